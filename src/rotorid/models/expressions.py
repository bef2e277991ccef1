"""Expressions: sums of products of powers, and functions, with their values.

A value to compare, to show and to evaluate, in double precision or to a hundred digits. Its algebra
is done before, by `parser`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache, cached_property
from math import prod
from typing import Any, TypeVar

import numpy as np
from mpmath.ctx_mp import MPContext
from mpmath.libmp import to_rational
from numpy.typing import ArrayLike, NDArray

from rotorid.core.frozen import frozen

RESERVED = ("t", "Omega", "phi")
FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh")
Factor = tuple["Expression", int | Fraction]
Factors = TypeVar("Factors", bound=Collection["Factor"])
Monomial = tuple[int, ...]  # exponent of each parameter


@frozen
class Expression:
    """A "name", "pi", a function, or a "sum"; equal to others of the same parts.

    `parts`: a text; nothing; the argument; or pairs of the factors of a term and its coefficient.
    """

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
    def inner(self) -> tuple[Expression, ...]:
        """The argument of a function, or the bases of a sum."""
        if self.kind == "sum":
            return tuple(base for factors, _ in self.parts for base, _ in factors)
        return () if self.kind == "name" else self.parts

    @cached_property
    def nodes(self) -> int:
        """What evaluating it takes."""
        return 1 + sum(1 + part.nodes for part in self.inner)

    @cached_property
    def free_symbols(self) -> frozenset[Expression]:
        if self.kind == "name":
            return frozenset((self,))
        return frozenset[Expression]().union(*(part.free_symbols for part in self.inner))

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        if self.kind == "sum" and [c for _, c in self.parts] == [1]:
            factors: tuple[Factor, ...] = self.parts[0][0]
            return factors
        return ((self, 1),)

    @cached_property
    def _text(self) -> str:
        if self.kind == "name":
            return str(self.parts[0])
        if self.kind == "sum":
            terms = " + ".join(_term_text(*term) for term in self.parts)
            return terms.replace("+ -", "- ") or "0"
        return f"{self.kind}({self.parts[0]})" if self.parts else self.kind

    def __str__(self) -> str:
        return self._text


@cache
def symbol(name: str) -> Expression:
    """Return a name (``q'`` is a name like any other)."""
    return Expression("name", (name,))


def expression(terms: Mapping[Factors, Fraction]) -> Expression:
    """Return a sum of products of powers of different bases: the same whatever the order."""
    found = [(tuple(sorted(factors, key=_place)), c) for factors, c in terms.items()]
    found.sort(key=lambda term: (not term[0], _term_text(term[0])))
    if len(found) == 1 and found[0][1] == 1 and [n for _, n in found[0][0]] == [1]:
        return found[0][0][0][0]
    return Expression("sum", tuple(found))


def product(factors: Iterable[Factor]) -> Expression:
    return expression({tuple(factors): Fraction(1)})


def number(value: int | Fraction) -> Expression:
    return expression({(): Fraction(value)})


def is_number(value: Expression) -> bool:
    return value.kind == "sum" and not value.inner


def _place(factor: Factor) -> tuple[int, str, int | Fraction]:
    base, n = factor
    return 0 if is_number(base) else 1 if base.kind == "name" else 2, str(base), n


def _term_text(factors: Collection[Factor], coefficient: Fraction = Fraction(1)) -> str:
    above = [_power_text(base, n) for base, n in factors if n > 0]
    below = [_power_text(base, -n) for base, n in factors if n < 0]
    text = "*".join([str(coefficient)] * (coefficient != 1) + above) or "1"
    if text.startswith("-1*"):
        text = f"-{text[3:]}"
    if not below:
        return text
    return f"{text}/{below[0]}" if len(below) == 1 else f"{text}/({'*'.join(below)})"


def _power_text(base: Expression, exponent: int | Fraction) -> str:
    text = str(base)
    if exponent == Fraction(1, 2):
        return f"sqrt({text})"
    if base.kind == "sum":
        text = f"({text})"
    if exponent == 1:
        return text
    return f"{text}**{exponent}" if exponent.denominator == 1 else f"{text}**({exponent})"


Real = Any  # a number of a hundred digits; mpmath carries no types
_EXACT = MPContext()
_EXACT.dps = 100
TOLERANCE = _EXACT.mpf("1e-40")  # what is left of a sum of zero, or of a dependent column
_LARGE = _EXACT.mpf("1e30")  # argument of a function, beyond which it takes as many more digits
_OF_ANY_SIZE = ("sum", "pi", "abs", "sign")
_MAGNITUDE = 10_000  # binary exponent of a value that is computed with
MAX_VALUE = 1e100


class _Values(dict[Expression, Any]):
    """Values of expressions in double precision, from those of the names, each computed once."""

    space: Any = np
    real: Any = np.float64

    def __missing__(self, value: Expression) -> Any:
        self[value] = found = self.value_of(value)
        return found

    def value_of(self, value: Expression) -> Any:
        if value.kind == "pi":
            return +self.space.pi
        if value.kind != "sum":
            name = "fabs" if value.kind == "abs" else value.kind
            return getattr(self.space, name)(self[value.parts[0]])
        terms = (prod(map(self.power, factors), start=self.real(c)) for factors, c in value.parts)
        return sum(terms, start=self.real(0))

    def power(self, factor: Factor) -> Any:
        base, n = factor
        return self[base] ** (int(n) if n.denominator == 1 else self.real(n))


class _ExactValues(_Values):
    """Values to a hundred digits; ValueError where one is not real, or too large."""

    space = _EXACT
    real = staticmethod(_EXACT.convert)

    def value_of(self, value: Expression) -> Any:
        if value.kind not in _OF_ANY_SIZE and abs(self[value.parts[0]]) > _LARGE:
            raise ValueError("too large an argument")
        found = super().value_of(value)
        if not isinstance(found, _EXACT.mpf) or not (
            found == 0 or (_EXACT.isfinite(found) and abs(_EXACT.mag(found)) < _MAGNITUDE)
        ):
            raise ValueError("no real number of a size to compute with")
        return found


def evaluate(
    value: Expression,
    arrays: Mapping[str, ArrayLike],
    known: Mapping[Expression, ArrayLike] | None = None,
) -> NDArray[np.float64]:
    """Return the value on arrays that broadcast; infinite or NaN without a warning.

    `known` parts of it are not computed.
    """
    names = {symbol(name): array for name, array in arrays.items()} | dict(known or {})
    values = {part: np.asarray(array, dtype=float) for part, array in names.items()}
    with np.errstate(all="ignore"):
        return np.asarray(_Values(values)[value])


def is_usable(value: ArrayLike) -> bool:
    return bool((np.abs(value) < MAX_VALUE).all())


def values_at(point: Mapping[str, Fraction], signals: Sequence[Expression]) -> list[Real] | None:
    """Return values to a hundred digits; None at a pole, and where one is not real or too large."""
    values = _ExactValues({symbol(name): _EXACT.convert(at) for name, at in point.items()})
    try:
        return [values[signal] for signal in signals]
    except (ArithmeticError, ValueError):
        return None


def simple_fraction(value: Real) -> Fraction | None:
    exact = Fraction(*map(int, to_rational(value._mpf_)))
    simple = exact.limit_denominator(10**6)
    return simple if abs(exact - simple) < Fraction(1, 10**30) else None
