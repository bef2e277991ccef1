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

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotorid.answer.estimate import Prediction
from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Booleans, Complexes, Floats, Integers
from rotorid.data.filtered import SPILLED, FilteredRecord, told_of
from rotorid.data.lines import PhasorClock, SampledClock
from rotorid.data.observation import Observation
from rotorid.data.record import PeriodicRecord
from rotorid.models import Model, Motion
from rotorid.models.equations import DERIVATIVES
from rotorid.models.expressions import Expression, evaluate, is_usable, symbol
from rotorid.models.linear_form import speed_factor
from rotorid.signals.spectrum import differentiate, line_spectra, synthesize

ROUNDING = 1e-12


def _finite_signal(model: Model, index: int, motion: Motion, source: str) -> Floats:
    value = model.signal_value(index, motion)
    if not is_usable(value):
        raise InputError(
            f"{model.signals[index]} without a finite value on this record",
            "a division by something other than zero, a root of something positive",
            "rewrite the term, or check the channels in it",
            file=source,
        )
    return value


def driven_rows(model: Model) -> list[int]:
    """Return the rows with a measured input or a term without parameters."""
    forced = model.input_matrix.any(axis=1) | model.coefficients[1].any(axis=0)
    return [int(row) for row in np.flatnonzero(forced)]


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
    """Return |predicted - measured| / |measured| of each channel; None for one that is zero."""
    sums: dict[str, Floats] = {}
    for record in records:
        for name, *powers in zip(record.names, record.wrong, record.size, strict=True):
            sums[name] = sums.get(name, np.zeros(2)) + powers
    return {
        name: Prediction(float(np.sqrt(wrong / size))) if size > 0 else None
        for name, (wrong, size) in sums.items()
    }


def lay_to_inputs(left: NDArray[Any], matrix: NDArray[Any]) -> Complexes:
    """Solve ``B u = left`` for the inputs, (line, input); rows without input have no say."""
    driven = np.abs(matrix).any(axis=(0, 2))
    return np.asarray((np.linalg.pinv(matrix[:, driven]) @ left[:, driven, None])[..., 0])


@frozen
class Equations(ABC):
    observation: Observation

    @property
    def model(self) -> Model:
        return self.observation.model

    @cached_property
    def sensed(self) -> tuple[list[int], Floats]:
        """The columns of the sensors, and what makes coordinates of them, (sensor, coordinate)."""
        seen = self.observation
        if seen.hidden or seen.indirect:
            derived = [s.channel.name for s in seen.indirect]
            found = f"no sensor of {', '.join(seen.hidden)}"
            if not seen.hidden:
                found = f"{derived[0]}, which reads a derivative or holds parameters"
            expected = "every coordinate measured, by sensors of positions"
            cure = "measure it, or use ml, which needs no such sensor"
            raise InputError(found, expected, cure, file=seen.lines.source)
        self.check_forces()
        return [sensor.column for sensor in seen.direct], np.asarray(np.linalg.pinv(seen.reads).T)

    def check_forces(self) -> None:
        for channel in self.observation.inputs:
            if channel.drive is not None:
                found = f"a current in the channel of {channel.name}"
                raise InputError(found, "a force", "use ml", file=self.observation.lines.source)

    @property
    @abstractmethod
    def signals(self) -> Any:
        """The signals of the model, shape (line or sample, signal)."""

    @property
    @abstractmethod
    def forces(self) -> Any:
        """B u, shape (line or sample, row)."""

    def counting(self, rows: Any) -> Any:
        """Return rows, (line or sample, row, ...), with zeros where no equation counts."""
        return rows

    @cached_property
    def design(self) -> Any:
        """Phi, shape (line or sample, row, base)."""
        return self.counting(np.tensordot(self.signals, self.model.coefficients[0], axes=1))

    @cached_property
    def target(self) -> Any:
        return self.counting(self.forces - self.signals @ self.model.coefficients[1])

    def residual(self, base: Floats) -> Any:
        """Return ``Phi base + known - B u``, shape (line or sample, row)."""
        return self.design @ base - self.target

    @abstractmethod
    def predicted(self, base: Floats) -> Predicted:
        """Predict the inputs from base parameters; any model."""

    def _predicted(self, base: Floats, measured: Any, *places: Any) -> Predicted:
        model = self.model
        wrong = lay_to_inputs(self.residual(base), model.input_matrix[None])
        units = tuple(model.units[name] for name in model.inputs)
        both = (measured + 0j, measured + wrong + 0j)
        return Predicted(model.inputs, units, *both, *places)


