"""Rival hypotheses on tables of phasors and of frequency responses.

The unit of the speeds is none of them: time itself may run faster or slower, and no table tells.
See `scale_of_time`, which holds the answer against its start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rotorid.core.notes import Note
from rotorid.core.units import dimension_of
from rotorid.core.values import Complexes, Floats
from rotorid.data.lines import PhasorClock, SilentClock
from rotorid.data.observation import Observation
from rotorid.likelihood.case import Case, Rival, each_record, mistake, rivals
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.mode_rows import pencil_at
from rotorid.likelihood.rivals_stated import without
from rotorid.likelihood.unknowns import Scalar
from rotorid.models.modal import eigenmodes
from rotorid.signals.covariance import lag_one_correlation

KINDS = ("positions", "velocities", "accelerations")
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
GROWS = 3.0
"""Deviations by which a damping is below zero before it counts: no free machine that grows has a
steady response, and a damping of zero is estimated as often below as above."""
ALIKE = 0.2
"""Correlation of the residuals of neighbouring lines from which they are not independent: those of
a Hann window have .44, independent ones .1 at most where there are a hundred."""
LEAST = 50
"""Lines below which chance makes neighbours as alike."""
NONE = 1e-9
"""Damping ratio below which a growth is rounding: of a model without damping."""


def is_response(record: Observation) -> bool:
    return isinstance(record.lines.clock, SilentClock)


def growing_mode(
    layout: Layout, unknowns: Floats, covariance: Floats, records: Sequence[Observation]
) -> Iterator[Note]:
    """Say that a machine whose responses were measured grows by itself: it would have none.

    `covariance` is that of all unknowns.
    """
    linear = layout.model.require_linear()
    if linear.rows != linear.coordinates:
        return
    for number, record in enumerate(records):
        if not is_response(record):
            continue
        pencil = pencil_at(layout.of_record(number), float(record.lines.speed[0]))
        stiffness, damping, mass = pencil.matrices(unknowns)
        modes = eigenmodes(mass, damping, stiffness)
        for value, left, right in zip(modes.values, modes.left, modes.right, strict=True):
            gram = left.conj() @ (2 * value * mass + damping) @ right
            slope = pencil.slopes(value, left[None], right[None], unknowns)[0, 0] / gram
            std = float(np.sqrt(max(float(slope.real @ covariance @ slope.real), 0.0)))
            if value.real > max(GROWS * std, NONE * abs(value)):
                text = (
                    f"a mode at {value.imag / (2 * np.pi):.4g} Hz with a damping ratio of "
                    f"{-value.real / abs(value):.3g}: a machine that grows by itself has no "
                    "frequency response, so the phases count the other way (set lag = true in "
                    "the channels), or a response has the wrong sign"
                )
                yield Note("growing mode", "rejects", text)
                return


def lines_alike(record: Observation, at: Evaluation) -> Iterator[Note]:
    """Say that neighbouring lines of responses hold the same noise, as a window makes them."""
    if not is_response(record) or len(at.whitened) < LEAST:
        return
    correlation = lag_one_correlation(at.whitened[:, :, None])
    if correlation < ALIKE:
        return
    names = ", ".join(sensor.channel.name for sensor in record.sensors)
    text = (
        f"the residuals of neighbouring lines of {names} are alike (correlation "
        f"{correlation:.2f}), as a window such as Hann makes them: the deviations are too small by "
        f"a factor of about {np.sqrt(1 + 2 * correlation):.2g}; keep every second line (every = 2)"
    )
    yield Note("neighbouring lines", "doubts", text)


FAR = 30.0
"""Factor by which a stiffness is off its start, at least, before the unit of speed is doubted: of
the units that are mistaken, rad/s for Hz changes it least, by 39."""
NEAR = 3.0
"""Factor within which the answer lies about its start once the unit is put right."""
SURE = 1000.0
"""Factor of a stiffness from which on the answer is turned away: rpm for Hz, 3600; nobody's start
is off by so much and right in every parameter but for the one factor of time."""


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
    where = f" of record {number + 1}" if len(case.records) > 1 else ""
    said = f"the row at {speed * 30 / np.pi:.6g} rpm{where}"
    cure = "check its speed and its readings, or leave it out"
    yield mistake("row", ("row",), said, cure, partial(without, number=number, line=row))


@rivals("table")
def _all_rows(case: Case) -> Iterator[Rival]:
    """Yield what may be mistaken in every row alike."""
    tables = [record for record in case.records if is_table(record)]
    if not tables or not case.gross:
        return
    names = [s.channel.name for s in tables[0].sensors]
    lag = "phases that count the other way, lag for lead"
    cure = "set lag = true in their channels, or take it out where it stands"
    degrees = 'set phase_unit = "rad" in the channels'
    radians = "phases in radians taken for degrees"
    other_way = "the rotor turning the other way"
    back = each_record(_reversed, is_table)
    yield mistake("lag", ("lag",), lag, cure, each_record(_lag(names), is_table))
    yield mistake("phase_unit", ("phase_unit",), radians, degrees, each_record(_radians, is_table))
    yield mistake("speed", (), other_way, "turn the sign of the speed", back, kind="speed")
    for name in names if len(names) > 1 else ():
        said = f"the phase of {name} counting the other way, lag for lead"
        cure = f"set lag = true in the channel of {name}, or take it out where it stands"
        yield mistake(f"lag[{name}]", (name,), said, cure, each_record(_lag([name]), is_table))


@rivals("table")
def _responses(case: Case) -> Iterator[Rival]:
    """Yield what may be mistaken in the frequency responses among some records."""
    orders = {s.order for r in case.records if is_response(r) for s in r.sensors}
    if not orders or not case.gross:
        return
    for order in range(len(KINDS)) if len(orders) == 1 else ():
        (said,) = orders
        if order != said:
            yield mistake(
                "derivative",
                ("derivative",),
                f"responses of {KINDS[order]}, where {KINDS[said]} are said to be read",
                f'write reads = "x{chr(39) * order}" in channels of names of their own',
                each_record(partial(_shifted, order=said - order), is_response),
                float(order),
            )
    yield mistake(
        "lag",
        ("lag",),
        "phases that count the other way, lag for lead",
        "set lag = true in the channels, or take it out where it stands",
        each_record(
            lambda r: r.with_lines(replace(r.lines, mean=r.lines.mean.conj())), is_response
        ),
    )
    yield mistake(
        "sign[force]",
        ("force",),
        "all responses upside down, as where the force sensor or the shaker is turned about",
        "set scale = -1 in each channel of the responses, or turn the force sensor",
        each_record(partial(_shifted, order=0, sign=-1.0), is_response),
    )


def _shifted(record: Observation, order: int, sign: float = 1.0) -> Observation:
    """Return a record with its sensors' lines times ``sign (i omega)^order``."""
    factor = np.ones(record.lines.mean.shape, dtype=np.complex128)
    columns = [sensor.column for sensor in record.sensors]
    factor[:, columns] = sign * (1j * record.lines.omega[:, None]) ** order
    matrices = record.lines.covariance.matrices * factor[:, :, None] * factor[:, None, :].conj()
    return _with(record, record.lines.mean * factor, matrices)


