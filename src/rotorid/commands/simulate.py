"""``rotorid simulate``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import check_outputs, progress, show, write, write_text
from rotorid.report.rig import record_page
from rotorid.rig.export import experiment_path, experiment_text, require_own, write_record
from rotorid.rig.file import load_rig


def run(rig: str, out: Path, seed: int | None, force: bool) -> int:
    """Run a rig and write its record, with the experiment file that identifies it."""
    experiment = experiment_path(out, rig)
    check_outputs(out, experiment)
    if not force:
        require_own(out)
        require_own(experiment)
    plan = load_rig(rig)
    with progress("running"):
        record = plan.run(seed)
    write(
        (out, partial(write_record, record, rig_text=plan.text)),
        (experiment, write_text(lambda: experiment_text(plan, record, out.name))),
    )
    show(record_page(record, str(out), str(experiment)))
    return OK
