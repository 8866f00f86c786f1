r"""Where the centre of mass is: at the centroid only as far as a prior says.

    p_wm = p_wo + R_wo (centroid + e_m)
    |e_m|^2 / (2 deviation^2)           prior,  deviation = sigma_centre * typical size

e_m (3,) [m] is in the body's frame, sigma_centre a datum of the scene, the typical size
the mean of the prior of sizes.  Where `window.central` is true, e_m is zero and no
unknown (reduction "central").
"""

from __future__ import annotations

import casadi as ca

from .names import CENTRE_OF_MASS


def declare(nlp, window, scene, shape):
    """Declare e_m and add its prior; return e_m, zero where it is the centroid."""
    if window.central:
        return 0.0
    deviation = scene.sigma_centre * shape.typical_size
    e_m = nlp.variable(CENTRE_OF_MASS, 3, guess=0.0, unit="m", scale=1e-3)
    name = f"{CENTRE_OF_MASS} prior"
    nlp.minimize(name, lambda e_m: ca.sumsqr(e_m / deviation) / 2, e_m, role="prior")
    return e_m
