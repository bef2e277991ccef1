"""Rotor angle from encoders and pulses."""

import numpy as np
import pytest

from rotorid import InputError
from rotorid.signals.angle import (
    MeasuredAngle,
    encoder_angle,
    keyphasor_angle,
    pulse_edges,
)

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


def off(found: MeasuredAngle, angle: np.ndarray) -> np.ndarray:
    """Return the error of the angle, whole turns apart."""
    error = found.angle - angle
    return np.asarray(error - 2 * np.pi * np.round(error.mean() / (2 * np.pi)))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("angle", [STEADY, RAMP])
@pytest.mark.parametrize("sign", [1, -1])
def test_encoder_counts_leave_no_staircase(angle: np.ndarray, sign: int) -> None:
    """Either direction of rotation: half a line is 0.18 degrees, a hundredth of it is left."""
    found = encoder_angle(counts(sign * angle), RATE, per_revolution=1024, lines=1024)
    error = off(found, sign * angle)
    assert np.abs(error).max() < 0.02 * np.pi / 1024 + 3 * found.angle_std
    assert np.ptp(error) < 0.1 * np.pi / 1024
    assert np.sign(found.speed) == sign
    assert found.angle_std < 0.1 * np.pi / 1024


def test_what_a_speed_in_step_with_the_samples_leaves_open_is_stated() -> None:
    """Three turns in 200 samples: pulses fall at three places of a sample, a third of it apart."""
    rate, hz = 1e4, 150.0
    rises = np.floor((np.arange(1, 600) - 0.2837) / hz * rate) / rate
    half = np.full(len(rises), 0.5 / rate)
    found = keyphasor_angle(rises + half, 40000, rate, half=half)
    width = 2 * np.pi * hz / rate / 3
    assert found.angle_std == pytest.approx(width / np.sqrt(12), rel=0.06)


@pytest.mark.slow
def test_what_a_whole_number_of_samples_leaves_open_is_stated() -> None:
    """At 100 Hz and 5 kHz every edge falls at the same place between two samples."""
    time = np.arange(25_000) / 5000.0
    stated, errors = [], []
    for start in np.linspace(0.02, 1.0, 7):
        angle = start + 2 * np.pi * 100.0 * time
        logic = (angle % (2 * np.pi) < 0.6).astype(float)
        times, half = pulse_edges(logic, 5000.0)
        found = keyphasor_angle(times, len(time), 5000.0, half=half)
        errors.append(off(found, angle).mean())
        stated.append(found.angle_std)
    width = 2 * np.pi * 100.0 / 5000.0
    np.testing.assert_allclose(stated, width / np.sqrt(12), rtol=0.12)
    assert np.abs(errors).max() <= width / 2 * 1.01


@pytest.mark.slow
def test_a_slow_variation_of_the_speed_is_followed() -> None:
    """0.1 % at 0.5 Hz, 10 degrees a sample: the angle moves by 16 degrees."""
    time = np.arange(25_000) / 5000.0
    angle = 0.3 + SPEED * time + 1e-3 * SPEED / np.pi * np.sin(np.pi * time)
    logic = (angle % (2 * np.pi) < 0.6).astype(float)
    times, half = pulse_edges(logic, 5000.0)
    found = keyphasor_angle(times, len(time), 5000.0, half=half)
    error = off(found, angle)
    assert np.degrees(error.std()) < 0.25
    assert np.degrees(found.angle_std) < 0.6


@pytest.mark.slow
def test_lost_and_double_lines_are_set_right() -> None:
    total = np.floor(STEADY * 1024 / (2 * np.pi))
    total[5000:] -= 1
    total[12_000:] += 2
    found = encoder_angle(total % 1024, RATE, per_revolution=1024, lines=1024)
    assert (found.missing, found.extra) == (1, 2)
    assert np.abs(off(found, STEADY)).max() < 0.1 * np.pi / 1024


@pytest.mark.slow
def test_a_coarse_encoder_with_more_jitter_than_lines() -> None:
    jitter = np.radians(0.2) * np.random.default_rng(0).normal(size=len(TIME))
    found = encoder_angle(counts(STEADY + jitter, 8192), RATE, per_revolution=8192, lines=8192)
    assert found.jitter == pytest.approx(np.radians(0.2), rel=1.0)
    assert np.abs(off(found, STEADY)).max() < 4 * found.angle_std < np.radians(0.1)


