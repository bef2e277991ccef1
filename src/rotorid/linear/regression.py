"""Design and target of the equations of motion, on lines or on samples.

``sum_b design[k, r, b] base[b] = target[k, r]`` on line k in row r, or at sample k: what filters
the forces filters the columns of Phi as well (docs/theory.md, sections 1 and 6).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotorid.answer.parts import Prediction
from rotorid.core.errors import InputError
from rotorid.core.values import Booleans, Complexes, Floats, Integers, frozen
from rotorid.data.filtered import SPILLED, FilteredRecord, LowPass, told_of
from rotorid.data.lines import PhasorClock, SampledClock
from rotorid.data.observation import Observation
from rotorid.data.record import PeriodicRecord
from rotorid.models import Model, Motion
from rotorid.models.equations import DERIVATIVES
from rotorid.models.expressions import Expression, evaluate, is_usable, symbol
from rotorid.models.linear_form import speed_factor
from rotorid.signals.checks.rotation import rotation_warnings
from rotorid.signals.spectrum import differentiate, line_spectra, synthesize

ROUNDING = 1e-12


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


def known_part(row: int) -> str:
    return f"known part of row {row + 1}"


@frozen
class Equations(ABC):
    observation: Observation

    @property
    def model(self) -> Model:
        return self.observation.model

    @property
    def warnings(self) -> tuple[str, ...]:
        return self.observation.lines.warnings

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
    def _known(self) -> Mapping[Expression, Floats]:
        """Parts of signals that are not what the motion makes of them."""
        return {}

    def _value(self, index: int, motion: Motion) -> Floats:
        value = self.model.signal_value(index, motion, self._known)
        if not is_usable(value):
            told = f"{self.model.signals[index]} without a finite value on this record"
            expected = "a division by something other than zero, a root of something positive"
            cure = "rewrite the term, or check the channels in it"
            raise InputError(told, expected, cure, file=self.observation.lines.source)
        return value

    @property
    @abstractmethod
    def signals(self) -> Any:
        """The signals of the model, shape (line or sample, signal)."""

    @property
    @abstractmethod
    def inputs(self) -> Any:
        """Shape (line or sample, input)."""

    def counting(self, rows: Any) -> Any:
        """Return rows, (line or sample, row, ...), with zeros where no equation counts."""
        return rows

    @cached_property
    def design(self) -> Any:
        """Phi, shape (line or sample, row, base)."""
        return self.counting(np.tensordot(self.signals, self.model.coefficients[0], axes=1))

    @cached_property
    def target(self) -> Any:
        """``B u - known``, shape (line or sample, row)."""
        known = self.signals @ self.model.coefficients[1]
        return self.counting(self.inputs @ self.model.input_matrix.T - known)

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
        beside = self.record.rotation
        recorded = self.record.spectra if beside is None else beside.recorded
        return recorded[used][..., columns]

    @property
    def warnings(self) -> tuple[str, ...]:
        leaks = () if self.record.rotation is None else rotation_warnings(self.record)
        return (*super().warnings, *leaks)

    @cached_property
    def coordinates(self) -> Complexes:
        """Lines of the coordinates, (period, line, coordinate), solved for from the sensors'."""
        return np.asarray(self._lines(self.sensed[0]) @ self.sensed[1])

    @cached_property
    def period_inputs(self) -> Complexes:
        self.check_forces()
        return self._lines(list(self.observation.input_columns))

    @property
    def inputs(self) -> Complexes:
        return np.asarray(self.period_inputs.mean(axis=0))

    def _signals(self, coordinates: Complexes) -> Complexes:
        """Return the lines of the model's signals on the motion that has these lines."""
        model, record = self.model, self.record
        derivatives = [
            differentiate(coordinates, record.harmonics, record.samples, record.sample_rate, order)
            for order in range(3)
        ]
        waves = [np.zeros((*coordinates.shape[:-2], record.samples, len(model.coordinates)))] * 3
        if model.nonlinear:
            waves = [synthesize(d, record.harmonics, record.samples) for d in derivatives]
        timed = any(symbol("t") in signal.free_symbols for signal in model.signals)
        time, angle = SampledClock.of(record).grid(timed=timed)
        motion = Motion(waves[0], waves[1], waves[2], time, angle, record.speed)
        lines = np.empty((*coordinates.shape[:-1], len(model.signals)), dtype=np.complex128)
        for index, factor in enumerate(model.motion_factors):
            if factor is None:
                value = self._value(index, motion)
                mean = value.mean(axis=0) if value.ndim >= coordinates.ndim else value
                whole = np.broadcast_to(mean, np.broadcast_shapes(mean.shape, (record.samples,)))
                own = line_spectra(whole[..., None], record.harmonics)[..., 0]
                # What rounding leaves on a line is no signal: an unbalance whose line is not kept.
                told = np.abs(own) > ROUNDING * np.abs(value).max()
                lines[..., index] = np.where(told, own, 0)
            else:
                column, order, scale = factor
                gain = speed_factor(scale, record.speed)
                lines[..., index] = gain * derivatives[order][..., column]
        return lines

    @cached_property
    def signals(self) -> Complexes:
        """Lines of the signals on the mean motion, shape (line, signal)."""
        return self._signals(self.coordinates.mean(axis=0))

    @cached_property
    def period_signals(self) -> Complexes:
        """Lines of the signals on the motion of each period, shape (period, line, signal)."""
        return self._signals(self.coordinates)

    def period_residual(self, base: Floats) -> Complexes:
        coefficients, known = self.model.coefficients
        forces = self.period_inputs @ self.model.input_matrix.T
        return np.asarray(self.period_signals @ (coefficients @ base + known) - forces)

    def predicted(self, base: Floats) -> Predicted:
        return self._predicted(base, self.inputs, self.record.multiplicity)


