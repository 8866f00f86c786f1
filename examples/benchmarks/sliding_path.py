r"""The path of a body that slides: formulations/time_stepping.py, step after step.

x_0 at rest,    x_{t+1} = f_theta(x_t, x_{t-1}, r_t)
"""

from __future__ import annotations

import casadi as ca

from formulations.rigid_body import PLANAR
from formulations.sliding_contact import Pusher


def path(body, fingers, samples):
    """Return the Function from a pose at rest to the poses at all samples.

    (x_0 (3,), theta, (dt, mu, mu_g, v_eps) (4,), p_wf (fingers * numbers, samples) one
    finger below another, rho (fingers,)) -> x (3, samples), of which the first is x_0.
    """
    x_0, theta = ca.MX.sym("x_0", PLANAR.unknowns), ca.MX.sym("theta", body.shape.theta)
    law, rho = ca.MX.sym("known", 4), ca.MX.sym("rho", fingers)
    p_wf = ca.MX.sym("p_wf", body.finger.numbers * fingers, samples)
    shared = [ca.repmat(a, 1, samples - 1) for a in (theta, law, rho)]
    steps = _step(body, fingers).mapaccum(samples - 1)
    states = steps(ca.vertcat(x_0, x_0), *shared, p_wf[:, 1:], p_wf[:, :-1])
    x = ca.horzcat(x_0, states[: PLANAR.unknowns, :])
    return ca.Function("path", [x_0, theta, law, p_wf, rho], [x])


def _step(body, fingers):
    """Return the step: ((x_1, x_2), theta, law, rho, p_wf, p_wf_1) -> (x, x_1)."""
    n, size = body.finger.numbers, PLANAR.unknowns
    y, theta = ca.SX.sym("y", 2 * size), ca.SX.sym("theta", body.shape.theta)
    law, rho = ca.SX.sym("known", 4), ca.SX.sym("rho", fingers)
    p, p_1 = ca.SX.sym("p", n * fingers), ca.SX.sym("p_1", n * fingers)
    rows = [slice(f * n, (f + 1) * n) for f in range(fingers)]
    pushing = [Pusher(p[row], p_1[row], rho[f]) for f, row in enumerate(rows)]
    x = body.step(theta, y[:size], y[size:], *ca.vertsplit(law), *pushing)
    return ca.Function("step", [y, theta, law, rho, p, p_1], [ca.vertcat(x, y[:size])])
