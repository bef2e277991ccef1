"""Where a sensitivity turns over: what is a peak, what is an axis' own, what lines tell nothing."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rotorid import InputError
from rotorid.results import sensitivity

LINES = np.arange(1.0, 41.0)


def resonance(at: float, width: float = 1.0) -> np.ndarray:
    """Return a pole on the lines, of size 1 where it is highest, whose half width is given."""
    return 1 / (1 + 1j * (LINES - at) / width)


def test_a_peak_is_told_to_a_twentieth_of_a_line() -> None:
    places = 20 + np.linspace(0.0, 1.0, 101)
    size, where = sensitivity.peak_of(LINES, np.array([resonance(at) for at in places]))
    assert np.abs(where - places).max() == pytest.approx(0.025, rel=0.25)
    assert np.abs(20 * where - np.round(20 * where)).max() < 1e-9
    assert np.abs(size - 1).max() < 1e-3


@pytest.mark.parametrize(("above", "peak"), [(1.49, True), (1.51, False)])
def test_a_peak_half_as_high_again_as_any_line_is_none(above: float, peak: bool) -> None:
    width = 0.5 / np.sqrt(above**2 - 1)
    (size,), (where,) = sensitivity.peak_of(LINES, resonance(20.5, width)[None])
    assert size == pytest.approx(1.0 if peak else 1 / above, rel=1e-6)
    assert (where == 20.5) == peak


def test_a_line_on_a_pole_weighs_a_thousand_times_as_much_as_the_farthest(monkeypatch) -> None:
    weights: list[np.ndarray] = []
    solve = np.linalg.pinv

    def watched(matrix, rcond):
        weights.append(np.abs(matrix[0, :, 0]))  # of the constant
        return solve(matrix, rcond=rcond)

    monkeypatch.setattr(np.linalg, "pinv", watched)
    sensitivity._Curve.of(LINES[:10], 1 + 100 * resonance(5.0, 1e-5)[None, :10])
    assert weights[-1].argmax() == 4
    assert weights[-1].max() / weights[-1].min() == pytest.approx(1000.0, rel=1e-6)


def test_the_interval_holds_the_peak_with_95_percent_by_a_thousand_draws() -> None:
    """One line, whose size scatters like its real part."""
    rng, drawn = np.random.default_rng(3), []
    counted = SimpleNamespace(
        standard_normal=lambda shape: drawn.append(shape[0]) or rng.standard_normal(shape),
        chisquare=rng.chisquare,
    )
    one = np.ones(1)
    found = sensitivity._axis("x", one, 2 * one + 0j, 2e-6 * one, 1e9 * one, counted)
    assert np.diff(found.interval)[0] / 2e-3 == pytest.approx(1.96, rel=0.06)
    assert drawn == [1000]


def window_of(monkeypatch, deviation: float = 0.1) -> tuple[int, list[float]]:
    """Return in how many windows of 190 lines S = 1 is told, and the chance asked of each."""
    chances: list[float] = []

    def best(self, e):
        chances.append(self.chance)
        return 1 + 0j, deviation**2, 10.0, 1.0, 0.0

    monkeypatch.setattr(sensitivity._Window, "best", best)
    count = 190
    lines = np.ones((count, 1)) + 0j
    ((raw, candidates),) = sensitivity._windows(np.arange(count), lines, lines, lines[:, :0])
    assert len(raw[0]) == len(candidates)
    return len(candidates), chances


@pytest.mark.parametrize(("deviation", "told"), [(0.29, True), (0.31, False)])
def test_a_line_that_was_not_excited_says_nothing(monkeypatch, deviation, told) -> None:
    windows, chances = window_of(monkeypatch, deviation)
    assert windows == (len(chances) if told else 0)


def test_noise_alone_gives_poles_to_one_of_a_hundred_records(monkeypatch) -> None:
    assert sum(window_of(monkeypatch)[1]) == pytest.approx(0.01, rel=0.1)


def test_what_a_window_asks_for() -> None:
    """S and the transient have 6 unknowns; a dozen degrees of freedom are left for the noise."""
    lines = np.ones((18, 1)) + 0j
    with pytest.raises(InputError, match=r"18 lines in the band; expected 19 or more"):
        sensitivity._windows(np.arange(18.0), lines, lines, lines[:, :0])


@pytest.mark.parametrize(("poles", "noise"), [(2, 1e-9), (0, 0.1)])
def test_a_window_has_two_poles_where_noise_alone_does_not_explain_them(poles, noise) -> None:
    rng = np.random.default_rng(7)
    offset = np.arange(-9, 10) / 9
    powers = offset[:, None] ** np.arange(3)
    r, drawn = rng.standard_normal((2, 19, 2)) @ np.array([1.0, 1j])
    below = (1 + 6j * (offset - 0.2)) * (1 + 5j * (offset + 0.5)) if poles else 1.0
    matrix = np.column_stack([r[:, None] * powers, powers])
    window = sensitivity._Window(matrix, offset, 0, float(np.abs(r).max()), 1e-3)
    found = window.best((2 + offset) * r / below + noise * drawn)
    assert found is not None
    value, _, freedom, _, _ = found
    assert freedom == 13 - poles
    exact = 2 / ((1 - 1.2j) * (1 + 2.5j)) if poles else 2.0
    assert abs(value / exact - 1) < 3 * noise


def whole(monkeypatch, unsure: float) -> tuple[sensitivity.AxisSensitivity, list[float]]:
    """Return an axis of five peaks, the higher the further down, and where it was looked."""
    asked: list[float] = []

    def peak_near(band, hertz):
        asked.append(hertz)
        size = hertz / 10
        return SimpleNamespace(
            hertz=hertz,
            reach=1.0,
            unsure=0.0 if len(asked) == 1 else unsure,
            peak=SimpleNamespace(size=size, value=size + 0j, std=0.01),
            interval=lambda chance: (size - 0.02, size + 0.02),
        )

    monkeypatch.setattr(sensitivity, "peak_near", peak_near)
    raw = (np.array([5.0]), np.ones(1) + 0j, np.ones(1), np.ones(1))
    candidates = [(9.0 - k, 10.0 * k) for k in range(1, 6)]
    axis = sensitivity._Whole(raw, None, candidates).axis("x", np.random.default_rng(1))
    return axis, asked


def test_three_peaks_of_an_axis_are_looked_at(monkeypatch) -> None:
    axis, asked = whole(monkeypatch, 0.01)
    assert asked == [10.0, 20.0, 30.0]
    assert axis.peak == 3.0


@pytest.mark.parametrize(("unsure", "peak"), [(0.099, 3.0), (0.101, 1.0)])
def test_a_second_peak_that_is_not_known_to_a_tenth_is_none(monkeypatch, unsure, peak) -> None:
    assert whole(monkeypatch, unsure)[0].peak == peak


def test_three_times_the_rotation_answers_no_excitation() -> None:
    record = SimpleNamespace(speed=2 * np.pi * 50.0, sample_rate=1000.0, mean=np.zeros(200))
    assert [sensitivity._rotates(record, 50.0 * n) for n in range(1, 6)] == [True] * 3 + [False] * 2
    assert [sensitivity._rotates(record, hertz) for hertz in (102.4, 102.6)] == [True, False]


def periods(*excitation: float) -> SimpleNamespace:
    """Return periods of a line on which S is 2 and 3, and what was added to two axes."""
    r = np.array(excitation)
    lines = np.tile(np.concatenate([r * [2.0, 3.0], r]) + 0j, (4, 1, 1))
    return SimpleNamespace(
        names=("e1", "e2", "r1", "r2"),
        spectra=lines,
        harmonics=np.array([1]),
        mean=np.zeros(100),
        sample_rate=1000.0,
        speed=0.0,
    )


@pytest.mark.parametrize(("records", "alone"), [(1, 0.9e-6), (1, 1.1e-6), (2, 0.9e-6), (2, 1.1e-6)])
def test_a_millionth_of_another_axis_is_an_axis_own(records, alone) -> None:
    """Of one record the share of the other axis; of two, how far their directions are apart."""
    if records == 1:
        made, axes, told = [periods(1.0, alone), periods(0.0, 1.0)], 2, alone < 1e-6
        made[1].harmonics = np.array([2])
    else:
        made, axes, told = [periods(1.0, 1.0), periods(1.0, 1.0 + 4 * alone)], 2, alone > 1e-6
    pairs = {"e1": "r1", "e2": "r2"}
    if told:
        assert len(sensitivity._of_periods(made, pairs)) == axes
    else:
        with pytest.raises(InputError, match="no line on which"):
            sensitivity._of_periods(made, pairs)
