"""Samples without periods, low-passed: ``L[Phi(q, q', q'')] theta = L[u]`` at every sample.

The motion inside a nonlinear term is low-passed before, too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy

from rotorid.core.errors import InputError, naming, require_type
from rotorid.core.notes import Note
from rotorid.core.units import quantity, to_si
from rotorid.core.values import Booleans, Floats, Integers, frozen
from rotorid.data.record import Channel, Known, OfMachine, Record, samples_between
from rotorid.signals.checks.channels import doubtful_samples
from rotorid.signals.checks.registry import check_record
from rotorid.signals.spectrum import transfer_of_recording

ORDER = 4
"""Of the Butterworth filter that is run forward and backward: the published one (Janot et al.)."""
END = 1e-3
"""Share of the weight of a filtered sample that may lie beyond the ends of its stretch: what is
guessed there is at most as wrong as the motion is large, less than any model of friction leaves."""


@frozen
class LowPass:
    """``1 / (1 + (f / f_c)^8)`` for each cut-off: 4th-order Butterworth, forward and backward."""

    sample_rate: float  # Hz
    cutoffs: tuple[float, ...]  # Hz; the filters of all of them, one after the other

    def gain(self, frequency: Floats) -> Floats:
        total = np.ones_like(frequency)
        for cutoff in self.cutoffs:
            total /= 1 + (frequency / cutoff) ** (2 * ORDER)
        return total

    def memory(self) -> int:
        """Return how many samples away the weights of a filtered sample add up to `END`."""
        count = int(np.ceil(32 * self.sample_rate / min(self.cutoffs)))
        gain = self.gain(scipy.fft.rfftfreq(count, 1 / self.sample_rate))
        weights = np.abs(scipy.fft.irfft(gain, n=count))
        far = 2 * np.cumsum(weights[: count // 2 : 1][::-1])[::-1]
        return int(np.argmax(far <= END * weights.sum()))

    def apply(
        self, samples: Floats, order: int = 0, channels: tuple[Channel, ...] | None = None
    ) -> Floats:
        """Return a derivative of the filtered samples, shape (sample, signal).

        The stretch is continued beyond its ends point by point (odd), about the line between
        them, so that filter and derivative are products on its lines: exact, no differences. What
        the `channels` are known to do, delay, hold and dynamics, is undone on the same lines.
        """
        count = len(samples)
        time = np.arange(count) / self.sample_rate
        slope = (samples[-1] - samples[0]) / time[-1]
        centred = samples - samples[0] - np.multiply.outer(time, slope)
        extended = np.concatenate([centred, -centred[-2:0:-1]])
        frequency = scipy.fft.rfftfreq(len(extended), 1 / self.sample_rate)
        factor = (self.gain(frequency) * (2j * np.pi * frequency) ** order)[:, None]
        late = np.zeros(samples.shape[1])
        if channels is not None:
            transfer = transfer_of_recording(channels, frequency, self.sample_rate)
            factor = factor * transfer
            late = np.angle(transfer[1]) / (2 * np.pi * frequency[1])
        lines = scipy.fft.rfft(extended, axis=0) * factor
        found = scipy.fft.irfft(lines, n=len(extended), axis=0)[:count]
        if order == 0:
            found += samples[0] + (time[:, None] + late) * slope
        elif order == 1:
            found += slope
        return np.asarray(found)

    def noise_of(self, samples: Floats, order: int, beside: LowPass | None = None) -> Floats:
        """Return what white noise leaves on a derivative: the root of its variance.

        It is what half the band and above hold, where the motion has least. Of two derivatives
        through two filters their covariance is that of their mean order, to the sign.
        """
        frequency = np.linspace(0, self.sample_rate / 2, 4097)
        motion = LowPass(self.sample_rate, (max(self.sample_rate / 4, *self.cutoffs),))
        taken = np.sqrt(((samples - motion.apply(samples)) ** 2).mean(axis=0))
        gains = self.gain(frequency) * (beside or self).gain(frequency)
        left = gains * (2 * np.pi * frequency) ** (2 * order)
        return np.asarray(taken * np.sqrt(left.mean() / ((1 - motion.gain(frequency)) ** 2).mean()))


_TEXT = re.compile(
    r"\s*(?P<size>abs\(\s*)?(?P<name>\w+)(?P<dots>'{0,2})(?(size)\s*\))"
    r"\s*(?P<sign>[<>])\s*(?P<limit>\S.*?)\s*"
)
_PER_SECOND = ("{unit}", "{unit}/s", "{unit}/s^2")


@frozen
class Condition:
    text: str  # as it was given
    channel: str
    order: int  # of the derivative
    absolute: bool
    below: bool  # whether samples below the limit meet it, or those above
    limit: float  # SI

    def met(self, values: Floats) -> Booleans:
        size = np.abs(values) if self.absolute else values
        return np.asarray(size < self.limit if self.below else size > self.limit)


def read_condition(text: str, units: dict[str, str]) -> Condition:
    """Return a condition from its text; `units` are the SI units of the channels."""
    found = _TEXT.fullmatch(text)
    if found is None:
        expected = 'a channel, < or >, and a quantity, such as "abs(q\') < 1 mm/s" or "F > 120 N"'
        cure = "write it so; several conditions stand in a list"
        raise InputError(f"the condition {text!r}", expected, cure, place="leave_out")
    name, order = found["name"], len(found["dots"])
    if name not in units:
        expected = f"a channel of the record: {', '.join(units)}"
        cure = "name one, with ' for its velocity and '' for its acceleration"
        raise InputError(f"{name!r} in the condition {text!r}", expected, cure, place="leave_out")
    unit = _PER_SECOND[order].format(unit=units[name] or "1")
    with naming(place="leave_out"):
        limit = to_si(found["limit"], unit)
    below = found["sign"] == "<"
    return Condition(text.strip(), name, order, found["size"] is not None, below, limit)


SPILLED = 0.1
"""Share of the weight of a filtered sample that may lie on samples that are left out."""
PASSED = 0.8
"""Of half the rate that decimation leaves, what its low-pass lets pass: the published rule."""


@frozen
class FilteredRecord(OfMachine):
    """A record to be low-passed and differentiated, and which of its samples are used.

    Parameters
    ----------
    record : Record
    cutoff : float
        Hz; of the zero-phase low-pass.
    decimate : int
        Every how many samples one is used.
    second : float or None
        Hz; cut-off of the low-pass that goes with a decimation.
    begins, ends : int array, shape (stretch,)
        The stretches between samples that must not enter the filter.
    used : int array, shape (used,)
        Numbers of the samples that are used, increasing.
    checks : sequence of Note
        What the samples showed, what the filter is, and what it left out.
    warnings : sequence of str
    parameters : mapping of str to float or str or (value, std)
        Parameters of the machine that this record has to itself.
    """

    record: Record
    cutoff: float
    decimate: int
    second: float | None
    begins: Integers
    ends: Integers
    used: Integers
    checks: tuple[Note, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
    parameters: Mapping[str, Known] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[Channel, ...]:  # type: ignore[override]
        """The channels of the record."""
        return self.record.channels

    @property
    def source(self) -> str:
        """Where the samples come from, for messages."""
        return self.record.source

    @property
    def speed(self) -> float:
        """Mean speed in rad/s."""
        return self.record.speed

    @property
    def phase_known(self) -> bool:
        """Whether phi is the rotor's own angle, or starts anywhere."""
        return self.record.phase_known

    @property
    def duration(self) -> float:
        """Time in s that the samples used stand for."""
        return len(self.used) * self.decimate / self.record.sample_rate

    @cached_property
    def inner(self) -> LowPass:
        """The filter of the motion inside a nonlinear term."""
        return LowPass(self.record.sample_rate, (self.cutoff,))

    @cached_property
    def outer(self) -> LowPass:
        """The filter of every column and force: the same, and that of the decimation."""
        cutoffs = (self.cutoff,) if self.second is None else (self.cutoff, self.second)
        return LowPass(self.record.sample_rate, cutoffs)

    def trusted(self) -> FilteredRecord:
        """Return the record without samples that hold something of doubtful ones."""
        reach = 2 * (self.inner.memory() + self.outer.memory()) + 1
        doubtful = doubtful_samples(self.record).astype(np.int8)
        near = scipy.ndimage.maximum_filter1d(doubtful, reach) > 0
        return replace(self, used=self.used[~near[self.used]])


