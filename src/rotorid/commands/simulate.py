"""``rotorid simulate``."""

from __future__ import annotations

from pathlib import Path

from rotorid.commands import OK
from rotorid.commands.console import as_text, check_outputs, show, write
from rotorid.core.errors import InputError
from rotorid.core.files import check_apart
from rotorid.core.watch import watch
from rotorid.report.record_tables import fault_page, record_page
from rotorid.rig.file import load_rig
from rotorid.rig.files import RECORD, experiment_path, experiment_text, record_bytes


def run(
    rig: str | None,
    out: Path | None,
    seed: int | None,
    fault: tuple[str, ...],
    faults: bool,
    force: bool,
) -> int:
    if faults:
        show(fault_page())
        return OK
    if rig is None or out is None:
        raise InputError(
            "no RIG" if rig is None else "no --out",
            "rotorid simulate RIG --out FILE, or rotorid simulate --faults",
            "name both: a rig, such as three-mass, and the record to write, such as run.h5",
        )
    experiment = experiment_path(out, rig)
    targets = check_outputs((out, RECORD), (experiment, RECORD), force=force)
    plan = load_rig(rig).with_faults(fault)
    check_apart(targets, [Path(rig), Path(plan.model)])
    watch("running")
    record = plan.record(seed)
    write(
        (out, lambda: record_bytes(record, rig_text=plan.text, faults=fault)),
        (experiment, as_text(lambda: experiment_text(plan, record, out.name), RECORD)),
    )
    show(record_page(record, str(out), str(experiment)))
    return OK
