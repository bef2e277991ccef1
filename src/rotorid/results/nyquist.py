"""Whether a loop is stable: its poles counted on the right, from ``det(I + L)`` over the lines.

The closed loop's poles are the zeros of ``D = det(I + L) prod (s - p)``, p those of the plant. From
infinity, where all ``s - p`` point the same way and L is nothing, down to 0 the angle of D comes
back to where it began if no zero lies on the right; each one there adds pi, and each pole of the
controller at 0 (an integrator) takes pi/2: the slope of the size of D at the first lines tells how
many there are. Of poles of the controller on the right nothing is known: it is taken as stable.
"""

from __future__ import annotations

import numpy as np
import scipy

from rotorid.record import Complexes, Floats

COARSE = np.deg2rad(100.0)
"""Turn of D from line to line from which on its sense is not told: a pole passes between them."""
QUIET = 0.8
"""Gain at the last line (the largest eigenvalue of L) above which the loop still acts beyond it."""
WHOLE = 0.3
"""Distance from a whole number of poles above which the first line lies too high to tell."""
AXIS = 1e-9
"""Share of its size by which a plant's pole left or right of the axis is on it: rounding."""


def plant_poles(
    stiffness: Floats | Complexes, damping: Floats | Complexes, mass: Floats | Complexes
) -> Complexes:
    """Return the finite roots of ``det(s^2 M + s D + K)``."""
    n = len(mass)
    zero, one = np.zeros((n, n)), np.eye(n)
    left = np.block([[zero, one], [-stiffness, -damping]])
    right = np.block([[one, zero], [zero, mass]])
    alpha, beta = scipy.linalg.eigvals(left, right, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-12 * np.hypot(np.abs(alpha), np.abs(beta))
    return np.asarray(alpha[finite] / beta[finite])


def poles_on_the_right(omega: Floats, returned: Complexes, poles: Complexes) -> int | str:
    """Return how many poles of the closed loop are unstable, or why the lines do not tell.

    Parameters
    ----------
    omega : array, shape (line,)
        rad/s, rising.
    returned : complex array, shape (line, loop, loop)
        ``I + L``.
    poles : complex array, shape (pole,)
        Of the plant.
    """
    kept = omega > 0
    omega, returned = omega[kept], returned[kept]
    away = 1j * omega[:, None] - poles
    if len(omega) < 2 or not np.isfinite(returned).all() or not away.all():
        return "its lines are too few, or one is on a pole of the plant"
    gain = np.abs(np.linalg.eigvals(returned[-1] - np.eye(returned.shape[1]))).max()
    if gain > QUIET:
        return "the loop still acts at its end: widen the band"
    difference = np.linalg.det(returned)
    ratio = difference[1:] / difference[:-1] * np.prod(_unit(away[1:]) / _unit(away[:-1]), axis=1)
    turns = np.angle(ratio)
    if np.abs(turns).max() > COARSE:
        return "the lines are too far apart: take them closer"
    angle = np.angle(difference[-1]) + _from_above(away[-1]).sum() - turns.sum()
    first, second = (np.log(abs(difference[k])) + np.log(np.abs(away[k])).sum() for k in (0, 1))
    order = (first - second) / np.log(omega[1] / omega[0])  # of a pole at 0, where there is one
    count = float(angle / np.pi + order / 2)
    whole = round(count)
    if abs(count - whole) > WHOLE or whole < 0:
        return "begin the band lower"
    return whole


def _unit(values: Complexes) -> Complexes:
    return np.asarray(values / np.abs(values))


def _from_above(away: Complexes) -> Floats:
    """Return the angles of ``i omega - p``, followed from a quarter turn at infinity."""
    right = away.real < -AXIS * np.abs(away)  # of a pole on the right: past half a turn
    angle = np.angle(np.where(np.abs(away.real) < AXIS * np.abs(away), 1j * away.imag, away))
    return np.asarray(np.where(right, np.mod(angle, 2 * np.pi), angle))
