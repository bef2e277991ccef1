"""Base parameters: the combinations of parameters that the equations determine.

Products of powers of symbols are independent. Where functions, roots or divisions appear, the
signals are evaluated at points without a pattern; those that double precision cannot tell apart
once more to a hundred digits, and the relations between the columns found by elimination: with so
many digits a relation at more points than signals is an identity.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import islice

import numpy as np

from rotorid.core.linalg import column_lengths
from rotorid.core.units import multiply_units
from rotorid.core.values import Floats, frozen
from rotorid.models.equations import Product
from rotorid.models.expressions import (
    MAX_VALUE,
    TOLERANCE,
    Expression,
    Factor,
    Monomial,
    Real,
    evaluate,
    product,
    simple_fraction,
    values_at,
)
from rotorid.models.parser import Work

_MAX_GROUP = 80  # signals; larger groups count as independent
# Nodes of signals to evaluate to a hundred digits, in all: a second and a half. What is beyond
# counts as independent; thirty functions that double precision cannot tell apart are within.
_EVALUATIONS = 30_000
_SPARE = 5  # points of each size beyond the number of independent signals
_SCALES = (Fraction(1), Fraction(3), Fraction(1, 30), Fraction(1, 10**5))
Combination = Mapping[Expression, Fraction]


def independent_signals(signals: Iterable[Expression]) -> dict[Expression, Combination]:
    """Write each signal as a combination of independent ones."""
    everything = list(dict.fromkeys(signals))
    found: dict[Expression, Combination] = {s: {s: Fraction(1)} for s in everything}
    known: dict[tuple[Expression, ...], Mapping[Expression, Combination]] = {}
    left = _EVALUATIONS
    for outer, members in _groups(everything).items():
        key = tuple(members)
        if key not in known:
            factors = [factor for member in members for factor in member.factors]
            if not 1 < len(members) <= _MAX_GROUP or not any(map(_holds_function, factors)):
                continue
            known[key], spent = _relations(_suspects(members), left)
            left -= spent
        for inner, relation in known[key].items():
            found[_times(outer, inner)] = {_times(outer, s): c for s, c in relation.items()}
    return found


def _holds_function(factor: Factor) -> bool:
    base, exponent = factor
    return base.kind != "name" or exponent.denominator != 1 or exponent < 0


def _times(one: Expression, other: Expression) -> Expression:
    return product([*one.factors, *other.factors])


def _groups(signals: Sequence[Expression]) -> dict[Expression, list[Expression]]:
    """Group signals by their powers of symbols in no function: groups are independent."""
    inside: set[Expression] = set()
    for signal in signals:
        for factor in signal.factors:
            if _holds_function(factor):
                inside |= factor[0].free_symbols
    groups: dict[Expression, list[Expression]] = defaultdict(list)
    for signal in signals:
        inner = [factor for factor in signal.factors if factor[0].free_symbols & inside]
        outer = [factor for factor in signal.factors if not factor[0].free_symbols & inside]
        groups[product(outer)].append(product(inner))
    return groups


def _suspects(signals: Sequence[Expression]) -> list[Expression]:
    """Return the signals that may be dependent, as double precision sees it."""
    names = _names(signals)
    points = 8 * len(signals) + 40
    arrays = {
        str(name): [float(_coordinate(i, k)) for k in range(points)] for i, name in enumerate(names)
    }
    columns = [np.broadcast_to(evaluate(signal, arrays), (points,)) for signal in signals]
    matrix = np.column_stack(columns)
    matrix = matrix[(np.abs(matrix) < MAX_VALUE).all(axis=1)]
    if len(matrix) < 2 * len(signals):
        return list(signals)
    _, singular, directions = np.linalg.svd(matrix / column_lengths(matrix))
    null = directions[: len(singular)][singular < 1e-8 * singular[0]]
    told = zip(signals, null.T, strict=True)
    return [signal for signal, direction in told if (abs(direction) > 1e-7).any()]


def _names(signals: Sequence[Expression]) -> list[Expression]:
    return sorted(set[Expression]().union(*(s.free_symbols for s in signals)), key=str)


def _relations(
    signals: Sequence[Expression], most: int
) -> tuple[dict[Expression, Combination], int]:
    """Return the dependent signals in terms of the others, and how many nodes were evaluated."""
    rank, nodes = min(4, len(signals)), sum(signal.nodes for signal in signals)
    names = [str(name) for name in _names(signals)]
    # Where all are real, at several sizes: functions may be alike at one.
    points = (
        {name: _coordinate(i, k) for i, name in enumerate(names)}
        for k in range(8 * len(_SCALES) * (len(signals) + _SPARE))
    )
    samples = filter(None, (values_at(point, signals) for point in points))
    rows: list[list[Real]] = []
    while True:  # many are often a few: points for as many as may be independent, and some to spare
        wanted = len(_SCALES) * (rank + _SPARE)
        if (spent := nodes * wanted) > most:
            return {}, most
        rows += islice(samples, wanted - len(rows))
        if len(rows) < wanted:
            return {}, spent  # too few points where all are real: all count as independent
        relations = _eliminated(signals, rows)
        found = len(signals) - len(relations)
        if found <= rank:
            return relations, spent
        rank = min(max(found, 2 * rank), len(signals))


def _eliminated(
    signals: Sequence[Expression], rows: list[list[Real]]
) -> dict[Expression, Combination]:
    """Return the dependent signals in terms of the others, by Gauss and Jordan."""
    relations: dict[Expression, Combination] = {}
    table, pivots = np.array(rows, dtype=object), list[int]()
    size = np.abs(table).max(axis=0)
    for j, signal in enumerate(signals):
        first = len(pivots)
        if first == len(table):
            break  # too few points: the rest counts as independent
        best = first + int(np.abs(table[first:, j]).argmax())
        if abs(table[best, j]) <= TOLERANCE * size[j]:
            ratios = zip(pivots, map(_near, table[:first, j]), strict=True)
            relations[signal] = {signals[p]: c for p, c in ratios if c}
            continue
        table[[first, best]] = table[[best, first]]
        table[first] = table[first] / table[first, j]
        others = np.arange(len(table)) != first
        table[others] -= np.outer(table[others, j], table[first])
        pivots.append(j)
    return relations


def _near(value: Real) -> Fraction:
    simple = simple_fraction(value)
    return Fraction(repr(float(value))) if simple is None else simple


def _coordinate(i: int, k: int) -> Fraction:
    """Return coordinate i of point k: several sizes, both signs, no pattern."""
    mixed = (7919 * (k + 1) ** 2 + 104729 * (i + 1) ** 3) % 99991
    return _SCALES[k % len(_SCALES)] * (Fraction(mixed, 49999) - 1)


@frozen
class BaseParameters:
    """Combinations ``base = gather @ monomial_values``, independent for every motion."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    gather: Floats  # (base, monomial)
    # the monomial of each whose column of the regressor is that of the base parameter
    kept: tuple[int, ...]


