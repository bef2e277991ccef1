"""Design and target of the equations of motion, on lines or on samples.

The signals of the model are evaluated on the line-filtered motion, and their own lines are kept:
the line filter applies to the columns of Phi as it does to the forces. Then the equations of
motion read, on line k and in row r,

    sum_b design[k, r, b] base[b] = target[k, r].

The equations hold at every sample, and a low-pass L that is applied to all columns alike leaves
them true: ``L[Phi] base = L[B u - known]``. Columns that are a derivative of a coordinate are
filtered once, exactly; others are computed from the low-passed motion, then filtered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from rotorid.answer.parts import Prediction
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Booleans, Complexes, Floats, Integers
from rotorid.data.filtered import SPILLED, FilteredRecord, told_of
from rotorid.data.lines import PeriodicClock, PhasorClock
from rotorid.data.observation import Observation
from rotorid.data.record import PeriodicRecord
from rotorid.models import Model, Motion
from rotorid.models.equations import DERIVATIVES
from rotorid.models.linear import speed_factor
from rotorid.models.text import Expression, evaluate, is_usable, symbol
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
    """The equations of motion of one record, on its lines."""

    observation: Observation
    # (first, last): periods that are used, as a slice takes them; all where it is not given
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


@frozen
class Predicted:
    """Lines of some channels of a record, measured and predicted."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    # (line, channel): in SI units; measured ones corrected for what the channel is known to do
    measured: Complexes
    predicted: Complexes
    multiplicity: Floats  # (line,)
    samples: Integers | None = None  # (line,): of a record without lines: the sample of each row

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


NOISY = 3.0
"""Deviations of its noise below which an expression has no sign: one in 400 has it by chance."""
SLOW = 0.005
"""Share of its usual size below which an expression counts as at rest: what creeps and quivers
of an axis that is held leaves more than its noise; an axis that turns is through in no time."""


@frozen
class SampledRegression:
    """The equations of motion of one record at the samples that are used."""

    observation: Observation

    @property
    def model(self) -> Model:
        """The model that the record is bound to."""
        return self.observation.model

    @property
    def record(self) -> FilteredRecord:
        """The filtered record."""
        assert self.observation.filtered is not None
        return self.observation.filtered

    @cached_property
    def stretches(self) -> list[Stretch]:
        """The stretches that hold samples in use."""
        columns, follow = sensed(self.observation)
        check_forces(self.observation)
        record, found = self.record, []
        for begin, end in zip(record.begins, record.ends, strict=True):
            first, last = np.searchsorted(record.used, (begin, end))
            if first < last:
                picked = record.used[first:last] - begin
                found.append(Stretch(self, int(begin), int(end), picked, tuple(columns), follow))
        return found

    @cached_property
    def told(self) -> Booleans:
        """Equations that count, shape (used, row): not those that hold the sign of noise."""
        rests = [self._rests(index) for index in range(len(self.model.signals))]
        holds = (self.model.coefficients[0] != 0).any(axis=2) | (self.model.coefficients[1] != 0)
        count = sum(len(stretch.picked) for stretch in self.stretches)
        out = np.zeros((count, holds.shape[1]), dtype=bool)
        for index, rest in enumerate(rests):
            if rest is not None:
                out |= rest[:, None] & holds[index]
        return ~out

    @cached_property
    def kept(self) -> Booleans:
        """Samples with an equation that counts, shape (used,)."""
        return np.asarray(self.told.any(axis=1))

    def _rests(self, index: int) -> Booleans | None:
        """Return the samples in use whose weights lie on a rest of a signal's sign, shape (used,).

        None where the signal holds no sign of the motion.
        """
        moves = self.model.moves(index)
        arguments = list(_signs_of(self.model.signals[index])) if moves else []
        if not arguments:
            return None
        found = np.zeros(sum(len(stretch.picked) for stretch in self.stretches), dtype=bool)
        for argument in arguments:
            parts = [stretch.sizes(argument) for stretch in self.stretches]
            size = np.concatenate([part[0] for part in parts])
            usual = float(np.sqrt((size**2).mean()))
            least = [max(NOISY * noise, SLOW * usual) for _, noise in parts]
            pairs = zip(self.stretches, parts, least, strict=True)
            found |= np.concatenate([s.resting(part[0] < low) for s, part, low in pairs])
        return found

    @cached_property
    def signals(self) -> Floats:
        """The filtered signals of the model, shape (sample, signal)."""
        return np.concatenate([stretch.signals() for stretch in self.stretches])[self.kept]

    @cached_property
    def inputs(self) -> Floats:
        """The filtered inputs, shape (sample, input)."""
        return np.concatenate([stretch.inputs() for stretch in self.stretches])[self.kept]

    @cached_property
    def force_rates(self) -> Floats:
        """The derivative of filtered B u, shape (sample, row); zero where no equation counts."""
        rates = np.concatenate([stretch.inputs(1) for stretch in self.stretches])[self.kept]
        return np.asarray((rates @ self.model.input_matrix.T) * self.told[self.kept])

    @cached_property
    def design(self) -> Floats:
        """Filtered Phi, shape (sample, row, base); zero where an equation does not count."""
        every = np.tensordot(self.signals, self.model.coefficients[0], axes=1)
        return np.asarray(every * self.told[self.kept][:, :, None])

    @cached_property
    def target(self) -> Floats:
        """Filtered B u less the terms without parameters, shape (sample, row), zero likewise."""
        known = self.signals @ self.model.coefficients[1]
        every = self.inputs @ self.model.input_matrix.T - known
        return np.asarray(every * self.told[self.kept])

    def residual(self, base: Floats) -> Floats:
        """Return ``Phi base + known - B u``, shape (sample, row)."""
        return np.asarray(self.design @ base - self.target)

    @property
    def left_out(self) -> str:
        """What was left out at rest, in words; empty where nothing was."""
        count = int((~self.told).any(axis=1).sum())
        if not count:
            return ""
        return (
            f"{told_of(self.record.record)}{count} of {len(self.told)} samples in use are left out "
            "of the equations with a sign "
            f"whose argument is at rest there, below {NOISY:g} deviations of its noise or "
            f"{100 * SLOW:g} % of its usual size: its sign is noise, and friction at rest is any"
        )

    def lowered(self, share: float) -> SampledRegression:
        """Return the same samples, low-passed at a share of the cut-offs."""
        assert self.observation.filtered is not None
        return SampledRegression(
            replace(self.observation, filtered=self.observation.filtered.lowered(share))
        )


