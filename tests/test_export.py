"""What is exported is the body that was estimated: simulators find it as it is."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from formulations.names import CENTRE_OF_MASS
from tactilenlp import Scene, export_shape, identify_body
from tactilenlp.errors import OptionError, TactileError
from tactilenlp.geometry.faces import face_sigma, polygons
from tactilenlp.output.colours import BLUE, RED, information_colour

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def cube(tosses):
    return identify_body(tosses.select(tosses.tosses[:1]), Scene(mass=0.37))


@pytest.fixture
def wedge(estimate):
    """An estimate whose shape is no box."""
    points = np.array([[-1, -1, -1], [1, -1, -1], [-1, 1, -1], [1, 1, -1], [0, 0, 2]])
    points = points * 0.02
    points = points - trimesh.convex.convex_hull(points).center_mass
    return replace(estimate, body_vertices=points, shape="polytope")


def simulate(path, seconds=1.0):
    """Drop the exported body on a plane; return its free joint and geom at the end."""
    scene = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1" friction="0 0 0"/>'
        "</worldbody></mujoco>"
    )
    spec = mujoco.MjSpec.from_file(str(path))
    body = spec.body("object") if path.suffix == ".xml" else spec.bodies[1]
    if path.suffix == ".urdf":
        body.add_freejoint()
        body.pos = [0, 0, 0.1]
    frame = scene.worldbody.add_frame()
    frame.attach_body(body, "one_", "")
    model = scene.compile()
    data = mujoco.MjData(model)
    while data.time < seconds:
        mujoco.mj_step(model, data)
    return model, data


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".glb", ".ply"])
def test_a_mesh_encloses_the_volume_that_was_estimated(estimate, tmp_path, suffix):
    export_shape(estimate, tmp_path / f"shape{suffix}")
    mesh = trimesh.load_mesh(tmp_path / f"shape{suffix}")
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    assert mesh.is_watertight
    # STL has single precision.
    assert mesh.volume == pytest.approx(np.prod(estimate.side_lengths), rel=1e-5)


@pytest.mark.parametrize("suffix", [".xml", ".urdf"])
def test_a_box_is_loaded_falls_and_comes_to_rest_on_its_face(
    estimate, tmp_path, suffix
):
    path = tmp_path / f"box{suffix}"
    export_shape(estimate, path)
    model, data = simulate(path)
    height = data.qpos[2]
    # MuJoCo's soft contact gives way by a tenth of a millimetre.
    assert height == pytest.approx(estimate.side_lengths[2] / 2, abs=0.3e-3)
    assert model.body_mass[1] == pytest.approx(estimate.scene.mass)
    a, b, c = estimate.side_lengths
    uniform = (
        estimate.scene.mass
        / 12
        * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    )
    np.testing.assert_allclose(
        np.sort(model.body_inertia[1]), np.sort(uniform), rtol=1e-6
    )


@pytest.mark.parametrize("suffix", [".xml", ".urdf"])
def test_a_hull_is_loaded_and_stands(wedge, tmp_path, suffix, monkeypatch):
    monkeypatch.chdir(tmp_path)
    export_shape(wedge, tmp_path / f"wedge{suffix}")
    model, data = simulate(tmp_path / f"wedge{suffix}")
    assert model.ngeom == 2
    assert data.qpos[2] == pytest.approx(-wedge.vertices[:, 2].min(), abs=0.5e-3)


def test_the_model_stands_where_the_estimate_ended_and_slips_as_it_did(
    estimate, tmp_path
):
    export_shape(estimate, tmp_path / "box.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "box.xml"))
    np.testing.assert_allclose(model.qpos0[:3], estimate.position[-1])
    np.testing.assert_allclose(model.qpos0[3:], estimate.quaternion[-1], atol=1e-9)
    assert model.geom("object").friction[0] == estimate.scene.friction_ground
    unknown = replace(
        estimate, scene=replace(estimate.scene, friction_ground=None),
        unknowns=estimate.unknowns | {"ground friction": np.array([[0.27]])},
    )  # fmt: skip
    export_shape(unknown, tmp_path / "box.urdf")
    assert '<lateral_friction value="0.27"' in (tmp_path / "box.urdf").read_text()


@pytest.mark.parametrize("suffix", [".xml", ".urdf"])
def test_a_body_is_heavy_where_its_centre_of_mass_was_found(estimate, tmp_path, suffix):
    off, path = np.array([[4e-3], [-2e-3], [-6e-3]]), tmp_path / f"loaded{suffix}"
    found = replace(estimate, unknowns=estimate.unknowns | {CENTRE_OF_MASS: off})
    export_shape(found, path)
    body = mujoco.MjSpec.from_file(str(path)).bodies[1]
    np.testing.assert_allclose(body.ipos, off[:, 0], atol=1e-12)


def test_an_identified_body_keeps_its_own_inertia(cube, tmp_path):
    export_shape(cube, tmp_path / "cube.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "cube.xml"))
    np.testing.assert_allclose(
        np.sort(model.body_inertia[1]), np.sort(cube.inertia), rtol=1e-6
    )
    assert model.geom("object").friction[0] == pytest.approx(cube.friction)
    export_shape(cube, tmp_path / "cube.glb")


def test_a_face_that_was_touched_is_redder_than_one_that_was_not(estimate, tmp_path):
    sigma = face_sigma(estimate)
    touched = [
        estimate.faces[np.argmax(abs(n)), int(n.sum() > 0)] >= 3
        for _, n in polygons(estimate.vertices)
    ]
    touched = np.array(touched)
    assert 0 < touched.sum() < 6
    assert sigma[touched].max() < 1e-3 < sigma[~touched].max()
    assert sigma.min() < 1e-12  # the bottom lies on the ground, by reduction
    export_shape(estimate, tmp_path / "shape.glb")
    mesh = trimesh.load_mesh(tmp_path / "shape.glb")
    found = np.unique(mesh.visual.vertex_colors[:, :3], axis=0)
    assert len(found) > 2
    assert tuple(information_colour(1.0)) == BLUE
    assert tuple(information_colour(1e-6)) == RED
    assert len(set(information_colour(np.nan))) == 1


def test_an_unknown_suffix_is_refused_with_the_ones_that_are_known(estimate, tmp_path):
    with pytest.raises(OptionError, match=r"\.glb"):
        export_shape(estimate, tmp_path / "shape.step")
    assert not any(tmp_path.iterdir())


def test_a_body_without_volume_or_with_faces_of_another_is_refused_in_words(estimate):
    flat = replace(estimate, body_vertices=estimate.vertices * [1.0, 1.0, 0.0])
    with pytest.raises(OptionError, match="vertices: the body has no volume"):
        flat.supporting_planes()
    other = replace(estimate, faces=np.zeros(7, int))
    with pytest.raises(OptionError, match="touches of 7 faces"):
        other.supporting_planes()


def test_a_box_whose_sizes_are_not_three_or_not_known_is_still_put_in_words(estimate):
    less = replace(estimate, theta=estimate.theta[:2])
    maps = {k: v for k, v in estimate.information.maps.items() if k != "side_lengths"}
    unknown = replace(estimate, information=replace(estimate.information, maps=maps))
    for odd in (less, unknown):
        assert "8 vertices, " in odd.summary()
    with pytest.raises(TactileError, match="only a cuboid has side lengths"):
        less.side_lengths  # noqa: B018
