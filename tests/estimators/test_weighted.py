"""Least squares by weight, by stage, and with what is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bank import (
    ARM,
    BANK,
    CHAIN,
    JEFFCOTT,
    RIGID,
    THREE_MASS,
    TRAIN,
    Grid,
    family,
    recovered,
    steady,
)
from model_text import model_text
from sampled_bank import coloured
from scipy.optimize import brentq
from scipy.stats import t as student

import rotorid as rid
from rotorid import Batch, Constraint, InputError, LeastSquares, ModelError, Plan, Sequential
from rotorid.linear import solve as weighted
from rotorid.linear.family import LeastSquaresProblem, sandwich, scatter_of_answers
from rotorid.linear.solve import Block, Scatter, block_numbers, pooled, scatter_of_blocks, solve
from rotorid.models.knowledge import constraint_polynomial, eliminate
from rotorid.testing import bind_all

# The weighted solution, its gains and its sandwich, on plain matrices.


def lines_of(rng, record, *shape):
    """Return random lines, real at DC and Nyquist."""
    lines = rng.standard_normal((len(record.harmonics), *shape, 2)) @ np.array([1, 1j])
    lines[record.multiplicity == 1] = lines[record.multiplicity == 1].real
    return lines


@pytest.fixture(params=[([0, 2, 5, 8], 16), ([1, 3, 4], 15)], ids=["with DC and Nyquist", "odd"])
def block(request):
    rng = np.random.default_rng(1)
    harmonics, samples = request.param
    plan = Plan(np.zeros((len(harmonics), 1)), harmonics, 1.0, float(samples), 3, noise={})
    record = plan.record(TRAIN.model)
    design, target = lines_of(rng, record, 3, 4), lines_of(rng, record, 3)
    return Block(design, target, rng.uniform(0.1, 10, (samples, 3)), record)


def test_units_of_columns_and_weights_do_not_matter(block):
    found = solve([block])
    assert found.undetermined.shape == (4, 0)
    scale = np.array([1e-9, 1.0, 1e7, 1e12])
    other = replace(block, design=block.design * scale, variance=block.variance * 1e-14)
    scaled = solve([other])
    np.testing.assert_allclose(scaled.values * scale, found.values, rtol=1e-9)
    assert scaled.condition_number == pytest.approx(found.condition_number, rel=1e-9)


def fitted(block, gains, matrices):
    scatter = SimpleNamespace(matrices=matrices)
    return SimpleNamespace(gains=gains, scatter=scatter, weight=block.record.multiplicity)


@pytest.mark.sampled(1)
def test_sandwich_is_the_scatter_of_the_values(block):
    """Noise with correlated rows, circular on complex lines and real on the others."""
    rng = np.random.default_rng(2)
    roots = lines_of(rng, block.record, 3, 3)
    (gains,) = solve([block]).gains
    size = np.where(block.record.multiplicity == 1, 1.0, np.sqrt(0.5))[:, None]
    white = np.array([size * lines_of(rng, block.record, 3) for _ in range(4000)])
    draws = np.einsum("fkr,krj,pkj->pf", gains, roots, white).real
    expected = np.cov(draws.T)
    stated = sandwich([fitted(block, gains, roots @ roots.conj().swapaxes(1, 2))])
    scale = np.outer(draws.std(axis=0), draws.std(axis=0))
    np.testing.assert_allclose(stated / scale, expected / scale, atol=0.08)
    np.testing.assert_array_equal(stated, stated.T)


@pytest.mark.sampled(1)
def test_scatter_of_answers_agrees_with_the_sandwich_for_independent_lines(block):
    rng = np.random.default_rng(3)
    gains = solve([block]).gains
    periods = 5000
    noise = np.stack([lines_of(rng, block.record, 3) for _ in range(periods)])
    matrices = np.zeros((len(block.record.harmonics), 3, 3)) + 2 * np.eye(3) / periods
    matrices[block.record.multiplicity == 1] /= 2
    stated = sandwich([fitted(block, gains[0], matrices)])
    answers = np.einsum("fkr,pkr->pf", gains[0], noise).real
    found = scatter_of_answers([SimpleNamespace(answers=answers)])
    np.testing.assert_allclose(np.diag(found), np.diag(stated), rtol=0.1)


@pytest.mark.parametrize(
    ("dependent", "open_sets"),
    [
        ({3: {0: 2.0}}, [{0, 3}]),
        ({3: {0: 2.0}, 2: {1: -1.0}}, [{0, 3}, {1, 2}]),
        ({3: {}}, [{3}]),
        ({3: {}, 1: {}}, [{1}, {3}]),
        ({3: {0: 1.0, 1: 1.0}}, [{0, 1, 3}]),
        ({2: {0: 1.0}, 3: {0: 5.0}}, [{0, 2}, {0, 3}]),
    ],
)
def test_open_directions_are_kept_apart(block, dependent, open_sets):
    """Columns that repeat others, or are zero: each set on its own, the rest determined."""
    design = block.design.copy()
    for column, sources in dependent.items():
        design[..., column] = sum(c * design[..., s] for s, c in sources.items())
    found = solve([replace(block, design=design)])
    touched = set().union(*open_sets)
    assert {int(i) for i in np.flatnonzero(np.isnan(found.values))} == touched
    assert found.condition_number == np.inf
    size = np.abs(found.undetermined)
    sets = [set(np.flatnonzero(column > 1e-6 * column.max())) for column in size.T]
    if len(open_sets) == 2 and open_sets[0] & open_sets[1]:
        assert len(sets) == 2
        assert set().union(*sets) == touched
        return
    assert sorted(map(sorted, sets)) == sorted(map(sorted, open_sets))


def test_variances_of_many_periods_stay_with_their_samples():
    variance = np.random.default_rng(5).uniform(1, 2, (20, 2))
    np.testing.assert_array_equal(pooled(variance, np.ones(2), 30), variance)
    variance[3, 0] = 0.0  # by chance: not a weight without bound
    assert pooled(variance, np.ones(2), 30)[3, 0] == pytest.approx(1e-3 * variance[:, 0].mean())


def test_variances_of_few_periods_are_pooled():
    variance = np.random.default_rng(6).uniform(0, 2, (20, 2))
    found = pooled(variance, np.ones(2), 29)
    np.testing.assert_allclose(found, np.broadcast_to(variance.mean(axis=0), (20, 2)))


@pytest.mark.parametrize("power", [[4.0, 9.0], [4.0, 0.0], [0.0, 0.0]])
def test_no_noise_still_gives_weights(power):
    found = pooled(np.zeros((5, 2)), np.array(power), 100)
    assert (found > 0).all()
    assert np.isfinite(1 / found).all()


# Deviations by blocks: against leaving out by hand, and what the decisions decide.


RNG = np.random.default_rng(3)


def fit(matrix: np.ndarray, right: np.ndarray, numbers: np.ndarray) -> Scatter:
    gains = np.linalg.pinv(matrix)
    return scatter_of_blocks(matrix, right - matrix @ (gains @ right), gains, numbers)


def test_it_is_leaving_out_each_block():
    matrix, right = RNG.standard_normal((960, 3)), RNG.standard_normal(960)
    numbers = block_numbers([960], 12)
    left = [numbers != b for b in range(12)]
    without = np.array([np.linalg.lstsq(matrix[k], right[k], rcond=None)[0] for k in left])
    apart = without - without.mean(axis=0)
    found = fit(matrix, right, numbers)
    assert not found.alone.any()
    np.testing.assert_allclose(found.covariance, apart.T @ apart * 11 / 12 * 11 / 9, rtol=1e-9)
    np.testing.assert_allclose(found.shifts.sum(axis=0), 0.0, atol=1e-12)


def test_blocks_cross_no_runs():
    numbers = block_numbers([300, 100], 8)
    assert numbers.tolist() == sorted(numbers.tolist())
    assert numbers[299] < numbers[300]
    assert np.bincount(numbers).tolist() == [50] * 8
    assert block_numbers([3000, 1], weighted.BLOCKS)[-1] == weighted.BLOCKS == 32


def test_blocks_that_remember_one_another_are_merged():
    """A level, and noise with a memory: merged while neighbours resemble, never below eight."""
    count, level = 3200, np.ones((3200, 1))
    numbers = block_numbers([count], weighted.BLOCKS)
    found = {}
    for memory in (1e-3, 0.06, 100.0):  # a block is .1 s long
        noise = coloured(np.random.default_rng(0), count, 1.0, memory, 1000.0)
        found[memory] = fit(level, noise, numbers)
    assert [found[m].blocks for m in (1e-3, 0.06, 100.0)] == [32, 16, weighted.FEWEST]
    assert [found[m].memory > 0 for m in (1e-3, 0.06, 100.0)] == [False, False, True]
    # What is left of it is made up for: (1 + r) / (1 - r) times the variance of independent blocks.
    r, blocks = found[100.0].memory, found[100.0].shifts[:, 0]
    apart = blocks / (1 - 1 / len(blocks))
    plain = (apart**2).sum() * 7 / 8 * 7 / 5
    assert found[100.0].covariance[0, 0] == pytest.approx(plain * (1 + r) / (1 - r))


@pytest.mark.parametrize(("share", "merged"), [(0.95, False), (1.05, True)])
def test_how_much_neighbours_may_resemble(share, merged):
    """The correlation of neighbours is set to `share` of 1 / sqrt(32)."""
    even, slow = np.tile([1.0, -1.0], 16), np.repeat([1.0, -1.0], 16)

    def mixed(part: float) -> np.ndarray:
        shifts = part * slow + np.sqrt(1 - part**2) * even
        return shifts - shifts.mean()

    def lagged(part: float) -> float:
        shifts = mixed(part)
        return (shifts[1:] @ shifts[:-1]) / (shifts @ shifts) - share / np.sqrt(32)

    shifts = mixed(brentq(lagged, 0.0, 0.99))
    found = fit(np.ones((32, 1)), shifts, np.arange(32))
    assert (found.blocks < 32) == merged


def test_what_one_block_tells_alone():
    """A column that is large in one block only: `ALONE` of what tells it must lie elsewhere."""
    numbers = block_numbers([320], 16)
    for share, alone in ((0.8 * weighted.ALONE, True), (1.2 * weighted.ALONE, False)):
        column = np.zeros(320)
        column[:20] = np.sqrt((1 - share) / 20)
        column[20:] = np.sqrt(share / 300) * np.tile([1.0, -1.0], 150)
        matrix = np.column_stack([column, np.tile([1.0, -1.0, -1.0, 1.0], 80)])
        found = fit(matrix, RNG.standard_normal(320), numbers)
        assert found.alone.tolist() == [alone, False]


@pytest.mark.parametrize(("share", "both"), [(0.8, False), (1.25, True)])
def test_which_parameters_are_of_a_combination_that_one_block_tells(share, both):
    """Outside block 0 the second column is a multiple of the first: they are told together."""
    numbers = block_numbers([320], 16)
    first = np.tile([1.0, -1.0, -1.0, 1.0], 80)
    own = np.where(np.arange(320) < 20, np.tile([1.0, 1.0, -1.0, -1.0], 80), 0.0)

    def posed(multiple: float) -> tuple[np.ndarray, float]:
        matrix = np.column_stack([first, own - multiple * np.where(own == 0, first, 0.0)])
        lengths = np.sqrt((np.linalg.pinv(matrix) ** 2).sum(axis=1))
        direction = np.array([multiple, 1.0]) / lengths
        return matrix, float(direction[0] / np.linalg.norm(direction))

    multiple = brentq(lambda m: posed(m)[1] - share * weighted.TINY, 0.0, 5.0)
    found = fit(posed(multiple)[0], RNG.standard_normal(320), numbers)
    assert found.alone.tolist() == [both, True]


def test_halves_differ_by_what_lies_between_them_alone():
    quiet = RNG.standard_normal((32, 1))
    quiet -= quiet.mean()
    step = np.repeat([5.0, -5.0], 16)[:, None]
    (calm, std), (apart, same) = (
        Scatter(np.eye(1), shifts, 0.0, np.zeros(1, dtype=bool), np.arange(32)).halves()
        for shifts in (quiet, quiet + step)
    )
    assert std == pytest.approx(same)
    assert (apart[0] - apart[1] - (calm[0] - calm[1])) == pytest.approx(2 * 32 * 5)
    within = np.concatenate([half - half.mean() for half in np.split(quiet[:, 0], 2)])
    wider = student.isf(student.sf(weighted.CHANCE, 1e9), 30) / weighted.CHANCE
    assert std == pytest.approx(wider * np.sqrt((within**2).sum() * 32 / 30), rel=1e-3)


# Stages derived from the model, and how the error of one goes into the next.


def stages_of(problem, constraints=(), **fixed):
    bound, known = bind_all(problem.model, problem.records), {**problem.known, **fixed}
    posed = LeastSquaresProblem.of(bound, known, constraints)
    names = posed.names
    return [(rows, [names[u] for u in unknowns]) for rows, unknowns in posed.stages]


def made(equations, parameters, harmonics=(1, 2), turns=0, **truth):
    """Return two masses that u drives, by their equations, and their record without noise."""
    model = rid.parse_model(model_text("t", equations, "x m, y m", "u N", parameters))
    forces = np.exp(1j * np.reshape(harmonics, (-1, 1)))
    record = steady(model, truth, forces, harmonics, 5.0, 1200.0, 3, hertz=5.0 * turns)
    return SimpleNamespace(model=model, records=[record], known={}, truth=truth)


def test_stages_of_the_seed():
    """The paper's (10) and (11)."""
    first, second = stages_of(THREE_MASS)
    assert first == ([0, 1, 6, 7], ["m1", "m3", "k1", "k1*L1", "k2", "k2*L2"])
    assert second[0] == [2, 3, 4, 5]
    assert set(first[1]) | set(second[1]) == set(THREE_MASS.base)
    assert not set(first[1]) & set(second[1])


