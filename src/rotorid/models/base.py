"""Base parameters: what the equations can tell apart, found from their structure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from rotorid.frozen import frozen
from rotorid.models import cost
from rotorid.models.dependence import independent_signals
from rotorid.models.expression import Expression, Monomial
from rotorid.models.terms import Product
from rotorid.record import Floats, Integers
from rotorid.units import multiply_units


@frozen
class BaseParameters:
    """Independent combinations of parameter monomials.

    ``base = gather @ monomial_values``. The merge is structural: it holds for every motion.

    Parameters
    ----------
    names, units : sequence of str
    gather : array, shape (base, monomial)
    kept : sequence of int
        The monomial of each whose column of the regressor is that of the base parameter.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    gather: Floats
    kept: tuple[int, ...]


def gather_base(
    products: Sequence[Product],
    monomials: Sequence[Monomial],
    parameters: Sequence[str],
    units: Mapping[str, str],
) -> BaseParameters:
    """Merge monomials whose columns of the regressor depend linearly on one another.

    The monomials are scanned in order: one whose column is independent of those kept is kept;
    else it is added to them with its rational coefficients.
    """
    independent = independent_signals(product.signal for product in products)
    entries: dict[tuple[int, Expression], int] = {}
    rows: dict[int, dict[int, Fraction]] = defaultdict(lambda: defaultdict(Fraction))
    position = {monomial: i for i, monomial in enumerate(monomials)}
    for product in products:
        column = position[product.monomial]
        for signal, factor in independent[product.signal].items():
            entry = entries.setdefault((product.row, signal), len(entries))
            rows[entry][column] += factor * product.coefficient
    occurring = {column for row in rows.values() for column, value in row.items() if value}
    scanned = [i for i in sorted(occurring) if any(monomials[i])]
    if not scanned:
        return BaseParameters((), (), np.zeros((0, len(monomials))), ())
    sparse = [{k: row[i] for k, i in enumerate(scanned) if row.get(i)} for row in rows.values()]
    reduced = _echelon(sparse)
    pivots = list(reduced)
    merged = [[reduced[p].get(k, Fraction(0)) for k in range(len(scanned))] for p in pivots]
    names, found_units = [], []
    gather = np.zeros((len(pivots), len(monomials)))
    for row, (pivot, ratios) in enumerate(zip(pivots, merged, strict=True)):
        for column, ratio in zip(scanned, ratios, strict=True):
            gather[row, column] = float(ratio)
        members = [(monomials[i], r) for i, r in zip(scanned, ratios, strict=True) if r]
        names.append(_combination_name(members, parameters))
        powers = zip(parameters, monomials[scanned[pivot]], strict=True)
        found_units.append(multiply_units([(units[p], n) for p, n in powers if n]))
    kept = tuple(scanned[pivot] for pivot in pivots)
    return BaseParameters(tuple(names), tuple(found_units), gather, kept)


def base_names(
    base: BaseParameters, monomials: Integers, parameters: Sequence[str]
) -> tuple[str, ...]:
    """Return the names of base parameters, the parameters called otherwise."""
    named = [monomial_name(tuple(powers), parameters) for powers in monomials.tolist()]
    found = []
    for row, kept in zip(base.gather, base.kept, strict=True):
        order = [kept, *(i for i in np.flatnonzero(row).tolist() if i != kept)]
        text = ""
        for i in order:
            factor = "" if abs(row[i]) == 1 else f"{abs(row[i]):.12g}*"
            sign = " + " if row[i] > 0 else " - "
            text += (sign if text else "") + factor + named[i]
        found.append(text)
    return tuple(found)


def _echelon(rows: Iterable[dict[int, Fraction]]) -> dict[int, dict[int, Fraction]]:
    """Return the reduced row echelon form of sparse rows, by the column of each pivot."""
    reduced: dict[int, dict[int, Fraction]] = {}
    with cost.bounded():
        for row in rows:
            _reduce(row, reduced)
    return dict(sorted(reduced.items()))


def _reduce(row: dict[int, Fraction], reduced: dict[int, dict[int, Fraction]]) -> None:
    """Add a row to those that are reduced; nothing where it follows from them."""
    for pivot in sorted(reduced.keys() & row.keys()):
        row = _without(row, pivot, reduced[pivot])
    if row:
        first = min(row)
        row = {column: value / row[first] for column, value in row.items()}
        for pivot, above in reduced.items():
            reduced[pivot] = _without(above, first, row)
        reduced[first] = row


def _without(
    row: dict[int, Fraction], column: int, pivot: dict[int, Fraction]
) -> dict[int, Fraction]:
    """Take from a row what makes one of its columns zero."""
    factor = row.get(column, Fraction(0))
    if not factor:
        return row
    cost.spend_exact(pivot.values(), factor)
    left = {k: row.get(k, Fraction(0)) - factor * pivot.get(k, Fraction(0)) for k in row | pivot}
    return {k: value for k, value in left.items() if value}


def monomial_name(monomial: Monomial, parameters: Sequence[str]) -> str:
    """Return a name such as ``k1*L1^2``."""
    factors = zip(parameters, monomial, strict=True)
    return "*".join(name if n == 1 else f"{name}^{n}" for name, n in factors if n)


def _combination_name(members: Sequence[tuple[Monomial, Any]], parameters: Sequence[str]) -> str:
    text = ""
    for monomial, ratio in members:
        size = abs(float(ratio))
        factor = "" if abs(ratio) == 1 else f"{size:.12g}*"
        sign = " + " if ratio > 0 else " - "
        text += (sign if text else "") + factor + monomial_name(monomial, parameters)
    return text
