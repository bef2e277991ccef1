"""What a drawn rotor weighs as a whole."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rotorid.frozen import frozen
from rotorid.models.rotor.model import RotorModel


@frozen
class Inertia:
    """Mass in kg, its centre in m from the left end, and moments of inertia about it in kg m^2."""

    mass: float
    centre: float
    transverse: float
    polar: float


def inertia(model: RotorModel, values: Mapping[str, float]) -> Inertia:
    """Return the inertia of the whole rotor, from its M and G.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> model = load_model("flexible")
    >>> round(inertia(model, model.nominal).mass, 3)
    4.167
    """
    matrices = model.require_linear().matrices(model.values(values))
    place = model.rotor.positions
    across, tilt = np.zeros(len(model.coordinates)), np.zeros(len(model.coordinates))
    across[0::4] = 1.0
    tilt[0::4], tilt[3::4] = place, 1.0
    mass, first = across @ matrices.M @ across, across @ matrices.M @ tilt
    centre = first / mass
    turned = tilt - centre * across
    other = np.zeros(len(model.coordinates))
    other[1::4], other[2::4] = -turned[0::4], turned[3::4]
    return Inertia(
        float(mass),
        float(centre),
        float(turned @ matrices.M @ turned),
        float(other @ matrices.G @ turned),
    )
