"""What the deviations of modes, critical speeds and balancing hold, over many records.

The whole figures, of 500 records each, are those of ``benchmarks/results.py``.
"""

import numpy as np
import pytest
from result_cases import (
    balanced,
    by_few_lines,
    by_periods,
    by_the_rig,
    close_case,
    covered,
    errors_at_the_minimum,
    found_at_the_minimum,
)

pytestmark = pytest.mark.slow


def test_deviations_hold_with_few_periods_and_where_few_lines_tell():
    """Damping c, d and the cross stiffness e are told by lines at the resonance."""
    cases = (close_case(seed, periods=10, stream=77) for seed in range(600))
    found = [errors_at_the_minimum(case) for case in cases]
    assert set(found[0]) == {"m", "I_t", "I_p", "k_x", "k_y", "c", "d", "e"}
    for name in found[0]:
        held = np.mean([abs(each[name]) < 1.96 for each in found])
        assert 0.923 < held < 0.977, name  # known to .9 percent
        # Known to 2.9 percent; without _widening 1.12 of ten periods.
        assert np.sqrt(np.mean([each[name] ** 2 for each in found])) < 1.08, name


def test_modes_and_critical_speeds_that_come_close():
    found = [found_at_the_minimum(seed) for seed in range(1000, 1040)]
    close = np.array([each.close for each in found])
    assert 0.3 < close[:, 1:3].mean() < 0.95  # the two bounce modes, in many records
    for name in ("frequency", "critical"):
        rows = np.array([getattr(each, name) for each in found])
        held = np.array([covered(each) for each in rows])
        away = (rows[..., 0] - rows[..., 4]) / rows[..., 1]
        assert held.mean() > 0.89, name  # of 120 to 160, half of them alike: known to 3 percent
        assert np.sqrt((away**2).mean()) < 1.2, name


def test_a_balanced_rotor_has_less_left_than_stated():
    found = [balanced(seed, "quick") for seed in range(1000, 1040)]
    assert sum(each.status == "ok" for each in found) >= 38
    good = [each for each in found if each.status == "ok"]
    left, stated = (np.array([getattr(e, n) for e in good]) for n in ("left", "stated"))
    before = np.array([e.before for e in good])
    assert 0.88 < (left <= stated).mean() < 0.995
    assert np.median(left.sum(axis=1) / before.sum(axis=1)) < 0.02


@pytest.mark.parametrize(
    ("draw", "count", "least", "most"),
    [(by_periods, 70, 0.9, 0.05), (by_the_rig, 10, 0.7, 0.1)],
    ids=["by lines", "simulated"],
)
def test_peaks_of_sensitivity_and_their_zones(draw, count, least, most):
    """Intervals half as wide as they should be hold two thirds of the peaks: found always by 70.

    S has noise of up to 3 percent of 1 on every line, and some 2 percent in the rig; `most` is
    the root mean square of what the peaks are off, in dB.
    """
    found = [draw(seed) for seed in range(1000, 1000 + count)]
    assert np.mean([each.held for each in found]) >= least
    assert np.mean([each.wrong for each in found]) <= 0.03
    off = np.array([each.off_db for each in found])
    assert np.sqrt((off**2).mean()) < most
    assert abs(off.mean()) < most / 2


def test_peaks_of_sensitivity_without_much_noise():
    found = [by_periods(seed, (1e-4, 1e-3)) for seed in range(1000, 1040)]
    assert np.mean([each.held for each in found]) >= 0.93
    assert max(abs(each.off_db) for each in found) < 0.03


def test_peaks_of_sensitivity_in_short_records():
    """Of two seconds. By parabolas in windows a third of these were held, and zones were wrong.

    Intervals of half their width hold two thirds; of 14 records that is found with 97 %.
    """
    found = [by_few_lines(seed, (2,)) for seed in range(1000, 1014)]
    assert np.mean([each.held for each in found]) >= 0.9
    assert not any(each.wrong for each in found)
    assert np.sqrt(np.mean([each.off_db**2 for each in found])) < 0.1
