"""Learn shape, friction and inertia of a real cube from the way it falls and slides.

    python examples/07_identify_a_tossed_cube.py tosses.npz

Nobody touches it here: a camera saw the pose, 148 times a second, of a cube tossed on a
board.  Every bounce tells where a corner is, every slide how large friction is.  The
file holds toss, position, quaternion and dt, as tactilenlp.Trajectories reads them, of
the tosses that accompany ContactNets: https://github.com/DAIRLab/contact-nets.
"""

import sys
from pathlib import Path

import numpy as np

from tactilenlp import Scene, Trajectories, identify_body

LIMIT = 2.0  # [mm] vertices should not be further off, on average
if len(sys.argv) < 2:
    sys.exit("Name a file of tosses: what it holds is said at the top of this script.")
recording = Path(sys.argv[1])

# Poses, toss by toss, and what is known: the mass.  Height 0 is that of the board.
data = Trajectories.load(recording)
data = data.select(data.tosses[:4])
scene = Scene(mass=0.37)
print(f"{recording.name}: {data}")

# Corners, friction, inertia and impulses that explain the motion best.
body = identify_body(data, scene)
print(body.summary())
print("Inertia in g m^2:", (1e3 * body.inertia).round(2), "(0.81 was reported).")

# The camera's metre is short: in free fall the cube seems to fall too slowly.
print(f"Gravity looks like {scene.gravity / body.gauge:.2f} m/s^2 to the camera.")

# The hardest push of the board, of all corners and steps.
push = np.linalg.norm(body.impulses, axis=2)
sample, vertex = np.unravel_index(push.argmax(), push.shape)
print(f"The hardest blow: {push.max():.2f} N s on vertex {vertex}, sample {sample}.")

# The same data, with nothing assumed of the shape but its number of corners.
free = identify_body(data, scene, shape="corners")
seen = np.setdiff1d(range(8), free.unobserved)
print(f"Free corners: {len(seen)} of 8 were seen to touch.")

# The true cube is 104.8 mm wide: every corner has three coordinates of +-52.4 mm.
error = 1e3 * np.linalg.norm(abs(body.vertices) - 0.0524, axis=1).mean()
loose = 1e3 * np.linalg.norm(abs(free.vertices[seen]) - 0.0524, axis=1).mean()
if error > LIMIT:
    sys.exit(f"The vertices are {error:.2f} mm off: more than {LIMIT} mm.")
print(
    f"The cuboid's vertices are {error:.2f} mm off on average, "
    f"the free corners {loose:.2f} mm."
)