NOISY = 3.0
"""Deviations of its noise below which an expression has no sign: one in 400 has it by chance."""
SHARPER = (5, 1)
"""Cut-offs through which terms that are not linear may see the motion. A low-pass shifts the zero
of what bends there, as a velocity with friction does, and makes less of a cube; noise is smaller
through a narrow one."""
WIDEST = 0.45
"""Of the sample rate: the highest of them."""
SLOW = 0.005
"""Share of its usual size below which an expression counts as at rest: what creeps and quivers
of an axis that is held leaves more than its noise; an axis that turns is through in no time."""


FURTHER: dict[str, Callable[..., Floats]] = {
    "{q}^3": lambda q, v, a, turn: q**3,
    "abs({q}')": lambda q, v, a, turn: np.abs(v),
    "{q}'*abs({q}')": lambda q, v, a, turn: v * np.abs(v),
    "tanh({q}'/{slow})": lambda q, v, a, turn: turn,
    "{q}*{q}''": lambda q, v, a, turn: q * a,
    "abs({q}'')*tanh({q}'/{slow})": lambda q, v, a, turn: np.abs(a) * turn,
    "{q}''*(1 - tanh({q}'/{slow})^2)": lambda q, v, a, turn: a * (1 - turn**2),
}
"""Forces that equations may lack beside linear ones, as a model's text has them. What keeps no such
sign with motion scatters between blocks (docs/theory.md, section 6)."""
ELASTIC = 4 * "'"
"""The derivative that what is elastic, or filters, makes of slow motion, beside a larger mass."""
ADD = "add it with a parameter"
BENDS = "something is elastic, or filters: give it coordinates, or its channel a delay"
SLOW_PART = 1 / 3
"""Share of the cut-off up to which it is looked for: its noise grows with the 4.5th power."""
ALONG = {"sin({k}*{q})": np.sin, "cos({k}*{q})": np.cos}
"""The same of a force along the stroke: cogging, a guide that is tight somewhere."""
WAVES = 3
"""Waves of a force along the stroke, the longest as long as it, that are looked for: shorter
ones change their sign often enough to scatter between blocks."""
ENOUGH = 1000
"""Samples over which the share of noise in terms that are not linear is averaged."""
SLOWLY = 0.1
"""Share of its usual size below which a velocity is one at which friction is not Coulomb's."""


