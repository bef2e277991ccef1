"""Constants of force laws: their checks, and the deviations that they cause."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from rotorid.errors import InputError
from rotorid.record import Floats

L = TypeVar("L")
MU0 = 4e-7 * np.pi
"""Permeability of vacuum in N/A^2."""

_STEP = 1e-30


def deviation_of(law: Any, constants: tuple[str, ...], function: Callable[[Any], Any]) -> Floats:
    """Return the first-order deviation of ``function(law)`` from those of the law's constants.

    Where the function depends on a constant that is unknown, it is infinite.

    The slopes come from complex steps, exact to rounding; the constants are taken as independent.
    """
    total: Any = 0.0
    for name in constants:
        deviation = getattr(law, f"{name}_std")
        if deviation:
            step = _STEP * (abs(getattr(law, name)) or 1.0)
            slope = np.imag(function(with_moved(law, {name: 1j * step}))) / step
            if deviation == np.inf:  # zero times infinity would be no number
                slope, deviation = np.where(slope == 0, 0.0, np.inf), 1.0
            total = total + (slope * deviation) ** 2
    return np.asarray(np.sqrt(total), dtype=float)


def with_moved(law: Any, changes: Mapping[str, complex]) -> Any:
    """Return a copy of a law with constants moved by so much, unchecked."""
    copy = object.__new__(type(law))
    for field in law.__dataclass_fields__:
        value = getattr(law, field)
        object.__setattr__(copy, field, value + changes[field] if field in changes else value)
    return copy


def require(found: object, ok: bool, name: str, expected: str, cure: str) -> None:
    """Refuse a constant of a law unless it is as it should be."""
    if not ok:
        raise InputError(f"{name} = {found}", expected, cure, place=name)


def require_constants(law: Any, positive: dict[str, str], free: tuple[str, ...] = ()) -> None:
    """Refuse constants that are not finite, or not positive where they must be."""
    for name, unit in positive.items():
        value = getattr(law, name)
        require(
            value,
            bool(np.isfinite(value) and value > 0),
            name,
            f"more than 0 {unit}",
            f"give {name} of the force law in {unit}, as the data sheet has it",
        )
    for name in free:
        value = getattr(law, name)
        require(
            value,
            bool(np.isfinite(value)),
            name,
            "a finite number",
            f"give a number for {name}, or leave it out",
        )
    for name in (*positive, *free):
        value = getattr(law, f"{name}_std")
        require(
            value,
            bool(value >= 0),
            f"{name}_std",
            "a standard deviation of 0 or more, infinite where the constant is unknown",
            f"give {name}_std as one standard deviation, or leave it out",
        )


def require_angle(angle: float) -> None:
    """Refuse an angle between poles and axis that leaves no force."""
    require(
        angle,
        bool(np.isfinite(angle) and abs(angle) < np.pi / 2),
        "angle",
        "less than 90 degrees",
        "give half the angle between the poles",
    )


def with_std(law: L, **stds: float) -> L:
    """Return a law with deviations given to its constants, ``with_std(law, gap=5e-6)``."""
    names = [name[:-4] for name in vars(law) if name.endswith("_std")]
    for name in stds:
        if name not in names:
            raise InputError(
                f"{name!r}", f"one of {', '.join(names)}", "name a constant of the force law"
            )
    changed: dict[str, Any] = {f"{name}_std": value for name, value in stds.items()}
    return cast(L, replace(cast(Any, law), **changed))
