"""What an estimate consists of: values, misfit, suspects, other answers, where it comes from."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, PlainSerializer, Strict

from rotorid.core.frozen import frozen

Kind = Literal["periods", "lines", "phasors", "responses", "samples"]
# JSON knows no NaN: null stands for a number that is not finite, in both directions.
Number = Annotated[float, Strict(), BeforeValidator(lambda x: math.nan if x is None else x)]
Numbers = tuple[Number, ...]
Count = Annotated[int, Strict()]
Optional = Annotated[float, Strict()] | None
Flag = Annotated[bool, Strict()]


@frozen
class Value:
    """A named quantity with its standard deviation.

    Parameters
    ----------
    name : str
    unit : str
        SI.
    value : float
        NaN where it is not determined.
    std : float or None
        ``None`` where the method gives none; 0 for a fixed value.
    std_inflated : float or None
        As if all of the misfit were noise.
    fixed : bool
        Known beforehand and not estimated.
    """

    name: str
    unit: str
    value: Number
    std: Optional = None
    std_inflated: Optional = None
    fixed: Flag = False


DOUBTFUL = 1e-3
"""The p-value from which on a misfit is what noise leaves; below it the model is doubtful."""
EXPLAINS = 0.2
"""Least share of the excess misfit with which a suspect is a lead."""


@frozen
class Misfit:
    """The misfit at the estimate, against what noise alone would leave."""

    cost: Number
    expected: Number
    dof: Count
    p_value: Number


@frozen
class LineMisfit:
    """The misfit of one line of one record (counted from 0), against what noise would leave."""

    record: Count
    frequency_hz: Number
    cost: Number
    expected: Number


@frozen
class Suspect:
    """What the model may lack, or a channel get wrong.

    Parameters
    ----------
    term : str
        ``damping k1``, ``gain[x1]``, ``swap[x1, y1]``, ...
    drop : float
        Drop of the cost if the term were free.
    share : float or None
        Share of the excess misfit that it explains.
    value : float or None
        Its estimate when it is freed.
    unit : str
        Of `value`.
    """

    term: str
    drop: Number
    share: Optional = None
    value: Optional = None
    unit: str = ""


def _pairs(rows: Any) -> Any:
    """Return ``(name, value)`` from rows of a file; pairs as they are."""
    if not isinstance(rows, list):
        return rows
    return tuple(
        (r["name"], r["value"]) if isinstance(r, dict) and len(r) == 2 else r for r in rows
    )


def _rows(pairs: tuple[tuple[str, float], ...]) -> list[dict[str, Any]]:
    return [{"name": name, "value": value} for name, value in pairs]


Pairs = Annotated[tuple[tuple[str, Number], ...], BeforeValidator(_pairs), PlainSerializer(_rows)]


@frozen
class Alternative:
    """Another answer that fits as well: its misfit, and ``(name, value)`` of each parameter."""

    cost: Number
    parameters: Pairs


@frozen
class ModeFit:
    """A measured natural frequency beside that of the estimate.

    Parameters
    ----------
    mode : int
        Its number among the distinct natural frequencies, from 1.
    speed_rad_s : float
    frequency_hz, std_hz : float
        As measured.
    fitted_hz, fitted_std_hz : float
        Of the estimate, with the deviation that follows from those of the parameters.
    damping_ratio, damping_std : float or None
        As measured; ``None`` where it was not.
    fitted_damping_ratio : float
    parameters : sequence of (name, value)
        What was otherwise in the test.
    """

    mode: Count
    speed_rad_s: Number
    frequency_hz: Number
    std_hz: Number
    fitted_hz: Number
    fitted_std_hz: Number
    damping_ratio: Optional = None
    damping_std: Optional = None
    fitted_damping_ratio: Optional = None
    parameters: Pairs = ()


@frozen
class Unbalance:
    """The unbalance of one plane: what stands there too much, and in which direction.

    Parameters
    ----------
    plane : str
        The coordinates on which it acts: ``x2, y2``; ``theta_x, theta_y`` for a couple.
    unit : str
        kg m, or kg m^2 of a couple.
    amount : float
    angle_rad : float
        In the rotor, counted from the zero of the rotor angle.
    std, angle_std_rad : float or None
        ``None`` where the estimate states no deviations.
    """

    plane: str
    unit: str
    amount: Number
    angle_rad: Number
    std: Optional = None
    angle_std_rad: Optional = None


@frozen
class SourceFile:
    """A file that went into an estimate, and the sha256 of its content in hexadecimal.

    Empty where the file is beyond 16 GB, or made of holes for the most part.
    """

    file: str
    sha256: str


@frozen
class Provenance:
    """Where an estimate comes from.

    Parameters
    ----------
    files : sequence of SourceFile
        Records and models that were read.
    experiment : str
        The experiment file's text.
    version : str
        Of rotorid.
    command : str
        As it was given.
    model : str
        The model file's text, whole, so that the result needs no other file.
    held : sequence of (name, value)
        What was substituted in the model before it was identified, SI.
    environment : str
        Versions of Python and of what computes: other ones may differ in the last digits.
    """

    files: tuple[SourceFile, ...] = ()
    experiment: str = ""
    version: str = ""
    command: str = ""
    model: str = ""
    held: Pairs = ()
    environment: str = ""


@frozen
class Prediction:
    """How well an estimate predicts one channel: ``|residual| / |measured|`` on the lines."""

    relative_error: Number


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
        return next((prior for prior in self.known if prior.name == name), None)