def test_a_stage_for_each_mass_of_a_train():
    assert stages_of(TRAIN) == [([2], ["a", "k"]), ([1], ["b", "h"]), ([0], ["c", "d"])]


def test_rows_without_an_input_of_their_own():
    assert stages_of(CHAIN) == [([0], ["m_1", "k", "k_3"]), ([1], ["m_2"])]
    assert stages_of(RIGID) == [([0, 1, 2, 3], list(RIGID.base))]


def test_fixed_values_and_constraints_move_unknowns():
    # A known spring drives the second mass as an input does.
    assert stages_of(TRAIN, k=3000.0) == [([1, 2], ["a", "b", "h"]), ([0], ["c", "d"])]
    # b = 2 a, eliminated, leaves a in the rows of both
    found = stages_of(TRAIN, [Constraint("b - 2*a", 0.0)])
    assert found in (
        [([2], ["a", "k"]), ([1], ["h"]), ([0], ["c", "d"])],
        [([2], ["b", "k"]), ([1], ["h"]), ([0], ["c", "d"])],
    )


def test_a_stage_takes_in_the_rows_that_tell_its_unknowns_apart():
    """a and b act through the same column of the driven row; the free row separates them."""
    equations = ["m*x'' + (a + b)*x = u", "n*y'' + a*y + b*x = 0"]
    problem = made(equations, "m kg, n kg, a N/m, b N/m", m=2.0, n=1.0, a=500.0, b=300.0)
    assert stages_of(problem) == [([0, 1], ["m", "n", "a", "b"])]
    recovered(Sequential().estimate(problem.model, problem.records), problem.truth)


