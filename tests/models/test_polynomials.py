"""Polynomials are expanded as the algebra expands them, or left to it."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid import ModelError, load_model, shipped_models
from rotorid.models.equations import Names, _plain_terms, polynomial
from rotorid.models.polynomials import expanded
from rotorid.models.symbolic import equation_terms, polynomial_terms
from rotorid.models.syntax import read

NAMES = Names(("x", "y"), ("F", "G"), ("a", "b"))
ATOMS = st.sampled_from(
    [
        *(
            "x",
            "x'",
            "x''",
            "y",
            "y''",
            "a",
            "b",
            "F",
            "phi",
            "Omega",
            "2",
            "0.5",
            "3e-2",
            "1",
            "0",
        ),
        *("sin(phi)", "cos(phi)", "sign(x')", "tan(y)", "tanh(x)", "sqrt(x)", "sin(2*phi)", "pi"),
    ]
)


def larger(inner):
    pair = st.tuples(inner, st.sampled_from("+-***/"), inner).map("({0[0]} {0[1]} {0[2]})".format)
    loose = st.tuples(inner, st.sampled_from("+-*/"), inner).map("{0[0]}{0[1]}{0[2]}".format)
    power = st.tuples(inner, st.sampled_from("1234")).map("{0[0]}^{0[1]}".format)
    return pair | loose | inner.map("-{}".format) | power


SIDES = st.recursive(ATOMS, larger, max_leaves=8)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(SIDES, SIDES)
def test_equations_are_what_the_algebra_makes_of_them(left, right):
    text = f"{left} = {right}"
    linear = frozenset([*NAMES.parameters, *NAMES.inputs])
    tree = read(text, "equation")
    value = expanded(tree, NAMES.all, linear)
    found = None if value is None else _plain_terms(value, NAMES)
    if found is None:
        return
    expected = equation_terms(tree, NAMES.all, NAMES.parameters, NAMES.inputs)
    assert found == {key: coefficient for key, coefficient in expected.items() if coefficient}


@pytest.mark.parametrize("name", [n for n in shipped_models() if n != "flexible"])  # a drawing
def test_shipped_models_need_no_algebra(name):
    model = load_model(name)
    for text in model.texts:
        assert expanded(read(text, "equation"), model.names.all) is not None


@pytest.mark.parametrize(
    "text",
    [
        *("x^2^2", "x^-1", "x^0", "x^9", "x^y", "x/y", "x/0", "x/(y - y)"),
        *("sqrt(x)", "sin(2*x)", "sin(a)", "z", "pi", "1e200", "(x + y + a + b + F + G)^8"),
    ],
)
def test_what_is_no_polynomial_is_left_to_the_algebra(text):
    linear = frozenset([*NAMES.parameters, *NAMES.inputs])
    assert expanded(read(text), NAMES.all, linear) is None


def test_an_input_with_company_is_left_to_the_algebra():
    tree = read("F*x = a", "equation")
    value = expanded(tree, NAMES.all)
    assert _plain_terms(value, NAMES) is None
    with pytest.raises(ModelError, match="inputs that stand alone"):
        equation_terms(tree, NAMES.all, NAMES.parameters, NAMES.inputs)


@pytest.mark.parametrize("text", ["2*a - 3*b^2*a", "a - a", "(a + b)^3/2", "-a*0.1 + b"])
def test_polynomials_by_powers(text):
    assert polynomial(text, ["a", "b"]) == polynomial_terms(read(text), ["a", "b"])


def test_coefficients_are_exact():
    assert polynomial("0.1*3*a - 0.3*a + b/3", ["a", "b"]) == {(0, 1): Fraction(1, 3)}
    assert polynomial("2^3^4*a", ["a"]) == {(1,): 2**81}
    assert polynomial_terms(read("a/3"), ["a"]) == {(1,): Fraction(1, 3)}
