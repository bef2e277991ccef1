"""To ROSS, whose elements are these; it is asked for here only, and only where a rotor goes there.

ROSS calls theta_x alpha and theta_y beta.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rotorid.errors import ModelError
from rotorid.models.rotor.drawing import Rotor, Support


def to_ross(rotor: Rotor, known: Mapping[str, float]) -> Any:
    """Return the ROSS rotor of a drawing; `known` holds its parameters and Omega."""
    try:
        import ross
    except ImportError:
        raise ModelError(
            "no package ross", "ROSS 2.3 or later", "pip install rotorid[ross]"
        ) from None
    for name in ("internal", "external", "structural"):
        if getattr(rotor, name).value(known):
            raise ModelError(
                f"{name} damping of {getattr(rotor, name).value(known):g}",
                "none, which ROSS does not have",
                "put its parameter to 0",
            )
    shaft = []
    for node, section, beam in rotor.spans():
        modulus = section.E.times(section.stiffness).value(known)
        density = section.density.value(known)
        material = ross.Material(f"m{node}", rho=density, E=modulus, G_s=modulus / section.ratio)
        shaft.append(
            ross.ShaftElement(
                beam.length, idl=beam.inner, odl=beam.outer, material=material, n=node
            )
        )
    discs = [
        ross.DiskElement(
            rotor.node(d.at), d.mass.value(known), d.I_t.value(known), d.I_p.value(known)
        )
        for d in rotor.discs.values()
    ]
    bearings = [_bearing(ross, rotor, support, known) for support in rotor.supports.values()]
    return ross.Rotor(shaft, discs, bearings)


def _bearing(ross: Any, rotor: Rotor, support: Support, known: Mapping[str, float]) -> Any:
    axes = ("xx", "xy", "yx", "yy")
    constants = {
        kind + axis: quantity.value(known)
        for kind, table in (("k", support.stiffness), ("c", support.damping))
        for axis, quantity in zip(axes, table, strict=True)
    }
    return ross.BearingElement(rotor.node(support.at), **constants)
