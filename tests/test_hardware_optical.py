"""A camera behind a soft dome: flow, its parts, where something presses."""

import math
import sys
import time

import numpy as np
import pytest
from bench import capture, refused

pytest.importorskip("cv2", reason='needs the extra: pip install "tactilenlp[optical]"')
import cv2

from hardware.errors import (
    FrameError,
    HardwareError,
    RecordingError,
    RigError,
    StaleStreamError,
)
from hardware.frames import Camera, pictures
from hardware.hodge import Hodge
from hardware.optical import LEAST, Lens, OpticalTouch
from hardware.optical_flow import Flow, grey, normalised
from hardware.simulated_skin import SimulatedSkin

SHAPE = (240, 320)  # [px]
LENS = Lens((160.0, 120.0), 118.0)
IDENTITY = tuple(map(tuple, np.eye(3).tolist()))


def disc(n=41):
    off = np.indices((n, n)) - (n - 1) / 2
    return (off**2).sum(axis=0) <= (n / 2) ** 2


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


# The decomposition


def test_the_three_parts_add_up_and_are_orthogonal():
    hodge = Hodge(disc(), spacing=3.0)
    flow = np.random.default_rng(0).normal(size=(41, 41, 2))
    parts = hodge.decompose(flow)
    edge = hodge._along(flow)
    # energies add up only if the parts are orthogonal
    assert sum(parts.energy.values()) == pytest.approx(edge @ edge, rel=1e-10)
    assert list(parts.energy) == ["irrotational", "solenoidal", "harmonic"]
    assert min(parts.energy.values()) > 0


def field(make):
    y, x = np.indices((41, 41)) - 20.0
    return np.stack(make(x, y), axis=-1)


def bump(x, y, s=5.0):
    return np.exp(-(x**2 + y**2) / (2 * s * s))


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("irrotational", lambda x, y: (x * bump(x, y), y * bump(x, y))),
        ("solenoidal", lambda x, y: (-y * bump(x, y), x * bump(x, y))),
        ("harmonic", lambda x, y: (np.ones_like(x), 2 * np.ones_like(x))),
        ("harmonic", lambda x, y: (x, -y)),  # a pure shear neither spreads nor swirls
    ],
)
def test_a_pure_flow_lands_in_its_own_part(name, make):
    flow = field(make)
    parts = Hodge(disc()).decompose(flow)
    total = sum(parts.energy.values())
    assert parts.energy[name] > 0.999 * total
    # the parts are shown at nodes; edges are means of two nodes, hence a blur
    inside = Hodge(disc(31)).mask
    off = np.abs(getattr(parts, name) - flow)[5:-5, 5:-5][inside]
    assert off.max() < 0.06 * np.abs(flow).max()


def test_the_potential_of_a_gradient_is_what_it_was_up_to_a_constant():
    h = 3.0
    y, x = h * (np.indices((41, 41)) - 20.0)
    psi = bump(x - 30, y + 21, 12.0)  # cut by the rim, which must not bend it
    flow = np.stack([np.gradient(psi, h, axis=1), np.gradient(psi, h, axis=0)], -1)
    mask = disc()
    sheared = flow + np.array([0.7, -0.3])
    found = Hodge(mask, h).potential(sheared)
    off = (found - psi)[mask]
    assert np.ptp(off) < 0.1  # central differences of a bump four nodes wide
    assert np.median(found[mask]) == pytest.approx(0.0, abs=1e-12)
    peak = np.unravel_index(np.where(mask, found, -1).argmax(), mask.shape)
    assert np.abs(np.subtract(peak, (13, 30))).max() <= 1


def test_a_mask_without_inside_is_refused():
    with pytest.raises(FrameError, match="three nodes wide"):
        Hodge(np.eye(5, dtype=bool))
    with pytest.raises(FrameError, match="wrong shape"):
        Hodge(disc()).decompose(np.zeros((40, 41, 2)))


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


def test_a_lens_that_cannot_be_is_refused():
    for wrong in ({"edge": 2.0}, {"angle": 2.0}, {"radius": 0.0}):
        with pytest.raises(RigError, match="no lens"):
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
    assert [sensor(k, skin.picture()) for k in range(6)] == [None] * 6
    assert sensor.decide.on == pytest.approx(LEAST * (236 / 256) ** 2)
    quiet = [sensor(k, skin.picture()) for k in range(10)]
    assert not any(touch.contact for touch in quiet)
    assert all(touch.valid for touch in quiet)


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


# Cameras and files


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.002)


def test_a_camera_that_freezes_is_missed_within_200_ms():
    rng, frozen = np.random.default_rng(0), []

    def read():
        time.sleep(0.01)
        if not frozen:
            read.picture = rng.integers(0, 255, (20, 20)).astype(np.uint8)
        return read.picture  # the driver gives the same buffer again and again

    with Camera(read, name="finger 1") as camera:
        wait_for(lambda: camera.good > 5)
        camera.check(stale=10.0)
        frozen.append(True)
        wait_for(lambda: camera.frozen > 0)
        error, passed = refused(camera.check, since=time.monotonic())
        assert isinstance(error, StaleStreamError)
        assert "finger 1: no touch is sensed" in str(error)
        assert passed < 0.2
        stamps = [stamp for stamp, _ in camera.take()]
    assert len(stamps) == camera.good
    assert stamps == sorted(stamps)


def test_a_camera_that_is_not_there_is_said_with_the_reason(capfd):
    with Camera("/dev/nowhere.mkv") as camera:
        wait_for(lambda: camera._why)
        time.sleep(0.12)
        with pytest.raises(StaleStreamError, match="cannot be opened"):
            camera.check()


def test_a_sink_that_fails_ends_in_its_own_error(skin):
    def full(frame, now):
        raise RecordingError("the disk is full")

    with Camera(skin.picture, sink=full) as camera:
        wait_for(lambda: camera._broken_down)
        with pytest.raises(RecordingError, match="the disk is full"):
            camera.check()


def test_pictures_are_read_in_their_natural_order(tmp_path):
    for k in (0, 1, 2, 10, 11, 100):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((4, 4), k, np.uint8))
    assert [p[0, 0] for p in pictures(tmp_path)] == [0, 1, 2, 10, 11, 100]
    (tmp_path / "5.png").write_bytes(b"no picture")
    with pytest.raises(RecordingError, match=r"5\.png"):
        list(pictures(tmp_path))


def test_a_folder_without_pictures_is_refused(tmp_path, capfd):
    for nothing in (tmp_path, tmp_path / "film.mkv"):
        with pytest.raises(RecordingError, match="no pictures"):
            list(pictures(nothing))
