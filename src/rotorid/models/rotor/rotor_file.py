"""Rotor files: TOML to a rotor and its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field

from rotorid.core.errors import ModelError
from rotorid.core.frozen import frozen
from rotorid.core.toml import Schema
from rotorid.core.units import to_si
from rotorid.models.equations import check_names
from rotorid.models.model import DeclaredParameter
from rotorid.models.rotor.drawing import (
    ENDS,
    Disc,
    DrawnUnbalance,
    Quantity,
    Rotor,
    Section,
    Support,
    read_quantity,
)
from rotorid.models.rotor.fem import divided

MAX_SECTIONS = 500
MAX_ELEMENTS = 500
SMALLEST, LARGEST = 1e-6, 1e3
"""Lengths and diameters of sections in m: a wire of a micrometre, a shaft of a kilometre."""
Text = str | float | int
Metres = Annotated[float, BeforeValidator(lambda value: to_si(value, "m"))]


class SectionEntry(Schema):
    """A cylinder of the shaft."""

    length: Metres
    outer: Metres
    inner: Metres = 0.0
    material: str
    stiffness: Text = 1.0
    elements: Annotated[int, Field(ge=1, le=MAX_ELEMENTS, strict=True)] | None = None


class MaterialEntry(Schema):
    """A material."""

    E: Text
    G: Text
    density: Text


class DiscEntry(Schema):
    """A rigid disc."""

    at: Metres
    mass: Annotated[Text, "kg"]
    I_t: Annotated[Text, "kg m^2"] = "0 kg m^2"
    I_p: Annotated[Text, "kg m^2"] = "0 kg m^2"


class PlaceEntry(Schema):
    """An actuator or a sensor."""

    at: Metres


class SupportEntry(Schema):
    """A spring and a damper to ground."""

    at: Metres
    k: Text | None = None
    c: Text | None = None
    kxx: Text | None = None
    kxy: Text | None = None
    kyx: Text | None = None
    kyy: Text | None = None
    cxx: Text | None = None
    cxy: Text | None = None
    cyx: Text | None = None
    cyy: Text | None = None


class UnbalanceEntry(Schema):
    """An unbalance, in the rotor's frame."""

    at: Metres
    x: Annotated[Text, "kg m"] = "0 kg m"
    y: Annotated[Text, "kg m"] = "0 kg m"


class ShaftDampingEntry(Schema):
    """Damping of the shaft."""

    internal: Annotated[Text, "s"] = "0 s"
    external: Annotated[Text, "1/s"] = "0 1/s"
    structural: Annotated[Text, "1"] = 0.0


class RotorFile(Schema):
    """A rotor file."""

    title: str = ""
    source: str = ""
    sections: list[SectionEntry] = Field(min_length=1, max_length=MAX_SECTIONS)
    materials: dict[str, MaterialEntry] = Field(min_length=1, max_length=MAX_SECTIONS)
    discs: dict[str, DiscEntry] = Field(default_factory=dict, max_length=MAX_SECTIONS)
    actuators: dict[str, PlaceEntry] = Field(default_factory=dict, max_length=MAX_SECTIONS)
    sensors: dict[str, PlaceEntry] = Field(default_factory=dict, max_length=MAX_SECTIONS)
    supports: dict[str, SupportEntry] = Field(default_factory=dict, max_length=MAX_SECTIONS)
    unbalance: dict[str, UnbalanceEntry] = Field(default_factory=dict, max_length=MAX_SECTIONS)
    damping: ShaftDampingEntry = Field(default_factory=ShaftDampingEntry)
    parameters: dict[str, DeclaredParameter] = Field(default_factory=dict, max_length=MAX_SECTIONS)


