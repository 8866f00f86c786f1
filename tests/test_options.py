"""Options of an estimate: what has no effect says so, and what is wrong is refused."""

import warnings

import pytest

from tactilenlp import Options
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
