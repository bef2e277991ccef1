"""The linear regression on lines that the least-squares family shares.

The signals of the model are evaluated on the line-filtered motion, and their own lines are kept:
the line filter applies to the columns of Phi as it does to the forces. Then the equations of
motion read, on line k and in row r,

    sum_b design[k, r, b] base[b] = target[k, r].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Prediction
from rotorid.models import Model, Motion
from rotorid.models.evaluation import is_usable
from rotorid.models.expression import symbol
from rotorid.models.linear import speed_factor
from rotorid.record import Complexes, Floats, PeriodicRecord
from rotorid.signals.covariance import LineCovariance, choose_covariance
from rotorid.signals.spectrum import differentiate, line_spectra, synthesize

ROUNDING = 1e-12


def sensors(model: Model, record: PeriodicRecord) -> tuple[list[int], Floats]:
    """Return the channels that read coordinates, and C with y = C q."""
    names = model.coordinates
    channels = [
        i for i, c in enumerate(record.channels) if c.combination and {*c.combination} <= {*names}
    ]
    reads = [[record.channels[i].combination.get(q, 0.0) for q in names] for i in channels]
    return channels, np.array(reads, dtype=float).reshape(len(channels), len(names))


def hidden_coordinates(model: Model, record: PeriodicRecord) -> list[str]:
    """Return the coordinates that the sensors of a record do not determine."""
    _, reads = sensors(model, record)
    if not reads.size:
        return list(model.coordinates)
    units = np.eye(len(model.coordinates))
    seen = np.linalg.matrix_rank(reads)
    return [
        q
        for q, unit in zip(model.coordinates, units, strict=True)
        if np.linalg.matrix_rank(np.vstack([reads, unit])) > seen
    ]


def coordinate_spectra(model: Model, record: PeriodicRecord) -> Complexes:
    """Return the lines of every coordinate, period by period.

    Sensors of several coordinates are solved for them.
    """
    channels, reads = sensors(model, record)
    if hidden := hidden_coordinates(model, record):
        raise InputError(
            f"no sensor of {', '.join(hidden)}",
            "every coordinate measured",
            "measure it, or use ml, which needs no such sensor",
            file=record.source,
        )
    return np.asarray(record.spectra[..., channels] @ np.linalg.pinv(reads).T)


def input_channels(model: Model, record: PeriodicRecord) -> list[int]:
    """Return the channel of each input of the model, in order."""
    missing = [name for name in model.inputs if name not in record.names]
    if missing:
        raise InputError(
            f"no channel of the input {', '.join(missing)}",
            "every input measured",
            "name its column in [channels]",
            file=record.source,
        )
    return [record.index(name) for name in model.inputs]


def input_spectra(model: Model, record: PeriodicRecord) -> Complexes:
    """Return the lines of every input, shape (period, line, input)."""
    channels = input_channels(model, record)
    currents = [record.names[i] for i in channels if record.channels[i].drive is not None]
    if currents:
        raise InputError(
            f"a current in the channel of {currents[0]}", "a force", "use ml", file=record.source
        )
    return record.spectra[..., channels]


def signal_spectra(
    model: Model, record: PeriodicRecord, coordinates: Complexes, time: Floats, angle: Floats
) -> Complexes:
    """Return the lines of the model's signals on the motion that has these lines."""
    derivatives = [
        differentiate(coordinates, record.harmonics, record.samples, record.sample_rate, order)
        for order in range(3)
    ]
    lines = np.empty((*coordinates.shape[:-1], len(model.signals)), dtype=complex)
    others = []
    for index, factor in enumerate(model.motion_factors):
        if factor is None:
            others.append(index)
        else:
            column, order, scale = factor
            gain = speed_factor(scale, record.speed)
            lines[..., index] = gain * derivatives[order][..., column]
    if any(model.moves(index) for index in others):
        waves = [synthesize(d, record.harmonics, record.samples) for d in derivatives]
    else:
        still = (*coordinates.shape[:-2], record.samples, len(model.coordinates))
        waves = [np.zeros(still)] * 3
    motion = Motion(waves[0], waves[1], waves[2], time, angle, record.speed)
    for index in others:
        lines[..., index] = _sampled_lines(model, record, index, motion)
    return lines


def _sampled_lines(model: Model, record: PeriodicRecord, index: int, motion: Motion) -> Complexes:
    """Return the lines of a signal that has to be evaluated sample by sample, (..., line)."""
    value = model.signal_value(index, motion)
    if not is_usable(value):
        raise InputError(
            f"{model.signals[index]} without a finite value on this record",
            "a division by something other than zero, a root of something positive",
            "rewrite the term, or check the channels in it",
            file=record.source,
        )
    axes = motion.position.ndim - 1
    mean = value.mean(axis=0) if value.ndim > axes else value
    whole = np.broadcast_to(mean, np.broadcast_shapes(mean.shape, (record.samples,)))
    lines = line_spectra(whole[..., None], record.harmonics)[..., 0]
    # What rounding leaves on a line is no signal: an unbalance whose line is not kept.
    return np.where(np.abs(lines) > ROUNDING * np.abs(whole).max(), lines, 0)


