"""Functions that depend linearly on one another whatever their arguments, as 1, sin^2 and cos^2.

Products of powers of symbols are independent. Where functions, roots or divisions appear, the
signals are evaluated at points without a pattern; those that double precision cannot tell apart
once more to a hundred digits, and the relations between the columns found by elimination: with so
many digits a relation at more points than signals is an identity.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import takewhile

import numpy as np

from rotorid.models.evaluation import MAX_VALUE, evaluate
from rotorid.models.expression import Expression, Factor, number, product

_DIGITS = 100
_TOLERANCE = Decimal("1e-40")  # what is left of a dependent column
_MAX_GROUP = 80  # signals; larger groups count as independent
_SCALES = (Fraction(1), Fraction(3), Fraction(1, 30), Fraction(1, 10**5))

Combination = Mapping[Expression, Fraction]


def independent_signals(signals: Iterable[Expression]) -> dict[Expression, Combination]:
    """Write each signal as a combination of independent ones."""
    everything = list(dict.fromkeys(signals))
    found: dict[Expression, Combination] = {s: {s: Fraction(1)} for s in everything}
    for outer, members in _groups(everything).items():
        if 1 < len(members) <= _MAX_GROUP and not all(_is_power_product(m) for m in members):
            for inner, relation in _relations(_suspects(members)).items():
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


def _relations(signals: Sequence[Expression]) -> dict[Expression, Combination]:
    """Return the dependent signals in terms of the others, by Gauss and Jordan."""
    relations: dict[Expression, Combination] = {}
    if not signals:
        return relations
    with localcontext() as context:
        context.prec = _DIGITS
        rows = _samples(signals)
        size = [max((abs(row[j]) for row in rows), default=0) for j in range(len(signals))]
        pivots: list[int] = []
        for j, signal in enumerate(signals):
            left = range(len(pivots), len(rows))
            best = max(left, key=lambda i: abs(rows[i][j]), default=None)
            if best is None:
                break  # too few points: the rest counts as independent
            if abs(rows[best][j]) <= _TOLERANCE * size[j]:
                ratios = [_near(row[j]) for row in rows[: len(pivots)]]
                relations[signal] = {
                    signals[p]: c for p, c in zip(pivots, ratios, strict=True) if c
                }
                continue
            rows[left[0]], rows[best] = rows[best], rows[left[0]]
            _eliminate(rows, left[0], j)
            pivots.append(j)
    return relations


def _eliminate(rows: list[list[Decimal]], pivot: int, column: int) -> None:
    head = [value / rows[pivot][column] for value in rows[pivot]]
    for i, row in enumerate(rows):
        factor = row[column]
        rows[i] = head if i == pivot else [a - factor * b for a, b in zip(row, head, strict=True)]


def _samples(signals: Sequence[Expression]) -> list[list[Decimal]]:
    """Evaluate signals at points where all are real; of each size five more than signals.

    Points of one size alone would let functions that are alike there pass for dependent.
    """
    from rotorid.models.symbolic import to_sympy  # its arithmetic of any length

    names, wanted, rows = _names(signals), len(_SCALES) * (len(signals) + 5), []
    symbols, symbolic = ([to_sympy(v) for v in values] for values in (names, signals))
    for k in range(8 * wanted):
        point = {name: to_sympy(number(_coordinate(i, k))) for i, name in enumerate(symbols)}
        values = (signal.evalf(_DIGITS, subs=point) for signal in symbolic)
        real = list(takewhile(lambda value: value.is_Float or value.is_Rational, values))
        if len(real) == len(signals):
            rows.append([Decimal(str(value)) for value in real])
        if len(rows) == wanted:
            return rows
    return []


def _coordinate(i: int, k: int) -> Fraction:
    """Return coordinate i of point k: several sizes, both signs, no pattern."""
    mixed = (7919 * (k + 1) ** 2 + 104729 * (i + 1) ** 3) % 99991
    return _SCALES[k % len(_SCALES)] * (Fraction(mixed, 49999) - 1)


def _near(value: Decimal) -> Fraction:
    """Return the simple fraction that a number is, else the number in double precision."""
    simple = Fraction(value).limit_denominator(10**6)
    if abs(Fraction(value) - simple) < Fraction(1, 10**30):
        return simple
    return Fraction(repr(float(value)))
