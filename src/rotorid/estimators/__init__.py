"""Estimators, one per file; each is a value with one method, `estimate(model, records)`."""

from collections.abc import Callable, Sequence
from typing import Protocol

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.estimators.batch import Batch
from rotorid.estimators.knowledge import Constraint
from rotorid.estimators.least_squares import LeastSquares
from rotorid.estimators.likelihood.bound import Plan, predict_accuracy
from rotorid.estimators.maximum_likelihood import MaximumLikelihood
from rotorid.estimators.sequential import Sequential
from rotorid.models import Model
from rotorid.observation import Data

__all__ = [
    "Batch",
    "Constraint",
    "Estimator",
    "LeastSquares",
    "MaximumLikelihood",
    "Plan",
    "Sequential",
    "by_name",
    "predict_accuracy",
]


class Estimator(Protocol):
    """What `rotorid.identify` needs: one method."""

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return what the records say of the model's parameters."""
        ...


METHODS: dict[str, Callable[[], Estimator]] = {
    "ls": LeastSquares,
    "batch": Batch,
    "sequential": Sequential,
    "ml": MaximumLikelihood,
}
"""The methods by the names that files and results have for them."""


def by_name(method: str) -> Estimator:
    """Return an estimator with its default settings by the name of its method."""
    if method not in METHODS:
        raise InputError(
            f"the method {method!r}", f"one of {', '.join(METHODS)}", "name one of these methods"
        )
    return METHODS[method]()
