"""solve_estimate keeps its contract."""

import time
from dataclasses import fields, replace

import numpy as np
import pytest

from tactilenlp import Estimate, Ground, Measurements, Options, Scene, solve_estimate
from tactilenlp.errors import NoContactError, NotConverged, OptionError, StartError
from tactilenlp.evaluation.metrics import cuboid_errors, surface_distance
from tactilenlp.geometry.transforms import planar_matrix


@pytest.mark.slow
def test_side_lengths_touched_on_both_sides_are_right_to_a_fifth_of_a_millimetre(
    recorded,
):
    data, scene, truth = recorded
    estimate = solve_estimate(data, scene)
    error = cuboid_errors(
        estimate.side_lengths,
        estimate.position[-1],
        estimate.quaternion[-1],
        truth["side_lengths"],
        truth["object_position"][-1],
        truth["object_quaternion"][-1],
    )
    touched = (estimate.faces >= 3).all(axis=1) | ([False, False, True])
    known = touched[error.permutation]
    assert known.any()
    assert np.abs(error.side_lengths[known]).max() < 0.2e-3


def test_estimate_has_a_pose_and_impulses_at_every_sample(estimate):
    T = estimate.measurements.samples
    assert estimate.position.shape == (T, 3)
    assert estimate.quaternion.shape == (T, 4)
    assert np.allclose(np.linalg.norm(estimate.quaternion, axis=1), 1, atol=1e-9)
    for name in ("finger 0", "finger 1", "ground"):
        assert estimate.impulses[name].shape == (T, 3)


def test_a_finger_pushes_and_never_pulls(estimate):
    data = estimate.measurements
    for f in range(data.fingers):
        normal_part = (estimate.impulses[f"finger {f}"] * data.normal[:, f]).sum(axis=1)
        # outward normal: a push has a negative component; 1e-3 N s covers the angle
        # between the measured and the estimated normal
        assert normal_part.max() < 1e-3


def test_no_impulse_where_nothing_is_felt(estimate):
    data = estimate.measurements
    for f in range(data.fingers):
        free = ~data.contact[:, f]
        assert not estimate.impulses[f"finger {f}"][free].any()


def test_impulses_leave_the_exact_friction_cone_by_less_than_its_rounding(estimate):
    rounding = 0.003  # weights: what the page rounds the apex by
    for name in ("finger cone, exact", "ground cone, exact"):
        assert estimate.violations[name] <= rounding
    assert estimate.violations["finger cone"] < 1e-6


@pytest.mark.slow
def test_truth_keys_of_a_file_are_never_read(recorded, touched, tmp_path):
    _, _, truth = recorded
    rng = np.random.default_rng(0)
    known = {f.name for f in fields(Measurements)} | {
        "mass",
        "friction_ground",
        "friction_finger",
    }
    scrambled = {
        key: value if key in known else rng.permutation(np.ravel(value))
        for key, value in truth.items()
    }
    scrambled["planned_start"] = rng.normal(size=(7, 2))
    path = tmp_path / "scrambled.npz"
    np.savez(path, **scrambled)
    two = Measurements.load(path).select(range(2))
    found = solve_estimate(two, Scene.load(path))
    assert np.array_equal(found.position, touched.position)
    assert np.array_equal(found.side_lengths, touched.side_lengths)


@pytest.mark.slow
def test_a_ground_at_37_mm_gives_the_same_estimate_shifted(touched):
    data, scene, low = touched.measurements, touched.scene, touched
    up = np.array([0, 0, 0.037])
    raised = replace(scene, ground=Ground(height=0.037))
    high = solve_estimate(data.transformed(np.eye(3), up), raised)
    # the shift rounds the data's last digits; the optimum is flat to about 1e-6 m
    assert np.allclose(high.position - up, low.position, atol=1e-5)
    # which horizontal side is called x is a tie that the last digits decide
    same = [np.sort(e.side_lengths[:2]) for e in (high, low)]
    assert np.allclose(*same, atol=1e-5)
    assert high.side_lengths[2] == pytest.approx(low.side_lengths[2], abs=1e-5)


