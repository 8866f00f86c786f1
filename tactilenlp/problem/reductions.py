"""Reduce measurements to the window that a scene needs: Measurements to Window.

still         samples in which nothing can move share one pose
far           a free finger far from the object carries no information
absent        a finger that feels nothing exerts no impulse
planar        an object that never tilts has three unknowns per pose, not six
frictionless  a contact without friction has no tangential impulse
rigid, central, aligned   fingertips do not yield under load, the centre of mass is the
              centroid, normals are not turned (see refinement/nested_models.py)
Each can be switched off alone; certificates check them after the solve.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from formulations.names import FINGER, GROUND
from formulations.page_contract import contract_of
from formulations.rigid_body import ARM, FREE, PLANAR

from ..common.validation import check_types
from ..data.contact_segments import REPEATED, SIDE_NORMAL, intervals, late_gap, rate_of
from ..data.scene import low_friction
from ..data.sensor_noise import noise_at_edges
from ..errors import OptionError, did_you_mean, typed_call
from .fingertips import finger_of, finger_poses, outlier_cost, yields
from .missing_samples import last_felt_normal, possible_contact, unseen_contact
from .window import Corners, Pushes, Rests, Samples, Steps, Window

CLEARLY_FREE = 30e-3  # [m] a free finger this far beyond the sensor's doubt is left out
MIN_MOVE = 0.1e-3  # [m] a guess that moves further in a sample needs poses of its own
EVEN_STEPS = 1e-6  # [-] by which steps of one length differ, by rounding of times


@typed_call()
@dataclass(frozen=True)
class Reductions:
    """Which reductions may be made; all by default."""

    still: bool = True
    far: bool = True
    absent: bool = True
    planar: bool = True
    frictionless: bool = True
    rigid: bool = True
    central: bool = True
    aligned: bool = True

    def __post_init__(self) -> None:
        check_types(**{name: (value, bool) for name, value in vars(self).items()})

    @classmethod
    def of(cls, without) -> Reductions:
        """Return all reductions but one, or some, by name; OptionError of others."""
        many = isinstance(without, (tuple, list, set, frozenset))
        off = tuple(without) if many else (without,)
        if unknown := [
            n for n in off if not isinstance(n, str) or n not in REDUCTION_NAMES
        ]:
            raise OptionError(
                "no names of reductions", where="without", got=unknown,
                expected=f"names among {[*REDUCTION_NAMES]}",
                next=did_you_mean(unknown[0], REDUCTION_NAMES),
            )  # fmt: skip
        return cls(**dict.fromkeys(off, False))


REDUCTION_NAMES = tuple(f.name for f in fields(Reductions))
OF_NUISANCES = "rigid", "central", "aligned"  # kept by pages without the unknowns


def required_reductions(page, reductions: Reductions) -> Reductions:
    """Return the reductions, those that a page requires switched on or off.

    It requires those OF_NUISANCES that it does not name in FREED.
    """
    contract = contract_of(page)
    taken = {name: True for name in OF_NUISANCES if name not in contract.freed}
    return replace(reductions, **taken | contract.reductions)


def states_planar_motion(page) -> bool:
    """Tell whether a page states planar motion only."""
    return contract_of(page).reductions.get("planar", False)


def window_of_samples(
    data, scene, shape, precision, choice=None, guess=None, cuts=()
) -> Window:
    """Return the window of `data` (ground at z = 0) under the chosen reductions.

    guess: theta and x (unknowns, T) that say what is far and which corners are low;
    without one, no sample is far.  cuts: samples that may move, still span or not.
    """
    choice = choice or Reductions()
    motion = PLANAR if choice.planar else FREE
    first = np.r_[True, data.action[1:] != data.action[:-1]]
    original = repeated_samples(data, first)
    moving = may_move(data, scene, first) if choice.still else np.ones_like(first)
    if motion is FREE and guess is not None:
        moving = (moving | guess_moves(guess[1])) & ~first
    moving[list(cuts)] = True
    moving &= original == np.arange(len(first))
    before, pose = np.r_[0, original[:-1]], np.cumsum(moving | first) - 1
    p_wf = finger_poses(data, scene)
    touch = _samples(data, p_wf, pose, data.contact)
    free = _samples(data, p_wf, pose, data.valid & ~data.contact)
    if choice.far:
        free = _samples_in_reach(free, scene, shape, guess, precision)
    step = _steps(data, scene, pose, first, before, moving)
    pushing = touch if choice.absent else _samples(data, p_wf, pose, data.valid)
    hidden = _samples(data, p_wf, pose, unseen_contact(data))
    hidden = _samples_in_reach(hidden, scene, shape, guess, precision)
    push = _pushes(data, p_wf, pushing, hidden, step, before)
    corner, lift, rest = _ground(scene, shape, motion, step, first, pose, guess)
    return Window(
        shape=shape, motion=motion, finger=finger_of(scene), fingers=data.fingers,
        poses=int(pose[-1]) + 1, pose=pose, touch=touch, free=free,
        step=step, gap=_gaps(data, scene, pose, first),
        push=push, unfelt=push.where(data.valid & ~data.contact),
        unseen=push.where(~data.valid), corner=corner, lift=lift, rest=rest,
        frictionless=frictionless_contacts(scene) if choice.frictionless else (),
        sigma_position=precision.position, sigma_normal=precision.normal,
        normal_error=precision.normal_error, outlier_cost=outlier_cost(scene),
        sigma_edge=noise_at_edges(data, precision),
        braking=low_friction(scene) * scene.gravity,
        compliant=yields(scene, choice) and len(push) > 0,
        central=choice.central or scene.sigma_centre == 0.0, aligned=choice.aligned,
    )  # fmt: skip


def _samples(data, p_wf, pose, chosen) -> Samples:
    """Return the chosen samples (T, F)."""
    sample, finger = np.nonzero(chosen)
    return Samples(
        sample, finger, pose[sample], p_wf[sample, finger],
        data.finger_radius[finger], data.normal[sample, finger],
        late_gap(data)[sample, finger],
    )  # fmt: skip


def may_move(data, scene, first) -> np.ndarray:
    """Tell for every sample whether the object may have moved since the one before.

    It may while a finger touches it, and until friction with the ground has stopped it:
    v / (mu g) seconds after the last touch, at the speed v of the fastest finger.
    """
    contact = (possible_contact(data) | unseen_contact(data)).any(axis=1)
    if coasts(scene):
        return np.logical_or.accumulate(contact) & ~first
    speeds = np.linalg.norm(rate_of(data, data.finger_position), axis=2)
    speed = np.where(data.contact, speeds, 0.0).max(initial=0.0)
    slowed = low_friction(scene) * scene.gravity * intervals(data)  # [m/s] in a sample
    settle = np.ceil(np.minimum(speed / slowed, len(first)))  # samples
    now = np.arange(len(first))
    latest = np.maximum.accumulate(np.where(contact | first, now, 0))
    return contact[latest] & (now - latest <= settle) & ~first


def repeated_samples(data, first) -> np.ndarray:
    """Return for every sample its index, or that of the one which it repeats (T,).

    A sample that comes twice, a moment later, shares the pose of the first: as a time
    step of its own it would turn a micrometre into a large velocity.
    """
    late = np.diff(data.time, prepend=-np.inf) >= REPEATED * intervals(data)
    return np.maximum.accumulate(np.where(late | first, np.arange(len(first)), 0))


def coasts(scene) -> bool:
    """Tell whether nothing brakes the object: it floats, or lies on ice."""
    return scene.ground is None or scene.gravity == 0 or scene.friction_ground == 0


def guess_moves(x) -> np.ndarray:
    """Tell for every sample of x (6, T) whether the guess moves on the way to it."""
    way = np.abs(np.diff(x, axis=1, prepend=x[:, :1]))
    return (way[:3].max(axis=0) > MIN_MOVE) | (way[3:].max(axis=0) * ARM > MIN_MOVE)


def frictionless_contacts(scene) -> tuple[str, ...]:
    """Return the contacts whose friction is known to be zero."""
    of = {FINGER: scene.friction_finger, GROUND: scene.friction_ground}
    return tuple(name for name, mu in of.items() if mu == 0)


def _samples_in_reach(samples, scene, shape, guess, precision) -> Samples:
    """Return the samples near the guessed object; all of them without a guess."""
    if guess is None:
        return samples
    theta, x = guess
    centre = x[:2, samples.sample].T
    way = np.linalg.norm(samples.p_wf[:, :2] - centre, axis=1)
    away = way - shape.reach(theta) - samples.radius
    away -= scene.finger_length / 2
    return samples.pick(~(away > CLEARLY_FREE + 10 * precision.position))


def _steps(data, scene, pose, first, before, moving) -> Steps:
    """Return the steps that end at moving samples; an action starts at rest."""
    ends_step = moving & ~first
    if coasts(scene):  # its speed at the start of a later action is unknown
        ends_step &= ~first[before] | (data.action == data.action[0])
    samples = np.nonzero(ends_step)[0]
    one = before[samples]
    two = np.where(first[one], one, before[one])
    dt, dt_1 = data.time[samples] - data.time[one], data.time[one] - data.time[two]
    dt_1 = np.where((two == one) | np.isclose(dt_1, dt, EVEN_STEPS), dt, dt_1)
    unmoved = np.zeros((len(dt), 3))  # no motion is predicted
    return Steps(samples, pose[samples], pose[one], pose[two], dt, dt_1, unmoved)


def _gaps(data, scene, pose, first) -> Steps:
    """Return the gaps between actions, none where the object coasts.

    Before each is the last step of the action before: how fast the object still is.
    """
    start = np.zeros(0, int) if coasts(scene) else np.nonzero(first)[0][1:]
    last = start - 1
    early = np.maximum(last - 1, 0)
    early = np.where(data.action[early] == data.action[last], early, last)
    dt = np.where(
        early < last, data.time[last] - data.time[early], intervals(data)[last]
    )
    unmoved = np.zeros((len(dt), 3))
    return Steps(start, pose[start], pose[last], pose[early], dt, dt, unmoved)


def _pushes(data, p_wf, pushing, hidden, step, before) -> Pushes:
    """Return the contacts that may carry an impulse: of samples, of hidden samples.

    Hidden ones are taken to have the normals that their fingers felt last, or next.
    """
    index = np.full(len(data.time), -1)
    index[step.sample] = np.arange(len(step))
    s, f = (
        np.r_[getattr(pushing, name), getattr(hidden, name)]
        for name in ("sample", "finger")
    )
    n = last_felt_normal(data, hidden.sample, hidden.finger)
    tangent = np.vstack([_tangents(pushing.normal), _tangents(n)])
    tangent[len(pushing) :][~n.any(axis=1)] = 0, 0, 1  # most likely a side
    order = np.lexsort((f, s))
    order = order[index[s[order]] >= 0]
    s, f, tangent = s[order], f[order], tangent[order]
    r, now, then = before[s], p_wf[s, f], p_wf[before[s], f]
    return Pushes(s, f, index[s], r, now, then, data.finger_radius[f], tangent)


def _tangents(n) -> np.ndarray:
    """Return where t1 points (n, 3) at contacts of normals n (n, 3)."""
    side = np.cross([0.0, 0.0, 1.0], n)
    length = np.linalg.norm(side, axis=1, keepdims=True)
    sideways = (length > SIDE_NORMAL).ravel()[:, None]
    return np.where(sideways, side / np.maximum(length, SIDE_NORMAL), [1.0, 0.0, 0.0])


def _ground(scene, shape, motion, step, first, pose, guess):
    """Return the ground contacts of every step, those that lift, and the rests.

    An action starts at rest, where there is gravity.  The guess says which corners are
    low at every step.
    """
    none = Corners(np.zeros(0, int), np.zeros((0, 3)))
    if scene.ground is None:
        return none, none, Rests(none.step, none.signs)
    guess = guess if motion is FREE else None
    low = lowest_corners(shape, guess, step.sample)
    corner = Corners(np.repeat(np.arange(len(low)), low.shape[1]), low.reshape(-1, 3))
    if motion is PLANAR:
        return corner, none, Rests(none.step, none.signs)
    start = np.nonzero(first & (scene.gravity > 0))[0]
    low = lowest_corners(shape, guess, start)
    at = np.repeat(pose[start], low.shape[1])
    return corner, corner, Rests(at, low.reshape(-1, 3))


def lowest_corners(shape, guess, samples) -> np.ndarray:
    """Return the signs of the corners nearest the ground at `samples`, (n, corners, 3).

    guess: theta and x (6, T); without one the object lies flat on shape.corners.
    """
    low = np.array(shape.corners, float).reshape(-1, 3)
    if guess is None or not shape.mirrored:
        return np.tile(low, (len(samples), 1, 1))
    every = np.array([*dict.fromkeys(map(tuple, np.vstack([low, -low]).tolist()))])
    theta, x = guess
    body = [shape.corner(ca.DM(theta), ca.DM(signs)).toarray()[:, 0] for signs in every]
    up = Rotation.from_rotvec(x[3:, samples].T).as_matrix()[:, 2]
    order = np.argsort((up @ np.transpose(body)).round(9), axis=1, kind="stable")
    return every[np.sort(order[:, : len(low)], axis=1)]
