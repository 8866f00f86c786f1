"""What Python, NumPy or CasADi would refuse in their words is refused in ours."""

import json
import pickle
import types

import numpy as np
import pytest

import tactilenlp as t
from formulations import violation_implicit
from hardware.errors import LimitError, RecordingError, RigError
from hardware.impedance import Limits
from hardware.recording import Recording
from hardware.rig import Rig
from hardware.simulated_robot import simulated_rig
from hardware.tape import Tape
from tactilenlp.errors import PageError, TactileError

DIGITS = 10**400
TIME = np.timedelta64(3, "s")
SIDES = (0.05, 0.04, 0.03)
REFUSED = {  # what is called with measurements and an estimate -> words of the error
    "far": (lambda d, e: changed(d, finger_position=1e300), "within 10000 m"),
    "thin": (lambda d, e: changed(d, finger_radius=1e-12), "too small"),
    "late": (lambda d, e: changed(d, action=np.uint64(2**63 + 1)), "too large"),
    "mask": (lambda d, e: masked(d), "MaskedArray"),
    "guess in words": (lambda d, e: t.Guess("big", (0, 0)), "start.side_lengths"),
    "guess NaN": (lambda d, e: t.Guess((np.nan, 0.1, 0.1), (0, 0)), "start.side_"),
    "guess yaw": (lambda d, e: t.Guess(SIDES, (0, 0), "north"), "start.yaw"),
    "guess place": (lambda d, e: t.Guess(SIDES, (0, 0, 0, 0)), "start.position"),
    "guess far": (lambda d, e: t.Guess(SIDES, (1e300, 0)), "start.position"),
    "guess none": (lambda d, e: t.solve_estimate(d, start=t.Guess((), (0, 0))), "3 "),
    "ragged": (lambda d, e: t.Scene(friction_ground=[[1], [2, 3]]), "one number"),
    "digits": (lambda d, e: t.Options(time_limit=DIGITS), "a positive number"),
    "many digits": (lambda d, e: t.Scene(mass=10**5000), "mass"),
    "time": (lambda d, e: t.Options(tolerance=TIME), "tolerance"),
    "time of noise": (lambda d, e: t.Noise(position=TIME), "Noise.position"),
    "time of space": (lambda d, e: t.Workspace(radius=TIME), "radius"),
    "misspelt": (lambda d, e: t.Options(hypothesis=2), "did you mean 'hypotheses'"),
    "too many": (lambda d, e: t.Ground(1, 2, 3), "arguments among"),
    "limits": (lambda d, e: Limits(speed=2), "did you mean 'top_speed'"),
    "digits of limits": (lambda d, e: Limits(margin=DIGITS), "margin"),
    "a file": (lambda d, e: t.solve_estimate("file.npz"), "Measurements.load"),
    "finger0": (lambda d, e: e.impulses["finger0"], "did you mean 'finger 0'"),
    "cost": (lambda d, e: e.costs["mass"], "expected one of"),
    "no levels": (lambda d, e: solve(d, violation_implicit.build, ()), "levels"),
    "no function": (lambda d, e: solve(d, 3), "build(nlp, window, scene, shape)"),
    "no theta": (lambda d, e: solve(d, without_theta), "theta of 3 numbers"),
    "few sizes": (lambda d, e: solve(d, without_height), "theta (2, 1)"),
}


def changed(data, **values):
    """Return measurements with all entries of some arrays of one value."""
    arrays = data.arrays()
    full = {key: np.full_like(arrays[key], v, type(v)) for key, v in values.items()}
    return t.Measurements(**arrays | full)


def masked(data):
    hidden = np.ma.masked_greater(data.finger_position, 0.01)
    return t.Measurements(**data.arrays() | {"finger_position": hidden})


def solve(data, build, levels=violation_implicit.LEVELS):
    page = types.ModuleType("own")
    page.build, page.LEVELS = build, levels
    return t.solve_estimate(data, formulation=page, options=t.Options(hypotheses=1))


def without_theta(nlp, window, scene, shape):
    y = nlp.variable("y", 3, guess=0.04, unit="m", scale=0.01)
    nlp.minimize("size", lambda y: y[0] ** 2, y, role="prior")


def without_height(nlp, window, scene, shape):
    theta = nlp.variable("theta", 2, guess=0.04, unit="m", scale=0.01)
    nlp.variable("x", 3, window.poses, guess=0.0, unit="m", scale=0.01)
    nlp.minimize("size", lambda y: y[0] ** 2, theta, role="prior")


def with_nan(nlp, window, scene, shape):
    violation_implicit.build(nlp, window, scene, shape)
    theta, zero = nlp.variables["theta"], lambda y: y[0] - y[0]
    nlp.minimize("my cost", lambda y: zero(y) / zero(y), theta, role="prior")


