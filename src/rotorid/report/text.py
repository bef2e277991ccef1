"""How well an estimate predicts, as a table for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rotorid.estimators.information import Information
from rotorid.tables import Table, table
from rotorid.validation import ChannelError


def validation_table(records: Sequence[Sequence[ChannelError]]) -> Table:
    """Return how far each channel is off beside what explains it, and what it comes to."""
    several = len(records) > 1
    rows = [
        (
            f"{c.name}, record {number + 1}" if several else c.name,
            *map(_percent, (c.relative_error, c.noise, c.deviations)),
            "" if c.p_value is None else f"{c.p_value:.2g}",
            "zero" if c.relative_error is None else "fails" if c.fails else "predicted",
        )
        for number, record in enumerate(records)
        for c in record
    ]
    headings = ("channel", "off by %", "by noise %", "by deviations %", "chance", "verdict")
    return table(headings, rows)


def information_lines(records: Iterable[Information | None]) -> list[str]:
    """Return the condition number of the regressor of each record, as it is quoted for robots."""
    return [
        f"condition number of the regressor: {told.scaled_condition_number:.4g} with its "
        f"columns scaled, {told.condition_number:.4g} in SI units as it is"
        for told in records
        if told is not None
    ]


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.3g}"
