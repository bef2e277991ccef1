"""Terms that a model of a rotor may lack, found from the structure of its own matrices.

A parameter p is a spring where p dK/dp is symmetric and positive semidefinite, a mass where
p dM/dp is. Masses that stand in two places, on coordinates that nothing but rotation couples, tell
which coordinates are a pair: the same displacement in x and in y.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from itertools import combinations, combinations_with_replacement

import numpy as np

from rotorid.estimators.likelihood.nuisances import Missing, MissingEntry, MissingLoad, Unknown
from rotorid.estimators.likelihood.unknowns import linear_form
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.expression import Expression, product, symbol
from rotorid.models.force_balance import ForceBalance, force_balance
from rotorid.models.linear import speed_factor
from rotorid.record import Floats, Integers

BENDS = "bending of the shaft"
STIFFEN = (
    "the shaft bends: take a rotor file of its drawing, or a model with a bending mode (docs/"
    "write-a-model.md), or only lines far below its first bending frequency"
)
"""What to do about a rotor that is not rigid."""
BENDING = 4
"""Order of the derivative by which a shaft that bends differs from a rigid one: the inertial force,
of the second, bends it, and what it bends by is accelerated in turn."""


@frozen
class Candidate:
    """A term that may be missing: its name, and what it adds, matrices (row, coordinate).

    Parameters
    ----------
    name : str
    k, k_speed, d, d_speed, m : array
        Additions to K, to K per rad/s of speed, to D, to D per rad/s, and to M.
    unit : str
        Of its size.
    rotating : bool
        It needs a rotor that turns.
    loads : sequence of MissingLoad
    cure : str
        What to do about it, where that is not to add the term to the model.
    bends : sequence of MissingEntry
        Entries of derivatives that the matrices do not have, with unknowns of their own.
    """

    name: str
    k: Floats
    k_speed: Floats
    d: Floats
    d_speed: Floats
    m: Floats
    unit: str = "1"
    rotating: bool = False
    loads: tuple[MissingLoad, ...] = ()
    cure: str = ""
    bends: tuple[MissingEntry, ...] = ()

    @property
    def nuisance(self) -> Missing:
        """The term as something to be freed."""
        parts = (
            (self.k, 0, 0),
            (self.k_speed, 0, 1),
            (self.d, 1, 0),
            (self.d_speed, 1, 1),
            (self.m, 2, 0),
        )
        entries = tuple(
            MissingEntry(int(r), int(c), order, float(matrix[r, c]), power)
            for matrix, order, power in parts
            for r, c in np.argwhere(matrix)
        )
        entries = (*entries, *self.bends)
        numbers = [load.unknown for load in self.loads] + [entry.unknown for entry in self.bends]
        count = 1 + max(numbers, default=0)
        names = [self.name] if count == 1 else [f"{self.name} ({i})" for i in range(count)]
        unknowns = tuple(
            Unknown(name, self.unit, 0.0, nuisance=True, additive=True) for name in names
        )
        return Missing(unknowns, entries, self.loads)


@frozen
class Structure:
    """Matrices of a model by parameter, rows brought to the order and sign of the coordinates.

    Parameters
    ----------
    springs, masses : sequence of (name, array)
        p dK/dp and p dM/dp, shape (coordinate, coordinate).
    pairs : sequence of (int, int)
        Coordinates of the same displacement in x and in y; forward rotation leads the first to
        the second.
    coordinates : sequence of str
    balance : ForceBalance
        The equation of each coordinate, and how many times the forces on it that is.
    lone : sequence of int
        Coordinates without a partner, on which something may act too.
    slopes : mapping of int to int
        The slope of the shaft at a displacement, where a drawing gives it.
    """

    springs: tuple[tuple[str, Floats], ...]
    masses: tuple[tuple[str, Floats], ...]
    pairs: tuple[tuple[int, int], ...]
    coordinates: tuple[str, ...]
    balance: ForceBalance
    lone: tuple[int, ...] = ()
    slopes: Mapping[int, int] = field(default_factory=dict)

    def in_rows(self, matrix: Floats) -> Floats:
        """Write a matrix of coordinates in the equations as they stand."""
        written = np.zeros_like(matrix)
        written[self.balance.rows] = self.balance.scales[:, None] * matrix
        return written

    def mass(self, units: Sequence[str]) -> float:
        """Return the mass that moves in x; `units`: of the coordinates."""
        moved = [pair[0] for pair in self.pairs if units[pair[0]] == "m"]
        return float(sum(matrix[moved, moved].sum() for _, matrix in self.masses))

    def turn(self) -> Floats:
        """Return J, the turn by a right angle in the sense of the rotation."""
        turn = np.zeros((len(self.coordinates), len(self.coordinates)))
        for a, b in self.pairs:
            turn[a, b], turn[b, a] = -1.0, 1.0
        return turn


def find_structure(model: Model, values: Floats, speed: float) -> Structure | None:
    """Return the structure of a model, or None where its equations do not match its coordinates."""
    linear = linear_form(model)
    n = linear.coordinates
    if linear.rows != n:
        return None
    distinct = dict.fromkeys(term.factor for term in linear.stiffness)
    factor = {f: speed_factor(f, speed) for f in distinct}
    slopes = model.monomial_jacobian(values)
    mu = model.monomial_values(values)
    inertia, parts = np.zeros((n, n)), np.zeros((len(values), 3, n, n))
    for t in linear.stiffness:
        size = t.coefficient * factor[t.factor]
        parts[:, t.order, t.row, t.column] += size * slopes[t.monomial] * values
        if t.order == 2:
            inertia[t.row, t.column] += size * mu[t.monomial]
    balance = force_balance(model, inertia)
    ordered = parts[:, :, balance.rows] / balance.scales[:, None]
    names = model.parameter_names
    springs = [(name, p[0]) for name, p in zip(names, ordered, strict=True) if _is_energy(p[0])]
    masses = [(name, p[2]) for name, p in zip(names, ordered, strict=True) if _is_energy(p[2])]
    pairs = _oriented(model, values, _pairs(masses), balance, speed)
    paired = {k for pair in pairs for k in pair}
    return Structure(
        tuple(springs),
        tuple(masses),
        tuple(pairs),
        model.coordinates,
        balance,
        tuple(k for k in range(n) if k not in paired),
    )


def _is_energy(matrix: Floats) -> bool:
    """Tell whether a matrix is symmetric, positive semidefinite, and not zero."""
    size = np.abs(matrix).max(initial=0.0)
    if size == 0 or np.abs(matrix - matrix.T).max() > 1e-9 * size:
        return False
    scale = np.sqrt(np.diag(matrix).clip(0))
    scale[scale == 0] = 1.0
    return bool(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > -1e-9)


def _parts(matrix: Floats) -> list[Integers]:
    """Return the groups of coordinates that a matrix couples."""
    coupled = (matrix != 0) | (matrix != 0).T
    left = set(np.flatnonzero(coupled.any(axis=0)).tolist())
    groups = []
    while left:
        group = {min(left)}
        while True:
            wider = set(np.flatnonzero(coupled[list(group)].any(axis=0)).tolist()) | group
            if wider == group:
                break
            group = wider
        left -= group
        groups.append(np.array(sorted(group), dtype=np.int64))
    return groups


def _pairs(masses: Sequence[tuple[str, Floats]]) -> list[tuple[int, int]]:
    pairs: list[tuple[int, int]] = []
    for _, matrix in masses:
        parts = _parts(matrix)
        if len(parts) == 2 and all(len(part) == 1 for part in parts):
            a, b = int(parts[0][0]), int(parts[1][0])
            taken = {k for pair in pairs for k in pair}
            if not {a, b} & taken:
                pairs.append((min(a, b), max(a, b)))
    return pairs


def _oriented(
    model: Model,
    values: Floats,
    pairs: Sequence[tuple[int, int]],
    balance: ForceBalance,
    speed: float,
) -> list[tuple[int, int]]:
    """Order each pair by the sense in which its unbalance turns; else as declared."""
    columns = linear_form(model).rotation_columns(speed or 1.0)
    once = balance.forces(columns @ model.monomial_values(values))
    found = []
    for a, b in pairs:
        backward = (once[b] * np.conj(once[a])).imag > 1e-6 * abs(once[a]) * abs(once[b])
        found.append((b, a) if backward else (a, b))
    return found


def find_candidates(structure: Structure, units: Sequence[str]) -> list[Candidate]:
    """Return the terms that may be missing; `units`: of the coordinates.

    Damping of each spring and each mass, of all springs together, the same in the rotating frame,
    x/y asymmetry of each; and for each pair of coordinates stiffness and cross-coupling to ground,
    mass, gyroscopic moment, and a load that turns with the rotor.
    """
    found: list[Candidate] = []
    springs, masses = structure.springs, structure.masses
    several = [(", ".join(n for n, _ in springs), _sum(springs))] if len(springs) > 1 else []
    for name, matrix in (*springs, *several):
        found.append(_constant(structure, f"damping {name}", "s", d=matrix))
        found.append(_rotating(structure, name, matrix))
    for name, matrix in masses:
        found.append(_constant(structure, f"damping {name}", "1/s", d=matrix))
    for kind, energies in (("k", springs), ("m", masses)):
        for name, matrix in energies:
            parts = _parts(matrix)
            for part in parts[1:]:
                block = np.zeros_like(matrix)
                block[np.ix_(part, part)] = matrix[np.ix_(part, part)]
                where = structure.coordinates[part[0]]
                text = f"asymmetry {name}" + (f" at {where}" if len(parts) > 2 else "")
                found.append(
                    _constant(structure, text, "1", k=block)
                    if kind == "k"
                    else _constant(structure, text, "1", m=block)
                )
    bending = [_bending(structure, units)] if structure.pairs and not springs else []
    return [*found, *bending, *_to_ground(structure, units), *parts_between(structure, units)]


def _bending(structure: Structure, units: Sequence[str]) -> Candidate:
    """Return what a shaft that bends adds to a rigid rotor, far below its first bending mode.

    With a compliance C between forces and readings, y = S q + C F, and F = B^-1 M q" of the rigid
    rotor, its equations become M q" + M A M q"" = B F with A = S^-1 C B^-1: symmetric where
    sensors stand beside their magnets, and the same in both planes.
    """
    n = len(structure.coordinates)
    heavy = _sum(structure.masses)
    entries: list[MissingEntry] = []
    couples = list(combinations_with_replacement(structure.pairs, 2))
    for unknown, (one, other) in enumerate(couples):
        alike = (units[one[0]] == "m") == (units[other[0]] == "m")
        matrix = np.zeros((n, n))
        for a in (0, 1):  # lengths go with tilts of their plane: x with theta_y, y with -theta_x
            b, sign = (a, 1.0) if alike else (1 - a, 1.0 - 2.0 * a)
            matrix[one[a], other[b]] = matrix[other[b], one[a]] = sign
        matrix = structure.in_rows(heavy @ matrix @ heavy)
        entries += [
            MissingEntry(int(r), int(c), BENDING, float(matrix[r, c]), unknown=unknown)
            for r, c in np.argwhere(matrix)
        ]
    unit = "m/N" if units[structure.pairs[0][0]] == "m" else "rad/(N m)"
    return replace(_constant(structure, BENDS, unit), bends=tuple(entries), cure=STIFFEN)


def _sum(parts: Sequence[tuple[str, Floats]]) -> Floats:
    return np.asarray(np.sum([matrix for _, matrix in parts], axis=0))


def _to_ground(structure: Structure, units: Sequence[str]) -> list[Candidate]:
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
        found.append(_constant(structure, f"stiffness to ground {names}", stiff, k=one))
        found.append(_constant(structure, f"mass at {names}", mass, m=one))
        found.append(_load(structure, f"load at {names}", load, group))
        if len(group) == 2:
            cross = np.zeros((n, n))
            cross[group[0], group[1]], cross[group[1], group[0]] = 1.0, -1.0
            name = f"cross-coupling to ground {names}"
            found.append(_constant(structure, name, stiff, k=cross))
            found.append(_constant(structure, f"gyroscopic {names}", mass, d_speed=cross))
            found.append(_constant(structure, f"damping to ground {names}", rate, d=one))
    return found


def _units_at(unit: str) -> tuple[str, str, str, str]:
    """Return the units of stiffness, mass, damping and unbalance at a coordinate."""
    if unit == "rad":
        return "N m/rad", "kg m^2", "N m s/rad", "kg m^2"
    return "N/m", "kg", "N s/m", "kg m"


def parts_between(structure: Structure, units: Sequence[str]) -> list[Candidate]:
    """Return a mass halfway between two places of the shaft, each pair of displacements.

    None of a drawing, in which the shaft between two places bends.
    """
    n, found = len(structure.coordinates), list[Candidate]()
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
        found.append(_constant(structure, text, "kg", m=heavy))
    return found


def _load(structure: Structure, name: str, unit: str, group: Sequence[int]) -> Candidate:
    """Return a free load of the rotor's speed, two amplitudes on each coordinate."""
    squared = (symbol("Omega"), Fraction(2))
    turning = [(Expression(name, (symbol("phi"),)), Fraction(1)) for name in ("cos", "sin")]
    signals = [product([squared, factor]) for factor in turning]
    rows, scales = structure.balance.rows, structure.balance.scales
    loads = tuple(
        MissingLoad(int(rows[c]), signal, 2 * k + part, float(scales[c]))
        for k, c in enumerate(group)
        for part, signal in enumerate(signals)
    )
    empty = _constant(structure, name, unit)
    return replace(empty, rotating=True, loads=loads)


def _constant(
    structure: Structure,
    name: str,
    unit: str,
    k: Floats | None = None,
    d: Floats | None = None,
    m: Floats | None = None,
    d_speed: Floats | None = None,
) -> Candidate:
    """Return a term from matrices of the coordinates."""
    n = len(structure.coordinates)
    zero = np.broadcast_to(0.0, (n, n))
    stiff, damped, gyro, heavy = (
        zero if x is None else structure.in_rows(x) for x in (k, d, d_speed, m)
    )
    turns = d_speed is not None
    return Candidate(name, stiff, zero, damped, gyro, heavy, unit, rotating=turns)


def _rotating(structure: Structure, name: str, matrix: Floats) -> Candidate:
    """Damping that acts in the rotating frame: C (q' - Omega J q)."""
    damping = structure.in_rows(matrix)
    circulation = structure.in_rows(matrix @ structure.turn())
    zero = np.zeros_like(matrix)
    term = f"rotating damping {name}"
    return Candidate(term, zero, -circulation, damping, zero, zero, "s", rotating=True)
