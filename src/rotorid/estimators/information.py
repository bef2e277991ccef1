"""What a record says at best about base parameters: the paper's (13), read as it should be."""

from __future__ import annotations

import numpy as np

from rotorid.estimate import Estimate
from rotorid.estimators.family import force_variance
from rotorid.estimators.regression import Regression
from rotorid.estimators.weighted import Block
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.observation import Data, bind
from rotorid.record import Floats


@frozen
class Information:
    """Information of the rows with a measured force.

    Parameters
    ----------
    names : sequence of str
        Base parameters.
    matrix : array, shape (base, base)
        ``F' Sigma^-1 F``, Sigma the variance of the mean force at each sample.
    condition_number : float
        Of F, as the paper's robots have it: neither rows nor columns are scaled.
    scaled_condition_number : float
        Of F with its columns scaled to length one; it does not change with the units.
    """

    names: tuple[str, ...]
    matrix: Floats
    condition_number: float
    scaled_condition_number: float


def information_of(model: Model, estimate: Estimate, record: Data) -> Information | None:
    """Return the information of a record about what an estimate left free.

    ``None`` for an estimate by maximum likelihood, whose own covariance says all there is to say,
    and for filtered samples, whose noise nobody knows beforehand.

    Raises
    ------
    InputError
        As `information`.
    """
    seen = bind(model, record)
    if estimate.method == "ml" or seen.hidden or seen.filtered is not None:
        return None
    held = {value.name: value.value for value in estimate.parameters if value.fixed}
    return information(model.substitute(held), seen)


def information(model: Model, data: Data) -> Information:
    """Return the information matrix and the condition numbers of a record.

    The paper's (13) calls ``F' Sigma^-1 F`` a covariance; it is an information matrix. Nor is its
    inverse the covariance of an estimate: the noise in F is left out, and rows without actuator
    have no variance, so that they are left out here. Use it to compare records; the deviations
    of an estimate are in its own covariance.
    """
    regression = Regression(bind(model, data))
    record = regression.record
    ones = np.ones((record.samples, regression.rows))
    plain, _ = Block(record, regression.design, regression.target, ones).whitened()
    driven = list(np.flatnonzero((model.input_matrix != 0).any(axis=1)))
    variance = force_variance(regression)[:, driven] / record.periods
    block = Block(record, regression.design[:, driven], regression.target[:, driven], variance)
    weighted, _ = block.whitened()
    length = np.sqrt((plain**2).sum(axis=0))
    return Information(
        names=model.base.names,
        matrix=weighted.T @ weighted,
        condition_number=float(np.linalg.cond(plain)),
        scaled_condition_number=float(np.linalg.cond(plain / np.where(length > 0, length, 1.0))),
    )
