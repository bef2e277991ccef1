"""Times and angles that are made when they are first read."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from rotorid import Channel, Record, average
from rotorid.data.lazy_time import Steady, changed, unread
from rotorid.data.lines import PeriodicClock
from rotorid.signals.checks.rotation import synchronism

WAVE = np.random.default_rng(3).standard_normal((200, 1))


def periods_at(speed, start=0.0, angle=None):
    record = Record([Channel("x", "m")], WAVE, 100.0, speed=speed, angle=angle)
    record = record if not start else replace(record, start=start)
    return average(record, 10.0, harmonics=[1, 2, 4], skip=0.25)


def test_nothing_is_made_before_it_is_read():
    periods = periods_at(30.0)
    clock = PeriodicClock.of(changed(periods, warnings=("w",)))
    assert (periods.begin, periods.middle) == pytest.approx((0.25, 1.095))
    assert isinstance(unread(periods, "time"), Steady)
    assert isinstance(unread(clock, "angle"), Steady)
    np.testing.assert_allclose(clock.period, 0.25 + np.arange(10) / 100)
    assert isinstance(unread(clock, "time"), Steady)
    np.testing.assert_allclose(periods.time, 0.25 + np.arange(170).reshape(17, 10) / 100)
    np.testing.assert_allclose(periods.angle, 30.0 * periods.time)
    assert periods.time is periods.time
    assert (periods.begin, periods.middle) == pytest.approx((0.25, 1.095))
    with pytest.raises(ValueError, match="read-only"):
        periods.time[0, 0] = 1.0
    assert periods == periods_at(30.0) == pickle.loads(pickle.dumps(periods))
    assert periods != periods_at(31.0)


@pytest.mark.parametrize("speed", [20 * np.pi, 20.5 * np.pi, 30.0])
def test_a_steady_angle_says_what_the_same_angle_measured_says(speed):
    steady = periods_at(speed)
    measured = periods_at(speed, angle=speed * np.arange(200) / 100)
    assert isinstance(unread(steady, "angle"), Steady)
    assert not isinstance(unread(measured, "angle"), Steady)
    ours, theirs = synchronism(steady), synchronism(measured)
    np.testing.assert_allclose(ours.leakage, theirs.leakage, atol=1e-12)
    for name in ("turns", "slip", "drift", "loss"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-9)
    grids = [PeriodicClock.of(p).grid(timed=False) for p in (steady, measured)]
    assert len(grids[0][0]) == len(grids[1][0]) == (1 if speed == 20 * np.pi else 17)
    np.testing.assert_allclose(grids[0][1], grids[1][1], rtol=1e-12)
    np.testing.assert_allclose(PeriodicClock.of(steady).at_speed(7.0).angle, 7.0 * steady.time)
