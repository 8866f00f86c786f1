"""Options of an estimate: what has no effect says so, and what is wrong is refused."""

from dataclasses import replace

import pytest

from tactilenlp import Options, Reductions
from tactilenlp.errors import OptionError


@pytest.mark.parametrize("name", ["seed", "rivals"])
def test_an_option_of_an_older_version_is_refused_by_name(name):
    with pytest.raises(OptionError, match=f"profile_likelihood.*got {name}"):
        Options(**{name: False})


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
