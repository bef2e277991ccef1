"""`Lines`: all that a likelihood needs to know of a record, whatever kind of record it was."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.notes import Note
from rotorid.core.values import Arrays, Booleans, Complexes, Floats, Integers, frozen
from rotorid.data.record import (
    Channel,
    Known,
    OfMachine,
    PeriodicRecord,
    RotationLine,
    Steady,
    WhenRead,
    changed,
    head_of,
    unread,
)
from rotorid.signals.covariance import LineCovariance, white_covariance
from rotorid.signals.spectrum import line_spectra, quantity
from rotorid.signals.turning import without_waves

Signal = Callable[[Floats, Floats, Floats], Floats]
"""A function of t (s), phi (rad) and Omega (rad/s), arrays that broadcast; (..., signal)."""
ROUNDING = 1e-11
"""A line below this share of its signal's size is rounding: a load that misses a line misses it."""


TURN = 64
"""Angles of a revolution at which loads are asked: exact up to the 62nd multiple of the angle."""


class Clock(Protocol):
    """Time and rotor angle of a record, and how functions of them become lines."""

    def lines(self, signal: Signal, *, timed: bool = False) -> Complexes:
        """Return the lines (line, signal) of signals; `timed` where they use t itself."""
        ...

    def at_speed(self, speed: float) -> Clock: ...


@frozen
class SampledClock(Arrays):
    """The clock of samples: lines of a mean period. A whole record is one period."""

    speed: Floats  # rad/s, one for all or at each sample
    harmonics: Integers  # (line,)
    # (period, sample), or callable: what makes them when they are first read
    time: WhenRead = WhenRead()
    angle: WhenRead = WhenRead()
    # multiples of the angle that the periods are without, bool array, shape (line,): the line of
    # the rotation itself, whose harmonic is the nearest, and as those of a RotationLine, (line, 2)
    orders: tuple[int, ...] = ()
    turning: Booleans | None = None
    kept: Complexes | None = None

    @classmethod
    def of(cls, record: PeriodicRecord) -> SampledClock:
        time, angle = (unread(record, name) for name in ("time", "angle"))
        return cls(np.asarray(record.speed), record.harmonics, time, angle)

    def beside(self, rotation: RotationLine, at: int, nearest: int) -> SampledClock:
        """Return the clock with a line more, of a rotation beside the periods."""
        harmonics = np.insert(self.harmonics, at, nearest)
        own, kept = np.arange(len(harmonics)) == at, np.insert(rotation.kept, at, 0.0, axis=0)
        return changed(self, harmonics=harmonics, orders=rotation.orders, turning=own, kept=kept)

    def at(self, chosen: Integers | Booleans) -> SampledClock:
        """Return the clock of some of the lines."""
        turning, kept = (None if a is None else a[chosen] for a in (self.turning, self.kept))
        return changed(self, harmonics=self.harmonics[chosen], turning=turning, kept=kept)

    @property
    def period(self) -> Floats:
        """Times of the first period, shape (sample,)."""
        return np.asarray(head_of(self, "time")[0])

    def grid(self, *, timed: bool) -> tuple[Floats, Floats]:
        """Return t and phi of all periods, or of the first where the others repeat it."""
        if timed or not self._repeats:
            return self.time, self.angle
        return head_of(self, "time"), head_of(self, "angle")

    @cached_property
    def _repeats(self) -> bool:
        """Whether the angle of the first period stands for that of each, but for whole turns."""
        time, angle = (unread(self, name) for name in ("time", "angle"))
        if isinstance(angle, Steady) and isinstance(time, Steady):
            turns = angle.in_period / (2 * np.pi)
            return bool(abs(turns - round(turns)) * (angle.shape[0] - 1) < 1e-9)
        turns = (self.angle - self.angle[0]) / (2 * np.pi)
        return bool(np.abs(turns - np.round(turns)).max(initial=0.0) < 1e-9)

    def turned(self, angle: float) -> SampledClock:
        given = unread(self, "angle")
        even = isinstance(given, Steady)
        more = replace(given, offset=given.offset + angle) if even else self.angle + angle
        return changed(self, angle=more)

    def lines(self, signal: Signal, *, timed: bool = False) -> Complexes:
        if self.orders:
            return self._lines_beside(signal, timed)
        time, angle = self.grid(timed=timed)
        values = signal(time, angle, self.speed)
        mean = values.mean(axis=0)  # of a rotation that fits no period: rounding alone, perhaps
        size = np.sqrt((values**2).mean(axis=tuple(range(values.ndim - 1))))
        return above_rounding(line_spectra(mean, self.harmonics), size)

    def _lines_beside(self, signal: Signal, timed: bool) -> Complexes:
        """Take the rotation out of signals as it was taken out of the channels.

        Functions of the angle alone hold the same of it in every turn: one of them tells.
        """
        angle = self.angle if timed else np.linspace(0, 2 * np.pi, TURN, endpoint=False)[:, None]
        values = signal(self.time if timed else np.zeros_like(angle), angle, self.speed)
        values = np.broadcast_to(values, (*angle.shape, values.shape[-1]))
        size = np.sqrt((values**2).mean(axis=(0, 1)))
        rest, found = without_waves(values, angle, self.orders)
        if not timed and np.ptp(rest, axis=0).any():  # further multiples
            values = signal(self.time, self.angle, self.speed)
            rest, _ = without_waves(values, self.angle, self.orders)
        mean = np.broadcast_to(rest.mean(axis=0), (len(self.period), len(size)))
        lines, turned = line_spectra(mean, self.harmonics), head_of(self, "angle")[0, 0]
        lines += 0.0 if self.kept is None else self.kept @ found[:2]
        once = (found[0] - 1j * found[1]) / 2 * np.exp(1j * turned)
        lines[self.turning] = once if self.speed > 0 else once.conj()
        return above_rounding(lines, size)

    def at_speed(self, speed: float) -> SampledClock:
        given = unread(self, "time")
        even = isinstance(given, Steady)
        angle = replace(given, slope=speed * given.slope) if even else speed * given
        other = changed(self, speed=np.asarray(speed), angle=angle)
        if abs(speed) == np.abs(self.speed).max():  # the other way, the same line
            back = np.array([1.0, np.sign(speed * float(self.speed.max()))])
            return other if self.kept is None else changed(other, kept=self.kept * back)
        return changed(other, orders=(), turning=None, kept=None)


