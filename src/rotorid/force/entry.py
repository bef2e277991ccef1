"""Constants as they stand in files, and force laws: the same keys in experiment and rig files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, StrictInt

from rotorid.core.errors import InputError
from rotorid.core.toml import Schema
from rotorid.core.units import to_si
from rotorid.force.channel_dynamics import UNKNOWN, Constant
from rotorid.force.laws import MU0, Differential, Flux, Law, Linear

LawName = Literal["linear", "differential", "flux"]


def constant(name: str, unit: str, *, of_law: bool = True) -> BeforeValidator:
    """Return what reads a constant: a quantity, value and std, or a start; `shared` in a law."""
    return BeforeValidator(lambda value: _stated(value, Constant(name, unit, 0.0), of_law))


def _stated(value: object, of: Constant, of_law: bool) -> Constant:
    if not isinstance(value, dict):
        found = replace(of, value=to_si(value, of.unit))
    else:
        keys, shared = set(value) - ({"shared"} if of_law else set()), value.get("shared", "")
        if keys not in ({"value", "std"}, {"start"}) or not isinstance(shared, str):
            others = ", or a quantity alone; a name in shared beside them" if of_law else ""
            raise InputError(
                f"the keys {', '.join(sorted(value)) or '(none)'}",
                f"value and std, or start{others}",
                f"write {{ value = '1 {of.unit}', std = '0.01 {of.unit}' }}, or "
                f"{{ start = '1 {of.unit}' }}",
            )
        said = {key: to_si(value[key], of.unit, place=key) for key in value if key in keys}
        number, std = said.get("start", said.get("value", 0.0)), said.get("std", UNKNOWN)
        found = replace(of, value=number, std=std, shared=shared)
    if not of_law and not (0 < found.value < np.inf and found.std >= 0):
        raise InputError(
            f"{of.name} = {found.value:g} +- {found.std:g} {of.unit}",
            "more than 0, with a deviation of 0 or more",
            f"give the {of.name} of the amplifier or sensor",
            place=of.name,
        )
    return found


_LAWS: Mapping[LawName, tuple[type[Law], tuple[str, ...], tuple[str, ...]]] = {
    # keys that a law needs; keys that are no constants of it
    "linear": (Linear, ("ki",), ()),
    "differential": (Differential, ("bias", "gap"), ("area", "turns")),
    "flux": (Flux, ("area",), ("poles",)),
}


class LawEntry(Schema):
    """A force law and its constants.

    ``linear``: ki, ks. ``differential``: bias, gap, angle and K, or area and turns of horseshoe
    magnets; bias_difference, iron and saturation. ``flux``: area, poles, angle. A constant is a
    quantity, or a table of value and std.
    """

    law: LawName
    ki: Annotated[Constant | None, constant("ki", "N/A")] = None
    ks: Annotated[Constant | None, constant("ks", "N/m")] = None
    K: Annotated[Constant | None, constant("K", "N m^2/A^2")] = None
    area: Annotated[Constant | None, constant("area", "m^2")] = None
    turns: Annotated[float | None, Field(gt=0, allow_inf_nan=False)] = None
    bias: Annotated[Constant | None, constant("bias", "A")] = None
    gap: Annotated[Constant | None, constant("gap", "m")] = None
    angle: Annotated[Constant | None, constant("angle", "rad")] = None
    poles: StrictInt | None = None
    bias_difference: Annotated[Constant | None, constant("bias_difference", "A")] = None
    iron: Annotated[Constant | None, constant("iron", "m")] = None
    saturation: Annotated[Constant | None, constant("saturation", "A/m")] = None

    @property
    def uncertain(self) -> tuple[str, ...]:
        return tuple(key for key, one in self._constants.items() if one.std)

    @property
    def _constants(self) -> dict[str, Constant]:
        every = ((key, getattr(self, key)) for key in law_keys())
        return {key: value for key, value in every if isinstance(value, Constant)}

    def build(self) -> Law:
        law, needed, more = _LAWS[self.law]
        allowed = (*needed, *law.stated, *more)
        said = {key for key in law_keys() if getattr(self, key) is not None}
        for key in needed:
            if key not in said:
                raise InputError(
                    f"no {key}", f"{', '.join(needed)} for the {self.law} law", f"add {key}"
                )
        for key in sorted(said - {"law", *allowed}):
            expected = f"one of {', '.join(dict.fromkeys(allowed))}"
            raise InputError(f"{key} with the {self.law} law", expected, "remove it", place=key)
        given = self._constants
        for key, one in given.items():
            if self.law == "linear" and (one.std == np.inf or one.shared):
                expected = "a quantity, or value and std"
                cure = f'write gains = ["{key}"] under [estimator] to estimate it'
                raise InputError(f"an unknown or shared {key}", expected, cure, place=key)
        if self.law == "differential":
            area = given.pop("area", None)
            given = {"K": self._magnet(given.get("K"), area), **given}
        values: dict[str, Any] = {name: one.value for name, one in given.items()}
        if self.poles is not None:
            values["poles"] = self.poles
        std = {name: one.std for name, one in given.items() if one.std}
        shared = {name: one.shared for name, one in given.items() if one.shared}
        return law(**values, std=std, shared=shared)

    def _magnet(self, given: Constant | None, area: Constant | None) -> Constant:
        """Return K of one magnet, given or of its geometry."""
        if given is not None and area is None and self.turns is None:
            return given
        if given is not None or area is None or self.turns is None:
            raise InputError(
                "no K" if given is None else "both K and a geometry",
                "K, or area and turns",
                "add K" if given is None else "keep one of them",
            )
        factor = MU0 * self.turns**2 / 4
        return Constant("K", "", factor * area.value, factor * area.std, shared=area.shared)


def law_keys() -> tuple[str, ...]:
    """Return the keys of a force law, for schemas that hold one among other keys."""
    return tuple(LawEntry.model_fields)
