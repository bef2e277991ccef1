"""Do the units of an equation agree? A check of what was typed, not a condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from rotorid.models.expression import Expression, Monomial
from rotorid.models.terms import DERIVATIVES, Product
from rotorid.unit_text import Dimension
from rotorid.units import dimension_of

_SAME = {"abs"}
_NUMBER = Dimension()


def unit_faults(
    products: Sequence[Product],
    parameter_units: Sequence[str],
    units: Mapping[str, str],
    coordinates: Sequence[str],
) -> list[str]:
    """Return what is wrong with the units of each equation, in words.

    A product with a number in it other than a small whole one is passed over: 9.81 or 0.4 may have
    a unit of its own.
    """
    symbols = symbol_dimensions(units, coordinates)
    parameters = [dimension_of(unit) for unit in parameter_units]
    faults = []
    for row in sorted({product.row for product in products}):
        plain = [p for p in products if p.row == row and _is_plain(p.coefficient)]
        told = [product_dimension(product, parameters, symbols) for product in plain]
        found = dict.fromkeys(unit for unit in told if unit is not None)
        if len(found) > 1:
            shown = " and in ".join(str(unit) for unit in found)
            faults.append(f"equation {row + 1} adds terms in {shown}: check it")
    return faults


def symbol_dimensions(units: Mapping[str, str], coordinates: Sequence[str]) -> dict[str, Dimension]:
    """Return the dimension of each name that an equation may hold besides parameters."""
    second = dimension_of("s")
    found = {name: dimension_of(unit) for name, unit in units.items()}
    for name in coordinates:
        for order, dots in enumerate(DERIVATIVES):
            found[name + dots] = found[name] * second**-order
    return {**found, "t": second, "Omega": second**-1, "phi": _NUMBER}


def _is_plain(coefficient: Fraction) -> bool:
    return coefficient.denominator == 1 and abs(coefficient) <= 4


def product_dimension(
    product: Product, parameters: list[Dimension], symbols: Mapping[str, Dimension]
) -> Dimension | None:
    """Return the dimension of a product; ``None`` where it cannot be told."""
    signal = _signal_dimension(product.signal, symbols)
    return None if signal is None else _monomial(product.monomial, parameters) * signal


def _monomial(monomial: Monomial, parameters: list[Dimension]) -> Dimension:
    total = _NUMBER
    for power, unit in zip(monomial, parameters, strict=True):
        if power:
            total = total * unit**power
    return total


def _signal_dimension(signal: Expression, symbols: Mapping[str, Dimension]) -> Dimension | None:
    """Return the dimension of a signal; ``None`` where it cannot be told."""
    if signal.kind == "name":
        return symbols[str(signal)]
    if not signal.free_symbols:
        return _NUMBER
    if signal.kind in ("product", "power"):
        total = _NUMBER
        for base, exponent in signal.factors:
            unit = _signal_dimension(base, symbols)
            if unit is None:
                return None
            total = total * unit**exponent
        return total
    inner = [_signal_dimension(part, symbols) for part in signal.parts]
    if signal.kind == "sum":
        return inner[0] if len(set(inner)) == 1 else None
    return inner[0] if signal.kind in _SAME else _NUMBER
