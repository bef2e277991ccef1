"""What is read from a text has the value of the text, as Python reads it."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from fractions import Fraction

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rotorid import ModelError
from rotorid.models.equations import polynomial, split_equations
from rotorid.models.expressions import evaluate

POINT = {"x": 0.7, "y": -1.3, "phi": 0.4, "Omega": 2.1, "F": 1.9, "a": 0.6, "b": 3.1}
FRACTIONS = {"a": Fraction(7, 3), "b": Fraction(-2, 5), "c": Fraction(11, 7)}
FUNCTIONS = ("sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh")
OPERATORS: Mapping[type[ast.AST], Callable[..., object]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
}


def value_of(text, values, number):
    """Return the value of a text by Python's own grammar; numbers become what `number` makes."""

    def of(node):
        if isinstance(node, ast.Constant):
            return number(ast.get_source_segment(code, node))
        if isinstance(node, ast.Name):
            return values[node.id]
        if isinstance(node, ast.Call):
            function = node.func.id
            known = {"abs": abs, "sign": lambda x: math.copysign(1, x) if x else 0.0}
            return (known.get(function) or getattr(math, function))(of(node.args[0]))
        if isinstance(node, ast.BinOp):
            exponent = isinstance(node.op, ast.Pow)
            right = of(node.right)
            if exponent and isinstance(right, Fraction) and right.denominator == 1:
                right = int(right)
            return OPERATORS[type(node.op)](of(node.left), right)
        return OPERATORS[type(node.op)](of(node.operand))

    code = text.replace("^", "**")
    return of(ast.parse(code, mode="eval").body)


def larger(inner, operators, exponents):
    """Return texts made of others."""
    pair = st.tuples(inner, st.sampled_from(operators), inner)
    power = st.tuples(inner, st.sampled_from(exponents))
    return (
        pair.map("({0[0]} {0[1]} {0[2]})".format)
        | pair.map("{0[0]}{0[1]}{0[2]}".format)
        | inner.map("-{}".format)
        | power.map("(({0[0]})^{0[1]})".format)
        | power.map("({0[0]}**{0[1]})".format)
    )


POLYNOMIALS = st.recursive(
    st.sampled_from(["a", "b", "c", "2", "0.5", "3e-2", "1", "0", ".25", "7."]),
    lambda inner: (
        larger(inner, "+-**", "1234")
        | st.tuples(inner, st.sampled_from(["3", "0.7", "(1/9)", "-4"])).map("{0[0]}/{0[1]}".format)
    ),
    max_leaves=7,
)
SIGNALS = st.recursive(
    st.sampled_from(["x", "y", "phi", "Omega", "2", "0.5", "3", "1"]),
    lambda inner: (
        larger(inner, "+-**/", ["2", "3", "0.5", "(-1)"])
        | st.tuples(st.sampled_from(FUNCTIONS), inner).map("{0[0]}({0[1]})".format)
    ),
    max_leaves=6,
)


@settings(max_examples=150, deadline=None)
@given(POLYNOMIALS)
def test_polynomials_have_the_value_of_their_text(text: str) -> None:
    """Exactly, in fractions."""
    try:
        found = polynomial(text, tuple(FRACTIONS))
    except ModelError as error:
        assert "degree" in str(error)  # noqa: PT017 - refused for its size, and for nothing else
        assume(False)
    total = Fraction(0)
    for powers, coefficient in found.items():
        factors = (v**n for v, n in zip(FRACTIONS.values(), powers, strict=True))
        total += coefficient * math.prod(factors, start=Fraction(1))
    assert total == value_of(text, FRACTIONS, Fraction)


@settings(max_examples=60, deadline=None)
@given(SIGNALS)
def test_equations_have_the_value_of_their_text(signal: str) -> None:
    """With functions, roots and divisors: times parameters, beside an input."""
    try:
        expected = value_of(signal, POINT, float)
    except (ArithmeticError, ValueError):
        assume(False)
    assume(not isinstance(expected, complex) and abs(expected) < 1e6)
    names = ("x", "y"), ("F",), ("a", "b")
    try:
        found = split_equations([f"a^2*b*({signal}) + x'' = 3*F/2"], *names)
    except ModelError:
        assume(False)  # a zero in disguise, a degree that is too high
    *left, right = found
    arrays = {**POINT, "x''": 0.0}
    powers = [(POINT["a"] ** p.monomial[0]) * POINT["b"] ** p.monomial[1] for p in left]
    terms = [
        float(p.coefficient) * size * float(evaluate(p.signal, arrays))
        for p, size in zip(left, powers, strict=True)
    ]
    assume(max(map(abs, terms)) < 1e6)
    assert sum(terms) == pytest.approx(POINT["a"] ** 2 * POINT["b"] * expected, rel=1e-7, abs=1e-7)
    assert (right.coefficient, str(right.signal)) == (Fraction(3, 2), "F")
