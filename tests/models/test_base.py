"""Base parameters: their names, their merge, and that only the equations' content matters."""

import re
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from math import prod

import numpy as np
import pytest
from bank import BANK, THREE_MASS, combination, names
from hypothesis import given, settings
from hypothesis import strategies as st
from model_text import model_of

from rotorid import InputError, load_model
from rotorid.models.base import _relations, independent_signals
from rotorid.models.equations import split_equations
from rotorid.models.expressions import evaluate, expression
from rotorid.models.parser import read


def of_letters(*equations, parameters="abcd"):
    kinds = (("xyz", "m"), ("F", "N"), (parameters, "kg"))
    return model_of(equations, *(dict.fromkeys(held, unit) for held, unit in kinds))


def rewritten(model, texts):
    names = model.coordinates, model.inputs, model.parameter_names
    return replace(model, texts=tuple(texts), equations=split_equations(texts, *names))


def test_the_seed_s_fourteen():
    model = load_model("three-mass")
    assert model.base.names == names(
        "m1, m2, m2*xi, m2*zeta, m3, I_t, I_t*mu - I_p*mu, I_t*eta - I_p*eta, I_p, "
        "k1, k1*L1, k1*L1^2 + k2*L2^2, k2, k2*L2"
    )
    units = dict(zip(model.base.names, model.base.units, strict=True))
    wanted = {"k1*L1": "N", "k1*L1^2 + k2*L2^2": "N m", "m2*xi": "kg m"}
    wanted["I_t*mu - I_p*mu"] = "kg m^2"
    assert {name: units[name] for name in wanted} == wanted


@pytest.mark.parametrize(
    ("fixed", "names"),
    [
        ({"L1": 0.3}, ["k1", "k2", "k2*L2", "k2*L2^2"]),
        ({"L2": 0.25}, ["k1", "k1*L1", "k1*L1^2", "k2"]),
        ({"L1": 0.3, "L2": 0.3}, ["k1", "k2"]),
        ({"k1": 8e5}, ["k2", "k2*L2", "k2*L2^2 + 800000*L1^2", "L1"]),
        ({"k1": 8e5, "k2": 7e5}, ["L1", "L1^2 + 0.875*L2^2", "L2"]),
        ({"mu": 0.0, "eta": 0.0, "L1": 0.3, "L2": 0.3}, ["I_t", "I_p", "k1", "k2"]),
    ],
)
def test_fixed_values_of_the_seed_s_rotor(fixed, names):
    found = load_model("three-mass").substitute(fixed).base.names
    held = "[kL][12]" if "mu" not in fixed else "[kL][12]|I_"
    assert [name for name in found if re.search(held, name)] == names


@pytest.mark.parametrize(
    ("equations", "names"),
    [
        (["a*x'' + b*x'' = F"], ["a + b"]),
        (["a*x'' - b*x'' = F"], ["a - b"]),
        (["b*x'' - a*x'' = F"], ["a - b"]),
        (["2*a*x'' + 3*b*x'' = F"], ["a + 1.5*b"]),
        (["3*a*x'' - b*x'' = F"], ["a - 0.333333333333*b"]),
        (["a*x'' + 1e9*b*x'' - 1e-9*c*x'' = F"], ["a + 1000000000*b - 1e-09*c"]),
        (["a*x'' + 123456789012345*b*x'' = F"], ["a + 1.23456789012e+14*b"]),
        (["(a + b)^2*x'' = F"], ["a^2 + 2*a*b + b^2"]),
        (["b*a*x + a*b*a*x' = F"], ["a^2*b", "a*b"]),
        (["d*x + c*x' + b*x'' + a = F"], ["a", "b", "c", "d"]),
        (["a*x + b*y + c*(x + y) + d*(x - y) = F"], ["a + c + d", "b + c - d"]),
        (["a*(x + y) + b*(x - y) + c*x + d*y = F"], ["a + 0.5*c + 0.5*d", "b + 0.5*c - 0.5*d"]),
        (["a*x'' + b*x = F", "c*y'' + b*y = 0"], ["a", "b", "c"]),
        (["a*x + b*y = F", "a*y + b*x = 0"], ["a", "b"]),
        (["a*x + b*x = F", "a*y + b*y = 0", "a*z + 2*b*z = 0"], ["a", "b"]),
        (["a*F = b*x + c*x'"], ["b", "c"]),
        (["a^2*x'' + a*x + x^3 = F"], ["a", "a^2"]),
        (["a*x'' + Omega*b*x' + Omega^2*c*x = F"], ["a", "b", "c"]),
        (["a*Omega*x'' + b*x''*Omega = F"], ["a + b"]),
        (["a*pi*x'' + b*x'' + 3*pi*a*x + 3*b*x = F"], ["a + 0.318309886184*b"]),
        (["a*sqrt(2)/2*x + b*x/sqrt(2) = F"], ["a + b"]),
        (["a*cos(pi/3)*x + b*x = F"], ["a + 2*b"]),
    ],
)
def test_names_of_combinations(equations, names):
    model = of_letters(*equations)
    assert list(model.base.names) == names
    values = np.random.default_rng(1).uniform(1, 2, len(model.parameters))
    truth = dict(zip(model.parameter_names, values, strict=True))
    for name, value in zip(names, model.base_values(values), strict=True):
        assert value == pytest.approx(combination(name, truth), rel=1e-11)


