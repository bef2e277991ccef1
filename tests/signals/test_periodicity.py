"""The period of a record, found from its samples alone."""

import numpy as np
import pytest
from scipy import signal

from rotorid.signals.period_search import find_period


def robot(rng: np.random.Generator, period: int = 2000, periods: int = 4) -> np.ndarray:
    """Return a trajectory of a robot: an approach, periods, a return; noise."""
    time = np.arange(period) / period
    one = sum(np.sin(2 * np.pi * k * time + k) / k for k in range(1, 6))
    approach = one[0] * (1 - np.cos(np.pi * np.arange(430) / 430)) / 2
    home = one[0] * (1 + np.cos(np.pi * np.arange(290) / 290)) / 2
    path = np.concatenate([np.zeros(300), approach, np.tile(one, periods), home, np.zeros(500)])
    return path + 0.02 * rng.normal(size=len(path))


def test_a_robot_that_goes_to_its_place_and_back() -> None:
    """10 s at 200 Hz, to a sample; ends that suggest a longer period do not matter."""
    for seed in range(5):
        found = find_period(robot(np.random.default_rng(seed)))
        assert found is not None
        assert abs(found.samples - 2000) < 1
        assert found.fundamental(200.0) == pytest.approx(0.1)


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("harmonics", [(1, 3, 5, 7, 9, 11), (1, 2), (3, 5), (7, 8, 9), (1,)])
def test_multisines(noise: float, harmonics: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    angle = 2 * np.pi * np.arange(250 * 60) / 250
    wave = sum(np.cos(k * angle + k * k) for k in harmonics)
    wave = wave / wave.std() + noise * rng.normal(size=len(wave))
    found = find_period(wave)
    assert found is not None
    assert found.samples == pytest.approx(250, abs=0.1)
    assert found.fundamental(5000.0) == 20.0
    assert found.correlation == pytest.approx(1 / (1 + noise**2), abs=0.1)


def test_three_long_periods_and_a_start() -> None:
    rng = np.random.default_rng(2)
    one = np.cumsum(rng.normal(size=624))
    one -= np.linspace(one[0], one[-1], 624)
    found = find_period(np.concatenate([one[:400] * np.linspace(0, 1, 400), np.tile(one, 3)]))
    assert found is not None
    assert found.samples == pytest.approx(624, abs=0.6)


def test_periods_of_no_whole_samples() -> None:
    found = find_period(np.sign(np.sin(2 * np.pi * np.arange(20000) / 333.3)))
    assert found is not None
    assert found.samples == pytest.approx(333.3, abs=found.accuracy)


def test_signals_without_period() -> None:
    rng = np.random.default_rng(9)
    time = np.arange(8000) / 1000
    for wave in (
        rng.normal(size=8000),
        np.sin(2 * np.pi * (1 + 10 * time) * time),
        np.linspace(0, 1, 8000),
        np.zeros(8000),
        np.ones(8),
    ):
        assert find_period(wave) is None


def test_what_rings_has_no_period() -> None:
    """A sweep through a resonance, and noise through one, are like themselves one wave later."""
    time = np.arange(20000) / 5000
    rng = np.random.default_rng(4)
    resonance = signal.iirpeak(57.0, 8.0, fs=5000.0)
    for drive in (signal.chirp(time, 10, 4, 300), rng.normal(size=20000)):
        assert find_period(signal.lfilter(*resonance, drive)) is None
