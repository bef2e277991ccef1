"""Rival hypotheses on what was stated: bounds, modes, trial masses, one line.

A bound is knowledge like a value with a deviation, and a wrong one explains a misfit as well. The
cost without it is found by minimizing again from the estimate.

Such a line contradicts all others, whatever is freed in the model. Without it, its covariance
beyond all bounds, the cost falls by r_k' (1 - H_k)^-1 r_k to first order, r_k its rows of the
residual and H_k what the unknowns can do there: no refit is needed to find it.

A record may state an unbalance of its own: two parameters that loads alone hold, a quarter turn
apart. Where it was typed at a wrong angle no derivative shows it, and a turned mark explains it as
well. Both are set free to find the angle; then the mass is held, and turned by that angle alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats
from rotorid.data.measured_modes import Mode, number
from rotorid.data.observation import Observation
from rotorid.likelihood.case import Case, Kind, Records, Rival, Small, mistake, rivals
from rotorid.likelihood.effects import Replaces, of_kind
from rotorid.likelihood.mode_rows import ModalRows
from rotorid.likelihood.preparation import Limit
from rotorid.likelihood.problem import Known, Point
from rotorid.likelihood.relations import Relations
from rotorid.likelihood.solver import bounds_held
from rotorid.likelihood.unknowns import Scalar, amount

CLOSE = 1.5
"""Factor of the limit within which what was set free makes the bound the likeliest mistake: a limit
is guessed or mistyped by less, and a unit is off by 2 or more (but for rms, 1.41, where both are
told)."""


@frozen
class HeldBound:
    """A bound that holds with equality."""

    limit: Limit
    row: int  # among the bounds
    bounds: Relations
    unit: str  # of a single parameter, else empty

    def value(self, point: Point) -> float:
        above = float(self.bounds.values(point.unknowns)[self.row])
        return self.limit.value + self.limit.way * above

    def likely(self, point: Point) -> bool:
        """Tell whether a point is so near to the limit that the bound is the likeliest mistake."""
        stated = self.limit.value
        return stated != 0 and 1 / CLOSE < self.value(point) / stated < CLOSE

    def told(self, value: float | None) -> tuple[str, str]:
        unit = "" if self.unit in ("", "1") else f" {self.unit}"
        size = f"{self.limit.expression} = {value:.6g}{unit}"
        said = f"{size}, which the bound {self.limit} does not let it be"
        if self.limit.value == 0:
            return said, (
                "look at the signs of the channels and of the terms; where it may have that sign, "
                "take the bound (positive, min, max) away"
            )
        return said, "check that bound (min, max), or take it away"


def held_bounds(case: Case) -> list[HeldBound]:
    prepared, layout = case.prepared, case.prepared.layout
    found: dict[Limit, HeldBound] = {}
    for row in bounds_held(case.point.problem, case.point.unknowns):
        limit = prepared.limits[row]
        at = layout.index.get(limit.expression)
        unit = "" if at is None else layout.unknowns[at].unit
        found.setdefault(limit, HeldBound(limit, row, prepared.bounds, unit))
    return list(found.values())


@rivals("bound")
def _single_bounds(case: Case) -> Iterator[Rival]:
    """Yield that each bound that holds with equality is too narrow."""
    for held in held_bounds(case):
        yield replace(_without_bounds(case, [held], held.told), value=held.value)


@rivals("bounds")
def _all_bounds(case: Case) -> Iterator[Rival]:
    """Yield that all of several are."""
    held = held_bounds(case)
    if len(held) > 1:
        listed = ", ".join(str(each.limit) for each in held)
        told = (f"the bounds {listed}, which hold with equality", "check these bounds")
        yield _without_bounds(case, held, told)


def _without_bounds(
    case: Case,
    held: Sequence[HeldBound],
    told: tuple[str, str] | Callable[[float | None], tuple[str, str]],
) -> Rival:
    limits, first = [each.limit for each in held], held[0]
    rows = [i for i, limit in enumerate(case.prepared.limits) if limit in limits]
    term = f"bound {', '.join(map(str, limits))}"
    return Rival(
        term,
        (term,),
        "bound",
        lambda case: case.without_bounds(rows),
        told,
        unit=first.unit,
        likely=first.likely,
    )


@rivals("known")
def _known(case: Case) -> Iterator[Rival]:
    layout = case.prepared.layout
    for at, scalar in enumerate(layout.unknowns[: layout.named]):
        if scalar.std is not None and at not in layout.idle:
            yield _prior(scalar, at, float(case.unknowns[at]))


def _prior(scalar: Scalar, at: int, given: float) -> Rival:
    name, term = scalar.name, f"prior {scalar.name}"

    def told(value: float | None) -> tuple[str, str]:
        return f"{name}{amount(value, scalar.unit)} instead of what was given", f"check {name}"

    return Rival(
        term,
        (term,),
        "known",
        lambda case: case.freed(name),
        told,
        lambda point: float(point.unknowns[at]),
        scalar.unit,
        small=Small(
            lambda slopes: np.column_stack([slopes.by(name), slopes.slack(name)]),
            lambda step: given + float(step[0]),
        ),
    )


@rivals("mode")
def _modes(case: Case) -> Iterator[Rival]:
    rows = case.prepared.known.modes
    for text in dict.fromkeys(rows.texts):
        yield _mode(text, rows.of_mode(text))


def _mode(text: str, rows: ModalRows) -> Rival:
    def told(value: float | None) -> tuple[str, str]:
        size = "" if value is None else f", which is {value:.6g} Hz by everything else"
        return f"{text} as measured{size}", "check that frequency, and which mode it is"

    return Rival(
        text,
        (text,),
        "term",
        lambda case: case.freed(text),
        told,
        lambda point: rows.first_hertz(point.unknowns),
        "Hz",
        small=Small(lambda slopes: slopes.slack(text), lambda step: None),
    )


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

    Asked last, and not where something else explains the data: with a wrong speed, or without its
    damping, a model fits all lines but one.
    """
    drop, number, line = max(_drops(case), default=(0.0, 0, 0))
    if not drop > HOLDS * (case.point.cost - case.expected):
        return
    hertz = float(case.records[number].lines.frequency[line])
    where = f" of record {number + 1}" if len(case.records) > 1 else ""
    term = f"line {hertz:.6g} Hz{where}"
    said = f"the line at {hertz:.6g} Hz{where}, {source(hertz)}, left out"
    cure = "leave it out of the harmonics, or stop its source"
    change = partial(without, number=number, line=line)
    yield mistake(term, (term,), said, cure, change, kind="omission")


