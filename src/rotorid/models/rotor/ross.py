"""Rotors from ROSS and to it.

ROSS calls theta_x alpha and theta_y beta.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, ModelError, require_names
from rotorid.models.model import Parameter
from rotorid.models.rotor.drawing import (
    CROSSED,
    ChannelPlace,
    Disc,
    Material,
    Quantity,
    Rotor,
    Section,
    Support,
)
from rotorid.models.rotor.fem import spans
from rotorid.models.rotor.rotor_model import RotorModel, rotor_model


def to_ross(rotor: Rotor, known: Mapping[str, float]) -> Any:
    """Return the ROSS rotor of a drawing; `known` holds its parameters and Omega."""
    try:
        import ross
    except ImportError:
        raise ModelError(
            "no package ross", "ROSS 2.3 or later", "pip install rotorid[ross]"
        ) from None
    for name, damping in rotor.damping:
        if damping.value(known):
            raise ModelError(
                f"{name} damping of {damping.value(known):g}",
                "none, which ROSS does not have",
                "put its parameter to 0",
            )
    shaft = []
    for node, section, beam in spans(rotor):
        modulus = section.material.E.times(section.stiffness).value(known)
        density = section.material.density.value(known)
        material = ross.Material(
            f"m{node}", rho=density, E=modulus, G_s=modulus / section.material.ratio
        )
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
    constants = {
        kind + axes: quantity.value(known)
        for kind in "kc"
        for axes, quantity in zip(CROSSED, support.table(kind), strict=True)
    }
    return ross.BearingElement(rotor.node(support.at), **constants)


def from_ross(
    rotor: Any,
    *,
    actuators: Mapping[str, int] | None = None,
    sensors: Mapping[str, int] | None = None,
    unknown: Sequence[str] | None = None,
) -> RotorModel:
    """Return the model of a ROSS rotor: its shaft, disks and bearings.

    Parameters
    ----------
    rotor : ross.Rotor
        Of cylindrical elements.
    actuators, sensors : mapping of str to int
        Nodes of the actuators, whose inputs are F_x and F_y before the name, and of the sensors.
    unknown : sequence of str, optional
        The parameters to keep; the others are put in as ROSS has them. The parameters are
        ``m_0``, ``I_t_0``, ``I_p_0`` of disk 0; ``kxx_0``, ``cxx_0`` and so on of bearing 0,
        as far as they are not zero; and ``s_0``, a factor on E of shaft element 0.

    Returns
    -------
    RotorModel

    Raises
    ------
    InputError
        For what a model of this package has not: conical elements, bearings that depend on the
        speed or the frequency, a parameter that is none.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> model = load_model("flexible")
    >>> ross_rotor = model.to_ross(model.nominal | {"c_i": 0.0})  # doctest: +SKIP
    >>> from_ross(ross_rotor, unknown=["m_0"]).parameter_names  # doctest: +SKIP
    ('m_0',)
    """
    parameters: list[Parameter] = []
    at = np.concatenate([[0.0], np.cumsum([float(e.L) for e in _in_order(rotor)])])

    def named(name: str, unit: str, value: float, *, positive: bool = True) -> Quantity:
        if not value:
            return Quantity(())
        parameters.append(Parameter(name, unit, float(value), positive and value > 0))
        return Quantity(((((name, 1),), 1.0),))

    sections = tuple(
        _section(element, named(f"s_{k}", "1", 1.0)) for k, element in enumerate(_in_order(rotor))
    )
    discs = {
        f"disc{k}": Disc(
            at=float(at[disk.n]),
            mass=named(f"m_{k}", "kg", disk.m),
            I_t=named(f"I_t_{k}", "kg m^2", disk.Id),
            I_p=named(f"I_p_{k}", "kg m^2", disk.Ip),
        )
        for k, disk in enumerate(rotor.disk_elements)
    }
    signed = partial(named, positive=False)
    supports = {
        f"bearing{k}": _support(float(at[bearing.n]), k, bearing, signed)
        for k, bearing in enumerate(rotor.bearing_elements)
    }
    pushed, read = (
        {name: ChannelPlace(at=float(at[node])) for name, node in (table or {}).items()}
        for table in (actuators, sensors)
    )
    drawn = Rotor.model_construct(
        sections=sections, discs=discs, supports=supports, actuators=pushed, sensors=read
    )
    model = rotor_model(drawn, parameters, name="ross", title=str(getattr(rotor, "tag", "")))
    return model if unknown is None else _only(model, tuple(unknown))


def _support(
    at: float, number: int, bearing: Any, named: Callable[[str, str, float], Quantity]
) -> Support:
    """Return a bearing, its constants as parameters."""
    quantities = {
        kind + axes: named(f"{kind}{axes}_{number}", unit, _constant(bearing, kind + axes))
        for kind, unit in (("k", "N/m"), ("c", "N s/m"))
        for axes in CROSSED
    }
    return Support(at=at, **quantities)


def _only(model: RotorModel, unknown: Sequence[str]) -> RotorModel:
    """Return the model with some of its parameters, the others put in."""
    cure = "take names from there"
    require_names(unknown, model.parameter_names, "no parameter {}", cure, place="unknown")
    return model.substitute({n: v for n, v in model.nominal.items() if n not in unknown})


def _in_order(rotor: Any) -> list[Any]:
    """Return the elements of a shaft from left to right, one after the other."""
    elements = sorted(rotor.shaft_elements, key=lambda e: int(e.n))
    if [int(e.n) for e in elements] != list(range(len(elements))):
        raise InputError(
            "elements of a shaft side by side",
            "one element between two nodes",
            "put layers into one element, or into the stiffness of a section",
        )
    return elements


def _section(element: Any, stiffness: Quantity) -> Section:
    if element.odl != element.odr or element.idl != element.idr:
        raise InputError(
            f"the conical element {element.n}", "cylinders", "divide it into steps of its mean"
        )
    material = element.material
    return Section(
        length=float(element.L),
        outer=float(element.odl),
        inner=float(element.idl),
        material=Material(
            E=Quantity.of(material.E),
            G=Quantity.of(material.G_s),
            density=Quantity.of(material.rho),
        ),
        stiffness=stiffness,
        elements=1,
    )


def _constant(bearing: Any, name: str) -> float:
    values = np.atleast_1d(np.asarray(getattr(bearing, name), dtype=float))
    if (np.abs(values - values[0]) > 0).any():
        raise InputError(
            f"{name} of a bearing that depends on the speed",
            "constants",
            "write a rotor file, whose supports may hold Omega",
        )
    return float(values[0])
