"""Rival hypotheses on what was read: of channels and their laws, of whole records and of lines.

Lines are changed as if the mistake had not been made, and the likelihood is minimized again. The
unit of the speeds of a table is no such mistake: time itself may run faster or slower, and no table
tells (see `rotorid.likelihood.doubts`, which holds the answer against its start).

A line that something else makes contradicts all others, whatever is freed in the model. By how much
the cost falls without it, `Linearized.without` tells to first order: no refit is needed to find it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from rotorid.core.values import Complexes, Floats
from rotorid.data.lines import PhasorClock, SilentClock, Window
from rotorid.data.observation import Observation, Records
from rotorid.likelihood.case import Case, Rival, each_record, freed, rivals
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.effects import Reads, Replaces, of_kind
from rotorid.likelihood.problem import Point
from rotorid.likelihood.unknowns import (
    FACTORS,
    Scalar,
    Unknown,
    factor_name,
    harmonic_runouts,
    later_phases,
    multiplier,
    snap,
    unknowns_of,
)
from rotorid.likelihood.whitening import as_complex
from rotorid.models.rotor import RotorModel
from rotorid.models.structure import Structure

UNLIKE = 5.0
"""A channel this much larger or smaller than the others of its kind has perhaps another unit, and
the search for its factor starts from there."""
LIKE_CHANNELS = 8
"""Swaps are tried among groups of like channels up to this size: 28 pairs; larger groups are
sorted by the planes that the model gives them, and only neighbours are tried."""


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


def _swap(pairs: Sequence[tuple[str, str]]) -> Rival:
    told, on = " and ".join(f"{a} with {b}" for a, b in pairs), tuple(n for p in pairs for n in p)
    term = f"swap[{'; '.join(f'{a}, {b}' for a, b in pairs)}]"
    said = f"the columns of {told} exchanged" if len(pairs) > 1 else f"{told} exchanged"
    change = each_record(partial(exchanged, pairs=pairs))
    return Rival(term, said, "exchange their columns in [channels]", change, on=on)


def _sign(names: Sequence[str]) -> Rival:
    listed = ", ".join(names)
    cure = "turn the sign: scale = -1 beside the column (of a current, in its table)"
    turned = each_record(partial(multiplied, factors=dict.fromkeys(names, -1.0)))
    said = f"{listed} upside down"
    return Rival(f"sign[{listed}]", said, cure, turned, -1.0, "1", on=tuple(names))


def _unit(names: Sequence[str], label: str, gain: float) -> Rival:
    """Return the rival that some channels read `gain` times their quantity."""
    said = f"{label} reading {gain:.4g} times the quantity{factor_name(gain)}"
    either = "all forces or currents, or of all positions"  # ratios of the two are the same
    whole = either if label == "force" else label
    cure = f"look up the unit and the scale of {whole}, and give them"
    scaled = each_record(partial(multiplied, factors=dict.fromkeys(names, 1 / gain)))
    return Rival(f"unit[{label}]", said, cure, scaled, gain, "1", on=(label,), kind="unit")


def _gain(unknown: Unknown, label: str) -> Rival:
    """Return the rival that some channels have a factor; of a sign or unit, that exactly."""
    free, names = freed(unknown, "gain", (label,)), sorted(unknown.on)

    def exactly(case: Case, point: Point) -> Iterator[Rival]:
        value = free.value_at(point)
        exact = snap(value) if value else None
        if exact == -1.0:
            yield _sign(names)
        elif exact is not None and exact != 1.0:
            other = _unit(names, label, exact)
            yield other if exact > 0 else replace(other, term=unknown.term, kind="mistake")

    return replace(free, sharper=exactly)


@rivals("gain")
def _gains(case: Case) -> Iterator[Rival]:
    groups = _like_groups(case)
    found = {name: [name] for group in groups for name in group}
    found |= {_label(case, group): group for group in groups if len(group) > 1}
    yield from (_gain(multiplier(label, names), label) for label, names in found.items())


@rivals("factor")
def _typical(case: Case) -> Iterator[Rival]:
    """Yield a factor of each channel, from where it would be as large as its kind."""
    lines = case.records[0].lines
    size = dict(zip(lines.names, np.sqrt((np.abs(lines.mean) ** 2).mean(axis=0)), strict=True))
    for group in _like_groups(case):
        middle = float(np.median([size[name] for name in group]))
        for name in group:
            ratio = float(middle / size[name]) if size[name] > 0 else 1.0
            start = 1.0 if 1 / UNLIKE <= ratio <= UNLIKE else ratio
            yield replace(_gain(multiplier(name, [name], start), name), way="both")


@rivals("channel")
def _effects(case: Case) -> Iterator[Rival]:
    if case.records:
        exact = set.intersection(*(_exact_inputs(record) for record in case.records))
        for unknown in unknowns_of(case.records):
            if unknown.rival and not unknown.on <= exact:
                yield freed(unknown, unknown.rival)
    yield from map(freed, harmonic_runouts(case.records))


def _label(case: Case, group: Sequence[str]) -> str:
    return "force" if group[0] in case.model.inputs else f"{group[0]} ... {group[-1]}"


def _exact_inputs(record: Observation) -> set[str]:
    """Return the inputs that are 1 or 0 by definition: a factor of one is a factor of rounding."""
    lines = record.lines
    variance = np.einsum("kii->ki", lines.covariance.matrices).real.max(axis=0)
    known = (variance == 0) & lines.passive | ~lines.mean.any(axis=0)
    named = zip(record.inputs, record.input_columns, strict=True)
    return {channel.name for channel, column in named if known[column]}


def _like_groups(case: Case) -> list[list[str]]:
    """Return inputs of one unit, then sensors of one unit: what can be mistaken for another."""
    if not case.records:
        return []
    record, model = case.records[0], case.model
    exact = _exact_inputs(record)
    groups: dict[tuple[str, int, str], list[str]] = {}
    for channel in record.inputs:
        if channel.name not in exact:
            groups.setdefault(("input", 0, model.units[channel.name]), []).append(channel.name)
    for sensor in (*record.direct, *record.indirect):
        measured = sensor.channel.unit or model.units[model.coordinates[sensor.terms[0].coordinate]]
        groups.setdefault(("sensor", sensor.order, measured), []).append(sensor.channel.name)
    return list(groups.values())


def planes(case: Case) -> list[tuple[str, str]]:
    """Return pairs of channels that see, or push, the same place in x and in y."""
    structure, model = case.structure, case.model
    if structure is None:
        return []
    constant = (~model.monomials.any(axis=1)).astype(float)
    acting = model.require_linear().input_matrix(constant)[structure.balance.rows] != 0
    pushed = dict(zip(model.inputs, acting.T.astype(float), strict=True))
    # Sensors by what they read, inputs by the pattern of what they push.
    turn = structure.turn()
    kinds = (turn, _read(case)), (np.abs(turn), pushed)
    return [(a, b) for by, of in kinds for a, b in combinations(of, 2) if quarter(by, of[a], of[b])]


def quarter(turn: Floats, one: Floats, other: Floats) -> float:
    """Return the sign with which a turn by a right angle carries one into the other; 0: none."""
    image = turn @ one
    side = float(np.sign(image @ other))
    return side if image.any() and np.allclose(side * image, other) else 0.0


def _read(case: Case) -> dict[str, Floats]:
    record, values = case.records[0], np.asarray(case.values)
    rows = {}
    for sensor in (*record.direct, *record.indirect):
        rows[sensor.channel.name] = row = np.zeros(len(case.model.coordinates))
        for term in sensor.terms:
            row[term.coordinate] += term.coefficient * np.prod(values ** np.array(term.powers))
    return rows


def _groups_with_planes(case: Case) -> Iterator[tuple[list[str], list[tuple[str, str]]]]:
    pairs = planes(case)
    for group in _like_groups(case):
        yield group, [pair for pair in pairs if {*pair} <= {*group}]


@rivals("single")
def _single(case: Case) -> Iterator[Rival]:
    for group, pairs in _groups_with_planes(case):
        both = list(combinations(group, 2))
        if len(group) > LIKE_CHANNELS:
            both = [p for p in both if p in pairs or group.index(p[1]) - group.index(p[0]) == 1]
        yield from (_swap([p]) for p in both)
    yield from (_sign([name]) for group in _like_groups(case) for name in group)


@rivals("several")
def _several(case: Case) -> Iterator[Rival]:
    """Yield planes exchanged or upside down, x for y, all of a kind upside down or in a unit."""
    groups = list(_groups_with_planes(case))
    for _, pairs in groups:
        yield from (_swap([(p[0], q[0]), (p[1], q[1])]) for p, q in combinations(pairs, 2))
        if len(pairs) > 1:
            yield _swap(pairs)
    yield from (_sign(pair) for pair in planes(case))
    for group, pairs in groups:
        if len(pairs) > 1:
            yield from (_sign(axis) for axis in zip(*pairs, strict=True))
        if len(group) > 2 or (len(group) == 2 and not pairs):
            yield _sign(group)
    sizes = dict.fromkeys(f for x in FACTORS.values() for f in (x, 1 / x))
    for group, _ in groups:
        if len(group) > 1:
            yield from (_unit(group, _label(case, group), size) for size in sizes)


@rivals("single")
def _positions(case: Case) -> Iterator[Rival]:
    model, places = case.model, set(case.model.coordinates)
    if isinstance(model, RotorModel):  # those that the drawing names: nobody writes another
        places &= {c for node in model.rotor.nodes if node.named for c in node.coordinates}
    lengths = [name for name in model.coordinates if name in places and model.units[name] == "m"]
    for channel in case.records[0].inputs:
        if channel.drive is None or not channel.drive.ks:
            continue
        for other in lengths:
            if dict(channel.drive.position) != {other: 1.0}:
                said = f"the force law of {channel.name} at {other}"
                cure = f'set position = "{other}" of {channel.name} in [channels]'
                change = each_record(partial(_driven_at, name=channel.name, other=other))
                yield Rival(f"position[{channel.name}]", said, cure, change, on=(channel.name,))


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
    kind: str, unit: str, said: str, shares: Shares, given: float = 0.0, beside: Sequence[str] = ()
) -> Rival:
    on = (*shares, *beside)
    unknown = Unknown(
        (Scalar(f"{kind}[{', '.join(on)}]", unit, 0.0, additive=True),),
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
    turn = structure.turn()
    lengths = np.array([model.units[name] == "m" for name in model.coordinates])
    still = {s.channel.name for s in case.records[0].sensors if s.order == 0}
    rows = {n: row for n, row in _read(case).items() if n in still and np.isfinite(row).all()}
    # The one displacement that each sensor reads, of those that read one.
    seen = {n: np.flatnonzero((row != 0) & lengths).tolist() for n, row in rows.items()}
    place = {name: each[0] for name, each in seen.items() if len(each) == 1}
    tilts = {k: _tilts(structure, k, lengths.tolist()) for k in place.values()}
    for name, k in place.items():
        if not turn[k].any():
            continue
        for angle in tilts[k]:
            label = model.coordinates[angle]
            said = f"{name} beside its plane: it reads {label} too, with the lever"
            yield _share("plane", "m", said, {name: (angle, 1.0)}, float(rows[name][angle]))
        other = int(np.abs(turn[k]).argmax())
        label = model.coordinates[other]
        said = f"cross-talk from {label} into {name}: its share"
        yield _share("crosstalk", "1", said, {name: (other, float(rows[name][k]))}, 0.0, [label])
    yield from _beside_planes(rows, place, tilts, turn)
    single = {int(np.flatnonzero(r)[0]): n for n, r in rows.items() if (r != 0).sum() == 1}
    pairs = [(a, b) for a, b in structure.pairs if a in single and b in single]
    turned = [{single[a]: (b, 1.0), single[b]: (a, -1.0)} for a, b in pairs]
    if len(turned) > 1:  # all against the magnets, which no pair by itself shows
        turned.append({name: share for each in turned for name, share in each.items()})
    for shares in turned:
        said = f"the axes of {' and '.join(shares)} turned by the angle"
        yield _share("rotation", "rad", said, shares)


def _tilts(structure: Structure, seen: int, lengths: Sequence[bool]) -> list[int]:
    """Return the angles in the plane of a displacement: its slope, or those that a spring ties."""
    if seen in structure.slopes:
        return [structure.slopes[seen]]
    angles = [k for pair in structure.pairs for k in pair if not lengths[k]]
    tied = [k for k in angles if any(abs(m[seen, k]) > 0 for _, m in structure.springs)]
    return tied or angles


def _beside_planes(
    rows: Mapping[str, Floats],
    place: Mapping[str, int],
    tilts: Mapping[int, Sequence[int]],
    turn: Floats,
) -> Iterator[Rival]:
    """Yield planes of which both sensors, and all sensors, are further along the shaft."""
    found: list[tuple[int, Shares]] = []
    for one, other in combinations(rows, 2):
        side = quarter(turn, rows[one], rows[other])
        for angle in tilts[place[one]] if side and one in place else ():
            size = float(rows[one][place[one]])
            across = side * size * turn[:, angle]
            beside = int(np.abs(across).argmax())
            if across[beside]:
                found.append((angle, {one: (angle, size), other: (beside, float(across[beside]))}))
    for _, shares in found:
        said = f"{' and '.join(shares)} beside their plane: they read angles too, with the lever"
        yield _share("plane", "m", said, shares)
    for angle in dict.fromkeys(angle for angle, _ in found):
        every = [shares for at, shares in found if at == angle]
        if len(every) > 1:
            said = "all sensors further along the shaft than stated, by"
            together = {name: share for shares in every for name, share in shares.items()}
            yield _share("plane", "m", said, together)


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
ASKED = 4
"""Records, those that fit worst, of each of which the speed may be wrong by itself: some twenty
mistakes each; the record with the mistake is among them, as the others agree."""


@rivals("single")
def _speeds(case: Case) -> Iterator[Rival]:
    shown = _speeds_of_lines(case)
    every = [np.unique(record.lines.speed) for record in case.records]
    given = {k: float(speeds[0]) for k, speeds in enumerate(every) if len(speeds) == 1}
    if len(given) == len(every):  # no tables
        alike = len(set(given.values())) == 1
        seen = [speed for speeds in shown.values() for speed in speeds] if alike else ()
        yield from _mistaken(given, list(dict.fromkeys(seen)), "")
    for number in [k for k in shown if k in given and len(every) > 1]:
        yield from _mistaken({number: given[number]}, shown[number], f"record {number + 1}")


def _speeds_of_lines(case: Case) -> dict[int, list[float]]:
    """Return, of the records that fit worst, the speeds of the nearest line and of the worst."""
    if case.values is None:
        return {}
    found, costs = {}, [at.line_costs for at in case.point.records]
    for number in worst_records(case):
        lines = case.records[number].lines
        given = np.abs(lines.speed).mean() / (2 * np.pi)
        nearest = int(np.abs(lines.frequency - given).argmin())
        order = [nearest, *np.argsort(-costs[number])[:2].tolist()]
        hertz = (float(lines.frequency[k]) for k in order)
        found[number] = list(dict.fromkeys(2 * np.pi * f for f in hertz if f > 0))
    return found


def worst_records(case: Case) -> list[int]:
    means = [-float(np.mean(at.line_costs)) for at in case.point.records]
    return [int(k) for k in np.argsort(means, kind="stable")[:ASKED]]


def _mistaken(given: Mapping[int, float], shown: Sequence[float], which: str) -> Iterator[Rival]:
    where = f" of {which}" if which else ""
    backward = f"the rotor{where} turning the other way, or x and y exchanged in every channel"
    factors = {backward: -1.0}
    for said, factor in SPEEDS.items():
        factors[f"the speed{where} {said}"] = factor
        factors[f"the speed{where} {said}, and its direction reversed"] = -factor
    right = [(s, {k: v * f for k, v in given.items()}) for s, f in factors.items()]
    right = right if next(iter(given.values())) else []
    for speed in shown:
        said = f"a speed{where} of {_rpm(speed)} rpm, which the data show"
        right.append((said, dict.fromkeys(given, speed)))
        right.append((f"{said}, the other way", dict.fromkeys(given, -speed)))
    for said, speeds in right:
        values = list(dict.fromkeys(speeds.values()))
        told = ", ".join(map(_rpm, values)) + " rpm"
        value, each = (values[0], "") if len(values) == 1 else (None, " one after the other")
        cure = f"correct speed{where} (or the lines of the encoder): {told}{each} would do"
        term = f"speed[{next(iter(given))}]" if which else "speed"
        yield _speed(term, said, cure, speeds, which, value)


def _rpm(speed: float) -> str:
    return f"{speed * 30 / np.pi:.6g}"


def _speed(
    term: str, said: str, cure: str, right: Mapping[int, float], which: str, value: float | None
) -> Rival:
    def change(case: Case) -> Case:
        numbered = enumerate(case.records)
        return case.reading([turned(r, right[k]) if k in right else r for k, r in numbered])

    on, unit = (which,) if which else (), "" if value is None else "rad/s"
    return Rival(term, said, cure, change, value, unit, on, "speed")


def turned(record: Observation, speed: float) -> Observation:
    """Let the rotor of a record turn at another speed, its phase kept as far as it is known."""
    lines, moved = record.lines, record.lines.at_speed(speed)
    known = lines.phase_known or not lines.speed.any()
    return record.with_lines(replace(moved, phase_known=known))


def shown_speed(records: Records) -> Rival | None:
    given = [(k, r.lines.shown, float(r.lines.speed[0])) for k, r in enumerate(records)]
    right = {k: shown for k, shown, said in given if shown and said and shown != said}
    if not right:
        return None
    first, shown = next(iter(right.items()))
    speed = float(np.copysign(1.0, given[first][2])) * shown
    which = f"record {first + 1}" if len(right) < len(records) else ""
    told = f"{_rpm(speed)} rpm ({speed / (2 * np.pi):.6g} Hz)"
    said = f"a speed{f' of {which}' if which else ''} of {told}, which its lines show"
    return _speed("speed", said, f"correct speed: {told}", right, which, speed)


BEGINNINGS = tuple(np.deg2rad([-135.0, -90.0, -45.0, 45.0, 90.0, 135.0, 180.0]).tolist())
"""Angles from which that of a further record is looked for: half a right angle leads to it."""


@rivals("angle")
def _angles(case: Case, starts: Sequence[float] = (0.0,)) -> Iterator[Rival]:
    for number, phase in later_phases(case.records, starts):
        cure = f'write phase = "unknown" in that record, or {phase.held}'
        if is_table(case.records[number]):  # no key sets its phases free
            cure = (
                "count the phases of that table from the mark of the first one: add that angle to "
                "them in the file; or check at which angle its trial mass sat"
            )
        yield freed(replace(phase, cure=cure), on=(f"record {number + 1}",))


@rivals("angle far")
def _angles_far(case: Case) -> Iterator[Rival]:
    return (replace(rival, way="both") for rival in _angles(case, BEGINNINGS))


WINDOWS: Mapping[Window, tuple[tuple[complex, complex], ...]] = {
    "rectangular": ((1.0, 1.0),),
    "hann": tuple(((1 - w) / 2, np.sqrt(2 / 3) * np.pi * (1 - w)) for w in (1j, -1j)),
}
"""What windows show in place of ``H(s)``, lines df apart: sums of ``c H(s + a df)``, (c, a).