def gather_base(
    products: Sequence[Product],
    monomials: Sequence[Monomial],
    parameters: Sequence[str],
    units: Mapping[str, str],
) -> BaseParameters:
    """Merge monomials, in order, whose columns of the regressor depend on those of kept ones."""
    independent = independent_signals(term.signal for term in products)
    entries: dict[tuple[int, Expression], dict[int, Fraction]]
    entries = defaultdict(lambda: defaultdict(Fraction))
    position = {monomial: i for i, monomial in enumerate(monomials)}
    for term in products:
        column = position[term.monomial]
        for signal, factor in independent[term.signal].items():
            if any(term.monomial):
                entries[term.row, signal][column] += factor * term.coefficient
    rows = ({column: x for column, x in row.items() if x} for row in entries.values())
    reduced = _echelon(rows)
    kept = tuple(reduced)
    gather = np.zeros((len(kept), len(monomials)))
    for number, ratios in enumerate(reduced.values()):
        for column, ratio in ratios.items():
            gather[number, column] = float(ratio)
    found_units = tuple(monomial_unit(monomials[i], parameters, units) for i in kept)
    names = base_names(gather, kept, monomials, parameters)
    return BaseParameters(names, found_units, gather, kept)


def base_names(
    gather: Floats, kept: Sequence[int], monomials: Sequence[Monomial], parameters: Sequence[str]
) -> tuple[str, ...]:
    """Return names such as ``k1*L1^2 + k2*L2^2``, the monomial that is kept before the others."""
    found = []
    for row, first in zip(gather, kept, strict=True):
        text = ""
        for column in [first, *(i for i in np.flatnonzero(row).tolist() if i != first)]:
            factor = "" if abs(row[column]) == 1 else f"{abs(row[column]):.12g}*"
            sign = " + " if row[column] > 0 else " - "
            name = monomial_name(monomials[column], parameters)
            text += (sign if text else "") + factor + name
        found.append(text)
    return tuple(found)


def _echelon(rows: Iterable[dict[int, Fraction]]) -> dict[int, dict[int, Fraction]]:
    """Return the reduced row echelon form of sparse rows, by the column of each pivot."""
    reduced: dict[int, dict[int, Fraction]] = {}
    zero, work = Fraction(0), Work()

    def without(row: dict[int, Fraction], column: int) -> dict[int, Fraction]:
        if not (factor := row.get(column, zero)):
            return row
        pivot = reduced[column]
        work.spend_exact(pivot.values(), factor)
        left = {k: row.get(k, zero) - factor * pivot.get(k, zero) for k in row | pivot}
        return {k: value for k, value in left.items() if value}

    for row in rows:
        for pivot in sorted(reduced.keys() & row.keys()):
            row = without(row, pivot)
        if row:
            first = min(row)
            row = {column: value / row[first] for column, value in row.items()}
            above, reduced[first] = dict(reduced), row
            reduced |= {pivot: without(other, first) for pivot, other in above.items()}
    return dict(sorted(reduced.items()))


def monomial_name(monomial: Monomial, parameters: Sequence[str]) -> str:
    factors = zip(parameters, monomial, strict=True)
    return "*".join(name if n == 1 else f"{name}^{n}" for name, n in factors if n)


def monomial_unit(monomial: Monomial, parameters: Sequence[str], units: Mapping[str, str]) -> str:
    powers = zip(parameters, monomial, strict=True)
    return multiply_units([(units[name], n) for name, n in powers if n])
