"""Does the rotor turn with the excitation? What it costs where it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.record import Floats, PeriodicRecord

_FITTED = 1 << 17  # samples from which the speed is fitted: more tell nothing new
_BLOCK = 1 << 16  # samples at once, so that memory does not grow with the record
NOTICED = 1e-3
"""Part of the unbalance lost, or leaked into a line, from which on it is worth a warning."""


@dataclass(frozen=True)
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
    angle, time = periods.angle.reshape(-1), periods.time.reshape(-1)
    omega0 = 2 * np.pi * periods.fundamental
    some = slice(None, None, max(1, len(time) // _FITTED))
    middle, centre = time.mean(), angle.mean()
    speed = np.polynomial.polynomial.polyfit(time[some] - middle, angle[some] - centre, 2)
    turns = speed[1] / omega0
    nearest = round(turns)
    orders = np.array([*periods.harmonics, nearest])
    within = 2 * np.pi * np.multiply.outer(np.arange(periods.samples), orders) / periods.samples
    waves = np.exp(-1j * within)
    starts = np.exp(-1j * omega0 * np.multiply.outer(periods.time[:, 0], orders))
    sums = np.zeros(len(orders), dtype=complex)
    step = max(1, _BLOCK // periods.samples)
    for begin in range(0, periods.periods, step):
        part = slice(begin, begin + step)
        sums += (starts[part] * (np.exp(1j * periods.angle[part]) @ waves)).sum(axis=0)
    *kept, own = np.abs(sums / len(time))
    return Synchronism(
        turns=float(turns),
        slip=float((turns - nearest) * omega0 * (time[-1] - time[0])),
        drift=float(2 * speed[2] * (time[-1] - time[0])),
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
