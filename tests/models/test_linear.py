"""Linear models: matrices, modal coordinates, forces in balance, turned about."""

from dataclasses import replace

import numpy as np
import pytest
from bank import BANK, HOIST, TABLE
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_machines import estimate_of
from model_text import model_of, model_text
from rotor_bank import jeffcott_rotor, rigid_rotor, three_mass_rotor

import rotorid as rid
from rotorid import InputError, ModelError, load_model, parse_model
from rotorid.answer.derived import with_unbalance
from rotorid.likelihood.rivals_model import find_candidates
from rotorid.linear.regression import Regression
from rotorid.models import modal
from rotorid.models.modal import _scales, eigenmodes, parted
from rotorid.models.structure import find_structure, force_balance
from rotorid.results.machine import machine_of
from rotorid.signals.spectrum import line_spectra
from rotorid.testing import bind

# M, D, G, K, B and g against matrices written by hand, line by line.


SPEEDS = (0.0, 1.0, 2 * np.pi * 140, -300.0)
LINEAR = [p for p in BANK if p.linear]


def named_values(model, seed):
    """Return random values of the parameters, as an array and by name."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0.1, 2.0, len(model.parameters)) * rng.choice([-1, 1], 1)
    return values, dict(zip(model.parameter_names, values, strict=True))


BY_HAND = {"three-mass": three_mass_rotor, "rigid": rigid_rotor, "jeffcott": jeffcott_rotor}


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("name", BY_HAND)
def test_matrices_by_hand(name, speed):
    model = load_model(name)
    values, p = named_values(model, 3)
    found = model.require_linear().matrices(values, speed)
    for letter, expected in zip("MDGKB", BY_HAND[name](p)[:5], strict=True):
        np.testing.assert_allclose(getattr(found, letter), expected, rtol=1e-14, atol=1e-15)
    assert (found.M == found.M.T).all()
    assert (found.K == found.K.T).all()
    assert (found.G == -found.G.T).all()


@pytest.mark.parametrize("name", BY_HAND)
def test_loads_by_hand(name):
    model = load_model(name)
    values, p = named_values(model, 6)
    phi, time = np.linspace(-4, 9, 57), np.linspace(0, 1, 57)
    mu = model.monomial_values(values)
    for speed in SPEEDS:
        found = model.require_linear().load_columns(time, phi, speed) @ mu
        np.testing.assert_allclose(found, BY_HAND[name](p).load(speed, phi), rtol=1e-12, atol=1e-9)
    shaped = model.require_linear().load_columns(time.reshape(3, 19), phi.reshape(3, 19), 5.0)
    assert shaped.shape == (3, 19, len(model.texts), len(model.monomials))


def test_constants_are_loads_and_inputs_stand_in_several_rows():
    columns = HOIST.model.require_linear().load_columns(np.zeros(4), np.zeros(4), 0.0)
    load = columns @ HOIST.model.monomial_values([30.0, 50.0])
    np.testing.assert_allclose(load, -9.81 * 30 * np.ones((4, 1)))
    B = TABLE.model.require_linear().matrices(np.ones(5)).B
    np.testing.assert_allclose(B, [[2, 2, 0], [-0.25, 0.5, 1]])
    np.testing.assert_allclose(TABLE.model.input_matrix, B)


@pytest.mark.parametrize("problem", LINEAR, ids=lambda p: p.name)
def test_regressor_form_is_the_dynamic_stiffness_on_random_lines(problem):
    """Phi base + known - B u = Z q - g - B u on every line, at any values of the parameters."""
    record = problem.records[0]
    rng = np.random.default_rng(9)
    noise = rng.standard_normal((*record.spectra.shape, 2)) @ np.array([1, 1j])
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
    equations = [
        "m*x'' + c*x' + Omega*h*y' + (k - s*Omega^2)*x + c*Omega*y + d*Omega^2*x' = F",
        "m*y'' + c*y' - 2*Omega*h*x' + k*y - c*Omega*x = 0",
    ]
    units = dict.fromkeys("mchksd", "kg")
    model = parse_model(model_text("rotating damping", equations, "x m, y m", "F N", units))
    m, c, h, k, s, d = values = np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0])
    W = 0.5
    found = model.require_linear().matrices(values, W)
    np.testing.assert_allclose(found.M, m * np.eye(2))
    np.testing.assert_allclose(found.D, [[c + d * W**2, 0], [0, c]])
    np.testing.assert_allclose(found.G, [[0, h], [-2 * h, 0]])
    np.testing.assert_allclose(found.K, [[k - s * W**2, c * W], [-c * W, k]])
    np.testing.assert_allclose(found.B, [[1], [0]])


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
    model = parse_model(model_text("n", [equation], "x m", "F N", "m kg, k N"))
    assert model.linear is None
    with pytest.raises(ModelError, match=f"equation 1: found the term {term}; .*use ls"):
        model.require_linear()


def test_a_division_by_the_speed_needs_a_speed():
    equation = "m*x'' + k/Omega*x' + d*x = F + m*cos(phi)/Omega"
    model = parse_model(model_text("n", [equation], "x m", "F N", "m kg, k N, d N/m"))
    linear = model.require_linear()
    np.testing.assert_allclose(linear.matrices([1.0, 2.0, 3.0], 4.0).D, [[0.5]])
    message = r"Omega.* without a finite value at the speed 0 rad"
    with pytest.raises(InputError, match=message):
        linear.matrices([1.0, 2.0, 3.0], 0.0)
    with pytest.raises(InputError, match=message):
        linear.load_columns(np.zeros(3), np.zeros(3), 0.0)


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


# Eigenvalues of the quadratic pencil against closed forms and numpy's.


CHAIN_M = np.diag([2.0, 3.0, 1.5])
CHAIN_K = np.array([[1.5e6, -1e6, 0], [-1e6, 3e6, -2e6], [0, -2e6, 2e6]])
CHAIN_D = np.array([[30.0, -20, 0], [-20, 45, -25], [0, -25, 25]])


def reference(mass: np.ndarray, damping: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Return lambda with positive imaginary part, from the state matrix."""
    n = len(mass)
    lower = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    values = np.linalg.eigvals(np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), lower]))
    kept = values[values.imag > 1e-3 * np.abs(values).max()]
    return kept[np.argsort(kept.imag)]


