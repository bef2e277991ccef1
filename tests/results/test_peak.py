"""The peak of S on the lines of whole records, held against loops in closed form."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy
from loop_cases import sampled_loop

import rotorid as rid
from rotorid.results import sensitivity
from rotorid.results import sensitivity_peak as peak
from rotorid.results.sensitivity import settles_elsewhere, worst_of
from rotorid.results.sensitivity_peak import (
    LineWindow,
    LocatedPeak,
    LoopLines,
    Peak,
    RationalCurve,
    best_curve,
    fitted,
    judged,
    least_lines,
    peak_near,
)

# -------------------------------------------------------------------------------------------------
# The peak of S on the lines of whole records, held against loops in closed form.


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


# -------------------------------------------------------------------------------------------------
# The decisions of a peak's fit, each at its edge.


NOTHING = np.zeros((100, 0), dtype=np.complex128)


def part_of(e: np.ndarray) -> LineWindow:
    size = len(e)
    place = np.linspace(-1.0, 1.0, size)
    ones = np.ones(size)
    return LineWindow(place, e + 0j, ones[:, None] + 0j, NOTHING[:size], 0, ones)


def curve_of(part: LineWindow, pole: complex, loss: float = 1.0) -> RationalCurve:
    """Return a curve of one pole, or of none, that explains nothing of its lines."""
    below = np.array([-1 / pole]) if pole else np.zeros(0, dtype=np.complex128)
    poles = len(below)
    columns = 2 * (peak.order_of(poles) + 1)
    return RationalCurve(part, below, np.zeros(columns, dtype=np.complex128), poles, loss)


@pytest.mark.parametrize(("chance", "poles"), [(0.0095, 1), (0.0105, 0)])
def test_a_pole_more_has_to_gain(
    monkeypatch: pytest.MonkeyPatch, chance: float, poles: int
) -> None:
    part = part_of(np.ones(100))
    one, none = curve_of(part, 0.1 + 0.2j), curve_of(part, 0.0)
    more = len(one.linear) + 1 - len(none.linear)
    rest = len(part.e) - len(one.linear) - 1
    ratio = scipy.special.fdtri(2 * more, 2 * rest, 1 - chance)
    further = RationalCurve(
        part, np.zeros(2) + 0j, np.zeros(2 * (peak.order_of(2) + 1)) + 0j, 2, 1.0
    )
    curves = {0: replace(none, loss=1 + ratio * more / rest), 1: one, 2: further}
    monkeypatch.setattr(peak, "fitted", lambda _, poles: curves[poles])
    assert best_curve(part).poles == poles


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8, 0.95, 0.99, 1.0])
def test_noise_has_the_poles_of_the_loop_by_a_share(share: float) -> None:
    """What is left has exactly that share's size on each line: no other weighs it as well."""
    part = part_of(np.ones(100))
    poles = 1 / np.abs(1 - part.place / (0.1 + 0.05j)) ** 2
    size = 1 - share + share * poles / poles.mean()
    weighed = peak._weighed(curve_of(replace(part, e=np.sqrt(size) + 0j), 0.1 + 0.05j))
    np.testing.assert_allclose(weighed.weight, 1 / np.sqrt(size), rtol=1e-12)


@pytest.mark.parametrize(("lines", "decays"), [(0.48, False), (0.52, True)])
def test_a_pole_that_does_not_decay_is_none(lines: float, decays: bool) -> None:
    spacing = 2 / 99
    assert curve_of(part_of(np.ones(100)), 0.1 + 1j * lines * spacing).decays == decays