@pytest.mark.slow
def test_a_tilted_ground_gives_the_same_estimate_turned(touched):
    from scipy.spatial.transform import Rotation

    data, scene, flat = touched.measurements, touched.scene, touched
    R = Rotation.from_rotvec([0.3, -0.2, 0.0]).as_matrix()
    tilted = replace(scene, ground=Ground(normal=tuple(R @ [0, 0, 1])))
    turned = solve_estimate(data.transformed(R, np.zeros(3)), tilted)
    a = np.sort(turned.mesh().extents), turned.mesh().volume
    assert a[1] == pytest.approx(flat.mesh().volume, rel=1e-3)
    assert np.allclose(turned.position @ R, flat.position, atol=2e-5)
    pushed = turned.impulses["finger 0"] @ R
    assert np.allclose(pushed, flat.impulses["finger 0"], atol=1e-4)


@pytest.mark.slow
def test_the_same_input_gives_the_same_digits(recorded, touched):
    data, scene, _ = recorded
    a, b = touched, solve_estimate(data.select(range(2)), scene)
    assert np.array_equal(a.position, b.position)
    assert a.costs == b.costs


def test_save_and_load_round_trip_to_the_last_digit(estimate, tmp_path):
    path = tmp_path / "estimate.npz"
    estimate.save(path)
    again = Estimate.load(path)
    assert again.summary() == estimate.summary()
    assert np.array_equal(again.position, estimate.position)
    assert np.array_equal(again.information.matrix, estimate.information.matrix)
    assert again.measurements == estimate.measurements
    assert again.versions == estimate.versions
    assert again.options == estimate.options


@pytest.mark.slow
def test_a_loaded_estimate_carries_on(recorded, estimate, tmp_path):
    data, scene, _ = recorded
    estimate.save(tmp_path / "e.npz")
    more = solve_estimate(
        data.select(range(4)), scene, start=Estimate.load(tmp_path / "e.npz")
    )
    fresh = solve_estimate(data.select(range(4)), scene, start=estimate)
    assert np.array_equal(more.position, fresh.position)
    assert len(more.position) == data.select(range(4)).samples


def test_a_start_from_other_data_is_refused(recorded, estimate):
    data, scene, _ = recorded
    with pytest.raises(StartError, match="prefix"):
        solve_estimate(data.select([0, 2]), scene, start=estimate)


@pytest.mark.slow
def test_the_default_scene_needs_one_argument(recorded):
    data, _, _ = recorded
    estimate = solve_estimate(data.select(range(2)))
    assert estimate.scene == Scene()
    assert estimate.success


@pytest.mark.slow
def test_unknown_friction_becomes_an_unknown_with_a_prior(recorded):
    data, scene, _ = recorded
    unknown = replace(scene, friction_ground=None, friction_finger=None)
    estimate = solve_estimate(data.select(range(3)), unknown)
    assert 0.01 <= estimate.unknowns["ground friction"].item() <= 2
    assert "finger friction prior" in estimate.costs


def test_data_without_contact_raise_a_typed_error(recorded):
    data, _, _ = recorded
    nothing = replace(data, contact=0 * data.contact, normal=0 * data.normal)
    with pytest.raises(NoContactError, match="nothing was touched"):
        solve_estimate(nothing)


def test_single_false_contacts_are_no_touch(recorded):
    data, _, _ = recorded
    contact, normal = np.zeros_like(data.contact), np.zeros_like(data.normal)
    contact[[3, 40, 77], 0] = True
    normal[contact] = [0, 0, 1]
    with pytest.raises(NoContactError, match="3 single samples") as caught:
        solve_estimate(replace(data, contact=contact, normal=normal))
    assert "of one sample are not used" in caught.value.what
    assert "higher rate" in caught.value.next


