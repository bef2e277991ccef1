"""What is known beforehand: constraints between parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import scipy

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.frozen import frozen
from rotorid.core.units import multiply_units, quantity, to_si
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.models import Model
from rotorid.models.equations import polynomial

Bounds = Mapping[str, tuple[float | str | None, float | str | None]]


def in_si(values: Mapping[str, float | str], model: Model) -> dict[str, float]:
    """Return values by name in SI: numbers as they are, texts with the units of parameters."""
    units = model.parameter_units
    return {
        name: quantity(value, units.get(name, "1"), place=name) for name, value in values.items()
    }


def own_in_si(record: Observation) -> dict[str, tuple[float, float]]:
    """Return the parameters that a record has to itself, value and deviation in SI."""
    units = record.model.parameter_units
    found = {}
    for name, known in record.own.items():
        place, file = f"parameters.{name}", record.lines.source
        said = "{}, which is no parameter of the model"
        require_names([name], units, said, file=file, place="parameters")
        given = known if isinstance(known, tuple) else (known, 0.0)
        value, std = (quantity(number, units[name], place=place) for number in given)
        if not np.isfinite([value, std]).all() or std < 0:
            raise InputError(
                f"{value:g} with a deviation of {std:g}",
                "finite numbers, the deviation 0 or more",
                "give the value of this record, and one standard deviation or none",
                file=file,
                place=place,
            )
        found[name] = (value, std)
    return found


@frozen
class Constraint:
    """``expression = value``, exactly or with a standard deviation.

    Parameters
    ----------
    expression : str
        A polynomial in the physical parameters, in the grammar of model files.
    value, std : float or str
        SI, or texts with a unit; a `std` of 0 means exactly.

    Examples
    --------
    >>> Constraint("m1 + m2 + m3", "12.99 kg", "10 g").std
    '10 g'
    """

    expression: str
    value: float | str
    std: float | str = 0.0

    def __post_init__(self) -> None:
        numbers = [n for n in (self.value, self.std) if not isinstance(n, str)]
        if not np.isfinite(numbers).all() or (not isinstance(self.std, str) and self.std < 0):
            raise InputError(
                f"value {self.value} and std {self.std} of {self.expression[:60]!r}",
                "finite numbers, the deviation not negative",
                "give the value that the expression has, and one standard deviation or none",
            )

    @property
    def in_si(self) -> tuple[float, float]:
        """Value and deviation where both are numbers: see `constraints_in_si`."""
        return float(self.value), float(self.std)


def constraints_in_si(constraints: Sequence[Constraint], model: Model) -> tuple[Constraint, ...]:
    """Return constraints in SI: numbers as they are, texts with the unit of the expression."""
    return tuple(
        Constraint(c.expression, *_numbers(c.expression, (c.value, c.std), model, "constraint"))
        for c in constraints
    )


def bounds_in_si(bounds: Bounds, model: Model) -> dict[str, tuple[float | None, float | None]]:
    """Return bounds in SI: numbers as they are, texts with the unit of the expression."""
    return {text: _numbers(text, ends, model, "bounds of") for text, ends in bounds.items()}


def _numbers(expression: str, given: tuple[Any, Any], model: Model, what: str) -> tuple[Any, Any]:
    place = f"{what} {expression[:60]!r}"
    if not any(isinstance(one, str) for one in given):
        return given
    unit = unit_of_expression(expression, model, place)
    low, high = (quantity(x, unit, place=place) if isinstance(x, str) else x for x in given)
    return low, high


def unit_of_expression(expression: str, model: Model, place: str) -> str:
    """Return the unit of a polynomial in the parameters; refuse sums of unlike units."""
    with naming(place=place):
        terms = constraint_polynomial(model, Constraint(expression, 0.0))
    units = [parameter.unit for parameter in model.parameters]
    found = {multiply_units(list(zip(units, p, strict=True))) for p in terms if any(p)}
    if not found:
        raise InputError(
            repr(expression[:60]),
            "an expression of parameters",
            "write parameters of the model, such as k1 - k2",
            place=place,
        )
    first, *others = sorted(found)
    for other in others:
        to_si(f"1 {other}", first, place=f"{place}.expression")
    return first


def constraint_polynomial(
    model: Model, constraint: Constraint, fixed: Mapping[str, float] | None = None
) -> dict[tuple[int, ...], float]:
    """Return a constraint's expression as ``{exponents of the parameters: coefficient}``."""
    exact = {name: Fraction(repr(float(value))) for name, value in (fixed or {}).items()}
    free = model.parameter_names
    names = list(dict.fromkeys([*free, *exact]))
    with naming(place=f"constraint {constraint.expression[:60]!r}"):
        terms = polynomial(constraint.expression, names)
    found: dict[tuple[int, ...], Fraction] = {}
    for powers, coefficient in terms.items():
        by_name = dict(zip(names, powers, strict=True))
        for name, value in exact.items():
            coefficient *= value ** by_name[name]
        kept = tuple(0 if name in exact else by_name[name] for name in free)
        found[kept] = found.get(kept, Fraction(0)) + coefficient
    return {m: float(c) for m, c in found.items() if c} or {(0,) * len(free): 0.0}


