"""What equations predict: the inputs where every coordinate is measured, else the readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimate_parts import Prediction
from rotorid.estimators.regression import Regression
from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, Integers


@frozen
class Predicted:
    """Lines of some channels of a record, measured and predicted.

    Parameters
    ----------
    names, units : sequence of str
    measured, predicted : complex array, shape (line, channel)
        In SI units; measured ones corrected for what the channel is known to do.
    multiplicity : array, shape (line,)
    samples : int array, shape (line,), optional
        Of a record without lines: the sample of each row.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    measured: Complexes
    predicted: Complexes
    multiplicity: Floats
    samples: Integers | None = None

    @property
    def wrong(self) -> Floats:
        """Squared length of what is wrong, shape (channel,)."""
        return np.asarray(self.multiplicity @ np.abs(self.predicted - self.measured) ** 2)

    @property
    def size(self) -> Floats:
        """Squared length of what was measured, shape (channel,)."""
        return np.asarray(self.multiplicity @ np.abs(self.measured) ** 2)


def relative_errors(records: Sequence[Predicted]) -> dict[str, Prediction | None]:
    """Return |predicted - measured| / |measured| of each channel, all records together.

    ``None`` for a channel that is zero.
    """
    wrong: dict[str, float] = {}
    size: dict[str, float] = {}
    for record in records:
        for name, error, power in zip(record.names, record.wrong, record.size, strict=True):
            wrong[name] = wrong.get(name, 0.0) + float(error)
            size[name] = size.get(name, 0.0) + float(power)
    return {
        name: Prediction(float(np.sqrt(wrong[name] / size[name]))) if size[name] > 0 else None
        for name in wrong
    }


def lay_to_inputs(left: Complexes, matrix: Complexes) -> Complexes:
    """Solve ``B u = left`` for the inputs, (line, input); rows without input have no say."""
    driven = np.abs(matrix).any(axis=(0, 2))
    if not driven.any():
        return np.zeros((len(left), matrix.shape[2]), dtype=np.complex128)
    return np.stack(
        [
            np.linalg.lstsq(b[driven], f[driven], rcond=None)[0]
            for b, f in zip(matrix, left, strict=True)
        ]
    )


def by_regression(regression: Regression, base: Floats) -> Predicted:
    """Predict the inputs of a record from base parameters; any model."""
    model = regression.model
    measured = regression.inputs.mean(axis=0)
    matrix = np.broadcast_to(model.input_matrix + 0j, (len(measured), *model.input_matrix.shape))
    wrong = lay_to_inputs(regression.residual(base), matrix)
    units = tuple(model.units[name] for name in model.inputs)
    multiplicity = regression.record.multiplicity
    return Predicted(model.inputs, units, measured, measured + wrong, multiplicity)
