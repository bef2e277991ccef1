"""Panels of records and machines."""

import json
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import plotly.graph_objects
import pytest
from linear_machines import estimate_of
from report_pages import Page, titles

import rotorid as rid
from rotorid.answer.parts import ResponseEvidence
from rotorid.demo import ESTIMATORS, FUNDAMENTAL, HARMONICS, simulate_record
from rotorid.report import drawn, machines
from rotorid.report import html as interactive
from rotorid.report.figure import figure_of
from rotorid.results.evidence import record_evidence
from rotorid.results.machine import machine_of
from rotorid.results.modes import partners, response_of

# Pictures: what they draw is what was measured, in a page and in a figure alike.


IMAGES = Path(__file__).parents[2] / "docs" / "images"
MODEL = rid.load_model("three-mass")


@pytest.fixture(scope="module")
def record():
    return simulate_record(MODEL, np.random.default_rng(3))


@pytest.fixture(scope="module")
def periods(record):
    return rid.average(record, FUNDAMENTAL, harmonics=HARMONICS)


@pytest.fixture(scope="module")
def estimates(periods):
    return {name: rid.identify(MODEL, periods, ESTIMATORS[name]) for name in ("batch-100", "ml")}


@pytest.fixture(scope="module")
def evidence(periods, estimates):
    return {name: record_evidence(e, MODEL, [periods])[0] for name, e in estimates.items()}


def curve(panel: drawn.Panel, text: str) -> drawn.Curve:
    (found,) = [one for one in panel.curves if one.label.startswith(text)]
    return found


def test_positions_are_drawn_in_micrometres(periods):
    panel = drawn.spectra(periods)[periods.index("x1")]
    assert panel.y.title == "amplitude in µm"
    found = np.abs(periods.mean_spectrum[:, periods.index("x1")])
    np.testing.assert_allclose(curve(panel, "used").y, 2e6 * found)


@pytest.mark.parametrize("name", ["batch-100", "ml"])
def test_predicted_forces_have_the_error_that_the_estimate_states(estimates, evidence, name):
    stated, record = estimates[name].prediction, evidence[name]
    panels = zip(record.channels[:4], drawn.over_time(record), drawn.lines(record), strict=False)
    for channel, waves, on_lines in panels:
        away, whole = curve(waves, "predicted").y, np.array(channel.wave_measured)
        error = np.linalg.norm(away) / np.linalg.norm(whole)
        prediction = stated[channel.name]
        assert error == pytest.approx(prediction.relative_error, rel=2e-3)
        assert channel.error == pytest.approx(prediction.relative_error, rel=1e-5)
        away, size = curve(on_lines, "predicted less").y, curve(on_lines, "measured").y
        assert np.linalg.norm(away) / np.linalg.norm(size) == pytest.approx(error, rel=2e-3)
        assert f"{100 * channel.error:.2g} %" in waves.title


def test_forces_are_drawn_over_one_period_with_their_noise(evidence):
    record = evidence["ml"]
    panels = drawn.over_time(record)
    assert [panel.title.split(":")[0] for panel in panels] == ["F_x1", "F_y1", "F_x3", "F_y3"]
    assert (panels[0].x.title, panels[0].y.title) == ("time in ms", "difference in N")
    for panel in panels:
        band, away = curve(panel, "95"), curve(panel, "predicted")
        np.testing.assert_allclose(away.x, np.arange(250) / 5)
        np.testing.assert_allclose(band.base, -band.y)
        assert 0.7 < (np.abs(away.y) < band.y).mean() <= 1


def test_what_is_left_is_shown_over_its_noise(evidence):
    (panel,) = drawn.residual(evidence["ml"])
    assert panel.matrix.values.shape == (4, 6)
    size = np.sqrt((panel.matrix.values**2).mean())
    assert 0.5 < size < 1.5
    assert panel.matrix.columns.tolist() == [20, 60, 100, 140, 180, 220]


def test_correlation_names_rows_and_columns():
    panel = drawn.correlation(["a", "<b>"], np.array([[1.0, -0.9], [-0.9, 1.0]]))
    spec = interactive.spec(panel)
    for axis in ("xaxis", "yaxis"):
        assert spec["layout"][axis]["ticktext"] == ["a", "&lt;b&gt;"]
    assert spec["data"][0]["text"] == [["", "\N{MINUS SIGN}.90"], ["\N{MINUS SIGN}.90", ""]]
    axes = figure_of([panel]).axes[0]
    assert [text.get_text() for text in axes.get_xticklabels()] == ["a", "<b>"]
    assert {text.get_text() for text in axes.texts} == {"\N{MINUS SIGN}.9"}


