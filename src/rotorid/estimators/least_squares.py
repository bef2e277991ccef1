"""Least squares without statistics: the paper's Sigma = I."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimate import Estimate
from rotorid.estimators.by_samples import estimate_by_samples, filtered_records
from rotorid.estimators.family import LinearEstimator, Problem, pose
from rotorid.estimators.weighted import Block, Solution, solve
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.observation import Data, bind_all


@frozen
class LeastSquares(LinearEstimator):
    """``min |F theta - b|^2`` over all rows and samples alike.

    The derivatives in F are taken as free of noise. They are not: noise in the regressors
    attenuates the estimates, most in rows whose right side is zero, and on the paper's rotor this
    bias is nearly all of the error. The stated deviations cover the scatter, not the bias.

    Parameters
    ----------
    fixed : mapping of str to float
        Physical parameters (SI) that are substituted.
    constraints : sequence of Constraint
        Exact ones, linear in the base parameters.

    References
    ----------
    Levy and Arogeti, equations (2) and (3).

    Examples
    --------
    >>> LeastSquares(fixed={"L1": 0.3}).fixed
    {'L1': 0.3}
    """

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return the estimate of the base parameters.

        Raises
        ------
        InputError
            For records that do not fit the model, or knowledge that only ml can use.
        """
        bound = bind_all(model, records)
        if filtered_records(bound):
            return estimate_by_samples("ls", bound, self.fixed, self.constraints)
        return pose(bound, self.fixed, self.constraints).summarize("ls", _solved)


def _solved(problem: Problem) -> Solution:
    """Solve with all equations alike."""
    return solve(
        [
            Block(r.record, *problem.free_equations(r), np.ones((r.record.samples, r.rows)))
            for r in problem.regressions
        ]
    )
