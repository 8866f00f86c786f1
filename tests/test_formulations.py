"""The pages say what physics says: derivatives, invariance, cases solved by hand."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from programmes import programme, sums, true_values
from scipy.spatial.transform import Rotation
from solid import RHO

from formulations import violation_implicit
from formulations.finger import capsule
from formulations.rigid_body import FREE
from formulations.shape import CUBOID
from tactilenlp import Options, solve_estimate
from tactilenlp.data.measurements import Measurements
from tactilenlp.data.scene import Scene
from tactilenlp.problem.pages import FORMULATIONS, page_of
from tactilenlp.problem.reductions import Reductions, states_planar_motion
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import solve, solve_levels

PAGES = {name: page_of(name, CUBOID) for name in FORMULATIONS}

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer


CASES = {
    "planar": {},
    "free": {"choice": Reductions(planar=False)},
    "unreduced, unknown friction": {
        "choice": Reductions(still=False, far=False, absent=False),
        "scene": {"friction_ground": None, "friction_finger": None},
    },
    "no ground": {
        "choice": Reductions(planar=False),
        "scene": {"ground": None, "gravity": 0.0},
    },
}
STATED = [
    (page, case) for page in PAGES for case in CASES
    if not (case in ("free", "no ground") and states_planar_motion(PAGES[page]))
]  # fmt: skip
# Shooting states the programme of multiple shooting; its steps take long to derive.
DERIVED = [pair for pair in STATED if pair[0] != "shooting"]
MOVED = [
    pytest.param(page, case, marks=pytest.mark.slow)
    if "shooting" in page or (page, case) == ("paper", "free")
    else (page, case)
    for page, case in STATED if case in ("planar", "free")
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("page", "case"), DERIVED)
def test_every_term_of_a_page_has_the_derivatives_of_finite_differences(
    page, case, two_actions, request
):
    if case not in ("planar", "free"):  # used nowhere else: not worth compiling
        request.getfixturevalue("interpreted")
    data, scene, truth = two_actions
    scene = replace(scene, **CASES[case].get("scene", {}))
    problem, window = programme(PAGES[page], data, scene, CASES[case].get("choice"))
    rng = np.random.default_rng(8)
    values = true_values(problem, window, truth, rng)
    # At rest without a ground the balance is flat: differences are rounding.  On the
    # ground the curvature of the printed min(0, phi)^2 jumps, which differences miss.
    if case == "no ground" or (page, case) == ("paper", "free"):
        x = problem.variables["x"]
        values["x"] += x.scale[:, None] * rng.normal(size=(x.rows, x.columns))
    report = problem.check(values)
    for name, (first, second) in report.derivatives.items():
        # Steps of 6e-6 of a scale, edges rounded over a tenth of one: 1e-8, rounding.
        assert first < 1e-5, name
        assert second < 1e-5, name
    assert report.assembled < 1e-5
    # Without a ground nothing tells how the object goes on between actions.
    idle = {"ground friction", "gap scale"} if case == "no ground" else set()
    assert set(report.unused) <= idle


@pytest.mark.slow
def test_the_gradient_of_shooting_is_that_of_differences(two_actions):
    """Of the first poses and the sizes alone: the others follow from them."""
    data, scene, truth = two_actions
    problem, window = programme(PAGES["shooting"], data, scene)
    rng, known, reduced = np.random.default_rng(7), problem.data(), problem.eliminated
    assert len(reduced.free) < problem.size / 3
    values = problem.pack(true_values(problem, window, truth))
    u = (values / problem.scale)[reduced.free]
    slope = reduced.evaluated(u, known)[1]
    for _ in range(5):
        way = 1e-5 * rng.normal(size=u.size)
        up, down = (reduced.value(u + side * way, known)[0] for side in (1, -1))
        # The square of a step over the rounding of edges, a tenth of a scale.
        assert slope @ way == pytest.approx((up - down) / 2, rel=1e-5)


@pytest.mark.parametrize(("page", "case"), MOVED)
def test_moving_the_whole_world_over_the_ground_costs_nothing(page, case, two_actions):
    data, scene, truth = two_actions
    spin, t = Rotation.from_euler("z", 0.8), np.array([0.3, -0.2, 0.0])
    moved = data.transformed(spin.as_matrix(), t)
    choice = CASES[case].get("choice")
    problem, window = programme(PAGES[page], data, scene, choice)

    def carry_tangents(there):
        # Where a finger touches the top, t1 is a fixed direction: it moves as well.
        return {"push": replace(there.push, tangent=spin.apply(window.push.tangent))}

    problem_2, _ = programme(PAGES[page], moved, scene, choice, carry_tangents)
    values = true_values(problem, window, truth, np.random.default_rng(9))
    there = dict(values)
    x = values["x"]
    rows = 3 if window.motion is FREE else 2
    position = np.vstack([x[:rows], np.zeros((3 - rows, x.shape[1]))])
    there["x"] = np.vstack([(spin.apply(position.T) + t).T[:rows], x[rows:] + 0.8])
    if window.motion is FREE:
        turned = spin * Rotation.from_rotvec(x[3:].T)
        there["x"][3:] = turned.as_rotvec().T
    if "ground" in values:
        force = values["ground"][[1, 2, 0]]  # along x, y, z
        there["ground"] = spin.apply(force.T).T[[2, 0, 1]]
    here, carried = sums(problem, values), sums(problem_2, there)
    for name in here:
        # Positions of 0.3 m, known to 1e-16 of that, are compared with 1e-4 m.
        assert carried[name] == pytest.approx(here[name], rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize(("page", "case"), MOVED)
def test_a_quarter_turn_with_two_sides_swapped_is_the_same_body(
    page, case, two_actions
):
    data, scene, truth = two_actions
    problem, window = programme(PAGES[page], data, scene, CASES[case].get("choice"))
    values = true_values(problem, window, truth, np.random.default_rng(10))
    other = dict(values)
    other["theta"] = values["theta"][[1, 0, 2]]
    other["x"] = (
        values["x"] + np.array([[0], [0], [np.pi / 2]] + [[0]] * 3)[: len(values["x"])]
    )
    if window.motion is FREE:
        R = Rotation.from_rotvec(values["x"][3:].T) * Rotation.from_euler(
            "z", np.pi / 2
        )
        other["x"] = np.vstack([values["x"][:3], R.as_rotvec().T])
    if "ground" in values:
        # The corner (a, b) of the old body is (b, -a) of the turned one.
        signs, step = window.corner.signs, window.corner.step
        order = np.empty(len(step), int)
        for i, (a, b, c) in enumerate(signs):
            same = (signs == [b, -a, c]).all(axis=1) & (step == step[i])
            order[np.nonzero(same)[0][0]] = i
        other["ground"] = values["ground"][:, order]
    here, there = sums(problem, values), sums(problem, other)
    for name in here:
        assert there[name] == pytest.approx(here[name], rel=1e-9, abs=1e-9), name


def test_where_the_object_slides_the_impulses_are_those_of_the_simulator(recorded):
    data, scene, truth = recorded
    problem, window = programme(violation_implicit, data, scene)
    values = true_values(problem, window, truth)
    known = tuple({"theta", "x", "depth"} & set(problem.variables))
    options = SolverOptions(barrier=1e-1)
    solution = solve(problem, options, start=values, fixed=known)
    x, push = problem.pack(solution.values), window.push
    impulse = problem.value("finger impulse", x, problem.data())
    way = np.diff(truth["object_position"], axis=0, prepend=np.nan)
    sliding = np.linalg.norm(way, axis=1)[push.sample] > 2e-3
    assert sliding.sum() > 10
    true = truth["truth_impulse"][push.sample, push.finger]
    error = np.linalg.norm(impulse - true, axis=1)[sliding] / (scene.mass * 9.81 / 30)
    # In weights: at 6 cm/s friction with the ground, 0.3, is known in size and sense.
    # The simulator's contacts are not quite rigid, and two fingers share a push; a
    # wrong sign or frame would be off by one weight everywhere.
    assert np.median(error) < 0.25
    assert error.max() < 0.8


HARD = "complementarity", "multiple_shooting", "shooting"  # physics as constraints
SIDES, POSE = np.array([0.04, 0.06, 0.05]), np.array([0.01, -0.02, 0.3])


def squeezed(samples=8):
    """Measure a cuboid at rest, touched on two opposite sides, two others, and the top.

    Three actions of two fingers that stay where they touch.
    """
    rng = np.random.default_rng(11)
    R, centre = Rotation.from_euler("z", POSE[2]), np.r_[POSE[:2], SIDES[2] / 2]
    p, n = np.zeros((3, 2, 3)), np.zeros((3, 2, 3))
    for axis, (f, side) in itertools.product(range(3), enumerate((1, -1))):
        out = side * np.eye(3)[axis]
        inner = rng.uniform(-0.3, 0.3, 3) * SIDES * (out == 0)
        n[axis, f] = R.apply(out)
        p[axis, f] = R.apply(out * (SIDES / 2 + RHO) + inner) + centre
    p[2, 1], n[2, 1] = [0.2, 0.2, 0.2], 0  # there is no way below: it waits
    action = np.repeat(np.arange(3), samples)
    return Measurements(
        time=np.arange(len(action)) / 30, finger_position=p[action],
        finger_radius=RHO, contact=n[action].any(axis=2), normal=n[action],
        action=action,
    )  # fmt: skip


def with_capsules(window):
    """Make every fingertip a capsule that stands upright."""
    upright = [1.0, 0, 0, 0]
    rows = {}
    for name in ("touch", "free"):
        of = getattr(window, name)
        p_wf = np.hstack([of.p_wf, np.tile(upright, (len(of), 1))])
        rows[name] = replace(of, p_wf=p_wf)
    return {"finger": capsule(0.005), **rows}


@pytest.mark.parametrize(
    ("page", "finger"),
    [
        ("quasi_static", None),
        ("quasi_static", with_capsules),
        ("violation_implicit", None),
        *(pytest.param(page, None, marks=pytest.mark.slow) for page in HARD),
    ],
    ids=["quasi_static", "quasi_static with capsules", "violation_implicit", *HARD],
)
def test_a_cuboid_touched_on_both_faces_has_the_sides_between_them(
    page, finger, interpreted
):
    data, scene = squeezed(), Scene(mass=0.5)
    if finger is not None:
        data = raised(data)
    problem, window = programme(PAGES[page], data, scene, finger=finger)
    off = 2e-3 if page == "quasi_static" else 0.2e-3  # the second starts from the first
    start = {
        "theta": SIDES + off,
        "x": np.tile(POSE[:, None], (1, window.poses)) + off / 2,
    }
    options = SolverOptions(tolerance=1e-8)
    solution = solve_levels(problem, PAGES[page].LEVELS, start, options)
    assert solution.success
    # Eight touches a face, of 0.3 mm, against a prior of 20 mm that is up to 20 mm
    # away; gaps are rounded by a few micrometres.
    np.testing.assert_allclose(solution.values["theta"][:, 0], SIDES, atol=0.02e-3)
    x = solution.values["x"]
    # Along a face that nobody touches, relaxed dissipation lets a corner that carries a
    # quarter of the weight creep by sqrt(2 V_EPS dt EPS / (mu / 4)) = 0.05 mm a step.
    off = 8 * 0.05e-3 if page == "complementarity" else 0.02e-3
    np.testing.assert_allclose(x[:2], np.tile(POSE[:2, None], window.poses), atol=off)
    np.testing.assert_allclose(x[2], POSE[2], atol=1e-3)
    if page == "violation_implicit":
        assert_at_rest(problem, window, solution, scene)


def assert_at_rest(problem, window, solution, scene):
    """All impulses of a step add up to what carries the weight."""
    x, data = problem.pack(solution.values), problem.data()
    total = np.zeros((len(window.step), 3))
    for name, of in (("finger", window.push), ("ground", window.corner)):
        np.add.at(total, of.step, problem.value(f"{name} impulse", x, data))
    weight = scene.mass * 9.81 / 30
    # A balance that is off by 3 % of the weight costs half a nat.
    np.testing.assert_allclose(total, np.tile([0, 0, weight], (len(total), 1)),
                               atol=0.03 * weight)  # fmt: skip


def raised(data):
    """Lift the fingers on the top by the half length of an upright capsule."""
    p = data.finger_position.copy()
    p[data.normal[..., 2] > 0.5] += [0, 0, 0.005]
    return replace(data, finger_position=p)


@pytest.mark.slow
def test_a_body_in_free_motion_stays_on_the_ground_without_impulses(recorded):
    data, scene, _ = recorded
    told = Options(without="planar", profile_likelihood=False)
    estimate = solve_estimate(
        data.select([0, 1]), scene, formulation="quasi_static", options=told
    )
    heights = [
        estimate.mesh(t).vertices[:, 2].min()
        for t in range(estimate.measurements.samples)
    ]
    assert np.abs(heights).max() < 0.5e-3
