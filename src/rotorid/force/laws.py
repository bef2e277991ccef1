"""Force laws: currents, fluxes and displacements to forces, one for the rig and for records.

*Notation* (theory, section 4): i current about the bias i0, x displacement about the nominal gap
s0, alpha half the angle between the poles, K the constant of a magnet.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import field
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.force.channel_dynamics import Constant

MU0 = 4e-7 * np.pi
"""Permeability of vacuum in N/A^2."""

_STEP = 1e-30
"""Imaginary part by which an argument moves for a derivative, exact to the last digit."""
Limit = tuple[Callable[[float], bool], str]
"""What a constant may be, and the same in words."""
ABOVE_ZERO: Limit = (lambda v: 0 < v < np.inf, "more than 0 {}")
NOT_ZERO: Limit = (lambda v: v != 0 and abs(v) < np.inf, "not zero")
NOT_BELOW_ZERO: Limit = (lambda v: 0 <= v < np.inf, "0 or more")
OPEN: Limit = (lambda v: v > 0, "more than 0 {}, or infinite")
FINITE: Limit = (lambda v: abs(v) < np.inf, "a finite number")
ACUTE: Limit = (lambda v: abs(v) < np.pi / 2, "half the poles' angle, less than 90 degrees")


def require(ok: object, name: str, found: object, expected: str, cure: str) -> None:
    if not ok:
        raise InputError(f"{name} = {found}", expected, cure, place=name)


class Stated(NamedTuple):
    """A constant of a law, whose field is its key in files: its unit and its limit."""

    unit: str
    limit: Limit
    positive: bool = False  # a search keeps it above 0


@frozen(kw_only=True)
class Law(ABC):
    """A force law of two signals: current and displacement, or two flux densities."""

    stated: ClassVar[Mapping[str, Stated]]  # the constants by their fields
    # by constants: deviations, and names under which channels share them
    std: Mapping[str, float] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)
    # the displacement in the actuator as a combination of channels, where a record's force is read
    position: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, of in self.stated.items():
            value, std = getattr(self, name), self.std.get(name, 0.0)
            holds, expected = of.limit
            cure = f"give {name} of the force law in {of.unit}, as the data sheet has it"
            require(holds(value), name, value, expected.format(of.unit), cure)
            unsure = "a standard deviation of 0 or more, infinite where the constant is unknown"
            cure = "give one standard deviation, or leave it out"
            require(std >= 0, f"{name}_std", std, unsure, cure)

    @property
    def constants(self) -> dict[str, Constant]:
        def constant(name: str, of: Stated) -> Constant:
            std, shared = self.std.get(name, 0.0), self.shared.get(name, "")
            return Constant(name, of.unit, getattr(self, name), std, of.positive, shared)

        return {name: constant(name, of) for name, of in self.stated.items()}

    @property
    def reach(self) -> float:
        """Displacement in m at which the rotor would touch the poles."""
        return np.inf

    @abstractmethod
    def _force(self, *signals: Any) -> Any:
        """Return the force, of complex constants too."""

    def closing(self, current: Floats, position: Floats) -> Floats:
        """Return how far the rotor is towards a magnet that pulls, which `reach` limits."""
        return np.abs(position)

    def _within(self, *signals: ArrayLike) -> tuple[Floats, ...]:
        """Return the signals; refuse those that the law does not hold for."""
        return tuple(np.asarray(each, dtype=float) for each in signals)

    def force(self, *signals: ArrayLike) -> Floats:
        """Return the force in N, broadcast over the signals."""
        return np.asarray(self._force(*self._within(*signals)))

    def force_std(self, *signals: ArrayLike) -> Floats:
        """Return the deviation of the force in N that the constants' deviations cause."""
        at = self._within(*signals)
        return self.deviation_of(lambda law: law._force(*at))

    def deviation_of(self, function: Callable[[Self], Any]) -> Floats:
        """Return the deviation of a function by those of the constants; infinite by an unknown."""
        total: Any = 0.0
        for name, deviation in self.std.items():
            step = _STEP * (abs(getattr(self, name)) or 1.0)
            slope = np.imag(function(self.moved({name: 1j * step}))) / step
            if deviation == np.inf:  # zero times infinity would be no number
                slope, deviation = np.where(slope == 0, 0.0, np.inf), 1.0
            total = total + (slope * deviation) ** 2
        return np.asarray(np.sqrt(total), dtype=float)

    def moved(self, changes: Mapping[str, complex]) -> Self:
        """Return the law with those of the constants that it has moved by so much, unchecked."""
        found = copy.copy(self)
        for name in changes.keys() & self.stated:
            object.__setattr__(found, name, getattr(self, name) + changes[name])
        return found

    def flowing(self, force: Floats, position: Floats) -> Floats:
        """Return what made a force: the current in A, of a flux law the force itself."""
        return force

    def changed(
        self, flowing: Floats, position: Floats, changes: Mapping[str, complex]
    ) -> Floats | Complexes:
        """Return the force in N of what flows, with constants moved by so much."""
        return np.asarray(self.moved(changes)._force(flowing, position))


