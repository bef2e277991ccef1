"""Force laws of magnetic bearings, from current and displacement.

The laws are values. The levitated rig drives its rotor with them and the reader of records turns
measured currents into forces with them, so the two cannot differ.

*Notation* (theory, section 4): i current about the bias i0, x displacement about the nominal gap
s0, alpha half the angle between the poles, K the constant of a magnet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from rotorid.actuators.constants import (
    MU0,
    deviation_of,
    require,
    require_angle,
    require_constants,
)
from rotorid.errors import InputError
from rotorid.record import Floats


@runtime_checkable
class CurrentLaw(Protocol):
    """A law that gives the force from a current and a displacement."""

    def force(self, current: ArrayLike, position: ArrayLike) -> Floats:
        """Return the force in N."""

    def force_std(self, current: ArrayLike, position: ArrayLike) -> Floats:
        """Return the standard deviation of the force in N that the constants' cause."""

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        """Return the slopes k_i and k_s at a point."""


@dataclass(frozen=True)
class Linear:
    """The linear law, F = k_i i + k_s x.

    Parameters
    ----------
    ki : float
        Force per current in N/A, not zero.
    ks : float
        Force per displacement in N/m; positive destabilizes.
    ki_std, ks_std : float
        Standard deviations of the constants.

    Raises
    ------
    InputError
        For constants that are not finite, or ki = 0.

    Examples
    --------
    >>> law = Linear(ki=120.0, ks=2e5, ki_std=1.2)
    >>> float(law.force(0.5, 1e-4)), float(law.force_std(0.5, 1e-4))
    (80.0, 0.6)
    """

    ki: float
    ks: float = 0.0
    ki_std: float = 0.0
    ks_std: float = 0.0

    def __post_init__(self) -> None:
        require_constants(self, {}, ("ki", "ks"))
        require(self.ki, self.ki != 0, "ki", "not zero", "give the force per current in N/A")

    def _force(self, current: Any, position: Any) -> Any:
        return self.ki * current + self.ks * position

    def force(self, current: ArrayLike, position: ArrayLike) -> Floats:
        """Return the force in N, broadcast over current (A) and position (m)."""
        return np.asarray(self._force(np.asarray(current, float), np.asarray(position, float)))

    def force_std(self, current: ArrayLike, position: ArrayLike) -> Floats:
        """Return the deviation of the force in N that the constants' deviations cause."""
        at = np.asarray(current, float), np.asarray(position, float)
        return deviation_of(self, ("ki", "ks"), lambda law: law._force(*at))

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        """Return the law itself: its slopes are the same everywhere."""
        return self


def differential_force(
    current: Any, position: Any, constant: Any, bias: Any, gap: Any, cosine: Any
) -> Any:
    """Return the force of two opposed magnets, unchecked; also compiled into the rig."""
    ahead = (bias + current) / (gap - position * cosine)
    behind = (bias - current) / (gap + position * cosine)
    return constant * cosine * (ahead * ahead - behind * behind)


@dataclass(frozen=True)
class Differential:
    """Two opposed magnets driven by bias plus and minus current.

    F = K cos(alpha) [ (i0 + i)^2 / (s0 - x cos(alpha))^2 - (i0 - i)^2 / (s0 + x cos(alpha))^2 ].
    Iron, stray flux and eddy currents are left out.

    Parameters
    ----------
    constant : float
        K in N m^2/A^2, of one magnet; `from_geometry` computes it.
    bias : float
        i0 in A.
    gap : float
        s0 in m.
    angle : float
        alpha in rad, between the poles' normals and the axis of the force.
    constant_std, bias_std, gap_std, angle_std : float
        Standard deviations of the constants.

    Raises
    ------
    InputError
        For constants that are not positive, as a gap of zero.

    Examples
    --------
    >>> law = Differential(constant=1e-5, bias=2.0, gap=4e-4)
    >>> slope = law.linearize()
    >>> bool(np.isclose(slope.ki, 4 * 1e-5 * 2.0 / 4e-4**2)), round(slope.ks)
    (True, 2500000)
    """

    constant: float
    bias: float
    gap: float
    angle: float = 0.0
    constant_std: float = 0.0
    bias_std: float = 0.0
    gap_std: float = 0.0
    angle_std: float = 0.0

    def __post_init__(self) -> None:
        require_constants(self, {"constant": "N m^2/A^2", "bias": "A", "gap": "m"}, free=("angle",))
        require_angle(self.angle)

    @classmethod
    def from_geometry(
        cls, area: float, turns: float, bias: float, gap: float, angle: float = 0.0
    ) -> Differential:
        """Return the law of horseshoe magnets: K = mu0 turns^2 area / 4.

        Parameters
        ----------
        area : float
            Face of one pole in m^2; a magnet has two.
        turns : float
            Turns of the magnet, over both poles.
        bias, gap, angle : float
            As for the class.

        Returns
        -------
        Differential

        Raises
        ------
        InputError
            For constants that are not positive.
        """
        for name, value in (("area", area), ("turns", turns)):
            require(value, value > 0, name, "more than 0", "correct the geometry")
        return cls(MU0 * turns**2 * area / 4, bias, gap, angle)

    @property
    def reach(self) -> float:
        """Displacement in m at which the rotor would touch the poles."""
        return float(self.gap / np.cos(self.angle))

    def _force(self, current: Any, position: Any) -> Any:
        return differential_force(
            current, position, self.constant, self.bias, self.gap, np.cos(self.angle)
        )

    def _within(self, current: ArrayLike, position: ArrayLike) -> tuple[Floats, Floats]:
        i, x = np.broadcast_arrays(np.asarray(current, float), np.asarray(position, float))
        for name, values, limit, cure in (
            ("current", i, self.bias, "check the unit and the bias, or limit the current below it"),
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

    def force(self, current: ArrayLike, position: ArrayLike) -> Floats:
        """Return the force in N, broadcast over current (A) and position (m).

        Raises
        ------
        InputError
            Where a current is beyond the bias or a position beyond the gap.
        """
        return np.asarray(self._force(*self._within(current, position)))

    def force_std(self, current: ArrayLike, position: ArrayLike) -> Floats:
        """Return the deviation of the force in N that the constants' deviations cause."""
        at = self._within(current, position)
        names = ("constant", "bias", "gap", "angle")
        return deviation_of(self, names, lambda law: law._force(*at))

    def _slopes(self, current: float, position: float) -> Any:
        c = np.cos(self.angle)
        near, far = self.gap - position * c, self.gap + position * c
        ahead, behind = self.bias + current, self.bias - current
        ki = 2 * self.constant * c * (ahead / near**2 + behind / far**2)
        ks = 2 * self.constant * c**2 * (ahead**2 / near**3 + behind**2 / far**3)
        return np.array([ki, ks])

    def linearize(self, current: float = 0.0, position: float = 0.0) -> Linear:
        """Return the slopes at a point; at the origin 4 K i0 cos / s0^2, 4 K i0^2 cos^2 / s0^3.

        Raises
        ------
        InputError
            Where the point lies beyond bias or gap.
        """
        self._within(current, position)
        names = ("constant", "bias", "gap", "angle")
        ki, ks = self._slopes(current, position)
        ki_std, ks_std = np.broadcast_to(
            deviation_of(self, names, lambda law: law._slopes(current, position)), 2
        )
        return Linear(float(ki), float(ks), float(ki_std), float(ks_std))
