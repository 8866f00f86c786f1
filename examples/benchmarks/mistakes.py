"""Make common mistakes in recordings, and measure which are found before a solve.

    python examples/benchmarks/mistakes.py folder ../shared/scenes/*.npz
        [--correct ../shared/foreign/*.npz] [--executor processes|dask|mpi|none]

Every mistake is made in every recording that has touches; those of `--correct` are
checked as they are only.  A mistake is found when its recording is refused, by the
constructor of Measurements, by the check for mistakes or by the check of the ground.
A mistake that leaves a recording nearly as it is does not count (`untold` says why).
What is not refused may be suspected: an estimate names it where its fit is not good.

Called again with the same folder, the script runs what is missing.  It writes
mistakes.csv (a line a mistake), mistakes_of_recordings.csv and mistakes.png.
"""

from itertools import permutations, product
from pathlib import Path
from time import process_time

import matplotlib.pyplot as plt
import numpy as np
from study import executor_of, grouped, run_study, study_parser, table, write_csv

from tactilenlp import Measurements, Scene
from tactilenlp.data.mistakes import most_likely, record_of, suspicion
from tactilenlp.errors import MeasurementError

SHIFTS = (-8, -5, -3, 3, 5, 8)  # samples
SEED = 2028
TURNED = 45.0  # [deg] that a change of axes must turn a normal
ENOUGH = 3  # touches that a mistake must change


def turns() -> dict[str, np.ndarray]:
    """Return the 47 changes of axes and signs, by what (x, y, z) become."""
    found = {}
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        name = "".join("+-"[signs[i] < 0] + "xyz"[i] for i in order)
        found[name] = np.diag(signs)[list(order)]
    return {name: Q for name, Q in found.items() if name != "+x+y+z"}


def kind_of(Q: np.ndarray) -> str:
    """Return how a change of axes is called."""
    if np.array_equal(Q, -np.eye(3)):
        return "all mirrored"
    if np.array_equal(abs(Q), np.eye(3)):
        return "mirrored"
    return "swapped" if np.linalg.det(Q) < 0 else "turned"


def shifted(data: Measurements, names, f: int, shift: int, how: str) -> dict:
    """Return arrays of finger f later by so many samples.

    how: "log", of the whole record, as clocks that differ make; "action", held at the
    ends of every action.
    """
    first = np.searchsorted(data.action, data.action)
    last = np.searchsorted(data.action, data.action, side="right") - 1
    source = np.arange(data.samples) - shift
    source = source % data.samples if how == "log" else np.clip(source, first, last)
    arrays = {name: getattr(data, name).copy() for name in names}
    for array in arrays.values():
        array[:, f] = array[source, f]
    return arrays


def mistakes_of(data: Measurements) -> dict:
    """Return (group, name) -> arrays of a recording with this mistake."""
    p, n, contact = data.finger_position, data.normal, data.contact
    felt = contact & data.valid
    made = {("normals inward", "-normal"): {"normal": -n}}
    for name, Q in turns().items():
        made[f"axes of normals {kind_of(Q)}", name] = {"normal": n @ Q.T}
        made[f"axes of positions {kind_of(Q)}", name] = {"finger_position": p @ Q.T}
    del made["axes of normals all mirrored", "-x-y-z"]  # the same as inward
    for factor in (1000.0, 100.0, 10.0, 0.01, 0.001):
        radius = data.finger_radius * factor
        made["radius in a wrong unit", f"x {factor:g}"] = {"finger_radius": radius}
    anywhere = np.random.default_rng(SEED).normal(size=n.shape)
    anywhere /= np.linalg.norm(anywhere, axis=2, keepdims=True)
    for name, normal in (("normals kept", n), ("any normals", anywhere)):
        inverted = ~contact & data.valid
        kept = normal if normal is n else np.where(inverted[..., None], normal, 0.0)
        made["contact inverted", name] = {"contact": inverted, "normal": kept}
    if data.fingers > 1:
        touch = {"contact": contact[:, ::-1], "normal": n[:, ::-1]}
        made["fingers swapped", "position"] = {"finger_position": p[:, ::-1]}
        touch["valid"] = data.valid[:, ::-1]
        made["fingers swapped", "contact and normal"] = touch
    f = int(felt.sum(axis=0).argmax())
    feeling = ("contact", "normal", "valid")
    for shift in SHIFTS:
        name = f"{shift:+d} samples"
        whole = shifted(data, ("finger_position", *feeling), f, shift, "log")
        made["clock of a finger", name] = whole
        made["clock of positions", name] = shifted(
            data, ("finger_position",), f, shift, "log"
        )
        late = "late" if shift > 0 else "early"
        made[f"touch {late}", name] = shifted(data, feeling, f, shift, "action")
    return made


