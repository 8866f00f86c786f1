"""Checks before any solve: may a page explain a scene, was anything touched.

What a value may be by itself, its class checks (`Measurements`, `Scene`, `Options`);
what recordings are likely mistakes, data/mistakes.py.
"""

from __future__ import annotations

import pickle

from formulations.page_contract import contract_of

from ..data.contact_segments import consecutive_contacts
from ..errors import NoContactError, OptionError, SceneError
from ..problem.reductions import states_planar_motion


def check_page(page, shape, scene) -> None:
    """Raise where a page cannot explain a scene or a shape.

    SceneError for planar motion without a ground, and for offsets or a compliance of
    fingers that it does not have; OptionError for planar motion of a body that rolls.
    """
    contract, planar = contract_of(page), states_planar_motion(page)
    if planar and scene.ground is None:
        raise SceneError(
            "this page is of planar motion only", where="scene.ground", got="None",
            expected="a ground on which the object slides",
            next='use formulation="violation_implicit"',
        )  # fmt: skip
    if planar and shape.rolls:
        raise OptionError(
            "this page is of planar motion only", where="formulation",
            got=f"{shape.name}, which rolls", expected="a shape with a flat face",
            next='use formulation="violation_implicit" or "quasi_static"',
        )  # fmt: skip
    name = getattr(page, "__name__", page)
    if scene.sigma_offset is not None and not contract.offsets:
        raise SceneError(
            "this page takes measured finger positions as exact",
            where="scene.sigma_offset", got=f"an offset with {name!r}",
            expected="None",
            next='use "violation_implicit" or "quasi_static", of a shape with sizes',
        )  # fmt: skip
    if scene.compliance and "rigid" not in contract.freed:
        raise SceneError(
            "this page is of rigid fingertips", where="scene.compliance",
            got=f"{scene.compliance} m/N with {name!r}", expected="None or 0",
            next='use "violation_implicit", or name "rigid" in FREED of a page with it',
        )  # fmt: skip


def check_round_fingertips(scene) -> None:
    """Raise SceneError unless the fingertips are round."""
    if scene.finger_length > 0:
        raise SceneError(
            "a polytope is estimated with round fingertips only",
            where="finger_length", got=scene.finger_length, expected="0",
        )  # fmt: skip


def check_executor(executor, shape) -> None:
    """Raise OptionError unless it is an Executor, and can be sent the shape."""
    if executor is None:
        return
    if isinstance(executor, type) or not callable(getattr(executor, "submit", None)):
        raise OptionError(
            "no executor", where="executor", got=repr(executor)[:80],
            expected="one of concurrent.futures, such as ProcessPoolExecutor(2)",
        )  # fmt: skip
    try:
        pickle.dumps(shape)
    except (pickle.PicklingError, AttributeError, TypeError) as bad:
        raise OptionError(
            "other processes cannot be sent this shape", where="shape",
            got=f"{shape.name}: {bad}", expected="functions that `import` finds",
            next="define them in a file of their own, or leave executor out",
        ) from bad  # fmt: skip


def check_touched(data) -> None:
    """Raise NoContactError unless a finger felt contact for two samples in a row.

    A single sample cannot be told from a flipped boolean.
    """
    if consecutive_contacts(data).any():
        return
    single = int(data.contact.sum())
    if single:
        what = "no touch lasts: those of one sample are not used, as flipped booleans"
        fix = "press for longer, or record at a higher rate"
    else:
        what, fix = "nothing was touched", "record an action that meets the object"
    raise NoContactError(
        what, where="contact", got=f"{single} single samples" if single else "none",
        expected="a finger in contact for at least two samples in a row", next=fix,
    )  # fmt: skip
