"""The drawing of a rotor as a rotor file gives it: sections, discs, supports, places.

Its classes are the tables of the file. Where they are read from one, the context of the validation
holds the declared parameters; without it, numbers are in SI.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import combinations
from math import ceil, prod
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    Field,
    InstanceOf,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from rotorid.core.errors import InputError, ModelError
from rotorid.core.toml import Schema
from rotorid.core.units import dimension_of, multiply_units, to_si
from rotorid.core.values import Floats, frozen
from rotorid.models.equations import check_names, polynomial
from rotorid.models.model import DeclaredParameter, Parameter

SPEED = "Omega"
Factors = tuple[tuple[str, int], ...]


@frozen
class Quantity:
    """A sum of ``coefficient * product of powers of names``, in SI."""

    terms: tuple[tuple[Factors, float], ...]
    nominal: float = np.nan  # its value at the nominal values of the parameters

    @classmethod
    def of(cls, number: float) -> Quantity:
        return cls((((), float(number)),) if number else (), float(number))

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
                powers = Counter(dict(mine))
                powers.update(dict(yours))
                key = tuple(sorted(powers.items()))
                found[key] = found.get(key, 0.0) + a * b
        return Quantity(tuple(found.items()), self.nominal * other.nominal)

    def __float__(self) -> float:
        return self.nominal

    def value(self, values: Mapping[str, float]) -> float:
        return sum(c * prod(values[name] ** n for name, n in f) for f, c in self.terms)


NONE = Quantity.of(0.0)
ONE = Quantity.of(1.0)


def read_quantity(text: str | float, unit: str, declared: Sequence[Parameter]) -> Quantity:
    """Return a quantity of the expected unit, perhaps made of the parameters that are declared."""
    parameters = {p.name: p.unit for p in declared}
    try:
        return Quantity.of(to_si(text, unit))
    except InputError as error:
        said = set(re.findall(r"\w+", text)) if isinstance(text, str) else set()
        if said & {*parameters, SPEED}:
            found = _of_names(str(text), unit, parameters)
            nominal = {p.name: np.nan if p.nominal is None else p.nominal for p in declared}
            return replace(found, nominal=found.value({**nominal, SPEED: np.nan}))
        if not isinstance(text, str) or not text.strip()[:1].isalpha():
            raise
        raise ModelError(
            repr(text[:60]),
            f"a number with a unit, such as '1 {unit}', or a name in [parameters]"
            + (f": {', '.join([*parameters][:8])}" if parameters else ""),
            "write the unit, or declare the parameter",
            place=error.place,
        ) from None


def _of_names(text: str, unit: str, parameters: Mapping[str, str]) -> Quantity:
    names = [*parameters, SPEED]
    units = {**parameters, SPEED: "rad/s"}
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
            )
        terms.append((tuple(sorted(factors)), float(coefficient)))
    return Quantity(tuple(terms))


MAX_SECTIONS = 500
MAX_ELEMENTS = 500
SMALLEST, LARGEST = 1e-6, 1e3
"""Lengths and diameters of sections in m: a wire of a micrometre, a shaft of a kilometre."""
SAME = 1e-9
"""Share of the length within which two places are one: less than any drawing states, and a beam
as short as that would have no stiffness that double precision holds."""
AXES = ("x", "y", "theta_x", "theta_y")  # coordinates of a place, before its name
PLANES = len(AXES)
ENDS = ("left_end", "right_end")  # names of the shaft's ends where no named place stands
CROSSED = ("xx", "xy", "yx", "yy")


def _of(unit: str, *, signed: bool = True, above: bool = False, speed: bool = False) -> Any:
    """Return what makes a quantity of a text: any, 0 or more, or above 0; maybe of the speed."""

    def read(value: Any, info: ValidationInfo) -> Any:
        if info.context is None or isinstance(value, Quantity):
            return value
        found = read_quantity(value, unit, info.context["parameters"])
        if not speed and any(name == SPEED for factors, _ in found.terms for name, _ in factors):
            told = f"{value!r}, which depends on the speed"
            cure = "let the speed stand in [supports] only"
            raise ModelError(told, "a quantity of the rotor itself", cure)
        if above:
            _check_nominal(found, info.context["parameters"])
        if not signed and found.number is not None and found.number < 0:
            raise ModelError(f"{found.number:g}", "0 or more", "drop the sign")
        return found

    return BeforeValidator(read)


def _check_nominal(quantity: Quantity, declared: Sequence[Parameter]) -> None:
    missing = [p.name for p in declared if p.nominal is None and p.name in quantity.names]
    if missing:
        told = f"{missing[0]} without nominal"
        expected = "a nominal value, for which the shaft is divided into elements"
        cure = "give nominal, about right"
        raise ModelError(told, expected, cure, place=f"parameters.{missing[0]}")
    if not 0 < quantity.nominal < np.inf:
        cure = "look at its unit and its sign, and at nominal of what it holds"
        raise ModelError(f"{quantity.nominal:g} at the nominal values", "a quantity above 0", cure)


def _in_si(unit: str) -> Any:
    return BeforeValidator(lambda x, info: x if info.context is None else to_si(x, unit))


Metres = Annotated[float, _in_si("m")]
Share = Annotated[float, Field(ge=0), _in_si("1")]
_Text = Annotated[
    InstanceOf[Quantity],
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "number"}, {"type": "integer"}]}),
]


def _default(quantity: Quantity) -> Any:
    return Field(default_factory=lambda: quantity)


class Material(Schema):
    """A material; G is the same share of E whatever E is."""

    E: Annotated[_Text, _of("Pa", above=True)]
    G: Annotated[_Text, _of("Pa", above=True)]
    density: Annotated[_Text, _of("kg/m^3", above=True)]

    @model_validator(mode="after")
    def _at_nominal(self, info: ValidationInfo) -> Self:
        if info.context is not None and not 2.0 <= self.ratio <= 3.0:
            raise ModelError(
                f"E = {self.E.nominal:.4g} Pa with G = {self.G.nominal:.4g} Pa, Poisson's ratio "
                f"{self.ratio / 2 - 1:.3g}",
                "a ratio from 0 to 0.5, E from 2 to 3 times G",
                "look at the units of E and G",
            )
        return self

    @property
    def ratio(self) -> float:
        """E / G."""
        return self.E.nominal / self.G.nominal


def _material(value: Any, info: ValidationInfo) -> Any:
    known = (info.context or {}).get("materials")
    if known is None:
        return value
    if value not in known:
        expected = f"one of [materials]: {', '.join(known)}"
        cure = "take a name from there, or add it"
        raise ModelError(f"the material {str(value)[:60]!r}", expected, cure)
    return known[value]


class Section(Schema):
    """A cylinder of the shaft."""

    length: Metres
    outer: Metres
    inner: Metres = 0.0
    material: Annotated[
        InstanceOf[Material], BeforeValidator(_material), WithJsonSchema({"type": "string"})
    ]
    stiffness: Annotated[_Text, _of("1", above=True)] = _default(ONE)  # factor on E: a shrink fit
    elements: Annotated[int, Field(ge=1, le=MAX_ELEMENTS, strict=True)] | None = None

    @field_validator("length", "outer")
    @classmethod
    def _of_a_shaft(cls, value: float) -> float:
        if not SMALLEST < value < LARGEST:
            expected = f"a length above 0, from {SMALLEST:g} to {LARGEST:g} m"
            cure = "take it from the drawing again, with its unit"
            raise ModelError(f"{value:g} m", expected, cure)
        return value

    @field_validator("inner")
    @classmethod
    def _within(cls, inner: float, info: ValidationInfo) -> float:
        outer = info.data.get("outer", np.inf)
        if not 0 <= inner < outer:
            expected = "an inner diameter from 0 to less than the outer one"
            cure = "give diameters, not radii; leave inner out where the section is solid"
            raise ModelError(f"inner {inner:g} m in outer {outer:g} m", expected, cure)
        return inner


class Disc(Schema):
    """A rigid disc."""

    at: Metres
    mass: Annotated[_Text, _of("kg", signed=False)]
    I_t: Annotated[_Text, _of("kg m^2", signed=False)] = _default(NONE)
    I_p: Annotated[_Text, _of("kg m^2", signed=False)] = _default(NONE)


class ChannelPlace(Schema):
    """An actuator."""

    at: Metres


def _place(value: Any, info: ValidationInfo) -> Any:
    """Return a place in m, or, where it holds parameters, a quantity."""
    if info.context is None:
        return value
    found = read_quantity(value, "m", info.context["parameters"])
    if found.number is None:
        _check_nominal(found, info.context["parameters"])
    return found if found.number is None else found.number


class SensorPlace(Schema):
    """A sensor; its place may be unknown: made of parameters."""

    at: Annotated[float | _Text, BeforeValidator(_place)]


_Stiffness = Annotated[_Text, _of("N/m", speed=True)] | None
_Damping = Annotated[_Text, _of("N s/m", speed=True)] | None


class Support(Schema):
    """A spring and a damper to ground."""

    at: Metres
    k: _Stiffness = None
    c: _Damping = None
    kxx: _Stiffness = None
    kxy: _Stiffness = None
    kyx: _Stiffness = None
    kyy: _Stiffness = None
    cxx: _Damping = None
    cxy: _Damping = None
    cyx: _Damping = None
    cyy: _Damping = None

    @model_validator(mode="after")
    def _told_once(self) -> Self:
        for kind in "kc":
            given = [kind + axes for axes in CROSSED if getattr(self, kind + axes) is not None]
            if getattr(self, kind) is not None and given:
                expected = f"{kind}, the same in x and y, or the four of {kind}xx to {kind}yy"
                raise ModelError(f"{kind} beside {given[0]}", expected, "leave one out")
        if not any(quantity.terms for quantity in self.constants.values()):
            cure = "give one of them, or leave the support out"
            raise ModelError("neither stiffness nor damping", "k, c, or kxx to cyy", cure)
        return self

    @property
    def constants(self) -> dict[str, Quantity]:
        """Stiffness, kxx to kyy in N/m, and damping, cxx to cyy in N s/m."""
        return {
            kind + axes: getattr(self, kind + axes)
            or (axes in ("xx", "yy") and getattr(self, kind))
            or NONE
            for kind in "kc"
            for axes in CROSSED
        }


class DrawnUnbalance(Schema):
    """Unbalance in the rotor's frame."""

    at: Metres
    x: Annotated[_Text, _of("kg m")] = _default(NONE)
    y: Annotated[_Text, _of("kg m")] = _default(NONE)


