"""Some of the lines of a whole record, for the way to the minimum: the last steps take them all.

The stages of the homotopy only lead into the right valley, for which a few hundred lines do; a
whole record has thousands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.lines import Clock, PeriodicClock, WholeClock
from rotorid.observation import Observation
from rotorid.record import Integers
from rotorid.steady import changed

FEW = 400
"""Lines that lead to the minimum: half of them the strongest, where the machine shows, half evenly
spaced. Against a hundred unknowns and the ends of the window they are many."""
PLAIN_LINES = 100
"""Lines of a record on which such a mistake shows. Of four records of 13 s with two sensors
exchanged, 60 and 120 put the right pair first, at half of the next cost or less; 30 do not."""
WORTH = 2
"""Times as many lines from which on some are left out."""


def thinned(
    records: Sequence[Observation], few: int = FEW, *, periodic: bool = False
) -> list[Observation] | None:
    """Return the records with fewer lines, those of periods on demand; None where they have few."""
    found = [_thinned(record, few, periodic) for record in records]
    same = all(new is old for new, old in zip(found, records, strict=True))
    return None if same else found


def _thinned(record: Observation, few: int, periodic: bool) -> Observation:
    lines, clock = record.lines, record.lines.clock
    if len(lines.frequency) <= WORTH * few:
        return record
    chosen = _chosen(record, few)
    fewer: Clock
    if isinstance(clock, WholeClock):
        fewer = replace(clock, lines_kept=clock.lines_kept[chosen])
    elif isinstance(clock, PeriodicClock) and periodic:
        fewer = changed(clock, harmonics=clock.harmonics[chosen])
    else:
        return record
    covariance = replace(lines.covariance, matrices=lines.covariance.matrices[chosen])
    samples = lines.samples
    if samples is not None:
        samples = replace(samples, lines_kept=samples.lines_kept[chosen])
    return record.with_lines(
        replace(
            lines,
            frequency=lines.frequency[chosen],
            speed=lines.speed[chosen],
            mean=lines.mean[chosen],
            covariance=covariance,
            multiplicity=lines.multiplicity[chosen],
            clock=fewer,
            samples=samples,
            scatter=None,
            beside=None,
        )
    )


def _chosen(record: Observation, few: int) -> Integers:
    """Return the strongest lines, in units of their noise, and others evenly spaced."""
    lines = record.lines
    noise = np.diagonal(lines.covariance.matrices, axis1=1, axis2=2).real
    power = np.abs(lines.mean) ** 2
    strength = (power / np.where(noise > 0, noise, 1.0)).sum(axis=1)
    strongest = np.argsort(-strength)[: few // 2]
    spaced = np.linspace(0, len(strength) - 1, few - few // 2).round().astype(np.int64)
    return np.unique(np.concatenate([strongest, spaced]))
