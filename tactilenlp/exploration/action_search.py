"""Search the action space for the action that tells most (nlopt, cross-entropy)."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from formulations.shape import Shape

from ..common.interrupt import interruptible
from ..common.validation import check_numbers, check_types
from ..errors import OptionError
from .action_space import Action, Workspace
from .candidate_actions import combined, facing
from .expected_information import ExpectedInformation

SEARCHES = (
    "facing", "direct", "direct_l", "crs2", "isres", "mlsl", "bobyqa", "cem", "random",
)  # fmt: skip
STARTED = 0.3  # [-] of the budget for actions that face something, before DIRECT
FACED = 0.4  # [-] and of that of "facing", which polishes the best of them
POLISH = 0.35  # [-] of the budget that a global search leaves to a local one
WIDTH = 0.06  # [-] first step of a local search, of every angle's range
WIDE = 0.12  # [-] that of the first one from an action that faces something
CLOSE = 3e-3  # [rad] at which it leaves off: the gain has kinks, not one smooth top
WORST = -1e3  # [nats] of an action whose gain cannot be computed: nlopt bears no NaN
POPULATION = 20  # of CRS2 and ISRES in four dimensions; nlopt's own would use it all up


@dataclass(frozen=True)
class CrossEntropy:
    """The paper's search: iterations of `samples` actions, refitted to the `best`."""

    samples: int = 60
    best: int = 5
    iterations: int = 3

    def __post_init__(self) -> None:
        given = {name: (getattr(self, name), int) for name in vars(self)}
        check_types(**given)
        if not (1 < self.best <= self.samples and self.iterations >= 1):
            raise OptionError(
                "out of range",
                where="CrossEntropy",
                got=f"{self}",
                expected="1 < best <= samples and at least one iteration",
            )


@dataclass(frozen=True, eq=False)
class Choice:
    """The action chosen, and how.

    gain [nats] is expected of it; evaluations, CPU seconds of the search; history (n,)
    [nats] of all that was tried, in order, and tried (n, 2 F) [rad].
    """

    action: Action
    gain: float
    evaluations: int
    seconds: float
    search: str
    history: np.ndarray
    tried: np.ndarray


@interruptible()
def choose_action(
    estimate,
    workspace: Workspace | None = None,
    *,
    search: str | CrossEntropy = "facing",
    budget: int = 180,
    seed: int = 0,
    hypotheses: int = 3,
    slopes: str = "motion",
    shape: Shape | None = None,
) -> Choice:
    """Return the action with the largest expected information gain (eq:eig).

    search: "facing" (actions that face corners, edges and faces; from the best of them
    COBYLA, then Subplex), "direct" or "direct_l" (some that face, then dividing
    rectangles, then COBYLA), "crs2", "isres", "mlsl", "bobyqa", "cem" or a
    CrossEntropy (the paper's: the action is drawn from the last best ones), "random";
    budget: evaluations of the gain; equal seeds give equal choices.  hypotheses,
    slopes, shape: see ExpectedInformation.
    """
    began = time.process_time()
    expected = ExpectedInformation(estimate, workspace, hypotheses, slopes, shape)
    space = expected.workspace
    return best_action(
        lambda angles: expected.gain(space.action(angles)),
        space, search=search, budget=budget, seed=seed, began=began,
        facing=facing(estimate, space),
    )  # fmt: skip


def best_action(
    score: Callable,
    space: Workspace,
    *,
    search: str | CrossEntropy = "facing",
    budget: int = 180,
    seed: int = 0,
    began: float | None = None,
    facing: list[np.ndarray] | None = None,
) -> Choice:
    """Return the action whose angles (2 F,) score most; NaN and infinity are worst.

    facing: for each finger, angles (n, 2) worth trying, by "facing" and "direct".
    """
    began = time.process_time() if began is None else began
    name = check_search(search, budget)
    check_types(seed=(seed, (int, np.integer)))
    check_numbers("", "a whole number from 0", seed=(seed, -1, 2**32 - 1))
    trial = _Trial(score, space.lower, space.upper, budget)
    rng = np.random.default_rng(seed)
    if name == "cem":
        best = _cross_entropy(trial, search, rng)
    else:
        if name == "random":
            while trial.left:
                trial(rng.uniform(trial.lower, trial.upper))
        else:
            shares = {"facing": FACED, "direct": STARTED, "direct_l": STARTED}
            if facing and name in shares:
                for angles in combined(facing, round(shares[name] * budget), rng):
                    trial(angles)
            _nlopt_search(trial, name, seed, rng)
        best = int(np.argmax(trial.scores))
    return Choice(
        action=space.action(trial.tried[best]),
        gain=trial.scores[best],
        evaluations=len(trial.scores),
        seconds=time.process_time() - began,
        search=name,
        history=np.array(trial.scores),
        tried=np.array(trial.tried),
    )


def check_search(search, budget) -> str:
    """Return the name of a search; OptionError where it or its budget is none."""
    check_types(search=(search, (str, CrossEntropy)))
    name = search if isinstance(search, str) else "cem"
    if name not in SEARCHES:
        expected = f"one of {SEARCHES} or a CrossEntropy"
        raise OptionError("no such search", where="search", got=name, expected=expected)
    if not (isinstance(budget, (int, np.integer)) and budget >= 2):
        expected = "an integer >= 2"
        raise OptionError("too few", where="budget", got=budget, expected=expected)
    return name


