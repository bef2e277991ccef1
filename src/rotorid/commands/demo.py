"""``rotorid demo``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotorid.commands import OK
from rotorid.commands.console import check_outputs, progress, show, write, write_text
from rotorid.demo import run_demo
from rotorid.report.demo_page import demo_page

NOISE = 2026  # starts the generator of the noise, so that every run shows the same figures


def run(runs: int, json: Path | None, report: Path | None) -> int:
    """Run the example and show its table beside the paper's."""
    check_outputs(json, report)
    with progress("simulating and identifying") as told:
        result = run_demo(runs, rng=np.random.default_rng(NOISE), progress=told)

    def html() -> str:
        from rotorid.report.demo import demo_report  # pictures take their time to load

        return demo_report(result)

    write((json, result.save), (report, write_text(html)))
    show(demo_page(result))
    return OK
