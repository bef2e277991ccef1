"""Rival hypotheses on the model: terms that it may lack.

The terms that any model may lack are thought of at each named place, and at both ends of the shaft;
and the stiffness of every section, of every joint between two, and of the whole
shaft may be otherwise than drawn, the damping that goes with it in proportion.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import combinations, combinations_with_replacement

import numpy as np

from rotorid.core.linalg import coupled
from rotorid.core.values import Floats
from rotorid.likelihood.case import Case, Rival, freed, rivals
from rotorid.likelihood.effects import Drives, Entry, RowLoad
from rotorid.likelihood.unknowns import Scalar, Unknown
from rotorid.models.expressions import Expression, product, symbol
from rotorid.models.rotor import RotorModel
from rotorid.models.rotor.drawing import PLANES
from rotorid.models.rotor.fem import Piece, elastic_pieces, spans
from rotorid.models.structure import Structure

BENDS = "bending of the shaft"
INTO_THE_FILE = "add it to the rotor file, as a disc, a support, an unbalance or a damping there"
"""What to do about a term that a drawing lacks."""
STIFFEN = (
    "the shaft bends: take a rotor file of its drawing, or a model with a bending mode (docs/"
    "write-a-model.md), or only lines far below its first bending frequency"
)
"""What to do about a rotor that is not rigid."""
BENDING = 4
"""Order of the derivative by which a shaft that bends differs from a rigid one: the inertial force,
of the second, bends it, and what it bends by is accelerated in turn."""


UNITS_AT = ("N/m", "kg", "N s/m", "kg m"), ("N m/rad", "kg m^2", "N m s/rad", "kg m^2")
"""Of a stiffness, a mass, a damping and a load at a displacement, and at a tilt."""
K, K_SPEED, D, D_SPEED, M = (0, 0), (0, 1), (1, 0), (1, 1), (2, 0)
"""Matrices by the derivative that they multiply, and by the power of the speed."""


def find_candidates(
    structure: Structure, units: Sequence[str], *, still: bool = False
) -> list[Unknown]:
    """Return the terms that may be missing; `units`: of the coordinates.

    Damping of each spring and each mass, of all springs together, the same in the rotating frame,
    x/y asymmetry of each; and for each pair of coordinates stiffness and cross-coupling to ground,
    mass, gyroscopic moment, and a load that turns with the rotor. `still`: no rotor turns.
    """
    bending = [_bending(structure, units)] if structure.pairs and not structure.springs else []
    return [
        *(_term(structure, *each) for each in _of_parts(structure, still)),
        *bending,
        *_to_ground(structure, units, still),
        *parts_between(structure, units),
    ]


Matrices = Mapping[tuple[int, int], Floats]


def _of_parts(structure: Structure, still: bool) -> Iterator[tuple[str, str, Matrices]]:
    """Yield name, unit and matrices of damping and asymmetry of springs and masses."""
    springs, masses = structure.springs, structure.masses
    several = [(", ".join(n for n, _ in springs), _sum(springs))] if len(springs) > 1 else []
    for name, matrix in (*springs, *several):
        yield f"damping {name}", "s", {D: matrix}
        if not still:  # in the rotating frame: C (q' - Omega J q)
            turning = -matrix @ structure.turn()
            yield f"rotating damping {name}", "s", {K_SPEED: turning, D: matrix}
    for name, matrix in masses:
        yield f"damping {name}", "1/s", {D: matrix}
    for kind, energies in ((K, springs), (M, masses)):
        for name, matrix in energies:
            parts = coupled(matrix)
            for part in parts[1:]:
                block = np.zeros_like(matrix)
                block[np.ix_(part, part)] = matrix[np.ix_(part, part)]
                where = f" at {structure.coordinates[part[0]]}" if len(parts) > 2 else ""
                yield f"asymmetry {name}{where}", "1", {kind: block}


def _bending(structure: Structure, units: Sequence[str]) -> Unknown:
    """Return what a shaft that bends adds to a rigid rotor, far below its first bending mode.

    With a compliance C between forces and readings, y = S q + C F, and F = B^-1 M q" of the rigid
    rotor, its equations become M q" + M A M q"" = B F with A = S^-1 C B^-1: symmetric where
    sensors stand beside their magnets, and the same in both planes.
    """
    n = len(structure.coordinates)
    heavy = _sum(structure.masses)
    entries: list[Entry] = []
    couples = list(combinations_with_replacement(structure.pairs, 2))
    for unknown, (one, other) in enumerate(couples):
        alike = (units[one[0]] == "m") == (units[other[0]] == "m")
        matrix = np.zeros((n, n))
        for a in (0, 1):  # lengths go with tilts of their plane: x with theta_y, y with -theta_x
            b, sign = (a, 1.0) if alike else (1 - a, 1.0 - 2.0 * a)
            matrix[one[a], other[b]] = matrix[other[b], one[a]] = sign
        matrix = structure.in_rows(heavy @ matrix @ heavy)
        entries += [
            Entry(int(r), int(c), BENDING, float(matrix[r, c]), unknown=unknown)
            for r, c in np.argwhere(matrix)
        ]
    unit = "m/N" if units[structure.pairs[0][0]] == "m" else "rad/(N m)"
    # Its unknowns have units of their own.
    return replace(_missing(BENDS, unit, entries), cure=STIFFEN, size=lambda v: float(v[0]))


def _sum(parts: Sequence[tuple[str, Floats]]) -> Floats:
    return np.asarray(np.sum([matrix for _, matrix in parts], axis=0))


def _to_ground(structure: Structure, units: Sequence[str], still: bool) -> Iterator[Unknown]:
    """Yield what may act at one place: each pair of coordinates, or each that has no partner."""
    n = len(structure.coordinates)
    for group in (*structure.pairs, *((k,) for k in structure.lone)):
        if structure.balance.faults.keys() & {*group}:  # no equation tells the forces there
            continue
        names = ", ".join(structure.coordinates[k] for k in sorted(group))
        stiff, mass, rate, load = UNITS_AT[units[group[0]] == "rad"]
        one = np.zeros((n, n))
        one[list(group), list(group)] = 1.0
        yield _term(structure, f"stiffness to ground {names}", stiff, {K: one})
        yield _term(structure, f"mass at {names}", mass, {M: one})
        if not still:
            yield _load(structure, f"load at {names}", load, group)
        if len(group) == 2:
            cross = np.zeros((n, n))
            cross[group[0], group[1]], cross[group[1], group[0]] = 1.0, -1.0
            yield _term(structure, f"cross-coupling to ground {names}", stiff, {K: cross})
            if not still:
                yield _term(structure, f"gyroscopic {names}", mass, {D_SPEED: cross})
            yield _term(structure, f"damping to ground {names}", rate, {D: one})


def parts_between(structure: Structure, units: Sequence[str]) -> list[Unknown]:
    """Return a mass halfway between two places of the shaft, each pair of displacements.

    None of a drawing, in which the shaft between two places bends.
    """
    found, unknown = list[Unknown](), structure.balance.faults.keys()
    places = [p for p in structure.pairs if units[p[0]] == "m" and not unknown & {*p}]
    for one, other in combinations(places, 2) if not structure.slopes else ():
        half = np.zeros((2, len(structure.coordinates)))  # the mean of both, in x and in y
        half[[0, 1], one] = half[[0, 1], other] = 0.5
        names = (structure.coordinates[min(one)], structure.coordinates[min(other)])
        text = f"mass between {names[0]} and {names[1]}"
        found.append(_term(structure, text, "kg", {M: half.T @ half}))
    return found


def _load(structure: Structure, name: str, unit: str, group: Sequence[int]) -> Unknown:
    """Return a free load of the rotor's speed, two amplitudes on each coordinate."""
    squared = (symbol("Omega"), Fraction(2))
    turning = [(Expression(name, (symbol("phi"),)), Fraction(1)) for name in ("cos", "sin")]
    signals = [product([squared, factor]) for factor in turning]
    rows, scales = structure.balance.rows, structure.balance.scales
    loads = [
        RowLoad(int(rows[c]), signal, 2 * k + part, float(scales[c]))
        for k, c in enumerate(group)
        for part, signal in enumerate(signals)
    ]
    return _missing(name, unit, loads)


