"""Scales of the equations and of the coordinates, found from the data and the stiffness.

Everything after it is free of units: a row divided by its scale, a coordinate by its own, are
numbers about one, whatever units they were written in.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.record import Complexes, Floats


@dataclass(frozen=True)
class Scales:
    """Typical size of each equation's terms and of each coordinate."""

    rows: Floats
    coordinates: Floats


def find_scales(
    stiffness: Complexes, forces: Complexes, sensors: Floats, readings: Complexes
) -> Scales:
    """Fit ``|Z_rc| ~ row_r / coordinate_c`` in the logarithms, tied to what was measured.

    The tie: rows with a force are as large as the force, and a coordinate that a sensor reads by
    itself is as large as its reading. The fit follows every change of units exactly.
    """
    rows, coordinates = stiffness.shape[1:]
    size = np.sqrt((np.abs(stiffness) ** 2).mean(axis=0))
    r, c = np.nonzero(size)
    unknowns, equations, values = rows + coordinates, [], []
    fit = np.zeros((len(r), unknowns))
    fit[np.arange(len(r)), r] = 1.0
    fit[np.arange(len(r)), rows + c] = -1.0
    equations.append(fit)
    values.append(np.log(size[r, c]))
    single = [(s, row.nonzero()[0][0]) for s, row in enumerate(sensors) if (row != 0).sum() == 1]
    tied = [(k, amount) for k, amount in enumerate(_rms(forces)) if amount > 0]
    amounts = _rms(readings)
    for s, coordinate in single:
        if amounts[s] > 0:
            tied.append((rows + coordinate, amounts[s] / abs(sensors[s, coordinate])))
    tie = np.zeros((len(tied), unknowns))
    for k, (unknown, amount) in enumerate(tied):
        tie[k, unknown] = 1.0
        values.append(np.array([np.log(amount)]))
    equations.append(tie)
    # The shortest solution serves what nothing ties (a rotor at rest without any force).
    logs = np.linalg.lstsq(np.concatenate(equations), np.concatenate(values), rcond=1e-10)[0]
    return Scales(np.exp(logs[:rows]), np.exp(logs[rows:]))


def _rms(lines: Complexes) -> Floats:
    return np.asarray(np.sqrt((np.abs(lines) ** 2).mean(axis=0)))
