"""A pushed body slides as Coulomb says, as MuJoCo says, and with exact derivatives."""

from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from conftest import benchmark
from scipy.spatial.transform import Rotation

from formulations.finger import SPHERE
from formulations.multiple_shooting import coming
from formulations.shape import CUBOID
from formulations.sliding_contact import LOAD_ROUNDING, Pusher
from formulations.time_stepping import STEP_V_EPS, Sliding, step_functions
from tactilenlp.nlp.term_functions import default_cache

G, MU_G, RHO = 9.81, 0.3, 0.01
SIDES = np.array([0.05, 0.04, 0.03])
AWAY = np.array([1.0, 1.0, 0.02])  # [m] a finger here touches nothing
BODY = Sliding(CUBOID, SPHERE, mass=0.5, gravity=G)

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer
paths = benchmark("sliding_path")


@pytest.fixture(scope="module")
def step():
    """One step with one finger: value, slopes and curvatures."""

    def stepped(theta, x_1, x_2, dt, mu, mu_g, v_eps, *finger):
        return BODY.step(theta, x_1, x_2, dt, mu, mu_g, v_eps, Pusher(*finger))

    sizes = (("z", 3), ("z", 3), ("z", 3), *(("d", n) for n in (1, 1, 1, 1, 3, 3, 1)))
    return default_cache().of(stepped, [3, 3, 3], list(sizes))


_x, _theta, _p = ca.SX.sym("x", 3), ca.SX.sym("theta", 3), ca.SX.sym("p", 3)
gap = ca.Function(
    "gap",
    [_theta, _x, _p],
    [SPHERE.gap(CUBOID, _theta, BODY.pose(_theta, _x), _p, RHO)],
)


def evaluated(step, part, *given):
    """Return what a part of a term function returns for one instance."""
    return step.evaluated(part, *(array[:, None] for array in given))


def rolled(step, x_0, v, fingers, dt, mu=0.5, mu_g=MU_G, v_eps=STEP_V_EPS):
    """Return poses (T, 3) from x_0 at velocity v, pushed by a finger at (T, 3) [m]."""
    x = [np.asarray(x_0, float) - dt * np.asarray(v), np.asarray(x_0, float)]
    for p_1, p in pairwise(fingers):
        z = np.concatenate([SIDES, x[-1], x[-2]])
        data = np.concatenate([[dt, mu, mu_g, v_eps], p, p_1, [RHO]])
        x.append(evaluated(step, "first", z, data)[0].ravel())
    return np.array(x[1:])


def energy(x, finger, dt):
    """Return kinetic energy, and that of the overlap, per unit mass [J/kg]."""
    v = np.diff(x, axis=0) / dt
    inertia = (SIDES[0] ** 2 + SIDES[1] ** 2) / 12
    z = -np.array([float(gap(SIDES, pose, finger)) for pose in x[1:]]) / (
        STEP_V_EPS * dt
    )
    # The primitive of lam_n / dt = m g S(-phi / (s dt)), from far away.
    root = np.hypot(z, LOAD_ROUNDING)
    work = (
        G
        * STEP_V_EPS
        * dt
        * (np.square(z) + z * root + LOAD_ROUNDING**2 * np.arcsinh(z / LOAD_ROUNDING))
    )
    return (v[:, 0] ** 2 + v[:, 1] ** 2 + inertia * v[:, 2] ** 2) / 2 + work / 4


def test_a_sliding_body_stops_after_v_squared_over_two_mu_g(step):
    v, dt = 0.2, 1e-3
    x = rolled(step, np.zeros(3), [v, 0, 0], np.tile(AWAY, (101, 1)), dt, v_eps=1e-4)
    # The implicit step loses half a step's way; `v_eps` lets it creep for microns.
    expected = v**2 / (2 * MU_G * G) - v * dt / 2
    assert x[-1, 0] == pytest.approx(expected, abs=2e-5)
    assert np.abs(x[-1, 1:]).max() < 1e-9


def test_a_body_that_nothing_touches_stays_at_rest(step):
    x = rolled(step, [0.1, 0.2, 0.3], np.zeros(3), np.tile(AWAY, (11, 1)), 1 / 30)
    # But for the far finger's rounded tail, 2e-7 weights.
    assert np.abs(x - x[0]).max() < 1e-8


