"""Search the last action alone, the past a Gaussian; then solve all actions, warm.

Least motion leads every guess to one path, and often to the wrong one; physics keeps
them apart.  With the past as a Gaussian, physics costs as little as least motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations import quasi_static

from .extend import WEAK, continuations
from .hypothesis import Hypothesis, Job, distinct, same
from .past import Past, remember
from .trial import ROUGH, opened, page_named, posed, resumed, spread, tried

BATCH = 4  # guesses solved before it is asked whether they agree
MOST = 12  # guesses of an action that are solved
AGREE = 3  # guesses that lead to the best path say that there is no better one
EQUAL = 0.5  # [nats] objectives this close are equal
BEHIND = 30.0  # [nats] of physics behind the best: dropped
CLOSE = 3.0  # [nats] what a Gaussian of the past may be wrong by
FEW, WIDE = 4, 10.0  # so few actions leave sizes open: [nats] it may be wrong by more
SETTLED = 4  # hypotheses that are solved for all actions


@dataclass(frozen=True, eq=False)
class Tail:
    """A guess of the last action: poses since the action before began, and its past.

    The objective is that of the past and of the tail.
    """

    hypothesis: Hypothesis
    before: Hypothesis
    past: Past


def continued(job: Job, page, kept, pasts, width, executor=None) -> list[Hypothesis]:
    """Return the best distinct hypotheses of all actions, by physics of the last one.

    kept: solved hypotheses of the actions before; pasts: the Gaussian of each.
    """
    part, first = last_action(job)
    tails = _promising(part, first, continuations(job, kept, pasts), kept, pasts)
    sent = page if executor is None else page.__name__
    found, shared = [], {}
    for i in range(0, len(tails), BATCH):
        if not _agreed(job.shape, found):
            batch = tails[i : i + BATCH]
            found += spread(_roughly, part, batch, executor, sent, shared)
    found = _best(job.shape, found, width)
    found = spread(_finely, part, found, executor, sent, shared)
    return [_joined(tail, first) for tail in _best(job.shape, found, width)]


def settled(job: Job, page, kept, width: int) -> list[Hypothesis]:
    """Return hypotheses solved for all actions, best first, until none can be better.

    kept: their unknowns are a warm start, their objectives may be estimates.
    """
    problem, window = posed(job, page, (kept[0].theta, kept[0].x))
    solvers, done = {}, []
    waiting = sorted(kept, key=lambda h: h.rank)
    while waiting and len(done) < SETTLED:
        best = min((h.objective for h in done), default=np.inf)
        if waiting[0].objective > best + doubt(job):
            break
        h = waiting.pop(0)
        warm = h.fits(problem)
        levels = resumed(page.LEVELS) if warm else opened(page.LEVELS, final=True)
        done.append(tried(job, problem, window, levels, h, ROUGH, solvers))
    waiting = [h for h in waiting if h.fits(problem)]
    return distinct(job.shape, done + waiting, width, BEHIND)


def doubt(job: Job) -> float:
    """Return how far an objective by a Gaussian of the past may be off [nats]."""
    return WIDE if job.data.actions <= FEW else CLOSE


def last_action(job: Job) -> tuple[Job, int]:
    """Return the job of the last two actions, in the earlier of which nothing was felt.

    Also its first sample.  The earlier action is the one pose where the past ends.
    """
    actions = np.unique(job.data.action)[-2:]
    data = job.data.select(actions)
    valid = data.valid.copy()
    valid[data.action == actions[0]] = False
    part = replace(job, data=replace(data, valid=valid))
    return part, job.data.samples - data.samples


def _promising(part, first, guesses, kept, pasts) -> list[Tail]:
    """Return tails, cheapest first by least motion; before, the best of each past."""
    problem, window = posed(part, quasi_static)
    remember(problem)
    tails, data = {}, [problem.data(WEAK | past.settings(problem)) for past in pasts]
    for k, h in guesses:
        h = replace(h, x=h.x[:, first:])
        x = problem.pack({"theta": h.theta, "x": h.x[:, window.last]})
        cost = sum(problem.value(n, x, data[k]).sum() for n in problem.costs)
        h = replace(h, objective=kept[k].objective + float(cost))
        tails[id(h)] = Tail(h, kept[k], pasts[k])
    found = [tail.hypothesis for tail in tails.values()]
    found = distinct(part.shape, found, len(found), np.inf)
    found = [tails[id(h)] for h in found]
    leads = [next((t for t in found if t.before is b), None) for b in kept]
    leads = [t for t in found if any(t is lead for lead in leads)]
    return [*leads, *(t for t in found if not any(t is lead for lead in leads))][:MOST]


def _roughly(job: Job, tails, page, shared) -> list[Tail]:
    page = page_named(page)
    return _solved(job, tails, page, opened(page.LEVELS, final=False), shared)


def _finely(job: Job, tails, page, shared) -> list[Tail]:
    page = page_named(page)
    return _solved(job, tails, page, resumed(page.LEVELS), shared)


def _solved(job, tails, page, levels, shared) -> list[Tail]:
    """Solve the page from every tail, its past in place of what came before.

    shared: keeps problem and solvers for a next call in this process.
    """
    lead = tails[0].hypothesis
    if not shared:
        shared["posed"] = posed(job, page, (lead.theta, lead.x))
        remember(shared["posed"][0])
        shared["solvers"] = {}
    (problem, window), out = shared["posed"], []
    for tail in tails:
        past = tail.past.settings(problem)
        mine = [replace(v, parameters=v.parameters | past) for v in levels]
        h = tail.hypothesis
        h = tried(job, problem, window, mine, h, ROUGH, shared["solvers"])
        h = replace(h, objective=h.objective + tail.before.objective)
        out.append(replace(tail, hypothesis=h))
    return out


def _agreed(shape, found) -> bool:
    """Tell whether several tails are the best one."""
    if not found:
        return False
    best = min(found, key=lambda t: t.hypothesis.objective).hypothesis
    near = [t for t in found if t.hypothesis.objective <= best.objective + EQUAL]
    return sum(same(shape, best, t.hypothesis) for t in near) >= AGREE


def _best(shape, tails, count) -> list[Tail]:
    """Return the best distinct tails."""
    of = {id(t.hypothesis): t for t in tails}
    found = distinct(shape, [t.hypothesis for t in tails], count, BEHIND)
    return [of[id(h)] for h in found]


def _joined(tail: Tail, first: int) -> Hypothesis:
    """Return the hypothesis of all actions: the past follows what the tail changed."""
    h, past, before = tail.hypothesis, tail.past, tail.before
    body = [name for name in dict.fromkeys(past.names) if name != "x"]
    end = np.concatenate([*(h.unknowns[n][:, 0] for n in body), h.x[:, 0]])
    moved = {
        n: before.unknowns[n] + a @ (end - past.mean) for n, a in past.along.items()
    }
    x = np.hstack([moved["x"][:, past.knot], h.x[:, len(past.knot) - first :]])

    def whole(old, new):
        """Append the columns of the tail; its first pose is the last of the past."""
        out = {n: np.hstack([old[n], a]) for n, a in new.items() if n not in body}
        out["x"] = np.hstack([old["x"], new["x"][:, 1:]])
        return out | {n: new[n] for n in body}

    rows = {
        n: np.concatenate([before.multipliers.get(n, a[:0]), a])
        for n, a in h.multipliers.items()
    }
    return replace(
        h, x=x, unknowns=whole(moved, h.unknowns),
        multipliers={**before.multipliers, **rows},
        bound_multipliers=whole(before.bound_multipliers, h.bound_multipliers),
    )  # fmt: skip
