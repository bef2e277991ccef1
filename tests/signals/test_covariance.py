"""Covariance of mean lines: both formulas against known noise, and the rule that chooses."""

import numpy as np
import pytest

from rotorid import InputError
from rotorid.signals.covariance import (
    choose_covariance,
    correlated_covariance,
    is_correlated,
    lag_one_correlation,
    white_covariance,
)

MIX = np.array([[1.0, 0.3 - 0.5j], [0.0, 0.8]])  # correlated channels


def circular(rng, *shape):
    """Return circular complex noise of variance 1."""
    return (rng.standard_normal((*shape, 2)) @ np.array([1, 1j])) / np.sqrt(2)


def white(rng, periods=260, lines=6, channels=2):
    return circular(rng, periods, lines, channels)


def telescoping(rng, periods, lines, channels=2, share=0.4):
    """Return white noise plus the difference of a random state between the ends of a period."""
    state = share * circular(rng, periods + 1, lines, channels)
    return white(rng, periods, lines, channels) + np.diff(state, axis=0)


def autoregressive(rng, periods, lines, channels, coefficient):
    noise = circular(rng, periods, lines, channels)
    noise[0] /= np.sqrt(1 - coefficient**2)
    for p in range(1, periods):
        noise[p] += coefficient * noise[p - 1]
    return noise


def mean_of(formula, spectra):
    return np.mean([formula(s).matrices for s in spectra], axis=0)


@pytest.mark.parametrize("periods", [2, 3, 20])
def test_white_formula_is_unbiased_and_keeps_cross_terms(periods):
    rng = np.random.default_rng(1)
    truth = MIX @ MIX.conj().T / periods
    draws = [white_covariance(white(rng, periods, 40) @ MIX.T) for _ in range(400)]
    assert {d.dof for d in draws} == {periods - 1}
    assert draws[0].kind == "white"
    found = np.mean([d.matrices for d in draws], axis=(0, 1))
    np.testing.assert_allclose(found, truth, atol=0.03 / periods)


def test_white_formula_by_hand():
    z = white(np.random.default_rng(2), 5, 3)
    expected = np.zeros((3, 2, 2), dtype=complex)
    for k in range(3):
        for p in range(5):
            d = z[p, k] - z[:, k].mean(axis=0)
            expected[k] += np.outer(d, d.conj()) / 20
    np.testing.assert_allclose(white_covariance(z).matrices, expected)


def test_matrices_are_hermitian_and_positive():
    z = white(np.random.default_rng(3), 12, 4)
    for covariance in (white_covariance(z), correlated_covariance(z)):
        np.testing.assert_allclose(covariance.matrices, covariance.matrices.conj().swapaxes(1, 2))
        assert np.linalg.eigvalsh(covariance.matrices).min() > -1e-15


