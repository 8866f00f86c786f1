"""Explore an unknown box in simulation: measure, estimate, choose, repeat.

    python examples/04_explore_in_simulation.py [picture.png]

`explore` works with any object that has `execute(trajectory)`: this simulated world, or
a robot.  The estimator reads booleans and normals only; the world keeps the truth.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactilenlp import Scene, World, explore, plot_top

LIMIT = 1.0  # [mm] largest error accepted after four actions

plt.switch_backend("Agg")  # write to a file, without a screen
picture = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("exploration.png")
turn = [np.cos(0.3), 0, 0, np.sin(0.3)]  # 0.6 rad about the vertical
world = World([0.055, 0.038, 0.045], position=[0.01, -0.005], quaternion=turn)

print("First touch, then three chosen actions ...", flush=True)
figure, axes = plt.subplots(1, 4, figsize=(14, 4.2), layout="constrained")
for step in explore(world, Scene(), actions=3, centre=world.pose[:3], seed=0):
    truth = {
        "position": world.truth.object_position,
        "quaternion": world.truth.object_quaternion,
        "side_lengths": world.side_lengths,
    }
    off = 1e3 * step.errors["surface"]
    gain = f", {step.choice.gain:.1f} nats expected" if step.choice else ""
    print(f"Action {step.number} ({step.policy}{gain}): {off:.2f} mm off", flush=True)
    unseen = "; ".join(step.estimate.information.unobserved) or "nothing"
    print(f"  not observed: {unseen}")
    axis = axes[step.number]
    plot_top(step.estimate, -1, truth, axis)
    axis.get_legend().remove()
    axis.set(xlim=(-80, 80), ylim=(-80, 80))
    axis.set_title(f"action {step.number}: {off:.2f} mm off")
key = {
    word: drawn for drawn, word in zip(*axis.get_legend_handles_labels(), strict=True)
}
figure.legend(key.values(), key, loc="outside lower center", ncols=6, frameon=False)
figure.savefig(picture, dpi=120)
print(f"The picture is in {picture}.")
if off > LIMIT:
    sys.exit(f"The surface is {off:.2f} mm off on average: more than {LIMIT} mm.")
print(f"After four seconds of touch the surface is {off:.2f} mm off on average.")
