"""Compare standard deviations with errors over many boxes: coverage and reliability.

    python examples/benchmarks/calibration.py folder [--count 200] [--first 2000]
        [--worlds clean noisy soft] [--executor processes|dask|mpi|none]

Boxes and worlds are those of time_against_error.py; box k has 1 + k mod 6 actions.  An
estimate of default options is judged by |error| / sigma of its sizes, of its final
position and yaw, and of position and yaw at PLACES samples of the whole path.

    coverage      share of the numbers within 1, 1.96 and 3 sigma: of Gaussian errors
                  68.3, 95.0 and 99.7 %
    reliability   share of the numbers within the interval of each probability
    errors        of the error budget: the mean share of the variance by each; of the
                  numbers that owe it more than half, the root mean square and the
                  largest |error| / sigma (1 where sigma is right)

Refused estimates are counted and left out.  Rows are kept in calibration.jsonl as they
end (study.py): called again, the script runs what is missing, prints both tables and
writes calibration.csv (a row a world, quantity and verdict), calibration_errors.csv (a
row a world, quantity and error) and calibration.png.
"""

from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from judging import solved, spread_samples
from scipy.stats import norm
from study import grouped, study_parser, table, tabled_study, telling, write_csv
from time_against_error import PLACES, WORLDS, measured, warm

from tactilenlp.evaluation.metrics import cuboid_errors

MOST_ACTIONS = 6
WITHIN = {"68.3 %": 1.0, "95 %": 1.96, "99.7 %": 3.0}  # [sigma]
QUANTITIES = ("sizes", "position", "yaw", "path position", "path yaw")
LEAST_SHARE = 0.03  # of an error that is printed
TOLD = ("refused", *QUANTITIES, "verdict", "cpu_s")  # of each estimate as it ends


def judged(world: str, number: int) -> dict:
    """Return one row: |error| / sigma by quantity, verdict, nats and CPU seconds."""
    warm("violation_implicit")
    actions = 1 + number % MOST_ACTIONS
    data, scene, true = measured(world, number, actions)
    row = {"world": world, "box": number, "actions": actions, "refused": ""}
    estimate, told = solved(data, scene)
    row |= told
    if estimate is None:
        return row
    row |= {"verdict": estimate.fit.verdict, "nats": estimate.objective}
    path = [ratios(estimate, true, k) for k in spread_samples(data, PLACES)]
    row |= {name: list(values) for name, values in path[-1].items()}
    row["shares"] = shares(estimate, true)
    return row | {
        f"path {name}": [float(r) for at in path for r in at[name]]
        for name in ("position", "yaw")
    }


def errors_at(estimate, true, sample: int):
    """Return the errors of a box at a sample, modulo its symmetries."""
    found = estimate.position[sample], estimate.quaternion[sample]
    truth = true["object_position"][sample], true["object_quaternion"][sample]
    sides = estimate.side_lengths, true["side_lengths"]
    return cuboid_errors(sides[0], *found, sides[1], *truth)


def ratios(estimate, true, sample: int) -> dict[str, np.ndarray]:
    """Return |error| / sigma of sizes, and of position and yaw at a sample."""
    error, sigma = errors_at(estimate, true, sample), estimate.information.sigma
    order = error.permutation
    pose = {name: sigma(name, sample=sample) for name in ("position", "rotation")}
    return {
        "sizes": np.abs(error.side_lengths) / sigma("side_lengths")[order],
        "position": np.abs(error.position) / pose["position"],
        "yaw": np.abs(error.rotation_vector[2:]) / pose["rotation"][2:],
    }


def shares(estimate, true) -> dict[str, dict[str, list[float]]]:
    """Return the share of each error in the variance of sizes, position and yaw."""
    order = errors_at(estimate, true, len(estimate.position) - 1).permutation
    taken = {"side_lengths": order, "position": range(3), "rotation": [2]}
    named = zip(("sizes", "position", "yaw"), taken.items(), strict=True)
    return {
        quantity: {
            error: [float(one[k] ** 2 / total[k] ** 2) for k in of]
            for error, one in estimate.information.error_budget(name).items()
        }
        for quantity, (name, of) in named
        for total in [estimate.information.sigma(name)]
    }


