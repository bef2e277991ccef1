"""The drawing of a rotor: sections, discs, supports, places, and their quantities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from functools import cached_property
from itertools import pairwise
from math import ceil, prod

import numpy as np

from rotorid.core.errors import InputError, ModelError, naming
from rotorid.core.frozen import frozen
from rotorid.core.units import dimension_of, multiply_units, to_si
from rotorid.core.values import Floats
from rotorid.models.equations import polynomial
from rotorid.models.rotor.elements import Beam

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
        return cls((((), float(number)),) if number else ())

    @property
    def names(self) -> tuple[str, ...]:
        every = (name for factors, _ in self.terms for name, _ in factors if name != SPEED)
        return tuple(dict.fromkeys(every))

    @property
    def number(self) -> float | None:
        if any(factors for factors, _ in self.terms):
            return None
        return sum(coefficient for _, coefficient in self.terms)

    def times(self, other: Quantity) -> Quantity:
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
    with naming(place=place):
        found = polynomial(text, names)
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


SAME = 1e-9
"""Share of the length within which two places are one: less than any drawing states, and a beam
as short as that would have no stiffness that double precision holds."""

AXES = ("x", "y", "theta_x", "theta_y")
"""Coordinates of a place, before its name."""
ENDS = ("left_end", "right_end")
"""Names of the shaft's ends where no place with a name stands there."""


@frozen
class Section:
    """A cylinder of one material; lengths in m."""

    length: float
    outer: float
    inner: float
    # Pa, kg/m^3
    E: Quantity
    density: Quantity
    ratio: float  # E / G
    # nominal E in Pa and density in kg/m^3
    modulus: float
    heaviness: float
    stiffness: Quantity = ONE  # factor on E of this section: a shrink fit
    elements: int = 1

    def beam(self, length: float) -> Beam:
        return Beam(length, self.outer, self.inner, self.modulus, self.modulus / self.ratio, 1.0)


@frozen
class Disc:
    """A rigid disc: kg, kg m^2."""

    at: float
    mass: Quantity
    I_t: Quantity
    I_p: Quantity


@frozen
class Support:
    """Stiffness and damping to ground: xx, xy, yx, yy, in N/m and N s/m."""

    at: float
    stiffness: tuple[Quantity, Quantity, Quantity, Quantity]
    damping: tuple[Quantity, Quantity, Quantity, Quantity]


@frozen
class DrawnUnbalance:
    """Unbalance in the rotor's frame, in kg m."""

    at: float
    x: Quantity
    y: Quantity


@frozen
class Place:
    """A node: its position in m, and the names that places on it have; the first names it."""

    position: float
    names: tuple[str, ...]
    named: bool

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates."""
        return tuple(f"{axis}_{self.names[0]}" for axis in AXES)


@frozen
class Rotor:
    """A rotor from its drawing; positions in m from the left end."""

    sections: tuple[Section, ...]
    # by the name of the place; the last two are positions
    discs: Mapping[str, Disc] = field(default_factory=dict)
    supports: Mapping[str, Support] = field(default_factory=dict)
    unbalance: Mapping[str, DrawnUnbalance] = field(default_factory=dict)
    actuators: Mapping[str, float] = field(default_factory=dict)
    sensors: Mapping[str, float] = field(default_factory=dict)
    # damping of the shaft: that turns with it, in s, times its K; of the air, in 1/s, times its M;
    # and the loss factor
    internal: Quantity = NONE
    external: Quantity = NONE
    structural: Quantity = NONE

    @property
    def length(self) -> float:
        return sum(section.length for section in self.sections)

    @cached_property
    def places(self) -> Mapping[str, float]:
        """Position of each named place; what names channels comes first."""
        found = {**self.sensors, **{n: at for n, at in self.actuators.items()}}
        for table in (self.discs, self.supports, self.unbalance):
            for name, member in table.items():
                found.setdefault(name, member.at)
        return found

    @cached_property
    def nodes(self) -> tuple[Place, ...]:
        """Nodes from left to right: borders of sections, places, and what divides the rest."""
        borders = np.concatenate([[0.0], np.cumsum([s.length for s in self.sections])])
        held = self._merged([*borders, *self.places.values()])
        cuts = [held[0]]
        for section, left, right in zip(self.sections, borders[:-1], borders[1:], strict=True):
            inside = [z for z in held if left + self._near < z < right - self._near]
            for one, other in zip([left, *inside], [*inside, right], strict=True):
                share = section.elements * (other - one) / section.length
                count = max(1, ceil(share - SAME))
                cuts += list(np.linspace(one, other, count + 1)[1:])
        return tuple(self._place(k, z) for k, z in enumerate(self._merged(cuts)))

    @property
    def _near(self) -> float:
        return SAME * self.length

    def _merged(self, positions: list[float]) -> list[float]:
        """Return positions in ascending order, each once."""
        found: list[float] = []
        for z in sorted(positions):
            if not found or z - found[-1] > self._near:
                found.append(float(z))
        return found

    def _place(self, number: int, position: float) -> Place:
        names = [n for n, at in self.places.items() if abs(at - position) <= self._near]
        if not names and (position <= self._near or position >= self.length - self._near):
            names = [ENDS[number > 0]]
        return Place(position, tuple(names) or (f"node{number}",), bool(names))

    @cached_property
    def positions(self) -> Floats:
        """Positions of the nodes in m."""
        return np.array([node.position for node in self.nodes])

    def node(self, at: float) -> int:
        return int(np.abs(self.positions - at).argmin())

    def spans(self) -> Iterator[tuple[int, Section, Beam]]:
        """Yield every element: its left node, its section, and its beam."""
        borders, place = np.cumsum([s.length for s in self.sections]), self.positions
        for k, (left, right) in enumerate(pairwise(place)):
            number = int(np.searchsorted(borders, (left + right) / 2))
            section = self.sections[number]
            yield k, section, section.beam(float(right - left))
