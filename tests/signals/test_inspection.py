"""What is in a record before anything is identified."""

import numpy as np
import pytest
from scipy import signal

from rotorid import Channel, Record
from rotorid.signals.inspection import inspect_record
from rotorid.signals.period_search import find_period

# -------------------------------------------------------------------------------------------------
# What is in a record before anything is identified.


RATE, SIZE, PERIODS = 5000.0, 250, 40


def record(
    *, square: float = 0.0, noise: float = 0.05, speed: float = 0.0, peak: bool = False
) -> Record:
    rng = np.random.default_rng(4)
    time = np.arange(SIZE * PERIODS) / RATE
    phases = np.zeros(3) if peak else np.array([0.3, 1.9, 4.0])
    force = sum(
        np.cos(2 * np.pi * 20 * k * time + p) for k, p in zip((1, 3, 5), phases, strict=True)
    )
    x = 1e-4 * (force + square * force**2) + 3e-5 * np.cos(speed * time) * (speed != 0)
    samples = np.stack([force, x], axis=1) + noise * rng.normal(size=(len(time), 2)) * [1, 1e-4]
    return Record([Channel("F", "N"), Channel("x", "m")], samples, RATE, speed=speed)


def test_period_and_lines_are_found() -> None:
    found = inspect_record(record())
    assert found.periods is not None
    assert (found.periods.samples, found.found) == (SIZE, True)
    assert found.periods.harmonics.tolist() == [1, 3, 5]
    assert found.verdict == "ok"
    assert "suitable for identification" in found.sentence


def test_the_period_of_a_robot_with_head_and_tail() -> None:
    """Ten seconds of excitation, repeated; approach and return suggest 10.09 s."""
    rate = 100.0
    time = np.arange(4000) / rate
    wave = sum(np.sin(2 * np.pi * 0.1 * k * time + k * k) / k for k in range(1, 6))
    head, tail = np.linspace(0, wave[0], 90), np.linspace(wave[-1], 0, 180)
    q = np.concatenate([head, wave, tail])
    q = q + 0.005 * np.random.default_rng(0).normal(size=len(q))
    found = inspect_record(Record([Channel("q", "rad")], q[:, None], rate), skip=0.9)
    assert found.periods is not None
    assert found.periods.samples == 1000


def test_signal_over_noise_is_that_of_one_period() -> None:
    """Lines of amplitude 1/2, white noise s^2 / N on each: 10 log10 (N / (4 s^2))."""
    found = inspect_record(record(noise=0.05), period_samples=SIZE, harmonics=[1, 3, 5])
    expected = 10 * np.log10(SIZE / (4 * 0.05**2))
    for channel in found.channels:
        assert channel.snr_db == pytest.approx(expected, abs=0.6)
        assert channel.coherence == pytest.approx(1.0, abs=1e-3)


def test_even_distortion_is_told_from_odd() -> None:
    found = inspect_record(record(square=0.05), period_samples=SIZE, harmonics=[1, 3, 5])
    force, x = found.channels
    assert force.even is not None
    assert force.even < 0.003
    assert x.even is not None
    force_only = record(noise=0.0).column("F")[:SIZE]
    lines = np.abs(np.fft.rfft(force_only + 0.05 * force_only**2, norm="forward")) ** 2
    even = lines[2:16:2].sum() / lines[[1, 3, 5]].sum()
    assert x.even == pytest.approx(np.sqrt(even), rel=0.05)
    assert x.odd is not None
    assert x.odd < 0.003


def test_the_rotation_is_measured_by_the_angle() -> None:
    speed = 2 * np.pi * 93.37
    found = inspect_record(record(speed=speed), period_samples=SIZE, harmonics=[1, 3, 5])
    assert found.channels[1].orders[0] == pytest.approx(3e-5, rel=0.02)
    assert found.channels[1].orders[1] < 1e-6


def test_a_high_crest_factor_is_a_note() -> None:
    steep = record(peak=True, noise=0.001)
    time = np.arange(SIZE * PERIODS) / RATE
    many = sum(np.cos(2 * np.pi * 20 * k * time) for k in range(1, 30, 2))
    samples = np.stack([many, steep.samples[:, 1]], axis=1)
    samples += 1e-3 * np.random.default_rng(0).normal(size=samples.shape) * [1, 1e-4]
    found = inspect_record(
        Record(steep.channels, samples, RATE), period_samples=SIZE, harmonics=range(1, 30, 2)
    )
    (note,) = [c for c in found.checks if c.about == "crest factor"]
    assert (", ".join(note.on), note.verdict) == ("F", "note")


def test_noise_that_goes_together_is_seen() -> None:
    rng = np.random.default_rng(1)
    base = record(noise=0.0)
    shared = rng.normal(size=len(base.samples))
    own = rng.normal(size=base.samples.shape)
    noise = (0.8 * shared[:, None] + 0.6 * own) * [0.05, 5e-6]
    found = inspect_record(
        Record(base.channels, base.samples + noise, RATE), period_samples=SIZE, harmonics=[1, 3, 5]
    )
    assert found.noise_correlation is not None
    assert found.noise_correlation[0, 1] == pytest.approx(0.64, abs=0.15)


def test_a_record_without_a_period() -> None:
    rough = np.random.default_rng(0).normal(size=(4000, 2)) * [1, 1e-4]
    found = inspect_record(Record([Channel("F", "N"), Channel("x", "m")], rough, RATE))
    assert found.periods is None
    assert found.verdict == "note"
    assert found.channels[0].rms == pytest.approx(1.0, rel=0.05)
    assert found.channels[0].snr_db is None


# -------------------------------------------------------------------------------------------------
# The period of a record, found from its samples alone.


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