def test_eigenvalues_and_vectors_of_a_damped_chain():
    found = eigenmodes(CHAIN_M, CHAIN_D, CHAIN_K)
    np.testing.assert_allclose(found.values, reference(CHAIN_M, CHAIN_D, CHAIN_K), rtol=1e-10)
    for value, right, left in zip(found.values, found.right, found.left, strict=True):
        pencil = value**2 * CHAIN_M + value * CHAIN_D + CHAIN_K
        size = np.abs(value**2 * CHAIN_M).max()
        assert np.abs(pencil @ right).max() < 1e-10 * size * np.abs(right).max()
        assert np.abs(left.conj() @ pencil).max() < 1e-10 * size * np.abs(left).max()


def test_other_units_and_another_order_of_the_equations_change_nothing():
    row, column = np.array([1e6, 1e-5, 1.0]), np.array([1.0, 1e-7, 1e4])
    order = [2, 0, 1]
    other = eigenmodes(*((row[:, None] * m * column)[order] for m in (CHAIN_M, CHAIN_D, CHAIN_K)))
    np.testing.assert_allclose(other.values, reference(CHAIN_M, CHAIN_D, CHAIN_K), rtol=1e-9)


def of_one_mass(damping: float) -> modal.Eigenmodes:
    return eigenmodes(np.eye(1), damping * np.eye(1), np.eye(1))