@frozen
class Stretch:
    """A part of a record without samples that must not enter the filter."""

    regression: SampledRegression
    begin: int
    end: int
    picked: Integers  # (used,): its samples in use, counted from `begin`
    columns: tuple[int, ...]  # of the sensors
    follow: Floats  # (sensor, coordinate): what makes coordinates of them

    @property
    def _record(self) -> FilteredRecord:
        return self.regression.record

    def _coordinates(self, order: int, *, outer: bool) -> Floats:
        """Return a derivative of the coordinates, filtered, shape (sample, coordinate)."""
        record = self._record
        filter_ = record.outer if outer else record.inner
        samples = record.record.samples[self.begin : self.end, list(self.columns)]
        channels = tuple(record.channels[c] for c in self.columns)
        return np.asarray(filter_.apply(samples, order, channels) @ self.follow)

    def sizes(self, argument: Expression) -> tuple[Floats, float]:
        """Return the size of an expression of the motion, (sample,), and the noise of it."""
        model, record = self.regression.model, self._record
        symbols = {
            name + dots: (order, column)
            for column, name in enumerate(model.coordinates)
            for order, dots in enumerate(DERIVATIVES)
        }
        motion = self.motion
        derivatives = (motion.position, motion.velocity, motion.acceleration)
        arrays: dict[str, Floats] = {
            name: derivatives[order][:, column] for name, (order, column) in symbols.items()
        }
        arrays |= {"t": motion.time, "phi": motion.angle, "Omega": np.asarray(motion.speed)}
        samples = record.record.samples[self.begin : self.end, list(self.columns)]
        noise = [
            np.sqrt(record.inner.noise_of(samples, order) ** 2 @ self.follow**2)
            for order in range(3)
        ]
        variance = 0.0
        for name, (order, column) in symbols.items():
            if symbol(name) in argument.free_symbols:
                off = noise[order][column]
                above = evaluate(argument, {**arrays, name: arrays[name] + off})
                below = evaluate(argument, {**arrays, name: arrays[name] - off})
                variance += float((((above - below) / 2) ** 2).mean())
        size = np.broadcast_to(np.abs(evaluate(argument, arrays)), (self.end - self.begin,))
        return size, float(np.sqrt(variance))

    def resting(self, small: Booleans) -> Booleans:
        """Return the samples in use too much of whose weight lies on a rest, shape (used,).

        A rest lasts so long that a filtered sample lies within; one that merely turns does not.
        """
        outer = self._record.outer
        within = outer.apply(small.astype(float)[:, None])[:, 0] > 0.5
        if not within.any():
            return np.zeros(len(self.picked), dtype=bool)
        rest = small & (outer.apply(within.astype(float)[:, None])[:, 0] > SPILLED)
        spilled = outer.apply(rest.astype(float)[:, None])[:, 0] > SPILLED
        return np.asarray((spilled | rest)[self.picked])

    def inputs(self, order: int = 0) -> Floats:
        """Return the filtered inputs or their derivative, shape (used, input)."""
        seen, record = self.regression.observation, self._record
        if not seen.inputs:
            return np.zeros((len(self.picked), 0))
        samples = record.record.samples[self.begin : self.end, list(seen.input_columns)]
        return np.asarray(record.outer.apply(samples, order, seen.inputs)[self.picked])

    @cached_property
    def motion(self) -> Motion:
        """Return the low-passed motion, at which the terms that are not linear are computed."""
        record, part = self._record.record, slice(self.begin, self.end)
        time = record.start + np.arange(self.begin, self.end) / record.sample_rate
        angle, speed = record.rotor_angle()[part], np.asarray(record.speed)
        if record.angle is not None and len(angle) > 1:
            speed = np.gradient(angle, 1 / record.sample_rate)
        q, velocity, acceleration = (self._coordinates(order, outer=False) for order in range(3))
        return Motion(q, velocity, acceleration, time, angle, speed)

    def signals(self) -> Floats:
        """Return the filtered signals of the model, shape (used, signal)."""
        model, record = self.regression.model, self._record
        found = np.empty((len(self.picked), len(model.signals)))
        exact: dict[int, Floats] = {}
        for index, factor in enumerate(model.motion_factors):
            turning = factor is not None and symbol("Omega") in factor[2].free_symbols
            if factor is not None and not (turning and record.record.angle is not None):
                column, order, scale = factor
                if order not in exact:
                    exact[order] = self._coordinates(order, outer=True)[self.picked]
                gain = speed_factor(scale, record.record.speed)
                found[:, index] = gain * exact[order][:, column]
                continue
            found[:, index] = self._filtered_signal(index)
        return found

    def _filtered_signal(self, index: int) -> Floats:
        """Return a signal that is computed sample by sample, then filtered, shape (used,)."""
        model = self.regression.model
        value = model.signal_value(index, self.motion)
        if not is_usable(value):
            raise InputError(
                f"{model.signals[index]} without a finite value on this record",
                "a division by something other than zero, a root of something positive",
                "rewrite the term, or check the channels in it",
                file=self._record.source,
            )
        whole = np.broadcast_to(value, (self.end - self.begin,))
        return np.asarray(self._record.outer.apply(whole[:, None])[self.picked, 0])


def _signs_of(value: Expression) -> Iterator[Expression]:
    if value.kind == "sign":
        yield value.parts[0]
    for part in value.parts:
        if isinstance(part, Expression):
            yield from _signs_of(part)


def predicted(regression: SampledRegression, base: Floats) -> Predicted:
    """Predict the filtered inputs of a record from base parameters."""
    model, measured = regression.model, regression.inputs
    driven = model.input_matrix.any(axis=1)
    measured = measured * regression.told[regression.kept][:, driven].all(axis=1, keepdims=True)
    wrong = regression.residual(base)[:, driven] @ np.linalg.pinv(model.input_matrix[driven]).T
    units = tuple(model.units[name] for name in model.inputs)
    both = (measured.astype(np.complex128), (measured + wrong).astype(np.complex128))
    samples = regression.record.used[regression.kept]
    return Predicted(model.inputs, units, *both, np.ones(len(measured)), samples)
