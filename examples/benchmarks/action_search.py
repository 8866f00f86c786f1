"""Compare searches of the action space on states of explorations in simulation.

    python examples/benchmarks/action_search.py folder [--worlds 4] [--known 5000]
        [--budgets 60 180 500] [--seed 77] [--searches direct cem ...]

A state is the estimate of an exploration in MuJoCo (a first touch and four chosen
actions), saved in the folder.  The best known gain of a state is the largest that any
search found; two of the searches use 5 000 evaluations for it.  The script prints the
mean gain relative to the best known one and the CPU time per evaluation.  It saves
search.jsonl (study.py) and resumes from it.  The constants of the searches were chosen
on the worlds of seed 77 only.
"""

from pathlib import Path
from time import process_time

import numpy as np
from exploration_objects import SIZES, WITHIN
from study import executor_of, run_study, study_parser, table

from tactilenlp import ExpectedInformation, Exploration, Scene, World, explore
from tactilenlp.exploration.action_search import best_action, facing
from tactilenlp.exploration.optimisers import SEARCHES

SEED, ACTIONS = 77, 4  # of the worlds; after each, a state


def states(folder: Path, worlds: int, seed: int) -> list[tuple[str, int]]:
    """Return files and steps of estimates, after exploring what is not there yet."""
    for k in range(worlds):
        rng = np.random.default_rng([seed, k])
        yaw, place = rng.uniform(0, 2 * np.pi), rng.uniform(-WITHIN, WITHIN, 2)
        turn = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
        here = folder / f"world_{k}.npz"
        if here.exists() and Exploration.load(here).at(ACTIONS):
            continue
        world = World(rng.uniform(*SIZES, 3), position=place, quaternion=turn)
        centre = world.pose[:3]
        for step in explore(
            world, Scene(), actions=ACTIONS, centre=centre, seed=k, file=here
        ):
            print(here.name, step.number, step.policy, flush=True)
    files = [folder / f"world_{k}.npz" for k in range(worlds)]
    return [(str(file), number) for file in files for number in range(ACTIONS + 1)]


def searched(file: str, number: int, known: int, budgets, searches) -> dict:
    """Return the gains found in one state, by search and budget."""
    estimate = Exploration.load(file).at(number).estimate
    expected = ExpectedInformation(estimate)
    space = expected.workspace
    near = facing(estimate, space)

    def gain(angles) -> float:
        return expected.gain(space.action(angles))

    gain(space.lower)  # compiles
    found, began = {}, process_time()
    found["known"] = max(
        best_action(gain, space, search=search, budget=known, facing=near).gain
        for search in ("facing", "direct_l")
    )
    per_gain = (process_time() - began) / (2 * known)
    for search in searches:
        for budget in budgets:
            choice = best_action(
                gain, space, search=search, budget=budget, seed=1, facing=near
            )
            found[f"{search} {budget}"] = choice.gain
    best = max(found.values())
    hypotheses = len(expected.beliefs)
    return {
        "state": f"{Path(file).stem} action {number}",
        "best": best,
        "hypotheses": hypotheses,
        "ms_per_gain_and_hypothesis": 1e3 * per_gain / hypotheses,
        "share": {k: v / best for k, v in found.items()},
    }


def main() -> None:
    parser = study_parser(__doc__)
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--known", type=int, default=5000)
    parser.add_argument("--budgets", type=int, nargs="+", default=[60, 180, 500])
    parser.add_argument("--searches", nargs="+", default=SEARCHES, choices=SEARCHES)
    parser.add_argument("--seed", type=int, default=SEED, help="of the worlds")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    asked = arguments.known, arguments.budgets, arguments.searches
    found = states(arguments.folder, arguments.worlds, arguments.seed)
    cases = [(*state, *asked) for state in found]
    with executor_of(arguments) as executor:
        rows = run_study(
            arguments.folder / "search.jsonl", "action search", searched, cases,
            executor, say=lambda _, r: f"{r['state']} best known {r['best']:.2f} nats",
        )  # fmt: skip
    cpu = np.median([row["ms_per_gain_and_hypothesis"] for row in rows])
    print(f"{len(rows)} states, {cpu:.2f} CPU ms per gain and hypothesis (median)")
    mean = {k: np.mean([row["share"][k] for row in rows]) for k in rows[0]["share"]}
    print("mean share of the best known gain, by search and budget")
    print(table([{"search": search, "share": share} for search, share in mean.items()]))


if __name__ == "__main__":
    main()
