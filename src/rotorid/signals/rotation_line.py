"""The rotation that the lines of a whole record show, where it is not the one that is stated.

A tone of frequency f leaves ``(-1)^k sinc(k - f T)`` on line k of a record of length T, to a factor
that all lines have in common. It is fitted beside what references and a transient make of the
lines around, and f is where it takes up most.
"""

from __future__ import annotations

import numpy as np
import scipy

from rotorid.record import Complexes, Floats, Integers
from rotorid.signals.checks_rotation import NEAR

AROUND = 12
"""Lines on each side of the strongest that tell where the tone stands."""
APART = 1.5
"""Lines between it and the rotation as stated, at least: nearer, that one takes it up."""
GRID = 41
"""Places within a line of the strongest that are tried before the best is refined."""


def shown_rotation(
    lines: Complexes, design: Complexes, standing_out: Integers, stated: float
) -> float | None:
    """Return where the lines show a rotation, in lines; None where that is as stated.

    Parameters
    ----------
    lines : complex array, shape (line, channel)
        All lines of the record from DC on.
    design : complex array, shape (line, column)
        What motion follows there, besides the rotation.
    standing_out : int array
        Lines that noise does not explain.
    stated : float
        The rotation as stated, in lines.
    """
    distance = np.abs(standing_out - stated)
    near = standing_out[(distance < NEAR * stated) & (distance > APART)]
    if not len(near):
        return None
    if near.max() + AROUND >= len(lines):  # before them there are plenty
        return None
    strongest = int(near[np.argmax(_strength(lines, near))])
    window = np.arange(strongest - AROUND, strongest + AROUND + 1)

    def misfit(place: float) -> float:
        tone = np.where(window % 2, -1.0, 1.0) * np.sinc(window - place)
        columns = np.column_stack([design[window], tone])
        return float(np.log(_power_left(lines[window], columns)).sum())

    places = strongest + np.linspace(-1, 1, GRID)
    best = places[int(np.argmin([misfit(place) for place in places]))]
    step = places[1] - places[0]
    found = scipy.optimize.minimize_scalar(
        misfit, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-5}
    )
    return float(found.x)


def _strength(lines: Complexes, near: Integers) -> Floats:
    """Return the power of lines over that of those around, of all channels together."""
    around = np.arange(near.min() - AROUND, near.max() + AROUND + 1)
    usual = np.median(np.abs(lines[around]) ** 2, axis=0)
    return np.asarray((np.abs(lines[near]) ** 2 / np.where(usual > 0, usual, np.inf)).sum(axis=1))


def _power_left(lines: Complexes, columns: Complexes) -> Floats:
    """Return what columns leave of each channel, (channel,)."""
    size = np.sqrt((np.abs(columns) ** 2).sum(axis=0))
    basis, _ = np.linalg.qr(columns / np.where(size > 0, size, 1.0))
    left = lines - basis @ (basis.conj().T @ lines)
    power = (np.abs(left) ** 2).sum(axis=0)
    return np.asarray(np.maximum(power, 1e-300))
