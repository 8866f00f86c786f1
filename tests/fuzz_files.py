"""Damaged files, methods of what they load to, and command lines, for the fuzzer."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from pathlib import Path

import numpy as np
from fuzz_inputs import measured
from fuzz_values import changed, changed_array, pick

import tactilenlp as t
from hardware.motor_can import Pair, Quantity, encode
from hardware.recording import Recording
from hardware.rig import Rig, stream_name
from hardware.serial_tactile import ForceFrame, encode_force
from hardware.simulated_robot import simulated_rig
from hardware.tape import Tape
from tactilenlp.common.npz import format_of
from tactilenlp.interface.request import check_start
from tactilenlp.problem.pages import shape_of

ESTIMATES = "estimate", "hull"
LOADERS = {
    "measurements": t.Measurements.load, "scene": t.Scene.load,
    "trajectories": t.Trajectories.load, "estimate": t.Estimate.load,
    "exploration": t.Exploration.load, "hull": t.Estimate.load,
}  # fmt: skip
FILES = {"scene": "measurements"}  # where a kind has the file of another
JSON_TEXTS = ("", "[" * 100_000, "{}", "[1]", "null", '{"format": 1}', "nan", "\0")
SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".xml", ".urdf", ".doc", "")
PATHS = ("/nowhere/x", "", "\0", "a\ud800", ".", "/dev/null", "x" * 300)


def prepare(folder: Path, estimate, hull) -> None:
    """Write one good file of each kind; estimates: of any measurements."""
    scene = {"mass": 0.5, "friction_ground": 0.3, "friction_finger": 0.5}
    np.savez(folder / "measurements.npz", **measured(), **scene)
    poses = {"toss": np.zeros(9, int), "position": np.zeros((9, 3)), "dt": 0.01}
    poses |= {"quaternion": np.tile([1.0, 0, 0, 0], (9, 1))}
    np.savez(folder / "trajectories.npz", **poses)
    estimate.save(folder / "packed.npz")
    hull.save(folder / "hulls.npz")
    action = t.Workspace().action([0.1] * 4)
    told = (action.trajectory((0.0, 0.0, 0.02)),)
    step = t.Step(
        0,
        action,
        estimate.measurements,
        estimate,
        None,
        "random",
        {},
        told,
        {"surface": 1e-4},
    )
    t.Exploration((step,)).save(folder / "explored.npz")
    packs = {"packed": "estimate", "hulls": "hull", "explored": "exploration"}
    for packed, name in packs.items():
        with np.load(folder / f"{packed}.npz") as file:  # without compression: faster
            np.savez(folder / f"{name}.npz", **file)
    rig = simulated_rig("optoforce")
    rig.save(folder / "rig.json")
    with Tape(folder / "recording", rig, bus="log") as tape:
        for one in rig.fingers:
            _record(tape, one.name)


def _record(tape, name: str) -> None:
    """Write a few good frames of a finger."""
    packets = b"".join(encode_force(ForceFrame(k, 0, (1, 2, 3))) for k in range(20))
    feed = tape.bytes(stream_name(name, "tactile"))
    for k in range(4):
        feed(packets[80 * k : 80 * (k + 1)], 0.1 * k)
    for board in range(2):
        sink = tape.can(stream_name(name, f"board {board}"))
        for k in range(20):
            sink(encode(Pair(Quantity.POSITION, (0.1, 0.2)), 0.01 * k))


class Known:
    """The good files of a folder, read once, and a place to write."""

    def __init__(self, folder: Path, scratch: Path) -> None:
        self.folder, self.scratch = folder, scratch
        kinds = {FILES.get(kind, kind) for kind in LOADERS}
        self.raw = {k: (folder / f"{k}.npz").read_bytes() for k in kinds}
        self.arrays = {}
        for kind in kinds:
            with np.load(folder / f"{kind}.npz") as file:
                self.arrays[kind] = dict(file)
        self.rig = json.loads((folder / "rig.json").read_text())
        self.estimates = {k: t.Estimate.load(folder / f"{k}.npz") for k in ESTIMATES}
        self.estimate = self.estimates["estimate"]
        self.step = t.Exploration.load(folder / "exploration.npz").steps[0]


def load(rng, known: Known) -> str:
    """Load a damaged file of any kind; return the kind."""
    kind = pick(rng, (*LOADERS, *LOADERS, "rig", "recording", "format"))
    if kind == "rig":
        return _load_rig(rng, known)
    if kind == "recording":
        return _load_recording(rng, known)
    reader = format_of if kind == "format" else LOADERS[kind]
    made = pick(rng, list(LOADERS)) if kind == "format" or rng.random() < 0.1 else kind
    reader(damaged(rng, known, FILES.get(made, made)))
    return kind


def damaged(rng, known: Known, kind: str) -> Path:
    """Return the path of a damaged file of this kind."""
    path = known.scratch / "damaged.npz"
    if rng.random() < 0.03:
        return Path(pick(rng, PATHS[:-1])) if rng.random() < 0.5 else known.folder
    if rng.random() < 0.3:
        path.write_bytes(damaged_bytes(rng, known.raw[kind]))
        return path
    arrays = dict(known.arrays[kind])
    for _ in range(int(rng.integers(1, 4))):
        _damage(rng, arrays)
    np.savez(path, **arrays)
    return path


def _damage(rng, arrays: dict) -> None:
    """Change, drop or rename one array, or the header."""
    if not arrays:
        return
    name = pick(rng, list(arrays))
    way = rng.random()
    if "header" in arrays and way < 0.4:
        arrays["header"] = np.array(damaged_json(rng, str(arrays["header"])))
    elif way < 0.5:
        del arrays[name]
    elif way < 0.55:
        arrays["other"] = arrays.pop(name)
    elif way < 0.65:
        arrays[name] = arrays[pick(rng, list(arrays))]
    else:
        with contextlib.suppress(ValueError):  # ragged: cannot be written
            arrays[name] = np.asarray(changed_array(arrays[name], rng))


def damaged_bytes(rng, raw: bytes) -> bytes:
    """Return bytes with some flipped, cut off, doubled or overwritten."""
    data, way = bytearray(raw), rng.integers(4)
    k = int(rng.integers(len(data)))
    if way == 0:
        return bytes(data[:k])
    if way == 1:
        for place in rng.integers(0, len(data), int(rng.integers(1, 30))):
            data[place] ^= 1 << int(rng.integers(8))
    elif way == 2:
        data[k : k + 40] = rng.integers(0, 256, 40, dtype=np.uint8).tobytes()
    else:
        data[k:k] = data[k : k + 200]
    return bytes(data)


def damaged_json(rng, text: str) -> str:
    """Return a JSON text with one part replaced, or another text."""
    if rng.random() < 0.1 or not text:
        return pick(rng, JSON_TEXTS)
    if rng.random() < 0.1:
        k = int(rng.integers(len(text)))
        return text[:k] + text[k + 1 :]
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):  # it was damaged before
        return text
    return json.dumps(_damaged_tree(rng, tree))


def _damaged_tree(rng, tree):
    """Return a tree of JSON in which one branch is another."""
    if not isinstance(tree, dict | list) or not tree or rng.random() < 0.1:
        return pick(rng, (None, True, -1, 1.5, "x", [], {}, [[1]], {"a": 1}, 1e308))
    if isinstance(tree, list):
        k = int(rng.integers(len(tree)))
        return [*tree[:k], _damaged_tree(rng, tree[k]), *tree[k + 1 :]]
    key = pick(rng, list(tree))
    rest = {name: branch for name, branch in tree.items() if name != key}
    if rng.random() < 0.1:
        return rest
    name = "strange" if rng.random() < 0.05 else key
    return rest | {name: _damaged_tree(rng, tree[key])}


def _load_rig(rng, known: Known) -> str:
    path = known.scratch / "rig.json"
    if rng.random() < 0.2:
        path.write_bytes(damaged_bytes(rng, json.dumps(known.rig).encode()))
    else:
        path.write_text(damaged_json(rng, json.dumps(known.rig)))
    rig = Rig.load(path)
    for one in rig.fingers:
        one.tactile.toucher()
    rig.save(path)
    return "rig"


def _load_recording(rng, known: Known) -> str:
    """Read a recording in which one file is damaged."""
    source, folder = known.folder / "recording", known.scratch / "recording"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    files = sorted(source.iterdir())
    worse = pick(rng, files)
    for file in files:
        if file != worse:
            os.link(file, folder / file.name)
    target, raw = folder / worse.name, worse.read_bytes()
    if worse.suffix == ".json" and rng.random() < 0.7:
        target.write_text(damaged_json(rng, raw.decode()))
    elif worse.suffix == ".csv" and rng.random() < 0.7:
        odd = pick(rng, (b"-5", b"x", b"nan", b"1e9", b"99999999", b"", b"1,2"))
        target.write_bytes(raw.replace(b"80", odd, 1))
    elif rng.random() < 0.95:
        target.write_bytes(damaged_bytes(rng, raw))
    recording = Recording(folder)
    recording.fingers()
    return f"recording {recording.complete}"


METHODS = {
    "side_lengths": lambda e, rng, k: e.side_lengths,
    "seen_positions": lambda e, rng, k: e.seen_positions,
    "compliance": lambda e, rng, k: e.compliance,
    "rotation": lambda e, rng, k: e.rotation(changed(-1, rng)),
    "mesh": lambda e, rng, k: e.mesh(changed(-1, rng)),
    "planes": lambda e, rng, k: e.supporting_planes(),
    "face_sigma": lambda e, rng, k: t.face_sigma(e),
    "summary": lambda e, rng, k: e.summary(),
    "save": lambda e, rng, k: e.save(k.scratch / "saved.npz"),
    "report": lambda e, rng, k: e.report(k.scratch / "report.html"),
    "export": lambda e, rng, k: e.export(k.scratch / f"body{pick(rng, SUFFIXES)}"),
    "export to": lambda e, rng, k: e.export(changed("x", rng)),
    "sigma": lambda e, rng, k: e.information.sigma(_name(e, rng)),
    "covariance": lambda e, rng, k: e.information.covariance(_name(e, rng)),
    "part": lambda e, rng, k: e.information.part(_name(e, rng)),
    "correlation": lambda e, rng, k: e.information.correlation(),
    "remarks": lambda e, rng, k: e.remarks,
    "of_hessian": lambda e, rng, k: e.information.of_hessian(),
    "impulses": lambda e, rng, k: e.impulses[_key(e.impulses, rng)],
    "costs": lambda e, rng, k: e.costs[_key(e.costs, rng)],
    "dt": lambda e, rng, k: e.measurements.dt,
    "select": lambda e, rng, k: e.measurements.select(changed([0], rng)),
    "scene": lambda e, rng, k: e.scene.check(e.measurements),
    "start": lambda e, rng, k: check_start(e, shape_of(e.shape), e.scene),
}


def _name(estimate, rng):
    names = [*estimate.information.maps, "position", "rotation", "theta", "x"]
    return pick(rng, names) if rng.random() < 0.7 else changed(names[0], rng)


def _key(values, rng):
    """Return a name that is there, or another that can be a key."""
    if values and rng.random() < 0.5:
        return pick(rng, list(values))
    return pick(rng, ("finger0", "", 0, None, 1.5, (1,), "\ud800"))


def method(rng, known: Known) -> str:
    """Call a method of an estimate from a damaged file, or of a good one."""
    kind = pick(rng, ESTIMATES)
    estimate = known.estimates[kind]
    if rng.random() < 0.7:
        arrays = dict(known.arrays[kind])
        _damage(rng, arrays)
        np.savez(known.scratch / "damaged.npz", **arrays)
        with contextlib.suppress(t.TactileError):  # refused: the good one it is
            estimate = t.Estimate.load(known.scratch / "damaged.npz")
    name = pick(rng, list(METHODS))
    METHODS[name](estimate, rng, known)
    return name