def _lag(names: Sequence[str]) -> Callable[[Observation], Observation]:
    """Return what turns the phases of some channels about."""

    def change(record: Observation) -> Observation:
        lines = record.lines
        turned = np.isin(lines.names, names)
        mean = np.where(turned, lines.mean.conj(), lines.mean)
        matrices = lines.covariance.matrices
        both = turned[:, None] & turned
        apart = turned[:, None] ^ turned  # one turned and one not: no covariance of the two left
        matrices = np.where(both, matrices.conj(), np.where(apart, 0.0, matrices))
        return _with(record, mean, matrices)

    return change


def _with(record: Observation, mean: Complexes, matrices: Complexes) -> Observation:
    lines = record.lines
    covariance = replace(lines.covariance, matrices=matrices)
    return record.with_lines(replace(lines, mean=mean, covariance=covariance))


def _radians(record: Observation) -> Observation:
    """Take phases that were read as degrees for radians."""
    lines = record.lines
    angle = np.angle(lines.mean) * (180 / np.pi)
    sensors = [s.column for s in record.sensors]
    mean: Complexes = lines.mean.copy()
    mean[:, sensors] = (np.abs(lines.mean) * np.exp(1j * angle))[:, sensors]
    return record.with_lines(replace(lines, mean=mean))


def _reversed(record: Observation) -> Observation:
    """Let the rotor turn the other way, its phasors as they are."""
    lines = record.lines
    back = replace(lines, speed=-lines.speed, clock=PhasorClock(-lines.speed))
    return _with(record.with_lines(back), lines.mean.conj(), lines.covariance.matrices.conj())


def _of_time(unknown: Scalar, force: bool) -> float:
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
) -> Iterator[Note]:
    """Say that the speeds of tables look like those of another unit.

    With all speeds a factor f off, stiffnesses are f^2 and dampings f times what they are, and
    nothing else in a table changes; with all frequencies of responses, masses are f^-2 times, and
    with those of measured modes, stiffnesses f^2 times what they are. So the answer is held
    against its start: where it is far off, and near with the speeds in another unit, that unit is
    suspected.
    """
    timing = _timing(records, modes)
    if timing is None:
        return
    what, force = timing
    inner = [int(i) for i in layout.free if i < layout.parameters]
    powers = {i: _of_time(layout.unknowns[i], force) for i in inner}
    at = [i for i, power in powers.items() if power and unknowns[i] * layout.start[i] > 0]
    if not at:
        return
    power = np.array([powers[i] for i in at])
    ratio = np.log(np.maximum(unknowns[at] / layout.start[at], 1e-300))
    if np.abs(ratio * 2 / power).max() < np.log(FAR):
        return
    off = {said: float(np.abs(ratio + power * np.log(f)).max()) for said, f in SPEEDS.items()}
    said = min(off, key=lambda name: off[name])
    factor = SPEEDS[said]
    if off[said] > np.log(NEAR) or factor in (0.5, 2.0):
        return
    names = ", ".join(layout.unknowns[i].name for i in at)
    text = (
        f"{names} are far off their start, and within a factor {np.exp(off[said]):.2g} of it with "
        f"{what} {factor:.4g} times as large ({said}): the data cannot tell, so check their "
        "unit, or give a nearer start"
    )
    sure = max(factor, 1 / factor) ** 2 > SURE
    yield Note("unit of the speed", "rejects" if sure else "doubts", text)
