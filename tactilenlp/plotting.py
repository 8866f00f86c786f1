"""Draw estimates with matplotlib: pictures for people, in millimetres.

Blue was touched, grey was not, a dashed line is the truth, each finger has a colour.
Every function returns the figure and draws into `axis` where one is given.  `truth` has
`position`, `quaternion` (wxyz) and `side_lengths` like an Estimate, or is a dict that
does: one pose, or one for every sample.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib import rc_context
from matplotlib.colors import to_rgb
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from .information import ENOUGH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .result import Estimate

# Colours that the colour-blind tell apart (Okabe and Ito, "Color Universal Design").
TOUCHED, UNTOUCHED, BAND, TRUTH = "#0072B2", "#B5B5B5", "#56B4E9", "#D55E00"
INK, FINGERS = "#333333", ("#009E73", "#CC79A7", "#E69F00", "#F0E442")
STYLE = {
    "font.size": 8, "axes.titlesize": 9, "legend.fontsize": 8, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#888888",
    "axes3d.grid": False, "axes3d.xaxis.panecolor": "none", "figure.dpi": 150,
    "axes3d.yaxis.panecolor": "none", "axes3d.zaxis.panecolor": "none",
    "figure.constrained_layout.use": True,
}  # fmt: skip
WIDTH = 7.0  # [inch] of a figure: the text width of a page
MM = 1e3  # [mm / m], also [mN s / N s]
MARGIN, ABOVE = 26.0, 22.0  # [mm] of room around and above the object: a fingertip
ARROW, GRID = (
    7.0,
    10.0,
)  # [mm] length of a contact normal, spacing of the ground's lines
ELEVATION, AZIMUTH = 28.0, -58.0  # [deg] from where a scene is seen
EYE = Rotation.from_euler("yz", [-ELEVATION, AZIMUTH], degrees=True).apply([1, 0, 0])
LIGHT = np.array([0.35, -0.55, 0.76])  # [1] towards the light
WORDS, SPREAD = {True: "face touched", False: "face not touched"}, "±1σ of each face"
TRUE = ("position", "quaternion", "side_lengths")  # what is read of a truth


@rc_context(STYLE)
def plot_scene(estimate: Estimate, sample: int = -1, truth=None, axis=None) -> Figure:
    """Draw object, fingers and contacts at a sample in three dimensions.

    What the object hides is left out.  The shell is one sigma out, as in `plot_top`.
    """
    if axis is None:
        axis = plt.figure(figsize=(4.6, 3.6)).add_subplot(projection="3d")
    _draw_scene(axis, estimate, sample, truth, _view(estimate, [sample]))
    return _with_key(axis.figure, [axis], 2)


@rc_context(STYLE)
def plot_top(estimate: Estimate, sample: int = -1, truth=None, axis=None) -> Figure:
    """Draw object, one-sigma band, finger paths and contacts at a sample from above.

    The band is where each face may be, along its normal: at the last sample from the
    covariance of sizes and pose, at others from that of the sizes alone.  Contacts of
    all actions are carried along with the object; those of the sample's action are big.
    """
    axis = axis or plt.figure(figsize=(4.5, 4.9)).subplots()
    _draw_top(axis, estimate, sample, truth, _view(estimate, [sample]))
    return _with_key(axis.figure, [axis], 2)


@rc_context(STYLE)
def plot_estimate(estimate: Estimate, truth=None) -> Figure:
    """Draw the first and the last sample side by side, from above and in 3-D."""
    figure, view = plt.figure(figsize=(WIDTH, 6.5)), _view(estimate, [0, -1])
    title = estimate.summary().partition("\n")[0].rstrip(".").replace(" at (", "\nat (")
    figure.suptitle(title, fontsize=10)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.5, 1))
    for column, (word, sample) in enumerate((("First", 0), ("Last", -1))):
        top = figure.add_subplot(grid[0, column])
        _draw_top(top, estimate, sample, truth, view)
        top.set_title(f"{word} sample: {top.get_title()}")
        below = figure.add_subplot(grid[1, column], projection="3d")
        _draw_scene(below, estimate, sample, truth, view)
        below.set_title("")
    return _with_key(figure, figure.axes, 3)


@rc_context(STYLE)
def plot_impulses(estimate: Estimate, axis=None) -> Figure:
    """Draw the normal and tangential parts of each finger's impulses over time.

    Inside the friction cone, a tangential part is at most mu times the normal part.
    Only samples with contact are drawn.  axis: one Axes, or one for each finger.
    """
    data = estimate.measurements
    if axis is None:
        figure = plt.figure(figsize=(WIDTH, 0.6 + 1.7 * data.fingers))
        axis = figure.subplots(data.fingers, sharex=True, squeeze=False)
    axes = np.resize(np.asarray(axis, dtype=object), data.fingers)
    shown = np.flatnonzero((data.contact & data.valid).any(axis=1))
    starts = np.flatnonzero(np.diff(data.action[shown], prepend=-1))
    ticks = [f"{data.time[t]:.1f} s\naction {data.action[t]}" for t in shown[starts]]
    at, mu = np.arange(len(shown)), estimate.scene.friction_finger
    mu = estimate.unknowns["finger friction"].item() if mu is None else mu
    for finger, axis in enumerate(axes):
        normal, tangential = _parts(estimate, finger, shown)
        colour, cone = (
            FINGERS[finger % len(FINGERS)],
            f"friction cone: {mu:.2g} × normal",
        )
        axis.bar(at, normal, 1.0, color=(colour, 0.5), label="normal")
        axis.step(at, mu * normal, where="mid", color=INK, lw=1, label=cone)
        axis.plot(at, tangential, "o", color=colour, ms=3.5, mec=INK, mew=0.5,
                  label="tangential")  # fmt: skip
        axis.grid(axis="x", linestyle=":")
        axis.margins(x=0.01)
        axis.set_xticks(starts - 0.5, ticks, ha="left")
        axis.set_ylabel(f"finger {finger} [mN s]")
        axis.legend(loc="upper right")
    axes[-1].set_xlabel("time [s], samples with contact only")
    return axes[0].figure


@rc_context(STYLE)
def plot_costs(estimate: Estimate, axis=None) -> Figure:
    """Draw the costs by term, largest first."""
    costs = dict(sorted(estimate.costs.items(), key=lambda cost: abs(cost[1])))
    axis = axis or plt.figure(figsize=(5.6, 0.8 + 0.24 * len(costs))).subplots()
    values = np.array([*costs.values()])
    bars = axis.barh([*costs], values, color=np.where(values < 0, UNTOUCHED, TOUCHED))
    axis.bar_label(bars, [f"{value:.2g}" for value in values], padding=3)
    axis.axvline(0, color=INK, lw=0.8)
    axis.margins(x=0.15)
    axis.set(xlabel="cost [nats]", title=f"Objective {estimate.objective:.2f} nats")
    return axis.figure


def _draw_top(axis, estimate, sample, truth, view) -> None:
    faces, spread = _faces(estimate, sample)
    for corners, normal, touched in sorted(faces, key=lambda face: -face[1][2]):
        side, colour = normal[2] < 0.5, TOUCHED if touched else UNTOUCHED
        if normal[2] > -1e-6:
            axis.fill(*corners[:, :2].T, fc=(colour, 0.25), ec=colour, lw=2.2 * side,
                      zorder=2 + side, label=WORDS[touched])  # fmt: skip
    if spread is not None:
        ring = np.concatenate([_outline(spread[0]), _outline(spread[1])[::-1]])
        axis.fill(*ring.T, color=BAND, alpha=0.5, lw=0, zorder=2.5,
                  label=SPREAD)  # fmt: skip
    if truth is not None:
        outline = _outline(_true_corners(truth, sample))
        axis.plot(*outline.T, "--", color=TRUTH, lw=1.3, zorder=6, label="truth")
    data = estimate.measurements
    during = data.action == data.action[sample]
    for finger, (points, normals, now) in enumerate(_touches(estimate, sample)):
        colour, path = (
            FINGERS[finger % len(FINGERS)],
            data.finger_position[:, finger] * MM,
        )
        axis.plot(*path[during, :2].T, ".-", ms=2.5, lw=0.8, color=colour, zorder=4)
        tip = Circle(path[sample, :2], data.finger_radius[finger] * MM, fc=(colour, 0.35),
                     ec=colour, zorder=5, label=f"finger {finger}, its path and contacts")  # fmt: skip
        axis.add_patch(tip)
        axis.quiver(*points[now, :2].T, *normals[now, :2].T, color=colour, angles="xy",
                    scale_units="xy", scale=1 / ARROW, width=0.004, zorder=7)  # fmt: skip
        axis.scatter(*points[:, :2].T, np.where(now, 16, 6), color=colour, zorder=8,
                     edgecolors=INK, lw=0.4)  # fmt: skip
    axis.set(xlim=view[:, 0], ylim=view[:, 1], xlabel="x [mm]", ylabel="y [mm]",
             aspect="equal", title=_when(data, sample))  # fmt: skip


def _draw_scene(axis, estimate, sample, truth, view) -> None:
    data, ground = estimate.measurements, estimate.scene.ground
    axis.set(xlim=view[:, 0], ylim=view[:, 1], zlim=view[:, 2],
             title=_when(data, sample))  # fmt: skip
    for name in "xyz":
        getattr(axis, f"set_{name}label")(f"{name} [mm]", labelpad=-4)
    axis.set_box_aspect(view[1] - view[0], zoom=1.42)
    axis.set_proj_type("ortho")
    axis.view_init(ELEVATION, AZIMUTH)
    axis.tick_params(pad=-2)
    axis.computed_zorder = False  # matplotlib's own order hides what is near
    if ground is not None:
        x, y, _ = (np.arange(a, b + 1, GRID) for a, b in np.round(view / GRID).T * GRID)
        lines = MM * ground.from_ground(
            np.stack(np.meshgrid(x, y, [0]), -1)[:, :, 0] / MM
        )
        axis.plot_wireframe(*np.moveaxis(lines, -1, 0), rstride=1, cstride=1, zorder=0,
                            color="#D0D0D0", lw=0.5)  # fmt: skip
    faces, spread = _faces(estimate, sample)
    for corners, normal, touched in (face for face in faces if face[1] @ EYE > 0):
        colour = _lit(TOUCHED if touched else UNTOUCHED, normal)
        _draw_polygons(axis, [corners], colour, INK, 4, label=WORDS[touched])
    if spread is not None:
        shell = [corners for corners, n in _polygons(spread[0]) if n @ EYE > 0]
        _draw_polygons(axis, shell, (BAND, 0.12), BAND, 5, label=SPREAD)
    if truth is not None:
        seen = [c for c, n in _polygons(_true_corners(truth, sample)) if n @ EYE > 0]
        _draw_polygons(axis, seen, "none", TRUTH, 6, ls="--", label="truth")
    for finger, (points, normals, _) in enumerate(_touches(estimate, sample)):
        colour, seen = FINGERS[finger % len(FINGERS)], normals @ EYE > 0
        axis.quiver(*points[seen].T, *normals[seen].T, length=ARROW, color=colour, lw=0.8,
                    arrow_length_ratio=0.3, zorder=7)  # fmt: skip
        axis.scatter(*points[seen].T, s=8, color=colour, edgecolors=INK, lw=0.4,
                     depthshade=False, zorder=8)  # fmt: skip
        centre = data.finger_position[sample, finger] * MM
        if np.all((centre > view[0]) & (centre < view[1])):  # 3-D axes do not clip
            near = max(faces, key=lambda face: face[1] @ (centre - face[0][0]))[1]
            order = 9 + EYE @ centre / MM if near @ EYE > 0 else 3
            _draw_sphere(axis, centre, data.finger_radius[finger] * MM, colour, order)


def _draw_polygons(axis, polygons, face, edge, order, **style) -> None:
    axis.add_collection3d(
        Poly3DCollection(polygons, fc=face, ec=edge, lw=1, zorder=order, **style)
    )


def _draw_sphere(axis, centre, radius, colour, order) -> None:
    turn, rise = np.mgrid[0 : 2 * np.pi : 41j, 0 : np.pi : 21j]
    ring = np.sin(rise)
    unit = np.stack([np.cos(turn) * ring, np.sin(turn) * ring, np.cos(rise)], axis=-1)
    axis.plot_surface(*np.moveaxis(centre + radius * unit, -1, 0), rstride=1, cstride=1,
                      facecolors=_lit(colour, unit), shade=False, lw=0, zorder=order,
                      antialiased=False)  # fmt: skip


def _lit(colour, normal) -> np.ndarray:
    """Return a colour as it looks on a surface with this normal, (..., 3)."""
    light = 0.6 + 0.4 * np.clip(normal @ LIGHT, 0, 1)
    return light[..., None] * np.array(to_rgb(colour))


def _faces(estimate, sample):
    """Return corners, normal and touched or not of every face; all corners +-1 sigma."""
    R_wo, p_wo = estimate.rotation(sample), estimate.position[sample] * MM
    known, sigma, spread = np.zeros((3, 2), bool), np.zeros((3, 2)), None
    if estimate.shape == "cuboid":
        known = estimate.faces >= ENOUGH
        known[2, 0] |= estimate.scene.ground is not None
        sigma, sides = (
            _face_sigma(estimate, sample, known) * MM,
            np.sign(estimate.vertices),
        )
        out, half = np.where(sides < 0, *sigma.T), estimate.side_lengths / 2 * MM
        spread = [sides * np.maximum(half + s, 0.02 * half) for s in (out, -out)]
        spread = [corners @ R_wo.T + p_wo for corners in spread]
    faces = []
    for corners, n_w in _polygons(estimate.vertices * MM @ R_wo.T + p_wo):
        n_o = R_wo.T @ n_w
        face = np.argmax(abs(n_o)), int(n_o.sum() > 0)
        faces.append((corners, n_w, bool(known[face])))
    return faces, spread


def _face_sigma(estimate, sample, known) -> np.ndarray:
    """Return the standard deviation of each face along its normal, (3, 2) [m].

    At the last sample by C, of n' p + side / 2.  At others a size that is wrong moves
    the face that was not touched, or both by half.
    """
    information = estimate.information
    if range(len(estimate.position))[sample] < len(estimate.position) - 1:
        share = np.where(known.sum(axis=1, keepdims=True) == 1, ~known, 0.5)
        return information.sigma("side_lengths")[:, None] * share
    along = estimate.rotation().T @ information.maps["position"]
    J = np.stack([-along, along], 1) + information.maps["side_lengths"][:, None] / 2
    C = np.linalg.inv(information.matrix)
    return np.sqrt(np.maximum(np.einsum("asj,jk,ask->as", J, C, J), 0))


def _polygons(points):
    """Yield corners (k, 3), in order, and outward normal of each face of a hull."""
    hull = ConvexHull(points)
    planes = hull.equations.round(5)  # triangles of one face have one plane
    for plane in np.unique(planes, axis=0):
        corners = points[np.unique(hull.simplices[(planes == plane).all(axis=1)])]
        arms = corners - corners.mean(axis=0)
        turn = np.arctan2(arms @ np.cross(plane[:3], arms[0]), arms @ arms[0])
        yield corners[np.argsort(turn)], plane[:3]


def _outline(corners) -> np.ndarray:
    """Return the closed outline (k, 2) of corners (n, 3) seen from above."""
    ring = ConvexHull(corners[:, :2]).vertices
    return corners[np.append(ring, ring[0]), :2]


def _true_corners(truth, sample) -> np.ndarray:
    """Return the corners (8, 3) [mm] of the true cuboid at a sample, world frame."""
    truth = truth if isinstance(truth, dict) else {k: getattr(truth, k) for k in TRUE}
    position, quaternion, sides = (np.asarray(truth[k]) for k in TRUE)
    if position.ndim == 2:
        position, quaternion = position[sample], quaternion[sample]
    corners = (np.indices((2, 2, 2)).reshape(3, -1).T - 0.5) * sides
    return MM * (_rotations(quaternion).apply(corners) + position)


def _touches(estimate, sample):
    """Yield a finger's contacts, carried along to a sample: points [mm], normals, now."""
    data, R_wo, p_wo = (
        estimate.measurements,
        _rotations(estimate.quaternion),
        estimate.position,
    )
    for finger, radius in enumerate(data.finger_radius):
        t = np.flatnonzero(data.contact[:, finger] & data.valid[:, finger])
        carry, n_w = R_wo[sample] * R_wo[t].inv(), data.normal[t, finger]
        arms = data.finger_position[t, finger] - radius * n_w - p_wo[t]
        points = MM * (carry.apply(arms) + p_wo[sample])
        yield points, carry.apply(n_w), data.action[t] == data.action[sample]


