"""Force from flux densities, as Hall sensors under the poles measure them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rotorid.actuators.constants import (
    MU0,
    deviation_of,
    require,
    require_angle,
    require_constants,
)
from rotorid.actuators.laws import Differential
from rotorid.frozen import frozen
from rotorid.record import Floats


@frozen
class Flux:
    """Force from the flux densities under opposed poles.

    F = poles A cos(alpha) (B1^2 - B2^2) / (2 mu0): B1 under the magnet that pulls in the positive
    direction, B2 under the other.

    Parameters
    ----------
    area : float
        Face of one pole in m^2.
    poles : int
        Poles of each magnet that carry this flux; a horseshoe has two.
    angle : float
        alpha in rad.
    area_std, angle_std : float
        Standard deviations of the constants.

    Raises
    ------
    InputError
        For an area or number of poles that is not positive.

    Examples
    --------
    >>> law = Flux(area=2e-4, poles=2)
    >>> round(float(law.force(0.6, 0.5)), 3)
    17.507
    """

    area: float
    poles: int = 2
    angle: float = 0.0
    area_std: float = 0.0
    angle_std: float = 0.0

    def __post_init__(self) -> None:
        require_constants(self, {"area": "m^2"}, free=("angle",))
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

    def force(self, ahead: ArrayLike, behind: ArrayLike) -> Floats:
        """Return the force in N from the flux densities B1 and B2 in T."""
        return np.asarray(self.gain * (np.asarray(ahead) ** 2 - np.asarray(behind) ** 2))

    def force_std(self, ahead: ArrayLike, behind: ArrayLike) -> Floats:
        """Return the deviation of the force in N that the constants' deviations cause."""
        square = np.asarray(ahead) ** 2 - np.asarray(behind) ** 2
        return deviation_of(self, ("area", "angle"), lambda law: law.gain * square)

    def densities(
        self, law: Differential, current: ArrayLike, position: ArrayLike
    ) -> tuple[Floats, Floats]:
        """Return B1 and B2 in T under the poles of `law`, so that both laws give one force.

        Raises
        ------
        InputError
            Where current or position lie beyond bias or gap.
        """
        scale = np.sqrt(law.constant * np.cos(law.angle) / self.gain)
        ahead, behind = law.fluxes(*law._within(current, position))
        return scale * ahead, scale * behind
