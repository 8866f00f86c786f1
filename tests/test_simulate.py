"""The simulated world obeys the physics that estimates are judged by."""

import copy
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from pushes import AWAY, OPPOSITE, SIZES, gap_and_normal, line, push, squeeze

from tactilenlp.data.noise_model import Noise
from tactilenlp.errors import OptionError, SceneError
from tactilenlp.simulation.world import World


def shot(friction_ground):
    """A box that a finger accelerates to 0.4 m/s and lets go; its world and its x."""
    time = np.linspace(0, 0.9, 901)
    ramp = np.minimum(time, 0.25)
    x = -0.055 + np.where(ramp < 0.2, ramp**2, 0.04 + 0.4 * (ramp - 0.2))
    column = np.stack([x, 0 * x, 0 * x + 0.02], axis=1)[:, None]
    options = {"friction_ground": friction_ground, "max_force": 30.0}
    world = World([0.04] * 3, finger_radius=[0.01], **options)
    world.execute(SimpleNamespace(time=time, finger_position=column))
    return world, world.truth.object_position[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["box", "icosahedron"])
def test_resting_object_does_not_drift(shape):
    if shape == "box":
        world = World(SIZES)
    else:  # on one of its faces
        mesh = trimesh.creation.icosahedron()
        down = trimesh.geometry.align_vectors(mesh.face_normals[0], [0, 0, -1])
        world = World(vertices=mesh.vertices @ down[:3, :3].T * 0.02)
    world.execute(line((AWAY, AWAY), (OPPOSITE, OPPOSITE), duration=2.0))
    moved = world.truth.object_position - world.truth.object_position[0]
    assert abs(moved).max() < 1e-5  # 0.01 mm: a hundredth of the sensors' noise


@pytest.mark.parametrize("friction", [0.15, 0.3])
def test_sliding_distance_is_v_squared_over_2_mu_g(friction):
    world, x = shot(friction)
    free = np.flatnonzero(world.truth.impulse[:, 0].any(axis=1))[-1] + 1
    v = (x[free + 2] - x[free]) * 30 / 2  # at free + 1, under constant friction
    assert v > 0.15
    assert x[-1] - x[free + 1] == pytest.approx(v**2 / (2 * friction * 9.81), rel=0.05)


def test_impulse_of_finger_becomes_momentum_on_frictionless_ground():
    world, x = shot(0.0)
    v = (x[-1] - x[-5]) * 30 / 4
    impulse = world.truth.impulse[:, 0].sum(axis=0)
    # The ground keeps MuJoCo's smallest friction, 1e-5: it takes 0.1 mm/s in a second.
    np.testing.assert_allclose(impulse[0], 0.5 * v, rtol=1e-3)
    assert abs(impulse[1]) < 1e-6


def test_a_box_that_falls_comes_back_up_by_the_square_of_its_restitution():
    away = np.tile([[[1.0, 0.0, 1.0]]], (2, 1, 1))
    wait = SimpleNamespace(time=np.array([0.0, 0.5]), finger_position=away)
    fall = {"position": (0, 0, 0.07), "settle": 0, "finger_radius": [0.01]}
    for e in (0.3, 0.6):
        world = World([0.04] * 3, restitution=e, rate=510, **fall)
        world.execute(wait)
        z = world.truth.object_position[:, 2]
        landed = np.argmax(z < 0.0205) + 5  # samples: the contact is over
        # A contact of milliseconds: the speed is right to a twentieth.
        assert np.sqrt((z[landed:].max() - 0.02) / 0.05) == pytest.approx(e, abs=0.05)


@pytest.mark.slow
def test_fingers_sink_in_by_less_than_a_tenth_of_a_millimetre():
    for mass in (0.5, 2.0):
        world = World(SIZES, mass=mass)
        world.execute(squeeze())
        truth = world.truth
        assert truth.normal_force.max() > 7.0  # both servos at their limit
        assert truth.distance.min() > -1e-4
        assert abs(truth.distance[truth.normal_force > 5]).max() < 1e-4
        assert truth.object_position[:, 2].min() > SIZES[2] / 2 - 1e-4


