"""``rotorid report``."""

from __future__ import annotations

import os
from pathlib import Path

from rotorid.answer.result_file import load_estimate
from rotorid.commands import OK
from rotorid.commands.console import as_text, check_outputs, show, write
from rotorid.core.files import REPORT, check_apart
from rotorid.core.watch import watch
from rotorid.report.estimate_report import WITHOUT, estimate_report


def run(result: Path, out: Path | None, force: bool) -> int:
    target = result.with_suffix(".html") if out is None else out
    targets = check_outputs((target, REPORT), force=force)
    estimate = load_estimate(result)
    files = [] if estimate.provenance is None else estimate.provenance.files
    check_apart(
        targets, [result, *(Path(source.file) for source in files if os.path.isfile(source.file))]
    )
    watch("writing the report")
    write((target, as_text(lambda: estimate_report(estimate), REPORT)))
    show([*([] if estimate.evidence else [WITHOUT]), f"report: {target}"])
    return OK
