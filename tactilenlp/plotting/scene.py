"""Draw object, fingers and contacts with matplotlib: for people, in millimetres.

Blue was touched, grey was not, a dashed line is the truth, each finger has a colour.
Every function returns the figure and draws into `axis` where one is given.  `truth`, a
dict or dataclass, has position, quaternion (wxyz) and side_lengths, or vertices, like
an Estimate.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from matplotlib.colors import LightSource, ListedColormap, LogNorm
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ..errors import OptionError
from ..estimation.result import Estimate
from ..geometry.faces import face_sigma, polygons
from ..geometry.transforms import rotation_of
from ..output.colours import NOT_KNOWN, WELL_KNOWN, information_colour
from .faces import faces_of
from .style import (
    BAND,
    FINGER_COLOURS,
    INK,
    MM,
    TOUCHED,
    TRUTH,
    UNTOUCHED,
    below,
    check_axes,
    check_solid,
    picture,
    with_key,
)

# [mm] beside and above the object: a fingertip
SCENE_MARGIN = np.array([26.0, 26.0, 22.0])
# [mm] length of a normal, spacing of the ground's lines
NORMAL_ARROW, GROUND_GRID = 7.0, 10.0
ELEVATION, AZIMUTH = 28.0, -58.0  # [deg] from where a scene is seen
EYE = Rotation.from_euler("yz", [-ELEVATION, AZIMUTH], degrees=True).apply([1, 0, 0])
LIGHT = LightSource(azdeg=145, altdeg=50)
LABEL = {
    "ha": "center", "va": "center", "fontsize": 7,
    "bbox": {"boxstyle": "round,pad=0.2", "fc": "w", "ec": "none", "alpha": 0.8},
}  # fmt: skip
WORTH = 100.0  # [mm^2] a face seen this large has room for a label
FACE_WORDS, SIGMA = (
    {True: "face touched", False: "face not touched"},
    "±1σ of each face",
)


@picture
def plot_scene(estimate: Estimate, sample: int = -1, truth=None, axis=None) -> Figure:
    """Draw what is seen of object, fingers and contacts at a sample, in 3-D."""
    axis = axis or plt.figure(figsize=(4.6, 3.6)).add_subplot(projection="3d")
    draw_scene(axis, estimate, sample, truth, view_of(estimate, [sample]))
    axis.set_title(_when(estimate.measurements, sample))
    return with_key(axis, axis, **below(axis))


@picture
def plot_top(estimate: Estimate, sample: int = -1, truth=None, axis=None) -> Figure:
    """Draw object, one-sigma band, finger paths and contacts at a sample from above.

    The band is where each face may be, along its normal: at the last sample from the
    covariance of sizes and pose, at others from that of the sizes alone.  Contacts of
    all actions are carried along with the object; those of the sample's action are big.
    """
    axis = axis or plt.figure(figsize=(4.5, 4.9)).subplots()
    draw_top(axis, estimate, sample, truth, view_of(estimate, [sample]))
    return with_key(axis, axis, **below(axis))


@picture
def plot_information(estimate: Estimate, axis=None, key: bool = True) -> Figure:
    """Draw how well each face is known at the last sample: blue hardly, red well.

    A face has the standard deviation [mm] of its middle along its normal; key: the bar.
    """
    axis = axis or plt.figure(figsize=(4.6, 3.6)).add_subplot(projection="3d")
    view = view_of(estimate, [-1])
    _frame(axis, estimate, view)
    points, R_wo = estimate.vertices, estimate.rotation()
    shown = zip(polygons(points), face_sigma(estimate), strict=True)
    for (corners, n_o), sigma in shown:
        place = (points[corners] @ R_wo.T + estimate.position[-1]) * MM
        colour = information_colour(sigma) / 255
        draw_seen(axis, [(place, R_wo @ n_o)], [colour], INK, 4, shade=False)
        if _extent(place, R_wo @ n_o) > WORTH:
            words = f"{sigma * MM:.2g}" if sigma < NOT_KNOWN else "unknown"
            axis.text(*place.mean(axis=0), words, zorder=9, **LABEL)
    for colour, seen, _, _ in _touches(estimate, -1):
        axis.scatter(*seen.T, s=5, color=colour, zorder=8, depthshade=False)
    scale = np.geomspace(NOT_KNOWN, WELL_KNOWN, 64)
    bar = plt.cm.ScalarMappable(
        LogNorm(WELL_KNOWN * MM, NOT_KNOWN * MM),
        ListedColormap(information_colour(scale)[::-1] / 255),
    )
    if key:
        axis.figure.colorbar(
            bar, ax=axis, shrink=0.6, pad=0.12, extend="both",
            label="deviation of a face [mm]",
        ).ax.invert_yaxis()  # fmt: skip
    axis.set_title("What is known of each face")
    return axis.figure


@picture
def plot_estimate(estimate: Estimate, truth=None, axis=None) -> Figure:
    """Draw the first and the last sample side by side, from above and in 3-D.

    axis: four Axes, from above of the first and the last sample, then in 3-D of both.
    """
    view = view_of(estimate, [0, -1])
    axes = _four_axes(estimate) if axis is None else check_axes(axis, 4)
    alone = " (band: sizes alone)" if estimate.shape == "cuboid" else ""
    words = f"First sample: {{}}{alone}", "Last sample: {}"
    for k, (title, sample) in enumerate(zip(words, (0, -1), strict=True)):
        draw_top(axes[k], estimate, sample, truth, view)
        axes[k].set_title(title.format(axes[k].get_title()))
        draw_scene(axes[k + 2], estimate, sample, truth, view)
    if axis is not None:
        return with_key(axes[0], axes[0], **below(axes[0]))
    return with_key(axes[0].figure, axes[0], loc="outside lower center", ncols=3)


def _four_axes(estimate) -> list:
    """Return the axes of a figure of its own, two flat and two in 3-D."""
    figure = plt.figure(figsize=(7.0, 6.6))
    said = estimate.summary().partition("\n")[0]
    figure.suptitle(said.replace(" at (", "\nat (").replace(", turned", ",\nturned"))
    figure.get_layout_engine().set(rect=(0, 0.012, 0.965, 0.988))  # 3-D labels
    solid = {("c", "d"): {"projection": "3d"}}
    ratios = {"height_ratios": (1.5, 1), "per_subplot_kw": solid}
    return [*figure.subplot_mosaic("ab;cd", **ratios).values()]


def draw_top(axis, estimate, sample, truth, view) -> None:
    """Draw a sample from above into an axis that shows the box `view` (2, 3) [mm]."""
    data, (faces, spread) = estimate.measurements, faces_of(estimate, sample)
    for face in (face for face in faces if face.normal[2] > -1e-6):
        side, colour = face.normal[2] < 0.5, TOUCHED if face.touched else UNTOUCHED
        axis.fill(*face.corners[:, :2].T, fc=(colour, 0.25), ec=colour, lw=1 + side,
                  zorder=2 + side, label=FACE_WORDS[face.touched])  # fmt: skip
    if spread is not None:
        ring = np.concatenate([outline(spread[0]), outline(spread[1])[::-1]])
        axis.fill(*ring.T, fc=(BAND, 0.5), lw=0, zorder=2.5, label=SIGMA)
    if truth is not None:
        true = outline(true_corners(truth, sample))
        axis.plot(*true.T, "--", color=TRUTH, lw=1.3, zorder=6, label="truth")
    during = data.action == data.action[sample]
    for finger, (colour, points, normals, now) in enumerate(_touches(estimate, sample)):
        path = estimate.seen_positions[:, finger] * MM
        axis.plot(*path[during, :2].T, ".-", ms=2.5, lw=0.8, color=colour, zorder=4)
        axis.add_patch(plt.Circle(
            path[sample, :2], data.finger_radius[finger] * MM, fc=(colour, 0.35),
            ec=colour, zorder=5, label=f"finger {finger} and its contacts",
        ))  # fmt: skip
        axis.quiver(*points[now, :2].T, *normals[now, :2].T, color=colour, angles="xy",
            scale_units="xy", scale=1 / NORMAL_ARROW, width=3e-3, zorder=7)  # fmt: skip
        size = 6 + 10 * now
        axis.scatter(*points[:, :2].T, size, color=colour, ec=INK, lw=0.4, zorder=8)
    axis.set(xlim=view[:, 0], ylim=view[:, 1], xlabel="x [mm]", ylabel="y [mm]",
             aspect="equal", title=_when(data, sample))  # fmt: skip


def draw_scene(axis, estimate, sample, truth, view) -> None:
    """Draw a sample in 3-D into an axis that shows the box `view` (2, 3) [mm]."""
    data, (faces, spread) = estimate.measurements, faces_of(estimate, sample)
    _frame(axis, estimate, view)
    for face in (face for face in faces if face.normal @ EYE > 0):
        colour = TOUCHED if face.touched else UNTOUCHED
        draw_seen(axis, [(face.corners, face.normal)], colour, INK, 4, shade=True,
                  lightsource=LIGHT, label=FACE_WORDS[face.touched])  # fmt: skip
    if spread is not None:
        draw_seen(axis, _polygons(spread[0]), (BAND, 0.12), BAND, 5, label=SIGMA)
    if truth is not None:
        true = _polygons(true_corners(truth, sample))
        draw_seen(axis, true, "none", TRUTH, 6, ls="--", label="truth")
    for finger, (colour, points, normals, _) in enumerate(_touches(estimate, sample)):
        seen = normals @ EYE > 0
        axis.quiver(*points[seen].T, *normals[seen].T, length=NORMAL_ARROW,
                    color=colour, lw=0.8, arrow_length_ratio=0.3, zorder=7)  # fmt: skip
        axis.scatter(
            *points[seen].T, s=8, color=colour, edgecolors=INK, lw=0.4, zorder=8,
            depthshade=False, label=f"finger {finger} and its contacts",
        )  # fmt: skip
        centre = estimate.seen_positions[sample, finger] * MM
        if np.all((centre > view[0]) & (centre < view[1])):  # 3-D axes do not clip
            near = max(faces, key=lambda f: f.normal @ (centre - f.corners[0])).normal
            ball = trimesh.creation.icosphere(3, data.finger_radius[finger] * MM)
            axis.plot_trisurf(
                *(ball.vertices + centre).T, triangles=ball.faces, color=colour, lw=0,
                antialiased=False, lightsource=LIGHT,
                zorder=9 + EYE @ centre / MM if near @ EYE > 0 else 3,
            )  # fmt: skip


def _frame(axis, estimate, view) -> None:
    """Set up a 3-D axis that shows the box `view` (2, 3) [mm], with the ground."""
    check_solid(axis)
    axis.set(xlim=view[:, 0], ylim=view[:, 1], zlim=view[:, 2], xlabel="x [mm]",
             ylabel="y [mm]", zlabel="z [mm]", proj_type="ortho")  # fmt: skip
    for side, pad in ((axis.xaxis, -4), (axis.yaxis, -4), (axis.zaxis, -10)):
        side.labelpad = pad
        side.set_tick_params(pad=-2)
        side.pane.set_visible(False)
    axis.set_box_aspect(view[1] - view[0], zoom=1.3)
    axis.view_init(ELEVATION, AZIMUTH)
    axis.computed_zorder = False  # matplotlib's own order hides what is near
    if estimate.scene.ground is not None:
        (x0, y0, _), (x1, y1, _) = np.round(view / GROUND_GRID) * GROUND_GRID
        flat = np.mgrid[x0 : x1 + 1 : GROUND_GRID, y0 : y1 + 1 : GROUND_GRID, 0:1] / MM
        lines = MM * estimate.scene.ground.from_ground(flat[..., 0].transpose(1, 2, 0))
        axis.plot_wireframe(*lines.transpose(2, 0, 1), rstride=1, cstride=1, lw=0.5,
                            color="#D0D0D0", zorder=0)  # fmt: skip


def draw_seen(axis, polygons, face, edge, order, **style) -> None:
    """Draw those of (corners, normal) that face the eye."""
    seen = [corners for corners, normal in polygons if normal @ EYE > 0]
    style |= {"facecolors": face, "edgecolors": edge, "lw": 1, "zorder": order}
    axis.add_collection3d(Poly3DCollection(seen, **style))


def _extent(corners, normal) -> float:
    """Return the area [mm^2] that the eye sees of a flat face; below 0 from behind."""
    turned = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0])
    return np.linalg.norm(turned.sum(axis=0)) / 2 * (normal @ EYE)


def _polygons(points):
    """Yield corners (k, 3), in order, and outward normal of each face of a hull."""
    for corners, normal in polygons(points):
        yield points[corners], normal


def outline(corners) -> np.ndarray:
    """Return the closed outline (k, 2) of corners (n, 3) seen from above."""
    ring = ConvexHull(corners[:, :2]).vertices
    return corners[np.append(ring, ring[0]), :2]


def true_corners(truth, sample) -> np.ndarray:
    """Return the corners (n, 3) [mm] of the true body at a sample, world frame."""
    truth = truth if isinstance(truth, dict) else getattr(truth, "__dict__", {})
    sized = truth.keys() & {"side_lengths", "vertices"}
    if not (sized and {"position", "quaternion"} <= truth.keys()):
        raise OptionError(
            "cannot be drawn", where="truth", got=f"{sorted(truth)}",
            expected="position, quaternion (wxyz) and side_lengths or vertices",
        )  # fmt: skip
    p_wo, quaternion = (np.atleast_2d(truth[k]) for k in ("position", "quaternion"))
    now = sample if len(p_wo) > 1 else 0
    corners = truth.get("vertices")
    if corners is None:
        corners = np.indices((2, 2, 2)).reshape(3, -1).T - 0.5
        corners = corners * truth["side_lengths"]
    return MM * (_rotations(quaternion[now]).apply(corners) + p_wo[now])


def _touches(estimate, sample):
    """Yield by finger: colour; contacts carried to a sample [mm], normals, if now."""
    data, R_wo = estimate.measurements, _rotations(estimate.quaternion)
    for finger, radius in enumerate(data.finger_radius):
        t = np.flatnonzero(data.contact[:, finger] & data.valid[:, finger])
        carry, n_w = R_wo[sample] * R_wo[t].inv(), data.normal[t, finger]
        arms = estimate.seen_positions[t, finger] - radius * n_w - estimate.position[t]
        points = MM * (carry.apply(arms) + estimate.position[sample])
        now = data.action[t] == data.action[sample]
        yield (
            FINGER_COLOURS[finger % len(FINGER_COLOURS)],
            points,
            carry.apply(n_w),
            now,
        )


def _rotations(quaternion):
    return rotation_of(quaternion)


def _when(data, sample) -> str:
    return f"{data.time[sample]:.1f} s, action {data.action[sample]}"


def view_of(estimate, samples) -> np.ndarray:
    """Return the corners (2, 3) [mm] of what is shown: the object, with some room."""
    points = np.concatenate([estimate.mesh(sample).vertices for sample in samples]) * MM
    below = SCENE_MARGIN * (1, 1, estimate.scene.ground is None)
    return np.stack([points.min(axis=0) - below, points.max(axis=0) + SCENE_MARGIN])
