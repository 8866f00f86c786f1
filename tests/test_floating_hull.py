"""A hull in free motion, solved: it floats, or planar motion is switched off."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import squeezed
from programmes import octahedron
from scipy.spatial.transform import Rotation
from trimesh.convex import convex_hull
from trimesh.proximity import closest_point_naive

from formulations import polytope_violation_implicit as page
from formulations.polytope import polytope
from tactilenlp import (
    Estimate,
    Options,
    Scene,
    face_sigma,
    solve_estimate,
)
from tactilenlp.errors import SceneError
from tactilenlp.geometry.faces import polygons, touched_polygons
from tactilenlp.interface.request import hypotheses_to_continue, make_job
from tactilenlp.refinement.incremental_polytope import is_one_action_more
from tactilenlp.search.proposals_floating import (
    in_free_motion,
    in_plane,
    search_plane,
    with_faces_tracked,
)

AFLOAT = Scene(ground=None, gravity=0.0)
RADIUS = 0.03  # [m] of the octahedron that floats
SHAPE = polytope()

pytestmark = [pytest.mark.usefixtures("not_compiled"), pytest.mark.slow]


@pytest.fixture(scope="module")
def world():
    """An octahedron in micro-gravity that is kicked, then squeezed off its centre."""
    x, y, z, w = Rotation.from_rotvec([0.3, 0.2, 0.5]).as_quat()
    body = convex_hull(RADIUS * np.vstack([np.eye(3), -np.eye(3)]))
    return squeezed(vertices=body, position=(0, 0, 0.2), quaternion=(w, x, y, z))


@pytest.fixture(scope="module")
def afloat(world):
    return solve_estimate(world.measurements, AFLOAT, shape=SHAPE)


def held(world):
    """Return samples and fingers of the touches, but for the kick that set it off."""
    felt = np.argwhere(world.measurements.contact)
    return felt[felt[:, 0] > felt[0, 0]].T


@pytest.mark.slow
def test_a_floating_hull_is_found_where_it_was_touched(world, afloat):
    data = world.measurements
    assert afloat.success
    for t, f in zip(*held(world), strict=True):
        point = data.finger_position[t, f] - data.finger_radius[f] * data.normal[t, f]
        away = closest_point_naive(afloat.mesh(int(t)), point[None])[1][0]
        assert away < 0.1e-3
    planes, true = afloat.supporting_planes(), world.truth
    on = [np.argmax(planes.normal @ n) for n in true.normal[-1]]
    assert planes.touches[on].min() > 3
    # Where fingers were on the true body, its own surface is, wherever that had been.
    t, f = held(world)
    R = Rotation.from_quat(np.roll(true.object_quaternion, -1, axis=1))
    met = data.finger_position[t, f] - data.finger_radius[f, None] * data.normal[t, f]
    met = R[-1].apply(R[t].inv().apply(met - true.object_position[t]))
    away = closest_point_naive(afloat.mesh(), met + true.object_position[-1])[1]
    assert away.mean() < 0.2e-3
    assert away.max() < 0.5e-3


@pytest.mark.slow
def test_its_faces_are_followed_as_it_turns(world, afloat):
    true = world.truth
    there = Rotation.from_quat(np.roll(true.object_quaternion, -1, axis=1))
    found = Rotation.from_quat(np.roll(afloat.quaternion, -1, axis=1))
    t = np.unique(held(world)[0])
    n = np.array(true.normal[-1, 0])
    axes = [(R[t] * R[-1].inv()).apply(n) for R in (there, found)]
    assert np.linalg.norm(np.cross(*axes), axis=1).max() < np.radians(1)
    turned = np.linalg.norm(np.cross(axes[0][0], n))
    assert turned > np.radians(5)  # there was something to follow


@pytest.mark.slow
def test_a_way_is_found_on_which_fingers_keep_their_faces(world, afloat):
    data, true = world.measurements, world.truth
    (h,) = hypotheses_to_continue(afloat, SHAPE, AFLOAT, data)
    still = replace(h, x=np.tile(h.x[:, -1:], data.samples))
    x = with_faces_tracked(still, data).x
    t, f = held(world)
    turn = Rotation.from_rotvec(x[3:, t].T)
    there = Rotation.from_quat(np.roll(true.object_quaternion, -1, axis=1))
    there = there[t] * there[-1].inv()
    n = data.normal[-1][f]
    away = np.cross(turn.apply(n), there.apply(n))
    assert np.linalg.norm(away, axis=1).max() < np.radians(0.5)
    gap = (data.normal[t, f] * (data.finger_position[t, f] - x[:3, t].T)).sum(axis=1)
    for finger in (0, 1):  # its face is as far from the middle as it was
        assert np.ptp(gap[f == finger]) < 0.05e-3
    before = np.unique(t)[0] - 1  # nothing felt: it stays as the hypothesis says
    assert x[:, before] == pytest.approx(x[:, before + 1])


def test_a_touch_is_of_faces_that_are_as_it_was_felt():
    fall = 0.02 * np.tan(np.radians([2.0, 6.0]))  # of a roof, to either side
    gable = np.array([[0, 0], [-0.02, -fall[0]], [0.02, -fall[1]], [0, -0.02]])
    body = np.vstack([np.insert(gable, 1, y, axis=1) for y in (-0.02, 0.02)])
    up = np.array([[0.0, 0.0, 1.0]])  # felt on the ridge
    window = SimpleNamespace(
        touch=SimpleNamespace(sample=[0], radius=np.ones(1), p_wf=up, normal=up)
    )
    still = np.zeros((3, 1))
    faces = polygons(body)
    exact, noisy = (touched_polygons(window, body, faces, still, s) for s in (0, 0.09))
    assert exact.sum() == 1
    assert noisy.sum() == 2


@pytest.mark.slow
def test_every_normal_is_that_of_the_body_where_it_is_then(world, afloat):
    data = world.measurements
    for t, f in zip(*held(world), strict=True):
        centre = data.finger_position[t, f]
        on = closest_point_naive(afloat.mesh(int(t)), centre[None])[0][0]
        out = (centre - on) / np.linalg.norm(centre - on)
        assert np.linalg.norm(np.cross(out, data.normal[t, f])) < np.radians(1)


@pytest.mark.slow
def test_untouched_parts_of_a_floating_hull_are_listed_as_not_observed(afloat):
    sigma, touched = face_sigma(afloat), afloat.faces > 3
    normals = afloat.supporting_planes().normal[touched]
    one_face = normals @ normals.T > np.cos(np.radians(5))  # nearly coplanar facets
    known = [sigma[touched][facets].min() for facets in one_face]
    assert max(known) < 0.5 * np.median(sigma[afloat.faces == 0])
    assert np.median(sigma[afloat.faces == 0]) > 2e-3
    assert any("never touched" in words for words in afloat.information.unobserved)


@pytest.mark.slow
def test_nothing_of_a_ground_is_in_the_estimate(afloat):
    assert "ground" not in afloat.impulses
    assert not any("ground" in name or name == "rest" for name in afloat.costs)
    assert not any(s.name == "planar" for s in afloat.skipped)
    assert all(s.holds for s in afloat.skipped)
    assert len(afloat.unknowns["x"]) == 6
    assert afloat.quaternion[-1] == pytest.approx([1, 0, 0, 0], abs=1e-9)
    assert afloat.mesh().center_mass == pytest.approx(afloat.position[-1], abs=1e-6)
    assert "polytope" in afloat.summary()


@pytest.mark.slow
def test_the_estimate_of_a_floating_hull_survives_the_disk(afloat, tmp_path):
    afloat.save(tmp_path / "hull.npz")
    back = Estimate.load(tmp_path / "hull.npz")
    assert np.array_equal(back.vertices, afloat.vertices)
    assert back.summary() == afloat.summary()


@pytest.mark.slow
def test_a_floating_hull_starts_the_next_search_from_where_it_is(world, afloat):
    data = world.measurements
    job = make_job(data, AFLOAT, SHAPE, Options(), 0.0, page)
    (h,) = hypotheses_to_continue(afloat, SHAPE, AFLOAT, data)
    assert h.x.shape == (6, data.samples)
    here = h.theta.reshape(-1, 3) + h.x[:3, -1]
    assert here == pytest.approx(afloat.vertices + afloat.position[-1], abs=1e-9)
    plane = search_plane(job)
    flat = in_plane(h, plane)
    again = in_free_motion(flat, plane, SHAPE)
    lie = again.theta.reshape(-1, 3) + again.x[:3, -1]
    assert lie == pytest.approx(here, abs=1e-9)  # the last pose is kept, whole
    assert in_plane(again, plane).x == pytest.approx(flat.x, abs=1e-9)
    assert not is_one_action_more(afloat, job)  # not by an action alone


@pytest.fixture(scope="module")
def slid():
    """The estimate of a recording in which the body only slid, in planar motion."""
    data, scene, _ = octahedron(2)
    return solve_estimate(data, scene, shape=SHAPE)


@pytest.fixture(scope="module")
def loose(slid):
    """The same where it may tilt and lift."""
    return solve_estimate(
        slid.measurements, slid.scene, shape=SHAPE, options=Options(without=("planar",))
    )


@pytest.mark.slow
def test_a_hull_that_only_slid_is_found_again_in_free_motion(slid, loose):
    planar, free = slid, loose
    assert [len(e.unknowns["x"]) for e in (planar, free)] == [3, 6]
    assert any(s.name == "planar" for s in planar.skipped)
    assert not any(s.name == "planar" for s in free.skipped)
    assert all(s.holds for s in free.skipped)
    # More freedom: no worse, but for resting steps that cost what `planar` has free.
    assert planar.objective - 0.5 < free.objective < planar.objective + 0.1
    shift = np.linalg.norm(free.position - planar.position, axis=1)
    sigma = np.linalg.norm(planar.information.sigma("position"))
    assert shift.max() < sigma
    known = planar.faces > 3
    before, after = planar.supporting_planes(), free.supporting_planes()
    for n, b, sigma in zip(
        before.normal[known], before.offset[known], before.sigma[known], strict=True
    ):
        same = np.argmax(after.normal @ n)
        assert after.normal[same] @ n > np.cos(np.radians(3))
        assert abs(after.offset[same] - b) < 3 * sigma
        assert after.sigma[same] < 3 * sigma + 0.5e-3


@pytest.mark.slow
def test_in_free_motion_it_stays_on_the_ground_that_carries_it(slid, loose):
    data, free = slid.measurements, loose
    x = free.unknowns["x"]
    assert np.abs(x[2]).max() < 0.1e-3  # [m]
    assert np.abs(x[3:5]).max() < np.radians(0.5)
    z = np.concatenate([free.mesh(t).vertices[:, 2] for t in (0, 30, data.samples - 1)])
    assert z.min() > -1e-6
    carried = free.impulses["ground"][:, 2]
    pushed = sum(free.impulses[f"finger {f}"][:, 2] for f in range(data.fingers))
    weight = free.scene.mass * free.scene.gravity * data.dt
    held = (carried + pushed)[carried != 0]  # fingers on slanted faces press it down
    assert np.median(held) == pytest.approx(weight, rel=0.1)
    longer = octahedron(3)[0]
    jobs = [
        make_job(longer, free.scene, SHAPE, Options(without=off), 0.0, page)
        for off in ((), ("planar",))
    ]
    assert is_one_action_more(slid, jobs[0])
    assert not is_one_action_more(free, jobs[1])  # the whole way is gone
    assert not is_one_action_more(slid, jobs[1])


def test_least_motion_alone_keeps_no_hull_on_a_ground_and_asks_for_one(world):
    with pytest.raises(SceneError, match="planar motion only") as caught:
        solve_estimate(
            world.measurements, AFLOAT, shape="polytope", formulation="quasi_static"
        )
    assert "violation_implicit" in caught.value.next
