"""Pages in a real browser: drawn whole at every width, by day and by night, and on paper."""

import base64
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, browser

import rotorid as rid
from rotorid import cli, with_evidence
from rotorid.demo import demo_report, run_demo, simulate_record
from rotorid.report.estimate_report import estimate_report
from rotorid.report.machines import sensitivity_report
from rotorid.results.sensitivity import AxisSensitivity

LOOKS = [(400, "dark"), (1280, "light"), (2560, "dark")]
MORE = [(400, "light"), (1280, "dark"), (2560, "light")]
INK = {"light": "rgb(32, 33, 36)", "dark": "rgb(232, 234, 237)"}
LARGEST = 6e6  # byte
HOSTILE = "</script><img src=x onerror=alert(1)>"


LOOP = AxisSensitivity(
    HOSTILE,
    np.arange(1.0, 99.0),
    1 + 1.2 / (1 + 0.1j * np.arange(-39.0, 59.0)),
    np.full(98, 0.05),
    2.2,
    40.0,
    (2.1, 2.3),
)


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """What the commands write of a rig's record, one channel under a hostile name."""
    folder = tmp_path_factory.mktemp("pages")
    record, experiment, result = (folder / f"run.{end}" for end in ("h5", "toml", "json"))
    assert cli.run(["simulate", "rigid", "--out", str(record)]) == 0
    found = [folder / f"{name}.html" for name in ("estimate", "inspect", "validate", "modes")]
    assert cli.run(["identify", str(experiment), "--json", str(result)]) == 0
    hostile = folder / "hostile.json"
    text = result.read_text(encoding="utf-8")
    hostile.write_text(text.replace('"s_xb"', json.dumps(HOSTILE)), encoding="utf-8")
    assert cli.run(["report", str(hostile), "--out", str(found[0])]) == 0
    assert cli.run(["inspect", str(experiment), "--report", str(found[1])]) == 0
    assert cli.run(["validate", str(result), str(experiment), "--report", str(found[2])]) == 0
    turning = ["--speed", "9000 rpm", "--to", "20000 rpm"]
    assert cli.run(["modes", str(result), *turning, "--report", str(found[3])]) == 0
    planes = ["--plane", "F_xa,F_ya", "--plane", "F_xb,F_yb", "--radius", "30 mm"]
    balanced = folder / "balance.html"
    assert cli.run(["balance", str(result), *planes, "--report", str(balanced)]) == 0
    loops = folder / "sensitivity.html"
    loops.write_text(sensitivity_report([LOOP], HOSTILE), encoding="utf-8")
    whole = folder / "whole.html"
    whole.write_text(_of_whole_records(), encoding="utf-8")
    drawing, least = folder / "drawing.html", folder / "ls.html"
    assert cli.run(["modes", "flexible", *turning, "--report", str(drawing)]) == 0
    least.write_text(_by_least_squares(), encoding="utf-8")
    demo = folder / "demo.html"
    page = demo_report(run_demo(2, rng=np.random.default_rng(3)))
    demo.write_text(page, encoding="utf-8")
    assert HOSTILE.replace("<", "&lt;").replace(">", "&gt;") in found[0].read_text("utf-8")
    return [*found, balanced, loops, whole, drawing, least, demo]


def _of_whole_records() -> str:
    """Return the page of two records without periods, the second of which begins anywhere."""
    model, rng = rid.load_model("jeffcott"), np.random.default_rng(1)
    noise = {"F_x": 1.0, "F_y": 1.0, "x": 1e-6, "y": 1e-6}
    data = []
    for phase in (0.0, 2.0):
        record = rid.simulate(
            model,
            model.values(model.nominal),
            np.fft.irfft(rng.standard_normal((240, 2)) * 1e4, n=4000, axis=0),  # to 60 Hz
            sample_rate=1000.0,
            periods=1,
            speed="1200 rpm",
            phase=phase,
            noise=noise,
            rng=rng,
        )
        turning = replace(record, angle=None, phase_known=phase == 0)
        data.append(rid.spectra(turning, (2.0, 60.0), inputs=model.inputs))
    page = estimate_report(with_evidence(rid.identify(model, data, "ml"), model, data))
    assert "Measured and predicted signals, record 2" in page
    return page


def _by_least_squares() -> str:
    """Return the page of an answer of least squares."""
    model = rid.load_model("three-mass")
    record = simulate_record(model, np.random.default_rng(1))
    periods = rid.average(record, "20 Hz", harmonics=[1, 3, 5, 7, 9, 11])
    page = estimate_report(with_evidence(rid.identify(model, periods, "ls"), model, periods))
    assert "least squares" in page
    return page


@pytest.mark.slow
def test_every_page_at_every_width_by_day_and_by_night(one: Browser, pages: list[Path]) -> None:
    for page in pages:
        looks = [*LOOKS, *MORE] if page is pages[0] else LOOKS if page in pages[:6] else LOOKS[:2]
        for width, scheme in looks:
            seen = one.show(page, width, scheme)
            where = f"{page.name}, {width} px, {scheme}"
            assert page.stat().st_size < LARGEST, where
            assert seen["places"] == seen["drawn"] > 0, where
            assert seen["overflow"] <= 0, where
            assert seen["ink"] == INK[scheme], where
            assert one.complaints() == [], where


@pytest.mark.slow
def test_on_paper(one: Browser, pages: list[Path]) -> None:
    one.show(pages[0], 400, "dark")
    one.run('window.dispatchEvent(new Event("beforeprint"))')
    assert one.seen()["wide"] == 0
    one.run('window.dispatchEvent(new Event("afterprint"))')
    paper = base64.b64decode(one.ask("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert paper.startswith(b"%PDF")
    assert 4 <= paper.count(b"/Type /Page\n") + paper.count(b"/Type /Page ") <= 40
    assert one.complaints() == []
