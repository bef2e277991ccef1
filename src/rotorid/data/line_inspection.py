"""What is in a table of phasors or frequency responses, before anything is identified."""

from __future__ import annotations

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.data.lines import Lines, PhasorClock
from rotorid.signals.inspection import Judged


@frozen
class LineFacts:
    """What one channel of a table holds."""

    name: str
    unit: str
    # least and largest amplitude in SI
    low: float
    high: float
    at: float  # where it is largest: rpm, or Hz of a response
    # power over that of its noise, of the median row; None where nothing tells the noise
    snr_db: float | None


@frozen
class LineInspection(Judged):
    """What is in a table."""

    lines: Lines
    checks: tuple[Note, ...]
    channels: tuple[LineFacts, ...]

    @property
    def source(self) -> str:
        return self.lines.source

    @property
    def turning(self) -> bool:
        """Whether each row has a speed of its own: phasors, not responses."""
        return isinstance(self.lines.clock, PhasorClock)


def inspect_lines(lines: Lines) -> LineInspection:
    """Look at a table as a technician would: what each channel reads, where, and how clearly."""
    turning = isinstance(lines.clock, PhasorClock)
    size = (2.0 if turning else 1.0) * np.abs(lines.mean)
    noise = np.diagonal(lines.covariance.matrices, axis1=1, axis2=2).real
    where = lines.speed * 30 / np.pi if turning else lines.frequency
    driven = None if turning else lines.channels[0]  # the input of a response is one by definition
    found = []
    for c, channel in enumerate(lines.channels):
        if channel is driven:
            continue
        told = noise[:, c] > 0
        ratio = np.abs(lines.mean[told, c]) ** 2 / noise[told, c]
        middle = float(np.median(ratio)) if told.any() else 0.0
        found.append(
            LineFacts(
                channel.name,
                channel.unit if driven is None else f"({channel.unit})/({driven.unit})",
                float(size[:, c].min()),
                float(size[:, c].max()),
                float(where[np.argmax(size[:, c])]),
                float(10 * np.log10(middle)) if middle > 0 else None,
            )
        )
    return LineInspection(lines, lines.checks, tuple(found))
