"""A camera behind a soft dome: flow, where something presses, its normal."""

import math
import sys

import numpy as np
import pytest
from bench import capture

pytest.importorskip("cv2", reason='needs the extra: pip install "tactilenlp[optical]"')
import cv2

from hardware.errors import (
    FrameError,
    HardwareError,
    RigError,
)
from hardware.optical import LEAST, Lens, OpticalTouch
from hardware.optical_flow import Flow, grey, normalised
from hardware.rig import Tactile
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.simulated_skin import SimulatedSkin

SHAPE = (240, 320)  # [px]
LENS = Lens((160.0, 120.0), 118.0)
IDENTITY = tuple(map(tuple, np.eye(3).tolist()))


def towards(polar, azimuth):
    """The dome's normal at angles [deg] from its axis and about it."""
    p, a = math.radians(polar), math.radians(azimuth)
    return np.array([math.sin(p) * math.cos(a), math.sin(p) * math.sin(a), math.cos(p)])


@pytest.fixture(scope="module")
def skin():
    return SimulatedSkin(LENS, SHAPE)


@pytest.fixture(scope="module")
def sensor(skin):
    sensor = OpticalTouch(LENS, mount=IDENTITY)
    sensor.learn([skin.picture() for _ in range(5)])
    return sensor


# The flow


def test_the_flow_of_a_known_warp_is_found_within_a_tenth_of_a_pixel(skin):
    push = towards(20, 60)
    flow, miss = Flow(skin.picture())(skin.picture(push, 1.0))
    known = skin.displacement(push, 1.0)
    inside = np.linalg.norm(skin._pixel - LENS.centre, axis=-1) < 110
    error = np.linalg.norm(flow - known, axis=-1)[inside]
    assert np.median(error) < 0.1
    assert (miss[inside] < 1).mean() > 0.9


def test_light_that_changes_moves_nothing(skin):
    reference, later = skin.picture(), skin.picture().astype(float)
    tilt = np.linspace(0.6, 1.2, SHAPE[1])
    flow, _ = Flow(reference)(np.clip(later * tilt, 0, 255).astype(np.uint8))
    assert np.percentile(np.linalg.norm(flow, axis=-1), 90) < 0.15


def test_pictures_may_be_grey_or_in_colour():
    g = np.random.default_rng(0).integers(0, 256, (8, 9)).astype(np.uint8)
    assert np.array_equal(grey(np.dstack([g, g, g])), g)
    assert grey(np.dstack([g, g, g, g])[::1]).flags.c_contiguous
    assert normalised(np.full((20, 20), 77, np.uint8)).tolist() == [[128] * 20] * 20
    for wrong in (g.astype(float), g[0], np.dstack([g, g]), np.zeros((0, 3), np.uint8)):
        with pytest.raises(FrameError, match="no picture"):
            grey(wrong)


def test_pictures_of_another_size_are_refused(skin):
    with pytest.raises(FrameError, match="another picture size"):
        Flow(skin.picture())(np.zeros((20, 20), np.uint8))


# The lens


def test_pixels_and_directions_are_one_to_one():
    pixel = LENS.centre + np.random.default_rng(0).uniform(-80, 80, (50, 2))
    direction = LENS.direction(pixel)
    assert np.allclose(np.linalg.norm(direction, axis=1), 1)
    assert np.allclose(LENS.pixel(direction), pixel, atol=1e-10)
    assert np.allclose(LENS.direction(LENS.centre), [0, 0, 1])


def test_the_rim_of_the_picture_is_80_degrees_off_axis():
    rim = LENS.direction([LENS.centre[0] + LENS.edge, LENS.centre[1]])
    assert np.degrees(np.arccos(rim[2])) == pytest.approx(80)
    assert rim[0] > 0  # x to the right


def test_the_radius_of_a_dome_has_one_place_in_a_rig():
    """A second one, of the lens, was checked and used nowhere."""
    lens = {"centre": (160, 120), "edge": 118, "radius": 0.5}
    with pytest.raises(RigError, match=r"lens: a lens has no radius.*tip_radius"):
        Tactile("densetact", touch={"lens": lens}).toucher()


def test_a_lens_that_cannot_be_is_refused():
    for wrong in ({"edge": 2.0}, {"angle": 2.0}, {"radius": 0.0}):
        with pytest.raises(RigError, match=r"^Lens"):
            Lens(**{"centre": (80, 60), "edge": 58.0} | wrong)


# Touches


@pytest.mark.parametrize("polar", [0, 25, 50])
@pytest.mark.parametrize("force", [0.7, 2.0])
def test_the_centre_of_pressure_is_within_a_pixel(skin, sensor, polar, force):
    for azimuth in (15, 135, 255):
        push = towards(polar, azimuth)
        sensed = sensor.sense(skin.picture(push, force))
        assert np.linalg.norm(sensed.centre - LENS.pixel(push)) < 1.0
        # psi has a minimum there, so the pressure is positive; the patches of DIS
        # smooth it a little
        assert 0.85 < sensed.strength / skin.strength(force) < 1.0
        assert sensed.agreement > 0.85


