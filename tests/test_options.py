"""Options of an estimate: what has no effect says so, and what is wrong is refused."""

import warnings
from dataclasses import replace

import pytest

from tactilenlp import Options, Reductions
from tactilenlp.errors import OptionError
from tactilenlp.interface.request import checked_request


@pytest.mark.parametrize("seed", [0, 7])
def test_a_seed_is_accepted_with_a_warning_that_it_has_no_effect(seed):
    with pytest.warns(FutureWarning, match="no effect"):
        assert Options(seed=seed) == Options()


def test_options_without_a_seed_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Options().seed is None


def test_a_seed_that_is_no_number_is_refused():
    with pytest.raises(OptionError, match="seed"):
        Options(seed="zero")


def test_rivals_is_profile_likelihood_and_warns():
    with pytest.warns(FutureWarning, match="profile_likelihood"):
        options = Options(rivals=False)
    assert options == Options(profile_likelihood=False)
    assert not replace(options, starts=2).profile_likelihood


def test_without_names_reductions_not_to_make():
    assert Options(without="planar").reductions == Reductions(planar=False)
    assert Options(without={"still"}).reductions == Reductions(still=False)
    assert Options().without == ()
    assert Options().reductions == Reductions()
    again = replace(Options(without=("far",)), starts=2)
    assert again.reductions == Reductions(far=False)


@pytest.mark.parametrize(
    "reduce",
    [("planar", "far"), {"planar", "far"}, Reductions(planar=False, far=False)],
)
def test_reduce_is_without_and_warns(reduce):
    with pytest.warns(FutureWarning, match="without"):
        options = Options(reduce=reduce)
    assert options.reductions == Reductions(planar=False, far=False)
    assert replace(options, starts=2).reductions == options.reductions


def test_reduce_false_makes_no_reductions():
    with pytest.warns(FutureWarning, match="without"):
        options = Options(reduce=False)
    assert not any(vars(options.reductions).values())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"without": ("planar",), "reduce": ("still",)}, "leave reduce out"),
        ({"without": ("planar",), "reduce": False}, "leave reduce out"),
        ({"without": True}, "no names of reductions"),
        ({"without": "planer"}, "without.*planar"),
    ],
)
def test_wrong_choices_of_reductions_are_refused(given, words):
    with pytest.raises(OptionError, match=words):
        Options(**given)


def test_a_reduction_that_a_page_states_cannot_be_left_out_and_that_is_said(
    recorded, caplog
):
    """Its motion is flat by its equations, whatever is asked for."""
    _, scene, _ = recorded
    asked = {"formulation": "multiple_shooting", "options": Options(without="planar")}
    checked_request(scene, "cuboid", executor=None, **asked)
    assert "states planar" in caplog.text
