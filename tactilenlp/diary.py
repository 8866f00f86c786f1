"""Keep an exploration on disk, action by action, so that it can be taken up again."""

from __future__ import annotations

import json
import os
from pathlib import Path

from .errors import StartError
from .measurements import Measurements
from .result import Estimate
from .workspace import Action, Workspace


def write(folder, number: int, data: Measurements, action, words: str) -> None:
    """Keep an action and what it measured, at once and whole; no folder, no diary."""
    if folder is None:
        return
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    plain = {"policy": words, "action": None if action is None else action.as_dict()}
    _whole(folder / f"action_{number:02d}.json", lambda path: path.write_text(
        json.dumps(plain)
    ))  # fmt: skip
    _whole(folder / f"action_{number:02d}.npz", data.save)


def read(folder, number: int, space: Workspace):
    """Return data, action and policy of an action that was kept, or None."""
    if folder is None:
        return None
    file = Path(folder) / f"action_{number:02d}.npz"
    if not file.exists():
        return None
    plain = json.loads(file.with_suffix(".json").read_text())
    action = plain["action"]
    if action is not None:
        action = Action(action["angles"], space, tuple(action["active"]))
    return Measurements.load(file), action, plain["policy"]


def keep(folder, number: int, estimate: Estimate) -> None:
    """Keep the estimate of all data up to an action."""
    if folder is None:
        return
    file = Path(folder) / f"estimate_{number:02d}.npz"
    if not file.exists():
        _whole(file, estimate.save)


def estimate(folder, number: int, data: Measurements) -> Estimate | None:
    """Return the estimate that was kept, of exactly these data, or None."""
    if folder is None:
        return None
    file = Path(folder) / f"estimate_{number:02d}.npz"
    if not file.exists():
        return None
    found = Estimate.load(file)
    if found.measurements == data:
        return found
    raise StartError(
        "the kept estimate is of other data",
        where=str(file),
        got=repr(found.measurements),
        expected=repr(data),
        next="explore into an empty folder",
    )


def _whole(path: Path, save) -> None:
    """Write a file that is there whole or not at all."""
    part = path.with_name(f".{path.name}")
    save(part)
    os.replace(part, path)
