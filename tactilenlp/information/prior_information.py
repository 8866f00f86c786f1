"""The information about a body of which only the prior is known.

A solve that the time limit ended has no optimum to linearise at, or no time for it.
Its sigma is that of the prior, so that nothing is claimed that was not computed.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from .error_budget import ANY_ROTATION, REACHED
from .finger_offsets import NAME, prior_of_offsets
from .information import Information
from .mixture import one_mode
from .polytope_information import maps_of_vertices, names_of_vertices
from .tangent_space import tangent_space_of

NOT_COMPUTED = "anything (no time to compute sigma: it is that of the prior)"


def prior_information(job, solved, R_wg) -> Information:
    """Return the information by the prior alone about what was solved, world frame.

    R_wg (3, 3): from the ground's frame, in which the problem is written.
    """
    problem, solution, shape = solved.problem, solved.solution, job.shape
    if shape.parameters == "vertices":
        names, turning = names_of_vertices(solution.values["theta"].shape[1]), 0
        maps, sizes = maps_of_vertices(solution.values["theta"].T, R_wg), len(names)
    else:
        tangent = tangent_space_of(problem, solution, solved.window, shape, R_wg)
        names, turning, maps = tangent.names, tangent.turning, tangent.maps
        sizes = shape.theta
    deviation = np.full(len(names), REACHED)
    deviation[:sizes] = shape.size_prior[1]
    deviation[len(names) - turning :] = ANY_ROTATION
    spread = np.diag(deviation**2)
    if shape.parameters == "vertices":  # all of them may be elsewhere together
        along = np.tile(np.eye(3), (len(names) // 3, 1))
        spread += REACHED**2 * along @ along.T
    matrix = np.linalg.inv(spread)
    offsets = {}
    if NAME in problem.variables:
        prior = prior_of_offsets(job.scene, solution.values[NAME].shape[1])
        both = block_diag(matrix, prior)
        offsets = {"offsets": np.linalg.inv(prior), "with_offsets": both}
    return Information(
        names=names, matrix=matrix, spread=spread, parts={}, roles={},
        modes=one_mode(solution.objective, spread), maps=maps,
        unobserved=(NOT_COMPUTED,), directions=np.zeros((len(names), 0)), fixed=(),
        active={}, ambiguous={}, indefinite=(), **offsets,
    )  # fmt: skip
