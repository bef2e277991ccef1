"""Where what is said of a signal turns over, and how closely it is looked at."""

import numpy as np
import pytest

from rotorid import Channel, InputError, Record, average
from rotorid.signals import period_search as periodicity
from rotorid.signals.angle import _rhythm, _without_excursions, keyphasor_angle, pulse_edges
from rotorid.signals.average import _excerpt
from rotorid.signals.checks import rotation as checks_rotation
from rotorid.signals.checks import timing as checks_timing
from rotorid.signals.checks.channels import _flat


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
