"""Parameters derived from base parameters, and unbalance."""

import numpy as np
import pytest
from bank import ARM, BANK, JEFFCOTT, THREE_MASS
from linear_machines import estimate_of, written

import rotorid as rid
from rotorid.answer.derived import base_from_physical, physical_from_base, with_unbalance

# Physical parameters that follow from base ones, and back.


RNG_SEED = 20


def covariance_of(size, rng, relative=1e-3):
    """Return a covariance with strong correlations, about `relative` of each size."""
    root = rng.standard_normal((len(size), len(size))) + 0.2 * np.eye(len(size))
    root /= np.linalg.norm(root, axis=1)[:, None]
    scale = relative * np.abs(size)
    return root @ root.T * np.outer(scale, scale)


def truth_of(problem):
    """Return the model, its parameters and its base parameters."""
    model = problem.model.substitute(problem.known)
    values = np.array([problem.truth[name] for name in model.parameter_names])
    return model, values, model.base_values(values)


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
def test_physical_parameters_come_back(problem):
    model, _, base = truth_of(problem)
    cov = covariance_of(base, np.random.default_rng(RNG_SEED))
    found = {v.name: v for v in physical_from_base(model, base, cov)}
    assert sorted(found) == sorted(problem.derived)
    for name, value in found.items():
        assert value.value == pytest.approx(problem.truth[name], rel=1e-9)
        assert value.std > 0


def test_what_stays_open_does_not_pull_at_what_is_determined():
    # l1 = m2*l1*r2 / (m2*r2); m1, r1, J1, J2 and m2, r2 themselves stay open.
    model, _, base = truth_of(ARM)
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
    model = written("m", ["m*x'' + a*b*x = F"], "x m", "F N", "m kg, a N/m, b 1")
    cov = np.array([[1e-2, 9e-3], [9e-3, 1e-2]])
    (mass,) = physical_from_base(model, np.array([3.0, 50.0]), cov)
    assert (mass.name, mass.value, mass.std) == ("m", pytest.approx(3.0), pytest.approx(0.1))


def test_minimum_distance_where_there_are_more_base_than_physical_parameters():
    # k*L and k*L^2 beside k: two ways to L, weighed by their covariance.
    equations = ["k*x + k*L*y = F", "k*L*x + k*L^2*y = T"]
    model = written("lever", equations, "x m, y rad", "F N, T N m", "k N/m, L m")
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
    for i, value in enumerate(physical_from_base(model, noisy, cov)):
        assert value.value - truth[i] == pytest.approx(step[i], rel=1e-2)
        assert value.std == pytest.approx(np.sqrt(spread[i, i]), rel=1e-3)


def test_a_covariance_that_rounding_made_indefinite():
    model, _, base = truth_of(THREE_MASS)
    cov = np.outer(1e-3 * base, 1e-3 * base) * (1 + 1e-9 * np.eye(14))
    cov[0, 1] = cov[1, 0] = cov[0, 1] * (1 + 1e-8)
    assert np.linalg.eigvalsh(cov / np.outer(base, base)).min() < 0
    for value in physical_from_base(model, base, cov):
        assert value.value == pytest.approx(THREE_MASS.truth[value.name], rel=1e-9)


def test_physical_parameters_may_be_zero_or_negative():
    model, values, _ = truth_of(THREE_MASS)
    values = values * np.where(np.arange(len(values)) >= 9, -1.0, 1.0)
    values[9] = 0.0  # xi
    base = model.base_values(values)
    found = physical_from_base(model, base, np.diag((1e-4 * np.abs(base) + 1e-9) ** 2))
    np.testing.assert_allclose([v.value for v in found], values, rtol=1e-8, atol=1e-12)


