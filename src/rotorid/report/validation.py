"""The report of a validation: a record held against what a result predicts of it."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.estimate import Estimate
from rotorid.evidence import RecordEvidence
from rotorid.models import Model
from rotorid.report.estimate import record_pictures, records_table
from rotorid.report.html import render
from rotorid.report.text import validation_table
from rotorid.report.verdict import METHODS
from rotorid.validation import ChannelError, verdict_of


def validation_report(
    estimate: Estimate,
    model: Model,
    found: Sequence[Sequence[ChannelError]],
    records: Sequence[RecordEvidence],
    notes: Sequence[str] = (),
) -> str:
    """Return what a validation shows as HTML: its verdict, and every record as it is predicted."""
    reached = verdict_of(found)
    return render(
        "validation.html",
        estimate=estimate,
        model=model,
        verdict=reached.verdict,
        method=METHODS.get(estimate.method, estimate.method),
        said=reached.sentence[:1].upper() + reached.sentence[1:],
        steps=reached.cures,
        channels=validation_table(found),
        records=records_table(records),
        pictures=list(record_pictures(records, another=True)),
        notes=notes,
    )
