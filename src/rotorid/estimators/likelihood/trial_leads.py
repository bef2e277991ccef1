"""Trial masses that sat elsewhere than was said, and files that were exchanged.

A record may state an unbalance of its own: two parameters that loads alone hold, a quarter turn
apart. Where it was typed at a wrong angle no derivative shows it, and a turned mark explains it as
well. Both are set free to find the angle; then the mass is held, and turned by that angle alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from rotorid.estimators.likelihood.leads import Lead
from rotorid.estimators.likelihood.nuisances import Own
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.refits import Case
from rotorid.estimators.likelihood.unknowns import linear_form
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats

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


@frozen
class Moved:
    """A trial mass at another angle: what is said, what to do, the angle, and the minimum."""

    term: str
    said: str
    cure: str
    angle: float
    point: Point


def moved_masses(case: Case) -> Iterator[Moved]:
    """Yield each trial mass at the angle that explains most."""
    layout = case.prepared.layout
    for trial in trials(case):
        names = [layout.unknowns[i].name for i in (trial.along, trial.across)]
        given = _amount(trial, layout.start)
        free = case.freed(names[0]).freed(names[1]).near()
        if free is None:
            continue
        turn = np.angle(_amount(trial, free.unknowns) / given)
        point = _turned(case, trial, complex(given * np.exp(1j * turn))).far()
        if point is None:
            continue
        was, now = (float(np.degrees(np.angle(a))) for a in (given, given * np.exp(1j * turn)))
        said = (
            f"the trial mass of record {trial.record + 1} ({', '.join(names)}) at {now:.4g} deg "
            f"instead of {was:.4g} deg"
        )
        cure = (
            "check where it sat, from which mark and which way that angle counts, and whether the "
            "files of two records are exchanged"
        )
        yield Moved(f"trial mass[{trial.record}]", said, cure, float(np.radians(now)), point)


def trials(case: Case) -> list[Trial]:
    """Return the unbalances that records state, none that is zero."""
    layout, found = case.prepared.layout, list[Trial]()
    if layout.base:
        return found
    own = [(n, int(at[0])) for n, at in layout.places() if isinstance(n, Own)]
    turns = _columns(case, {n.parameter for n, _ in own} & layout.load_only())
    for (one, i), (other, j) in combinations(own, 2):
        stated = all(layout.unknowns[k].std is not None for k in (i, j))
        if one.record != other.record or not stated or not layout.start[[i, j]].any():
            continue
        a, b = (turns.get(n.parameter, np.zeros(1)) for n in (one, other))
        margin = QUARTER * np.abs(a).max(initial=0.0)
        if a.any() and b.any() and a.shape == b.shape:
            if (np.abs(b - 1j * a) <= margin).all():
                found.append(Trial(one.record, i, j))
            elif (np.abs(b + 1j * a) <= margin).all():
                found.append(Trial(one.record, j, i))
    return found


def _columns(case: Case, parameters: set[int]) -> dict[int, Complexes]:
    """Return the load once per revolution that each of some parameters makes by itself."""
    layout = case.prepared.layout
    turns = linear_form(layout.model).rotation_columns(1.0)
    return {
        factors[0]: turns[:, monomial]
        for monomial, factors in enumerate(layout.monomial_factors)
        if factors is not None and len(factors) == 1 and factors[0] in parameters
    }


def _amount(trial: Trial, unknowns: Floats) -> complex:
    return complex(unknowns[trial.along], unknowns[trial.across])


def _turned(case: Case, trial: Trial, amount: complex) -> Case:
    """Return the case with the trial mass held at another place."""
    layout, known = case.prepared.layout, case.prepared.known
    unknowns = list(layout.unknowns)
    for at, value in ((trial.along, amount.real), (trial.across, amount.imag)):
        unknowns[at] = replace(unknowns[at], start=value, std=0.0)
        known = known.without(unknowns[at].name)
    held = replace(layout, unknowns=tuple(unknowns))
    return replace(case, prepared=replace(case.prepared, layout=held, known=known))


def exchanges(case: Case) -> list[Lead]:
    """Return the leads that the files of two records are exchanged, where what they state differs.

    The lines change places, and what is stated of each record stays.
    """
    layout = case.prepared.layout
    own = [n for n in layout.nuisances if isinstance(n, Own)]
    stated = {n.record for n in own if n.unknowns[0].std is not None}
    pairs = [pair for pair in combinations(range(len(case.records)), 2) if stated & set(pair)]
    alike = [pair for pair in pairs if _alike(*(case.records[k] for k in pair))]
    return [_exchange(one, other) for one, other in alike[:MOST]]


def _alike(one: Observation, other: Observation) -> bool:
    """Tell whether either of two records may be taken for the other: by their channels."""
    return one.lines.names == other.lines.names and one.lines.passive == other.lines.passive


def _exchange(one: int, other: int) -> Lead:
    def undo(records: Sequence[Observation]) -> list[Observation]:
        found = list(records)
        found[one], found[other] = found[other], found[one]
        return found

    return Lead(
        f"swap[record {one}, record {other}]",
        f"the files of records {one + 1} and {other + 1} exchanged",
        "exchange their files, or what [records.parameters] says of the two",
        undo,
    )
