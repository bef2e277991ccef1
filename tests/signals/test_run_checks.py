"""Synchronism, settling, distortion: what a run tells before anything is identified."""

import numpy as np
import pytest

from rotorid import Channel, InputError, PeriodicRecord, Record, average
from rotorid.signals.checks.periods import Settling, detect_settling
from rotorid.signals.checks.rotation import rotation_warnings, synchronism
from rotorid.signals.inspection import detect_distortion

RATE, F0, PERIODS = 1000.0, 10.0, 60
TIME = np.arange(int(PERIODS * RATE / F0)) / RATE
WAVE = sum(np.cos(2 * np.pi * F0 * k * TIME + k) for k in (1, 3, 5))


def rotating(speed: float, drift: float = 0.0) -> PeriodicRecord:
    record = Record(
        [Channel("x", "m")],
        WAVE[:, None],
        RATE,
        speed=speed,
        angle=speed * TIME + drift * TIME**2 / 2,
    )
    return average(record, F0, harmonics=[1, 3, 5])


def test_synchronous_rotation_gives_no_warning() -> None:
    assert rotation_warnings(rotating(2 * np.pi * 30.0)) == ()
    assert rotation_warnings(rotating(0.0)) == ()
    found = synchronism(rotating(2 * np.pi * 30.0))
    assert found.turns == pytest.approx(3.0)
    np.testing.assert_allclose(found.leakage, 0.0, atol=1e-9)


def test_slip_is_said_with_its_leakage() -> None:
    periods = rotating(2 * np.pi * 30.05)
    found = synchronism(periods)
    slip = np.pi * 0.05 * TIME[-1]
    assert found.loss == pytest.approx(1 - np.sin(slip) / slip, rel=1e-3)
    assert found.slip == pytest.approx(2 * slip)
    (warning,) = rotation_warnings(periods)
    assert "3.005 revolutions per period" in warning
    assert "108 degrees off over 60 periods" in warning
    assert f"loses {100 * found.loss:.2g} %" in warning


def test_leakage_is_the_spectrum_of_the_unbalance() -> None:
    """Half way between two lines, the unbalance leaks into both as a window of that length."""
    periods = rotating(2 * np.pi * 40.15)
    found = synchronism(periods)
    off = 2 * np.pi * (40.15 - periods.frequency)
    wave = np.abs([np.mean(np.exp(1j * w * TIME)) for w in off])
    np.testing.assert_allclose(found.leakage, wave, rtol=1e-6)


def test_drift_is_said() -> None:
    (warning,) = rotation_warnings(rotating(2 * np.pi * 30.0, drift=0.5))
    assert "speed changing by 28.6 rpm" in warning


def noisy(transient: float, sigma: float, seed: int) -> PeriodicRecord:
    rng = np.random.default_rng(seed)
    start = transient * np.exp(-8.0 * TIME) * np.cos(2 * np.pi * 11.0 * TIME)
    samples = WAVE + start + sigma * rng.normal(size=len(TIME))
    return average(Record([Channel("x", "m")], samples[:, None], RATE), F0, harmonics=[1, 3, 5])


def test_a_transient_is_found_and_twice_its_length_dropped() -> None:
    for seed in range(10):
        found = detect_settling(noisy(1.0, 0.1, seed))
        assert 2 <= found.periods <= 9
        assert found.drop == pytest.approx(2 * found.periods / F0)
        assert found.excess > 3


@pytest.mark.slow
def test_no_transient_is_found_in_noise() -> None:
    found = [detect_settling(noisy(0.0, 0.1, seed)).periods for seed in range(200)]
    assert np.count_nonzero(found) <= 2


def test_without_noise_the_transient_is_followed_far_down() -> None:
    found = detect_settling(noisy(1.0, 0.0, 0))
    assert np.exp(-8.0 * found.periods / F0) < 1e-7
    assert detect_settling(noisy(0.0, 0.0, 0)).periods == 0


def test_a_drift_is_no_transient() -> None:
    samples = WAVE * (1 + 0.1 * np.exp(-0.1 * TIME))
    record = Record([Channel("x", "m")], samples[:, None], RATE)
    assert detect_settling(average(record, F0, harmonics=[1, 3, 5])).periods == 0