At its own lines a rectangular window adds df to the rate of each decay that ends within a block.
Hann's averages H over about a line, here by ``1 / (1 + (f / b)^4)`` with b^2 = df^2 / 3, its mean
square width: right for resonances that are wider, and to a fourth for those of half a line."""
KINDS = ("positions", "velocities", "accelerations")


def is_response(record: Observation) -> bool:
    return isinstance(record.lines.clock, SilentClock)


def is_table(record: Observation) -> bool:
    return isinstance(record.lines.clock, PhasorClock)


@rivals("table")
def _row(case: Case) -> Iterator[Rival]:
    if not (tables := [k for k, record in enumerate(case.records) if is_table(record)]):
        return
    number = max(tables, key=lambda k: float(case.point.records[k].line_costs.max()))
    row = int(case.point.records[number].line_costs.argmax())
    speed = float(case.records[number].lines.speed[row])
    said = f"the row at {_rpm(speed)} rpm{_of_record(case, number)}"
    cure = "check its speed and its readings, or leave it out"
    yield Rival("row", said, cure, partial(without, number=number, line=row))


def _of_record(case: Case, number: int) -> str:
    return f" of record {number + 1}" if len(case.records) > 1 else ""


@rivals("table")
def _all_rows(case: Case) -> Iterator[Rival]:
    tables = [record for record in case.records if is_table(record)]
    if not tables or not case.gross:
        return
    names = [s.channel.name for s in tables[0].sensors]
    yield _lag("phases that count", "their channels", is_table, names)
    said, cure = "phases in radians taken for degrees", 'set phase_unit = "rad" in the channels'
    yield Rival("phase_unit", said, cure, each_record(_radians, is_table))
    said, cure = "the rotor turning the other way", "turn the sign of the speed"
    yield Rival("speed", said, cure, each_record(_reversed, is_table), kind="speed")
    for name in names if len(names) > 1 else ():
        said, where = f"the phase of {name} counting", f"the channel of {name}"
        yield replace(_lag(said, where, is_table, [name]), term=f"lag[{name}]", on=(name,))


@rivals("table")
def _responses(case: Case) -> Iterator[Rival]:
    responses = [record for record in case.records if is_response(record)]
    orders = {s.order for record in responses for s in record.sensors}
    if not orders or not case.gross:
        return
    for order in range(len(KINDS)) if len(orders) == 1 else ():
        (read,) = orders
        if order != read:
            said = f"responses of {KINDS[order]}, where {KINDS[read]} are said to be read"
            cure = f'write reads = "x{chr(39) * order}" in channels of names of their own'
            change = each_record(partial(_shifted, order=read - order), is_response)
            yield Rival("derivative", said, cure, change, float(order))
    every = [name for record in responses for name in record.lines.names]
    yield _lag("phases that count", "the channels", is_response, every)
    said = "all responses upside down, as where the force sensor or the shaker is turned about"
    cure = "set scale = -1 in each channel of the responses, or turn the force sensor"
    turned = each_record(partial(_shifted, order=0, sign=-1.0), is_response)
    yield Rival("sign[force]", said, cure, turned, on=("force",))


@rivals("table")
def _windows(case: Case) -> Iterator[Rival]:
    for window in WINDOWS:
        pairs = zip(case.point.records, case.records, strict=True)
        if any(blurred(at, record, window) is not None for at, record in pairs):
            said = f"what a {window} window does to resonances that are narrow beside its lines"
            cure = "measure finer lines, or with bursts or impacts that end within their block"
            yield Rival(f"window[{window}]", said, cure, partial(_sharpened, window=window))


def _sharpened(case: Case, window: Window) -> Case:
    """Return a case whose responses are without what a window does to the machine as found."""
    records = list[Observation]()
    for at, record in zip(case.point.records, case.records, strict=True):
        factor = np.ones(record.lines.mean.shape, dtype=np.complex128)
        if (error := blurred(at, record, window)) is not None:
            read = at.read_at(as_complex(np.ones_like(record.lines.omega)))
            factor[:, at.problem.order[at.forces :]] = read / (read + error)
        matrices = record.lines.covariance.matrices
        records.append(_with(record, record.lines.mean * factor, matrices))
    return case.reading(records)


def blurred(at: Evaluation, record: Observation, window: Window) -> Complexes | None:
    """Return by what a window that may have been there moves readings, (line, sensor)."""
    made, omega = record.lines.analyser, record.lines.omega
    if made is None or not made.spacing or made.window not in (None, window):
        return None
    error = -at.read_at(as_complex(np.ones_like(omega)))
    for share, shift in WINDOWS[window]:
        error += share * at.read_at(as_complex(1 + shift * made.spacing / (1j * omega)))
    return error


def _lag(said: str, where: str, of: Callable[[Observation], bool], names: Sequence[str]) -> Rival:
    """Return the rival that the phases of some channels count the other way."""

    def change(record: Observation) -> Observation:
        lines, matrices = record.lines, record.lines.covariance.matrices
        turned = np.isin(lines.names, names)
        both, neither = (np.outer(each, each) for each in (turned, ~turned))
        # One turned and one not: no covariance of the two is left.
        matrices = np.where(both, matrices.conj(), np.where(neither, matrices, 0.0))
        return _with(record, np.where(turned, lines.mean.conj(), lines.mean), matrices)

    cure = f"set lag = true in {where}, or take it out where it stands"
    return Rival("lag", f"{said} the other way, lag for lead", cure, each_record(change, of))


def _with(record: Observation, mean: Complexes, matrices: Complexes) -> Observation:
    covariance = replace(record.lines.covariance, matrices=matrices)
    return record.with_lines(replace(record.lines, mean=mean, covariance=covariance))


def _shifted(record: Observation, order: int, sign: float = 1.0) -> Observation:
    """Return a record with its sensors' lines times ``sign (i omega)^order``."""
    factor = np.ones(record.lines.mean.shape, dtype=np.complex128)
    columns = [sensor.column for sensor in record.sensors]
    factor[:, columns] = sign * (1j * record.lines.omega[:, None]) ** order
    matrices = record.lines.covariance.matrices * factor[:, :, None] * factor[:, None, :].conj()
    return _with(record, record.lines.mean * factor, matrices)


