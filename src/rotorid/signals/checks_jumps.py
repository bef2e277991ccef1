"""Samples that are missing in the middle of a record, or come twice: all positions jump at once.

A position is smooth; from one sample to the next it moves about as before and after. Where samples
are lost in all columns every sensor jumps between the same two, whatever their noise is.
"""

from __future__ import annotations

import numpy as np
import scipy

from rotorid.record import Check, Floats, Record
from rotorid.signals.checks_samples import is_input

LENGTHS = frozenset({"m", "rad"})
"""Units of what is smooth: a force may jump, and with it an acceleration."""
AROUND = 50
"""Samples on each side that tell what is usual there: a sweep through a resonance is no jump."""
SURE = 8.0
"""Times the usual size at which one sensor jumps: of 25,000 samples of noise the largest is 5."""
SHARE = 0.5
"""Part of the sensors that jump, at least, and two of them: one alone is a knock of its own."""


def check_jumps(record: Record) -> list[Check]:
    """Find where all positions jump within one sample.

    Parameters
    ----------
    record : Record
    """
    columns = [c for c, ch in enumerate(record.channels) if ch.unit in LENGTHS and not is_input(ch)]
    if len(columns) < 2 or len(record.samples) < 4 * AROUND:
        return []
    jumps = np.stack([_jumps(record.samples[:, c]) for c in columns], axis=1) > SURE
    together = np.flatnonzero(jumps.sum(axis=1) >= max(2, SHARE * len(columns)))
    if not len(together):
        return []
    together = together[np.append(True, np.diff(together) > 2)]  # beside a jump is half of it
    at = record.start + (int(together[0]) + 0.5) / record.sample_rate
    more = len(together) - 1
    text = (
        f"{int(jumps[together[0]].sum())} positions jump within a sample at {at:.6g} s"
        f"{f' and at {more} more places' if more else ''}: samples are missing there or come "
        "twice; use the part before or behind (skip, until)"
    )
    return [Check("lost samples", "", text, "warning")]


def _jumps(samples: Floats) -> Floats:
    """Return by how much a channel moves from each sample to the next beyond what is usual."""
    steps = np.diff(samples)
    beyond = np.zeros(len(steps))
    beyond[1:-1] = np.abs(steps[1:-1] - (steps[:-2] + steps[2:]) / 2)
    power = beyond**2
    width = 2 * AROUND + 1
    near = scipy.ndimage.uniform_filter1d(power, width) * width
    near -= scipy.ndimage.uniform_filter1d(power, 3) * 3  # not of the jump itself
    usual = np.sqrt(np.maximum(near, 0.0) / (width - 3))
    usual = np.maximum(usual, 1e-12 * np.abs(samples).max(initial=0.0))
    return np.asarray(beyond / np.where(usual > 0, usual, np.inf))