def _parts(estimate, finger, shown):
    """Return normal and tangential parts [mN s] of a finger's impulses at samples."""
    from trimesh.convex import convex_hull
    from trimesh.proximity import closest_point_naive

    R_ow = _rotations(estimate.quaternion[shown]).inv()
    p_wf = estimate.measurements.finger_position[shown, finger]
    p_of = R_ow.apply(p_wf - estimate.position[shown])
    nearest, distance, _ = closest_point_naive(convex_hull(estimate.vertices), p_of)
    n_o = (p_of - nearest) / distance[:, None]
    impulse = R_ow.apply(estimate.impulses[f"finger {finger}"][shown]) * MM
    normal = -np.sum(impulse * n_o, axis=1)
    return normal, np.linalg.norm(impulse + normal[:, None] * n_o, axis=1)


def _rotations(quaternion):
    return Rotation.from_quat(np.roll(quaternion, -1, axis=-1))


def _view(estimate, samples) -> np.ndarray:
    """Return the corners (2, 3) [mm] of what is shown: the object, with some room."""
    points = np.concatenate([estimate.mesh(sample).vertices for sample in samples]) * MM
    low = MARGIN, MARGIN, ABOVE if estimate.scene.ground is None else 0
    return np.stack([points.min(0) - low, points.max(0) + (MARGIN, MARGIN, ABOVE)])


def _when(data, sample) -> str:
    row = range(data.samples)[sample]
    return f"{data.time[row]:.1f} s, action {data.action[row]} (sample {row})"


def _with_key(figure, axes, columns):
    """Put one legend below, with every label once; return the figure."""
    found = [axis.get_legend_handles_labels() for axis in reversed(axes)]
    entries = {k: v for pair in found for v, k in zip(*pair, strict=True)}
    figure.legend(entries.values(), entries, loc="outside lower center", ncols=columns)
    return figure