@frozen
class _Reader:
    """What quantities are read with: units and nominal values of the parameters."""

    units: Mapping[str, str]
    nominal: Mapping[str, float]

    def read(self, text: Text, unit: str, place: str) -> Quantity:
        """Return a quantity; its place is for the message."""
        return read_quantity(text, unit, self.units, place=place)

    def constant(self, text: Text, unit: str, place: str) -> Quantity:
        """Return a quantity that does not depend on the speed."""
        found = self.read(text, unit, place)
        if any(name == "Omega" for factors, _ in found.terms for name, _ in factors):
            raise ModelError(
                f"{text!r}, which depends on the speed",
                "a quantity of the rotor itself",
                "let the speed stand in [supports] only",
                place=place,
            )
        return found

    def constants(self, entry: Schema, place: str) -> dict[str, Quantity]:
        """Return the quantities of a table: the fields that name a unit."""
        return {
            name: self.constant(getattr(entry, name), unit, f"{place}.{name}")
            for name, about in type(entry).model_fields.items()
            for unit in about.metadata
            if isinstance(unit, str)
        }

    def at_nominal(self, quantity: Quantity, place: str) -> float:
        """Return the positive value at the nominal values."""
        missing = [name for name in quantity.names if name not in self.nominal]
        if missing:
            raise ModelError(
                f"{missing[0]} without nominal",
                "a nominal value, for which the shaft is divided into elements",
                "give nominal, about right",
                place=f"parameters.{missing[0]}",
            )
        value = quantity.value(self.nominal)
        if not 0 < value < float("inf"):
            raise ModelError(
                f"{value:g} at the nominal values",
                "a quantity above 0",
                "look at its unit and its sign, and at nominal of what it holds",
                place=place,
            )
        return value


def read_rotor(entry: RotorFile, units: Mapping[str, str], nominal: Mapping[str, float]) -> Rotor:
    """Return the rotor of a file; `units` and `nominal` are those of its parameters, in SI."""
    reader = _Reader(units, nominal)
    sections = tuple(_section(k, entry, reader) for k in range(len(entry.sections)))
    discs = {name: reader.constants(disc, f"discs.{name}") for name, disc in entry.discs.items()}
    damping = reader.constants(entry.damping, "damping")
    rotor = Rotor(
        sections,
        {name: Disc(entry.discs[name].at, **disc) for name, disc in discs.items()},
        {name: _support(name, support, reader) for name, support in entry.supports.items()},
        {
            name: DrawnUnbalance(plane.at, **reader.constants(plane, f"unbalance.{name}"))
            for name, plane in entry.unbalance.items()
        },
        {name: place.at for name, place in entry.actuators.items()},
        {name: place.at for name, place in entry.sensors.items()},
        **damping,
    )
    _check_places(rotor, entry)
    _check_channels(rotor)
    for name, disc in discs.items():
        _check_numbers(disc, f"discs.{name}")
    _check_numbers(damping, "damping")
    return divided(rotor, [section.elements for section in entry.sections], MAX_ELEMENTS)


def _check_section(drawn: SectionEntry, place: str, entry: RotorFile) -> None:
    """Refuse lengths, diameters and materials that a section cannot have."""
    for name, value in (("length", drawn.length), ("outer", drawn.outer)):
        if not SMALLEST < value < LARGEST:
            raise ModelError(
                f"{value:g} m",
                f"a length above 0, from {SMALLEST:g} to {LARGEST:g} m",
                "take it from the drawing again, with its unit",
                place=f"{place}.{name}",
            )
    if not 0 <= drawn.inner < drawn.outer:
        raise ModelError(
            f"inner {drawn.inner:g} m in outer {drawn.outer:g} m",
            "an inner diameter from 0 to less than the outer one",
            "give diameters, not radii; leave inner out where the section is solid",
            place=f"{place}.inner",
        )
    if drawn.material not in entry.materials:
        raise ModelError(
            f"the material {drawn.material[:60]!r}",
            f"one of [materials]: {', '.join(entry.materials)}",
            "take a name from there, or add it",
            place=f"{place}.material",
        )


