"""Modes, Campbell diagram and unbalance response as pictures and pages."""

from pathlib import Path

import numpy as np
import pytest
from report_pages import Page, check_self_contained, titles

import rotorid as rid
from rotorid.plots.machines import campbell as campbell_panel
from rotorid.plots.machines import response, shapes
from rotorid.report.machines import BEYOND, SPEEDS, machine_part, modes_report
from rotorid.results.critical import campbell
from rotorid.results.machine import machine_of
from rotorid.results.modes import modes
from rotorid.results.unbalance import response_of
from rotorid.results.whirl import partners

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
        silent = {"forward": back, "backward": ahead}.get(mode.whirl)
        if silent is None:  # planar: as much of one as of the other
            np.testing.assert_allclose(np.abs(ahead), np.abs(back), atol=0.04)
        else:
            assert np.abs(silent).max() < 1e-3
    bending = next(c.y for c in panels[2].curves if np.abs(c.y).max() > 0.5)
    assert bending[0] == pytest.approx(bending[2], rel=1e-3)
    assert bending[0] * bending[1] < 0


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


def test_what_a_report_shows_of_a_machine(estimate: rid.Estimate) -> None:
    assert (BEYOND, SPEEDS) == (1.5, 121)
    turning, still = machine_part(estimate, SPEED), machine_part(estimate, 0.0)
    assert [picture.title for picture in turning.pictures] == [
        "Campbell diagram",
        "Mode shapes",
        "Unbalance response",
    ]
    assert [picture.title for picture in still.pictures] == ["Mode shapes"]
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
    assert titles(page) == ["Mode shapes"]
