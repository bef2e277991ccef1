"""Shifted samples against the shifted function."""

import numpy as np
import pytest

from rotorid.signals.spectrum import shifted

N = np.arange(400)


@pytest.mark.parametrize("steps", [0.5, -0.25, 3.7, -2.1, 2.0, -3.0, 0.0, 1e-12, -0.0001])
@pytest.mark.parametrize("frequency", [0.02, 0.1, 0.3, 0.4, 0.45])
def test_a_periodic_signal_is_shifted_to_its_ends(steps: float, frequency: float) -> None:
    wave = np.cos(2 * np.pi * frequency * N + 0.3)
    moved = np.cos(2 * np.pi * frequency * (N + steps) + 0.3)
    np.testing.assert_allclose(shifted(wave, steps, 100), moved, atol=3e-9)
    middle = slice(70, -70)
    if frequency < 0.4:  # what is not known beyond the ends is seen within 64 samples of them
        np.testing.assert_allclose(shifted(wave, steps)[middle], moved[middle], atol=3e-9)


@pytest.mark.parametrize("steps", [0.5, -3.2, 30.0])
@pytest.mark.parametrize("count", [2, 5, 17, 40])
def test_short_signals_keep_their_length(steps: float, count: int) -> None:
    assert len(shifted(np.arange(float(count)), steps)) == count
    np.testing.assert_allclose(shifted(np.ones(count), steps), 1.0)


def test_a_straight_line_stays_one_to_its_ends() -> None:
    line = 3.0 + 0.5 * N
    np.testing.assert_allclose(shifted(line, 0.4), line + 0.2)
