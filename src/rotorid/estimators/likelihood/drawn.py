"""What the drawing of a rotor lacks: the stiffness of fits and joints, and where things stand.

The terms that any model may lack (`candidates`) are thought of at each named place, and at both
ends of the shaft; and the stiffness of every section, of every joint between two, and of the whole
shaft may be otherwise than drawn, the damping that goes with it in proportion.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.candidates import Candidate, Structure
from rotorid.estimators.likelihood.nuisances import Lever, Unknown
from rotorid.models.rotor import RotorModel
from rotorid.models.rotor.assembly import Piece, elastic_pieces
from rotorid.models.rotor.elements import PLANES
from rotorid.record import Floats


def drawn_structure(structure: Structure, model: RotorModel) -> Structure:
    """Return the structure of a drawing's model: pairs are those of its places and ends."""
    pairs: list[tuple[int, int]] = []
    slopes: dict[int, int] = {}
    for number, node in enumerate(model.rotor.nodes):
        x, y, around_x, around_y = range(PLANES * number, PLANES * (number + 1))
        slopes |= {x: around_y, y: around_x}
        pairs += [(x, y), (around_x, around_y)] if node.named else []
    return replace(structure, pairs=tuple(pairs), lone=(), slopes=slopes)


def drawn_candidates(
    structure: Structure, model: RotorModel, values: Floats
) -> Iterator[Candidate]:
    """Yield what may be otherwise than drawn of the shaft, as a share of what is drawn."""
    known = dict(zip(model.parameter_names, values.tolist(), strict=True)) | dict(model.fixed)
    rotor = model.rotor
    sections = [section for _, section, _ in rotor.spans()]
    every = range(len(sections))
    groups: list[tuple[str, str, Collection[int]]] = [
        ("stiffness shaft", "correct E of the material, or give it a parameter", every)
    ]
    borders = np.cumsum([section.length for section in rotor.sections])
    for number, section in enumerate(rotor.sections):
        inside = [k for k in every if sections[k] is section]
        left, right = 1e3 * (borders[number] - section.length), 1e3 * borders[number]
        cure = f"give the section from {left:g} to {right:g} mm a parameter: stiffness"
        groups.append((f"stiffness section {number + 1}", cure, inside))
    for number, border in enumerate(borders[:-1], start=1):
        node = rotor.node(border)
        cure = "divide the sections there, and give the short ones a parameter: stiffness"
        groups.append((f"stiffness joint {number}, {number + 1}", cure, (node - 1, node)))
    for name, cure, elements in groups:
        yield replace(_elastic(structure, name, elastic_pieces(rotor, elements), known), cure=cure)


def _elastic(
    structure: Structure, name: str, pieces: tuple[Piece, ...], known: dict[str, float]
) -> Candidate:
    """Return the stiffness of some elements, and their damping, as a term."""
    n = len(structure.coordinates)
    k, k_speed, d = (np.zeros((n, n)) for _ in range(3))
    for piece in pieces:
        if piece.structural:
            continue
        size = np.prod([known[factor] ** power for factor, power in piece.factors])
        into = d if piece.order else k_speed if piece.power else k
        into += size * piece.matrix.toarray()
    zero = np.broadcast_to(0.0, (n, n))
    stiff, turning, damped = (structure.in_rows(each) for each in (k, k_speed, d))
    return Candidate(name, stiff, turning, damped, zero, zero, "1")


def levers(structure: Structure, model: RotorModel) -> Iterator[tuple[str, str, Lever]]:
    """Yield each actuator beside the place where it is drawn: its term, its name, and its lever."""
    for number, (name, at) in enumerate(model.rotor.actuators.items()):
        first = PLANES * model.rotor.node(at)
        pushed = {first: 1.0, first + 1: -1.0}  # theta_y is the slope of x, theta_x that of -y
        arms = {
            int(structure.balance.rows[row]): (
                int(structure.balance.rows[structure.slopes[row]]),
                share,
            )
            for row, share in pushed.items()
        }
        inputs = frozenset((2 * number, 2 * number + 1))
        term = f"plane[{', '.join(model.inputs[k] for k in sorted(inputs))}]"
        unknown = Unknown(term, "m", 0.0, nuisance=True, additive=True)
        yield term, name, Lever((unknown,), arms, inputs)
