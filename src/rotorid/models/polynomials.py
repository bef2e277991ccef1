"""Expressions that are polynomials, as most are, expanded without a computer algebra.

These are sums, products and whole powers of names and numbers, and some functions of a single name.
For anything else, and everything that is to be refused, `expanded` returns nothing: `symbolic`
makes something of the tree, or says what is wrong.
"""

from __future__ import annotations

from fractions import Fraction

from rotorid.models import text_cost
from rotorid.models.expressions import Expression, symbol
from rotorid.models.syntax import Node

MAX_TERMS = 300  # of any part: more are for the algebra, which bounds them
_DEGREE = 32
_POWERS = ("1", "2", "3", "4", "5", "6", "7", "8")
_FUNCTIONS = ("sin", "cos", "tan", "tanh", "sign")  # no power of which is something simpler

Powers = frozenset[tuple[Expression, int]]
Polynomial = dict[Powers, Fraction]


class _NoPolynomialError(Exception):
    """Something for the algebra."""


def expanded(
    tree: Node, names: frozenset[str], linear: frozenset[str] = frozenset()
) -> Polynomial | None:
    """Return the terms of an expression, or of an equation as left minus right side.

    `linear` are the names that stand in no function. ``None`` where it is no polynomial.
    """
    try:
        with text_cost.bounded():
            total = _Expander(names, linear).of(tree)
    except _NoPolynomialError:
        return None
    return {powers: c for powers, c in total.items() if c}


class _Expander:
    def __init__(self, names: frozenset[str], linear: frozenset[str]) -> None:
        self.names, self.linear = names, linear

    def of(self, node: Node) -> Polynomial:
        if node.kind == "number":
            return {frozenset(): _number(node.text)}
        if node.kind == "name":
            return _alone(symbol(self._known(node)))
        if node.kind == "call":
            return _alone(self._call(node))
        if node.kind == "negative":
            return {powers: -c for powers, c in self.of(node.parts[0]).items()}
        if node.kind == "power":
            return self._power(*node.parts)
        total = dict(self.of(node.parts[0]))
        for sign, part in zip(node.text[1:] or "-", node.parts[1:], strict=True):
            other = self.of(part)
            if node.kind == "product":
                total = _multiplied(total, other if sign == "*" else _reciprocal(other))
            else:
                _add(total, other, 1 if sign == "+" else -1)
        return total

    def _known(self, node: Node) -> str:
        if node.kind != "name" or node.text not in self.names:
            raise _NoPolynomialError
        return node.text

    def _call(self, node: Node) -> Expression:
        argument = self._known(node.parts[0])
        if node.text not in _FUNCTIONS or node.text in self.names or argument in self.linear:
            raise _NoPolynomialError
        return Expression(node.text, (symbol(argument),))

    def _power(self, base: Node, exponent: Node) -> Polynomial:
        if exponent.kind != "number" or exponent.text not in _POWERS:
            raise _NoPolynomialError
        total = factor = self.of(base)
        for _ in range(int(exponent.text) - 1):
            total = _multiplied(total, factor)
        return total


def _alone(base: Expression) -> Polynomial:
    return {frozenset([(base, 1)]): Fraction(1)}


def _number(text: str) -> Fraction:
    if len(text) > 60 or (text != "0" and not 1e-99 < float(text) < 1e99):
        raise _NoPolynomialError
    return Fraction(text)


def _reciprocal(divisor: Polynomial) -> Polynomial:
    if list(divisor) != [frozenset()] or not divisor[frozenset()]:
        raise _NoPolynomialError
    return {frozenset(): 1 / divisor[frozenset()]}


def _add(total: Polynomial, other: Polynomial, sign: int) -> None:
    text_cost.spend(len(other))
    for powers, coefficient in other.items():
        found = total[powers] = total.get(powers, Fraction(0)) + sign * coefficient
        text_cost.check_digits(found.numerator, found.denominator)
    if len(total) > MAX_TERMS:
        raise _NoPolynomialError


def _multiplied(one: Polynomial, other: Polynomial) -> Polynomial:
    if len(one) * len(other) > MAX_TERMS:
        raise _NoPolynomialError
    text_cost.spend(text_cost.PRODUCT * len(one) * len(other))
    total: Polynomial = {}
    for first, c in one.items():
        for second, d in other.items():
            powers = dict(first)
            for base, power in second:
                powers[base] = powers.get(base, 0) + power
            key = frozenset(powers.items())
            total[key] = total.get(key, Fraction(0)) + c * d
    for found, coefficient in total.items():
        text_cost.check_digits(coefficient.numerator, coefficient.denominator)
        if sum(n for _, n in found) > _DEGREE:
            raise _NoPolynomialError
    return total