def untold(arrays: dict, change: dict, group: str, name: str) -> str:
    """Return why nothing can tell this mistake in this recording, or no words."""
    felt = arrays["contact"] & arrays["valid"]
    if group.startswith("axes"):
        Q, n = turns()[name], arrays["normal"][begun(felt)]
        cosine = (n * (n @ Q.T)).sum(axis=1)
        if (cosine < np.cos(np.radians(TURNED))).sum() < ENOUGH:
            return f"turns fewer than {ENOUGH} touched normals by {TURNED:.0f} deg"
    if group.startswith("touch"):
        left = change["contact"] & change["valid"]
        moved = (left != felt).any(axis=0)
        if begun(left)[:, moved].sum() < ENOUGH:
            return f"fewer than {ENOUGH} touches of the finger are left"
    return ""


def begun(felt: np.ndarray) -> np.ndarray:
    """Return where touches (T, F) of two samples or more begin."""
    none = np.zeros((1, felt.shape[1]), bool)
    return felt & ~np.vstack([none, felt[:-1]]) & np.vstack([felt[1:], none])


def refusal(arrays: dict) -> tuple[str, float, float, str]:
    """Return what a recording is refused for, gain, CPU time, and what is suspected.

    "" where it is not refused; where it is, nothing is suspected any more.
    """
    try:
        data = Measurements(**arrays)
    except MeasurementError as error:
        return f"constructor: {error.what}", np.nan, 0.0, ""
    began = process_time()
    found, gain, limit = most_likely(record_of(data, Scene()))
    seconds = process_time() - began
    if gain > limit:
        return found.name, gain, seconds, ""
    try:
        Scene().check(data)
    except MeasurementError as error:
        return f"ground: {error.what}", gain, seconds, ""
    return "", gain, seconds, suspicion(data, Scene())


def judged(path: str, correct: bool) -> list[list]:
    """Return [group, name, refusal, nats, CPU [s], suspected, why untold] of each."""
    data = Measurements.load(path)
    arrays = {key: getattr(data, key) for key in vars(data)}
    made = {("none", "as it is"): {}} | ({} if correct else mistakes_of(data))
    return [
        [*key, *refusal(arrays | change), untold(arrays, change, *key)]
        for key, change in made.items()
    ]


def table_of(rows: list[dict]) -> list[dict]:
    """Return a line a group of mistakes: how many were made, and the share found."""
    table = []
    for (group,), mine in grouped(rows, "group").items():
        told = [row for row in mine if not row["untold"]]
        found = np.array([bool(row["refused"]) for row in told])
        cpu = [row["cpu_s"] for row in mine]
        table.append({
            "group": group, "made": len(mine), "untold": len(mine) - len(told),
            "found": int(found.sum()), "share": round(float(found.mean()), 4),
            "suspected": sum(bool(row["suspected"]) for row in told),
            "cpu_s_median": round(float(np.median(cpu)), 4),
            "cpu_s_most": round(float(np.max(cpu)), 4),
        })  # fmt: skip
    return table


def drawn(table: list[dict], path: Path) -> None:
    """Draw the share of each mistake that was found."""
    shown = table[::-1]
    names = [f"{row['group']} (n = {row['made'] - row['untold']})" for row in shown]
    share = [100 * row["share"] for row in shown]
    figure, axes = plt.subplots(figsize=(7, 0.35 * len(shown) + 1), layout="tight")
    bars = axes.barh(names, share, color=["C1" if s < 90 else "C0" for s in share])
    axes.bar_label(bars, [f"{s:.1f}" for s in share], padding=3)
    axes.set(xlabel="recordings refused [%]", xlim=(0, 112))
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = study_parser(__doc__)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--correct", nargs="*", default=[])
    given = parser.parse_args()
    touched = [path for path in given.recordings if np.load(path)["contact"].any()]
    cases = [[path, False] for path in touched] + [[p, True] for p in given.correct]
    with executor_of(given) as executor:
        results = run_study(
            given.folder / "mistakes.jsonl", "mistakes", judged, cases, executor
        )
    keys = ("group", "mistake", "refused", "nats", "cpu_s", "suspected", "untold")
    rows = [
        {"recording": Path(path).stem} | dict(zip(keys, line, strict=True))
        for (path, _), lines in zip(cases, results, strict=True)
        for line in lines
    ]
    groups = table_of(rows)
    write_csv(given.folder / "mistakes_of_recordings.csv", rows)
    write_csv(given.folder / "mistakes.csv", groups)
    drawn(groups, given.folder / "mistakes.png")
    print(table(groups))


if __name__ == "__main__":
    main()
