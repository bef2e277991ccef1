"""Physical parameters that follow from base ones, and back."""

import numpy as np
import pytest
from bank import ARM, BANK, THREE_MASS, combination, table

from rotorid import parse_model
from rotorid.answer.derived import base_from_physical, physical_from_base

RNG_SEED = 20


def covariance_of(size, rng, relative=1e-3):
    """Return a covariance with strong correlations, about `relative` of each size."""
    root = rng.standard_normal((len(size), len(size))) + 0.2 * np.eye(len(size))
    root /= np.linalg.norm(root, axis=1)[:, None]
    scale = relative * np.abs(size)
    return root @ root.T * np.outer(scale, scale)


def truth_of(problem):
    model = problem.model.substitute(problem.known)
    values = np.array([problem.truth[name] for name in model.parameter_names])
    return model, values


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
def test_base_values_follow_their_names(problem):
    model, values = truth_of(problem)
    found = dict(zip(model.base.names, model.base_values(values), strict=True))
    assert list(found) == list(problem.base)
    for name, value in found.items():
        assert value == pytest.approx(combination(name, problem.truth), rel=1e-13)


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
def test_physical_parameters_come_back(problem):
    model, values = truth_of(problem)
    base = model.base_values(values)
    cov = covariance_of(base, np.random.default_rng(RNG_SEED))
    found = {v.name: v for v in physical_from_base(model, base, cov)}
    assert sorted(found) == sorted(problem.derived)
    for name, value in found.items():
        assert value.value == pytest.approx(problem.truth[name], rel=1e-9)
        assert value.std is not None
        assert value.std > 0


def test_what_stays_open_does_not_pull_at_what_is_determined():
    # l1 = m2*l1*r2 / (m2*r2); m1, r1, J1, J2 and m2, r2 themselves stay open.
    model, values = truth_of(ARM)
    base = model.base_values(values)
    rng = np.random.default_rng(RNG_SEED)
    product, arm = base[2], base[3]
    for _ in range(10):
        cov = covariance_of(base, rng)
        (length,) = physical_from_base(model, base, cov)
        gradient = np.array([0, 0, 1 / arm, -product / arm**2, 0])
        assert length.name == "l1"
        assert length.value == pytest.approx(0.5, rel=1e-9)
        assert length.std == pytest.approx(np.sqrt(gradient @ cov @ gradient), rel=1e-6)


def test_a_product_that_stays_open_leaves_the_correlated_mass_alone():
    text = table(
        "m",
        ["m*x'' + a*b*x = F"],
        coordinates={"x": "m"},
        inputs={"F": "N"},
        parameters={"m": "kg", "a": "N/m", "b": "1"},
    )
    cov = np.array([[1e-2, 9e-3], [9e-3, 1e-2]])
    (mass,) = physical_from_base(parse_model(text), np.array([3.0, 50.0]), cov)
    assert (mass.name, mass.value, mass.std) == ("m", pytest.approx(3.0), pytest.approx(0.1))


def test_minimum_distance_where_there_are_more_base_than_physical_parameters():
    # k*L and k*L^2 beside k: two ways to L, weighed by their covariance.
    text = table(
        "lever",
        ["k*x + k*L*y = F", "k*L*x + k*L^2*y = T"],
        coordinates={"x": "m", "y": "rad"},
        inputs={"F": "N", "T": "N m"},
        parameters={"k": "N/m", "L": "m"},
    )
    model = parse_model(text)
    assert model.base.names == ("k", "k*L", "k*L^2")
    rng = np.random.default_rng(RNG_SEED)
    truth = np.array([200.0, 0.3])
    exact = model.base_values(truth)
    cov = covariance_of(exact, rng, 1e-5)
    noisy = exact + np.linalg.cholesky(cov) @ rng.standard_normal(3)
    jacobian = np.array([[1, 0], [0.3, 200], [0.09, 120]])
    information = np.linalg.inv(cov)
    spread = np.linalg.inv(jacobian.T @ information @ jacobian)
    step = spread @ jacobian.T @ information @ (noisy - exact)  # generalized least squares
    found = physical_from_base(model, noisy, cov)
    for i, value in enumerate(found):
        assert value.value - truth[i] == pytest.approx(step[i], rel=1e-2)
        assert value.std == pytest.approx(np.sqrt(spread[i, i]), rel=1e-3)


def test_a_covariance_that_rounding_made_indefinite():
    model, values = truth_of(THREE_MASS)
    base = model.base_values(values)
    cov = np.outer(1e-3 * base, 1e-3 * base) * (1 + 1e-9 * np.eye(14))
    cov[0, 1] = cov[1, 0] = cov[0, 1] * (1 + 1e-8)
    assert np.linalg.eigvalsh(cov / np.outer(base, base)).min() < 0
    for value in physical_from_base(model, base, cov):
        assert value.value == pytest.approx(THREE_MASS.truth[value.name], rel=1e-9)


def test_physical_parameters_may_be_zero_or_negative():
    model, values = truth_of(THREE_MASS)
    values = values * np.where(np.arange(len(values)) >= 9, -1.0, 1.0)
    values[9] = 0.0  # xi
    base = model.base_values(values)
    found = physical_from_base(model, base, np.diag((1e-4 * np.abs(base) + 1e-9) ** 2))
    np.testing.assert_allclose([v.value for v in found], values, rtol=1e-8, atol=1e-12)


def test_what_follows_from_a_part_of_the_base_parameters():
    model, values = truth_of(THREE_MASS)
    base = model.base_values(values)
    cov = np.diag((1e-3 * base) ** 2)
    base[[2, 9]] = np.nan  # m2*xi, k1; the latter follows from k1*L1^2 and k1*L1 all the same
    found = {v.name: v.value for v in physical_from_base(model, base, cov)}
    assert set(found) == set(THREE_MASS.derived) - {"xi"}
    for name, value in found.items():
        assert value == pytest.approx(THREE_MASS.truth[name], rel=1e-9)


def test_nothing_follows_from_nothing():
    model, _ = truth_of(THREE_MASS)
    assert physical_from_base(model, np.full(14, np.nan), np.eye(14)) == ()


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
def test_deviations_of_base_parameters_agree_with_scatter(problem):
    model, values = truth_of(problem)
    rng = np.random.default_rng(RNG_SEED)
    cov = covariance_of(values, rng, 1e-4)
    draws = values + rng.standard_normal((4000, len(values))) @ np.linalg.cholesky(cov).T
    scatter = np.std([model.base_values(draw) for draw in draws], axis=0)
    found = base_from_physical(model, values, cov)
    assert [v.name for v in found] == list(problem.base)
    np.testing.assert_allclose([v.value for v in found], model.base_values(values), rtol=1e-13)
    np.testing.assert_allclose([v.std for v in found], scatter, rtol=0.06)
