"""Mistakes that anybody makes: each is refused, in words that name the remedy."""

import pytest
from mistakes_of_callers import CALLS, MEASUREMENTS, Known
from mistakes_of_editors import PAGES, SHAPES_AND_WORLDS

from tactilenlp.errors import TactileError

ALL = MEASUREMENTS | CALLS | PAGES | SHAPES_AND_WORLDS


@pytest.fixture(scope="module")
def known(recorded, touched):
    return Known(recorded[0], recorded[1], touched)


@pytest.mark.parametrize("name", ALL)
def test_the_remedy_of_a_common_mistake_is_named(name, known, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make, remedy = ALL[name]
    with pytest.raises(TactileError) as refused:
        make(known)
    assert remedy in str(refused.value)


def test_they_are_more_than_sixty():
    assert len(ALL) == sum(map(len, (MEASUREMENTS, CALLS, PAGES, SHAPES_AND_WORLDS)))
    assert len(ALL) >= 60
