"""One factorization of the Jacobian, held against refits and brute force on random problems."""

from itertools import pairwise

import numpy as np
import pytest

from rotorid.likelihood.linear import Linearized

ROWS, FREE = 60, 6
KINDS = ("plain", "related", "open", "open and related", "few rows")


class Random:
    """A linear problem: rows ``residual + jacobian @ change``, with relations and open directions.

    Columns differ in size by nine orders, as stiffnesses and dampings do.
    """

    def __init__(self, kind: str, seed: int) -> None:
        self.rng = np.random.default_rng([seed, KINDS.index(kind)])
        rows = 4 if kind == "few rows" else ROWS
        jacobian = self.rng.standard_normal((rows, FREE))
        if kind.startswith("open"):
            jacobian[:, 1] = jacobian[:, 0] - 2 * jacobian[:, 2]
        self.scale = 10.0 ** self.rng.uniform(-6, 3, FREE)
        self.jacobian = jacobian / self.scale
        self.residual = self.rng.standard_normal(rows)
        relations = self.rng.standard_normal((2 if kind.endswith("related") else 0, FREE))
        self.relations = relations / self.scale
        self.linear = self.of(self.jacobian, self.residual)
        right = np.linalg.svd(relations)[2]
        self.along = self.scale[:, None] * right[len(relations) :].T  # where no relation changes
        self.expected_rank = min(rows, FREE - len(relations) - kind.startswith("open"))
        if kind == "open and related":
            self.expected_rank += 1  # the relations tell what was open

    def of(self, jacobian: np.ndarray, residual: np.ndarray) -> Linearized:
        shifts = np.zeros(jacobian.shape[1], dtype=bool)
        missing = jacobian.shape[1] - FREE
        relations = np.pad(self.relations, ((0, 0), (0, missing)))
        typical = np.append(self.scale, np.ones(missing))
        return Linearized.of(jacobian, residual, relations, typical, shifts)

    def refit(self, columns: np.ndarray, rows: np.ndarray | slice = slice(None)) -> float:
        """Return the least cost with further columns, of some rows, along the relations."""
        matrix = np.column_stack([self.jacobian @ self.along, columns])[rows]
        residual = self.residual[rows]
        change = np.linalg.lstsq(matrix, -residual, rcond=1e-12)[0]
        return float(((residual + matrix @ change) ** 2).sum())


@pytest.fixture(params=[(kind, seed) for kind in KINDS for seed in range(4)], ids=str)
def made(request: pytest.FixtureRequest) -> Random:
    return Random(*request.param)


def test_leverage_sums_to_the_rank(made: Random) -> None:
    assert made.linear.rank == made.expected_rank
    assert made.linear.leverage.sum() == pytest.approx(made.expected_rank, rel=1e-9)
    shares = made.linear.told_by().sum(axis=1)
    assert shares == pytest.approx(np.ones(FREE), rel=1e-9)


def test_the_covariance_is_that_of_least_squares_along_the_relations(made: Random) -> None:
    inner = made.jacobian @ made.along
    expected = made.along @ np.linalg.pinv(inner.T @ inner, rcond=1e-10) @ made.along.T
    found = made.linear.root @ made.linear.root.T
    if made.linear.rank == made.along.shape[1]:  # what open directions add is a choice of units
        assert found == pytest.approx(expected, rel=1e-6)
    # Whatever is open, the change of the residual is that of the whole projection.
    hat = inner @ np.linalg.pinv(inner, rcond=1e-10)
    assert made.jacobian @ found @ made.jacobian.T == pytest.approx(hat, abs=1e-8)
    assert made.relations @ made.linear.root == pytest.approx(0.0, abs=1e-8)


def test_open_directions_change_neither_the_residual_nor_the_relations(made: Random) -> None:
    null = made.linear.scale[:, None] * made.linear.null
    assert null.shape[1] == made.along.shape[1] - made.expected_rank
    for matrix in (made.jacobian, made.relations):
        assert matrix @ null == pytest.approx(0.0, abs=1e-8)


def test_which_unknowns_are_not_determined() -> None:
    """The first three make up one another's columns; with relations they need not."""
    assert Random("open", 0).linear.undetermined.tolist() == [True] * 3 + [False] * 3
    assert not Random("open and related", 0).linear.undetermined.any()
    assert Random("few rows", 0).linear.undetermined.all()
    assert not Random("plain", 0).linear.undetermined.any()


def test_a_score_is_the_drop_of_the_cost_of_a_refit(made: Random) -> None:
    rows = len(made.residual)
    inside = made.jacobian @ made.along
    for count in (1, 3):
        columns = 1e5 * made.rng.standard_normal((rows, count))
        columns[:, 0] += 1e7 * inside @ made.rng.standard_normal(inside.shape[1])
        drop, change = made.linear.score(columns)
        before = made.refit(np.zeros((rows, 0)))
        assert drop == pytest.approx(before - made.refit(columns), rel=1e-6, abs=1e-9)
        if rows == ROWS:
            wide = made.of(np.column_stack([made.jacobian, columns]), made.residual)
            assert change == pytest.approx(wide.steps(made.residual)[FREE:], rel=1e-6)


