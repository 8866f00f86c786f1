"""What a finger feels, and what an impulse may do."""

import casadi as ca
import numpy as np
import pytest

from formulations import contact, sensing


def test_contact_booleans_cost_what_the_logistic_says():
    alpha, phi = 1500.0, np.linspace(-2e-3, 2e-3, 41)
    p_free = 1 / (1 + np.exp(-alpha * phi))
    for gap, p in zip(phi, p_free, strict=True):
        assert float(sensing.free(gap, alpha)) == pytest.approx(-np.log(p), rel=1e-12)
        assert float(sensing.logistic_contact(gap, alpha)) == pytest.approx(
            -np.log(1 - p), rel=1e-12
        )


def test_a_metre_of_gap_overflows_neither_cost_nor_slope():
    phi = ca.SX.sym("phi")
    cost = sensing.mixture(sensing.free(phi, 1500.0), 7.0), sensing.free(phi, 1500.0)
    slope = [ca.gradient(c, phi) for c in cost]
    f = ca.Function("f", [phi], [*cost, *slope, *(ca.gradient(s, phi) for s in slope)])
    bounded, free, *derivatives = (float(v) for v in f(-1.0))
    assert free == 1500.0
    assert bounded == pytest.approx(7.0 + np.log1p(np.exp(-7.0)), abs=1e-12)
    assert np.isfinite(derivatives).all()
    bounded, free, *derivatives = (float(v) for v in f(1.0))
    assert free == 0.0
    assert abs(bounded) < 1e-15
    assert derivatives == [0.0, 0.0, 0.0, 0.0]


def test_a_measured_normal_costs_its_squared_chord():
    n, n_m = np.array([0.6, 0, 0.8]), np.array([0.0, 0.6, 0.8])
    cost = float(sensing.normal(ca.DM(n), ca.DM(n_m), 0.1))
    assert cost == pytest.approx(((0.6**2 + 0.6**2) / 0.02), rel=1e-14)


def test_a_touch_costs_quadratically_near_and_linearly_far():
    sigma = 0.3e-3
    assert float(sensing.touch(0.0, sigma)) == 0.0
    near, far = 0.1 * sigma, 100 * sigma
    # Off by (phi / 4 sigma)^2 near and by 4 nats of 200 far.
    assert float(sensing.touch(near, sigma)) == pytest.approx(0.1**2 / 2, rel=1e-3)
    assert float(sensing.touch(far, sigma)) == pytest.approx(2 * 100 - 4, rel=1e-3)
    assert float(sensing.touch(-far, sigma)) == float(sensing.touch(far, sigma))


def test_no_sample_costs_more_than_the_outlier_cost_and_none_more_than_alone():
    for cost in (0.0, 0.5, 3.0, 7.0, 30.0, 1e6):
        bounded = float(sensing.mixture(cost, 7.0))
        most = 7.0 + np.log1p(np.exp(-7.0))
        assert bounded <= min(cost, most) + 1e-15
        direct = -np.log((np.exp(-cost) + np.exp(-7.0)) / (1 + np.exp(-7.0)))
        assert bounded == pytest.approx(direct, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_tangents_and_normal_are_a_right_handed_frame(seed):
    rng = np.random.default_rng(seed)
    n, t = rng.normal(size=(2, 3))
    n /= np.linalg.norm(n)
    t_1, t_2 = (np.asarray(v).ravel() for v in contact.tangents(ca.DM(n), ca.DM(t)))
    frame = np.array([n, t_1, t_2])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-8)  # 1e-9 rounds |t|
    assert np.linalg.det(frame) == pytest.approx(1, abs=1e-8)
    assert t_1 @ t > 0


def test_the_friction_cone_is_that_of_coulomb_but_for_its_apex():
    rounding = 1e-3
    inside, on, outside = ([2.0, 0.6 * s, 0.8 * s] for s in (0.9, 1.0, 1.1))
    for lam, exact in ((inside, 0.1), (on, 0.0), (outside, -0.1)):
        value = float(contact.cone(0.5, ca.DM(lam), rounding))
        assert exact <= value <= exact + rounding
    assert float(contact.cone(0.5, ca.DM.zeros(3), rounding)) == 0.0


def test_friction_that_opposes_sliding_at_the_cone_dissipates_all_it_can():
    mu, still, v = 0.5, 1e-4, np.array([0.06, -0.08])
    opposing = np.r_[2.0, -mu * 2.0 * v / 0.1]
    least = float(contact.sliding_loss(mu * 2.0, ca.DM(opposing), ca.DM(v), still))
    # sqrt(v^2 + still^2) - v = still^2 / (2 v)
    assert 0 <= least <= mu * 2.0 * still**2 / 0.2 * 1.001
    rng = np.random.default_rng(7)
    for _ in range(100):
        direction = rng.normal(size=2)
        share = rng.uniform(0, 1) * mu * 2.0 / np.linalg.norm(direction)
        lam = ca.DM(np.r_[2.0, share * direction])
        assert float(contact.sliding_loss(mu * 2.0, lam, ca.DM(v), still)) >= least


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99, 1.0])
def test_dissipation_is_zero_where_the_rounded_law_holds_and_nowhere_else(share):
    """Coulomb's law, of an impulse in the rounded cone."""
    mu, v_eps, rounding, lam_n = 0.5, 3e-3, 0.01, 2.0
    limit = np.sqrt((mu * lam_n + rounding) ** 2 - rounding**2)  # of contact.cone
    lam = ca.DM([lam_n, 0.6 * share * limit, 0.8 * share * limit])
    assert float(contact.cone(mu, lam, rounding)) >= -1e-12
    lam_t = lam.full()[1:, 0]
    root = np.sqrt((mu * lam_n + rounding) ** 2 - lam_t @ lam_t)

    def lost(v_s):
        return float(contact.dissipation(mu, lam, ca.DM(v_s), v_eps, rounding))

    assert lost(-v_eps * lam_t / root) == pytest.approx(0, abs=1e-12)
    for v_s in np.random.default_rng(1).normal(0, 0.05, (100, 2)):
        assert lost(v_s) > 0


def test_a_squeeze_of_a_body_at_rest_costs_nothing_however_hard():
    for lam_n in (0.1, 10.0):
        lam = ca.DM([lam_n, 0, 0])
        lost = float(contact.dissipation(0.5, lam, ca.DM.zeros(2), 3e-3, 0.01))
        assert lost == pytest.approx(0, abs=1e-15)


def test_dissipation_has_derivatives_outside_the_cone_and_without_friction():
    lam, v = ca.SX.sym("lam", 3), ca.DM([0.01, 0.0])
    for mu, rounding, at in ((0.5, 0.01, [1, 0.9, 0]), (0.0, 0.0, [1, 0, 0])):
        hessian, slope = ca.hessian(
            contact.dissipation(mu, lam, v, 3e-3, rounding), lam
        )
        both = ca.Function("f", [lam], [hessian, slope])(at)
        assert all(np.isfinite(value.full()).all() for value in both)


def test_an_impulse_needs_contact_and_returns_no_energy():
    lam = ca.DM([2.0, 0, 0])
    for of in (contact.complementarity, contact.inelasticity):
        assert float(of(lam, 1e-2, 1e-6)) == pytest.approx(2e-2, rel=1e-6)
        assert float(of(lam, -1e-2, 1e-6)) == pytest.approx(0, abs=1e-9)
        assert float(of(0 * lam, 1e-2, 1e-6)) == 0
