"""A fit as a whole, without the steps on the way to it."""

from collections import deque
from collections.abc import Sequence

from rotorid import Model
from rotorid.data.observation import Observation
from rotorid.likelihood.fit import CovarianceChoice, Fit, Fitting, answered
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge


def fit(
    model: Model,
    records: Sequence[Observation],
    knowledge: Knowledge,
    nuisances: Nuisances,
    *,
    covariance: CovarianceChoice = "auto",
) -> Fit:
    """Return the minimum with its deviations."""
    steps = Fitting(model, knowledge, nuisances, covariance=covariance).located(records)
    return answered(deque(steps, maxlen=1).pop().fit)