def confounded(second):
    """Return a model whose first stage cannot tell c from g at one speed; `second` is row 2."""
    first = "a*x'' + c*x' + g*Omega*x' + k*(x - y) = u"
    units = "a kg, b kg, c N s/m, g N s^2/m, k N/m"
    truth = {"a": 1.0, "b": 2.0, "c": 7.0, "g": 0.2, "k": 900.0}
    return made([first, f"b*y'' + {second} + k*(y - x) = 0"], units, (2, 3), 4, **truth)


@pytest.mark.parametrize("method", [Sequential, Batch], ids=lambda m: m.__name__)
def test_what_one_stage_leaves_open_and_no_other_determines(method):
    problem = confounded("0")
    estimate = method().estimate(problem.model, problem.records)
    assert estimate.status == "not_identifiable"
    assert "not identifiable: c, g are determined only together" in estimate.warnings
    assert np.isnan([estimate.value("c"), estimate.value("g")]).all()
    recovered(estimate, {name: problem.truth[name] for name in "abk"})


@pytest.mark.parametrize("second", ["c*y'", "g*Omega*y'"])
@pytest.mark.parametrize("method", [Sequential, Batch], ids=lambda m: m.__name__)
def test_what_one_stage_leaves_open_is_no_zero_in_the_next(method, second):
    """Row 2 tells c from g; the rows of the first stage wait for it."""
    problem = confounded(second)
    assert stages_of(problem) == [([0], ["a", "c", "g", "k"]), ([1], ["b"])]
    estimate = method().estimate(problem.model, problem.records)
    assert estimate.status == "ok"
    assert estimate.warnings == ()
    recovered(estimate, problem.truth)


