"""Choose the action of highest expected information gain, and draw the gain.

    python examples/03_where_to_touch_next.py [picture.png]

After a first touch and two actions one side of the box is not observed yet.  The gain
in nats is drawn over all directions from which the two fingers may approach,
each within 72 deg (2 pi / 5) of its own side: the workspace keeps them apart.
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

from tactilenlp import (
    ExpectedInformation,
    Measurements,
    Scene,
    Workspace,
    choose_action,
    example_recording,
    plot_gain,
    solve_estimate,
)

matplotlib.use("Agg")  # write to a file, without a screen
recording = example_recording()
picture = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("where_next.png")
data, scene = Measurements.load(recording), Scene.load(recording)
print("Estimating three actions ...", flush=True)
estimate = solve_estimate(data.select(range(3)), scene)
print(f"Not observed: {'; '.join(estimate.information.unobserved) or 'nothing'}.")

# Fingers move on straight lines to the centroid.
workspace = Workspace()
choice = choose_action(estimate, workspace, search="facing", budget=180, seed=0)
for finger, direction in enumerate(choice.action.directions):
    print(f"Finger {finger} approaches from {np.round(direction, 2)}.")
print(f"{choice.evaluations} actions evaluated in {choice.seconds:.2f} CPU s.")

# The gain of any action: here of two hundred drawn at random.
expected, rng = ExpectedInformation(estimate, workspace), np.random.default_rng(0)
random = [expected.gain(workspace.random(rng)) for _ in range(200)]

plot_gain(estimate, choice).savefig(picture, dpi=110)
print(f"The picture is in {picture}.")
if choice.gain < max(random):
    sys.exit(f"A random action has a larger gain: {max(random):.1f} nats.")
print(
    f"The chosen action has an expected gain of {choice.gain:.1f} nats, "
    f"a random one {np.median(random):.1f}, the best of 200 {max(random):.1f}."
)
