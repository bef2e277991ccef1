"""What noise alone makes of a cost: mean, variance, and the chance of more."""

from __future__ import annotations

import numpy as np

from rotorid.distributions import f_tail, gamma_tail
from rotorid.frozen import frozen
from rotorid.record import Floats


@frozen
class Expectation:
    """Mean and variance of a cost, and the chance of one at least as large."""

    mean: float
    variance: float
    dof: int

    def p_value(self, cost: float) -> float:
        """Return the chance that noise alone gives this cost or more."""
        if self.dof <= 0 or self.mean <= 0:
            return 1.0
        spread = self.variance / self.mean**2
        excess = spread * self.dof - 2
        if excess < 1e-9:  # C is known, or holds part of what it weighs: a gamma distribution
            shape = min(2 / spread, 1e15)
            return gamma_tail(cost / self.mean * shape / 2, shape / 2)
        nu = (2 * self.dof - 4 + 4 * spread * self.dof) / excess
        if nu <= 4:
            nu = 4.0 + 1e-6
        return f_tail(cost / self.mean * nu / (nu - 2), self.dof, nu)


def line_moments(left: Floats, dof: Floats, multiplicity: Floats) -> tuple[Floats, Floats]:
    """Return mean and variance of each line's cost."""
    t, c = np.maximum(left, 0.0), multiplicity
    a = c * t
    b = np.maximum(c * (dof - t + 1), 4.0 + 1e-3)  # fewer have no variance
    scale = dof * a / np.maximum(dof - t + 1, 1e-9)
    safe = np.maximum(a, 1e-300)
    variance = scale**2 * 2 * b**2 * (a + b - 2) / (safe * (b - 2) ** 2 * (b - 4))
    return scale * b / (b - 2), np.where(a > 0, variance, 0.0)
