"""Clocks merged into one pattern."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid import InputError
from rotorid.rig.machine import merge_clocks


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 40))
def test_every_clock_ticks_as_often_as_it_should(p: int, q: int, tenths: int) -> None:
    control_rate, sample_rate = 1000.0 * p, 1000.0 * q
    delay = tenths / 10 / control_rate
    found = merge_clocks(control_rate, sample_rate, delay)
    assert found.duration == pytest.approx(1e-3 / np.gcd(p, q))
    assert found.length.sum() == pytest.approx(found.duration)
    assert (found.length > 0).all()
    np.testing.assert_allclose(np.diff(found.offset), found.length[:-1], atol=1e-15)
    for ticks, rate in ((found.control, control_rate), (found.log, sample_rate)):
        at = found.offset[ticks >= 0]
        np.testing.assert_allclose(at, np.arange(len(at)) / rate, atol=1e-15)
        np.testing.assert_array_equal(ticks[ticks >= 0], np.arange(len(at)))
    effect = found.offset[found.apply >= 0] + found.lag / control_rate
    begun = found.apply[found.apply >= 0] / control_rate
    np.testing.assert_allclose(effect, begun + delay, atol=1e-12)
    assert found.lag == Fraction(tenths, 10) // 1


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        ((0.0, 1.0, 0.0), "rate: found 0.0 Hz"),
        ((1.0, -1.0, 0.0), "sample_rate: found -1.0 Hz"),
        ((1.0, 1.0, -1e-3), "delay: found -0.001 s"),
        ((1e4, 1e4 * (1 + 1e-6), 0.0), "samples at 10000.01 Hz; expected a ratio of whole num"),
        ((1e4, np.pi * 1e4, 0.0), "choose rates of a simpler ratio"),
    ],
)
def test_clocks_that_never_meet_are_refused(rates, message: str) -> None:
    with pytest.raises(InputError, match=message):
        merge_clocks(*rates)
