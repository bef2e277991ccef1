"""Rotor angle from encoders and pulses."""

import numpy as np
import pytest

from rotorid.errors import InputError
from rotorid.signals.angle import encoder_angle, keyphasor_angle, pulse_times

RATE = 10_000.0
TIME = np.arange(20_000) / RATE
SPEED, DRIFT = 2 * np.pi * 140.0, 3.0
STEADY = 0.4 + SPEED * TIME
RAMP = STEADY + DRIFT * TIME**2 / 2


def counts(angle: np.ndarray, lines: int = 1024) -> np.ndarray:
    return np.floor(angle * lines / (2 * np.pi)) % lines


def level(times: np.ndarray, width: float = 1e-3, flank: float = 1.0) -> np.ndarray:
    """Pulses that rise at given times, with flanks of so many samples on each side."""
    edge = flank / RATE
    knots = np.stack([times - edge, times + edge, times + width - edge, times + width + edge], 1)
    return np.interp(TIME, knots.ravel(), np.tile([0.0, 1.0, 1.0, 0.0], len(times)))


@pytest.mark.parametrize("angle", [STEADY, RAMP])
def test_encoder_counts_give_the_angle_within_a_line(angle: np.ndarray) -> None:
    found = encoder_angle(counts(angle), RATE, per_revolution=1024, lines=1024)
    error = found.angle - angle
    assert np.abs(error).max() <= np.pi / 1024 + 1e-9
    assert abs(error.mean()) < 0.02 * 2 * np.pi / 1024
    assert found.scatter == pytest.approx(2 * np.pi / 1024 / np.sqrt(12), rel=0.1)


def test_encoder_speed_and_drift() -> None:
    found = encoder_angle(counts(RAMP), RATE, per_revolution=1024, lines=1024)
    assert found.speed == pytest.approx(SPEED + DRIFT * TIME.mean(), rel=1e-6)
    assert found.drift == pytest.approx(DRIFT, rel=1e-2)


@pytest.mark.parametrize(("scale", "turn"), [(1.0, 2 * np.pi), (180 / np.pi, 360.0)])
def test_an_angle_column_is_unwrapped(scale: float, turn: float) -> None:
    wrapped = (STEADY * scale) % turn
    found = encoder_angle(wrapped, RATE, per_revolution=turn)
    np.testing.assert_allclose(found.angle, STEADY, atol=1e-9)


@pytest.mark.parametrize(
    ("readings", "message"),
    [
        (counts(-STEADY), r"an encoder that runs backwards \(-140 revolutions/s\)"),
        (
            counts(np.where(TIME < 1, STEADY, 2 * (0.4 + SPEED) - STEADY)),
            r"backwards 1.0\d* s after|backwards \(",
        ),
        (
            counts(np.where(TIME < 1.5, STEADY, 2 * (0.4 + 1.5 * SPEED) - STEADY)),
            r"backwards 1\.5\d* s after the first sample",
        ),
        (counts(34 * STEADY), "between two samples; expected well below half a revolution"),
        (np.where(TIME == 0.5, np.nan, counts(STEADY)), "nan in sample 5000"),
    ],
)
def test_bad_encoders_are_refused(readings: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        encoder_angle(readings, RATE, per_revolution=1024, lines=1024, source="run.h5")


def test_one_line_of_flicker_is_no_turning_back() -> None:
    slow = 0.4 + 2 * np.pi * 0.3 * TIME
    jitter = 2 * np.pi / 1024 * 0.3 * np.random.default_rng(0).normal(size=len(TIME))
    found = encoder_angle(counts(slow + jitter), RATE, per_revolution=1024, lines=1024)
    assert found.speed == pytest.approx(2 * np.pi * 0.3, rel=1e-3)


def true_pulses(angle_at_zero: float = 0.4) -> np.ndarray:
    return (2 * np.pi * np.arange(1, 280) - angle_at_zero) / SPEED


def test_flanks_give_pulse_times_between_samples() -> None:
    times = true_pulses()
    np.testing.assert_allclose(pulse_times(level(times), RATE), times, atol=1e-12)
    noisy = level(times) + 0.01 * np.random.default_rng(0).normal(size=len(TIME))
    error = pulse_times(noisy, RATE) - times
    assert error.std() < 0.03 / RATE


def test_logic_levels_give_pulse_times_without_bias() -> None:
    times = true_pulses()
    logic = (level(times, flank=1e-6) > 0.5).astype(float)
    error = pulse_times(logic, RATE) - times
    assert np.abs(error).max() <= 0.5 / RATE + 1e-9
    assert abs(error.mean()) < 0.08 / RATE


def test_a_negative_going_column_is_no_fault() -> None:
    """The rising flank counts; the width of the mark then turns the angle, and nothing else."""
    times = true_pulses()
    found = pulse_times(3.0 - 5.0 * level(times), RATE)
    np.testing.assert_allclose(np.diff(found), np.diff(times[: len(found)]), atol=1e-12)


@pytest.mark.parametrize("drift", [0.0, DRIFT])
def test_keyphasor_angle(drift: float) -> None:
    angle = STEADY + drift * TIME**2 / 2
    turns = np.arange(1, int(angle[-1] / (2 * np.pi)) + 1)
    rest = 2 * np.pi * turns - 0.4
    times = 2 * rest / (SPEED + np.sqrt(SPEED**2 + 2 * drift * rest))
    found = keyphasor_angle(times, len(TIME), RATE)
    offset = found.angle - angle
    assert np.ptp(offset) < 1e-6 if drift == 0 else np.ptp(offset) < 1e-4
    assert np.exp(1j * offset).mean() == pytest.approx(1.0, abs=2e-4)
    assert found.drift == pytest.approx(drift, abs=1e-3)
    assert found.speed == pytest.approx(SPEED + drift * np.mean([times[0], times[-1]]), rel=1e-6)


def without(times: np.ndarray, index: int) -> np.ndarray:
    return np.delete(times, index)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (
            without(true_pulses(), 100),
            r"a missing pulse between 0\.713\d* s and 0\.728\d* s, 1 such",
        ),
        (without(true_pulses(), 1), "a missing pulse between"),
        (without(true_pulses(), -2), "a missing pulse between"),
        (np.sort(np.append(true_pulses(), 0.5)), "a pulse too many between"),
        (true_pulses()[:3], "3 pulses; expected four or more"),
    ],
)
def test_bad_pulses_are_refused(times: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        keyphasor_angle(times, len(TIME), RATE, source="run.h5")


@pytest.mark.parametrize("column", [np.zeros(100), np.zeros(0)])
def test_a_column_without_pulses_is_refused(column: np.ndarray) -> None:
    with pytest.raises(InputError, match="a column without a pulse"):
        pulse_times(column, RATE)
