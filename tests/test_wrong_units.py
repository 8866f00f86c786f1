"""Millimetres, degrees, grams, wrong shapes: refused where they come in, with a fix."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import tactilenlp as t
from tactilenlp.errors import FileError, TactileError

BOX = (0.05, 0.04, 0.03)
LEVEL = np.eye(4)[[0] * 9]


def tossed(**changes):
    given = {"toss": np.zeros(9, int), "position": np.zeros((9, 3)), "dt": 0.01}
    return t.Trajectories(**given | {"quaternion": LEVEL} | changes)


def explored(**changes):
    return next(t.explore(t.World(BOX), **{"centre": (0.0, 0.0)} | changes))


WRONG = {  # call of estimate and data -> what the message must say
    "divide by 1000": [
        lambda e, d: replace(d, finger_position=1e3 * d.finger_position),
        lambda e, d: replace(d, finger_radius=1e3 * d.finger_radius),
        lambda e, d: replace(d, time=1e3 * d.time),
        lambda e, d: t.World((50.0, 40.0, 30.0)),
        lambda e, d: t.Workspace(radius=100.0),
        lambda e, d: t.solve_estimate(d, start=t.Guess((50, 40, 30), (0, 0))),
    ],
    "transpose": [
        lambda e, d: replace(d, finger_position=d.finger_position.transpose(1, 0, 2)),
    ],
    "normalise": [lambda e, d: replace(d, normal=2 * d.normal)],
    "kg, got 500": [lambda e, d: t.Scene(mass=500)],
    "[rad]": [
        lambda e, d: t.Workspace(bound=72.0),
        lambda e, d: t.Workspace().action([90, 20, 90, 20]),
    ],
    "got shape": [
        lambda e, d: t.World(BOX).execute(t.Trajectory(np.arange(3), np.zeros((2, 3)))),
    ],
    "(3,) finite positive numbers [m], got [1, 2]": [
        lambda e, d: t.cuboid_errors([1, 2], *[np.zeros(3)] * 5),
    ],
    "3 positive lengths [m]": [
        lambda e, d: t.solve_estimate(d, start=t.Guess((0.05, 0.04), (0, 0))),
    ],
    "shape (3,)": [lambda e, d: t.World((0.05, 0.04))],
    "unit length": [
        lambda e, d: tossed(quaternion=np.ones((9, 4))),
        lambda e, d: t.World(BOX, quaternion=(1, 1, 1, 1)),
    ],
    "[s] between 0 and 1": [lambda e, d: tossed(dt=-1)],
    "square matrices": [lambda e, d: t.information_gain(np.eye(3), np.eye(2))],
    "finite numbers [m]": [
        lambda e, d: explored(centre=(1, 2, 3, 4)),
        lambda e, d: explored(centre="here"),
    ],
    "execute(trajectory)": [lambda e, d: next(t.explore("robot"))],
    "a whole number from 0": [
        lambda e, d: explored(actions=-1),
        lambda e, d: explored(seed=-1),
    ],
    "wrong type": [
        lambda e, d: d.is_prefix_of("data"),
        lambda e, d: t.Scene().check(None),
        lambda e, d: t.Workspace().random(7),
        lambda e, d: e.information.sigma(2),
        lambda e, d: e.information.part(np.zeros(3)),
        lambda e, d: t.ExpectedInformation(e, hypotheses=1).gain([0.1, 0.2]),
        lambda e, d: explored(actions=2.5),
        lambda e, d: explored(seed="x"),
        lambda e, d: explored(workspace=3),
        lambda e, d: explored(start=3),
        lambda e, d: d.append(3),
        lambda e, d: t.Exploration().with_step(3),
    ],
    "or a function": [lambda e, d: explored(until="enough")],
    "(..., 3) finite numbers [m]": [
        lambda e, d: t.Ground().distance("here"),
        lambda e, d: t.Ground().to_ground([1, 2]),
        lambda e, d: t.Ground().from_ground(np.nan),
    ],
    "(3,) finite numbers [m]": [
        lambda e, d: t.Workspace().action([0.1, 0.1, 0.1, 0.1]).trajectory("here"),
        lambda e, d: t.Workspace().action([0.1] * 4).positions([1, 2], 3),
    ],
    "whole numbers among": [
        lambda e, d: d.select(3),
        lambda e, d: d.select(["a"]),
        lambda e, d: tossed().select(None),
    ],
    "not a rigid motion": [lambda e, d: d.transformed("turn", None)],
    "the path of a file": [lambda e, d: d.save("")],
    "as many fingers": [lambda e, d: t.JointZeros(0.02, [[0, 0, 0]], [], [])],
    "np.deg2rad": [lambda e, d: t.JointZeros(1.0, [], [], [])],
    "a str or a Path": [
        lambda e, d: t.Measurements.load(3),
        lambda e, d: t.Scene.load(None),
        lambda e, d: explored(file=3.5),
        lambda e, d: t.export_shape(e, None),
        lambda e, d: t.write_report(e, None),
        lambda e, d: e.save(None),
        lambda e, d: t.animate(e, None),
    ],
    "concurrent.futures": [lambda e, d: t.solve_estimate(d, executor=4)],
    "matplotlib Axes": [
        lambda e, d: t.plot_scene(e, axis="x"),
        lambda e, d: t.plot_top(e, axis=[1, 2]),
    ],
    "3d": [lambda e, d: t.plot_scene(e, axis=plt.figure().subplots())],
    "side_lengths or vertices": [
        lambda e, d: t.plot_top(e, truth={"position": [0, 0, 0]}),
        lambda e, d: t.plot_scene(e, truth=3),
        lambda e, d: t.animate(e, "film.gif", truth={}),
    ],
    "(3,) [m]": [lambda e, d: t.plot_errors([e], truth=[1, 2])],
    "frames per second": [lambda e, d: t.animate(e, "film.gif", rate="fast")],
    "Measurements.load": [lambda e, d: t.Estimate.load("recording.npz")],
}
CASES = [
    pytest.param(call, words, id=f"{words}-{k}")
    for words, calls in WRONG.items()
    for k, call in enumerate(calls)
]


@pytest.mark.parametrize(("call", "words"), CASES)
def test_what_is_wrong_is_refused_with_what_was_expected(
    call, words, estimate, recorded, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    recorded[0].save("recording.npz")
    with pytest.raises(TactileError) as caught:
        call(estimate, recorded[0].select([0]))
    assert words in str(caught.value)
    assert caught.value.where  # a stranger finds what is meant
    assert [path.name for path in tmp_path.iterdir()] == ["recording.npz"]


def test_a_folder_that_is_not_there_is_named_as_it_was_given(estimate, tmp_path):
    with pytest.raises(FileError, match="no such folder") as caught:
        estimate.save(tmp_path / "nowhere" / "estimate.npz")
    assert str(tmp_path / "nowhere") in str(caught.value)