def test_misfit_is_drawn_over_its_expectation():
    lines = ([0, 0, 1], [10.0, 20.0, 10.0], [12.0, 90.0, 0.0], [12.0] * 3)
    panel = drawn.misfit(map(rid.LineMisfit, *lines))
    first, second = curve(panel, "record 1"), curve(panel, "record 2")
    np.testing.assert_allclose([first.x, first.y], [[10, 20], [1, 7.5]])
    np.testing.assert_allclose([second.x, second.y], [[10], [1]])


def test_misfit_of_phasors_is_drawn_over_the_speed_with_ticks_to_read():
    lines = ([0, 0], [10.0, 20.0], [12.0, 2.0], [12.0] * 2)
    panel = drawn.misfit(map(rid.LineMisfit, *lines), turning=True)
    assert panel.x.title == "speed in rpm"
    np.testing.assert_allclose(panel.curves[0].x, [600, 1200])
    axis = interactive.spec(panel)["layout"]["yaxis"]
    assert {"0.2", "0.5", "1", "2"} <= set(axis["ticktext"])
    assert "dtick" not in axis
    for top, told in ((3.9, None), (4.1, "tickvals"), (310.0, "tickvals"), (320.0, "dtick")):
        panel = drawn.Panel(y=drawn.Axis(log=True, ends=(1.0, top)))
        axis = interactive.spec(panel)["layout"]["yaxis"]
        assert [key for key in ("tickvals", "dtick") if key in axis] == ([told] if told else [])


def test_names_of_marks_stay_in_the_picture():
    x, y = np.array([-5.0, 9.0, 9.0]), np.array([3.0, 3.0, -3.0])
    marks = drawn.Curve(x, y, "masses", look="named", told=("a", "b", "c"))
    within = ["middle right", "top left", "bottom left"]
    for ends, at in (((-10.0, 10.0), within), (None, "middle right")):
        (trace,) = interactive.spec(drawn.Panel("", drawn.Axis(ends=ends), curves=(marks,)))["data"]
        assert trace["textposition"] == at


def test_a_spike_shows_in_a_long_record():
    values = np.zeros((100_000, 1))
    values[54_321] = 7.0
    record = rid.Record([rid.Channel("x", "V")], values, sample_rate=1000.0)
    (panel,) = drawn.samples(record)
    (band,) = panel.curves
    assert len(band.x) <= 600
    assert band.y.max() == 7.0
    assert band.x[np.argmax(band.y)] == pytest.approx(54.321, abs=0.1)


def test_deviations_of_an_estimate_are_drawn_in_percent(estimates):
    estimate = estimates["batch-100"]
    left, right, _ = estimate.plot().axes
    assert [text.get_text() for text in left.get_yticklabels()] == [v.name for v in estimate.free]
    percent = [100 * v.std / abs(v.value) for v in estimate.free]
    np.testing.assert_allclose(left.lines[0].get_xdata(), percent)
    shown = right.collections[0].get_array().reshape(estimate.correlation.shape)
    np.testing.assert_allclose(shown, estimate.correlation)
    with pytest.raises(rid.InputError, match="without covariance"):
        estimate.with_(covariance=np.zeros((0, 0))).plot()


def test_every_panel_is_what_plotly_takes(record, periods, evidence):
    """The library that draws it knows every key, and the numbers are JSON."""
    predicted = evidence["ml"]
    panels = [
        *drawn.over_time(predicted),
        *drawn.lines(predicted),
        *drawn.residual(predicted),
        *drawn.spectra(periods)[:1],
        *drawn.samples(record)[:1],
        drawn.misfit(map(rid.LineMisfit, [0, 1], [10.0, 20.0], [1.0, np.nan], [1.0, 1.0])),
        drawn.correlation(["a", "b"], np.array([[1.0, np.nan], [np.nan, 1.0]])),
    ]
    for panel in panels:
        spec = interactive.spec(panel)
        json.dumps(spec, allow_nan=False)
        assert plotly.graph_objects.Figure(spec).layout.height >= 100


def test_names_are_no_markup_in_a_page():
    bad = '<a href="https://example.org">x</a>'
    curve = drawn.Curve(np.ones(1), np.zeros(1), bad)
    panel = drawn.Panel(bad, drawn.Axis(bad), drawn.Axis(names=(bad,)), (curve,))
    assert "<" not in json.dumps(interactive.spec(panel))