def test_energy_never_grows_where_fingers_do_no_work(step):
    dt, finger, v = 1 / 300, np.array([0.060, 0.008, 0.015]), np.array([0.5, 0.1, 4.0])
    x = rolled(step, np.zeros(3), v, np.tile(finger, (61, 1)), dt, mu_g=0.05)
    e = energy(np.vstack([x[0] - dt * v, x]), finger, dt)
    assert np.all(np.diff(e) <= 1e-9)
    assert e[-1] < 0.1 * e[0]
    gaps = [float(gap(SIDES, pose, finger)) for pose in x]
    assert min(gaps) < 0 < gaps[0], "it never reached the finger"


@pytest.mark.parametrize("rate", [30, 300])
def test_an_impact_is_inelastic(step, rate):
    """Every weight of the impulse rebounds at two or three STEP_V_EPS, no more."""
    dt, v, finger = 1 / rate, 0.2, np.array([0.045, 0.0, 0.015])
    still = np.tile(finger, (rate, 1))
    x = rolled(step, np.zeros(3), [v, 0, 0], still, dt, mu_g=0.0)
    rebound = -np.diff(x[:, 0]).min() / dt
    assert 0 < rebound < 3 * STEP_V_EPS * (v / (G * dt) + LOAD_ROUNDING)
    assert x[:, 0].max() == pytest.approx(finger[0] - RHO - SIDES[0] / 2, abs=1e-4)


def test_a_finger_within_the_friction_cone_takes_the_body_along(step):
    t = np.linspace(0, 1, 31)[:, None]
    way = np.array([0.03, 0.01, 0.0])  # 18 degrees off the normal, friction holds 45
    start = np.array([-SIDES[0] / 2 - RHO, 0.0, 0.015])
    x = rolled(step, np.zeros(3), np.zeros(3), start + t * way, 1 / 30, mu=1.0)
    turn = x[-1, 2]
    arm = np.array([-SIDES[0] / 2, 0.0])
    c, s = np.cos(turn), np.sin(turn)
    touched = x[-1, :2] + np.array([[c, -s], [s, c]]) @ arm
    # It creeps at less than STEP_V_EPS, and rolls on the finger by RHO times the turn.
    slip = np.linalg.norm(touched - arm - way[:2]) - RHO * abs(turn)
    assert slip < STEP_V_EPS
    free = rolled(step, np.zeros(3), np.zeros(3), start + t * way, 1 / 30, mu=0.0)
    assert abs(free[-1, 1]) < 1e-3 < x[-1, 1]


def test_slopes_and_curvatures_are_exact(step):
    """Against central differences, at pushes that stick, slide and meet an edge."""
    pushes = (
        ([-0.0352, 0.005, 0.015], [-0.0382, 0.005, 0.015]),
        ([-0.0352, 0.005, 0.015], [-0.0352, 0.002, 0.015]),
        ([-0.0315, 0.0265, 0.02], [-0.033, 0.028, 0.022]),
    )
    for p, p_1 in pushes:
        z = np.r_[SIDES, 0.0, 0.0, 0.02, -0.0005, 0.0, 0.01]
        data = np.r_[1 / 30, 0.5, MU_G, STEP_V_EPS, p, p_1, RHO]
        multiplier = np.array([1.0, -2.0, 0.02])

        def slope(z, data=data):
            nonzeros = evaluated(step, "first", z, data)[1].ravel()
            return dense(step.jacobian_sparsity, nonzeros)

        def value(z, data=data):
            return evaluated(step, "first", z, data)[0]

        h = 1e-7 * np.eye(9)
        by_hand = [value(z + e) - value(z - e) for e in h]
        J = slope(z)
        assert np.abs(np.hstack(by_hand) / 2e-7 - J).max() < 1e-6 * np.abs(J).max()
        nonzeros = evaluated(step, "second", z, data, multiplier)[0].ravel()
        H = dense(step.hessian_sparsity, nonzeros)
        H = H + np.triu(H, 1).T
        by_hand = [multiplier @ (slope(z + e) - slope(z - e)) / 2e-7 for e in h]
        assert np.isfinite(H).all()
        assert np.abs(np.array(by_hand) - H).max() < 1e-4 * np.abs(H).max()


