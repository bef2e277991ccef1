"""The methods by the names that files and results have for them."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Protocol

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.models import Model
from rotorid.observation import Data


class Estimator(Protocol):
    """What `rotorid.identify` needs: one method."""

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return what the records say of the model's parameters."""
        ...


METHODS = {
    "ls": "LeastSquares",
    "batch": "Batch",
    "sequential": "Sequential",
    "ml": "MaximumLikelihood",
}


def by_name(method: str) -> Estimator:
    """Return an estimator with its default settings by the name of its method."""
    if method not in METHODS:
        raise InputError(
            f"the method {method!r}", f"one of {', '.join(METHODS)}", "name one of these methods"
        )
    estimator: Estimator = getattr(import_module("rotorid.estimators"), METHODS[method])()
    return estimator