def test_pictures_are_the_same_each_time_and_leave_no_trace(evidence):
    before = dict(mpl.rcParams)
    panels = drawn.over_time(evidence["ml"])
    first, second = (figure_of(panels, columns=3) for _ in range(2))
    for one, other in zip(first.axes, second.axes, strict=True):
        for a, b in zip(one.lines, other.lines, strict=True):
            np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(
    ("name", "shown"),
    [("k1*L1", "k1*L1"), ("a\nb\x00", "a b "), ("x" * 30, "x" * 23 + "…"), ("$x_{$", "$x_{$")],
)
def test_labels(name, shown):
    assert drawn.label(name) == shown


def test_pictures_of_the_documentation_are_small():
    sizes = [path.stat().st_size for path in IMAGES.iterdir()]
    assert max(sizes) < 200_000


# Modes, Campbell diagram and unbalance response as pictures and pages.


SPEED = 2 * np.pi * 140.0


@pytest.fixture(scope="module")
def estimate():
    """A result of which every value is known to a thousandth."""
    return estimate_of(MODEL, percent=0.1)


@pytest.fixture(scope="module")
def diagram(estimate):
    return rid.campbell(estimate, 1.3 * SPEED)


def test_a_diagram_shows_what_was_computed(diagram):
    found, panel = diagram, drawn.campbell(diagram)
    lines = [c for c in panel.curves if c.look == "line"]
    assert len(lines) == len(found.whirl)
    for curve, frequency in zip(lines, found.frequency_hz.T, strict=True):
        np.testing.assert_array_equal(curve.y, frequency)
        np.testing.assert_allclose(curve.x, 30 / np.pi * found.speed)
    (marks,) = [c for c in panel.curves if c.look == "diamonds"]
    np.testing.assert_allclose(marks.x, [30 / np.pi * c.speed_rad_s for c in found.critical])
    np.testing.assert_allclose(marks.y, marks.x / 60)  # where a mode meets the rotation
    half = [1.96 * 30 / np.pi * c.std for c in found.critical if c.std]
    np.testing.assert_allclose(marks.error, half, rtol=1e-4)
    band = next(c for c in panel.curves if c.look == "band")
    np.testing.assert_allclose((band.y - band.base) / 2, 1.96 * found.std_hz[:, 0], rtol=1e-4)


def test_a_shape_is_its_forward_and_its_backward_part():
    """The first bending mode of a symmetric rotor: its ends alike, its middle against them."""
    found = rid.modes(MODEL, speed=SPEED)
    names = MODEL.coordinates
    pairs = [pair for pair in partners(names) if MODEL.units[names[pair[0]]] == "m"]
    panels = drawn.shapes(found, pairs)
    assert len(panels) == len(found.modes)
    for panel, mode in zip(panels, found.modes, strict=True):
        assert panel.x.names == ("x1", "x2", "x3")
        parts = {c.label: c.y for c in panel.curves if c.label}
        zero = np.zeros(3)
        ahead, back = (parts.get(f"{way} part", zero) for way in ("forward", "backward"))
        assert max(np.abs(ahead).max(), np.abs(back).max()) == pytest.approx(1.0)
        assert np.abs({"forward": back, "backward": ahead}[mode.whirl]).max() < 1e-3
    bending = next(c.y for c in panels[2].curves if np.abs(c.y).max() > 0.5)
    assert bending[0] == pytest.approx(bending[2], rel=1e-3)
    assert bending[0] * bending[1] < 0


def test_shapes_of_a_drawing_stand_along_the_rotor():
    model = rid.load_model("flexible")
    part = machines.machine_part(model, 0.0)
    (picture,) = (p for p in part.parts if p.title == "Mode shapes")
    found = rid.modes(model)
    pairs = machines._places(model)
    (first, *_) = drawn.shapes(found, pairs, machines._positions(model, pairs))
    assert first.x.title == "mm from the left end"
    along = first.curves[0].x
    assert (along[0], along[-1]) == pytest.approx((0.0, 530.0))
    named = dict(zip(first.curves[1].told, first.curves[1].x, strict=True))
    assert named["x_A"] == pytest.approx(1e3 * model.rotor.places["A"])  # type: ignore[attr-defined]
    assert "mm from the left end" in str(picture)
    assert machines._positions(MODEL, [(0, 1)]) is None


def test_an_amplitude_that_hardly_changes_is_drawn_from_zero():
    """A rigid rotor moves alike at every speed, known to a thousandth."""
    model = rid.load_model("rigid")
    found = response_of(machine_of(model), np.linspace(100.0, 800.0, 5))
    for panel in drawn.response(found, model.units):
        assert panel.y.ends[0] == 0.0
        assert panel.y.ends[1] == pytest.approx(1.25 * panel.curves[0].y[0])
        assert not panel.y.log


