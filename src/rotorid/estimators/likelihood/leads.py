"""Mistakes that an experiment file may hold, each with what undoes it on the lines of a record.

A swapped column, a sign, a unit, a speed: none of these is a small change, so that no derivative
at the estimate shows it. The lines are changed as if the mistake had not been made, and the
likelihood is minimized again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rotorid.estimators.likelihood.candidates import Structure
from rotorid.estimators.likelihood.passage import with_columns
from rotorid.frozen import frozen
from rotorid.observation import Observation, Sensor
from rotorid.record import Floats

Undo = Callable[[Sequence[Observation]], list[Observation]]

GROSS = 3.0
"""Cost over its expectation from which on mistakes that are no small changes are tried: no swap,
sign or unit of a channel that says anything costs less."""
FACTORS = {
    "mil instead of um, um instead of mil, or inches instead of mm": 25.4,
    "mm instead of um, or mA instead of A": 1e3,
    "m instead of um, or uA instead of A": 1e6,
    "degrees instead of radians": 180 / np.pi,
    "rms instead of amplitude": np.sqrt(2),
    "peak to peak instead of amplitude": 2.0,
    "inches instead of m": 1 / 0.0254,
    "pounds-force instead of N": 1 / 4.4482216152605,
    "kilograms-force instead of N": 1 / 9.80665,
    "ten times": 10.0,
}
"""Factors by which a reading is off where a unit was mistaken; each may be its inverse."""
SNAP = 0.03
"""A free factor this close to that of a unit is taken for it: calibrations are off by less."""
UNLIKE = 5.0
"""A channel this much larger or smaller than the others of its kind has perhaps another unit, and
the search for its factor starts from there."""
SPEEDS = {
    "rad/s taken for rpm": 60 / (2 * np.pi),
    "rpm taken for rad/s": 2 * np.pi / 60,
    "Hz taken for rpm": 60.0,
    "rpm taken for Hz": 1 / 60,
    "rad/s taken for Hz": 1 / (2 * np.pi),
    "Hz taken for rad/s": 2 * np.pi,
    "twice the true one": 0.5,
    "half the true one": 2.0,
}
"""True speed over the given one, where a unit or a number of lines was mistaken."""
LIKE_CHANNELS = 8
"""Swaps are tried among groups of like channels up to this size: 28 pairs; larger groups are
sorted by the planes that the model gives them, and only neighbours are tried."""


@frozen
class Lead:
    """One mistake, and what undoes it.

    Parameters
    ----------
    term : str
        ``swap[x1, y1]``, ``sign[x1]``, ``speed``.
    said : str
        What is the matter, for people.
    cure : str
        What to do.
    undo : callable
        From the records as they are to records without the mistake.
    value : float or None
        What is right instead of what was given, in `unit`.
    """

    term: str
    said: str
    cure: str
    undo: Undo
    value: float | None = None
    unit: str = ""


def exchanged(observation: Observation, pairs: Iterable[tuple[str, str]]) -> Observation:
    """Exchange the columns of pairs of channels."""
    names = observation.lines.names
    matrix = np.eye(len(names))
    for a, b in pairs:
        if a in names and b in names:
            i, j = names.index(a), names.index(b)
            matrix[[i, j]] = matrix[[j, i]]
    return with_columns(observation, matrix)


def multiplied(observation: Observation, factors: Mapping[str, float]) -> Observation:
    """Multiply the columns of some channels."""
    size = [factors.get(name, 1.0) for name in observation.lines.names]
    return with_columns(observation, np.diag(size))


def turning(observation: Observation, factor: float) -> Observation:
    """Let the rotor of a record turn this much faster, its phase kept as far as it is known."""
    lines = observation.lines
    speeds = np.unique(lines.speed)
    if len(speeds) != 1:  # phasors: each line has a speed of its own
        return observation
    known = lines.phase_known
    moved = replace(lines.at_speed(float(speeds[0]) * factor), phase_known=known)
    return observation.with_lines(moved)


def _each(change: Callable[[Observation], Observation]) -> Undo:
    return lambda records: [change(record) for record in records]


def swap(pairs: Sequence[tuple[str, str]]) -> Lead:
    """Return the lead that the columns of some pairs of channels are exchanged."""
    term = "swap[" + "; ".join(f"{a}, {b}" for a, b in pairs) + "]"
    told = " and ".join(f"{a} with {b}" for a, b in pairs)
    return Lead(
        term,
        f"the columns of {told} exchanged" if len(pairs) > 1 else f"{told} exchanged",
        "exchange their columns in [channels]",
        _each(lambda record: exchanged(record, pairs)),
    )


def sign(names: Sequence[str]) -> Lead:
    """Return the lead that some channels are upside down."""
    listed = ", ".join(names)
    return Lead(
        f"sign[{listed}]",
        f"{listed} upside down",
        "turn the sign: scale = -1 (or that of ki, where the channel is a current)",
        _each(lambda record: multiplied(record, dict.fromkeys(names, -1.0))),
        -1.0,
        "1",
    )


def unit(names: Sequence[str], label: str, gain: float) -> Lead:
    """Return the lead that some channels read `gain` times their quantity."""
    return Lead(
        f"unit[{label}]",
        f"{label} reading {gain:.4g} times the quantity{factor_name(gain)}",
        f"look up the unit and the scale of {label}, and give them",
        _each(lambda record: multiplied(record, dict.fromkeys(names, 1 / gain))),
        gain,
        "1",
    )


def factor_name(gain: float) -> str:
    """Say which unit was mistaken where a gain is that of one, and whether it is upside down."""
    name, _ = _nearest(abs(gain)) or ("", 1.0)
    told = [name] if name else []
    if gain < 0:
        told.append("upside down")
    return f" ({', '.join(told)})" if told else ""


def snap(gain: float) -> float | None:
    """Return the sign and unit factor that a gain is close to, or None."""
    near = _nearest(abs(gain))
    return None if near is None else float(np.copysign(near[1], gain))


def _nearest(size: float) -> tuple[str, float] | None:
    """Return the unit whose factor is nearest to a size, with that factor; None where none is."""
    factors = [("", 1.0), *((n, way) for n, f in FACTORS.items() for way in (f, 1 / f))]
    name, exact = min(factors, key=lambda known: abs(size / known[1] - 1))
    return (name, exact) if abs(size / exact - 1) < SNAP else None


def exact_inputs(record: Observation) -> frozenset[str]:
    """Return the inputs that are what they are by definition, 1 or 0: nothing is wrong with them.

    They have no noise; a factor of one would be a factor of rounding.
    """
    if not record.lines.passive:
        return frozenset()
    variance = np.einsum("kii->ki", record.lines.covariance.matrices).real.max(axis=0)
    named = zip(record.inputs, record.input_columns, strict=True)
    return frozenset(channel.name for channel, column in named if variance[column] == 0)


def like_groups(record: Observation) -> list[list[str]]:
    """Return inputs of one unit, then sensors of one unit: what can be mistaken for another."""
    model, exact = record.model, exact_inputs(record)
    groups: dict[tuple[str, str], list[str]] = {}
    for channel in record.inputs:
        if channel.name in exact:
            continue
        groups.setdefault(("input", model.units[channel.name]), []).append(channel.name)
    for sensor in record.direct:
        groups.setdefault(("sensor", sensor.channel.unit or _unit(record, sensor)), []).append(
            sensor.channel.name
        )
    return list(groups.values())


def _unit(record: Observation, sensor: Sensor) -> str:
    return record.model.units[record.model.coordinates[sensor.terms[0].coordinate]]


def factor_groups(record: Observation) -> dict[str, list[str]]:
    """Return what may have a factor of its own: each channel, the inputs, the sensors of a unit."""
    groups = like_groups(record)
    found = {name: [name] for group in groups for name in group}
    inputs = [channel.name for channel in record.inputs]
    for group in groups:
        if len(group) > 1:
            found["force" if group[0] in inputs else f"{group[0]} ... {group[-1]}"] = group
    return found


def typical_factors(record: Observation) -> dict[str, float]:
    """Return by what each channel would be as large as its kind; 1 where it is, by `UNLIKE`."""
    names = record.lines.names
    size = np.sqrt((np.abs(record.lines.mean) ** 2).mean(axis=0))
    found = {}
    for group in like_groups(record):
        sizes = {name: float(size[names.index(name)]) for name in group}
        middle = float(np.median(list(sizes.values())))
        for name, amount in sizes.items():
            ratio = middle / amount if amount > 0 else 1.0
            found[name] = ratio if ratio > UNLIKE or ratio < 1 / UNLIKE else 1.0
    return found


def planes(record: Observation, structure: Structure | None) -> list[tuple[str, str]]:
    """Return pairs of channels that see, or push, the same place in x and in y."""
    if structure is None:
        return []
    turn = structure.turn()
    rows: dict[str, Floats] = {}
    for sensor, reads in zip(record.direct, record.reads, strict=True):
        rows[sensor.channel.name] = reads
    found = _turned_pairs(rows, turn)
    model = record.model
    linear = model.linear
    if linear is not None:
        pushed = {name: np.zeros(len(model.coordinates)) for name in model.inputs}
        to = {int(row): k for k, row in enumerate(structure.balance.rows)}
        for term in linear.input_terms:
            if term.row in to and model.monomials[term.monomial].sum() == 0:
                pushed[model.inputs[term.input]][to[term.row]] = term.coefficient
        found += _turned_pairs(pushed, turn, loose=True)
    return found


def _turned_pairs(
    rows: Mapping[str, Floats], turn: Floats, *, loose: bool = False
) -> list[tuple[str, str]]:
    """Pair what a turn by a right angle carries into one another; `loose`: by their pattern."""
    found = []
    for (a, one), (b, other) in combinations(rows.items(), 2):
        image = turn @ one
        if not image.any():
            continue
        if loose:
            image, other = (image != 0).astype(float), (other != 0).astype(float)
        if np.allclose(image, other) or np.allclose(image, -other):
            found.append((a, b))
    return found


def discrete_leads(
    records: Sequence[Observation],
    structure: Structure | None,
    speeds: Mapping[int, Sequence[float]],
) -> tuple[list[Lead], list[Lead]]:
    """Return swaps, signs and speeds, then swaps, signs and units of several channels.

    `speeds` are those that the data show, by the number of the record. The unit of one channel is
    found by its factor.
    """
    record = records[0]
    pairs = planes(record, structure)
    single, several = _swaps(record, pairs)
    signs = [sign([name]) for group in like_groups(record) for name in group]
    return [*single, *signs, *_speeds(records, speeds), *_positions(record)], [
        *several,
        *_signs(record, pairs),
        *_units(record),
    ]


def _swaps(record: Observation, pairs: Sequence[tuple[str, str]]) -> tuple[list[Lead], list[Lead]]:
    """Return swaps of two like channels; then of whole planes, and of x with y everywhere."""
    single, several = [], []
    for group in like_groups(record):
        both = list(combinations(group, 2))
        if len(group) > LIKE_CHANNELS:
            both = [p for p in both if p in pairs or group.index(p[1]) - group.index(p[0]) == 1]
        single += [swap([p]) for p in both]
        inner = [p for p in pairs if p[0] in group and p[1] in group]
        several += [swap([(p[0], q[0]), (p[1], q[1])]) for p, q in combinations(inner, 2)]
        if len(inner) > 1:
            several.append(swap(inner))
    return single, several


def _signs(record: Observation, pairs: Sequence[tuple[str, str]]) -> list[Lead]:
    """Return signs of whole planes, of each axis, and of all channels of a kind."""
    found = [sign(pair) for pair in pairs]
    for group in like_groups(record):
        inner = [p for p in pairs if p[0] in group and p[1] in group]
        if len(inner) > 1:
            found += [sign([p[0] for p in inner]), sign([p[1] for p in inner])]
        if len(group) > 2 or (len(group) == 2 and not inner):
            found.append(sign(group))
    return found


def _positions(record: Observation) -> list[Lead]:
    """Return another displacement in the force law of each input that holds a current."""
    found = []
    for channel in record.inputs:
        if channel.drive is None or not channel.drive.ks:
            continue
        for other in record.model.coordinates:
            if record.model.units[other] == "m" and dict(channel.drive.position) != {other: 1.0}:
                found.append(_position(channel.name, other))
    return found


def _position(name: str, other: str) -> Lead:
    """Return the lead of another displacement in one force law."""

    def undo(record: Observation) -> Observation:
        inputs = tuple(
            replace(c, drive=replace(c.drive, position={other: 1.0}))
            if c.name == name and c.drive is not None
            else c
            for c in record.inputs
        )
        return replace(record, inputs=inputs)

    said = f"the force law of {name} at {other}"
    cure = f'set position = "{other}" of {name} in [channels]'
    return Lead(f"position[{name}]", said, cure, _each(undo))


def _units(record: Observation) -> list[Lead]:
    """Return units of all inputs together, and of all sensors of one unit."""
    found = []
    inputs = [channel.name for channel in record.inputs]
    for group in like_groups(record):
        if len(group) < 2:
            continue
        label = "force" if group[0] in inputs else f"{group[0]} ... {group[-1]}"
        sizes = dict.fromkeys(f for x in FACTORS.values() for f in (x, 1 / x))
        found += [unit(group, label, f) for f in sizes]
    return found


def _speeds(records: Sequence[Observation], shown: Mapping[int, Sequence[float]]) -> list[Lead]:
    """Return mistaken units of the speed, its direction, and speeds that the data show.

    Of all records alike, and of each record that may show another.
    """
    every = [np.unique(record.lines.speed) for record in records]
    given = {k: float(speeds[0]) for k, speeds in enumerate(every) if len(speeds) == 1}
    found = []
    if len(given) == len(records):  # no tables: see `table_leads`
        alike = len(set(given.values())) == 1
        seen = [speed for speeds in shown.values() for speed in speeds] if alike else ()
        found += _mistaken(given, list(dict.fromkeys(seen)), "")
    for number in [k for k in shown if k in given and len(records) > 1]:
        where = f" of record {number + 1}"
        found += _mistaken({number: given[number]}, shown[number], where)
    return found


def _mistaken(given: Mapping[int, float], shown: Sequence[float], where: str) -> list[Lead]:
    """Return what the speeds of some records may be instead, by one mistake with all of them."""
    found, now = [], next(iter(given.values()))
    for said, factor in (("the right one", 1.0), *SPEEDS.items()) if now else ():
        for way in (1.0, -1.0):
            if factor * way == 1.0:
                continue
            text = f"the rotor{where} turning the other way" if way < 0 else ""
            if factor != 1.0:
                reversed_too = ", and its direction reversed" if way < 0 else ""
                text = f"the speed{where} {said}{reversed_too}"
            right = {k: speed * factor * way for k, speed in given.items()}
            found.append(_speed(text, given, right, where))
    for speed in shown:
        text = f"a speed{where} of {speed * 30 / np.pi:.6g} rpm, which the data show"
        for told, size in ((text, speed), (f"{text}, the other way", -speed)):
            found.append(_speed(told, given, dict.fromkeys(given, size), where))
    return found


def _speed(text: str, given: Mapping[int, float], right: Mapping[int, float], where: str) -> Lead:
    """Return the lead of other speeds of some records."""

    def undo(records: Sequence[Observation]) -> list[Observation]:
        return [
            _turned(record, given[k], right[k]) if k in given else record
            for k, record in enumerate(records)
        ]

    speeds = list(dict.fromkeys(right.values()))
    told = ", ".join(f"{speed * 30 / np.pi:.6g}" for speed in speeds)
    each = " one after the other" if len(speeds) > 1 else ""
    cure = f"correct speed{where} (or the lines of the encoder): {told} rpm{each} would do"
    term = f"speed[{next(iter(given))}]" if where else "speed"
    value = speeds[0] if len(speeds) == 1 else None
    return Lead(term, text, cure, undo, value, "" if value is None else "rad/s")


def _turned(record: Observation, now: float, speed: float) -> Observation:
    """Return a record at another speed than it was said to be."""
    if now:
        return turning(record, speed / now)
    return record.with_lines(record.lines.at_speed(speed))
