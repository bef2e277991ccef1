"""The linear regression on lines that the least-squares family shares.

The signals of the model are evaluated on the line-filtered motion, and their own lines are kept:
the line filter applies to the columns of Phi as it does to the forces. Then the equations of
motion read, on line k and in row r,

    sum_b design[k, r, b] base[b] = target[k, r].
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.lines import PeriodicClock, PhasorClock
from rotorid.models import Model, Motion
from rotorid.models.evaluation import is_usable
from rotorid.models.expression import symbol
from rotorid.models.linear import speed_factor
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats, PeriodicRecord
from rotorid.signals.covariance import LineCovariance, choose_covariance
from rotorid.signals.spectrum import differentiate, line_spectra, synthesize

ROUNDING = 1e-12


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


def driven_rows(model: Model) -> list[int]:
    """Return the rows with a measured input or a term without parameters."""
    forced = model.input_matrix.any(axis=1) | model.coefficients[1].any(axis=0)
    return [int(row) for row in np.flatnonzero(forced)]


def sensed(seen: Observation) -> tuple[list[int], Floats]:
    """Return the columns of the sensors, and what makes coordinates of them, (sensor, coordinate).

    Refuses an observation from which the coordinates do not follow.
    """
    if seen.hidden or seen.indirect:
        derived = [s.channel.name for s in seen.indirect]
        raise InputError(
            f"no sensor of {', '.join(seen.hidden)}"
            if seen.hidden
            else f"{derived[0]}, which reads a derivative or holds parameters",
            "every coordinate measured, by sensors of positions",
            "measure it, or use ml, which needs no such sensor",
            file=seen.lines.source,
        )
    return [sensor.column for sensor in seen.direct], np.asarray(np.linalg.pinv(seen.reads).T)


def check_forces(seen: Observation) -> None:
    """Refuse an input whose channel holds a current."""
    for channel in seen.inputs:
        if channel.drive is not None:
            raise InputError(
                f"a current in the channel of {channel.name}",
                "a force",
                "use ml",
                file=seen.lines.source,
            )


@frozen
class Regression:
    """The equations of motion of one record, on its lines.

    Parameters
    ----------
    observation : Observation
    kept : (first, last)
        Periods that are used, as a slice takes them; all where it is not given.
    """

    observation: Observation
    kept: tuple[int | None, int | None] = (None, None)

    @property
    def model(self) -> Model:
        """The model that the record is bound to."""
        return self.observation.model

    @cached_property
    def record(self) -> PeriodicRecord:
        """The periods; an `InputError` where the record has none."""
        lines = self.observation.lines
        if self.observation.periodic is None and isinstance(lines.clock, PhasorClock):
            raise InputError(
                "a table, which has no samples",
                "whole periods for this method",
                "use ml, for a model that is linear in its coordinates",
                file=lines.source,
            )
        if self.observation.periodic is None:
            raise InputError(
                "a record without periods",
                "whole periods for this method",
                "give its fundamental, or, without one, the cut-off of a low-pass in place of the "
                'band (cutoff = "100 Hz", rid.filtered); for a linear model, use ml',
                file=self.observation.lines.source,
            )
        return self.observation.periodic

    @cached_property
    def coordinates(self) -> Complexes:
        """Lines of the coordinates, shape (period, line, coordinate).

        Sensors of several coordinates are solved for them.
        """
        columns, follow = sensed(self.observation)
        return np.asarray(self.record.spectra[slice(*self.kept)][..., columns] @ follow)

    @cached_property
    def inputs(self) -> Complexes:
        """Lines of every input, shape (period, line, input)."""
        check_forces(self.observation)
        return self.record.spectra[slice(*self.kept)][..., list(self.observation.input_columns)]

    @cached_property
    def clock(self) -> tuple[Floats, Floats]:
        """T and phi at which the signals are evaluated."""
        timed = any(symbol("t") in signal.free_symbols for signal in self.model.signals)
        record = self.record
        clock = PeriodicClock.of(record)
        return clock.grid(timed=timed)

    @cached_property
    def signals(self) -> Complexes:
        """Lines of the signals on the mean motion, shape (line, signal)."""
        mean = self.coordinates.mean(axis=0)
        return signal_spectra(self.model, self.record, mean, *self.clock)

    @cached_property
    def period_signals(self) -> Complexes:
        """Lines of the signals on the motion of each period, shape (period, line, signal)."""
        return signal_spectra(self.model, self.record, self.coordinates, *self.clock)

    @cached_property
    def period_forces(self) -> Complexes:
        """Lines of B u in each period, shape (period, line, row)."""
        return np.asarray(self.inputs @ self.model.input_matrix.T)

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