def of_errors(rows) -> list[dict]:
    """Return a row for every world, quantity and error, the largest shares first."""
    cells = []
    for ((world,), mine), quantity in product(
        grouped(rows, "world").items(), QUANTITIES[:3]
    ):
        kept = [row for row in mine if "shares" in row]
        found = numbers_of(kept, quantity)
        for error in dict.fromkeys(e for row in kept for e in row["shares"][quantity]):
            none = [0.0] * len(kept[0][quantity])
            each = [row["shares"][quantity].get(error, none) for row in kept]
            share = np.concatenate(each)
            most = found[share > 0.5]
            rms = float(np.sqrt(np.mean(most**2))) if len(most) else np.nan
            cell = {"world": world, "quantity": quantity, "error": error}
            cell |= {"share": float(share.mean()), "n": len(most), "rms": rms}
            cells.append(cell | {"largest": float(most.max(initial=0.0))})
    order = {name: k for k, name in enumerate(QUANTITIES)}
    return sorted(cells, key=lambda c: (c["world"], order[c["quantity"]], -c["share"]))


def numbers_of(rows, quantity: str) -> np.ndarray:
    """Return all |error| / sigma of a quantity."""
    return np.concatenate([row[quantity] for row in rows] or [[]]).astype(float)


def coverage(rows) -> list[dict]:
    """Return a row for every world, quantity, and kind of verdict."""
    cells = []
    for (world,), mine in grouped(rows, "world").items():
        kept = [row for row in mine if not row["refused"]]
        good = [row for row in kept if row["verdict"] == "good"]
        for verdict, chosen in (("any", kept), ("good", good)):
            for quantity in QUANTITIES:
                found = numbers_of(chosen, quantity)
                cell = {"world": world, "verdict": verdict, "quantity": quantity}
                cell |= {"boxes": len(mine), "estimates": len(chosen)}
                cell |= {"numbers": len(found), "refused": len(mine) - len(kept)}
                cell |= {name: float(np.mean(found <= z)) for name, z in WITHIN.items()}
                cell |= {"beyond 5 sigma": int(np.sum(found > 5.0))}
                cell |= {"median": float(np.median(found)) if len(found) else np.nan}
                cell |= {"largest": float(found.max(initial=0.0))}
                cells.append(cell)
    return cells


def draw(rows, path: Path) -> None:
    """Plot the share of numbers within each interval against its probability."""
    worlds = grouped(rows, "world")
    figure, axes = plt.subplots(
        1, len(worlds), figsize=(3.4 * len(worlds) + 0.6, 4.2), sharey=True,
        layout="constrained", squeeze=False,
    )  # fmt: skip
    wanted = np.linspace(0.01, 0.99, 99)
    for axis, ((world,), every) in zip(axes[0], worlds.items(), strict=True):
        mine = [row for row in every if not row["refused"]]
        for quantity in QUANTITIES:
            found = numbers_of(mine, quantity)
            share = [np.mean(found <= z) for z in norm.ppf((1 + wanted) / 2)]
            style = "--" if quantity.startswith("path") else "-"
            axis.plot(wanted, share, style, label=quantity)
        axis.plot([0, 1], [0, 1], color="0.6", lw=0.8, zorder=0)
        axis.set(title=f"{world}, {len(mine)} boxes", aspect="equal")
        axis.set(xlim=(0, 1), ylim=(0, 1))
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("share of errors within the interval")
    figure.supxlabel("probability of the interval (above the diagonal: sigma is wide)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), ncols=len(QUANTITIES),
                  loc="outside upper center", frameon=False)  # fmt: skip
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main() -> None:
    parser = study_parser(__doc__)
    parser.add_argument("--count", type=int, default=200, help="boxes")
    parser.add_argument("--first", type=int, default=2000, help="number of the first")
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=list(WORLDS))
    chosen = parser.parse_args()
    boxes = range(chosen.first, chosen.first + chosen.count)
    cases = [(world, number) for number in boxes for world in chosen.worlds]
    path = chosen.folder / "calibration"
    rows = tabled_study(chosen, path, judged, cases, say=telling(*TOLD), table=coverage)
    print(table(coverage(rows)))
    errors = of_errors(rows)
    write_csv(Path(f"{path}_errors.csv"), errors)
    print(table([cell for cell in errors if cell["share"] > LEAST_SHARE]))
    draw(rows, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
