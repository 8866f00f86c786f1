"""The gallery: every picture exists, is small, and stands below what made it."""

import re

import pytest
from conftest import ROOT

FOLDER = ROOT / "examples" / "gallery"
PAGE = (FOLDER.parent / "GALLERY.md").read_text(encoding="utf-8")
LARGEST = 150_000  # [bytes] of a picture
# The code, what follows it, up to the next code.
BLOCKS = re.findall(
    r"^```(?:sh|python)\n(.*?)^```\n(.*?)(?=^```|\Z)", PAGE, re.S | re.M
)
SHOWN = [
    pytest.param(code, picture, id=picture)
    for code, below in BLOCKS
    for picture in re.findall(r"!\[[^\]]+\]\(gallery/(\S+)\)", below)
]


@pytest.mark.parametrize(("code", "picture"), SHOWN)
def test_a_picture_is_small_and_its_command_exists_and_writes_it(code, picture):
    assert (FOLDER / picture).stat().st_size <= LARGEST
    scripts = re.findall(r"^python (\S+\.py)", code, re.M)
    for script in scripts:
        assert (ROOT / script).is_file(), script
    text = "".join([code, *((ROOT / s).read_text(encoding="utf-8") for s in scripts)])
    written = re.search(r"# \S+/(\w+\.png)", code)  # where it has another name
    assert f'"{picture}"' in text or (written and written[1] in text)


def test_all_pictures_are_shown_once_and_no_other():
    shown = [parameter.values[1] for parameter in SHOWN]
    assert sorted(shown) == sorted(path.name for path in FOLDER.iterdir())
    assert len(re.findall(r"!\[", PAGE)) == len(shown)


def test_every_example_has_a_picture():
    for example in FOLDER.parent.glob("0*.py"):
        assert f"python examples/{example.name}\n" in PAGE