@frozen
class SampledRegression(Equations):
    """On the samples in use; arrays over samples hold those of all stretches, one after another."""

    # cut-offs of the low-pass through which terms that are not linear see the motion
    sharper: float = 1
    between: bool = False  # whether signs turn between samples, or are those of the samples

    def ways(self) -> Iterator[SampledRegression]:
        """Yield the ways to see a motion in terms that are not linear."""
        if not self.model.nonlinear:
            yield self
            return
        for times, between in product(SHARPER, (True, False) if self.signs else (False,)):
            yield replace(self, sharper=times, between=between)

    def variance(self, base: Floats) -> Floats:
        """Return the variance of what is left of each row, (row,)."""
        told = np.maximum(self.told.sum(axis=0), 1)
        variance = (self.residual(base) ** 2).sum(axis=0) / told
        floor = 1e-18 * (self.target**2).mean(axis=0).max()
        return np.asarray(np.maximum(variance, floor if floor > 0 else 1.0))

    def misfit(self, base: Floats) -> float:
        """Return what all equations leave, ``sum n log(variance)``."""
        return len(self.told) * float(np.log(self.variance(base)).sum())

    @property
    def record(self) -> FilteredRecord:
        assert self.observation.filtered is not None
        return self.observation.filtered

    @cached_property
    def _stretches(self) -> list[Integers]:
        """The samples of each stretch in which some are in use: the filter works within."""
        found = map(np.arange, self.record.begins, self.record.ends)
        return [part for part in found if np.isin(self.record.used, part).any()]

    @cached_property
    def _samples(self) -> Integers:
        return np.concatenate(self._stretches)

    @cached_property
    def _picked(self) -> Integers:
        """The samples in use, counted over all stretches, (used,)."""
        return np.searchsorted(self._samples, self.record.used)

    def _each(self, of: Callable[[NDArray[Any]], NDArray[Any]], rows: NDArray[Any]) -> NDArray[Any]:
        """Return what something makes of each stretch: rows, or one value for all of its rows."""
        parts = np.split(rows, np.cumsum([len(part) for part in self._stretches])[:-1])
        return np.concatenate([np.broadcast_to(of(part), part.shape) for part in parts])

    def _weight(self, on: Booleans) -> Floats:
        """Return the share of each filtered sample's weight that lies on some samples."""
        return self._each(self.record.outer.apply, on.astype(float)[:, None])[:, 0]

    @cached_property
    def _read(self) -> Floats:
        return self.record.record.samples[self._samples][:, self.sensed[0]]

    def _coordinates(self, low_pass: LowPass, order: int) -> Floats:
        channels = tuple(self.record.channels[c] for c in self.sensed[0])
        rows = self._each(lambda part: low_pass.apply(part, order, channels), self._read)
        return np.asarray(rows @ self.sensed[1])

    def _noise(self, low_pass: LowPass, order: int) -> Floats:
        noise = self._each(partial(low_pass.noise_of, order=order), self._read)
        return np.asarray(np.sqrt(noise**2 @ self.sensed[1] ** 2))

    @cached_property
    def _motion(self) -> Motion:
        """The low-passed motion, at which the terms that are not linear are computed."""
        return self._through(LowPass(self.record.record.sample_rate, (self.highest,)))

    @property
    def highest(self) -> float:
        """Hz; the cut-off of the low-pass through which terms that are not linear see it."""
        widest = min(self.sharper * self.record.cutoff, WIDEST * self.record.record.sample_rate)
        return max(widest, self.record.cutoff)

    def _through(self, low_pass: LowPass) -> Motion:
        record = self.record.record
        time = record.start + self._samples / record.sample_rate
        angle, speed = record.rotor_angle()[self._samples], np.asarray(record.speed)
        if record.angle is not None:
            speed = self._each(lambda part: np.gradient(part, 1 / record.sample_rate), angle)
        q, velocity, acceleration = (self._coordinates(low_pass, k) for k in range(3))
        return Motion(q, velocity, acceleration, time, angle, speed)

    @cached_property
    def _known(self) -> Mapping[Expression, Floats]:
        """The signs, turning between samples, if they do."""
        arrays, signs = self.model.arrays(self._motion), self.signs if self.between else ()
        return {s: self._each(_mean_sign, evaluate(s.parts[0], arrays)) for s in signs}

    @cached_property
    def signs(self) -> tuple[Expression, ...]:
        """The signs of what moves in the signals."""
        moving = (s for index, s in enumerate(self.model.signals) if self.model.moves(index))
        return tuple(dict.fromkeys(sign for signal in moving for sign in _signs_of(signal)))

    @cached_property
    def told(self) -> Booleans:
        """Equations that count, shape (used, row): not those that hold the sign of noise."""
        holds = (self.model.coefficients[0] != 0).any(axis=2) | (self.model.coefficients[1] != 0)
        out = np.zeros((len(self._picked), holds.shape[1]), dtype=bool)
        for index, held in enumerate(holds):
            if self.model.moves(index):
                for sign in _signs_of(self.model.signals[index]):
                    out |= self._resting(sign.parts[0])[:, None] & held
        return ~out

    @cached_property
    def kept(self) -> Booleans:
        """Samples with an equation that counts, shape (used,)."""
        found = np.asarray(self.told.any(axis=1))
        if not found.any():
            signs = ", ".join(map(str, self.signs))
            told = f"no sample in use at which the argument of {signs} is more than its noise"
            cure = "check the column and its unit, or record a motion that is larger"
            raise InputError(told, "motion", cure, file=self.observation.lines.source)
        return found

    def _resting(self, argument: Expression) -> Booleans:
        """Return the samples in use too much of whose weight lies on a rest of a sign's argument.

        A rest lasts so long that a filtered sample lies within; one that merely turns does not.
        """
        inner = self.record.inner
        arrays = self.model.arrays(self._through(inner))
        size, variance = np.abs(evaluate(argument, arrays)), np.zeros(len(self._samples))
        for order, dots in enumerate(DERIVATIVES):
            offs = self._noise(inner, order)
            for name, off in zip(self.model.coordinates, offs.T, strict=True):
                if symbol(moving := name + dots) in argument.free_symbols:
                    above, below = (
                        evaluate(argument, {**arrays, moving: arrays[moving] + by})
                        for by in (off, -off)
                    )
                    variance += self._each(lambda part: (part**2).mean(), (above - below) / 2)
        least = SLOW * np.sqrt((size**2).mean())
        small = size < np.maximum(NOISY * np.sqrt(variance), least)
        rest = small & (self._weight(self._weight(small) > 0.5) > SPILLED)
        return np.asarray(((self._weight(rest) > SPILLED) | rest)[self._picked])

    def counting(self, rows: Any) -> Any:
        told = self.told[self.kept]
        return rows * told.reshape(told.shape + (1,) * (rows.ndim - 2))

    @cached_property
    def signals(self) -> Floats:
        model, record, used = self.model, self.record.record, self._picked[self.kept]
        low_pass, found = self.record.outer, np.empty((len(used), len(self.model.signals)))
        exact = cache(partial(self._coordinates, low_pass))
        for index, factor in enumerate(model.motion_factors):
            turning = factor is not None and symbol("Omega") in factor[2].free_symbols
            if factor is None or (turning and record.angle is not None):
                value = self._value(index, self._motion)
                whole = np.broadcast_to(value, self._motion.time.shape)
                found[:, index] = self._each(low_pass.apply, whole[:, None])[used, 0]
            else:
                column, order, scale = factor
                found[:, index] = speed_factor(scale, record.speed) * exact(order)[used, column]
        return found

    def _inputs(self, order: int) -> Floats:
        seen, used, low_pass = self.observation, self._picked[self.kept], self.record.outer
        if not seen.inputs:
            return np.zeros((len(used), 0))
        samples = self.record.record.samples[self._samples][:, list(seen.input_columns)]
        return self._each(lambda part: low_pass.apply(part, order, seen.inputs), samples)[used]

    @cached_property
    def inputs(self) -> Floats:
        return self._inputs(0)

    def predicted(self, base: Floats) -> Predicted:
        driven = self.model.input_matrix.any(axis=1)
        counts = self.told[self.kept][:, driven].all(axis=1, keepdims=True)
        ones, samples = np.ones(len(self.inputs)), self.record.used[self.kept]
        if driven.any():
            return self._predicted(base, self.inputs * counts, ones, samples)
        # Of what swings freely the known terms are what the others have to balance.
        rows = np.flatnonzero((self.model.coefficients[1] != 0).any(axis=0))
        target, left = self.target[:, rows] + 0j, self.residual(base)[:, rows]
        names = tuple(map(known_part, rows.tolist()))
        return Predicted(names, ("",) * len(rows), target, target + left, ones, samples)

    @cached_property
    def _slow(self) -> LowPass:
        outer = self.record.outer
        return replace(outer, cutoffs=(*outer.cutoffs, SLOW_PART * self.record.cutoff))

    @cached_property
    def _covariance(self) -> Floats:
        """Of what noise of the motion leaves on derivatives 0, 1, 2 and the slow part of the 4th.

        Shape (order, coordinate, order, coordinate). Of derivatives k and l of one quantity it is
        ``cos((k - l) pi / 2)`` times the variance of the one of order (k + l) / 2.
        """
        orders, to, outer = (0, 1, 2, 4), self.sensed[1], self.record.outer
        found = np.zeros((4, to.shape[1]) * 2)
        for (a, one), (b, other) in product(enumerate(orders), repeat=2):
            if (one + other) % 2 == 0 and one + other < 8:
                beside = self._slow if 4 in (one, other) else None
                of = partial(outer.noise_of, order=(one + other) // 2, beside=beside)
                variance = (self._each(of, self._read) ** 2).mean(axis=0)
                found[a, :, b] = (-1) ** ((one - other) // 2) * (to.T * variance) @ to
        return found

    @cached_property
    def _slopes(self) -> Floats:
        """How the signals answer to the motion, (signal, sample, order x coordinate).

        At some samples; signs have no slope of any size.
        """
        model, covariance = self.model, self._covariance
        std = np.sqrt([np.diag(covariance[k, :, k]) for k in range(3)]).reshape(-1)
        some = self._picked[self.kept][:: max(1, len(self.kept) // ENOUGH)]
        arrays = {
            name: values if values.ndim == 0 else values[some]
            for name, values in model.arrays(self._motion).items()
        }
        turning = {sign: evaluate(sign, arrays) for sign in self.signs}
        slopes = np.zeros((len(model.signals), len(some), len(std)))
        moved = [name + dots for dots in DERIVATIVES for name in model.coordinates]
        for index, factor in enumerate(model.motion_factors):
            if factor is not None:
                column, order, scale = factor
                at = order * len(model.coordinates) + column
                slopes[index, :, at] = speed_factor(scale, self.record.record.speed)
            elif model.moves(index):
                signal = model.signals[index]
                for at, (name, by) in enumerate(zip(moved, std, strict=True)):
                    if by and symbol(name) in signal.free_symbols:
                        above, below = (
                            evaluate(signal, {**arrays, name: arrays[name] + off}, turning)
                            for off in (by, -by)
                        )
                        slopes[index, :, at] = (above - below) / (2 * by)
        return slopes

    @cached_property
    def noise(self) -> Floats:
        """What noise of the motion leaves on the signals, to first order: means of products.

        Shape (signal, signal).
        """
        slopes, size = self._slopes, self._slopes.shape[2]
        own = self._covariance[:3, :, :3].reshape(size, size)
        products = np.tensordot(slopes @ own, slopes, ((1, 2), (1, 2)))
        return np.asarray(products / slopes.shape[1])

    @cached_property
    def shared(self) -> Floats:
        """The same of derivatives and signals, (order of `_covariance`, coordinate, signal)."""
        with_them = self._covariance[:, :, :3].reshape(4, len(self.model.coordinates), -1)
        return np.asarray(with_them @ self._slopes.mean(axis=1).T)

    @cached_property
    def travel(self) -> Floats:
        """The usual velocity of each coordinate, and its stroke, (2, coordinate)."""
        found = np.sqrt((self._motion.velocity**2).mean(axis=0)), np.ptp(self._motion.position, 0)
        return np.array([np.where(each > 0, each, 1.0) for each in found])

    def further(
        self, travel: Floats, whole: Floats
    ) -> tuple[list[tuple[str, str]], Floats, Floats]:
        """Return what equations may lack and its cure, with columns, (sample, row, what).

        And the mean product of what noise leaves on each and on what a row holds of the signals,
        `whole`: (row, what). The last column, without a text, is that of a lag. `travel` is that
        of all records.
        """
        used, m, texts = self._picked[self.kept], self._motion, {"1": ADD}
        outer, bent = self.record.outer, self._coordinates(self._slow, 4)
        columns, noisy = [np.ones((len(used), 1))], [np.zeros((1, whole.shape[1]))]
        for j, name in enumerate(self.model.coordinates):
            # filtered once, as in the equations
            texts |= dict.fromkeys((name + dots for dots in DERIVATIVES), ADD)
            columns += [self._coordinates(outer, k)[used, j : j + 1] for k in range(3)]
            texts[name + ELASTIC] = BENDS
            columns.append(bent[used, j : j + 1])
            noisy += [
                self.shared[:, j] @ whole,
                np.zeros((len(FURTHER) + len(ALONG) * WAVES, whole.shape[1])),
            ]
            crawl, longest = SLOWLY * travel[0, j], 2 * np.pi / travel[1, j]
            turn = np.tanh(m.velocity[:, j] / crawl)
            forces = {
                text.format(q=name, slow=f"{crawl:.3g}"): of(
                    m.position[:, j], m.velocity[:, j], m.acceleration[:, j], turn
                )
                for text, of in FURTHER.items()
            } | {
                text.format(q=name, k=f"{n * longest:.5g}"): of(n * longest * m.position[:, j])
                for (text, of), n in product(ALONG.items(), range(1, 1 + WAVES))
            }
            texts |= dict.fromkeys(forces, ADD)
            columns += [
                self._each(self.record.outer.apply, f[:, None])[used] for f in forces.values()
            ]
        acting = self.model.input_matrix
        driven = acting.any(axis=1)
        pushed = np.flatnonzero(driven if driven.any() else ~driven)  # or all of what swings freely
        every = np.hstack(columns)[:, None, None] * np.eye(len(acting))[:, pushed, None]
        late = self._inputs(1) @ acting.T
        found = np.dstack([every.reshape(*late.shape, -1), late])
        inputs = np.array(self.model.inputs, dtype=object)
        drives = [", ".join(inputs[acting[row] != 0]) or f"row {row + 1}" for row in pushed]
        lack = "the equation of {} lacks a force as {}"
        said = [(lack.format(row, text), cure) for row in drives for text, cure in texts.items()]
        shared = np.concatenate(noisy).T[:, None] * np.eye(len(acting))[:, pushed, None]
        shared = np.append(shared.reshape(len(acting), -1), np.zeros((len(acting), 1)), axis=1)
        return said, self.counting(found), shared

    @property
    def left_out(self) -> str:
        if not (count := int((~self.told).any(axis=1).sum())):
            return ""
        return (
            f"{told_of(self.record.record)}{count} of {len(self.told)} samples in use are left out "
            "of the equations with a sign "
            f"whose argument is at rest there, below {NOISY:g} deviations of its noise or "
            f"{100 * SLOW:g} % of its usual size: its sign is noise, and friction at rest is any"
        )


def _signs_of(value: Expression) -> Iterator[Expression]:
    if value.kind == "sign":
        yield value
    for part in value.inner:
        yield from _signs_of(part)


def _mean_sign(argument: Floats) -> Floats:
    """Return the samples of the sign of what is a line along a step, up to what a filter takes.

    Its mean over the step about each sample, with what the mean takes of slow parts put back: it
    multiplies them by ``sin(x) / x ~ 1 - x^2 / 6, x = pi f / rate``.
    """
    mean = np.clip(2 * argument / np.maximum(np.abs(np.gradient(argument)), 1e-300), -1, 1)
    mean[1:-1] -= np.diff(mean, 2) / 24
    return np.asarray(mean)