@pytest.mark.parametrize("case", REFUSED)
def test_bare_errors_have_become_typed_ones(case, recorded, touched):
    call, words = REFUSED[case]
    with pytest.raises(TactileError) as caught:
        call(recorded[0].select([0]), touched)
    assert words in str(caught.value)
    assert caught.value.where
    assert caught.value.expected


def test_a_page_with_a_nan_cost_is_refused_by_the_name_of_the_cost(recorded):
    with pytest.raises(PageError, match='"my cost" is not finite'):
        solve(recorded[0].select([0]), with_nan)


def test_an_unknown_name_of_a_result_is_a_key_error_and_survives_pickling(touched):
    with pytest.raises(KeyError):
        touched.impulses["finger0"]
    assert touched.impulses.get("finger0") is None
    again = pickle.loads(pickle.dumps(touched.impulses))
    assert [*again] == [*touched.impulses]
    with pytest.raises(KeyError, match=r"estimate\.impulses"):
        again["finger0"]


def kinds_of(kind):
    """Yield a class and those that derive from it."""
    yield kind
    for derived in kind.__subclasses__():
        yield from kinds_of(derived)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_error_survives_pickling_also_those_of_files(protocol):
    for kind in kinds_of(TactileError):
        error = kind("what", where="here", got=[3], expected="4", next="do")
        error.more = 5.0
        again = pickle.loads(pickle.dumps(error, protocol))
        assert type(again) is kind
        assert (str(again), again.args) == (str(error), error.args)
        assert vars(again) == vars(error)


JSON = (None, True, 3, -1.5, "x", [], {}, [[1]], {"a": 1}, 10**400, "NaN")


def places(tree, path=()):
    """Yield the path to every branch of a tree of JSON."""
    yield path
    lists = dict(enumerate(tree)) if isinstance(tree, list) else {}
    for key, branch in (tree if isinstance(tree, dict) else lists).items():
        yield from places(branch, (*path, key))


def replaced(tree, path, value):
    """Return a tree with one branch replaced."""
    if not path:
        return value
    made = dict(tree) if isinstance(tree, dict) else list(tree)
    made[path[0]] = replaced(tree[path[0]], path[1:], value)
    return made


@pytest.mark.parametrize("kind", ["optoforce_can", "densetact"])
def test_a_rig_with_a_value_of_another_type_is_refused_or_can_be_used(kind, tmp_path):
    simulated_rig(kind).save(tmp_path / "rig.json")
    rig = json.loads((tmp_path / "rig.json").read_text())
    del rig["fingers"][1]
    refused = 0
    for path in places(rig):
        for value in JSON:
            try:
                made = Rig.from_dict(replaced(rig, path, value))
                made.save(tmp_path / "again.json")
                if kind != "densetact":  # needs OpenCV, and is slow
                    [one.tactile.toucher() for one in made.fingers]
            except RigError:
                refused += 1
    assert refused > 100


def test_a_rig_that_is_nested_deeply_is_refused(tmp_path):
    path = tmp_path / "rig.json"
    for text in ("[" * 100_000, '{"fingers": ' + "[" * 500 + "]" * 500 + "}"):
        path.write_text(text)
        with pytest.raises(RigError):
            Rig.load(path)


@pytest.mark.parametrize(
    "row", ["0.1,-5", "0.1,many", "nan,3", "inf,3", "0.1,1e3", "3"]
)
def test_a_recording_with_a_bad_size_or_time_is_refused(row, tmp_path):
    rig = simulated_rig("optoforce")
    with Tape(tmp_path / "tape", rig, bus="log") as tape:
        tape.bytes("finger_0_tactile")(b"abc", 0.0)
    with (tmp_path / "tape" / "finger_0_tactile.csv").open("a") as table:
        table.write(f"{row}\n")
    with pytest.raises(RecordingError, match="cannot be read"):
        [*Recording(tmp_path / "tape").chunks("finger_0_tactile")]


def test_a_picture_outside_of_the_recording_is_refused(tmp_path):
    with Tape(tmp_path / "tape", simulated_rig(), bus="log"):
        pass
    table = "time,name\n0.1,../secret.png\n"
    (tmp_path / "tape" / "camera.csv").write_text(table)
    with pytest.raises(RecordingError, match="not the name of a file"):
        [*Recording(tmp_path / "tape").pictures("camera")]


def test_numbers_that_reach_a_motor_are_of_one_shape_and_kind():
    finger = simulated_rig().fingers[0]
    for wrong in ("x", None, [1, 2], [[1], [2, 3]], TIME, np.ma.masked_all(3)):
        with pytest.raises(LimitError):
            finger.geometry.forward(wrong)
        with pytest.raises(LimitError):
            finger.joints.currents(wrong)
