"""The recordings that are installed with the package, for examples and first steps."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from ..common.validation import check_one_of

RECORDINGS = ("cuboid", "polytope", "tosses")


def example_recording(name: str = "cuboid") -> Path:
    """Return the path of a recording in the simulator, an .npz file with its truth.

    "cuboid": two fingers touch a box in six actions; "polytope": an octahedron of
    22 mm radius in nine actions.  Load both by `Measurements.load` and `Scene.load`.
    "tosses": a cube tossed four times; load it by `Trajectories.load`.  Raises
    OptionError for another name.
    """
    check_one_of("name", name, RECORDINGS, "no such recording")
    return Path(str(files("tactilenlp.data") / "recordings" / f"{name}.npz"))
