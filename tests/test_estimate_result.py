"""Results are read only: a conversion in place would change what is saved later."""

import numpy as np
import pytest

from tactilenlp import Estimate


@pytest.mark.parametrize(
    "read",
    [
        lambda e: e.side_lengths,
        lambda e: e.position,
        lambda e: e.vertices,
        lambda e: e.impulses["finger 0"],
        lambda e: e.unknowns["x"],
    ],
)
def test_an_array_of_a_result_cannot_be_written(estimate, tmp_path, read):
    estimate.save(tmp_path / "estimate.npz")
    for result in (estimate, Estimate.load(tmp_path / "estimate.npz")):
        values = read(result)
        before = values.copy()
        with pytest.raises(ValueError, match="read-only"):
            values *= 1e3
        assert np.array_equal(read(result), before)
        assert (1e3 * values).flags.writeable  # a copy is the caller's