def _term(structure: Structure, name: str, unit: str, matrices: Matrices) -> Unknown:
    entries = [
        Entry(int(r), int(c), order, float(rows[r, c]), power)
        for (order, power), matrix in sorted(matrices.items())
        for rows in [structure.in_rows(matrix)]
        for r, c in np.argwhere(rows)
    ]
    return _missing(name, unit, entries)


def _missing(name: str, unit: str, effects: Sequence[Entry | RowLoad]) -> Unknown:
    count = 1 + max((effect.unknown for effect in effects), default=0)
    names = [name] if count == 1 else [f"{name} ({i})" for i in range(count)]
    scalars = tuple(Scalar(each, unit, 0.0, additive=True) for each in names)
    return Unknown(scalars, frozenset(), tuple(effects), name)


def drawn_candidates(structure: Structure, model: RotorModel, values: Floats) -> Iterator[Unknown]:
    """Yield what may be otherwise than drawn of the shaft, as a share of what is drawn."""
    known = dict(zip(model.parameter_names, values.tolist(), strict=True)) | dict(model.held)
    rotor = model.rotor
    sections = [section for _, section, _ in spans(rotor)]
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
        matrices = _elastic(elastic_pieces(rotor, elements), known, len(structure.coordinates))
        yield replace(_term(structure, name, "1", matrices), cure=cure)


