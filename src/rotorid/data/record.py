"""What was measured, in SI and without a model: samples, and periods with their lines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

from rotorid.core.errors import InputError, WrongTypeError, require_names, require_type
from rotorid.core.notes import Note
from rotorid.core.units import multiply_units, name_and_unit, quantity, si_factor
from rotorid.core.values import (
    Array,
    Arrays,
    Booleans,
    Complexes,
    Floats,
    Integers,
    Shown,
    frozen,
    import_pandas,
    read_only,
)
from rotorid.force.channel_dynamics import Dynamics
from rotorid.force.laws import Law

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")
Known = float | str | tuple[float | str, float | str]
"""A parameter that is known: its value in SI or a text with a unit, or that and its deviation."""


_LARGEST = 1e100  # in SI; the squares of larger numbers, and sums of them, may overflow


@frozen
class Drive:
    """Says that an input's channel holds the current of a bearing: F = ki i + ks x.

    Parameters
    ----------
    ki : float
        N/A.
    ks : float
        N/m; positive destabilizes.
    position : mapping of str to float
        x, the displacement in the bearing, as ``{coordinate: coefficient}``.
    """

    ki: float
    ks: float = 0.0
    position: Mapping[str, float] = field(default_factory=dict)


@frozen
class Channel:
    """One measured quantity.

    Parameters
    ----------
    name : str
        Name of an input or a coordinate of the model, or of a sensor of several (see `reads`).
    unit : str
        SI unit of the samples, for tables; the samples are in SI already.
    reads : mapping of str to float, optional
        The sensor reads this combination of coordinates, ``{coordinate: coefficient}``; without
        it the channel is the quantity of its name.
    hold : bool
        The samples are commands that a zero-order hold keeps for one sample period.
    delay : float
        Time in s by which the samples lag the quantity.
    delay_std, gain_std : float
        Standard deviations with which the delay (s) and the gain (relative) are known; 0 means
        exactly.
    drive : Drive, optional
        The channel holds a current, not the input itself. Maximum likelihood only.
    dynamics : Dynamics, optional
        What an amplifier, a filter or the sensor itself does to each line.
    law : Law, optional
        The channel's force was made of a current, or of flux densities, by this law.
    """

    name: str
    unit: str = ""
    reads: Mapping[str, float] | None = None
    hold: bool = False
    delay: float = 0.0
    delay_std: float = 0.0
    gain_std: float = 0.0
    drive: Drive | None = None
    dynamics: Dynamics | None = None
    law: Law | None = None

    def __post_init__(self) -> None:
        require_type(self.name, str, place="name")
        if self.reads is not None:
            require_type(self.reads, Mapping, place="reads")

    @property
    def combination(self) -> Mapping[str, float]:
        """What the channel reads, as ``{name: coefficient}``."""
        return {self.name: 1.0} if self.reads is None else self.reads


class WithChannels(Arrays):
    channels: tuple[Channel, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, in order."""
        return tuple(channel.name for channel in self.channels)

    def index(self, name: str) -> int:
        """Return the position of a channel.

        Raises
        ------
        InputError
            Where there is no such channel.
        """
        require_names([name], self.names, "no channel {}", "name a channel of the record")
        return self.names.index(name)


@frozen
class Steady:
    """A quantity that grows evenly from sample to sample, over whole periods."""

    first: int  # number of the first sample
    shape: tuple[int, int]  # (int, int): periods, and samples of each
    # Hz, and the time in s of sample 0
    sample_rate: float
    start: float = 0.0
    # ``offset + slope t``: of the time itself 0 and 1, of an angle the phase and the speed
    offset: float = 0.0
    slope: float = 1.0

    def __call__(self) -> Floats:
        return self.head(self.shape[0])

    def head(self, periods: int) -> Floats:
        last = self.first + periods * self.shape[1]
        values = np.arange(self.first, last, dtype=np.float64)
        values /= self.sample_rate
        values += self.start
        if self.slope != 1.0:
            values *= self.slope
        if self.offset != 0.0:
            values += self.offset
        return values.reshape(periods, self.shape[1])

    @property
    def mean(self) -> float:
        middle = self.first + (self.shape[0] * self.shape[1] - 1) / 2
        return self.offset + self.slope * (self.start + middle / self.sample_rate)

    @property
    def in_period(self) -> float:
        """By how much it grows in a period."""
        return self.slope * self.shape[1] / self.sample_rate


