"""Medians, tails of distributions, and what noise makes of a cost; scipy loads its parts late."""

from __future__ import annotations

import math

import numpy as np
import scipy

from rotorid.core.values import Floats, frozen

HALF_WIDTH = 1.959964
"""Deviations to either side that hold 95 % of a normal distribution."""


def median(values: Floats, axis: int = -1) -> Floats:
    """Return the median by sorting, fast for short rows; numpy's loads masked arrays first."""
    ordered = np.sort(np.moveaxis(values, axis, -1), axis=-1)
    middle = ordered.shape[-1] // 2
    if ordered.shape[-1] % 2:
        return np.asarray(ordered[..., middle])
    return np.asarray((ordered[..., middle - 1] + ordered[..., middle]) / 2)


def f_limit(chance: float, first: float, second: float) -> float:
    """Return what F with these degrees of freedom exceeds with a chance, however small."""
    if first == 2:  # the tail is (1 + 2 F / second)^(- second / 2)
        return second / 2 * math.expm1(-2 / second * math.log(chance))
    # fdtri takes 1 - chance, and rounds.
    share = scipy.special.betaincinv(second / 2, first / 2, chance)
    return float(second / first * (1 - share) / share)


def chance_of_any(chance: float, correlation: Floats) -> float:
    """Return a bound on that any of n normal variables is as far out as one alone is by a chance.

    ``n chance`` less the chance of both of each pair in a tree that joins them all, that of the
    largest correlations (Worsley 1982). Two of correlation r are both above t with the chance
    ``Phi(-t) - 2 T(t, sqrt((1 - r) / (1 + r)))``, T of Owen, and of -r on opposite sides.
    """
    alike = np.minimum(np.abs(correlation), 1 - 1e-12)
    tree = scipy.sparse.csgraph.minimum_spanning_tree(np.triu(2 - alike, 1))
    r = np.outer([1, -1], 2 - tree.data)
    level = -scipy.special.ndtri(chance / 2)
    both = chance / 2 - 2 * scipy.special.owens_t(level, np.sqrt((1 - r) / (1 + r)))
    return float(len(alike) * chance - 2 * both.sum())


def bound_of_length(mean: Floats, covariance: Floats, chance: float) -> float:
    """Return what the length of a normal vector, (2,), stays below with a chance."""
    size, axes = np.linalg.eigh(covariance)
    narrow, wide = np.sqrt(np.clip(size, 0.0, None))
    if wide == 0:
        return float(np.hypot(*mean))
    across, along = axes.T @ mean
    nodes, weights = np.polynomial.legendre.leggauss(NODES)

    def inside(radius: float) -> float:
        low, high = (max(-radius, along - 9 * wide), min(radius, along + 9 * wide))
        if low >= high:
            return -chance
        x = (low + high) / 2 + (high - low) / 2 * nodes
        half = np.sqrt(np.clip(radius**2 - x**2, 0.0, None))
        if narrow > 1e-9 * wide:
            ends = [scipy.special.ndtr((s * half - across) / narrow) for s in (1, -1)]
            share = ends[0] - ends[1]
        else:
            share = (np.abs(across) <= half).astype(float)
        density = np.exp(-(((x - along) / wide) ** 2) / 2) / (wide * math.sqrt(2 * math.pi))
        return float((high - low) / 2 * (weights * density * share).sum()) - chance

    most = float(np.hypot(*mean)) + 9 * wide
    return float(scipy.optimize.brentq(inside, 0.0, most, rtol=1e-6))


NODES = 200
"""Points of the integral: right to 1e-6 down to axes of a ratio of a thousand."""


@frozen
class Expectation:
    """Mean and variance of a cost, and the chance of one at least as large."""

    mean: float
    variance: float
    dof: int

    @property
    def _freedom(self) -> tuple[float, float]:
        """The degrees of F; the second infinite, a gamma distribution, where C is known."""
        spread = self.variance / self.mean**2
        excess = spread * self.dof - 2
        if excess < 1e-9:
            return min(2 / spread, 1e15), math.inf
        return self.dof, max((2 * self.dof - 4 + 4 * spread * self.dof) / excess, 4.0 + 1e-6)

    def p_value(self, cost: float) -> float:
        if self.dof <= 0 or self.mean <= 0:
            return 1.0
        first, second = self._freedom
        if second == math.inf:
            return float(scipy.special.gammaincc(first / 2, cost / self.mean * first / 2))
        ratio = cost / self.mean * second / (second - 2)
        return float(scipy.special.fdtrc(first, second, ratio))

    def exceeded(self, chance: float) -> float:
        """Return the cost that is exceeded with a chance."""
        if self.dof <= 0 or self.mean <= 0:
            return math.inf
        first, second = self._freedom
        if second == math.inf:
            return self.mean * 2 / first * float(scipy.special.gammainccinv(first / 2, chance))
        return self.mean * f_limit(chance, first, second) * (second - 2) / second


def line_moments(left: Floats, dof: Floats, multiplicity: Floats) -> tuple[Floats, Floats]:
    t, c = np.maximum(left, 0.0), multiplicity
    a = c * t
    b = np.maximum(c * (dof - t + 1), 4.0 + 1e-3)  # fewer have no variance
    scale = dof * a / np.maximum(dof - t + 1, 1e-9)
    safe = np.maximum(a, 1e-300)
    variance = scale**2 * 2 * b**2 * (a + b - 2) / (safe * (b - 2) ** 2 * (b - 4))
    return scale * b / (b - 2), np.where(a > 0, variance, 0.0)
