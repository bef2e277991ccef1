"""Constraints: eliminated exactly, or refused with the reason."""

from dataclasses import replace

import numpy as np
import pytest
from bank import ARM, JEFFCOTT, RIGID, THREE_MASS, TRAIN

from rotorid import Batch, Constraint, InputError, LeastSquares, ModelError, Sequential
from rotorid.data.observation import bind_all
from rotorid.linear.family import LeastSquaresProblem
from rotorid.models.constraints import constraint_polynomial, eliminate

FAMILY = (LeastSquares, Batch, Sequential)
family = pytest.mark.parametrize("method", FAMILY, ids=lambda m: m.__name__)


def noisy(problem, periods=20, level=0.02, seed=1):
    clean = problem.record(periods=2)
    noise = dict(zip(clean.names, level * clean.samples.std(axis=0), strict=True))
    return problem.periodic(periods=periods, noise=noise, rng=np.random.default_rng(seed))


CONSTRAINTS = [
    ("m1 + m2 + m3", 12.98878),
    ("2*m1 - 2*m3 + 1", 1.0),
    ("k1", 8.8357e5),
    ("k1*L1^2 + k2*L2^2", 2 * 8.8357e5 * 0.09),
    ("L1*k1 - k2*L2", 0.0),
    ("I_t*mu - I_p*mu", -1.3145 / (2 * np.pi * 140) ** 2),
    ("mu*(I_t - I_p)/3", -1.3145 / (2 * np.pi * 140) ** 2 / 3),
    ("m1 + k1/1e6", 0.83339 + 0.88357),
]


@pytest.mark.sampled(6)
@family
@pytest.mark.parametrize(("expression", "value"), CONSTRAINTS)
def test_a_constraint_holds_exactly(method, expression, value):
    constraint = Constraint(expression, value)
    estimate = method(constraints=(constraint,)).estimate(THREE_MASS.model, [noisy(THREE_MASS)])
    assert estimate.status == "ok"
    model = THREE_MASS.model
    index = {tuple(int(e) for e in m): i for i, m in enumerate(model.monomials)}
    base = np.array([estimate.value(name) for name in model.base.names])
    row, offset = np.zeros(len(index)), 0.0
    for monomial, coefficient in constraint_polynomial(model, constraint).items():
        if any(monomial):
            row[index[monomial]] += coefficient
        else:
            offset = coefficient
    weights = np.linalg.lstsq(model.base.gather.T, row, rcond=None)[0]
    size = np.abs(weights * base).max()
    assert weights @ base + offset == pytest.approx(value, abs=1e-12 * size)
    # ... and is known without error: the covariance has no component along it.
    spread = weights @ estimate.covariance @ weights
    assert spread <= 1e-20 * size**2


@family
def test_all_constraints_together_on_noise_free_data(method):
    constraints = tuple(Constraint(e, v) for e, v in CONSTRAINTS[:6])
    estimate = method(constraints=constraints).estimate(THREE_MASS.model, THREE_MASS.records)
    for name, value in THREE_MASS.true_base.items():
        assert estimate.value(name) == pytest.approx(value, rel=1e-8)


def test_the_constrained_minimum_by_lagrange():
    """min |X theta - b|^2 with row @ theta = value, by the KKT equations."""
    record = noisy(TRAIN)
    model = TRAIN.model
    constraint = Constraint("a + b + c", 4.4)
    found = LeastSquares(constraints=(constraint,)).estimate(model, [record])
    problem = LeastSquaresProblem.of(bind_all(model, [record]), {}, ())
    (regression,) = problem.regressions
    scale = np.array(list(TRAIN.true_base.values()))
    design = regression.design * scale
    matrix = np.concatenate([design.real, design.imag]).reshape(-1, 6)
    right = np.concatenate([regression.target.real, regression.target.imag]).reshape(-1)
    row = np.array([1, 1, 1, 0, 0, 0]) * scale
    kkt = np.block([[matrix.T @ matrix, row[:, None]], [row, 0]])
    expected = np.linalg.solve(kkt, [*(matrix.T @ right), 4.4])[:6] * scale
    np.testing.assert_allclose([found.value(n) for n in TRAIN.base], expected, rtol=1e-8)


@family
def test_a_constraint_cures_what_one_line_leaves_open(method):
    one = replace(JEFFCOTT, harmonics=(4,))
    plain = method().estimate(one.model, one.records)
    assert plain.status == "not_identifiable"
    cured = method(constraints=(Constraint("k - 225000*m", 0.0),))
    estimate = cured.estimate(one.model, one.records)
    assert estimate.status == "ok"
    for name, value in one.true_base.items():
        assert estimate.value(name) == pytest.approx(value, rel=1e-8)


@family
def test_constraints_that_leave_nothing_free(method):
    constraints = tuple(Constraint(n, v) for n, v in TRAIN.truth.items())
    with pytest.raises(InputError, match="found every parameter constrained"):
        method(constraints=constraints).estimate(TRAIN.model, TRAIN.records)
    estimate = method(constraints=constraints[1:]).estimate(TRAIN.model, TRAIN.records)
    assert estimate.value("a") == pytest.approx(1.0, rel=1e-9)


