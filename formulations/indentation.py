r"""How deep a felt finger sits in the surface: soft fingertips, radius error.

    delta = d + c lam_n / w                       touched gap: phi + delta, see eq:loss
    d^2 / (2 DEPTH^2) + c^2 / (2 COMPLIANCE_SIGMA^2)    priors,  c >= 0
    sum (lam_n / w)^2 / (2 PUSH^2)                prior, where fingertips are soft

d [m] is common to all touches: an error of the radius.  c [m] is the compliance of the
fingertips, the indentation under the weight w = m g dt of a time step; lam_n is the
normal impulse of that step.  The law is linear: it explains 93 to 97 % of the excess
objective of MuJoCo's contacts, which are stiffer at small loads, a Hertzian law
(lam_n^(2/3)) less.

No motion tells how hard two fingers squeeze a body, only how deep they sit: c lam_n
can be exchanged for a change of the body's size.  The normal impulses of soft
fingertips therefore have a prior.

A touched sample that ends no time step has no impulse: c itself, the indentation under
one weight, is then added to the deviation of its gap.  Where `window.compliant` is
false, c is zero and no unknown (reduction "rigid").

The path that rigid fingertips would need is an optimum with c = 0, which may lie tens
of nats above the one of soft fingertips: solves hold c where it starts, then free it.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from .names import COMPLIANCE, DEPTH_OF_TOUCH, INDENTATION
from .rigid_body import G

DEPTH = 0.05e-3  # [m] deviation of d: radius error and rest of the compliance
COMPLIANCE_SIGMA = 5e-3  # [m] under one weight, deviation of c: rubber of any hardness
GUESS = 0.67 * COMPLIANCE_SIGMA  # [m] where c starts: the median of its prior
# [weights] deviation of a push of soft fingertips: sizes are nearest the true ones
# among 0.7, 1.3, 2.2 and 7 (27 recordings of MuJoCo's contacts, results/EXPERIMENTS.md)
PUSH = 1.3
SOFTEST = 50e-3  # [m] upper bound of c


class Rigid(NamedTuple):
    """The indentation d [m] of a rigid fingertip."""

    depth: object

    def delta(self):
        """Return the indentation [m]."""
        return self.depth

    def widened(self, sigma):
        """Return the deviation [m] of a gap whose own is sigma."""
        return sigma


class Soft(NamedTuple):
    """The indentation of a soft fingertip that pushes by lam (3,), w its weight.

    stepped: 1 where the sample ends a time step, so that lam is known, else 0.
    """

    depth: object
    compliance: object
    lam: object
    w: object
    stepped: object

    def delta(self):
        """Return the indentation [m]."""
        return self.depth + self.stepped * self.compliance * self.lam[0] / self.w

    def pushing(self):
        """Return the cost of how hard the fingertip pushes."""
        return self.stepped * (self.lam[0] / (PUSH * self.w)) ** 2 / 2

    def widened(self, sigma):
        """Return the deviation [m] of a gap whose own is sigma."""
        return ca.sqrt(sigma**2 + (1 - self.stepped) * self.compliance**2)


NONE = Rigid(0.0)  # of a page that knows no indentation


def declare(nlp, window, scene, pushes=None):
    """Declare d, and c where the fingertips are compliant; return Rigid or Soft.

    pushes: friction.Impulses of the fingers, None on a page without impulses.
    """
    d = nlp.variable(DEPTH_OF_TOUCH, 1, guess=0.0, unit="m", scale=DEPTH)
    if pushes is None or not window.compliant:
        return Rigid(d)
    if scene.compliance is None:
        c = nlp.variable(
            COMPLIANCE, 1, lower=0.0, upper=SOFTEST, guess=GUESS, unit="m", scale=1e-3
        )
    else:
        c = nlp.parameter(COMPLIANCE, told(scene), "m")
    row, stepped = window.push_of_touch
    return Soft(d, c, pushes.lam[:, row], pushes.w[row], stepped)


def told(scene):
    """Return the compliance [m per weight] of the fingertips that a scene tells."""
    return scene.compliance * scene.mass * G


def of_pushes(nlp, pushes, rows):
    """Return the indentation of the fingers that push by some rows of pushes."""
    d = nlp.variables[DEPTH_OF_TOUCH]
    c = (nlp.variables | nlp.parameters).get(COMPLIANCE)
    if c is None:
        return Rigid(d)
    return Soft(d, c, pushes.lam[:, rows], pushes.w[rows], 1.0)


def add_prior(nlp, indentation):
    """Add the priors of d and c, where these are unknown; report the indentation."""
    d = indentation.depth
    nlp.minimize("depth prior", lambda d: (d / DEPTH) ** 2 / 2, d, role="prior")
    if COMPLIANCE in nlp.variables:
        c = indentation.compliance
        name, sigma = f"{COMPLIANCE} prior", COMPLIANCE_SIGMA
        nlp.minimize(name, lambda c: (c / sigma) ** 2 / 2, c, role="prior")
    if isinstance(indentation, Soft):
        nlp.minimize("push prior", Soft.pushing, indentation, role="prior")
        nlp.report(INDENTATION, lambda inside: inside.delta(), indentation)
