"""`Observation`: a record that has met a model. What every channel is, is decided here, once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import get_args

import numpy as np
import scipy

from rotorid.core.errors import InputError, require_type
from rotorid.core.linalg import sensor_rank
from rotorid.core.values import Floats, frozen
from rotorid.data.filtered import FilteredRecord
from rotorid.data.lines import Lines, SampledClock, SilentClock
from rotorid.data.record import Channel, Known, PeriodicRecord
from rotorid.force.reading import Passed, combined_columns
from rotorid.models import Model
from rotorid.models.equations import DERIVATIVES, SensorTerm, sensor_terms
from rotorid.signals.covariance import LineCovariance

HIDDEN = 1e-6
"""A coordinate with more than this share in a combination that no sensor reads is hidden."""


@frozen
class Sensor:
    """What a sensor is: a channel with ``y = sum coefficient * parameters * d^n q / dt^n``."""

    channel: Channel
    column: int  # where it stands among the channels of the record
    terms: tuple[SensorTerm, ...]
    apart: bool = False  # it reads something unknown besides

    @property
    def direct(self) -> bool:
        """Whether it reads a combination of positions with known coefficients."""
        still = all(term.order == 0 and not any(term.powers) for term in self.terms)
        return still and not self.apart

    @property
    def order(self) -> int:
        return max(term.order for term in self.terms)


@frozen
class Observation:
    model: Model
    lines: Lines
    inputs: tuple[Channel, ...]  # the channel of each input of the model, in order
    input_columns: tuple[int, ...]  # where they stand among the channels of the record
    sensors: tuple[Sensor, ...]  # in the order of the record
    periodic: PeriodicRecord | None = None  # the periods, where the record has them
    # mapping of str to float or str or (value, std): parameters that the record has to itself, as
    # they were given
    own: Mapping[str, Known] = field(default_factory=dict)
    filtered: FilteredRecord | None = None  # the samples, where there are these in place of lines

    @cached_property
    def direct(self) -> tuple[Sensor, ...]:
        return tuple(s for s in self.sensors if s.direct)

    @cached_property
    def indirect(self) -> tuple[Sensor, ...]:
        return tuple(s for s in self.sensors if not s.direct)

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The channels in the order of the likelihood: inputs, indirect sensors, direct ones."""
        return (*self.inputs, *(s.channel for s in (*self.indirect, *self.direct)))

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Columns of the record in the order of `channels`."""
        return (*self.input_columns, *(s.column for s in (*self.indirect, *self.direct)))

    @cached_property
    def reads(self) -> Floats:
        """C of the direct sensors, shape (sensor, coordinate)."""
        matrix = np.zeros((len(self.direct), len(self.model.coordinates)))
        for row, sensor in enumerate(self.direct):
            for term in sensor.terms:
                matrix[row, term.coordinate] += term.coefficient
        return matrix

    @cached_property
    def rank(self) -> int:
        return sensor_rank(self.reads)

    @cached_property
    def hidden(self) -> tuple[str, ...]:
        """Coordinates that the direct sensors do not determine."""
        if not self.rank:
            return self.model.coordinates
        open_ways = np.abs(np.linalg.svd(self.reads)[2][self.rank :].T)
        names = zip(self.model.coordinates, open_ways, strict=True)
        return tuple(name for name, ways in names if (ways > HIDDEN).any())

    @cached_property
    def passed(self) -> dict[int, Passed]:
        """What went through the laws that take a displacement, by the number of the input."""
        named = zip(self.inputs, self.input_columns, strict=True)
        return {
            number: Passed.of(self.lines, column, channel.law)
            for number, (channel, column) in enumerate(named)
            if channel.law is not None and channel.law.position
        }

    def with_lines(self, lines: Lines) -> Observation:
        return replace(self, lines=lines)

    def with_columns(self, matrix: Floats) -> Observation:
        """Return the record whose columns are ``matrix @ columns``, as if logged so."""
        return self.with_lines(combined_columns(self.lines, self.passed.values(), matrix))

    def with_sensor(self, channel: Channel) -> Observation:
        """Return the plan with one more sensor, as noisy as the others on average."""
        variance = np.diagonal(self.lines.covariance.matrices, axis1=1, axis2=2).real
        beside = [sensor.column for sensor in self.sensors]
        lines = self.lines.with_channel(channel, variance[:, beside].mean(axis=1))
        added = Sensor(channel, len(lines.channels) - 1, _terms(channel, self.model, ""))
        return replace(self, lines=lines, sensors=(*self.sensors, added), periodic=None)


Records = Sequence[Observation]

Measured = PeriodicRecord | Lines | FilteredRecord
"""What is made of a record before it meets a model."""
MEASURED = get_args(Measured)
Data = Measured | Observation
"""What a model can be bound to; what is bound already is taken as it is."""


def bind(model: Model, data: Data) -> Observation:
    """Say what every channel of a record is to a model; what is bound already meets another."""
    if isinstance(data, Observation):
        before = data.model
        if (model.coordinates, model.readings) == (before.coordinates, before.readings):
            return replace(data, model=model)
        return replace(bind(model, data.lines), periodic=data.periodic, own=data.own)
    require_type(model, Model, place="model")
    require_type(data, *MEASURED, place="record")
    lines = _lines(data)
    read = [c for c in lines.channels if c.name not in model.inputs or c.reads is not None]
    terms = {channel.name: _terms(channel, model, lines.source) for channel in read}
    lines = _unforced(model, lines, [term for each in terms.values() for term in each])
    where = {name: k for k, name in enumerate(lines.names)}
    missing = [name for name in model.inputs if name not in where]
    if missing:
        raise InputError(
            f"no channel of the input {', '.join(missing)}",
            "every input measured that moves what a sensor reads",
            "name its column in [channels]; where nothing acts on it, write { scale = 0 } for it",
            file=lines.source,
        )
    sensors = tuple(Sensor(c, where[c.name], terms[c.name]) for c in read)
    if not sensors:
        expected = f"at least one of {', '.join(model.coordinates)}"
        cure = "name a channel after it, or give a channel that reads it"
        raise InputError("no sensor of any coordinate", expected, cure, file=lines.source)
    columns = tuple(where[name] for name in model.inputs)
    return Observation(
        model,
        lines,
        tuple(lines.channels[k] for k in columns),
        columns,
        sensors,
        data if isinstance(data, PeriodicRecord) else None,
        lines.parameters,
        data if isinstance(data, FilteredRecord) else None,
    )


def _lines(data: Measured) -> Lines:
    """Return the lines of a record; samples that are filtered have none."""
    if isinstance(data, Lines):
        return data
    if isinstance(data, PeriodicRecord):
        return Lines.of_periods(data)
    count, none = len(data.channels), np.zeros(0)
    return Lines(
        channels=data.channels,
        frequency=none,
        speed=none,
        mean=np.zeros((0, count), dtype=np.complex128),
        covariance=LineCovariance(np.zeros((0, count, count), dtype=np.complex128), 0, "stated"),
        multiplicity=none,
        clock=SampledClock(none, none.astype(np.int64), none[None], none[None]),
        phase_known=data.record.phase_known,
        phase_std=data.record.phase_std,
        source=data.source,
        warnings=data.warnings,
        checks=data.checks,
        parameters=data.parameters,
    )


def _unforced(model: Model, lines: Lines, read: Sequence[SensorTerm]) -> Lines:
    """Return lines with zero for inputs that have no channel and need none.

    In passive bearings there are no forces; else an input needs none that moves no coordinate which
    a sensor reads, as those of the other plane of a rotor at rest.
    """
    missing = [name for name in model.inputs if name not in lines.names]
    if not lines.passive:
        missing = [name for name in missing if name in _apart(model, lines, read)]
    for name in missing:
        lines = lines.with_channel(Channel(name, model.units[name]), np.zeros(len(lines.mean)))
    if not missing or isinstance(lines.clock, SilentClock):  # responses are to one input alone
        return lines
    why = "in passive bearings" if lines.passive else "what it moves no sensor reads"
    told = f"no column of {', '.join(missing)}: taken as zero, {why}"
    return replace(lines, warnings=(*lines.warnings, told))


def _apart(model: Model, lines: Lines, read: Sequence[SensorTerm]) -> set[str]:
    """Return the inputs that no equation couples with what is read, at the speeds of the lines."""
    if model.linear is None:
        return set()
    table, count = model.linear.stiffness, len(model.coordinates)
    still = np.array([not kind.factor.free_symbols for kind in table.kinds])[table.kind]
    acting = table.where(still | bool(lines.speed.any()))
    size, places = model.linear.rows + count, (acting.row, model.linear.rows + acting.column)
    graph = scipy.sparse.csr_array((np.ones(len(acting)), places), shape=(size, size))
    part = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    seen = {part[model.linear.rows + term.coordinate] for term in read}
    moved = {model.inputs[b.input] for b in model.linear.input_terms if part[b.row] in seen}
    return {*model.inputs} - moved


def bind_all(model: Model, data: Sequence[Data]) -> tuple[Observation, ...]:
    if not data:
        raise InputError("no record", "at least one", "give a PeriodicRecord")
    bound = tuple(bind(model, each) for each in data)
    refuse_unread(model, bound)
    return bound


def refuse_unread(model: Model, bound: Records) -> None:
    """Refuse a model with a parameter that is in no equation, and that no sensor reads."""
    channels = [channel for record in bound for channel in record.channels]
    said = [text for c in channels for text, _ in _spelt(c.combination, model)]
    said += [text for channel in channels if channel.drive for text in channel.drive.position]
    read = set(re.findall(r"\w+", " ".join(said)))
    alone = np.flatnonzero(~model.monomials.any(axis=0)).tolist()
    if unread := [name for name in (model.parameter_names[i] for i in alone) if name not in read]:
        found = f"{unread[0]} in no equation of the model, and in nothing that a sensor reads"
        cure = "use it, or remove it from the model"
        raise InputError(found, "every parameter in one of them", cure)


def _spelt(combination: Mapping[str, float], model: Model) -> Iterator[tuple[str, float]]:
    """Yield the terms of a combination in coordinates, for what the model reads besides them."""
    for text, coefficient in combination.items():
        *levers, moving = text.split("*")
        name = moving.rstrip("'")
        for inner, share in model.readings.get(name, {name: 1.0}).items():
            yield "*".join([*levers, inner + moving[len(name) :]]), share * coefficient


def _terms(channel: Channel, model: Model, source: str) -> tuple[SensorTerm, ...]:
    return combined(channel.combination, model, "a channel that reads", channel.name, source)


def combined(
    combination: Mapping[str, float], model: Model, what: str, place: str, source: str = ""
) -> tuple[SensorTerm, ...]:
    """Return a combination of coordinates, dotted, or of products of them with parameters."""
    names = {
        name + dots: (k, order)
        for k, name in enumerate(model.coordinates)
        for order, dots in enumerate(DERIVATIVES)
    }
    still = (0,) * len(model.parameters)
    found: list[SensorTerm] = []
    for text, coefficient in _spelt(combination, model):
        if text in names:
            found.append(SensorTerm(*names[text], still, float(coefficient)))
            continue
        try:
            terms = sensor_terms(text, model.coordinates, model.parameter_names)
        except InputError:
            raise InputError(
                f"{what} {text!r}",
                f"inputs ({', '.join(model.inputs)}) or coordinates "
                f"({', '.join(model.coordinates)})",
                "give it a name of the model, or leave it out of the record",
                file=source,
                place=place,
            ) from None
        found += [replace(t, coefficient=t.coefficient * coefficient) for t in terms]
    return tuple(found)
