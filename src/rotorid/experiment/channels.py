"""Where the channels of a record come from, names and units checked against the model."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.frozen import frozen
from rotorid.core.units import check_unit, converts, multiply_units, si_factor
from rotorid.core.values import Complexes, Floats
from rotorid.data.record import Channel
from rotorid.experiment.schema import (
    ChannelEntry,
    DynamicsEntry,
    Recorded,
    RecordEntry,
)
from rotorid.force.channel_dynamics import Dynamics, EddyCurrents, FirstOrder, Measured, SecondOrder
from rotorid.force.laws import Differential, Flux, Linear
from rotorid.force.reading import ForceReading
from rotorid.io import Source, open_table
from rotorid.io.table import Column
from rotorid.models import Model
from rotorid.models.equations import DERIVATIVES, SensorTerm, sensor_terms

Entries = Mapping[str, ChannelEntry]
_ANGLES = ("deg", "rad")
_POLAR = re.compile(r"(?:phase|phi|angle|arg)(?![a-z])", re.I)


@frozen
class Recording:
    """A record as the file has it: where its columns come from, and what is made of them."""

    entry: RecordEntry
    folder: Path  # of its files
    channels: Entries
    sources: Mapping[str, Source]
    # of inputs: the columns that they are made of by name, the displacement by coordinates
    laws: Mapping[str, ForceReading]

    @property
    def paths(self) -> list[Path]:
        return [self.folder / name for name in self.entry.paths]

    @property
    def of_table(self) -> dict[str, Channel]:
        """The channels of a table."""
        return {name: one.channel(name, one.expected or "") for name, one in self.sources.items()}


_UNIT_OF = {
    "samples": "the unit of the sensor",
    "phasors": "the unit of the amplitude",
    "responses": "the unit of the response, such as um/N",
}


def source(name: str, entry: ChannelEntry, model: Model, folder: Path) -> Source:
    """Return where a channel without force law comes from; a table is looked for in `folder`.

    `expected` is the SI unit of the channel; None for the one of its column.
    """
    place, kind = f"channels.{name}", entry.kind
    quantities = (*model.inputs, *model.coordinates)
    if entry.input is not None:
        told = "{}, which is no input of the model"
        require_names([entry.input], model.inputs, told, place=f"{place}.input")
    if entry.reads is None:
        told = "{}, which is no input or coordinate of the model"
        require_names([name], quantities, told, place=place)
    if entry.reads is not None and name in quantities:
        raise InputError(
            f"reads in the channel of {name}",
            "a name of its own for a sensor of a combination",
            "rename the channel",
            place=place,
        )
    reads = None if entry.reads is None else _combination(entry.reads, model, f"{place}.reads")
    stated = entry.column is not None and (kind == "responses" or reads is None)
    if entry.unit is None and not stated:
        raise InputError("no unit", _UNIT_OF[kind], "write it", place=f"{place}.unit")
    expected = model.units.get(name)
    if entry.polar:
        si_factor(entry.phase_unit, "rad", place=f"{place}.phase_unit")
    if kind == "responses":
        expected = reading_unit(name, entry, model)
    if entry.unit is not None and kind == "responses":
        reading_factor(name, entry, entry.unit, model)
    elif entry.unit is not None and kind == "phasors":
        si_factor(entry.unit, expected, place=f"{place}.unit")
        expected = expected or check_unit(entry.unit)
    dynamics = dynamics_of(entry.dynamics, actuator=name in model.inputs, folder=folder)
    return replace(_as_recorded(entry, expected, dynamics), reads=reads, alone=True)


def reading_unit(name: str, entry: ChannelEntry, model: Model) -> str:
    """Return the SI unit of what the sensor of a response reads."""
    if entry.reads is None:
        return model.units[name]
    first = sensor_terms(entry.reads, model.coordinates, model.parameter_names)[0]
    units = model.parameter_units
    held = zip(model.parameter_names, first.powers, strict=True)
    return multiply_units(
        [
            (model.units[model.coordinates[first.coordinate]], 1),
            ("s", -first.order),
            *((units[parameter], power) for parameter, power in held),
        ]
    )


def reading_factor(name: str, entry: ChannelEntry, stated: str, model: Model) -> float:
    """Return the number that turns a response into SI; a derivative of another order is told."""
    place, over = f"channels.{name}.unit", model.units[entry.input or ""]
    reading = reading_unit(name, entry, model)
    expected = f"({reading})/({over})"
    try:
        return si_factor(stated, expected)
    except InputError as error:
        read = entry.reads or name
        plain = read.rstrip("'")
        for order, dots in enumerate(DERIVATIVES):
            other = multiply_units([(model.units.get(plain, reading), 1), ("s", -order)])
            if plain in model.coordinates and converts(stated, f"({other})/({over})"):
                raise InputError(
                    f"unit {stated!r} of a response that reads {read}",
                    f"a unit that converts to {expected}",
                    f'a channel of a name of its own with reads = "{plain}{dots}"',
                    place=place,
                ) from None
        raise error.at(place=place) from None


def _as_recorded(entry: Recorded, expected: str | None, dynamics: Dynamics | None) -> Source:
    """Return a column as the file says that it was recorded, to be read in a unit."""
    return Source(
        column=entry.column or "",
        unit=entry.unit,
        scale=entry.scale,
        expected=expected,
        hold=entry.hold == "zero-order",
        delay=entry.delay.value,
        delay_std=entry.delay.std or 0.0,
        gain_std=entry.gain_std,
        dynamics=dynamics,
    )


def _combination(text: str, model: Model, place: str) -> dict[str, float]:
    """Return what a sensor reads, by dotted coordinates, or products of them with parameters."""
    return {
        "*".join([*factors, model.coordinates[t.coordinate] + DERIVATIVES[t.order]]): t.coefficient
        for factors, t in _products(text, model.coordinates, model, place)
    }


def _products(
    text: str, names: Sequence[str], model: Model, place: str
) -> Iterator[tuple[list[str], SensorTerm]]:
    """Yield the terms of a combination of names, each after the parameters that multiply it."""
    for term in sensor_terms(text, names, model.parameter_names, place=place):
        powers = zip(model.parameter_names, term.powers, strict=True)
        yield [name for name, power in powers for _ in range(power)], term


def dynamics_of(
    entry: DynamicsEntry | None, *, actuator: bool, folder: Path = Path()
) -> Dynamics | None:
    """Return the dynamics of a channel; by default an input's are its actuator's."""
    if entry is None:
        return None
    common: dict[str, Any] = {
        "actuator": actuator if entry.of is None else entry.of == "actuator",
        "shared": entry.shared,
    }
    if entry.table is not None:
        table = open_table(folder / entry.table)
        names = table.names
        if len(names) != 3:
            raise InputError(
                f"{len(names)} columns",
                "frequency in Hz, real part, imaginary part",
                "write these three columns",
                file=str(folder / entry.table),
            )
        columns = table.read(names)
        with naming(str(folder / entry.table)):
            hertz, measured = _response(list(names), [columns[name] for name in names])
        return Measured(frequency=hertz, measured=measured, **common)
    if entry.eddy is not None:
        return EddyCurrents(eddy=entry.eddy, **common)
    assert entry.bandwidth is not None  # the schema sees to it
    if entry.damping is None:
        return FirstOrder(bandwidth=entry.bandwidth, **common)
    return SecondOrder(bandwidth=entry.bandwidth, damping=entry.damping, **common)


def _response(names: Sequence[str], columns: Sequence[Column]) -> tuple[Floats, Complexes]:
    """Return frequencies in Hz and the response, of two parts or of amplitude and phase.

    The units are those in the head; without any, Hz, and parts.
    """
    units = [column.unit for column in columns]
    first, second = columns[1].values, columns[2].values
    hertz = columns[0].values * si_factor(units[0] or "Hz", "Hz")
    polar = units[2] in _ANGLES or _POLAR.match(names[2]) is not None
    if any("dB" in (text or "") for text in (*names, *units)) or (polar and units[2] is None):
        shown = (
            name if unit is None else f"{name} [{unit}]"
            for name, unit in zip(names, units, strict=True)
        )
        raise InputError(
            f"columns {', '.join(shown)}"[:200],
            "frequency, then real and imaginary part, or amplitude and phase [deg]",
            "write such columns, a phase with its unit",
        )
    if polar:
        angle = second * si_factor(units[2] or "rad", "rad")
        return hertz, np.asarray(first * np.exp(1j * angle))
    return hertz, np.asarray(first + 1j * second)


def law_sources(
    name: str, entry: ChannelEntry, entries: Entries, model: Model, folder: Path
) -> tuple[dict[str, Source], ForceReading]:
    """Return where the columns of a force law come from, and the law."""
    place = f"channels.{name}"
    if name not in model.inputs:
        raise InputError(
            f"a force law for {name}",
            f"an input of the model ({', '.join(model.inputs)})",
            "give laws to inputs only",
            place=place,
        )
    with naming(place=place):
        law = _law(entry)
        position = _position(entry, entries, model)
    columns = entry.recorded
    linear = isinstance(law, Linear)
    labels = [name] if linear else [f"{name}[{i}]" for i in range(len(columns))]
    unit = "T" if isinstance(law, Flux) else "A"
    sources = {
        label: _as_recorded(column, unit, _law_dynamics(law, column.dynamics, folder, place))
        for label, column in zip(labels, columns, strict=True)
    }
    return sources, ForceReading(law, tuple(labels), position)


def _law_dynamics(
    law: Linear | Differential | Flux, entry: DynamicsEntry | None, folder: Path, place: str
) -> Dynamics | None:
    """Return the dynamics of a law's column: of a current; known, where the law bends."""
    bends = not isinstance(law, Linear)
    if entry is not None and (isinstance(law, Flux) or (bends and entry.uncertain)):
        raise InputError(
            "dynamics of a flux" if isinstance(law, Flux) else "unknown dynamics in a bent law",
            "known dynamics of a current",
            "take the linear law, measure the current behind the amplifier, or its response",
            place=f"{place}.dynamics",
        )
    return dynamics_of(entry, actuator=True, folder=folder)