@frozen
class Linear(Law):
    """The linear law, F = k_i i + k_s x."""

    stated: ClassVar[Mapping[str, Stated]] = {
        "ki": Stated("N/A", NOT_ZERO),
        "ks": Stated("N/m", FINITE),
    }
    ki: float  # force per current in N/A
    ks: float = 0.0  # force per displacement in N/m; positive destabilizes

    def _force(self, current: Any, position: Any) -> Any:
        return self.ki * current + self.ks * position

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        return self


KNEE = 4
"""Sharpness of the iron's knee: b / (1 + (b / b_s)^KNEE)^(1 / KNEE); 4 follows the curves of
transformer sheet, which bend within a fifth of their saturation."""


def magnet_fluxes(current: Any, position: Any, magnet: Any) -> Any:
    """Return what the flux densities of two opposed magnets are in proportion to, in A/m."""
    bias, gap, cosine, difference, iron, saturation = magnet
    ahead = bias + difference + current
    behind = bias - difference - current
    # A magnet without current has no flux, be its gap closed or not.
    flows, flows_behind = ahead.real > 0, behind.real > 0
    ahead = ahead * flows / (1 - flows + flows * (gap + iron - position * cosine))
    path = 1 - flows_behind + flows_behind * (gap + iron + position * cosine)
    behind = behind * flows_behind / path
    if saturation != np.inf:
        ahead = ahead * (1 + (ahead / saturation) ** KNEE) ** (-1 / KNEE)
        behind = behind * (1 + (behind / saturation) ** KNEE) ** (-1 / KNEE)
    return ahead, behind


def bent(flux: Any, knee: Any) -> Any:
    """Bend a flux as `magnet_fluxes` does, ``knee = saturation^-KNEE``, which may be 0."""
    return flux * (1 + flux**KNEE * knee) ** (-1 / KNEE)


KNEE_CONSTANT = "knee"
"""How much of a knee the iron has, (b_0 / b_s)^4, b_0 the bias over the gap: what bends as much as
it does, however far off saturation is, so that a search may begin from none."""

