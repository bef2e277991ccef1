"""The text of equations: expressions, and equations split by value."""

import ast
import copy
import math
import operator
import pickle
import re
from collections.abc import Callable, Mapping
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from model_text import model_text

from rotorid import InputError, Model, ModelError, load_model, parse_model, shipped_models
from rotorid.models import parser
from rotorid.models.equations import polynomial, split_equations
from rotorid.models.expressions import FUNCTIONS, Expression, evaluate, expression, product
from rotorid.models.parser import read

# The grammar: what a text means, what is refused and how it says so.


NAMES = frozenset({"x", "x'", "x''", "y", "a", "b", "F", "t", "Omega", "phi"})
LINEAR = frozenset({"a", "b", "F"})
POINT = {"x": 2.0, "x'": 3.0, "x''": 5.0, "y": 7.0, "a": 11.0, "b": 13.0, "F": 17.0}


def parse(text, names=NAMES, linear=frozenset(), *, equation=False):
    return expression(read(text, names, linear, equation=equation))


def refusal(text, *, equation=False):
    """Return the message with which a text is refused, checked for its form; "" where it is not."""
    try:
        found = parse(text, linear=LINEAR, equation=equation)
    except InputError as error:
        message = str(error)
    else:
        assert {str(s) for s in found.free_symbols} <= NAMES
        return ""
    assert re.fullmatch("(column .+: )?found .+; expected .+; .+", message)
    assert len(message) < 600
    return message


def value(text):
    return float(evaluate(parse(text), POINT))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("-x^2", -4),
        ("2^3^2", 512),  # from the right, as in mathematics and Python
        ("+x", 2),
        ("x''*x'", 15),
        ("x'^2", 9),
        ("x''^2*x", 50),
        ("x\t*\n y", 14),
        ("x^(1/3)", 2 ** (1 / 3)),
        ("2^40*10^-12*10^-12*10^-12*x", 2**41 * 1e-36),
        ("pi*x", 2 * np.pi),
        ("cos(pi/4)*x", 2**0.5),
        ("tan(pi/2 - x)", 1 / np.tan(2)),
    ],
)
def test_value_of_a_text(text, expected):
    assert value(text) == pytest.approx(expected, rel=1e-14)


def test_both_signs_of_a_power_are_one_operator():
    assert parse("x**2") == parse("x^2")
    with pytest.raises(ModelError, match=r"column 4: found '\*'"):
        parse("x* *2")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2x", "column 2: found 'x'.*write an operator before it"),
        ("(x)(y)", "column 4: found '('.*write an operator before it"),
        ("a(x + 1)", "found 'a' before a parenthesis; .*; write a\\*(...) for a product"),
        ("sin x", "found the unknown name 'sin'; .*; write sin(...)"),
        ("sine(x)", "found the unknown name 'sine'; .*; did you mean sin?"),
        ("x'''", 'column 4: found "\'"'),
        ("a'", 'found the unknown name "a\'"; .*; did you mean a?'),
        ("omega", "found the unknown name 'omega'; .*; did you mean Omega?"),
        ("x +", "found the end of the text"),
        ("", "column 1: found the end of the text"),
        ("x = y", "column 3: found '='"),
        ("(x", "found the end of the text"),
        ("x\0", "column 2: found"),
        ("x − y", "column 3: found '−'"),
        ("x.y", r"column 2: found '\.'"),
        ("__import__('os')", "unknown name '__import__'|column 12"),
        ("9^9^9^9*x", "found the power 387420489; expected a degree of at most 300"),
        ("x^33", "found the power 33; expected a degree of at most 32"),
        ("x^20*x^20", "found degree 40"),
        ("exp(exp(exp(100)))", "found exp(exp(100)): no finite real number"),
        ("1e999*x", "found the number 1e999"),
        ("x/0e999999999", "found a division by zero"),
        ("1e150^2*x", "too large or too small a number"),
        ("*".join(["(x + y + a + t + phi)"] * 13), "found too many terms when expanded"),
        ("+".join(["x"] * 100_000), "found 199999 characters"),
        ("z" * 10**6, "found 1000000 characters"),
        ("x/0", "found a division by zero"),
        ("1/(x - x)", "found a division by zero"),
        ("y/(x*(x + 1) - x^2 - x)", "found a division by zero"),
        ("y/(sin(1)^2 + cos(1)^2 - 1)", "found a division by zero"),
        ("(x*(x + 1) - x^2 - x)^-2", "found the power -2 of zero"),
        ("(x - x)^0.5", "found the power 1/2 of zero"),
        ("tan(pi/2)", "no finite real number"),
        ("x/sin(pi)", "found a division by zero"),
        ("sqrt(-2)*x", "no finite real number"),
        ("sqrt(-x^2)", "no finite real number"),
        ("sqrt(a)*x", "found sqrt of a, which holds a; expected a polynomial in the parameters"),
        ("a/b", "found a division by b, which holds b"),
        ("sin(a*x)", "found sin of a\\*x, which holds a"),
        ("a^x", "found the exponent x; expected a rational number"),
        ("x^pi", "found the exponent pi"),
        ("a^-1*x", "found the power -1 of a"),
        ("a^0.5", "found the power 1/2 of a"),
        ("sin(F)", "found sin of F, which holds F"),
        ("1/F", "found a division by F"),
    ],
)
def test_refusals(text, message):
    with pytest.raises(ModelError, match=message.replace("(", r"\(").replace(")", r"\)")) as caught:
        parse(text, linear=LINEAR)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.sampled(21)
