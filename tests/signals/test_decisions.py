"""Where what is said of a signal turns over, and how closely it is looked at."""

import numpy as np
import pytest

import rotorid as rid
from rotorid import Channel, InputError, Record, average
from rotorid.signals import period_search as periodicity
from rotorid.signals.angle import _rhythm, _without_excursions, keyphasor_angle, pulse_edges
from rotorid.signals.average import _excerpt
from rotorid.signals.checks import rotation as checks_rotation
from rotorid.signals.checks import timing as checks_timing
from rotorid.signals.checks.channels import _flat
from rotorid.signals.checks.timing import (
    _small_shifts,
    shifts_of,
)

# -------------------------------------------------------------------------------------------------
# Where what is said of a signal turns over, and how closely it is looked at.


@pytest.mark.parametrize(("lost", "taken"), [(9, True), (10, False)])
def test_a_fifth_of_the_pulses_may_be_missing(lost: int, taken: bool) -> None:
    times = np.delete(0.01 + 0.02 * np.arange(50), 3 + 4 * np.arange(lost))
    if taken:
        assert keyphasor_angle(times, 1000, 1000.0).missing == lost
    else:
        with pytest.raises(InputError, match="10 pulses missing or too many, of 40"):
            keyphasor_angle(times, 1000, 1000.0)


@pytest.mark.parametrize(("lines", "left"), [(2.4, 2.4), (2.6, 0.0)])
def test_a_counter_that_goes_off_and_comes_back(lines: float, left: float) -> None:
    steady = np.arange(2000.0)
    off = lines * ((steady > 900) & (steady < 960))
    assert np.abs(_without_excursions(steady + off) - steady).max() == pytest.approx(left, abs=1e-9)


@pytest.mark.parametrize("usual", [12, 13])
def test_the_rhythm_is_that_of_the_first_pulses(usual: int) -> None:
    """Of the first 25: neither that of more, nor of half of them."""
    few, slower = np.full(usual, 1.0), np.full(50, 1.3)
    assert _rhythm(np.concatenate([few, slower])) == (1.0 if usual == 13 else 1.3)
    assert _rhythm(np.concatenate([few[:10], slower])) == 1.3


@pytest.mark.parametrize(("low", "high", "half"), [(0.019, 0.97, 0.5), (0.021, 0.97, 0.0)])
def test_a_sample_near_low_shows_no_flank(low: float, high: float, half: float) -> None:
    pulse = np.concatenate([np.zeros(40), [low, high], np.ones(40), [0.5]])
    _, open_ = pulse_edges(np.tile(pulse, 4), 1.0)
    np.testing.assert_allclose(open_, half)


@pytest.mark.parametrize(("count", "looked"), [(16384, 16384), (16500, 3 * 5400)])
def test_a_long_record_is_looked_at_in_parts(count: int, looked: int) -> None:
    record = Record([Channel("x", "m")], np.zeros((count, 1)), 1000.0)
    assert len(_excerpt(record, 0, 100).samples) == looked


@pytest.mark.parametrize(("share", "flat"), [(0.49, 490), (0.51, 0)])
def test_a_signal_of_two_levels_is_not_clipped(share: float, flat: int) -> None:
    samples = np.linspace(0.0, 0.9, 1000)
    samples[: round(1000 * share)] = 1.0
    assert _flat(samples, 1.0) == flat


@pytest.mark.parametrize(("turns", "size"), [(10.0009, 1.0), (10.0011, 0.0)])
def test_a_tone_on_the_grid_is_in_the_mean(turns: float, size: float) -> None:
    wave = np.cos(2 * np.pi * 10 * np.arange(5000) / 1000)
    record = Record([Channel("x", "m")], wave[:, None], 1000.0)
    periods = average(record, 1.0, harmonics=[10])
    found = checks_rotation._amplitude(record, periods, 0, turns)
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
def test_a_speed_in_another_unit_is_named(shown: float, mistake: str) -> None:
    tone = checks_rotation.Tone(140.0, 1.0, "x")
    assert mistake in checks_rotation._wrong_speed([tone], 140.0 / shown, False).found
    tone = checks_rotation.Tone(140.0 * 1.006, 1.0, "x")
    assert mistake not in checks_rotation._wrong_speed([tone], 140.0 / shown, False).found


@pytest.mark.parametrize(("count", "looked"), [(3, 0), (4, 1)])
def test_four_periods_tell_a_step_of_time(monkeypatch, count: int, looked: int) -> None:
    wave = np.cos(2 * np.pi * np.arange(100 * count) / 100)
    periods = average(Record([Channel("x", "m")], wave[:, None], 100.0), 1.0, harmonics=[1])
    seen: list[object] = []
    monkeypatch.setattr(checks_timing, "_each_shift", lambda found: seen.append(found) or {})
    checks_timing.check_timing(periods)
    assert len(seen) == looked


@pytest.mark.parametrize(("typed", "found"), [(12.34, 12.34), (12.345, None)])
def test_a_frequency_that_somebody_typed_has_four_digits(typed: float, found: float) -> None:
    assert periodicity.Period(1000.0, 0.5, 1.0).fundamental(1000 * typed) == found


# -------------------------------------------------------------------------------------------------
# Shifts of periods: all channels at once, against one by one.


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
