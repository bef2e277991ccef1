"""`Evidence`: what a report shows of the records behind a result, in the result itself."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Strict

from rotorid.core.frozen import frozen

Kind = Literal["periods", "lines", "phasors", "responses", "samples"]
# JSON knows no NaN: null stands for a number that is not finite, in both directions.
Number = Annotated[float, Strict(), BeforeValidator(lambda x: math.nan if x is None else x)]
Numbers = tuple[Number, ...]
Count = Annotated[int, Strict()]


@frozen
class ChannelEvidence:
    """One channel of a record: what was measured, and what the estimate predicts."""

    # SI
    name: str
    unit: str
    # amplitudes on the lines of the record: as measured, as predicted, of their difference, and of
    # what the noise of the record makes of that difference, one standard deviation; of a channel
    # that is not predicted, the noise of the channel. Empty where there is none.
    measured: Numbers = ()
    predicted: Numbers = ()
    difference: Numbers = ()
    noise: Numbers = ()
    # the same over time, at the times of the record
    wave_measured: Numbers = ()
    wave_predicted: Numbers = ()
    # standard deviation that noise gives the difference of the two at any time
    wave_noise: Number = math.nan
    # |predicted - measured| / |measured| on all lines that are not left out
    error: Number = math.nan
    # lines beside a resonance on which the noise alone moves the prediction further than the
    # channel moved. They are in none of what is over time, nor in `error`.
    left_out: Count = 0


@frozen
class RecordEvidence:
    """One record as it was used."""

    source: str
    # {"periods", "lines", "phasors", "responses", "samples"}: cut into periods; the lines of the
    # whole record; a table of 1x phasors or of frequency responses; samples filtered
    kind: Kind
    lines: Count = 0  # lines that were used
    # how many neighbouring lines one value here stands for: their root mean square
    lines_per_point: Count = 1
    # 0 where there are none
    periods: Count = 0
    samples_per_period: Count = 0
    sample_rate_hz: Number = math.nan
    speed_rad_s: Numbers = ()  # the lowest and the highest speed
    frequency_hz: Numbers = ()  # of the lines; of several neighbouring ones the middle
    time_s: Numbers = ()  # one period; or an excerpt of the record; or every so many samples
    channels: tuple[ChannelEvidence, ...] = ()  # those that are predicted first

    def __post_init__(self) -> None:
        for channel in self.channels:
            on_lines = (channel.measured, channel.predicted, channel.difference, channel.noise)
            over_time = (channel.wave_measured, channel.wave_predicted)
            for rows, length in ((on_lines, len(self.frequency_hz)), (over_time, len(self.time_s))):
                if any(len(row) not in (0, length) for row in rows):
                    raise ValueError(f"{length} numbers of each kind, or none")


@frozen
class Prior:
    """What was known of a quantity before the records: its value and deviation, 0 for exactly."""

    name: str  # of a parameter or nuisance, or an expression in parameters
    value: Number
    std: Number


@frozen
class Evidence:
    """What a report shows besides the values.

    Examples
    --------
    >>> Evidence(known=(Prior("L1", 0.3, 0.0005),)).prior("L1").std
    0.0005
    """

    records: tuple[RecordEvidence, ...] = ()
    known: tuple[Prior, ...] = ()  # what was known beforehand, with its deviation

    def prior(self, name: str) -> Prior | None:
        """Return what was known of a quantity, None where nothing was."""
        return next((prior for prior in self.known if prior.name == name), None)
