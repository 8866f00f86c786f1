"""Which error makes sigma what it is: names, and squares that add up to sigma's."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formulations import names
from tactilenlp import Estimate, Options, solve_estimate
from tactilenlp.errors import OptionError
from tactilenlp.information import error_budget
from tactilenlp.information.error_budget import OF_PRIORS, POOR_FIT
from tactilenlp.information.information import Information

DOCUMENTED = {*re.findall(r"^    ([a-z].*?)  ", error_budget.__doc__, re.M)}


def check_budget(information):
    """Check the budget of every quantity: names, order, and the sum of squares."""
    assert {*information.budget} <= DOCUMENTED
    for name in [*information.maps, None]:
        errors = information.error_budget(name)
        variance = np.diag(information.covariance(name))
        squares = sum(sigma**2 for sigma in errors.values())
        if errors:
            np.testing.assert_allclose(squares, variance, rtol=1e-9, atol=1e-18)
        if name is not None:
            sizes = [np.nansum(sigma**2) for sigma in errors.values()]
            assert sizes == sorted(sizes, reverse=True)


def test_every_documented_name_is_that_of_an_error():
    folder = Path(error_budget.__file__).parent
    files = [Path(names.__file__), *folder.glob("*.py")]
    code = "".join(file.read_text(encoding="utf-8") for file in files)
    assert len(DOCUMENTED) == 25
    assert all(f'"{name}"' in code for name in DOCUMENTED)


def test_squares_of_a_box_add_up_to_those_of_sigma(estimate, touched):
    for each in (estimate, touched):
        check_budget(each.information)
        assert POOR_FIT not in each.information.budget
    # Side x was not pushed from both sides: only the prior, and its tails, tell it.
    by_name = touched.information.error_budget("side_lengths")
    known = by_name[OF_PRIORS][0], by_name["profile likelihood"][0]
    assert np.hypot(*known) > 0.99 * touched.information.sigma("side_lengths")[0]


def test_what_a_poor_fit_adds_is_named_and_the_other_errors_stay(touched):
    before, wide = touched.information, touched.information.widened(2.0)
    check_budget(wide)
    check_budget(wide.widened(1.5))
    for name in ("side_lengths", "position", "rotation"):
        told, others = wide.error_budget(name), before.error_budget(name)
        more = told.pop(POOR_FIT)
        np.testing.assert_allclose(more, 3**0.5 * before.sigma(name))
        assert told.keys() == others.keys()
        for error, sigma in told.items():
            np.testing.assert_allclose(sigma, others[error], rtol=1e-9, atol=1e-12)


def test_a_budget_survives_a_file_and_files_from_before_have_none(touched, tmp_path):
    touched.save(tmp_path / "estimate.npz")
    again = Estimate.load(tmp_path / "estimate.npz")
    assert again == touched
    check_budget(again.information)
    with np.load(tmp_path / "estimate.npz") as file:
        arrays = {name: file[name] for name in file.files if "/budget/" not in name}
    header = json.loads(str(arrays.pop("header")))
    del header["content"]["fields"]["information"]["fields"]["budget"]
    np.savez(tmp_path / "old.npz", header=np.array(json.dumps(header)), **arrays)
    old = Estimate.load(tmp_path / "old.npz")
    assert np.array_equal(
        old.information.covariance_matrix, touched.information.covariance_matrix
    )
    assert old.information.widened(2.0).budget == {}
    with pytest.raises(OptionError, match="no error budget"):
        old.information.error_budget("position")


def test_covariances_of_a_file_from_before_count_by_their_variances(touched):
    spread = touched.information.covariance_matrix
    shares = {"physics": 0.3 * spread, "priors": 0.7 * spread}
    fields = vars(touched.information) | {"budget": shares}
    before = Information.from_file(**fields)
    assert {error.ndim for error in before.budget.values()} == {1}
    assert shares["priors"].ndim == 2  # what was given stays as it was
    check_budget(before)
    priors, sigma = (
        before.error_budget("side_lengths")["priors"],
        touched.information.sigma("side_lengths"),
    )
    np.testing.assert_allclose(priors, 0.7**0.5 * sigma)


def test_what_has_no_budget_is_refused_by_name(estimate):
    information = estimate.information
    with pytest.raises(OptionError, match="side_lengths"):
        information.error_budget("side_length")
    with pytest.raises(OptionError, match="name"):
        information.error_budget(3)
    with pytest.raises(OptionError, match="no error budget"):
        information.of_hessian().error_budget("position")
    offsets = replace(information, offsets=np.eye(6))
    with pytest.raises(OptionError, match="no error budget"):
        offsets.error_budget("finger_offset")


@pytest.mark.slow
def test_squares_of_a_hull_add_up_to_those_of_sigma(recorded):
    data, scene, _ = recorded
    hull = solve_estimate(data.select(range(2)), scene, shape="polytope")
    check_budget(hull.information)
    assert {"active bounds", "prior of a hull"} <= {*hull.information.budget}


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["cuboid", "cylinder"])
def test_squares_of_a_poor_fit_add_up_to_those_of_sigma(recorded, shape):
    data, scene, _ = recorded
    data = data.select(range(2))
    off = data.finger_position.copy()
    off[data.action == 1, 0] += [0.0, 0.0, 0.02]
    wrong = replace(data, finger_position=off)
    lean = Options(
        check_mistakes=False, hypotheses=1, starts=1, profile_likelihood=False
    )
    poor = solve_estimate(wrong, scene, shape=shape, options=lean, throw=False)
    assert poor.fit.widening > 1
    check_budget(poor.information)
    assert next(iter(poor.information.error_budget("position"))) == POOR_FIT