def test_rigid_body_modes_and_overdamped_poles_are_no_modes():
    free = CHAIN_K - np.diag([5e5, 0, 0])
    assert len(eigenmodes(CHAIN_M, np.zeros((3, 3)), free).values) == 2
    assert len(of_one_mass(2.1).values) == 0
    assert len(of_one_mass(0.9 * 2.1).values) == 1


@pytest.mark.parametrize(("soft", "count"), [(1e-3, 3), (3e-7, 3), (1e-8, 2)])
def test_a_soft_mode_is_no_rigid_body_mode(soft, count):
    """A share of 3e-14 of the others is one, FREE is 1e-14; rounding leaves 1e-10 of 1e6."""
    stiffness = CHAIN_K + np.diag([soft - 5e5, 0, 0])
    assert len(eigenmodes(CHAIN_M, np.zeros((3, 3)), stiffness).values) == count


def test_a_support_that_is_rigid_hides_no_soft_one():
    """Beside 1e18 N/m a mode on 400 N/m has a share of 2e-8 of the highest frequency."""
    found = eigenmodes(np.eye(2), np.zeros((2, 2)), np.diag([1e18, 400.0]))
    assert found.rigid == 0
    np.testing.assert_allclose(found.values.imag, [20.0, 1e9], rtol=1e-12)


def test_zero_is_a_double_pole_but_where_damping_acts():
    free = CHAIN_K - np.diag([5e5, 0, 0])
    internal = CHAIN_D - np.diag([10.0, 0, 0])
    assert eigenmodes(CHAIN_M, internal, free).rigid == 2
    dragged = eigenmodes(CHAIN_M, internal + np.diag([1e-9, 0, 0]), free)  # UNDAMPED: 4e-11 > 1e-12
    assert (dragged.rigid, len(dragged.real)) == (1, 1)
    assert eigenmodes(CHAIN_M, internal + np.diag([1e-12, 0, 0]), free).rigid == 2


def test_what_counts_as_real_and_as_one():
    for imaginary, count in ((1e-4, 1), (1e-9, 0)):
        assert len(of_one_mass(2 * np.sqrt(1 - imaginary**2)).values) == count
    for apart, count in ((1e-6, 2), (1e-12, 1)):
        stiffness = np.diag([1e6, 1e6 * (1 + apart)])
        assert len(eigenmodes(np.eye(2), np.zeros((2, 2)), stiffness).distinct) == count


def test_massless_coordinates_have_no_mode():
    found = eigenmodes(np.diag([2.0, 0.0]), np.zeros((2, 2)), np.array([[2.0, -1], [-1, 3]]))
    np.testing.assert_allclose(found.values, [1j * np.sqrt((2 - 1 / 3) / 2)], rtol=1e-10)


def test_a_machine_beyond_all_bounds_is_refused():
    with pytest.raises(np.linalg.LinAlgError, match="beyond all bounds"):
        eigenmodes(np.array([[np.inf]]), np.zeros((1, 1)), np.eye(1))


def test_coinciding_frequencies_part_as_their_planes_do():
    # two planes of one mass; unknowns: their stiffnesses. d omega = dk / (2 m omega), each its own
    found = eigenmodes(np.diag([2.0, 2.0]), np.zeros((2, 2)), np.diag([8.0, 8.0]))
    gram = found.left.conj() @ (2 * 2j * np.diag([2.0, 2.0])) @ found.right.T
    slopes = found.left.conj()[:, None, :] * found.right[None, :, :]
    away = parted(gram, slopes.astype(complex), np.array([1.0, -0.3])).imag
    np.testing.assert_allclose(away, [[0, 1 / 8], [1 / 8, 0]], atol=1e-12)


