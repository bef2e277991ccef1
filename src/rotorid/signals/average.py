"""Whole periods of a record: their mean, their scatter, their lines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InputError
from rotorid.record import Booleans, Floats, Integers, PeriodicRecord, Record
from rotorid.signals.checks import check_record
from rotorid.signals.spectrum import line_spectra, transfer_of_recording


def average(
    record: Record,
    fundamental: float | None = None,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float, float] | None = None,
    skip: float = 0.0,
) -> PeriodicRecord:
    """Cut a record into whole periods and keep the chosen lines of each.

    Parameters
    ----------
    record : Record
    fundamental : float, optional
        Hz; the sample rate is a whole multiple of it. Or `period_samples`.
    period_samples : int, optional
        Samples of a period.
    harmonics : sequence of int, optional
        Lines to keep, as multiples of the fundamental; 0 is DC. Or `band`.
    band : (float, float), optional
        Hz; keeps every harmonic in it, both ends included.
    skip : float
        Settling to drop, in s. Whole periods after it are used, what is left over is not.

    Returns
    -------
    PeriodicRecord

    Raises
    ------
    InputError
        For a period that is no whole number of samples, fewer than two periods, lines beyond
        the Nyquist frequency, and options that contradict one another.

    Examples
    --------
    >>> from rotorid.record import Channel
    >>> wave = np.cos(2 * np.pi * np.arange(40) / 10)[:, None]
    >>> periodic = average(Record([Channel("x")], wave, 100.0), 10.0, harmonics=[1])
    >>> periodic.periods, periodic.mean_spectrum.real.round(12)
    (4, array([[0.5]]))
    """
    size = _period_samples(record, fundamental, period_samples)
    lines = _lines(record, size, harmonics, band)
    first = _first_sample(record, skip)
    periods = max(len(record.samples) - first, 0) // size
    if periods < 2:
        raise _error(
            record,
            f"{max(len(record.samples) - first, 0)} samples after skip, {periods} whole periods",
            f"at least two periods of {size} samples",
            "record longer, skip less, or correct the fundamental",
        )
    used = slice(first, first + periods * size)
    kept, warnings = _kept_periods(record, used, size)
    samples = record.samples[used].reshape(periods, size, len(record.channels))[kept]
    transfer = transfer_of_recording(
        record.channels, lines * record.sample_rate / size, record.sample_rate
    )
    _check_nyquist(record, size, lines)
    periods_of_record = PeriodicRecord(
        channels=record.channels,
        sample_rate=record.sample_rate,
        harmonics=lines,
        spectra=line_spectra(samples, lines) * transfer,
        variance=samples.var(axis=0, ddof=1),
        mean=samples.mean(axis=0),
        speed=record.speed,
        time=_times(record, used).reshape(periods, size)[kept],
        angle=record.rotor_angle()[used].reshape(periods, size)[kept],
        phase_known=record.phase_known,
        source=record.source,
        warnings=warnings,
    )
    return replace(periods_of_record, checks=check_record(record, periods_of_record))


def _kept_periods(
    record: Record, used: slice, size: int
) -> tuple[slice | Booleans, tuple[str, ...]]:
    """Return the periods without a masked sample, and what is said of the others."""
    if record.valid is None or record.valid[used].all():
        return slice(None), ()
    kept: Booleans = np.all(record.valid[used].reshape(-1, size), axis=1)
    left = int(kept.sum())
    if left < 2:
        raise _error(
            record,
            f"{left} of {len(kept)} periods without a sample that the mask leaves out",
            "at least two",
            "record longer, or leave out less",
        )
    told = f"{len(kept) - left} of {len(kept)} periods hold samples that are masked: left out"
    return kept, (told,)


def _error(record: Record, found: str, expected: str, cure: str) -> InputError:
    return InputError(found, expected, cure, file=record.source)


def _period_samples(record: Record, fundamental: float | None, samples: int | None) -> int:
    if (fundamental is None) == (samples is None):
        raise _error(
            record,
            "neither or both of fundamental and period_samples",
            "one of them",
            "give the fundamental frequency or the samples of a period",
        )
    exact = record.sample_rate / _positive(record, fundamental) if samples is None else samples
    size = round(exact) if math.isfinite(exact) else 0
    if not math.isfinite(exact) or abs(exact - size) > 1e-6 * abs(exact):
        source = "" if fundamental is None else f" ({record.sample_rate:g} / {fundamental:g} Hz)"
        raise _error(
            record,
            f"a period of {exact:.6g} samples{source}",
            "a whole number of samples",
            "give a lower common fundamental and multiply the harmonics, or resample",
        )
    if size < 2:
        raise _error(record, f"a period of {size} samples", "2 or more", "sample faster")
    return size


def _positive(record: Record, fundamental: float | None) -> float:
    if fundamental is None or not (math.isfinite(fundamental) and fundamental > 0):
        raise _error(record, f"a fundamental of {fundamental} Hz", "more than 0 Hz", "correct it")
    return fundamental


def _lines(
    record: Record,
    size: int,
    harmonics: Sequence[int] | None,
    band: tuple[float, float] | None,
) -> Integers:
    if (harmonics is None) == (band is None):
        raise _error(
            record,
            "neither or both of harmonics and band",
            "one of them",
            "say which lines to keep",
        )
    chosen: Sequence[int] = () if harmonics is None else harmonics
    shown = f"the harmonics {list(chosen)}"
    if band is not None:
        spacing = record.sample_rate / size
        shown = f"the band {band[0]:g} to {band[1]:g} Hz"
        if not band[1] <= (size // 2 + 1e-6) * spacing:
            raise _error(
                record,
                f"a band up to {band[1]:g} Hz",
                f"lines up to {record.sample_rate / 2:g} Hz, half the sample rate",
                "lower its upper end",
            )
        if not 0 <= band[0] <= band[1]:
            raise _error(record, shown, "0 Hz or more, the lower end first", "correct its ends")
        chosen = range(
            math.ceil(band[0] / spacing - 1e-6), math.floor(band[1] / spacing + 1e-6) + 1
        )
    if not len(chosen):
        raise _error(record, f"no line in {shown}", "at least one line", "widen it")
    lines = sorted({int(k) for k in chosen if 0 <= k <= size // 2 and k == int(k)})
    if len(lines) < len(chosen):
        raise _error(
            record,
            shown,
            f"different whole numbers from 0 to {size // 2}, half the samples of a period",
            "correct the lines or the fundamental",
        )
    return np.array(lines, dtype=np.int64)


def _first_sample(record: Record, skip: float) -> int:
    if not (math.isfinite(skip) and skip >= 0):
        raise _error(record, f"skip of {skip} s", "0 s or more", "correct it")
    return max(0, math.ceil((skip - record.start) * record.sample_rate - 1e-6))


def _times(record: Record, used: slice) -> Floats:
    return np.asarray(record.start + np.arange(used.start, used.stop) / record.sample_rate)


def _check_nyquist(record: Record, size: int, lines: Integers) -> None:
    """Refuse to correct the Nyquist line, whose phase is not in the samples."""
    corrected = [c.name for c in record.channels if c.hold or c.delay or c.delay_std]
    if corrected and 2 * lines[-1] == size:
        raise _error(
            record,
            f"the Nyquist line with the hold or delay of {corrected[0]}",
            "lines below the Nyquist frequency",
            "leave that line out",
        )