@pytest.mark.parametrize("depth", [20, 100, 200, 330, 500, 999, 5000])
@pytest.mark.parametrize(
    "nest",
    [
        lambda n: "(" * n + "x" + ")" * n,
        lambda n: "-" * n + "x",
        lambda n: "-(" * n + "x" + ")" * n,
        lambda n: "x" + "^1" * n,
        lambda n: "2" + "^-1" * n,
        lambda n: "sin(" * n + "x" + ")" * n,
        lambda n: "sqrt(1+" * n + "x" + ")" * n,
        lambda n: "(x*" * n + "x" + ")" * n,
        lambda n: "x" + "*(x" * n + ")" * n,
        lambda n: "(" * n,
        lambda n: "x" + ")" * n,
        lambda n: "-" * n,
    ],
)
def test_deep_nesting_is_read_or_refused_in_one_line(nest, depth):
    message = refusal(nest(depth))
    assert depth == 20 or re.search("nesting deeper|degree|column|found the end", message)


ATOMS = [*NAMES, *FUNCTIONS, "pi", "q", "0", "1", "2", "3", "0.5", "1e3", "1e-300", "1e300", "²"]
MARKS = ["+", "-", "*", "/", "^", "**", "(", ")", "=", "'", " ", ".", ",", "\n", "\\", "é", "_"]
TEXTS = st.lists(st.sampled_from(ATOMS + MARKS), max_size=25).map("".join) | st.text(max_size=40)


def trees(inner):
    pair = st.tuples(inner, st.sampled_from([" + ", " - ", "*", "/", "^"]), inner)
    call = st.tuples(st.sampled_from([*FUNCTIONS, "-", ""]), inner)
    return pair.map("({0[0]}{0[1]}{0[2]})".format) | call.map("{0[0]}({0[1]})".format)


WELL_FORMED = st.recursive(
    st.sampled_from([*NAMES, "pi", "0", "1", "2", "0.5"]), trees, max_leaves=8
)


@settings(max_examples=250, deadline=None)
@given(TEXTS | WELL_FORMED, st.booleans())
def test_any_text_is_read_or_refused(text, equation):
    refusal(text, equation=equation)


@pytest.mark.parametrize(
    ("divisor", "zero"),
    [
        ("sin(x)^2 + cos(x)^2 - 1", True),
        ("sqrt(x^2*y^2) - abs(x)*abs(y)", True),
        ("x", False),
        ("1e-190", False),
        ("sin(x) - x", False),
        ("exp(-100*x^2)", False),
        ("sign(x) - 1", False),
        ("tanh(1000*x) - 1", False),
        ("(y + 2)^(1/3) - y", False),
    ],
)
def test_a_divisor_that_vanishes_is_told_from_a_small_one(divisor, zero):
    assert ("a division by zero" in refusal(f"t/({divisor})")) == zero


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sqrt(x)*sqrt(x)", "x"),
        ("sqrt(x^2)", "abs(x)"),
        ("sqrt(x^2 + 1)^2", "1 + x*x"),
        ("1/(1/(1 + x))", "x + 1"),
        ("x^2/x", "x"),
        ("sin(-x)", "-sin(x)"),
        ("cos(y - x)", "cos(x - y)"),
        ("sqrt(12)*x/sqrt(3)", "2*x"),
        ("cos(pi/3)*x", "x/2"),
        ("sin(pi/4)*x", "x/sqrt(2)"),
        ("tan(pi/3)*x", "sqrt(3)*x"),
        ("exp(0)*x + sin(pi) - abs(-1/3)", "x - 1/3"),
        ("(8*x)^(1/3)", "2*x^(1/3)"),
        ("sqrt(y^2*x) + y*x", "abs(y)*sqrt(x) + x*y"),
    ],
)
def test_texts_that_mean_the_same_are_the_same(text, expected):
    assert parse(text) == parse(expected)