def _law(entry: ChannelEntry) -> Linear | Differential | Flux:
    law = entry.build()
    if isinstance(law, Linear) and law.std.get("ks"):
        raise InputError(
            "a deviation of ks",
            "ks as it is, or as an unknown",
            'leave std out, or estimate it: gains = ["ks"]',
            place="ks",
        )
    return law


def _position(entry: ChannelEntry, entries: Entries, model: Model) -> dict[str, float]:
    """Return the displacement in an actuator as a combination of coordinates."""
    if entry.position is None:
        return {}
    reads = {
        name: _combination(sensor.reads, model, f"channels.{name}.reads")
        for name, sensor in entries.items()
        if sensor.reads is not None
    }
    known = list(dict.fromkeys((*model.coordinates, *reads)))
    total: dict[str, float] = {}
    for levers, term in _products(entry.position, known, model, "position"):
        if term.order:
            raise InputError(
                f"{entry.position[:60]!r}, which holds a derivative",
                "a combination of positions here",
                "leave the derivative out",
                place="position",
            )
        name = known[term.coordinate]
        for coordinate, share in reads.get(name, {name: 1.0}).items():
            text = "*".join([*levers, coordinate])
            total[text] = total.get(text, 0.0) + term.coefficient * share
    return {name: value for name, value in total.items() if value}