def test_a_touch_that_the_rim_cuts_off_is_not_pulled_inwards(skin, sensor):
    off = []
    for polar in (70, 75):
        for azimuth in range(0, 360, 45):
            push = towards(polar, azimuth)
            sensed = sensor.sense(skin.picture(push, 1.5))
            off.append(LENS.direction(sensed.centre) @ push)
    off = np.degrees(np.arccos(off))  # plain weighted means are 2.5 to 5 degrees off
    assert np.median(off) < 1.5
    assert np.percentile(off, 90) < 3.0


def test_beyond_the_field_of_view_contact_is_felt_but_no_normal(skin, sensor):
    for azimuth in range(0, 360, 45):
        for polar in (60, 90, 95):
            touch = sensor(0.0, skin.picture(towards(polar, azimuth), 2.0))
            assert touch.contact
            assert touch.valid
            assert touch.normal.any() == (polar == 60)


def test_the_normal_points_from_the_object_into_the_dome(skin, sensor):
    push = towards(30, 100)
    for k in range(3):
        touch = sensor(k, skin.picture(push, 2.0))
    assert touch.contact
    assert np.degrees(np.arccos(-touch.normal @ push)) < 2.0


def test_the_mount_turns_the_normal_into_the_tips_frame(skin):
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    mounted = OpticalTouch(LENS, mount=turn)
    mounted.learn([skin.picture() for _ in range(3)])
    push = towards(30, 100)
    touch = mounted(0.0, skin.picture(push, 2.0))
    assert np.degrees(np.arccos(-touch.normal @ turn @ push)) < 2.0


def test_the_first_second_is_the_reference(skin):
    sensor = OpticalTouch(LENS, rest=6)
    with pytest.raises(FrameError, match="no reference yet"):
        sensor.sense(skin.picture())
    assert [sensor(k, skin.picture()) for k in range(12)] == [None] * 12
    assert sensor.decide.on == pytest.approx(LEAST * (236 / 256) ** 2)
    quiet = [sensor(k, skin.picture()) for k in range(10)]
    assert not any(touch.contact for touch in quiet)
    assert all(touch.valid for touch in quiet)


def test_no_picture_takes_longer_to_learn_than_another(skin, monkeypatch):
    """Buses wait meanwhile: one picture is evaluated at a time."""
    sensor, evaluated = OpticalTouch(LENS, rest=5), []
    sense = sensor._sensed
    monkeypatch.setattr(sensor, "_sensed", lambda c: evaluated.append(c) or sense(c))
    pressed = skin.picture(towards(20, 0), 2.0)
    for k in range(10):  # the thresholds are those of the first five
        assert sensor(k, skin.picture() if k < 5 else pressed) is None
        assert len(evaluated) == max(k - 4, 0)
    assert sensor.decide.on == pytest.approx(LEAST * (236 / 256) ** 2)
    assert sensor(10, pressed).contact


def test_contact_is_kept_between_the_two_thresholds(skin, sensor):
    per_newton = skin.strength(1.0)
    between = (sensor.decide.on + sensor.decide.off) / 2 / per_newton / 0.92
    push = towards(20, 0)
    felt = [
        sensor(k, skin.picture(push, force)).contact
        for k, force in enumerate((0.0, between, 2.0, between, 0.0, between))
    ]
    assert felt == [False, False, True, True, False, False]


def test_a_sheared_gel_is_no_touch(skin, sensor):
    shifted = np.roll(skin.picture(), 2, axis=1)
    sensed = sensor.sense(shifted)
    assert sensed.strength < sensor.decide.off


def test_a_real_gel_without_texture_is_rejected():
    pair = [
        cv2.imread(str(capture(f"gel_textureless_{name}.png")))
        for name in ("reference", "contact")
    ]
    for scale in (1.0, 0.5):
        reference, contact = (
            cv2.resize(p, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            for p in pair
        )
        h, w = reference.shape[:2]
        sensor = OpticalTouch(Lens((w / 2, h / 2), 0.47 * h))
        sensor.learn([reference, reference])
        # the flow is large and means nothing
        assert sensor.sense(contact).strength > 10 * sensor.decide.on
        touch = sensor(0.0, contact)
        assert not touch.valid
        assert not touch.contact
        assert sensor(0.0, reference).valid


def test_a_disc_outside_the_picture_is_refused(skin):
    sensor = OpticalTouch(Lens((100.0, 120.0), 118.0))
    with pytest.raises(FrameError, match="not in the picture"):
        sensor(0.0, skin.picture())


def test_without_opencv_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(HardwareError, match=r"tactilenlp\[optical\]"):
        Flow(np.zeros((20, 20), np.uint8))


def test_the_clock_of_a_simulated_camera_is_its_robot():
    rig = simulated_rig("densetact", "camera alone")
    robot = SimulatedRobot(rig)
    camera = robot.reader(rig.fingers[0].tactile, "finger 0, tactile", None, None)
    with robot, camera:
        robot.sleep(0.2)
        camera.check()
        assert len(camera.take()) > 5