@pytest.mark.slow
def test_a_tumbling_object_is_followed_in_free_motion(scenes):
    import trimesh
    from trimesh.transformations import quaternion_matrix, translation_matrix

    path = scenes / "stress_tumble_tall.npz"
    data = Measurements.load(path)
    estimate = solve_estimate(data, Scene.load(path))
    with np.load(path) as file:
        p, q = file["object_position"][-1], file["object_quaternion"][-1]
        pose = translation_matrix(p) @ quaternion_matrix(q)
        true = trimesh.creation.box(file["side_lengths"], transform=pose)
    assert surface_distance(estimate.mesh(), true).mean < 3e-3
    assert estimate.fit.verdict == "good"
    turned = data.transformed(planar_matrix(3.5), np.zeros(3))
    again = solve_estimate(turned, Scene.load(path))
    assert again.objective == pytest.approx(estimate.objective, abs=0.5)


@pytest.mark.slow
def test_a_time_limit_holds_for_all_that_follows_the_search(recorded, estimate):
    """Forty actions, in the time that an estimate of three takes four times over."""
    data, scene, _ = recorded
    many, limit = data, min(4.0, 4.0 * estimate.seconds["total"])
    while many.actions < 40:
        later = data.time + many.time[-1] + 1.0
        many = many.append(replace(data, time=later, action=data.action))
    began = time.monotonic()
    options = Options(time_limit=limit)
    late = solve_estimate(many, scene, options=options, throw=False)
    took = time.monotonic() - began
    assert took < limit + 1.5
    assert not late.success
    assert "time limit reached: without" in late.status
    assert late.position.shape == (many.samples, 3)


def test_an_unreachable_time_limit_ends_with_a_marked_estimate(recorded):
    data, scene, _ = recorded
    options = Options(time_limit=1e-3)
    estimate = solve_estimate(
        data.select(range(2)), scene, options=options, throw=False
    )
    assert "time" in estimate.status.lower()
    assert np.isfinite(estimate.position).all()


def test_a_solve_that_stops_early_raises_with_the_solution(recorded):
    data, scene, _ = recorded
    options = Options(ipopt={"max_iter": 1})
    with pytest.raises(NotConverged) as caught:
        solve_estimate(data.select(range(1)), scene, options=options)
    assert caught.value.solution is not None
    assert "iterations" in str(caught.value)


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        ({"shape": "sphere"}, "unknown shape"),
        ({"formulation": "magic"}, "unknown formulation"),
        ({"options": "fast"}, "Options"),
    ],
)
def test_a_wrong_choice_names_the_right_ones(recorded, call, expected):
    with pytest.raises(OptionError, match=expected):
        solve_estimate(recorded[0], **call)


@pytest.mark.parametrize(
    "wrong",
    [{"hypotheses": 0}, {"tolerance": -1.0}, {"without": ["stil"]}, {"time_limit": 0}],
)
def test_options_out_of_range_are_refused(wrong):
    with pytest.raises(OptionError):
        Options(**wrong)


@pytest.mark.slow
def test_a_process_pool_gives_the_same_digits(recorded, touched):
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    data, scene, _ = recorded
    data = data.select(range(2))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        spread = solve_estimate(data, scene, executor=pool)
    assert np.array_equal(spread.position, touched.position)


@pytest.mark.slow
def test_summary_says_what_was_not_observed(recorded):
    data, scene, _ = recorded
    first = solve_estimate(data.select([0]), scene)
    assert first.information.unobserved
    assert "Not observed: side" in first.summary()
    assert "±" in first.summary()


def test_mesh_lies_on_the_ground_and_has_the_estimated_size(estimate):
    mesh = estimate.mesh(sample=0)
    assert abs(mesh.bounds[0, 2]) < 1e-6
    assert mesh.volume == pytest.approx(np.prod(estimate.side_lengths), rel=1e-9)


def test_an_estimate_names_its_solver_and_how_far_it_is_from_an_optimum(estimate):
    assert estimate.solver in ("interior_point", "ipopt")
    # Of a solve to 1e-6, in nats over the typical change of each unknown.
    assert 0 <= estimate.stationarity < 1e-4
    assert 0 <= estimate.complementarity < 1e-4
