"""Scales of the equations and of the coordinates, found from the data and the stiffness.

Everything after it is free of units: a row divided by its scale, a coordinate by its own, are
numbers about one, whatever units they were written in.
"""

from __future__ import annotations

import numpy as np

from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats


@frozen
class Scales:
    """Typical size of each equation's terms and of each coordinate."""

    rows: Floats
    coordinates: Floats


SEEN = 3.0
"""Size, in deviations of its noise, from which a row's force or a reading counts as a signal."""
BORROWED = 1e-3
"""Weight of a size that is borrowed: it decides only where nothing else does."""


def find_scales(
    stiffness: Complexes,
    forces: Complexes,
    sensors: Floats,
    readings: Complexes,
    force_noise: Floats | None = None,
    reading_noise: Floats | None = None,
) -> Scales:
    """Fit ``|Z_rc| ~ row_r / coordinate_c`` in the logarithms, tied to what was measured.

    The tie: rows with a force are as large as the force, and a coordinate that a sensor reads by
    itself is as large as its reading. The fit follows every change of units exactly.

    A force or a reading that does not rise above its noise, ``force_noise`` of each row and
    ``reading_noise`` of each sensor (rms over the lines), ties nothing. A row without excitation
    would else be scaled by its own noise, and be granted errors no larger than that: it would
    join the regression with a signal that is noise, whose best fit is a rotor without mass. Where
    it is all that a part of the machine has, the row is taken to be as large as the largest that
    is driven.
    """
    rows, coordinates = stiffness.shape[1:]
    top = np.abs(stiffness).max(axis=0, initial=0.0)
    shares = np.abs(stiffness) / np.where(top > 0, top, 1.0)  # squares of which cannot overflow
    size = top * np.sqrt((shares**2).mean(axis=0))
    r, c = np.nonzero(size)
    fit = np.zeros((len(r), rows + coordinates))
    fit[np.arange(len(r)), r] = 1.0
    fit[np.arange(len(r)), rows + c] = -1.0
    tied: list[tuple[int, float, float]] = []
    amounts = _rms(forces)
    noise = np.zeros(rows) if force_noise is None else force_noise
    for row in np.flatnonzero(amounts > 0).tolist():
        seen = amounts[row] > SEEN * noise[row]
        tied.append((row, amounts[row], 1.0) if seen else (row, amounts.max(), BORROWED))
    amounts = _rms(readings)
    noise = np.zeros(len(sensors)) if reading_noise is None else reading_noise
    for s, row in enumerate(sensors):
        if (row != 0).sum() == 1 and amounts[s] > SEEN * noise[s]:
            coordinate = int(row.nonzero()[0][0])
            tied.append((rows + coordinate, amounts[s] / abs(row[coordinate]), 1.0))
    tie, values = np.zeros((len(tied), rows + coordinates)), np.zeros(len(tied))
    for k, (unknown, amount, weight) in enumerate(tied):
        tie[k, unknown], values[k] = weight, weight * np.log(amount)
    # The shortest solution serves what nothing ties (a rotor at rest without any force).
    logs = np.linalg.lstsq(
        np.concatenate([fit, tie]), np.concatenate([np.log(size[r, c]), values]), rcond=1e-10
    )[0]
    return Scales(np.exp(logs[:rows]), np.exp(logs[rows:]))


def _rms(lines: Complexes) -> Floats:
    return np.asarray(np.sqrt((np.abs(lines) ** 2).mean(axis=0)))