class ShaftDamping(Schema):
    """Damping of the shaft: that turns with it, times its K; of the air, times its M; loss."""

    internal: Annotated[_Text, _of("s", signed=False)] = _default(NONE)
    external: Annotated[_Text, _of("1/s", signed=False)] = _default(NONE)
    structural: Annotated[_Text, _of("1", signed=False)] = _default(NONE)


class Tolerances(Schema):
    """How wrong the numbers of a drawing may be."""

    E: Share = 0.03  # steels have 193 to 212 GPa
    density: Share = 0.01
    lengths: Share = 0.01  # all alike: a ruler, or a scale
    diameters: Share = 0.001  # each: what parts fit on is measured to hundredths of a mm
    places: Annotated[float, Field(ge=0), _in_si("m")] | None = None  # None: 1 % of the length


@frozen
class Place:
    """A node: its position in m, and the names that places on it have; the first names it."""

    position: float
    names: tuple[str, ...]
    named: bool

    @property
    def coordinates(self) -> tuple[str, ...]:
        return tuple(f"{axis}_{self.names[0]}" for axis in AXES)


def _table(**more: Any) -> Any:
    return Field(default_factory=dict, max_length=MAX_SECTIONS, **more)


class Rotor(Schema):
    """A rotor from its drawing; positions in m from the left end."""

    title: str = ""
    source: str = ""
    materials: dict[str, Material] = Field(min_length=1, max_length=MAX_SECTIONS)
    sections: tuple[Section, ...] = Field(min_length=1, max_length=MAX_SECTIONS)
    discs: dict[str, Disc] = _table()
    actuators: dict[str, ChannelPlace] = _table()
    sensors: dict[str, SensorPlace] = _table()
    supports: dict[str, Support] = _table()
    unbalance: dict[str, DrawnUnbalance] = _table()
    damping: ShaftDamping = Field(default_factory=ShaftDamping)
    tolerances: Tolerances = Field(default_factory=Tolerances)
    parameters: dict[str, DeclaredParameter] = _table()

    @field_validator("materials")
    @classmethod
    def _named(cls, materials: dict[str, Material], info: ValidationInfo) -> dict[str, Material]:
        if info.context is not None:
            info.context["materials"] = materials
        return materials

    @property
    def length(self) -> float:
        return sum(section.length for section in self.sections)

    @model_validator(mode="after")
    def _check_places(self) -> Self:
        """Refuse places off the shaft, and names that stand for two."""
        first: dict[str, tuple[str, float]] = {}
        for table in ("sensors", "actuators", "discs", "supports", "unbalance"):
            check_names(**{table: getattr(self, table)})
            for name, member in getattr(self, table).items():
                place = f"{table}.{name}"
                if name.startswith("node") or name in ENDS:
                    raise ModelError(
                        f"the place {name!r}",
                        "a name that no node has: node1, node2 are those without a name, left_end "
                        "and right_end the ends",
                        "rename it",
                        place=place,
                    )
                there = float(member.at)
                if not -self._near <= there <= self.length + self._near:
                    expected = f"one on the shaft, which is {self.length:g} m long"
                    cure = "measure from the left end"
                    raise ModelError(f"a place at {there:g} m", expected, cure, place=f"{place}.at")
                known, at = first.setdefault(name, (table, there))
                if abs(at - there) > self._near or (known != table and name in self.floating):
                    raise ModelError(
                        f"{name!r} at {there:g} m and, in [{known}], at {at:g} m",
                        "one place of that name, and for a place of parameters a name of its own",
                        "give the other another name",
                        place=f"{place}.at",
                    )
        return self

    @model_validator(mode="after")
    def _check_channels(self) -> Self:
        """Refuse two names of one place where channels would have to know which of them it has."""
        named = [*self.sensors, *self.actuators]
        shown = [(name, self.places[name]) for name in named if name not in self.floating]
        for (other, there), (name, at) in combinations(shown, 2):
            if name != other and abs(at - there) <= self._near:
                told = f"{other!r} and {name!r} at {at:g} m"
                expected = "one name of one place, after which its coordinates are called"
                cure = f"call both {name}: the actuator then has F_x{name}, the sensor x_{name}"
                raise ModelError(told, expected, cure, place=f"sensors.{other}")
        return self

    def with_elements(self, counts: Sequence[int]) -> Rotor:
        pairs = zip(self.sections, counts, strict=True)
        sections = tuple(s.model_copy(update={"elements": count}) for s, count in pairs)
        return Rotor.model_construct(**{**dict(self), "sections": sections})

    def with_places(self, at: Mapping[str, float]) -> Rotor:
        """Return the rotor with nodes where sensors sit whose places are made of parameters."""
        moved = {n: replace(place, nominal=at[n]) for n, place in self.floating.items()}
        sensors = {
            n: s.model_copy(update={"at": moved[n]}) if n in moved else s
            for n, s in self.sensors.items()
        }
        return Rotor.model_construct(**{**dict(self), "sensors": sensors})

    @cached_property
    def places(self) -> Mapping[str, float]:
        """Position of each named place; what names channels comes first."""
        tables = (self.sensors, self.actuators, self.discs, self.supports, self.unbalance)
        every = ((name, member.at) for table in tables for name, member in table.items())
        return {name: at for name, at in every if not isinstance(at, Quantity)}

    @cached_property
    def floating(self) -> Mapping[str, Quantity]:
        """Sensors whose places are made of parameters: no nodes, since these do not move."""
        return {name: s.at for name, s in self.sensors.items() if isinstance(s.at, Quantity)}

    @cached_property
    def nodes(self) -> tuple[Place, ...]:
        """Nodes from left to right: borders of sections, places, and what divides the rest."""
        borders = np.concatenate([[0.0], np.cumsum([s.length for s in self.sections])])
        floating = map(float, self.floating.values())  # whose polynomials are best near a node
        held = self._merged([*borders, *self.places.values(), *floating])
        cuts = [held[0]]
        for section, left, right in zip(self.sections, borders[:-1], borders[1:], strict=True):
            inside = [z for z in held if left + self._near < z < right - self._near]
            for one, other in zip([left, *inside], [*inside, right], strict=True):
                share = (section.elements or 1) * (other - one) / section.length
                count = max(1, ceil(share - SAME))
                cuts += list(np.linspace(one, other, count + 1)[1:])
        return tuple(self._place(k, z) for k, z in enumerate(self._merged(cuts)))

    @property
    def _near(self) -> float:
        return SAME * self.length

    def _merged(self, positions: list[float]) -> list[float]:
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
        return np.array([node.position for node in self.nodes])

    def node(self, at: float) -> int:
        return int(np.abs(self.positions - at).argmin())
