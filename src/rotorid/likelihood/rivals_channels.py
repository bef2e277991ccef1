"""Rival hypotheses on channels: sign, swap, unit, factors, force laws, what a sensor reads.

Lines are changed as if the mistake had not been made, and the likelihood is minimized again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.likelihood.case import Case, Rival, each_record, freed, mistake, not_asked, rivals
from rotorid.likelihood.effects import Reads
from rotorid.likelihood.problem import Point
from rotorid.likelihood.unknowns import (
    FACTORS,
    Scalar,
    Unknown,
    factor_name,
    harmonic_runouts,
    multiplier,
    snap,
    unknowns_of,
)
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
    told = " and ".join(f"{a} with {b}" for a, b in pairs)
    return mistake(
        "swap[" + "; ".join(f"{a}, {b}" for a, b in pairs) + "]",
        f"the columns of {told} exchanged" if len(pairs) > 1 else f"{told} exchanged",
        "exchange their columns in [channels]",
        each_record(partial(exchanged, pairs=pairs)),
        on=tuple(name for pair in pairs for name in pair),
    )


def _sign(names: Sequence[str]) -> Rival:
    listed = ", ".join(names)
    cure = "turn the sign: scale = -1 (or that of ki, where the channel is a current)"
    turned = each_record(partial(multiplied, factors=dict.fromkeys(names, -1.0)))
    said = f"{listed} upside down"
    return mistake(f"sign[{listed}]", said, cure, turned, -1.0, "1", on=tuple(names))


def _unit(names: Sequence[str], label: str, gain: float) -> Rival:
    """Return the rival that some channels read `gain` times their quantity."""
    said = f"{label} reading {gain:.4g} times the quantity{factor_name(gain)}"
    cure = f"look up the unit and the scale of {label}, and give them"
    scaled = each_record(partial(multiplied, factors=dict.fromkeys(names, 1 / gain)))
    return mistake(f"unit[{label}]", said, cure, scaled, gain, "1", on=(label,), kind="unit")


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
    for label, names in found.items():
        for unknown in not_asked(case, [multiplier(label, names)]):
            yield _gain(unknown, label)


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
            for unknown in not_asked(case, [multiplier(name, [name], start)]):
                yield replace(_gain(unknown, name), way="both")


@rivals("channel")
def _effects(case: Case) -> Iterator[Rival]:
    if case.records:
        exact = set.intersection(*(_exact_inputs(record) for record in case.records))
        for unknown in not_asked(case, unknowns_of(case.records)):
            if unknown.rival and not unknown.on <= exact:
                yield freed(unknown, unknown.rival)
    for runout in not_asked(case, harmonic_runouts(case.records)):
        yield freed(runout)


def _label(case: Case, group: Sequence[str]) -> str:
    return "force" if group[0] in case.model.inputs else f"{group[0]} ... {group[-1]}"


def _exact_inputs(record: Observation) -> set[str]:
    """Return the inputs that are 1 or 0 by definition: a factor of one is a factor of rounding."""
    if not record.lines.passive:
        return set()
    variance = np.einsum("kii->ki", record.lines.covariance.matrices).real.max(axis=0)
    named = zip(record.inputs, record.input_columns, strict=True)
    return {channel.name for channel, column in named if variance[column] == 0}


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
    pushed = {name: np.zeros(len(model.coordinates)) for name in model.inputs}
    to = {int(row): k for k, row in enumerate(structure.balance.rows)}
    for term in model.require_linear().input_terms:
        if term.row in to and model.monomials[term.monomial].sum() == 0:
            pushed[model.inputs[term.input]][to[term.row]] = 1.0
    # Sensors by what they read, inputs by the pattern of what they push.
    turn = structure.turn()
    kinds = (turn, _read(case)), (np.abs(turn), pushed)
    return [(a, b) for by, of in kinds for a, b in combinations(of, 2) if _side(by, of[a], of[b])]


def _side(turn: Floats, one: Floats, other: Floats) -> float:
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
    for channel in case.records[0].inputs:
        if channel.drive is None or not channel.drive.ks:
            continue
        for other in case.model.coordinates:
            if case.model.units[other] == "m" and dict(channel.drive.position) != {other: 1.0}:
                yield mistake(
                    f"position[{channel.name}]",
                    f"the force law of {channel.name} at {other}",
                    f'set position = "{other}" of {channel.name} in [channels]',
                    each_record(partial(_driven_at, name=channel.name, other=other)),
                    on=(channel.name,),
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
    for a, b in structure.pairs:
        if a in single and b in single:
            said = f"the axes of {single[a]} and {single[b]} turned by the angle"
            yield _share("rotation", "rad", said, {single[a]: (b, 1.0), single[b]: (a, -1.0)})


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
        side = _side(turn, rows[one], rows[other])
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
