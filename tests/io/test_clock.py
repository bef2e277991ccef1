"""Sample times: even, rounded, jittered, late, missing."""

from pathlib import Path

import numpy as np
import pytest

import rotorid as rid
from rotorid import ReadError
from rotorid.io.clock import (
    BEARABLE,
    EARLY,
    LATE,
    NEGLIGIBLE,
    SAME_RATE,
    error_as_they_are,
    interpolation_error,
    onto_grid,
    read_clock,
)

RNG = np.random.default_rng(11)
EVEN = np.arange(4000) / 1000.0
JITTER = EVEN + np.r_[0.0, RNG.uniform(-2e-4, 2e-4, 3998), 0.0]


def wave(time: np.ndarray, frequency: float = 20.0) -> np.ndarray:
    return np.cos(2 * np.pi * frequency * time + 0.3)


def write(path: Path, time: np.ndarray, *columns: np.ndarray, names: str = "t,x") -> Path:
    table = np.column_stack([time, *columns])
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.12g")
    return path


def test_even_and_rounded_times_are_left_alone() -> None:
    for time in (EVEN, np.round(np.arange(4000) / 400.0, 3), 1.7e9 + EVEN, EVEN + 1e-9 * JITTER):
        clock = read_clock(time)
        assert clock.even
    assert read_clock(np.round(np.arange(4001) / 400.0, 3)).rate.hertz == pytest.approx(400.0)
    assert not read_clock(JITTER).even


def test_times_whose_error_does_not_tell_are_left_alone(tmp_path: Path) -> None:
    """What the samples of a wave are off, taken as they are, is at most a ten-thousandth."""
    step, few = 1e-3, NEGLIGIBLE * 1e-3 / np.pi
    for size, even in ((0.9 * few, True), (1.2 * few, False)):
        jitter = size * np.where(np.arange(4000) % 2, 1.0, -1.0)
        assert read_clock(EVEN + jitter).even == even
        near = wave(EVEN + jitter, 499.0) - wave(EVEN, 499.0)
        assert np.abs(near).max() == pytest.approx(2 * np.pi * 499 * size, rel=0.01)
    assert pytest.approx(1e-4) == np.pi * few / step  # at half the sample rate
    for size, told in ((0.9, 0), (1.1, 1)):
        furthest = size * NEGLIGIBLE / (2 * np.pi * 20.0)
        jitter = furthest * np.r_[0.0, np.tile([1.0, -1.0], 1999), 0.0]
        assert error_as_they_are(EVEN + jitter, 1000.0, 20.0) == pytest.approx(size * NEGLIGIBLE)
        path = write(tmp_path / "run.csv", EVEN + jitter, wave(EVEN))
        record = rid.read_record(path, columns=["x"], time="t", highest=20.0)
        assert len(record.warnings) == told
        assert (np.abs(record.column("x") - wave(EVEN)).max() < 1e-11) == (told == 0)
        assert len(rid.read_record(path, columns=["x"], time="t").warnings) == 1


