"""What unknowns of the measurement do to one record: a closed set of effects.

The likelihood knows these and no kinds of unknowns. `Calibration` is what those on channels,
readings and rotor angle come to on the lines of a record, with derivatives; terms, loads and what
drives the model go into its equations (`assembly`).

A constant such as the gap is no factor of a line. The samples behind the lines, mean period or
whole record, go through the law again; what changes is added to the lines as they were read. The
samples carry the noise of their mean only, and only the change is taken from them.

The force of a magnet is computed from a current and a displacement. A gain, a lag or a runout of
the sensor is therefore in the force as well, k_s times as large.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from typing import Literal, Protocol, TypeVar

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.data.lines import Lines, Samples
from rotorid.data.observation import Observation
from rotorid.force.at_binding import Passed, displacement
from rotorid.models.expressions import Expression


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
    through the laws that take their displacement from the sensor; else one scalar times `lines`.
    """

    channel: str
    order: int = 0
    # (line,) of the quantity, for an unknown of one; ``None`` where the record does not tell it
    lines: Callable[[Observation], Complexes | None] | None = None


@frozen
class Rereads:
    """Changes constants of the force laws of inputs; the samples go through them again."""

    inputs: frozenset[str]
    # by how much each constant changes at a value of the scalar, by its name in the law
    changes: Callable[[complex], Mapping[str, complex]]


@frozen
class Entry:
    """``coefficient * Omega^speed_power * unknown * d^order / dt^order`` of a coordinate in a row.

    It adds to the left side of the equations of motion, as the stiffness does; `unknown` counts
    among the scalars.
    """

    row: int
    column: int
    order: int
    coefficient: float
    speed_power: int = 0
    unknown: int = 0


@frozen
class RowLoad:
    """``coefficient * signal(phi, Omega) * unknown``, added to the right side of a row.

    `unknown` counts among the scalars.
    """

    row: int
    signal: Expression
    unknown: int
    coefficient: float = 1.0


@frozen
class Drives:
    """Acts on what inputs do in the model.

    `force`: multiplies all of it. `ki`, `ks`: stands for that constant of a linear magnet. `lever`:
    the force acts on the rows of `arms` too: for each row that it acts on, another and its share of
    the force for a lever of 1 m.
    """

    inputs: frozenset[str]
    part: Literal["force", "ki", "ks", "lever"]
    arms: Mapping[int, tuple[int, float]] = field(default_factory=dict)


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
Placed = Sequence[tuple[E, Integers]]
"""Effects of one kind, each with where its scalars stand among the unknowns."""


def of_kind(kind: type[E], effects: Sequence[Effect]) -> list[E]:
    return [effect for effect in effects if isinstance(effect, kind)]


STEP = 1e-30
"""A complex step: the derivative of what is computed with it is exact to rounding."""


@frozen
class Reread:
    """A channel read otherwise: ``gain * line + rest`` in place of the line."""

    gain: float  # of the whole force, so that its noise follows too
    rest: Complexes  # (line,)


@frozen
class BoundLaw:
    """A force law of which constants are unknown, with the samples that went through it."""

    channel: int
    passed: Passed
    changes: Placed[Rereads]
    samples: Samples

    def _moved(self, unknowns: Floats, step: int | None = None) -> Floats | Complexes:
        changes: dict[str, complex] = {}
        for effect, (at,) in self.changes:
            value = unknowns[at] + (STEP * 1j if at == step else 0.0)
            for name, change in effect.changes(value).items():
                changes[name] = changes.get(name, 0.0) + change
        return self.passed.law.force(self.passed.flowing, self.passed.position, changes)

    def _split(self, change: Floats) -> Reread:
        """Return a change of the force as a share of the force itself, and the rest."""
        force = self.passed.force
        about = force - force.mean()
        size = float(about @ about)
        gain = float(about @ change) / size if size > 0 else 0.0
        return Reread(gain, self.samples.lines((change - gain * force)[:, None])[:, 0])

    def at(self, unknowns: Floats) -> Reread:
        change = self._split(self._moved(unknowns).real - self.passed.force)
        return Reread(1 + change.gain, change.rest)

    def slopes(self, unknowns: Floats) -> Iterator[tuple[int, Reread]]:
        for _, (at,) in self.changes:
            yield int(at), self._split(self._moved(unknowns, at).imag / STEP)


@frozen
class BoundPassage:
    """A factor of a sensor, as it acts on a force that was read with that sensor."""

    channel: int  # the input
    scales: Scales
    unknowns: Integers  # where those of the factor stand
    omega: Floats  # (line,)
    lines: Complexes  # (line,): of the slope of the law times what the sensor reads

    def at(self, unknowns: Floats) -> Reread:
        factor = self.scales.factor(unknowns[self.unknowns], self.omega)
        return Reread(1.0, (factor - 1) * self.lines)

    def slopes(self, unknowns: Floats) -> Iterator[tuple[int, Reread]]:
        values = unknowns[self.unknowns]
        change = self.scales.factor(values, self.omega) * self.lines
        for unknown, slope in zip(
            self.unknowns, self.scales.slopes(values, self.omega).T, strict=True
        ):
            yield int(unknown), Reread(0.0, change * slope)


