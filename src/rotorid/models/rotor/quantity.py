"""Quantities of a drawing: a number with its unit, or a polynomial of parameters and the speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod

from rotorid.errors import InputError, ModelError
from rotorid.frozen import frozen
from rotorid.models.terms import polynomial
from rotorid.units import dimension_of, multiply_units, to_si

SPEED = "Omega"
Factors = tuple[tuple[str, int], ...]


@frozen
class Quantity:
    """A sum of ``coefficient * product of powers of names``, in SI.

    Examples
    --------
    >>> read_quantity("1.5 kg", "kg", {})
    Quantity(terms=(((), 1.5),))
    >>> read_quantity("k_0 + k_2*Omega^2", "N/m", {"k_0": "N/m", "k_2": "N s^2/m"}).names
    ('k_0', 'k_2')
    """

    terms: tuple[tuple[Factors, float], ...]

    @classmethod
    def of(cls, number: float) -> Quantity:
        """Return a number."""
        return cls((((), float(number)),) if number else ())

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters in it."""
        every = (name for factors, _ in self.terms for name, _ in factors if name != SPEED)
        return tuple(dict.fromkeys(every))

    @property
    def number(self) -> float | None:
        """Its value where it is a number."""
        if any(factors for factors, _ in self.terms):
            return None
        return sum(coefficient for _, coefficient in self.terms)

    def times(self, other: Quantity) -> Quantity:
        """Return the product."""
        found: dict[Factors, float] = {}
        for mine, a in self.terms:
            for yours, b in other.terms:
                powers = dict(mine)
                for name, power in yours:
                    powers[name] = powers.get(name, 0) + power
                key = tuple(sorted(powers.items()))
                found[key] = found.get(key, 0.0) + a * b
        return Quantity(tuple(found.items()))

    def value(self, values: Mapping[str, float]) -> float:
        """Return its value at values of the names, all of which are there."""
        return sum(c * prod(values[name] ** n for name, n in f) for f, c in self.terms)


NONE = Quantity(())
ONE = Quantity.of(1.0)


def read_quantity(
    text: str | float, unit: str, parameters: Mapping[str, str], *, place: str = ""
) -> Quantity:
    """Return a quantity of the expected unit; `parameters` are the units of those declared."""
    if not isinstance(text, str):
        return Quantity.of(to_si(text, unit, place=place))
    try:
        return Quantity.of(to_si(text, unit, place=place))
    except InputError as error:
        if not _holds_a_name(text, [*parameters, SPEED]):
            raise _help(error, text, unit, parameters) from None
    return _of_names(text, unit, parameters, place)


def _holds_a_name(text: str, names: Sequence[str]) -> bool:
    """Tell whether a declared name stands in a text by itself."""
    marked = "".join(c if c.isalnum() or c == "_" else " " for c in text)
    return not set(marked.split()).isdisjoint(names)


def _help(error: InputError, text: str, unit: str, parameters: Mapping[str, str]) -> InputError:
    """Return the error of a text that is neither a number nor holds a declared name."""
    if not text.strip()[:1].isalpha():
        return error
    return ModelError(
        repr(text[:60]),
        f"a number with a unit, such as '1 {unit}', or a name in [parameters]"
        + (f": {', '.join([*parameters][:8])}" if parameters else ""),
        "write the unit, or declare the parameter",
        place=error.place,
    )


def _of_names(text: str, unit: str, parameters: Mapping[str, str], place: str) -> Quantity:
    """Return a polynomial of names; every term must have the expected unit."""
    names = [*parameters, SPEED]
    units = {**parameters, SPEED: "rad/s"}
    try:
        found = polynomial(text, names)
    except InputError as error:
        raise error.at(place=place) from None
    terms = []
    for powers, coefficient in found.items():
        factors = tuple((name, n) for name, n in zip(names, powers, strict=True) if n)
        if not coefficient:
            continue
        own = multiply_units([(units[name], n) for name, n in factors])
        if dimension_of(own) != dimension_of(unit):
            raise ModelError(
                f"a term in {own} in {text[:60]!r}",
                f"terms in {unit}",
                "give each parameter the unit that it needs there; declare a number that stands "
                "beside others as a parameter too, and fix its value",
                place=place,
            )
        terms.append((tuple(sorted(factors)), float(coefficient)))
    return Quantity(tuple(terms))