def test_servo_does_not_push_harder_than_its_limit():
    world = World(SIZES, mass=5.0, max_force=3.0)
    world.execute(push())
    assert world.truth.normal_force[-3:, 0] == pytest.approx(3.0, abs=0.05)
    # Friction holds 14 N: what is left is creep.
    assert abs(world.truth.object_position[-1, 0]) < 1e-5


def test_distances_and_normals_are_those_of_the_box(pushed):
    world = pushed[0]
    truth, touching = world.truth, world.truth.contact
    distance, normal = gap_and_normal(SIZES, truth)
    np.testing.assert_allclose(truth.distance, distance - 0.01, atol=1e-6)
    # The normal is the one last felt: in 10 ms the box turns by less than 0.01 rad.
    assert touching.sum() > 15
    np.testing.assert_allclose(truth.normal[touching], normal[touching], atol=0.01)
    # A push beside the centre turns the box, by 0.02 rad at the first sample.
    np.testing.assert_allclose(truth.normal[touching][0], [1, 0, 0], atol=0.03)


def test_normal_on_an_edge_points_from_edge_to_finger():
    world = World(SIZES, mass=5.0, finger_radius=[0.01])
    world.execute(line(([0.08, 0.0, 0.095], [0.0, 0.0, 0.015])))  # 45 degrees
    touching = world.truth.contact[:, 0]
    _, normal = gap_and_normal(SIZES, world.truth)
    first = world.truth.normal[touching][0, 0]
    np.testing.assert_allclose(first, normal[touching][0, 0], atol=0.02)
    assert 0.2 < first[2] < 0.98


def test_box_given_by_its_vertices_moves_like_the_box(pushed):
    mesh = trimesh.creation.box(SIZES)
    mesh.apply_translation([0.3, 0.2, 0.1])  # shifted back: the origin is the centroid
    world = World(vertices=mesh)
    assert abs(world.vertices).max(axis=0) == pytest.approx(SIZES / 2)
    data, box = world.execute(push()), pushed[1]
    assert (data.contact != box.contact).sum() <= 1
    end = pushed[0].truth.object_position[30]
    np.testing.assert_allclose(world.truth.object_position[-1], end, atol=1e-3)


def test_convex_body_has_the_inertia_of_uniform_density():
    points = np.random.default_rng(3).normal(size=(30, 3)) * 0.02
    world = World(vertices=points, mass=0.7, position=(0, 0, 1), settle=0)
    hull = trimesh.convex.convex_hull(world.vertices)
    hull.density = 0.7 / hull.volume
    model = world.plant.model
    np.testing.assert_allclose(hull.center_mass, 0, atol=1e-9)
    np.testing.assert_allclose(model.body_ipos[1], 0, atol=1e-9)
    expected = np.sort(np.linalg.eigvalsh(hull.moment_inertia))
    np.testing.assert_allclose(np.sort(model.body_inertia[1]), expected, rtol=1e-6)


@pytest.mark.slow
def test_raised_ground_shifts_everything_and_nothing_else():
    up = np.array([0, 0, 0.037])
    low, high = World(SIZES), World(SIZES, ground=0.037)
    lifted = push()
    lifted.finger_position = lifted.finger_position + up
    a, b = low.execute(push()), high.execute(lifted)
    assert (a.contact == b.contact).all()
    shift = high.truth.object_position - low.truth.object_position
    np.testing.assert_allclose(shift - up, 0, atol=2e-4)  # rounding, through friction


def test_body_floats_without_ground_and_gravity():
    world = World(SIZES, ground=None, gravity=0.0, position=(0, 0, 0.02))
    world.execute(push())
    assert world.truth.contact[:, 0].any()
    assert world.truth.object_position[-1, 0] < -0.03