@frozen
class Elimination:
    """Base parameters written with fewer unknowns: ``base = origin + basis @ free``.

    Each exact constraint eliminates one base parameter, so that the free unknowns are base
    parameters themselves and equations keep what they do not share.
    """

    origin: Floats  # (base,)
    basis: Floats  # (base, free)
    kept: tuple[int, ...]  # the base parameter that each free unknown is


def eliminate(
    model: Model, constraints: Sequence[Constraint], fixed: Mapping[str, float] | None = None
) -> Elimination:
    """Eliminate exact constraints that are linear in the base parameters."""
    size = len(model.base.names)
    if not constraints:
        return Elimination(np.zeros(size), np.eye(size), tuple(range(size)))
    rows, values = zip(*(base_row(model, c, fixed) for c in constraints), strict=True)
    matrix, right = np.array(rows), np.array(values)
    scale = np.abs(matrix).max(axis=1)
    matrix, right = matrix / scale[:, None], right / scale
    # Pivoted QR picks the parameters to eliminate.
    _, triangle, order = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    if len(rows) > size or diagonal[-1] < 1e-10 * diagonal[0]:
        raise InputError(
            "constraints that repeat or contradict one another",
            "independent constraints",
            "drop one",
            place="constraints",
        )
    gone, kept = order[: len(rows)], np.sort(order[len(rows) :])
    solved = np.linalg.solve(matrix[:, gone], np.column_stack([right, -matrix[:, kept]]))
    origin, basis = np.zeros(size), np.zeros((size, len(kept)))
    origin[gone], basis[gone] = solved[:, 0], solved[:, 1:]
    basis[kept, np.arange(len(kept))] = 1.0
    return Elimination(origin, basis, tuple(int(i) for i in kept))


def base_row(
    model: Model, constraint: Constraint, fixed: Mapping[str, float] | None
) -> tuple[Floats, float]:
    """Return an exact constraint as ``row @ base = value``."""
    shown = f"the constraint {constraint.expression[:60]!r}"
    value, std = constraint.in_si
    if std > 0:
        raise InputError(f"{shown} with a deviation", "exact constraints for this method", "use ml")
    index = {tuple(int(e) for e in m): i for i, m in enumerate(model.monomials)}
    wanted = np.zeros(len(index))
    linear = True
    for monomial, coefficient in constraint_polynomial(model, constraint, fixed).items():
        if not any(monomial):
            value -= coefficient
        elif monomial in index:
            wanted[index[monomial]] += coefficient
        else:
            linear = False
    if linear and not wanted.any():
        raise InputError(
            f"{shown}, which holds no free parameter", "a parameter that is not fixed", "drop it"
        )
    row = np.linalg.lstsq(model.base.gather.T, wanted, rcond=None)[0]
    residual = model.base.gather.T @ row - wanted
    if not linear or np.abs(residual).max() > 1e-9 * max(np.abs(wanted).max(), 1e-300):
        raise InputError(
            f"{shown}, not linear in the base parameters",
            f"a combination of {', '.join(model.base.names)}",
            "use ml",
        )
    return np.asarray(row, dtype=np.float64), value