@pytest.mark.parametrize(
    ("equation", "names"),
    [
        ("a*sin(x)^2*y'' + a*cos(x)^2*y'' + b*y'' = F", ["a + b"]),
        ("a*abs(x)^2 + b*x^2 = F", ["a + b"]),
        ("a*sign(x)*abs(x) + b*x = F", ["a + b"]),
        ("a*sign(x)^3 + b*sign(x) = F", ["a + b"]),
        ("a*abs(x')*x' + b*x'^2*sign(x') = F", ["a + b"]),
        ("a*abs(x - y) + b*abs(2*y - 2*x) = F", ["a + 2*b"]),
        ("a*cos(2*phi)*x + b*cos(phi)^2*x + c*sin(phi)^2*x = F", ["a - c", "b + c"]),
        ("a*cos(x + y) + b*(cos(x)*cos(y) - sin(x)*sin(y)) = F", ["a + b"]),
        ("a*sin(3*x) + b*sin(x)^3 + c*sin(x) = F", ["a + 0.333333333333*c", "b + 1.33333333333*c"]),
        ("a*cos(x + pi/4) + b*cos(x) + c*sin(x) = F", ["a - 1.41421356237*c", "b + c"]),
        ("a*tan(x)*cos(x) + b*sin(x) = F", ["a + b"]),
        ("a*x/(1 + x) + b/(1 + x) + c = F", ["a + c", "b + c"]),
        ("a*sqrt(x^2 + 1)^2 + b*x^2 + c = F", ["a + c", "b - c"]),
        ("a*sqrt(x^2*(x^2 + 1)) + b*abs(x)*sqrt(1 + x^2) = F", ["a + b"]),
        ("a*exp(x)*exp(-x)*x'' + b*x'' = F", ["a + b"]),
        ("a*exp(2*x) + b*exp(x)^2 + c*exp(-x) = F", ["a + b", "c"]),
        ("a*tanh(x)*(exp(x) + exp(-x)) + b*(exp(x) - exp(-x)) = F", ["a + b"]),
        # near, but not the same
        ("a*sign(x') + b*tanh(x'/0.01) + c*tanh(x'/0.0001) + d*x' = F", ["a", "b", "c", "d"]),
        ("a*sin(1e-4*x) + b*x + c*x^3 = F", ["a", "b", "c"]),
        ("a*sin(x) + b*sin(1.0001*x) + c*cos(x) = F", ["a", "b", "c"]),
        ("a*sqrt(x) + b*sqrt(x + 1e-6) + c*x = F", ["a", "b", "c"]),
        ("a*abs(x) + b*x + c*sqrt(x^2 + 1e-12) = F", ["a", "b", "c"]),
        ("a*cos(phi)*x + b*cos(Omega*t)*x + c*sin(phi)*x = F", ["a", "b", "c"]),
        ("a*sin(x)^2 + b*cos(x)^2 = F", ["a", "b"]),
    ],
)
def test_identities_between_functions(equation, names):
    assert list(of_letters(equation).base.names) == names


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(BANK), st.randoms(use_true_random=False))
def test_the_way_of_writing_changes_nothing(problem, random):
    model = problem.model
    texts = [_shuffled(text, random) for text in model.texts]
    random.shuffle(texts)
    other = rewritten(model, texts)
    assert other.base.names == model.base.names
    assert other.base.units == model.base.units
    np.testing.assert_array_equal(other.base.gather, model.base.gather)
    np.testing.assert_array_equal(other.monomials, model.monomials)


def _shuffled(text, random):
    """Return the same equation, its sides exchanged, scaled, or moved to one side."""
    left, right = text.split("=")
    return random.choice(
        [
            text,
            f"{right} = {left}",
            f"({left}) - ({right}) = 0",
            f"0 = ({right}) - 1*({left})",
            f"-3*({left}) = -({right})*3",
            f"({left})/7 - x_0 = ({right})/7 - x_0".replace("x_0", "2.5"),
        ]
    )


def test_equations_permuted_permute_the_matrices():
    model = load_model("three-mass")
    order = [6, 2, 0, 7, 4, 1, 5, 3]
    other = rewritten(model, [model.texts[i] for i in order])
    values = model.values(model.nominal)
    first, second = (m.require_linear().matrices(values, 880.0) for m in (model, other))
    for name in "MDGKB":
        np.testing.assert_array_equal(getattr(second, name), getattr(first, name)[order])


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
def test_jacobians_agree_with_differences(problem):
    model = problem.model
    values = np.array([problem.truth[name] for name in model.parameter_names])
    for function, jacobian in (
        (model.monomial_values, model.monomial_jacobian(values)),
        (model.base_values, model.base_jacobian(values)),
    ):
        for j, value in enumerate(values):
            step = 1e-5 * abs(value) * np.eye(len(values))[j]
            difference = (function(values + step) - function(values - step)) / (2e-5 * abs(value))
            np.testing.assert_allclose(jacobian[:, j], difference, rtol=1e-7, atol=1e-9)
    at_zero = of_letters("a^2*x'' + a*b*x + b^3*x^3 = F").base_jacobian([0.0, 2.0])
    np.testing.assert_array_equal(at_zero, [[0, 0], [2, 0], [0, 12]])


