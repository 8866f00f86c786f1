"""How far a size may be off: by what it costs to be elsewhere, not by curvature."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp.local.margins import PROFILE_RISE
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.refinement.profile_deviation import (
    STEEP_RISE,
    TAIL_GROWTH,
    VAGUE_SHARE,
    Point,
    Profile,
)

SHARP = 0.4e-3  # [m] that a Hessian claims
PRIOR = CUBOID.size_prior[1]
AT = Hypothesis(np.full(3, 0.04), np.zeros((3, 2)), 0.0, ())


def solve(at):
    """Return what a profile reads of a solve that ended at a hypothesis."""
    return SimpleNamespace(at=at, solution=SimpleNamespace(objective=at.objective))


def deviation(price, touched=(0, 9), seeks=True, cost=None, claimed=SHARP):
    """Return what a `Profile` makes of a price [nats] of a change [m].

    The body moves by half of what it grows.  A larger one starts where it was.
    touched: samples on both faces of a size, None where a pose is off; seeks: whether
    a lower price ends the profile; cost(change [m]): that of the prior; claimed [m]:
    by the Hessian.
    """
    sharp = np.r_[1, 0, 0, 1 / 2, 0, 0] * claimed
    felt = None if touched is None else np.array(touched)

    def solve_held(step, start, direction, touched):
        grows = felt is not None and direction[0] > 0 and min(felt) == 0
        assert (touched is not None) == grows
        assert start.step < step
        change = step * direction[0]
        rise, grown = price(change), np.r_[change, 0, 0]
        if rise is None:
            return None
        other = {"theta": AT.theta + grown, "x": AT.x + grown[:, None] / 2}
        return Point(step, rise, solve(replace(AT, objective=rise, **other)))

    profile = Profile(solve(AT), 0, PRIOR, felt, seeks, cost)
    off, better = profile.deviation(solve_held, sharp, sharp)
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


@pytest.mark.parametrize("height", [5.0, 8.0, 30.0])
def test_a_plateau_is_looked_for_only_where_it_could_have_weight(height):
    """Behind a rise of 5 nats within 0.5 mm it could, behind one of 8 it could not."""
    asked, price = [], plateau(height)
    deviation(lambda d: asked.append(d) or price(d), cost=prior_of)
    if height < 2 * PROFILE_RISE:
        assert asked[-1] == PRIOR
        assert max(np.divide(asked[1:], asked[:-1])) <= TAIL_GROWTH
    else:  # what rises steeply is looked at once more, nearer
        assert len(asked) == 1 + (height > STEEP_RISE * PROFILE_RISE)


def test_behind_a_plateau_that_ends_no_more_is_looked_for():
    asked, price = [], plateau(5.0)
    deviation(
        lambda d: asked.append(d) or price(d) + 2 * PROFILE_RISE * (d > 2e-3),
        cost=prior_of,
    )
    assert asked[-2] < 2e-3 < asked[-1] < PRIOR / 2


def test_what_falls_again_behind_a_rise_counts_by_its_posterior_mass():
    """A second optimum that is 1 nat above the first one, behind a ridge of 5."""

    def ridge(d):
        return (5.0 if d < 3e-3 else 1.0) * min(1.0, d / 0.5e-3) + prior_of(d)

    # Most of the mass is at the second one: as wide as the prior.
    assert deviation(ridge, cost=prior_of)[0] > 0.9 * PRIOR


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
    steep = int(slope * asked[0] > STEEP_RISE * PROFILE_RISE)  # it is repeated nearer
    dear = [d for d in asked[steep:] if slope * d >= PROFILE_RISE]
    assert dear in ([], asked[-1:])  # once it is dear enough, no more


def test_what_lies_before_a_wall_is_looked_for_in_a_few_steps():
    end = 10e-3  # where a finger passed, say; before it hardly a rise
    found, _ = deviation(lambda d: 0.2 if d < end else 100.0)
    assert end / 2 < found < end
    end, asked = 8.3e-3, []  # just before the step that met it: neared without end
    deviation(lambda d: asked.append(d) or (0.3 if d < 2e-3 else 1 + 99 * (d > end)))
    assert len(asked) <= 6


def test_a_solve_that_ends_in_another_optimum_does_not_end_a_profile():
    """From farther than 1.2 mm it does; along the optimum it hardly rises."""
    near = [0.0]

    def price(d):
        if abs(d - near[-1]) > 1.2e-3:
            return 20.0
        near.append(d)
        return 0.01

    assert deviation(price)[0] > 3 * SHARP
    asked = []
    deviation(lambda d: asked.append(d) or (d / SHARP) ** 2 / 2 + 50 * (d > 1e-3))
    assert len(asked) == 2  # a parabola before a wall: the Hessian is right


def test_without_a_solution_of_the_profile_sigma_is_that_of_the_hessian():
    assert deviation(lambda d: None) == (SHARP, None)


def test_a_smaller_size_is_profiled_where_a_larger_one_has_no_solution():
    def price(d):
        return None if d > 0 else (d / SHARP) ** 2 / 2

    assert deviation(price)[0] == pytest.approx(SHARP)


def test_a_better_optimum_is_returned():
    found, better = deviation(lambda d: -3.0 if d > 0 else 9.0)
    assert found == SHARP
    assert better.solution.objective == -3.0
