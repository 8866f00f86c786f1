"""Mistakes of who calls the package: each with words of its remedy."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import casadi as ca
import numpy as np

import tactilenlp as tn

FIELDS = "time", "action", "finger_position", "finger_radius", "contact", "normal"
BOX = (0.05, 0.035, 0.04)


class Known:
    """What the mistakes are made with: data, scene, one estimate."""

    def __init__(self, data, scene, estimate):
        self.data, self.scene, self.estimate = data, scene, estimate
        self.few = data.select([0])

    def measured(self, **other):
        """Return the measurements with other fields."""
        given = {name: getattr(self.data, name) for name in FIELDS}
        return tn.Measurements(**given | other)

    def solved(self, data=None, **more):
        """Solve; no mistake may come as far as a second of it."""
        data = self.few if data is None else data
        return tn.solve_estimate(data, more.pop("scene", self.scene), **more)

    def posed(self, page):
        """Return the programme of a page."""
        return tn.problem_of(self.few, self.scene, page)


MEASUREMENTS = {
    "positions in mm": (
        lambda k: k.measured(finger_position=1e3 * k.data.finger_position),
        "millimetres",
    ),
    "radius in mm": (lambda k: k.measured(finger_radius=10.0), "divide by 1000"),
    "time in ms": (lambda k: k.measured(time=1e3 * k.data.time), "divide by 1000"),
    "time backwards": (lambda k: k.measured(time=k.data.time[::-1]), "sort by time"),
    "normals not unit": (lambda k: k.measured(normal=2 * k.data.normal), "normalise"),
    "normals inward": (
        lambda k: k.solved(k.measured(normal=-k.data.normal)), "give -normal",
    ),
    "contact inverted": (
        lambda k: k.measured(contact=~k.data.contact), "give ~contact",
    ),
    "forces as contact": (
        lambda k: k.measured(contact=3.2 * k.data.contact), "give booleans",
    ),
    "NaN where not felt": (
        lambda k: k.measured(finger_position=k.data.finger_position * np.nan),
        "give numbers where valid, of each action one",
    ),
    "axes of arrays": (
        lambda k: k.measured(finger_position=k.data.finger_position.swapaxes(1, 2)),
        "transpose",
    ),
    "one finger without its axis": (
        lambda k: k.measured(finger_position=k.data.finger_position[:, 0]),
        "add a single finger's axis",
    ),
    "nothing touched": (
        lambda k: k.solved(
            k.measured(contact=0 * k.data.contact, normal=0 * k.data.normal)
        ),
        "record an action that meets the object",
    ),
    "fingers swapped": (
        lambda k: k.solved(
            k.measured(contact=k.data.contact[:, ::-1], normal=k.data.normal[:, ::-1])
        ),
        "swap their columns",
    ),
    "axes of positions": (
        lambda k: k.solved(
            k.measured(finger_position=k.data.finger_position[..., [0, 2, 1]])
        ),
        "give positions",
    ),
    "actions as fractions": (
        lambda k: k.measured(action=k.data.action + 0.5), "whole numbers",
    ),
    "an action that is not there": (lambda k: k.data.select([99]), "among [0, 1"),
    "a second part with its own clock": (
        lambda k: k.data.append(k.data), "one clock for all actions",
    ),
    "an estimate read as measurements": (
        lambda k: (k.estimate.save("e.npz"), tn.Measurements.load("e.npz")),
        "Estimate.load(path).measurements",
    ),
    "measurements read as an estimate": (
        lambda k: (k.data.save("d.npz"), tn.Estimate.load("d.npz")),
        "Measurements.load reads recordings",
    ),
}  # fmt: skip
CALLS = {
    "grams": (lambda k: tn.Scene(mass=500), "divide by 1000"),
    "a vector of gravity": (lambda k: tn.Scene(gravity=[0, 0, -9.81]), "magnitude"),
    "a friction below zero": (
        lambda k: tn.Scene(friction_ground=-1), "None if unknown",
    ),
    "a name of the scene": (lambda k: tn.Scene(friction=0.3), "'friction_ground'"),
    "a tuple as ground": (
        lambda k: tn.Scene(ground=(0, 0, 1)), "Ground(height=..., normal=...)",
    ),
    "a path as data": (lambda k: k.solved("scene.npz"), "Measurements.load(path)"),
    "a shape as scene": (lambda k: k.solved(scene="cuboid"), "Scene.load(path)"),
    "a path as start": (lambda k: k.solved(start="e.npz"), "Estimate.load(path)"),
    "a dict as options": (
        lambda k: k.solved(options={"time_limit": 3}), "Options(name=value",
    ),
    "a name of the options": (lambda k: tn.Options(timelimit=3), "'time_limit'"),
    "a name of an argument": (lambda k: k.solved(option=1), "'options'"),
    "no time": (lambda k: tn.Options(time_limit=0), "a positive number"),
    "a name of a reduction": (lambda k: tn.Options(without="plannar"), "'planar'"),
    "an option of IPOPT": (
        lambda k: k.solved(options=tn.Options(ipopt={"max_iters": 5})), "max_iters",
    ),
    "a name of a shape": (lambda k: k.solved(shape="cilinder"), "'cylinder'"),
    "a class not called": (lambda k: k.solved(shape=tn.prism), "call it: prism(6)"),
    "a name of a page": (lambda k: k.solved(formulation="shoting"), "'shooting'"),
    "a path as page": (
        lambda k: k.solved(formulation="my_page.py"), "give the module",
    ),
    "a hull by shooting": (
        lambda k: k.solved(shape="polytope", formulation="shooting"),
        'use shape="cuboid"',
    ),
    "a start of other data": (
        lambda k: k.solved(k.data.select([1, 2]), start=k.estimate),
        "append to the same measurements",
    ),
    "a guess in mm": (
        lambda k: k.solved(start=tn.Guess([50, 30, 40], [0, 0])), "divide by 1000",
    ),
    "a guess in degrees": (lambda k: tn.Guess(BOX, [0, 0], yaw=90), "[rad]"),
    "a class as executor": (
        lambda k: k.solved(executor=ProcessPoolExecutor), "ProcessPoolExecutor(2)",
    ),
    "a shape that cannot travel": (
        lambda k: k.solved(
            shape=replace(tn.CYLINDER, inertia=lambda theta: ca.DM.eye(3)),
            executor=ProcessPoolExecutor(1),
        ),
        "leave executor out",
    ),
    "a name of a cost": (lambda k: k.estimate.costs["touches"], "'touch'"),
    "a name of an impulse": (
        lambda k: k.estimate.impulses["finger0"], "did you mean 'finger 0'?",
    ),
    "a name of a sigma": (
        lambda k: k.estimate.information.sigma("side_length"), "'side_lengths'",
    ),
    "a sample beyond the last": (
        lambda k: k.estimate.information.sigma("position", sample=10**6),
        "a whole number from",
    ),
    "a format of a mesh": (lambda k: k.estimate.export("box.step"), "one of .stl"),
    "a folder that is not there": (
        lambda k: k.estimate.save("no/where.npz"), "make the folder",
    ),
    "sides of a hull": (
        lambda k: replace(k.estimate, theta=k.estimate.vertices.ravel()).side_lengths,
        "read estimate.vertices",
    ),
}  # fmt: skip
