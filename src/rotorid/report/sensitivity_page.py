"""The sensitivity of loops, as a table and a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.results.sensitivity import AxisSensitivity, worst_of
from rotorid.tables import Page, Table, table


def sensitivity_page(found: Sequence[AxisSensitivity]) -> Page:
    """Return the zone of the machine, and a row per axis."""
    return [sentence_of(found), sensitivity_table(found)]


def sensitivity_table(found: Sequence[AxisSensitivity]) -> Table:
    """Return a row per axis: its peak, the interval of this, its zone."""
    rows = [
        (
            each.axis,
            f"{each.peak:.3g}",
            f"{each.interval[0]:.3g} to {each.interval[1]:.3g}",
            f"{each.peak_db:.1f}",
            f"{each.peak_hz:.4g}",
            each.verdict,
        )
        for each in found
    ]
    return table(("axis", "peak of S", "95 %", "dB", "at Hz", "ISO 14839-3"), rows)


def sentence_of(found: Sequence[AxisSensitivity]) -> str:
    """Return the zone of a machine, and the peak that makes it."""
    worst = max(found, key=lambda each: each.interval[1])
    low, high = worst.interval
    verdict = worst_of(found)
    return (
        f"{verdict[:1].upper()}{verdict[1:]}: the largest sensitivity is {worst.peak:.3g} "
        f"({worst.peak_db:.1f} dB) at {worst.peak_hz:.4g} Hz, of {worst.axis}; with 95 % it lies "
        f"between {low:.3g} and {high:.3g}"
    )
