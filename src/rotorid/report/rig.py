"""What a rig recorded, as a table for a terminal."""

from __future__ import annotations

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rotorid.rig.logger import Column, RigRecord


def record_summary(record: RigRecord, file: str, experiment: str) -> RenderableType:
    """Return the columns of a record with their size, and what to do with it."""
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("column", "unit"):
        table.add_column(heading)
    for heading in ("mean", "rms about it", "hold", "delay us"):
        table.add_column(heading, justify="right")
    for column in record.columns:
        table.add_row(*_row(column))
    turning = record.speed / (2 * np.pi) * 60
    title = f"{len(record.samples)} samples at {record.sample_rate:g} Hz, {turning:.6g} rpm: {file}"
    return Group(
        Text(title),
        table,
        Text(f"The experiment file that identifies it: {experiment}"),
        Text(f"    rotorid identify {experiment}"),
    )


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
