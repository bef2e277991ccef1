"""Expressions to a hundred digits, at points where they are real."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from mpmath.ctx_mp import MPContext
from mpmath.libmp import to_rational

from rotorid.models.expression import Expression

Real = Any  # a number of a hundred digits; mpmath carries no types
_EXACT = MPContext()
_EXACT.dps = 100
TOLERANCE = _EXACT.mpf("1e-40")  # what is left of a dependent column
_LARGE = _EXACT.mpf("1e30")  # argument of a function, beyond which it takes as many more digits
_MAGNITUDE = 10_000  # binary exponent of a value that is computed with


def values_at(point: Mapping[str, Fraction], signals: Sequence[Expression]) -> list[Real] | None:
    """Return the values of signals; nothing at a pole, and where one is not real or too large."""
    values = _Point(point)
    try:
        return [values.of(signal) for signal in signals]
    except (ArithmeticError, ValueError):
        return None


class _Point:
    """The values of expressions at a point; what they share is found once."""

    def __init__(self, point: Mapping[str, Fraction]) -> None:
        self.point = {name: _real(value) for name, value in point.items()}
        self.known: dict[int, Real] = {}

    def of(self, value: Expression) -> Real:
        """Return the value; an error where it is no real number of a size to compute with."""
        if id(value) not in self.known:
            found = self._of(value)
            if not isinstance(found, _EXACT.mpf) or not _is_moderate(found):
                raise ValueError("no real number")
            self.known[id(value)] = found
        return self.known[id(value)]

    def _of(self, value: Expression) -> Real:
        if value.kind == "name":
            return self.point[value.parts[0]]
        if value.kind == "number":
            return _real(value.parts[0])
        if value.kind == "pi":
            return +_EXACT.pi
        if value.kind == "power":
            base, exponent = value.parts
            whole = exponent.denominator == 1
            return self.of(base) ** (int(exponent) if whole else _real(exponent))
        inner = [self.of(part) for part in value.parts]
        if value.kind == "sum":
            return _EXACT.fsum(inner)
        if value.kind == "product":
            return _EXACT.fprod(inner)
        if value.kind in ("abs", "sign"):
            return abs(inner[0]) if value.kind == "abs" else _EXACT.sign(inner[0])
        if abs(inner[0]) > _LARGE:
            raise ValueError("too large an argument")
        return getattr(_EXACT, value.kind)(inner[0])


def _is_moderate(found: Real) -> bool:
    if found == 0:
        return True
    return bool(_EXACT.isfinite(found) and abs(_EXACT.mag(found)) < _MAGNITUDE)


def _real(value: Fraction) -> Real:
    return _EXACT.mpf(value.numerator) / value.denominator


def near(value: Real) -> Fraction:
    """Return the simple fraction that a number is, else the number in double precision."""
    exact = Fraction(*map(int, to_rational(value._mpf_)))
    simple = exact.limit_denominator(10**6)
    if abs(exact - simple) < Fraction(1, 10**30):
        return simple
    return Fraction(repr(float(value)))