@pytest.mark.slow
@settings(max_examples=50, deadline=None)
@given(
    st.sampled_from(BANK),
    st.lists(st.fractions(-3, 3, max_denominator=8), min_size=13, max_size=13),
)
def test_substitution_is_the_same_as_writing_the_number(problem, numbers):
    model = problem.model
    values = dict(zip(model.parameter_names, map(float, numbers), strict=False))
    fixed = dict(list(values.items())[::2])
    reduced = model.substitute(fixed)
    free = [values[name] for name in reduced.parameter_names]
    for row in range(len(model.texts)):
        assert _sides(model, list(values.values()), row) == _sides(reduced, free, row)


def _sides(model, values, row):
    """Return the coefficient of each signal of a row, exactly."""
    exact, total = [Fraction(repr(v)) for v in values], Counter()
    for product in model.sides[0]:
        if product.row == row:
            powers = (v**n for v, n in zip(exact, product.monomial, strict=True))
            total[product.signal] += product.coefficient * prod(powers)
    return {signal: value for signal, value in total.items() if value}


@pytest.mark.parametrize(
    ("fixed", "message"),
    [
        ({"L3": 1.0}, "found no parameter 'L3'; expected one of m1"),
        ({"L1": float("nan")}, "found nan for L1; expected a finite number"),
        ({"L1": float("inf")}, "found inf for L1; expected a finite number"),
        ({"k1": 1e300, "L1": 1e300}, "too large or too small"),
    ],
)
def test_substitution_refuses(fixed, message):
    with pytest.raises(InputError, match=message):
        load_model("three-mass").substitute(fixed)


def test_substitution_of_nothing_of_everything_and_of_the_last_again():
    model = load_model("three-mass")
    first = model.substitute({"L1": 0.3})
    assert model.substitute({"L1": 0.3}) is first  # what was substituted last is kept
    other = model.substitute({"L1": 0.4})
    assert (first.held, other.held) == ((("L1", 0.3),), (("L1", 0.4),))
    assert model.substitute({"L1": 0.3}) == first
    assert THREE_MASS.model.substitute({}) is THREE_MASS.model
    everything = THREE_MASS.model.substitute(THREE_MASS.truth)
    assert everything.base.names == ()
    assert everything.base.gather.shape == (0, len(everything.monomials))


def signals_of(*texts):
    return [expression(read(text, frozenset("x"))) for text in texts]


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.data())
def test_identities_are_found_whatever_the_order(data):
    basis = ["1", "sin(x)", "cos(x)", "x", "x*sin(x)", "abs(x)"]
    mixed = ["cos(x)^2", "sin(x)^2", "sin(2*x)^2", "cos(4*x)", "sign(x)*x"]
    found = independent_signals(signals_of(*data.draw(st.permutations(basis + mixed))))
    kept = {s for relation in found.values() for s in relation}
    assert len(kept) == 8  # 1, sin, cos, x, x sin, |x|, cos 2x, cos 4x
    for signal, relation in found.items():
        for x in (-1.3, 0.4, 2.2):
            total = sum(float(c) * evaluate(s, {"x": x}) for s, c in relation.items())
            assert total == pytest.approx(float(evaluate(signal, {"x": x})), abs=1e-12)


@pytest.mark.slow
def test_many_functions_that_are_alike_near_zero_are_independent():
    several = [
        [f"cos({i}*x)" for i in range(60)],
        [f"sin({i}*x/10)" for i in range(1, 12)],
        [f"x^{i}" for i in range(20)] + ["exp(x)", "exp(-x)"],
        [f"tanh(10^{i}*x)" for i in range(5)] + ["sign(x)", "x"],
        [f"1/(x^2 + {i})" for i in range(1, 15)],
        [f"sqrt(x^2 + 10^-{i})" for i in range(8)] + ["abs(x)"],
    ]
    for texts in several:
        signals = signals_of(*texts)
        assert all(r == {s: 1} for s, r in independent_signals(signals).items())
        assert _relations(signals[:14], 10**9)[0] == {}


@pytest.mark.parametrize("loads", [8, 60])
def test_loads_at_many_angles_are_two(loads):
    """Sixty unbalances at angles of their own turn as a cosine and a sine do."""
    angles = [0.01 + 0.057 * k for k in range(loads)]
    text = " + ".join(f"u{k}*Omega^2*cos(phi + {a:.4f})" for k, a in enumerate(angles))
    held = ["a", "b", "c", *(f"u{k}" for k in range(loads))]
    model = of_letters(f"a*x'' + b*x' + c*x = F + {text}", parameters=held)
    assert len(model.base.names) == 3 + 2