@pytest.mark.slow
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
        (
            counts(np.where(TIME < 1, STEADY, 2 * (0.4 + SPEED) - STEADY)),
            r"turns around \d",
        ),
        (
            counts(np.where(TIME < 1.5, STEADY, 2 * (0.4 + 1.5 * SPEED) - STEADY)),
            r"turns around 1\.5\d* s after the first sample",
        ),
        (counts(34 * STEADY), "between two samples; expected well below half a revolution"),
        (np.where(TIME == 0.5, np.nan, counts(STEADY)), "nan in sample 5000"),
    ],
)
def test_bad_encoders_are_refused(readings: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        encoder_angle(readings, RATE, per_revolution=1024, lines=1024, source="run.h5")


@pytest.mark.slow
def test_one_line_of_flicker_is_no_turning_back() -> None:
    slow = 0.4 + 2 * np.pi * 0.3 * TIME
    jitter = 2 * np.pi / 1024 * 0.3 * np.random.default_rng(0).normal(size=len(TIME))
    found = encoder_angle(counts(slow + jitter), RATE, per_revolution=1024, lines=1024)
    assert found.speed == pytest.approx(2 * np.pi * 0.3, rel=1e-3)


def true_pulses(angle_at_zero: float = 0.4) -> np.ndarray:
    return (2 * np.pi * np.arange(1, 280) - angle_at_zero) / SPEED


def test_flanks_give_pulse_times_between_samples() -> None:
    times = true_pulses()
    found, half = pulse_edges(level(times, flank=3.0), RATE)
    np.testing.assert_allclose(found, times, atol=1e-12)
    assert not half.any()
    noisy = level(times, flank=3.0) + 0.01 * np.random.default_rng(0).normal(size=len(TIME))
    error = pulse_edges(noisy, RATE)[0] - times
    assert error.std() < 0.06 / RATE


def test_logic_levels_give_pulse_times_without_bias() -> None:
    times = true_pulses()
    logic = (level(times, flank=1e-6) > 0.5).astype(float)
    error = pulse_edges(logic, RATE)[0] - times
    assert np.abs(error).max() <= 0.5 / RATE + 1e-9
    assert abs(error.mean()) < 0.08 / RATE


def test_a_negative_going_column_is_no_fault() -> None:
    """The rising flank counts; the width of the mark then turns the angle, and nothing else."""
    times = true_pulses()
    found, _ = pulse_edges(3.0 - 5.0 * level(times, flank=3.0), RATE)
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
    assert found.speed == pytest.approx(SPEED + drift * TIME.mean(), rel=1e-6)


def without(times: np.ndarray, index: int | slice) -> np.ndarray:
    return np.delete(times, index)


@pytest.mark.parametrize(
    ("times", "missing", "extra"),
    [
        (without(true_pulses(), 100), 1, 0),
        (without(true_pulses(), slice(100, 104)), 4, 0),
        (without(true_pulses(), 1), 1, 0),
        (without(true_pulses(), -2), 1, 0),
        (np.sort(np.append(true_pulses(), [0.5, 1.2, 1.2001])), 0, 3),
        (np.sort(np.append(true_pulses()[1:], 0.001)), 0, 1),
    ],
)
def test_missing_and_double_pulses_are_understood(
    times: np.ndarray, missing: int, extra: int
) -> None:
    found = keyphasor_angle(times, len(TIME), RATE)
    assert (found.missing, found.extra) == (missing, extra)
    assert np.abs(off(found, STEADY)).max() < 1e-6


def test_pulses_without_a_rhythm_are_refused() -> None:
    times = np.sort(np.random.default_rng(0).uniform(0, 2, 200))
    with pytest.raises(InputError, match="pulses missing or too many, of 200"):
        keyphasor_angle(times, len(TIME), RATE, source="run.h5")
    with pytest.raises(InputError, match="3 pulses; expected four or more"):
        keyphasor_angle(true_pulses()[:3], len(TIME), RATE, source="run.h5")


@pytest.mark.parametrize("column", [np.zeros(100), np.zeros(0)])
def test_a_column_without_pulses_is_refused(column: np.ndarray) -> None:
    with pytest.raises(InputError, match="a column without a pulse"):
        pulse_edges(column, RATE)


@pytest.mark.slow
def test_lines_lost_until_the_next_index_leave_no_step():
    """Twenty of 1024 lines, put back within the revolution by the index."""
    rate, turns = 10e3, 150.0
    time = np.arange(20000) / rate
    lines = np.floor(1024 * turns * time)
    glitch = (time > 0.7) & (time < np.ceil(0.7 * turns) / turns + 1 / turns)
    counts = (lines - 20 * glitch) % 1024
    turned = encoder_angle(counts, rate, per_revolution=1024, lines=1024)
    wanted = 2 * np.pi * turns * time
    assert np.abs(turned.angle - wanted).max() < np.radians(0.2)
