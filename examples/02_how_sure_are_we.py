"""Print the standard deviations of an estimate, and what is not observed.

    python examples/02_how_sure_are_we.py [picture.png]

The same recording after one, three and six actions: standard deviations by name, a
list of what is not observed, and the surface coloured by its information.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from tactilenlp import (
    Measurements,
    Scene,
    example_recording,
    plot_information,
    solve_estimate,
)

plt.switch_backend("Agg")  # write to a file, without a screen
recording = example_recording()
picture = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("how_sure.png")
data, scene = Measurements.load(recording), Scene.load(recording)

figure = plt.figure(figsize=(11, 3.6), layout="constrained")
estimate = None
for place, actions in enumerate((1, 3, 6)):
    print(f"After {actions} action{'s' * (actions > 1)}:", flush=True)
    # `start` continues from the hypotheses of the shorter recording.
    estimate = solve_estimate(data.select(range(actions)), scene, start=estimate)
    information = estimate.information
    sides = estimate.side_lengths * 1e3
    sigma = information.sigma("side_lengths") * 1e3
    for name, side, deviation in zip("xyz", sides, sigma, strict=True):
        print(f"  side {name}  {side:6.2f} ± {deviation:5.2f} mm")
    for axis, deviation in zip("xyz", information.sigma("position"), strict=True):
        print(f"  position {axis}     ± {deviation * 1e3:5.2f} mm")
    print(f"  not observed: {'; '.join(information.unobserved) or 'nothing'}")
    axis = figure.add_subplot(1, 3, place + 1, projection="3d")
    plot_information(estimate, axis, key=actions == 6)
    axis.set_title(f"after {actions} action{'s' * (actions > 1)}")
figure.savefig(picture, dpi=110)
print(f"The picture is in {picture}.")

# The labels of a box's axes are arbitrary: compare the sizes in order.
with np.load(recording) as file:
    off = np.sort(sides) - np.sort(file["side_lengths"]) * 1e3
ratio = np.abs(off) / sigma[np.argsort(sides)]
if ratio.max() > 4:
    sys.exit(f"A size is off by {ratio.max():.1f} standard deviations.")
print(
    f"The sizes are off by {np.abs(off).max():.2f} mm at most, "
    f"{ratio.max():.1f} of their standard deviations."
)
