"""Rival hypotheses on whole records: speed, where the angle begins, phases of tables, single lines.

The unit of the speeds of a table is none of them: time itself may run faster or slower, and no
table tells (see `rotorid.likelihood.doubts`, which holds the answer against its start).

A line that something else makes contradicts all others, whatever is freed in the model. Without it,
its covariance beyond all bounds, the cost falls by r_k' (1 - H_k)^-1 r_k to first order, r_k its
rows of the residual and H_k what the unknowns can do there: no refit is needed to find it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from rotorid.core.values import Complexes
from rotorid.data.lines import PhasorClock, SilentClock
from rotorid.data.observation import Observation
from rotorid.likelihood.case import (
    Case,
    Records,
    Rival,
    each_record,
    freed,
    mistake,
    not_asked,
    rivals,
)
from rotorid.likelihood.effects import Replaces, of_kind
from rotorid.likelihood.unknowns import later_phases

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
    for number in np.argsort([-np.mean(c) for c in costs], kind="stable")[:ASKED].tolist():
        lines = case.records[number].lines
        given = np.abs(lines.speed).mean() / (2 * np.pi)
        nearest = int(np.abs(lines.frequency - given).argmin())
        order = [nearest, *np.argsort(-costs[number])[:2].tolist()]
        hertz = (float(lines.frequency[k]) for k in order)
        found[number] = list(dict.fromkeys(2 * np.pi * f for f in hertz if f > 0))
    return found


def _mistaken(given: Mapping[int, float], shown: Sequence[float], which: str) -> Iterator[Rival]:
    where = f" of {which}" if which else ""
    factors = {f"the rotor{where} turning the other way": -1.0}
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
        yield _speed(said, cure, given, speeds, which, value)


def _rpm(speed: float) -> str:
    return f"{speed * 30 / np.pi:.6g}"


def _speed(
    said: str,
    cure: str,
    given: Mapping[int, float],
    right: Mapping[int, float],
    which: str,
    value: float | None,
) -> Rival:
    def change(case: Case) -> Case:
        records = list(case.records)
        for k in given:
            records[k] = turned(records[k], given[k], right[k])
        return case.reading(records)

    term = f"speed[{next(iter(given))}]" if which and len(given) == 1 else "speed"
    on, unit = (which,) if which else (), "" if value is None else "rad/s"
    return mistake(term, said, cure, change, value, unit, on=on, kind="speed")


def turned(record: Observation, now: float, speed: float) -> Observation:
    """Let the rotor of a record turn at another speed, its phase kept as far as it is known."""
    lines = record.lines
    if not now:
        return record.with_lines(lines.at_speed(speed))
    speeds = np.unique(lines.speed)
    if len(speeds) != 1:  # phasors: each line has a speed of its own
        return record
    moved = lines.at_speed(float(speeds[0]) * (speed / now))
    return record.with_lines(replace(moved, phase_known=lines.phase_known))


def shown_speed(records: Records) -> Rival | None:
    given = {k: float(record.lines.speed[0]) for k, record in enumerate(records)}
    right = {k: records[k].lines.shown or v if v else v for k, v in given.items()}
    others = [k for k in given if right[k] != given[k]]
    if not others:
        return None
    first = others[0]
    speed = abs(given[first]) * right[first] / given[first]
    which = f"record {first + 1}" if len(others) < len(records) else ""
    told = f"{_rpm(speed)} rpm ({speed / (2 * np.pi):.6g} Hz)"
    said = f"a speed{f' of {which}' if which else ''} of {told}, which its lines show"
    return _speed(said, f"correct speed: {told}", given, right, which, speed)


BEGINS = 'write phase = "unknown" in that record, or name the column of the mark (keyphasor, angle)'
"""What to do about a record whose rotor angle begins elsewhere."""
MARKED = (
    "count the phases of that table from the mark of the first one: add that angle to them in the "
    "file; or check at which angle its trial mass sat"
)
"""What to do about a table whose phases are counted from elsewhere: no key sets them free."""
BEGINNINGS = tuple(np.deg2rad([-135.0, -90.0, -45.0, 45.0, 90.0, 135.0, 180.0]).tolist())
"""Angles from which that of a further record is looked for: half a right angle leads to it."""


@rivals("angle")
def _angles(case: Case, starts: Sequence[float] = (0.0,)) -> Iterator[Rival]:
    for number, phase in later_phases(case.records, starts):
        cure = MARKED if is_table(case.records[number]) else BEGINS
        for unknown in not_asked(case, [replace(phase, cure=cure)]):
            yield freed(unknown, on=(f"record {number + 1}",))


@rivals("angle far")
def _angles_far(case: Case) -> Iterator[Rival]:
    return (replace(rival, way="both") for rival in _angles(case, BEGINNINGS))


KINDS = ("positions", "velocities", "accelerations")


def is_response(record: Observation) -> bool:
    return isinstance(record.lines.clock, SilentClock)


def is_table(record: Observation) -> bool:
    return isinstance(record.lines.clock, PhasorClock)


@rivals("table")
def _row(case: Case) -> Iterator[Rival]:
    tables = [k for k, record in enumerate(case.records) if is_table(record)]
    if not tables:
        return
    number = max(tables, key=lambda k: float(case.point.records[k].line_costs.max()))
    row = int(case.point.records[number].line_costs.argmax())
    speed = float(case.records[number].lines.speed[row])
    said = f"the row at {_rpm(speed)} rpm{_of_record(case, number)}"
    cure = "check its speed and its readings, or leave it out"
    yield mistake("row", said, cure, partial(without, number=number, line=row))


def _of_record(case: Case, number: int) -> str:
    return f" of record {number + 1}" if len(case.records) > 1 else ""


@rivals("table")
def _all_rows(case: Case) -> Iterator[Rival]:
    tables = [record for record in case.records if is_table(record)]
    if not tables or not case.gross:
        return
    names, of = [s.channel.name for s in tables[0].sensors], partial(each_record, of=is_table)
    yield _lag("phases that count", "their channels", of, names)
    said, cure = "phases in radians taken for degrees", 'set phase_unit = "rad" in the channels'
    yield mistake("phase_unit", said, cure, of(_radians))
    said, cure = "the rotor turning the other way", "turn the sign of the speed"
    yield mistake("speed", said, cure, of(_reversed), kind="speed")
    for name in names if len(names) > 1 else ():
        said, where = f"the phase of {name} counting", f"the channel of {name}"
        yield replace(_lag(said, where, of, [name]), term=f"lag[{name}]", on=(name,))


@rivals("table")
def _responses(case: Case) -> Iterator[Rival]:
    responses = [record for record in case.records if is_response(record)]
    orders = {s.order for record in responses for s in record.sensors}
    if not orders or not case.gross:
        return
    of = partial(each_record, of=is_response)
    for order in range(len(KINDS)) if len(orders) == 1 else ():
        (said,) = orders
        if order != said:
            yield mistake(
                "derivative",
                f"responses of {KINDS[order]}, where {KINDS[said]} are said to be read",
                f'write reads = "x{chr(39) * order}" in channels of names of their own',
                of(partial(_shifted, order=said - order)),
                float(order),
            )
    every = [name for record in responses for name in record.lines.names]
    yield _lag("phases that count", "the channels", of, every)
    yield mistake(
        "sign[force]",
        "all responses upside down, as where the force sensor or the shaker is turned about",
        "set scale = -1 in each channel of the responses, or turn the force sensor",
        of(partial(_shifted, order=0, sign=-1.0)),
        on=("force",),
    )


Change = Callable[[Observation], Observation]


def _lag(
    said: str,
    where: str,
    of: Callable[[Change], Callable[[Case], Case]],
    names: Sequence[str],
) -> Rival:
    """Return the rival that the phases of some channels count the other way."""

    def change(record: Observation) -> Observation:
        lines, matrices = record.lines, record.lines.covariance.matrices
        turned = np.isin(lines.names, names)
        both, neither = (np.outer(each, each) for each in (turned, ~turned))
        # One turned and one not: no covariance of the two is left.
        matrices = np.where(both, matrices.conj(), np.where(neither, matrices, 0.0))
        return _with(record, np.where(turned, lines.mean.conj(), lines.mean), matrices)

    cure = f"set lag = true in {where}, or take it out where it stands"
    return mistake("lag", f"{said} the other way, lag for lead", cure, of(change))


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
    lines, mean = record.lines, record.lines.mean.copy()
    sensors = [s.column for s in record.sensors]
    angle = np.angle(lines.mean[:, sensors]) * (180 / np.pi)
    mean[:, sensors] = np.abs(lines.mean[:, sensors]) * np.exp(1j * angle)
    return record.with_lines(replace(lines, mean=mean))


def _reversed(record: Observation) -> Observation:
    """Let the rotor turn the other way, its phasors as they are."""
    lines = record.lines
    back = replace(lines, speed=-lines.speed, clock=PhasorClock(-lines.speed))
    return _with(record.with_lines(back), lines.mean.conj(), lines.covariance.matrices.conj())


HOLDS = 0.5
"""Share of the excess misfit, at least, that leaving out one line takes away."""
FORGOTTEN = 1e12
"""Factor on the covariance of a line that takes no part any more."""
ORDERS = 3
"""Orders of the rotation whose lines are left to runout and unbalance."""
BESIDE = 0.25
"""Share of the distance of lines within which one is an order of the rotation."""
MAINS = (50.0, 60.0)
"""Frequencies of the mains, Hz."""
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
    yield mistake(f"line {where}", said, cure, change, kind="omission")


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


MOST = 6
"""Pairs of records of which an exchange is tried, at the most: of four runs all."""


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
        yield mistake(
            f"swap[record {i}, record {j}]",
            f"the files of records {i + 1} and {j + 1} exchanged",
            "exchange their files, or what [records.parameters] says of the two",
            partial(_in_order, order=order),
            on=(f"record {i + 1}", f"record {j + 1}"),
        )


def _in_order(case: Case, order: Sequence[int]) -> Case:
    return case.reading([case.records[k] for k in order])
