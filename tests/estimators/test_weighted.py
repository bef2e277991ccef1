"""The weighted solution, its gains and its sandwich, on plain matrices."""

from dataclasses import replace

import numpy as np
import pytest
from sampled_bank import coloured
from scipy.optimize import brentq
from scipy.stats import t as student

from rotorid import Channel, PeriodicRecord
from rotorid.linear.solve import (
    ALONE,
    BLOCKS,
    CHANCE,
    FEWEST,
    TINY,
    Block,
    Scatter,
    block_numbers,
    pooled,
    sandwich,
    scatter_of_answers,
    scatter_of_blocks,
    solve,
)
from rotorid.signals.spectrum import synthesize

# -------------------------------------------------------------------------------------------------
# The weighted solution, its gains and its sandwich, on plain matrices.


def record_of(samples, harmonics, periods=3):
    harmonics = np.array(harmonics)
    return PeriodicRecord(
        channels=(Channel("x"),),
        sample_rate=100.0,
        harmonics=harmonics,
        spectra=np.zeros((periods, len(harmonics), 1), dtype=complex),
        variance=np.zeros((samples, 1)),
        mean=np.zeros((samples, 1)),
        speed=0.0,
        time=np.zeros((periods, samples)),
        angle=np.zeros((periods, samples)),
    )


def lines_of(rng, record, *shape):
    """Return random lines, real at DC and Nyquist."""
    lines = rng.standard_normal((len(record.harmonics), *shape, 2)) @ np.array([1, 1j])
    lines[record.multiplicity == 1] = lines[record.multiplicity == 1].real
    return lines


@pytest.fixture(params=[([0, 2, 5, 8], 16), ([1, 3, 4], 15)], ids=["with DC and Nyquist", "odd"])
def block(request):
    rng = np.random.default_rng(1)
    harmonics, samples = request.param
    record = record_of(samples, harmonics)
    design, target = lines_of(rng, record, 3, 4), lines_of(rng, record, 3)
    return Block(design, target, rng.uniform(0.1, 10, (samples, 3)), record)


def test_solution_of_the_weighted_problem(block):
    matrix = np.stack(
        [
            synthesize(block.design[..., f], block.record.harmonics, block.record.samples)
            for f in range(4)
        ],
        axis=-1,
    )
    right = synthesize(block.target, block.record.harmonics, block.record.samples)
    root = 1 / np.sqrt(block.variance)
    expected = np.linalg.lstsq(
        (matrix * root[..., None]).reshape(-1, 4), (right * root).reshape(-1), rcond=None
    )[0]
    found = solve([block])
    np.testing.assert_allclose(found.values, expected)
    assert found.undetermined.shape == (4, 0)
    scaled = (matrix * root[..., None]).reshape(-1, 4)
    scaled /= np.linalg.norm(scaled, axis=0)
    assert found.condition_number == pytest.approx(np.linalg.cond(scaled))


def test_gains_give_the_values_back(block):
    found = solve([block])
    (gains,) = found.gains
    np.testing.assert_allclose(np.einsum("fkr,kr->f", gains, block.target).real, found.values)
    identity = np.einsum("fkr,krj->fj", gains, block.design).real
    np.testing.assert_allclose(identity, np.eye(4), atol=1e-12)


def test_units_of_columns_and_weights_do_not_matter(block):
    found = solve([block])
    scale = np.array([1e-9, 1.0, 1e7, 1e12])
    other = replace(block, design=block.design * scale, variance=block.variance * 1e-14)
    scaled = solve([other])
    np.testing.assert_allclose(scaled.values * scale, found.values, rtol=1e-9)
    assert scaled.condition_number == pytest.approx(found.condition_number, rel=1e-9)


def test_blocks_stack(block):
    twice = solve([block, block])
    np.testing.assert_allclose(twice.values, solve([block]).values)
    np.testing.assert_allclose(twice.gains[0], solve([block]).gains[0] / 2, atol=1e-14)
    assert len(twice.gains) == 2


def test_sandwich_is_the_scatter_of_the_values(block):
    """Noise with correlated rows, circular on complex lines and real on the others."""
    rng = np.random.default_rng(2)
    roots = lines_of(rng, block.record, 3, 3)
    matrices = roots @ roots.conj().swapaxes(1, 2)
    found = solve([block])
    draws = []
    for _ in range(4000):
        white = rng.standard_normal((len(roots), 3, 2)) @ np.array([1, 1j]) / np.sqrt(2)
        real = block.record.multiplicity == 1
        white[real] = rng.standard_normal((int(real.sum()), 3))
        noise = np.einsum("kij,kj->ki", roots, white)
        draws.append(np.einsum("fkr,kr->f", found.gains[0], noise).real)
    expected = np.cov(np.array(draws).T)
    stated = sandwich(found.gains, [matrices], [block.record])
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        stated / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.08
    )
    np.testing.assert_array_equal(stated, stated.T)


def test_scatter_of_answers_agrees_with_the_sandwich_for_independent_lines(block):
    rng = np.random.default_rng(3)
    gains = solve([block]).gains
    periods = 5000
    noise = np.stack([lines_of(rng, block.record, 3) for _ in range(periods)])
    matrices = np.zeros((len(block.record.harmonics), 3, 3)) + 2 * np.eye(3) / periods
    matrices[block.record.multiplicity == 1] /= 2
    stated = sandwich(gains, [matrices], [block.record])
    found = scatter_of_answers(gains, [noise])
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