@frozen
class PhasorClock(Arrays):
    """The clock of 1x phasors: line k at ``|Omega_k|``, conjugate where it turns backward."""

    speed: Floats  # (line,): rad/s; negative backward, never 0

    def lines(self, signal: Signal, *, timed: bool = False) -> Complexes:
        if timed:
            expected = "loads of the rotor angle and the speed"
            cure = "give the samples of the run, or a model without that load"
            raise InputError("a load that depends on t in a table of phasors", expected, cure)
        turn = np.linspace(0, 2 * np.pi, TURN, endpoint=False)
        values = signal(np.zeros_like(turn), turn, self.speed[:, None])
        values = np.broadcast_to(values, (len(self.speed), TURN, values.shape[-1]))
        back = np.exp(-1j * np.sign(self.speed)[:, None] * turn)
        found = np.einsum("ls,lsk->lk", back, values) / TURN
        return above_rounding(found, np.sqrt((values**2).mean(axis=1)))

    def at_speed(self, speed: float) -> PhasorClock:
        return PhasorClock(np.full(len(self.speed), speed))


@frozen
class Samples(Arrays):
    """The samples behind the lines: of a mean period, or of a whole record."""

    values: Floats  # (sample, channel): as recorded, hold, delay and dynamics not corrected
    sample_rate: float  # Hz
    lines_kept: Integers  # (line,): numbers of the lines
    period: int | None = None  # samples of a period

    def with_channel(self) -> Samples:
        """Return the samples with one more channel, zero."""
        return replace(self, values=np.column_stack([self.values, np.zeros(len(self.values))]))

    def column(self, index: int, channel: Channel) -> Floats:
        """Return the samples of what a channel recorded, without delay and dynamics, (sample,)."""
        return quantity(self.values[:, index], channel, self.sample_rate, self.period)

    def lines(self, signals: Floats) -> Complexes:
        return line_spectra(signals, self.lines_kept)


