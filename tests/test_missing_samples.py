"""Missing samples: where a finger may have pushed, and what that costs."""

from dataclasses import replace

import numpy as np
import pytest
from programmes import SENSORS, programme, true_values

from formulations import quasi_static, violation_implicit
from formulations.finger_contact import CHANGE
from formulations.shape import CUBOID
from tactilenlp import solve_estimate
from tactilenlp.data.sensor_noise import precision_of
from tactilenlp.geometry.transforms import planar_matrix
from tactilenlp.problem.missing_samples import LONG_WAY, unseen_contact
from tactilenlp.problem.reductions import Reductions, window_of_samples
from tactilenlp.tracking.geometry import geometry_of

WEIGHT = 9.81  # [m/s^2] times mass and time step


def without(data, lost):
    """Return the data without the samples that are lost (T, F)."""
    valid = data.valid & ~lost
    normal = np.where(valid[..., None], data.normal, 0.0)
    return replace(data, valid=valid, contact=data.contact & valid, normal=normal)


def one(data, t, f):
    """Return the data without the sample t of finger f."""
    lost = np.zeros_like(data.valid)
    lost[t, f] = True
    return without(data, lost)


def pushing(data) -> tuple[int, int]:
    """Return sample and finger in the middle of a touch."""
    felt = data.contact & data.valid
    inside = felt[1:-1] & felt[:-2] & felt[2:]
    t, f = np.argwhere(inside)[len(np.argwhere(inside)) // 2]
    return int(t) + 1, int(f)


def approaching(data) -> tuple[int, int]:
    """Return sample and finger between samples without contact."""
    free = ~data.contact & data.valid
    t, f = np.argwhere(free[1:-1] & free[:-2] & free[2:])[0]
    return int(t) + 1, int(f)


def test_a_missing_sample_hides_a_contact_beside_a_touch_only(two_actions):
    data, _, _ = two_actions
    assert not unseen_contact(data).any()
    t, f = pushing(data)
    assert np.argwhere(unseen_contact(one(data, t, f))).tolist() == [[t, f]]
    assert not unseen_contact(one(data, *approaching(data))).any()


def test_a_finger_that_stands_still_hides_no_contact_and_one_that_travels_does(
    two_actions,
):
    data, _, _ = two_actions
    rows = data.action == 0
    lost = np.zeros_like(data.valid)
    lost[rows, 0] = True
    moved = data.finger_position.copy()
    away = np.linalg.norm(np.diff(moved[rows, 0], axis=0), axis=1).sum()
    assert away > LONG_WAY
    assert unseen_contact(without(data, lost))[rows, 0].all()
    moved[rows, 0] = moved[0, 0]
    parked = replace(without(data, lost), finger_position=moved)
    assert not unseen_contact(parked)[rows, 0].any()


def test_a_finger_that_never_measures_hides_no_contact(two_actions):
    data, _, _ = two_actions
    lost = np.zeros_like(data.valid)
    lost[:, 0] = True
    assert not unseen_contact(without(data, lost)).any()


def test_a_missing_sample_in_a_touch_keeps_its_impulse(two_actions):
    data, scene, _ = two_actions
    t, f = pushing(data)
    lost = one(data, t, f)
    whole, window = (
        window_of_samples(d, scene, CUBOID, SENSORS, Reductions()) for d in (data, lost)
    )
    assert len(whole.unseen) == 0
    assert len(window.touch) == len(whole.touch) - 1
    for name in ("sample", "finger", "step"):
        np.testing.assert_array_equal(
            getattr(window.push, name), getattr(whole.push, name)
        )
    row = int(window.unseen[0])
    assert (window.push.sample[row], window.push.finger[row]) == (t, f)
    assert not np.isin(window.unfelt, window.unseen).any()


def unseen_cost(two_actions, gap: float, impulse: float) -> float:
    """Return the cost [nats] of an impulse [weights] of a finger in the air."""
    data, scene, truth = two_actions
    t, f = pushing(data)
    problem, window = programme(violation_implicit, one(data, t, f), scene)
    row = int(window.unseen[0])
    values = true_values(problem, window, truth, np.random.default_rng(3))
    values["depth"] = 0.0
    w = scene.mass * WEIGHT * window.step.dt[window.push.step[row]]
    values["finger"][:, row] = impulse * w, 0, 0
    # The finger is moved along the body's normal until it is `gap` off its surface.
    z = np.r_[truth["side_lengths"], values["x"][:, window.pose[t]]]
    p, rho = window.push.p_wf[row], window.push.radius[row]
    for _ in range(3):
        phi, n = geometry_of(CUBOID).contact(z[:, None], p, rho)
        p = p + (gap - phi[0]) * planar_matrix(z[-1]) @ n[:, 0]
    push = replace(window.push, p_wf=window.push.p_wf.copy())
    push.p_wf[row] = p
    problem, _ = programme(
        violation_implicit, one(data, t, f), scene, finger=lambda w: {"push": push}
    )
    x, given = problem.pack(values), problem.data()
    return float(problem.value("unseen finger", x, given)[0, 0])


def test_a_finger_whose_sample_is_missing_pays_for_impulses_across_a_gap(
    two_actions, interpreted
):
    """Half a weight across 2 mm costs kappa = 5 nats/mm: five nats; none is free."""
    assert unseen_cost(two_actions, 2e-3, 0.5) == pytest.approx(5.0, rel=1e-3)
    assert unseen_cost(two_actions, 2e-3, 0.0) == pytest.approx(0.0, abs=1e-9)
    # Where it touches, an impulse costs what rounding max(phi, 0) leaves.
    assert unseen_cost(two_actions, 0.0, 0.5) == pytest.approx(0.0, abs=0.05)
    # It cannot be inside: a millimetre is six deviations of the touched gap.
    assert unseen_cost(two_actions, -1e-3, 0.0) > 4


def test_derivatives_with_missing_samples_are_those_of_finite_differences(
    two_actions, interpreted
):
    data, scene, truth = two_actions
    lost = one(data, *pushing(data))
    problem, window = programme(violation_implicit, lost, scene)
    values = true_values(problem, window, truth, np.random.default_rng(3))
    report = problem.check(values)
    assert max(report.derivatives["unseen finger"]) < 1e-5
    assert max(report.derivatives["lasting push"]) < 1e-5
    assert report.assembled < 1e-5


def test_a_push_lasts_through_a_missing_sample_and_pays_for_changes(
    two_actions, interpreted
):
    data, scene, truth = two_actions
    t, f = pushing(data)
    problem, window = programme(violation_implicit, one(data, t, f), scene)
    push, pairs = window.push, np.transpose(window.lasting)
    found = [(*push.sample[[j, i]], *push.finger[[j, i]]) for j, i in pairs]
    assert found == [(t, t - 1, f, f), (t + 1, t, f, f)]
    _, whole = programme(violation_implicit, data, scene)
    assert not whole.lasting[0].size
    values = true_values(problem, window, truth, np.random.default_rng(3))
    w = scene.mass * WEIGHT * window.step.dt[push.step]
    values["finger"][0] = 0.5 * w
    values["finger"][0, int(window.unseen[0])] *= 1.6
    cost = problem.value("lasting push", problem.pack(values), problem.data())
    assert cost[:, 0] == pytest.approx([0.3 / CHANGE] * 2, rel=0.1)  # rounded by 0.02


def test_motion_lasts_where_a_finger_that_may_push_is_not_seen(
    two_actions, interpreted
):
    """A body that moves on at its speed costs nothing there, one that stops does.

    It then changes by 1 mm and 0.02 rad, a way of 1.08 mm: 0.82 mm rounded, 300 nats/m.
    """
    data, scene, truth = two_actions
    t, f = pushing(data)
    lost = one(data, t, f)
    problem, window = programme(quasi_static, lost, scene)
    values = true_values(problem, window, truth, np.random.default_rng(3))
    k = int(np.flatnonzero(window.step.sample == t)[0])
    assert window.unseen_steps.tolist() == [k]
    ((rows, before),) = window.unseen_runs
    assert rows.tolist() == [k]
    assert window.step.pose[before] == window.step.before[k]
    x, step = values["x"], window.step
    x[:, step.before_2[k]] = 0.01, 0.02, 0.3
    x[:, step.before[k]] = 0.011, 0.02, 0.32
    for pose, cost in (((0.012, 0.02, 0.34), 0.0), ((0.011, 0.02, 0.32), 0.245)):
        x[:, step.pose[k]] = pose
        found = problem.value("lasting motion", problem.pack(values), problem.data())
        assert found[0, 0] == pytest.approx(cost, abs=0.005)


def test_a_body_that_is_let_go_in_motion_may_move_on(two_actions, interpreted):
    """By its motion since the last touch, and by one time step before."""
    data, scene, truth = two_actions
    last = int(np.flatnonzero(data.contact.any(axis=1))[-1])
    problem, window = programme(violation_implicit, data, scene)
    x = true_values(problem, window, truth)["x"]
    x[:] = x[:, :1]
    assert not window.let_go(x).any()  # it was at rest
    step = window.step
    pushed = np.flatnonzero(step.sample == last)
    after = np.flatnonzero(step.sample > last)
    assert len(pushed)
    moved = np.array([2e-3, 0.0, 0.1])
    x[:, window.pose[last] :] += moved[:, None]
    x[:, step.pose[after]] += 0.5 * moved[:, None]
    found = window.let_go(x)
    assert not found[:, : window.pose[last] + 1].any()
    later = found[:, window.pose[last] + 1 :]
    total = moved * (1.5 if len(after) else 1.0)
    assert later == pytest.approx(np.broadcast_to(total[:, None], later.shape))


def test_a_body_that_is_let_go_after_an_action_may_move_on_until_it_is_felt(
    two_actions, interpreted
):
    data, scene, truth = two_actions
    felt = np.flatnonzero(data.contact.any(axis=1))
    (begin,) = np.flatnonzero(np.diff(data.action)) + 1
    last, after = felt[felt < begin].max(), felt[felt >= begin].min()
    problem, window = programme(violation_implicit, data, scene)
    x = true_values(problem, window, truth)["x"]
    x[:] = x[:, :1]
    moved = np.array([2e-3, 0.0, 0.1])
    x[:, window.pose[last] :] += moved[:, None]
    found = window.let_go(x)
    between = slice(window.pose[last] + 1, window.pose[after])
    assert found[:, between] == pytest.approx(
        np.broadcast_to(moved[:, None], found[:, between].shape)
    )
    found[:, between] = 0.0
    assert not found.any()


@pytest.mark.slow
def test_half_of_the_samples_of_each_finger_tell_nearly_as_much(recorded):
    """Contacts that nothing measured still push: the fit stays as good."""
    data, scene, truth = recorded
    lost = without(data, np.random.default_rng(5).random(data.valid.shape) < 0.5)
    whole, half = solve_estimate(data, scene), solve_estimate(lost, scene)
    # [nats]; without impulses, tens.  Only `half` has a prior of pushes that last, and
    # unseen fingers that dissipate.
    paid = half.costs["lasting push"] + half.costs["unseen finger"]
    assert half.objective - paid < whole.objective + 2.0
    assert half.costs["lasting push"] < 10.0
    assert half.fit.verdict == "good"
    error = np.sort(half.side_lengths) - np.sort(truth["side_lengths"])
    order = np.argsort(half.side_lengths)
    assert (np.abs(error) < 3 * half.information.sigma("side_lengths")[order]).all()


def test_the_steps_of_a_later_action_keep_what_was_not_seen(two_actions):
    """Of a window's second action: the same pushes and steps, numbered from zero."""
    data, scene, _ = two_actions
    lost = np.zeros_like(data.valid)
    lost[-12:-8] = True
    data = without(data, lost)
    window = window_of_samples(
        data, scene, CUBOID, precision_of(data, scene), Reductions()
    )
    first = int(np.flatnonzero(data.action == data.action[-1])[0])
    later = replace(window, **window.of_later_steps(first))
    assert len(later.unseen_steps)
    for rows in (later.step, later.push, later.gap):
        assert (rows.sample >= first).all()
    assert (later.step.sample[later.push.step] == later.push.sample).all()
    for name in ("unseen", "unfelt"):
        whole, part = window.push.pick(getattr(window, name)), getattr(later, name)
        kept = whole.pick(whole.sample >= first)
        np.testing.assert_array_equal(later.push.pick(part).sample, kept.sample)
        np.testing.assert_array_equal(later.push.pick(part).finger, kept.finger)
    seen = later.step.sample[later.unseen_steps]
    whole = window.step.sample[window.unseen_steps]
    np.testing.assert_array_equal(seen, whole[whole >= first])


@pytest.mark.slow
def test_a_polytope_goes_on_by_an_action_with_missing_samples(two_actions):
    """Its planes and poses are found for the new action alone (was an IndexError)."""
    data, scene, _ = two_actions
    lost = np.zeros_like(data.valid)
    lost[-12:-8] = True
    data = without(data, lost)
    first = solve_estimate(data.select([0]), scene, shape="polytope")
    found = solve_estimate(data, scene, shape="polytope", start=first)
    assert found.success
    assert found.position.shape == (data.samples, 3)
