"""Constructors, calls and wire frames that the fuzzer draws, each with good arguments.

A table names what is called and good arguments; an input changes some of them.
"""

from __future__ import annotations

import functools

import can
import numpy as np
from fuzz_values import anything, changed, pick

import tactilenlp as t
from formulations.shape import CUBOID, Shape
from hardware.clock import ClockMap, unwrap
from hardware.errors import LimitError
from hardware.impedance import Gains, Limits
from hardware.kinematics import FAR, ROBOTS, Finger, finger
from hardware.motor_board import MotorBoard
from hardware.motor_can import encode_command, encode_current
from hardware.motor_joints import JointMap
from hardware.optical import Lens
from hardware.rig import FingerRig, Rig, Tactile
from hardware.serial_reader import OptoForceCan
from hardware.serial_tactile import (
    AnySkinFramer,
    ForceFrame,
    OptoForceFramer,
    encode_configuration,
    encode_force,
)
from hardware.simulated_robot import simulated_rig
from hardware.tape import Tape
from hardware.touch import FieldTouch, ForceTouch, Hysteresis, Tare
from tactilenlp.geometry.interpolation import path_of
from tactilenlp.problem.pages import page_of, shape_of

WIDE = 0.3  # share of the arguments that are changed
T, F = 6, 2


def measured() -> dict:
    """Return the arrays of good measurements."""
    contact = np.zeros((T, F), bool)
    contact[2:, 0] = True
    normal = np.zeros((T, F, 3))
    normal[2:, 0] = [1.0, 0.0, 0.0]
    return {
        "time": np.arange(T) / 30, "finger_position": np.full((T, F, 3), 0.05),
        "finger_radius": np.full(F, 0.01), "contact": contact, "normal": normal,
        "action": np.zeros(T, int), "valid": np.ones((T, F), bool),
        "finger_orientation": np.tile([1.0, 0, 0, 0], (T, F, 1)),
    }  # fmt: skip


def fields_of(made, *names) -> dict:
    """Return the fields of an object, by default all of a dataclass."""
    return {name: getattr(made, name) for name in names or made.__dataclass_fields__}


@functools.cache
def constructors() -> tuple:
    """Return pairs of a class and good arguments, World last."""
    world = fields_of(t.World((0.05, 0.04, 0.03)))
    known = {k: v for k, v in world.items() if k != "_"}
    return *_of_tactilenlp(), *_of_hardware(), (t.World, known)


def _of_tactilenlp() -> tuple:
    joints = {"sigma": 0.01, "place": np.full((F, 3), 0.1)}
    joints |= {"jacobian": np.tile(np.eye(6, 3), (F, 1, 1))}
    joints |= {"change": np.zeros((F, 3, 3, 3))}
    poses = {"toss": np.zeros(9, int), "position": np.zeros((9, 3)), "dt": 0.01}
    poses |= {"quaternion": np.tile([1.0, 0, 0, 0], (9, 1))}
    shape = {name: getattr(CUBOID, name) for name in Shape.__dataclass_fields__}
    space = t.Workspace()
    return (
        (t.Scene, fields_of(t.Scene())),
        (t.Ground, fields_of(t.Ground())),
        (t.JointZeros, joints),
        (t.Measurements, measured()),
        (t.Trajectories, poses),
        (t.Noise, fields_of(t.Noise())),
        (t.Guess, {"side_lengths": (0.05, 0.04, 0.03), "position": (0, 0), "yaw": 0.1}),
        (t.Options, fields_of(t.Options())),
        (t.Reductions, fields_of(t.Reductions())),
        (t.Reductions.of, {"without": ["still", "far"]}),
        (t.SolverOptions, fields_of(t.SolverOptions())),
        (t.ExploreOptions, fields_of(t.ExploreOptions(centre=(0.0, 0.0)))),
        (t.Workspace, fields_of(space)),
        (t.Workspace.robot, fields_of(space)),
        (t.Action, {"angles": [0.1] * 4, "workspace": space, "active": (True, False)}),
        (t.CrossEntropy, fields_of(t.CrossEntropy())),
        (t.Exploration, {"steps": ()}),
        (_shaped, shape),
        (_checked, shape),
        (t.prism, {"sides": 6}),
        (t.polytope, {"vertices": 8}),
        (t.log_size_prior, {"shape": CUBOID, "theta": (0.05, 0.04, 0.03)}),
        (_page, {"formulation": "quasi_static"}),
    )


def _of_hardware() -> tuple:
    rig = simulated_rig("optoforce")
    return (
        (Limits, fields_of(Limits())),
        (Gains, fields_of(Gains())),
        (Tactile, fields_of(rig.fingers[0].tactile)),
        (FingerRig, fields_of(rig.fingers[0])),
        (Rig, {"fingers": rig.fingers}),
        (JointMap, fields_of(JointMap())),
        (Finger, fields_of(ROBOTS["pro"])),
        (finger, {"robot": "edu", "degrees": 120.0}),
        (Lens, fields_of(Lens((160.0, 120.0), 118.0))),
        (Hysteresis, {"on": 2.0, "off": 1.0}),
        (Tare, {"samples": 10}),
        (ForceTouch, {"scale": (400.0,) * 3, "on": 0.2, "off": 0.1, "rest": 10}),
        (FieldTouch, {"on": 60.0, "off": 40.0, "rest": 10}),
        (encode_configuration, {"speed": 1000, "filter": 15, "zero": False}),
        (MotorBoard, {"config": {}, "name": "board", "max_current": 1.0}),
        (Tape, {"folder": "tape", "rig": rig, "bus": "blf"}),
    )