@pytest.mark.parametrize("periods", [2, 3, 24, 25])
def test_all_neighbours_are_the_white_formula_again(periods):
    z = white(np.random.default_rng(4), periods, 3)
    found = correlated_covariance(z, max(1, periods // 2))
    np.testing.assert_allclose(found.matrices, white_covariance(z).matrices, atol=1e-14)
    assert found.dof == periods - 1


def test_correlated_formula_by_hand():
    z = white(np.random.default_rng(5), 30, 2)
    m, periods = 3, 30
    expected = np.zeros((2, 2, 2), dtype=complex)
    for k in range(2):
        for j in (-3, -2, -1, 1, 2, 3):
            turn = np.exp(-2j * np.pi * j * np.arange(periods) / periods)
            line = (z[:, k] * turn[:, None]).sum(axis=0)
            expected[k] += np.outer(line, line.conj()) / (2 * m * periods**2)
    found = correlated_covariance(z, m)
    np.testing.assert_allclose(found.matrices, expected)
    assert (found.dof, found.kind) == (6, "correlated")


@pytest.mark.parametrize(("periods", "m"), [(260, 22), (100, 8), (40, 3), (12, 1), (2, 1)])
def test_neighbours_that_are_taken(periods, m):
    assert correlated_covariance(white(np.random.default_rng(6), periods, 1)).dof == min(
        2 * m, periods - 1
    )


def test_neither_formula_sees_what_every_period_repeats():
    rng = np.random.default_rng(7)
    z, signal = white(rng, 40, 3), 1e6 * circular(rng, 3, 2)
    for formula in (white_covariance, correlated_covariance):
        np.testing.assert_allclose(formula(z + signal).matrices, formula(z).matrices, atol=1e-9)


def test_telescoping_noise_inflates_the_scatter_and_not_the_mean():
    """The state at the ends cancels in the mean; the scatter between periods does not know."""
    rng = np.random.default_rng(8)
    periods, share = 120, 0.6
    draws = [telescoping(rng, periods, 30, 1, share) for _ in range(150)]
    true = np.mean([np.abs(z.mean(axis=0)) ** 2 for z in draws])
    assert true == pytest.approx(1 / periods, rel=0.05)
    by_scatter = mean_of(white_covariance, draws).real.mean()
    by_neighbours = mean_of(correlated_covariance, draws).real.mean()
    assert by_scatter / true == pytest.approx(1 + 2 * share**2, rel=0.05)
    # The neighbours' own share of it grows with their distance: some per cent at a twelfth.
    assert by_neighbours / true == pytest.approx(1.0, rel=0.08)


@pytest.mark.parametrize("coefficient", [-0.6, -0.3, 0.3])
def test_autoregressive_noise(coefficient):
    rng = np.random.default_rng(9)
    periods = 240
    draws = [autoregressive(rng, periods, 20, 1, coefficient) for _ in range(150)]
    true = np.mean([np.abs(z.mean(axis=0)) ** 2 for z in draws])
    assert true * periods == pytest.approx(1 / (1 - coefficient) ** 2, rel=0.08)
    by_scatter = mean_of(white_covariance, draws).real.mean() / true
    by_neighbours = mean_of(correlated_covariance, draws).real.mean() / true
    assert by_neighbours == pytest.approx(1.0, abs=0.12)
    assert abs(by_scatter - 1) > 4 * abs(by_neighbours - 1)


def test_lag_one_correlation():
    rng = np.random.default_rng(10)
    independent = np.mean([lag_one_correlation(white(rng, 20)) for _ in range(300)])
    assert independent == pytest.approx(-1 / 20, abs=0.004)
    z = autoregressive(rng, 4000, 6, 2, 0.5)
    assert lag_one_correlation(z) == pytest.approx(0.5, abs=0.02)
    np.testing.assert_allclose(lag_one_correlation(1e-9 * z), lag_one_correlation(z))


def test_no_noise_is_no_correlation():
    same = np.ones((50, 3, 2), dtype=complex) * (1 + 1j) / 3
    rounding = same * (1 + 1e-15 * np.arange(50)[:, None, None])
    for z in (same, rounding, np.zeros((50, 3, 2), dtype=complex)):
        assert lag_one_correlation(z) == 0
        assert not is_correlated(z)
        assert choose_covariance(z, z).kind == "white"


def test_rows_without_noise_do_not_hide_those_with_it():
    z = autoregressive(np.random.default_rng(11), 260, 6, 2, 0.4)
    z[..., 1] = 3.0
    assert is_correlated(z)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("periods", "lines", "rows"), [(260, 6, 8), (40, 6, 1), (8, 1, 1), (260, 1, 4), (20, 41, 1)]
)
def test_false_alarms_are_rare(periods, lines, rows):
    rng = np.random.default_rng(12)
    alarms = [is_correlated(white(rng, periods, lines, rows)) for _ in range(1000)]
    assert np.mean(alarms) < 0.01


@pytest.mark.parametrize("harmonics", [[0], [0, 1]])
def test_false_alarms_are_rare_on_real_lines(harmonics):
    rng = np.random.default_rng(13)
    alarms = 0
    for _ in range(1000):
        z = white(rng, 100, len(harmonics), 1)
        z[:, 0] = np.sqrt(2) * z[:, 0].real
        alarms += is_correlated(z)
    assert alarms < 15


def test_a_weak_correlation_is_detected():
    """Lag-one correlation of -0.15 at 260 periods, 6 lines."""
    rng = np.random.default_rng(14)
    share = np.sqrt(0.15 / (1 - 2 * 0.15))  # -s^2 / (1 + 2 s^2) = -0.15
    found = [is_correlated(telescoping(rng, 260, 6, 2, share)) for _ in range(300)]
    lag = [lag_one_correlation(telescoping(rng, 260, 6, 2, share)) for _ in range(100)]
    assert np.mean(lag) == pytest.approx(-0.15, abs=0.01)
    assert np.mean(found) > 0.95


def test_the_rule_chooses():
    rng = np.random.default_rng(15)
    z, carried = white(rng), telescoping(rng, 260, 6)
    assert choose_covariance(z, z).kind == "white"
    assert choose_covariance(carried, carried).kind == "correlated"
    assert choose_covariance(z, carried).matrices.shape == (6, 2, 2)
    assert choose_covariance(z, carried).kind == "correlated"


def test_few_periods_are_taken_as_independent():
    z = autoregressive(np.random.default_rng(16), 7, 6, 2, 0.9)
    assert not is_correlated(z)


@pytest.mark.parametrize("formula", [white_covariance, correlated_covariance])
def test_one_period_is_not_enough(formula):
    with pytest.raises(InputError, match="found 1 periods; expected 2 or more"):
        formula(np.ones((1, 2, 2), dtype=complex))


@pytest.mark.parametrize("m", [0, -1, 6, 100])
def test_impossible_neighbours(m):
    with pytest.raises(InputError, match=f"found {m} neighbouring lines; expected 1 to 5"):
        correlated_covariance(np.ones((10, 2, 2), dtype=complex), m)