@pytest.mark.parametrize("tilt", [0.0, 0.04, 0.06])
def test_motion_in_a_plane_is_one_line(tilt):
    """Of two modes of one frequency any mixture is one: a circle too is the shape in its plane."""
    shape = np.array([1.0, -0.5, 0.8])
    across = tilt * np.array([0.8, 0.0, -1.0]) * np.linalg.norm(shape) / np.hypot(0.8, 1.0)
    motion = np.zeros(8, dtype=complex)
    names = list(MODEL.coordinates)
    for k, place in enumerate("123"):
        motion[names.index(f"x{place}")] = 0.6 * shape[k] - 0.8 * across[k]
        motion[names.index(f"y{place}")] = 1j * (0.8 * shape[k] + 0.6 * across[k])
    found = rid.modes(MODEL, speed=SPEED)
    mode = replace(found.modes[0], whirl="planar", shape=tuple(motion))
    pairs = [(names.index(f"x{k}"), names.index(f"y{k}")) for k in "123"]
    (panel,) = drawn.shapes(replace(found, modes=(mode,)), pairs)
    told = [c.label for c in panel.curves if c.label]
    if tilt == 0:
        np.testing.assert_allclose(panel.curves[0].y, shape, atol=1e-12)
    assert (told == ["in a plane"]) == (tilt < 0.05)
    assert drawn.shapes(found, pairs[:1]) == []  # a single place has no shape


@pytest.mark.parametrize("names", [("h", "v"), ("q1", "q2")])
def test_coordinates_without_a_partner_are_shown_as_they_stand(names):
    """Nothing says that they are to be called x and y; both planes ring at one frequency."""
    text = rid.load_model("jeffcott").file_text
    for old, new in zip("xy", names, strict=True):
        text = text.replace(f"{old}''", f"{new}''").replace(f"{old}'", f"{new}'")
        text = text.replace(f"k*{old} ", f"k*{new} ").replace(f'{old} = "m"', f'{new} = "m"')
    renamed = rid.parse_model(text, name="renamed")
    found = rid.modes(renamed, speed=SPEED)
    assert found.coordinates == names
    panels = drawn.shapes(found, [(0,), (1,)])
    assert panels
    for panel in panels:
        assert max(np.abs(c.y).max() for c in panel.curves) == pytest.approx(1.0)
    assert titles(Page(machines.modes_report(renamed, found, None, []))) == ["Mode shapes"]


def test_a_response_is_drawn_with_its_band(estimate):
    found = response_of(machine_of(estimate), np.linspace(100.0, 800.0, 5))
    panels = drawn.response(found, MODEL.units)
    assert [panel.title for panel in panels] == list(MODEL.coordinates)
    assert panels[0].y.title == "amplitude in \N{MICRO SIGN}m"
    band, line = panels[0].curves
    np.testing.assert_allclose(line.y, 1e6 * np.abs(found.motion[:, 0]))
    half = 1.96e6 * found.std[:, 0]
    np.testing.assert_allclose(band.y - line.y, half, rtol=1e-4)
    np.testing.assert_allclose(band.base, np.maximum(line.y - half, line.y / 100), rtol=1e-4)


def test_the_page_of_modes(estimate, diagram):
    found = rid.modes(estimate, speed=SPEED)
    page = Page(machines.modes_report(estimate, found, diagram, ["rotorid modes run.json"]))
    assert titles(page) == ["Campbell diagram", "Mode shapes", "Unbalance response"]
    critical = f"{30 / np.pi * diagram.critical[0].speed_rad_s:.6g}"
    for text in ("Modes at 8400 rpm", critical, "rotorid modes run.json"):
        assert text in page.words


def test_the_page_of_a_balance(estimate):
    planes = ("x2 - 0.02*theta_y, y2 + 0.02*theta_x", "x2 + 0.02*theta_y, y2 - 0.02*theta_x")
    found = rid.balance(estimate, planes, SPEED, radius="60 mm", masses=["1 g", "2 g"])
    page = Page(machines.balance_report(found, [], MODEL, ["rotorid balance run.json"]))
    assert "Balanced with this to below " in page.words
    assert "rotorid balance run.json" in page.words
    for plot, one, left in zip(page.plots.values(), found.corrections, found.residual, strict=True):
        arrow, _, ring, masses = plot["data"]  # type: ignore[misc]
        tip = 1e6 * one.unbalance_kg_m * np.exp(1j * one.angle_rad)
        np.testing.assert_allclose([arrow["x"][1], arrow["y"][1]], [tip.real, tip.imag], rtol=1e-4)
        away = np.hypot(np.array(ring["x"]) - tip.real, np.array(ring["y"]) - tip.imag)
        np.testing.assert_allclose(away, 1e6 * left.unbalance_kg_m, atol=0.01)
        off = np.arctan2(masses["y"], masses["x"]) - np.array(one.masses)[:, 1]
        np.testing.assert_allclose(np.exp(1j * off), 1.0, 1e-4)
        assert plot["layout"]["yaxis"]["scaleanchor"] == "x"  # type: ignore[index]
    twice = replace(found.corrections[0], masses=((1e-3, 0.5),) * 2)
    panel, *_ = drawn.corrections(replace(found, corrections=(twice, *found.corrections[1:])))
    assert curve(panel, "masses").told == ("2 x 1 g at 28.6 deg",)