def _radians(record: Observation) -> Observation:
    """Take phases that were read as degrees for radians."""
    lines, read = record.lines, [s.column for s in record.sensors]
    mean = lines.mean.copy()
    mean[:, read] *= np.exp(1j * np.angle(mean[:, read]) * (180 / np.pi - 1))
    return _with(record, mean, lines.covariance.matrices)


def _reversed(record: Observation) -> Observation:
    """Let the rotor turn the other way, its phasors as they are."""
    lines = record.lines
    back = replace(lines, speed=-lines.speed, clock=PhasorClock(-lines.speed))
    return _with(record.with_lines(back), lines.mean.conj(), lines.covariance.matrices.conj())


HOLDS = 0.5  # share of the excess misfit, at least, that leaving out one line takes away
FORGOTTEN = 1e12  # factor on the covariance of a line that takes no part any more
ORDERS = 3  # orders of the rotation whose lines are left to runout and unbalance
BESIDE = 0.25  # share of the distance of lines within which one is an order of the rotation
MAINS = (50.0, 60.0)  # frequencies of the mains, Hz
ON = 1e-3
"""Distance from a multiple of the mains, relative, within which a line is theirs: they are held to
4e-3 at worst, and to 1e-3 in all but a few hours."""


@rivals("line")
def _line(case: Case) -> Iterator[Rival]:
    """Yield that one line of the records is wrong, if leaving it out helps enough.

    Asked last: with a wrong speed, or without its damping, a model fits all lines but one.
    """
    drop, number, line = max(_drops(case), default=(0.0, 0, 0))
    if not drop > HOLDS * (case.point.cost - case.expected):
        return
    hertz = float(case.records[number].lines.frequency[line])
    where = f"{hertz:.6g} Hz{_of_record(case, number)}"
    said = f"the line at {where}, {source(hertz)}, left out"
    cure = "leave it out of the harmonics, or stop its source"
    change = partial(without, number=number, line=line)
    yield Rival(f"line {where}", said, cure, change, kind="omission")