def test_copies_are_equal_though_a_name_is_its_own_free_symbol():
    x, phi = (Expression("name", (name,)) for name in ("x", "phi"))
    value = product([(x, Fraction(2)), (Expression("cos", (phi,)), Fraction(1))])
    assert value.free_symbols  # kept in it from now on
    for again in (copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
        assert (again, again.free_symbols) == (value, value.free_symbols)
    model = load_model("jeffcott")
    assert pickle.loads(pickle.dumps(model)) == copy.deepcopy(model) == model


# Texts that ask for too much: refused by counting, before the work, in one line.


def model_of(term: str, *more: str, names: int = 0) -> Model:
    extra = [f"p{i}" for i in range(names)]
    equations = [f"m*x'' + c*x' + k*x + {term} = F", *more]
    units = dict.fromkeys(["m", "c", "k", *extra], "kg")
    return parse_model(model_text("large", equations, "x m", "F N", units))


def dense(digits: int, size: int) -> list[str]:
    """Return equations whose elimination has numbers of more and more digits."""
    figure = [str(pow(7, 40 + 3 * i, 10**digits)) for i in range(size * size)]
    return [
        " + ".join(f"0.{figure[size * i + j]}*p{j}*x" for j in range(size)) + " = 0"
        for i in range(size)
    ]


def squared(levels: int) -> str:
    """Return functions of sums of functions, whose size grows with each level."""
    found = "x"
    for _ in range(levels):
        found = f"sin(({found}+1)^8)"
    return found


@pytest.fixture
def spent(monkeypatch):
    found, spend = [0], parser.Work.spend

    def counted(work: parser.Work, units: int) -> None:
        found[0] += units
        spend(work, units)

    monkeypatch.setattr(parser.Work, "spend", counted)
    return found


@pytest.mark.parametrize(
    ("term", "limit"),
    [
        (squared(20), "steps to expand"),
        ("(1.1^300)^300*x", f"more than {parser.DIGITS} digits"),
        ("1.1^300*1.3^300*1.7^300*1.9^300*x", "more than 1000 digits"),
        ("x*" + "*".join(["1.23456789012345678901234567890123456789"] * 30), "digits"),
        (" + ".join(f"x/{10**9 + 7 + 2 * i}" for i in range(300)), "digits"),
        ("1/(x+t+phi+Omega)^31", "too many terms"),
        ("x*(" + "+".join(f"cos(pi/{i})" for i in range(7, 20)) + ")^31", "too many terms"),
        ("(" + "+".join(f"tanh(x+{i})" for i in range(60)) + ")^2*(x+t+phi)", "too many|steps"),
        ("x^999999999999999999999999", "degree"),
        ("2^(999999999999999999999999)*x", "degree"),
        ("2^(999999999999999999999999.5)*x", "degree"),
        ("x^32*x", "degree"),
    ],
)
def test_a_bomb_is_one_line_that_names_the_limit(term, limit, spent):
    with pytest.raises(ModelError, match=limit) as found:
        model_of(term)
    assert "equation 1" in str(found.value)
    assert len(str(found.value)) < 600
    assert spent[0] < 2 * parser.WORK  # what is refused last is not done any more


@pytest.mark.slow
def test_equations_share_what_they_may_cost(monkeypatch):
    """Terms that cancel are counted as well."""
    monkeypatch.setattr(parser, "WORK", 50_000)
    powers = "(m+c+k+x+x')^4*(x+1)"
    with pytest.raises(ModelError, match=r"equation \d\d: found equations that take more than"):
        model_of("x", *[f"{powers} - {powers} + m*x'' = 0"] * 99)
    model_of("p0*x", *dense(6, 12), names=12)
    with pytest.raises(ModelError, match="steps to expand"):
        model_of("p0*x", *dense(40, 25), names=25)


def test_a_combination_costs_less_than_a_model():
    names = [f"x{i}" for i in range(100)]
    assert len(polynomial(" + ".join(f"0.5*{name}" for name in names), names)) == 100
    quotients = "+".join(f"(x{i % 100}+1)/(1+1)" for i in range(3_000))
    for text in ("x0" + "+x1" * 7_000, quotients):
        with pytest.raises(ModelError, match="more than 20,000 steps"):
            polynomial(text, names)


def test_the_limits_are_where_they_are_said_to_be(monkeypatch):
    model_of("x*1.1234567891^97")  # a denominator of 971 digits
    with pytest.raises(ModelError, match="1000 digits"):
        model_of("x*1.1234567891^101")
    monkeypatch.setattr(parser, "WORK", 5_000)
    model_of("x" + "+x" * 1_600)
    with pytest.raises(ModelError, match="more than 5,000 steps"):
        model_of("x" + "+x" * 1_700)


# What is read from a text has the value of the text, as Python reads it.


AT = {"x": 0.7, "y": -1.3, "phi": 0.4, "Omega": 2.1, "F": 1.9, "a": 0.6, "b": 3.1}
FRACTIONS = {"a": Fraction(7, 3), "b": Fraction(-2, 5), "c": Fraction(11, 7)}
SMOOTH = ("sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh")
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
        | st.tuples(st.sampled_from(SMOOTH), inner).map("{0[0]}({0[1]})".format)
    ),
    max_leaves=6,
)


