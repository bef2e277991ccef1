"""Batch processing: forces weighted by their variance, rows without actuator by a factor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.estimators.by_samples import estimate_by_samples, filtered_records
from rotorid.estimators.family import LinearEstimator, Problem, force_variance, pose
from rotorid.estimators.regression import Regression
from rotorid.estimators.weighted import Block, Solution, solve
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.observation import Data, bind_all
from rotorid.record import Floats


@frozen
class Batch(LinearEstimator):
    """``min (F theta - b)' Sigma^-1 (F theta - b)``, Sigma diagonal, all rows at once.

    A row with a measured force has that force's variance at each sample; a row without has
    `free_weight` times the largest of them. The paper calls the free weight k and alpha. A large
    one takes bias away and adds variance.

    Parameters
    ----------
    free_weight : float
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    References
    ----------
    Levy and Arogeti, equations (3), (4), (8) and (9). What (9) calls sigma is a variance.

    Examples
    --------
    >>> Batch(free_weight=10.0).free_weight
    10.0
    """

    free_weight: float = 100.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.free_weight) and self.free_weight > 0):
            raise InputError(
                f"free_weight {self.free_weight}",
                "a positive number",
                "take 100, as the paper does",
            )

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return the estimate of the base parameters.

        Raises
        ------
        InputError
            For records that do not fit the model, or knowledge that only ml can use.
        """
        bound = bind_all(model, records)
        if filtered_records(bound):
            return estimate_by_samples(
                "batch", bound, self.fixed, self.constraints, self.free_weight
            )
        return pose(bound, self.fixed, self.constraints).summarize("batch", self._solved)

    def solve(self, model: Model, records: Sequence[Data]) -> tuple[Problem, Solution]:
        """Return the regression and its solution, without statistics.

        Raises
        ------
        InputError
            As `estimate`.
        """
        problem = pose(bind_all(model, records), self.fixed, self.constraints)
        return problem, self._solved(problem)

    def _solved(self, problem: Problem) -> Solution:
        return solve(
            [
                Block(r.record, *problem.free_equations(r), self._variance(r))
                for r in problem.regressions
            ]
        )

    def _variance(self, regression: Regression) -> Floats:
        variance = force_variance(regression)
        largest = variance.max(axis=1, keepdims=True)
        free = ~regression.model.input_matrix.any(axis=1)
        return np.where(free, self.free_weight * np.where(largest > 0, largest, 1.0), variance)
