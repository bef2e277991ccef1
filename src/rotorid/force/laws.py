"""Force laws: currents, fluxes and displacements to forces.

The laws are values. The levitated rig drives its rotor with them and the reader of records turns
measured currents into forces with them, so the two cannot differ.

*Notation* (theory, section 4): i current about the bias i0, x displacement about the nominal gap
s0, alpha half the angle between the poles, K the constant of a magnet.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats

MU0 = 4e-7 * np.pi
"""Permeability of vacuum in N/A^2."""

_STEP = 1e-30


def deviation_of(law: Any, function: Callable[[Any], Any]) -> Floats:
    """Return the first-order deviation of ``function(law)`` from those of the law's constants.

    Infinite where it depends on an unknown one. Slopes by complex steps; constants independent.
    """
    total: Any = 0.0
    for name in law.__dataclass_fields__:
        deviation = getattr(law, f"{name}_std", 0.0)
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


def require_constants(law: Law, positive: tuple[str, ...], free: tuple[str, ...] = ()) -> None:
    """Refuse constants that are not finite, or not positive where they must be."""
    for name in (*positive, *free):
        value, std, unit = getattr(law, name), getattr(law, f"{name}_std"), law.stated[name].unit
        above = name in positive
        require(
            value,
            bool(np.isfinite(value) and (value > 0 or not above)),
            name,
            f"more than 0 {unit}" if above else "a finite number",
            f"give {name} of the force law in {unit}, as the data sheet has it"
            if above
            else f"give a number for {name}, or leave it out",
        )
        require(
            std,
            bool(std >= 0),
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


class Stated(NamedTuple):
    """A constant of a law: its unit, its key in files if not the field's, whether it is above 0."""

    unit: str
    key: str = ""
    positive: bool = False


class Law(ABC):
    """A force law of two signals: current and displacement, or two flux densities."""

    stated: ClassVar[Mapping[str, Stated]]  # the constants by their fields

    @abstractmethod
    def _force(self, *signals: Any) -> Any:
        """Return the force, of complex constants too."""

    def _within(self, *signals: ArrayLike) -> tuple[Floats, ...]:
        """Return the signals; refuse those that the law does not hold for."""
        return tuple(np.asarray(each, dtype=float) for each in signals)

    def force(self, *signals: ArrayLike) -> Floats:
        """Return the force in N, broadcast over the signals."""
        return np.asarray(self._force(*self._within(*signals)))

    def force_std(self, *signals: ArrayLike) -> Floats:
        """Return the deviation of the force in N that the constants' deviations cause."""
        at = self._within(*signals)
        return deviation_of(self, lambda law: law._force(*at))


@frozen
class Linear(Law):
    """The linear law, F = k_i i + k_s x."""

    stated: ClassVar[Mapping[str, Stated]] = {"ki": Stated("N/A"), "ks": Stated("N/m")}
    ki: float  # force per current in N/A, not zero
    ks: float = 0.0  # force per displacement in N/m; positive destabilizes
    # standard deviations of the constants
    ki_std: float = 0.0
    ks_std: float = 0.0

    def __post_init__(self) -> None:
        require_constants(self, (), ("ki", "ks"))
        require(self.ki, self.ki != 0, "ki", "not zero", "give the force per current in N/A")

    def _force(self, current: Any, position: Any) -> Any:
        return self.ki * current + self.ks * position

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        """Return the law itself: its slopes are the same everywhere."""
        return self


KNEE = 4
"""Sharpness of the iron's knee: b / (1 + (b / b_s)^KNEE)^(1 / KNEE); 4 follows the curves of
transformer sheet, which bend within a fifth of their saturation."""


def magnet_fluxes(
    current: Any,
    position: Any,
    bias: Any,
    gap: Any,
    cosine: Any,
    bias_difference: Any,
    iron: Any,
    saturation: Any,
) -> Any:
    """Return what the flux densities of two opposed magnets are in proportion to, in A/m."""
    ahead = bias + bias_difference + current
    behind = bias - bias_difference - current
    ahead = ahead * (ahead.real > 0) / (gap + iron - position * cosine)
    behind = behind * (behind.real > 0) / (gap + iron + position * cosine)
    if saturation != np.inf:
        ahead = ahead * (1 + (ahead / saturation) ** KNEE) ** (-1 / KNEE)
        behind = behind * (1 + (behind / saturation) ** KNEE) ** (-1 / KNEE)
    return ahead, behind


