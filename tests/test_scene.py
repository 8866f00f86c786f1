"""A scene says what is known; its ground maps the world to level ground at z = 0."""

import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

from tactilenlp.data.measurements import Measurements
from tactilenlp.data.scene import Ground, Scene
from tactilenlp.errors import MeasurementError, OptionError, SceneError

SCENES = Path(__file__).parents[2] / "shared" / "scenes"
ROUNDING = 1e-15  # [m], a few doubles of order 0.3 added up
TILTS = {
    "level": (0.0, 0.0, 1.0),
    "tilted": (0.6, 0.0, 0.8),
    "wall": (0.0, 1.0, 0.0),
    "overhang": (0.48, -0.36, -0.8),
    "almost down": (1e-4, 0.0, -np.sqrt(1 - 1e-8)),
    "down": (0.0, 0.0, -1.0),
}


def measurements():
    """Make one action of 6 samples of 2 fingers, all centres above z = 0."""
    rng = np.random.default_rng(0)
    contact = rng.random((6, 2)) < 0.5
    vectors, q = rng.normal(size=(6, 2, 3)), rng.normal(size=(6, 2, 4))
    normal = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return Measurements(
        time=np.arange(6) / 30,
        finger_position=rng.uniform(0.01, 0.09, (6, 2, 3)),
        finger_radius=0.01,
        contact=contact,
        normal=normal * contact[..., None],
        action=np.zeros(6, int),
        finger_orientation=q / np.linalg.norm(q, axis=-1, keepdims=True),
    )


# What is known


def test_the_default_scene_is_that_of_the_recordings():
    scene = Scene()
    assert (scene.mass, scene.friction_ground, scene.friction_finger) == (0.5, 0.3, 0.5)
    assert scene.ground == Ground(height=0.0, normal=(0.0, 0.0, 1.0))
    assert scene.gravity == 9.81
    assert scene.sigma_position is scene.sigma_normal is scene.flip_rate is None


def test_frictions_ground_and_sensors_may_be_unknown_and_the_scene_is_frozen():
    scene = Scene(friction_ground=None, friction_finger=None, ground=None)
    with pytest.raises(FrozenInstanceError):
        scene.mass = 1.0
    assert replace(scene, gravity=0).gravity == 0.0
    assert hash(Scene()) == hash(Scene())


def test_a_file_gives_mass_frictions_gravity_and_height_and_nothing_else(tmp_path):
    truth = {"ground": 0.3, "sigma_normal": 0.2, "side_lengths": np.array([{}])}
    np.savez(tmp_path / "a.npz", mass=0.02, friction_ground=0.1, **truth)
    scene = Scene.load(tmp_path / "a.npz")
    assert scene == Scene(mass=0.02, friction_ground=0.1)
    np.savez(tmp_path / "b.npz", **truth)
    assert Scene.load(tmp_path / "b.npz", mass=0.5) == Scene()
    np.savez(tmp_path / "c.npz", mass=0.5, gravity=0, ground_height=[])
    assert Scene.load(tmp_path / "c.npz") == Scene(ground=None, gravity=0)
    given = Scene.load(tmp_path / "c.npz", ground=Ground(0.1), gravity=1.6)
    assert given == Scene(ground=Ground(0.1), gravity=1.6)


def test_a_file_without_mass_is_refused_unless_it_is_given(tmp_path):
    np.savez(tmp_path / "b.npz", friction_ground=0.1)
    with pytest.raises(SceneError, match="mass") as caught:
        Scene.load(tmp_path / "b.npz")
    assert "--mass" in caught.value.next


def test_what_the_caller_says_goes_before_what_the_file_says(tmp_path):
    np.savez(tmp_path / "a.npz", mass=0.02, friction_ground=0.1)
    scene = Scene.load(tmp_path / "a.npz", friction_ground=None, flip_rate=0.01)
    assert scene == Scene(mass=0.02, friction_ground=None, flip_rate=0.01)


def test_an_unknown_field_is_answered_with_the_known_ones(tmp_path):
    np.savez(tmp_path / "a.npz")
    with pytest.raises(OptionError, match="friction_floor") as error:
        Scene.load(tmp_path / "a.npz", friction_floor=0.1)
    assert "friction_ground" in error.value.expected


