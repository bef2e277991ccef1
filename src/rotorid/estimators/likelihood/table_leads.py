"""Mistakes of a table of phasors: how its phases count, their unit, and the sense of the rotation.

The unit of the speeds is none of them: time itself may run faster or slower, and no table tells.
See `scale_of_time`, which holds the answer against its start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.leads import SPEEDS, Lead
from rotorid.estimators.likelihood.line_leads import without
from rotorid.estimators.likelihood.nuisances import Unknown
from rotorid.estimators.likelihood.refits import Case
from rotorid.estimators.likelihood.response_leads import is_response
from rotorid.estimators.likelihood.unknowns import Layout
from rotorid.lines import Lines, PhasorClock
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats
from rotorid.units import dimension_of

FAR = 30.0
"""Factor by which a stiffness is off its start, at least, before the unit of speed is doubted: of
the units that are mistaken, rad/s for Hz changes it least, by 39."""
NEAR = 3.0
"""Factor within which the answer lies about its start once the unit is put right."""
SURE = 1000.0
"""Factor of a stiffness from which on the answer is turned away: rpm for Hz, 3600; nobody's start
is off by so much and right in every parameter but for the one factor of time."""


def is_table(record: Observation) -> bool:
    """Tell whether a record is a table of phasors."""
    return isinstance(record.lines.clock, PhasorClock)


def table_leads(case: Case, gross: bool) -> list[Lead]:
    """Return what may be mistaken in the tables among some records; of all rows where `gross`."""
    tables = [record for record in case.records if is_table(record)]
    if not tables:
        return []
    rows = [_row(case)]
    return [*rows, *_of_all_rows(tables)] if gross else rows


def _row(case: Case) -> Lead:
    """Return the lead that the row with the largest misfit is wrong."""
    tables = [k for k, record in enumerate(case.records) if is_table(record)]
    number = max(tables, key=lambda k: float(case.point.records[k].line_costs.max()))
    row = int(case.point.records[number].line_costs.argmax())

    speed = float(case.records[number].lines.speed[row])
    where = f" of record {number + 1}" if len(case.records) > 1 else ""
    said = f"the row at {speed * 30 / np.pi:.6g} rpm{where}"
    cure = "check its speed and its readings, or leave it out"
    return Lead("row", said, cure, lambda records: without(records, number, row))


def _of_all_rows(tables: Sequence[Observation]) -> list[Lead]:
    """Return what may be mistaken in every row alike."""
    names = [s.channel.name for s in tables[0].sensors]
    cure = "set lag = true in their channels, or take it out where it stands"
    degrees = 'set phase_unit = "rad" in the channels'
    found = [
        _lead("lag", "phases that count the other way, lag for lead", cure, _lag(names)),
        _lead("phase_unit", "phases in radians taken for degrees", degrees, _radians),
        _lead("speed", "the rotor turning the other way", "turn the sign of the speed", _reversed),
    ]
    for name in names if len(names) > 1 else ():
        said = f"the phase of {name} counting the other way, lag for lead"
        cure = f"set lag = true in the channel of {name}, or take it out where it stands"
        found.append(_lead(f"lag[{name}]", said, cure, _lag([name])))
    return found


def _lead(term: str, said: str, cure: str, change: Callable[[Observation], Lines]) -> Lead:
    """Return a lead that changes the tables among the records."""

    def undo(records: Sequence[Observation]) -> list[Observation]:
        return [r.with_lines(change(r)) if is_table(r) else r for r in records]

    return Lead(term, said, cure, undo)


def _lag(names: Sequence[str]) -> Callable[[Observation], Lines]:
    """Return what turns the phases of some channels about."""

    def change(record: Observation) -> Lines:
        lines = record.lines
        turned = np.isin(lines.names, names)
        mean = np.where(turned, lines.mean.conj(), lines.mean)
        matrices = lines.covariance.matrices
        both = turned[:, None] & turned
        apart = turned[:, None] ^ turned  # one turned and one not: no covariance of the two left
        matrices = np.where(both, matrices.conj(), np.where(apart, 0.0, matrices))
        return replace(lines, mean=mean, covariance=replace(lines.covariance, matrices=matrices))

    return change


def _radians(record: Observation) -> Lines:
    """Take phases that were read as degrees for radians."""
    lines = record.lines
    angle = np.angle(lines.mean) * (180 / np.pi)
    sensors = [s.column for s in record.sensors]
    mean: Complexes = lines.mean.copy()
    mean[:, sensors] = (np.abs(lines.mean) * np.exp(1j * angle))[:, sensors]
    return replace(lines, mean=mean)


def _reversed(record: Observation) -> Lines:
    """Let the rotor turn the other way, its phasors as they are."""
    lines = record.lines
    return replace(
        lines,
        speed=-lines.speed,
        clock=PhasorClock(-lines.speed),
        mean=lines.mean.conj(),
        covariance=replace(lines.covariance, matrices=lines.covariance.matrices.conj()),
    )


def _of_time(unknown: Unknown, force: bool) -> float:
    """Return the power of 1 / time in a parameter: 2 of a stiffness, where masses stay.

    Where forces stay, 0 of a stiffness, and -2 of a mass: kg = N s^2 / m.
    """
    powers = dict(dimension_of(unknown.unit).powers)
    return -float(powers.get("s", 0)) - (2 * float(powers.get("kg", 0)) if force else 0.0)


def _timing(records: Sequence[Observation], modes: bool) -> tuple[str, bool] | None:
    """Return what sets the scale of time alone, and whether it holds forces."""
    if not records:
        return "the measured natural frequencies", False
    if modes:
        return None  # two kinds of data hold each other's unit
    if all(is_response(record) for record in records):
        return "the frequencies of the responses", True
    return ("the speeds of the table", False) if all(map(is_table, records)) else None


def scale_of_time(
    layout: Layout, unknowns: Floats, records: Sequence[Observation], *, modes: bool = False
) -> tuple[str, bool] | None:
    """Say that the speeds of tables look like those of another unit, and whether that is sure.

    With all speeds a factor f off, stiffnesses are f^2 and dampings f times what they are, and
    nothing else in a table changes; with all frequencies of responses, masses are f^-2 times, and
    with those of measured modes, stiffnesses f^2 times what they are. So the answer is held
    against its start: where it is far off, and near with the speeds in another unit, that unit is
    suspected.
    """
    timing = _timing(records, modes)
    if timing is None:
        return None
    what, force = timing
    inner = [int(i) for i in layout.free if i < layout.parameters]
    powers = {i: _of_time(layout.unknowns[i], force) for i in inner}
    at = [i for i, power in powers.items() if power and unknowns[i] * layout.start[i] > 0]
    if not at:
        return None
    power = np.array([powers[i] for i in at])
    ratio = np.log(np.maximum(unknowns[at] / layout.start[at], 1e-300))
    if np.abs(ratio * 2 / power).max() < np.log(FAR):
        return None
    off = {said: float(np.abs(ratio + power * np.log(f)).max()) for said, f in SPEEDS.items()}
    said = min(off, key=lambda name: off[name])
    factor = SPEEDS[said]
    if off[said] > np.log(NEAR) or factor in (0.5, 2.0):
        return None
    names = ", ".join(layout.unknowns[i].name for i in at)
    told = (
        f"{names} are far off their start, and within a factor {np.exp(off[said]):.2g} of it with "
        f"{what} {factor:.4g} times as large ({said}): the data cannot tell, so check their "
        "unit, or give a nearer start"
    )
    return told, max(factor, 1 / factor) ** 2 > SURE
