"""Whole periods of a record: what is used, what is kept, what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid import Channel, InputError, Record, average
from rotorid.signals.covariance import white_covariance


def record_of(samples, rate=100.0, **options):
    samples = np.asarray(samples, dtype=float)
    if samples.ndim == 1:
        samples = samples[:, None]
    channels = [Channel(f"c{i}") for i in range(samples.shape[1])]
    return Record(options.pop("channels", channels), samples, rate, source="a.csv", **options)


RANDOM = np.random.default_rng(1).standard_normal((103, 2))


def test_statistics_of_the_periods():
    periodic = average(record_of(RANDOM), 10.0, harmonics=[0, 2, 5])
    assert (periodic.periods, periodic.samples, periodic.fundamental) == (10, 10, 10.0)
    cut = RANDOM[:100].reshape(10, 10, 2)
    np.testing.assert_allclose(periodic.mean, cut.mean(axis=0))
    scatter = ((cut - cut.mean(axis=0)) ** 2).sum(axis=0) / 9  # the paper's (8), unbiased
    np.testing.assert_allclose(periodic.variance, scatter)
    np.testing.assert_allclose(periodic.spectra, np.fft.fft(cut, axis=1)[:, [0, 2, 5]] / 10)
    np.testing.assert_allclose(periodic.mean_spectrum, periodic.spectra.mean(axis=0))
    np.testing.assert_array_equal(periodic.frequency, [0, 20, 50])
    np.testing.assert_allclose(periodic.omega, 2 * np.pi * periodic.frequency)
    np.testing.assert_array_equal(periodic.multiplicity, [1, 2, 1])
    np.testing.assert_allclose(periodic.time, np.arange(100).reshape(10, 10) / 100)
    unsorted = average(record_of(RANDOM), period_samples=9, harmonics=np.array([4, 0]))
    np.testing.assert_array_equal(unsorted.harmonics, [0, 4])
    np.testing.assert_array_equal(unsorted.multiplicity, [1, 2])  # no Nyquist line of an odd count


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 40), st.integers(2, 12), st.integers(0, 10**6))
def test_averaging_identical_periods_is_the_identity(size, periods, seed):
    one = np.random.default_rng(seed).standard_normal((size, 2))
    record, lines = record_of(np.tile(one, (periods, 1))), range(size // 2 + 1)
    periodic = average(record, period_samples=size, harmonics=lines)
    np.testing.assert_allclose(periodic.mean, one, atol=1e-15)
    np.testing.assert_allclose(periodic.variance, 0, atol=1e-29)
    np.testing.assert_allclose(periodic.mean_spectrum, np.fft.rfft(one, axis=0) / size, atol=1e-15)


@pytest.mark.parametrize(
    ("skip", "first"),
    [(0, 0), (0.03, 3), (0.0301, 4), (0.07, 7), (0.29, 29), (0.1 + 0.2, 30), (1e-9, 0), (0.8, 80)],
)
def test_skip_is_rounded_up_to_samples(skip, first):
    periodic = average(record_of(RANDOM), 10.0, harmonics=[1], skip=skip)
    assert periodic.time[0, 0] == pytest.approx(first / 100)
    assert periodic.periods == (103 - first) // 10
    cut = RANDOM[first : first + 10 * periodic.periods].reshape(-1, 10, 2)
    np.testing.assert_allclose(periodic.mean, cut.mean(axis=0))


def test_the_angle_counts_from_the_first_sample_of_the_file():
    periodic = average(record_of(RANDOM, speed=3.0), 10.0, harmonics=[1], skip=0.25)
    np.testing.assert_allclose(periodic.angle, 3.0 * periodic.time)
    assert periodic.time[0, 0] == pytest.approx(0.25)
    angle = np.linspace(5, 9, 103)
    periodic = average(record_of(RANDOM, angle=angle), 10.0, harmonics=[1], skip=0.25)
    np.testing.assert_allclose(periodic.angle.ravel(), angle[25:95])


@pytest.mark.parametrize(
    ("fundamental", "band", "harmonics"),
    [
        (10.0, (0, 40), [0, 1, 2, 3, 4]),
        (10.0, (10, 40), [1, 2, 3, 4]),
        (10.0, (0.1, 39.9), [1, 2, 3]),
        (10.0, (10.0000001, 29.9999999), [1, 2, 3]),  # rounding of units, not a wish
        (10.0, (40, 50), [4, 5]),
        (10.0, (20, 20), [2]),
        (1000 / 30, (1000 / 30, 3000 / 30), [1, 2, 3]),  # no finite decimal
    ],
)
def test_both_ends_of_a_band_are_in_it(fundamental, band, harmonics):
    record = record_of(RANDOM, rate=100.0 if fundamental == 10.0 else 1000.0)
    np.testing.assert_array_equal(average(record, fundamental, band=band).harmonics, harmonics)


def test_hold_and_delay_are_corrected_on_the_lines_and_only_there():
    channels = [Channel("u", hold=True, delay=1e-3), Channel("x")]
    periodic = average(record_of(RANDOM, channels=channels), 10.0, harmonics=[0, 3])
    plain = average(record_of(RANDOM), 10.0, harmonics=[0, 3])
    factor = np.sinc(0.3) * np.exp(-0.3j * np.pi) * np.exp(2j * np.pi * 30 * 1e-3)
    np.testing.assert_allclose(periodic.spectra[:, 1, 0], plain.spectra[:, 1, 0] * factor)
    np.testing.assert_allclose(periodic.spectra[:, 0], plain.spectra[:, 0])
    np.testing.assert_allclose(periodic.spectra[..., 1], plain.spectra[..., 1])
    np.testing.assert_allclose(periodic.mean, plain.mean)
    np.testing.assert_allclose(periodic.variance, plain.variance)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"harmonics": [1]}, "neither or both of fundamental and period_samples"),
        ({"fundamental": 10.0, "period_samples": 10, "harmonics": [1]}, "neither or both of fund"),
        ({"fundamental": 10.0}, "neither or both of harmonics and band"),
        ({"fundamental": 10.0, "harmonics": [1], "band": (0, 1)}, "neither or both of harmonics"),
        ({"fundamental": 30.0, "harmonics": [1]}, "a period of 3.33333 samples.*whole number"),
        ({"fundamental": 9.9999, "harmonics": [1]}, "a period of 10.0001 samples"),
        ({"fundamental": np.nan, "harmonics": [1]}, "a fundamental of nan Hz"),
        ({"fundamental": 1e-320, "harmonics": [1]}, "a fundamental of .* Hz|a period of inf"),
        ({"fundamental": 100.0, "harmonics": [1]}, r"of 1 samples \(rate 100 Hz, fu.* 2 or"),
        ({"fundamental": 200.0, "harmonics": [1]}, "a period of 0.5 samples .* column in ms"),
        ({"period_samples": 0, "harmonics": [1]}, "a period of 0 samples"),
        ({"period_samples": 10.5, "harmonics": [1]}, "a period of 10.5 samples"),
        ({"period_samples": 60, "harmonics": [1]}, "103 samples after skip, 1 whole periods"),
        ({"fundamental": 10.0, "harmonics": [1], "skip": 0.9}, "13 samples after skip, 1 whole"),
        ({"fundamental": 10.0, "harmonics": [1], "skip": -1}, "skip of -1 s"),
        ({"fundamental": 10.0, "harmonics": []}, "no line in the harmonics"),
        ({"fundamental": 10.0, "harmonics": [6]}, r"the harmonics \[6\]; expected .* 0 to 5"),
        ({"fundamental": 10.0, "harmonics": [1, 1]}, r"the harmonics \[1, 1\]; expected different"),
        ({"fundamental": 10.0, "harmonics": [1.5]}, r"the harmonics \[1.5\]; .*whole numbers"),
        ({"fundamental": 10.0, "harmonics": [np.nan]}, r"the harmonics \[nan\]"),
        ({"fundamental": 10.0, "band": (1, 9)}, "no line between 1 and 9 Hz"),
        ({"fundamental": 10.0, "band": (40, 10)}, "the band 40 to 10 Hz; .*the lower end first"),
        ({"fundamental": 10.0, "band": (0, 60)}, "the band 0 to 60 Hz; expected 0 Hz to 50 Hz"),
        ({"fundamental": 10.0, "band": (-20, 20)}, "the band -20 to 20 Hz"),
        ({"fundamental": 10.0, "band": (np.nan, 20)}, "band .*nan"),
    ],
)
def test_refusals(options, message):
    with pytest.raises(InputError, match=rf"^a.csv: (\w+: )?found .*{message}"):
        average(record_of(RANDOM), **options)


def test_the_nyquist_line_cannot_be_corrected():
    record = record_of(RANDOM, channels=[Channel("u", hold=True), Channel("x")])
    with pytest.raises(InputError, match="the Nyquist line with the hold or delay of u"):
        average(record, 10.0, harmonics=[1, 5])
    average(record, 10.0, harmonics=[1, 4])
    average(record, period_samples=9, harmonics=[4])


def test_two_periods_are_enough_and_a_remainder_is_dropped():
    periodic = average(record_of(RANDOM[:29]), period_samples=14, harmonics=[1])
    assert periodic.periods == 2
    difference = RANDOM[:14] - RANDOM[14:28]
    np.testing.assert_allclose(periodic.variance, difference**2 / 2)


@pytest.mark.parametrize("noise", [0.05, 0.2, 0.8])  # in steps; from 0.5 on it spreads the rounding
def test_the_scatter_holds_rounding_that_repeats_in_every_period(noise):
    """The mean square error of a mean line is its variance, up to 200 times the scatter's."""
    rng, lines = np.random.default_rng(4), np.array([2, 5, 7, 11, 17])
    wave = np.exp(2j * np.pi * np.outer(np.arange(200), lines) / 200)
    ratios = []
    for _ in range(60):
        sizes = 10 * np.exp(2j * np.pi * rng.random((5, 2)))
        motion = np.tile((wave @ sizes).real, (20, 1))
        samples = np.round(motion + noise * rng.standard_normal(motion.shape))
        record = Record([Channel("x", "m"), Channel("y", "m")], samples, 200.0)
        periods = average(record, 1.0, harmonics=lines.tolist())
        error = np.abs(periods.mean_spectrum - sizes / 2) ** 2
        matrices = white_covariance(periods.spectra).matrices
        variance = np.diagonal(matrices, axis1=1, axis2=2).real
        assert np.abs(matrices[:, 0, 1]).mean() < 0.5 * variance.mean()
        ratios.append(error.mean() / variance.mean())
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.15)