@dataclass(frozen=True)
class Regression:
    """The equations of motion of one record, on its lines.

    Parameters
    ----------
    model : Model
    record : PeriodicRecord
    """

    model: Model
    record: PeriodicRecord

    @cached_property
    def coordinates(self) -> Complexes:
        """Lines of the coordinates, shape (period, line, coordinate)."""
        return coordinate_spectra(self.model, self.record)

    @cached_property
    def signals(self) -> Complexes:
        """Lines of the signals on the mean motion, shape (line, signal)."""
        mean = self.coordinates.mean(axis=0)
        return signal_spectra(
            self.model, self.record, mean, *time_and_angle(self.model, self.record)
        )

    @cached_property
    def period_signals(self) -> Complexes:
        """Lines of the signals on the motion of each period, shape (period, line, signal)."""
        return signal_spectra(
            self.model, self.record, self.coordinates, *time_and_angle(self.model, self.record)
        )

    @cached_property
    def period_forces(self) -> Complexes:
        """Lines of B u in each period, shape (period, line, row)."""
        return np.asarray(input_spectra(self.model, self.record) @ self.model.input_matrix.T)

    @cached_property
    def design(self) -> Complexes:
        """Lines of Phi, shape (line, row, base)."""
        return np.asarray(np.tensordot(self.signals, self.model.coefficients[0], axes=1))

    @cached_property
    def target(self) -> Complexes:
        """Lines of B u less the terms without parameters, shape (line, row)."""
        known = self.signals @ self.model.coefficients[1]
        return np.asarray(self.period_forces.mean(axis=0) - known)

    def period_residual(self, base: Floats) -> Complexes:
        """Return the lines of ``Phi base + known - B u`` of each period, (period, line, row)."""
        coefficients, known = self.model.coefficients
        return np.asarray(self.period_signals @ (coefficients @ base + known) - self.period_forces)

    def residual(self, base: Floats) -> Complexes:
        """Return the lines of ``Phi base + known - B u`` of the mean, shape (line, row)."""
        return self.design @ base - self.target

    def residual_covariance(self, base: Floats) -> LineCovariance:
        """Return the covariance of `residual`, from its scatter over periods."""
        residual = self.period_residual(base)
        return choose_covariance(residual, residual)

    @property
    def rows(self) -> int:
        """Number of equations."""
        return len(self.model.texts)

    @property
    def driven(self) -> list[int]:
        """Rows with a measured input or a term without parameters."""
        forced = self.model.input_matrix.any(axis=1) | self.model.coefficients[1].any(axis=0)
        return [int(row) for row in np.flatnonzero(forced)]


def predict_inputs(regressions: Sequence[Regression], base: Floats) -> dict[str, Prediction | None]:
    """Return how well each input is predicted: |lines(u - u_hat)| / |lines(u)|, the seed's (12).

    The residual of the equations is laid to the inputs by the pseudoinverse of B.
    """
    model = regressions[0].model
    wrong, size = np.zeros(len(model.inputs)), np.zeros(len(model.inputs))
    for regression in regressions:
        weight = regression.record.multiplicity
        force = input_spectra(model, regression.record).mean(axis=0)
        error = regression.residual(base) @ np.linalg.pinv(model.input_matrix).T
        wrong += weight @ np.abs(error) ** 2
        size += weight @ np.abs(force) ** 2
    return {
        name: Prediction(float(np.sqrt(wrong[i] / size[i]))) if size[i] > 0 else None
        for i, name in enumerate(model.inputs)
    }


def load_spectra(model: Model, record: PeriodicRecord) -> Complexes:
    """Return the lines of the columns of g, averaged over periods; g = columns @ mu."""
    linear = model.require_linear()
    columns = linear.load_columns(*time_and_angle(model, record), record.speed).mean(axis=0)
    lines = line_spectra(columns.reshape(record.samples, -1), record.harmonics)
    return lines.reshape(len(record.harmonics), linear.rows, linear.monomials)


def time_and_angle(model: Model, record: PeriodicRecord) -> tuple[Floats, Floats]:
    """Return t and phi of all periods, or of the first where the others repeat it."""
    turns = (record.angle - record.angle[0]) / (2 * np.pi)
    timed = any(symbol("t") in signal.free_symbols for signal in model.signals)
    if not timed and np.abs(turns - np.round(turns)).max() < 1e-9:
        return record.time[:1], record.angle[:1]
    return record.time, record.angle