@pytest.mark.parametrize("complex_stiffness", [False, True])
def test_both_ways_to_the_poles_agree(monkeypatch, complex_stiffness):
    """M divided by, and the pencil of two matrices, which a coordinate without inertia needs."""
    model = load_model("three-mass")
    m = model.linear.matrices(model.values(model.nominal), 2 * np.pi * 140)
    held = m.K + np.diag([1e4] * 8) * (1 + 0.02j * complex_stiffness)
    matrices = (m.M, m.D + 2 * np.pi * 140 * m.G + np.diag([3.0] * 8), held)
    fast = eigenmodes(*matrices)
    assert modal.eigenvalues(*matrices) == pytest.approx(fast.values, rel=1e-12)
    monkeypatch.setattr(modal, "REGULAR", 0.0)
    slow = eigenmodes(*matrices)
    assert modal.eigenvalues(*matrices) == pytest.approx(slow.values, rel=1e-10)
    assert fast.values == pytest.approx(slow.values, rel=1e-10)
    for one, two in zip(fast.right, slow.right, strict=True):
        size = (np.vdot(one, one) * np.vdot(two, two)).real
        assert abs(np.vdot(one, two)) ** 2 == pytest.approx(size, rel=1e-9)
    for value, left in zip(fast.values, fast.left, strict=True):
        rest = left.conj() @ (value**2 * matrices[0] + value * matrices[1] + matrices[2])
        assert np.abs(rest).max() < 1e-8 * (np.abs(left) @ np.abs(held)).max()


def test_scaling_goes_as_far_as_it_needs_to():
    """A matrix that no scaling levels: a sweep halves what is left; after 8 it is 10 %."""
    size = np.array([[1.0, 1e12], [0.0, 1.0]])
    row, column = _scales(size)
    least = float((row[:, None] * size * column).max(axis=0).min())
    assert 0.8 < least < 0.95


# Forces on a coordinate are told alike however its equation is typed, or it is said why not.


PLANES = {
    "jeffcott": ["x,y"],
    "rigid": ["x - L_a*theta_y, y + L_a*theta_x", "F_xb,F_yb"],
    "three-mass": ["x1,y1", "x3,y3"],
}


def rewritten(model: rid.Model, change) -> rid.Model:
    """Return a model whose equations were changed, as lists of left and right sides."""
    sides = [tuple(part.strip() for part in text.split("=")) for text in model.texts]
    text = model.file_text
    start = text.index("equations = [")
    head, rest = text[:start], text[text.index("]\n", start) :]
    made = ",\n".join(f'"{left} = {right}"' for left, right in change(sides))
    return parse_model(f"{head}equations = [{made}\n{rest}", name=model.name)


def times(row: int, factor: str):
    return lambda sides: [
        tuple(f"{factor}*({side})" for side in pair) if k == row else pair
        for k, pair in enumerate(sides)
    ]


def exchanged(one: int, other: int):
    places = {one: other, other: one}
    return lambda sides: [sides[places.get(k, k)] for k in range(len(sides))]


def summed(into: int, other: int, share: str = "1"):
    def change(sides):
        pairs = zip(sides[into], sides[other], strict=True)
        both = tuple(f"{a} + {share}*({b})" for a, b in pairs)
        return [*sides[:into], both, *sides[into + 1 :]]

    return change


def answers(model: rid.Model) -> dict:
    """Return what is read from the equations as forces: planes, corrections, terms that lack."""
    estimate = estimate_of(model)
    planes = {
        u.plane: u.amount * np.exp(1j * u.angle_rad)
        for u in with_unbalance(model, estimate).unbalance
    }
    found = rid.balance(estimate, PLANES[model.name], "6000 rpm")
    masses = [c.unbalance_kg_m * np.exp(1j * c.angle_rad) for c in found.corrections]
    return planes | {"masses": np.array(masses), "rotor": found.rotor_mass, "share": found.share}