def _laws(observation: Observation, rereads: Placed[Rereads]) -> Iterator[BoundLaw]:
    lines, samples = observation.lines, observation.lines.samples
    if samples is None:
        return
    for number, channel in enumerate(observation.inputs):
        acting = [(effect, at) for effect, at in rereads if channel.name in effect.inputs]
        if channel.law is not None and acting:
            column = observation.input_columns[number]
            passed = observation.passed.get(number) or Passed.of(lines, column, channel.law)
            yield BoundLaw(number, passed, acting, samples)


def _passages(
    observation: Observation, scales: Scales, unknowns: Integers
) -> Iterator[BoundPassage]:
    """Yield what a factor of sensors does to the forces that were read with them."""
    lines = observation.lines
    if lines.samples is None or not scales.channels:
        return
    acting = np.array([name in scales.channels for name in lines.names])
    for number, passed in observation.passed.items():
        shares = np.where(acting, passed.shares, 0.0)
        if shares.any():
            moved = passed.slope * displacement(lines, lines.samples, shares)
            found = lines.samples.lines(moved[:, None])[:, 0]
            yield BoundPassage(number, scales, unknowns, lines.omega, found)


@frozen
class CalibrationState:
    factors: Complexes  # (line, channel): E: true line = E times measured line
    # (line, channel): what adds to the readings on each line, in the unit of the channel
    readings: Complexes
    phase: Complexes  # (order,): exp(i order delta) for each order of the rotor angle


class Acting(Protocol):
    """What a point of the cost says of channels and loads; `cost.Evaluation` says it."""

    unknowns: Floats
    state: CalibrationState
    # (line, row, channel): what acts on what adds to the measured lines, and on these themselves
    plain: Complexes
    columns: Complexes

    @property
    def load_factors(self) -> Floats:
        """The monomials that the loads are multiplied by, shape (load,)."""


@frozen
class BoundFactor:
    """A factor, where its unknowns stand, and on which channels it acts."""

    scales: Scales
    unknowns: Integers
    channels: Integers


@frozen
class Addition:
    """What adds to the readings of a channel: an unknown times its lines."""

    channel: int
    unknown: int
    lines: Complexes  # (line,)


@frozen
class Reading:
    """What adds ``w (cos * cos(n phi) + sin * sin(n phi))`` to the readings of a channel.

    The weight w is 1 for the sensor itself, and a function of time for a force that is read with
    the displacement of that sensor.
    """

    channel: int
    # the two unknowns
    cos: int
    sin: int
    order: int  # n
    rotation: Complexes  # (line, 2): lines of w exp(i n phi) and w exp(-i n phi)

    def cosine_sine(self, phase: float) -> tuple[Complexes, Complexes]:
        """Return the lines of w cos(n phi) and w sin(n phi), each of shape (line,)."""
        turn = np.exp(1j * self.order * phase)
        forward, backward = self.rotation[:, 0] * turn, self.rotation[:, 1] / turn
        return (forward + backward) / 2, (forward - backward) / 2j