def test_files_that_hold_no_scene_are_refused(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"mass = 0.5")
    with pytest.raises(SceneError, match="cannot be read"):
        Scene.load(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", mass=np.array([{}]))
    with pytest.raises(SceneError, match="mass: cannot be read"):
        Scene.load(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", mass=[0.5, 0.5])
    with pytest.raises(SceneError, match="mass: not one number"):
        Scene.load(tmp_path / "a.npz")


BAD = [
    ("mass", None),
    ("mass", 0),
    ("mass", -0.5),
    ("mass", np.nan),
    ("mass", np.inf),
    ("mass", "0.5"),
    ("mass", True),
    ("friction_ground", -0.1),
    ("friction_ground", 10),
    ("friction_finger", -1e-9),
    ("friction_finger", np.nan),
    ("friction_finger", 1j),
    ("gravity", -9.81),
    ("gravity", None),
    ("sigma_position", 0.0),
    ("sigma_position", 1.0),
    ("sigma_offset", 1.0),
    ("sigma_normal", -0.1),
    ("flip_rate", 0.5),
    ("flip_rate", -0.01),
    ("ground", 0.037),
]


@pytest.mark.parametrize(("field", "value"), BAD)
def test_what_cannot_be_true_is_refused_by_field(field, value):
    with pytest.raises(SceneError) as error:
        Scene(**{field: value})
    assert error.value.where == field
    assert error.value.got == repr(value)
    assert all((error.value.expected, error.value.next))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("normal", (0, 0, 0)),
        ("normal", (0, 0, 1.00001)),
        ("normal", (0, 0, np.nan)),
        ("normal", (0, 1)),
        ("normal", None),
        ("height", np.inf),
        ("height", None),
        ("height", (0, 0, 0.037)),
    ],
)
def test_a_ground_that_is_no_plane_is_refused(field, value):
    with pytest.raises(SceneError) as error:
        Ground(**{field: value})
    assert error.value.where == f"ground.{field}"
    assert all((error.value.got, error.value.expected, error.value.next))


# The ground frame


def test_level_ground_turns_nothing_and_a_height_only_shifts():
    assert np.array_equal(Ground().rotation, np.eye(3))
    assert np.array_equal(Ground().origin, np.zeros(3))
    points = np.random.default_rng(0).normal(size=(5, 2, 3))
    assert np.array_equal(Ground().to_ground(points), points)
    shelf = Ground(height=0.037)
    assert np.array_equal(shelf.rotation, np.eye(3))
    assert np.array_equal(shelf.to_ground(points), points - [0, 0, 0.037])


@pytest.mark.parametrize("normal", TILTS.values(), ids=TILTS)
def test_the_ground_becomes_z_zero_and_its_normal_plus_z(normal):
    ground = Ground(height=0.3, normal=normal)
    R_gw = ground.rotation
    assert np.allclose(R_gw @ R_gw.T, np.eye(3), atol=ROUNDING, rtol=0)
    assert np.linalg.det(R_gw) == pytest.approx(1)
    assert np.allclose(R_gw @ normal, [0, 0, 1], atol=ROUNDING, rtol=0)
    assert np.allclose(ground.to_ground(ground.origin), 0, atol=ROUNDING)
    p_w = np.random.default_rng(1).uniform(-0.3, 0.3, (4, 3))
    p_g = ground.to_ground(p_w)
    assert np.allclose(p_g[:, 2], ground.distance(p_w), atol=ROUNDING, rtol=0)
    assert np.allclose(p_g, p_w @ R_gw.T + ground.translation, atol=ROUNDING, rtol=0)
    assert np.allclose(ground.from_ground(p_g), p_w, atol=ROUNDING, rtol=0)


def test_a_normal_within_rounding_is_made_a_unit_normal():
    normal = np.array([0.6, 0.0, 0.8]) * (1 + 5e-7)
    assert np.allclose(
        Ground(normal=normal).normal, (0.6, 0.0, 0.8), atol=1e-15, rtol=0
    )


