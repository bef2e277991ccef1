"""The one front function: a model, records, an estimator, an estimate."""

from __future__ import annotations

from collections.abc import Sequence

from rotorid.estimate import Estimate
from rotorid.estimators import Estimator
from rotorid.models import Model
from rotorid.observation import Data


def identify(model: Model, periods: Data | Sequence[Data], estimator: Estimator) -> Estimate:
    r"""Estimate the parameters of a model from one record or several.

    Parameters
    ----------
    model : Model
    periods : PeriodicRecord or Lines, or sequence of them
        Records of one machine; several are identified together.
    estimator : Estimator
        `LeastSquares`, `Batch`, `Sequential`, `MaximumLikelihood`, or one of your own.

    Returns
    -------
    Estimate
        Its status says whether the parameters are determined.

    Raises
    ------
    InputError
        For records that do not fit the model or the estimator.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> t = np.arange(400) / 100.0
    >>> motion = np.column_stack([-3.0 * np.pi**2 * np.cos(np.pi * t), 0.75 * np.cos(np.pi * t)])
    >>> record = rid.Record([rid.Channel("F_x"), rid.Channel("x")], motion, sample_rate=100.0)
    >>> model = rid.parse_model('''
    ... title = "a free mass"
    ... equations = ["m*x\'\' = F_x"]
    ... coordinates = { x = "m" }
    ... inputs = { F_x = "N" }
    ... parameters = { m = { unit = "kg" } }''')
    >>> estimate = rid.identify(model, rid.average(record, 0.5, harmonics=[1]), rid.LeastSquares())
    >>> round(estimate.value("m"), 9)
    4.0
    """
    return estimator.estimate(model, periods if isinstance(periods, Sequence) else [periods])
