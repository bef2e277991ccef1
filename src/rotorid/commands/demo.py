"""``rotorid demo``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotorid.commands import OK
from rotorid.commands.console import Outputs
from rotorid.core.files import check_apart
from rotorid.demo import run_demo
from rotorid.demo.levitated import run_machine
from rotorid.demo.page import demo_page, machine_page

NOISE = 2026  # starts the generator of the noise, so that every run shows the same figures


def run(runs: int, machine: Path | None, answer: Outputs) -> int:
    check_apart(answer.check(machine), [])
    _show_machine(machine)
    result = run_demo(runs, rng=np.random.default_rng(NOISE))

    def html() -> str:
        from rotorid.demo.page import demo_report  # pictures take their time to load

        return demo_report(result)

    page = ["", "The example of Levy and Arogeti", *demo_page(result)]
    answer.give(page, result.to_dict(), html)
    return OK


def _show_machine(report: Path | None) -> None:
    """Identify the levitated machine, show it beside its truth, and write its report."""
    result = run_machine(np.random.default_rng(NOISE))

    def html() -> str:
        from rotorid.report.estimate_report import (
            estimate_report,  # pictures take their time to load
        )
        from rotorid.results.evidence import with_evidence

        known = with_evidence(result.estimate, result.model, result.periods, result.estimator)
        return estimate_report(known)

    Outputs(None, report).give(machine_page(result), {}, html)
