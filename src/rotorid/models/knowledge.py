"""What is known beforehand: values, constraints, bounds, measured natural frequencies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from typing import Any, Generic, TypeVar

import numpy as np
import scipy

from rotorid.core.errors import InputError, naming, require_names
from rotorid.core.units import finite_speed, multiply_units, quantity, to_si
from rotorid.core.values import Floats, frozen, grouped
from rotorid.data.observation import Observation
from rotorid.models import Model
from rotorid.models.equations import polynomial

Amount = TypeVar("Amount", float, float | str)  # SI; with no model yet, perhaps a text with a unit
_SHARPEST = 1e-12
"""Deviation of a natural frequency, over itself: eigenvalues of a model are not computed better."""


def in_si(values: Mapping[str, float | str], model: Model) -> dict[str, float]:
    """Return values by name in SI: numbers as they are, texts with the units of parameters."""
    units = model.parameter_units
    return {name: quantity(x, units.get(name, "1"), place=name) for name, x in values.items()}


def own_in_si(record: Observation) -> dict[str, tuple[float, float]]:
    units = record.model.parameter_units
    found = {}
    for name, known in record.own.items():
        place, file = f"parameters.{name}", record.lines.source
        said = "{}, which is no parameter of the model"
        require_names([name], units, said, file=file, place="parameters")
        given = known if isinstance(known, tuple) else (known, 0.0)
        value, std = (quantity(number, units[name], place=place) for number in given)
        if not np.isfinite([value, std]).all() or std < 0:
            told = f"{value:g} with a deviation of {std:g}"
            expected = "finite numbers, the deviation 0 or more"
            cure = "give the value of this record, and one standard deviation or none"
            raise InputError(told, expected, cure, file=file, place=place)
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
            told = f"value {self.value} and std {self.std} of {self.expression[:60]!r}"
            cure = "give the value that the expression has, and one standard deviation or none"
            raise InputError(told, "finite numbers, the deviation not negative", cure)

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
        terms = constraint_polynomial(model, expression)
    units = [parameter.unit for parameter in model.parameters]
    found = {multiply_units(list(zip(units, p, strict=True))) for p in terms if any(p)}
    if not found:
        told, cure = repr(expression[:60]), "write parameters of the model, such as k1 - k2"
        raise InputError(told, "an expression of parameters", cure, place=place)
    first, *others = sorted(found)
    for other in others:
        to_si(f"1 {other}", first, place=f"{place}.expression")
    return first


def constraint_polynomial(model: Model, expression: str) -> dict[tuple[int, ...], float]:
    """Return an expression as ``{exponents of the parameters: coefficient}``; held ones count."""
    exact = {name: Fraction(repr(value)) for name, value in model.held}
    free = model.parameter_names
    names = list(dict.fromkeys([*free, *exact]))
    with naming(place=f"constraint {expression[:60]!r}"):
        terms = polynomial(expression, names)
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
    """Base parameters by fewer unknowns, some of them: ``base = origin + basis @ free``."""

    origin: Floats  # (base,)
    basis: Floats  # (base, free)
    kept: tuple[int, ...]  # the base parameter that each free unknown is


def eliminate(model: Model, constraints: Sequence[Constraint]) -> Elimination:
    size = len(model.base.names)
    if not constraints:
        return Elimination(np.zeros(size), np.eye(size), tuple(range(size)))
    rows, values = zip(*(base_row(model, c) for c in constraints), strict=True)
    matrix, right = np.array(rows), np.array(values)
    scale = np.abs(matrix).max(axis=1)
    matrix, right = matrix / scale[:, None], right / scale
    # Pivoted QR picks the parameters to eliminate.
    _, triangle, order = scipy.linalg.qr(matrix, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    if len(rows) > size or diagonal[-1] < 1e-10 * diagonal[0]:
        told, cure = "constraints that repeat or contradict one another", "drop one"
        raise InputError(told, "independent constraints", cure, place="constraints")
    gone, kept = order[: len(rows)], np.sort(order[len(rows) :])
    solved = np.linalg.solve(matrix[:, gone], np.column_stack([right, -matrix[:, kept]]))
    origin, basis = np.zeros(size), np.zeros((size, len(kept)))
    origin[gone], basis[gone] = solved[:, 0], solved[:, 1:]
    basis[kept, np.arange(len(kept))] = 1.0
    return Elimination(origin, basis, tuple(int(i) for i in kept))


def base_row(model: Model, constraint: Constraint) -> tuple[Floats, float]:
    """Return an exact constraint as ``row @ base = value``."""
    shown = f"the constraint {constraint.expression[:60]!r}"
    value, std = constraint.in_si
    if std > 0:
        raise InputError(f"{shown} with a deviation", "exact constraints for this method", "use ml")
    index = {tuple(m): i for i, m in enumerate(model.monomials.tolist())}
    terms = constraint_polynomial(model, constraint.expression)
    value -= terms.pop((0,) * len(model.parameters), 0.0)
    if not terms:
        told = f"{shown}, which holds no free parameter"
        raise InputError(told, "a parameter that is not fixed", "drop it")
    wanted = np.zeros(len(index))
    known = [(index[monomial], c) for monomial, c in terms.items() if monomial in index]
    for place, coefficient in known:
        wanted[place] = coefficient
    row = np.linalg.lstsq(model.base.gather.T, wanted, rcond=None)[0]
    residual = model.base.gather.T @ row - wanted
    if len(known) < len(terms) or np.abs(residual).max() > 1e-9 * max(np.abs(wanted).max(), 1e-300):
        expected, cure = f"a combination of {', '.join(model.base.names)}", "use ml"
        raise InputError(f"{shown}, not linear in the base parameters", expected, cure)
    return np.asarray(row, dtype=np.float64), value


@frozen
class Mode:
    """A natural frequency, and perhaps a damping ratio, that a test gave.

    Of ``lambda^2 M + lambda (D + Omega G) + K`` at the speed of the test: the frequency is
    ``Im lambda / (2 pi)``, with which a free vibration rings, the damping ratio
    ``- Re lambda / |lambda|``. What a controller or a force law adds is no part of it.

    Parameters
    ----------
    frequency, std : float or str
        In Hz, or texts with units.
    damping : (value, std), optional
        Damping ratio, and its deviation.
    speed : float or str
        Of the rotor in the test, in rad/s.
    parameters : mapping of str to float or str
        Parameters that were otherwise in the test, exactly: SI, or texts with units.
    mode : int, optional
        Which one it is of the distinct natural frequencies of the model in ascending order, from
        1, rigid-body modes not counted. Left out: the one after that of the next lower frequency
        measured at this speed with these parameters.

    Examples
    --------
    >>> Mode("22.6 Hz", "0.05 Hz", damping=(0.0025, 0.0005), parameters={"k": "0 N/m"}).frequency
    22.6
    """

    frequency: float | str
    std: float | str
    damping: tuple[float, float] | None = None
    speed: float | str = 0.0
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    mode: int | None = None

    def __post_init__(self) -> None:
        for name in ("frequency", "std"):
            number = float(quantity(getattr(self, name), "Hz", place=name))
            _positive(number, "Hz", name)
            object.__setattr__(self, name, number)
        if (share := float(self.std) / float(self.frequency)) < _SHARPEST:
            told = f"{self.std:g} Hz, {share:.0e} of {self.frequency:g} Hz"
            expected = f"{_SHARPEST:g} of the frequency or more: no computed mode is more exact"
            cure = "state the deviation of the test: what repeating it scatters by"
            raise InputError(told, expected, cure, place="std")
        object.__setattr__(self, "speed", finite_speed(self.speed))
        if self.damping is not None:
            value, std = map(float, self.damping)
            object.__setattr__(self, "damping", (value, std))
            if not -1 < value < 1:
                expected = "a number between -1 and 1, such as 0.0025"
                cure = "divide percent by 100"
                raise InputError(f"a damping ratio of {value:g}", expected, cure, place="damping")
            _positive(std, "", "damping.std")
        if self.mode is not None and self.mode < 1:
            raise InputError(f"{self.mode}", "1 or more", "count from 1", place="mode")

    @property
    def in_si(self) -> tuple[float, float, float]:
        """Frequency and deviation in Hz, speed in rad/s."""
        return float(self.frequency), float(self.std), float(self.speed)

    def __str__(self) -> str:
        where = "" if self.mode is None else f"mode {self.mode}, "
        hertz, _, speed = self.in_si
        turning = f" at {speed / (2 * np.pi):g} rev/s" if speed else ""
        with_ = "".join(f", {name} = {value:g}" for name, value in self.parameters.items())
        return f"{where}{hertz:.6g} Hz{turning}{with_}"


def number(mode: Mode) -> int:
    assert mode.mode is not None  # `configurations` settles it
    return mode.mode


def _positive(value: float, unit: str, place: str) -> None:
    if not 0 < value < np.inf:
        raise InputError(
            f"{value:g} {unit}".rstrip(),
            "a number above 0",
            "state the deviation of the test: what repeating it scatters by"
            if place.endswith("std")
            else "give what the test found",
            place=place,
        )


def in_units_of(model: Model, mode: Mode) -> Mode:
    found = "{} in the parameters of a mode"
    require_names(mode.parameters, model.parameter_names, found, place="modes")
    return replace(mode, parameters=in_si(mode.parameters, model))


def configurations(modes: Sequence[Mode]) -> list[list[Mode]]:
    """Group modes by speed and parameters, numbered in ascending order, on from a stated number."""
    groups = grouped(((m.speed, frozenset(m.parameters.items())), m) for m in modes)
    numbered: list[list[Mode]] = []
    for group in groups.values():
        found: list[Mode] = []
        for mode in sorted(group, key=lambda m: m.in_si[0]):
            last = number(found[-1]) if found else 0
            own = last + 1 if mode.mode is None else mode.mode
            if own < last:
                expected = "numbers that rise with the frequencies"
                cure = "correct mode, or a frequency"
                raise InputError(f"{mode}, above {found[-1]}", expected, cure, place="modes")
            found.append(replace(mode, mode=own))
        numbered.append(found)
    return numbered


@frozen
class Knowledge(Generic[Amount]):
    fixed: Mapping[str, Amount] = field(default_factory=dict)  # exactly, nuisances too
    constraints: tuple[Constraint, ...] = ()
    known: Mapping[str, tuple[Amount, Amount]] = field(default_factory=dict)  # value, deviation
    start: Mapping[str, Amount] = field(default_factory=dict)  # never biases the estimate
    # of polynomials in the parameters; ``None`` for no bound
    bounds: Mapping[str, tuple[Amount | None, Amount | None]] = field(default_factory=dict)
    modes: tuple[Mode, ...] = ()

    def held(self, model: Model) -> dict[str, float]:
        return {n: float(v) for n, v in self.fixed.items() if n in model.parameter_names}

    def knowledge(self, model: Model) -> Knowledge[float]:
        """Return what is known beforehand of the parameters of a model, in SI."""
        pairs = ({name: pair[k] for name, pair in self.known.items()} for k in (0, 1))
        values, deviations = (in_si(each, model) for each in pairs)
        return Knowledge(
            in_si(self.fixed, model),
            constraints_in_si(self.constraints, model),
            {name: (value, deviations[name]) for name, value in values.items()},
            in_si(self.start, model),
            {text: _numbers(text, ends, model, "bounds of") for text, ends in self.bounds.items()},
            tuple(in_units_of(model, mode) for mode in self.modes),
        )
