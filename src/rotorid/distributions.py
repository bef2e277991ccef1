"""Tails of distributions, by scipy.special: scipy.stats takes longer to load than they to use."""

from __future__ import annotations

from scipy import special


def gamma_tail(value: float, shape: float) -> float:
    """Return the chance that a gamma variable of unit scale exceeds a value."""
    return float(special.gammaincc(shape, value))


def f_tail(value: float, first: float, second: float) -> float:
    """Return the chance that F with these degrees of freedom exceeds a value."""
    return float(special.fdtrc(first, second, value))


def f_limit(chance: float, first: float, second: float) -> float:
    """Return what F with these degrees of freedom exceeds with a chance, however small."""
    share = special.betaincinv(second / 2, first / 2, chance)  # fdtri takes 1 - chance, and rounds
    return float(second / first * (1 - share) / share)
