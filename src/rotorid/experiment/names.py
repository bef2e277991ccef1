"""Names of the model in an experiment file: channels, parameters, constraints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, naming, nearest
from rotorid.core.units import si_factor, to_si
from rotorid.core.values import Complexes, Floats
from rotorid.data.measured_modes import Mode, in_units_of
from rotorid.experiment.schema import (
    ChannelEntry,
    ConstraintEntry,
    DynamicsEntry,
    ModeEntry,
    OwnEntry,
    ParameterEntry,
    Recorded,
)
from rotorid.force.channel_dynamics import Dynamics, EddyCurrents, FirstOrder, Measured, SecondOrder
from rotorid.io import Source, open_table
from rotorid.io.table import Column
from rotorid.models import Model
from rotorid.models.equations import DERIVATIVES, polynomial, sensor_terms
from rotorid.models.priors import Constraint, unit_of_expression

_ANGLES = ("deg", "rad")
_POLAR = re.compile(r"(?:phase|phi|angle|arg)(?![a-z])", re.I)


def unknown(name: str, known: Iterable[str], what: str, place: str) -> InputError:
    """Return the error for a name that the model does not have, with the nearest that it has."""
    there = list(known)
    return InputError(
        f"{name[:60]!r}, which is no {what} of the model",
        f"one of {', '.join(there)}",
        nearest(name, there),
        place=place,
    )


def source(name: str, entry: ChannelEntry, model: Model, folder: Path = Path()) -> Source:
    """Return where a channel without force law comes from; a table is looked for in `folder`."""
    place = f"channels.{name}"
    quantities = (*model.inputs, *model.coordinates)
    if entry.reads is None and name not in quantities:
        raise unknown(name, quantities, "input or coordinate", place)
    if entry.reads is not None and name in quantities:
        raise InputError(
            f"reads in the channel of {name}",
            "a name of its own for a sensor of a combination",
            "rename the channel",
            place=place,
        )
    reads = (
        None if entry.reads is None else combination_of(entry.reads, model, place=f"{place}.reads")
    )
    if reads is not None and entry.unit is None:
        raise InputError("no unit", "the unit of the sensor", "write it", place=f"{place}.unit")
    expected = model.units[name] if reads is None else None
    dynamics = dynamics_of(entry.dynamics, actuator=name in model.inputs, folder=folder)
    return replace(as_recorded(entry, expected, dynamics), reads=reads, alone=True)


def as_recorded(entry: Recorded, expected: str | None, dynamics: Dynamics | None) -> Source:
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


def combination_of(text: str, model: Model, *, place: str) -> dict[str, float]:
    """Return what a sensor reads, by dotted coordinates, or products of them with parameters."""
    found: dict[str, float] = {}
    for term in sensor_terms(text, model.coordinates, model.parameter_names, place=place):
        powers = zip(model.parameter_names, term.powers, strict=True)
        factors = [name for name, power in powers for _ in range(power)]
        moving = model.coordinates[term.coordinate] + DERIVATIVES[term.order]
        found["*".join([*factors, moving])] = term.coefficient
    return found


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


def fixed_values(entries: Mapping[str, ParameterEntry], model: Model) -> dict[str, float]:
    """Return the fixed parameters in SI, every entry checked for its name and its units."""
    units = model.parameter_units
    positive = {parameter.name: parameter.positive for parameter in model.parameters}
    fixed = {}
    for name, entry in entries.items():
        if name not in units:
            raise unknown(name, units, "parameter", f"parameters.{name}")
        for key in ("fixed", "value", "std", "start", "min", "max"):
            quantity = getattr(entry, key)
            if quantity is not None:
                number = to_si(quantity, units[name], place=f"parameters.{name}.{key}")
                if key == "std":
                    _check_deviation(number, f"parameters.{name}.std")
                if key in ("fixed", "value", "start"):
                    _check_sign(number, positive[name], f"parameters.{name}.{key}")
                if key == "fixed":
                    fixed[name] = number
    return fixed


def own_values(
    entries: Mapping[str, OwnEntry], model: Model, place: str
) -> dict[str, tuple[float, float]]:
    """Return the parameters that a record has to itself, value and deviation in SI."""
    known = {p.name: p for p in model.parameters}
    found = {}
    for name, entry in entries.items():
        where = f"{place}.{name}"
        if name not in known:
            raise unknown(name, known, "parameter", where)
        key, given = ("fixed", entry.fixed) if entry.value is None else ("value", entry.value)
        value = to_si(given, known[name].unit, place=f"{where}.{key}")
        # A trial mass of none is 0, whatever the model says of those that are there.
        if value < 0:
            _check_sign(value, known[name].positive, f"{where}.{key}")
        std = 0.0
        if entry.std is not None:
            std = to_si(entry.std, known[name].unit, place=f"{where}.std")
            _check_deviation(std, f"{where}.std")
        found[name] = (value, std)
    return found


def _check_sign(number: float, positive: bool, place: str) -> None:
    if positive and number <= 0:
        raise InputError(
            f"{number:g}",
            "more than 0, since the model says positive = true",
            "correct one of them",
            place=place,
        )


def stated(entries: Mapping[str, ParameterEntry], model: Model, key: str) -> dict[str, float]:
    """Return what the entries state under a key, in SI; parameters without it are left out."""
    units = model.parameter_units
    given = {name: getattr(entry, key) for name, entry in entries.items()}
    return {
        name: to_si(quantity, units[name], place=f"parameters.{name}.{key}")
        for name, quantity in given.items()
        if quantity is not None
    }


def bounds(
    parameters: Mapping[str, ParameterEntry], entries: Sequence[ConstraintEntry], model: Model
) -> dict[str, tuple[float | None, float | None]]:
    """Return lower and upper bounds of parameters and of expressions, in SI."""
    low, high = (stated(parameters, model, key) for key in ("min", "max"))
    found = {name: (low.get(name), high.get(name)) for name in (*low, *high)}
    for number, entry in enumerate(entries):
        if entry.value is None:
            place = f"constraints.{number}"
            unit = unit_of_expression(entry.expression, model, place)
            lower, upper = (
                None if limit is None else to_si(limit, unit, place=f"{place}.{key}")
                for key, limit in (("min", entry.min), ("max", entry.max))
            )
            found[entry.expression] = lower, upper
    return found


def constraints(entries: Sequence[ConstraintEntry], model: Model) -> tuple[Constraint, ...]:
    """Return the constraints in SI."""
    found = []
    for number, entry in enumerate(entries):
        place = f"constraints.{number}"
        unit = unit_of_expression(entry.expression, model, place)
        if entry.value is None:
            continue
        value = to_si(entry.value, unit, place=f"{place}.value")
        std = 0.0
        if entry.std is not None:
            std = to_si(entry.std, unit, place=f"{place}.std")
            _check_deviation(std, f"{place}.std")
        found.append(Constraint(entry.expression, value, std))
    return tuple(found)


def check_once(
    parameters: Mapping[str, ParameterEntry], entries: Sequence[ConstraintEntry], model: Model
) -> None:
    """Refuse one measurement stated twice: a multiple of what has a value and a deviation already.

    Raises
    ------
    InputError
        With the constraint that comes second.
    """
    names = model.parameter_names
    known = {
        frozenset([(tuple(int(n == name) for n in names), 1.0)]): f"parameters.{name}"
        for name, entry in parameters.items()
        if entry.value is not None and entry.std is not None
    }
    for number, entry in enumerate(entries):
        if entry.value is None or entry.std is None:
            continue
        terms = {p: float(c) for p, c in polynomial(entry.expression, names).items() if c}
        largest = max(terms.items(), key=lambda term: (abs(term[1]), term[0]), default=((), 1.0))[1]
        what = frozenset((tuple(p), round(c / largest, 12)) for p, c in terms.items())
        place = f"constraints.{number}"
        if (other := known.setdefault(what, place)) != place:
            raise InputError(
                f"{entry.expression[:60]!r}, which is what {other} states, or a multiple of it",
                "each measurement once: twice it counts as two",
                "remove one; of two weighings state the mean, and its own std",
                place=place,
            )


def modes(entries: Sequence[ModeEntry], model: Model) -> tuple[Mode, ...]:
    """Return the measured natural frequencies, what was otherwise in the test in SI."""
    found = []
    for at, entry in enumerate(entries):
        place = f"modes.{at}"
        for name in entry.parameters:
            if name not in model.parameter_names:
                inner = f"{place}.parameters.{name}"
                raise unknown(name, model.parameter_names, "parameter", inner)
        told = entry.damping
        damping = None if told is None else (told.value, told.std)
        said = {name: str(value) for name, value in entry.parameters.items()}
        with naming(place=place):
            mode = Mode(entry.frequency, entry.std, damping, entry.speed, said, entry.mode)
            found.append(in_units_of(model, mode))
    return tuple(found)


def _check_deviation(std: float, place: str) -> None:
    if std <= 0:
        raise InputError(
            f"{std:g}", "a deviation of more than 0", "leave it out for an exact value", place=place
        )
