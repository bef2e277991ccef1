"""``rotorid validate``."""

from __future__ import annotations

import json as json_format
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rotorid.commands import OK
from rotorid.commands.console import check_outputs, progress, show, write, write_text
from rotorid.errors import InputError
from rotorid.estimate import Prediction, load_estimate
from rotorid.estimators.information import information_of
from rotorid.estimators.prediction import relative_errors
from rotorid.experiment import load_experiment
from rotorid.io.output import check_apart
from rotorid.predict import predict_lines
from rotorid.report.text import information_lines, prediction_table
from rotorid.tables import Page


def run(result: Path, experiment: Path, json: Path | None, report: Path | None) -> int:
    """Predict the records of an experiment with a result."""
    targets = check_outputs(json, report)
    estimate = load_estimate(result)
    with progress("reading"):
        plan = load_experiment(experiment)
        plan.require_records()
        check_apart(targets, [result, *plan.files])
        records = plan.records("ml" if estimate.method == "ml" else "batch")
    try:
        predicted = [
            predict_lines(plan.model, estimate, [record], number)
            for number, record in enumerate(records)
        ]
        errors = [relative_errors(lines) for lines in predicted]
        told = [information_of(plan.model, estimate, record) for record in records]
    except InputError as error:
        raise error.at(file=str(result)) from None
    page: Page = [prediction_table(errors), *information_lines(told)]

    def html() -> str:
        from rotorid.report.estimate import validation_report  # pictures take their time to load

        return validation_report(estimate, plan.model, records, page)

    text = json_format.dumps({"channels": channels(errors)}, indent=2, allow_nan=False)
    write((json, write_text(lambda: text + "\n")), (report, write_text(html)))
    show(page)
    return OK


def channels(errors: Sequence[Mapping[str, Prediction | None]]) -> list[dict[str, Any]]:
    """Return one row per channel and record: how far the prediction is off."""
    return [
        {"record": index, "name": name, "relative_error": found and found.relative_error}
        for index, record in enumerate(errors)
        for name, found in record.items()
    ]
