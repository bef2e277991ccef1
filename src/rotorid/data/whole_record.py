"""Lines of a whole record, with the transient of its ends (docs/maximum-likelihood.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
import scipy

from rotorid.core.errors import InputError, naming, require_names, require_type
from rotorid.core.notes import Note
from rotorid.core.units import quantity
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.lines import Beside, Lines, SampledClock, Samples
from rotorid.data.record import Channel, Record, part_of, samples_between
from rotorid.signals.checks.channels import REFERENCE
from rotorid.signals.checks.references import DrivenMotion, check_quiet, check_references
from rotorid.signals.checks.registry import Seen, found_by
from rotorid.signals.checks.rotation import shown_rotation
from rotorid.signals.covariance import Kind, LineCovariance
from rotorid.signals.local_polynomial import ORDERS, Local, half_width, local_covariance
from rotorid.signals.spectrum import lines_within, transfer_of_recording

TRANSIENT = 2  # R: J / dof 1.6 to 5 with 0, 1.00 with 2, the same with 3


@frozen
class _Whole:
    """The samples of a record that are used, and all their lines, from DC on."""

    record: Record
    names: tuple[str, ...]  # of what is measured: no references
    angle: Floats  # rad, at each sample
    speed: Floats  # rad/s, at each sample or one for all

    @property
    def spacing(self) -> float:
        return self.record.sample_rate / len(self.record.samples)

    @property
    def place(self) -> float:
        return abs(self.record.speed) / (2 * np.pi * self.spacing)

    @property
    def columns(self) -> list[int]:
        return [self.record.names.index(name) for name in self.names]

    @property
    def channels(self) -> tuple[Channel, ...]:
        return tuple(self.record.channels[column] for column in self.columns)

    def part(self, first: int, after: int) -> _Whole:
        speed = self.speed[first:after] if self.speed.ndim else self.speed
        record = part_of(self.record, first, after)
        return _Whole(record, self.names, self.angle[first:after], speed)

    def of(self, names: Sequence[str]) -> Complexes:
        return _all_lines([self.record.column(name) for name in names], len(self.record.samples))

    @cached_property
    def every(self) -> Complexes:
        return self.of(self.names)

    @cached_property
    def rotation(self) -> Complexes:
        """All lines of exp(i phi) and exp(-i phi); none at standstill."""
        count = len(self.record.samples)
        if not self.record.speed and self.record.angle is None:
            return _all_lines([], count)
        cosine, sine = _all_lines([np.cos(self.angle), np.sin(self.angle)], count).T
        return np.column_stack([cosine + 1j * sine, cosine - 1j * sine])

    def motion(self, driven: Complexes) -> DrivenMotion:
        return DrivenMotion(self.every, driven, self.rotation, self.place)

    def within(self, band: tuple[float, float]) -> Integers:
        return lines_within(band, self.record.sample_rate, len(self.record.samples))

    def lines(self, kept: Integers, covariance: LineCovariance) -> Lines:
        record, count, samples = self.record, len(self.record.samples), None
        if any(channel.law is not None for channel in self.channels):  # its constants may be others
            whole = self.columns == list(range(len(record.names)))  # then no copy
            values = record.samples if whole else record.samples[:, self.columns]
            samples = Samples(values, record.sample_rate, kept)
        frequency: Floats = np.asarray(kept * self.spacing)
        transfer = transfer_of_recording(self.channels, frequency, record.sample_rate)
        time = record.start + np.arange(count) / record.sample_rate
        return Lines(
            channels=self.channels,
            frequency=frequency,
            speed=np.full(len(kept), record.speed),
            mean=self.every[kept] * transfer,
            covariance=covariance.times(transfer),
            multiplicity=np.where((kept == 0) | (2 * kept == count), 1.0, 2.0),
            clock=SampledClock(self.speed, kept, time[None], self.angle[None]),
            transient=TRANSIENT,
            phase_known=record.phase_known,
            phase_std=record.phase_std,
            source=record.source,
            samples=samples,
        )

    def parts(
        self, band: tuple[float, float], found: LineCovariance, frequency: Floats, count: int
    ) -> list[Lines]:
        """Return the lines of parts; their covariance is that found on the nearest line."""
        size, parts = len(self.record.samples) // count, []
        for number in range(count):
            part = self.part(number * size, (number + 1) * size)
            kept = part.within(band)
            at = np.abs(frequency - kept[:, None] * part.spacing).argmin(axis=1)
            matrices = found.matrices[at] * (len(self.record.samples) / size)
            parts.append(part.lines(kept, LineCovariance(matrices, found.dof, "quiet")))
        return parts


def _all_lines(columns: Sequence[Floats], count: int) -> Complexes:
    out = np.empty((count // 2 + 1, len(columns)), dtype=np.complex128)
    for number, column in enumerate(columns):
        out[:, number] = scipy.fft.rfft(column, norm="forward")
    return out


def _whole(
    record: Record, skip: float, until: float = np.inf, references: Sequence[str] = ()
) -> _Whole:
    first, after = samples_between(record, skip, until)
    if after - first < 2:
        expected = "a record longer than both leave out"
        cure = "skip less, or record longer"
        raise InputError(f"{max(after - first, 0)} samples between skip and until", expected, cure)
    speed = np.asarray(record.speed)
    if record.angle is not None:
        speed = np.gradient(record.angle, 1 / record.sample_rate)
    names = tuple(name for name in record.names if name not in references)
    return _Whole(record, names, record.rotor_angle(), speed).part(first, after)


def spectra(
    record: Record,
    band: tuple[float | str, float | str],
    *,
    references: Sequence[str] = (),
    quiet: Record | None = None,
    inputs: Sequence[str] = (),
    skip: float | str = 0.0,
    until: float | str | None = None,
) -> Lines:
    r"""Return the lines of a whole record in a band, their noise, and the loads on them.

    Nothing has to repeat, and the rotation need not sit on a line. Noise is told from motion by
    one of: `references`, what was added to the commands, by a polynomial in a window of lines;
    `quiet`, a record of the same machine, speed and controller without excitation; or, where
    neither is given, `inputs`, the measured inputs taken as free of noise, which is right in open
    loop with quiet inputs only.

    Parameters
    ----------
    record : Record
    band : (float, float)
        Hz, or texts with units; every line in it, both ends included.
    references : sequence of str
        Channels of the record that hold the excitation; they are no channels of the model.
    quiet : Record, optional
        The same channels.
    inputs : sequence of str
        Channels of the inputs, used where there are no references and no quiet record.
    skip, until : float or str
        What is left out before and after, in s from the first sample.

    Returns
    -------
    Lines
        With a transient of order 2, and the source of the covariance in `covariance.kind`.

    Raises
    ------
    InputError
        For a band without lines, too short a record, unknown references, or no source of noise.

    References
    ----------
    Pintelon, Schoukens, Vandersteen, Barbe (2010), Mech. Syst. Signal Process. 24, 573-595.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> rng = np.random.default_rng(1)
    >>> wave, noise = rng.standard_normal((2, 4000))
    >>> samples = np.column_stack([wave, 2 * wave + noise])
    >>> record = Record([Channel("r"), Channel("x")], samples, sample_rate=1000.0)
    >>> lines = spectra(record, (20.0, 200.0), references=["r"])
    >>> lines.names, lines.covariance.kind, bool(lines.covariance.dof >= 5)
    (('x',), 'references', True)
    """
    require_type(record, Record, place="record")
    ends = (quantity(band[0], "Hz", place="band"), quantity(band[1], "Hz", place="band"))
    end = np.inf if until is None else quantity(until, "s", place="until")
    begin = quantity(skip, "s", place="skip")
    with naming(record.source):
        whole = _whole(record, begin, end, references)
        kept = whole.within(ends)
        cure = "name the column that holds the excitation"
        require_names(references, record.names, "the reference {}", cure, place="references")
        driven = whole.of(references)
        if quiet is not None:
            with naming(quiet.source):
                noise = _quiet_noise(quiet, whole, kept, driven)
        elif references:
            noise = _noise_beside(whole, driven, kept, "references")
            held = check_references(
                references, driven, whole.names, whole.every, record.sample_rate
            )
            noise = replace(noise, checks=tuple(held))
        else:
            noise = _input_noise(whole, inputs, kept)
    found = whole.lines(kept, noise.covariance)
    used = replace(whole.record, angle=None, valid=None)
    checks = found_by("whole", Seen(used, channels=found.channels, references=tuple(references)))
    stuck = {name for c in checks if (c.about, c.severity) == (REFERENCE, "warns") for name in c.on}
    return replace(
        found,
        warnings=noise.told,
        checks=(*checks, *(check for check in noise.checks if not stuck & {*check.on})),
        beside=noise.beside,
        shown=noise.shown,
        parts=partial(whole.parts, ends, noise.covariance, found.frequency),
    )


def whole_lines(
    record: Record, band: tuple[float, float], groups: Sequence[Sequence[str]], skip: float = 0.0
) -> tuple[Floats, list[Complexes], Complexes]:
    """Return Hz, (line,); each group, (line, channel); exp(+-i phi), (line, 2 or, at rest, 0)."""
    with naming(record.source):
        whole = _whole(record, skip)
        kept = whole.within(band)
    found = [whole.of(names)[kept] for names in groups]
    return np.asarray(kept * whole.spacing), found, whole.rotation[kept]


def _local(whole: _Whole, references: Complexes, lines: Integers) -> Local:
    every, rotation = whole.every, whole.rotation
    half = half_width(every.shape[1], references.shape[1], rotation.shape[1] > 0, ORDERS[0])
    if 2 * half + 1 > len(every):
        expected = f"{2 * half + 1} or more, to tell noise from motion in {every.shape[1]} channels"
        raise InputError(f"{len(every)} lines", expected, "record longer")
    return local_covariance(every, references, rotation, lines)


@frozen
class _Noise:
    covariance: LineCovariance
    told: tuple[str, ...]
    beside: Beside
    shown: float | None = None
    checks: tuple[Note, ...] = ()


def _noise_beside(whole: _Whole, references: Complexes, kept: Integers, kind: Kind) -> _Noise:
    found = _local(whole, references, kept)
    numbers = np.arange(len(kept))
    ordinary = ~np.isin(kept, found.standing_out)
    beside = Beside(_constant(references[kept], whole.rotation[kept]), ordinary, numbers, numbers)
    shown = _shown(found, whole, references)
    # Of each line its own residual has a share.
    covariance = LineCovariance(found.matrices, found.dof, kind, found.leverage)
    return _Noise(covariance, _told(found, whole, shown), beside, shown)


def _constant(references: Complexes, rotation: Complexes) -> Complexes:
    """Return what motion follows in a window in which no response changes."""
    ones = np.ones((len(references), 1), dtype=np.complex128)
    return np.concatenate([references, ones, rotation], axis=1)


def _input_noise(whole: _Whole, inputs: Sequence[str], kept: Integers) -> _Noise:
    known = [whole.names.index(name) for name in inputs if name in whole.names]
    if not known:
        raise InputError(
            "neither references, nor a quiet record, nor periods",
            "something that tells noise from motion",
            "name the columns that hold the excitation in references, record the machine once "
            "without excitation (quiet), or give the inputs; of a free decay set a cutoff in place "
            "of the band",
        )
    found = _noise_beside(whole, whole.every[:, known], kept, "inputs")
    warning = (
        "noise was told from motion by the measured inputs, taken as free of noise: right in open "
        "loop; in closed loop name the excitation in references or give a quiet record"
    )
    return replace(found, told=(warning, *found.told))


def _quiet_noise(quiet: Record, whole: _Whole, kept: Integers, driven: Complexes) -> _Noise:
    record = whole.record
    missing = [name for name in whole.names if name not in quiet.names]
    if missing or quiet.sample_rate != record.sample_rate:
        raise InputError(
            f"no channel {missing[0]!r}" if missing else f"a sample rate of {quiet.sample_rate:g}",
            "the channels and the sample rate of the record with excitation",
            "record the machine as before, only without excitation",
            place="quiet",
        )
    if np.array_equal(quiet.samples, record.samples):
        expected = "a record of the same machine without excitation"
        cure = "name the file that was recorded without excitation, or name references"
        raise InputError("the record itself for its quiet record", expected, cure, place="quiet")
    still = _Whole(quiet, whole.names, quiet.rotor_angle(), np.asarray(quiet.speed))
    none = np.zeros((len(still.every), 0), dtype=np.complex128)
    frequency = kept * whole.spacing
    nearest = np.clip(np.round(frequency / still.spacing), 0, len(none) - 1).astype(np.int64)
    found = _local(still, none, nearest)
    longer = len(quiet.samples) / len(record.samples)
    covariance = LineCovariance(found.matrices * longer, found.dof, "quiet")
    near = np.arange(nearest.min(), nearest.max() + 1)
    transfer = transfer_of_recording(still.channels, near * still.spacing, quiet.sample_rate)
    where = np.round((near * still.spacing - frequency[0]) / whole.spacing)
    beside = Beside(
        _constant(none[near], still.rotation[near]),
        ~np.isin(near, found.standing_out),
        nearest - nearest.min(),
        where.clip(0, len(kept) - 1).astype(np.int64),
        still.every[near] * transfer * np.sqrt(longer),
    )
    shown = _shown(found, still, none) if quiet.speed == record.speed else None
    speeds = record.speed, quiet.speed
    checks = check_quiet(still.channels, whole.motion(driven), still.motion(none), speeds, shown)
    return _Noise(covariance, _told(found, still, shown), beside, shown, tuple(checks))


def _shown(found: Local, whole: _Whole, references: Complexes) -> float | None:
    """Return the speed that the lines show where it is not the one stated, rad/s."""
    speed = whole.record.speed
    if whole.record.angle is not None or not speed or not len(found.standing_out):
        return None
    motion = np.column_stack([references, np.ones(len(references))])
    place = shown_rotation(whole.every, motion, whole.rotation, found.standing_out, whole.place)
    return None if place is None else float(np.copysign(2 * np.pi * place * whole.spacing, speed))


def _told(found: Local, whole: _Whole, shown: float | None) -> tuple[str, ...]:
    told: tuple[str, ...] = ()
    if len(found.standing_out):
        where = ", ".join(f"{line * whole.spacing:.6g}" for line in found.standing_out[:5])
        more = f" and {len(found.standing_out) - 5} more" if len(found.standing_out) > 5 else ""
        what = "hum, or a rotation otherwise than stated"
        if shown is not None:
            hertz, stated = (abs(s) / (2 * np.pi) for s in (shown, whole.record.speed))
            what = f"a rotation at {hertz:.6g} Hz, where {stated:.6g} Hz is stated, or hum"
        told += (
            f"the lines at {where} Hz{more} stand out of the noise beside them: {what}; check the "
            "speed, or take the band beside them",
        )
    if found.bent:
        width = (2 * found.half + 1) * whole.spacing
        told += (
            f"the response bends within the {width:.3g} Hz in which noise is told from motion, "
            f"more than a polynomial of order {found.order} follows: deviations are too wide; "
            "record longer",
        )
    return told
