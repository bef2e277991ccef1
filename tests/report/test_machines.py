"""Modes, Campbell diagram and unbalance response as pictures and pages."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_pages import Page, check_self_contained, titles

import rotorid as rid
from rotorid import campbell, modes
from rotorid.report import machines
from rotorid.report.drawn import campbell as campbell_panel
from rotorid.report.drawn import response, shapes
from rotorid.report.machines import (
    balance_report,
    machine_part,
    mode_table,
    modes_report,
    modes_sentence,
    ringing,
    ringing_curves,
    summary,
)
from rotorid.results.machine import machine_of
from rotorid.results.modes import partners, response_of

SPEED = 2 * np.pi * 140.0


@pytest.fixture(scope="module")
def model() -> rid.Model:
    return rid.load_model("three-mass")


@pytest.fixture(scope="module")
def estimate(model: rid.Model) -> rid.Estimate:
    """A result of which every value is known to a thousandth."""
    values = model.values(model.nominal)
    found = tuple(
        rid.Value(p.name, p.unit, float(value), 1e-3 * abs(float(value)))
        for p, value in zip(model.parameters, values, strict=True)
    )
    covariance = np.diag(np.square(1e-3 * np.abs(values)))
    return rid.Estimate(model.name, "ml", "ok", found, covariance=covariance)


def test_a_diagram_shows_what_was_computed(estimate: rid.Estimate) -> None:
    found = campbell(estimate, 1.3 * SPEED)
    panel = campbell_panel(found)
    lines = [c for c in panel.curves if c.look == "line"]
    assert len(lines) == len(found.whirl)
    for curve, frequency in zip(lines, found.frequency_hz.T, strict=True):
        np.testing.assert_array_equal(curve.y, frequency)
        np.testing.assert_allclose(curve.x, 30 / np.pi * found.speed)
    (marks,) = [c for c in panel.curves if c.look == "diamonds"]
    np.testing.assert_allclose(marks.x, [30 / np.pi * c.speed_rad_s for c in found.critical])
    np.testing.assert_allclose(marks.y, marks.x / 60)  # where a mode meets the rotation
    assert marks.error is not None
    np.testing.assert_allclose(
        marks.error, [1.96 * 30 / np.pi * c.std for c in found.critical if c.std], rtol=1e-4
    )
    band = next(c for c in panel.curves if c.look == "band")
    assert band.base is not None
    np.testing.assert_allclose((band.y - band.base) / 2, 1.96 * found.std_hz[:, 0], rtol=1e-4)


def test_a_shape_is_its_forward_and_its_backward_part(model: rid.Model) -> None:
    """The first bending mode of a symmetric rotor: its ends alike, its middle against them."""
    found = modes(model, speed=SPEED)
    names = model.coordinates
    pairs = [pair for pair in partners(names) if model.units[names[pair[0]]] == "m"]
    panels = shapes(found, pairs, [])
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


def test_shapes_of_a_drawing_stand_along_the_rotor() -> None:
    model = rid.load_model("flexible")
    part = machine_part(model, 0.0)
    (picture,) = (p for p in part.parts if p.title == "Mode shapes")
    found = modes(model)
    pairs, _ = machines._places(model)
    (first, *_) = shapes(found, pairs, [], machines._positions(model, pairs))
    assert first.x.title == "mm from the left end"
    along = first.curves[0].x
    assert (along[0], along[-1]) == pytest.approx((0.0, 530.0))
    named = dict(zip(first.curves[1].told, first.curves[1].x, strict=True))
    assert named["x_A"] == pytest.approx(1e3 * model.rotor.places["A"])  # type: ignore[attr-defined]
    assert "mm from the left end" in str(picture)
    assert machines._positions(rid.load_model("three-mass"), [(0, 1)]) is None


def test_an_amplitude_that_hardly_changes_is_drawn_from_zero() -> None:
    """A rigid rotor moves alike at every speed, known to a thousandth."""
    model = rid.load_model("rigid")
    found = response_of(machine_of(model), np.linspace(100.0, 800.0, 5))
    for panel in response(found, model.units):
        assert panel.y.ends is not None
        assert panel.y.ends[0] == 0.0
        assert panel.y.ends[1] == pytest.approx(1.25 * panel.curves[0].y[0])
        assert not panel.y.log


@pytest.mark.parametrize("tilt", [0.0, 0.04, 0.06])
def test_motion_in_a_plane_is_one_line(model: rid.Model, tilt: float) -> None:
    """Of two modes of one frequency any mixture is one: a circle too is the shape in its plane."""
    shape = np.array([1.0, -0.5, 0.8])
    across = tilt * np.array([0.8, 0.0, -1.0]) * np.linalg.norm(shape) / np.hypot(0.8, 1.0)
    motion = np.zeros(8, dtype=complex)
    names = list(model.coordinates)
    for k, place in enumerate("123"):
        motion[names.index(f"x{place}")] = 0.6 * shape[k] - 0.8 * across[k]
        motion[names.index(f"y{place}")] = 1j * (0.8 * shape[k] + 0.6 * across[k])
    found = modes(model, speed=SPEED)
    mode = replace(found.modes[0], whirl="planar", shape=tuple(motion))
    pairs = [(names.index(f"x{k}"), names.index(f"y{k}")) for k in "123"]
    (panel,) = shapes(replace(found, modes=(mode,)), pairs, [])
    told = [c.label for c in panel.curves if c.label]
    if tilt == 0:
        np.testing.assert_allclose(panel.curves[0].y, shape, atol=1e-12)
    assert (told == ["in a plane"]) == (tilt < 0.05)
    assert shapes(found, pairs[:1], []) == []  # a single place has no shape


@pytest.mark.parametrize("names", [("h", "v"), ("q1", "q2")])
def test_coordinates_without_a_partner_are_shown_as_they_stand(names: tuple[str, str]) -> None:
    """Nothing says that they are to be called x and y; both planes ring at one frequency."""
    text = rid.load_model("jeffcott").file_text
    for old, new in zip("xy", names, strict=True):
        text = text.replace(f"{old}''", f"{new}''").replace(f"{old}'", f"{new}'")
        text = text.replace(f"k*{old} ", f"k*{new} ").replace(f'{old} = "m"', f'{new} = "m"')
    renamed = rid.parse_model(text, name="renamed")
    found = modes(renamed, speed=SPEED)
    assert found.coordinates == names
    panels = shapes(found, partners(names), [0, 1])
    assert panels
    for panel in panels:
        assert max(np.abs(c.y).max() for c in panel.curves) == pytest.approx(1.0)
    page = Page(modes_report(renamed, found, None, []))
    assert titles(page) == ["Mode shapes"]


def test_a_response_is_drawn_with_its_band(estimate: rid.Estimate, model: rid.Model) -> None:
    speeds = np.linspace(100.0, 800.0, 5)
    found = response_of(machine_of(estimate), speeds)
    panels = response(found, model.units)
    assert [panel.title for panel in panels] == list(model.coordinates)
    assert panels[0].y.title == "amplitude in \N{MICRO SIGN}m"
    band, line = panels[0].curves
    np.testing.assert_allclose(line.y, 1e6 * np.abs(found.motion[:, 0]))
    assert band.base is not None
    half = 1.96e6 * found.std[:, 0]
    np.testing.assert_allclose(band.y - line.y, half, rtol=1e-4)
    np.testing.assert_allclose(band.base, np.maximum(line.y - half, line.y / 100), rtol=1e-4)


def test_the_page_of_modes(estimate: rid.Estimate) -> None:
    found, diagram = modes(estimate, speed=SPEED), campbell(estimate, 1.3 * SPEED)
    page = Page(modes_report(estimate, found, diagram, ["rotorid modes run.json"]))
    check_self_contained(page)
    assert titles(page) == ["Campbell diagram", "Mode shapes", "Unbalance response"]
    critical = f"{30 / np.pi * diagram.critical[0].speed_rad_s:.6g}"
    for text in ("Modes at 8400 rpm", critical, "rotorid modes run.json"):
        assert text in page.words


@pytest.mark.slow
def test_what_a_report_shows_of_a_machine(estimate: rid.Estimate) -> None:
    turning, still = machine_part(estimate, SPEED), machine_part(estimate, 0.0)
    assert [one.title for one in turning.parts if one.panels] == [
        "Campbell diagram",
        "Mode shapes",
        "Unbalance response",
    ]
    assert [one.title for one in still.parts if one.panels] == ["Mode shapes"]
    assert still.title == "Modes at standstill"
    lost = estimate.with_(status="not_converged")
    (said,) = machine_part(lost, SPEED).said
    assert said.startswith("No modes are told: a result that has not converged; ")


def test_of_a_machine_in_one_plane_and_one_that_does_not_turn(tmp_path: Path) -> None:
    text = """
    title = "a mass on a spring"
    equations = ["m*q'' + c*q' + k*q = F"]
    coordinates = { q = "m" }
    inputs = { F = "N" }
    [parameters]
    m = { unit = "kg", nominal = 2.0 }
    c = { unit = "N s/m", nominal = 4.0 }
    k = { unit = "N/m", nominal = 800.0 }
    """
    model = rid.parse_model(text)
    page = Page(modes_report(model, modes(model), None, []))
    check_self_contained(page)
    assert f"{np.sqrt(400 - 1) / (2 * np.pi):.6g}" in page.words
    assert titles(page) == []  # one place has no shape


def test_the_page_of_a_balance(estimate: rid.Estimate, model: rid.Model) -> None:
    planes = ("x2 - 0.02*theta_y, y2 + 0.02*theta_x", "x2 + 0.02*theta_y, y2 - 0.02*theta_x")
    found = rid.balance(estimate, planes, SPEED, radius="60 mm", masses=["1 g", "2 g"])
    page = Page(balance_report(found, [], model, ["rotorid balance run.json"]))
    check_self_contained(page)
    assert "Balanced with this to less than G " in page.words
    assert "rotorid balance run.json" in page.words
    for plot, one, left in zip(page.plots.values(), found.corrections, found.residual, strict=True):
        arrow, _, ring, masses = plot["data"]  # type: ignore[misc]
        tip = 1e6 * one.unbalance_kg_m * np.exp(1j * one.angle_rad)
        np.testing.assert_allclose([arrow["x"][1], arrow["y"][1]], [tip.real, tip.imag], rtol=1e-4)
        away = np.hypot(np.array(ring["x"]) - tip.real, np.array(ring["y"]) - tip.imag)
        np.testing.assert_allclose(away, 1e6 * left.unbalance_kg_m, atol=0.01)
        angles = np.arctan2(masses["y"], masses["x"])
        np.testing.assert_allclose(
            np.exp(1j * angles), np.exp(1j * np.array(one.masses)[:, 1]), 1e-4
        )
        assert plot["layout"]["yaxis"]["scaleanchor"] == "x"  # type: ignore[index]


def test_planes_that_do_not_reach_are_said(estimate: rid.Estimate, model: rid.Model) -> None:
    found = rid.balance(estimate, ["x1,y1"], SPEED)
    page = Page(balance_report(found, [], model))
    assert "These planes cannot do away with the unbalance: " in page.words


def test_what_is_overdamped_is_no_mode_of_a_page(estimate: rid.Estimate) -> None:
    """A pole without a peak in any response, damping ratio above .707, is neither row nor curve."""
    found = modes(estimate, speed=SPEED)
    dull = replace(found.modes[1], damping_ratio=0.71, frequency_hz=57.6)
    crowd = replace(found, modes=(found.modes[0], dull, *found.modes[2:]))
    assert len(ringing(crowd).modes) == len(found.modes) - 1
    assert "57.6" not in [cell for row in mode_table(crowd).rows for cell in row]
    assert [text for text in summary(crowd) if text.startswith("1 overdamped")]
    rings = replace(dull, damping_ratio=0.70)
    assert len(ringing(replace(found, modes=(rings,))).modes) == 1
    diagram = campbell(estimate, SPEED)
    ratio = diagram.damping_ratio.copy()
    ratio[:, 0] = 1.0
    ratio[0, 1] = 0.8
    kept = ringing_curves(replace(diagram, damping_ratio=ratio))
    assert len(kept.whirl) == len(diagram.whirl) - 1
    assert np.isnan(kept.frequency_hz[0, 0])
    np.testing.assert_array_equal(kept.frequency_hz[1:, 0], diagram.frequency_hz[1:, 1])
    jumping = diagram.frequency_hz.copy()
    jumping[0, :2] *= 1e3, 5  # two curves in one, and one that is steep
    kept = ringing_curves(replace(diagram, frequency_hz=jumping))
    assert np.isnan(kept.frequency_hz[0, :2]).tolist() == [True, False]


@pytest.mark.slow
def test_modes_in_a_sentence(estimate: rid.Estimate) -> None:
    found, diagram = modes(estimate, speed=SPEED), campbell(estimate, "20000 rpm")
    said = modes_sentence(found, diagram)
    nearest = min((c.speed_rad_s for c in diagram.critical), key=lambda s: abs(s - SPEED))
    listed = ", ".join(f"{mode.frequency_hz:.4g}" for mode in found.modes[:4])
    assert said.startswith(f"At 8400 rpm the machine rings at {listed} and ")
    assert f"{30 / np.pi * nearest:.5g} rpm, lies {100 * (nearest / SPEED - 1):.3g} % above" in said
    still = modes_sentence(modes(estimate, speed=0.0), None)
    assert still.startswith("At standstill the machine rings at ")
    assert still.endswith(" Hz.")
