"""What a scene has not is not paid for, and leaves the optimum where it is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import squeezed
from scipy.spatial.transform import Rotation

from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Guess, Options, Problem, Scene, extend, solve_estimate
from tactilenlp.certificates.static_friction import LONGEST_SLIP, slip_gains
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.evaluation.metrics import cuboid_errors
from tactilenlp.local.transfer import transferred_values
from tactilenlp.nlp.term_functions import TermFunctionCache
from tactilenlp.problem.missing_samples import possible_contact
from tactilenlp.problem.pages import page_of
from tactilenlp.problem.reductions import (
    Reductions,
    may_move,
    required_reductions,
    window_of_samples,
)
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solution import evaluated
from tactilenlp.solvers.solve import solve, solve_levels


@pytest.fixture(scope="module")
def found(touched):
    """Data and scene of two actions, and where a search finds the object in them."""
    return touched.measurements, touched.scene, touched.hypotheses[0]


def programme(data, scene, h, off=()):
    known = CUBOID, precision_of(data, scene), Reductions.of(off)
    window = window_of_samples(data, scene, *known, guess=(h.theta, h.x))
    problem = Problem()
    page.build(problem, window, scene, CUBOID)
    return problem, {"theta": h.theta, "x": h.x[:, window.last]}


def total(problem, values):
    x, data = problem.pack(values), problem.data()
    return sum(problem.value(name, x, data).sum() for name in problem.costs)


@pytest.mark.slow
@pytest.mark.parametrize("slippery", ["finger", "ground", "both"])
def test_without_friction_no_tangential_impulse_is_possible_and_none_is_paid(
    found, slippery
):
    data, scene, h = found
    names = ("finger", "ground") if slippery == "both" else (slippery,)
    scene = replace(scene, **{f"friction_{name}": 0.0 for name in names})
    lean, start = programme(data, scene, h)
    whole, _ = programme(data, scene, h, off="frictionless")
    assert lean.rows < whole.rows
    rng = np.random.default_rng(13)
    values = lean.unpack(
        lean.pack(start) + 0.1 * lean.scale * rng.normal(size=lean.size)
    )
    full = dict(values)
    for name in names:
        v = whole.variables[name]
        assert lean.variables[name].rows == 1 < v.rows
        full[name] = np.vstack([np.abs(values[name]), np.zeros((2, v.columns))])
        values[name] = full[name][:1]
    # Wherever the tangential impulses are zero the two problems cost the same, and the
    # larger one allows nothing else: so they have one optimum.
    assert total(whole, full) == pytest.approx(total(lean, values), rel=1e-12)
    for name in names:
        v = whole.variables[name]
        full[name][1:] = 1e-3 * v.scale[0] * rng.normal(size=(2, v.columns))
        room = whole.value(f"{name} cone", whole.pack(full), whole.data())
        assert room.max() < 0


@pytest.mark.parametrize("name", ["far", "absent"])
def test_what_is_far_or_absent_leaves_the_optimum_where_it_is(found, name):
    data, scene, h = found
    exact = SolverOptions(tolerance=1e-8)
    known = CUBOID, precision_of(data, scene)
    windows = [
        window_of_samples(data, scene, *known, Reductions.of(off), guess=(h.theta, h.x))
        for off in ((), name)
    ]
    lean, whole = Problem(), Problem()
    page.build(lean, windows[0], scene, CUBOID)
    page.build(whole, windows[1], scene, CUBOID)
    instances = [sum(t.instances for t in p.terms.values()) for p in (lean, whole)]
    assert instances[0] < instances[1]
    start = {"theta": h.theta, "x": h.x[:, windows[0].last]}
    best = solve_levels(lean, page.LEVELS, start, exact)
    reduced = SimpleNamespace(problem=lean, window=windows[0], solution=best)
    start, _, _ = transferred_values(reduced, windows[1], whole)
    again = solve(whole, replace(exact, barrier=1e-5), start=start)
    assert again.objective == pytest.approx(best.objective, rel=1e-6, abs=1e-6)


def test_multipliers_follow_contacts_where_a_constraint_says_so_not_by_its_name(
    found,
):
    data, scene, h = found
    known = CUBOID, precision_of(data, scene)
    ends = [0, -1]

    def cap(nlp, window, scene, shape):
        x = nlp.variables["x"][:, ends]
        nlp.subject_to("ground tilt cap", lambda x: x[2], x, upper=3.0)

    capped, problems = extend("violation_implicit", cap), []
    windows = [
        window_of_samples(data, scene, *known, Reductions.of(off), guess=(h.theta, h.x))
        for off in ((), "still")
    ]
    for window in windows:
        problems.append(Problem(cache=TermFunctionCache(derive=False)))
        capped.build(problems[-1], window, scene, CUBOID)
    lean, whole = problems
    columns = {name: v.columns for name, v in lean.variables.items()}
    assert columns["ground"] < whole.variables["ground"].columns
    at = evaluated(lean, {})
    numbers = np.arange(columns["ground"])[:, None]
    own = {"ground tilt cap": np.array([[1.0], [2.0]]), "ground cone": 1.0 + numbers}
    at = replace(at, multipliers=at.multipliers | own)
    reduced = SimpleNamespace(problem=lean, window=windows[0], solution=at)
    _, _, moved = transferred_values(reduced, windows[1], whole)
    assert np.array_equal(moved["ground tilt cap"], own["ground tilt cap"])
    cone = moved["ground cone"]
    assert np.array_equal(cone[cone > 0], own["ground cone"].ravel())


def test_a_box_on_ice_is_found_without_tangential_impulses(found):
    data, scene, h = found
    ice = replace(scene, friction_ground=0.0, friction_finger=0.0)
    problem, start = programme(data, ice, h)
    assert problem.rows == 0  # no cone is left: bounds alone
    solution = solve_levels(problem, page.LEVELS, start, SolverOptions())
    assert solution.success


def test_a_finger_that_is_not_there_costs_nothing(found):
    data, scene, h = found
    other = np.arange(data.fingers) > 0
    blind = replace(data, valid=data.valid & ~other)
    per_finger = ("finger_position", "contact", "normal", "valid")
    first = {name: getattr(blind, name)[:, :1] for name in per_finger}
    alone = replace(blind, **first, finger_radius=data.finger_radius[:1])
    two, _ = programme(blind, scene, h)
    one, _ = programme(alone, scene, h)
    assert one.size == two.size < programme(data, scene, h)[0].size
    x = one.pack({"theta": h.theta})
    for name in one.terms:
        same = two.value(name, x, two.data()) == one.value(name, x, one.data())
        assert same.all(), name


SIDES, AT = np.array([0.04, 0.06, 0.05]), np.array([0.0, 0.0, 0.2])


@pytest.fixture(scope="module")
def floating():
    """A box in micro-gravity that two fingers squeeze, off its centre: it tumbles."""
    yaw = 0.3
    turn = (np.cos(yaw / 2), 0, 0, np.sin(yaw / 2))
    return squeezed(SIDES, position=AT, quaternion=turn)


def errors_of(estimate, world):
    true = world.truth
    return cuboid_errors(
        estimate.side_lengths, estimate.position[-1], estimate.quaternion[-1],
        SIDES, true.object_position[-1], true.object_quaternion[-1],
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("start", [None, Guess(SIDES + 5e-3, AT + 4e-3, 0.2)])
def test_a_floating_box_is_followed_as_it_turns(floating, start):
    # Of fingertips that may be soft no squeeze tells how deep they sit.
    scene = Scene(ground=None, gravity=0.0, compliance=0.0)
    data = floating.measurements
    estimate = solve_estimate(data, scene, start=start)
    assert estimate.unknowns["ground"].size == 0
    assert "ground" not in estimate.impulses
    true, found = (
        Rotation.from_quat(np.roll(q, -1, axis=1))
        for q in (floating.truth.object_quaternion, estimate.quaternion)
    )
    assert (true[-1] * true[0].inv()).magnitude() > np.radians(20)
    error = errors_of(estimate, floating)
    sigma = estimate.information.sigma("side_lengths")[error.permutation]
    # Squeezed along x: that side, and where its faces look, is known; the simulated
    # fingers sink in by a few hundredths of a millimetre.
    assert sigma[0] < 0.2e-3
    assert abs(error.side_lengths[0]) < 0.1e-3
    axis = found.apply(np.eye(3)[error.permutation[0]])
    off = np.linalg.norm(np.cross(axis, true.apply([1, 0, 0])), axis=1)
    felt = np.nonzero(floating.measurements.contact.any(axis=1))[0]
    # The first touch alone may be that of an edge: what it looked like is not known.
    assert off[felt[1:]].max() < np.radians(1)
    # No one else touched it: the turn about that axis is not known, and said so.
    assert (sigma[1:] > 5e-3).all()
    assert np.nanmax(estimate.information.sigma("rotation")) > np.radians(45)


def test_a_sample_that_comes_twice_is_no_time_step(recorded):
    """Its pose is the first one's, and the next step starts from that."""
    data, scene, _ = recorded
    felt = data.contact[:-1].any(axis=1) & data.contact[1:].any(axis=1)
    again = int(np.argmax(felt)) + 1  # while a finger pushes
    rows = np.sort(np.r_[np.arange(data.samples), again])
    arrays = {n: a[rows] for n, a in vars(data).items()
              if a is not None and n != "finger_radius"}  # fmt: skip
    arrays["time"] = arrays["time"] + 1e-3 * (np.arange(len(rows)) == again + 1)
    twice = replace(data, **arrays)
    precision = precision_of(data, scene)
    one, two = (
        window_of_samples(d, scene, CUBOID, precision, Reductions(still=False))
        for d in (data, twice)
    )
    assert two.poses == one.poses
    assert two.pose[again] == two.pose[again + 1]
    extra = data.contact[again].sum()
    assert len(two.touch.sample) == len(one.touch.sample) + extra
    for name in ("pose", "before", "before_2", "dt"):
        np.testing.assert_array_equal(getattr(two.step, name), getattr(one.step, name))
    np.testing.assert_array_equal(two.push.p_wf_1, one.push.p_wf_1)


