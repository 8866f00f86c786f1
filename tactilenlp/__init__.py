"""Find where an unknown rigid object is, and what shape it has, from touch alone.

from tactilenlp import Measurements, Scene, solve_estimate

data = Measurements.load("scene.npz")
estimate = solve_estimate(data, Scene.load("scene.npz"))
print(estimate.summary())
"""

from __future__ import annotations

from importlib import import_module

# Public name -> where it lives; loaded when first used, so that importing stays light.
_HOMES = {
    "Measurements": "measurements",
    "Scene": "scene",
    "Ground": "scene",
    "JointZeros": "joint_zeros",
    "Options": "options",
    "Reductions": "reduce",
    "Guess": "guess",
    "Estimate": "result",
    "Information": "information",
    "observed_information": "observed",
    "assumption_sensitivity": "observed",
    "solve_estimate": "estimate",
    "Action": "workspace",
    "Workspace": "workspace",
    "Trajectory": "workspace",
    "ExpectedInformation": "expected",
    "expected_information_gain": "expected",
    "information_gain": "nats",
    "choose_action": "choose",
    "Choice": "choose",
    "CrossEntropy": "choose",
    "explore": "exploration",
    "Step": "diary",
    "Exploration": "diary",
    "Plan": "policies",
    "World": "simulate",
    "Trajectories": "trajectories",
    "Body": "body",
    "identify_body": "identify",
    "export_shape": "export",
    "write_report": "report",
    "Noise": "noise",
    "face_sigma": "surface",
    "SupportingPlanes": "surface",
    "vertex_information": "hull_information",
    "surface_distance": "metrics",
    "cuboid_errors": "metrics",
    "plot_estimate": "plotting",
    "plot_scene": "plotting",
    "plot_top": "plotting",
    "plot_information": "plotting",
    "plot_impulses": "curves",
    "plot_cones": "curves",
    "plot_costs": "curves",
    "plot_progress": "curves",
    "plot_errors": "curves",
    "animate": "animation",
    "plot_gain": "maps",
    "Problem": "nlp",
    "SolverOptions": "solve",
    "Solution": "solve",
    "TactileError": "errors",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module 'tactilenlp' has no attribute {name!r}")
    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value  # found at once from now on
    return value


def __dir__() -> list[str]:
    return __all__
