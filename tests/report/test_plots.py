"""Pictures: what they draw is what was measured."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from rotorid.demo import DemoResult, run_demo
from rotorid.demo.paper import TABLE
from rotorid.errors import InputError
from rotorid.plots.pictures import draw_correlation, draw_forces, draw_misfit
from rotorid.plots.spectra import draw_filter, draw_spectra
from rotorid.plots.style import label, svg
from rotorid.report.demo_plots import draw_errors, draw_overview, example_waves
from rotorid.report.plots import force_waves

IMAGES = Path(__file__).parents[2] / "docs" / "images"


@pytest.fixture(scope="module")
def demo() -> DemoResult:
    return run_demo(3, rng=np.random.default_rng(3))


def curve(axes, text: str) -> tuple[np.ndarray, np.ndarray]:
    (found,) = [line for line in axes.lines if line.get_label().startswith(text)]
    return found.get_data()


def test_line_filter_shows_the_amplitudes_of_the_forces(demo: DemoResult) -> None:
    """10 sin + 10 cos is a wave of sqrt(200) N; F_x1 has half of it, in six lines."""
    example = demo.example
    whole, zoom = draw_filter(example.record, example.periods, "F_x1", 180.0).axes
    frequency, amplitude = curve(whole, "after")
    np.testing.assert_allclose(frequency, [20, 60, 100, 140, 180, 220])
    np.testing.assert_allclose(amplitude, np.sqrt(200) / 2, rtol=0.01)
    frequency, amplitude = curve(whole, "before")
    np.testing.assert_allclose(np.diff(frequency), 20 / 260)
    noise = amplitude[amplitude < 1]
    assert len(noise) == len(amplitude) - 6
    assert np.sqrt(np.mean(noise**2)) == pytest.approx(2 / np.sqrt(65000), rel=0.05)
    assert curve(zoom, "after")[0].tolist() == [180.0]
    assert whole.get_ylabel() == "amplitude in N"
    assert whole.get_xlabel() == "frequency in Hz"


def test_positions_are_drawn_in_micrometres(demo: DemoResult) -> None:
    example = demo.example
    whole, _ = draw_filter(example.record, example.periods, "x1", 180.0).axes
    assert whole.get_ylabel() == "amplitude in µm"
    lines = np.abs(example.periods.mean_spectrum[:, example.periods.index("x1")])
    np.testing.assert_allclose(curve(whole, "after")[1], 2e6 * lines)


def test_predicted_forces_have_the_error_that_the_estimate_states(demo: DemoResult) -> None:
    waves = example_waves(demo, "batch-100")
    stated = demo.example.estimates["batch-100"].prediction
    for index, name in enumerate(waves.names):
        difference = waves.predicted[:, index] - waves.measured[:, index]
        error = np.linalg.norm(difference) / np.linalg.norm(waves.measured[:, index])
        assert waves.error[index] == pytest.approx(error)
        assert waves.error[index] == pytest.approx(stated[name].relative_error)


def test_forces_are_drawn_over_one_period(demo: DemoResult) -> None:
    waves = example_waves(demo, "batch-100")
    axes = draw_forces(waves).axes
    assert [panel.get_ylabel() for panel in axes] == [f"{name} in N" for name in waves.names]
    for index, panel in enumerate(axes):
        time, force = curve(panel, "predicted")
        np.testing.assert_allclose(time, np.arange(250) / 5)
        np.testing.assert_allclose(force, waves.predicted[:, index])
        np.testing.assert_allclose(curve(panel, "measured")[1], waves.measured[:, index])
        difference = 10 * (waves.predicted - waves.measured)[:, index]
        np.testing.assert_allclose(curve(panel, "10 x")[1], difference)


def test_no_forces_of_an_estimate_of_another_model(demo: DemoResult) -> None:
    example = demo.example
    other = example.estimates["ls"].with_(parameters=())
    assert force_waves(example.model, other, example.periods) is None


def test_spectra_name_every_channel(demo: DemoResult) -> None:
    periods = demo.example.periods
    axes = draw_spectra(periods).axes[: len(periods.channels)]
    assert [panel.get_title(loc="left") for panel in axes] == list(periods.names)


def test_errors_have_a_panel_for_every_parameter(demo: DemoResult) -> None:
    axes = draw_errors(demo).axes
    assert [panel.get_title(loc="left") for panel in axes][:14] == [row.base for row in TABLE]
    labels = [text.get_text() for text in axes[0].get_yticklabels()]
    assert labels == list(demo.estimators)


def test_correlation_names_rows_and_columns() -> None:
    axes = draw_correlation(["a", "b"], np.array([[1.0, -0.9], [-0.9, 1.0]])).axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["a", "b"]
    assert {text.get_text() for text in axes.texts} == {"\N{MINUS SIGN}.9"}


def test_misfit_is_drawn_over_its_expectation() -> None:
    axes = draw_misfit([0, 0, 1], [10.0, 20.0, 10.0], [12.0, 90.0, 0.0], [12.0, 12.0, 12.0]).axes[0]
    np.testing.assert_allclose(curve(axes, "record 1"), [[10, 20], [1, 7.5]])
    np.testing.assert_allclose(curve(axes, "record 2"), [[10], [1]])


def test_deviations_of_an_estimate_are_drawn_in_percent(demo: DemoResult) -> None:
    estimate = demo.example.estimates["batch-100"]
    left, right, _ = estimate.plot().axes
    assert [text.get_text() for text in left.get_yticklabels()] == [v.name for v in estimate.free]
    percent = [100 * v.std / abs(v.value) for v in estimate.free]
    np.testing.assert_allclose(left.lines[0].get_xdata(), percent)
    np.testing.assert_allclose(right.images[0].get_array(), estimate.correlation)
    with pytest.raises(InputError, match="without covariance"):
        estimate.with_(covariance=np.zeros((0, 0))).plot()


def test_pictures_are_the_same_each_time_and_leave_no_trace(demo: DemoResult) -> None:
    before = dict(mpl.rcParams)
    assert svg(draw_overview(demo)) == svg(draw_overview(demo))
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