class WhenRead:
    """A field of a frozen dataclass that takes an array, or what makes it when it is first read."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: object | None, owner: type) -> Floats:
        if instance is None:
            raise AttributeError(self.name)  # the field has no default
        value = vars(instance)[self.name]
        if callable(value):
            value = value()
            value.flags.writeable = False
            vars(instance)[self.name] = value
        return np.asarray(value)

    def __set__(self, instance: object, value: Floats | Callable[[], Floats]) -> None:
        vars(instance)[self.name] = value


def unread(value: object, name: str) -> Any:
    """Return a field as it was given: an array, or what will make it."""
    return vars(value)[name]


def head_of(value: object, name: str) -> Floats:
    """Return a field of times or angles in the first period, (1, sample), without the others."""
    given = unread(value, name)
    return np.asarray(given.head(1) if isinstance(given, Steady) else given[:1])


def some_periods(given: Steady | Floats, begin: int, end: int) -> Floats:
    """Return times or angles, as they were given, of some of the periods, (period, sample)."""
    if not isinstance(given, Steady):
        return given[begin:end]
    size = given.shape[1]
    return replace(given, first=given.first + begin * size, shape=(end - begin, size))()


def changed(value: T, **changes: Any) -> T:
    """Return a copy with other fields, as `dataclasses.replace`, without reading the others."""
    kept = {f.name: vars(value)[f.name] for f in fields(value) if f.init}  # type: ignore[arg-type]
    return type(value)(**kept | changes)


class OfMachine(WithChannels):
    """What a model is bound to: a record that may have parameters of the machine to itself."""

    parameters: Mapping[str, Known]

    def with_parameters(self, **parameters: Known) -> Self:
        """Return the record with parameters of the machine that it has to itself.

        Least squares refuses them; every kind of record answers alike.

        Parameters
        ----------
        **parameters : float or str or (value, std)
            SI, or texts with units.

        Returns
        -------
        PeriodicRecord, Lines, or FilteredRecord
        """
        return changed(self, parameters={**self.parameters, **parameters})


def samples_between(record: Record, skip: float, until: float = np.inf) -> tuple[int, int]:
    """Return the first sample that is used, and that after the last, of times in s."""
    begin, end = ((time - record.start) * record.sample_rate for time in (skip, until))
    first, after = np.ceil(min(begin - 1e-6, 1e15)), np.floor(min(end + 1e-6, 1e15))
    return max(0, int(first)), min(len(record.samples), int(after))


def part_of(record: Record, first: int, after: int) -> Record:
    if not first and after == len(record.samples):
        return record
    return replace(
        record,
        samples=record.samples[first:after],
        angle=None if record.angle is None else record.angle[first:after],
        valid=None if record.valid is None else record.valid[first:after],
        start=record.start + first / record.sample_rate,
    )


def check_samples(
    names: Sequence[str],
    samples: Floats,
    source: str = "",
    valid: Booleans | None = None,
    first: int = 0,
) -> None:
    """Refuse samples that are not finite, the first of them being number `first`."""
    # One pass over the whole: NaN is greater than nothing. What is wrong is sought afterwards.
    extremes = (samples.max(), samples.min()) if samples.size else (0.0,)
    if all(abs(extreme) < _LARGEST for extreme in extremes):
        return
    for name, column in zip(names, samples.T, strict=True):
        wrong = ~(np.abs(column) < _LARGEST)
        bad = np.flatnonzero(wrong if valid is None else wrong & valid)
        if bad.size:
            place = f"sample {first + bad[0]} of channel {name!r}"
            found = f"{column[bad[0]]} in {place}, {bad.size} in all"
            cure = "cut the record before the gap, or fill it where you know the truth"
            raise InputError(found, "finite samples without gaps", cure, file=source)


@frozen
class Record(Shown, WithChannels):
    """Samples as measured, in SI units.

    Parameters
    ----------
    channels : sequence of Channel
    samples : array, shape (sample, channel)
    sample_rate : float
        Hz, or a text with a unit.
    speed : float
        Mean speed of rotation in rad/s, or a text with a unit; 0 at standstill.
    angle : array, shape (sample,), optional
        Rotor angle phi in rad at each sample; ``None`` means ``speed * t``.
    phase_known : bool
        False where the angle is known up to a constant only.
    phase_std : float
        Deviation in rad of an offset common to all angles: what an encoder or pulses leave open.
    source : str
        Where the samples come from, for messages.
    valid : bool array, shape (sample,), optional
        False where a sample is to be left out: periods that hold one are.
    warnings : sequence of str
        What was done to the samples when they were read.
    start : float
        Time in s of the first sample; t counts from the first sample of the file.

    Raises
    ------
    InputError
        For shapes that do not fit, repeated channels, or samples that are not finite.

    Examples
    --------
    >>> record = Record([Channel("x", "m")], np.zeros((4, 1)), sample_rate=1000.0)
    >>> record.column("x")
    array([0., 0., 0., 0.])
    """

    channels: tuple[Channel, ...]
    samples: Floats
    sample_rate: float
    speed: float = 0.0
    angle: Floats | None = None
    phase_known: bool = True
    phase_std: float = 0.0
    source: str = ""
    valid: Booleans | None = None
    warnings: tuple[str, ...] = ()
    start: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        object.__setattr__(self, "samples", np.asarray(self.samples, dtype=float))
        for name, unit in (("sample_rate", "Hz"), ("speed", "rad/s")):
            object.__setattr__(self, name, quantity(getattr(self, name), unit, place=name))
        super().__post_init__()
        names = self.names
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise self._error(f"channel {repeated[0]!r} twice", "each channel once", "drop one")
        if self.samples.ndim != 2 or self.samples.shape[1] != len(names):
            raise self._error(
                f"samples of shape {self.samples.shape}",
                f"(sample, channel) with {len(names)} channels",
                "give one column per channel",
            )
        if not (np.isfinite(self.sample_rate) and self.sample_rate > 0):
            found = f"sample rate {self.sample_rate}"
            raise self._error(found, "a positive number of Hz", "give the samples per second")
        if not np.isfinite(self.speed):
            cure = "give the speed of the rotor, 0 at standstill"
            raise self._error(f"speed {self.speed}", "a finite number of rad/s", cure)
        each = (len(self.samples),)
        if self.valid is not None and np.shape(self.valid) != each:
            found = f"a mask of shape {np.shape(self.valid)}"
            raise self._error(found, f"{each}", "give one truth value per sample")
        check_samples(names, self.samples, self.source, self.valid)
        if self.angle is not None and np.shape(self.angle) != each:
            found = f"angle of shape {np.shape(self.angle)}"
            raise self._error(found, f"{each}", "give one angle per sample")
        if self.angle is not None and not np.isfinite(self.angle).all():
            raise self._error("an angle that is not finite", "radians", "cut the record there")

    def _error(self, found: str, expected: str, cure: str) -> InputError:
        return InputError(found, expected, cure, file=self.source)

    def column(self, name: str) -> Floats:
        """Return the samples of one channel, shape (sample,).

        Raises
        ------
        InputError
            Where there is no such channel.
        """
        return self.samples[:, self.index(name)]

    def _drawn(self) -> tuple[Any, str]:
        from rotorid.report.drawn import samples

        return samples(self), "the channels over time"

    @classmethod
    def from_frame(
        cls,
        frame: pd.DataFrame,
        *,
        sample_rate: float | str | None = None,
        units: Mapping[str, str] | None = None,
        speed: float | str = 0.0,
    ) -> Self:
        """Return a pandas data frame as a record: a channel per column, ``x [um]`` with its unit.

        Parameters
        ----------
        frame : pandas.DataFrame
            Its index holds evenly spaced times, in s or as dates; any index with a `sample_rate`.
        sample_rate : float or str, optional
            Hz, or a text with a unit, in place of the index.
        units : mapping of str to str, optional
            Unit of a column, such as ``{"x": "um"}``, in place of that in its name; without
            either it is in SI.
        speed : float or str
            rad/s, or a text with a unit.

        Returns
        -------
        Record

        Raises
        ------
        InputError
            For what is no data frame, columns that are no numbers, and times that are uneven.

        Examples
        --------
        >>> import pandas as pd
        >>> frame = pd.DataFrame({"x": [1.0, 2.0], "F": [5.0, 6.0]}, index=[0.0, 0.001])
        >>> record = Record.from_frame(frame, units={"x": "um"})
        >>> record.sample_rate, record.column("x").tolist(), record.to_frame().index.tolist()
        (1000.0, [1e-06, 2e-06], [0.0, 0.001])
        """
        if not all(hasattr(frame, name) for name in ("columns", "index", "to_numpy")):
            told, taken = f"{type(frame).__name__}", "a pandas data frame"
            raise WrongTypeError(told, taken, "rid.Record takes arrays", place="frame")
        pairs = [name_and_unit(str(name)) for name in frame.columns]
        names, given = [name for name, _ in pairs], units or {}
        require_names(given, names, "no column {}", "name a column of the frame", place="units")
        given = {name: unit for name, unit in pairs if unit} | {**given}
        index = np.asarray(frame.index)
        start, rate = _times_of(index) if sample_rate is None else (0.0, sample_rate)
        try:
            if np.iscomplexobj(frame.to_numpy()):
                raise TypeError("complex numbers")
            samples = frame.to_numpy(dtype=float)
        except (TypeError, ValueError) as error:
            cure = "drop the columns that are none"
            raise InputError(str(error), "columns of numbers", cure, place="frame") from None
        scale = [si_factor(given.get(name, "1"), place=f"units.{name}") for name in names]
        labels = [multiply_units([(given[name], 1)]) if name in given else "" for name in names]
        channels = tuple(map(Channel, names, labels))
        omega = quantity(speed, "rad/s", place="speed")
        rate = quantity(rate, "Hz", place="sample_rate")
        return cls(channels, samples * scale, rate, omega, start=start)

    def to_frame(self) -> pd.DataFrame:
        """Return the samples as a pandas data frame: a column per channel in SI, times in s.

        Raises
        ------
        ImportError
            Where pandas is not installed.
        """
        pandas = import_pandas()
        time = self.start + np.arange(len(self.samples)) / self.sample_rate
        index = pandas.Index(time, name="time in s")
        return pandas.DataFrame(self.samples, index=index, columns=list(self.names))

    def rotor_angle(self) -> Floats:
        """Return phi in rad at each sample, shape (sample,)."""
        if self.angle is not None:
            return self.angle
        time = self.start + np.arange(len(self.samples)) / self.sample_rate
        return np.asarray(self.speed * time, dtype=float)


EVEN = 0.01  # share of a step by which times may lie beside an even grid: more are jitter, or a gap


def _times_of(index: Array) -> tuple[float, float]:
    """Return the first time in s and the rate in Hz of times, or of dates, evenly spaced."""
    if index.dtype.kind in "mM":
        index = (index - index[:1]) / np.timedelta64(1, "s")
    cure = 'make them the index: frame.set_index("time"), or give the rate: sample_rate="5 kHz"'
    if index.dtype.kind != "f" or len(index) < 2:
        told = f"an index of {index.dtype}, {len(index)} long"
        raise InputError(told, "times in s, or dates", cure, place="frame")
    step = (index[-1] - index[0]) / (len(index) - 1)
    away = np.abs(index - index[0] - step * np.arange(len(index))).max()
    if not (step > 0 and away <= EVEN * step):
        told = f"times up to {away / step if step else np.inf:.2g} steps beside an even grid"
        raise InputError(told, "evenly spaced times", cure, place="frame")
    return float(index[0]), float(f"{1 / step:.12g}")  # times are rounded, rates are round


@frozen
class RotationLine(Arrays):
    """The line of a rotation that stands on no line of the periods, at its own frequency."""

    orders: tuple[int, ...]  # multiples that the periods are without
    spectra: Complexes  # (period, channel): of the first multiple, from the first sample used on
    recorded: Complexes  # (period, line, channel): the lines of the periods with it
    kept: Complexes  # (line, 2): what the lines of the periods keep of cos(phi) and sin(phi)
    # rad/s by which a speed that is used as stated plausibly is off, and by what that moves the
    # lines, (line, channel), the rotation's own behind those of the periods
    slip: float = 0.0
    moved: Complexes | None = None


@frozen
class PeriodicRecord(Shown, OfMachine):
    """A record cut into whole periods, with its lines period by period.

    The spectra are two-sided amplitudes, ``X_k = mean(x exp(-i omega_k t))``, so that white noise
    of variance s^2 per sample has ``E|X_k|^2 = s^2 / samples`` on every line, and
    ``x = sum c_k Re(X_k exp(i omega_k t))`` with c = 2, or 1 at DC and at the Nyquist line.

    Parameters
    ----------
    channels : sequence of Channel
    sample_rate : float
        Hz.
    harmonics : int array, shape (line,)
        The kept multiples of the fundamental, increasing.
    spectra : complex array, shape (period, line, channel)
        Lines of each period, corrected for hold and delay; rounding that repeats scatters them too.
    variance : array, shape (sample, channel)
        Unbiased variance over periods of each sample within the period: of a sample, not of the
        mean; the paper's (8) with 1/(n-1).
    mean : array, shape (sample, channel)
        Mean over periods, as measured (all lines, nothing corrected).
    speed : float
        Mean speed in rad/s.
    time, angle : array, shape (period, sample), or callable
        t in s and rotor angle phi in rad of every sample used; or what makes them when they are
        first read.
    checks : sequence of Note
        What the samples showed before they were averaged.
    phase_known : bool
        Whether phi is the rotor's own angle, or starts anywhere.
    phase_std : float
        Deviation in rad of an offset common to all angles: what an encoder or pulses leave open.
    source : str
        The file, for messages.
    warnings : sequence of str
        What was done to the samples.
    parameters : mapping of str to float or str or (value, std)
        Parameters of the machine that this record has to itself, known exactly or with a
        deviation: a trial mass.
    rotation : RotationLine, optional
        The rotation beside the periods, which are without it, where it stands on none of their
        lines.
    """

    channels: tuple[Channel, ...]
    sample_rate: float
    harmonics: Integers
    spectra: Complexes
    variance: Floats
    mean: Floats
    speed: float
    time: WhenRead = WhenRead()
    angle: WhenRead = WhenRead()
    phase_known: bool = True
    phase_std: float = 0.0
    source: str = ""
    warnings: tuple[str, ...] = field(default=())
    checks: tuple[Note, ...] = field(default=())
    parameters: Mapping[str, Known] = field(default_factory=dict)
    rotation: RotationLine | None = None

    @property
    def begin(self) -> float:
        """Time in s of the first sample used."""
        return float(head_of(self, "time")[0, 0])

    @property
    def middle(self) -> float:
        """Mean time in s of the samples used."""
        given = unread(self, "time")
        return given.mean if isinstance(given, Steady) else float(given.mean())

    @property
    def periods(self) -> int:
        """Number of periods."""
        return int(self.spectra.shape[0])

    @property
    def samples(self) -> int:
        """Number of samples of a period."""
        return int(self.mean.shape[0])

    @property
    def fundamental(self) -> float:
        """Fundamental frequency in Hz."""
        return self.sample_rate / self.samples

    @property
    def turns(self) -> float:
        """Revolutions in a period, whichever way."""
        return abs(self.speed) / (2 * np.pi * self.fundamental)

    @property
    def on_rotation(self) -> Booleans:
        """Whether a line is that of the rotation, or nearest to it; shape (line,)."""
        return np.asarray((np.abs(self.harmonics - self.turns) < 0.5) & (self.rotation is None))

    @property
    def frequency(self) -> Floats:
        """Frequencies of the lines in Hz, shape (line,)."""
        return np.asarray(self.harmonics * self.fundamental, dtype=float)

    @property
    def omega(self) -> Floats:
        """Angular frequencies of the lines in rad/s, shape (line,)."""
        return 2 * np.pi * self.frequency

    @cached_property
    def mean_spectrum(self) -> Complexes:
        """Mean over periods of the lines, shape (line, channel)."""
        return read_only(self.spectra.mean(axis=0))

    @property
    def multiplicity(self) -> Floats:
        """Weight c of each line: 2, or 1 at DC and at the Nyquist line; shape (line,)."""
        single = (self.harmonics == 0) | (2 * self.harmonics == self.samples)
        return np.where(single, 1.0, 2.0)

    def trusted(self, doubts: Iterable[Note]) -> PeriodicRecord | None:
        """Return the record without the periods that notes doubt; None where no two are left."""
        kept = np.setdiff1d(np.arange(self.periods), [p for note in doubts for p in note.periods])
        if len(kept) < 2:
            return None
        spectra, rotation = self.spectra[kept], self.rotation
        if rotation is not None:
            own, recorded = rotation.spectra[kept], rotation.recorded[kept]
            rotation = replace(rotation, spectra=own, recorded=recorded)
        every, some = (s.var(axis=0, ddof=1).sum(axis=0) for s in (self.spectra, spectra))
        shrunk = np.divide(some, every, where=every > 0, out=np.ones_like(every))
        return replace(
            self,
            spectra=spectra,
            variance=shrunk * self.variance,  # the samples are gone: as much less as lines scatter
            time=self.time[kept],
            angle=self.angle[kept],
            rotation=rotation,
        )

    def _drawn(self) -> tuple[Any, str]:
        from rotorid.report.drawn import spectra

        return spectra(self), "the spectrum of the mean period"
