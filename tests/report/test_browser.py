"""Pages in a real browser: drawn whole at every width, by day and by night, and on paper."""

import base64
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, browser

from rotorid import cli
from rotorid.demo import run_demo
from rotorid.report.demo import demo_report

LOOKS = [(400, "dark"), (1280, "light"), (2560, "dark")]
MORE = [(400, "light"), (1280, "dark"), (2560, "light")]
INK = {"light": "rgb(32, 33, 36)", "dark": "rgb(232, 234, 237)"}
HOSTILE = "</script><img src=x onerror=alert(1)>"


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
    demo = folder / "demo.html"
    page = demo_report(run_demo(2, rng=np.random.default_rng(3)))
    demo.write_text(page, encoding="utf-8")
    assert HOSTILE.replace("<", "&lt;").replace(">", "&gt;") in found[0].read_text("utf-8")
    return [*found, demo]


@pytest.mark.slow
def test_every_page_at_every_width_by_day_and_by_night(one: Browser, pages: list[Path]) -> None:
    for page in pages:
        for width, scheme in LOOKS + (MORE if page is pages[0] else []):
            seen = one.show(page, width, scheme)
            where = f"{page.name}, {width} px, {scheme}"
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