def test_columns_that_the_unknowns_take_over_lower_no_cost(made: Random) -> None:
    columns = made.jacobian @ made.along @ made.rng.standard_normal((made.along.shape[1], 2))
    drop, _ = made.linear.score(columns)
    assert drop == pytest.approx(0.0, abs=1e-12)
    assert made.linear.rest(columns) == pytest.approx(0.0, abs=1e-8)
    change = made.linear.taken(columns)
    assert made.jacobian @ change == pytest.approx(columns, rel=1e-6, abs=1e-8)
    assert made.relations @ change == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("share", "drop"), [(0.9e-5, 0.0), (1.1e-5, 4.0)])
def test_a_column_that_is_taken_over_but_for_rounding_lowers_no_cost(share, drop) -> None:
    jacobian, none = np.eye(3)[:, :1], np.zeros((0, 1))
    linear = Linearized.of(jacobian, np.array([0.0, 2.0, 0.0]), none, np.ones(1), np.zeros(1, bool))
    column = 7.0 * np.array([[np.sqrt(1 - share**2)], [share], [0.0]])
    assert linear.score(column)[0] == pytest.approx(drop)


def test_a_step_leads_to_the_least_squares(made: Random) -> None:
    change = made.linear.steps(made.residual)
    left = made.residual + made.jacobian @ change
    assert left @ left == pytest.approx(made.refit(np.zeros((len(left), 0))), rel=1e-9, abs=1e-12)
    assert made.linear.rest(made.residual) == pytest.approx(left, abs=1e-8)


@pytest.mark.parametrize("kind", KINDS[:-1])
def test_without_rows_is_the_cost_of_a_refit_without_them(kind: str) -> None:
    """At the minimum, where the residual is what the unknowns do not take over."""
    made = Random(kind, 7)
    made.residual = made.linear.rest(made.residual)
    linear = made.of(made.jacobian, made.residual)
    for first, last in pairwise((0, 4, 5, 25, 60)):
        rows = np.arange(first, last)
        kept = np.setdiff1d(np.arange(ROWS), rows)
        gained = linear.residual @ linear.residual - made.refit(np.zeros((ROWS, 0)), kept)
        assert linear.without(rows) == pytest.approx(gained, rel=1e-8)


def test_a_row_that_alone_tells_an_unknown_fits_itself() -> None:
    jacobian = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 2.0]])
    residual = np.array([0.0, 2.0, -1.0])
    none = np.zeros((0, 2))
    linear = Linearized.of(jacobian, residual, none, np.ones(2), np.zeros(2, dtype=bool))
    assert linear.without(np.array([0])) == 0.0
    assert linear.without(np.array([1])) == pytest.approx(5.0)  # the third row fits by itself


def test_the_worst_of_what_is_unseen_is_found_by_brute_force(made: Random) -> None:
    columns = 3 * made.rng.standard_normal((len(made.residual), 2))
    columns[:, 0] *= 0.02
    std, excess = made.scale * np.linspace(0.5, 2.0, FREE), 7.0
    std[4] = np.inf
    errors = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, np.pi, 20001)]).T
    left = made.linear.rest(columns)
    errors = errors / np.sqrt(1 + ((left @ errors) ** 2).sum(axis=0) / excess)
    worst = np.abs(made.linear.taken(columns) @ errors / std[:, None]).max(axis=1)
    assert made.linear.unseen(columns, std, excess) == pytest.approx(worst, rel=1e-6)
    assert worst[4] == 0.0


def test_weighted_rows_are_those_of_a_weighted_jacobian(made: Random) -> None:
    weights = made.rng.uniform(0.2, 1.0, len(made.residual))
    whole = made.of(weights[:, None] * made.jacobian, weights * made.residual)
    found = made.linear.determined.weighted(weights)
    fixed = ~made.linear.undetermined
    both = [(at.root @ at.root.T)[np.ix_(fixed, fixed)] for at in (found, whole)]
    assert both[0] == pytest.approx(both[1], rel=1e-6)
    assert found.leverage == pytest.approx(whole.leverage, abs=1e-8)


def test_what_counts_as_rounding() -> None:
    """A column by which nothing moves is none, unless it belongs to a shift."""
    jacobian = np.array([[1.0, 1e-13, 1e-13], [2.0, 1e-13, -1e-13], [0.0, 1e-13, 0.0]])
    shifts = np.array([False, False, True])
    found = Linearized.of(jacobian, np.ones(3), np.zeros((0, 3)), np.ones(3), shifts)
    assert found.undetermined.tolist() == [False, True, False]
    assert found.rank == 2
    none, alike = np.zeros((0, 2)), np.array([[2.0, 1.0], [1.0, 2.0]])
    coarse = Linearized.of(alike, np.ones(2), none, np.ones(2), np.zeros(2, dtype=bool))
    assert (coarse.rank, coarse.cut(0.5).rank) == (2, 1)


def test_a_derivative_beyond_all_bounds_is_no_information() -> None:
    with pytest.raises(np.linalg.LinAlgError, match="beyond all bounds"):
        Linearized.of(
            np.full((2, 1), 1e200), np.ones(2), np.zeros((0, 1)), np.ones(1), np.ones(1) > 0
        )
    with pytest.raises(np.linalg.LinAlgError, match="without a free unknown"):
        Linearized.of(np.ones((2, 1)), np.ones(2), np.zeros((1, 1)), np.ones(1), np.ones(1) > 0)
