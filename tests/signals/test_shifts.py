"""Shifts of periods: all channels at once, against one by one."""

import numpy as np
import pytest

import rotorid as rid
from rotorid.signals.checks.timing import (
    STEP,
    Shifts,
    _may_step,
    _small_shifts,
    fit_shifts,
    shifts_of,
)

RATE, SIZE, COUNT = 1000.0, 200, 60
FUNDAMENTAL = RATE / SIZE


def periods_of(tau: np.ndarray, noise: float) -> rid.PeriodicRecord:
    """Return periods that come late by tau, seen by two channels."""
    rng = np.random.default_rng(1)
    time = np.arange(SIZE) / RATE - tau[:, None]
    waves = [sum(np.cos(2 * np.pi * k * FUNDAMENTAL * time + k) for k in (1, 3)), np.zeros(1)]
    waves[1] = 2.0 * np.sin(2 * np.pi * FUNDAMENTAL * time)
    samples = np.stack(waves, axis=-1).reshape(-1, 2)
    samples = samples + noise * rng.standard_normal(samples.shape)
    channels = [rid.Channel("x", "m"), rid.Channel("y", "m")]
    return rid.average(rid.Record(channels, samples, RATE), FUNDAMENTAL, harmonics=[1, 3])


@pytest.mark.parametrize("noise", [0.02, 0.3])
def test_all_channels_at_once_are_as_one_by_one(noise: float) -> None:
    tau = 2e-4 * np.sin(np.arange(COUNT))
    periods = periods_of(tau, noise)
    found = _small_shifts(periods)
    whole = shifts_of(periods, [0, 1])
    assert found is not None
    assert whole is not None
    assert sorted(found) == [0, 1]
    for channel, shifts in found.items():
        one = shifts_of(periods, [channel], whole.tau)
        assert one is not None
        assert shifts.noise == pytest.approx(one.noise, rel=1e-9)
        assert shifts.explained == pytest.approx(one.explained, abs=0.02)
        assert np.abs(shifts.tau - one.tau).max() < 0.25 * one.noise + 2e-7
    if noise < 0.1:
        np.testing.assert_allclose(found[0].tau, tau - tau[0], atol=6 * found[0].noise)


@pytest.mark.parametrize(("turn", "small"), [(0.95, True), (1.05, False)])
def test_where_phases_could_wrap_it_is_one_by_one(turn: float, small: bool) -> None:
    """Two periods of 60 come late and early so that the third line turns by `turn`."""
    tau = np.zeros(COUNT)
    tau[[20, 40]] = np.array([1, -1]) * turn / (2 * np.pi * 3 * FUNDAMENTAL)
    assert (_small_shifts(periods_of(tau, 1e-4)) is not None) == small


def test_no_clear_step_is_passed_over() -> None:
    """Steps around the least clear one, at any place: what is not looked at is not clear."""
    rng = np.random.default_rng(2)
    looked_at = 0
    for trial in range(300):
        tau = rng.standard_normal(COUNT)
        at = int(rng.integers(2, COUNT - 2))
        tau += rng.uniform(0.0, 6.0) * (np.arange(COUNT) >= at)
        fit = fit_shifts(tau, 1.0)
        shifts = Shifts(tau, 1.0, 1.0)
        looked_at += bool(may := _may_step({0: shifts}))
        assert may or abs(fit.step) <= STEP * fit.step_std, trial
    assert 0 < looked_at < 290