def _elastic(pieces: tuple[Piece, ...], known: Mapping[str, float], size: int) -> Matrices:
    """Return the stiffness of some elements, and their damping."""
    matrices = {at: np.zeros((size, size)) for at in (K, K_SPEED, D)}
    for piece in pieces:
        if not piece.structural:
            at = D if piece.order else K_SPEED if piece.power else K
            matrices[at] += piece.value(known) * piece.matrix.toarray()
    return matrices


def levers(structure: Structure, model: RotorModel) -> Iterator[Unknown]:
    """Yield each actuator beside the place where it is drawn."""
    rows = structure.balance.rows
    for number, (name, actuator) in enumerate(model.rotor.actuators.items()):
        first = PLANES * model.rotor.node(actuator.at)
        arms = {  # theta_y is the slope of x, theta_x that of -y
            int(rows[row]): (int(rows[structure.slopes[row]]), share)
            for row, share in ((first, 1.0), (first + 1, -1.0))
        }
        inputs = model.inputs[2 * number : 2 * number + 2]
        scalar = Scalar(f"plane[{', '.join(inputs)}]", "m", 0.0, additive=True)
        cure = f"give {name} in the rotor file the place (at) where it acts"
        on = frozenset(inputs)
        yield Unknown((scalar,), on, (Drives(on, "lever", arms),), cure=cure)


@rivals("term")
def _terms(case: Case) -> Iterator[Rival]:
    model, structure = case.model, case.structure
    if structure is None:
        return
    still = not any(record.lines.speed.any() for record in case.records)
    units = [model.units[name] for name in model.coordinates]
    drawn = isinstance(model, RotorModel)
    for term in find_candidates(structure, units, still=still):
        yield freed(replace(term, cure=INTO_THE_FILE) if drawn else term)


@rivals("drawn")
def _drawn(case: Case) -> Iterator[Rival]:
    model, structure = case.model, case.structure
    if structure is None or not isinstance(model, RotorModel) or case.values is None:
        return
    for term in drawn_candidates(structure, model, case.values):
        yield freed(term)
    for lever in levers(structure, model):
        yield freed(lever, on=tuple(sorted(lever.on)))


@rivals("drawn far")
def _drawn_far(case: Case) -> Iterator[Rival]:
    """Yield the same, to be looked for from afar."""
    return (replace(rival, way="both") for rival in _drawn(case))