CHANGES = [
    *[("jeffcott", times(row, factor)) for row in (0, 1) for factor in ("2", "-1")],
    *[("jeffcott", times(1, factor)) for factor in ("1000", "0.3")],
    ("jeffcott", exchanged(0, 1)),
    ("jeffcott", lambda sides: exchanged(0, 1)(times(0, "-0.001")(sides))),
    ("rigid", times(0, "-1")),
    ("rigid", times(3, "1000")),
    ("rigid", lambda sides: exchanged(0, 1)(exchanged(1, 2)(sides))),
    *[("three-mass", times(row, "-2.5")) for row in (3, 5)],  # no input in them
    ("three-mass", lambda sides: times(2, "3")(times(0, "2")(sides))),
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("name", "change"), CHANGES)
def test_a_factor_an_order_and_a_sign_change_nothing(name, change):
    model = rid.load_model(name)
    wanted, found = answers(model), answers(rewritten(model, change))
    assert found.keys() == wanted.keys()
    for key, value in wanted.items():
        assert found[key] == pytest.approx(value, rel=1e-6, abs=1e-12), key


@pytest.mark.parametrize("name", ["jeffcott", "three-mass"])
def test_a_result_by_base_parameters_tells_the_same(name):
    model = rid.load_model(name)
    told = []
    for each in (model, rewritten(model, times(1, "-2"))):
        base = each.base_values(each.values(each.nominal))
        values = [rid.Value(n, "1", float(v)) for n, v in zip(each.base.names, base, strict=True)]
        told.append(with_unbalance(each, rid.Estimate(name, "ls", "ok", tuple(values))).unbalance)
    assert [u.plane for u in told[0]] == [u.plane for u in told[1]]
    assert [u.amount for u in told[1]] == pytest.approx([u.amount for u in told[0]], rel=1e-9)
    assert told[0]


SUMS = [
    ("jeffcott", summed(0, 1), "holds inertia that equation 2 does not"),
    ("jeffcott", summed(1, 0, "-0.5"), "holds inertia that equation 1 does not"),
    ("three-mass", summed(0, 2), "holds inertia that equation 3 does not"),
]


@pytest.mark.parametrize(("name", "change", "told"), SUMS)
def test_sums_of_equations_are_refused_with_a_cure(name, change, told):
    model = rewritten(rid.load_model(name), change)
    with pytest.raises(rid.InputError, match=f"{told}.*write that equation as the force on x"):
        rid.balance(estimate_of(model), PLANES[name][:1], "6000 rpm")
    if name == "jeffcott":
        assert with_unbalance(model, estimate_of(model)).unbalance == ()
        assert told in with_unbalance(model, estimate_of(model)).notes[0].found
        structure = find_structure(model, model.values(model.nominal), 500.0)
        lacking = find_candidates(structure)
        places = ("mass at", "load at", "stiffness to")
        assert not [c.name for c in lacking if c.name.startswith(places)]


def test_what_an_input_does_needs_no_coordinate():
    plain = rid.load_model("jeffcott")
    model = rewritten(plain, summed(0, 1))
    (found,) = rid.balance(estimate_of(model), ["F_x,F_y"], "6000 rpm").corrections
    amount = found.unbalance_kg_m * np.exp(1j * found.angle_rad)
    assert amount == pytest.approx(answers(plain)["masses"][0], rel=1e-6)


UNITS = {"m": "kg", "k": "N/m", "ki": "N/A", "u": "kg m", "w": "1/s^2", "b": "1/kg", "e": "m"}


def one_of(*equations: str) -> rid.Model:
    return model_of(equations, {"x": "m", "y": "m"}, {"F": "N", "i": "A"}, UNITS)


TURNING = "Omega^2*cos(phi)"