def test_a_transient_longer_than_half_the_record_is_told() -> None:
    """It dies away by a factor of 40 in the first half, and stands a hundred times above noise."""
    start = np.exp(-1.25 * TIME) * np.cos(2 * np.pi * 11.0 * TIME)
    rng = np.random.default_rng(3)
    samples = WAVE + start + 1e-4 * rng.normal(size=len(TIME))
    record = Record([Channel("x", "m")], samples[:, None], RATE)
    found = detect_settling(average(record, F0, harmonics=[1, 3, 5]))
    assert found.periods == PERIODS // 2
    assert found.drop == pytest.approx(PERIODS // 2 / F0)


def test_another_level_in_the_first_half_is_no_transient() -> None:
    rng = np.random.default_rng(3)
    samples = WAVE * np.where(np.arange(len(TIME)) < 3120, 1.1, 1.0) + 0.01 * rng.normal(
        size=len(TIME)
    )
    record = Record([Channel("x", "m")], samples[:, None], RATE)
    assert detect_settling(average(record, F0, harmonics=[1, 3, 5])).periods == 0


def test_few_periods_tell_nothing() -> None:
    record = Record([Channel("x")], WAVE[:700, None], RATE)
    assert detect_settling(average(record, F0, harmonics=[1])).periods == 0


def distorted(odd: float, even: float, sigma: float, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    answer = WAVE + even * WAVE**2 + odd * WAVE**3 + sigma * rng.normal(size=len(TIME))
    return Record([Channel("F", "N")], answer[:, None], RATE)


@pytest.mark.parametrize(("odd", "even"), [(0.01, 0.0), (0.0, 0.01), (0.01, 0.02)])
def test_odd_and_even_distortion_are_told_apart(odd: float, even: float) -> None:
    found = detect_distortion(distorted(odd, even, 0.0), F0, [1, 3, 5], highest=15)
    got_odd, got_even, noise = found.relative("F")
    assert (got_odd > 1e-3) == (odd > 0)
    assert (got_even > 1e-3) == (even > 0)
    assert noise < 1e-12
    np.testing.assert_array_equal(found.odd, [7, 9, 11, 13, 15])
    np.testing.assert_array_equal(found.even, range(2, 16, 2))


def test_distortion_has_its_size() -> None:
    record = distorted(0.0, 0.02, 0.0)
    found = detect_distortion(record, F0, [1, 3, 5], highest=10)
    square = np.abs(np.fft.rfft(0.02 * WAVE**2, norm="forward"))[::PERIODS][[2, 4, 6, 8, 10]]
    assert found.even_level[0] == pytest.approx(np.sqrt((square**2).mean()), rel=1e-9)


def test_noise_is_neither() -> None:
    excess = []
    for seed in range(30):
        found = detect_distortion(distorted(0.0, 0.0, 0.1, seed), F0, [1, 3, 5], highest=15)
        excess.append([found.odd_excess[0], found.even_excess[0]])
        assert found.noise[0] == pytest.approx(0.1 / np.sqrt(len(TIME)), rel=0.2)
    np.testing.assert_allclose(np.mean(np.square(excess), axis=0), 1.0, atol=0.15)


def test_the_rotation_is_left_aside() -> None:
    turning = Record(
        [Channel("F")], distorted(0.01, 0.0, 0.0).samples, RATE, speed=2 * np.pi * 70.0
    )
    found = detect_distortion(turning, F0, [1, 3, 5], highest=15)
    assert 7 not in found.odd
    assert 14 not in found.even


def test_no_line_left_out_is_refused() -> None:
    with pytest.raises(InputError, match="every harmonic up to 3 excited"):
        detect_distortion(distorted(0, 0, 0), F0, [1, 2, 3])
    found = detect_distortion(distorted(0, 0, 0), F0, [1, 3])
    with pytest.raises(InputError, match="no channel 'G'"):
        found.relative("G")


def test_a_transient_of_one_period_is_told_as_one():
    one, more = Settling(1, 0.2, 153.0), Settling(3, 0.6, 153.0)
    scatter = "153 times the scatter of the later ones"
    assert one.told == f"a transient in the first period, {scatter}"
    assert more.told == f"a transient in the first 3 periods, {scatter}"
