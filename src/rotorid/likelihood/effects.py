"""What unknowns of the measurement do to one record: a closed set of effects.

The likelihood knows these and no kinds of unknowns. `Calibration` is what those on channels,
readings and rotor angle come to on the lines of a record, with derivatives; terms, loads and what
drives the model go into its equations (`assembly`).

A constant of a force law is no factor of a line. The samples behind the lines go through the law
again; only what changes is added to the lines. What a sensor reads wrong is in the forces that were
read with it too (docs/maximum-likelihood.md, section 6).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Literal, TypeVar

import numpy as np

from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.data.lines import Lines, Samples
from rotorid.data.observation import Observation
from rotorid.force.reading import Passed, displacement
from rotorid.models.expressions import Expression, product, symbol
from rotorid.models.linear_form import TermKind
from rotorid.signals.spectrum import transfer_of_recording


@frozen
class Scales:
    """Multiplies the lines of channels: true line = factor * corrected line.

    A factor of a sensor acts on the forces that were read with that sensor too.
    """

    channels: frozenset[str]
    # of the values of its scalars and omega: the factor, (line,), and the derivatives of its
    # logarithm, (line, scalar)
    factor: Callable[[Floats, Floats], Complexes]
    slopes: Callable[[Floats, Floats], Complexes]


@frozen
class Adds:
    """A channel reads more, linear in the unknown.

    With an `order` n that is ``cos * cos(n phi) + sin * sin(n phi)`` of two scalars, and it goes on
    through the laws that take their displacement from the sensor; else one scalar times a `shape`
    of the samples, where the record has them.
    """

    channel: str
    order: int = 0
    shape: Callable[[Floats], Floats] | None = None


@frozen
class Rereads:
    """Changes a constant of the force laws of inputs; the samples go through them again."""

    inputs: frozenset[str]
    constant: str  # its name in the laws
    stated: float  # the value of the scalar at which the forces are as they were read


Factors = tuple[int, ...]  # unknowns whose product something is multiplied by, repeated for powers


@frozen
class Entry:
    """``coefficient * Omega^speed_power * factors * d^order / dt^order`` of a coordinate in a row.

    It adds to the left side of the equations of motion, as the stiffness does.
    """

    row: int
    column: int
    order: int
    coefficient: float
    speed_power: int = 0
    factors: Factors = (0,)  # whose product it is: of an effect counted among the scalars

    @property
    def kind(self) -> TermKind:
        return _kind(self.order, self.speed_power)


@lru_cache(maxsize=100)
def _kind(order: int, speed_power: int) -> TermKind:
    power = [(symbol("Omega"), Fraction(speed_power))] if speed_power else []
    return TermKind(order, product(power), structural=False)


@frozen
class RowLoad:
    """``coefficient * factors * signal(t, phi, Omega)``, added to the right side of a row."""

    row: int
    signal: Expression
    coefficient: float
    factors: Factors = (0,)  # as those of an entry


@frozen
class Drives:
    """Acts on what inputs do in the model.

    `force`: multiplies all of it. `ki`, `ks`: stands for that constant of a linear magnet. `lever`:
    the force acts on the rows of `arms` too: for each row that it acts on, others and their shares
    of the force for a lever of 1 m, or a turn of 1 rad. What drives it there gains as much of their
    motion.
    """

    inputs: frozenset[str]
    part: Literal["force", "ki", "ks", "lever"]
    arms: Mapping[int, Sequence[tuple[int, float]]] = field(default_factory=dict)


@frozen
class Reads:
    """A sensor reads a coordinate besides: the scalar times a coefficient times its position."""

    channel: str
    coordinate: int
    coefficient: float


@frozen
class Turns:
    """Adds to the rotor angle of the record."""


@frozen
class Replaces:
    """Stands for a parameter of the model in the record."""

    parameter: int  # which of the model's
    alone: bool  # every record has a value of its own: none is shared


Effect = Scales | Adds | Rereads | Entry | RowLoad | Drives | Reads | Turns | Replaces
E = TypeVar("E", bound=Effect)
Term = TypeVar("Term", Entry, RowLoad)
Placed = Sequence[tuple[E, Integers]]
"""Effects of one kind, each with where its scalars stand among the unknowns."""


def at_unknowns(placed: Placed[Term]) -> list[Term]:
    """Return entries or loads with their factors counted among the unknowns."""
    return [replace(e, factors=tuple(at[list(e.factors)].tolist())) for e, at in placed]


def of_kind(kind: type[E], effects: Sequence[Effect]) -> list[E]:
    return [effect for effect in effects if isinstance(effect, kind)]


STEP = 1e-30  # a complex step: the derivative of what is computed with it is exact to rounding
Line = Complexes | Floats | float  # a number of each line, or one of all


@frozen
class Bound:
    """What an effect does to a channel of a record: true line = factor * measured line - added."""

    channel: int
    unknowns: Integers  # on which it depends
    at: Callable[[Floats], tuple[Line, Line]]  # of all unknowns: the factor, and what is added
    # derivatives of the factor's logarithm and of what is added, (line, 1, unknown) or a number
    slopes: Callable[[Floats], tuple[Line, Line]]


def _factor(
    channel: int, scales: Scales, at: Integers, omega: Floats, part: Complexes | None = None
) -> Bound:
    """Return a factor of a channel, or of the `part` of a force that a sensor was read for."""

    def change(x: Floats) -> tuple[Line, Line]:
        factor = scales.factor(x[at], omega)
        return (factor, 0.0) if part is None else (1.0, (1 - factor) * part)

    def slopes(x: Floats) -> tuple[Line, Line]:
        slope = scales.slopes(x[at], omega)[:, None]
        if part is None:
            return slope, 0.0
        return 0.0, -(scales.factor(x[at], omega) * part)[:, None, None] * slope

    return Bound(channel, at, change, slopes)


def _addition(channel: int, at: Integers, lines: Complexes) -> Bound:
    return Bound(channel, at, lambda x: (1.0, lines @ x[at]), lambda x: (0.0, lines[:, None]))


def _rotation(
    channel: int, at: Integers, order: int, weight: Floats, lines: Lines, phase: int | None
) -> Bound:
    """Return ``w (cos * cos(n phi) + sin * sin(n phi))``, w the weight of each sample."""
    parts = lines.clock.lines(
        lambda t, phi, speed: (
            weight[:, None] * np.stack([np.cos(order * phi), np.sin(order * phi)], axis=-1)
        )
    )
    if phase is None:
        return _addition(channel, at, parts)

    def turned(x: Floats) -> Complexes:
        cos, sin = np.cos(order * x[phase]), np.sin(order * x[phase])
        return np.asarray(parts @ np.array([[cos, sin], [-sin, cos]]))

    def slopes(x: Floats) -> tuple[Line, Line]:
        found, (cos, sin) = turned(x), x[at]
        return 0.0, np.column_stack([found, order * (found @ np.array([sin, -cos]))])[:, None]

    return Bound(channel, np.append(at, phase), lambda x: (1.0, turned(x) @ x[at]), slopes)


def _law(channel: int, passed: Passed, rereads: Placed[Rereads], samples: Samples) -> Bound:
    at = np.array([where[0] for _, where in rereads])
    about = passed.force - passed.force.mean()
    size = float(about @ about)

    def moved(x: Floats, step: int | None = None) -> Floats | Complexes:
        changes: dict[str, complex] = {}
        for number, (effect, where) in enumerate(rereads):
            change = float(x[where[0]]) - effect.stated + (STEP * 1j if number == step else 0.0)
            changes[effect.constant] = changes.get(effect.constant, 0.0) + change
        return passed.law.changed(passed.flowing, passed.position, changes)

    def split(change: Floats) -> tuple[float, Complexes]:
        """Return a change as a share of the whole force, whose noise follows too, and the rest."""
        gain = float(about @ change) / size if size > 0 else 0.0
        return gain, samples.lines((change - gain * passed.force)[:, None])[:, 0]

    def change_at(x: Floats) -> tuple[float, Complexes]:
        gain, rest = split(moved(x).real - passed.force)
        return 1 + gain, -rest

    def slopes(x: Floats) -> tuple[Line, Line]:
        gains, rests = zip(*(split(moved(x, k).imag / STEP) for k in range(len(at))), strict=True)
        gain = change_at(x)[0] or 1e-300  # a law astray has none: so has its line
        return np.array(gains) / gain, -np.stack(rests, axis=1)[:, None]

    return Bound(channel, at, change_at, slopes)


@frozen
class CalibrationState:
    factors: Complexes  # (line, channel): E: true line = E times measured line
    # (line, channel): what adds to the readings on each line, in the unit of the channel
    readings: Complexes
    phase: Complexes  # (order,): exp(i order delta) for each order of the rotor angle


@frozen
class Calibration:
    shape: tuple[int, int]  # lines and channels
    phase_unknown: int | None = None  # the unknown that adds to phi
    # (order,): orders n of exp(i n phi) into which the loads are split; (0,) where the phase is
    # known
    phase_orders: Floats = field(default_factory=lambda: np.zeros(1))
    acting: tuple[Bound, ...] = ()
    rotating: tuple[Bound, ...] = ()  # what turns with the rotor, the phase behind its unknowns
    reread: tuple[Bound, ...] = ()  # forces that samples make again

    @classmethod
    def of(
        cls,
        observation: Observation,
        scales: Placed[Scales],
        adds: Placed[Adds],
        rereads: Placed[Rereads],
        phase: int | None,
        orders: Floats,
    ) -> Calibration:
        omega, names = observation.lines.omega, [c.name for c in observation.channels]
        acting = [
            _factor(channel, effect, at, omega)
            for effect, at in scales
            for channel, name in enumerate(names)
            if name in effect.channels
        ]
        added = (*acting, *_additions(observation, names, adds))
        rotating = tuple(_rotations(observation, names, adds, phase))
        reread = (*_laws(observation, rereads), *_passages(observation, scales))
        return cls((len(omega), len(names)), phase, orders, added, rotating, reread)

    @cached_property
    def every(self) -> tuple[Bound, ...]:
        return (*self.acting, *self.rotating, *self.reread)

    @property
    def affine(self) -> Integers:
        """Unknowns on which the equation error depends linearly, whitening not at all."""
        return np.unique(np.array([b.unknowns[:2] for b in self.rotating], dtype=np.int64))

    @cached_property
    def _still(self) -> CalibrationState:
        """The state where nothing acts."""
        factors, added = (np.full(self.shape, value, np.complex128) for value in (1.0, 0.0))
        return CalibrationState(factors, added, np.ones(len(self.phase_orders), np.complex128))

    def at(self, unknowns: Floats) -> CalibrationState:
        still = self._still
        if not self.every and self.phase_unknown is None:
            return still
        factors, added = still.factors.copy(), still.readings.copy()
        for bound in self.every:
            factor, more = bound.at(unknowns)
            factors[:, bound.channel] *= factor
            added[:, bound.channel] += more
        phase = 0.0 if self.phase_unknown is None else float(unknowns[self.phase_unknown])
        return CalibrationState(factors, added, np.exp(1j * self.phase_orders * phase))


def _laws(observation: Observation, rereads: Placed[Rereads]) -> Iterator[Bound]:
    lines = observation.lines
    if lines.samples is None:
        return
    for number, channel in enumerate(observation.inputs):
        acting = [(effect, at) for effect, at in rereads if channel.name in effect.inputs]
        if channel.law is not None and acting:
            column = observation.input_columns[number]
            passed = observation.passed.get(number) or Passed.of(lines, column, channel.law)
            yield _law(number, passed, acting, lines.samples)


def _passages(observation: Observation, scales: Placed[Scales]) -> Iterator[Bound]:
    lines = observation.lines
    if lines.samples is None:
        return
    for effect, at in scales:
        acting = np.array([name in effect.channels for name in lines.names])
        for number, passed in observation.passed.items():
            shares = np.where(acting, passed.shares, 0.0)
            if shares.any():
                moved = passed.slope * displacement(lines, lines.samples, shares)
                found = lines.samples.lines(moved[:, None])[:, 0]
                yield _factor(number, effect, at, lines.omega, found)


def _rotations(
    observation: Observation, names: Sequence[str], adds: Placed[Adds], phase: int | None
) -> Iterator[Bound]:
    """Yield what turns with the rotor in sensors, and in the forces whose laws they enter.

    Such a force is read too large by the slope of its law, in N/m at each sample: exact to first
    order, what is read wrong being small against the gap.
    """
    for effect, at in adds:
        if not effect.order:
            continue
        weights = {
            number: passed.law.position[effect.channel] * passed.slope
            for number, passed in observation.passed.items()
            if passed.law.position.get(effect.channel)
        }
        if effect.channel in names:
            weights[names.index(effect.channel)] = np.ones(1)
        for channel, weight in weights.items():
            yield _rotation(channel, at, effect.order, weight, observation.lines, phase)


def _additions(
    observation: Observation, names: Sequence[str], adds: Placed[Adds]
) -> Iterator[Bound]:
    lines, samples = observation.lines, observation.lines.samples
    if samples is None:
        return
    for effect, at in adds:
        if effect.shape is None or effect.channel not in names:
            continue
        column = lines.names.index(effect.channel)
        bent = samples.lines(effect.shape(samples.values[:, column])[:, None])
        # Lines of samples become those of the quantity as the channel's own do.
        recorded = [lines.channels[column]]
        bent *= transfer_of_recording(recorded, lines.frequency, samples.sample_rate)
        yield _addition(names.index(effect.channel), at, bent)