def test_more_unknowns_than_samples():
    rng = np.random.default_rng(4)
    record = record_of(2, [0])
    design, target = lines_of(rng, record, 1, 3), lines_of(rng, record, 1)
    found = solve([Block(design, target, np.ones((2, 1)), record)])
    assert np.isnan(found.values).all()
    assert found.undetermined.shape == (3, 2)


def test_variances_of_many_periods_stay_with_their_samples():
    rng = np.random.default_rng(5)
    variance = rng.uniform(1, 2, (20, 2))
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


# -------------------------------------------------------------------------------------------------
# Deviations by blocks: against leaving out by hand, and what the decisions decide.


RNG = np.random.default_rng(3)


def fit(matrix: np.ndarray, right: np.ndarray, numbers: np.ndarray) -> Scatter:
    gains = np.linalg.pinv(matrix)
    return scatter_of_blocks(matrix, right - matrix @ (gains @ right), gains, numbers)


def test_it_is_leaving_out_each_block() -> None:
    matrix, right = RNG.standard_normal((960, 3)), RNG.standard_normal(960)
    numbers = block_numbers([960], 12)
    without = np.array(
        [
            np.linalg.lstsq(matrix[numbers != b], right[numbers != b], rcond=None)[0]
            for b in range(12)
        ]
    )
    apart = without - without.mean(axis=0)
    found = fit(matrix, right, numbers)
    assert not found.alone.any()
    np.testing.assert_allclose(found.covariance, apart.T @ apart * 11 / 12 * 11 / 9, rtol=1e-9)
    np.testing.assert_allclose(found.shifts.sum(axis=0), 0.0, atol=1e-12)


def test_blocks_cross_no_runs() -> None:
    numbers = block_numbers([300, 100], 8)
    assert numbers.tolist() == sorted(numbers.tolist())
    assert numbers[299] < numbers[300]
    assert np.bincount(numbers).tolist() == [50] * 8
    assert block_numbers([3000, 1], BLOCKS)[-1] == BLOCKS == 32


def test_blocks_that_remember_one_another_are_merged() -> None:
    """A level, and noise with a memory: merged while neighbours resemble, never below eight."""
    count, level = 3200, np.ones((3200, 1))
    numbers = block_numbers([count], BLOCKS)
    found = {}
    for memory in (1e-3, 0.06, 100.0):  # a block is .1 s long
        noise = coloured(np.random.default_rng(0), count, 1.0, memory, 1000.0)
        found[memory] = fit(level, noise, numbers)
    assert [found[m].blocks for m in (1e-3, 0.06, 100.0)] == [32, 16, FEWEST]
    assert [found[m].memory for m in (1e-3, 0.06, 100.0)] == [False, False, True]


@pytest.mark.parametrize(("share", "merged"), [(0.95, False), (1.05, True)])
def test_how_much_neighbours_may_resemble(share: float, merged: bool) -> None:
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


def test_what_one_block_tells_alone() -> None:
    """A column that is large in one block only: `ALONE` of what tells it must lie elsewhere."""
    numbers = block_numbers([320], 16)
    for share, alone in ((0.8 * ALONE, True), (1.2 * ALONE, False)):
        column = np.zeros(320)
        column[:20] = np.sqrt((1 - share) / 20)
        column[20:] = np.sqrt(share / 300) * np.tile([1.0, -1.0], 150)
        matrix = np.column_stack([column, np.tile([1.0, -1.0, -1.0, 1.0], 80)])
        found = fit(matrix, RNG.standard_normal(320), numbers)
        assert found.alone.tolist() == [alone, False]


@pytest.mark.parametrize(("share", "both"), [(0.8, False), (1.25, True)])
def test_which_parameters_are_of_a_combination_that_one_block_tells(
    share: float, both: bool
) -> None:
    """Outside block 0 the second column is a multiple of the first: they are told together."""
    numbers = block_numbers([320], 16)
    first = np.tile([1.0, -1.0, -1.0, 1.0], 80)
    own = np.where(np.arange(320) < 20, np.tile([1.0, 1.0, -1.0, -1.0], 80), 0.0)

    def posed(multiple: float) -> tuple[np.ndarray, float]:
        matrix = np.column_stack([first, own - multiple * np.where(own == 0, first, 0.0)])
        lengths = np.sqrt((np.linalg.pinv(matrix) ** 2).sum(axis=1))
        direction = np.array([multiple, 1.0]) / lengths
        return matrix, float(direction[0] / np.linalg.norm(direction))

    multiple = brentq(lambda m: posed(m)[1] - share * TINY, 0.0, 5.0)
    found = fit(posed(multiple)[0], RNG.standard_normal(320), numbers)
    assert found.alone.tolist() == [both, True]


def test_halves_differ_by_what_lies_between_them_alone() -> None:
    quiet = RNG.standard_normal((32, 1))
    quiet -= quiet.mean()
    step = np.repeat([5.0, -5.0], 16)[:, None]
    (calm, std), (apart, same) = (
        Scatter(np.eye(1), shifts, False, np.zeros(1, dtype=bool)).halves()
        for shifts in (quiet, quiet + step)
    )
    assert std == pytest.approx(same)
    assert (apart[0] - apart[1] - (calm[0] - calm[1])) == pytest.approx(2 * 32 * 5)
    within = np.concatenate([half - half.mean() for half in np.split(quiet[:, 0], 2)])
    wider = student.isf(student.sf(CHANCE, 1e9), 30) / CHANCE
    assert std == pytest.approx(wider * np.sqrt((within**2).sum() * 32 / 30), rel=1e-3)
