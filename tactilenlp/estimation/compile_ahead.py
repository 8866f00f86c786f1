"""Compile ahead what estimates use: by an estimate of the recording that is shipped."""

from __future__ import annotations

import logging

from ..data.examples import example_recording
from ..data.measurements import Measurements
from ..data.scene import Scene
from ..interface.request import read_request
from ..interface.result import Estimate
from ..interface.session import PROCESS
from ..local.local_solve import built_page, in_motion_of
from ..problem.pages import shape_of
from .solver import solve_estimate

log = logging.getLogger("tactilenlp")
LARGER_MODELS = ("rigid", "aligned", "central", "planar")  # reductions given up in turn


def compile_ahead(shape: str) -> Estimate:
    """Return the estimate of the shipped recording of a class, "cuboid" or "polytope".

    The functions that it used are compiled then, and those of larger models, whose
    problems are assembled: that waits for the compilers.
    """
    file = example_recording(shape)
    data, scene = Measurements.load(file), Scene.load(file)
    estimate = solve_estimate(data, scene, shape=shape)
    job = read_request(data, scene, shape_of(shape), session=PROCESS)[0].job
    for name in LARGER_MODELS:
        larger = job.with_reductions(**{name: False})
        problem = built_page(larger, in_motion_of(larger, estimate.origin)).problem
        log.info("without %r: %d functions", name, len(problem.assembly.functions))
    return estimate
