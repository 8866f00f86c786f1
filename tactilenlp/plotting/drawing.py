"""Draw one sample of an estimate into an axis, from above or in 3-D."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from matplotlib.colors import LightSource
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ..common.brief import MM_PER_M
from ..common.layout import has_volume
from ..common.validation import checked_array, checked_unit, numbers_of
from ..data.trajectories import QUATERNION_TOLERANCE
from ..errors import OptionError
from ..evaluation.metrics import TrueBody
from ..geometry.convex_hull import hull_vertices
from ..geometry.transforms import rotation_of
from .faces import faces_at, faces_of_hull
from .style import (
    BAND_COLOUR,
    INK,
    TOUCHED_COLOUR,
    TRUTH_COLOUR,
    UNTOUCHED_COLOUR,
    finger_colour,
)

# [mm] beside and above the object: a fingertip has room.
SCENE_MARGINS = np.array([26.0, 26.0, 22.0])
TIP_MARGIN = 2.0  # [mm] beside a fingertip
NORMAL_LENGTH = 7.0  # [mm] of an arrow along a normal
GRID_SPACING_MM = 10.0  # [mm] between the lines of the ground
ELEVATION, AZIMUTH = 28.0, -58.0  # [deg] of the direction of view
EYE = Rotation.from_euler("yz", [-ELEVATION, AZIMUTH], degrees=True).apply([1, 0, 0])
LIGHT = LightSource(azdeg=145, altdeg=50)
FACE_LABELS = {True: "face touched", False: "face not touched"}
SIGMA_LABEL = "±1σ of each face"
POSITION_LABEL = "±1σ of the position"


def draw_top(axis, estimate, sample, truth, view) -> None:
    """Draw a sample from above into an axis that shows the box `view` (2, 3) [mm]."""
    data, (faces, spread) = estimate.measurements, faces_at(estimate, sample)
    for face in (face for face in faces if face.normal[2] > -1e-6):
        colour, upright = _face_colour(face), face.normal[2] < 0.5
        axis.fill(*face.corners[:, :2].T, fc=(colour, 0.25), ec=colour, lw=1 + upright,
                  zorder=2 + upright, label=FACE_LABELS[face.touched])  # fmt: skip
    if spread is not None:
        ring = np.concatenate([outline(spread[0]), outline(spread[1])[::-1]])
        axis.fill(*ring.T, fc=(BAND_COLOUR, 0.5), lw=0, zorder=2.5, label=SIGMA_LABEL)
    if estimate.information.path is not None:
        x, y, _ = estimate.position[sample] * MM_PER_M
        off_x, off_y, _ = estimate.sigma_position[sample] * MM_PER_M
        axis.errorbar(x, y, off_y, off_x, color=INK, lw=1, capsize=2, zorder=6,
                      label=POSITION_LABEL)  # fmt: skip
    if truth is not None:
        true = outline(true_corners(truth, sample, data.samples))
        axis.plot(*true.T, "--", color=TRUTH_COLOUR, lw=1.3, zorder=6, label="truth")
    during = data.action == data.action[sample]
    contacts = contacts_on_body(estimate, sample)
    for finger, (colour, points, normals, now) in enumerate(contacts):
        centres = estimate.seen_positions[:, finger] * MM_PER_M
        axis.plot(*centres[during, :2].T, ".-", ms=2.5, lw=0.8, color=colour, zorder=4)
        axis.add_patch(plt.Circle(
            centres[sample, :2], data.finger_radius[finger] * MM_PER_M, ec=colour,
            fc=(colour, 0.35), zorder=5, label=f"finger {finger} and its contacts",
        ))  # fmt: skip
        axis.quiver(*points[now, :2].T, *normals[now, :2].T, color=colour,
                    angles="xy", scale_units="xy", scale=1 / NORMAL_LENGTH,
                    width=3e-3, zorder=7)  # fmt: skip
        size = 6 + 10 * now
        axis.scatter(*points[:, :2].T, size, color=colour, ec=INK, lw=0.4, zorder=8)
    axis.set(xlim=view[:, 0], ylim=view[:, 1], xlabel="x [mm]", ylabel="y [mm]",
             aspect="equal", title=title_of(data, sample))  # fmt: skip


def draw_scene(axis, estimate, sample, truth, view) -> None:
    """Draw a sample in 3-D into an axis that shows the box `view` (2, 3) [mm]."""
    data, (faces, spread) = estimate.measurements, faces_at(estimate, sample)
    set_up(axis, estimate, view)
    for face in (face for face in faces if face.normal @ EYE > 0):
        colour = _face_colour(face)
        draw_seen(axis, [face], colour, INK, 4, shade=True,
                  lightsource=LIGHT, label=FACE_LABELS[face.touched])  # fmt: skip
    if spread is not None:
        outer, colour = faces_of_hull(spread[0]), BAND_COLOUR
        draw_seen(axis, outer, (colour, 0.12), colour, 5, label=SIGMA_LABEL)
    if truth is not None:
        true = faces_of_hull(true_corners(truth, sample, data.samples))
        draw_seen(axis, true, "none", TRUTH_COLOUR, 6, ls="--", label="truth")
    contacts = contacts_on_body(estimate, sample)
    for finger, (colour, points, normals, _) in enumerate(contacts):
        seen = normals @ EYE > 0
        axis.quiver(*points[seen].T, *normals[seen].T, length=NORMAL_LENGTH,
                    color=colour, lw=0.8, arrow_length_ratio=0.3, zorder=7)  # fmt: skip
        axis.scatter(
            *points[seen].T, s=8, color=colour, edgecolors=INK, lw=0.4, zorder=8,
            depthshade=False, label=f"finger {finger} and its contacts",
        )  # fmt: skip
        centre = estimate.seen_positions[sample, finger] * MM_PER_M
        if np.all((centre > view[0]) & (centre < view[1])):  # 3-D axes do not clip
            near = max(faces, key=lambda f: f.normal @ (centre - f.corners[0])).normal
            ball = trimesh.creation.icosphere(3, data.finger_radius[finger] * MM_PER_M)
            axis.plot_trisurf(
                *(ball.vertices + centre).T, triangles=ball.faces, color=colour, lw=0,
                antialiased=False, lightsource=LIGHT,
                zorder=9 + EYE @ centre / MM_PER_M if near @ EYE > 0 else 3,
            )  # fmt: skip


def _face_colour(face) -> str:
    return TOUCHED_COLOUR if face.touched else UNTOUCHED_COLOUR


def set_up(axis, estimate, view) -> None:
    """Set up a 3-D axis that shows the box `view` (2, 3) [mm], with the ground."""
    if not hasattr(axis, "zaxis"):
        raise OptionError(
            "a flat axis", where="axis", got=type(axis).__name__,
            expected='an axis of add_subplot(projection="3d")',
        )  # fmt: skip
    axis.set(xlim=view[:, 0], ylim=view[:, 1], zlim=view[:, 2], xlabel="x [mm]",
             ylabel="y [mm]", zlabel="z [mm]", proj_type="ortho")  # fmt: skip
    for side, pad in ((axis.xaxis, -4), (axis.yaxis, -4), (axis.zaxis, -10)):
        side.labelpad = pad
        side.set_tick_params(pad=-2)
        side.pane.set_visible(False)
    axis.set_box_aspect(view[1] - view[0], zoom=1.3)
    axis.view_init(ELEVATION, AZIMUTH)
    axis.computed_zorder = False  # matplotlib's own order draws near things below
    if estimate.scene.ground is not None:
        _draw_ground(axis, estimate.scene.ground, view)


def _draw_ground(axis, ground, view) -> None:
    """Draw a grid on the ground, below the box `view` (2, 3) [mm]."""
    step = GRID_SPACING_MM
    middle = MM_PER_M * ground.to_ground(view.mean(axis=0) / MM_PER_M)
    reach = abs(ground.rotation) @ np.ptp(view, axis=0) / 2  # along the ground's axes
    ends = np.stack([middle - reach, middle + reach])
    (x0, y0, _), (x1, y1, _) = np.round(ends / step) * step
    flat = np.mgrid[x0 : x1 + 1 : step, y0 : y1 + 1 : step, 0:1] / MM_PER_M
    lines = MM_PER_M * ground.from_ground(flat[..., 0].transpose(1, 2, 0))
    axis.plot_wireframe(*lines.transpose(2, 0, 1), rstride=1, cstride=1, lw=0.5,
                        color="#D0D0D0", zorder=0)  # fmt: skip


def draw_seen(axis, faces, colour, edge, order, **style) -> None:
    """Draw those faces whose outside is visible."""
    seen = [face.corners for face in faces if face.normal @ EYE > 0]
    style |= {"facecolors": colour, "edgecolors": edge, "lw": 1, "zorder": order}
    axis.add_collection3d(Poly3DCollection(seen, **style))


def visible_area(face) -> float:
    """Return the projected area [mm^2] of a face; negative if seen from behind."""
    corners = face.corners
    turned = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0])
    return np.linalg.norm(turned.sum(axis=0)) / 2 * (face.normal @ EYE)


def outline(corners) -> np.ndarray:
    """Return the closed outline (k, 2) of corners (n, 3) seen from above."""
    ring = ConvexHull(corners[:, :2]).vertices
    return corners[np.append(ring, ring[0]), :2]


def true_corners(truth, sample: int, samples: int) -> np.ndarray:
    """Return the corners (n, 3) [mm] of the true body at one of the samples, world.

    truth: a TrueBody, or arrays by name, with one pose or as many as samples.  Raises
    OptionError of others, and where the body has no volume.
    """
    if isinstance(truth, TrueBody):
        return MM_PER_M * truth.mesh.vertices
    truth = truth if isinstance(truth, dict) else getattr(truth, "__dict__", {})
    truth = {k: v for k, v in truth.items() if v is not None}
    sized = truth.keys() & {"side_lengths", "vertices"}
    if not (sized and {"position", "quaternion"} <= truth.keys()):
        raise OptionError(
            "cannot be drawn", where="truth", got=f"{sorted(truth)}",
            expected="a TrueBody, or position, quaternion and side_lengths or vertices",
        )  # fmt: skip
    p_wo, wxyz = (
        _row_of(f"truth.{name}", truth[name], width, sample, samples)
        for name, width in (("position", 3), ("quaternion", 4))
    )
    p_wo = checked_array("truth.position", p_wo, 3, unit="[m]")
    fix = "give wxyz, divided by its length"
    unit = 4, QUATERNION_TOLERANCE, OptionError, fix
    turn = rotation_of(checked_unit("truth.quaternion", wxyz, *unit))
    return MM_PER_M * (turn.apply(_corners_of(truth)) + p_wo)


def _row_of(where: str, value, width: int, sample: int, samples: int) -> np.ndarray:
    """Return the row (width,) at a sample, of one row or of as many as samples.

    More are those of a recording, of which the estimate has the first samples.
    """
    rows = numbers_of(where, value, OptionError, ..., width)
    rows = rows[:samples] if rows.ndim == 2 else rows
    if rows.shape not in ((width,), (1, width), (samples, width)):
        raise OptionError(
            "wrong number of samples", where=where, got=f"shape {rows.shape}",
            expected=f"({width},), or ({samples}, {width}) as in the estimate, or more",
            next="give one pose, or one of every sample",
        )  # fmt: skip
    return np.broadcast_to(rows, (samples, width))[sample]


def _corners_of(truth: dict) -> np.ndarray:
    """Return the corners (n, 3) [m] of a true body in its frame."""
    if "vertices" in truth:
        where = "truth.vertices"
        corners = checked_array(where, truth["vertices"], "V", 3, unit="[m]")
        if has_volume(corners):
            return hull_vertices(corners)
        raise OptionError(
            "the body has no volume", where=where, got=f"shape {corners.shape}",
            expected="vertices (V, 3) [m] that are not in a plane",
        )  # fmt: skip
    where, of = "truth.side_lengths", {"unit": "[m]", "positive": True}
    sides = numbers_of(where, truth["side_lengths"], OptionError, 3, **of)
    return (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * sides


def contacts_on_body(estimate, sample):
    """Yield the contacts of each finger, moved with the object to a sample.

    The finger's colour, points (n, 3) [mm], normals (n, 3), world frame, and whether
    each contact is of the sample's action (n,).
    """
    data, (p_o, n_o) = estimate.measurements, estimate.contacts()
    R_wo, p_wo = estimate.rotation(sample), estimate.position[sample]
    for finger in range(data.fingers):
        t = np.flatnonzero(data.contact[:, finger])
        points = MM_PER_M * (p_o[t, finger] @ R_wo.T + p_wo)
        now = data.action[t] == data.action[sample]
        yield finger_colour(finger), points, n_o[t, finger] @ R_wo.T, now


def title_of(data, sample) -> str:
    """Return the time and the action of a sample."""
    return f"{data.time[sample]:.1f} s, action {data.action[sample]}"


def view_of(estimate, samples) -> np.ndarray:
    """Return the corners (2, 3) [mm] of a box that holds the object, with margins.

    Fingertips that reach into it at one of the samples are in it as a whole.
    """
    meshes = [estimate.mesh(sample) for sample in samples]
    points = np.concatenate([mesh.vertices for mesh in meshes]) * MM_PER_M
    ground = estimate.scene.ground  # below level ground there is nothing to show
    steep = 1.0 if ground is None else min(1.0, 1.0 - ground.normal[2])
    below = SCENE_MARGINS * (1, 1, steep)
    view = np.stack([points.min(axis=0) - below, points.max(axis=0) + SCENE_MARGINS])
    tips = estimate.seen_positions[list(samples), :, :2] * MM_PER_M
    room = MM_PER_M * estimate.measurements.finger_radius[:, None] + TIP_MARGIN
    inside = np.all((tips - room < view[1, :2]) & (tips + room > view[0, :2]), axis=2)
    whole = np.concatenate([(tips - room)[inside], (tips + room)[inside], view[:, :2]])
    view[:, :2] = whole.min(axis=0), whole.max(axis=0)
    return view
