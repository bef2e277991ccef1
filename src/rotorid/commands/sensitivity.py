"""``rotorid sensitivity``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rotorid.commands import OK
from rotorid.commands.console import (
    REPORT,
    SENSITIVITY,
    answer,
    as_json,
    as_text,
    check_outputs,
    progress,
)
from rotorid.commands.sources import done
from rotorid.errors import InputError
from rotorid.experiment import Experiment, load_experiment
from rotorid.experiment.recording import reference_name
from rotorid.report.sensitivity_page import sensitivity_page
from rotorid.results.sensitivity import AxisSensitivity, sensitivity, worst_of
from rotorid.writing import check_apart


def run(
    experiment: Path,
    pair: Sequence[str],
    json: Path | None,
    report: Path | None,
    force: bool,
    given: str,
) -> int:
    """Show the sensitivity of each loop as it was measured, its peak, and its zone."""
    targets = check_outputs((json, SENSITIVITY), (report, REPORT), force=force)
    with progress("reading"):
        plan = load_experiment(experiment)
        plan.require_records()
        check_apart(targets, plan.files)
        pairs, band, skip = _said(plan, pair)
        records = plan.measured("ml")
    try:
        with progress("computing"):
            found = sensitivity(records, pairs, band=band, skip=skip)
    except InputError as error:
        raise error.at(file=str(experiment)) from None

    def html() -> str:
        from rotorid.report.answers import sensitivity_report  # pictures take their time to load

        return sensitivity_report(found, experiment.name, done(given, plan.files))

    data = as_json({"axes": [_axis(each) for each in found], "verdict": worst_of(found)})
    answer(sensitivity_page(found), json=(json, data), report=(report, as_text(html)))
    return OK


def _said(
    plan: Experiment, given: Sequence[str]
) -> tuple[dict[str, str], tuple[float | str, float | str], float]:
    """Return the channels of e and r of each axis, the band, and what is skipped."""
    entry = plan.entry.records[0]
    references = entry.references or []
    if not references or entry.band is None:
        raise InputError(
            "a record without references and band",
            "references, the columns of what was added to the commands, and a band",
            'write references = ["r_x", ..] and band = ["2 Hz", "500 Hz"] into its table',
            file=plan.file,
            place="records.0.references",
        )
    if given:
        split = [text.partition("=")[::2] for text in given]
        pairs = {e.strip(): reference_name(r.strip()) for e, r in split}
    else:
        if len(references) != len(plan.model.inputs):
            raise InputError(
                f"{len(references)} references for {len(plan.model.inputs)} inputs",
                "one for each, in the order of the inputs",
                "say which belong together: --pair F_x1=r_x1",
                file=plan.file,
                place="records.0.references",
            )
        pairs = {e: reference_name(r) for e, r in zip(plan.model.inputs, references, strict=True)}
    return pairs, entry.band, float(entry.skip or 0.0)


def _axis(each: AxisSensitivity) -> dict[str, Any]:
    return {
        "axis": each.axis,
        "peak": each.peak,
        "peak_db": each.peak_db,
        "peak_hz": each.peak_hz,
        "interval": list(each.interval),
        "zone": each.zone,
        "frequency_hz": each.frequency_hz.tolist(),
        "sensitivity": [[s.real, s.imag] for s in each.sensitivity.tolist()],
        "std": each.std.tolist(),
    }