def test_a_fit_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where every step gains: four of Sanathanan and Koerner, twelve of Gauss and Newton."""
    kinds: list[str] = []
    real, svd = peak._linear, peak._svd

    def gaining(part: LineWindow, poles: int, below: np.ndarray) -> RationalCurve:
        return replace(real(part, poles, below), loss=0.5 ** len(kinds))

    def counted(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        kinds.append("")
        return svd(matrix)

    rng = np.random.default_rng(1)
    part = part_of(rng.standard_normal(100))
    monkeypatch.setattr(peak, "_linear", gaining)
    monkeypatch.setattr(peak, "_svd", counted)
    fitted(part, 1)
    linear = 1 + peak.ROUNDS + peak.STEPS
    assert len(kinds) == linear + peak.ROUNDS + peak.STEPS


def at(place: float, **given: float | bool) -> Peak:
    whole = {"std": 0.1, "dof": 20.0, "chance": 0.5, "width": np.inf, "inside": True, **given}
    return Peak(value=1.0 + 0j, place=place, **whole)


@pytest.fixture
def climbing(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], tuple[LocatedPeak | None, int]]:
    """Climb to a frequency from 500 Hz by windows of 100 lines, 1 Hz apart; and count them."""
    lines = np.arange(1000.0)
    band = LoopLines(lines, lines + 0j, lines[:, None] + 0j, np.zeros((1000, 0)) + 0j, 0)

    def climb(target: float) -> tuple[LocatedPeak | None, int]:
        seen = []

        def highest(curve: float, low: float, high: float) -> Peak:
            seen.append((low, high))
            place = (target - curve) / 49.5 - 1
            return at(float(np.clip(place, low, high)), inside=low < place < high)

        def first(part: LineWindow) -> float:
            return float(part.e[0].real)

        monkeypatch.setattr(peak, "best_curve", first)
        monkeypatch.setattr(peak, "judged", highest)
        found = band.climbed(500.0, 100)
        return found, len(seen)

    return climb


def test_lines_are_moved_on_to_the_highest_point(
    climbing: Callable[[float], tuple[LocatedPeak | None, int]],
) -> None:
    middle, inner = 450 + 49.5, 0.6 * 49.5
    assert climbing(middle + inner - 0.4)[1] == 1
    assert climbing(middle + inner + 0.4)[1] == 2
    found, times = climbing(612.0)
    assert found is not None
    assert (found.hertz, times) == (pytest.approx(612.0), 4)
    assert climbing(630.0) == (None, 4)


def held(unsure: float, chance: float = 0.5) -> LocatedPeak:
    return LocatedPeak(at(0.0, std=unsure, chance=chance), 500.0, 50, 50.0, np.inf)


def times(
    monkeypatch: pytest.MonkeyPatch, peaks: list[LocatedPeak | None]
) -> tuple[LocatedPeak | None, int]:
    """Return the peak near 500 Hz, and the windows that were tried, of peaks as they come."""
    sizes = []

    def climbed(_: LoopLines, hertz: float, size: int) -> LocatedPeak | None:
        sizes.append(size)
        return peaks[min(len(sizes), len(peaks)) - 1]

    monkeypatch.setattr(LoopLines, "climbed", climbed)
    lines = np.arange(100_000.0)
    found = peak_near(LoopLines(lines, lines, lines[:, None], NOTHING, 0), 500.0)
    assert sizes == [sizes[0] * 2**k for k in range(len(sizes))]
    return found, len(sizes)


def test_wider_windows_are_tried_until_three_tell_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    assert times(monkeypatch, [held(0.1), held(0.2)])[1] == 1 + 3
    assert times(monkeypatch, [held(0.2), held(0.21), held(0.22), held(0.1), held(0.2)])[1] == 4 + 3


@pytest.mark.parametrize(
    ("unsure", "chance", "told"),
    [(0.29, 0.5, True), (0.31, 0.5, False), (0.1, 1.1e-3, True), (0.1, 0.9e-3, False)],
)
def test_a_peak_has_to_be_told_and_followed(
    monkeypatch: pytest.MonkeyPatch, unsure: float, chance: float, told: bool
) -> None:
    found, _ = times(monkeypatch, [held(unsure, chance)])
    assert (found is not None) == told


def looked_at(monkeypatch: pytest.MonkeyPatch, peaks: list[LocatedPeak]) -> tuple[int, float]:
    """Return how many candidates of an axis are looked at, and the upper end of its interval."""
    lines = np.arange(1.0, 1001.0)
    raw = (lines, np.ones(1000) + 0j, np.full(1000, 1e-4), np.full(1000, 20.0))
    band = LoopLines(lines, lines, lines[:, None], NOTHING, 0)
    whole = sensitivity._Whole(raw, band, [(9.0 - k, 100.0 * (k + 1)) for k in range(len(peaks))])
    asked: list[float] = []

    def near(_: LoopLines, hertz: float) -> LocatedPeak:
        asked.append(hertz)
        return replace(peaks[len(asked) - 1], hertz=hertz)

    monkeypatch.setattr(sensitivity, "peak_near", near)
    axis = whole.axis("x", np.random.default_rng(1))
    return len(asked), axis.interval[1]


def test_how_many_peaks_are_looked_at_and_which_rival(monkeypatch: pytest.MonkeyPatch) -> None:
    sure = held(0.01)
    assert looked_at(monkeypatch, [sure] * 5)[0] == 3
    rivals = [looked_at(monkeypatch, [sure, held(unsure)]) for unsure in (0.095, 0.105)]
    assert rivals[0][1] > 1.15 > 1.03 > rivals[1][1]


def test_a_curve_of_lines_is_fitted_in_three_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    real = np.linalg.pinv

    def counted(matrix: np.ndarray, **given: float) -> np.ndarray:
        calls.append(matrix.shape)
        return np.asarray(real(matrix, **given))

    monkeypatch.setattr(np.linalg, "pinv", counted)
    nodes = np.linspace(10.0, 20.0, 10)
    values = 1 / (1 + 1j * (nodes - 14.3))
    curve = sensitivity._Curve.of(nodes, values[None])
    assert len(calls) == 3
    np.testing.assert_allclose(curve.at(nodes)[0], values, rtol=1e-9)
