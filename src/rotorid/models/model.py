"""`Model`: equations of motion, their parameters, and the regressor that follows from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from functools import cached_property
from textwrap import shorten
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from rotorid.core.errors import InputError, ModelError, require_names
from rotorid.core.tables import page_html, table
from rotorid.core.toml import Schema
from rotorid.core.units import Dimension, check_unit, si_factor
from rotorid.core.values import Floats, Integers, fact, frozen
from rotorid.models.base import BaseParameters, base_names, gather_base
from rotorid.models.equations import (
    DERIVATIVES,
    Product,
    product_dimensions,
    sort_monomials,
    unit_faults,
)
from rotorid.models.expressions import RESERVED, Expression, Monomial, evaluate, symbol
from rotorid.models.linear_form import (
    InputTerm,
    LinearForm,
    StiffnessTable,
    Term,
    classify,
    motion_factor,
)
from rotorid.models.parser import out_of_range


@frozen
class Parameter:
    """A physical parameter: its SI unit, a starting value (SI), and whether it is positive."""

    name: str
    unit: str
    nominal: float | None = None
    positive: bool = False


class DeclaredParameter(Schema):
    """A parameter as a file declares it."""

    unit: str
    nominal: float | None = Field(None, allow_inf_nan=False)
    positive: bool = False

    def parameter(self, name: str) -> Parameter:
        place = f"parameters.{name}.unit"
        unit = check_unit(self.unit, place=place)
        factor = si_factor(self.unit, place=place)
        nominal = None if self.nominal is None else self.nominal * factor
        if self.positive and nominal is not None and nominal <= 0:
            expected = "a positive number, since positive = true"
            cure = "give a nominal above 0, or leave out positive"
            raise ModelError(f"{self.nominal}", expected, cure, place=f"parameters.{name}.nominal")
        return Parameter(name, unit, nominal, self.positive)


@frozen
class Motion:
    """Signals at which equations are evaluated; leading axes broadcast."""

    # (..., sample, coordinate)
    position: Floats
    velocity: Floats
    acceleration: Floats
    # (..., sample): t in s, phi in rad
    time: Floats
    angle: Floats
    speed: float | Floats  # float or array, shape (..., sample): omega in rad/s


@frozen
class Model:
    """Equations of motion as text, with what follows from them.

    Left sides ``sum coefficient * mu[monomial] * signal`` equal right sides ``B u``; the signals
    are functions of q, q', q'', t, phi and Omega, and mu are monomials of the parameters.

    Parameters
    ----------
    name, title, source : str
    texts : sequence of str
        The equations.
    coordinates, inputs : sequence of str
        Their names, in order.
    units : mapping of str to str
        SI unit of each coordinate and input.
    parameters : sequence of Parameter
    equations : sequence of Product
        The texts, expanded: terms of the left sides, then those of the right sides.
    file_text : str
        The model file that it was read from, whole; "" for a model put together otherwise.
    held : sequence of (name, value)
        What `substitute` has replaced since, SI.
    before : Model, optional
        The model as it was before anything was replaced.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> load_model("emps").base.names
    ('M', 'Fv', 'Fc', 'offset')
    """

    name: str
    title: str
    source: str
    texts: tuple[str, ...]
    coordinates: tuple[str, ...]
    inputs: tuple[str, ...]
    units: Mapping[str, str]
    parameters: tuple[Parameter, ...]
    equations: tuple[Product, ...]
    file_text: str = field(default="", compare=False, repr=False)
    held: tuple[tuple[str, float], ...] = field(default=(), repr=False)
    before: Model | None = field(default=None, compare=False, repr=False)

    @property
    def typed(self) -> Model:
        """The model with no parameter replaced by a number."""
        return self.before or self

    @property
    def readings(self) -> Mapping[str, Mapping[str, float]]:
        """Names that a sensor may read besides the coordinates, as combinations of these."""
        return {}

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def parameter_units(self) -> dict[str, str]:
        """Units of the parameters by name."""
        return {p.name: p.unit for p in self.parameters}

    @property
    def nominal(self) -> dict[str, float]:
        """Nominal values (SI) of the parameters that have one."""
        return {p.name: p.nominal for p in self.parameters if p.nominal is not None}

    @cached_property
    def _monomials(self) -> list[Monomial]:
        return sort_monomials({p.monomial for p in self.equations})

    @cached_property
    def sides(self) -> tuple[list[Product], list[Product]]:
        """The terms of the left sides, and those of the right, whose signals are inputs."""
        inputs = set(map(symbol, self.inputs))
        right = [p for p in self.equations if p.signal in inputs]
        return [p for p in self.equations if p.signal not in inputs], right

    @cached_property
    def _places(self) -> dict[Monomial, int]:
        return {monomial: i for i, monomial in enumerate(self._monomials)}

    @cached_property
    def monomials(self) -> Integers:
        """Exponents of the parameters in each monomial, shape (monomial, parameter)."""
        shape = (len(self._monomials), len(self.parameters))
        return np.array(self._monomials, dtype=np.int64).reshape(shape)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The left sides."""
        place, left = self._places, self.sides[0]
        return tuple(Term(p.row, place[p.monomial], float(p.coefficient), p.signal) for p in left)

    @cached_property
    def input_terms(self) -> tuple[InputTerm, ...]:
        """The right sides."""
        index = {symbol(name): i for i, name in enumerate(self.inputs)}
        place = self._places
        return tuple(
            InputTerm(p.row, index[p.signal], place[p.monomial], float(p.coefficient))
            for p in self.sides[1]
        )

    @cached_property
    def base(self) -> BaseParameters:
        """The base parameters; their map from the monomials is ``base.gather``."""
        units = self.parameter_units
        return gather_base(self.sides[0], self._monomials, self.parameter_names, units)

    def monomial_values(self, values: ArrayLike) -> Floats:
        """Return mu, shape (monomial,), from parameter values, shape (parameter,), SI."""
        return np.asarray(np.prod(np.asarray(values, dtype=float) ** self.monomials, axis=1))

    def monomial_jacobian(self, values: ArrayLike) -> Floats:
        """Return d mu / d parameters, shape (monomial, parameter)."""
        x, each = np.asarray(values, dtype=float), np.eye(len(self.parameters), dtype=bool)[:, None]
        slopes = self.monomials * x ** np.maximum(self.monomials - 1, 0)
        return np.asarray(np.where(each, slopes, x**self.monomials).prod(axis=2).T)

    def base_values(self, values: ArrayLike) -> Floats:
        """Return the base parameters, shape (base,), from physical ones, shape (parameter,)."""
        return self.base.gather @ self.monomial_values(values)

    def base_jacobian(self, values: ArrayLike) -> Floats:
        """Return d base / d physical, shape (base, parameter)."""
        return self.base.gather @ self.monomial_jacobian(values)

    def base_named(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the names of the base parameters, the parameters called otherwise."""
        return base_names(self.base.gather, self.base.kept, self._monomials, names)

    def values(self, by_name: Mapping[str, float]) -> Floats:
        """Return parameter values in order, shape (parameter,), from values by name.

        Raises
        ------
        InputError
            Where one is missing.
        """
        missing = [name for name in self.parameter_names if name not in by_name]
        if missing:
            told = f"no value of {', '.join(missing)}"
            raise InputError(told, "a value of every parameter", "give it")
        return np.array([by_name[name] for name in self.parameter_names], dtype=float)

    def substitute(self, fixed: Mapping[str, float]) -> Self:
        """Return the model with some parameters replaced by numbers (SI).

        Raises
        ------
        InputError
            For names that are no parameters, and values that are not finite or too large.
        """
        require_names(fixed, self.parameter_names, "no parameter {}")
        for name, value in fixed.items():
            if not np.isfinite(value):
                cure = "give its value, or leave it out"
                raise InputError(f"{value} for {name}", "a finite number", cure)
        return self._replaced(tuple(fixed.items())) if fixed else self

    def redrawn(self, values: Mapping[str, float]) -> Model:
        """Return the model for values by name: equations are the same for all, drawings are not."""
        return self

    @fact
    def _replaced(self, held: tuple[tuple[str, float], ...]) -> Self:
        fixed = dict(held)
        kept = tuple(p for p in self.parameters if p.name not in fixed)
        return replace(
            self,
            parameters=kept,
            held=(*self.held, *((name, float(value)) for name, value in fixed.items())),
            before=self.typed,
            **self._with_numbers(fixed),
        )

    def _with_numbers(self, fixed: Mapping[str, float]) -> dict[str, Any]:
        """Return the fields that hold the equations, with numbers in place of parameters."""
        exact = {name: Fraction(repr(float(value))) for name, value in fixed.items()}
        gathered: dict[tuple[int, Monomial, Expression], Fraction] = {}
        for product in self.equations:
            coefficient, monomial = product.coefficient, []
            for name, power in zip(self.parameter_names, product.monomial, strict=True):
                if name in exact:
                    coefficient *= exact[name] ** power
                else:
                    monomial.append(power)
            key = (product.row, tuple(monomial), product.signal)
            gathered[key] = gathered.get(key, Fraction(0)) + coefficient
        kept = [Product(row, m, c, signal) for (row, m, signal), c in gathered.items() if c != 0]
        if any(out_of_range(product.coefficient) for product in kept):
            raise InputError("fixed values too large or too small", "SI values", "check units")
        return {"equations": tuple(kept)}

    @cached_property
    def input_matrix(self) -> Floats:
        """B, shape (row, input), where no parameter multiplies an input.

        Raises
        ------
        ModelError
            Where one does.
        """
        matrix = np.zeros((len(self.texts), len(self.inputs)))
        for term in self.input_terms:
            if self.monomials[term.monomial].any():
                held = self.parameter_names[int(self.monomials[term.monomial].argmax())]
                told = f"{held}, which multiplies the input {self.inputs[term.input]}"
                expected = "inputs with known factors"
                cure = "divide the equation by it, fix its value, or use ml"
                raise ModelError(told, expected, cure, place=f"equation {term.row + 1}")
            matrix[term.row, term.input] += term.coefficient
        return matrix

    @cached_property
    def signals(self) -> tuple[Expression, ...]:
        """The different signals of the left sides."""
        return tuple(dict.fromkeys(term.signal for term in self.terms))

    @cached_property
    def coefficients(self) -> tuple[Floats, Floats]:
        """What multiplies each signal: the left sides are ``s @ (coefficients @ base + known)``.

        Shapes (signal, row, base) and (signal, row).
        """
        signals = {signal: i for i, signal in enumerate(self.signals)}
        columns = {monomial: base for base, monomial in enumerate(self.base.kept)}
        coefficients = np.zeros((len(signals), len(self.texts), len(columns)))
        known = np.zeros(coefficients.shape[:2])
        for term in self.terms:
            if term.monomial in columns:
                index = (signals[term.signal], term.row, columns[term.monomial])
                coefficients[index] += term.coefficient
            elif not self.monomials[term.monomial].any():
                known[signals[term.signal], term.row] += term.coefficient
        return coefficients, known

    @cached_property
    def motion_factors(self) -> tuple[tuple[int, int, Expression] | None, ...]:
        """Which signals are a derivative of one coordinate; see `motion_factor`."""
        return tuple(motion_factor(signal, self.coordinates) for signal in self.signals)

    def moves(self, index: int) -> bool:
        """Tell whether a signal depends on the motion, not on t, phi and Omega alone."""
        return not self.signals[index].free_symbols <= {symbol(name) for name in RESERVED}

    @property
    def nonlinear(self) -> bool:
        """Whether a signal is not linear in the motion."""
        factors = enumerate(self.motion_factors)
        return any(factor is None and self.moves(index) for index, factor in factors)

    def arrays(self, motion: Motion) -> dict[str, Floats]:
        """Return what the symbols of a signal stand for."""
        derivatives = (motion.position, motion.velocity, motion.acceleration)
        arrays = {
            name + dots: array[..., j]
            for j, name in enumerate(self.coordinates)
            for dots, array in zip(DERIVATIVES, derivatives, strict=True)
        }
        return arrays | {"t": motion.time, "phi": motion.angle, "Omega": np.asarray(motion.speed)}

    def signal_value(
        self, index: int, motion: Motion, known: Mapping[Expression, Floats] | None = None
    ) -> Floats:
        """Evaluate a signal; it has the axes (..., sample) that it depends on, or none.

        `known` parts of it are not computed.
        """
        return evaluate(self.signals[index], self.arrays(motion), known)

    @cached_property
    def dimensions(self) -> tuple[Dimension | None, ...]:
        """The dimension of each of the `equations`; ``None`` where it cannot be told."""
        units = [parameter.unit for parameter in self.parameters]
        return tuple(product_dimensions(self.equations, units, self.units, self.coordinates))

    @cached_property
    def unit_faults(self) -> tuple[str, ...]:
        """What is wrong with the units of the equations, in words."""
        return tuple(unit_faults(self.equations, self.dimensions))

    @fact
    def require_linear(self) -> LinearForm:
        """Return the linear form.

        Raises
        ------
        ModelError
            Naming the term that is not linear.
        """
        stiffness, loads = self._linear_terms()
        return LinearForm(
            rows=len(self.texts),
            coordinates=len(self.coordinates),
            inputs=len(self.inputs),
            stiffness=stiffness,
            input_terms=self.input_terms,
            load_terms=loads,
            monomial_values=self.monomial_values,
            monomials=len(self._monomials),
        )

    def _linear_terms(self) -> tuple[StiffnessTable, tuple[Term, ...]]:
        return classify(self.terms, self.coordinates)

    def __repr__(self) -> str:
        inputs = ", ".join(self.inputs) or "none"
        found = f"coordinates {', '.join(self.coordinates)}; inputs {inputs}"
        return f"<Model {shorten(self.name, 40)}: {shorten(found, 160, placeholder='...')}>"

    def _repr_html_(self) -> str:
        """Return title, equations, and what stands in them, for a notebook."""
        rows = [(p.name, "parameter", p.unit) for p in self.parameters]
        rows += [(name, "coordinate", self.units[name]) for name in self.coordinates]
        rows += [(name, "input", self.units[name]) for name in self.inputs]
        numbered = [f"{i + 1}. {' '.join(text.split())}" for i, text in enumerate(self.texts)]
        return page_html([self.title, *numbered, table(("name", "what", "unit"), rows)])

    @property
    def measurable(self) -> tuple[str, ...]:
        """The coordinates that a sensor could read: all but the modes of a reduced rotor."""
        return self.coordinates

    @cached_property
    def linear(self) -> LinearForm | None:
        """The linear form, or ``None`` where the equations are not linear in the coordinates."""
        try:
            return self.require_linear()
        except ModelError:
            return None
