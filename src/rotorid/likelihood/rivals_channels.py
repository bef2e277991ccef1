"""Rival hypotheses on channels: sign, swap, unit, speed, factors, what a sensor reads.

A swapped column, a sign, a unit, a speed: none of these is a small change, so that no derivative
at the estimate shows it. The lines are changed as if the mistake had not been made, and the
likelihood is minimized again. What a sensor reads may hold parameters: it is upside down all the
same.

A sensor beside its plane reads an angle too, one that is not aligned reads the other axis. Its
share is no factor of a channel, but an unknown of its own in what the sensor reads.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations, permutations

import numpy as np

from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.likelihood.case import Case, Records, Rival, each_record, freed, mistake, rivals
from rotorid.likelihood.effects import Reads
from rotorid.likelihood.problem import Point
from rotorid.likelihood.rivals_tables import SPEEDS, is_table
from rotorid.likelihood.unknowns import (
    FACTORS,
    Scalar,
    Unknown,
    every_unknown,
    factor_name,
    harmonic_runouts,
    later_phases,
    multiplier,
    snap,
)
from rotorid.models import Model
from rotorid.models.structure import Structure

UNLIKE = 5.0
"""A channel this much larger or smaller than the others of its kind has perhaps another unit, and
the search for its factor starts from there."""
LIKE_CHANNELS = 8
"""Swaps are tried among groups of like channels up to this size: 28 pairs; larger groups are
sorted by the planes that the model gives them, and only neighbours are tried."""
ASKED = 4
"""Records, those that fit worst, of each of which the speed may be wrong by itself: some twenty
mistakes each; the record with the mistake is among them, as the others agree."""
BEGINS = 'write phase = "unknown" in that record, or name the column of the mark (keyphasor, angle)'
"""What to do about a record whose rotor angle begins elsewhere."""
MARKED = (
    "count the phases of that table from the mark of the first one: add that angle to them in the "
    "file; or check at which angle its trial mass sat"
)
"""What to do about a table whose phases are counted from elsewhere: no key sets them free."""
BEGINNINGS = tuple(np.deg2rad([-135.0, -90.0, -45.0, 45.0, 90.0, 135.0, 180.0]).tolist())
"""Angles from which that of a further record is looked for: half a right angle leads to it."""


def exchanged(observation: Observation, pairs: Iterable[tuple[str, str]]) -> Observation:
    names = observation.lines.names
    matrix = np.eye(len(names))
    for a, b in pairs:
        if a in names and b in names:
            i, j = names.index(a), names.index(b)
            matrix[[i, j]] = matrix[[j, i]]
    return observation.with_columns(matrix)


def multiplied(observation: Observation, factors: Mapping[str, float]) -> Observation:
    size = [factors.get(name, 1.0) for name in observation.lines.names]
    return observation.with_columns(np.diag(size))


def turning(observation: Observation, factor: float) -> Observation:
    """Let the rotor of a record turn this much faster, its phase kept as far as it is known."""
    lines = observation.lines
    speeds = np.unique(lines.speed)
    if len(speeds) != 1:  # phasors: each line has a speed of its own
        return observation
    known = lines.phase_known
    moved = replace(lines.at_speed(float(speeds[0]) * factor), phase_known=known)
    return observation.with_lines(moved)


def swap(pairs: Sequence[tuple[str, str]]) -> Rival:
    told = " and ".join(f"{a} with {b}" for a, b in pairs)
    return mistake(
        "swap[" + "; ".join(f"{a}, {b}" for a, b in pairs) + "]",
        tuple(name for pair in pairs for name in pair),
        f"the columns of {told} exchanged" if len(pairs) > 1 else f"{told} exchanged",
        "exchange their columns in [channels]",
        each_record(lambda record: exchanged(record, pairs)),
    )


def sign(names: Sequence[str]) -> Rival:
    listed = ", ".join(names)
    return mistake(
        f"sign[{listed}]",
        tuple(names),
        f"{listed} upside down",
        "turn the sign: scale = -1 (or that of ki, where the channel is a current)",
        each_record(lambda record: multiplied(record, dict.fromkeys(names, -1.0))),
        -1.0,
        "1",
    )


def unit(names: Sequence[str], label: str, gain: float) -> Rival:
    """Return the rival that some channels read `gain` times their quantity."""
    return mistake(
        f"unit[{label}]",
        (label,),
        f"{label} reading {gain:.4g} times the quantity{factor_name(gain)}",
        f"look up the unit and the scale of {label}, and give them",
        each_record(lambda record: multiplied(record, dict.fromkeys(names, 1 / gain))),
        gain,
        "1",
        kind="unit",
    )


def _gain(label: str, names: Sequence[str], start: float = 1.0) -> Rival:
    """Return the rival that some channels have a factor; of a sign or unit, that exactly."""
    unknown = multiplier(label, names, start)
    free = freed(unknown, "gain", on=(label,))

    def exactly(case: Case, point: Point) -> Iterator[Rival]:
        value = free.value_at(point)
        exact = snap(value) if value else None
        if exact == -1.0:
            yield sign(sorted(names))
        elif exact is not None and exact != 1.0:
            other = unit(sorted(names), label, exact)
            yield other if exact > 0 else replace(other, term=unknown.term, kind="mistake")

    return replace(free, sharper=exactly)


def _missing(case: Case, every: Iterable[Rival]) -> Iterator[Rival]:
    """Yield what is not estimated already."""
    for rival in every:
        names = {scalar.name for scalar in rival.added.scalars} if rival.added else set()
        if not names & case.prepared.layout.index.keys():
            yield rival


@rivals("gain")
def _gains(case: Case) -> Iterator[Rival]:
    """Yield factors of each channel, of the inputs, and of the sensors of a unit."""
    inputs = case.model.inputs
    groups = like_groups(case)
    found = {name: [name] for group in groups for name in group}
    found |= {_label(group, inputs): group for group in groups if len(group) > 1}
    yield from _missing(case, (_gain(label, names) for label, names in found.items()))


@rivals("factor")
def _typical(case: Case) -> Iterator[Rival]:
    """Yield a factor of each channel, from where it would be as large as its kind."""
    every = (_gain(name, [name], start) for name, start in typical_factors(case).items())
    yield from _missing(case, (replace(rival, way="both") for rival in every))


@rivals("channel")
def _effects(case: Case) -> Iterator[Rival]:
    """Yield what else may be unknown of channels and their force laws."""
    exact = _exact_inputs(case.records)
    for unknown in every_unknown(case.records) if case.records else ():
        if unknown.rival and not unknown.on <= exact:
            yield from _missing(case, [freed(unknown, unknown.rival)])


@rivals("channel")
def _harmonic_runout(case: Case) -> Iterator[Rival]:
    """Yield runout twice and three times per revolution of each sensor, where lines hold it."""
    return _missing(case, map(freed, harmonic_runouts(case.records)))


def _begun(case: Case, starts: Sequence[float]) -> Iterator[Rival]:
    """Yield where the rotor angle of a further record may begin."""
    for number, phase in later_phases(case.records, starts):
        cure = MARKED if is_table(case.records[number]) else BEGINS
        free = freed(replace(phase, cure=cure), on=(f"record {number + 1}",))
        yield from _missing(case, [free])


@rivals("angle")
def _angles(case: Case) -> Iterator[Rival]:
    """Yield that the rotor angle of a further record begins elsewhere."""
    return _begun(case, [0.0])


@rivals("angle far")
def _angles_far(case: Case) -> Iterator[Rival]:
    """Yield the same from angles all around."""
    return (replace(rival, way="both") for rival in _begun(case, BEGINNINGS))


def _label(group: Sequence[str], inputs: Sequence[str]) -> str:
    return "force" if group[0] in inputs else f"{group[0]} ... {group[-1]}"


def _exact_inputs(records: Records) -> set[str]:
    """Return the inputs that are what they are by definition in all records."""
    return (
        set.intersection(*(set(exact_inputs(record)) for record in records)) if records else set()
    )


def exact_inputs(record: Observation) -> frozenset[str]:
    """Return the inputs that are what they are by definition, 1 or 0: nothing is wrong with them.

    They have no noise; a factor of one would be a factor of rounding.
    """
    if not record.lines.passive:
        return frozenset()
    variance = np.einsum("kii->ki", record.lines.covariance.matrices).real.max(axis=0)
    named = zip(record.inputs, record.input_columns, strict=True)
    return frozenset(channel.name for channel, column in named if variance[column] == 0)


def like_groups(case: Case) -> list[list[str]]:
    """Return inputs of one unit, then sensors of one unit: what can be mistaken for another."""
    if not case.records:
        return []
    record, model = case.records[0], case.model
    exact = exact_inputs(record)
    groups: dict[tuple[str, int, str], list[str]] = {}
    for channel in record.inputs:
        if channel.name not in exact:
            groups.setdefault(("input", 0, model.units[channel.name]), []).append(channel.name)
    for sensor in (*record.direct, *record.indirect):
        measured = sensor.channel.unit or model.units[model.coordinates[sensor.terms[0].coordinate]]
        groups.setdefault(("sensor", sensor.order, measured), []).append(sensor.channel.name)
    return list(groups.values())


def typical_factors(case: Case) -> dict[str, float]:
    """Return by what each channel would be as large as its kind; 1 where it is, by `UNLIKE`."""
    lines = case.records[0].lines
    size = np.sqrt((np.abs(lines.mean) ** 2).mean(axis=0))
    found = {}
    for group in like_groups(case):
        sizes = {name: float(size[lines.names.index(name)]) for name in group}
        middle = float(np.median(list(sizes.values())))
        for name, each in sizes.items():
            ratio = middle / each if each > 0 else 1.0
            found[name] = ratio if ratio > UNLIKE or ratio < 1 / UNLIKE else 1.0
    return found


def planes(case: Case) -> list[tuple[str, str]]:
    """Return pairs of channels that see, or push, the same place in x and in y."""
    structure, model = case.structure, case.model
    if structure is None:
        return []
    turn = structure.turn()
    found = _turned_pairs(_read(case), turn)
    linear = model.linear
    if linear is not None:
        pushed = {name: np.zeros(len(model.coordinates)) for name in model.inputs}
        to = {int(row): k for k, row in enumerate(structure.balance.rows)}
        for term in linear.input_terms:
            if term.row in to and model.monomials[term.monomial].sum() == 0:
                pushed[model.inputs[term.input]][to[term.row]] = term.coefficient
        found += _turned_pairs(pushed, turn, loose=True)
    return found


def _read(case: Case) -> dict[str, Floats]:
    """Return what each sensor reads of the coordinates at the estimate, direct ones first."""
    record, values = case.records[0], np.asarray(case.values)
    rows = {}
    for sensor in (*record.direct, *record.indirect):
        rows[sensor.channel.name] = row = np.zeros(len(case.model.coordinates))
        for term in sensor.terms:
            row[term.coordinate] += term.coefficient * np.prod(values ** np.array(term.powers))
    return rows


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


@rivals("single")
def _single_swaps(case: Case) -> Iterator[Rival]:
    pairs = planes(case)
    for group in like_groups(case):
        both = list(combinations(group, 2))
        if len(group) > LIKE_CHANNELS:
            both = [p for p in both if p in pairs or group.index(p[1]) - group.index(p[0]) == 1]
        yield from (swap([p]) for p in both)


@rivals("single")
def _single_signs(case: Case) -> Iterator[Rival]:
    yield from (sign([name]) for group in like_groups(case) for name in group)


@rivals("several")
def _swapped_planes(case: Case) -> Iterator[Rival]:
    """Yield whole planes exchanged, and x with y everywhere."""
    pairs = planes(case)
    for group in like_groups(case):
        inner = [p for p in pairs if p[0] in group and p[1] in group]
        yield from (swap([(p[0], q[0]), (p[1], q[1])]) for p, q in combinations(inner, 2))
        if len(inner) > 1:
            yield swap(inner)


@rivals("several")
def _signs(case: Case) -> Iterator[Rival]:
    """Yield whole planes, each axis, and all channels of a kind upside down."""
    pairs = planes(case)
    yield from (sign(pair) for pair in pairs)
    for group in like_groups(case):
        inner = [p for p in pairs if p[0] in group and p[1] in group]
        if len(inner) > 1:
            yield sign([p[0] for p in inner])
            yield sign([p[1] for p in inner])
        if len(group) > 2 or (len(group) == 2 and not inner):
            yield sign(group)


@rivals("several")
def _units(case: Case) -> Iterator[Rival]:
    """Yield units of all inputs together, and of all sensors of one unit.

    The unit of one channel is found by its factor.
    """
    sizes = dict.fromkeys(f for x in FACTORS.values() for f in (x, 1 / x))
    for group in like_groups(case):
        if len(group) > 1:
            yield from (unit(group, _label(group, case.model.inputs), f) for f in sizes)


@rivals("single")
def _speeds(case: Case) -> Iterator[Rival]:
    """Yield mistaken units of the speed, its direction, and speeds that the data show.

    Of all records alike, and of each record that may show another.
    """
    records, shown = case.records, _speeds_of_lines(case)
    every = [np.unique(record.lines.speed) for record in records]
    given = {k: float(speeds[0]) for k, speeds in enumerate(every) if len(speeds) == 1}
    if len(given) == len(records):  # no tables: see `rivals_tables`
        alike = len(set(given.values())) == 1
        seen = [speed for speeds in shown.values() for speed in speeds] if alike else ()
        yield from _mistaken(given, list(dict.fromkeys(seen)), "")
    for number in [k for k in shown if k in given and len(records) > 1]:
        yield from _mistaken({number: given[number]}, shown[number], f"record {number + 1}")


def _speeds_of_lines(case: Case) -> dict[int, list[float]]:
    """Return the speeds of the nearest line and of the worst, which may be the rotor's own.

    Of the records that fit worst, by their numbers; of none before there is an estimate.
    """
    if case.values is None:
        return {}
    found, pairs = {}, list(zip(case.records, case.point.records, strict=True))
    misfit = [-float(np.mean(at.line_costs)) for _, at in pairs]
    for number in np.argsort(misfit, kind="stable")[:ASKED].tolist():
        record, at = pairs[number]
        frequency = record.lines.frequency
        given = np.abs(record.lines.speed).mean() / (2 * np.pi)
        nearest = int(np.abs(frequency - given).argmin())
        order = [nearest, *np.argsort(-at.line_costs)[:2].tolist()]
        worst = [2 * np.pi * float(frequency[k]) for k in order if frequency[k] > 0]
        found[number] = list(dict.fromkeys(worst))
    return found


def _mistaken(given: Mapping[int, float], shown: Sequence[float], which: str) -> Iterator[Rival]:
    """Yield what the speeds of some records may be instead, by one mistake with all of them."""
    now, where = next(iter(given.values())), f" of {which}" if which else ""
    for said, factor in (("the right one", 1.0), *SPEEDS.items()) if now else ():
        for way in (1.0, -1.0):
            if factor * way == 1.0:
                continue
            text = f"the rotor{where} turning the other way" if way < 0 else ""
            if factor != 1.0:
                reversed_too = ", and its direction reversed" if way < 0 else ""
                text = f"the speed{where} {said}{reversed_too}"
            right = {k: speed * factor * way for k, speed in given.items()}
            yield _speed(text, given, right, which)
    for speed in shown:
        text = f"a speed{where} of {speed * 30 / np.pi:.6g} rpm, which the data show"
        for told, size in ((text, speed), (f"{text}, the other way", -speed)):
            yield _speed(told, given, dict.fromkeys(given, size), which)


def speed_term(number: int | None = None) -> str:
    return "speed" if number is None else f"speed[{number}]"


def _speed(text: str, given: Mapping[int, float], right: Mapping[int, float], which: str) -> Rival:
    def change(records: Records) -> list[Observation]:
        return [
            _turned(record, given[k], right[k]) if k in given else record
            for k, record in enumerate(records)
        ]

    speeds = list(dict.fromkeys(right.values()))
    told = ", ".join(f"{speed * 30 / np.pi:.6g}" for speed in speeds)
    each = " one after the other" if len(speeds) > 1 else ""
    where = f" of {which}" if which else ""
    return mistake(
        speed_term(next(iter(given)) if which else None),
        (which,) if which else (),
        text,
        f"correct speed{where} (or the lines of the encoder): {told} rpm{each} would do",
        change,
        speeds[0] if len(speeds) == 1 else None,
        "rad/s" if len(speeds) == 1 else "",
        kind="speed",
    )


def _turned(record: Observation, now: float, speed: float) -> Observation:
    if now:
        return turning(record, speed / now)
    return record.with_lines(record.lines.at_speed(speed))


def shown_speed(records: Records) -> Rival | None:
    """Return the rival that the rotation is the one that the lines of records show."""
    ratios = [_ratio(record) for record in records]
    others = [ratio for ratio in ratios if ratio != 1.0]
    if not others:
        return None
    first = ratios.index(others[0])
    speed = float(np.abs(records[first].lines.speed).mean()) * ratios[first]
    which = f"record {first + 1}" if len(others) < len(records) else ""
    where = f" of {which}" if which else ""
    told = f"{speed * 30 / np.pi:.6g} rpm ({speed / (2 * np.pi):.6g} Hz)"
    return mistake(
        speed_term(),
        (which,) if which else (),
        f"a speed{where} of {told}, which its lines show",
        f"correct speed: {told}",
        lambda chosen: [turning(r, x) for r, x in zip(chosen, ratios, strict=True)],
        speed,
        "rad/s",
        kind="speed",
    )


def _ratio(record: Observation) -> float:
    """Return the speed that a record shows over the one stated; 1 where that is as stated."""
    shown, stated = record.lines.shown, float(record.lines.speed[0])
    return 1.0 if shown is None or stated == 0 else shown / stated


@rivals("single")
def _positions(case: Case) -> Iterator[Rival]:
    """Yield another displacement in the force law of each input that holds a current."""
    for channel in case.records[0].inputs:
        if channel.drive is None or not channel.drive.ks:
            continue
        for other in case.model.coordinates:
            if case.model.units[other] == "m" and dict(channel.drive.position) != {other: 1.0}:
                yield mistake(
                    f"position[{channel.name}]",
                    (channel.name,),
                    f"the force law of {channel.name} at {other}",
                    f'set position = "{other}" of {channel.name} in [channels]',
                    each_record(partial(_driven_at, name=channel.name, other=other)),
                )


def _driven_at(record: Observation, name: str, other: str) -> Observation:
    inputs = tuple(
        replace(c, drive=replace(c.drive, position={other: 1.0}))
        if c.name == name and c.drive is not None
        else c
        for c in record.inputs
    )
    return replace(record, inputs=inputs)


Shares = Mapping[str, tuple[int, float]]
"""What sensors read more for a share of one: of which coordinate, and how much of it."""


def _share(
    term: str, unit: str, said: str, shares: Shares, on: tuple[str, ...], given: float = 0.0
) -> Rival:
    unknown = Unknown(
        (Scalar(term, unit, 0.0, additive=True),),
        frozenset(shares),
        tuple(Reads(name, *more) for name, more in shares.items()),
        phrase=said,
        cure="correct reads in [channels], or turn the sensor",
        size=lambda values: given + float(values[0]),
    )
    return freed(unknown, on=on)


@rivals("reads")
def _shares(case: Case) -> Iterator[Rival]:
    """Yield sensors out of their plane, cross-talk, and planes whose axes are turned."""
    structure, model = case.structure, case.model
    if structure is None or not case.records:
        return
    turn, every = structure.turn(), _read(case)
    partner = {k: int(np.abs(turn[k]).argmax()) for k in range(len(turn)) if turn[k].any()}
    still = [s.channel.name for s in case.records[0].sensors if s.order == 0]
    reads = {name: row for name, row in every.items() if name in still and np.isfinite(row).all()}
    for name, row in reads.items():
        lengths = [k for k in np.flatnonzero(row) if model.units[model.coordinates[k]] == "m"]
        if len(lengths) != 1 or lengths[0] not in partner:
            continue
        seen, size = int(lengths[0]), float(row[lengths[0]])
        for angle in _tilts(model, structure, seen):
            label = model.coordinates[angle]
            said = f"{name} beside its plane: it reads {label} too, with the lever"
            shares = {name: (angle, 1.0)}
            yield _share(f"plane[{name}]", "m", said, shares, (name,), float(row[angle]))
        other = partner[seen]
        label = model.coordinates[other]
        said = f"cross-talk from {label} into {name}: its share"
        term = f"crosstalk[{name}, {label}]"
        yield _share(term, "1", said, {name: (other, size)}, (name, label))
    yield from _beside_planes(model, reads, structure)
    yield from _rotations(reads, structure)


def _beside_planes(
    model: Model, reads: Mapping[str, Floats], structure: Structure
) -> Iterator[Rival]:
    """Yield planes of which both sensors, and all sensors, are further along the shaft."""
    turn, found = structure.turn(), list[tuple[str, str, int, dict[str, tuple[int, float]]]]()
    for (one, row), (other, partner) in permutations(reads.items(), 2):
        lengths = [k for k in np.flatnonzero(row) if model.units[model.coordinates[k]] == "m"]
        image = turn @ row
        side = float(np.sign(image @ partner))
        if len(lengths) != 1 or not image.any() or not np.allclose(side * image, partner):
            continue
        for angle in _tilts(model, structure, int(lengths[0])):
            lever = np.zeros(len(row))
            lever[angle] = row[lengths[0]]
            across = side * turn @ lever
            beside = int(np.abs(across).argmax())
            both = {one: (angle, float(lever[angle])), other: (beside, float(across[beside]))}
            if across[beside] and (other, one) not in {(a, b) for a, b, _, _ in found}:
                found.append((one, other, angle, both))
    for one, other, _, both in found:
        said = f"{one} and {other} beside their plane: they read angles too, with the lever"
        yield _share(f"plane[{one}, {other}]", "m", said, both, (one, other))
    for angle in dict.fromkeys(angle for _, _, angle, _ in found):
        every = [both for _, _, at, both in found if at == angle]
        shares = {name: share for both in every for name, share in both.items()}
        if len(every) > 1:
            said = "all sensors further along the shaft than stated, by"
            yield _share(f"plane[{', '.join(shares)}]", "m", said, shares, tuple(shares))


def _tilts(model: Model, structure: Structure, seen: int) -> list[int]:
    """Return the angles in the plane of a displacement: its slope, or those that a spring ties."""
    if seen in structure.slopes:
        return [structure.slopes[seen]]
    angles = [
        k for pair in structure.pairs for k in pair if model.units[model.coordinates[k]] != "m"
    ]
    tied = [k for k in angles if any(abs(m[seen, k]) > 0 for _, m in structure.springs)]
    return tied or angles


def _rotations(reads: Mapping[str, Floats], structure: Structure) -> Iterator[Rival]:
    """Yield planes whose two sensors are turned together, by an angle in rad."""
    single = {int(np.flatnonzero(r)[0]): n for n, r in reads.items() if (r != 0).sum() == 1}
    for a, b in structure.pairs:
        if a in single and b in single:
            one, other = single[a], single[b]
            said = f"the axes of {one} and {other} turned by the angle"
            shares = {one: (b, 1.0), other: (a, -1.0)}
            yield _share(f"rotation[{one}, {other}]", "rad", said, shares, (one, other))
