"""Functions that depend linearly on one another whatever their arguments, as 1, sin^2 and cos^2.

Products of powers of symbols are independent. Where functions, roots or divisions appear, the
signals are evaluated at points without a pattern; those that double precision cannot tell apart
once more to a hundred digits, and the relations between the columns found by elimination: with so
many digits a relation at more points than signals is an identity.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import islice
from typing import Any

import numpy as np

from rotorid.models.evaluation import MAX_VALUE, evaluate
from rotorid.models.expression import Expression, Factor, product

_MAX_GROUP = 80  # signals; larger groups count as independent
# Nodes of signals to evaluate to a hundred digits, in all: a second and a half. What is beyond
# counts as independent; thirty functions that double precision cannot tell apart are within.
_EVALUATIONS = 30_000
_SPARE = 5  # points of each size beyond the number of independent signals
_SCALES = (Fraction(1), Fraction(3), Fraction(1, 30), Fraction(1, 10**5))

Real = Any  # a number of a hundred digits; mpmath carries no types
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
            if not 1 < len(members) <= _MAX_GROUP or all(_is_power_product(m) for m in members):
                continue
            known[key], spent = _relations(_suspects(members), left)
            left -= spent
        for inner, relation in known[key].items():
            found[_times(outer, inner)] = {_times(outer, s): c for s, c in relation.items()}
    return found


def _is_power_product(value: Expression) -> bool:
    return not any(_holds_function(factor) for factor in value.factors)


def _holds_function(factor: Factor) -> bool:
    base, exponent = factor
    return base.kind != "name" or exponent.denominator != 1 or exponent < 0


def _times(one: Expression, other: Expression) -> Expression:
    """Return the product of expressions that share no base."""
    return product([*one.factors, *other.factors])


def _groups(signals: Sequence[Expression]) -> dict[Expression, list[Expression]]:
    """Split off the powers of symbols that stand in no function; what is left is grouped by them.

    Signals of different groups are independent.
    """
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
    length = np.linalg.norm(matrix, axis=0)
    _, singular, directions = np.linalg.svd(matrix / np.where(length > 0, length, 1.0))
    null = directions[: len(singular)][singular < 1e-8 * singular[0]]
    return [
        s for s, direction in zip(signals, null.T, strict=True) if (abs(direction) > 1e-7).any()
    ]


def _names(signals: Sequence[Expression]) -> list[Expression]:
    return sorted(set[Expression]().union(*(s.free_symbols for s in signals)), key=str)


def _relations(
    signals: Sequence[Expression], most: int
) -> tuple[dict[Expression, Combination], int]:
    """Return the dependent signals in terms of the others, and how many nodes were evaluated.

    So many points are looked at as the independent signals that show ask for, and no more.
    """
    spent, rank = 0, min(4, len(signals))
    if not signals:
        return {}, spent
    nodes, samples = sum(map(_nodes, signals)), _samples(signals)
    rows: list[list[Real]] = []
    while True:
        wanted = len(_SCALES) * (rank + _SPARE)
        if (spent := nodes * wanted) > most:
            return {}, most
        rows += islice(samples, wanted - len(rows))
        if len(rows) < wanted:
            return {}, spent  # too few points where all are real: all count as independent
        relations = _eliminated(signals, list(rows))
        found = len(signals) - len(relations)
        if found <= rank:
            return relations, spent
        rank = min(max(found, 2 * rank), len(signals))


def _nodes(value: Expression) -> int:
    return 1 + sum(_nodes(part) for part in value.parts if isinstance(part, Expression))


def _eliminated(
    signals: Sequence[Expression], rows: list[list[Real]]
) -> dict[Expression, Combination]:
    """Return the dependent signals in terms of the others, by Gauss and Jordan."""
    from rotorid.models.exact import TOLERANCE, near

    relations: dict[Expression, Combination] = {}
    size = [max(abs(row[j]) for row in rows) for j in range(len(signals))]
    pivots: list[int] = []
    for j, signal in enumerate(signals):
        left = range(len(pivots), len(rows))
        best = max(left, key=lambda i: abs(rows[i][j]), default=None)
        if best is None:
            break  # too few points: the rest counts as independent
        if abs(rows[best][j]) <= TOLERANCE * size[j]:
            ratios = [near(row[j]) for row in rows[: len(pivots)]]
            relations[signal] = {signals[p]: c for p, c in zip(pivots, ratios, strict=True) if c}
            continue
        rows[left[0]], rows[best] = rows[best], rows[left[0]]
        _eliminate(rows, left[0], j)
        pivots.append(j)
    return relations


def _eliminate(rows: list[list[Real]], pivot: int, column: int) -> None:
    head = [value / rows[pivot][column] for value in rows[pivot]]
    for i, row in enumerate(rows):
        factor = row[column]
        rows[i] = head if i == pivot else [a - factor * b for a, b in zip(row, head, strict=True)]


def _samples(signals: Sequence[Expression]) -> Iterator[list[Real]]:
    """Evaluate signals at points where all are real, as many of each size.

    Points of one size alone would let functions that are alike there pass for dependent.
    """
    from rotorid.models.exact import values_at  # its arithmetic takes its time to load

    names, most = _names(signals), 8 * len(_SCALES) * (len(signals) + _SPARE)
    for k in range(most):
        point = {str(name): _coordinate(i, k) for i, name in enumerate(names)}
        if (values := values_at(point, signals)) is not None:
            yield values


def _coordinate(i: int, k: int) -> Fraction:
    """Return coordinate i of point k: several sizes, both signs, no pattern."""
    mixed = (7919 * (k + 1) ** 2 + 104729 * (i + 1) ** 3) % 99991
    return _SCALES[k % len(_SCALES)] * (Fraction(mixed, 49999) - 1)
