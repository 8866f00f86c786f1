"""Options of an estimate: what has no effect says so, and what is wrong is refused."""

import warnings
from dataclasses import replace

import pytest

from tactilenlp import Options, Reductions
from tactilenlp.errors import OptionError


@pytest.mark.parametrize("seed", [0, 7])
def test_a_seed_is_accepted_with_a_warning_that_it_has_no_effect(seed):
    with pytest.warns(FutureWarning, match="no effect"):
        options = Options(seed=seed)
    assert options.seed == seed


def test_options_without_a_seed_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Options().seed is None


def test_a_seed_that_is_no_number_is_refused():
    with pytest.raises(OptionError, match="seed"):
        Options(seed="zero")


def test_without_names_reductions_not_to_make():
    assert Options(without="planar").reductions == Reductions(planar=False)
    assert Options(without={"still"}).reductions == Reductions(still=False)
    assert Options(reduce=("planar",)).reductions == Reductions(planar=False)
    assert Options().reductions == Reductions()
    again = replace(Options(without=("far",)), starts=2)
    assert again.reductions == Reductions(far=False)


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
