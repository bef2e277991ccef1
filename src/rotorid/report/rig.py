"""What a rig recorded, and the faults that it may have, as pages for a terminal."""

from __future__ import annotations

from rotorid.rig.faults import FAULTS
from rotorid.rig.logger import Column, Logged
from rotorid.tables import Page, by_hand, table

_HEADINGS = ("column", "unit", "mean", "rms about it", "hold", "delay us")


def record_page(record: Logged, file: str, experiment: str) -> Page:
    """Return the columns of a record with their size, and what to do with it."""
    turning = record.truth.rpm
    return [
        f"{record.count} samples at {record.sample_rate:g} Hz, {turning:.6g} rpm: {file}",
        table(_HEADINGS, map(_row, record.columns)),
        f"The experiment file that identifies it: {experiment}",
        f"    rotorid identify {experiment}",
    ]


def fault_page() -> Page:
    """Return the faults that a rig may have, one a line: name, size by default, what it is."""
    names = max(map(len, FAULTS))
    return [f"{f.name:{names}}  {f.shown:>10}  {f.what}" for f in FAULTS.values()]


def _row(column: Column) -> tuple[str, ...]:
    mean, rms = column.samples.mean(), column.samples.std()
    unit, factor = by_hand(column.unit)
    return (
        column.name,
        unit,
        f"{factor * mean:.4g}",
        f"{factor * rms:.4g}",
        "zero-order" if column.hold else "",
        f"{column.delay * 1e6:.6g}" if column.delay else "",
    )
