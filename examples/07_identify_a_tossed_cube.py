"""Identify shape, friction and inertia of a real cube from recorded tosses.

    python examples/07_identify_a_tossed_cube.py tosses.npz

No finger touches it: a camera recorded the pose of a cube, tossed on a board, at
148 Hz.  Bounces inform about the corners, sliding about friction.  The file contains
toss, position, quaternion and dt, as tactilenlp.Trajectories reads them, of the tosses
that accompany ContactNets: https://github.com/DAIRLab/contact-nets.
"""

import sys
from pathlib import Path

import numpy as np

from tactilenlp import Scene, Trajectories, identify_body

LIMIT = 2.0  # [mm] largest mean error of the vertices accepted
if len(sys.argv) < 2:
    sys.exit("Give a file of tosses; the docstring of this script describes it.")
recording = Path(sys.argv[1])

# Poses, toss by toss, and the known mass.  The board is at height 0.
data = Trajectories.load(recording)
data = data.select(data.tosses[:4])
scene = Scene(mass=0.37)
print(f"{recording.name}: {data}")

# Corners, friction, inertia and impulses that explain the motion best.
body = identify_body(data, scene)
print(body.summary())
print("Inertia in g m^2:", (1e3 * body.inertia).round(2), "(0.81 was reported).")

# The camera's length scale is wrong: free fall appears too slow.
print(f"In the camera's units gravity is {scene.gravity / body.gauge:.2f} m/s^2.")

# The largest impulse of the board, over all corners and steps.
push = np.linalg.norm(body.impulses, axis=2)
sample, vertex = np.unravel_index(push.argmax(), push.shape)
print(f"Largest impulse: {push.max():.2f} N s, vertex {vertex}, sample {sample}.")

# The same data, with free corners instead of a cuboid.
free = identify_body(data, scene, shape="corners")
seen = np.setdiff1d(range(8), free.unobserved)
print(f"Free corners: {len(seen)} of 8 touched the board.")

# The true cube is 104.8 mm wide: corner coordinates are +-52.4 mm.
error = 1e3 * np.linalg.norm(abs(body.vertices) - 0.0524, axis=1).mean()
loose = 1e3 * np.linalg.norm(abs(free.vertices[seen]) - 0.0524, axis=1).mean()
if error > LIMIT:
    sys.exit(f"The vertices are {error:.2f} mm off: more than {LIMIT} mm.")
print(
    f"The cuboid's vertices are {error:.2f} mm off on average, "
    f"the free corners {loose:.2f} mm."
)
