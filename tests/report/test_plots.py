"""Pictures: what they draw is what was measured, in a page and in a figure alike."""

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import plotly.graph_objects
import pytest

from rotorid import (
    Channel,
    Estimate,
    InputError,
    PeriodicRecord,
    Record,
    average,
    identify,
    load_model,
)
from rotorid.answer.estimate import RecordEvidence
from rotorid.demo import ESTIMATORS, FUNDAMENTAL, HARMONICS, simulate_record
from rotorid.report import html as interactive
from rotorid.report.drawn import (
    Axis,
    Curve,
    Panel,
    correlation,
    differences,
    envelope,
    label,
    lines,
    misfit,
    residual,
    samples,
    spectra,
    waves,
)
from rotorid.report.figure import figure_of
from rotorid.results.evidence import record_evidence

IMAGES = Path(__file__).parents[2] / "docs" / "images"


MODEL = load_model("three-mass")


@pytest.fixture(scope="module")
def record() -> Record:
    return simulate_record(MODEL, np.random.default_rng(3))


@pytest.fixture(scope="module")
def periods(record: Record) -> PeriodicRecord:
    return average(record, FUNDAMENTAL, harmonics=HARMONICS)


@pytest.fixture(scope="module")
def estimates(periods: PeriodicRecord) -> dict[str, Estimate]:
    return {name: identify(MODEL, periods, ESTIMATORS[name]) for name in ("batch-100", "ml")}


@pytest.fixture(scope="module")
def evidence(periods: PeriodicRecord, estimates: dict[str, Estimate]) -> dict[str, RecordEvidence]:
    return {name: record_evidence(e, MODEL, [periods])[0] for name, e in estimates.items()}


def curve(panel: Panel, text: str) -> Curve:
    (found,) = [one for one in panel.curves if one.label.startswith(text)]
    return found


def test_positions_are_drawn_in_micrometres(periods: PeriodicRecord) -> None:
    panel = spectra(periods)[periods.index("x1")]
    assert panel.y.title == "amplitude in µm"
    found = np.abs(periods.mean_spectrum[:, periods.index("x1")])
    np.testing.assert_allclose(curve(panel, "used").y, 2e6 * found)


@pytest.mark.parametrize("name", ["batch-100", "ml"])
def test_predicted_forces_have_the_error_that_the_estimate_states(
    estimates: dict[str, Estimate], evidence: dict[str, RecordEvidence], name: str
) -> None:
    stated, record = estimates[name].prediction, evidence[name]
    for channel, over_time, on_lines in zip(
        record.channels[:4], waves(record), lines(record), strict=False
    ):
        measured, predicted = curve(over_time, "measured").y, curve(over_time, "predicted").y
        error = np.linalg.norm(predicted - measured) / np.linalg.norm(measured)
        prediction = stated[channel.name]
        assert prediction is not None
        assert error == pytest.approx(prediction.relative_error, rel=2e-3)
        assert channel.error == pytest.approx(prediction.relative_error, rel=1e-5)
        away, size = curve(on_lines, "predicted less").y, curve(on_lines, "measured").y
        assert np.linalg.norm(away) / np.linalg.norm(size) == pytest.approx(error, rel=2e-3)
        assert f"{100 * channel.error:.2g} %" in over_time.title


def test_forces_are_drawn_over_one_period_with_their_noise(
    evidence: dict[str, RecordEvidence],
) -> None:
    record = evidence["ml"]
    panels = waves(record)
    assert [panel.y.title for panel in panels] == [f"F_{n} in N" for n in ("x1", "y1", "x3", "y3")]
    assert panels[0].x.title == "time in ms"
    np.testing.assert_allclose(curve(panels[0], "predicted").x, np.arange(250) / 5)
    for panel, left in zip(panels, differences(record), strict=True):
        band, away = curve(left, "95"), curve(left, "predicted")
        assert band.base is not None
        np.testing.assert_allclose(band.base, -band.y)
        inside = np.abs(away.y) < band.y
        assert 0.7 < inside.mean() <= 1
        np.testing.assert_allclose(away.y, curve(panel, "predicted").y - curve(panel, "measured").y)


def test_what_is_left_is_shown_over_its_noise(evidence: dict[str, RecordEvidence]) -> None:
    (panel,) = residual(evidence["ml"])
    assert panel.matrix is not None
    assert panel.matrix.values.shape == (4, 6)
    size = np.sqrt((panel.matrix.values**2).mean())
    assert 0.5 < size < 1.5
    assert panel.matrix.columns.tolist() == [20, 60, 100, 140, 180, 220]


def test_correlation_names_rows_and_columns() -> None:
    panel = correlation(["a", "<b>"], np.array([[1.0, -0.9], [-0.9, 1.0]]))
    drawn = interactive.spec(panel)
    for axis in ("xaxis", "yaxis"):
        assert drawn["layout"][axis]["ticktext"] == ["a", "&lt;b&gt;"]
    assert drawn["data"][0]["text"] == [["", "\N{MINUS SIGN}.90"], ["\N{MINUS SIGN}.90", ""]]
    axes = figure_of([panel]).axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["a", "<b>"]
    assert {text.get_text() for text in axes.texts} == {"\N{MINUS SIGN}.9"}


