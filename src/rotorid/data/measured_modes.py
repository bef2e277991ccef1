"""Measured natural frequencies: data beside records, or without any."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from rotorid.core.errors import InputError, require_names
from rotorid.core.frozen import frozen
from rotorid.core.units import quantity
from rotorid.models import Model
from rotorid.models.constraints import in_si


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
        for name, unit in (("frequency", "Hz"), ("std", "Hz"), ("speed", "rad/s")):
            number = quantity(getattr(self, name), unit, place=name)
            object.__setattr__(self, name, float(number))
        for name in ("frequency", "std"):
            _positive(getattr(self, name), "Hz", name)
        if not np.isfinite(self.in_si[2]):
            raise InputError(
                f"{self.speed}", "a finite speed", "give 0 at standstill", place="speed"
            )
        if self.damping is not None:
            value, std = map(float, self.damping)
            object.__setattr__(self, "damping", (value, std))
            if not -1 < value < 1:
                raise InputError(
                    f"a damping ratio of {value:g}",
                    "a number between -1 and 1, such as 0.0025",
                    "divide percent by 100",
                    place="damping",
                )
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
    groups: dict[object, list[Mode]] = {}
    for mode in modes:
        key = mode.speed, frozenset(mode.parameters.items())
        groups.setdefault(key, []).append(mode)
    return [_counted(group) for group in groups.values()]


def _counted(group: Sequence[Mode]) -> list[Mode]:
    found: list[Mode] = []
    for mode in sorted(group, key=lambda m: m.in_si[0]):
        last = number(found[-1]) if found else 0
        own = last + 1 if mode.mode is None else mode.mode
        if own < last:
            raise InputError(
                f"{mode}, above {found[-1]}",
                "numbers that rise with the frequencies",
                "correct mode, or a frequency",
                place="modes",
            )
        found.append(replace(mode, mode=own))
    return found