@frozen
class Regression(Equations):
    half: int = 0  # of the periods, which are used: the first, 1, or the last, 2; 0: all

    @cached_property
    def record(self) -> PeriodicRecord:
        lines = self.observation.lines
        if self.observation.periodic is not None:
            return self.observation.periodic
        if isinstance(lines.clock, PhasorClock):
            found = "a table, which has no samples"
            cure = "use ml, for a model that is linear in its coordinates"
        else:
            found = "a record without periods"
            cure = (
                "give its fundamental, or, without one, the cut-off of a low-pass in place of the "
                'band (cutoff = "100 Hz", rid.filtered); for a linear model, use ml'
            )
        raise InputError(found, "whole periods for this method", cure, file=lines.source)

    def _lines(self, columns: Sequence[int]) -> Complexes:
        """Return the lines of columns in the periods that are used, (period, line, column)."""
        middle = self.record.periods // 2
        used = (slice(None), slice(middle), slice(middle, None))[self.half]
        return self.record.spectra[used][..., columns]

    @cached_property
    def coordinates(self) -> Complexes:
        """Lines of the coordinates, (period, line, coordinate), solved for from the sensors'."""
        columns, follow = self.sensed
        return np.asarray(self._lines(columns) @ follow)

    @cached_property
    def inputs(self) -> Complexes:
        self.check_forces()
        return self._lines(list(self.observation.input_columns))

    def _signals(self, coordinates: Complexes) -> Complexes:
        """Return the lines of the model's signals on the motion that has these lines."""
        model, record = self.model, self.record
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
        still = (*coordinates.shape[:-2], record.samples, len(model.coordinates))
        waves = [np.zeros(still)] * 3
        if any(model.moves(index) for index in others):
            waves = [synthesize(d, record.harmonics, record.samples) for d in derivatives]
        timed = any(symbol("t") in signal.free_symbols for signal in model.signals)
        time, angle = SampledClock.of(record).grid(timed=timed)
        motion = Motion(waves[0], waves[1], waves[2], time, angle, record.speed)
        for index in others:
            lines[..., index] = self._sampled_lines(index, motion)
        return lines

    def _sampled_lines(self, index: int, motion: Motion) -> Complexes:
        record, axes = self.record, motion.position.ndim - 1
        value = _finite_signal(self.model, index, motion, record.source)
        mean = value.mean(axis=0) if value.ndim > axes else value
        whole = np.broadcast_to(mean, np.broadcast_shapes(mean.shape, (record.samples,)))
        lines = line_spectra(whole[..., None], record.harmonics)[..., 0]
        # What rounding leaves on a line is no signal: an unbalance whose line is not kept.
        return np.where(np.abs(lines) > ROUNDING * np.abs(whole).max(), lines, 0)

    @cached_property
    def signals(self) -> Complexes:
        """Lines of the signals on the mean motion, shape (line, signal)."""
        return self._signals(self.coordinates.mean(axis=0))

    @cached_property
    def period_signals(self) -> Complexes:
        """Lines of the signals on the motion of each period, shape (period, line, signal)."""
        return self._signals(self.coordinates)

    @cached_property
    def period_forces(self) -> Complexes:
        """Lines of B u in each period, shape (period, line, row)."""
        return np.asarray(self.inputs @ self.model.input_matrix.T)

    @property
    def forces(self) -> Complexes:
        return np.asarray(self.period_forces.mean(axis=0))

    def period_residual(self, base: Floats) -> Complexes:
        coefficients, known = self.model.coefficients
        return np.asarray(self.period_signals @ (coefficients @ base + known) - self.period_forces)

    def predicted(self, base: Floats) -> Predicted:
        return self._predicted(base, self.inputs.mean(axis=0), self.record.multiplicity)


NOISY = 3.0
"""Deviations of its noise below which an expression has no sign: one in 400 has it by chance."""
SLOW = 0.005
"""Share of its usual size below which an expression counts as at rest: what creeps and quivers
of an axis that is held leaves more than its noise; an axis that turns is through in no time."""


@frozen
class SampledRegression(Equations):
    @property
    def record(self) -> FilteredRecord:
        assert self.observation.filtered is not None
        return self.observation.filtered

    @cached_property
    def stretches(self) -> list[Stretch]:
        record, found = self.record, []
        for begin, end in zip(record.begins, record.ends, strict=True):
            first, last = np.searchsorted(record.used, (begin, end))
            if first < last:
                picked = record.used[first:last] - begin
                found.append(Stretch(self, slice(int(begin), int(end)), picked))
        return found

    def _joined(self, parts: Iterable[NDArray[Any]]) -> NDArray[Any]:
        """Return parts of stretches as one, without samples of which no equation counts."""
        return np.concatenate(list(parts))[self.kept]

    @cached_property
    def told(self) -> Booleans:
        """Equations that count, shape (used, row): not those that hold the sign of noise."""
        holds = (self.model.coefficients[0] != 0).any(axis=2) | (self.model.coefficients[1] != 0)
        count = sum(len(stretch.picked) for stretch in self.stretches)
        out = np.zeros((count, holds.shape[1]), dtype=bool)
        for index, held in enumerate(holds):
            if self.model.moves(index):
                for argument in _signs_of(self.model.signals[index]):
                    out |= self._resting(argument)[:, None] & held
        return ~out

    @cached_property
    def kept(self) -> Booleans:
        """Samples with an equation that counts, shape (used,)."""
        return np.asarray(self.told.any(axis=1))

    def _resting(self, argument: Expression) -> Booleans:
        """Return the samples in use whose weights lie on a rest of a sign's argument, (used,)."""
        parts = [(stretch, *stretch.sizes(argument)) for stretch in self.stretches]
        size = np.concatenate([size for _, size, _ in parts])
        least = SLOW * float(np.sqrt((size**2).mean()))
        return np.concatenate(
            [stretch.resting(size < max(NOISY * noise, least)) for stretch, size, noise in parts]
        )

    def counting(self, rows: Any) -> Any:
        told = self.told[self.kept]
        return rows * told.reshape(told.shape + (1,) * (rows.ndim - 2))

    @cached_property
    def signals(self) -> Floats:
        return self._joined(stretch.signals() for stretch in self.stretches)

    @cached_property
    def inputs(self) -> Floats:
        return self._joined(stretch.inputs() for stretch in self.stretches)

    @property
    def forces(self) -> Floats:
        return np.asarray(self.inputs @ self.model.input_matrix.T)

    @cached_property
    def force_rates(self) -> Floats:
        """The derivative of filtered B u, shape (sample, row); zero where no equation counts."""
        rates = self._joined(stretch.inputs(1) for stretch in self.stretches)
        return np.asarray(self.counting(rates @ self.model.input_matrix.T))

    def predicted(self, base: Floats) -> Predicted:
        driven = self.model.input_matrix.any(axis=1)
        counts = self.told[self.kept][:, driven].all(axis=1, keepdims=True)
        ones, samples = np.ones(len(self.inputs)), self.record.used[self.kept]
        return self._predicted(base, self.inputs * counts, ones, samples)

    @property
    def left_out(self) -> str:
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
        lower = self.record.lowered(share)
        return SampledRegression(replace(self.observation, filtered=lower))


