"""Force laws as they stand in files: the same keys in experiment and in rig files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, StrictInt

from rotorid.core.errors import InputError
from rotorid.core.toml import Schema
from rotorid.core.units import to_si
from rotorid.force.laws import MU0, Differential, Flux, LawConstant, Linear

LawName = Literal["linear", "differential", "flux"]


def stated_constant(value: object, unit: str, *, shares: bool = True) -> LawConstant:
    """Read a quantity, value and std, or a start; with a name in `shared` where it `shares`."""
    if not isinstance(value, dict):
        return LawConstant(unit, to_si(value, unit))
    keys, shared = set(value) - ({"shared"} if shares else set()), value.get("shared", "")
    if keys not in ({"value", "std"}, {"start"}) or not isinstance(shared, str):
        beside = ", or a quantity alone; a name in shared beside them" if shares else ""
        raise InputError(
            f"the keys {', '.join(sorted(value)) or '(none)'}",
            f"value and std, or start{beside}",
            f"write {{ value = '1 {unit}', std = '0.01 {unit}' }}, or {{ start = '1 {unit}' }}",
        )
    if keys == {"start"}:
        start = to_si(value["start"], unit, place="start")
        return LawConstant(unit, start, np.inf, shared=shared)
    number, std = (to_si(value[key], unit, place=key) for key in ("value", "std"))
    return LawConstant(unit, number, std, shared=shared)


def _constant(unit: str) -> BeforeValidator:
    return BeforeValidator(lambda value: stated_constant(value, unit))


_LAWS: Mapping[
    LawName, tuple[type[Linear | Differential | Flux], tuple[str, ...], tuple[str, ...]]
] = {
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
    ki: Annotated[LawConstant | None, _constant("N/A")] = None
    ks: Annotated[LawConstant | None, _constant("N/m")] = None
    K: Annotated[LawConstant | None, _constant("N m^2/A^2")] = None
    area: Annotated[LawConstant | None, _constant("m^2")] = None
    turns: Annotated[float | None, Field(gt=0, allow_inf_nan=False)] = None
    bias: Annotated[LawConstant | None, _constant("A")] = None
    gap: Annotated[LawConstant | None, _constant("m")] = None
    angle: Annotated[LawConstant | None, _constant("rad")] = None
    poles: StrictInt | None = None
    bias_difference: Annotated[LawConstant | None, _constant("A")] = None
    iron: Annotated[LawConstant | None, _constant("m")] = None
    saturation: Annotated[LawConstant | None, _constant("A/m")] = None

    @property
    def uncertain(self) -> tuple[str, ...]:
        return tuple(key for key, constant in self._constants.items() if constant.std)

    @property
    def _constants(self) -> dict[str, LawConstant]:
        every = {key: getattr(self, key) for key in type(self).model_fields}
        return {key: value for key, value in every.items() if isinstance(value, LawConstant)}

    def build(self) -> Linear | Differential | Flux:
        law, needed, more = _LAWS[self.law]
        allowed = (*needed, *law.stated, *more)
        said = {key for key in law_keys() if getattr(self, key) is not None}
        for key in needed:
            if key not in said:
                raise InputError(
                    f"no {key}", f"{', '.join(needed)} for the {self.law} law", f"add {key}"
                )
        for key in sorted(said - {"law", *allowed}):
            raise InputError(
                f"{key} with the {self.law} law",
                f"one of {', '.join(dict.fromkeys(allowed))}",
                "remove it",
                place=key,
            )
        for key, constant in self._constants.items():
            if self.law == "linear" and (constant.std == np.inf or constant.shared):
                raise InputError(
                    f"an unknown or shared {key}",
                    "a quantity, or value and std",
                    f'write gains = ["{key}"] under [estimator] to estimate it',
                    place=key,
                )
        given = self._constants
        if self.law == "differential":
            given = {"K": self._magnet(), **given}
            given.pop("area", None)
        values: dict[str, Any] = {name: constant.value for name, constant in given.items()}
        if self.poles is not None:
            values["poles"] = self.poles
        std = {name: constant.std for name, constant in given.items() if constant.std}
        shared = {name: constant.shared for name, constant in given.items() if constant.shared}
        return law(**values, std=std, shared=shared)

    def _magnet(self) -> LawConstant:
        """Return K of one magnet, given or of its geometry."""
        geometry: Any = (self.area, self.turns)
        if (self.K is None) == (None in geometry):
            raise InputError(
                "both K and a geometry" if self.K is not None else "no K",
                "K, or area and turns",
                "keep one of them" if self.K is not None else "add K",
            )
        if self.K is not None:
            return self.K
        area, turns = geometry
        factor, unit = MU0 * turns**2 / 4, Differential.stated["K"].unit
        return LawConstant(unit, factor * area.value, factor * area.std, shared=area.shared)


def law_keys() -> tuple[str, ...]:
    """Return the keys of a force law, for schemas that hold one among other keys."""
    return tuple(LawEntry.model_fields)