def test_two_stages_by_hand():
    """(5) and (6) with numpy.linalg.lstsq: forces weigh stage 1, transmitted forces stage 2."""
    record = CHAIN.noisy(40, 1)
    found = Sequential().estimate(CHAIN.model, [record])

    grid, keep = Grid(), list(CHAIN.harmonics)
    omega = grid.omega * np.arange(grid.samples // 2 + 1)

    def filtered(x, order=0):
        spectrum = np.fft.rfft(x, axis=-1)
        masked = np.zeros_like(spectrum)
        masked[..., keep] = spectrum[..., keep]
        return np.fft.irfft((1j * omega) ** order * masked, grid.samples, axis=-1)

    F, x1, x2 = (record.mean[:, record.index(n)] for n in ("F", "x1", "x2"))
    stretch = filtered(x1) - filtered(x2)
    columns = np.column_stack([filtered(x1, 2), stretch, filtered(stretch**3)])
    weight = 1 / np.sqrt(record.variance[:, record.index("F")])
    m_1, k, k_3 = np.linalg.lstsq(columns * weight[:, None], filtered(F) * weight, rcond=None)[0]

    each = np.fft.irfft(_full(record.spectra, keep, grid.samples), grid.samples, axis=1)
    own = each[..., record.index("x1")] - each[..., record.index("x2")]
    transmitted = k * own + k_3 * filtered(own**3)
    weight = 1 / transmitted.std(axis=0, ddof=1)
    right = k * stretch + k_3 * filtered(stretch**3)
    m_2 = np.linalg.lstsq((filtered(x2, 2) * weight)[:, None], right * weight, rcond=None)[0][0]
    for name, value in {"m_1": m_1, "k": k, "k_3": k_3, "m_2": m_2}.items():
        assert found.value(name) == pytest.approx(value, rel=1e-7)


def _full(spectra, keep, samples):
    whole = np.zeros((spectra.shape[0], samples // 2 + 1, spectra.shape[2]), dtype=complex)
    whole[:, keep] = samples * spectra
    return whole


@pytest.mark.sampled(8)
@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
@pytest.mark.parametrize("kind", [Batch, Sequential])
def test_gains_are_the_answer_to_a_change_of_the_forces(problem, kind):
    record = problem.noisy(5, 2)

    def solve(one):
        return kind(fixed=problem.known).solve(problem.model, [one])

    posed, before = solve(record)
    rng = np.random.default_rng(3)
    inputs = [record.index(name) for name in problem.model.inputs]
    size = np.abs(record.mean_spectrum[:, inputs]).max(axis=0)
    change = 1e-6 * size * (rng.standard_normal((len(record.harmonics), len(inputs), 2)) @ [1, 1j])
    change[record.harmonics == 0] = change[record.harmonics == 0].real
    spectra = record.spectra.copy()
    spectra[..., inputs] += change
    _, after = solve(replace(record, spectra=spectra))
    target = change @ posed.model.input_matrix.T
    expected = np.einsum("fkr,kr->f", before.gains[0], target).real
    scale = np.abs(before.values) * 1e-6
    np.testing.assert_allclose((after.values - before.values) / scale, expected / scale, atol=5e-3)


def test_a_driven_row_without_unknowns():
    """Row 1 is normalized and known altogether; the other starts from it all the same."""
    equations = ["x'' + 3*x' + 50*x = u", "m*y'' + k*(y - x) + 3*y' = 0"]
    problem = made(equations, "m kg, k N/m", m=2.0, k=700.0)
    for method in (Sequential, Batch):
        recovered(method().estimate(problem.model, problem.records), problem.truth)


def test_standstill_record_beside_a_turning_one():
    """Stages come from the structure, not from one record's data."""
    grids = (Grid(250, 5000.0), Grid(250, 5000.0, turns=7))
    problem = replace(THREE_MASS, grids=grids)
    for method in (Sequential, Batch):
        recovered(method().estimate(problem.model, problem.records), problem.true_base, 1e-8)


# Constraints: eliminated exactly, or refused with the reason.


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
    model, record = THREE_MASS.model, THREE_MASS.noisy(20, 1, level=0.02)
    estimate = method(constraints=(constraint,)).estimate(model, [record])
    assert estimate.status == "ok"
    index = {tuple(int(e) for e in m): i for i, m in enumerate(model.monomials)}
    base = np.array([estimate.value(name) for name in model.base.names])
    polynomial = dict(constraint_polynomial(model, expression))
    offset = polynomial.pop((0,) * len(model.parameters), 0.0)
    row = np.zeros(len(index))
    row[[index[monomial] for monomial in polynomial]] = list(polynomial.values())
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
    recovered(estimate, THREE_MASS.true_base, 1e-8)


def test_the_constrained_minimum_by_lagrange():
    """min |X theta - b|^2 with row @ theta = value, by the KKT equations."""
    record, constraint = TRAIN.noisy(20, 1, level=0.02), Constraint("a + b + c", 4.4)
    found = LeastSquares(constraints=(constraint,)).estimate(TRAIN.model, [record])
    (regression,) = LeastSquaresProblem.of(bind_all(TRAIN.model, [record]), {}, ()).regressions
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
    assert method().estimate(one.model, one.records).status == "not_identifiable"
    cured = method(constraints=(Constraint("k - 225000*m", 0.0),))
    estimate = cured.estimate(one.model, one.records)
    assert estimate.status == "ok"
    recovered(estimate, one.true_base, 1e-8)


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
        ([Constraint("I_t*mu", 1.0)], {}, "not linear in the base parameters"),
        ([Constraint("m1^2", 1.0)], {}, "not linear in the base parameters"),
        ([Constraint("m1", 1.0), Constraint("2*m1", 2.0)], {}, "repeat or contradict one another"),
        ([Constraint(f"{i}*m1 + m2", 1.0) for i in range(16)], {}, "repeat or contradict"),
        ([Constraint("2", 2.0)], {}, "which holds no free parameter"),
        ([Constraint("m1", 0.8)], {"m1": 0.8}, "which holds no free parameter"),
    ],
)
@family
def test_refused_constraints(method, constraints, fixed, message):
    asked = method(constraints=tuple(constraints), fixed=fixed)
    with pytest.raises(InputError, match=message):
        asked.estimate(THREE_MASS.model, THREE_MASS.records)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("m1 + q", "unknown name 'q'"),
        ("m1/m2", "a division by m2, which holds m2"),
        ("m1 +", "found the end of the text"),
        ("m1 = 3", "found '='"),
        ("m" * 1000, "unknown name 'mmm"),
    ],
)
def test_texts_that_are_no_polynomial(expression, message):
    with pytest.raises(ModelError, match=rf"^constraint '.*': .*{message}") as caught:
        constraint_polynomial(THREE_MASS.model, expression)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("value", "std"), [(np.nan, 0.0), (np.inf, 0.0), (1.0, -1.0), (1.0, np.nan), (1.0, np.inf)]
)
def test_numbers_of_a_constraint(value, std):
    with pytest.raises(InputError, match="finite numbers, the deviation not negative"):
        Constraint("m1", value, std)


def test_polynomials():
    model = TRAIN.model
    found = constraint_polynomial(model, "(a + 2*b)^2 - pi*c + 3")
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
