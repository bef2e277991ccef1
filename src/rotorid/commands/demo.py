"""``rotorid demo``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotorid.commands import OK
from rotorid.commands.console import (
    FIGURES,
    REPORT,
    answer,
    as_json,
    as_text,
    check_outputs,
    progress,
)
from rotorid.demo import run_demo
from rotorid.report.demo_page import demo_page

NOISE = 2026  # starts the generator of the noise, so that every run shows the same figures


def run(runs: int, json: Path | None, report: Path | None, force: bool) -> int:
    """Run the example and show its table beside the paper's."""
    check_outputs((json, FIGURES), (report, REPORT), force=force)
    with progress("simulating and identifying") as told:
        result = run_demo(runs, rng=np.random.default_rng(NOISE), progress=told)

    def html() -> str:
        from rotorid.report.demo import demo_report  # pictures take their time to load

        return demo_report(result)

    figures = as_json(result.to_dict())
    answer(demo_page(result), json=(json, figures), report=(report, as_text(html)))
    return OK
