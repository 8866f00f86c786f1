"""Proposals of a tumble are solved as far as they may still be the best."""

from types import SimpleNamespace

import numpy as np
import pytest

from formulations.violation_implicit import ROUGH
from tactilenlp.refinement import certification

PLANAR = 30.0  # [nats] of the solve to beat
# Objectives of each proposal [nats]: after the softer weights, and after all levels.
PROPOSALS = {"a": (5.0, 20.0), "b": (40.0, 1.0), "c": (25.0, 1.0), "d": (2.0, 10.0)}


@pytest.fixture
def solved(monkeypatch):
    """Return the names and last levels of what is solved, as it is solved."""
    done = []

    def solve(job, name, built, levels, before=None):
        done.append((name, levels[-1].name))
        objective = PROPOSALS[name][before is not None]
        solution = SimpleNamespace(objective=objective, success=True)
        return SimpleNamespace(name=name, solution=solution)

    stand_ins = {
        "solved_from": solve, "tumbling_motions": lambda *_: [*PROPOSALS],
        "unexplained_by_action": lambda *_: {}, "built_page": lambda *_: None,
        "in_motion_of": lambda job, h: h, "certify": lambda *_: None,
        "replace": lambda best, **_: best,
        "in_canonical_axes": lambda shape, h, like: h,
    }  # fmt: skip
    for name, value in stand_ins.items():
        monkeypatch.setattr(certification, name, value)
    return done


@pytest.mark.parametrize(
    ("limit", "best", "to_the_end"), [(PLANAR, "d", "ad"), (1.0, None, "")]
)
def test_what_costs_more_by_softer_weights_is_not_solved_to_the_end(
    solved, limit, best, to_the_end
):
    job = SimpleNamespace(
        options=SimpleNamespace(widths=lambda precise: (1, 1)),
        shape=None,
        contract=SimpleNamespace(from_guesses=ROUGH),
        with_reductions=lambda planar: None,
    )
    flat = SimpleNamespace(at=SimpleNamespace(theta=None, x=np.zeros((3, 1))))
    found = certification._solve_tumbles(job, flat, limit, None)
    assert (found and found.name) == best
    # "c" costs less than the flat solve, and more than "a" did at the end.
    assert [name for name, level in solved if level == "joint"] == [*to_the_end]
    assert [name for name, level in solved if level == "loose"] == [*PROPOSALS]
