"""What a rig recorded, as a table for a terminal."""

from __future__ import annotations

import numpy as np

from rotorid.rig.logger import Column, RigRecord
from rotorid.tables import Page, table

_HEADINGS = ("column", "unit", "mean", "rms about it", "hold", "delay us")


def record_page(record: RigRecord, file: str, experiment: str) -> Page:
    """Return the columns of a record with their size, and what to do with it."""
    turning = record.speed / (2 * np.pi) * 60
    return [
        f"{len(record.samples)} samples at {record.sample_rate:g} Hz, {turning:.6g} rpm: {file}",
        table(_HEADINGS, map(_row, record.columns)),
        f"The experiment file that identifies it: {experiment}",
        f"    rotorid identify {experiment}",
    ]


def _row(column: Column) -> tuple[str, ...]:
    mean, rms = column.samples.mean(), column.samples.std()
    return (
        column.name,
        column.unit,
        f"{mean:.4g}",
        f"{rms:.4g}",
        "zero-order" if column.hold else "",
        f"{column.delay * 1e6:.6g}" if column.delay else "",
    )
