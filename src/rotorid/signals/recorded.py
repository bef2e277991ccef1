"""Samples of a quantity from the column that recorded it: without hold, delay and dynamics."""

from __future__ import annotations

import numpy as np

from rotorid.record import Channel, Floats
from rotorid.signals.shift import extended, shifted
from rotorid.signals.spectrum import transfer_of_recording

REACH = 512
"""Samples beyond the ends of a record: the slowest amplifier has forgotten them."""
AMPLIFIED = 10.0
"""What a channel lets less than a tenth through of is noise, and is not made any larger."""


def quantity(
    column: Floats, channel: Channel, sample_rate: float, period: int | None = None
) -> Floats:
    """Return the samples that a column would have had without what recorded it, (sample,).

    A delay by local interpolation; dynamics line by line over the record, where a table of a
    response goes on beyond its ends as it is there.
    """
    if channel.dynamics is None:
        return shifted(column, channel.delay * sample_rate, period)
    goes_round = period is not None and len(column) % period == 0
    reach = 0 if goes_round else min(REACH, len(column) - 1, period or REACH)
    whole = extended(column, reach, reach, period)
    turns = np.asarray(np.fft.rfftfreq(len(whole)), dtype=np.float64)
    frequency = np.clip(turns * sample_rate, *channel.dynamics.band)
    factor = transfer_of_recording([channel], frequency, sample_rate)[:, 0]
    factor = factor / np.maximum(np.abs(factor) / AMPLIFIED, 1.0)
    lines = np.fft.rfft(whole) * factor
    return np.asarray(np.fft.irfft(lines, len(whole))[reach : len(whole) - reach])
