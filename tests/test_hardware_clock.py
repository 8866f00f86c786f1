"""Clocks of devices: drift and delay are told apart, counters wrap."""

import time

import numpy as np
import pytest

from hardware.clock import ClockMap, HostClock, unwrap
from hardware.errors import ClockError

FLOOR = 0.5e-3  # [s], the least delay of the transport: nobody can observe it


def record(rate, seconds=8.0, drift=80e-6, seed=0):
    """Return device times, arrivals at the host [s] and the true times [s]."""
    rng = np.random.default_rng(seed)
    device = np.arange(int(rate * seconds)) / rate
    true = 1.7e9 + device * (1 + drift)
    late = rng.exponential(2e-3, len(device))
    late += (rng.random(len(device)) < 0.02) * rng.uniform(0, 30e-3, len(device))
    return device, true + FLOOR + late, true


@pytest.mark.parametrize("rate", [30, 100, 333, 1000])
def test_the_clock_of_a_drifting_device_is_found_within_a_millisecond(rate):
    device, host, true = record(rate)
    error = ClockMap.fit(device, host)(device) - true
    assert np.abs(error).max() < 1e-3
    assert error.min() > 0  # the floor stays in it


def test_least_squares_would_be_pulled_up_by_the_late_ones():
    device, host, true = record(30)
    line = np.polyval(np.polyfit(device, host - host[0], 1), device) + host[0]
    ours = np.abs(ClockMap.fit(device, host)(device) - true).max()
    assert np.abs(line - true).max() > 2 * ours


def test_stamps_in_microseconds_are_mapped_with_their_unit():
    device, host, true = record(100)
    fitted = ClockMap.fit(1e6 * device, host, unit=1e-6)
    assert np.abs(fitted(1e6 * device) - true).max() < 1e-3
    assert fitted.rate == pytest.approx(1e-6, rel=1e-3)
    with pytest.raises(ClockError, match="does not run with the host's"):
        ClockMap.fit(1e6 * device, host)


def test_the_residual_is_the_jitter_of_the_transport():
    device, host, _ = record(1000)
    # the median of an exponential with a mean of 2 ms is 1.4 ms
    assert ClockMap.fit(device, host).residual == pytest.approx(1.4e-3, rel=0.15)


def test_clocks_that_stand_or_run_backwards_are_refused():
    device, host, _ = record(30)
    with pytest.raises(ClockError, match="do not increase"):
        ClockMap.fit(np.r_[device[:50], device[49:-1]], host)
    with pytest.raises(ClockError, match="no pairs"):
        ClockMap.fit(device, host[:-1])
    with pytest.raises(ClockError, match="no pairs"):
        ClockMap.fit(device[:1], host[:1])


def test_a_counter_goes_on_where_it_wraps_and_shows_its_gaps():
    counts = 65530 + np.cumsum([0, 1, 1, 1, 3, 1, 1, 1, 1, 2000, 1])
    assert np.array_equal(unwrap(counts % 65536, 16), counts)
    assert unwrap(np.array([], int), 16).size == 0
    with pytest.raises(ClockError, match="16 unsigned bits"):
        unwrap([70000], 16)


def test_the_host_clock_is_the_time_of_day():
    clock = HostClock()
    before = clock.now()
    clock.sleep(0.01)
    assert 0.009 < clock.now() - before < 1.0
    assert clock.now() == pytest.approx(time.time(), abs=0.1)
    clock.sleep(-1.0)  # what is late need not wait
