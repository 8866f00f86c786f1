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
    "Measurements": "data.measurements",
    "Scene": "data.scene",
    "Ground": "data.scene",
    "JointZeros": "data.joint_offsets",
    "Options": "problem.options",
    "Session": "interface.session",
    "Reductions": "problem.reductions",
    "Guess": "interface.session",
    "Estimate": "interface.result",
    "Information": "information.information",
    "observed_information": "estimation.observed_information",
    "assumption_sensitivity": "estimation.observed_information",
    "solve_estimate": "estimation.solver",
    "Shape": "shapes",
    "ShapeReport": "shapes",
    "CUBOID": "shapes",
    "CYLINDER": "shapes",
    "ELLIPSOID": "shapes",
    "prism": "shapes",
    "polytope": "shapes",
    "gradient_normal": "shapes",
    "log_size_prior": "shapes",
    "Action": "exploration.action_space",
    "Workspace": "exploration.action_space",
    "Trajectory": "exploration.action_space",
    "ExpectedInformation": "exploration.expected_information",
    "expected_information_gain": "exploration.expected_information",
    "information_gain": "information.comparisons",
    "choose_action": "exploration.action_search",
    "Choice": "exploration.action_search",
    "CrossEntropy": "exploration.optimisers",
    "explore": "exploration.loop",
    "ExploreOptions": "exploration.options",
    "Step": "exploration.log",
    "Exploration": "exploration.log",
    "Plan": "exploration.policies",
    "World": "simulation.world",
    "TouchedWorld": "exploration.sweep",
    "TrueBody": "evaluation.metrics",
    "Trajectories": "data.trajectories",
    "Body": "identification.body",
    "identify_body": "identification.identify",
    "export_shape": "output.export",
    "write_report": "output.html_report",
    "Noise": "data.noise_model",
    "face_sigma": "geometry.faces",
    "SupportingPlanes": "geometry.faces",
    "vertex_information": "information.information",
    "surface_distance": "evaluation.metrics",
    "cuboid_errors": "evaluation.metrics",
    "plot_estimate": "plotting.scene",
    "plot_scene": "plotting.scene",
    "plot_top": "plotting.scene",
    "plot_information": "plotting.scene",
    "plot_impulses": "plotting.charts",
    "plot_cones": "plotting.charts",
    "plot_costs": "plotting.charts",
    "plot_progress": "plotting.charts",
    "plot_errors": "plotting.charts",
    "animate": "plotting.animation",
    "plot_gain": "plotting.gain_map",
    "Problem": "nlp.problem",
    "problem_of": "estimation.observed_information",
    "extend": "problem.pages",
    "Page": "problem.pages",
    "Executor": "search.least_motion",
    "solve": "solvers.solve",
    "SolverOptions": "solvers.options",
    "Solution": "solvers.solution",
    "TactileError": "errors",
    "example_recording": "data.examples",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str):
    if name == "__version__":
        from importlib.metadata import version

        return version("tactilenlp")
    if name not in _HOMES:
        raise AttributeError(f"module 'tactilenlp' has no attribute {name!r}")
    value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value  # found at once from now on
    return value


def __dir__() -> list[str]:
    return __all__
