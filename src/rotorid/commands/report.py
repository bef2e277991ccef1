"""``rotorid report``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from hashlib import file_digest
from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import REPORT, as_text, check_outputs, progress, show, write
from rotorid.errors import InputError
from rotorid.estimate import Estimate, load_estimate
from rotorid.experiment import load_experiment
from rotorid.models import Model
from rotorid.observation import Measured
from rotorid.report.estimate import estimate_report
from rotorid.writing import check_apart


def run(result: Path, out: Path | None, force: bool) -> int:
    """Write the report of a result again, with its records where they are still as they were."""
    target = result.with_suffix(".html") if out is None else out
    targets = check_outputs((target, REPORT), force=force)
    estimate = load_estimate(result)
    files = [] if estimate.provenance is None else estimate.provenance.files
    check_apart(
        targets, [result, *(Path(source.file) for source in files if os.path.isfile(source.file))]
    )
    with progress("reading"):
        missing = moved(estimate)
        model, records = (None, ()) if missing else read_again(estimate)
    notes = [f"{missing}: the records are left out"] if missing else []
    write((target, as_text(lambda: estimate_report(estimate, model, records, notes))))
    show([*notes, f"report: {target}"])
    return OK


def moved(estimate: Estimate) -> str:
    """Say which file of an estimate is no longer what was read; "" where all are."""
    if estimate.provenance is None or not estimate.provenance.files:
        return "the result does not say which files it comes from"
    for source in estimate.provenance.files:
        if not os.path.isfile(source.file):  # nor a device, which may never end
            return f"{source.file[:200]} is not there"
        try:
            with Path(source.file).open("rb") as stream:
                same = file_digest(stream, "sha256").hexdigest() == source.sha256
        except (OSError, ValueError):
            return f"{source.file} cannot be read"
        if not same:
            return f"{source.file} has changed since"
    return ""


def read_again(estimate: Estimate) -> tuple[Model | None, Sequence[Measured]]:
    """Read the model and the records of an estimate; nothing where the method was the user's."""
    assert estimate.provenance is not None
    model = None
    try:
        plan = load_experiment(estimate.provenance.files[0].file)
        model = plan.model
        return model, plan.records("ml" if estimate.method == "ml" else "batch")
    except InputError:
        return model, ()
