"""The peak of S on the lines of whole records, held against loops in closed form."""

import numpy as np
import pytest
from loop_cases import sampled_loop

import rotorid as rid
from rotorid.results import sensitivity_peak as peak
from rotorid.results.sensitivity import settles_elsewhere, worst_of
from rotorid.results.sensitivity_peak import (
    LineWindow,
    LocatedPeak,
    LoopLines,
    best_curve,
    fitted,
    judged,
    least_lines,
    peak_near,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "gains", "size"), [(4, (2e4, 10.0), 3.1019), (2, (3e4, 14.0), 3.8956)]
)
def test_a_peak_that_is_narrower_than_a_window_of_lines(seconds, gains, size):
    """2 Hz wide at its half power, windows of 22 lines 5.5 and 11 Hz: parabolas said zone A."""
    record, exact = sampled_loop(*gains, seconds, np.random.default_rng(3))
    assert exact == pytest.approx(size, rel=1e-4)
    (found,) = rid.sensitivity(record, {"e": "r"}, band=("8 Hz", "400 Hz"))
    assert found.interval[0] < exact < found.interval[1]
    assert found.interval[1] / found.interval[0] < 1.01
    assert found.verdict == "zone B"
    assert np.abs(found.sensitivity).max() == pytest.approx(found.peak)  # as it is drawn


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "zone"), [(2.0, "A or worse"), (1.43, "A or worse"), (0.5, "D")])
def test_a_reference_of_another_unit_or_gain(gain, zone):
    record, exact = sampled_loop(1.5e5, 60.0, 2, np.random.default_rng(4), damping=60.0, gain=gain)
    (found,) = rid.sensitivity(record, {"e": "r"}, band=("8 Hz", "400 Hz"))
    assert found.peak == pytest.approx(exact / gain, rel=0.02)
    assert found.zone == zone
    for said in (found.verdict, worst_of([found])):
        assert "not in one unit or gain, or the loop still has gain there" in said
        assert f"zone {zone}" in said


def test_where_s_comes_to():
    """Edges of LEAST_SETTLED, UNIT and FLAT, and of AT_END where the change is noise."""
    lines = np.linspace(10.0, 300.0, 60)
    quiet = np.full(60, 1e-5)

    def said(values, std=quiet):
        return bool(settles_elsewhere(lines[: len(values)], values + 0j, std[: len(values)]))

    assert "stays at 0.51" in settles_elsewhere(lines, np.full(60, 0.51 + 0j), quiet)
    assert not said(np.ones(60))
    # What falls as the gain of a loop does is its gain.
    for power in (1, 2):
        assert not said(1 + 0.3 * (10 / lines) ** power)
        assert not said(1 - 0.3 * np.exp(-2j * lines / 300) * (300 / lines) ** power)
    assert [said(np.full(60, 1 + off)) for off in (0.029, 0.031, -0.031)] == [False, True, True]
    # A parabola's end is known to .61 of what each of its twenty lines is: a change of twice that.
    off = 4 * 2 * 0.609 * 0.1 * np.sqrt(2)
    noisy = np.full(60, 0.1)
    assert [said(np.full(60, 1 + x * off), noisy) for x in (0.98, 1.02)] == [False, True]
    steps = 1.3 + 0.3 * np.clip((lines - 202.0) / 98.0, 0, 1)
    assert [said(1.5 + slope * (steps - 1.45)) for slope in (0.35, 0.45)] == [True, False]
    assert [said(np.full(count, 0.5)) for count in (14, 15)] == [False, True]


def made(size: int, noise: float, rng: np.random.Generator, coloured: bool = False) -> LineWindow:
    """Return lines of S = 1 + 2 / (1 + 20i x) with a transient of its pole."""
    place = np.linspace(-1.0, 1.0, size)
    below = 1 + 20j * place
    r = rng.standard_normal((size, 2)) @ np.array([1.0, 1j])
    drawn = noise * (rng.standard_normal((size, 2)) @ np.array([1.0, 1j])) / np.sqrt(2)
    drawn = drawn / below * 3 if coloured else drawn
    e = (1 + 2 / below) * r + 0.5 / below + drawn
    return LineWindow(place, e, r[:, None], np.zeros((size, 0)) + 0j, 0, np.ones(size))


def test_curves_have_the_poles_that_their_lines_tell():
    rng = np.random.default_rng(1)
    exact = best_curve(made(60, 1e-6, rng))
    assert exact.poles == 1
    assert exact.roots[0] == pytest.approx(0.05j, rel=1e-3)
    assert np.abs(exact.at(np.zeros(1))[0]) == pytest.approx(3.0, rel=1e-5)
    # Without poles the same lines are missed, which is seen.
    assert judged(exact, -0.6, 0.6).chance > 1e-3
    assert judged(fitted(exact.part, 0), -0.6, 0.6).chance < 1e-2
    assert [least_lines(2, 2, poles) for poles in peak.POLES] == [28, 29, 33, 37]


@pytest.mark.slow
def test_deviations_of_peaks_hold_with_noise_on_all_lines_and_with_that_of_the_loop():
    """Three lines wide at the half power, where noise of the loop is all there is."""
    for coloured, least in ((False, 0.93), (True, 0.85)):
        rng = np.random.default_rng(2)
        held = []
        for _ in range(60):
            found = judged(best_curve(made(60, 0.1, rng, coloured)), -0.6, 0.6)
            low, high = LocatedPeak(found, 0.0, 60, 1.0, 1.0).interval(0.95)
            held.append(low < 3.0 < high)
            assert high / low < 2
        assert np.mean(held) >= least


def test_lines_that_tell_no_peak():
    part = made(200, 50.0, np.random.default_rng(5))
    band = LoopLines(np.arange(200.0), part.e, part.r, part.rotation, 0)
    assert peak_near(band, 100.0) is None