def filtered(
    record: Record,
    cutoff: float | str,
    *,
    decimate: int = 1,
    leave_out: Sequence[str] = (),
    skip: float | str = 0.0,
    until: float | str | None = None,
) -> FilteredRecord:
    r"""Return a record low-passed and differentiated: for nonlinear models, without periods.

    A Butterworth filter of 4th order, run forward and backward so that it shifts nothing, takes
    away what is above the cut-off; the ends, which it cannot know, are trimmed. For `LeastSquares`
    and `Batch`. Noise that the cut-off lets pass is in the regressors and pulls the estimate, as
    in every least squares; what white noise does is taken off. A low cut-off takes the motion away
    that tells a parameter.

    Parameters
    ----------
    record : Record
        Samples that its mask leaves out do not enter the filter: it works in the stretches
        between them.
    cutoff : float or str
        Hz, or a text with a unit; some five to ten times the frequencies of the motion.
    decimate : int
        Use every so many-th sample, after another low-pass at 0.8 of half the rate that is left.
    leave_out : sequence of str
        Conditions in which a sample is left out: ``"abs(q') < 1 mm/s"`` where the axis rests and
        the sign of its velocity is noise, ``"abs(F) > 120 N"`` where a channel saturates.
    skip, until : float or str
        What is left out before and after, in s from the first sample.

    Returns
    -------
    FilteredRecord
        Its `checks` say what was done and how many samples were left out, and why.

    Raises
    ------
    InputError
        For a cut-off beyond half the sample rate, a condition that cannot be read, and where
        nothing is left.

    References
    ----------
    Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS, section 3.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> t = np.arange(4000) / 1000.0
    >>> wave = np.column_stack([np.sin(2 * np.pi * t), np.cos(2 * np.pi * t)])
    >>> record = Record([Channel("F", "N"), Channel("q", "m")], wave, sample_rate=1000.0)
    >>> low = filtered(record, "20 Hz", decimate=5, leave_out=["abs(q') < 1 m/s"])
    >>> len(low.used), low.decimate
    (587, 5)
    """
    require_type(record, Record, place="record")
    hertz, begin = quantity(cutoff, "Hz"), quantity(skip, "s")
    end = np.inf if until is None else quantity(until, "s")
    with naming(record.source):
        _check(record, hertz, decimate)
        units = {c.name: c.unit for c in record.channels}
        conditions = [read_condition(text, units) for text in leave_out]
        good, told = _good(record, conditions, begin, end)
        steps = np.diff(np.concatenate([[0], good.astype(np.int8), [0]]))
        begins, ends = np.flatnonzero(steps > 0), np.flatnonzero(steps < 0)
        second = None if decimate == 1 else PASSED * record.sample_rate / (2 * decimate)
        found = FilteredRecord(record, hertz, decimate, second, begins, ends, np.arange(0))
        edge = found.inner.memory() + found.outer.memory()
        kept = np.zeros(len(good), dtype=bool)
        for first, after in zip(begins, ends, strict=True):
            kept[first + edge : max(after - edge, first + edge)] = True
        told["trimmed"] = int((good & ~kept).sum())
        for condition in conditions:
            if condition.order:
                out = _spilled(found, condition)
                told[f"where {condition.text}"] = int((kept & out).sum())
                kept &= ~out
        used = np.flatnonzero(kept)
        count = len(used)
        used = used[used % decimate == 0]
        if not len(used):
            raise _nothing_left(found, edge, told)
    long = (ends - begins) > 2 * edge
    return replace(
        found,
        begins=begins[long],
        ends=ends[long],
        used=used,
        checks=(
            *check_record(replace(record, valid=good)),  # without periods no line tells the speed
            *_said(found, edge, count, told),
        ),
        warnings=record.warnings,
    )