@pytest.mark.parametrize(
    ("equation", "scale"),
    [
        (f"m*x'' + k*x = F + u*{TURNING}", 1),
        (f"-m*x'' - k*x = -F - u*{TURNING}", -1),
        (f"m*x'' + k*x = -F + u*{TURNING}", 1),  # a sensor of force the other way
        (f"m*x'' + k*x = 2*F + u*{TURNING}", 1),  # two magnets
        (f"m*x'' + 2*k*x = 0.5*F + u*{TURNING}", 1),
        (f"2*m*x'' + 2*k*x = F + 2*u*{TURNING}", 1),  # half the mass is asked for
        (f"2*m*x'' + 4*k*x = 2*F + 2*u*{TURNING}", 2),
        (f"1.37*(m*x'' + 2*k*x - F - u*{TURNING}) = 0", 1.37),
        (f"m*x'' + k*x = 50*i + u*{TURNING}", 1),
        (f"m*x'' + k*x = ki*i + u*{TURNING}", 1),
        (f"m*x'' + k*x = 2*ki*i + u*{TURNING}", 1),
        (f"3*m*x'' + 3*k*x = 3*ki*i + 3*u*{TURNING}", 3),
        (f"m*x'' + 2*k*x = u*{TURNING}", 1),
        (f"0.5*m*x'' + k*x = 0.5*u*{TURNING}", 1),  # half a rotor
        (f"2*x'' + 2e4*x = F + u*{TURNING}", 1),
    ],
)
def test_what_was_typed_tells_the_scale(equation, scale):
    model = one_of(equation)
    found = force_balance(model, np.array([[np.sign(scale) * 2.0]]))
    assert not found.faults
    assert found.scales == pytest.approx([scale])
    fixed = model.substitute({name: 3.7 for name in model.parameter_names})
    assert force_balance(fixed, np.array([[np.sign(scale) * 2.5]])).scales == pytest.approx([scale])


@pytest.mark.parametrize(
    ("equation", "told"),
    [
        (f"2*m*x'' + 2*k*x = 2*u*{TURNING}", "the balance of forces times 2"),
        (f"2*m*x'' + k*x = 2*F + 2*u*{TURNING}", "the balance of forces times 2"),
        (f"2*m*x'' + 3*k*x = 2*F + 2*u*{TURNING}", "the balance of forces times 2"),
        (f"x'' + w*x = b*F + e*{TURNING}", "whose terms are in m s^-2"),
    ],
)
def test_what_does_not_tell_the_scale_is_said(equation, told):
    assert told in force_balance(one_of(equation), np.array([[2.0]])).faults[0]


def test_numbers_alone_do_not_tell_a_multiple():
    found = force_balance(one_of("4*x'' + 4e4*x = 2*F", "m*y'' + k*y = 0"), np.eye(2))
    assert found.faults == {0: "equation 1, which may be the balance of forces times 2"}


def test_a_spring_that_pulls_unlike_is_told():
    model = one_of("m*x'' + k*(x - y) = F", "m*y'' + 2*k*(y - x) = 0")
    assert "couple x and y unlike (2 to 1)" in force_balance(model, np.eye(2)).faults[0]


def test_terms_that_lack_have_the_size_that_they_have_at_the_coordinate():
    model = rid.load_model("jeffcott")
    doubled = rewritten(model, times(1, "2"))
    values = model.values(model.nominal)
    plain, twice = (find_structure(each, values, 500.0) for each in (model, doubled))
    candidates = [
        {c.name: c for c in find_candidates(s) if c.name.endswith("x, y")} for s in (plain, twice)
    ]
    assert candidates[0].keys() == candidates[1].keys() >= {"mass at x, y", "load at x, y"}
    for name, one in candidates[0].items():
        found, expected = candidates[1][name].effects, one.effects
        sizes = [each.coefficient * (1 + (each.row == 1)) for each in expected]
        assert [each.coefficient for each in found] == pytest.approx(sizes)
        places = [replace(each, coefficient=1.0) for each in expected]
        assert [replace(each, coefficient=1.0) for each in found] == places


# What turns with the rotor: the line of a load once per revolution, against closed forms.


