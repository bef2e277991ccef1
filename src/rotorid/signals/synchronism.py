"""Does the rotor turn with the excitation? What it costs where it does not."""

from __future__ import annotations

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Floats, PeriodicRecord
from rotorid.steady import Steady, unread

_FITTED = 1 << 17  # samples from which the speed is fitted: more tell nothing new
_BLOCK = 1 << 16  # samples at once, so that memory does not grow with the record
NOTICED = 1e-3
"""Part of the unbalance lost, or leaked into a line, from which on it is worth a warning."""


@frozen
class Synchronism:
    """How well the rotation fits the periods of the excitation.

    Parameters
    ----------
    turns : float
        Mean revolutions per period.
    slip : float
        Angle in rad by which the rotation gains on the nearest whole number of turns, over all
        periods.
    drift : float
        Change of the speed in rad/s over the record, by regression.
    loss : float
        Part of the unbalance's line that averaging over the periods loses.
    leakage : array, shape (line,)
        Size of exp(i phi) on each kept line; 1 where all of it is, the line of the rotation
        itself set to 0.
    """

    turns: float
    slip: float
    drift: float
    loss: float
    leakage: Floats


def synchronism(periods: PeriodicRecord) -> Synchronism:
    """Compare the rotor angle with the periods.

    Notes
    -----
    The columns of the unbalance are averaged and filtered as the data are, from the measured
    angle, so they lose the same part. What remains is the answer of the rotor to the part that
    leaks, which is not periodic: an error of about the leakage times the amplification there.
    """
    angle, time = unread(periods, "angle"), unread(periods, "time")
    if isinstance(angle, Steady) and isinstance(time, Steady):
        return _of_one_speed(periods, angle.slope)
    return _measured(periods)


def _of_one_speed(periods: PeriodicRecord, speed: float) -> Synchronism:
    """Return it for a constant speed: the sums over periods and over samples are apart."""
    omega0, count = 2 * np.pi * periods.fundamental, periods.periods
    turns = speed / omega0
    nearest = round(turns)
    gains = speed - omega0 * np.array([*periods.harmonics, nearest])
    place = np.arange(periods.samples) / periods.sample_rate
    begin = np.arange(count) / periods.fundamental
    means = [np.exp(1j * np.multiply.outer(t, gains)).mean(axis=0) for t in (begin, place)]
    length = (count * periods.samples - 1) / periods.sample_rate
    return _told(periods, turns, length, 0.0, np.abs(means[0] * means[1]))


def _measured(periods: PeriodicRecord) -> Synchronism:
    """Return it for a measured angle: its line in every period."""
    angle, time = periods.angle.reshape(-1), periods.time.reshape(-1)
    omega0 = 2 * np.pi * periods.fundamental
    some = slice(None, None, max(1, len(time) // _FITTED))
    middle, centre = time.mean(), angle.mean()
    speed = np.polynomial.polynomial.polyfit(time[some] - middle, angle[some] - centre, 2)
    turns = float(speed[1] / omega0)
    orders = np.array([*periods.harmonics, round(turns)])
    within = 2 * np.pi * np.multiply.outer(np.arange(periods.samples), orders) / periods.samples
    waves = np.exp(-1j * within)
    starts = np.exp(-1j * omega0 * np.multiply.outer(periods.time[:, 0], orders))
    sums = np.zeros(len(orders), dtype=complex)
    step = max(1, _BLOCK // periods.samples)
    for begin in range(0, periods.periods, step):
        part = slice(begin, begin + step)
        sums += (starts[part] * (np.exp(1j * periods.angle[part]) @ waves)).sum(axis=0)
    length = float(time[-1] - time[0])
    return _told(periods, turns, length, float(speed[2]), np.abs(sums / len(time)))


def _told(
    periods: PeriodicRecord, turns: float, length: float, bend: float, sizes: Floats
) -> Synchronism:
    """Return what is told of a rotation, from its sizes on the kept lines and, last, its own."""
    nearest = round(turns)
    *kept, own = sizes
    return Synchronism(
        turns=turns,
        slip=(turns - nearest) * 2 * np.pi * periods.fundamental * length,
        drift=2 * bend * length,
        loss=float(1 - own),
        leakage=np.where(periods.harmonics == nearest, 0.0, kept),
    )


def rotation_warnings(periods: PeriodicRecord) -> tuple[str, ...]:
    """Return warnings, with numbers, where the rotation does not fit the periods."""
    if periods.speed == 0:
        return ()
    found = synchronism(periods)
    worst = int(np.argmax(found.leakage))
    if found.loss < NOTICED and found.leakage[worst] < NOTICED:
        return ()
    line = periods.frequency[worst]
    return (
        f"the rotation is not synchronous with the excitation: {found.turns:.6g} revolutions per "
        f"period, {np.degrees(found.slip):.3g} degrees off over {periods.periods} periods, the "
        f"speed changing by {abs(found.drift) / (2 * np.pi) * 60:.3g} rpm; the line of the "
        f"unbalance loses {100 * found.loss:.2g} % and leaks up to "
        f"{100 * found.leakage[worst]:.2g} % into the line at {line:g} Hz",
    )
