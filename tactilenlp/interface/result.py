"""`Estimate`: shape, poses and impulses by name, without the symbols of a solver."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import ClassVar

import numpy as np

from formulations.names import CENTRE_OF_MASS, COMPLIANCE, FINGER_TURN
from formulations.rigid_body import G

from ..common.brief import printed, same_content
from ..common.layout import ANY
from ..common.named import Named
from ..common.npz import read_result, write_result
from ..common.validation import check_sample
from ..data.ground import frame_of
from ..data.joint_offsets import JointZeros
from ..data.measurements import Measurements
from ..data.scene import Ground, Scene
from ..data.sensor_noise import (
    Precision,
    shift_in_time,
    shift_rotations,
    with_sensors_earlier,
)
from ..errors import TactileError
from ..geometry.faces import SupportingPlanes, has_sides, is_hull, supporting_planes
from ..geometry.transforms import rotate_back, rotation_of
from ..information.goodness_of_fit import Fit, Misfit, TouchMisfit
from ..information.information import Information
from ..information.mixture import ClassOdds, Modes
from ..output.summary import remarks_of, summary_of
from ..problem.fingertips import as_spheres
from ..problem.hypothesis import Hypothesis
from ..problem.skipped import Skipped
from ..solvers.solution import Solution

ESTIMATE_FORMAT, ESTIMATE_VERSION = "estimate", 2  # of the files that `save` writes
# Fields that are asked by name, as in estimate.impulses["finger 0"].
BY_NAME = ("impulses", "unknowns", "costs", "violations", "multipliers", "seconds")


@printed
@dataclass(frozen=True, eq=False)
class Estimate:
    """Shape, poses and impulses that explain T samples of F fingers.

    theta:         (n,) [m], sizes, or vertices one after another, as the page has them
    position:      (T, 3) [m], of the body's origin, world frame
    quaternion:    (T, 4) wxyz, body to world
    body_vertices: (V, 3) [m], body frame
    impulses:      (T, 3) [N s] by contact, on the object over (t-1, t], world frame
    unknowns:      (rows, columns) [SI] by the page's names; so are bound_multipliers
    costs:         [nats] by name, sum `objective`; of physics 0 where its law holds
    violations:    the largest of each constraint, dimensionless; multipliers: by name
    success, status, iterations, evaluations, progress, solver, stationarity,
    complementarity: of the solve, as in Solution
    seconds:       [s] of CPU time by step; "compile": of waiting for compilers
    skipped:       reductions made, with checks; faces: how many samples touched each
    information:   about shape, final pose and trajectory
    hypotheses:    for the next action, best first; origin: what it was solved from
    finger_offset: (F, 3) [m], true less measured, world; None: no Scene.sigma_offset
    fit:           how well the model explains the data; None: a page without touch term
    classes:       the odds of those that were compared, best first

    Axes of a cuboid at the first sample: z is nearest the vertical, x within 90 degrees
    of the world's (a tilted ground's) and not shorter than y; updates keep their names.
    """

    measurements: Measurements
    scene: Scene
    shape: str
    formulation: str
    options: dict
    theta: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    body_vertices: np.ndarray
    impulses: dict[str, np.ndarray]
    unknowns: dict[str, np.ndarray]
    costs: dict[str, float]
    violations: dict[str, float]
    multipliers: dict[str, np.ndarray]
    bound_multipliers: dict[str, np.ndarray]
    objective: float
    success: bool
    status: str
    iterations: int
    iterations_by_level: tuple[int, ...]
    evaluations: int
    seconds: dict[str, float]
    skipped: tuple[Skipped, ...]
    faces: np.ndarray
    information: Information
    precision: dict[str, float]
    reductions: dict[str, bool]
    cuts: tuple[int, ...]
    origin: Hypothesis
    hypotheses: tuple[Hypothesis, ...]
    versions: dict[str, str]
    progress: dict[str, np.ndarray] = field(default_factory=dict)
    finger_offset: np.ndarray | None = None
    fit: Fit | None = None
    classes: tuple[ClassOdds, ...] = ()
    solver: str = ""
    stationarity: float = np.nan
    complementarity: float = np.nan

    LAYOUT: ClassVar = {  # of the arrays in a file
        "measurements/time": ("T",), "measurements/finger_radius": ("F",),
        "theta": ("n",), "position": ("T", 3), "quaternion": ("T", 4),
        "body_vertices": ("V", 3),
        "impulses/*": ("T", 3),
        "unknowns/*": (ANY, ANY),
        "multipliers/*": (...,),
        "bound_multipliers/*": (...,),
        "progress/*": ("iterations",),
        "faces": (ANY, ...),
        "finger_offset": ("F", 3),
        "origin/x": (ANY, "T"),
        "information/path": ("T", 6),
        "information/maps/vertices": ("3 V", ANY),
    }  # fmt: skip
    FINITE: ClassVar = ("theta", "position", "quaternion", "body_vertices")
    UNIT: ClassVar = ("quaternion",)
    SOLID: ClassVar = ("body_vertices",)

    def __post_init__(self) -> None:
        for name in BY_NAME:
            values = Named(f"estimate.{name}", getattr(self, name))
            object.__setattr__(self, name, values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Estimate) and same_content(self, other)

    def __hash__(self) -> int:
        return hash((self.shape, self.formulation, self.measurements.samples))

    @property
    def side_lengths(self) -> np.ndarray:
        """Full side lengths (3,) [m] of a box, along its body axes."""
        if not has_sides(self):
            raise TactileError(
                "only a cuboid has side lengths", where="side_lengths",
                got=self.shape, next="read estimate.vertices",
            )  # fmt: skip
        return self.theta.copy()

    @property
    def vertices(self) -> np.ndarray:
        """Vertices (V, 3) [m], body frame."""
        return self.body_vertices.copy()

    @property
    def seen_positions(self) -> np.ndarray:
        """Finger positions (T, F, 3) [m], world frame: measured, plus offset."""
        said, joints = self.measurements.finger_position, self.scene.sigma_offset
        if self.finger_offset is None:
            return said
        if isinstance(joints, JointZeros):
            return said + joints.displacement(said, self.finger_offset)
        return said + self.finger_offset

    def contacts(self) -> tuple[np.ndarray, np.ndarray]:
        """Points [m], normals of contacts when felt, (T, F, 3), body frame, or NaN."""
        data, late = self.measurements, self.latency
        seen = replace(data, finger_position=self.seen_positions)
        seen = with_sensors_earlier(seen, self.sensors)
        if (turns := self.finger_turn) is not None:
            seen = replace(seen, normal=rotate_back(seen.normal, turns))
        spheres = as_spheres(seen, self.scene)
        n_w = np.where(data.contact[..., None], seen.normal, np.nan)
        p_w = spheres.finger_position - data.finger_radius[:, None] * n_w
        R_wo = rotation_of(shift_rotations(data, self.quaternion, -late)).as_matrix()
        arms = p_w - shift_in_time(data, self.position, -late)[:, None]
        return arms @ R_wo, n_w @ R_wo

    @property
    def compliance(self) -> float | None:
        """Estimated compliance of the fingertips [m/N]; None where it is no unknown."""
        if COMPLIANCE not in self.unknowns:
            return None
        return float(self.unknowns[COMPLIANCE].item()) / (self.scene.mass * G)

    @property
    def sensors(self) -> Precision:
        """The noise and latency of the sensors, as told or estimated."""
        return Precision(**self.precision)

    @property
    def latency(self) -> float:
        """By how much contacts and normals are later than positions [s].

        As told or estimated; 0 where the data do not ask for it.
        """
        return self.sensors.latency

    @property
    def finger_turn(self) -> np.ndarray | None:
        """Rotation vectors (F, 3) [rad] of the fingers' normals, world frame; or None.

        By which every measured normal is turned; None where sensors are aligned.
        """
        if FINGER_TURN not in self.unknowns:
            return None
        return self._from_ground(self.unknowns[FINGER_TURN].T)

    @property
    def centre_of_mass(self) -> np.ndarray:
        """Offset (3,) [m] from the centroid, body frame; zero where that is fixed."""
        offset = self.unknowns.get(CENTRE_OF_MASS, np.zeros(3)).ravel()
        # The axes of a polytope are the ground's in the page, the world's here.
        return self._from_ground(offset) if is_hull(self) else offset

    def _from_ground(self, vectors) -> np.ndarray:
        """Return vectors (..., 3) of the ground's frame in the world's."""
        return vectors @ frame_of(self.scene.ground).rotation

    @property
    def sigma_position(self) -> np.ndarray:
        """Standard deviations (T, 3) [m] of the position at every sample."""
        return self.information.along_path("position")

    @property
    def sigma_yaw(self) -> np.ndarray:
        """Standard deviations (T,) [rad] of the turn about the world's z axis."""
        return self.information.along_path("rotation")[:, 2]

    def rotation(self, sample: int = -1) -> np.ndarray:
        """Return the rotation matrix (3, 3) from body to world at a sample."""
        check_sample(sample, len(self.quaternion))
        return rotation_of(self.quaternion[sample]).as_matrix()

    def mesh(self, sample: int = -1):
        """Return the shape at a sample as a trimesh.Trimesh, world frame [m]."""
        import trimesh

        points = self.vertices @ self.rotation(sample).T + self.position[sample]
        return trimesh.convex.convex_hull(points)

    def supporting_planes(self) -> SupportingPlanes:
        """Return the planes of all faces, touched or not; sigma of each offset."""
        return supporting_planes(self)

    def summary(self) -> str:
        """Return a paragraph in words: size, pose, sigma, solve, what was left out."""
        return summary_of(self)

    @property
    def remarks(self) -> list[str]:
        """Sentences on classes, fit, nuisance parameters, what is not observed."""
        return remarks_of(self)

    def save(self, path) -> None:
        """Write one .npz: plain arrays and a JSON header, readable by NumPy alone."""
        write_result(path, ESTIMATE_FORMAT, ESTIMATE_VERSION, self, ESTIMATE_CLASSES)

    def report(self, path) -> None:
        """Write one HTML page with a scene to turn and a time slider; works offline."""
        from ..output.html_report import write_report

        write_report(self, path)

    def export(self, path) -> None:
        """Write the shape, body frame [m]: .stl .obj .ply .glb .xml (MJCF) .urdf."""
        from ..output.export import export_shape

        export_shape(self, path)

    @classmethod
    def load(cls, path) -> Estimate:
        """Read what `save` wrote, to the last digit; FileError of anything else."""
        return read_result(
            path, ESTIMATE_FORMAT, ESTIMATE_VERSION, ESTIMATE_CLASSES, cls
        )


OF_SOLVE = tuple(f.name for f in fields(Solution) if f.name in Estimate.__annotations__)


def solution_of(estimate: Estimate, page) -> Solution:
    """Return the solution of a page that an estimate was read from."""
    solved = {name: getattr(estimate, name) for name in OF_SOLVE}
    values, last = estimate.unknowns, page.LEVELS[-1]
    held = {name: np.ones(values[name].shape, bool) for name in last.fixed}
    return Solution(values=values, parameters=last.parameters, held=held, **solved)


ESTIMATE_CLASSES = {  # what a file of an estimate is made of
    kind.__name__: kind
    for kind in (
        *(Estimate, Skipped, Information, Modes, Measurements),
        *(Scene, Ground, JointZeros, Hypothesis),
        *(Fit, Misfit, TouchMisfit, ClassOdds),
    )
}
