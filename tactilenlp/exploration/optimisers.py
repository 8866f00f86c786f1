"""Maximise a score over bounded angles within a budget of evaluations."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import nlopt
import numpy as np

from ..common.validation import check_one_of, check_types, check_whole
from ..errors import OptionError, shortened, typed_call

SEARCHES = (
    "facing", "direct", "direct_l", "crs2", "isres", "mlsl", "bobyqa", "cem", "random",
)  # fmt: skip
MOST_EVALUATIONS = 1_000_000  # [1] actions or iterations of a search
LOCAL_SHARE = 0.35  # [-] of the budget that DIRECT leaves to a local search
LOCAL_STEP = 0.06  # [-] first step of a local search, relative to the angles' ranges
FIRST_LOCAL_STEP = 0.12  # [-] the same for the first search from a facing action
ANGLE_TOLERANCE = 3e-3  # [rad] at which a local search stops: the gain has kinks
WORST_GAIN = -1e3  # [nats] in place of NaN and infinity, which nlopt does not accept
POPULATION = 20  # [1] of CRS2 and ISRES: nlopt's default would use up the budget


@typed_call()
@dataclass(frozen=True)
class CrossEntropy:
    """The cross-entropy method, the paper's search.

    samples:    [1], actions drawn in each iteration
    best:       [1], of these the best, to which the Gaussian is fitted
    iterations: [1]
    """

    samples: int = 60
    best: int = 5
    iterations: int = 3

    def __post_init__(self) -> None:
        check_types(**{n: (v, (int, np.integer)) for n, v in vars(self).items()})
        fits = (
            1 < self.best <= self.samples <= MOST_EVALUATIONS
            and 1 <= self.iterations <= MOST_EVALUATIONS
        )
        if not fits:
            raise OptionError(
                "out of range",
                where="CrossEntropy",
                got=shortened(self),
                expected="1 < best <= samples and iterations >= 1, "
                f"at most {MOST_EVALUATIONS}",
            )


def check_search(search, budget) -> str:
    """Return the name of a search; OptionError for an unknown one or a bad budget."""
    check_types(search=(search, (str, CrossEntropy)))
    name = search if isinstance(search, str) else "cem"
    what, also = "no such search", "or a CrossEntropy"
    check_one_of("search", name, SEARCHES, what, unit=also)
    check_whole("budget", budget, 2, np.inf)
    return name


def maximise(objective: Objective, search, seed: int, rng) -> int:
    """Run a search until its budget is used; return the index of the chosen angles."""
    if search == "cem" or isinstance(search, CrossEntropy):
        return _cross_entropy(objective, search, rng)
    if search == "random":
        while objective.left:
            objective(objective.random(rng))
    else:
        _nlopt_search(objective, search, seed, rng)
    return int(np.argmax(objective.scores))


class Objective:
    """Evaluate the score of angles, count and keep every evaluation.

    The best evaluation is taken from here: nlopt returns others where it is stopped.
    """

    def __init__(self, score, lower, upper, budget) -> None:
        self.score, self.lower, self.upper, self.budget = score, lower, upper, budget
        self.tried: list[np.ndarray] = []
        self.scores: list[float] = []

    @property
    def left(self) -> int:
        """The number of evaluations that are left."""
        return self.budget - len(self.scores)

    def __call__(self, angles: np.ndarray) -> float:
        # nlopt passes the same buffer at every call, and BOBYQA leaves the bounds.
        angles = np.clip(np.array(angles, float), self.lower, self.upper)
        score = float(self.score(angles))
        score = score if np.isfinite(score) else WORST_GAIN
        self.tried.append(angles)
        self.scores.append(score)
        return score

    @property
    def middle(self) -> np.ndarray:
        """The angles in the middle of their bounds."""
        return (self.lower + self.upper) / 2

    def random(self, rng) -> np.ndarray:
        """Return angles drawn uniformly within the bounds."""
        return rng.uniform(self.lower, self.upper)

    @property
    def best(self) -> np.ndarray:
        """The angles of the highest score so far."""
        return self.tried[int(np.argmax(self.scores))]


def _nlopt_search(objective: Objective, name: str, seed: int, rng) -> None:
    """Search globally where the name says so, then locally."""
    n = len(objective.lower)
    if name in ("direct", "direct_l"):
        kind = nlopt.GN_DIRECT if name == "direct" else nlopt.GN_DIRECT_L
        spared = round(LOCAL_SHARE * objective.budget)
        _run(objective, nlopt.opt(kind, n), objective.middle, spared, seed)
    elif name in ("crs2", "isres"):
        optimiser = nlopt.opt(nlopt.GN_CRS2_LM if name == "crs2" else nlopt.GN_ISRES, n)
        # CRS2 refuses a population of fewer than n + 1.
        optimiser.set_population(max(n + 1, min(POPULATION, objective.budget - 1)))
        _run(objective, optimiser, objective.random(rng), 0, seed)
    elif name == "mlsl":
        optimiser = nlopt.opt(nlopt.G_MLSL_LDS, n)
        local = nlopt.opt(nlopt.LN_COBYLA, n)
        local.set_xtol_rel(1e-2)
        optimiser.set_local_optimizer(local)
        _run(objective, optimiser, objective.random(rng), 0, seed)
    _local_searches(objective, name, seed, rng)


def _local_searches(objective: Objective, name: str, seed: int, rng) -> None:
    """Search locally from the best angles so far, then from random ones (multistart).

    "facing" begins at all that were tried, best first: COBYLA moves fast from a start;
    Subplex, from the best of all, also moves along kinks, where COBYLA stalls.
    """
    starts = [objective.best] if objective.tried else [objective.middle]
    kind = nlopt.LN_BOBYQA if name == "bobyqa" else nlopt.LN_COBYLA
    searches = [(kind, LOCAL_STEP, 1e-3)]
    if name == "facing":
        order = np.argsort(objective.scores)[::-1]
        starts = [objective.tried[i] for i in order] or starts
        searches = [
            (nlopt.LN_COBYLA, FIRST_LOCAL_STEP, ANGLE_TOLERANCE),
            (nlopt.LN_SBPLX, LOCAL_STEP, ANGLE_TOLERANCE),
        ]
    while objective.left:
        start = starts.pop(0) if starts else objective.random(rng)
        for kind, step, tolerance in searches:
            _local_search(objective, kind, start, step, tolerance, seed)
            start = objective.best


def _local_search(objective: Objective, local, start, step: float, xtol: float, seed):
    """Search locally from a start until steps are below xtol [rad].

    step: of the first one, relative to the angles' ranges.  The start is evaluated
    where nlopt evaluates nothing.
    """
    before = len(objective.scores)
    optimiser = nlopt.opt(local, len(objective.lower))
    optimiser.set_initial_step(step * (objective.upper - objective.lower))
    optimiser.set_xtol_abs(xtol)
    _run(objective, optimiser, start, 0, seed)
    if objective.left and len(objective.scores) == before:
        objective(start)


def _run(objective: Objective, optimiser, start, spared: int, seed: int) -> None:
    """Run an optimiser of nlopt until `spared` evaluations of the budget are left."""
    end, failed = objective.budget - spared, []
    if len(objective.scores) >= end:  # nlopt must not be stopped before it evaluates
        return

    def score(angles, _gradient) -> float:
        if len(objective.scores) >= end:  # MLSL and ISRES overrun their maxeval
            raise nlopt.ForcedStop
        try:
            return objective(angles)
        except Exception as error:  # some algorithms of nlopt discard exceptions
            failed.append(error)
            raise nlopt.ForcedStop from error

    nlopt.srand(seed)  # nlopt's generator is global: seeded before every run
    optimiser.set_lower_bounds(objective.lower)
    optimiser.set_upper_bounds(objective.upper)
    optimiser.set_max_objective(score)
    optimiser.set_maxeval(max(1, end - len(objective.scores)))
    with suppress(nlopt.ForcedStop, nlopt.RoundoffLimited):  # evaluations are kept
        optimiser.optimize(np.clip(start, objective.lower, objective.upper))
    if failed:
        raise failed[0]


def _cross_entropy(objective: Objective, search, rng) -> int:
    """Fit a Gaussian to the best samples, repeatedly (cross-entropy method).

    Return the index of one of the best of the last iteration, drawn uniformly; of the
    best of all where each of these met an obstacle.
    """
    if search == "cem":
        iterations = max(1, min(CrossEntropy.iterations, objective.budget // 2))
        samples = max(2, objective.budget // iterations)
        search = CrossEntropy(samples, min(CrossEntropy.best, samples), iterations)
    mean = spread = None
    for _ in range(search.iterations):
        first = len(objective.scores)
        for _ in range(search.samples):
            if mean is None:
                angles = objective.random(rng)
            else:
                angles = rng.multivariate_normal(mean, spread)
            objective(angles)
        elite = first + np.argsort(objective.scores[first:])[::-1][: search.best]
        points = np.array(objective.tried)[elite]
        mean, spread = points.mean(axis=0), np.cov(points.T)
    scores = np.array(objective.scores)
    free = elite[scores[elite] > WORST_GAIN]
    return int(rng.choice(free) if len(free) else np.argmax(scores))