def dense(sparsity, nonzeros):
    rows, columns = sparsity.get_triplet()
    out = np.zeros(sparsity.shape)
    out[rows, columns] = nonzeros
    return out


def test_a_recorded_push_is_followed_within_a_millimetre(recorded, paths):
    """The shipped recording is MuJoCo's; every action starts at its true pose."""
    data, scene, truth = recorded
    turn = Rotation.from_quat(np.roll(truth["object_quaternion"], -1, axis=1))
    yaw = np.unwrap(turn.as_euler("zyx")[:, 0])
    x = np.column_stack([truth["object_position"][:, :2], yaw])
    known = [data.dt, scene.friction_finger, scene.friction_ground, STEP_V_EPS]
    body = Sliding(CUBOID, SPHERE, scene.mass, scene.gravity)
    found = []
    for action in np.unique(data.action):
        rows = np.nonzero(data.action == action)[0]
        walk = paths.path(body, data.fingers, len(rows))
        fingers = data.finger_position[rows].reshape(len(rows), -1).T
        args = truth["side_lengths"], known, fingers, data.finger_radius
        error = np.asarray(walk(x[rows[0]], *args)).T - x[rows]
        way = np.linalg.norm(x[rows[-1], :2] - x[rows[0], :2])
        off = np.linalg.norm(error[:, :2], axis=1).max()
        found.append(SimpleNamespace(off=off, turn=np.abs(error[:, 2]).max(), way=way))
    moved = [f for f in found if f.way > 5e-4]
    assert len(moved) >= 3
    assert np.median([f.off for f in moved]) < 0.5e-3
    assert np.median([f.turn for f in moved]) < np.radians(0.6)


def test_a_step_gives_way_to_an_impulse_as_its_balance_says(step):
    """Solved again with an impulse of a hundredth of a weight, pushed on the way."""
    dt, impulse = 1 / 30, np.array([0.01, -0.005, 0.008])
    x_1, x_2 = np.array([0.002, 0.0, 0.0]), np.zeros(3)
    finger = np.array([-0.033, 0.005, 0.015]), np.array([-0.035, 0.005, 0.015]), RHO
    known = SIDES, x_1, x_2, dt, 0.5, MU_G
    z = np.concatenate([SIDES, x_1, x_2])
    data = np.concatenate([[dt, 0.5, MU_G, STEP_V_EPS], *finger[:2], [RHO]])
    x = evaluated(step, "first", z, data)[0].ravel()
    response = BODY.impulse_response(x, *known, STEP_V_EPS, Pusher(*finger))
    way = np.asarray(ca.evalf(response)) @ impulse
    balance, slope, _ = step_functions(BODY, 1)
    moved = x.copy()
    for _ in range(20):
        off = np.asarray(balance(moved, STEP_V_EPS, *known, *finger)).ravel() - impulse
        moved -= np.linalg.solve(
            np.asarray(slope(moved, STEP_V_EPS, *known, *finger)), off
        )
    assert np.linalg.norm(way) > 1e-6
    assert moved - x == pytest.approx(way, rel=0.1, abs=0.1 * np.linalg.norm(way))


@pytest.mark.parametrize(("before", "now"), [(1, 1), (2, 1), (1, 2)])
def test_a_body_that_coasts_keeps_its_speed_whatever_the_times(step, before, now):
    v, dt_1, dt = np.array([0.1, 0.0, 0.5]), before / 30, now / 30
    x_2 = np.asarray(coming(np.zeros(3), -v * dt_1, dt, dt_1)).ravel()
    if before == now:
        assert (x_2 == -v * dt_1).all()
    z = np.concatenate([SIDES, np.zeros(3), x_2])
    data = np.concatenate([[dt, 0.5, 0.0, STEP_V_EPS], AWAY, AWAY, [RHO]])
    (x, *_) = evaluated(step, "first", z, data)
    np.testing.assert_allclose(x.ravel(), v * dt, rtol=1e-3, atol=1e-7)