@pytest.mark.parametrize(
    "about",
    [
        {"ground": 10.02},
        {"ground": None, "gravity": 0.0, "position": (0, 0, 10)},
        {"side_lengths": [0.1, 0.1, 2.0], "ground": 9.0},
        {"side_lengths": None, "vertices": 30 * np.eye(4, 3), "ground": 9.0},
    ],
    ids=["raised", "floating", "tall", "hull as high as a house"],
)
def test_an_object_of_any_height_stays_where_it_was_set_down(about):
    world = World(**{"side_lengths": SIZES} | about)
    assert (world.plant.distance() > 1.0).all()  # of the fingers, which wait above
    np.testing.assert_allclose(world.pose[:3], world.position, atol=1e-5)
    np.testing.assert_allclose(world.pose[3:], world.quaternion, atol=1e-5)


def test_an_object_falls_freely_from_any_height_before_the_first_action():
    settle = 0.05
    world = World(SIZES, position=(1.0, 0.0, 9.995), settle=settle)
    fallen = 9.81 / 2 * settle**2
    # Steps h of the integrator add g h t / 2, here 0.06 mm, to the parabola.
    np.testing.assert_allclose(world.pose[:3], [1, 0, 9.995 - fallen], atol=1e-4)


def test_fingers_of_any_radius_wait_apart_from_each_other():
    world = World(SIZES, finger_radius=[0.8, 0.02, 1.4, 0.7])
    apart = np.diff(world.plant.fingers[:, 0])
    assert (apart > world.finger_radius[1:] + world.finger_radius[:-1]).all()
    waiting = world.plant.fingers
    world.plant.hold(0.1)
    np.testing.assert_allclose(world.plant.fingers, waiting, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"side_lengths": None}, "side_lengths"),
        ({"side_lengths": [0.1, 0.1]}, "side_lengths"),
        ({"side_lengths": [0.1, 0.1, -0.1]}, "side_lengths"),
        ({"side_lengths": None, "vertices": np.eye(3)}, "vertices"),
        ({"side_lengths": None, "vertices": np.ones((8, 2))}, "vertices"),
        ({"mass": 0.0}, "mass"),
        ({"mass": "heavy"}, "mass"),
        ({"mass": 1e-300}, "mass"),
        ({"friction_ground": -0.1}, "friction_ground"),
        ({"finger_radius": []}, "finger_radius"),
        ({"gravity": np.nan}, "gravity"),
        ({"ground": None}, "ground"),
        ({"position": (0, 0, 0)}, "position"),
        ({"quaternion": (1, 1, 0, 0)}, "quaternion"),
        ({"max_force": None}, "max_force"),
        ({"settle": -1.0}, "settle"),
        ({"settle": 300.0}, "settle.*at most 30 s"),
        ({"rate": 0.0}, "rate"),
        ({"rate": 1e5}, "rate.*at most 4080 Hz"),
        ({"restitution": 0.95}, "restitution"),
    ],
)
def test_impossible_world_is_refused_by_name(options, name):
    with pytest.raises(SceneError, match=name):
        World(**{"side_lengths": SIZES} | options)


def test_bad_trajectory_or_noise_is_refused(pushed):
    world = copy.deepcopy(pushed[0])
    good = push()
    late = SimpleNamespace(time=good.time[::-1], finger_position=good.finger_position)
    flat = SimpleNamespace(time=good.time, finger_position=good.finger_position[:, :1])
    for bad, name in ((late, "time"), (flat, "finger_position"), (None, "time")):
        with pytest.raises(OptionError, match=name):
            world.execute(bad)
    inside = world.pose[:3]
    with pytest.raises(OptionError, match="finger 1 starts inside"):
        world.execute(line(([0.1, 0, 0.02], [0, 0, 0.02]), (inside, inside)))
    for bad in ({"flips": 1.5}, {"position": -1.0}, {"seed": 0.5}, {"bias": np.nan}):
        with pytest.raises(OptionError, match=next(iter(bad))):
            Noise(**bad)


def test_importing_the_module_stays_light():
    code = "import sys, tactilenlp.simulation.world; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