_BIASED = ("bias", "bias_difference")
_ROUNDS = 50
"""Newton's steps at most; four or five are taken, a dozen where the iron is near saturation."""


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
        "K": Stated("N m^2/A^2", ABOVE_ZERO, positive=True),
        "bias": Stated("A", NOT_BELOW_ZERO, positive=True),
        "gap": Stated("m", ABOVE_ZERO, positive=True),
        "angle": Stated("rad", ACUTE),
        "bias_difference": Stated("A", FINITE),
        "iron": Stated("m", NOT_BELOW_ZERO),
        "saturation": Stated("A/m", OPEN, positive=True),
    }
    K: float  # in N m^2/A^2, of one magnet: mu0 turns^2 area / 4 of a horseshoe
    bias: float  # i0 in A; 0 where one magnet works at a time
    gap: float  # s0 in m
    angle: float = 0.0  # alpha in rad, between the poles' normals and the axis of the force
    # half of what the bias of the magnet ahead has more than that of the other, in A
    bias_difference: float = 0.0
    # path in the iron over twice its relative permeability, in m: so much more of a gap
    iron: float = 0.0
    # b_s in A/m, 2 B_s / (mu0 turns) of horseshoes; infinite where the iron is not near it
    saturation: float = np.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        apart, unsure = self.bias_difference, max(self.std.get(name, 0.0) for name in _BIASED)
        below = abs(apart) < self.bias or not apart
        require(below, "bias_difference", apart, "a difference below the bias", "check its unit")
        require(
            self.bias or not unsure,
            "bias",
            f"0 A, with a deviation of {unsure:g} A",
            "exactly 0, where one magnet works at a time, or a bias",
            "give the bias that there is, or leave the deviation out",
        )

    @property
    def constants(self) -> dict[str, Constant]:
        found = super().constants
        return found if self.bias else {n: c for n, c in found.items() if n not in _BIASED}

    @property
    def reach(self) -> float:
        return float(self.gap / np.cos(self.angle))

    def closing(self, current: Floats, position: Floats) -> Floats:
        return np.abs(position) if self.bias else np.sign(current) * position

    def _force(self, current: Any, position: Any) -> Any:
        return self._pull(*self.fluxes(current, position))

    def _pull(self, ahead: Any, behind: Any) -> Any:
        return self.K * np.cos(self.angle) * (ahead * ahead - behind * behind)

    def fluxes(self, current: Any, position: Any) -> tuple[Any, Any]:
        ahead, behind = magnet_fluxes(current, position, self.numbers[1:])
        return ahead, behind

    @property
    def numbers(self) -> tuple[float, ...]:
        """Constants in the order of `magnet_fluxes`, K before them."""
        magnet = (self.K, self.bias, self.gap, np.cos(self.angle))
        return (*magnet, self.bias_difference, self.iron, self.saturation)

    @property
    def most(self) -> float:
        """Current in A at which one of the magnets has none left."""
        return self.bias - abs(self.bias_difference) if self.bias else np.inf

    def _within(self, *signals: ArrayLike) -> tuple[Floats, ...]:
        i, x = np.broadcast_arrays(*super()._within(*signals))
        below = "check the unit and the bias, or limit the current below it"
        for name, values, size, limit, cure in (
            ("current", i, np.abs(i), self.most, below),
            ("position", x, self.closing(i, x), self.reach, "check the unit and the gap"),
        ):
            over = np.flatnonzero(~(size < limit * (1 + 1e-12)))
            if over.size:
                unit, what = ("A", "bias") if name == "current" else ("m", "gap")
                at = f" at sample {over[0]}" if values.ndim else ""
                found = f"{name} {values.ravel()[over[0]]:.6g} {unit}{at}, {over.size} such in all"
                raise InputError(found, f"less than the {what} of {limit:.6g} {unit}", cure)
        return i, x

    def flowing(self, force: Floats, position: Floats) -> Floats:
        """Return the current; forces beyond what the magnets can give stand for the most."""
        current = self.guess(force, position)
        size = self.bias or float(np.abs(current).max(initial=0.0)) or 1.0
        slope = self.linearize(0.0 if self.bias else size).ki
        for _ in range(_ROUNDS):
            found = self._force(current + 1j * _STEP, position)
            step = (force - found.real) / np.maximum(found.imag / _STEP, 1e-3 * slope)
            nearer = np.clip(current + step, -self.most, self.most)
            moved = np.abs(nearer - current).max(initial=0.0)
            current = nearer
            if moved < 1e-12 * size:
                break
        return np.asarray(current)

    def changed(
        self, flowing: Floats, position: Floats, changes: Mapping[str, complex]
    ) -> Floats | Complexes:
        moved = self.moved(changes)
        fluxes: Any = moved.fluxes(flowing, position)
        if KNEE_CONSTANT in changes:
            knee = changes[KNEE_CONSTANT] * (self.gap / self.bias) ** KNEE
            fluxes = [bent(flux, knee) for flux in fluxes]
        return np.asarray(moved._pull(*fluxes))

    def guess(self, force: Floats, position: Floats) -> Floats:
        """Return the current in A of a force in N, unsaturated: exact without bias, else near."""
        if self.bias:
            return np.clip(force / self.linearize().ki, -self.most, self.most)
        c, side = np.cos(self.angle), np.sign(force)
        gap = self.gap + self.iron - side * position * c
        return np.asarray(side * gap * np.sqrt(np.abs(force) / (self.K * c)))

    def _slopes(self, current: float, position: float) -> Any:
        c = np.cos(self.angle)
        gaps = self.gap + self.iron - position * c, self.gap + self.iron + position * c
        biases = self.bias + self.bias_difference, self.bias - self.bias_difference
        ki, ks = 0.0, 0.0
        for gap, bias, side in zip(gaps, biases, (1, -1), strict=True):
            flowing = bias + side * current
            if flowing.real <= 0:
                continue
            b = flowing / gap
            bend = 1.0
            if self.saturation != np.inf:
                # The slope of g^2 / 2, g the bent b: b (1 + (b / b_s)^p)^(-2 / p - 1).
                bend = (1 + (b / self.saturation) ** KNEE) ** (-2 / KNEE - 1)
            ki = ki + 2 * self.K * c * b * bend / gap
            ks = ks + 2 * self.K * c**2 * b**2 * bend / gap
        return np.array([ki, ks])

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        """Return the slopes at a point; at the origin 4 K i0 cos / s0^2, 4 K i0^2 cos^2 / s0^3."""
        self._within(current, position)
        if not self.bias and not current:
            found = "no current in magnets without bias, where the force has no slope"
            cure = "linearize about the current that flows"
            raise InputError(found, "a current other than 0, or a bias", cure)
        ki, ks = self._slopes(current, position)
        std = np.broadcast_to(self.deviation_of(lambda law: law._slopes(current, position)), 2)
        named = zip(("ki", "ks"), std.tolist(), strict=True)
        return Linear(float(ki), float(ks), std=dict(named))