def _check(record: Record, hertz: float, decimate: int) -> None:
    if not 0 < hertz < record.sample_rate / 2:
        expected = f"a frequency between 0 and {record.sample_rate / 2:g} Hz, half the sample rate"
        cure = "give five to ten times the highest frequency of the motion"
        raise InputError(f"a cut-off of {hertz:g} Hz", expected, cure, place="cutoff")
    if not isinstance(decimate, int) or not 1 <= decimate <= len(record.samples):
        expected = "a whole number, 1 or more, that leaves samples"
        cure = "leave it out to use every sample"
        raise InputError(f"decimate = {decimate!r}", expected, cure, place="decimate")


def _good(
    record: Record, conditions: Sequence[Condition], skip: float, until: float
) -> tuple[Booleans, dict[str, int]]:
    first, last = samples_between(record, skip, until)
    good = np.zeros(len(record.samples), dtype=bool)
    good[first : max(last, first)] = True
    told = {"skipped": int((~good).sum())}
    if record.valid is not None:
        told["masked"] = int((good & ~record.valid).sum())
        good &= record.valid
    for condition in conditions:
        if not condition.order:
            with np.errstate(invalid="ignore"):  # of samples that the mask leaves out already
                met = condition.met(record.column(condition.channel))
            told[f"where {condition.text}"] = int((good & met).sum())
            good &= ~met
    return good, told