def test_data_on_tilted_ground_map_to_level_ground():
    level = measurements()
    ground = Ground(height=0.3, normal=TILTS["tilted"])
    R_wg = ground.rotation.T
    tilted = level.transformed(R_wg, ground.origin)
    back = tilted.transformed(ground.rotation, ground.translation)
    for key in ("finger_position", "normal"):
        assert np.allclose(getattr(back, key), getattr(level, key), atol=1e-15, rtol=0)
    Scene(ground=ground).check(tilted)


# The frame of measurements


def test_moving_the_frame_moves_points_and_only_turns_directions():
    data = measurements()
    R = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # yaw of 90 deg
    moved = data.transformed(R, [0.0, 0.0, 0.5])
    x, y, z = np.moveaxis(data.finger_position, -1, 0)
    assert np.array_equal(moved.finger_position, np.stack([-y, x, z + 0.5], axis=-1))
    x, y, z = np.moveaxis(data.normal, -1, 0)
    assert np.array_equal(moved.normal, np.stack([-y, x, z], axis=-1))
    w, x, y, z = np.moveaxis(data.finger_orientation, -1, 0)
    turned = np.stack([w - z, x - y, x + y, w + z], axis=-1) / np.sqrt(2)  # (1, k) q
    same = abs(np.sum(turned * moved.finger_orientation, axis=-1))  # q and -q are one
    assert np.allclose(same, 1, atol=1e-14)


@pytest.mark.parametrize(
    ("R", "t"),
    [
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3)),
        (2 * np.eye(3), np.zeros(3)),
        (np.full((3, 3), np.nan), np.zeros(3)),
        (np.eye(4), np.zeros(3)),
        (np.eye(3), np.zeros(2)),
    ],
    ids=["mirror", "scale", "nan", "4 x 4", "flat offset"],
)
def test_what_is_no_rigid_motion_is_refused(R, t):
    with pytest.raises(MeasurementError, match="not a rigid motion") as error:
        measurements().transformed(R, t)
    assert error.value.where == "R, t"
    assert all((error.value.got, error.value.expected, error.value.next))


# Measurements against the scene


def test_a_finger_whose_centre_is_below_the_ground_is_refused():
    data = measurements()
    p_wf = data.finger_position.copy()
    p_wf[3, 1, 2] = p_wf[4, 0, 2] = -0.002
    data = replace(data, finger_position=p_wf)
    with pytest.raises(MeasurementError, match="2 mm below") as error:
        Scene().check(data)
    assert (error.value.where, error.value.index) == ("finger_position", (3, 1))
    assert all((error.value.expected, error.value.next))
    Scene(ground=None).check(data)
    Scene(ground=Ground(height=-0.01)).check(data)


def test_a_fingertip_may_touch_and_even_dent_the_ground():
    data = measurements()
    p_wf = data.finger_position.copy()
    p_wf[..., 2] = 0.0  # centres on the ground: the lower half of a tip of 10 mm is in
    Scene().check(replace(data, finger_position=p_wf))


def test_a_sample_that_is_not_valid_may_lie_anywhere():
    data = measurements()
    p_wf, valid = data.finger_position.copy(), np.ones((6, 2), bool)
    p_wf[3, 1, 2], valid[3, 1] = -0.5, False
    Scene().check(replace(data, finger_position=p_wf, valid=valid))


# Recorded scenes


@pytest.mark.skipif(not SCENES.is_dir(), reason=f"no recorded scenes at {SCENES}")
def test_recorded_scenes_pass_the_door_and_come_back_to_the_last_digit(tmp_path):
    for path in sorted(SCENES.glob("*.npz"))[::7]:
        data, scene = Measurements.load(path), Scene.load(path)
        scene.check(data)
        data.save(tmp_path / "again.npz")
        assert Measurements.load(tmp_path / "again.npz") == data
        with np.load(path) as raw:
            assert np.array_equal(raw["finger_position"], data.finger_position)
            assert np.array_equal(raw["contact"] & raw["valid"], data.contact)
            assert scene.friction_finger == raw["friction_finger"]
            assert scene.mass == raw["mass"]
        assert data.dt == pytest.approx(1 / 30)


def test_measurements_and_scene_import_numpy_only():
    code = "import tactilenlp.data.scene, sys; print(*sys.modules)"
    loaded = subprocess.check_output([sys.executable, "-c", code], text=True).split()
    assert not {"scipy", "casadi", "mujoco", "trimesh", "matplotlib"} & set(loaded)
