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
"""Lines within which it is one tone with the rotation as stated: it stands in place of that one.
Further off it is looked for beside it."""
GRID = 41
"""Places within a line of the strongest that are tried before the best is refined."""
MUCH = 4.0
"""How much less power the tone leaves in each channel, on average, at a speed other than the one
stated and less than APART from it. A speed that wanders, or a second tone, gains less than that."""


def shown_rotation(
    lines: Complexes, motion: Complexes, rotation: Complexes, standing_out: Integers, stated: float
) -> float | None:
    """Return where the lines show a rotation, in lines; None where that is as stated.

    Parameters
    ----------
    lines : complex array, shape (line, channel)
        All lines of the record from DC on.
    motion : complex array, shape (line, column)
        What motion follows there, besides the rotation.
    rotation : complex array, shape (line, column)
        What the rotation as stated puts there; no column where none is taken out.
    standing_out : int array
        Lines that noise does not explain.
    stated : float
        The rotation as stated, in lines.
    """
    distance = np.abs(standing_out - stated)
    near = standing_out[distance < NEAR * stated]
    if not len(near):
        return None
    if distance.min() < AROUND and (moved := _moved(lines, motion, stated)) is not None:
        return moved
    apart = near[np.abs(near - stated) > APART]
    if not len(apart) or apart.max() + AROUND >= len(lines):  # before them there are plenty
        return None
    strongest = int(apart[np.argmax(_strength(lines, apart))])
    return _place(lines, np.column_stack([motion, rotation]), strongest)[0]


def _moved(lines: Complexes, motion: Complexes, stated: float) -> float | None:
    """Return a place within APART of the one stated that takes up much more; None without."""
    nearest = round(stated)
    if nearest + AROUND >= len(lines):
        return None
    window = np.arange(nearest - AROUND, nearest + AROUND + 1)
    reach = APART - 1.0  # to each side; a place is looked for within a line of it
    tried = [_place(lines, motion, nearest, aside) for aside in (-reach, reach)]
    place, left = min(tried, key=lambda found: found[1])
    gain = _left(lines, motion, window, stated) - left
    near = abs(place - stated) <= APART
    return place if near and gain > np.log(MUCH) * lines.shape[1] else None


def _place(
    lines: Complexes, design: Complexes, middle: int, aside: float = 0.0
) -> tuple[float, float]:
    """Return where about a line a tone takes up most, and the logarithm of what it leaves."""
    window = np.arange(middle - AROUND, middle + AROUND + 1)

    def misfit(place: float) -> float:
        return _left(lines, design, window, place)

    places = middle + aside + np.linspace(-1, 1, GRID)
    best = places[int(np.argmin([misfit(place) for place in places]))]
    step = places[1] - places[0]
    found = scipy.optimize.minimize_scalar(
        misfit, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-5}
    )
    return float(found.x), float(found.fun)


def _left(lines: Complexes, design: Complexes, window: Integers, place: float) -> float:
    """Return the logarithm of what a tone at a place leaves, summed over the channels."""
    tone = np.where(window % 2, -1.0, 1.0) * np.sinc(window - place)
    return float(np.log(_power_left(lines[window], np.column_stack([design[window], tone]))).sum())


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