def bent(flux: Any, knee: Any) -> Any:
    """Bend a flux as `magnet_fluxes` does, ``knee = saturation^-KNEE``, which may be 0."""
    return flux * (1 + flux**KNEE * knee) ** (-1 / KNEE)


@frozen
class Differential(Law):
    """Two opposed magnets driven by bias plus and minus current.

    F = K cos(alpha) [ (i0 + i)^2 / (s0 - x cos(alpha))^2 - (i0 - i)^2 / (s0 + x cos(alpha))^2 ].
    No magnet carries less than no current. With a bias of 0 one works at a time, that ahead for
    i > 0: F = K cos(alpha) i |i| / (s0 - sign(i) x cos(alpha))^2, whose slope at i = 0 is 0.
    The iron's path adds to both gaps; saturation bends b, the current over the gap, which the flux
    density follows, into b / (1 + (b / b_s)^4)^(1/4). Stray flux and eddy currents are left out.
    """

    stated: ClassVar[Mapping[str, Stated]] = {
        "constant": Stated("N m^2/A^2", "K", positive=True),
        "bias": Stated("A", positive=True),
        "gap": Stated("m", positive=True),
        "angle": Stated("rad"),
        "bias_difference": Stated("A"),
        "iron": Stated("m"),
        "saturation": Stated("A/m", positive=True),
    }
    constant: float  # K in N m^2/A^2, of one magnet: mu0 turns^2 area / 4 of a horseshoe
    bias: float  # i0 in A; 0 where one magnet works at a time
    gap: float  # s0 in m
    angle: float = 0.0  # alpha in rad, between the poles' normals and the axis of the force
    # standard deviations of the constants
    constant_std: float = 0.0
    bias_std: float = 0.0
    gap_std: float = 0.0
    angle_std: float = 0.0
    # half of what the bias of the magnet ahead has more than that of the other, in A
    bias_difference: float = 0.0
    # path in the iron over twice its relative permeability, in m: so much more of a gap
    iron: float = 0.0
    # b_s in A/m, 2 B_s / (mu0 turns) of horseshoes; infinite where the iron is not near it
    saturation: float = np.inf
    # and of the others
    bias_difference_std: float = 0.0
    iron_std: float = 0.0
    saturation_std: float = 0.0

    def __post_init__(self) -> None:
        free = ("bias", "angle", "bias_difference", "iron")
        require_constants(self, ("constant", "gap"), free)
        require_angle(self.angle)
        apart = abs(self.bias_difference)
        for name, value, ok in (
            ("bias", self.bias, self.bias >= 0),
            ("bias_difference", self.bias_difference, apart < self.bias or apart == 0),
            ("iron", self.iron, self.iron >= 0),
            ("saturation", self.saturation, self.saturation > 0),
        ):
            require(value, ok, name, "0 or more, a difference below the bias", "check its unit")
        unsure = max(self.bias_std, self.bias_difference_std)
        require(
            f"0 A, with a deviation of {unsure:g} A",
            bool(self.bias or not unsure),
            "bias",
            "exactly 0, where one magnet works at a time, or a bias",
            "give the bias that there is, or leave the deviation out",
        )

    @property
    def reach(self) -> float:
        """Displacement in m at which the rotor would touch the poles."""
        return float(self.gap / np.cos(self.angle))

    def _force(self, current: Any, position: Any) -> Any:
        ahead, behind = self.fluxes(current, position)
        return self.constant * np.cos(self.angle) * (ahead * ahead - behind * behind)

    def fluxes(self, current: Any, position: Any) -> tuple[Any, Any]:
        ahead, behind = magnet_fluxes(current, position, *self.constants[1:])
        return ahead, behind

    @property
    def constants(self) -> tuple[float, ...]:
        """Constants in the order of `magnet_fluxes`, K before them."""
        magnet = (self.constant, self.bias, self.gap, np.cos(self.angle))
        return (*magnet, self.bias_difference, self.iron, self.saturation)

    @property
    def most(self) -> float:
        """Current in A at which one of the magnets has none left."""
        return self.bias - abs(self.bias_difference) if self.bias else np.inf

    def _within(self, *signals: ArrayLike) -> tuple[Floats, ...]:
        """Return current and position; refuse those beyond the bias or the gap."""
        i, x = np.broadcast_arrays(*super()._within(*signals))
        for name, values, limit, cure in (
            ("current", i, self.most, "check the unit and the bias, or limit the current below it"),
            ("position", x, self.reach, "check the unit and the gap"),
        ):
            over = np.flatnonzero(~(np.abs(values) < limit * (1 + 1e-12)))
            if over.size:
                unit, what = ("A", "bias") if name == "current" else ("m", "gap")
                at = f" at sample {over[0]}" if values.ndim else ""
                raise InputError(
                    f"{name} {values.ravel()[over[0]]:.6g} {unit}{at}, {over.size} such in all",
                    f"less than the {what} of {limit:.6g} {unit}",
                    cure,
                )
        return i, x

    def guess(self, force: Floats, position: Floats) -> Floats:
        """Return the current in A that gives a force in N, iron that saturates left aside.

        It is exact without bias; with it, a first guess by the slope at the centre.
        """
        if self.bias:
            return np.clip(force / self.linearize().ki, -self.most, self.most)
        c, side = np.cos(self.angle), np.sign(force)
        gap = self.gap + self.iron - side * position * c
        return np.asarray(side * gap * np.sqrt(np.abs(force) / (self.constant * c)))

    def _slopes(self, current: float, position: float) -> Any:
        c = np.cos(self.angle)
        gaps = self.gap + self.iron - position * c, self.gap + self.iron + position * c
        biases = self.bias + self.bias_difference, self.bias - self.bias_difference
        ki, ks = 0.0, 0.0
        for gap, bias, side in zip(gaps, biases, (1, -1), strict=True):
            b = (bias + side * current) / gap
            b = b * (b.real > 0)
            bend = 1.0
            if self.saturation != np.inf:
                # The slope of g^2 / 2, g the bent b: b (1 + (b / b_s)^p)^(-2 / p - 1).
                bend = (1 + (b / self.saturation) ** KNEE) ** (-2 / KNEE - 1)
            ki = ki + 2 * self.constant * c * b * bend / gap
            ks = ks + 2 * self.constant * c**2 * b**2 * bend / gap
        return np.array([ki, ks])

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        """Return the slopes at a point; at the origin 4 K i0 cos / s0^2, 4 K i0^2 cos^2 / s0^3.

        Without bias and current there is none.
        """
        self._within(current, position)
        if not self.bias and not current:
            raise InputError(
                "no current in magnets without bias, where the force has no slope",
                "a current other than 0, or a bias",
                "linearize about the current that flows",
            )
        ki, ks = self._slopes(current, position)
        ki_std, ks_std = np.broadcast_to(
            deviation_of(self, lambda law: law._slopes(current, position)), 2
        )
        return Linear(float(ki), float(ks), float(ki_std), float(ks_std))