@settings(max_examples=150, deadline=None)
@given(POLYNOMIALS)
def test_polynomials_have_the_value_of_their_text(text):
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
def test_equations_have_the_value_of_their_text(signal):
    """With functions, roots and divisors: times parameters, beside an input."""
    try:
        expected = value_of(signal, AT, float)
    except (ArithmeticError, ValueError):
        assume(False)
    assume(not isinstance(expected, complex) and abs(expected) < 1e6)
    names = ("x", "y"), ("F",), ("a", "b")
    try:
        found = split_equations([f"a^2*b*({signal}) + x'' = 3*F/2"], *names)
    except ModelError:
        assume(False)  # a zero in disguise, a degree that is too high
    *left, right = found
    arrays = {**AT, "x''": 0.0}
    powers = [(AT["a"] ** p.monomial[0]) * AT["b"] ** p.monomial[1] for p in left]
    terms = [
        float(p.coefficient) * size * float(evaluate(p.signal, arrays))
        for p, size in zip(left, powers, strict=True)
    ]
    assume(max(map(abs, terms)) < 1e6)
    assert sum(terms) == pytest.approx(AT["a"] ** 2 * AT["b"] * expected, rel=1e-7, abs=1e-7)
    assert (right.coefficient, str(right.signal)) == (Fraction(3, 2), "F")


# Units of equations: what was typed wrong is said, what may be right is not.


MODEL = model_text("a mass on a spring", ["EQUATION"], "x m", "F N", "m kg, k N/m, l m")


@pytest.mark.parametrize("name", shipped_models())
def test_the_shipped_models_agree_and_cost_little(name, spent):
    assert load_model(name).unit_faults == ()
    assert spent[0] < 5_000


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("m*x'' + k*(x - l) = F", ""),
        ("m*x'' + k*(x - l) + m*9.81*sin(phi) = F", ""),  # 9.81 has a unit of its own
        ("m*x'' + k*l*tanh(phi) - k*abs(x)*sign(x') = F", ""),
        ("m*x'' + 2*m*Omega*x' + k*l*cos(phi) = F", ""),
        ("m*x' + k*(x - l) = F", "kg m s^-1 and in kg m s^-2"),
        ("m*x'' + k*l*x = F", "kg m s^-2 and in kg m^2 s^-2"),
        ("m*x'' + m*Omega*x + k*l = F", "kg m s^-1"),
    ],
)
def test_equations_whose_terms_do_not_agree_are_told(text, units):
    faults = parse_model(MODEL.replace("EQUATION", text)).unit_faults
    assert len(faults) == bool(units)
    assert all(fault.startswith("equation 1 adds terms in ") for fault in faults)
    assert all(units in fault for fault in faults)