def source(hertz: float) -> str:
    """Say what a line comes from, as far as its frequency tells."""
    for mains in MAINS:
        multiple = round(hertz / mains)
        if multiple and abs(hertz / mains - multiple) < ON * multiple:
            return "where hum of the mains stands"
    return "which something else makes, such as a base that shakes or another machine"


def without(records: Sequence[Observation], number: int, line: int) -> list[Observation]:
    record = records[number]
    matrices = record.lines.covariance.matrices.copy()
    matrices[line] *= FORGOTTEN
    covariance = replace(record.lines.covariance, matrices=matrices)
    changed = record.with_lines(replace(record.lines, covariance=covariance))
    return [*records[:number], changed, *records[number + 1 :]]


def _drops(case: Case) -> Iterator[tuple[float, int, int]]:
    """Yield by how much the cost falls without each line, its record and its which."""
    rows = case.point.by_line(np.arange(len(case.point.residual)))
    for which, (record, own) in enumerate(zip(case.records, rows, strict=True)):
        lines = record.lines
        orders = np.abs(lines.frequency[:, None] - np.arange(ORDERS + 1) * _turns(record))
        apart = (orders > BESIDE * np.diff(lines.frequency).min(initial=np.inf)).all(axis=1)
        for k in np.flatnonzero(apart).tolist() if lines.scatter is not None else ():
            yield case.point.linear.without(own[k]), which, k


def _turns(record: Observation) -> float:
    return float(np.abs(record.lines.speed).mean()) / (2 * np.pi)


UNITS = {"rad/s": 2 * np.pi, "cycles per minute": 60.0}
"""Units in which frequencies are written by mistake: so many of them are one Hz."""


@rivals("modes")
def _wrong_unit(case: Case) -> Iterator[Rival]:
    """Yield natural frequencies in another unit."""
    rows = case.prepared.known.modes
    for name, factor in UNITS.items() if len(rows) else ():
        said = f"natural frequencies in {name}, not in Hz"
        cure = "write frequency and std in [[modes]] with their unit"
        changed = _changed(rows, partial(_scaled, factor=factor))
        yield _of_modes("unit[modes]", said, cure, changed, 1 / factor, "unit")


@rivals("modes")
def _skipped(case: Case) -> Iterator[Rival]:
    """Yield that a mode below one, and so below all above it, was not found in the test."""
    rows = case.prepared.known.modes
    for each in rows.configurations:
        if number(each.modes[-1]) < len(each.pattern):
            for first in each.modes:
                above = [mode for mode in each.modes if number(mode) >= number(first)]
                term = f"skipped below {first.in_si[0]:.4g} Hz"
                true = number(first) + 1
                said = (
                    f"a mode below {first} that was not measured, so that this one is number {true}"
                )
                changed = _changed(rows, partial(_raised, above=above))
                yield _of_modes(term, said, f"write mode = {true} there", changed, float(true))


def _of_modes(
    term: str, said: str, cure: str, rows: ModalRows, value: float, kind: Kind = "mistake"
) -> Rival:
    """Return the rival that other modes were measured."""

    def change(case: Case) -> Case:
        return case.knowing(Known(case.prepared.known.relations, rows))

    return Rival(term, (term,), kind, change, (said, cure), value, "1", way="far")


