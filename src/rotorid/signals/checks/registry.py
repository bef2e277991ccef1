"""Checks of the data before any model: what a record or its periods show by themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.core.notes import Note
from rotorid.core.values import Floats
from rotorid.data.record import PeriodicRecord, Record
from rotorid.signals.checks.channels import (
    check_clipped,
    check_copied,
    check_dead,
    check_quantized,
    check_stuck,
)
from rotorid.signals.checks.periods import (
    NO_SCATTER,
    check_copied_periods,
    check_drift,
    check_identical,
    check_knocks,
    check_multiple,
    check_repeats,
    check_settled,
    check_silent,
)
from rotorid.signals.checks.rotation import check_speed, check_wander
from rotorid.signals.checks.timing import check_timing


def check_record(
    record: Record, periods: PeriodicRecord | None = None, *, excerpt: Record | None = None
) -> tuple[Note, ...]:
    """Look at the samples of a record: dead, clipped, quantized and copied channels, the speed.

    Parameters
    ----------
    record : Record
    periods : PeriodicRecord, optional
        Its periods, where it has them: their scatter tells rounding from noise.
    excerpt : Record, optional
        The part of a long record in which the channels are looked at one by one.

    Returns
    -------
    tuple of Note
        One that passes for each thing that was looked at and found in order.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> x = np.clip(np.sin(np.arange(1000) / 20.0), -0.9, 0.9)
    >>> found = check_record(Record([Channel("x", "m")], x[:, None], 1000.0))
    >>> [c.about for c in found if c.severity == "warns"]
    ['clipped']
    """
    part = record if excerpt is None else excerpt
    if part.valid is not None:
        part = replace(part, samples=part.samples[part.valid], angle=None, valid=None)
    scatter = None if periods is None else _scatter(periods)
    begin = -np.inf if periods is None else periods.begin
    found = {
        "dead": check_dead(part, scatter),
        "stuck": check_stuck(
            record if record.valid is None else part, begin, steady=periods is not None
        ),
        "clipped": check_clipped(part),
        "quantized": check_quantized(part, scatter),
    }
    if periods is None:
        centred = part.samples - part.samples.mean(axis=0)
        found["copied"] = check_copied(part.channels, centred)
    if record.valid is None:  # a mask tears the course of time
        found["speed"] = check_speed(record, periods)
        if periods is not None:
            found["multiple period"] = check_multiple(record, periods)
    return _with_ok(found)


def check_periods(periods: PeriodicRecord) -> tuple[Note, ...]:
    """Look at averaged periods: scatter, settling, knocks, drift, lost samples, clocks.

    Parameters
    ----------
    periods : PeriodicRecord

    Returns
    -------
    tuple of Note
        One that passes for each thing that was looked at and found in order.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> from rotorid.signals.average import average
    >>> wave = np.tile(np.cos(2 * np.pi * np.arange(40) / 40), 4)[:, None]
    >>> periods = average(Record([Channel("x", "m")], wave, 40.0), 1.0, harmonics=[1])
    >>> [c.about for c in check_periods(periods) if c.severity == "warns"]
    ['identical periods']
    """
    found = {
        "identical periods": check_identical(periods),
        "copied periods": check_copied_periods(periods),
        "copied": check_copied(periods.channels, _deviations(periods)),
        "repeats": check_repeats(periods),
        "lines below noise": check_silent(periods),
        "lost samples": (timing := check_timing(periods)),
        "settled": (settled := [] if timing else check_settled(periods)),
    }
    found["wander"] = check_wander(periods)
    # What shifts or settles leaves other traces too: they are told once.
    disturbed = any(c.severity != "says" for c in (*timing, *settled))
    found["knock"] = [] if disturbed else check_knocks(periods)
    found["drift"] = [] if disturbed or found["knock"] else check_drift(periods)
    return _with_ok(found)


def _scatter(periods: PeriodicRecord) -> Floats:
    """Return the standard deviation of a sample between periods; 0 where it is rounding."""
    scatter = np.sqrt(periods.variance.mean(axis=0))
    level = np.sqrt((periods.mean**2).mean(axis=0))
    return np.asarray(np.where(scatter > NO_SCATTER * level, scatter, 0.0))


def _deviations(periods: PeriodicRecord) -> Floats:
    """Return what differs from period to period, shape (value, channel); 0 where it is rounding."""
    z = periods.spectra - periods.mean_spectrum
    level = np.sqrt((np.abs(periods.spectra) ** 2).mean(axis=(0, 1)))
    noisy = np.sqrt((np.abs(z) ** 2).mean(axis=(0, 1))) > NO_SCATTER * level
    flat = np.where(noisy, z, 0.0).reshape(-1, z.shape[2])
    return np.concatenate([flat.real, flat.imag])


_IN_ORDER = {
    "dead": "every channel moves",
    "stuck": "no channel stops in the middle",
    "clipped": "no channel is cut at a limit",
    "quantized": "no channel is too coarse",
    "copied": "no two channels are the same",
    "copied periods": "no period is an earlier one again",
    "identical periods": "the periods scatter, so that deviations can be stated",
    "repeats": "the periods repeat",
    "lines below noise": "every line that is used stands above its noise",
    "lost samples": "every period comes when it should",
    "settled": "no transient is left",
    "knock": "no period stands out",
    "drift": "no line drifts",
    "multiple period": "the record repeats after one period",
    "speed": "no line contradicts the speed",
    "wander": "the line of the rotation scatters as the others do",
}


def _with_ok(found: dict[str, list[Note]]) -> tuple[Note, ...]:
    return tuple(
        check
        for name, checks in found.items()
        for check in (checks or [Note(name, "passes", _IN_ORDER[name])])
    )
