"""Which equation is the balance of forces on each coordinate, and how many times it stands there.

Motion is the same whatever an equation is multiplied by, and whichever equations are added. Forces
are not: an unbalance, a correction mass and what a model lacks are read from the equation of their
coordinate. By virtual work that is the one in N for a coordinate in m, in N m for one in rad; in it
a force on the coordinate stands once, inertia couples two coordinates alike, and so do springs.
What people type has terms without a number before them, so a number before all of them is one that
the equation was multiplied by.

A parameter p is a spring where p dK/dp is symmetric and positive semidefinite, a mass where
p dM/dp is. Masses that stand in two places, on coordinates that nothing but rotation couples, tell
which coordinates are a pair: the same displacement in x and in y.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import scipy

from rotorid.core.errors import InputError
from rotorid.core.linalg import coupled
from rotorid.core.units import dimension_of
from rotorid.core.values import Complexes, Floats, Integers, fact, frozen
from rotorid.models.expressions import Expression, Monomial
from rotorid.models.linear_form import motion_factor
from rotorid.models.model import Model

ALIKE = 1e-3  # share by which typed numbers may differ and be the same: four digits are typed
WHOLE = 1e-6  # share of one by which a ratio may miss a whole number: typed ones are exact
_WORK = dimension_of("J")
Values = TypeVar("Values", Floats, Complexes)


@dataclass(frozen=True, eq=False)
class ForceBalance:
    """The equation of each coordinate, and how many times the forces on it that is."""

    rows: Integers  # (coordinate,)
    # (coordinate,): negative where it is written with the other sign; of size one where it is not
    # told
    scales: Floats
    # coordinates whose forces no equation tells, each with the reason
    faults: Mapping[int, str] = field(default_factory=dict)
    names: tuple[str, ...] = ()  # of the coordinates

    def column(self, shares: Floats) -> Floats:
        """Return what a force does to the equations that acts along coordinates, shape (row,)."""
        self.check(shares)
        found = np.zeros(len(shares))
        np.add.at(found, self.rows, self.scales * shares)
        return found

    def forces(self, columns: Values) -> Values:
        """Return the forces on the coordinates that columns of the equations are, (row, ...)."""
        scales = self.scales.reshape(-1, *(1,) * (columns.ndim - 1))
        return np.asarray(columns[self.rows] / scales)

    def check(self, shares: Floats) -> None:
        for coordinate, fault in self.faults.items():
            if np.any(shares[coordinate]):
                expected = f"the balance of forces on {self.names[coordinate]}, once"
                cure = f"write that equation as the force on {self.names[coordinate]}"
                raise InputError(f"the model's {fault}", expected, cure)


def force_balance(model: Model, inertia: Floats) -> ForceBalance:
    """Return equation and scale of each coordinate; `inertia`, M (row, coordinate), tells whose."""
    if not model.typed.equations:  # matrices that no one typed: a drawing's
        n = len(model.coordinates)
        return ForceBalance(np.arange(n), np.ones(n), names=model.coordinates)
    n = len(inertia)
    size = np.abs(inertia) + 1e-9 * np.abs(inertia).max(initial=0.0) * np.eye(n)
    scale = np.sqrt(np.outer(size.max(axis=1), size.max(axis=0)))
    share = size / np.where(scale > 0, scale, 1.0)
    order = np.arange(n)
    if (np.diag(share) < share.max(axis=1, initial=0.0)).any():  # else no other order has more
        rows, columns = scipy.optimize.linear_sum_assignment(-share)
        order[columns] = rows
    signs = np.where(inertia[order, np.arange(n)] < 0, -1.0, 1.0)
    return _balance(model.typed, tuple(order.tolist()), tuple(signs.tolist()))


@fact
def _balance(typed: Model, rows: tuple[int, ...], signs: tuple[float, ...]) -> ForceBalance:
    equations = _equations(typed, rows)
    links, faults = _links(equations, signs)
    # Where need be by what couples it; NaN if not told.
    scales = np.array([equation.told[0] for equation in equations])
    waiting = np.flatnonzero(np.isfinite(scales)).tolist()
    while waiting:
        i = waiting.pop()
        for (one, j), ratio in links.items():
            if one == i and np.isnan(scales[j]) and not equations[j].told[1]:
                scales[j] = scales[i] / ratio
                waiting.append(j)
    for c, equation in enumerate(equations):
        wrong = equation.told[1] or ("" if np.isfinite(scales[c]) else equation.multiplied())
        if wrong:
            faults.setdefault(c, wrong)
    for (i, j), ratio in links.items():
        unlike = ratio * scales[j] / scales[i]
        if not {i, j} & faults.keys() and abs(unlike - 1) > ALIKE:
            a, b = (typed.coordinates[k] for k in (i, j))
            faults[i] = faults[j] = (
                f"equations {rows[i] + 1} and {rows[j] + 1}, which couple {a} and {b} unlike "
                f"({max(unlike, 1 / unlike):.4g} to 1), as no spring and no inertia does"
            )
    scales = np.where(np.isfinite(scales), scales, 1.0) * signs
    return ForceBalance(np.array(rows), scales, faults, typed.coordinates)


Key = tuple[int, Expression, Monomial]
"""Of a coefficient of K, D or M: order of the derivative, factor of the speed, parameters."""


@frozen
class _Equation:
    row: int
    entries: Mapping[Key, Mapping[int, float]]  # coefficients of each coordinate
    numbers: tuple[float, ...]  # sizes of the coefficients of parameters, without inputs
    own: tuple[float, ...]  # those of its inertia
    pushes: tuple[float, ...]  # those of inputs that act on no other coordinate of its kind
    levers: bool  # whether these have a lever
    unit_fault: str

    @cached_property
    def told(self) -> tuple[float, str]:
        """How many times the balance of forces it is, NaN where not told, and why not."""
        if self.unit_fault or not self.pushes:
            alone = not self.unit_fault and (not self.numbers or _has_one(self.numbers))
            return 1.0 if alone else np.nan, self.unit_fault
        once = min(self.pushes)
        if _has_one(self.pushes):
            return 1.0, ""
        if _has_one(self.numbers):  # as typed, unless the force and the mass are of two such
            doubled = any(abs(size / once - 1) < WHOLE for size in self.own)
            return (np.nan, self.multiplied(once)) if doubled else (1.0, "")
        of = min(self.numbers, default=once) if self.levers else once
        ratios = [size / of for size in (*self.numbers, *self.pushes)]
        whole = all(r > 0.5 and abs(r - round(r)) < WHOLE * r for r in ratios)
        return (of, "") if self.numbers and whole else (np.nan, self.multiplied(once))

    def multiplied(self, by: float | None = None) -> str:
        size = min(self.numbers) if by is None else by
        return f"equation {self.row + 1}, which may be the balance of forces times {size:.6g}"


def _has_one(sizes: Sequence[float]) -> bool:
    return any(abs(size - 1) < WHOLE for size in sizes)


def _equations(model: Model, rows: Sequence[int]) -> list[_Equation]:
    units = [model.units[name] for name in model.coordinates]
    left, right = model.sides
    kinds = dict(zip(rows, units, strict=True))
    acts = Counter((signal, kinds[row]) for signal, row in {(p.signal, p.row) for p in right})
    inputs = {p.signal for p in right}
    found = []
    for c, (row, unit) in enumerate(zip(rows, units, strict=True)):
        force = _WORK * dimension_of(unit) ** -1
        own = [p for p in left if p.row == row]
        entries: dict[Key, dict[int, float]] = defaultdict(lambda: defaultdict(float))
        for p in own:
            if (factor := motion_factor(p.signal, model.coordinates)) is not None:
                column, order, speed = factor
                entries[order, speed, p.monomial][column] += float(p.coefficient)
        inertia = [
            abs(by_column[c])
            for (order, _, monomial), by_column in entries.items()
            if order == 2 and any(monomial) and c in by_column
        ]
        pushes = [
            abs(float(p.coefficient))
            for p in right
            if p.row == row
            and acts[p.signal, unit] == 1
            and (any(p.monomial) or dimension_of(model.units[str(p.signal)]) == force)
        ]
        in_units = [
            dimension
            for p, dimension in zip(model.equations, model.dimensions, strict=True)
            if p.row == row and dimension and (any(p.monomial) or p.signal in inputs)
        ]
        unlike = in_units and force not in in_units
        fault = f"equation {row + 1}, whose terms are in {in_units[0]}" if unlike else ""
        numbers = tuple(abs(float(p.coefficient)) for p in own if any(p.monomial))
        said = (entries, numbers, tuple(inertia), tuple(pushes), unit != "m", fault)
        found.append(_Equation(row, *said))
    return found


def _links(
    equations: Sequence[_Equation], signs: Sequence[float]
) -> tuple[dict[tuple[int, int], float], dict[int, str]]:
    """Return by how much the scales of two equations differ, and what couples only one way."""
    links: dict[tuple[int, int], float] = {}
    faults: dict[int, str] = {}
    for i, one in enumerate(equations):
        for key, by_column in one.entries.items():
            for j, here in by_column.items():
                back = equations[j].entries.get(key, {}).get(i, 0.0)
                if i == j or here == 0:
                    continue
                if signs[i] * here * signs[j] * back > 0:
                    links.setdefault((i, j), abs(here / back))
                elif key[0] == 2:
                    faults[i] = faults[j] = (
                        f"equation {one.row + 1}, which holds inertia that equation "
                        f"{equations[j].row + 1} does not, as sums of equations do"
                    )
    return links, faults


@frozen
class Structure:
    """Matrices of a model by parameter, rows brought to the order and sign of the coordinates."""

    # name, and p dK/dp or p dM/dp, shape (coordinate, coordinate)
    springs: tuple[tuple[str, Floats], ...]
    masses: tuple[tuple[str, Floats], ...]
    # coordinates of the same displacement in x and in y; forward rotation leads the first to the
    # second
    pairs: tuple[tuple[int, int], ...]
    coordinates: tuple[str, ...]
    units: tuple[str, ...]  # of these
    # the equation of each coordinate, and how many times the forces on it that is
    balance: ForceBalance
    lone: tuple[int, ...] = ()  # coordinates without a partner, on which something may act too
    inertia: Floats = field(default_factory=lambda: np.zeros((0, 0)))  # M, of coordinates
    # coordinates that lie in one plane: those of x, those of y; else those that couple
    planes: tuple[tuple[int, ...], ...] = ()
    # the slope of the shaft at a displacement, where a drawing gives it
    slopes: Mapping[int, int] = field(default_factory=dict)
    # (coordinate, own), where the model has fewer of its own: ``q = shapes @ own``, and which of q
    # are among these: forces act, and sensors read, there alone
    shapes: Floats | None = None
    shown: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def in_rows(self, matrix: Values) -> Values:
        """Write a matrix of coordinates in the equations as they stand."""
        written = np.zeros_like(matrix)
        written[self.balance.rows] = self.balance.scales[:, None] * matrix
        return written if self.shapes is None else np.asarray(self.shapes.T @ written)

    def forces(self, columns: Values) -> Values:
        """Return the forces on the coordinates that columns of the equations are, (row, column)."""
        return self.balance.forces(columns) if self.shapes is None else self.shown @ columns

    def motion(self, own: Values) -> Values:
        """Return the motion of the coordinates, (..., coordinate), by those of the model."""
        return own if self.shapes is None else own @ self.shapes.T

    def own(self, motion: Values) -> Values:
        """Return what sensors see of a motion, by the coordinates of the model."""
        return motion if self.shapes is None else motion @ self.shown

    @property
    def mass(self) -> float:
        """The mass that moves in x."""
        along = next(iter(self.translations()), np.zeros(len(self.units)))
        return float(along @ self.inertia @ along)

    def translations(self) -> list[Floats]:
        """Return what moves all places alike, in x and in y, or in each direction there is."""
        lengths, every = np.array(self.units) == "m", np.arange(len(self.units))
        moved = [(np.isin(every, plane) & lengths).astype(float) for plane in self.planes]
        return [along for along in moved if along.any()]

    def turn(self) -> Floats:
        """Return J, the turn by a right angle in the sense of the rotation."""
        turn = np.zeros((len(self.coordinates), len(self.coordinates)))
        for a, b in self.pairs:
            turn[a, b], turn[b, a] = -1.0, 1.0
        return turn

    def along(self) -> Floats:
        """Return what displacements gain for a metre along the shaft, by its slopes."""
        gained = np.zeros((len(self.coordinates), len(self.coordinates)))
        for seen, slope in self.slopes.items():  # theta_x is the slope of -y
            gained[seen, slope] = 1.0 if seen in self.planes[0] else -1.0
        return gained


def find_structure(model: Model, values: Floats, speed: float) -> Structure | None:
    """Return the structure of a model, or None where its equations do not match its coordinates."""
    linear = model.require_linear()
    n = linear.coordinates
    if linear.rows != n:
        return None
    whole = linear.matrices(values, speed).M
    balance = force_balance(model, whole)
    inertia = whole[balance.rows] / balance.scales[:, None]
    springs, masses = energies(model, values, speed, balance)
    columns = linear.rotation_columns(speed or 1.0)
    once = balance.forces(columns @ model.monomial_values(values))
    pairs: list[tuple[int, int]] = []
    elastic = np.abs([matrix for _, matrix in (*springs, *masses)]).sum(axis=0) if springs else None
    for _, matrix in masses:
        moved = np.flatnonzero(np.diag(matrix)).tolist()
        single = len(moved) == np.count_nonzero(matrix) == 2
        if single and not any({*moved} & {*pair} for pair in pairs):
            if elastic is not None and elastic[moved[0], moved[1]]:
                continue  # two places of one plane
            a, b = moved  # in the sense in which its unbalance turns; else as declared
            backward = (once[b] * np.conj(once[a])).imag > 1e-6 * abs(once[a]) * abs(once[b])
            pairs.append((b, a) if backward else (a, b))
    lone = tuple(k for k in range(n) if not any(k in pair for pair in pairs))
    if pairs:
        planes = tuple(zip(*pairs, strict=True))
    else:
        links = np.abs(inertia) + sum((np.abs(matrix) for _, matrix in springs), np.zeros((n, n)))
        planes = tuple(tuple(group.tolist()) for group in coupled(links + np.eye(n)))
    names, units = model.coordinates, tuple(model.units[name] for name in model.coordinates)
    found = Structure(springs, masses, tuple(pairs), names, units, balance, lone)
    return replace(found, inertia=inertia, planes=planes)


Parts = tuple[tuple[str, Floats], ...]


def energies(
    model: Model, values: Floats, speed: float, balance: ForceBalance
) -> tuple[Parts, Parts]:
    """Return the springs and the masses among the parameters, each with its matrix."""
    ordered = _by_parameter(model, values, speed)[:, :, balance.rows] / balance.scales[:, None]
    named = list(zip(model.parameter_names, ordered, strict=True))
    springs, masses = (
        tuple((name, part[k]) for name, part in named if _is_energy(part[k])) for k in (0, 2)
    )
    return springs, masses


def _by_parameter(model: Model, values: Floats, speed: float) -> Floats:
    """Return p dK/dp, p dD/dp and p dM/dp of each parameter p, (parameter, 3, row, coordinate)."""
    linear = model.require_linear()
    table, parts = linear.stiffness, np.zeros((3, linear.rows, linear.coordinates, len(values)))
    slopes = model.monomial_jacobian(values)[table.monomial]
    place, size = (table.order, table.row, table.column), table.sizes(speed)
    np.add.at(parts, place, size[:, None] * slopes * values)
    return np.moveaxis(parts, 3, 0)


def holding(model: Model, values: Floats) -> tuple[str, ...]:
    """Return the stiffnesses, dampings and cross-couplings that hold the rotor: bearings, seals.

    They may follow the speed. A shaft, and what damps its bending, holds nothing that moves or
    turns as one body, wherever its places are: some displacements beside a turn by 1 rad strain
    nothing. Masses and lengths do act there: units tell.
    """
    lengths = np.array([model.units[name] == "m" for name in model.coordinates])

    def holds(matrix: Floats) -> bool:
        across, turned = matrix[:, lengths], matrix[:, ~lengths].sum(axis=1)
        left = turned - across @ np.linalg.lstsq(across, turned, rcond=None)[0]
        return bool(np.abs([across.sum(axis=1), left]).max() > ALIKE * np.abs(matrix).max())

    every = zip(model.parameters, _by_parameter(model, values, 0.0)[:, :2], strict=True)
    timed = ((p.name, two) for p, two in every if "s" in dict(dimension_of(p.unit).powers))
    return tuple(name for name, two in timed if any(map(holds, two)))


def _is_energy(matrix: Floats) -> bool:
    size = np.abs(matrix).max(initial=0.0)
    if size == 0 or np.abs(matrix - matrix.T).max() > 1e-9 * size:
        return False
    scale = np.sqrt(np.diag(matrix).clip(0))
    scale[scale == 0] = 1.0
    return bool(np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > -1e-9)
