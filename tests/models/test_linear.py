"""M, D, G, K, B and g against matrices written by hand, line by line."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bank import (
    BANK,
    HOIST,
    TABLE,
    rigid_load,
    rigid_matrices,
    table,
    three_mass_load,
    three_mass_matrices,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid import InputError, ModelError, load_model, parse_model
from rotorid.data.observation import bind
from rotorid.linear.regression import Regression
from rotorid.signals.spectrum import line_spectra

SPEEDS = (0.0, 1.0, 2 * np.pi * 140, -300.0)
LINEAR = [p for p in BANK if p.linear]


def namespace(model, seed):
    """Return random values of the parameters, as an array and by name."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.1, 2.0, len(model.parameters)) * rng.choice([-1, 1], 1)
    return values, SimpleNamespace(**dict(zip(model.parameter_names, values, strict=True)))


def jeffcott_matrices(p):
    two = np.eye(2)
    return p.m * two, p.c * two, 0 * two, p.k * two, two


def jeffcott_load(p, speed, phi):
    c, s = np.cos(phi), np.sin(phi)
    return p.m * speed**2 * np.column_stack([p.xi * c - p.zeta * s, p.xi * s + p.zeta * c])


BY_HAND = {
    "three-mass": (three_mass_matrices, three_mass_load),
    "rigid": (rigid_matrices, rigid_load),
    "jeffcott": (jeffcott_matrices, jeffcott_load),
}


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("name", BY_HAND)
def test_matrices_by_hand(name, speed):
    model, matrices = load_model(name), BY_HAND[name][0]
    values, p = namespace(model, 3)
    found = model.require_linear().matrices(values, speed)
    for letter, expected in zip("MDGKB", matrices(p), strict=True):
        np.testing.assert_allclose(getattr(found, letter), expected, rtol=1e-14, atol=1e-15)
    assert (found.M == found.M.T).all()
    assert (found.K == found.K.T).all()
    assert (found.G == -found.G.T).all()


@pytest.mark.parametrize("name", BY_HAND)
def test_loads_by_hand(name):
    model, load = load_model(name), BY_HAND[name][1]
    values, p = namespace(model, 6)
    phi, time = np.linspace(-4, 9, 57), np.linspace(0, 1, 57)
    mu = model.monomial_values(values)
    for speed in SPEEDS:
        found = model.require_linear().load_columns(time, phi, speed) @ mu
        np.testing.assert_allclose(found, load(p, speed, phi), rtol=1e-12, atol=1e-9)
    shaped = model.require_linear().load_columns(time.reshape(3, 19), phi.reshape(3, 19), 5.0)
    assert shaped.shape == (3, 19, len(model.texts), len(model.monomials))


@pytest.mark.parametrize("problem", LINEAR, ids=lambda p: p.name)
def test_regressor_form_is_the_dynamic_stiffness_on_random_lines(problem):
    """Phi base + known - B u = Z q - g - B u on every line, at any values of the parameters."""
    record = problem.records[0]
    rng = np.random.default_rng(9)
    shape = record.spectra.shape
    noise = rng.standard_normal((*shape, 2)) @ np.array([1, 1j])
    noise[:, record.harmonics == 0] = noise[:, record.harmonics == 0].real
    record = replace(record, spectra=noise)
    model = problem.model.substitute(problem.known)
    values = rng.uniform(0.5, 2.0, len(model.parameters))
    regression = Regression(bind(model, record))
    left = regression.residual(model.base_values(values))
    linear, mu = model.require_linear(), model.monomial_values(values)
    q = regression.coordinates.mean(axis=0)
    u = record.mean_spectrum[:, [record.index(name) for name in model.inputs]]
    z = linear.dynamic_stiffness(record.omega, values, record.speed)
    loads = linear.load_columns(record.time, record.angle, record.speed).mean(axis=0)
    columns = line_spectra(loads.reshape(record.samples, -1), record.harmonics)
    g = columns.reshape(len(record.harmonics), linear.rows, linear.monomials) @ mu
    right = np.einsum("krj,kj->kr", z, q) - g - u @ linear.input_matrix(mu).T
    np.testing.assert_allclose(left, right, rtol=1e-10, atol=1e-9 * np.abs(right).max())


def test_what_depends_on_the_speed_otherwise_is_in_d_and_k():
    model = parse_model(
        table(
            "rotating damping and a softening bearing",
            [
                "m*x'' + c*x' + Omega*h*y' + (k - s*Omega^2)*x + c*Omega*y + d*Omega^2*x' = F",
                "m*y'' + c*y' - 2*Omega*h*x' + k*y - c*Omega*x = 0",
            ],
            coordinates={"x": "m", "y": "m"},
            inputs={"F": "N"},
            parameters={n: "kg" for n in ("m", "c", "h", "k", "s", "d")},
        )
    )
    m, c, h, k, s, d = values = np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
    W = 0.5
    found = model.require_linear().matrices(values, W)
    np.testing.assert_allclose(found.M, m * np.eye(2))
    np.testing.assert_allclose(found.D, [[c + d * W**2, 0], [0, c]])
    np.testing.assert_allclose(found.G, [[0, h], [-2 * h, 0]])
    np.testing.assert_allclose(found.K, [[k - s * W**2, c * W], [-c * W, k]])
    np.testing.assert_allclose(found.B, [[1], [0]])


