"""The transient at the start of a record: how long it lasts, on the lines that count."""

from __future__ import annotations

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, PeriodicRecord
from rotorid.signals.sums import median, quartiles

LEAST_PERIODS = 8
"""Periods below which a transient cannot be told from the scatter."""

_ROUNDING = 1e-9
_DRIFT, _LARGE = 4.0, 3.0
_DECAYS = 10.0
"""Ratio of the power at the begin and at the end of the first half from which on it dies away: what
is left of a transient as long as half the record; samples lost in its middle leave one level."""
_SLOPE = 15.0
"""Square of the slope over its own from which on the second half drifts: of one line chance makes
it so once in three million."""


@frozen
class Settling:
    """The transient at the start of a record.

    Parameters
    ----------
    periods : int
        Whole periods from the start that it disturbs.
    drop : float
        Time in s to drop: as long again, in which the transient sinks below the scatter of the
        mean.
    excess : float
        Root mean square of the deviation of these periods from the settled ones, over all lines
        and channels, in units of the scatter between the settled ones; 0 where there is none.
    relative : float
        Their largest deviation, as a part of the channel's line spectrum.
    """

    periods: int
    drop: float
    excess: float
    relative: float

    @property
    def told(self) -> str:
        """What a warning says of it first."""
        lasts = "period" if self.periods == 1 else f"{self.periods} periods"
        return (
            f"a transient in the first {lasts}, {self.excess:.3g} times the scatter of the later "
            "ones"
        )


NONE = Settling(0, 0.0, 0.0, 0.0)
"""No transient."""


def detect_settling(periods: PeriodicRecord) -> Settling:
    """Find the periods at the start that are not like those of the second half.

    Of each period, d = the mean over lines and channels of |z - z_settled|^2 / s^2, with z_settled
    and s the mean and the scatter over the second half; a transient lasts until d stays below what
    chance explains. It is looked for on the kept lines only: elsewhere it does no harm.
    """
    count = periods.periods
    if count < LEAST_PERIODS:
        return NONE
    deviation, size = _deviation(periods.spectra)
    d = (deviation**2).mean(axis=1)
    # Against differences of neighbours the second half has d = 1; a drift in it makes it large.
    drifts = median(d[count // 2 :]) > _DRIFT
    last = 0 if drifts else _last_unsettled(d, deviation.shape[1])
    if last == 0:
        return NONE
    return Settling(
        periods=last,
        drop=min(2 * last, count // 2) / periods.fundamental,
        excess=float(np.sqrt(d[:last].mean())),
        relative=float(size[:last].max()),
    )


def _deviation(spectra: Complexes) -> tuple[Floats, Floats]:
    """Return each period's deviation from the second half: over its scatter, and relative."""
    count = len(spectra)
    spectra = _without_drift(spectra)
    settled = spectra[count // 2 :]
    mean = settled.mean(axis=0)
    channel = np.sqrt((np.abs(mean) ** 2).mean(axis=0))
    # A drift that is left in the second half is no scatter: differences of neighbours hold less.
    scatter = np.sqrt((np.abs(np.diff(settled, axis=0)) ** 2).mean(axis=0) / 2)
    pooled = np.sqrt((scatter**2).mean(axis=0))
    level = np.sqrt((np.abs(spectra) ** 2).mean(axis=(0, 1)))  # a channel that stops has none late
    floor = np.maximum(pooled, np.maximum(_ROUNDING * np.maximum(channel, level), 1e-300))
    moved = np.abs(spectra - mean)
    relative = moved / np.where(channel > 0, channel, np.inf)
    return (moved / floor).reshape(count, -1), relative.reshape(count, -1).max(axis=1)


def _without_drift(spectra: Complexes) -> Complexes:
    """Take off the straight line through the second half, where there is more than noise in it."""
    count = len(spectra)
    settled = spectra[count // 2 :]
    place = np.arange(count) - count // 2 - (len(settled) - 1) / 2
    late = place[count // 2 :]
    slope = np.einsum("p,pkc->kc", late, settled) / (late @ late)
    noise = (np.abs(np.diff(settled, axis=0)) ** 2).mean(axis=0) / 2
    strength = (np.abs(slope) ** 2 * (late @ late)).mean(axis=0)
    drifting = strength > _SLOPE * noise.mean(axis=0)
    return spectra - place[:, None, None] * np.where(drifting, slope, 0.0)


def _last_unsettled(d: Floats, terms: int) -> int:
    """Return the number of periods at the start that are beyond chance.

    What chance explains: the median over the settled half and five times its spread, which is
    known from the quartiles. The transient ends where two successive periods are settled. One
    that begins below three times the scatter biases no mean by more than its deviation.
    """
    half = len(d) // 2
    low, middle, high = quartiles(d[half:])
    if d[0] <= _LARGE**2 * middle:
        return 0
    late = d > middle + 5 * max((high - low) / 1.35, 1 / np.sqrt(terms))
    ends = np.flatnonzero(~late[:half] & ~late[1 : half + 1])
    if ends.size:
        return int(ends[0])
    # Longer than half the record: what dies away, not what was another level and stepped.
    begin, end = median(d[: half // 4]), median(d[half - half // 4 : half])
    return half if begin > _DECAYS * end else 0
