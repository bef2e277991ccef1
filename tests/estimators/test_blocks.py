"""Deviations by blocks: against leaving out by hand, and what the decisions decide."""

import numpy as np
import pytest
from sampled_bank import coloured
from scipy.optimize import brentq
from scipy.stats import t as student

from rotorid.linear.solve import (
    ALONE,
    BLOCKS,
    CHANCE,
    FEWEST,
    TINY,
    Scatter,
    block_numbers,
    scatter_of_blocks,
)

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