@frozen
class Calibration:
    """How the channels of one record depend on unknowns of the measurement."""

    omega: Floats  # (line,): rad/s
    channels: int
    factors: tuple[BoundFactor, ...] = ()
    readings: tuple[Reading, ...] = ()
    phase_unknown: int | None = None  # the unknown that adds to phi
    # (order,): orders n of exp(i n phi) into which the loads are split; (0,) where the phase is
    # known
    phase_orders: Floats = field(default_factory=lambda: np.zeros(1))
    reread: tuple[BoundLaw | BoundPassage, ...] = ()
    additions: tuple[Addition, ...] = ()

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
        """Bind what acts on the channels of a record; `phase`: the unknown that adds to phi."""
        names = [channel.name for channel in observation.channels]
        factors = []
        for scale, at in scales:
            acting = np.flatnonzero([name in scale.channels for name in names])
            if len(acting):
                factors.append(BoundFactor(scale, at, acting))
        passed = (each for scale, at in scales for each in _passages(observation, scale, at))
        return cls(
            observation.lines.omega,
            len(names),
            tuple(factors),
            tuple(_readings(observation, names, adds)),
            phase,
            orders,
            (*_laws(observation, rereads), *passed),
            tuple(_additions(observation, names, adds)),
        )

    @property
    def affine(self) -> Integers:
        """Unknowns on which the equation error depends linearly, whitening not at all."""
        return np.unique(np.array([(r.cos, r.sin) for r in self.readings], dtype=np.int64))

    def at(self, unknowns: Floats) -> CalibrationState:
        shape = (len(self.omega), self.channels)
        factors = np.ones(shape, dtype=np.complex128)
        for bound in self.factors:
            factor = bound.scales.factor(unknowns[bound.unknowns], self.omega)
            factors[:, bound.channels] *= factor[:, None]
        added = np.zeros(shape, dtype=np.complex128)
        for reading in self.readings:
            cos, sin = reading.cosine_sine(self.phase(unknowns))
            added[:, reading.channel] += cos * unknowns[reading.cos] + sin * unknowns[reading.sin]
        for addition in self.additions:
            added[:, addition.channel] += unknowns[addition.unknown] * addition.lines
        for law in self.reread:
            read = law.at(unknowns)
            factors[:, law.channel] *= read.gain
            added[:, law.channel] -= read.rest
        return CalibrationState(
            factors, added, np.exp(1j * self.phase_orders * self.phase(unknowns))
        )

    def phase(self, unknowns: Floats) -> float:
        return 0.0 if self.phase_unknown is None else float(unknowns[self.phase_unknown])

    def add_directions(
        self, jacobian: Complexes, at: Acting, data: Complexes, load: Complexes
    ) -> None:
        """Add the columns of these unknowns to `jacobian`, (line, row, unknown).

        `data` are the corrected lines, `load` the columns of g for each order of the rotor angle.
        """
        for bound in self.factors:
            acted = (at.columns[:, :, bound.channels] @ data[:, bound.channels, None])[:, :, 0]
            slopes = bound.scales.slopes(at.unknowns[bound.unknowns], self.omega)
            jacobian[:, :, bound.unknowns] += acted[:, :, None] * slopes[:, None, :]
        for law in self.reread:
            line = at.columns[:, :, law.channel] * data[:, law.channel, None]
            gain = law.at(at.unknowns).gain or 1e-300  # a law astray has none: so has its line
            for unknown, slope in law.slopes(at.unknowns):
                jacobian[:, :, unknown] += slope.gain / gain * line
                jacobian[:, :, unknown] += at.plain[:, :, law.channel] * slope.rest[:, None]
        for addition in self.additions:
            acted = at.plain[:, :, addition.channel] * addition.lines[:, None]
            jacobian[:, :, addition.unknown] -= acted
        self.add_readings(jacobian, at, np.arange(len(at.unknowns)))
        if self.phase_unknown is not None:
            self._add_phase(jacobian, at, load, self.phase_unknown)

    def add_readings(self, jacobian: Complexes, at: Acting, among: Integers) -> None:
        """Add the columns of what adds to readings to those of some unknowns."""
        for reading in self.readings:
            acted = at.plain[:, :, reading.channel]
            parts = reading.cosine_sine(self.phase(at.unknowns))
            for unknown, line in zip((reading.cos, reading.sin), parts, strict=True):
                for where in np.flatnonzero(among == unknown):  # several share one
                    jacobian[:, :, where] -= acted * line[:, None]

    def _add_phase(self, jacobian: Complexes, at: Acting, load: Complexes, unknown: int) -> None:
        turned = np.tensordot(1j * self.phase_orders * at.state.phase, load, 1)
        jacobian[:, : turned.shape[1], unknown] += turned @ at.load_factors
        for reading in self.readings:
            cos, sin = reading.cosine_sine(self.phase(at.unknowns))
            moved = cos * at.unknowns[reading.sin] - sin * at.unknowns[reading.cos]
            moved = moved * reading.order
            jacobian[:, :, unknown] -= at.plain[:, :, reading.channel] * moved[:, None]


def _readings(
    observation: Observation, names: Sequence[str], adds: Placed[Adds]
) -> Iterator[Reading]:
    """Yield what turns with the rotor in sensors, and in the forces whose laws they enter.

    Such a force is read too large by the slope of its law, in N/m at each sample: exact to first
    order, what is read wrong being small against the gap.
    """
    for effect, at in adds:
        if not effect.order:
            continue
        cos, sin = at.tolist()
        weights = {
            number: passed.law.position[effect.channel] * passed.slope
            for number, passed in observation.passed.items()
            if passed.law.position.get(effect.channel)
        }
        if effect.channel in names:
            weights[names.index(effect.channel)] = np.ones(1)
        for channel, weight in weights.items():
            rotation = _rotation(observation.lines, effect.order, weight)
            yield Reading(channel, cos, sin, effect.order, rotation)


def _rotation(lines: Lines, order: int, weight: Floats) -> Complexes:
    """Return the lines of w exp(i n phi) and w exp(-i n phi), shape (line, 2)."""
    parts = lines.clock.lines(
        lambda t, phi, speed: (
            weight[:, None] * np.stack([np.cos(order * phi), np.sin(order * phi)], axis=-1)
        )
    )
    return np.stack([parts[:, 0] + 1j * parts[:, 1], parts[:, 0] - 1j * parts[:, 1]], axis=1)


def _additions(
    observation: Observation, names: Sequence[str], adds: Placed[Adds]
) -> Iterator[Addition]:
    for effect, at in adds:
        if effect.lines is None or effect.channel not in names:
            continue
        found = effect.lines(observation)
        if found is not None:
            yield Addition(names.index(effect.channel), int(at[0]), found)
