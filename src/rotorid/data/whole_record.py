"""Lines of a whole record, whatever excited it: sweep, noise, steps, one axis at a time.

Over a window of any length the DFT of a record obeys, at every line,

    Z(omega_k) Q_k = B U_k + g_k + sum_{p=0..R} tau_p (i omega_k / omega_0)^p,

g the loads by the same DFT of the measured rotor angle, so that a speed that fits no line leaks
into every line exactly as its data do, and tau what the loose ends of the window leave. The noise
comes from references, from a quiet record, or from the measured inputs in place of references.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.frozen import frozen
from rotorid.core.notes import Note
from rotorid.core.units import quantity
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.data.lines import Beside, Lines, Samples, WholeClock
from rotorid.data.record import Channel, Record, samples_between
from rotorid.signals.checks.channels import REFERENCE
from rotorid.signals.checks.references import DrivenMotion, check_quiet, check_references
from rotorid.signals.checks.registry import check_whole
from rotorid.signals.checks.rotation import shown_rotation
from rotorid.signals.covariance import Kind, LineCovariance
from rotorid.signals.local_polynomial import ORDERS, Local, half_width, local_covariance
from rotorid.signals.spectrum import transfer_of_recording

TRANSIENT = 2
"""R: J / dof 1.6 to 5 with 0, 1.00 with 2, the same with 3."""


@frozen
class _Window:
    """The samples of a record that are used, and all their lines."""

    record: Record
    first: int
    count: int

    @property
    def used(self) -> slice:
        return slice(self.first, self.first + self.count)

    def columns(self, names: Sequence[str]) -> list[int]:
        return [self.record.names.index(name) for name in names]

    @property
    def spacing(self) -> float:
        """Distance of the lines in Hz."""
        return self.record.sample_rate / self.count

    def lines_of(self, samples: Floats) -> Complexes:
        used = samples[self.used]
        out = np.empty((self.count // 2 + 1, used.shape[1]), dtype=np.complex128)
        for column in range(used.shape[1]):
            out[:, column] = scipy.fft.rfft(used[:, column], norm="forward")
        return out

    def channels(self, names: Sequence[str]) -> Complexes:
        return self.lines_of(self.record.samples[:, self.columns(names)])

    def rotation(self) -> Complexes:
        """Return all lines of exp(i phi) and exp(-i phi); none at standstill."""
        if not self.record.speed and self.record.angle is None:
            return np.zeros((self.count // 2 + 1, 0), dtype=np.complex128)
        angle = self.record.rotor_angle()
        parts = self.lines_of(np.column_stack([np.cos(angle), np.sin(angle)]))
        return np.column_stack([parts[:, 0] + 1j * parts[:, 1], parts[:, 0] - 1j * parts[:, 1]])


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
    ends = (quantity(band[0], "Hz", place="band"), quantity(band[1], "Hz", place="band"))
    end = None if until is None else quantity(until, "s", place="until")
    begin = quantity(skip, "s", place="skip")
    with naming(record.source):
        window = _window(record, begin, end)
        kept = _lines(window, ends)
        frequency: Floats = np.asarray(kept * window.spacing)
        names = [name for name in record.names if name not in references]
        cure = "name the column that holds the excitation"
        require_names(references, record.names, "the reference {}", cure, place="references")
        every, driven = window.channels(names), window.channels(references)
        if quiet is not None:
            motion = _motion(window, every, driven, window.rotation())
            with naming(quiet.source):
                noise = _quiet_noise(quiet, names, frequency, window, motion)
        elif references:
            noise = _noise_beside(window, every, driven, kept, "references")
            held = check_references(references, driven, names, every, record.sample_rate)
            noise = replace(noise, checks=tuple(held))
        else:
            noise = _input_noise(window, every, names, inputs, kept)
    found = _lines_in(window, names, kept, every, noise.covariance)
    checks = _checked(window, found.channels, tuple(references))
    stuck = {name for c in checks if (c.about, c.severity) == (REFERENCE, "warns") for name in c.on}
    return replace(
        found,
        warnings=noise.told,
        checks=(*checks, *(check for check in noise.checks if not stuck & {*check.on})),
        beside=noise.beside,
        shown=noise.shown,
        parts=_Parts(window, tuple(names), ends, noise.covariance, frequency),
    )


def _lines_in(
    window: _Window,
    names: Sequence[str],
    kept: Integers,
    every: Complexes,
    covariance: LineCovariance,
) -> Lines:
    record, used = window.record, window.used
    frequency: Floats = np.asarray(kept * window.spacing)
    angle, time = record.rotor_angle()[used], np.arange(len(record.samples)) / record.sample_rate
    speed = np.asarray(record.speed)
    if record.angle is not None:
        speed = np.gradient(record.angle, 1 / record.sample_rate)[used]
    columns, samples = window.columns(names), None
    channels = tuple(record.channels[column] for column in columns)
    if any(channel.law is not None for channel in channels):  # its constants may be others
        values = record.samples[used]
        whole = columns == list(range(values.shape[1]))  # then no copy
        samples = Samples(values if whole else values[:, columns], record.sample_rate, kept)
    transfer = transfer_of_recording(channels, frequency, record.sample_rate)
    single = (kept == 0) | (2 * kept == window.count)
    return Lines(
        channels=channels,
        frequency=frequency,
        speed=np.full(len(kept), record.speed),
        mean=every[kept] * transfer,
        covariance=covariance.times(transfer),
        multiplicity=np.where(single, 1.0, 2.0),
        clock=WholeClock(time[used], angle, speed, kept),
        transient=TRANSIENT,
        phase_known=record.phase_known,
        phase_std=record.phase_std,
        source=record.source,
        samples=samples,
    )


@frozen
class _Parts:
    """Cuts a record into parts, of `covariance` at the nearest line times their number."""

    window: _Window
    names: tuple[str, ...]
    band: tuple[float, float]
    covariance: LineCovariance
    frequency: Floats

    def __call__(self, count: int) -> list[Lines]:
        size, found = self.window.count // count, []
        for number in range(count):
            part = _Window(self.window.record, self.window.first + number * size, size)
            kept = _lines(part, self.band)
            at = np.abs(self.frequency - kept[:, None] * part.spacing).argmin(axis=1)
            matrices = self.covariance.matrices[at] * (self.window.count / size)
            noise = LineCovariance(matrices, self.covariance.dof, "quiet")
            found.append(_lines_in(part, self.names, kept, part.channels(self.names), noise))
        return found


def _checked(
    window: _Window, channels: tuple[Channel, ...], references: tuple[str, ...]
) -> tuple[Note, ...]:
    record, samples = window.record, window.record.samples[window.used]
    columns = window.columns([channel.name for channel in channels])
    start = record.start + window.first / record.sample_rate
    return check_whole(
        replace(record, samples=samples, angle=None, valid=None, start=start),
        Record(channels, samples[:, columns], record.sample_rate),
        references,
    )


def whole_lines(
    record: Record,
    band: tuple[float, float],
    groups: Sequence[Sequence[str]],
    skip: float = 0.0,
) -> tuple[Floats, list[Complexes], Complexes]:
    """Return the lines of groups of channels of a whole record, and those of the rotation.

    Frequency in Hz, (line,); each group, as recorded, (line, channel); exp(+-i phi), (line, 2), or
    (line, 0) at standstill.
    """
    with naming(record.source):
        window = _window(record, skip, None)
        kept = _lines(window, band)
    found = [window.channels(list(names))[kept] for names in groups]
    return np.asarray(kept * window.spacing), found, window.rotation()[kept]


def _window(record: Record, skip: float, until: float | None) -> _Window:
    first, last = samples_between(record, skip, np.inf if until is None else until)
    if last - first < 2:
        raise InputError(
            f"{max(last - first, 0)} samples between skip and until",
            "a record longer than both leave out",
            "skip less, or record longer",
        )
    return _Window(record, first, last - first)


def _lines(window: _Window, band: tuple[float, float]) -> Integers:
    low, high = band
    nyquist = window.record.sample_rate / 2
    if not 0 <= low < high <= nyquist * (1 + 1e-9):
        raise InputError(
            f"the band {low:g} to {high:g} Hz",
            f"0 Hz to {nyquist:g} Hz, half the sample rate, the lower end first",
            "give the band in which the machine was excited",
        )
    kept = np.arange(
        np.ceil(low / window.spacing - 1e-6), np.floor(high / window.spacing + 1e-6) + 1
    ).astype(np.int64)
    if not len(kept):
        raise InputError(
            f"no line between {low:g} and {high:g} Hz, lines are {window.spacing:g} Hz apart",
            "at least one line",
            "widen the band, or record longer",
        )
    return kept


def _local(every: Complexes, references: Complexes, rotation: Complexes, lines: Integers) -> Local:
    """Return the covariance by local polynomials, or say that the record is too short for it."""
    half = half_width(every.shape[1], references.shape[1], rotation.shape[1] > 0, ORDERS[0])
    if 2 * half + 1 > len(every):
        raise InputError(
            f"{len(every)} lines",
            f"{2 * half + 1} or more, to tell noise from motion in {every.shape[1]} channels",
            "record longer",
        )
    return local_covariance(every, references, rotation, lines)


@frozen
class _Noise:
    """The noise of a record, what is to be said of it, and where else it shows."""

    covariance: LineCovariance
    told: tuple[str, ...]
    beside: Beside
    shown: float | None = None
    checks: tuple[Note, ...] = ()


def _noise_beside(
    window: _Window, every: Complexes, references: Complexes, kept: Integers, kind: Kind
) -> _Noise:
    rotation = window.rotation()
    found = _local(every, references, rotation, kept)
    numbers = np.arange(len(kept))
    ordinary = ~np.isin(kept, found.standing_out)
    beside = Beside(_constant(references[kept], rotation[kept]), ordinary, numbers, numbers)
    shown = _shown(found, window, every, references)
    # Of each line its own residual has a share.
    covariance = LineCovariance(found.matrices, found.dof, kind, found.leverage)
    return _Noise(covariance, _told(found, window, shown), beside, shown)


def _constant(references: Complexes, rotation: Complexes) -> Complexes:
    """Return what motion follows in a window in which no response changes."""
    ones = np.ones((len(references), 1), dtype=np.complex128)
    return np.concatenate([references, ones, rotation], axis=1)


def _input_noise(
    window: _Window,
    every: Complexes,
    names: Sequence[str],
    inputs: Sequence[str],
    kept: Integers,
) -> _Noise:
    known = [names.index(name) for name in inputs if name in names]
    if not known:
        raise InputError(
            "neither references, nor a quiet record, nor periods",
            "something that tells noise from motion",
            "name the columns that hold the excitation in references, record the machine once "
            "without excitation (quiet), or give the inputs",
        )
    found = _noise_beside(window, every, every[:, known], kept, "inputs")
    warning = (
        "noise was told from motion by the measured inputs, taken as free of noise: right in open "
        "loop; in closed loop name the excitation in references or give a quiet record"
    )
    return replace(found, told=(warning, *found.told))


def _quiet_noise(
    quiet: Record, names: Sequence[str], frequency: Floats, window: _Window, motion: DrivenMotion
) -> _Noise:
    missing = [name for name in names if name not in quiet.names]
    if missing or quiet.sample_rate != window.record.sample_rate:
        raise InputError(
            f"no channel {missing[0]!r}" if missing else f"a sample rate of {quiet.sample_rate:g}",
            "the channels and the sample rate of the record with excitation",
            "record the machine as before, only without excitation",
            place="quiet",
        )
    if np.array_equal(quiet.samples, window.record.samples):
        raise InputError(
            "the record itself for its quiet record",
            "a record of the same machine without excitation",
            "name the file that was recorded without excitation, or name references",
            place="quiet",
        )
    still = _Window(quiet, 0, len(quiet.samples))
    every, rotation = still.channels(names), still.rotation()
    none = np.zeros((len(every), 0), dtype=np.complex128)
    nearest = np.clip(np.round(frequency / still.spacing), 0, len(every) - 1).astype(np.int64)
    found = _local(every, none, rotation, nearest)
    longer = still.count / window.count
    covariance = LineCovariance(found.matrices * longer, found.dof, "quiet")
    kept = np.arange(nearest.min(), nearest.max() + 1)
    channels = [quiet.channels[column] for column in still.columns(names)]
    transfer = transfer_of_recording(channels, kept * still.spacing, quiet.sample_rate)
    beside = Beside(
        _constant(none[kept], rotation[kept]),
        ~np.isin(kept, found.standing_out),
        nearest - nearest.min(),
        np.round((kept * still.spacing - frequency[0]) / window.spacing)
        .clip(0, len(frequency) - 1)
        .astype(np.int64),
        every[kept] * transfer * np.sqrt(longer),
    )
    shown = _shown(found, still, every, none) if quiet.speed == window.record.speed else None
    speeds = window.record.speed, quiet.speed
    checks = check_quiet(channels, motion, _motion(still, every, none, rotation), speeds, shown)
    return _Noise(covariance, _told(found, still, shown), beside, shown, tuple(checks))


def _motion(
    window: _Window, every: Complexes, driven: Complexes, rotation: Complexes
) -> DrivenMotion:
    return DrivenMotion(
        every, driven, rotation, abs(window.record.speed) / (2 * np.pi * window.spacing)
    )


def _shown(found: Local, window: _Window, every: Complexes, references: Complexes) -> float | None:
    """Return the speed that the lines show where it is not the one stated, rad/s."""
    record = window.record
    if record.angle is not None or not record.speed or not len(found.standing_out):
        return None
    hertz = abs(record.speed) / (2 * np.pi)
    motion = np.column_stack([references, np.ones(len(references))])
    stated = hertz / window.spacing
    place = shown_rotation(every, motion, window.rotation(), found.standing_out, stated)
    if place is None:
        return None
    return float(np.copysign(2 * np.pi * place * window.spacing, record.speed))


def _told(found: Local, window: _Window, shown: float | None) -> tuple[str, ...]:
    told: tuple[str, ...] = ()
    if len(found.standing_out):
        where = ", ".join(f"{line * window.spacing:.6g}" for line in found.standing_out[:5])
        more = f" and {len(found.standing_out) - 5} more" if len(found.standing_out) > 5 else ""
        what = "hum, or a rotation otherwise than stated"
        if shown is not None:
            hertz, stated = (abs(s) / (2 * np.pi) for s in (shown, window.record.speed))
            what = f"a rotation at {hertz:.6g} Hz, where {stated:.6g} Hz is stated, or hum"
        told += (
            f"the lines at {where} Hz{more} stand out of the noise beside them: {what}; check the "
            "speed, or take the band beside them",
        )
    if found.bent:
        width = (2 * found.half + 1) * window.spacing
        told += (
            f"the response bends within the {width:.3g} Hz in which noise is told from motion, "
            f"more than a polynomial of order {found.order} follows: deviations are too wide; "
            "record longer",
        )
    return told