@frozen
class Beside(Arrays):
    """Lines on which noise shows, one beside the other, and what motion follows there."""

    # (line, column): references, a one for the transient, exp(+-i phi): what is left of it is noise
    columns: Complexes
    ordinary: Booleans  # bool array, shape (line,): false where a line stands out of the noise
    # (line of the record,): the line here that lies nearest to each line of the record
    centre: Integers
    where: Integers  # (line,): the line of the record that lies nearest to each line here
    # (line, channel): the lines of a quiet record, as large as noise of the record; without them
    # those of the record itself are meant
    noise: Complexes | None = None


@frozen
class SilentClock(Arrays):
    """The clock of frequency responses: what does not come from the input averages out of them."""

    count: int  # number of lines

    def lines(self, signal: Signal, *, timed: bool = False) -> Complexes:
        """Return zeros, (line, signal): unbalance and weight are no part of a response."""
        zero = np.zeros(1)
        signals = np.shape(signal(zero, zero, zero))[-1]
        return np.zeros((self.count, signals), dtype=np.complex128)

    def at_speed(self, speed: float) -> SilentClock:
        return self


Window = Literal["rectangular", "hann", "none"]
"""What an analyser multiplies its blocks by; none where they hold each response from rest to rest,
as of a burst or an impact, and where sines are stepped."""


@frozen
class Analyser:
    """What the errors of responses depend on that an analyser has made."""

    spacing: float  # Hz from line to line of its transform; 0 where lines are not evenly spaced
    window: Window | None = None  # None: it was not stated
    averages: int | None = None  # of the coherence that told the noise; None where a std did


def above_rounding(lines: Complexes, size: Floats) -> Complexes:
    """Set lines (line, signal) to zero that are rounding of signals of that size."""
    return np.where(np.abs(lines) > ROUNDING * size, lines, 0.0)