def test_jittered_samples_come_onto_the_grid(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", JITTER, wave(JITTER))
    record = rid.read_record(path, columns=["x"], time="t", highest="20 Hz")
    assert np.abs(record.column("x") - wave(EVEN)).max() < 1e-6
    as_if_even = rid.read_record(path, columns=["x"], sample_rate=1000.0)
    assert np.abs(as_if_even.column("x") - wave(EVEN)).max() > 0.02
    (told,) = record.warnings
    assert "jitter by 0.00011 s (rms): samples interpolated to 1000 Hz" in told
    assert "at 20 Hz" in told


def test_the_stated_error_is_the_error() -> None:
    """Also where it is large: two fifths of the sample rate."""
    for frequency in (100.0, 250.0, 400.0):
        found, error, _ = onto_grid(JITTER, wave(JITTER, frequency)[:, None], 1000.0, frequency)
        actual = np.sqrt(2 * np.mean((found[:, 0] - wave(EVEN, frequency)) ** 2))
        assert error == pytest.approx(actual, rel=0.25, abs=1e-10)


def test_where_the_lines_cannot_bear_it(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", JITTER, wave(JITTER))
    with pytest.raises(ReadError, match=r"off by 0.000114 s.*% at 480 Hz.*keep lines"):
        rid.read_record(path, columns=["x"], time="t", highest=480.0)
    (told,) = rid.read_record(path, columns=["x"], time="t").warnings
    highest = float(told.partition(" at ")[2].partition(" Hz")[0])
    assert 100 < highest < 400
    grid = np.arange(4000) / 1000.0
    assert interpolation_error(JITTER, grid, highest) <= BEARABLE
    assert interpolation_error(JITTER, grid, 1.3 * highest) > BEARABLE


def test_one_late_sample(tmp_path: Path) -> None:
    """A clock that stands for half a step, once: what follows is later by that much."""
    late = EVEN + 5e-4 * (EVEN > 1.7)
    path = write(tmp_path / "run.csv", late, wave(late))
    record = rid.read_record(path, columns=["x"], time="t", highest=20.0)
    grid = np.arange(len(record.samples)) / record.sample_rate
    assert np.abs(record.column("x") - wave(grid)).max() < 1e-5
    assert len(record.warnings) == 1


def test_a_missing_sample_is_told_with_the_longest_stretch(tmp_path: Path) -> None:
    time = np.delete(EVEN, [500, 3000])
    path = write(tmp_path / "run.csv", time, wave(time))
    with pytest.raises(
        ReadError, match=r"a step of 0.002 s after sample 499 \(t = 0.499 s\), 2 such"
    ) as caught:
        rid.read_record(path, columns=["x"], time="t")
    assert 'skip = "0.501 s" and until = "2.9995 s"' in caught.value.cure
    first = rid.read_record(path, columns=["x"], time="t", until="0.4995 s")
    assert len(first.samples) == 500
    stretch = {"skip": "0.501 s", "until": "2.9995 s"}
    middle = rid.read_record(path, columns=["x"], time="t", speed=10.0, phase=0.5, **stretch)
    assert (middle.start, len(middle.samples)) == (pytest.approx(0.501), 2499)
    np.testing.assert_allclose(middle.rotor_angle(), 0.5 + 10 * time[499 + 1 : 2999], rtol=1e-12)
    periods = rid.average(middle, 20.0, harmonics=[1], skip=0.75)
    assert periods.time[0, 0] == pytest.approx(0.75)
    np.testing.assert_allclose(periods.angle, 0.5 + 10 * periods.time)


def test_between_late_and_missing() -> None:
    for step, taken in (
        (LATE - 0.01, True),
        (LATE + 0.01, False),
        (EARLY + 0.01, True),
        (EARLY - 0.01, False),
    ):
        time = np.cumsum(np.r_[0.0, np.ones(50), step, np.ones(50)])
        if taken:
            assert not read_clock(time).even
        else:
            with pytest.raises(ReadError, match="no dropped samples"):
                read_clock(time)


def test_two_statements_of_the_rate(tmp_path: Path) -> None:
    path = write(tmp_path / "run.csv", np.arange(10**4) / 1000.0, np.ones(10**4))
    near, far = 1000 * (1 + 0.9 * SAME_RATE), 1000 * (1 + 2.2 * SAME_RATE)
    assert rid.read_record(path, time="t", sample_rate=near).sample_rate == near
    with pytest.raises(rid.InputError, match=r"where the time column says 1000 Hz"):
        rid.read_record(path, time="t", sample_rate=far)


def test_a_rate_of_few_digits_fits_the_period(tmp_path: Path) -> None:
    """Times in whole milliseconds at 2.5 ms end within a digit of the truth, not on it."""
    time = np.round(np.arange(4000) / 400.0, 3)
    path = write(tmp_path / "run.csv", time, wave(time))
    assert rid.read_record(path, time="t").sample_rate != 400.0
    assert rid.read_record(path, time="t", fundamental="20 Hz").sample_rate == 400.0
    odd = rid.read_record(path, time="t", fundamental="19.3 Hz").sample_rate
    assert odd == rid.read_record(path, time="t").sample_rate


def test_what_is_no_number_before_skip_does_no_harm(tmp_path: Path) -> None:
    values = wave(EVEN)
    values[:30] = np.nan
    path = write(tmp_path / "run.csv", EVEN, values)
    for clock in ({"time": "t"}, {"sample_rate": 1000.0}):
        record = rid.read_record(path, columns=["x"], skip="0.1 s", speed=7.0, **clock)
        assert record.start == pytest.approx(0.1)
        np.testing.assert_allclose(record.column("x"), values[100:], atol=1e-11)
        np.testing.assert_allclose(record.rotor_angle(), 7 * EVEN[100:])
        with pytest.raises(rid.InputError, match="found nan in sample"):
            rid.read_record(path, columns=["x"], skip="0.02 s", **clock)
