"""Do the units of an equation agree? A check of what was typed, not a condition."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING

from rotorid.models.expression import Expression
from rotorid.models.terms import DERIVATIVES, Monomial, Product
from rotorid.units import base_powers

if TYPE_CHECKING:
    from rotorid.models.model import Model

Dimension = frozenset[tuple[str, Fraction]]  # powers of base units, none of them zero
_SAME = {"Abs"}
_NUMBER: Dimension = frozenset()


def unit_faults(model: Model) -> list[str]:
    """Return what is wrong with the units of each equation, in words.

    A product with a number in it other than a small whole one is passed over: 9.81 or 0.4 may have
    a unit of its own.
    """
    symbols = _symbol_dimensions(model)
    parameters = [_dimension(base_powers(p.unit)) for p in model.parameters]
    faults = []
    for row in range(len(model.texts)):
        found: dict[Dimension, Product] = {}
        for product in (*model.equations.left, *model.equations.right):
            if product.row == row and _is_plain(product.coefficient):
                unit = _product_dimension(product, parameters, symbols)
                if unit is not None:
                    found.setdefault(unit, product)
        if len(found) > 1:
            shown = " and in ".join(_text(unit) for unit in found)
            faults.append(f"equation {row + 1} adds terms in {shown}: check it")
    return faults


def _symbol_dimensions(model: Model) -> dict[str, Dimension]:
    found = {name: _dimension(base_powers(unit)) for name, unit in model.units.items()}
    for name in model.coordinates:
        for order, dots in enumerate(DERIVATIVES):
            found[name + dots] = _times(found[name], _dimension({"s": -order}))
    second = _dimension({"s": 1})
    return {**found, "t": second, "Omega": _power(second, Fraction(-1)), "phi": _NUMBER}


def _is_plain(coefficient: Fraction) -> bool:
    return coefficient.denominator == 1 and abs(coefficient) <= 4


def _product_dimension(
    product: Product, parameters: list[Dimension], symbols: Mapping[str, Dimension]
) -> Dimension | None:
    signal = _signal_dimension(product.signal, symbols)
    return None if signal is None else _times(_monomial(product.monomial, parameters), signal)


def _monomial(monomial: Monomial, parameters: list[Dimension]) -> Dimension:
    total = _NUMBER
    for power, unit in zip(monomial, parameters, strict=True):
        total = _times(total, _power(unit, Fraction(power)))
    return total


def _signal_dimension(signal: Expression, symbols: Mapping[str, Dimension]) -> Dimension | None:
    """Return the dimension of a signal; ``None`` where it cannot be told."""
    if signal.is_Symbol:
        return symbols[str(signal)]
    if signal.is_number:
        return _NUMBER
    inner = [_signal_dimension(argument, symbols) for argument in signal.args]
    if signal.is_Pow:
        exponent = signal.exp
        if inner[0] is None or not exponent.is_Rational:
            return None
        return _power(inner[0], Fraction(int(exponent.p), int(exponent.q)))
    if signal.is_Mul:
        total = _NUMBER
        for unit in inner:
            if unit is None:
                return None
            total = _times(total, unit)
        return total
    if signal.is_Add:
        return inner[0] if len(set(inner)) == 1 else None
    return inner[0] if signal.func.__name__ in _SAME else _NUMBER


def _dimension(powers: Mapping[str, int]) -> Dimension:
    return frozenset((atom, Fraction(power)) for atom, power in powers.items() if power)


def _times(a: Dimension, b: Dimension) -> Dimension:
    powers = dict(a)
    for atom, power in b:
        powers[atom] = powers.get(atom, Fraction(0)) + power
    return frozenset((atom, power) for atom, power in powers.items() if power)


def _power(a: Dimension, exponent: Fraction) -> Dimension:
    return frozenset((atom, power * exponent) for atom, power in a if exponent)


def _text(unit: Dimension) -> str:
    parts = [atom if power == 1 else f"{atom}^{power}" for atom, power in sorted(unit)]
    return " ".join(parts) or "plain numbers"
