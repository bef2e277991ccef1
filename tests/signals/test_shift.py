"""Shifted samples against the shifted function."""

import numpy as np
import pytest

from rotorid.signals.shift import shifted

N = np.arange(400)


@pytest.mark.parametrize("steps", [0.5, -0.25, 3.7, -2.1, 2.0, -3.0, 0.0, 1e-12, -0.0001])
@pytest.mark.parametrize(("frequency", "accuracy"), [(0.02, 1e-13), (0.05, 1e-12), (0.1, 2e-9)])
def test_a_periodic_signal_is_shifted_to_its_ends(
    steps: float, frequency: float, accuracy: float
) -> None:
    wave = np.cos(2 * np.pi * frequency * N + 0.3)
    moved = np.cos(2 * np.pi * frequency * (N + steps) + 0.3)
    np.testing.assert_allclose(shifted(wave, steps, 100), moved, atol=accuracy)
    middle = slice(20, -20)
    np.testing.assert_allclose(shifted(wave, steps)[middle], moved[middle], atol=accuracy)


@pytest.mark.parametrize("steps", [0.5, -3.2, 30.0])
@pytest.mark.parametrize("count", [2, 5, 17, 40])
def test_short_signals_keep_their_length(steps: float, count: int) -> None:
    assert len(shifted(np.arange(float(count)), steps)) == count
    np.testing.assert_allclose(shifted(np.ones(count), steps), 1.0)


def test_a_straight_line_stays_one_to_its_ends() -> None:
    line = 3.0 + 0.5 * N
    np.testing.assert_allclose(shifted(line, 0.4), line + 0.2)