@frozen
class Flux(Law):
    """Force from flux densities, F = poles A cos(alpha) (B1^2 - B2^2) / (2 mu0).

    B1 is under the magnet that pulls in the positive direction, B2 under the other.
    """

    stated: ClassVar[Mapping[str, Stated]] = {
        "area": Stated("m^2", positive=True),
        "angle": Stated("rad"),
    }
    area: float  # face of one pole in m^2
    poles: int = 2  # poles of each magnet that carry this flux; a horseshoe has two
    angle: float = 0.0  # alpha in rad
    # standard deviations of the constants
    area_std: float = 0.0
    angle_std: float = 0.0

    def __post_init__(self) -> None:
        require_constants(self, ("area",), free=("angle",))
        require_angle(self.angle)
        require(
            self.poles,
            self.poles == int(self.poles) and self.poles > 0,
            "poles",
            "a whole number of poles",
            "a horseshoe magnet has 2",
        )

    @property
    def gain(self) -> Any:
        """Force per B1^2 - B2^2 in N/T^2."""
        return self.poles * self.area * np.cos(self.angle) / (2 * MU0)

    def _force(self, ahead: Any, behind: Any) -> Any:
        return self.gain * (ahead**2 - behind**2)

    def densities(
        self, law: Differential, current: ArrayLike, position: ArrayLike
    ) -> tuple[Floats, Floats]:
        """Return B1 and B2 in T under the poles of `law`, so that both laws give one force."""
        scale = np.sqrt(law.constant * np.cos(law.angle) / self.gain)
        ahead, behind = law.fluxes(*law._within(current, position))
        return scale * ahead, scale * behind
