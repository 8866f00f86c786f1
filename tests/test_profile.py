"""How far a size may be off: by what it costs to be elsewhere, not by curvature."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import (
    CYLINDER,
    Ground,
    Options,
    World,
    explore,
    polytope,
    solve_estimate,
)
from tactilenlp.information.error_budget_terms import REACHED
from tactilenlp.refinement import certification
from tactilenlp.refinement import profile_likelihood as profile_of
from tactilenlp.refinement.profile_likelihood import (
    KNOWN_POSITION,
    VAGUE_SHARE,
    profiled,
    touched_ends,
)
from tactilenlp.search.hypothesis import Hypothesis
from tactilenlp.search.margins import PROFILE_RISE

SHARP = 0.4e-3  # [m] that a Hessian claims
PRIOR = CUBOID.size_prior[1]
AT = Hypothesis(np.full(3, 0.04), np.zeros((3, 2)), 0.0, ())


def deviation(price, touched=(0, 9), seeks=True, cost=None, claimed=SHARP):
    """Return what `deviation_along` makes of a price [nats] of a change [m].

    The body moves by half of what it grows.  A larger one starts where it was.
    touched: samples on both faces of a size, None where a pose is off; seeks: whether
    a lower price ends the profile; cost(change [m]): that of the prior; claimed [m]:
    by the Hessian.
    """
    sharp = np.r_[1, 0, 0, 1 / 2, 0, 0] * claimed

    def elsewhere(axis, pull, moved, step):
        change = step * pull[axis]
        grows = touched is not None and change > 0 and min(touched) == 0
        assert (moved is not None) == grows
        cost, grown = price(change), np.r_[change, 0, 0]
        if cost is None:
            return None
        there = {"theta": AT.theta + grown, "x": AT.x + grown[:, None] / 2}
        return replace(AT, objective=cost, **there)

    touched = None if touched is None else np.array(touched)
    given = AT, PRIOR, 0, sharp, sharp, touched, seeks, cost
    off, better = profile_of.deviation_along(elsewhere, *given)
    assert off == pytest.approx(sharp / claimed * off[0])
    return abs(off[0]), better


def test_a_parabola_has_the_deviation_of_its_curvature():
    found, better = deviation(lambda d: (d / SHARP) ** 2 / 2)
    assert better is None
    assert found == pytest.approx(SHARP)


def test_a_kink_is_as_wide_as_its_slopes_say():
    slope = 80.0  # [nats / m] where the kink itself looks as sharp as SHARP
    found, _ = deviation(lambda d: slope * abs(d))
    assert found > VAGUE_SHARE * PRIOR  # 6 mm cost 0.48 nats, less than one sigma
    assert slope * found < PROFILE_RISE  # no farther than where that is the price


def test_sigma_of_a_size_is_read_from_the_profile_of_a_larger_body():
    def price(d):  # on its right an exponential of 2 mm, on its left a parabola
        return 500 * d if d > 0 else (d / SHARP) ** 2 / 2

    # The second step of a straight line ends where the rise is reached.
    where_it_costs_so_much = np.sqrt(PROFILE_RISE / 2) * 2e-3
    assert deviation(price)[0] == pytest.approx(where_it_costs_so_much)


def test_of_a_pose_both_directions_are_profiled_and_the_flatter_one_counts():
    for side in (1, -1):

        def price(d, side=side):
            return 500 * side * d if side * d > 0 else (d / SHARP) ** 2 / 2

        # The profile of a pose ends at half the rise of that of a size.
        flatter = deviation(price, None)[0]
        assert flatter == pytest.approx(np.sqrt(PROFILE_RISE / 4) * 2e-3)


def plateau(height):
    """Return a price that rises within 0.5 mm to a plateau of so many nats."""
    return lambda d: height * min(1.0, abs(d) / 0.5e-3) + prior_of(d)


def prior_of(d):
    """Return the cost [nats] that a Gaussian prior at its mean adds to a change [m]."""
    return (d / PRIOR) ** 2 / 2


def test_a_plateau_behind_a_narrow_optimum_counts_by_its_posterior_mass():
    for height in (3.1, 3.5):  # the profile ends at PROFILE_RISE: it looks narrow
        price = plateau(height)
        d = np.linspace(0, 5 * PRIOR, 100_000)
        density = np.exp(-np.array([price(k) for k in d]))
        exact = np.sqrt((density * d**2).sum() / density.sum())
        narrow, _ = deviation(price)
        wide, _ = deviation(price, cost=prior_of)
        assert narrow < 1.5 * SHARP
        assert exact / 2 < wide < 1.3 * exact  # the narrow part is seen too wide
    far = deviation(plateau(7.0), cost=prior_of)[0]  # of hardly any mass
    assert far == deviation(plateau(7.0))[0]


@pytest.mark.parametrize(("height", "solves"), [(8.0, 2), (30.0, 1)])
def test_a_plateau_is_looked_for_only_where_it_could_have_weight(height, solves):
    """Behind a rise of 8 nats within 0.5 mm it could, behind one of 30 it could not."""
    asked, price = [], plateau(height)
    deviation(lambda d: asked.append(d) or price(d), cost=prior_of)
    assert len(asked) == solves


def test_a_large_deviation_is_as_large_as_one_solve_far_off_says():
    claimed = 0.4 * PRIOR  # too large for a profile
    assert claimed > VAGUE_SHARE * PRIOR
    told = deviation(lambda d: (d / claimed) ** 2 / 2, cost=prior_of, claimed=claimed)
    assert told[0] == pytest.approx(claimed, rel=0.1)
    open_ = deviation(prior_of, cost=prior_of, claimed=claimed)
    assert open_[0] == pytest.approx(PRIOR, rel=0.1)
    unsolved = deviation(lambda d: None, cost=prior_of, claimed=claimed)
    assert unsolved[0] == claimed


def test_a_lower_objective_that_does_not_last_does_not_end_a_profile():
    def price(d):
        return -0.4 if 0 < d < 3e-3 else 4.0

    _, better = deviation(price)
    assert better is not None
    found, better = deviation(price, seeks=False)
    assert better is None
    assert found > 5 * SHARP


def test_profiles_go_on_where_a_better_optimum_is_not_better_with_nothing_held(
    monkeypatch,
):
    asked = []

    def profiles(job, best, seeks=True):
        asked.append(seeks)
        return np.eye(6), AT if seeks else None

    solution = SimpleNamespace(success=True)
    deadline = SimpleNamespace(passed=lambda _: False)
    job = SimpleNamespace(
        options=SimpleNamespace(rivals=True), deadline=deadline,
        page=SimpleNamespace(LEVELS=(None,)),
    )  # fmt: skip
    certificates = SimpleNamespace(broken=())
    best = Certified(solution, certificates, job, (False, 1.0))
    monkeypatch.setattr(certification, "profiled", profiles)
    monkeypatch.setattr(certification, "certified", lambda job, solved: solved)
    for rank, same in (((False, 1.2), True), ((False, 0.6), False)):
        again = replace(best, rank=rank)
        monkeypatch.setattr(certification, "solved_from", lambda *_, a=again, **__: a)
        asked.clear()
        found = certification.with_profiles(best)
        assert asked == [True, False]
        assert (found.rank == best.rank) == same
        assert (found.profile == np.eye(6)).all()


@dataclass(frozen=True)
class Certified:
    """What `with_profiles` reads of a solve."""

    solution: object
    certificates: object
    job: object
    rank: tuple
    profile: object = None


def test_sizes_of_classes_without_known_faces_are_all_open():
    solved = SimpleNamespace(at=AT)
    assert not touched_ends(CYLINDER, solved).any()
    assert len(touched_ends(CYLINDER, solved)) == CYLINDER.theta
    assert touched_ends(polytope(20), solved) is None


def test_the_yaw_of_a_box_that_was_only_pressed_on_its_top_is_open(recorded):
    """Friction alone would tell it to a degree or two."""
    data, scene, _ = recorded
    top = data.select([0])
    assert top.normal[top.contact][:, 2].min() > 0.99
    estimate = solve_estimate(top, scene, options=Options(hypotheses=2, starts=2))
    assert estimate.information.sigma("rotation")[2] > np.radians(5)


def test_a_pose_is_no_surer_than_its_curvature():
    found, _ = deviation(lambda d: 10 * (d / SHARP) ** 2 / 2, None)
    assert found == pytest.approx(SHARP)


def test_faces_that_were_felt_go_along_with_a_larger_body():
    assert deviation(lambda d: (d / SHARP) ** 2 / 2, (9, 9))[0] == pytest.approx(SHARP)


def test_what_costs_nothing_is_known_by_its_prior_alone():
    # The profile ends where the sigma is vague, and no farther than where PROFILE_RISE
    # nats would leave it so: 0.3 to 0.73 deviations of the prior.
    found = deviation(lambda d: 0.0)[0] / PRIOR
    assert VAGUE_SHARE <= found <= VAGUE_SHARE * np.sqrt(2 * PROFILE_RISE) < 0.75


@pytest.mark.parametrize("slope", [60.0, 200.0, 2e4])
def test_no_offset_is_evaluated_whose_sigma_would_be_vague(slope):
    asked = []

    def price(d):
        asked.append(abs(d))
        return slope * abs(d)

    deviation(price)
    assert asked[0] <= VAGUE_SHARE * PRIOR
    assert max(asked) <= VAGUE_SHARE * PRIOR * np.sqrt(2 * PROFILE_RISE) * (1 + 1e-9)
    assert len(asked) <= 4
    dear = [d for d in asked if slope * d >= PROFILE_RISE]
    assert dear in ([], asked[-1:])  # once it is dear enough, no more


def test_without_a_solution_of_the_profile_sigma_is_that_of_the_hessian():
    assert deviation(lambda d: None) == (SHARP, None)


def test_a_smaller_size_is_profiled_where_a_larger_one_has_no_solution():
    def price(d):
        return None if d > 0 else (d / SHARP) ** 2 / 2

    assert deviation(price)[0] == pytest.approx(SHARP)


def test_a_better_optimum_is_returned():
    found, better = deviation(lambda d: -3.0 if d > 0 else 9.0)
    assert found == SHARP
    assert better.objective == -3.0


def test_an_untouched_size_is_no_surer_than_its_profile(touched, recorded):
    truth = recorded[2]["side_lengths"]
    untouched = [i for i, faces in enumerate(touched.faces) if faces.min() == 0]
    assert untouched
    sigma = touched.information.sigma("side_lengths")
    never = touched.faces.max(axis=1) == 0
    assert never.any()
    assert (sigma[never] >= VAGUE_SHARE * PRIOR).all()
    order = np.argsort(touched.side_lengths)  # the names of the axes are arbitrary
    error = touched.side_lengths[order] - np.sort(truth)
    assert (np.abs(error) < 3 * sigma[order]).all()  # each by its own sigma


def test_a_place_that_the_hessian_claims_little_of_is_no_surer_than_that(touched):
    sharp = touched.information.of_hessian().sigma("position")[:2]
    along = np.argmax(sharp)
    assert sharp[along] > KNOWN_POSITION
    within = sharp[along] / np.hypot(1, sharp[along] / REACHED)  # of the pose's prior
    assert touched.information.sigma("position")[along] > 0.99 * within


def test_a_body_without_sides_has_no_profile():
    job = SimpleNamespace(
        shape=replace(CUBOID, symmetries=()), reductions=SimpleNamespace(planar=True)
    )
    found, better = profiled(job, SimpleNamespace(at=AT))
    assert better is None
    assert not found.any()


@pytest.mark.slow
def test_a_touch_of_the_top_alone_leaves_finite_sigma():
    """The Hessian is indefinite: the place of what only its top tells is open."""
    turn = 1.0909 / 2
    world = World(
        (0.03693529, 0.05700028, 0.04258107), position=(-0.01250407, -0.00079563),
        quaternion=[np.cos(turn), 0, 0, np.sin(turn)],
    )  # fmt: skip
    steps = [*explore(world, actions=1, seed=1005, centre=world.pose[:3])]
    first = steps[0].estimate
    assert np.isfinite(first.information.sigma("side_lengths")).all()
    assert np.isfinite(first.information.sigma("position")).all()


def test_only_a_ground_touches_the_lowest_face_of_a_box():
    for ground in (None, Ground()):
        job = SimpleNamespace(scene=SimpleNamespace(ground=ground))
        faces = np.array([[0, 9], [0, 0], [0, 9]])
        solved = SimpleNamespace(at=AT, job=job, touched=faces)
        ends = touched_ends(CUBOID, solved)
        assert (ends.min(axis=1) > 0).tolist() == [False, False, ground is not None]