def source(hertz: float) -> str:
    for mains in MAINS:
        multiple = round(hertz / mains)
        if multiple and abs(hertz / mains - multiple) < ON * multiple:
            return "where hum of the mains stands"
    return "which something else makes, such as a base that shakes or another machine"


def without(case: Case, number: int, line: int) -> Case:
    records = list(case.records)
    matrices = records[number].lines.covariance.matrices.copy()
    matrices[line] *= FORGOTTEN
    records[number] = _with(records[number], records[number].lines.mean, matrices)
    return case.reading(records)


def _drops(case: Case) -> Iterator[tuple[float, int, int]]:
    """Yield by how much the cost falls without each line, its record and its which."""
    rows = case.point.by_line(np.arange(len(case.point.residual)))
    for number, (record, own) in enumerate(zip(case.records, rows, strict=True)):
        lines = record.lines
        turns = float(np.abs(lines.speed).mean()) / (2 * np.pi)
        orders = np.abs(lines.frequency[:, None] - np.arange(ORDERS + 1) * turns)
        apart = (orders > BESIDE * np.diff(lines.frequency).min(initial=np.inf)).all(axis=1)
        for k in np.flatnonzero(apart).tolist() if lines.scatter is not None else ():
            yield case.point.linear.without(own[k]), number, k


MOST = 6  # pairs of records of which an exchange is tried, at the most: of four runs all


@rivals("trial")
def _exchanges(case: Case) -> Iterator[Rival]:
    own = [u for u in case.prepared.layout.nuisances if of_kind(Replaces, u.effects)]
    stated = {unknown.record for unknown in own if unknown.scalars[0].std is not None}
    kinds = [(record.lines.names, record.lines.passive) for record in case.records]
    pairs = combinations(range(len(kinds)), 2)
    alike = [(i, j) for i, j in pairs if stated & {i, j} and kinds[i] == kinds[j]]
    for i, j in alike[:MOST]:
        order = list(range(len(kinds)))
        order[i], order[j] = j, i
        on = f"record {i + 1}", f"record {j + 1}"
        said = f"the files of records {i + 1} and {j + 1} exchanged"
        cure = "exchange their files, or what [records.parameters] says of the two"
        yield Rival(f"swap[{', '.join(on)}]", said, cure, partial(_in_order, order=order), on=on)


def _in_order(case: Case, order: Sequence[int]) -> Case:
    return case.reading([case.records[k] for k in order])