def test_what_was_not_measured_beside_a_touch_may_have_moved_the_object(recorded):
    data, scene, _ = recorded
    data = data.select([1])
    t, f = np.argwhere(data.contact & data.valid)[0] + [2, 0]
    valid, contact, normal = data.valid.copy(), data.contact.copy(), data.normal.copy()
    valid[t:, f], contact[t:, f], normal[t:, f] = False, False, 0.0
    lost = replace(data, valid=valid, contact=contact, normal=normal)
    assert possible_contact(lost)[t:, f].all()
    first = np.arange(lost.samples) == 0
    assert may_move(lost, scene, first)[t:].all()
    # A finger that measures nothing in a whole action takes no part in it.
    valid[:, f], contact[:, f], normal[:, f] = False, False, 0.0
    away = replace(data, valid=valid, contact=contact, normal=normal)
    assert not possible_contact(away)[:, f].any()


def test_a_body_pushed_by_a_finger_that_reports_nothing_is_not_at_rest(touched):
    """Static friction holds a body that nothing pushes, and no other one."""
    data, whole = touched.measurements, touched
    rows = np.flatnonzero((data.action == 1) & data.contact.any(axis=1))
    contact = data.contact.copy()
    contact[rows[len(rows) // 2 :]] = False
    normal = np.where(contact[..., None], data.normal, 0.0)
    lost = replace(data, contact=contact, normal=normal)
    torn = solve_estimate(lost, touched.scene, options=Options(check_mistakes=False))
    (rest,) = [s for s in whole.skipped if s.name == "still"]
    assert rest.holds
    assert whole.cuts == ()
    assert whole.reductions["still"]
    # While it was pushed unfelt it has poses of its own.
    assert torn.cuts or not torn.reductions["still"]
    assert set(torn.cuts) <= set(range(rows[len(rows) // 2], data.samples))
    assert len(torn.unknowns["x"][0]) > len(whole.unknowns["x"][0])


def test_a_slip_gains_what_its_force_exceeds_friction_by_until_it_is_held():
    force, stiff = np.array([3e3, 3e3, -1e3]), np.array([1e7, -1.0, 1e7])
    gains = slip_gains(force, stiff)
    assert gains[0] == pytest.approx(force[0] ** 2 / stiff[0] / 2)
    assert gains[1] == pytest.approx(force[1] * LONGEST_SLIP, rel=1e-3)  # not held
    assert gains[2] == 0.0  # friction holds it


def test_a_touch_is_doubted_by_the_rate_of_wrong_booleans(found):
    data, scene, _ = found
    known = CUBOID, precision_of(data, scene), Reductions.of(())
    costs = [
        window_of_samples(data, replace(scene, flip_rate=rate), *known).outlier_cost
        for rate in (0.05, 0.001, None, 0.0)
    ]
    assert costs[0] == pytest.approx(3.0, abs=0.01)  # -log(0.05)
    assert costs[1] == pytest.approx(costs[2], abs=0.1)
    assert costs[2] < costs[3] < np.inf


def test_a_page_keeps_the_assumptions_that_it_cannot_give_up():
    asked = Reductions.of(("rigid", "central", "far"))
    kept = required_reductions(page_of("complementarity", CUBOID), asked)
    assert (kept.rigid, kept.central, kept.far) == (True, True, False)
    freed = required_reductions(page_of("violation_implicit", CUBOID), asked)
    assert (freed.rigid, freed.central, freed.far) == (False, False, False)
