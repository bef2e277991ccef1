"""What is seen of a record at once, and where signals turn over."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import rotorid as rid
from rotorid import Channel, InputError, Record, average
from rotorid.signals import period_search as periodicity
from rotorid.signals.angle import (
    MeasuredAngle,
    _rhythm,
    _without_excursions,
    encoder_angle,
    keyphasor_angle,
    pulse_edges,
)
from rotorid.signals.average import _excerpt
from rotorid.signals.checks import rotation as checks_rotation
from rotorid.signals.checks import timing as checks_timing
from rotorid.signals.checks.channels import _flat
from rotorid.signals.checks.timing import _small_shifts, shifts_of
from rotorid.signals.inspection import inspect_record
from rotorid.signals.period_search import find_period

RATE, SIZE, PERIODS = 5000.0, 250, 40
CHANNELS = [Channel("F", "N"), Channel("x", "m")]


def record(*, noise: float = 0.05, speed: float = 0.0) -> Record:
    rng = np.random.default_rng(4)
    time = np.arange(SIZE * PERIODS) / RATE
    lines = ((1, 0.3), (3, 1.9), (5, 4.0))
    force = sum(np.cos(2 * np.pi * 20 * k * time + p) for k, p in lines)
    x = 1e-4 * force + 3e-5 * np.cos(speed * time) * (speed != 0)
    samples = np.stack([force, x], axis=1) + noise * rng.normal(size=(len(time), 2)) * [1, 1e-4]
    return Record(CHANNELS, samples, RATE, speed=speed)


def test_period_and_lines_are_found():
    found = inspect_record(record())
    assert (found.periods.samples, found.found) == (SIZE, True)
    assert found.periods.harmonics.tolist() == [1, 3, 5]
    assert found.verdict == "ok"
    assert "suitable for identification" in found.sentence


def test_signal_over_noise_is_that_of_one_period():
    """Lines of amplitude 1/2, white noise s^2 / N on each: 10 log10 (N / (4 s^2))."""
    found = inspect_record(record(noise=0.05), period_samples=SIZE, harmonics=[1, 3, 5])
    expected = 10 * np.log10(SIZE / (4 * 0.05**2))
    for channel in found.channels:
        assert channel.snr_db == pytest.approx(expected, abs=0.6)
        assert channel.coherence == pytest.approx(1.0, abs=1e-3)


def test_the_rotation_is_measured_by_the_angle():
    speed = 2 * np.pi * 93.37
    found = inspect_record(record(speed=speed), period_samples=SIZE, harmonics=[1, 3, 5])
    assert found.channels[1].orders[0] == pytest.approx(3e-5, rel=0.02)
    assert found.channels[1].orders[1] < 1e-6


def test_a_high_crest_factor_is_a_note():
    time = np.arange(SIZE * PERIODS) / RATE
    steep = sum(np.cos(2 * np.pi * 20 * k * time) for k in range(1, 30, 2))
    samples = np.stack([steep, record(noise=0.001).samples[:, 1]], axis=1)
    samples += 1e-3 * np.random.default_rng(0).normal(size=samples.shape) * [1, 1e-4]
    whole = Record(CHANNELS, samples, RATE)
    found = inspect_record(whole, period_samples=SIZE, harmonics=range(1, 30, 2))
    (note,) = [c for c in found.checks if c.about == "crest factor"]
    assert (", ".join(note.on), note.verdict) == ("F", "note")


def test_noise_that_goes_together_is_seen():
    rng = np.random.default_rng(1)
    base = record(noise=0.0)
    shared = rng.normal(size=len(base.samples))
    noise = (0.8 * shared[:, None] + 0.6 * rng.normal(size=base.samples.shape)) * [0.05, 5e-6]
    noisy = replace(base, samples=base.samples + noise)
    found = inspect_record(noisy, period_samples=SIZE, harmonics=[1, 3, 5])
    assert found.noise_correlation[0, 1] == pytest.approx(0.64, abs=0.15)


def test_a_record_without_a_period():
    rough = np.random.default_rng(0).normal(size=(4000, 2)) * [1, 1e-4]
    found = inspect_record(Record(CHANNELS, rough, RATE))
    assert found.periods is None
    assert found.verdict == "note"
    assert found.channels[0].rms == pytest.approx(1.0, rel=0.05)
    assert found.channels[0].snr_db is None


# The period of a record, found from its samples alone.


def robot(rng: np.random.Generator, period: int = 2000, periods: int = 4) -> np.ndarray:
    """Return a trajectory of a robot: an approach, periods, a return; noise."""
    time = np.arange(period) / period
    one = sum(np.sin(2 * np.pi * k * time + k) / k for k in range(1, 6))
    approach = one[0] * (1 - np.cos(np.pi * np.arange(430) / 430)) / 2
    home = one[0] * (1 + np.cos(np.pi * np.arange(290) / 290)) / 2
    path = np.concatenate([np.zeros(300), approach, np.tile(one, periods), home, np.zeros(500)])
    return path + 0.02 * rng.normal(size=len(path))


def test_a_robot_that_goes_to_its_place_and_back():
    """10 s at 200 Hz, to a sample; ends that suggest a longer period do not matter."""
    for seed in range(5):
        found = find_period(robot(np.random.default_rng(seed)))
        assert abs(found.samples - 2000) < 1
        assert found.fundamental(200.0) == pytest.approx(0.1)


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("harmonics", [(1, 3, 5, 7, 9, 11), (1, 2), (3, 5), (7, 8, 9), (1,)])
def test_multisines(noise, harmonics):
    rng = np.random.default_rng(5)
    angle = 2 * np.pi * np.arange(250 * 60) / 250
    wave = sum(np.cos(k * angle + k * k) for k in harmonics)
    wave = wave / wave.std() + noise * rng.normal(size=len(wave))
    found = find_period(wave)
    assert found.samples == pytest.approx(250, abs=0.1)
    assert found.fundamental(5000.0) == 20.0
    assert found.correlation == pytest.approx(1 / (1 + noise**2), abs=0.1)


def test_three_long_periods_with_a_start_and_periods_of_no_whole_samples():
    one = np.cumsum(np.random.default_rng(2).normal(size=624))
    one -= np.linspace(one[0], one[-1], 624)
    found = find_period(np.concatenate([one[:400] * np.linspace(0, 1, 400), np.tile(one, 3)]))
    assert found.samples == pytest.approx(624, abs=0.6)
    found = find_period(np.sign(np.sin(2 * np.pi * np.arange(20000) / 333.3)))
    assert found.samples == pytest.approx(333.3, abs=found.accuracy)


def test_signals_without_period():
    """What rings is like itself one wave later: a sweep through a resonance, and noise."""
    rng = np.random.default_rng(9)
    time, longer = np.arange(8000) / 1000, np.arange(20000) / 5000
    resonance = signal.iirpeak(57.0, 8.0, fs=5000.0)
    drives = (signal.chirp(longer, 10, 4, 300), np.random.default_rng(4).normal(size=20000))
    for wave in (
        rng.normal(size=8000),
        np.sin(2 * np.pi * (1 + 10 * time) * time),
        np.linspace(0, 1, 8000),
        np.zeros(8000),
        np.ones(8),
        *(signal.lfilter(*resonance, drive) for drive in drives),
    ):
        assert find_period(wave) is None


# Where what is said of a signal turns over, and how closely it is looked at.


def test_a_fifth_of_the_pulses_may_be_missing():
    def lost(count: int) -> np.ndarray:
        return np.delete(0.01 + 0.02 * np.arange(50), 3 + 4 * np.arange(count))

    assert keyphasor_angle(lost(9), 1000, 1000.0).missing == 9
    with pytest.raises(InputError, match="10 pulses missing or too many, of 40"):
        keyphasor_angle(lost(10), 1000, 1000.0)


@pytest.mark.parametrize(("lines", "left"), [(2.4, 2.4), (2.6, 0.0)])
def test_a_counter_that_goes_off_and_comes_back(lines, left):
    steady = np.arange(2000.0)
    off = lines * ((steady > 900) & (steady < 960))
    assert np.abs(_without_excursions(steady + off) - steady).max() == pytest.approx(left, abs=1e-9)


@pytest.mark.parametrize("usual", [12, 13])
def test_the_rhythm_is_that_of_the_first_pulses(usual):
    """Of the first 25: neither that of more, nor of half of them."""
    few, slower = np.full(usual, 1.0), np.full(50, 1.3)
    assert _rhythm(np.concatenate([few, slower])) == (1.0 if usual == 13 else 1.3)
    assert _rhythm(np.concatenate([few[:10], slower])) == 1.3


@pytest.mark.parametrize(("low", "high", "half"), [(0.019, 0.97, 0.5), (0.021, 0.97, 0.0)])
def test_a_sample_near_low_shows_no_flank(low, high, half):
    pulse = np.concatenate([np.zeros(40), [low, high], np.ones(40), [0.5]])
    _, open_ = pulse_edges(np.tile(pulse, 4), 1.0)
    np.testing.assert_allclose(open_, half)


@pytest.mark.parametrize(("count", "looked"), [(16384, 16384), (16500, 3 * 5400)])
def test_a_long_record_is_looked_at_in_parts(count, looked):
    record = Record([Channel("x", "m")], np.zeros((count, 1)), 1000.0)
    assert len(_excerpt(record, 0, 100).samples) == looked


@pytest.mark.parametrize(("share", "flat"), [(0.49, 490), (0.51, 0)])
def test_a_signal_of_two_levels_is_not_clipped(share, flat):
    samples = np.linspace(0.0, 0.9, 1000)
    samples[1 : 1 + round(1000 * share)] = 1.0
    assert _flat(samples, 1.0) == flat


@pytest.mark.parametrize(("turns", "size"), [(10.0009, 1.0), (10.0011, 0.0)])
def test_a_tone_on_the_grid_is_in_the_mean(turns, size):
    wave = np.cos(2 * np.pi * 10 * np.arange(5000) / 1000)
    record = Record([Channel("x", "m")], wave[:, None], 1000.0)
    found = checks_rotation._amplitude(record, average(record, 1.0, harmonics=[10]), 0, turns)
    assert abs(found) == pytest.approx(size, abs=0.01)


@pytest.mark.parametrize(
    ("shown", "mistake"),
    [
        (60 / (2 * np.pi), "rad/s given as rpm"),
        (2 * np.pi / 60, "rpm given as rad/s"),
        (60, "Hz given as rpm"),
        (1 / 60, "rpm given as Hz"),
        (2 * np.pi, "Hz given as rad/s"),
        (1 / (2 * np.pi), "rad/s given as Hz"),
    ],
)
def test_a_speed_in_another_unit_is_named(shown, mistake):
    for off, told in ((1.0, True), (1.006, False)):
        tone = checks_rotation.Tone(140.0 * off, 1.0, "x")
        found = checks_rotation._wrong_speed([tone], 140.0 / shown, False).found
        assert (mistake in found) == told


@pytest.mark.parametrize(("count", "looked"), [(3, 0), (4, 1)])
def test_four_periods_tell_a_step_of_time(monkeypatch, count, looked):
    wave = np.cos(2 * np.pi * np.arange(100 * count) / 100)
    periods = average(Record([Channel("x", "m")], wave[:, None], 100.0), 1.0, harmonics=[1])
    seen: list[object] = []
    monkeypatch.setattr(checks_timing, "_each_shift", lambda found: seen.append(found) or {})
    checks_timing.check_timing(periods)
    assert len(seen) == looked


@pytest.mark.parametrize(("typed", "found"), [(12.34, 12.34), (12.345, None)])
def test_a_frequency_that_somebody_typed_has_four_digits(typed, found):
    assert periodicity.Period(1000.0, 0.5, 1.0).fundamental(1000 * typed) == found


# Shifts of periods: all channels at once, against one by one.


FEW_RATE, FEW_SIZE, COUNT = 1000.0, 200, 60
FUNDAMENTAL = FEW_RATE / FEW_SIZE


def periods_of(tau: np.ndarray, noise: float) -> rid.PeriodicRecord:
    """Return periods that come late by tau, seen by two channels."""
    rng = np.random.default_rng(1)
    time = np.arange(FEW_SIZE) / FEW_RATE - tau[:, None]
    waves = [sum(np.cos(2 * np.pi * k * FUNDAMENTAL * time + k) for k in (1, 3)), np.zeros(1)]
    waves[1] = 2.0 * np.sin(2 * np.pi * FUNDAMENTAL * time)
    samples = np.stack(waves, axis=-1).reshape(-1, 2)
    samples = samples + noise * rng.standard_normal(samples.shape)
    channels = [rid.Channel("x", "m"), rid.Channel("y", "m")]
    return rid.average(rid.Record(channels, samples, FEW_RATE), FUNDAMENTAL, harmonics=[1, 3])


@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_all_channels_at_once_are_as_one_by_one(noise):
    tau = 2e-4 * np.sin(np.arange(COUNT))
    periods = periods_of(tau, noise)
    found = _small_shifts(periods)
    whole = shifts_of(periods, [0, 1])
    assert sorted(found) == [0, 1]
    for channel, shifts in found.items():
        one = shifts_of(periods, [channel], whole.tau)
        assert shifts.noise == pytest.approx(one.noise, rel=1e-9)
        assert shifts.explained == pytest.approx(one.explained, abs=0.02)
        assert np.abs(shifts.tau - one.tau).max() < 0.25 * one.noise + 2e-7
    if noise < 0.1:
        np.testing.assert_allclose(found[0].tau, tau - tau[0], atol=6 * found[0].noise)


@pytest.mark.parametrize(("turn", "small"), [(0.95, True), (1.05, False)])
def test_where_phases_could_wrap_it_is_one_by_one(turn, small):
    """Two periods of 60 come late and early so that the third line turns by `turn`."""
    tau = np.zeros(COUNT)
    tau[[20, 40]] = np.array([1, -1]) * turn / (2 * np.pi * 3 * FUNDAMENTAL)
    assert (_small_shifts(periods_of(tau, 1e-4)) is not None) == small


# Rotor angle from encoders and pulses.


FAST_RATE = 10_000.0
TIME = np.arange(20_000) / FAST_RATE
SPEED, DRIFT = 2 * np.pi * 140.0, 3.0
STEADY = 0.4 + SPEED * TIME
RAMP = STEADY + DRIFT * TIME**2 / 2
AROUND = np.where(TIME < 1.5, STEADY, 2 * (0.4 + 1.5 * SPEED) - STEADY)


def counts(angle: np.ndarray, lines: int = 1024) -> np.ndarray:
    return np.floor(angle * lines / (2 * np.pi)) % lines


def level(times: np.ndarray, width: float = 1e-3, flank: float = 1.0) -> np.ndarray:
    """Pulses that rise at given times, with flanks of so many samples on each side."""
    edge = flank / FAST_RATE
    knots = np.stack([times - edge, times + edge, times + width - edge, times + width + edge], 1)
    return np.interp(TIME, knots.ravel(), np.tile([0.0, 1.0, 1.0, 0.0], len(times)))


def off(found: MeasuredAngle, angle: np.ndarray) -> np.ndarray:
    error = found.angle - angle
    return np.asarray(error - 2 * np.pi * np.round(error.mean() / (2 * np.pi)))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("angle", [STEADY, RAMP])
@pytest.mark.parametrize("sign", [1, -1])
def test_encoder_counts_leave_no_staircase(angle, sign):
    """Either direction of rotation: half a line is 0.18 degrees, a hundredth of it is left."""
    found = encoder_angle(counts(sign * angle), FAST_RATE, per_revolution=1024, lines=1024)
    error = off(found, sign * angle)
    assert np.abs(error).max() < 0.02 * np.pi / 1024 + 3 * found.angle_std
    assert np.ptp(error) < 0.1 * np.pi / 1024
    assert np.sign(found.speed) == sign
    assert found.angle_std < 0.1 * np.pi / 1024


def test_what_a_speed_in_step_with_the_samples_leaves_open_is_stated():
    """Three turns in 200 samples: pulses fall at three places of a sample, a third of it apart."""
    rate, hz = 1e4, 150.0
    rises = np.floor((np.arange(1, 600) - 0.2837) / hz * rate) / rate
    half = np.full(len(rises), 0.5 / rate)
    found = keyphasor_angle(rises + half, 40000, rate, half=half)
    width = 2 * np.pi * hz / rate / 3
    assert found.angle_std == pytest.approx(width / np.sqrt(12), rel=0.06)


@pytest.mark.slow
def test_a_slow_variation_of_the_speed_is_followed():
    """0.1 % at 0.5 Hz, 10 degrees a sample: the angle moves by 16 degrees."""
    time = np.arange(25_000) / 5000.0
    angle = 0.3 + SPEED * time + 1e-3 * SPEED / np.pi * np.sin(np.pi * time)
    times, half = pulse_edges((angle % (2 * np.pi) < 0.6).astype(float), 5000.0)
    found = keyphasor_angle(times, len(time), 5000.0, half=half)
    error = off(found, angle)
    assert np.degrees(error.std()) < 0.25
    assert np.degrees(found.angle_std) < 0.6


@pytest.mark.slow
def test_lost_and_double_lines_are_set_right():
    total = np.floor(STEADY * 1024 / (2 * np.pi))
    total[5000:] -= 1
    total[12_000:] += 2
    found = encoder_angle(total % 1024, FAST_RATE, per_revolution=1024, lines=1024)
    assert (found.missing, found.extra) == (1, 2)
    assert np.abs(off(found, STEADY)).max() < 0.1 * np.pi / 1024
    # Twenty lines that the next index puts back leave no step.
    turns = 150.0 * TIME
    lost = 20 * ((TIME > 0.7) & (turns < np.ceil(0.7 * 150.0) + 1))
    counted = (np.floor(1024 * turns) - lost) % 1024
    found = encoder_angle(counted, FAST_RATE, per_revolution=1024, lines=1024)
    assert np.abs(found.angle - 2 * np.pi * turns).max() < np.radians(0.2)


@pytest.mark.slow
def test_a_coarse_encoder_with_more_jitter_than_lines():
    jitter = np.radians(0.2) * np.random.default_rng(0).normal(size=len(TIME))
    found = encoder_angle(counts(STEADY + jitter, 8192), FAST_RATE, per_revolution=8192, lines=8192)
    assert found.jitter == pytest.approx(np.radians(0.2), rel=1.0)
    assert np.abs(off(found, STEADY)).max() < 4 * found.angle_std < np.radians(0.1)


@pytest.mark.parametrize(("scale", "turn"), [(1.0, 2 * np.pi), (180 / np.pi, 360.0)])
def test_an_angle_column_is_unwrapped(scale, turn):
    found = encoder_angle((STEADY * scale) % turn, FAST_RATE, per_revolution=turn)
    np.testing.assert_allclose(found.angle, STEADY, atol=1e-9)


@pytest.mark.parametrize(
    ("readings", "message"),
    [
        (counts(AROUND), r"turns around 1\.5\d* s after the first sample"),
        (counts(34 * STEADY), "between two samples; expected well below half a revolution"),
        (np.where(TIME == 0.5, np.nan, counts(STEADY)), "nan in sample 5000"),
    ],
)
def test_bad_encoders_are_refused(readings, message):
    with pytest.raises(InputError, match=message):
        encoder_angle(readings, FAST_RATE, per_revolution=1024, lines=1024, source="run.h5")


@pytest.mark.slow
def test_one_line_of_flicker_is_no_turning_back():
    slow = 0.4 + 2 * np.pi * 0.3 * TIME
    jitter = 2 * np.pi / 1024 * 0.3 * np.random.default_rng(0).normal(size=len(TIME))
    found = encoder_angle(counts(slow + jitter), FAST_RATE, per_revolution=1024, lines=1024)
    assert found.speed == pytest.approx(2 * np.pi * 0.3, rel=1e-3)


def true_pulses(angle_at_zero: float = 0.4) -> np.ndarray:
    return (2 * np.pi * np.arange(1, 280) - angle_at_zero) / SPEED


def test_flanks_give_pulse_times_between_samples():
    """Of a negative-going column the rising ones: the width of the mark turns the angle alone."""
    times = true_pulses()
    found, half = pulse_edges(level(times, flank=3.0), FAST_RATE)
    np.testing.assert_allclose(found, times, atol=1e-12)
    assert not half.any()
    noisy = level(times, flank=3.0) + 0.01 * np.random.default_rng(0).normal(size=len(TIME))
    assert (pulse_edges(noisy, FAST_RATE)[0] - times).std() < 0.06 / FAST_RATE
    found, _ = pulse_edges(3.0 - 5.0 * level(times, flank=3.0), FAST_RATE)
    np.testing.assert_allclose(np.diff(found), np.diff(times[: len(found)]), atol=1e-12)
    logic = (level(times, flank=1e-6) > 0.5).astype(float)  # levels alone, without bias
    error = pulse_edges(logic, FAST_RATE)[0] - times
    assert np.abs(error).max() <= 0.5 / FAST_RATE + 1e-9
    assert abs(error.mean()) < 0.08 / FAST_RATE


@pytest.mark.parametrize("drift", [0.0, DRIFT])
def test_keyphasor_angle(drift):
    angle = STEADY + drift * TIME**2 / 2
    turns = np.arange(1, int(angle[-1] / (2 * np.pi)) + 1)
    rest = 2 * np.pi * turns - 0.4
    times = 2 * rest / (SPEED + np.sqrt(SPEED**2 + 2 * drift * rest))
    found = keyphasor_angle(times, len(TIME), FAST_RATE)
    offset = found.angle - angle
    assert np.ptp(offset) < 1e-6 if drift == 0 else np.ptp(offset) < 1e-4
    assert np.exp(1j * offset).mean() == pytest.approx(1.0, abs=2e-4)
    assert found.speed == pytest.approx(SPEED + drift * TIME.mean(), rel=1e-6)


@pytest.mark.parametrize(
    ("times", "missing", "extra"),
    [
        (np.delete(true_pulses(), 100), 1, 0),
        (np.delete(true_pulses(), slice(100, 104)), 4, 0),
        (np.delete(true_pulses(), 1), 1, 0),
        (np.delete(true_pulses(), -2), 1, 0),
        (np.sort(np.append(true_pulses(), [0.5, 1.2, 1.2001])), 0, 3),
        (np.sort(np.append(true_pulses()[1:], 0.001)), 0, 1),
    ],
)
def test_missing_and_double_pulses_are_understood(times, missing, extra):
    found = keyphasor_angle(times, len(TIME), FAST_RATE)
    assert (found.missing, found.extra) == (missing, extra)
    assert np.abs(off(found, STEADY)).max() < 1e-6


def test_pulses_without_a_rhythm_are_refused():
    times = np.sort(np.random.default_rng(0).uniform(0, 2, 200))
    with pytest.raises(InputError, match="pulses missing or too many, of 200"):
        keyphasor_angle(times, len(TIME), FAST_RATE, source="run.h5")
    with pytest.raises(InputError, match="3 pulses; expected four or more"):
        keyphasor_angle(true_pulses()[:3], len(TIME), FAST_RATE, source="run.h5")


@pytest.mark.parametrize("column", [np.zeros(100), np.zeros(0)])
def test_a_column_without_pulses_is_refused(column):
    with pytest.raises(InputError, match="a column without a pulse"):
        pulse_edges(column, FAST_RATE)


# Offsets that drift are taken out and told; what only looks like it is left.


RAMP_RATE, F0, RAMP_SIZE = 4000.0, 20.0, 200


def machine(periods=40, noise=1e-7, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(RAMP_SIZE * periods) / RAMP_RATE
    wave = sum(np.cos(2 * np.pi * F0 * k * time + k) / k for k in (1, 3, 5))
    samples = 1e-5 * wave[:, None] * [1.0, 0.7] + noise * rng.standard_normal((len(time), 2))
    return Record([Channel("x", "m"), Channel("y", "m")], samples, RAMP_RATE)


def drifting(record, shape):
    return replace(record, samples=record.samples + np.outer(shape, [1, 0]))


def told(periods):
    return [c for c in periods.checks if c.about == "drift" and c.verdict != "ok"]


@pytest.mark.parametrize("periods", [6, 40])
def test_a_ramp_is_taken_out_and_told(periods):
    clean = machine(periods)
    ramp = np.linspace(0, 2e-4, len(clean.samples))
    found = average(drifting(clean, ramp), F0, harmonics=[1, 3, 5])
    kept = average(clean, F0, harmonics=[1, 3, 5])
    (note,) = told(found)
    assert (", ".join(note.on), note.verdict) == ("x", "note")
    assert "the offset drifts by" in note.found
    assert "a straight line was taken out" in note.found
    assert np.abs(found.mean_spectrum - kept.mean_spectrum).max() < 1e-8
    assert not told(kept)


STD = 1e-7 / np.sqrt(40 * RAMP_SIZE)  # of a mean line of 40 periods


@pytest.mark.parametrize(
    ("periods", "shape"),
    [
        (40, lambda share: 0.2 * STD * 2 * np.pi * 40 * share),  # below the noise
        (40, lambda share: np.where(share < 0.3, 0.0, 1e-4)),  # a step
        (5, lambda share: 2e-4 * share),  # too few periods
    ],
)
def test_what_is_no_ramp_is_left(periods, shape):
    record = machine(periods)
    drifts = drifting(record, shape(np.linspace(0, 1, len(record.samples))))
    notes = told(average(drifts, F0, harmonics=[1, 3, 5]))
    assert not any("straight" in note.found for note in notes)
