"""Estimates of polytopes: impulses, ground, degenerate starts, change of class."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import octahedron
from scipy.spatial.transform import Rotation
from trimesh.convex import convex_hull
from trimesh.proximity import closest_point_naive

from formulations import polytope_violation_implicit
from formulations.names import COMPLIANCE
from formulations.polytope import COUNTS, polytope
from tactilenlp import (
    Estimate,
    Ground,
    Guess,
    solve_estimate,
    surface_distance,
)
from tactilenlp.certificates import static_friction
from tactilenlp.common.deadline import NEVER, Deadline
from tactilenlp.errors import OptionError, SceneError, StartError
from tactilenlp.geometry.convex_hull import nearest_points
from tactilenlp.interface.readout import information_in_time, read_hull
from tactilenlp.interface.request import make_job
from tactilenlp.local import local_solve
from tactilenlp.local.local_solve import after_soft_fingertips, solved_from
from tactilenlp.problem.options import Options
from tactilenlp.problem.reductions import Reductions
from tactilenlp.search.polytope_init import search_polytope

ACTIONS = 4


@pytest.fixture(scope="module")
def slid():
    return octahedron(ACTIONS)


@pytest.fixture(scope="module")
def hull(slid):
    data, scene, _ = slid
    return solve_estimate(data, scene, shape="polytope")


def test_the_estimate_lies_about_the_true_octahedron(slid, hull):
    distance = surface_distance(slid[2], hull.mesh(), samples=500)
    assert distance.a_to_b < 3e-3  # half of its faces were not touched yet
    assert len(hull.vertices) in COUNTS  # as many as the evidence asks for
    volume = convex_hull(hull.vertices)
    assert volume.center_mass == pytest.approx(np.zeros(3), abs=1e-6)
    assert hull.position[-1] == pytest.approx(hull.mesh().center_mass, abs=1e-6)


@pytest.mark.slow
def test_the_surface_has_the_normals_that_were_felt_on_a_tilted_ground():
    data, scene, body = octahedron(5)
    R = Rotation.from_rotvec([0.3, -0.2, 0.0])
    tilted = replace(scene, ground=Ground(normal=tuple(R.apply([0, 0, 1]))))
    data = data.transformed(R.as_matrix(), np.zeros(3))
    estimate = solve_estimate(data, tilted, shape="polytope")
    t, f = np.nonzero(data.contact)
    turn = Rotation.from_quat(estimate.quaternion, scalar_first=True)
    felt = (turn[-1] * turn[t].inv()).apply(data.normal[t, f])
    planes = estimate.supporting_planes()
    alike = (planes.normal @ felt.T).max(axis=1)  # cosine to the closest felt normal
    assert alike[planes.touches > 0].min() > 0.98
    faces = R.apply(np.array(body.face_normals))
    faces = faces[(faces @ felt.T > 0.98).any(axis=1)]  # that were truly felt: five
    assert len(faces) == 5
    assert (planes.touches > 0).sum() >= len(faces)
    # Where a finger slid along a straight track, the hull may have an edge: what was
    # felt is the normal of its surface at the finger, of a face or of an edge.
    centres = turn[t].inv().apply(data.finger_position[t, f] - estimate.position[t])
    away = centres - nearest_points(estimate.vertices, centres)
    surface = turn[-1].apply(away / np.linalg.norm(away, axis=1, keepdims=True))
    for face in faces:
        on_face = felt @ face > 0.999
        assert on_face.any()
        assert (surface[on_face] @ face).min() > 0.999


def searched_first_action(slid):
    """Return the job of the first action, and the hypothesis that its search finds."""
    data, scene, _ = slid
    page = polytope_violation_implicit
    job = make_job(data.select([0]), scene, polytope(20), Options(), 0.0, page)
    job = replace(job, deadline=NEVER)
    (h,) = search_polytope(replace(job, reductions=Reductions()), [])
    return job, h


def test_the_solve_goes_on_from_a_page_that_is_filled_anew(slid):
    job, h = searched_first_action(slid)
    assert [level.rebuild for level in job.page.LEVELS] == [False, True]
    solved = solved_from(job, h)
    solution = solved.solution
    assert solution.success
    assert len(solution.iterations_by_level) == 2
    assert sum(solution.iterations_by_level) == solution.iterations
    assert np.unique(solution.progress["level"]).tolist() == [0, 1]
    assert not np.allclose(solved.hypothesis.theta, h.theta)  # it was moved on


def test_where_time_ends_soft_fingertips_the_page_is_of_rigid_ones(slid):
    job, h = searched_first_action(slid)
    late = after_soft_fingertips(replace(job, deadline=Deadline.within(0.0)), h)
    assert late.job.reductions.rigid
    assert COMPLIANCE not in late.problem.variables
    assert not late.solution.success
    assert np.isfinite(late.solution.objective)
    assert late.solution.iterations_by_level  # what was computed is told


def test_where_soft_fingertips_leave_no_body_rigid_ones_start_alone(slid, monkeypatch):
    job, h = searched_first_action(slid)
    collapsed = local_solve.collapsed
    monkeypatch.setattr(
        local_solve, "collapsed", lambda s: not s.job.reductions.rigid or collapsed(s)
    )
    solved = after_soft_fingertips(job, h)
    assert solved.solution.success
    assert solved.job.reductions.rigid
    alone = solved_from(job, h)
    assert solved.solution.objective == alone.solution.objective


def test_it_stands_on_three_vertices_and_none_is_below_the_ground(hull):
    z = np.sort(hull.mesh().vertices[:, 2])
    assert z[0] > -1e-6
    assert z[2] < 1e-4


def test_a_hull_on_three_legs_is_read_with_these(slid):
    job, found = searched_first_action(slid)
    vertices = found.theta.reshape(-1, 3)
    vertices[np.argsort(vertices[:, 2])[3:], 2] += 2e-3  # a fourth might carry as well
    found = replace(found, theta=vertices.ravel())
    solved = solved_from(job, found, levels=job.page.LEVELS[:1])
    assert len(solved.window.legs) == 3 < len(job.shape.corners)
    body = read_hull(job, solved)
    information = information_in_time(job, solved, body["faces"])
    assert np.isfinite(body["body_vertices"]).all()
    assert np.isfinite(information.covariance_matrix).all()


def test_fingers_push_where_they_touch_and_nowhere_else(slid, hull):
    data, scene, _ = slid
    weight = scene.mass * scene.gravity * data.dt
    total = hull.impulses["ground"].copy()
    for finger in range(data.fingers):
        push = hull.impulses[f"finger {finger}"]
        touched = data.contact[:, finger] & data.valid[:, finger]
        assert not push[~touched].any()
        # It moved the body, which needs more than the ground's friction.
        strongest = np.linalg.norm(push[touched], axis=1).max()
        assert strongest > scene.friction_ground * weight
        total += push
    # The body neither rises nor falls: ground and fingers carry its weight, up to the
    # sigma of the balance.
    carried = hull.impulses["ground"][:, 2] != 0
    assert carried.any()
    assert total[carried, 2] == pytest.approx(weight, rel=1e-3)


def shared_poses(estimate):
    """Return how many poses were left out, and whether that holds."""
    found = [s for s in estimate.skipped if s.name == "still"]
    return sum(int(s.dropped.split()[0]) for s in found), all(s.holds for s in found)


def test_friction_holds_a_hull_that_nothing_touches(slid, monkeypatch):
    data, scene, _ = slid
    given = data.select(range(2)), scene
    told = {"shape": "polytope", "formulation": "quasi_static", "throw": False}
    still, holds = shared_poses(solve_estimate(*given, **told))
    assert holds
    assert still > data.samples / 4
    monkeypatch.setattr(static_friction, "WORK_COST", 0.01)
    sliding, _ = shared_poses(solve_estimate(*given, **told))
    assert sliding < still  # what friction does not hold has poses of its own


def test_an_estimate_survives_the_disk(hull, tmp_path):
    hull.save(tmp_path / "hull.npz")
    back = Estimate.load(tmp_path / "hull.npz")
    assert np.array_equal(back.vertices, hull.vertices)
    assert np.array_equal(back.faces, hull.faces)
    assert back.summary() == hull.summary()


def test_twenty_vertices_become_thirty_with_the_next_action(hull):
    data, scene, _ = octahedron(ACTIONS + 1)
    more = solve_estimate(
        data, scene, shape=polytope(30), start=hull, formulation="quasi_static"
    )
    assert more.vertices.shape == (30, 3)
    assert len(more.position) == data.samples
    assert more.hypotheses[0].x.shape == (3, data.samples)


def test_a_cuboid_becomes_a_polytope(estimate, recorded):
    _, scene, _ = recorded
    data = estimate.measurements
    hull = solve_estimate(
        data, scene, shape="polytope", start=estimate, formulation="quasi_static"
    )
    assert hull.shape == "polytope"
    distance = surface_distance(estimate.mesh(), hull.mesh(), samples=500)
    assert distance.a_to_b < 4e-3  # its untouched sides are now those of a ball


def contact_points(estimate):
    """Return where the fingers touched (n, 3) [m], on the body at its last pose."""
    data = estimate.measurements
    t, f = np.nonzero(data.contact & data.valid)
    point = data.finger_position[t, f] - data.finger_radius[f, None] * data.normal[t, f]
    R = Rotation.from_quat(np.roll(estimate.quaternion, -1, axis=1))
    body = R[t].inv().apply(point - estimate.position[t])
    return R[-1].apply(body) + estimate.position[-1]


@pytest.mark.slow
def test_a_cuboid_seen_as_a_polytope_has_the_same_faces_where_it_was_touched(
    estimate, recorded
):
    hull = solve_estimate(estimate.measurements, recorded[1], shape="polytope")
    points = contact_points(estimate)
    away = closest_point_naive(hull.mesh(), points)[1]
    assert np.median(away) < 0.3e-3
    assert away.mean() < 1e-3


def test_what_a_polytope_cannot_do_is_said_before_any_solve(slid, hull):
    data, scene, _ = slid
    up = np.tile([1.0, 0, 0, 0], (data.samples, data.fingers, 1))
    pointing = replace(data, finger_orientation=up)
    with pytest.raises(OptionError, match="formulation: no page"):
        solve_estimate(data, scene, shape="polytope", formulation="shooting")
    capsules = replace(scene, finger_length=0.02)
    with pytest.raises(SceneError, match="round fingertips"):
        solve_estimate(pointing, capsules, shape="polytope")
    guess = Guess(np.full(3, 0.04), np.zeros(2))
    with pytest.raises(StartError, match="without a guess"):
        solve_estimate(data, scene, shape="polytope", start=guess)
    with pytest.raises(StartError, match="another shape"):
        solve_estimate(data, scene, start=hull)