def test_constants_are_loads():
    linear = HOIST.model.require_linear()
    columns = linear.load_columns(np.zeros(4), np.zeros(4), 0.0)
    load = columns @ HOIST.model.monomial_values([30.0, 50.0])
    np.testing.assert_allclose(load, -9.81 * 30 * np.ones((4, 1)))


def test_inputs_in_several_rows():
    B = TABLE.model.require_linear().matrices(np.ones(5)).B
    np.testing.assert_allclose(B, [[2, 2, 0], [-0.25, 0.5, 1]])
    np.testing.assert_allclose(TABLE.model.input_matrix, B)


def test_a_parameter_that_multiplies_an_input():
    model = load_model("rigid")
    with pytest.raises(ModelError, match="equation 3: found L_a, which multiplies the input F_ya"):
        _ = model.input_matrix
    B = model.substitute({"L_a": 0.2, "L_b": 0.25}).input_matrix
    np.testing.assert_allclose(B[2], [0, 0.2, 0, -0.25])


@pytest.mark.parametrize(
    ("equation", "term"),
    [
        ("m*x'' + k*x^2 = F", r"x\*\*2|x\^2"),
        ("m*x'' + k*sin(x) = F", r"sin\(x\)"),
        ("m*x'' + k*x*cos(phi) = F", r"x\*cos\(phi\)"),
        ("m*x'' + k*sign(x') = F", r"sign\(x'\)"),
        ("m*x'' + k*x*t = F", r"t\*x"),
        ("m*x'' + k*x*x' = F", r"x\*x'"),
        ("m*x''/x + k = F", "x''/x"),
    ],
)
def test_equations_that_are_not_linear(equation, term):
    model = parse_model(
        table(
            "n",
            [equation],
            coordinates={"x": "m"},
            inputs={"F": "N"},
            parameters={"m": "kg", "k": "N"},
        )
    )
    assert model.linear is None
    with pytest.raises(ModelError, match=f"equation 1: found the term {term}; .*use ls"):
        model.require_linear()


def test_a_division_by_the_speed_needs_a_speed():
    model = parse_model(
        table(
            "n",
            ["m*x'' + k/Omega*x' + d*x = F + m*cos(phi)/Omega"],
            coordinates={"x": "m"},
            inputs={"F": "N"},
            parameters={"m": "kg", "k": "N", "d": "N/m"},
        )
    )
    linear = model.require_linear()
    np.testing.assert_allclose(linear.matrices([1.0, 2.0, 3.0], 4.0).D, [[0.5]])
    for call in (
        lambda: linear.matrices([1.0, 2.0, 3.0], 0.0),
        lambda: linear.load_columns(np.zeros(3), np.zeros(3), 0.0),
    ):
        with pytest.raises(
            InputError, match=r"Omega.* without a finite value at the speed 0 rad/s"
        ):
            call()


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(LINEAR), st.integers(0, 2**31))
def test_response_solves_the_equations(problem, seed):
    model = problem.model
    rng = np.random.default_rng(seed)
    values = model.values(problem.truth)
    linear = model.require_linear()
    omega = rng.uniform(10, 3000, 4)
    shape = (4, linear.rows)
    right = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    q = linear.response(omega, values, 40.0, right)
    z = linear.dynamic_stiffness(omega, values, 40.0)
    np.testing.assert_allclose(np.einsum("krj,kj->kr", z, q), right, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("name", BY_HAND)
def test_dynamic_stiffness_by_hand(name, speed):
    model = load_model(name)
    values, p = namespace(model, 4)
    M, D, G, K, _ = BY_HAND[name][0](p)
    omega = np.array([0.0, 1.0, 125.7, 9e4])
    found = model.require_linear().dynamic_stiffness(omega, values, speed)
    for w, z in zip(omega, found, strict=True):
        np.testing.assert_allclose(z, -(w**2) * M + 1j * w * (D + speed * G) + K, rtol=1e-13)


def test_potential_energy_of_the_seed_s_rotor():
    """K is the Hessian of the potential from which the paper's (7) follow."""
    model = load_model("three-mass")
    values, p = namespace(model, 7)
    K = model.require_linear().matrices(values).K

    def potential(q):
        x1, y1, x2, y2, tx, ty, x3, y3 = q
        first = (x1 - x2 + p.L1 * ty) ** 2 + (y1 - y2 - p.L1 * tx) ** 2
        second = (x2 - x3 + p.L2 * ty) ** 2 + (y2 - y3 - p.L2 * tx) ** 2
        return p.k1 / 2 * first + p.k2 / 2 * second

    q = np.random.default_rng(8).standard_normal(8)
    assert q @ K @ q / 2 == pytest.approx(potential(q), rel=1e-12)