@frozen
class Flux(Law):
    """Force from flux densities, F = poles A cos(alpha) (B1^2 - B2^2) / (2 mu0).

    B1 is under the magnet that pulls in the positive direction, B2 under the other.
    """

    stated: ClassVar[Mapping[str, Stated]] = {
        "area": Stated("m^2", ABOVE_ZERO, positive=True),
        "angle": Stated("rad", ACUTE),
    }
    area: float  # face of one pole in m^2
    poles: int = 2  # poles of each magnet that carry this flux
    angle: float = 0.0  # alpha in rad

    def __post_init__(self) -> None:
        super().__post_init__()
        whole = self.poles == int(self.poles) and self.poles > 0
        require(whole, "poles", self.poles, "a whole number of poles", "a horseshoe magnet has 2")

    @property
    def gain(self) -> Any:
        """Force per B1^2 - B2^2 in N/T^2."""
        return self.poles * self.area * np.cos(self.angle) / (2 * MU0)

    def _force(self, ahead: Any, behind: Any) -> Any:
        return self.gain * (ahead**2 - behind**2)

    def changed(
        self, flowing: Floats, position: Floats, changes: Mapping[str, complex]
    ) -> Floats | Complexes:
        return np.asarray(flowing * (self.moved(changes).gain / self.gain))

    def densities(
        self, law: Differential, current: ArrayLike, position: ArrayLike
    ) -> tuple[Floats, Floats]:
        """Return B1 and B2 in T under the poles of `law`, so that both laws give one force."""
        scale = np.sqrt(law.K * np.cos(law.angle) / self.gain)
        ahead, behind = law.fluxes(*law._within(current, position))
        return scale * ahead, scale * behind