def model_with(more: str, unit: str = "kg m") -> rid.Model:
    equation = f"m*x'' + c*x' + k*x = F + Omega^2*u*cos(phi + 0.5) + {more}"
    units = f"m 2.0 kg, c 30.0 N s/m, k 2e5 N/m, u 4e-5 kg m, b 3e-5 {unit}"
    return parse_model(model_text("and something more", [equation], "x m", "F N", units))


def load_of(model: rid.Model, speed: float) -> complex:
    """Return the load of the model at its nominal values: that of one row."""
    found, _ = machine_of(model).load(speed)
    return complex(found[0])


def unbalance_at(model: rid.Model) -> complex:
    (found,) = with_unbalance(model, estimate_of(model, std=1e-9)).unbalance
    assert found.plane == "x"
    return found.amount * np.exp(1j * found.angle_rad)


BESIDE = [
    "b*Omega^2*cos(2*phi)",
    "b*Omega^2*sin(15*phi)",  # blades
    "b*Omega^2*cos(17*phi + 1)",
    "b*Omega^2*cos(63*phi)",
    "b*Omega^2*cos(255*phi)",
    "b*Omega^2*cos(1.5*phi)",  # the shaft of a gear
    "b*Omega^2*cos(2.5*phi + 0.2)",
    "b*Omega^2*sin(0.98*phi)",  # a motor that slips
    "b*Omega^2*cos(pi*phi)",
    "b*Omega^2*cos(1.0035*phi)",
    "b*Omega^2*cos(50*t)",  # not from the same zero, and turning as fast at 50 rad/s
    "b*Omega^2",
]


@pytest.mark.parametrize("grows", ["100", "Omega", "Omega^3", "tanh(Omega)"])
def test_what_does_not_grow_as_the_square_of_the_speed_is_no_unbalance(grows):
    """Such as a bent shaft, whose load is the same at any speed."""
    model = model_with(f"b*{grows}*cos(phi)")
    assert unbalance_at(model) == pytest.approx(4e-5 * np.exp(0.5j), rel=1e-7)


@pytest.mark.parametrize("more", BESIDE)
def test_what_turns_at_another_rate_is_no_unbalance(more):
    model = model_with(more)
    wanted = 4e-5 * np.exp(0.5j)
    near = 2e-3 if "1.0035" in more else 1e-7
    assert unbalance_at(model) == pytest.approx(wanted, rel=near)
    for speed in (50.0, -30.0):
        assert load_of(model, speed) == pytest.approx(wanted * speed**2, rel=near)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("cos(phi)", 1),
        ("sin(phi)", -1j),
        ("cos(phi)^3", 0.75),
        ("sin(phi)*cos(2*phi)", 0.5j),
        ("Omega*cos(phi - 1)", 7 * np.exp(-1j)),
        ("cos(phi)*cos(1.5*phi)^2", 0.5),  # 1 and two others: cos^2 = (1 + cos(3 phi))/2
    ],
)
def test_products_and_powers(text, wanted):
    model = model_with(f"b*{text}", "N")
    assert load_of(model, 7.0) == pytest.approx(4e-5 * 49 * np.exp(0.5j) + 3e-5 * wanted, rel=1e-9)


def test_what_has_no_number_is_refused_where_it_is_needed():
    model = model_with("b*cos(phi)/Omega", "N rad/s")
    assert np.isfinite(load_of(model, 1.0))
    with pytest.raises(rid.InputError, match="without a finite value at the speed 0"):
        load_of(model, 0.0)


@pytest.mark.parametrize("text", ["cos(Omega*t)", "sin(2*Omega*t + 0.3)", "cos(phi - Omega*t/3)"])
def test_a_rotation_counted_from_the_record_is_refused(text):
    with pytest.raises(rid.InputError, match=r"equation 1: found .*a load that turns.*write phi"):
        model_with(f"b*Omega^2*{text}")

    for other in ("cos(314*t)", "exp(-3*t)*sin(phi)"):  # loads of the time are loads
        assert model_with(f"b*Omega^2*{other}").parameter_names[-1] == "b"