def _section(number: int, entry: RotorFile, reader: _Reader) -> Section:
    drawn, place = entry.sections[number], f"sections.{number}"
    _check_section(drawn, place, entry)
    material, where = entry.materials[drawn.material], f"materials.{drawn.material}"
    E = reader.constant(material.E, "Pa", f"{where}.E")
    modulus = reader.at_nominal(E, f"{where}.E")
    shear = reader.at_nominal(reader.constant(material.G, "Pa", f"{where}.G"), f"{where}.G")
    density = reader.constant(material.density, "kg/m^3", f"{where}.density")
    heaviness = reader.at_nominal(density, f"{where}.density")
    if not 2.0 <= modulus / shear <= 3.0:
        raise ModelError(
            f"E = {modulus:.4g} Pa with G = {shear:.4g} Pa, Poisson's ratio "
            f"{modulus / shear / 2 - 1:.3g}",
            "a ratio from 0 to 0.5, E from 2 to 3 times G",
            "look at the units of E and G",
            place=where,
        )
    stiffness = reader.constant(drawn.stiffness, "1", f"{place}.stiffness")
    reader.at_nominal(stiffness, f"{place}.stiffness")
    return Section(
        drawn.length,
        drawn.outer,
        drawn.inner,
        E,
        density,
        modulus / shear,
        modulus,
        heaviness,
        stiffness,
    )


def _support(name: str, entry: SupportEntry, reader: _Reader) -> Support:
    tables = []
    for kind, unit in (("k", "N/m"), ("c", "N s/m")):
        both = getattr(entry, kind)
        single = {axes: getattr(entry, kind + axes) for axes in ("xx", "xy", "yx", "yy")}
        given = [kind + axes for axes, value in single.items() if value is not None]
        if both is not None and given:
            raise ModelError(
                f"{kind} beside {given[0]}",
                f"{kind}, the same in x and y, or the four of {kind}xx to {kind}yy",
                "leave one out",
                place=f"supports.{name}",
            )
        if both is not None:
            single["xx"] = single["yy"] = both
        tables.append(
            tuple(
                Quantity(())
                if value is None
                else reader.read(value, unit, f"supports.{name}.{kind}{axes}")
                for axes, value in single.items()
            )
        )
    if not any(quantity.terms for table in tables for quantity in table):
        raise ModelError(
            "neither stiffness nor damping",
            "k, c, or kxx to cyy",
            "give one of them, or leave the support out",
            place=f"supports.{name}",
        )
    stiffness, damping = tables
    return Support(entry.at, stiffness, damping)  # type: ignore[arg-type]


def _check_places(rotor: Rotor, entry: RotorFile) -> None:
    """Refuse places off the shaft, and names that stand for two."""
    first: dict[str, tuple[str, float]] = {}
    for table in ("sensors", "actuators", "discs", "supports", "unbalance"):
        check_names({table: getattr(entry, table)})
        for name, member in getattr(entry, table).items():
            place = f"{table}.{name}"
            if name.startswith("node") or name in ENDS:
                raise ModelError(
                    f"the place {name!r}",
                    "a name that no node has: node1, node2 are those without a name, left_end and "
                    "right_end the ends",
                    "rename it",
                    place=place,
                )
            if not -1e-9 * rotor.length <= member.at <= rotor.length * (1 + 1e-9):
                raise ModelError(
                    f"a place at {member.at:g} m",
                    f"one on the shaft, which is {rotor.length:g} m long",
                    "measure from the left end",
                    place=f"{place}.at",
                )
            known, at = first.setdefault(name, (table, member.at))
            if abs(at - member.at) > 1e-9 * rotor.length:
                raise ModelError(
                    f"{name!r} at {member.at:g} m and, in [{known}], at {at:g} m",
                    "one place of that name",
                    "give the other another name",
                    place=f"{place}.at",
                )


def _check_channels(rotor: Rotor) -> None:
    """Refuse two names of one place where channels would have to know which of them it has."""
    shown = [*rotor.sensors.items(), *rotor.actuators.items()]
    for k, (name, at) in enumerate(shown):
        for other, there in shown[:k]:
            if name != other and abs(at - there) <= 1e-9 * rotor.length:
                raise ModelError(
                    f"{other!r} and {name!r} at {at:g} m",
                    "one name of one place, after which its coordinates are called",
                    f"call both {name}: the actuator then has F_x{name}, the sensor x_{name}",
                    place=f"sensors.{other}",
                )


def _check_numbers(quantities: Mapping[str, Quantity], place: str) -> None:
    for what, quantity in quantities.items():
        if quantity.number is not None and quantity.number < 0:
            raise ModelError(
                f"{quantity.number:g}", "0 or more", "drop the sign", place=f"{place}.{what}"
            )
