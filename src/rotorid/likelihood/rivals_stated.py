"""Rival hypotheses on what was stated: bounds, known values, measured modes, trial masses.

A bound is knowledge like a value with a deviation, and a wrong one explains a misfit as well. The
cost without it is found by minimizing again from the estimate.

A record may state an unbalance of its own: two parameters that loads alone hold, a quarter turn
apart. Where it was typed at a wrong angle no derivative shows it, and a turned mark explains it as
well. Both are set free to find the angle; then the mass is held, and turned by that angle alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from rotorid.core.values import Complexes
from rotorid.data.measured_modes import Mode, number
from rotorid.likelihood.case import Case, Kind, Rival, rivals
from rotorid.likelihood.mode_rows import ModalRows
from rotorid.likelihood.problem import Known, Point
from rotorid.likelihood.relations import Limit
from rotorid.likelihood.solver import bounds_held
from rotorid.likelihood.unknowns import amount

CLOSE = 1.5
"""Factor of the limit within which what was set free makes the bound the likeliest mistake: a limit
is guessed or mistyped by less, and a unit is off by 2 or more (but for rms, 1.41, where both are
told)."""
WRONG_SIGN = (
    "look at the signs of the channels and of the terms; where it may have that sign, take the "
    "bound (positive, min, max) away"
)
"""What to do about a value below zero that a bound keeps above."""


def _held_bounds(case: Case) -> dict[Limit, int]:
    """Return the bounds that are active, and where they stand among the bounds."""
    found: dict[Limit, int] = {}
    for row in bounds_held(case.point.problem, case.point.unknowns):
        limit = case.prepared.bounds.rows[row].stated
        assert isinstance(limit, Limit)
        found.setdefault(limit, row)
    return found


@rivals("bound")
def _single_bounds(case: Case) -> Iterator[Rival]:
    """Yield that each bound that is active is too narrow."""
    for limit, row in _held_bounds(case).items():
        yield _without(case, {limit: row})


@rivals("bounds")
def _all_bounds(case: Case) -> Iterator[Rival]:
    """Yield that all of several are."""
    held = _held_bounds(case)
    if len(held) > 1:
        listed = ", ".join(map(str, held))
        said = f"the bounds {listed}, which hold with equality"
        yield replace(_without(case, held), says=said, cure="check these bounds", value=None)


def _without(case: Case, held: Mapping[Limit, int]) -> Rival:
    """Return the rival that bounds are too narrow, and what the first of them bounds then is."""
    every, (limit, row) = case.prepared, next(iter(held.items()))
    looser = replace(every, bounds=every.bounds.where(lambda row: row.stated not in held))
    at = every.layout.index.get(limit.expression)
    unit = "" if at is None else every.layout.unknowns[at].unit

    def value(point: Point) -> float:
        return limit.value + limit.way * float(every.bounds.values(point.unknowns)[row])

    def likely(point: Point) -> bool:
        """Tell whether a point is so near to the limit that the bound is the likeliest mistake."""
        return limit.value != 0 and 1 / CLOSE < value(point) / limit.value < CLOSE

    def said(value: float | None) -> str:
        size = f"{value:.6g}" + ("" if unit in ("", "1") else f" {unit}")
        return f"{limit.expression} = {size}, which the bound {limit} does not let it be"

    return Rival(
        f"bound {', '.join(map(str, held))}",
        "bound",
        lambda case: case.prepared_as(looser),
        said,
        "check that bound (min, max), or take it away" if limit.value else WRONG_SIGN,
        value,
        unit,
        likely=likely,
    )


@rivals("known")
def _known(case: Case) -> Iterator[Rival]:
    layout = case.prepared.layout
    for at, scalar in enumerate(layout.unknowns[: layout.named]):
        if scalar.std is not None and at not in layout.idle:
            yield _prior(scalar.name, scalar.unit)


def _prior(name: str, unit: str) -> Rival:
    return Rival(
        f"prior {name}",
        "known",
        lambda case: case.freed(name),
        lambda value: f"{name}{amount(value, unit)} instead of what was given",
        f"check {name}",
        unit=unit,
        frees=(name,),
        size=lambda values: float(values[0]),
        forgets=name,
    )


@rivals("mode")
def _modes(case: Case) -> Iterator[Rival]:
    rows = case.prepared.known.modes
    for text in dict.fromkeys(rows.texts):
        yield _mode(text, rows.of_mode(text))


def _mode(text: str, rows: ModalRows) -> Rival:
    def said(value: float | None) -> str:
        size = "" if value is None else f", which is {value:.6g} Hz by everything else"
        return f"{text} as measured{size}"

    return Rival(
        text,
        "term",
        lambda case: case.freed(text),
        said,
        "check that frequency, and which mode it is",
        lambda point: rows.first_hertz(point.unknowns),
        "Hz",
        forgets=text,
    )


UNITS = {"rad/s": 2 * np.pi, "cycles per minute": 60.0}
"""Units in which frequencies are written by mistake: so many of them are one Hz."""


@rivals("modes")
def _wrong_unit(case: Case) -> Iterator[Rival]:
    """Yield natural frequencies in another unit."""
    for name, factor in UNITS.items() if len(case.prepared.known.modes) else ():
        said = f"natural frequencies in {name}, not in Hz"
        cure = "write frequency and std in [[modes]] with their unit"
        scaled = partial(_scaled, factor=factor)
        yield _of_modes(case, "unit[modes]", said, cure, scaled, 1 / factor, "unit")


def _scaled(mode: Mode, factor: float) -> Mode:
    hertz, std, _ = mode.in_si
    return replace(mode, frequency=hertz / factor, std=std / factor)


@rivals("modes")
def _skipped(case: Case) -> Iterator[Rival]:
    """Yield that a mode below one, and so below all above it, was not found in the test."""
    for each in case.prepared.known.modes.configurations:
        for first in each.modes if number(each.modes[-1]) < len(each.pattern) else ():
            above = [mode for mode in each.modes if number(mode) >= number(first)]
            true = number(first) + 1
            term = f"skipped below {first.in_si[0]:.4g} Hz"
            said = f"a mode below {first} that was not measured, so that this one is number {true}"
            raised = partial(_raised, above=above)
            yield _of_modes(case, term, said, f"write mode = {true} there", raised, float(true))


def _raised(mode: Mode, above: Sequence[Mode]) -> Mode:
    return replace(mode, mode=number(mode) + 1) if mode in above else mode


def _of_modes(
    case: Case,
    term: str,
    said: str,
    cure: str,
    change: Callable[[Mode], Mode],
    value: float,
    kind: Kind = "mistake",
) -> Rival:
    """Return the rival that other modes were measured."""
    rows = ModalRows(
        tuple(
            replace(each, modes=tuple(change(mode) for mode in each.modes))
            for each in case.prepared.known.modes.configurations
        )
    )

    def changed(case: Case) -> Case:
        known = Known(case.prepared.known.relations, rows)
        return case.prepared_as(replace(case.prepared, known=known))

    return Rival(term, kind, changed, said, cure, value, "1", way="far")


QUARTER = 1e-9
"""Share of a load within which another is the same a quarter turn on: rounding."""


@rivals("trial")
def _moved_masses(case: Case) -> Iterator[Rival]:
    """Yield each trial mass at the angle that explains most."""
    layout = case.prepared.layout
    for record, *parts in trials(case):
        names = [layout.unknowns[i].name for i in parts]
        free = case.freed(*names).minimized()
        if free is None:
            continue
        given, found = (complex(*at[parts]) for at in (layout.start, free.unknowns))
        there = complex(given * np.exp(1j * np.angle(found / given)))
        was, now = (float(np.degrees(np.angle(at))) for at in (given, there))
        said = (
            f"the trial mass of record {record + 1} ({', '.join(names)}) at {now:.4g} deg "
            f"instead of {was:.4g} deg"
        )
        cure = (
            "check where it sat, from which mark and which way that angle counts, and whether the "
            "files of two records are exchanged"
        )
        there_parts = dict(zip(names, (there.real, there.imag), strict=True))
        yield Rival(
            f"trial mass[{record}]",
            "mistake",
            partial(Case.held, values=there_parts),
            said,
            cure,
            float(np.radians(now)),
            "rad",
            (f"record {record + 1}",),
            way="far",
        )


def trials(case: Case) -> list[tuple[int, int, int]]:
    """Return the unbalances that records state: which record, and the unknowns of both parts."""
    layout, found = case.prepared.layout, list[tuple[int, int, int]]()
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
                found.append((record, i, j))
            elif (np.abs(b + 1j * a) <= margin).all():
                found.append((record, j, i))
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
