"""Identify boxes that plain MuJoCo tosses, with a CSV file and a picture.

    python examples/benchmarks/tossed_boxes.py folder [--boxes 20] [--tosses 4]
        [--executor processes|dask|mpi|none]

Every second box is a cube.  Half widths are 20 to 60 mm, frictions 0.2 to 0.6; contacts
are MuJoCo's default ones, poses are recorded at 150 Hz without noise.  off: distance
[mm] between each vertex and the true one; poses tell the axes of the body.  A failure
is infinitely far in the quantiles.

Called again with the same folder, the script runs what is missing.  It writes
tossed_boxes.csv and tossed_boxes.png.
"""

from pathlib import Path
from time import process_time

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from judging import quantile
from study import study_parser, tabled_study, telling

from tactilenlp import Scene, Trajectories, identify_body
from tactilenlp.errors import TactileError

RATE, STEPS = 150.0, 10  # [Hz] of the poses, steps of the simulator between two
SECONDS = 1.2  # [s] of a toss
SEED = 2029
WORLD = """
<mujoco>
  <option timestep="{step}"/>
  <worldbody>
    <geom type="plane" size="5 5 1" friction="{friction} 0 0"/>
    <body name="box">
      <freejoint/>
      <geom type="box" size="{size}" mass="{mass}" friction="{friction} 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def drawn_box(number: int) -> tuple[np.ndarray, float, float]:
    """Return half widths (3,) [m], mass [kg] and friction of a box; even: a cube."""
    rng = np.random.default_rng([SEED, number])
    half = rng.uniform(0.02, 0.06, 3)
    half = np.full(3, half[0]) if number % 2 == 0 else half
    return half, float(rng.uniform(0.1, 0.6)), float(rng.uniform(0.2, 0.6))


def tossed(number: int, tosses: int) -> Trajectories:
    """Return the poses of a box in so many tosses."""
    half, mass, friction = drawn_box(number)
    size, step = " ".join(map(str, half)), 1 / RATE / STEPS
    text = WORLD.format(step=step, size=size, mass=mass, friction=friction)
    model = mujoco.MjModel.from_xml_string(text)
    data, rng, poses = mujoco.MjData(model), np.random.default_rng([number, SEED]), []
    for toss in range(tosses):
        mujoco.mj_resetData(model, data)
        turn = rng.normal(size=4)
        height = np.linalg.norm(half) + rng.uniform(0.1, 0.3)
        data.qpos[:] = [0, 0, height, *turn / np.linalg.norm(turn)]
        data.qvel[:] = [
            *rng.normal(0, 0.5, 2),
            rng.uniform(-1, 0.5),
            *rng.normal(0, 5, 3),
        ]
        for _ in range(int(SECONDS * RATE)):
            poses.append([toss, *data.qpos])
            mujoco.mj_step(model, data, STEPS)
    poses = np.array(poses)
    return Trajectories(
        toss=poses[:, 0].astype(int), position=poses[:, 1:4], quaternion=poses[:, 4:],
        dt=1 / RATE,
    )  # fmt: skip


def run(number: int, tosses: int) -> dict:
    """Return one row: the box, errors [mm], sigma [mm], gauge, verdict or failure."""
    half, mass, friction = drawn_box(number)
    row = {
        "box": number,
        "cube": number % 2 == 0,
        "half_mm": str((1e3 * half).round(1)),
    }
    began = process_time()
    try:
        body = identify_body(tossed(number, tosses), Scene(mass=mass))
    except TactileError as error:
        words = f"{type(error).__name__}: {error.what}"
        return row | {"failure": words, "cpu_s": process_time() - began}
    error = body.half_widths - half
    sigma = body.sigma["half_widths"]
    return row | {
        "failure": "", "off_mm": 1e3 * float(np.linalg.norm(error)),
        "sigmas": float(abs(error / sigma).max()), "sigma_mm": 1e3 * float(sigma.max()),
        "gauge": body.gauge, "radius_mm": 1e3 * body.radius,
        "friction": body.friction, "friction_true": friction,
        "objective": body.objective, "cpu_s": process_time() - began,
        "verdict": body.fit.verdict,
    }  # fmt: skip


def tell(rows: list[dict]) -> None:
    """Print median, 90th percentile and worst of cubes and others, and failures."""
    for name, cube in (("cubes", True), ("others", False)):
        mine = [row for row in rows if row["cube"] == cube]
        failed = sum(bool(row["failure"]) for row in mine)
        off = [row.get("off_mm", np.inf) for row in mine]
        numbers = np.round([quantile(off, q) for q in (0.5, 0.9, 1.0)], 2)
        print(f"{name}: n = {len(mine)}, off median, 90 %, worst {numbers} mm, "
              f"{failed} failed")  # fmt: skip


def draw(rows: list[dict], path: Path) -> None:
    """Draw the errors of all boxes; crosses are failures."""
    figure, axes = plt.subplots(figsize=(6, 3), layout="tight")
    for row in rows:
        style = {"marker": "x", "color": "C3"} if row["failure"] else {"marker": "o"}
        colour = {} if row["failure"] else {"color": "C0" if row["cube"] else "C1"}
        axes.scatter(row["box"], row.get("off_mm", 100.0), **style, **colour)
    axes.set(yscale="log", xlabel="box (even: cubes)", ylabel="vertices off [mm]")
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = study_parser(__doc__)
    parser.add_argument("--boxes", type=int, default=20)
    parser.add_argument("--tosses", type=int, default=4)
    given = parser.parse_args()
    cases = [[number, given.tosses] for number in range(given.boxes)]
    path = given.folder / "tossed_boxes"
    say = telling("failure", "off_mm", "sigmas", "verdict", "cpu_s")
    rows = tabled_study(given, path, run, cases, say=say)
    draw(rows, path.with_suffix(".png"))
    tell(rows)


if __name__ == "__main__":
    main()