def _spilled(found: FilteredRecord, condition: Condition) -> Booleans:
    """Return the samples too much of whose filtered weight lies where a condition is met."""
    samples = found.record.samples
    out = np.zeros(len(samples), dtype=bool)
    column = found.index(condition.channel)
    for begin, end in zip(found.begins, found.ends, strict=True):
        if end - begin < 3:
            continue
        part, channel = samples[begin:end, column : column + 1], (found.channels[column],)
        met = condition.met(found.inner.apply(part, condition.order, channel))
        out[begin:end] = met[:, 0] | (found.outer.apply(met.astype(float))[:, 0] > SPILLED)
    return out


def _nothing_left(found: FilteredRecord, edge: int, told: dict[str, int]) -> InputError:
    why = ", ".join(f"{count} {reason}" for reason, count in told.items() if count)
    return InputError(
        f"no sample left of {len(found.record.samples)}: {why}",
        f"stretches longer than {2 * edge / found.record.sample_rate:.3g} s, twice what the filter "
        f"at {found.cutoff:g} Hz must trim at an end",
        "leave out less, raise the cut-off, or record longer",
        place="leave_out",
    )


def told_of(record: Record) -> str:
    return f"{Path(record.source).name}: " if record.source else ""


def _said(found: FilteredRecord, edge: int, kept: int, told: dict[str, int]) -> tuple[Note, Note]:
    text = (
        f"zero-phase Butterworth of 4th order, forward and backward, {found.cutoff:g} Hz; "
        "derivatives taken on its lines"
    )
    if found.second is not None:
        text += (
            f"; every {found.decimate} samples one is used, after a second low-pass at "
            f"{found.second:g} Hz"
        )
    left = "; ".join(f"{count} {reason}" for reason, count in told.items() if count)
    if told["trimmed"]:
        left += f" ({edge / found.record.sample_rate:.3g} s at each end of a stretch)"
    samples = f"{kept} of {len(found.record.samples)} samples kept; left out: {left}"
    return (
        Note("low-pass", "says", text),
        Note("left out", "says", told_of(found.record) + samples),
    )
