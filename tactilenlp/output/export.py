"""Write an estimated body as a mesh (STL, OBJ, PLY, GLB) or a model (MJCF, URDF)."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree as xml

import numpy as np

from formulations.names import GROUND_FRICTION

from ..common.validation import check_path, check_types
from ..common.whole_file import write_whole
from ..errors import OptionError
from ..geometry.faces import face_sigma, polygons
from .colours import information_colour

MESHES = (".stl", ".obj", ".glb", ".ply")
MODELS = (".xml", ".urdf")  # MJCF, URDF
ROLLING = "0.001 0.0001"  # [m] MuJoCo's torsional and rolling friction: negligible


def export_shape(estimate, path: str | os.PathLike) -> None:
    """Write the shape of an Estimate or a Body, in the format of the path's suffix.

    .stl .obj .ply .glb: the surface in metres, body frame; in GLB and PLY, faces have
    colours from blue (standard deviation of 10 mm) to red (0.1 mm).  .xml: MJCF, one
    free body with mass, inertia and friction.  .urdf: one link; any shape but a box is
    written as an .stl beside it, and friction is in the `contact` element that Bullet
    reads.  The origin is that of the body frame.  The centre of mass is the estimated
    one; the inertia about it is that of a uniform body, for a Body the identified one.

    Raises OptionError for another suffix.
    """
    check_types(estimate=(estimate, ("Estimate", "Body")))
    check_path(path)
    path = Path(path)
    suffix = check_format(path)
    if suffix in MESHES:
        _write_mesh(estimate, path)
        return
    tree = (_mjcf if suffix == ".xml" else _urdf)(estimate, path)
    xml.indent(tree)
    write_whole(path, xml.tostring(tree, encoding="unicode") + "\n")


def check_format(path: Path, suffixes=(*MESHES, *MODELS)) -> str:
    """Return the suffix of a file to write; OptionError unless among suffixes."""
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise OptionError(
            "no such format", where=str(path), got=suffix or "no suffix",
            expected=f"one of {', '.join(suffixes)}",
        )  # fmt: skip
    return suffix


def _write_mesh(estimate, path: Path) -> None:
    kind = path.suffix.lower().lstrip(".")
    write_whole(path, _coloured(estimate).export(file_type=kind))


def _coloured(estimate):
    """Return the surface as a mesh, faces coloured by their standard deviation."""
    import trimesh

    vertices = estimate.vertices
    faces = polygons(vertices)
    sigma = np.full(len(faces), np.nan)
    if hasattr(estimate, "information"):
        sigma = face_sigma(estimate)
    points, triangles, colours = [], [], []
    for (corners, _), s in zip(faces, sigma, strict=True):
        first = len(points)  # faces share no corners, so that colours do not blend
        points += [vertices[c] for c in corners]
        triangles += [
            [first, first + i, first + i + 1] for i in range(1, len(corners) - 1)
        ]
        colours += [[*information_colour(s), 255]] * len(corners)
    return trimesh.Trimesh(points, triangles, vertex_colors=colours, process=False)


def _mjcf(estimate, path):
    """Return the MJCF model of a body at its last pose."""
    root = xml.Element("mujoco", model=path.stem)
    p, q = np.zeros(3), np.array([1.0, 0, 0, 0])
    if hasattr(estimate, "position"):  # a Body has no pose
        p, q = estimate.position[-1], estimate.quaternion[-1]
    mass, centre, inertia, friction = _physics(estimate)
    attributes = _box(estimate)
    if attributes is None:
        assets = xml.SubElement(root, "asset")
        xml.SubElement(assets, "mesh", name="shape", vertex=_text(estimate.vertices))
        attributes = {"type": "mesh", "mesh": "shape"}
    else:
        attributes = {"type": "box", "size": _text(attributes)}
    world = xml.SubElement(root, "worldbody")
    body = xml.SubElement(world, "body", name="object", pos=_text(p), quat=_text(q))
    xml.SubElement(body, "freejoint")
    full = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    xml.SubElement(
        body, "inertial", pos=_text(centre), mass=repr(mass), fullinertia=_text(full)
    )
    xml.SubElement(
        body, "geom", name="object", friction=f"{friction!r} {ROLLING}",
        rgba="0 0.45 0.7 1", **attributes,
    )  # fmt: skip
    return root


def _urdf(estimate, path):
    """Return the URDF model of a body; its mesh is written beside `path`."""
    root = xml.Element("robot", name=path.stem)
    link = xml.SubElement(root, "link", name="object")
    mass, centre, inertia, friction = _physics(estimate)
    inertial = xml.SubElement(link, "inertial")
    xml.SubElement(inertial, "origin", xyz=_text(centre), rpy="0 0 0")
    xml.SubElement(inertial, "mass", value=repr(mass))
    names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1),
             ("iyz", 1, 2), ("izz", 2, 2))  # fmt: skip
    entries = {name: repr(float(inertia[i, j])) for name, i, j in names}
    xml.SubElement(inertial, "inertia", **entries)
    half = _box(estimate)
    if half is None:
        estimate_mesh = path.with_suffix(".stl")
        _write_mesh(estimate, estimate_mesh)
    for kind in ("visual", "collision"):
        shape = xml.SubElement(xml.SubElement(link, kind), "geometry")
        if half is None:
            xml.SubElement(shape, "mesh", filename=estimate_mesh.name)
        else:
            xml.SubElement(shape, "box", size=_text(2 * half))
    contact = xml.SubElement(link, "contact")
    xml.SubElement(contact, "lateral_friction", value=repr(friction))
    return root


def _box(estimate) -> np.ndarray | None:
    """Return the half widths (3,) [m] of a box about its origin, else None."""
    half = np.ptp(estimate.vertices, axis=0) / 2
    flush = np.allclose(abs(estimate.vertices), half, atol=1e-9)
    return half if flush and len(estimate.vertices) == 8 else None


def _physics(estimate) -> tuple:
    """Return mass [kg], centre of mass (3,) [m], inertia about it, and friction.

    inertia (3, 3) [kg m^2]: of a Body the identified one, about its origin; of an
    Estimate that of a uniform body about its centroid, taken about the centre of mass
    also where this was found elsewhere, as the pages take it; friction [1] with the
    ground: known or estimated, else 0.
    """
    if hasattr(estimate, "inertia"):
        inertia, friction = np.diag(estimate.inertia), float(estimate.friction)
        return float(estimate.mass), np.zeros(3), inertia, friction
    import trimesh

    solid, mass = trimesh.convex.convex_hull(estimate.vertices), estimate.scene.mass
    inertia = solid.moment_inertia * float(mass) / solid.mass
    friction = estimate.scene.friction_ground
    if friction is None:
        friction = np.ravel(estimate.unknowns.get(GROUND_FRICTION, 0.0))[0]
    centre = solid.center_mass + estimate.centre_of_mass
    return float(mass), centre, inertia, float(friction)


def _text(numbers) -> str:
    return " ".join(repr(float(number)) for number in np.ravel(numbers))