class _Trial:
    """Score angles, count, and keep every one: nlopt's own best is not trusted."""

    def __init__(self, score, lower, upper, budget) -> None:
        self.score, self.lower, self.upper, self.budget = score, lower, upper, budget
        self.tried: list[np.ndarray] = []
        self.scores: list[float] = []

    @property
    def left(self) -> int:
        return self.budget - len(self.scores)

    def __call__(self, angles: np.ndarray) -> float:
        # nlopt passes one and the same buffer every time, and BOBYQA leaves bounds.
        angles = np.clip(np.array(angles, float), self.lower, self.upper)
        score = float(self.score(angles))
        score = score if np.isfinite(score) else WORST
        self.tried.append(angles)
        self.scores.append(score)
        return score

    @property
    def best(self) -> np.ndarray:
        return self.tried[int(np.argmax(self.scores))]


def _nlopt_search(trial: _Trial, name: str, seed: int, rng) -> None:
    """Search globally, then polish from the best; or locally from several starts."""
    import nlopt

    n = len(trial.lower)
    if name in ("direct", "direct_l"):
        kind = nlopt.GN_DIRECT if name == "direct" else nlopt.GN_DIRECT_L
        middle = (trial.lower + trial.upper) / 2
        _run(trial, nlopt.opt(kind, n), middle, round(POLISH * trial.budget), seed)
    elif name in ("crs2", "isres"):
        optimiser = nlopt.opt(nlopt.GN_CRS2_LM if name == "crs2" else nlopt.GN_ISRES, n)
        # CRS2 refuses a population of fewer than n + 1.
        optimiser.set_population(max(n + 1, min(POPULATION, trial.budget - 1)))
        _run(trial, optimiser, rng.uniform(trial.lower, trial.upper), 0, seed)
    elif name == "mlsl":
        optimiser = nlopt.opt(nlopt.G_MLSL_LDS, n)
        local = nlopt.opt(nlopt.LN_COBYLA, n)
        local.set_xtol_rel(1e-2)
        optimiser.set_local_optimizer(local)
        _run(trial, optimiser, rng.uniform(trial.lower, trial.upper), 0, seed)
    elif name == "facing":
        return _polish_in_turn(trial, seed, rng)
    local = nlopt.LN_BOBYQA if name == "bobyqa" else nlopt.LN_COBYLA
    start = trial.best if trial.tried else (trial.lower + trial.upper) / 2
    while trial.left:  # from the best, then from anywhere
        _polish(trial, local, start, WIDTH, 1e-3, seed)
        start = rng.uniform(trial.lower, trial.upper)


def _polish_in_turn(trial: _Trial, seed: int, rng) -> None:
    """Search locally from what was tried, best first; each time on from the very best.

    COBYLA leaves a start fast; Subplex, on subspaces, gets along kinks where it stalls.
    """
    import nlopt

    order = np.argsort(trial.scores)[::-1]
    starts = [trial.tried[i] for i in order] or [(trial.lower + trial.upper) / 2]
    while trial.left:
        start = starts.pop(0) if starts else rng.uniform(trial.lower, trial.upper)
        _polish(trial, nlopt.LN_COBYLA, start, WIDE, CLOSE, seed)
        _polish(trial, nlopt.LN_SBPLX, trial.best, WIDTH, CLOSE, seed)


def _polish(trial: _Trial, local, start, width: float, close: float, seed) -> None:
    """Search locally from a start until steps are close [rad]; try once at least."""
    import nlopt

    before = len(trial.scores)
    optimiser = nlopt.opt(local, len(trial.lower))
    optimiser.set_initial_step(width * (trial.upper - trial.lower))
    optimiser.set_xtol_abs(close)
    _run(trial, optimiser, start, 0, seed)
    if trial.left and len(trial.scores) == before:
        trial(start)


def _run(trial: _Trial, optimiser, start: np.ndarray, spared: int, seed: int) -> None:
    """Let nlopt try until `spared` evaluations of the budget are left."""
    import nlopt

    end, failed = trial.budget - spared, []
    if len(trial.scores) >= end:  # nlopt bears no stop before its first evaluation
        return

    def objective(angles, _gradient) -> float:
        if len(trial.scores) >= end:  # MLSL and ISRES overrun their maxeval
            raise nlopt.ForcedStop
        try:
            return trial(angles)
        except Exception as error:  # some of nlopt's searches would swallow it
            failed.append(error)
            raise nlopt.ForcedStop from error

    nlopt.srand(seed)  # global state: before every run
    optimiser.set_lower_bounds(trial.lower)
    optimiser.set_upper_bounds(trial.upper)
    optimiser.set_max_objective(objective)
    optimiser.set_maxeval(max(1, end - len(trial.scores)))
    with suppress(nlopt.ForcedStop, nlopt.RoundoffLimited):  # what was tried is kept
        optimiser.optimize(np.clip(start, trial.lower, trial.upper))
    if failed:
        raise failed[0]


def _cross_entropy(trial: _Trial, search, rng) -> int:
    """Refit a Gaussian to the best few; return one of the last best, drawn evenly."""
    if search == "cem":
        samples = max(2, trial.budget // CrossEntropy.iterations)
        best = min(CrossEntropy.best, samples)
        search = CrossEntropy(samples, best, CrossEntropy.iterations)
    mean = spread = None
    for _ in range(search.iterations):
        first = len(trial.scores)
        for _ in range(search.samples):
            if mean is None:
                angles = rng.uniform(trial.lower, trial.upper)
            else:
                angles = rng.multivariate_normal(mean, spread)
            trial(angles)
        elite = first + np.argsort(trial.scores[first:])[::-1][: search.best]
        points = np.array(trial.tried)[elite]
        mean, spread = points.mean(axis=0), np.cov(points.T)
    return int(rng.choice(elite))
