"""Channels that stop while the others go on: a reading that stays at its last value.

A logger that has lost a channel repeats its last value, or lets the last digit of it play. A rest
is no fault by itself where nothing repeats: an axis may not be excited for a while. But what moves
comes to rest by and by, and what drives rests where it drives nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rotorid.frozen import frozen
from rotorid.record import Check, Floats, Record, Verdict
from rotorid.signals.checks_samples import DITHER, is_input, quantum
from rotorid.signals.sums import median

STUCK = 0.02
"""Part of the record from which on one value is a stop: with 40 periods nearly one of them."""
FEWEST_STUCK = 50
"""Samples below which a stop is none: a coarse converter rests that long at a turning point."""
STUCK_BESIDE = 10.0
"""How much longer than any other rest of the channel a stop is: one of steps rests every time."""
FINE = 1e-4
"""Part of a channel's deviation that counts as its last digit where it has no steps: no sensor is
that free of noise."""
ABRUPT = 10.0
"""Last digits that a sensor moves within the one sample before a stop: a motion that ends, and be
it in ten samples a cycle, has less than three left."""
MOVING = 0.5
"""Part of the samples outside its rest in which a drive changes, if it stops: one of steps rests
between them as well."""
ASIDE = 0.2
"""Deviations from its mean at which a drive has stopped; where it drives nothing it rests at the
mean. Chance puts one stop in six nearer."""

_POINTS = 5  # of a rest that are looked at: of a moving channel chance puts no five within a digit
_TRIED = 3  # rests that are measured to their ends


@frozen
class _Rest:
    """Samples of a channel that stay within a tolerance: from `first` up to before `after`."""

    first: int
    after: int
    level: float
    digit: float
    tolerance: float

    def abrupt(self, samples: Floats) -> bool:
        """Tell whether it begins out of full motion."""
        return self.first > 0 and abs(samples[self.first - 1] - self.level) > ABRUPT * self.digit

    def aside(self, samples: Floats) -> bool:
        """Tell whether a drive that moves all the time otherwise rests where it does not belong."""
        moving = np.delete(samples, slice(self.first, self.after))
        if len(moving) < 2 or (np.abs(np.diff(moving)) > self.tolerance).mean() < MOVING:
            return False
        return bool(abs(self.level - moving.mean()) > ASIDE * moving.std())


def check_stuck(
    record: Record,
    begin: float = -np.inf,
    *,
    steady: bool = True,
    references: tuple[str, ...] = (),
) -> list[Check]:
    """Find channels that stop in the middle: one value for a good part of the record.

    What lies before `begin`, in s, is not used, and may rest. `steady`: the motion repeats, so
    that no rest belongs to it; otherwise a sensor has to stop out of full motion.
    """
    found = []
    first = max(0, round((max(begin, record.start) - record.start) * record.sample_rate))
    for c, channel in enumerate(record.channels):
        samples = record.samples[first:, c]
        rest = _longest(samples)
        if rest is None:
            continue
        driving = is_input(channel) or channel.name in references
        verdict: Verdict = "refused"
        if driving:
            verdict = "warning" if rest.aside(samples) else "note"
        elif not rest.abrupt(samples) and not (steady and rest.tolerance == 0):
            verdict = "note"
        text = _told(rest, record.start + first / record.sample_rate, record.sample_rate)
        found.append(Check("stuck", channel.name, f"{text}: {_cure(verdict)}", verdict))
    return found


def _cure(verdict: Verdict) -> str:
    if verdict == "note":
        return "right only if nothing was to move there"
    return "check its cable and its logger, use the part in which it moves (skip, until)"


def _told(rest: _Rest, start: float, rate: float) -> str:
    stop, go = start + rest.first / rate, start + rest.after / rate
    how = "in every sample" if rest.tolerance == 0 else "to the last digit"
    return f"{rest.level:.6g} {how} from {stop:.5g} to {go:.5g} s, while it moves before or after"


def _longest(samples: Floats) -> _Rest | None:
    """Return the longest rest of a channel that can be a stop, exact or to the last digit."""
    least = max(FEWEST_STUCK, int(np.ceil(STUCK * len(samples))))
    step = max(1, least // (_POINTS + 1))
    some = samples[::step]
    if len(some) < 2 * _POINTS or (some == some[0]).all():
        return None
    windows = np.ptp(sliding_window_view(some, _POINTS), axis=1)
    digit = max(quantum(samples), FINE * float(some.std()))
    for tolerance in (0.0, DITHER * digit):
        rest = _longest_within(samples, windows, step, digit, tolerance)
        if rest is not None and rest.after - rest.first >= least:
            return rest
    return None


def _longest_within(
    samples: Floats, windows: Floats, step: int, digit: float, tolerance: float
) -> _Rest | None:
    """Return the longest rest within a tolerance, if no other is nearly as long."""
    rests = list(_rests(samples, windows, step, digit, tolerance))
    if not rests:
        return None
    best = max(rests, key=lambda rest: rest.after - rest.first)
    length = best.after - best.first
    if length == len(samples):  # it never moves, which is told by itself
        return None
    beside = max(2, int(length / STUCK_BESIDE))
    for part in (samples[: best.first], samples[best.after :]):
        whole = part[: len(part) // beside * beside].reshape(-1, beside)
        if (np.ptp(whole, axis=1) <= tolerance).any():
            return None
    return best


def _rests(
    samples: Floats, windows: Floats, step: int, digit: float, tolerance: float
) -> Iterator[_Rest]:
    """Yield the rests that the longest runs of quiet windows belong to, measured to their ends."""
    quiet = np.flatnonzero(windows <= tolerance)
    if not len(quiet):
        return
    runs = np.split(quiet, np.flatnonzero(np.diff(quiet) > 1) + 1)
    for run in sorted(runs, key=len, reverse=True)[:_TRIED]:
        begin, end = int(run[0]) * step, (int(run[-1]) + _POINTS - 1) * step + 1
        part = samples[begin:end]
        if np.ptp(part) > tolerance:
            continue
        outside = (samples < part.max() - tolerance) | (samples > part.min() + tolerance)
        before, behind = np.flatnonzero(outside[:begin]), np.flatnonzero(outside[end:])
        first = int(before[-1]) + 1 if len(before) else 0
        after = end + int(behind[0]) if len(behind) else len(samples)
        level = float(median(samples[first:after]))
        yield _Rest(first, after, level, digit, tolerance)
