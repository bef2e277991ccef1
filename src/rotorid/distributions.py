"""Tails of distributions, by scipy.special: scipy.stats takes longer to load than they to use.

scipy loads its parts where they are first used: a record that calls for none of these waits for
none.
"""

from __future__ import annotations

import math

import scipy


def gamma_tail(value: float, shape: float) -> float:
    """Return the chance that a gamma variable of unit scale exceeds a value."""
    return float(scipy.special.gammaincc(shape, value))


def f_tail(value: float, first: float, second: float) -> float:
    """Return the chance that F with these degrees of freedom exceeds a value."""
    return float(scipy.special.fdtrc(first, second, value))


def f_limit(chance: float, first: float, second: float) -> float:
    """Return what F with these degrees of freedom exceeds with a chance, however small."""
    if first == 2:  # the tail is (1 + 2 F / second)^(- second / 2)
        return second / 2 * math.expm1(-2 / second * math.log(chance))
    # fdtri takes 1 - chance, and rounds.
    share = scipy.special.betaincinv(second / 2, first / 2, chance)
    return float(second / first * (1 - share) / share)