def columns_of(entry: ChannelEntry) -> tuple[tuple[str, ...], ...]:
    """Return what a channel is read from: a column, the two of a phasor, or each of its law's."""
    if entry.law is not None:
        return tuple((column.column.strip("/"),) for column in entry.columns)
    if entry.column is not None:
        return ((entry.column.strip("/"),),)
    return (tuple(str(getattr(entry, part)) for part in entry.parts),)


def check_columns(entries: Entries) -> None:
    """Refuse one column for two channels; force laws may share a current: coils in series."""
    taken: dict[tuple[str, ...], str] = {}
    for name, entry in entries.items():
        for column in columns_of(entry):
            other = taken.setdefault(column, name)
            series = entry.law is not None and entries[other].law is not None and other != name
            if (other != name or columns_of(entry).count(column) > 1) and not series:
                raise InputError(
                    f"{' and '.join(map(repr, column))} for {other} and for {name}",
                    "a column of its own for each channel",
                    "write the name of the right column; a sensor that sees several coordinates is "
                    "one channel with reads, a force that acts on several one input of the model",
                    place=f"channels.{name}",
                )


def shared_currents(plan: Recording) -> tuple[str, ...]:
    """Say which currents feed several force laws."""
    users: dict[str, list[str]] = {}
    for name, law in plan.laws.items():
        for source in law.channels:
            users.setdefault(plan.sources[source].column.strip("/"), []).append(name)
    return tuple(
        f"the current {column[:60]!r} drives {' and '.join(names)}: right for coils in series only"
        for column, names in users.items()
        if len(names) > 1
    )
