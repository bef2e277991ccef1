"""The decisions of a peak's fit, each at its edge."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy

from rotorid.results import sensitivity
from rotorid.results import sensitivity_peak as peak
from rotorid.results.sensitivity_peak import (
    LineWindow,
    LocatedPeak,
    LoopLines,
    Peak,
    RationalCurve,
    best_curve,
    fitted,
    peak_near,
)

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