@frozen
class Lines(OfMachine):
    """Mean lines of a record with their covariance and the loads on the same lines.

    Parameters
    ----------
    channels : sequence of Channel
    frequency : array, shape (line,)
        Hz.
    speed : array, shape (line,)
        Speed of the rotor at each line in rad/s.
    mean : complex array, shape (line, channel)
        Lines as ``x = sum c Re(X exp(i omega t))`` has them, c the multiplicity.
    covariance : LineCovariance
        Of `mean`, cross terms kept.
    multiplicity : array, shape (line,)
        c: 2, or 1 for real lines (DC, Nyquist).
    clock : Clock
        Lines of functions of t and phi.
    scatter : complex array, shape (period, line, channel), optional
        The lines of each period, where there are periods.
    transient : int, optional
        Order of the polynomial in i omega that a window with loose ends adds to each equation;
        ``None`` where the record repeats itself.
    phase_known : bool
        False where the rotor angle is known up to a constant only.
    phase_std : float
        Deviation in rad of an offset common to all angles: what an encoder or pulses leave open.
    source : str
        For messages.
    warnings : sequence of str
    checks : sequence of Note
        What the data showed before any model.
    passive : bool
        An input without a channel is zero: the machine runs in passive bearings.
    parameters : mapping of str to float or str or (value, std)
        Parameters of the machine that this record has to itself, known exactly or with a
        deviation: a trial mass.
    samples : Samples, optional
        The samples behind the lines, where there are some.
    beside : Beside, optional
        What tells noise from motion, where neighbouring lines do.
    shown : float, optional
        Speed in rad/s at which the lines show a rotation, where that is not the one stated.
    analyser : Analyser, optional
        Of frequency responses.
    parts : callable, optional
        Returns the lines of so many parts of the record, where it was taken whole.
    """

    channels: tuple[Channel, ...]
    frequency: Floats
    speed: Floats
    mean: Complexes
    covariance: LineCovariance
    multiplicity: Floats
    clock: Clock
    scatter: Complexes | None = None
    transient: int | None = None
    phase_known: bool = True
    phase_std: float = 0.0
    source: str = ""
    warnings: tuple[str, ...] = field(default=())
    checks: tuple[Note, ...] = ()
    passive: bool = False
    parameters: Mapping[str, Known] = field(default_factory=dict)
    samples: Samples | None = None
    beside: Beside | None = None
    shown: float | None = None
    analyser: Analyser | None = None
    parts: Callable[[int], list[Lines]] | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of_periods(cls, record: PeriodicRecord, covariance: LineCovariance | None = None) -> Lines:
        """Return the lines of a record of periods; without `covariance`, from their scatter.

        A rotation beside the periods has a line more, among theirs by its frequency.
        """
        spectra, clock, samples = record.spectra, SampledClock.of(record), None
        frequency, multiplicity = record.frequency, record.multiplicity
        if record.rotation is None:
            samples = Samples(record.mean, record.sample_rate, record.harmonics, record.samples)
        else:
            own = record.turns * record.fundamental
            at = int(np.searchsorted(frequency, own))
            spectra = np.insert(spectra, at, record.rotation.spectra, axis=1)
            frequency, multiplicity = np.insert(frequency, at, own), np.insert(multiplicity, at, 2)
            clock = clock.beside(record.rotation, at, round(record.turns))
        return cls(
            channels=record.channels,
            frequency=frequency,
            speed=np.full(len(frequency), record.speed),
            mean=spectra.mean(axis=0),
            covariance=white_covariance(spectra) if covariance is None else covariance,
            multiplicity=multiplicity,
            clock=clock,
            scatter=spectra,
            phase_known=record.phase_known,
            phase_std=record.phase_std,
            source=record.source,
            warnings=record.warnings,
            checks=record.checks,
            parameters=record.parameters,
            samples=samples,
        )

    @property
    def omega(self) -> Floats:
        """Frequencies of the lines in rad/s, shape (line,)."""
        return 2 * np.pi * self.frequency

    @property
    def periods(self) -> int:
        """Number of periods; 1 where there are none."""
        return 1 if self.scatter is None else int(self.scatter.shape[0])

    @property
    def marked(self) -> bool:
        """Whether a mark on the rotor tells its speed, and not the file alone."""
        return self.phase_std > 0 or isinstance(self.clock, PhasorClock)

    def among(self, chosen: Integers | Booleans) -> Lines:
        """Return some of the lines of samples."""
        assert isinstance(self.clock, SampledClock)
        names, samples = ("frequency", "speed", "mean", "multiplicity"), self.samples
        changes: dict[str, Any] = {name: getattr(self, name)[chosen] for name in names}
        matrices = self.covariance.matrices[chosen]
        changes["covariance"] = replace(self.covariance, matrices=matrices)
        if samples is not None:
            changes["samples"] = replace(samples, lines_kept=samples.lines_kept[chosen])
        if self.scatter is not None:
            changes["scatter"] = self.scatter[:, chosen]
        return replace(self, clock=self.clock.at(chosen), beside=None, **changes)

    def at_speed(self, speed: float) -> Lines:
        """Return the same run at another speed in rad/s: the plan of a further record.

        The line of a rotation beside the periods is none at another speed.
        """
        clock = self.clock
        own = clock.turning if isinstance(clock, SampledClock) else None
        if own is not None and own.any() and abs(speed) != abs(self.speed[0]):
            return self.among(~own).at_speed(speed)
        turning = np.full(len(self.frequency), speed)
        shifted = isinstance(clock, PhasorClock)  # its lines are the speed itself
        return replace(
            self,
            frequency=np.abs(turning) / (2 * np.pi) if shifted else self.frequency,
            speed=turning,
            clock=clock.at_speed(speed),
            phase_known=True,
            phase_std=0.0,
            shown=None,
        )

    def turned(self, angle: float) -> Lines:
        """Return a run whose rotor angle is larger by so many rad, which makes it known.

        A table of phasors or of responses stays as it is.
        """
        if not isinstance(self.clock, SampledClock):
            return self
        return replace(self, clock=self.clock.turned(angle), phase_known=True, phase_std=0.0)

    def with_channel(self, channel: Channel, variance: Floats) -> Lines:
        """Return the lines with one more channel, zero, of this variance per line."""
        lines, count = self.mean.shape
        matrices = np.zeros((lines, count + 1, count + 1), dtype=np.complex128)
        matrices[:, :count, :count] = self.covariance.matrices
        matrices[:, count, count] = variance
        return replace(
            self,
            channels=(*self.channels, channel),
            mean=np.column_stack([self.mean, np.zeros(lines)]),
            covariance=replace(self.covariance, matrices=matrices),
            samples=None if self.samples is None else self.samples.with_channel(),
            scatter=None,
            beside=None,
        )
