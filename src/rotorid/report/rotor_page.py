"""What the program makes of a drawing: the rotor in characters, its inertia, nodes, parameters."""

from __future__ import annotations

import numpy as np

from rotorid.models.base import monomial_name
from rotorid.models.rotor.drawing import Rotor
from rotorid.models.rotor.inertia import inertia
from rotorid.models.rotor.mesh import bending
from rotorid.models.rotor.model import RotorModel
from rotorid.tables import Page, table

WIDTH = 76
"""Characters of the drawing: a terminal of 80 holds it."""
HALF = 5
"""Lines of the drawing above its axis."""
KINDS = (
    ("discs", "disc", "D"),
    ("actuators", "actuator", "A"),
    ("sensors", "sensor", "s"),
    ("supports", "support", "^"),
    ("unbalance", "unbalance", "u"),
)
"""What stands on a rotor, in words, and its mark in the drawing."""


def rotor_page(model: RotorModel) -> Page:
    """Return a rotor in words and tables."""
    rotor = model.rotor
    nominal = [
        (p.name, p.unit, "" if p.nominal is None else f"{p.nominal:.6g}") for p in model.parameters
    ]
    nodes = [
        (str(k), f"{1e3 * node.position:.6g}", ", ".join(node.names if node.named else ()), what)
        for k, node in enumerate(rotor.nodes)
        for what in [_standing(rotor, node.names)]
    ]
    return [
        f"{model.name}: {model.title}",
        *([f"source: {model.source}"] if model.source else []),
        "",
        *drawing(rotor),
        "",
        *_weights(model),
        table(("node", "mm", "place", "what stands there"), nodes),
        table(("parameter", "unit", "nominal"), nominal),
        table(("base parameter", "unit"), zip(model.base.names, model.base.units, strict=True)),
        *_channels(model),
    ]


def _standing(rotor: Rotor, names: tuple[str, ...]) -> str:
    held = [word for key, word, _ in KINDS if set(names) & set(getattr(rotor, key))]
    return ", ".join(held)


def _weights(model: RotorModel) -> list[str]:
    """Return mass and inertia at the nominal values, and bending frequencies of the shaft."""
    hertz = ", ".join(f"{w / (2 * np.pi):.4g}" for w in bending(model.rotor))
    told = [f"shaft alone, free, at rest: bending at {hertz} Hz"]
    missing = [name for name in model.parameter_names if name not in model.nominal]
    if missing:
        return [*told, f"no mass as a whole: {', '.join(missing)} without nominal"]
    whole = inertia(model, model.nominal)
    return [
        f"{whole.mass:.5g} kg, centre at {1e3 * whole.centre:.5g} mm; I_t {whole.transverse:.4g}, "
        f"I_p {whole.polar:.4g} kg m^2 about it (nominal values)",
        *told,
    ]


def _channels(model: RotorModel) -> list[str]:
    coordinates = [f"x_{name}, y_{name}" for name in model.rotor.sensors]
    read = f"; sensors at {'; '.join(coordinates)}" if coordinates else ""
    return [
        f"inputs: {', '.join(model.inputs) or 'none'}{read}",
        f"{len(model.coordinates)} coordinates: x, y, theta_x, theta_y of each node, such as "
        f"{model.coordinates[0]}; monomials of the matrices: "
        + ", ".join(monomial_name(m, model.parameter_names) for m in model.monomials if m.any()),
    ]


def drawing(rotor: Rotor) -> list[str]:
    """Return the rotor seen from the side, in characters; its marks stand below."""
    widest = max(section.outer for section in rotor.sections)
    borders = np.cumsum([0.0, *(section.length for section in rotor.sections)])
    middle = (np.arange(WIDTH) + 0.5) / WIDTH * rotor.length
    number = np.searchsorted(borders, middle).clip(1, len(rotor.sections)) - 1
    outer = np.array([s.outer for s in rotor.sections])[number] / widest
    inner = np.array([s.inner for s in rotor.sections])[number] / widest
    height = (np.arange(HALF, -HALF - 1, -1) / (HALF + 0.5))[:, None]
    inside = np.abs(height) <= outer
    bore = np.abs(height) < inner
    canvas = np.where(bore & inside, ".", np.where(inside, "#", " "))
    for disc in rotor.discs.values():
        canvas[:, _column(rotor, disc.at)] = "|"
    lines = ["".join(row).rstrip() for row in canvas]
    marks = np.full((2, WIDTH), " ")
    for key, _, mark in KINDS:
        for member in getattr(rotor, key).values():
            column = _column(rotor, getattr(member, "at", member))
            marks[0 if marks[0, column] == " " else 1, column] = mark
    legend = ", ".join(f"{mark} {word}" for key, word, mark in KINDS if getattr(rotor, key))
    below = ["".join(row).rstrip() for row in marks if (row != " ").any()]
    return [*lines, *below, f"0 to {rotor.length:g} m" + (f"; {legend}" if legend else "")]


def _column(rotor: Rotor, at: float) -> int:
    return int(np.clip(at / rotor.length * WIDTH, 0, WIDTH - 1))
