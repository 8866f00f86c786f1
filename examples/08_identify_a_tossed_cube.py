"""Identify shape, friction and inertia of a cube from recorded tosses.

    python examples/08_identify_a_tossed_cube.py [tosses.npz [picture.png]]

No finger touches it: bounces inform about the corners, sliding about friction.  The
shipped tosses are simulated (examples/data/make_tosses.py); a file of your own has
toss, position, quaternion and dt, as tactilenlp.Trajectories reads them, and mass,
half_width, inertia_reported.  The real cube: https://github.com/DAIRLab/contact-nets.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from tactilenlp import Scene, Trajectories, example_recording, identify_body

LIMIT = 2.0  # [mm] largest mean error of the vertices accepted
recording = Path(sys.argv[1]) if len(sys.argv) > 1 else example_recording("tosses")
picture = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("tosses.png")

# Poses, toss by toss, and the known mass.  The ground is at height 0.
data = Trajectories.load(recording)
data = data.select(data.tosses[:4])
with np.load(recording) as file:
    scene, width = Scene(mass=float(file["mass"])), float(file["half_width"])
    reported = 1e3 * file["inertia_reported"]
print(f"{recording.name}: {data}", flush=True)

# Corners, friction, inertia and impulses that explain the motion best.
body = identify_body(data, scene)
print(body.summary())
print(f"Inertia {np.round(1e3 * body.inertia, 2)} g m^2 ({reported:.2f} was reported).")
print(f"In the tracker's units gravity is {scene.gravity / body.gauge:.2f} m/s^2.")

# The same data, with free corners instead of a cuboid.
free = identify_body(data, scene, shape="corners")
seen = np.setdiff1d(range(8), free.unobserved)
print(f"Free corners: {len(seen)} of 8 touched the ground.")

# Heights of the eight corners in the first toss, and impulses of the ground.
one = data.toss == data.tosses[0]
R_wo = Rotation.from_quat(np.roll(data.quaternion[one], -1, axis=1)).as_matrix()
height = data.position[one, 2:] + R_wo[:, 2] @ body.vertices.T
time = data.dt * np.arange(one.sum())
above, below = (figure := Figure((7, 5), layout="constrained")).subplots(2, sharex=True)
above.plot(time, 1e3 * height)
above.set(ylabel="height of each corner [mm]", title="the first toss")
below.plot(time, 1e3 * np.linalg.norm(body.impulses[one], axis=2), ".")
below.set(xlabel="time [s]", ylabel="impulse [mN s]", yscale="log", ylim=(1, None))
figure.savefig(picture)
print(f"The picture is in {picture}.")

error = 1e3 * np.linalg.norm(abs(body.vertices) - width, axis=1).mean()
loose = 1e3 * np.linalg.norm(abs(free.vertices[seen]) - width, axis=1).mean()
if error > LIMIT:
    sys.exit(f"The vertices are {error:.2f} mm off: more than {LIMIT} mm.")
print(f"The cuboid's vertices are {error:.2f} mm off, free corners {loose:.2f} mm.")
