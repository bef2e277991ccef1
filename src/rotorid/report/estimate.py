"""The report of an estimate, and of a validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.estimate import Estimate
from rotorid.filtered import FilteredRecord
from rotorid.lines import Lines
from rotorid.models import Model
from rotorid.observation import Measured
from rotorid.plots import pictures, spectra
from rotorid.predict import predict_lines
from rotorid.report.html import Picture, picture, render
from rotorid.report.plots import force_waves, speaks_of
from rotorid.tables import Page, Table, table


def estimate_report(
    estimate: Estimate,
    model: Model | None,
    records: Sequence[Measured],
    remarks: Sequence[str] = (),
) -> str:
    """Return the report of an estimate as HTML; without model and records what it holds itself."""
    shown = [*_record_pictures(estimate, model, records), *_own_pictures(estimate)]
    return render(
        "estimate.html",
        estimate=estimate,
        model=model,
        tables=estimate.tables,
        remarks=remarks,
        notes=[note for note in estimate.notes if not note.startswith("warning: ")],
        records=_records_table(records),
        pictures=shown,
    )


def validation_report(
    estimate: Estimate, model: Model, records: Sequence[Measured], page: Page
) -> str:
    """Return what a validation shows as HTML: its page, and every record as it is predicted."""
    return render(
        "validation.html",
        estimate=estimate,
        model=model,
        page=page,
        records=_records_table(records),
        pictures=list(_record_pictures(estimate, model, records)),
    )


def _own_pictures(estimate: Estimate) -> Iterator[Picture]:
    """Draw what the estimate holds: where the misfit lies, and how parameters hang together."""
    if estimate.line_misfit:
        yield picture(
            pictures.draw_misfit(
                [row.record for row in estimate.line_misfit],
                [row.frequency_hz for row in estimate.line_misfit],
                [row.cost for row in estimate.line_misfit],
                [row.expected for row in estimate.line_misfit],
            ),
            "Misfit line by line",
            "Cost of each line over what noise would leave of it. Lines that stand out together "
            "say where in frequency the model lacks something.",
        )
    names = [value.name for value in estimate.free]
    if 1 < len(names) == len(estimate.covariance):
        yield picture(
            pictures.draw_correlation(names, estimate.correlation),
            "Correlation of the parameters",
            "Near +1 or -1 two parameters are known as a combination better than one by one.",
        )


def _record_pictures(
    estimate: Estimate, model: Model | None, records: Sequence[Measured]
) -> Iterator[Picture]:
    for number, record in enumerate(records):
        where = f", record {number + 1}" if len(records) > 1 else ""
        if isinstance(record, Lines):
            known = model is not None and speaks_of(model, estimate, record, number)
            found = predict_lines(model, estimate, [record], number)[0] if model and known else None
            yield picture(
                spectra.draw_lines(record, found),
                f"Lines{where}",
                f"{len(record.frequency)} lines of the whole record, channel by channel, with the "
                "noise that the estimate was weighted by.",
            )
            continue
        waves = None if model is None else force_waves(model, estimate, record, number)
        if isinstance(record, FilteredRecord):
            if waves is not None:
                yield picture(
                    pictures.draw_forces(waves),
                    f"Measured and predicted{where}",
                    "The samples that were used, filtered, one after the other. The prediction "
                    "lays what the equations of motion leave over to the inputs.",
                )
            yield picture(
                spectra.draw_samples(record.record), f"Samples{where}", "As they were measured."
            )
            continue
        if waves is not None:
            yield picture(
                pictures.draw_forces(waves),
                f"Measured and predicted{where}",
                "One period on the kept lines. Where every coordinate is measured, the prediction "
                "lays what the equations of motion leave over to the inputs; else it is what the "
                "sensors should read of the measured inputs.",
            )
        yield picture(
            spectra.draw_spectra(record),
            f"Spectra{where}",
            f"Mean of {record.periods} periods, channel by channel. Lines that were not kept took "
            "no part. The noise is the scatter of the kept lines between periods, of their mean.",
        )


def _cut(record: Measured) -> tuple[str, ...]:
    """Return how a record was cut: periods, their samples, rate, fundamental, lines."""
    if isinstance(record, FilteredRecord):
        return "-", str(len(record.used)), f"{record.record.sample_rate:g}", "-", "-"
    if isinstance(record, Lines):
        return "-", "-", "-", "-", str(len(record.frequency))
    return (
        str(record.periods),
        str(record.samples),
        f"{record.sample_rate:g}",
        f"{record.fundamental:g}",
        str(len(record.harmonics)),
    )


def _records_table(records: Sequence[Measured]) -> Table | None:
    """Return a row per record: how it was recorded and cut; nothing where there are none."""
    headings = ("record", "periods", "samples per period", "sample rate in Hz")
    more = ("fundamental in Hz", "lines", "speed in rev/s", "channels")
    rows = [
        (
            f"{number}: {record.source}" if record.source else str(number),
            *_cut(record),
            f"{np.mean(record.speed) / (2 * np.pi):.6g}",
            ", ".join(record.names),
        )
        for number, record in enumerate(records, start=1)
    ]
    return table((*headings, *more), rows) if rows else None
