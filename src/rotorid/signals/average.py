"""Whole periods of a record: their mean, their scatter, their lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.errors import InputError
from rotorid.record import Booleans, Floats, PeriodicRecord, Record
from rotorid.signals.checks import check_periods, check_record
from rotorid.signals.checks_ramp import ramp_notes, ramps, without_ramps
from rotorid.signals.period_lines import (
    check_nyquist,
    first_sample,
    lines_of,
    period_size,
    too_short,
)
from rotorid.signals.sums import PeriodSums
from rotorid.steady import Steady, changed
from rotorid.units import quantity

_LOOKED_AT = 1 << 14
"""Samples of a long record whose channels are checked one by one."""


def average(
    record: Record,
    fundamental: float | str | None = None,
    *,
    period_samples: int | None = None,
    harmonics: Sequence[int] | None = None,
    band: tuple[float | str, float | str] | None = None,
    skip: float | str = 0.0,
) -> PeriodicRecord:
    """Cut a record into whole periods and keep the chosen lines of each.

    Parameters
    ----------
    record : Record
    fundamental : float or str, optional
        Hz; the sample rate is a whole multiple of it. Or `period_samples`.
    period_samples : int, optional
        Samples of a period.
    harmonics : sequence of int, optional
        Lines to keep, as multiples of the fundamental; 0 is DC. Or `band`.
    band : (float, float), optional
        Hz; keeps every harmonic in it, both ends included.
    skip : float or str
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
    hertz = None if fundamental is None else quantity(fundamental, "Hz")
    ends = None if band is None else (quantity(band[0], "Hz"), quantity(band[1], "Hz"))
    size = period_size(record, hertz, period_samples)
    lines = lines_of(record, size, harmonics, ends)
    first = first_sample(record, quantity(skip, "s"), record.start)
    left = max(len(record.samples) - first, 0)
    periods = left // size
    if periods < 2:
        raise too_short(record, left, size)
    used = slice(first, first + periods * size)
    kept, warnings = _kept_periods(record, used, size)
    samples = record.samples[used].reshape(periods, size, len(record.channels))
    sums = PeriodSums(size, len(record.channels), lines)
    sums.add(samples if isinstance(kept, slice) else samples[kept], 0)
    check_nyquist(record, size, lines)
    periods_of_record = sums.periods(
        record,
        *_course(record, first, (periods, size), kept),
        phase_known=record.phase_known,
        phase_std=record.phase_std,
        warnings=warnings,
    )
    rise = ramps(record, periods_of_record)
    if rise.any():
        flat = without_ramps(record, periods_of_record, rise)
        again = average(
            flat,
            hertz,
            period_samples=period_samples,
            harmonics=harmonics,
            band=band,
            skip=skip,
        )
        return changed(again, checks=(*again.checks, *ramp_notes(again, rise)))
    seen = check_record(record, periods_of_record, excerpt=_excerpt(record, first, size))
    return changed(periods_of_record, checks=(*seen, *check_periods(periods_of_record)))


def _excerpt(record: Record, first: int, size: int) -> Record:
    """Return the periods of a long record that are looked at: some of its start, middle and end.

    What a channel does in every period, as to clip, shows in any.
    """
    count, few = len(record.samples), size * max(1, _LOOKED_AT // (3 * size))
    if record.valid is not None or count <= max(_LOOKED_AT, 3 * few):
        return record
    middle = first + size * ((count - first) // (2 * size))
    end = first + size * ((count - first) // size)
    parts = [slice(0, few), slice(middle - few, middle), slice(end - few, end)]
    samples = np.concatenate([record.samples[part] for part in parts])
    return replace(record, samples=samples, angle=None, valid=None)


def _kept_periods(
    record: Record, used: slice, size: int
) -> tuple[slice | Booleans, tuple[str, ...]]:
    """Return the periods without a masked sample, and what is said of the others."""
    if record.valid is None or record.valid[used].all():
        return slice(None), ()
    kept: Booleans = np.all(record.valid[used].reshape(-1, size), axis=1)
    left = int(kept.sum())
    if left < 2:
        raise InputError(
            f"{left} of {len(kept)} periods without a sample that the mask leaves out",
            "at least two",
            "record longer, or leave out less",
            file=record.source,
        )
    told = f"{len(kept) - left} of {len(kept)} periods hold samples that are masked: left out"
    return kept, (told,)


def _course(
    record: Record, first: int, shape: tuple[int, int], kept: slice | Booleans
) -> tuple[Steady | Floats, Steady | Floats]:
    """Return times and angles of the samples used."""
    time = Steady(first, shape, record.sample_rate, record.start)
    angle = replace(time, slope=record.speed) if record.angle is None else record.angle
    if not isinstance(angle, Steady):
        angle = angle[first : first + shape[0] * shape[1]].reshape(shape)
    if isinstance(kept, slice):
        return time, angle
    return time()[kept], (angle() if isinstance(angle, Steady) else angle)[kept]
