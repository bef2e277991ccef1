"""The report of an estimate, from the result alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.evidence import ChannelEvidence, RecordEvidence
from rotorid.models import Model, shipped_models
from rotorid.models.rotor import RotorModel
from rotorid.plots import estimates as drawn
from rotorid.plots import rotors
from rotorid.record import Floats
from rotorid.report import parameters
from rotorid.report.html import Picture, pictures, render
from rotorid.report.machines import Part, machine_part
from rotorid.report.verdict import METHODS, verdict_of
from rotorid.results.model import own_model
from rotorid.tables import Table, table

KINDS = {
    "periods": "periods",
    "lines": "lines of the whole record",
    "phasors": "table of 1x phasors",
    "responses": "frequency responses",
    "samples": "filtered samples",
}
EARLY = ("unbalance", "suspect", "other answers")
"""Tables that stand before the pictures."""
TITLES = {
    "unbalance": "Unbalance in each plane",
    "suspect": "What the model may lack, or a channel get wrong",
    "other answers": "Other answers that fit as well",
    "check": "What the records showed, and what was taken as exact",
    "natural frequencies": "Natural frequencies that were measured",
}
WITHOUT = (
    "This result holds no evidence of its records, so nothing of them is drawn: it was written by "
    "an older version, or in Python without with_evidence. Identify again to have it."
)


def estimate_report(estimate: Estimate, remarks: Sequence[str] = ()) -> str:
    """Return the report of an estimate as HTML, from what it holds itself."""
    model, lacking = model_of(estimate)
    records = estimate.evidence.records if estimate.evidence else ()
    told = [*remarks, *lacking, *([] if estimate.evidence else [WITHOUT])]
    shown = [one.headings[0] for one in estimate.value_tables]
    page = estimate.summary(intervals=True)
    tables = {one.headings[0]: one for one in page if isinstance(one, Table)}
    others = [one for head, one in tables.items() if head not in shown]
    return render(
        "estimate.html",
        estimate=estimate,
        model=model,
        machine=_machine(estimate, model, records),
        own=model is None or model.name not in shipped_models(),
        method=METHODS.get(estimate.method, estimate.method),
        verdict=verdict_of(estimate),
        rejected=estimate.status == "rejected",
        groups=parameters.groups(estimate),
        known=parameters.any_known(estimate),
        relations=parameters.relations(estimate),
        fixed=parameters.fixed(estimate),
        early=[_titled(one) for one in others if one.headings[0] in EARLY],
        tables=[_titled(one) for one in others if one.headings[0] not in EARLY],
        remarks=told,
        notes=[n for n in estimate.notes if not n.startswith(("warning: ", "note, "))],
        exact=[note.removeprefix("note, ") for note in estimate.notes if note.startswith("note, ")],
        channels=channels_table(records),
        records=records_table(records),
        pictures=[*_drawn(model), *record_pictures(records), *_own_pictures(estimate, records)],
    )


def _machine(
    estimate: Estimate, model: Model | None, records: Sequence[RecordEvidence]
) -> Part | None:
    """Return the modes of the machine, at the highest speed of the records."""
    if model is None or model.linear is None:
        return None
    speeds = [speed for record in records for speed in record.speed_rad_s if math.isfinite(speed)]
    return machine_part(estimate, max(speeds, key=abs, default=0.0))


def _titled(one: Table) -> tuple[str, Table]:
    """Return a table with its title."""
    head = one.headings[0]
    return TITLES.get(head, head[:1].upper() + head[1:]), one


def model_of(estimate: Estimate) -> tuple[Model | None, list[str]]:
    """Return the model of a result, or why there is none."""
    try:
        return own_model(estimate), []
    except InputError as error:
        return None, [f"{error.found}: the equations of motion are not shown; {error.cure}."]


def _drawn(model: Model | None) -> Iterator[Picture]:
    """Draw the rotor, where the model comes from a drawing."""
    if isinstance(model, RotorModel):
        yield Picture(
            "The rotor",
            "The rotor as it is drawn, and what stands on it.",
            (rotors.drawing(model.rotor),),
        )


def _own_pictures(estimate: Estimate, records: Sequence[RecordEvidence]) -> Iterator[Picture]:
    """Draw what the estimate holds: where the misfit lies, and how parameters hang together."""
    rows = estimate.line_misfit
    turning = bool(records) and all(record.kind == "phasors" for record in records)
    if rows:
        panel = drawn.misfit(
            [row.record for row in rows],
            [row.frequency_hz for row in rows],
            [row.cost for row in rows],
            [row.expected for row in rows],
            turning=turning,
        )
        what, where = ("row", "speed") if turning else ("spectral line", "frequency")
        yield Picture(
            f"Misfit, {where} by {where}",
            f"Misfit of each {what} over what noise would leave of it; 1 is right on average. "
            f"Those that stand out together say at which {where} the model lacks something.",
            (panel,),
        )
    names = [value.name for value in estimate.free]
    if 1 < len(names) == len(estimate.covariance) and np.isfinite(estimate.correlation).any():
        yield Picture(
            "Correlation of the parameters",
            f"{_strongest(names, estimate.correlation)} Near +1 or \N{MINUS SIGN}1 two "
            "parameters are known as a combination better than one by one.",
            (drawn.correlation(names, estimate.correlation),),
        )


def _strongest(names: Sequence[str], matrix: Floats) -> str:
    """Name the two parameters that hang together most."""
    size = np.nan_to_num(np.abs(np.triu(matrix, 1)))
    i, j = divmod(int(np.argmax(size)), size.shape[1])
    value = f"{matrix[i, j]:+.2f}".replace("-", "\N{MINUS SIGN}")
    return f"Strongest: {names[i]} with {names[j]}, {value}."


def record_pictures(
    records: Sequence[RecordEvidence], *, another: bool = False
) -> Iterator[Picture]:
    """Draw records as they were measured and as they are predicted.

    Of `another` record than the estimate was made of, the deviations of its values count too.
    """
    noise = "noise and the deviations of the values make" if another else "noise makes"
    for number, record in enumerate(records):
        where = f", record {number + 1}" if len(records) > 1 else ""
        each = "speed by speed" if record.kind == "phasors" else "frequency by frequency"
        yield from pictures(
            (
                f"Measured and predicted over time{where}",
                f"{_of_waves(record)} The band holds 95 % of what {noise} of the difference.",
                drawn.waves(record),
            ),
            (
                f"What is left over time{where}",
                f"Predicted less measured, on a scale of its own; the band holds 95 % of what "
                f"{noise} of it.",
                drawn.differences(record),
            ),
            (
                f"Measured and predicted, {each}{where}",
                f"{_of_lines(record)} Where the difference lies in the band or below, it is what "
                f"{noise}. A channel that is not predicted is shown with its own noise.",
                drawn.lines(record),
            ),
            (
                f"What is left, {each}{where}",
                f"Predicted less measured of each channel over what {noise} of it. Evenly near "
                "1 is noise; a line or a channel that stands out is none.",
                drawn.residual(record),
            ),
        )


def _of_waves(record: RecordEvidence) -> str:
    """Say what the pictures over time show."""
    if record.kind == "samples":
        return (
            "The samples that were used, filtered. The prediction lays what the equations of "
            "motion leave over to the inputs."
        )
    stretch = (
        "One period, of the frequencies that are used."
        if record.kind == "periods"
        else "An excerpt from the middle of the record, of the frequencies that are used."
    )
    told = (
        f"{stretch} Where every coordinate is measured, forces are predicted from the motion; else "
        "what the sensors should read, from the forces."
    )
    left = max((channel.left_out for channel in record.channels), default=0)
    if left:
        told += (
            f" Up to {left} of {record.lines} lines, beside a resonance, are not in it: there the "
            "noise of the forces alone moves the model further than the machine moved."
        )
    return told


def _of_lines(record: RecordEvidence) -> str:
    """Say what the pictures on the lines show."""
    what = "rows of 1x phasors" if record.kind == "phasors" else "spectral lines"
    told = f"Amplitudes of {record.lines} {what}"
    if record.lines_per_point > 1:
        told += f", {record.lines_per_point} neighbours together as their root mean square"
    return f"{told}."


def channels_table(records: Sequence[RecordEvidence]) -> Table | None:
    """Return how well each channel is predicted, in figures."""
    several = len(records) > 1
    rows = [
        ((f"{c.name}, record {n + 1}" if several else c.name), *_against_noise(c))
        for n, record in enumerate(records)
        for c in record.channels
        if not math.isnan(c.error)
    ]
    headings = ("channel", "off by %", "noise makes %", "difference / noise")
    return table(headings, rows) if rows else None


def _against_noise(channel: ChannelEvidence) -> tuple[str, ...]:
    """Return the error in %, what noise makes of it, and the ratio of the two."""
    noise = math.nan
    if channel.difference and channel.noise:
        pair = (channel.noise, channel.difference)
        made, wrong = (float(np.sqrt(np.mean(np.square(x)))) for x in pair)
        noise = made / wrong if wrong > 0 else math.nan
    shown = (100 * channel.error, 100 * channel.error * noise, 1 / noise if noise > 0 else math.nan)
    return tuple(f"{x:.3g}" if math.isfinite(x) else "" for x in shown)


def records_table(records: Sequence[RecordEvidence]) -> Table | None:
    """Return a row per record: how it was recorded and used; nothing where there are none."""
    first = ("record", "used as", "periods", "samples per period", "sample rate in Hz")
    headings = (*first, "lines", "speed in rpm", "channels")
    rows = [
        (
            f"{number}: {record.source}" if record.source else str(number),
            KINDS[record.kind],
            str(record.periods or ""),
            str(record.samples_per_period or ""),
            f"{record.sample_rate_hz:.6g}" if math.isfinite(record.sample_rate_hz) else "",
            str(record.lines or ""),
            _speeds(record),
            ", ".join(channel.name for channel in record.channels),
        )
        for number, record in enumerate(records, start=1)
    ]
    told = [k for k in range(len(headings)) if any(row[k] for row in rows)]
    if not rows:
        return None
    return table([headings[k] for k in told], [[row[k] for k in told] for row in rows])


def _speeds(record: RecordEvidence) -> str:
    found = [f"{30 / math.pi * speed:.6g}" for speed in record.speed_rad_s]
    return " to ".join(dict.fromkeys(found))