def _page(formulation):
    return page_of(formulation, CUBOID)


def _shaped(**fields) -> Shape:
    """Return a user's shape as the library takes it."""
    return shape_of(Shape(**fields))


def _checked(**fields) -> str:
    """Return what disagrees in a user's shape, in words."""
    return str(Shape(**fields).check())


def constructor(rng, known) -> str:
    """Call a constructor with some arguments changed, left out or invented."""
    table = constructors()
    last = rng.random() < 0.02  # a World compiles a model of MuJoCo
    make, good = table[-1] if last else pick(rng, table[:-1])
    given = {n: changed(v, rng) if rng.random() < WIDE else v for n, v in good.items()}
    if isinstance(make, type) and rng.random() < 0.05:
        given.pop(pick(rng, list(given)))
    if isinstance(make, type) and make is not Shape and rng.random() < 0.05:
        given[pick(rng, ("hypothesis", "masss", "x"))] = anything(rng)
    make(**given)
    return make.__name__


@functools.cache
def calls() -> tuple:
    """Return triples of a name, a function of good arguments, and these."""
    data, ground, space = t.Measurements(**measured()), t.Ground(0.1), t.Workspace()
    action, joints, pro = space.action([0.1] * 4), JointMap(), ROBOTS["pro"]
    points, box = np.full((4, 3), 0.1), (0.05, 0.04, 0.03)
    path = {"time": [0.0, 1.0], "finger_position": np.zeros((2, F, 3))}
    rigid = {"R": np.eye(3), "t": np.zeros(3)}
    turned = np.array([1.0, 0, 0, 0])
    errors = (box, (0, 0, 0), turned, box, (0, 0, 0), turned)
    stamps = np.arange(50.0), np.arange(50.0) / 10
    limits = functools.partial(Limits().check_path, "finger", pro)
    return (
        ("distance", ground.distance, (points,)),
        ("to_ground", ground.to_ground, (points,)),
        ("from_ground", ground.from_ground, (points,)),
        ("check", t.Scene().check, (data,)),
        ("action", space.action, ([0.1] * 4, (True, True))),
        ("random", space.random, (np.random.default_rng(0), None)),
        ("trajectory", action.trajectory, ((0.0, 0.0, 0.02),)),
        ("positions", action.positions, ((0.0, 0.0, 0.02), 5)),
        ("path_of", _path, tuple(path.values())),
        ("select", data.select, ([0],)),
        ("append", data.append, (data,)),
        ("is_prefix_of", data.is_prefix_of, (data,)),
        ("transformed", data.transformed, tuple(rigid.values())),
        ("cuboid_errors", t.cuboid_errors, errors),
        ("information_gain", t.information_gain, (np.eye(3), np.eye(3))),
        ("variable", _variable, (3, 2, 0.1, 0.0, 1.0, 0.1)),
        ("parameter", t.Problem().parameter, ("p", 1.0, "m")),
        ("forward of joints", joints.angles, (np.zeros((2, 2)),)),
        ("check_path", limits, (np.zeros((9, 3)), 0.01)),
        ("inverse", pro.inverse, (points,)),
        ("current", encode_current, (0.1, 0.2)),
        ("command", encode_command, (0, 1)),
        ("ClockMap.fit", ClockMap.fit, (*stamps, 0.1)),
        ("unwrap", unwrap, (np.arange(20), 16)),
        ("Hysteresis.learn", Hysteresis.learn, (np.arange(9.0), 1.0)),
        ("Rig.from_dict", Rig.from_dict, ({"fingers": []},)),
        ("solve_estimate", t.solve_estimate, (None,)),
        ("identify_body", t.identify_body, (None,)),
    )


def _path(time, position):
    return path_of(t.Trajectory(time, position), F, 60.0, FAR, LimitError)


def _variable(rows, columns, guess, lower, upper, scale):
    t.Problem().variable(
        "x", rows, columns, guess=guess, lower=lower, upper=upper, unit="m", scale=scale
    )


def call(rng, known) -> str:
    """Call a function or a method of a good object with some arguments changed."""
    name, function, good = pick(rng, calls())
    k = int(rng.integers(len(good)))
    given = [changed(v, rng) if i == k else v for i, v in enumerate(good)]
    function(*given)
    return name


def wire(rng, known) -> str:
    """Feed bytes or CAN frames to a decoder, and what it finds to a toucher."""
    name = pick(rng, ("optoforce", "anyskin", "board", "sensor"))
    count = int(rng.integers(0, 80))
    noise = rng.integers(0, 256, count, dtype=np.uint8).tobytes()
    if name == "optoforce":
        chunk = encode_force(ForceFrame(1, 0, (1, 2, 3)))
        k = int(rng.integers(len(chunk) + 1))
        framer, toucher = OptoForceFramer(), ForceTouch(rest=1)
        for frame in framer.feed(chunk[:k] + noise + chunk * 3):
            toucher(0.0, frame)
    elif name == "anyskin":
        AnySkinFramer().feed(noise + b"\r\n" + noise + b"\r\n")
    else:
        board = MotorBoard({}, name="b") if name == "board" else OptoForceCan()
        odd = rng.random(3) < 0.1
        identifier = int(pick(rng, (0, 1, 16, 32, 48, 64, 80, 96, 256)))
        message = can.Message(
            timestamp=float(rng.normal()), arbitration_id=identifier, data=noise[:8],
            is_extended_id=odd[0], is_error_frame=odd[1], is_rx=not odd[2],
        )  # fmt: skip
        board.on_message_received(message)
        if name == "sensor":
            board.take()
    return name