def test_misfit_is_drawn_over_its_expectation() -> None:
    panel = misfit([0, 0, 1], [10.0, 20.0, 10.0], [12.0, 90.0, 0.0], [12.0, 12.0, 12.0])
    first, second = curve(panel, "record 1"), curve(panel, "record 2")
    np.testing.assert_allclose([first.x, first.y], [[10, 20], [1, 7.5]])
    np.testing.assert_allclose([second.x, second.y], [[10], [1]])


def test_misfit_of_phasors_is_drawn_over_the_speed_with_ticks_to_read() -> None:
    panel = misfit([0, 0], [10.0, 20.0], [12.0, 2.0], [12.0, 12.0], turning=True)
    assert panel.x.title == "speed in rpm"
    np.testing.assert_allclose(panel.curves[0].x, [600, 1200])
    axis = interactive.spec(panel)["layout"]["yaxis"]
    assert {"0.2", "0.5", "1", "2"} <= set(axis["ticktext"])
    assert "dtick" not in axis
    for top, told in ((3.9, None), (4.1, "tickvals"), (310.0, "tickvals"), (320.0, "dtick")):
        axis = interactive.spec(Panel(y=Axis(log=True, ends=(1.0, top))))["layout"]["yaxis"]
        assert [key for key in ("tickvals", "dtick") if key in axis] == ([told] if told else [])


def test_names_of_marks_stay_in_the_picture() -> None:
    x, y = np.array([-5.0, 9.0, 9.0]), np.array([3.0, 3.0, -3.0])
    marks = Curve(x, y, "masses", look="named", told=("a", "b", "c"))
    for ends, at in (
        ((-10.0, 10.0), ["middle right", "top left", "bottom left"]),
        (None, "middle right"),
    ):
        (trace,) = interactive.spec(Panel("", Axis(ends=ends), curves=(marks,)))["data"]
        assert trace["textposition"] == at


def test_a_spike_shows_in_a_long_record() -> None:
    values = np.zeros((100_000, 1))
    values[54_321] = 7.0
    record = Record([Channel("x", "V")], values, sample_rate=1000.0)
    (panel,) = samples(record)
    (band,) = panel.curves
    assert len(band.x) <= 600
    assert band.y.max() == 7.0
    assert band.x[np.argmax(band.y)] == pytest.approx(54.321, abs=0.1)
    low, high, size = envelope(np.arange(10.0), 3)
    assert (low.tolist(), high.tolist(), size) == ([0, 4], [3, 7], 4)


def test_deviations_of_an_estimate_are_drawn_in_percent(
    estimates: dict[str, Estimate],
) -> None:
    estimate = estimates["batch-100"]
    left, right, _ = estimate.plot().axes
    assert [text.get_text() for text in left.get_yticklabels()] == [v.name for v in estimate.free]
    percent = [100 * v.std / abs(v.value) for v in estimate.free]
    np.testing.assert_allclose(left.lines[0].get_xdata(), percent)
    shown = right.collections[0].get_array().reshape(estimate.correlation.shape)
    np.testing.assert_allclose(shown, estimate.correlation)
    with pytest.raises(InputError, match="without covariance"):
        estimate.with_(covariance=np.zeros((0, 0))).plot()


def test_records_draw_themselves(record: Record, periods: PeriodicRecord) -> None:
    assert len(record.plot().axes) == 12
    drawn = periods.plot().axes
    assert [axes.get_title(loc="left") for axes in drawn] == [*periods.names]


def test_every_panel_is_what_plotly_takes(
    record: Record, periods: PeriodicRecord, evidence: dict[str, RecordEvidence]
) -> None:
    """The library that draws it knows every key, and the numbers are JSON."""
    predicted = evidence["ml"]
    panels = [
        *waves(predicted),
        *differences(predicted),
        *lines(predicted),
        *residual(predicted),
        *spectra(periods)[:1],
        *samples(record)[:1],
        misfit([0, 1], [10.0, 20.0], [1.0, np.nan], [1.0, 1.0]),
        correlation(["a", "b"], np.array([[1.0, np.nan], [np.nan, 1.0]])),
    ]
    for panel in panels:
        drawn = interactive.spec(panel)
        json.dumps(drawn, allow_nan=False)
        figure = plotly.graph_objects.Figure(drawn)
        assert figure.layout.height >= 100


def test_names_are_no_markup_in_a_page() -> None:
    bad = '<a href="https://example.org">x</a>'
    panel = Panel(bad, Axis(bad), Axis(names=(bad,)), (Curve(np.ones(1), np.zeros(1), bad),))
    assert "<" not in json.dumps(interactive.spec(panel))


def test_pictures_are_the_same_each_time_and_leave_no_trace(
    evidence: dict[str, RecordEvidence],
) -> None:
    before = dict(mpl.rcParams)
    first, second = (figure_of(waves(evidence["ml"]), columns=3) for _ in range(2))
    for one, other in zip(first.axes, second.axes, strict=True):
        for a, b in zip(one.lines, other.lines, strict=True):
            np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(
    ("name", "shown"),
    [("k1*L1", "k1*L1"), ("a\nb\x00", "a b "), ("x" * 30, "x" * 23 + "…"), ("$x_{$", "$x_{$")],
)
def test_labels(name: str, shown: str) -> None:
    assert label(name) == shown


def test_pictures_of_the_documentation_are_small() -> None:
    sizes = [path.stat().st_size for path in IMAGES.iterdir()]
    assert sizes
    assert max(sizes) < 200_000