def _raised(mode: Mode, above: Sequence[Mode]) -> Mode:
    return replace(mode, mode=number(mode) + 1) if mode in above else mode


def _scaled(mode: Mode, factor: float) -> Mode:
    hertz, std, _ = mode.in_si
    return replace(mode, frequency=hertz / factor, std=std / factor)


def _changed(rows: ModalRows, change: Callable[[Mode], Mode]) -> ModalRows:
    return ModalRows(
        tuple(
            replace(each, modes=tuple(change(mode) for mode in each.modes))
            for each in rows.configurations
        )
    )


QUARTER = 1e-9
"""Share of a load within which another is the same a quarter turn on: rounding."""
MOST = 6
"""Pairs of records of which an exchange is tried, at the most: of four runs all."""


@frozen
class Trial:
    """An unbalance that a record states: its number, and the unknowns of its two parts."""

    record: int
    along: int
    across: int


@rivals("trial")
def _moved_masses(case: Case) -> Iterator[Rival]:
    """Yield each trial mass at the angle that explains most."""
    layout = case.prepared.layout
    for trial in trials(case):
        names = [layout.unknowns[i].name for i in (trial.along, trial.across)]
        given = _amount(trial, layout.start)
        free = case.freed(*names).near()
        if free is None:
            continue
        turn = np.angle(_amount(trial, free.unknowns) / given)
        there = complex(given * np.exp(1j * turn))
        was, now = (float(np.degrees(np.angle(at))) for at in (given, there))
        held = dict(zip(names, (there.real, there.imag), strict=True))
        said = (
            f"the trial mass of record {trial.record + 1} ({', '.join(names)}) at {now:.4g} deg "
            f"instead of {was:.4g} deg"
        )
        cure = (
            "check where it sat, from which mark and which way that angle counts, and whether the "
            "files of two records are exchanged"
        )
        yield Rival(
            f"trial mass[{trial.record}]",
            (f"record {trial.record + 1}",),
            "mistake",
            partial(Case.held, values=held),
            (said, cure),
            float(np.radians(now)),
            "rad",
            way="far",
        )


def trials(case: Case) -> list[Trial]:
    layout, found = case.prepared.layout, list[Trial]()
    if layout.base:
        return found
    parameters = {effect.parameter for _, effect, _ in layout.replaced}
    turns = _columns(case, parameters & layout.load_only())
    for (record, one, i), (its, other, j) in combinations(layout.replaced, 2):
        stated = all(layout.unknowns[k].std is not None for k in (i, j))
        if record != its or not stated or not layout.start[[i, j]].any():
            continue
        a, b = (turns.get(n.parameter, np.zeros(1)) for n in (one, other))
        margin = QUARTER * np.abs(a).max(initial=0.0)
        if a.any() and b.any() and a.shape == b.shape:
            if (np.abs(b - 1j * a) <= margin).all():
                found.append(Trial(record, i, j))
            elif (np.abs(b + 1j * a) <= margin).all():
                found.append(Trial(record, j, i))
    return found


def _columns(case: Case, parameters: set[int]) -> dict[int, Complexes]:
    """Return the load once per revolution that each of some parameters makes by itself."""
    layout = case.prepared.layout
    turns = layout.model.require_linear().rotation_columns(1.0)
    return {
        factors[0]: turns[:, monomial]
        for monomial, factors in enumerate(layout.monomial_factors)
        if factors is not None and len(factors) == 1 and factors[0] in parameters
    }


def _amount(trial: Trial, unknowns: Floats) -> complex:
    return complex(unknowns[trial.along], unknowns[trial.across])


@rivals("trial")
def _exchanges(case: Case) -> Iterator[Rival]:
    """Yield that the files of two records are exchanged, where what they state differs.

    The lines change places, and what is stated of each record stays.
    """
    own = [u for u in case.prepared.layout.nuisances if of_kind(Replaces, u.effects)]
    stated = {unknown.record for unknown in own if unknown.scalars[0].std is not None}
    pairs = [pair for pair in combinations(range(len(case.records)), 2) if stated & set(pair)]
    alike = [pair for pair in pairs if _alike(*(case.records[k] for k in pair))]
    for one, other in alike[:MOST]:
        yield mistake(
            f"swap[record {one}, record {other}]",
            (f"record {one + 1}", f"record {other + 1}"),
            f"the files of records {one + 1} and {other + 1} exchanged",
            "exchange their files, or what [records.parameters] says of the two",
            partial(_files_exchanged, one=one, other=other),
        )


def _alike(one: Observation, other: Observation) -> bool:
    """Tell whether either of two records may be taken for the other: by their channels."""
    return one.lines.names == other.lines.names and one.lines.passive == other.lines.passive


def _files_exchanged(records: Records, one: int, other: int) -> list[Observation]:
    found = list(records)
    found[one], found[other] = found[other], found[one]
    return found
