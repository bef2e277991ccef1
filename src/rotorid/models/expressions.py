"""Expressions: signals as products, sums, powers and functions, and their values.

A value to compare, to show and to evaluate. Its algebra is done before: by `polynomials`
where these do, else by sympy in `symbolic`, which takes longer to load than most records take to
identify.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotorid.core.frozen import frozen

RESERVED = ("t", "Omega", "phi")
FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh")
_RANK = {"number": 0, "name": 1}  # in a product
MAX_TERMS = 5_000
MAX_EXPONENT = 280  # decimal exponent of a number
Factor = tuple["Expression", Fraction]
Monomial = tuple[int, ...]  # exponent of each parameter
Terms = dict[tuple[Monomial, "Expression"], Fraction]


@frozen
class Expression:
    """What `kind` says of `parts`.

    A name holds its text, a number its fraction, a power its base and its exponent (a fraction);
    sums, products and functions hold expressions.
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
    def free_symbols(self) -> frozenset[Expression]:
        if self.kind == "name":
            return frozenset((self,))
        inner = (part for part in self.parts if isinstance(part, Expression))
        return frozenset[Expression]().union(*(part.free_symbols for part in inner))

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """Bases and exponents that it is the product of."""
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


MAX_VALUE = 1e100
_NUMERIC: dict[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "cot": lambda x: 1 / np.tan(x),
    "sec": lambda x: 1 / np.cos(x),
    "csc": lambda x: 1 / np.sin(x),
    "exp": np.exp,
    "abs": np.abs,
    "sign": np.sign,
    "tanh": np.tanh,
    "coth": lambda x: 1 / np.tanh(x),
}


def evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    """Return the value of an expression on arrays that broadcast.

    It is infinite or NaN, without a warning, where the expression has no finite value.
    """
    with np.errstate(all="ignore"):
        return _evaluate(value, arrays)


def _evaluate(value: Expression, arrays: Mapping[str, ArrayLike]) -> NDArray[np.float64]:
    if value.kind == "name":
        return np.asarray(arrays[value.parts[0]], dtype=float)
    if value.kind == "number":
        return np.asarray(float(value.parts[0]))
    if value.kind == "pi":
        return np.asarray(np.pi)
    if value.kind == "power":
        base, exponent = value.parts
        whole = exponent.denominator == 1
        return np.asarray(_evaluate(base, arrays) ** (int(exponent) if whole else float(exponent)))
    inner = [_evaluate(part, arrays) for part in value.parts]
    if value.kind == "sum":
        return np.asarray(sum(inner[1:], start=inner[0]))
    if value.kind == "product":
        return np.asarray(np.prod(np.broadcast_arrays(*inner), axis=0))
    return np.asarray(_NUMERIC[value.kind](inner[0]))


def is_usable(value: ArrayLike) -> bool:
    return bool((np.abs(value) < MAX_VALUE).all())