@frozen
class Stretch:
    """A part of a record without samples that must not enter the filter."""

    regression: SampledRegression
    part: slice  # of the samples of the record
    picked: Integers  # (used,): its samples in use, counted from the first of the part

    @property
    def _record(self) -> FilteredRecord:
        return self.regression.record

    def _coordinates(self, order: int, *, outer: bool) -> Floats:
        record, (columns, follow) = self._record, self.regression.sensed
        filter_ = record.outer if outer else record.inner
        channels = tuple(record.channels[c] for c in columns)
        samples = record.record.samples[self.part, columns]
        return np.asarray(filter_.apply(samples, order, channels) @ follow)

    def sizes(self, argument: Expression) -> tuple[Floats, float]:
        """Return the size of an expression of the motion, (sample,), and the noise of it."""
        model, motion = self.regression.model, self.motion
        columns, follow = self.regression.sensed
        samples = self._record.record.samples[self.part, columns]
        arrays, variance = model.arrays(motion), 0.0
        for order, dots in enumerate(DERIVATIVES):
            noise = np.sqrt(self._record.inner.noise_of(samples, order) ** 2 @ follow**2)
            for name, off in zip(model.coordinates, noise, strict=True):
                if symbol(moving := name + dots) in argument.free_symbols:
                    above = evaluate(argument, {**arrays, moving: arrays[moving] + off})
                    below = evaluate(argument, {**arrays, moving: arrays[moving] - off})
                    variance += float((((above - below) / 2) ** 2).mean())
        size = np.broadcast_to(np.abs(evaluate(argument, arrays)), motion.time.shape)
        return size, float(np.sqrt(variance))

    def resting(self, small: Booleans) -> Booleans:
        """Return the samples in use too much of whose weight lies on a rest, shape (used,).

        A rest lasts so long that a filtered sample lies within; one that merely turns does not.
        """

        def weight(on: Booleans) -> Floats:
            return self._record.outer.apply(on.astype(float)[:, None])[:, 0]

        within = weight(small) > 0.5
        if not within.any():
            return np.zeros(len(self.picked), dtype=bool)
        rest = small & (weight(within) > SPILLED)
        return np.asarray(((weight(rest) > SPILLED) | rest)[self.picked])

    def inputs(self, order: int = 0) -> Floats:
        seen, record = self.regression.observation, self._record
        if not seen.inputs:
            return np.zeros((len(self.picked), 0))
        samples = record.record.samples[self.part, list(seen.input_columns)]
        return np.asarray(record.outer.apply(samples, order, seen.inputs)[self.picked])

    @cached_property
    def motion(self) -> Motion:
        """Return the low-passed motion, at which the terms that are not linear are computed."""
        record = self._record.record
        time = record.start + np.arange(self.part.start, self.part.stop) / record.sample_rate
        angle, speed = record.rotor_angle()[self.part], np.asarray(record.speed)
        if record.angle is not None and len(angle) > 1:
            speed = np.gradient(angle, 1 / record.sample_rate)
        q, velocity, acceleration = (self._coordinates(order, outer=False) for order in range(3))
        return Motion(q, velocity, acceleration, time, angle, speed)

    def signals(self) -> Floats:
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
            value = _finite_signal(model, index, self.motion, record.source)
            whole = np.broadcast_to(value, self.motion.time.shape)
            found[:, index] = record.outer.apply(whole[:, None])[self.picked, 0]
        return found


def _signs_of(value: Expression) -> Iterator[Expression]:
    if value.kind == "sign":
        yield value.parts[0]
    for part in value.parts:
        if isinstance(part, Expression):
            yield from _signs_of(part)
