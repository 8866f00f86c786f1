"""Successive samples of a finger."""

from types import SimpleNamespace

import numpy as np

from tactilenlp.data.contact_segments import rate_of


def test_a_rate_across_a_dropped_sample_is_over_the_time_that_passed():
    time = np.array([0.0, 0.1, 0.3, 0.4, 0.401, 5.0, 5.1])
    data = SimpleNamespace(time=time, dt=0.1, action=np.array([0] * 5 + [1, 1]))
    place = 0.2 * time[:, None, None] * np.ones((7, 2, 3))
    rate = rate_of(data, place)
    np.testing.assert_allclose(rate[[1, 2, 3, 6]], 0.2)
    assert not rate[[0, 4, 5]].any()  # actions begin, and a sample comes twice
