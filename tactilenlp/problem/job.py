"""A job: measurements, scene, shape and page of a search and of its local solves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from formulations.implicit import noting_roots
from formulations.page_contract import PageContract, contract_of
from formulations.sensing import heavy_tailed
from formulations.shape import Shape

from ..common.deadline import Deadline
from ..data.contact_segments import samples_until
from ..data.measurements import Measurements
from ..data.scene import Scene
from ..data.sensor_noise import Precision, latency_cost, with_sensors_earlier
from ..nlp.problem import Problem
from ..nlp.term_functions import TermFunctionCache, default_cache
from .hypothesis import Hypothesis
from .options import Options
from .polytope_window import polytope_window, with_supports, without_clear
from .reductions import (
    Reductions,
    required_reductions,
    window_of_samples,
)
from .window import Window


@dataclass(frozen=True, eq=False)
class SearchSettings:
    """How a job is searched.

    guess: a user's, of one sample, of the body at the first touch; drawn: factor of the
    number of bodies drawn there, or of a polytope's paths that are continued;
    process_noise: of its deviations; may_be_carried: whether the body may be, by hand,
    between two actions; hypothesis: one of all samples that is solved instead of a
    search.
    """

    guess: Hypothesis | None = None
    drawn: int = 1
    process_noise: float = 1.0
    may_be_carried: bool = True
    hypothesis: Hypothesis | None = None


@dataclass(frozen=True, eq=False)
class Job:
    """What a solve needs to know, picklable: measurements and how to read them.

    page: a module with `build` and `LEVELS`; options: the caller's; deadline: by which
    it is to end; functions: the caller's store of term functions by page and motion,
    filled by the solves; cuts: samples within rest intervals that need a pose of their
    own; search: what only a search reads; recorded: the data before a latency, if any.

    Pickled, it has no page: other processes search, and solve pages of their own.  Nor
    has it functions: these stay in the process that derived them.
    """

    data: Measurements
    scene: Scene
    shape: Shape
    precision: Precision
    reductions: Reductions
    page: ModuleType | None
    options: Options
    deadline: Deadline
    functions: dict
    cuts: tuple[int, ...] = ()
    search: SearchSettings = SearchSettings()
    recorded: Measurements | None = None

    def __getstate__(self) -> dict:
        return {**vars(self), "page": None, "functions": {}}

    @property
    def contract(self) -> PageContract:
        """What the page states of itself."""
        return contract_of(self.page)

    def with_search(self, **settings) -> Job:
        """Return the job with other settings of the search, by name."""
        return replace(self, search=replace(self.search, **settings))

    def with_reductions(self, **made: bool) -> Job:
        """Return the job with other values of some reductions, by name."""
        return replace(self, reductions=replace(self.reductions, **made))

    def fixes(self, name: str) -> bool:
        """Tell whether something unknown is assumed, and the page may free it.

        name: of the assumption, one of those that a page may name in FREED.
        """
        scene = self.scene
        made = required_reductions(self.page, self.reductions)
        assumed = {
            "rigid": made.rigid and scene.compliance is None,
            "central": made.central and scene.sigma_centre > 0,
            "aligned": made.aligned,
            "planar": made.planar and scene.ground is not None,
            "level": not scene.tilt_is_known,
            "prompt": scene.latency is None,
        }
        return assumed[name] and name in self.contract.freed

    def of_data(self, change) -> Job:
        """Return the job of other data: change(Measurements) of these."""
        recorded = None if self.recorded is None else change(self.recorded)
        return replace(self, data=change(self.data), recorded=recorded)

    def as_found(self, other: Job) -> Job:
        """Return the job on the ground, and with the lags, of another one.

        Of a polytope with its fingertips, soft or rigid, too: the searches of other
        shapes have a tolerance for both.
        """
        job = self.on_ground(other.scene.ground).as_late_as(other.precision)
        if not job.shape.of_vertices:
            return job
        return job.with_reductions(rigid=other.reductions.rigid)

    def on_ground(self, ground) -> Job:
        """Return the job with its data in the frame of another Ground."""
        old = self.scene.ground
        if ground is old:
            return self
        R = ground.rotation @ old.rotation.T
        t = ground.rotation @ old.origin + ground.translation
        job = self.of_data(lambda data: data.transformed(R, t))
        return replace(job, scene=replace(self.scene, ground=ground))

    def as_late_as(self, sensors: Precision) -> Job:
        """Return the job with the lags of other sensors, its data earlier by these."""
        own = self.precision
        late = replace(sensors, position=own.position, normal=own.normal,
                       normal_error=own.normal_error)  # fmt: skip
        recorded = self.data if self.recorded is None else self.recorded
        data = with_sensors_earlier(recorded, sensors)
        recorded = None if data is recorded else recorded
        return replace(self, data=data, recorded=recorded, precision=late)

    @property
    def prior_cost(self) -> float:
        """The priors of what was estimated before a solve: tilt, lags [nats]."""
        return prior_cost_of(self.scene, self.precision)

    def window(self, guess=None, resting=None) -> Window:
        """Return the window that the page reads.

        guess: theta and x, where a page starts.  Of a polytope whose vertices it gives,
        resting is the theta as which it carries its weight where it rests, by default
        that of the guess.
        """
        shape, of_vertices = self.shape, self.shape.of_vertices and guess is not None
        if of_vertices:
            vertices, x = np.reshape(guess[0], (-1, 3)), guess[1]
            shape = with_supports(shape, vertices)
        window = window_of_samples(
            self.data, self.scene, shape, self.precision, self.reductions, guess,
            self.cuts,
        )  # fmt: skip
        if not of_vertices:
            return window
        if self.reductions.far:
            window = without_clear(window, vertices, x)
        resting = vertices if resting is None else np.reshape(resting, (-1, 3))
        ground = self.scene.ground is not None
        return polytope_window(window, vertices, x, ground, resting)

    def window_until(self, samples: int) -> Window:
        """Return the window of the first samples' actions, no rest interval cut."""
        known = samples_until(self.data, samples), self.scene, self.shape
        return window_of_samples(*known, self.precision, self.reductions)

    def build(self, window, scene=None, fill=None, solved=True, only=None) -> Problem:
        """Return the problem that the page poses of a window.

        scene: another one; fill: the `build` of a page with the same terms; solved:
        False of what is only evaluated, which needs no derivatives; only: the names of
        the terms that it has, by default all.

        Problems of this scene share term functions where these depend on page, shape,
        scene and motion, not on what else a window holds: a page states so by ALIKE.
        """
        scene, shared = self.scene if scene is None else scene, {}
        cache = default_cache() if solved else TermFunctionCache(derive=False)
        if scene is self.scene and self.contract.alike and solved:
            key = (
                *(self.page, window.motion, window.frictionless),
                *(window.compliant, window.central, window.aligned),
            )
            shared = self.functions.setdefault(key, {})
        problem = Problem(
            functions_by_name=shared, cache=cache, deadline=self.deadline,
            noting=noting_roots, only=only,
        )  # fmt: skip
        (fill or self.page.build)(problem, window, scene, window.shape)
        return problem


def prior_cost_of(scene: Scene, sensors: Precision) -> float:
    """Return the priors of a tilt of the ground and of lags that were estimated [nats].

    The tilt is against the ground that was told.
    """
    late = latency_cost(scene, sensors)
    if scene.tilt_is_known or scene.ground.told is None:
        return late
    tilt = np.sum((scene.ground.tilt / scene.sigma_tilt) ** 2)
    return late + float(heavy_tailed(tilt, 2))
