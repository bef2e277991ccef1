"""Trees of expressions to symbolic ones, where they are no polynomials.

What a tree may cost is bounded before it is computed: its depth, the size of its numbers, the
degree and the number of terms it expands to.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import sympy as sp

from rotorid.core.errors import ModelError, nearest
from rotorid.core.frozen import frozen
from rotorid.models import text_cost
from rotorid.models.expressions import (
    FUNCTIONS,
    MAX_EXPONENT,
    MAX_TERMS,
    Expression,
    Factor,
    Monomial,
    Terms,
    number,
    product,
)
from rotorid.models.expressions import symbol as plain_symbol
from rotorid.models.syntax import MAX_NESTING, Node, too_deep

MAX_DEGREE = 32
# What may stand in a signal; the algebra puts cot, sec, csc and coth in their place.
_FUNCTIONS: dict[str, Any] = {
    "sin": sp.sin,
    "cos": sp.cos,
    "tan": sp.tan,
    "exp": sp.exp,
    "sqrt": sp.sqrt,
    "abs": sp.Abs,
    "sign": sp.sign,
    "tanh": sp.tanh,
    "cot": sp.cot,
    "sec": sp.sec,
    "csc": sp.csc,
    "coth": sp.coth,
}
_NAMES = {function: name for name, function in _FUNCTIONS.items()}
Symbolic = Any  # a sympy expression; sympy carries no types of its own


@cache
def symbol(name: str) -> Symbolic:
    """Return the real symbol of a name (``q'`` is a name like any other)."""
    return sp.Symbol(name, real=True)


def from_sympy(value: Symbolic) -> Expression:
    if value.is_Symbol:
        return plain_symbol(str(value))
    if value.is_Rational:
        return number(_fraction(value))
    if value is sp.pi:
        return Expression("pi")
    if value is sp.E:
        return Expression("exp", (number(1),))
    if value.is_Float:
        return number(Fraction(repr(float(value))))
    if value.is_Add:
        return Expression("sum", tuple(from_sympy(part) for part in value.args))
    if value.is_Mul or value.is_Pow:
        return product(map(_factor, sp.Mul.make_args(value)))
    if value.func not in _NAMES:
        raise ModelError(f"the function {value.func}", ", ".join(FUNCTIONS), "rewrite the term")
    return Expression(_NAMES[value.func], (from_sympy(value.args[0]),))


def _factor(value: Symbolic) -> Factor:
    base, exponent = (value.base, value.exp) if value.is_Pow else (value, sp.Integer(1))
    return from_sympy(base), _fraction(exponent)


def _fraction(value: Symbolic) -> Fraction:
    return Fraction(int(value.p), int(value.q))


@frozen
class _Node:
    """An expression with bounds on what expanding it costs."""

    value: Symbolic
    terms: int = 1
    degree: int = 0
    depth: int = 0
    size: int = 1  # nodes, or terms when expanded where there are more
    nested: int = 0  # functions, roots and divisors inside each other

    def with_value(self, value: Symbolic) -> _Node:
        return replace(self, value=value)


class _Builder:
    """Builds expressions from their parts, refusing what is too large or has no meaning."""

    def __init__(self, names: frozenset[str], linear: frozenset[str]) -> None:
        self.names, self.linear = names, linear

    def of(self, tree: Node) -> _Node:
        """Return what a tree stands for: its parts first, from the left."""
        parts = [self.of(part) for part in tree.parts]
        make: Callable[[str, list[_Node]], _Node] = getattr(self, tree.kind)
        return make(tree.text, parts)

    def number(self, text: str, parts: list[_Node]) -> _Node:
        text_cost.spend(text_cost.NODE)
        value = float(text)
        if not re.search("[1-9]", re.split("[eE]", text)[0]):
            return _Node(sp.Integer(0))  # 0e999999999 is not to be computed
        if len(text) > 60 or not 1e-200 < value < 1e200:
            raise ModelError(f"the number {text[:40]}", "1e-200 to 1e200", "scale the equation")
        return _Node(sp.Rational(text))

    def name(self, name: str, parts: list[_Node]) -> _Node:
        text_cost.spend(text_cost.NODE)
        if name == "pi":
            return _Node(sp.pi)
        if name not in self.names:
            raise _unknown(name, self.names, "a declared name: one of")
        return _Node(symbol(name), degree=1)

    def sum(self, signs: str, nodes: list[_Node]) -> _Node:
        whole = _joined(nodes, sum(n.terms for n in nodes), max(n.degree for n in nodes))
        pairs = zip(signs, nodes, strict=True)
        values = (node.value if sign == "+" else -node.value for sign, node in pairs)
        return self._made(whole, lambda: sp.Add(*values))

    def negative(self, _: str, parts: list[_Node]) -> _Node:
        (node,) = parts
        return self._made(_joined(parts, node.terms, node.degree), lambda: -node.value)

    def product(self, operators: str, parts: list[_Node]) -> _Node:
        pairs = zip(operators, parts, strict=True)
        nodes = [node if sign == "*" else self._reciprocal(node) for sign, node in pairs]
        terms = 1
        for node in nodes:
            terms = min(terms * node.terms, 10 * MAX_TERMS)
        whole = _joined(nodes, terms, sum(n.degree for n in nodes))
        return self._made(whole, lambda: sp.Mul(*(node.value for node in nodes)))

    def _reciprocal(self, node: _Node) -> _Node:
        if node.value.is_Rational and node.value != 0:
            return _joined([node], 1, node.degree).with_value(1 / node.value)
        divisor = self._expanded(node, node.terms, "a division by")
        if vanishes(divisor):
            raise ModelError(
                f"a division by zero (by {shown(node.value)})", "a divisor", "remove it"
            )
        whole = _joined([node], 1, node.degree, nested=node.nested + 1)
        return self._made(whole, lambda: 1 / divisor)

    def power(self, _: str, parts: list[_Node]) -> _Node:
        base, exponent = parts
        value = exponent.value
        if not value.is_Rational:
            raise ModelError(
                f"the exponent {shown(value)}", "a rational number", "write a number there"
            )
        size = max(1, abs(int(value)))
        number = base.value.is_number
        degree = 0 if number else max(base.degree, 1) * size
        limit = 300 if number else MAX_DEGREE
        if size > limit or degree > limit:
            raise ModelError(
                f"the power {shown(value)}", f"a degree of at most {limit}", "write it smaller"
            )
        if base.value.is_Rational:
            text_cost.check_power(_fraction(base.value), size)
        terms = min(base.terms**size, 10 * MAX_TERMS)
        if value.is_Integer and value >= 0:
            return self._made(_joined(parts, terms, degree), lambda: base.value**value)
        if terms > MAX_TERMS:
            raise _too_many()
        expanded = self._expanded(base, terms, f"the power {shown(value)} of")
        if vanishes(expanded):
            raise ModelError(
                f"the power {shown(value)} of zero ({shown(base.value)})",
                "a base other than zero",
                "remove it",
            )
        # What is above the whole part of an exponent is multiplied out like any power.
        whole = _joined(parts, terms if value > 1 else 1, degree, nested=base.nested + 1)
        return self._made(whole, lambda: base.value**value)

    def call(self, function: str, parts: list[_Node]) -> _Node:
        (node,) = parts
        if function in self.names:
            raise ModelError(
                f"{function[:60]!r} before a parenthesis",
                "a function or an operator there",
                f"write {function[:60]}*(...) for a product",
            )
        if function not in FUNCTIONS:
            raise _unknown(function, frozenset(FUNCTIONS), "a function: one of")
        argument = self._expanded(node, node.terms, f"{function} of", tested=False)
        if argument.is_number and abs(float(argument)) > 300 and function == "exp":
            raise ModelError(f"exp({shown(argument)})", "a finite number", "scale it")
        # One nonlinear function counts as one factor, however large its argument.
        whole = _joined([node], 1, 1, nested=node.nested + 1)
        return self._made(whole, lambda: _FUNCTIONS[function](argument))

    def equation(self, _: str, parts: list[_Node]) -> _Node:
        left, right = parts
        whole = _joined(parts, left.terms + right.terms, 0)
        text_cost.spend(text_cost.TERM * whole.terms)  # it is expanded next
        return self._made(whole, lambda: left.value - right.value)

    def _expanded(self, node: _Node, terms: int, what: str, *, tested: bool = True) -> Symbolic:
        """Multiply out what stands in a function, a root or a divisor, there to test for zero."""
        if node.nested >= text_cost.NESTED:
            raise ModelError(
                f"functions and roots nesting deeper than {text_cost.NESTED}",
                f"{text_cost.NESTED} levels at most",
                "give what is inside a name, or leave it out",
            )
        evaluated = text_cost.EVALUATED * node.size if tested else 0
        text_cost.spend(text_cost.FUNCTION + text_cost.TERM * (terms - 1) + evaluated)
        expanded = sp.expand(node.value)
        self._refuse_parameters(expanded, what)
        return expanded

    def _refuse_parameters(self, value: Symbolic, what: str) -> None:
        held = sorted(str(s) for s in value.free_symbols if str(s) in self.linear)
        if held:
            raise ModelError(
                f"{what} {shown(value)}, which holds {', '.join(held)}",
                "a polynomial in the parameters, inputs to the first power only",
                "name the whole expression as a parameter of its own",
            )

    def _made(self, whole: _Node, value: Callable[[], Symbolic]) -> _Node:
        """Check the bounds of an expression, make it, and check what it is."""
        if whole.terms > MAX_TERMS:
            raise _too_many()
        if whole.degree > MAX_DEGREE:
            raise ModelError(f"degree {whole.degree}", f"{MAX_DEGREE} at most", "write it smaller")
        if whole.depth > MAX_NESTING:
            raise too_deep()
        text_cost.spend(text_cost.NODE + whole.size)
        found = value()
        if found.has(sp.zoo, sp.nan, sp.oo, -sp.oo, sp.I):
            raise _not_real(found)
        factor = found.as_coeff_Mul(rational=True)[0]
        text_cost.check_digits(int(factor.p), int(factor.q))
        if found.is_number and not found.is_Rational:
            text_cost.spend(4 * text_cost.EVALUATED * whole.size)  # to as many digits as it takes
        if found.is_number and found != 0:
            check_number(found)
        return whole.with_value(found)


def _joined(nodes: list[_Node], terms: int, degree: int, *, nested: int = 0) -> _Node:
    """Return the bounds of what is made of some expressions, without its value."""
    return _Node(
        None,
        terms,
        degree,
        1 + max(node.depth for node in nodes),
        1 + sum(max(node.size, node.terms) for node in nodes),
        max(nested, *(node.nested for node in nodes)),
    )


def _too_many() -> ModelError:
    return ModelError("too many terms when expanded", f"{MAX_TERMS} at most", "split it")


def vanishes(value: Symbolic) -> bool:
    """Tell whether an expanded expression is zero whatever its symbols are."""
    names = sorted(value.free_symbols, key=str)
    if value == 0 or value.is_Rational or value.is_polynomial(*names):
        return bool(value == 0)
    for scale, sign in ((1, 1), (1, -1), (-1, 1), (-1, -1), (1000, 1), (-1000, -1)):
        point = {
            name: sp.Rational((2 * i + 3) * (sign if i % 2 else 1), (7 * i + 11) * scale)
            for i, name in enumerate(names)
        }
        if _is_significant(value.evalf(15, subs=point)):
            return False
    return True


def _is_significant(number: Symbolic) -> bool:
    """Tell a number from what cancellation leaves of zero: no digit of that is right."""
    return bool(number != 0) and all(part._prec > 1 for part in number.atoms(sp.Float))


def check_number(value: Symbolic) -> None:
    """Refuse a number that is complex, too large or too small, or zero in disguise."""
    number = sp.N(value, 15)
    real, imaginary = number.as_real_imag()
    if imaginary != 0:
        raise _not_real(value)
    if not value.is_Rational and not _is_significant(number):
        raise ModelError(f"{shown(value)}, which is zero", "a number", "write 0 or remove it")
    if not sp.Float(10) ** -MAX_EXPONENT < abs(real) < sp.Float(10) ** MAX_EXPONENT:
        raise ModelError(
            f"{shown(value)}, too large or too small a number", f"1e+-{MAX_EXPONENT}", "scale it"
        )


def _not_real(value: Symbolic) -> ModelError:
    return ModelError(
        f"{shown(value)}: no finite real number", "real numbers", "check divisors and roots"
    )


def shown(value: Symbolic) -> str:
    text = str(value).replace("**", "^")
    return text if len(text) <= 60 else text[:57] + "..."


def _unknown(name: str, names: frozenset[str], expected: str) -> ModelError:
    listed = sorted(names)
    cure = nearest(name, listed, "declare it in the model file, or write the name that is")
    shown = ", ".join(listed[:30]) + (", ..." if len(listed) > 30 else "")
    return ModelError(f"the unknown name {name[:60]!r}", f"{expected} {shown}", cure)


def parse(tree: Node, names: frozenset[str], linear: frozenset[str] = frozenset()) -> Symbolic:
    """Return an expression, or an equation as left minus right side."""
    with text_cost.bounded():
        return _Builder(names, linear).of(tree).value


def equation_terms(
    tree: Node, names: frozenset[str], parameters: Sequence[str], inputs: Sequence[str]
) -> Terms:
    """Return the coefficient of each monomial and signal in an equation, left minus right side."""
    linear = frozenset([*parameters, *inputs])
    value = sp.expand(parse(tree, names, linear))
    alone = frozenset(symbol(name) for name in inputs)
    index = {symbol(name): i for i, name in enumerate(parameters)}
    gathered: Terms = defaultdict(Fraction)
    for term in sp.Add.make_args(value):
        exponents = [0] * len(index)
        coefficient, signal = Fraction(1), sp.Integer(1)
        for factor in sp.Mul.make_args(term):
            base, exponent = factor.as_base_exp()
            if factor.is_number:
                coefficient *= _coefficient(factor)
            elif base in index:
                exponents[index[base]] += int(exponent)
            else:
                signal *= factor
        if (held := signal.free_symbols & alone) and signal not in alone:
            raise ModelError(
                f"the term {shown(term)} with the input {min(map(str, held))}",
                "inputs that stand alone, times numbers and parameters",
                "give the product an input of its own",
            )
        gathered[tuple(exponents), from_sympy(signal)] += coefficient
    return gathered


def _coefficient(number: Symbolic) -> Fraction:
    if number.is_Rational:
        return _fraction(number)
    check_number(number)
    return Fraction(repr(float(number)))  # pi, sqrt(2), ...


def polynomial_terms(tree: Node, names: Sequence[str]) -> dict[Monomial, Fraction]:
    """Return the coefficients of a polynomial by the powers of its names."""
    known = frozenset(names)
    value = sp.expand(parse(tree, known, known))
    terms = sp.Poly(value, *map(symbol, names)).terms()
    return {m: _coefficient(c) for m, c in terms}
