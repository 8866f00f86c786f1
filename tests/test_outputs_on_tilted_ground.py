"""Pictures and words on a tilted ground are those on level ground, moved with it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from scipy.spatial.transform import Rotation
from test_report import content

from tactilenlp import ExpectedInformation, Ground, plot_gain
from tactilenlp.exploration.action_search import Choice
from tactilenlp.geometry.transforms import quaternion_of, rotation_of
from tactilenlp.plotting import gain_map
from tactilenlp.plotting.drawing import outline
from tactilenlp.plotting.scene import plot_scene

MM = 1e3  # [mm / m]
LEANING = Ground(0.3, (0.0, -np.sin(0.6), np.cos(0.6)))
WALL = Ground(0.2, (1.0, 0.0, 0.0))


def moved(estimate, ground):
    """Return an estimate on level ground as it would be on another one."""
    R_wg, about = ground.rotation.T, estimate.information
    maps = {name: R_wg @ np.nan_to_num(about.maps[name]) for name in
            ("position", "rotation")}  # fmt: skip
    still = np.abs(maps["rotation"]).max(axis=1) < 1e-12
    maps["rotation"][still] = np.nan
    both = np.kron(np.eye(2), R_wg)
    leaning = None if about.ground is None else both @ about.ground @ both.T
    q = Rotation.from_matrix(R_wg) * rotation_of(estimate.quaternion)
    return replace(
        estimate, scene=replace(estimate.scene, ground=ground),
        position=ground.from_ground(estimate.position), quaternion=quaternion_of(q),
        measurements=estimate.measurements.transformed(R_wg, ground.origin),
        impulses={name: p @ R_wg.T for name, p in estimate.impulses.items()},
        information=replace(about, maps=about.maps | maps, ground=leaning),
    )  # fmt: skip


@pytest.mark.parametrize("ground", [LEANING, WALL])
def test_the_map_shows_the_body_pushed_along_the_tilted_ground(
    ground, touched, monkeypatch
):
    monkeypatch.setattr(gain_map, "DIRECTIONS", (3, 2))
    estimate = moved(touched, ground)
    expected = ExpectedInformation(estimate)
    rng, none = np.random.default_rng(0), np.zeros(0)
    some = [expected.workspace.random(rng) for _ in range(8)]
    action = max(some, key=lambda a: np.linalg.norm(expected.prospect(a).motion[-1]))
    gain = expected.gain(action)
    choice = Choice(action, gain, 1, 0.0, "facing", none, none)
    _, top, *_ = plot_gain(estimate, choice).axes
    (line,) = [line for line in top.lines if line.get_label() == "expected after it"]

    *along, yaw = expected.prospect(action).motion[-1]
    assert np.linalg.norm(along) > 2e-3  # [m], else there is nothing to tell apart
    turn = Rotation.from_rotvec(yaw * np.array(ground.normal))
    centre = estimate.position[-1]
    then = turn.apply(estimate.mesh().vertices - centre) + centre
    then += ground.rotation.T @ [*along, 0.0]
    drawn = line.get_xydata()
    for low_or_high in (np.min, np.max):
        np.testing.assert_allclose(
            low_or_high(drawn, axis=0), low_or_high(outline(then * MM), axis=0),
            atol=1e-6,
        )  # fmt: skip


def test_a_body_that_is_pushed_stays_on_its_ground(touched):
    points, motion = touched.mesh().vertices, (0.02, -0.01, 0.4)
    level = gain_map.moved_on_ground(points, Ground(), touched.position[-1], motion)
    for ground in (LEANING, WALL):
        there, about = moved(touched, ground), ground.from_ground(touched.position[-1])
        then = gain_map.moved_on_ground(there.mesh().vertices, ground, about, motion)
        np.testing.assert_allclose(
            np.sort(ground.distance(then)), np.sort(level[:, 2]), atol=1e-12
        )
        centre = ground.from_ground(level).mean(axis=0)
        np.testing.assert_allclose(then.mean(axis=0), centre, atol=1e-12)


@pytest.mark.parametrize("ground", [Ground(), Ground(0.5), LEANING, WALL])
def test_the_grid_of_the_ground_is_below_the_object(ground, touched):
    estimate = moved(touched, ground)
    axis = plot_scene(estimate).axes[0]
    (grid,) = [c for c in axis.collections if type(c) is Line3DCollection
               and c.get_zorder() == 0]  # fmt: skip
    lines = np.concatenate([np.array(line) for line in grid._segments3d]) / MM
    assert abs(ground.distance(lines)).max() < 1e-9
    on_ground = ground.to_ground(lines)[:, :2]
    corners = ground.to_ground(estimate.mesh().vertices)[:, :2]
    # It holds the whole body with the margins of the view, and not much more.
    assert (on_ground.min(axis=0) < corners.min(axis=0)).all()
    assert (on_ground.max(axis=0) > corners.max(axis=0)).all()
    assert (np.ptp(on_ground, axis=0) < np.ptp(corners, axis=0) + 0.15).all()


@pytest.mark.parametrize("ground", [LEANING, WALL])
def test_a_turn_on_tilted_ground_is_about_its_normal(ground, touched, tmp_path):
    (turn,) = re.findall(r"turned by (.*) about the vertical", touched.summary())
    tilted = moved(touched, ground)
    assert f"turned by {turn} about the ground's normal, at" in tilted.summary()
    tilted.report(tmp_path / "report.html")
    shown = dict(content(tmp_path / "report.html")["sigma"])
    assert shown["rotation about the ground's normal"] == turn
    # of one axis of the world alone the angle is not a turn of the body
    assert shown["rotation about z"].startswith(("±", "fixed"))


def test_on_level_ground_the_words_do_not_change(touched):
    raised = moved(touched, Ground(0.5))
    w, x, y, z = touched.quaternion[-1]
    yaw = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    off = np.degrees(touched.information.sigma("rotation")[2])
    words = f"turned by {yaw:.2f} ± {off:.2f} deg about the vertical, at the last"
    for estimate in (touched, raised):
        assert words in estimate.summary()
