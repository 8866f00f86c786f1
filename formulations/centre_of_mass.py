r"""Where the centre of mass is: at the centroid only as far as a prior says.

    p_wc = p_wo + R_wo (centroid + c)
    |c|^2 / (2 S^2)                     prior,  S = sigma_centre * typical size

c (3,) [m] is in the body's frame, sigma_centre a datum of the scene, the typical size
the mean of the prior of sizes.  Where `window.central` is true, c is zero and no
unknown (reduction "central").
"""

from __future__ import annotations

import casadi as ca

NAME = "centre of mass"


def declare(nlp, window, scene, shape):
    """Declare c and add its prior; return c, zero where it is the centroid."""
    if window.central:
        return 0.0
    deviation = scene.sigma_centre * shape.typical_size
    c = nlp.variable(NAME, 3, guess=0.0, unit="m", scale=1e-3)
    nlp.minimize(
        f"{NAME} prior", lambda c: ca.sumsqr(c / deviation) / 2, c, role="prior"
    )
    return c
