"""What a force was made of: its law and its displacement, kept with the channel of the force.

The forces of laws that bend are computed sample by sample, before any line is taken. Should a
constant of the law be another one than stated, the force is another one too: the current that made
it is found again, by inverting the law, and goes through the law with the other constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from rotorid.actuators.constants import with_moved
from rotorid.actuators.flux import Flux
from rotorid.actuators.laws import KNEE, Differential, bent
from rotorid.frozen import frozen
from rotorid.record import Complexes, Floats, LawConstant

KNEE_CONSTANT = "knee"
"""How much of a knee the iron has, (b_0 / b_s)^4, b_0 the bias over the gap: what bends as much as
it does, however far off saturation is, so that a search may begin from none."""

_MAGNET = {
    # constant: name in files, unit, must be positive
    "constant": ("K", "N m^2/A^2", True),
    "bias": ("bias", "A", True),
    "gap": ("gap", "m", True),
    "angle": ("angle", "rad", False),
    "bias_difference": ("bias_difference", "A", False),
    "iron": ("iron", "m", False),
    "saturation": ("saturation", "A/m", True),
}
_BIASED = ("bias", "bias_difference")
_FLUX = {"area": ("area", "m^2", True), "angle": ("angle", "rad", False)}
_STEPS = 50
"""Newton's steps at most; four or five are taken, a dozen where the iron is near saturation."""


@frozen
class ForceSource:
    """The law of a channel's force, as `rotorid.record.ForceLaw` asks.

    Parameters
    ----------
    law : Differential or Flux
    position : mapping of str to float
        Displacement in the actuator as a combination of channels; empty for `Flux`.
    shared : mapping of str to str
        Names under which constants are shared with other channels.
    """

    law: Differential | Flux
    position: Mapping[str, float] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)

    @property
    def constants(self) -> dict[str, LawConstant]:
        """Constants by their names in files."""
        table = _FLUX if isinstance(self.law, Flux) else _MAGNET
        return {
            name: LawConstant(
                unit,
                getattr(self.law, key),
                getattr(self.law, f"{key}_std"),
                positive,
                self.shared.get(key, ""),
            )
            for key, (name, unit, positive) in table.items()
            if not (key in _BIASED and isinstance(self.law, Differential) and not self.law.bias)
        }

    def flowing(self, force: Floats, position: Floats) -> Floats:
        """Return the current in A that made a force; for a flux law the force itself.

        Forces beyond what the magnets can give stand for the most that they can.
        """
        if isinstance(self.law, Flux):
            return force
        current = self.law.guess(force, position)
        size = self.law.bias or float(np.abs(current).max(initial=0.0)) or 1.0
        slope = self.law.linearize(0.0 if self.law.bias else size).ki
        for _ in range(_STEPS):
            found = self.law._force(current + 1e-30j, position)
            step = (force - found.real) / np.maximum(found.imag / 1e-30, 1e-3 * slope)
            nearer = np.clip(current + step, -self.law.most, self.law.most)
            moved = np.abs(nearer - current).max(initial=0.0)
            current = nearer
            if moved < 1e-12 * size:
                break
        return np.asarray(current)

    def force(
        self, flowing: Floats, position: Floats, changes: Mapping[str, complex]
    ) -> Floats | Complexes:
        """Return the force in N with some constants, by their names, changed by so much."""
        table = _FLUX if isinstance(self.law, Flux) else _MAGNET
        keys = {name: key for key, (name, _, _) in table.items()}
        moved = with_moved(self.law, {keys[n]: c for n, c in changes.items() if n in keys})
        if isinstance(self.law, Flux):
            return np.asarray(flowing * (moved.gain / self.law.gain))
        fluxes: Any = moved.fluxes(flowing, position)
        if KNEE_CONSTANT in changes:
            knee = changes[KNEE_CONSTANT] * (self.law.gap / self.law.bias) ** KNEE
            fluxes = [bent(flux, knee) for flux in fluxes]
        ahead, behind = fluxes
        return np.asarray(moved.constant * np.cos(moved.angle) * (ahead**2 - behind**2))
