"""Equations that are polynomials, as most are, without a computer algebra.

What is read here are sums, products and whole powers of names and numbers, and some functions of
a single name. For anything else, and everything that is to be refused, `read_plain` returns
nothing: the grammar in `symbolic` reads it, or says what is wrong.
"""

from __future__ import annotations

import re
from fractions import Fraction

from rotorid.models import cost
from rotorid.models.text import Expression, symbol

MAX_TERMS = 300  # of any part: more are for the grammar, which bounds them
_DEGREE = 32
_NESTING = 12
_POWER = 8
_FUNCTIONS = ("sin", "cos", "tan", "tanh", "sign")  # no power of which is something simpler
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?)(?![\w.'])"
    r"|(?P<name>[^\W\d]\w*'{0,2})(?!')|(?P<sign>\*\*|[-+*/^()=]))",
    re.ASCII,
)

Powers = frozenset[tuple[Expression, int]]
Polynomial = dict[Powers, Fraction]


class _NotPlainError(Exception):
    """Something for the grammar."""


def read_plain(
    text: str, *, names: frozenset[str], linear: frozenset[str] = frozenset(), start: str = "sum"
) -> Polynomial | None:
    """Return the expanded terms of a sum, or of an equation as left minus right side.

    `linear` are the names that stand in no function. ``None`` where the text is not plain.
    """
    try:
        with cost.bounded():
            return _Reader(text, names, linear).read(equation=start == "equation")
    except _NotPlainError:
        return None


class _Reader:
    """One text, token by token."""

    def __init__(self, text: str, names: frozenset[str], linear: frozenset[str]) -> None:
        self.names, self.linear, self.nesting = names, linear, 0
        self.tokens: list[tuple[str, str]] = []
        place, text = 0, text.rstrip()
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                raise _NotPlainError
            cost.spend(1)
            kind = str(match.lastgroup)
            self.tokens.append((kind, match[kind]))
            place = match.end()
        self.tokens = self.tokens[::-1]  # the next one is the last

    def read(self, *, equation: bool) -> Polynomial:
        total = self.sum()
        if equation:
            if not self.accepts("="):
                raise _NotPlainError
            _add(total, self.sum(), -1)
        if self.tokens:
            raise _NotPlainError
        return {powers: c for powers, c in total.items() if c}

    def accepts(self, *signs: str) -> str:
        """Take the next token where it is one of these signs."""
        if self.tokens and self.tokens[-1][0] == "sign" and self.tokens[-1][1] in signs:
            return self.tokens.pop()[1]
        return ""

    def needs(self, kind: str) -> str:
        """Take the next token, which must be of this kind."""
        if not self.tokens or self.tokens[-1][0] != kind:
            raise _NotPlainError
        return self.tokens.pop()[1]

    def sum(self) -> Polynomial:
        self.nesting += 1
        if self.nesting > _NESTING:
            raise _NotPlainError
        total = dict(self.product())
        while sign := self.accepts("+", "-"):
            _add(total, self.product(), 1 if sign == "+" else -1)
        self.nesting -= 1
        return total

    def product(self) -> Polynomial:
        total = self.unary()
        while operator := self.accepts("*", "/"):
            other = self.unary()
            total = _multiplied(total, other if operator == "*" else _reciprocal(other))
        return total

    def unary(self) -> Polynomial:
        sign = signs = 1
        while taken := self.accepts("+", "-"):
            sign = -sign if taken == "-" else sign
            signs += 1
        if signs > _NESTING:
            raise _NotPlainError
        return {powers: sign * c for powers, c in self.power().items()}

    def power(self) -> Polynomial:
        base = self.atom()
        if not self.accepts("^", "**"):
            return base
        exponent = self.needs("number")
        if not exponent.isdigit() or not 0 < int(exponent) <= _POWER or self.accepts("^", "**"):
            raise _NotPlainError
        total = base
        for _ in range(int(exponent) - 1):
            total = _multiplied(total, base)
        return total

    def atom(self) -> Polynomial:
        if self.accepts("("):
            inner = self.sum()
            if not self.accepts(")"):
                raise _NotPlainError
            return inner
        if self.tokens and self.tokens[-1][0] == "number":
            return {frozenset(): _fraction(self.tokens.pop()[1])}
        name = self.needs("name")
        if self.accepts("("):
            return self.call(name)
        if name not in self.names:
            raise _NotPlainError
        return {frozenset([(symbol(name), 1)]): Fraction(1)}

    def call(self, function: str) -> Polynomial:
        argument = self.needs("name")
        known = argument in self.names and argument not in self.linear
        if function not in _FUNCTIONS or function in self.names or not known:
            raise _NotPlainError
        if not self.accepts(")"):
            raise _NotPlainError
        return {frozenset([(Expression(function, (symbol(argument),)), 1)]): Fraction(1)}


def _fraction(text: str) -> Fraction:
    if len(text) > 60 or (text != "0" and not 1e-99 < float(text) < 1e99):
        raise _NotPlainError
    return Fraction(text)


def _reciprocal(divisor: Polynomial) -> Polynomial:
    if list(divisor) != [frozenset()] or not divisor[frozenset()]:
        raise _NotPlainError
    return {frozenset(): 1 / divisor[frozenset()]}


def _add(total: Polynomial, other: Polynomial, sign: int) -> None:
    cost.spend(len(other))
    for powers, coefficient in other.items():
        found = total[powers] = total.get(powers, Fraction(0)) + sign * coefficient
        cost.check_digits(found.numerator, found.denominator)
    if len(total) > MAX_TERMS:
        raise _NotPlainError


def _multiplied(one: Polynomial, other: Polynomial) -> Polynomial:
    if len(one) * len(other) > MAX_TERMS:
        raise _NotPlainError
    cost.spend(cost.PRODUCT * len(one) * len(other))
    total: Polynomial = {}
    for first, c in one.items():
        for second, d in other.items():
            powers = dict(first)
            for base, power in second:
                powers[base] = powers.get(base, 0) + power
            key = frozenset(powers.items())
            total[key] = total.get(key, Fraction(0)) + c * d
    for found, coefficient in total.items():
        cost.check_digits(coefficient.numerator, coefficient.denominator)
        if sum(n for _, n in found) > _DEGREE:
            raise _NotPlainError
    return total
