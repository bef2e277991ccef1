"""What a drawing may lack or have wrong, as matrices: to be tried where a record rejects it.

Mass and inertia added at a node, a section or one element stiffer than drawn, a sensor or an
actuator elsewhere on the shaft. Each is a derivative, at the drawing as it stands, of the matrices
or of what a sensor reads, per unit of the change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.models.rotor.drawing import AXES
from rotorid.models.rotor.elements import PLANES, both_planes
from rotorid.models.rotor.model import RotorModel
from rotorid.record import Floats


@dataclass(frozen=True, eq=False)
class Change:
    """A change of a rotor: its name and unit, and what one unit adds to K and to M.

    Shape (coordinate, coordinate) each.
    """

    name: str
    unit: str
    stiffness: Floats
    mass: Floats


def added_mass(model: RotorModel, node: int) -> Change:
    """Return a mass at a node, per kg."""
    own = np.zeros((len(model.coordinates),) * 2)
    first = PLANES * node
    own[first, first] = own[first + 1, first + 1] = 1.0
    return Change(f"mass at {label(model, node)}", "kg", np.zeros_like(own), own)


def added_inertia(model: RotorModel, node: int) -> Change:
    """Return a transverse moment of inertia at a node, per kg m^2."""
    own = np.zeros((len(model.coordinates),) * 2)
    first = PLANES * node
    own[first + 2, first + 2] = own[first + 3, first + 3] = 1.0
    return Change(f"inertia at {label(model, node)}", "kg m^2", np.zeros_like(own), own)


def stiffer_section(model: RotorModel, number: int, values: Mapping[str, float]) -> Change:
    """Return a section whose E is twice what it is: one unit of a factor on its stiffness."""
    rotor, known = model.rotor, {**model.fixed, **values}
    own = np.zeros((len(model.coordinates),) * 2)
    left = sum(section.length for section in rotor.sections[:number])
    right = left + rotor.sections[number].length
    for node, section, beam in rotor.spans():
        if left <= rotor.positions[node] + beam.length / 2 <= right:
            where = slice(PLANES * node, PLANES * node + 2 * PLANES)
            E = section.E.times(section.stiffness).value(known)
            own[where, where] += E / section.modulus * both_planes(beam.stiffness())
    return Change(f"stiffness of section {number + 1}", "1", own, np.zeros_like(own))


def shifted(model: RotorModel, reads: Mapping[str, float]) -> dict[str, float]:
    """Return what a combination of displacements gains per metre that it stands further right."""
    slopes: dict[str, float] = {}
    for name, share in reads.items():
        axis, place = name.split("_", 1)
        if axis in AXES[:2]:
            slope, sign = (f"theta_y_{place}", 1.0) if axis == "x" else (f"theta_x_{place}", -1.0)
            slopes[slope] = slopes.get(slope, 0.0) + sign * share
    return slopes


def label(model: RotorModel, node: int) -> str:
    """Return what to call a node: its place, an end of the shaft, or its position."""
    place = model.rotor.nodes[node]
    if place.named:
        return place.names[0]
    if node in (0, len(model.rotor.nodes) - 1):
        return "the left end" if node == 0 else "the right end"
    return f"{1e3 * place.position:.5g} mm"
