"""What the texts of a model may cost: counted before it is spent, and by no clock.

A text of two hundred characters can ask an algebra for years. Its cost is counted in units while
it is read, the same on every machine; a model that costs more than `WORK` is refused.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction

from rotorid.core.errors import ModelError

WORK = 500_000
"""Units of up to 4 us that all texts of a model may cost together: two seconds. A model of a
hundred coordinates and 1,200 terms costs 12,000, with a tanh and a cube in each equation 430,000;
the shipped ones cost below 1,000."""

COMBINATION = 20_000
"""Units for what a sensor reads, or a constraint: 0.1 s, since an experiment may hold hundreds."""

PRODUCT = 2
"""Units for two terms that are multiplied without the algebra."""

NODE = 20
"""Units for a name, a number or an operator in the algebra: 0.08 ms."""

FUNCTION = 400
"""Units for a function, a root or a divisor there, whose argument is brought to a normal form:
1.5 ms."""

TERM = 70
"""Units for a term of what the algebra expands: 0.3 ms."""

EVALUATED = 20
"""Units for a node of what is evaluated to tell whether it is zero."""

NESTED = 8
"""Functions and roots inside each other: the algebra's time doubles with each, and equations of
motion have two or three."""

DIGITS = 1_000
"""Of a numerator or denominator: more than any product of measured numbers needs, far below
where arithmetic with them takes time."""

EXACT_BITS = 400
"""Of a fraction, from which exact elimination takes more than a unit for each entry."""

_BITS = DIGITS * 10 // 3
_left: ContextVar[list[int] | None] = ContextVar("left", default=None)


@contextmanager
def bounded(work: int | None = None) -> Iterator[None]:
    """Bound what the texts that are read meanwhile cost together; the outermost bound holds."""
    if _left.get() is not None:
        yield
        return
    units = WORK if work is None else work
    token = _left.set([units, units])
    try:
        yield
    finally:
        _left.reset(token)


def spend(units: int) -> None:
    """Count what is to be done next; refuse what is too much."""
    left = _left.get()
    if left is None:
        return
    left[0] -= units
    if left[0] < 0:
        raise ModelError(
            f"equations that take more than {left[1]:,} steps to expand",
            "sums and products of a few thousand terms in all",
            "simplify them, or give a large part of them a name and a parameter of its own",
        )


def spend_exact(row: Iterable[Fraction], factor: Fraction) -> None:
    """Count what it takes to multiply a row of fractions exactly, and take it from another."""
    bits = factor.numerator.bit_length() + factor.denominator.bit_length()
    for value in row:
        size = bits + value.numerator.bit_length() + value.denominator.bit_length()
        spend(1 + (size // EXACT_BITS) ** 2)


def check_digits(numerator: int, denominator: int = 1) -> None:
    """Refuse a number of more digits than `DIGITS`."""
    if max(numerator.bit_length(), denominator.bit_length()) > _BITS:
        raise ModelError(
            f"a number of more than {DIGITS} digits",
            "numbers as they are measured",
            "write it as a decimal of a dozen digits",
        )


def check_power(base: Fraction, exponent: int) -> None:
    """Refuse a power of a number that would have too many digits, before it is computed."""
    for part in (abs(base.numerator), base.denominator):
        if part > 1 and part.bit_length() * abs(exponent) > _BITS:
            check_digits(1 << _BITS)
