"""The page `paper` says what is printed: every term by hand, slopes, two actions."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations import paper
from formulations.contact import MM
from formulations.paper_contact import LAM_MAX
from formulations.rigid_body import FREE
from formulations.shape import CUBOID
from tactilenlp.data.scene import Scene
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.reductions import Reductions, window_of_samples

SCENE = Scene()
W = SCENE.mass * 9.81 / 30  # [N s] the weight over a step
WEIGHT = {name: value for name, (value, _) in paper.WEIGHTS.items()}

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer


@pytest.fixture(scope="module")
def free(recorded):
    """The page in free motion on two actions, at a random point near the truth."""
    data, _, truth = recorded
    data, rng = data.select([0, 1]), np.random.default_rng(0)
    T = data.samples
    turn = Rotation.from_quat(np.roll(truth["object_quaternion"][:T], -1, axis=1))
    x = np.vstack([truth["object_position"][:T].T, turn.as_rotvec().T])
    theta = truth["side_lengths"]
    off = Reductions(planar=False, absent=False)
    window = window_of_samples(
        data, SCENE, CUBOID, Precision(0, 0), off, guess=(theta, x)
    )
    assert window.motion is FREE
    assert min(map(len, (window.lift, window.push, window.gap, window.rest))) > 0
    problem = Problem()
    paper.build(problem, window, SCENE, CUBOID)
    x = x[:, window.last]
    # A tenth of a millimetre and half a degree: gaps of either sign, sliding, turning.
    spread = np.array([[1e-4]] * 3 + [[0.01]] * 3)
    values = {"theta": theta, "x": x + spread * rng.normal(size=x.shape)}
    for name in ("finger", "ground"):
        lam = rng.normal(size=problem.variables[name].guess.shape) * W / 3
        values[name] = np.vstack([np.abs(lam[:1]), lam[1:]])
    z = problem.pack(values)
    return SimpleNamespace(
        window=window, problem=problem, values=values,
        value=lambda name: problem.value(name, z, problem.data()).squeeze(1),
    )  # fmt: skip


# The same equations by hand, one instance after another


def pose(values, k):
    return values["x"][:3, k], Rotation.from_rotvec(values["x"][3:, k]).as_matrix()


def gap_and_normal(values, k, p_wf, rho):
    """Return phi [m] and n (3,) of the rounded solid, as `shape.py` says it."""
    p, R = pose(values, k)
    q, half = R.T @ (p_wf - p), values["theta"] / 2
    small = rho / 10
    modulus = np.sqrt(q**2 + (small / 10) ** 2)
    d = modulus - half
    part = (d + np.sqrt(d**2 + (small / 5) ** 2)) / 2
    depth = -small * np.log(np.exp(d / small).sum())
    inside = (depth + np.sqrt(depth**2 + (small / 5) ** 2)) / 2
    gradient = part**2 / np.sqrt(d**2 + (small / 5) ** 2) * q / modulus
    phi = np.linalg.norm(part) - inside - rho
    return phi, R @ gradient / np.linalg.norm(gradient)


def pushed(free, j):
    """Return gap, frame (3, 3) of n, t1, t2 and point p_w of push j."""
    push = free.window.push
    k, rho = free.window.step.pose[push.step[j]], push.radius[j]
    phi, n = gap_and_normal(free.values, k, push.p_wf[j], rho)
    t = push.tangent[j] - n * (n @ push.tangent[j])
    t_1 = t / np.sqrt(t @ t + 1e-9)
    return phi, np.array([n, t_1, np.cross(n, t_1)]), push.p_wf[j] - rho * n


def velocity(free, j):
    """Return v_n [m/s], positive where body and finger part, and v_s (2,)."""
    push, step = free.window.push, free.window.step
    s = push.step[j]
    _, frame, p_w = pushed(free, j)
    (p, R), (p_1, R_1) = (pose(free.values, i) for i in (step.pose[s], step.before[s]))
    before = p_1 + R_1 @ R.T @ (p_w - p)
    v = (p_w - before - (push.p_wf[j] - push.p_wf_1[j])) / step.dt[s]
    v_n, *v_s = frame @ v
    return -v_n, np.array(v_s)


def corner(free, index, signs):
    p, R = pose(free.values, index)
    return p + R @ (signs * free.values["theta"] / 2)


def corner_velocity(free, c):
    step, s = free.window.step, free.window.corner.step[c]
    signs = free.window.corner.signs[c]
    way = corner(free, step.pose[s], signs) - corner(free, step.before[s], signs)
    return way / step.dt[s]


def agree(got, expected):
    """Check every instance against its twin by hand, and that they are not all zero."""
    scale = np.abs(expected).max()
    assert scale > 0
    np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-9 * scale)


def energies(name, losses):
    """Return losses [J] in the unit of the page, times the weight of the term."""
    return WEIGHT[name] * np.array(losses) / (W * MM)


# What is felt


def test_a_felt_sample_costs_its_normal_in_the_norm_of_sigma_and_the_logistic(free):
    touch, inverse = free.window.touch, np.linalg.inv(paper.SIGMA_N)
    expected = []
    for i in range(len(touch)):
        where = touch.pose[i], touch.p_wf[i], touch.radius[i]
        phi, n = gap_and_normal(free.values, *where)
        off, logit = touch.normal[i] - n, np.log(19) / 5e-3 * phi
        expected.append(off @ inverse @ off / 2 + np.log(1 + np.exp(logit)))
    agree(free.value("touch"), expected)


def test_a_sample_without_contact_costs_the_logistic_of_its_gap(free):
    f, expected = free.window.free, []
    for i in range(len(f)):
        phi, _ = gap_and_normal(free.values, f.pose[i], f.p_wf[i], f.radius[i])
        logit = np.log(19) / 5e-3 * phi
        expected.append(np.log(1 + np.exp(logit)) - logit)
    agree(free.value("free"), expected)


# What moves


def test_a_pose_is_compared_with_one_step_of_impulse_and_momentum(free):
    window, values = free.window, free.values
    step, push, corners = window.step, window.push, window.corner
    m, theta = SCENE.mass, values["theta"]
    inertia = np.diag((theta @ theta - theta**2) / 12)
    expected, got = np.zeros(len(step)), np.zeros(len(step))
    for count, group in window.groups.items():
        got[group.steps] = free.value(f"dynamics, {count} pushing")
    for s in range(len(step)):
        indices, dt = (step.pose[s], step.before[s], step.before_2[s]), step.dt[s]
        (p, R), (p_1, R_1), (p_2, R_2) = (pose(values, k) for k in indices)
        force, moment = np.zeros(3), np.zeros(3)
        for c in np.nonzero(corners.step == s)[0]:
            impulse = values["ground"][[1, 2, 0], c]
            force += impulse
            moment += np.cross(corner(free, indices[0], corners.signs[c]) - p, impulse)
        for j in np.nonzero(push.step == s)[0]:
            _, frame, p_w = pushed(free, j)
            impulse = frame.T @ (values["finger"][:, j] * [-1, 1, 1])
            force += impulse
            moment += np.cross(p_w - p, impulse)
        p_f = p_1 + (p_1 - p_2) + (force / m - [0, 0, 9.81 * dt]) * dt
        J, d = R_1 @ inertia @ R_1.T, Rotation.from_matrix(R_1 @ R_2.T).as_rotvec()
        d = d + np.linalg.solve(J, dt * moment / m - np.cross(d, J @ d))
        R_f = Rotation.from_rotvec(d).as_matrix() @ R_1
        off = (p - p_f) @ (p - p_f) + 0.02**2 * ((R - R_f) ** 2).sum() / 2
        expected[s] = off / (2 * WEIGHT["dynamics deviation"] ** 2)
    # `turn` cuts the series of arcsin after its fifth power: 1e-9 at these turns.
    np.testing.assert_allclose(got, expected, rtol=1e-5)


def test_between_actions_the_object_stays(free):
    gap, expected = free.window.gap, []
    for index, before in zip(gap.pose, gap.before, strict=True):
        (p, R), (p_1, R_1) = pose(free.values, index), pose(free.values, before)
        off = (p - p_1) @ (p - p_1) + 0.02**2 * ((R - R_1) ** 2).sum() / 2
        expected.append(off / (2 * WEIGHT["dynamics deviation"] ** 2))
    agree(free.value("between actions"), expected)


# Contact


def test_complementarity_is_the_normal_impulse_times_the_gap_of_either_sign(free):
    pushes, up = range(len(free.window.push)), free.window.lift
    phi = np.array([pushed(free, j)[0] for j in pushes])
    assert phi.min() < 0 < phi.max()
    loss = free.values["finger"][0] * phi
    agree(free.value("finger complementarity"), energies("complementarity", loss))
    rows = zip(free.window.step.pose[up.step], up.signs, strict=True)
    z = [corner(free, index, signs)[2] for index, signs in rows]
    loss = free.values["ground"][0] * z
    agree(free.value("ground complementarity"), energies("complementarity", loss))


def test_dissipation_is_printed_without_mu_and_with_the_square_of_the_speed(free):
    dt = free.window.step.dt.mean()
    lam, loss = free.values["finger"], []
    for j in range(len(free.window.push)):
        _, v_s = velocity(free, j)
        loss.append((v_s @ v_s * lam[0, j] + v_s @ lam[1:, j]) * dt)
    agree(free.value("finger dissipation"), energies("dissipation", loss))
    lam, loss = free.values["ground"], []
    for c in range(len(free.window.corner)):
        v_s = corner_velocity(free, c)[:2]
        loss.append((v_s @ v_s * lam[0, c] + v_s @ lam[1:, c]) * dt)
    agree(free.value("ground dissipation"), energies("dissipation", loss))


def test_inelasticity_charges_what_pushes_while_it_parts(free):
    dt, still = free.window.step.dt.mean(), WEIGHT["speed rounding"]
    for name, velocities in (
        ("finger", [velocity(free, j)[0] for j in range(len(free.window.push))]),
        ("ground", [corner_velocity(free, c)[2] for c in range(len(free.window.lift))]),
    ):
        exact = free.values[name][0] * np.maximum(velocities, 0) * dt
        charged = free.value(f"{name} inelasticity")
        more = charged - energies("inelasticity", exact)
        bound = energies("inelasticity", free.values[name][0] * still / 2 * dt)
        assert (more >= -1e-12).all()
        assert (more <= bound + 1e-12).all()


def test_penetration_is_charged_by_its_square_and_a_gap_is_free(free):
    deviation, touch = WEIGHT["penetration deviation"], free.window.touch
    where = zip(touch.pose, touch.p_wf, touch.radius, strict=True)
    phi = np.array([gap_and_normal(free.values, *w)[0] for w in where])
    expected = np.minimum(0, phi) ** 2 / (2 * deviation**2)
    agree(free.value("felt finger penetration"), expected)
    up, rest = free.window.lift, free.window.rest
    for name, indices, signs in (
        ("ground", free.window.step.pose[up.step], up.signs),
        ("rest", rest.pose, rest.signs),
    ):
        z = [corner(free, k, s)[2] for k, s in zip(indices, signs, strict=True)]
        expected = np.minimum(0, z) ** 2 / (2 * deviation**2)
        agree(free.value(f"{name} penetration"), expected)


def test_the_friction_cone_contains_exactly_the_impulses_of_coulombs_law(free):
    for name, mu in (("finger", 0.5), ("ground", 0.3)):
        lam = free.values[name] / W
        inside = np.hypot(lam[1], lam[2]) <= mu * lam[0]
        assert 0 < inside.sum() < len(inside)
        np.testing.assert_array_equal(free.value(f"{name} cone") >= 0, inside)


def test_pushing_harder_where_the_finger_sank_in_is_paid_for(free):
    """Why lam_n is bounded: two fingers that squeeze move nothing and gain by (1)."""
    deep = np.array([pushed(free, j)[0] for j in range(len(free.window.push))]) < 0
    more = {**free.values, "finger": free.values["finger"] * np.where(deep, 2.0, 1.0)}
    z, name = free.problem.pack(more), "finger complementarity"
    after = free.problem.value(name, z, free.problem.data())
    assert after.sum() < free.value(name).sum()
    assert free.problem.variables["finger"].upper[0] == pytest.approx(LAM_MAX * W)


# Slopes and solves


def test_derivatives_agree_with_finite_differences(free):
    report = free.problem.check(free.values)
    # Differences straddle the kink of min(0, phi) where |phi| < 1e-8 m: in no instance.
    assert max(max(errors) for errors in report.derivatives.values()) < 1e-4
    assert report.assembled < 1e-4
