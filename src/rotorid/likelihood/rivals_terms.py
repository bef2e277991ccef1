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
    found: list[Unknown] = []
    springs, masses = structure.springs, structure.masses
    several = [(", ".join(n for n, _ in springs), _sum(springs))] if len(springs) > 1 else []
    for name, matrix in (*springs, *several):
        found.append(_term(structure, f"damping {name}", "s", {D: matrix}))
        if not still:  # in the rotating frame: C (q' - Omega J q)
            turning = {K_SPEED: -matrix @ structure.turn(), D: matrix}
            found.append(_term(structure, f"rotating damping {name}", "s", turning))
    for name, matrix in masses:
        found.append(_term(structure, f"damping {name}", "1/s", {D: matrix}))
    for kind, energies in ((K, springs), (M, masses)):
        for name, matrix in energies:
            parts = coupled(matrix)
            for part in parts[1:]:
                block = np.zeros_like(matrix)
                block[np.ix_(part, part)] = matrix[np.ix_(part, part)]
                where = structure.coordinates[part[0]]
                text = f"asymmetry {name}" + (f" at {where}" if len(parts) > 2 else "")
                found.append(_term(structure, text, "1", {kind: block}))
    bending = [_bending(structure, units)] if structure.pairs and not springs else []
    ground = _to_ground(structure, units, still)
    return [*found, *bending, *ground, *parts_between(structure, units)]


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
    return replace(_missing(BENDS, unit, entries), cure=STIFFEN)


def _sum(parts: Sequence[tuple[str, Floats]]) -> Floats:
    return np.asarray(np.sum([matrix for _, matrix in parts], axis=0))


def _to_ground(structure: Structure, units: Sequence[str], still: bool) -> list[Unknown]:
    """Return what may act at one place: each pair of coordinates, or each that has no partner."""
    n = len(structure.coordinates)
    found = []
    for group in (*structure.pairs, *((k,) for k in structure.lone)):
        if structure.balance.faults.keys() & {*group}:  # no equation tells the forces there
            continue
        names = ", ".join(structure.coordinates[k] for k in sorted(group))
        stiff, mass, rate, load = _units_at(units[group[0]])
        one = np.zeros((n, n))
        one[list(group), list(group)] = 1.0
        found.append(_term(structure, f"stiffness to ground {names}", stiff, {K: one}))
        found.append(_term(structure, f"mass at {names}", mass, {M: one}))
        if not still:
            found.append(_load(structure, f"load at {names}", load, group))
        if len(group) == 2:
            cross = np.zeros((n, n))
            cross[group[0], group[1]], cross[group[1], group[0]] = 1.0, -1.0
            name = f"cross-coupling to ground {names}"
            found.append(_term(structure, name, stiff, {K: cross}))
            if not still:
                found.append(_term(structure, f"gyroscopic {names}", mass, {D_SPEED: cross}))
            found.append(_term(structure, f"damping to ground {names}", rate, {D: one}))
    return found


def _units_at(unit: str) -> tuple[str, str, str, str]:
    if unit == "rad":
        return "N m/rad", "kg m^2", "N m s/rad", "kg m^2"
    return "N/m", "kg", "N s/m", "kg m"


def parts_between(structure: Structure, units: Sequence[str]) -> list[Unknown]:
    """Return a mass halfway between two places of the shaft, each pair of displacements.

    None of a drawing, in which the shaft between two places bends.
    """
    n, found = len(structure.coordinates), list[Unknown]()
    if structure.slopes:
        return found
    unknown = structure.balance.faults.keys()
    places = [p for p in structure.pairs if units[p[0]] == "m" and not unknown & {*p}]
    for one, other in combinations(places, 2):
        heavy = np.zeros((n, n))
        for a, b in zip(one, other, strict=True):
            half = np.zeros(n)
            half[[a, b]] = 0.5
            heavy += np.outer(half, half)
        names = (structure.coordinates[min(one)], structure.coordinates[min(other)])
        text = f"mass between {names[0]} and {names[1]}"
        found.append(_term(structure, text, "kg", {M: heavy}))
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
    return _missing(name, unit, loads=loads)


def _term(
    structure: Structure, name: str, unit: str, matrices: Mapping[tuple[int, int], Floats]
) -> Unknown:
    entries = []
    for (order, power), matrix in sorted(matrices.items()):
        rows = structure.in_rows(matrix)
        found = ((int(r), int(c), float(rows[r, c])) for r, c in np.argwhere(rows))
        entries += [Entry(r, c, order, size, power) for r, c, size in found]
    return _missing(name, unit, entries)


def _missing(
    name: str, unit: str, entries: Sequence[Entry] = (), loads: Sequence[RowLoad] = ()
) -> Unknown:
    numbers = [entry.unknown for entry in entries] + [load.unknown for load in loads]
    count = 1 + max(numbers, default=0)
    names = [name] if count == 1 else [f"{name} ({i})" for i in range(count)]
    scalars = tuple(Scalar(each, unit, 0.0, additive=True) for each in names)
    missing = Unknown(scalars, frozenset(), (*entries, *loads), name)
    # Unknowns of entries have units of their own.
    return replace(missing, size=lambda values: float(values[0])) if entries else missing


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
        yield replace(_elastic(structure, name, elastic_pieces(rotor, elements), known), cure=cure)


def _elastic(
    structure: Structure, name: str, pieces: tuple[Piece, ...], known: dict[str, float]
) -> Unknown:
    """Return the stiffness of some elements, and their damping, as a term."""
    n = len(structure.coordinates)
    matrices = {at: np.zeros((n, n)) for at in (K, K_SPEED, D)}
    for piece in pieces:
        if piece.structural:
            continue
        size = piece.value(known)
        at = D if piece.order else K_SPEED if piece.power else K
        matrices[at] += size * piece.matrix.toarray()
    return _term(structure, name, "1", matrices)


def levers(structure: Structure, model: RotorModel) -> Iterator[Unknown]:
    """Yield each actuator beside the place where it is drawn."""
    for number, (name, actuator) in enumerate(model.rotor.actuators.items()):
        first = PLANES * model.rotor.node(actuator.at)
        pushed = {first: 1.0, first + 1: -1.0}  # theta_y is the slope of x, theta_x that of -y
        arms = {
            int(structure.balance.rows[row]): (
                int(structure.balance.rows[structure.slopes[row]]),
                share,
            )
            for row, share in pushed.items()
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
