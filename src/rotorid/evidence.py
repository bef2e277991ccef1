"""`Evidence`: what a report shows of the records behind a result, in the result itself."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import BeforeValidator, Strict

from rotorid.frozen import frozen

Kind = Literal["periods", "lines", "phasors", "responses", "samples"]
# JSON knows no NaN: null stands for a number that is not finite, in both directions.
Number = Annotated[float, Strict(), BeforeValidator(lambda x: math.nan if x is None else x)]
Numbers = tuple[Number, ...]
Count = Annotated[int, Strict()]


@frozen
class ChannelEvidence:
    """One channel of a record: what was measured, and what the estimate predicts.

    Parameters
    ----------
    name, unit : str
        SI.
    measured, predicted, difference, noise : sequence of float
        Amplitudes on the lines of the record: as measured, as predicted, of their difference, and
        of what the noise of the record makes of that difference, one standard deviation; of a
        channel that is not predicted, the noise of the channel. Empty where there is none.
    wave_measured, wave_predicted : sequence of float
        The same over time, at the times of the record.
    wave_noise : float
        Standard deviation that noise gives the difference of the two at any time.
    error : float
        |predicted - measured| / |measured| on all lines that are not left out.
    left_out : int
        Lines beside a resonance on which the noise alone moves the prediction further than the
        channel moved. They are in none of what is over time, nor in `error`.
    """

    name: str
    unit: str
    measured: Numbers = ()
    predicted: Numbers = ()
    difference: Numbers = ()
    noise: Numbers = ()
    wave_measured: Numbers = ()
    wave_predicted: Numbers = ()
    wave_noise: Number = math.nan
    error: Number = math.nan
    left_out: Count = 0


@frozen
class RecordEvidence:
    """One record as it was used.

    Parameters
    ----------
    source : str
    kind : {"periods", "lines", "phasors", "responses", "samples"}
        Cut into periods; the lines of the whole record; a table of 1x phasors or of frequency
        responses; samples filtered.
    lines : int
        Lines that were used.
    lines_per_point : int
        How many neighbouring lines one value here stands for: their root mean square.
    periods, samples_per_period : int
        0 where there are none.
    sample_rate_hz : float
    speed_rad_s : sequence of float
        The lowest and the highest speed.
    frequency_hz : sequence of float
        Of the lines; of several neighbouring ones the middle.
    time_s : sequence of float
        One period; or an excerpt of the record; or every so many samples.
    channels : sequence of ChannelEvidence
        Those that are predicted first.
    """

    source: str
    kind: Kind
    lines: Count = 0
    lines_per_point: Count = 1
    periods: Count = 0
    samples_per_period: Count = 0
    sample_rate_hz: Number = math.nan
    speed_rad_s: Numbers = ()
    frequency_hz: Numbers = ()
    time_s: Numbers = ()
    channels: tuple[ChannelEvidence, ...] = ()

    def __post_init__(self) -> None:
        for channel in self.channels:
            on_lines = (channel.measured, channel.predicted, channel.difference, channel.noise)
            over_time = (channel.wave_measured, channel.wave_predicted)
            for rows, length in ((on_lines, len(self.frequency_hz)), (over_time, len(self.time_s))):
                if any(len(row) not in (0, length) for row in rows):
                    raise ValueError(f"{length} numbers of each kind, or none")


@frozen
class Prior:
    """What was known of a quantity before the records: its value, and a deviation, 0 for exactly.

    Parameters
    ----------
    name : str
        Of a parameter or nuisance, or an expression in parameters.
    value, std : float
    """

    name: str
    value: Number
    std: Number


@frozen
class Evidence:
    """What a report shows besides the values.

    Parameters
    ----------
    records : sequence of RecordEvidence
    known : sequence of Prior
        What was known beforehand, with its deviation.

    Examples
    --------
    >>> Evidence(known=(Prior("L1", 0.3, 0.0005),)).prior("L1").std
    0.0005
    """

    records: tuple[RecordEvidence, ...] = ()
    known: tuple[Prior, ...] = ()

    def prior(self, name: str) -> Prior | None:
        """Return what was known of a quantity, None where nothing was."""
        return next((prior for prior in self.known if prior.name == name), None)
