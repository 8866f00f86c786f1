"""Times of an OptoForce by its counters: restarts, pauses and wrong rates."""

import numpy as np
import pytest

from hardware.errors import ClockError
from hardware.recording import device_times
from hardware.serial_tactile import ForceFrame


def counted(counters, times):
    """Return frames without force that came at times (N,) [s]."""
    pairs = zip(times.tolist(), map(int, counters), strict=True)
    return [(t, ForceFrame(counter, 0, (0, 0, 0))) for t, counter in pairs]


def test_counters_give_the_times_that_arrivals_blur():
    rng = np.random.default_rng(0)
    true = 1.7e9 + 1.00005 * np.arange(3000) / 1000
    arrival = true[np.minimum((np.arange(3000) // 16 + 1) * 16 - 1, 2999)]
    late = arrival + rng.exponential(2e-4, 3000)
    late = np.maximum.accumulate(late)
    frames = counted((65000 + np.arange(3000)) % 65536, late)
    times = device_times(frames, 1e-3)
    assert np.abs(times - true).max() < 2e-3
    assert np.abs(np.diff(times) - 1.00005e-3).max() < 1e-6
    assert np.abs(late - true).max() > 0.01


def test_a_sensor_that_was_switched_on_again_has_a_new_clock():
    counters = [*range(5000, 5500), *range(0, 500)]
    true = 1.7e9 + np.r_[np.arange(500), 900 + np.arange(500)] / 100
    frames = counted(counters, true)
    assert np.abs(device_times(frames, 0.01) - true).max() < 1e-3


@pytest.mark.parametrize("count", [600, 10_000])
@pytest.mark.parametrize("last", [30_000, 45_000, 65_000])
def test_a_sensor_that_was_unplugged_has_a_new_clock_whatever_it_had_counted(
    count, last
):
    """Beyond half its range a counter that starts at 0 seems to go forward."""
    counters = [*range(last - count, last), *range(count)]
    outage = 1.0
    true = 1.7e9 + np.arange(2 * count) / 1000 + np.repeat([0.0, outage], count)
    frames = counted(counters, true)
    assert np.abs(device_times(frames, 1e-3) - true).max() < 1e-3


@pytest.mark.parametrize("count", [100, 1000])
def test_a_sensor_that_sends_at_another_rate_than_told_is_named(count):
    """An OptoForce on CAN is not told its speed: 100 Hz by default."""
    frames = counted(range(count), 1.7e9 + np.arange(count) / 100)
    with pytest.raises(ClockError, match=r"tactile\.speed.*0\.001 s, got 0\.01 s"):
        device_times(frames, 1e-3)


@pytest.mark.parametrize("seconds", [0.8, 1.9, 4.0])
@pytest.mark.parametrize("drift", [5e-4, 2e-3, -0.015])
def test_an_oscillator_that_is_off_is_mapped(drift, seconds):
    count = round(1000 * seconds)
    true = 1.7e9 + np.arange(count) / 1000 * (1 + drift)
    arrival = true[np.minimum((np.arange(count) // 16 + 1) * 16 - 1, count - 1)]
    frames = counted(range(count), arrival)
    assert np.abs(device_times(frames, 1e-3) - true).max() < 2e-3


@pytest.mark.parametrize("seconds", [0.8, 1.9, 4.0])
@pytest.mark.parametrize("drift", [0.03, -0.09])
def test_a_rate_that_no_oscillator_has_is_refused_however_short(drift, seconds):
    true = 1.7e9 + np.arange(round(1000 * seconds)) / 1000 * (1 + drift)
    with pytest.raises(ClockError, match=r"tactile\.speed"):
        device_times(counted(range(len(true)), true), 1e-3)


def test_a_counter_that_wrapped_unheard_keeps_the_time():
    counters = [*range(20_000), *(k % 65536 for k in range(90_000, 100_000))]
    true = 1.7e9 + np.r_[np.arange(20_000), np.arange(90_000, 100_000)] / 1000
    frames = counted(counters, true)
    assert np.abs(device_times(frames, 1e-3) - true).max() < 1e-3


@pytest.mark.parametrize("after", [10, 500, 5000])
@pytest.mark.parametrize("chunk", [256, 4096])
def test_a_pause_of_the_host_is_no_other_rate(after, chunk):
    """All samples of a second are read when it goes on, in chunks, 1 ms apart."""
    true = 1.7e9 + np.arange(1500 + after) / 1000
    arrival = true.copy()
    arrival[500:1500] = true[1500] + np.arange(1000) // chunk * 1e-3 - 4e-3
    frames = counted(range(len(arrival)), arrival)
    assert np.abs(device_times(frames, 1e-3) - true).max() < 5e-3
