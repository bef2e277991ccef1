"""``rotorid validate``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.predict import at_best_phase, channel_errors, verdict_of
from rotorid.answer.result_file import load_estimate
from rotorid.commands import NO_ANSWER, OK
from rotorid.commands.console import Outputs, done, source_of
from rotorid.core.errors import InputError, naming
from rotorid.core.files import check_apart
from rotorid.core.tables import Page
from rotorid.core.watch import watch
from rotorid.experiment import load_experiment
from rotorid.linear.family import information_of
from rotorid.report.estimate_report import information_lines, validation_report, validation_table


def run(result: Path, experiment: Path, answer: Outputs) -> int:
    targets = answer.check()
    estimate = load_estimate(result)
    watch("reading")
    plan = load_experiment(experiment)
    plan.require_records()
    check_apart(targets, [result, *plan.files])
    if estimate.model != (name := plan.model.name):  # parameters may have the same names
        raise InputError(
            f"a result of the model {estimate.model[:60]!r}",
            f"one of {name[:60]!r}, the model of the experiment",
            "name the model of the result in the experiment, or identify with this one",
            file=str(result),
        )
    records = plan.records("ml" if estimate.method == "ml" else "batch")
    with naming(str(result)):
        turned = [at_best_phase(plan.model, estimate, r, k) for k, r in enumerate(records)]
        placed = [record for record, _ in turned]
        found = [
            channel_errors(plan.model, estimate, record, number)
            for number, record in enumerate(placed)
        ]
        told = [information_of(plan.model, estimate, record) for record in placed]
    reached = verdict_of(found)
    lead = f"{reached.verdict}: {reached.sentence}"
    page: Page = [lead, validation_table(found), *information_lines(told)]
    fitted = [
        f"note: nothing tells the rotor angle of record {number + 1}: {np.rad2deg(angle):.4g} deg, "
        "which fits best, was taken: the amount of the unbalance is tested, its direction is not"
        for number, (_, angle) in enumerate(turned)
        if angle is not None
    ]
    page = [*page, *fitted, *_its_own(estimate, plan.record_files), *reached.cures]

    def html() -> str:
        from rotorid.results.evidence import record_evidence

        shown = record_evidence(estimate, plan.model, placed, another=True)
        work = [*done(answer.given, [result, *plan.files]), *information_lines(told), *fitted]
        return validation_report(estimate, plan.model, found, shown, work)

    rows = [{"record": k, **vars(one)} for k, record in enumerate(found) for one in record]
    content = {"verdict": reached.verdict, "channels": rows}
    answer.give(page, content, html)
    return OK if reached.verdict == "predicts" else NO_ANSWER


def _its_own(estimate: Estimate, files: Sequence[Path]) -> list[str]:
    made_of = () if estimate.provenance is None else estimate.provenance.files
    sums = {source.sha256 for source in made_of} - {""}
    return [
        f"note: {path} is a record that the result was made of, which proves little: take another"
        for path in dict.fromkeys(files)
        if path.is_file() and source_of(path).sha256 in sums
    ]