def test_planes_that_do_not_reach_are_said(estimate):
    page = Page(machines.balance_report(rid.balance(estimate, ["x1,y1"], SPEED), [], MODEL))
    assert "These planes cannot balance this rotor: " in page.words


def test_what_is_overdamped_is_no_mode_of_a_page(estimate, diagram):
    """A pole without a peak in any response, damping ratio above .707, is neither row nor curve."""
    found = rid.modes(estimate, speed=SPEED)
    dull = replace(found.modes[1], damping_ratio=0.71, frequency_hz=57.6)
    crowd = replace(found, modes=(found.modes[0], dull, *found.modes[2:]))
    assert len(machines.ringing(crowd).modes) == len(found.modes) - 1
    assert "57.6" not in [cell for row in machines.mode_table(crowd).rows for cell in row]
    assert [text for text in machines.summary(crowd) if text.startswith("1 overdamped")]
    rings = replace(dull, damping_ratio=0.70)
    assert len(machines.ringing(replace(found, modes=(rings,))).modes) == 1
    ratio = diagram.damping_ratio.copy()
    ratio[:, 0] = 1.0
    ratio[0, 1] = 0.8
    kept = machines.ringing_curves(replace(diagram, damping_ratio=ratio))
    assert len(kept.whirl) == len(diagram.whirl) - 1
    assert np.isnan(kept.frequency_hz[0, 0])
    np.testing.assert_array_equal(kept.frequency_hz[1:, 0], diagram.frequency_hz[1:, 1])
    jumping = diagram.frequency_hz.copy()
    jumping[0, :2] *= 1e3, 5  # two curves in one, and one that is steep
    kept = machines.ringing_curves(replace(diagram, frequency_hz=jumping))
    assert np.isnan(kept.frequency_hz[0, :2]).tolist() == [True, False]


@pytest.mark.slow
def test_modes_in_a_sentence(estimate):
    found, diagram = rid.modes(estimate, speed=SPEED), rid.campbell(estimate, "20000 rpm")
    said = machines.modes_sentence(found, diagram)
    nearest = min((c.speed_rad_s for c in diagram.critical), key=lambda s: abs(s - SPEED))
    listed = ", ".join(f"{mode.frequency_hz:.4g}" for mode in found.modes[:4])
    bare = "the free rotor, without its bearings, has natural frequencies of "
    assert said.startswith(f"At 8400 rpm {bare}{listed} and ")
    assert f"{30 / np.pi * nearest:.5g} rpm, lies {100 * (nearest / SPEED - 1):.3g} % above" in said
    still = machines.modes_sentence(rid.modes(estimate, speed=0.0), None)
    assert still.startswith(f"At standstill {bare}")
    assert still.endswith(" Hz.")


def test_a_phase_turns_by_half_a_turn_at_a_resonance_without_damping():
    """From 0 to -180 deg and back at the zero between two, whatever rounding makes of the sign."""
    hertz = np.linspace(1.0, 40.0, 79)
    signs = (-1.0) ** (1 * (hertz > 10.3) + (hertz > 20.3) + (hertz > 30.3))
    tiny = 1e-17 * np.random.default_rng(1).choice([-1, 1], len(hertz))
    seen = ResponseEvidence("F", "x", "m/N", 0.0, (5.0, 35.0), (1.0, -1.0), (0.0, 0.0), (0.1, 0.1))
    _, phase, left = drawn.force_response(seen, hertz, signs + 1j * tiny, np.zeros((2, 79)))
    (line, *_) = (curve.y for curve in phase.curves if curve.label == "model")
    np.testing.assert_allclose(line, 90 * (signs - 1), atol=1e-9)
    np.testing.assert_allclose([curve.y for curve in left.curves], 0.0, atol=1e-9)


def test_a_response_at_one_speed_is_a_point(estimate):
    """A line through one point is not seen."""
    panels = drawn.response(rid.unbalance_response(estimate, SPEED), MODEL.units)
    assert {curve(panel, "amplitude").look for panel in panels} == {"dots"}