def test_what_follows_from_a_part_of_the_base_parameters():
    model, _, base = truth_of(THREE_MASS)
    cov = np.diag((1e-3 * base) ** 2)
    base[[2, 9]] = np.nan  # m2*xi, k1; the latter follows from k1*L1^2 and k1*L1 all the same
    found = {v.name: v.value for v in physical_from_base(model, base, cov)}
    assert set(found) == set(THREE_MASS.derived) - {"xi"}
    for name, value in found.items():
        assert value == pytest.approx(THREE_MASS.truth[name], rel=1e-9)
    assert physical_from_base(model, np.full(14, np.nan), np.eye(14)) == ()


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
def test_deviations_of_base_parameters_agree_with_scatter(problem):
    model, values, base = truth_of(problem)
    rng = np.random.default_rng(RNG_SEED)
    cov = covariance_of(values, rng, 1e-4)
    draws = values + rng.standard_normal((4000, len(values))) @ np.linalg.cholesky(cov).T
    scatter = np.std([model.base_values(draw) for draw in draws], axis=0)
    found = base_from_physical(model, values, cov, model.parameter_names)
    assert [v.name for v in found] == list(problem.base)
    np.testing.assert_allclose([v.value for v in found], base, rtol=1e-13)
    np.testing.assert_allclose([v.std for v in found], scatter, rtol=0.06)


# Unbalance as amount and angle: against closed forms, and draws from the covariance.


def made(name: str, deviation: float) -> tuple[rid.Model, rid.Estimate]:
    model = rid.load_model(name)
    sizes = deviation * np.array(list(model.nominal.values()))
    return model, estimate_of(model, covariance=np.diag(sizes**2))


def test_planes_of_the_three_mass_rotor():
    model, estimate = made("three-mass", 1e-3)
    static, couple = with_unbalance(model, estimate).unbalance
    value = {v.name: v.value for v in estimate.parameters}
    assert (static.plane, static.unit) == ("x2, y2", "kg m")
    assert (couple.plane, couple.unit) == ("theta_x, theta_y", "kg m^2")
    heavy = value["m2"] * (value["xi"] + 1j * value["zeta"])
    tilted = (value["I_t"] - value["I_p"]) * (value["mu"] + 1j * value["eta"])
    for found, wanted in ((static, heavy), (couple, tilted)):
        assert found.amount * np.exp(1j * found.angle_rad) == pytest.approx(wanted, rel=1e-12)


def test_what_grows_otherwise_leaves_no_rounding():
    text = rid.load_model("jeffcott").file_text
    model = rid.models.parse_model(text.replace("Omega^2", "Omega"))
    assert with_unbalance(model, estimate_of(model, std=1e-3)).unbalance == ()


def test_deviations_are_those_of_draws():
    model, estimate = made("rigid", 1e-3)
    value = np.array([v.value for v in estimate.parameters])
    rng = np.random.default_rng(3)
    draws = value * (1 + 1e-3 * rng.standard_normal((20000, len(value))))
    names = list(model.parameter_names)
    m, xi, zeta = (draws[:, names.index(n)] for n in ("m", "xi", "zeta"))
    static = with_unbalance(model, estimate).unbalance[0]
    amounts = m * (xi + 1j * zeta)
    assert static.std == pytest.approx(np.abs(amounts).std(), rel=0.03)
    assert static.angle_std_rad == pytest.approx(np.angle(amounts).std(), rel=0.03)


@pytest.mark.parametrize("problem", [THREE_MASS, JEFFCOTT], ids=lambda p: p.name)
@pytest.mark.parametrize("method", ["batch", "ml"])
def test_both_methods_state_the_same(problem, method):
    found = rid.identify(problem.model, problem.records, method).unbalance
    truth = estimate_of(problem.model, problem.truth)
    exact = with_unbalance(problem.model, truth).unbalance
    assert [u.plane for u in found] == [u.plane for u in exact]
    for one, other in zip(found, exact, strict=True):
        assert one.amount == pytest.approx(other.amount, rel=1e-6)
        assert one.angle_rad == pytest.approx(other.angle_rad, rel=1e-6)


def test_what_is_not_told_has_no_unbalance():
    model, estimate = made("three-mass", 1e-3)
    unknown = tuple(rid.Value(v.name, v.unit, np.nan) for v in estimate.parameters)
    lost = estimate.with_(parameters=unknown, status="not_converged")
    for less in (lost, estimate.with_(parameters=estimate.parameters[1:])):
        assert with_unbalance(model, less).unbalance == ()
    bare = estimate.with_(covariance=np.full((13, 13), np.nan), status="not_identifiable")
    assert with_unbalance(model, bare).unbalance[0].std is None
    emps = rid.load_model("emps")
    assert with_unbalance(emps, estimate_of(emps, std=1.0)).unbalance == ()