def test_names_of_the_free_unknowns():
    """The unknown that is kept gives the name, also where another answers to it more."""
    constraint = Constraint("a - b", 0.0), Constraint("k - 5*h + 2000*c", 0.0)
    problem = LeastSquaresProblem.of(bind_all(TRAIN.model, TRAIN.records), {}, constraint)
    elimination = problem.elimination
    assert len(problem.names) == 4
    for position, index in enumerate(elimination.kept):
        assert elimination.basis[index, position] == 1
        assert elimination.origin[index] == 0
        assert problem.names[position] == TRAIN.model.base.names[index]


@family
def test_constraints_with_fixed_values(method):
    """A fixed parameter may stand in a constraint: its value counts."""
    knowing = method(fixed={"a": 1.0}, constraints=(Constraint("a + b + c", 4.5),))
    estimate = knowing.estimate(TRAIN.model, TRAIN.records)
    assert estimate.value("b") + estimate.value("c") == pytest.approx(3.5, rel=1e-12)
    assert estimate.value("h") == pytest.approx(5000.0, rel=1e-9)
    fixed = {**RIGID.known, "m": 8.0}
    lever = Constraint("I_t + m*L_a^2", 0.21 + 8.0 * 0.04)
    estimate = method(fixed=fixed, constraints=(lever,)).estimate(RIGID.model, RIGID.records)
    assert estimate.value("I_t") == pytest.approx(0.21, rel=1e-12)


@pytest.mark.parametrize(
    ("constraints", "fixed", "message"),
    [
        ([Constraint("m1", 0.8, 0.01)], {}, "m1' with a deviation; expected exact .*; use ml"),
        ([Constraint("L1", 0.3)], {}, "L1', not linear in the base parameters; .*; use ml"),
        ([Constraint("k1*L1^2", 1.0)], {}, "not linear in the base parameters"),
        ([Constraint("I_t*mu", 1.0)], {}, "not linear in the base parameters"),
        ([Constraint("m1*m2", 1.0)], {}, "not linear in the base parameters"),
        ([Constraint("m1^2", 1.0)], {}, "not linear in the base parameters"),
        ([Constraint("m1", 1.0), Constraint("2*m1", 2.0)], {}, "repeat or contradict one another"),
        ([Constraint("m1", 1.0), Constraint("m1", 2.0)], {}, "repeat or contradict one another"),
        ([Constraint(f"{i}*m1 + m2", 1.0) for i in range(16)], {}, "repeat or contradict"),
        ([Constraint("2", 2.0)], {}, "which holds no free parameter"),
        ([Constraint("m1 - m1", 0.0)], {}, "which holds no free parameter"),
        ([Constraint("m1", 0.8)], {"m1": 0.8}, "which holds no free parameter"),
    ],
)
@family
def test_refused_constraints(method, constraints, fixed, message):
    with pytest.raises(InputError, match=message):
        method(constraints=tuple(constraints), fixed=fixed).estimate(
            THREE_MASS.model, THREE_MASS.records
        )


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("m1 + q", "unknown name 'q'"),
        ("m1/m2", "a division by m2, which holds m2"),
        ("sqrt(m1)", "sqrt of m1"),
        ("sin(m1)", "sin of m1"),
        ("x1 + m1", "unknown name 'x1'"),
        ("m1 +", "found the end of the text"),
        ("", "found the end of the text"),
        ("m1 = 3", "found '='"),
        ("m" * 1000, "unknown name 'mmm"),
    ],
)
def test_texts_that_are_no_polynomial(expression, message):
    with pytest.raises(ModelError, match=rf"^constraint '.*': .*{message}") as caught:
        constraint_polynomial(THREE_MASS.model, Constraint(expression, 1.0))
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("value", "std"), [(np.nan, 0.0), (np.inf, 0.0), (1.0, -1.0), (1.0, np.nan), (1.0, np.inf)]
)
def test_numbers_of_a_constraint(value, std):
    with pytest.raises(InputError, match="finite numbers, the deviation not negative"):
        Constraint("m1", value, std)


def test_polynomials():
    model = TRAIN.model
    found = constraint_polynomial(model, Constraint("(a + 2*b)^2 - pi*c + 3", 0.0))
    names = model.parameter_names
    by_name = {
        tuple((n, p) for n, p in zip(names, m, strict=True) if p): c for m, c in found.items()
    }
    assert by_name == {
        (("a", 2),): 1,
        (("a", 1), ("b", 1)): 4,
        (("b", 2),): 4,
        (("c", 1),): pytest.approx(-np.pi),
        (): 3,
    }


def test_no_constraints_is_the_identity():
    elimination = eliminate(ARM.model, ())
    np.testing.assert_array_equal(elimination.basis, np.eye(5))
    np.testing.assert_array_equal(elimination.origin, np.zeros(5))
    assert elimination.kept == tuple(range(5))
