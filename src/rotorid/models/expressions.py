"""Expressions: signals as products, sums, powers and functions, and their values.

A value to compare, to show and to evaluate, in double precision or to a hundred digits. Its algebra
is done before, by `text`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache, cached_property
from typing import Any

import numpy as np
from mpmath.ctx_mp import MPContext
from mpmath.libmp import to_rational
from numpy.typing import ArrayLike, NDArray

from rotorid.core.frozen import frozen

RESERVED = ("t", "Omega", "phi")
FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh")
_RANK = {"number": 0, "name": 1}  # in a product
Factor = tuple["Expression", Fraction]
Monomial = tuple[int, ...]  # exponent of each parameter


@frozen
class Expression:
    """What `kind` says of `parts`: text, fraction, base and fraction (a power), or expressions."""

    kind: str
    parts: tuple[Any, ...] = ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Expression):
            return NotImplemented
        return self is other or (self.kind == other.kind and self.parts == other.parts)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        """Kept: expressions are keys, and hold others that hold others."""
        return hash((self.kind, self.parts))

    def __reduce__(self) -> tuple[type[Expression], tuple[str, tuple[Any, ...]]]:
        """Copy what it is, not what it keeps: a name is among its own free symbols."""
        return Expression, (self.kind, self.parts)

    @cached_property
    def free_symbols(self) -> frozenset[Expression]:
        if self.kind == "name":
            return frozenset((self,))
        inner = (part for part in self.parts if isinstance(part, Expression))
        return frozenset[Expression]().union(*(part.free_symbols for part in inner))

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        if self.kind == "product":
            return tuple(factor for part in self.parts for factor in part.factors)
        if self.kind == "power":
            return ((self.parts[0], self.parts[1]),)
        return () if self == ONE else ((self, Fraction(1)),)

    @cached_property
    def _text(self) -> str:
        if self.kind in ("name", "number"):
            return str(self.parts[0])
        if self.kind == "sum":
            return " + ".join(map(str, self.parts)).replace("+ -", "- ")
        if self.kind in ("product", "power"):
            return _product_text(self.factors)
        return f"{self.kind}({self.parts[0]})" if self.parts else self.kind

    def __str__(self) -> str:
        return self._text


def number(value: int | Fraction) -> Expression:
    return Expression("number", (Fraction(value),))


ONE = number(1)


@cache
def symbol(name: str) -> Expression:
    """Return a name (``q'`` is a name like any other)."""
    return Expression("name", (name,))


def product(factors: Iterable[Factor]) -> Expression:
    """Return the product of powers of different bases: the same one whatever their order."""
    ordered = sorted(factors, key=lambda f: (_RANK.get(f[0].kind, 2), str(f[0]), f[1]))
    parts = [base if n == 1 else Expression("power", (base, Fraction(n))) for base, n in ordered]
    if len(parts) < 2:
        return parts[0] if parts else ONE
    return Expression("product", tuple(parts))


def _product_text(factors: Iterable[Factor]) -> str:
    above = [_power_text(base, n) for base, n in factors if n > 0]
    below = [_power_text(base, -n) for base, n in factors if n < 0]
    text = "*".join(above) or "1"
    if text.startswith("-1*"):
        text = f"-{text[3:]}"
    if not below:
        return text
    return f"{text}/{below[0]}" if len(below) == 1 else f"{text}/({'*'.join(below)})"


def _power_text(base: Expression, exponent: Fraction) -> str:
    text = str(base)
    if exponent == Fraction(1, 2):
        return f"sqrt({text})"
    if base.kind in ("sum", "product", "power") or (base.kind == "number" and exponent != 1):
        text = f"({text})"
    if exponent == 1:
        return text
    return f"{text}**{exponent}" if exponent.denominator == 1 else f"{text}**({exponent})"


Real = Any  # a number of a hundred digits; mpmath carries no types
_EXACT = MPContext()
_EXACT.dps = 100
TOLERANCE = _EXACT.mpf("1e-40")
"""What is left of a sum that is zero, and of a column that depends on others."""
_LARGE = _EXACT.mpf("1e30")  # argument of a function, beyond which it takes as many more digits
_MAGNITUDE = 10_000  # binary exponent of a value that is computed with
MAX_VALUE = 1e100


def evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Return the value on arrays that broadcast; infinite or NaN without a warning."""

    def of(value: Expression) -> NDArray[np.float64]:
        if value.kind == "name":
            return np.asarray(arrays[value.parts[0]], dtype=float)
        if value.kind in ("number", "pi"):
            return np.asarray(float(value.parts[0]) if value.parts else np.pi)
        if value.kind == "power":
            base, exponent = value.parts
            whole = exponent.denominator == 1
            return np.asarray(of(base) ** (int(exponent) if whole else float(exponent)))
        inner = [of(part) for part in value.parts]
        if value.kind == "sum":
            return np.asarray(sum(inner[1:], start=inner[0]))
        if value.kind == "product":
            return np.asarray(np.prod(np.broadcast_arrays(*inner), axis=0))
        function: Callable[..., Any] = getattr(np, value.kind)
        return np.asarray(function(inner[0]))

    with np.errstate(all="ignore"):
        return of(value)


def is_usable(value: ArrayLike) -> bool:
    return bool((np.abs(value) < MAX_VALUE).all())


def values_at(point: Mapping[str, Fraction], signals: Sequence[Expression]) -> list[Real] | None:
    """Return values to a hundred digits; None at a pole, and where one is not real or too large."""
    known: dict[int, Real] = {}

    def of(value: Expression) -> Real:
        if id(value) not in known:
            found = known[id(value)] = _exactly(value, point, of)
            if not isinstance(found, _EXACT.mpf) or not (
                found == 0 or (_EXACT.isfinite(found) and abs(_EXACT.mag(found)) < _MAGNITUDE)
            ):
                raise ValueError("no real number of a size to compute with")
        return known[id(value)]

    try:
        return [of(signal) for signal in signals]
    except (ArithmeticError, ValueError):
        return None


def _exactly(
    value: Expression, point: Mapping[str, Fraction], of: Callable[[Expression], Real]
) -> Real:
    if value.kind == "name":
        return _real(point[value.parts[0]])
    if value.kind in ("number", "pi"):
        return _real(value.parts[0]) if value.parts else +_EXACT.pi
    if value.kind == "power":
        base, exponent = value.parts
        return of(base) ** (int(exponent) if exponent.denominator == 1 else _real(exponent))
    inner = [of(part) for part in value.parts]
    if value.kind in ("sum", "product"):
        return _EXACT.fsum(inner) if value.kind == "sum" else _EXACT.fprod(inner)
    if value.kind in ("abs", "sign"):
        return abs(inner[0]) if value.kind == "abs" else _EXACT.sign(inner[0])
    if abs(inner[0]) > _LARGE:
        raise ValueError("too large an argument")
    return getattr(_EXACT, value.kind)(inner[0])


def _real(value: Fraction) -> Real:
    return _EXACT.mpf(value.numerator) / value.denominator


def simple_fraction(value: Real) -> Fraction | None:
    exact = Fraction(*map(int, to_rational(value._mpf_)))
    simple = exact.limit_denominator(10**6)
    return simple if abs(exact - simple) < Fraction(1, 10**30) else None
