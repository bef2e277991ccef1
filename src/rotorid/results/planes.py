"""Places on a rotor: what a force there, or a mass that turns with it, does to the equations.

The force of an unbalance U (kg m, complex: its direction in the rotor from x to y at phi = 0) is
``Re(U Omega^2 exp(i phi))`` in x and ``Re(-i U Omega^2 exp(i phi))`` in y.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats
from rotorid.models.equations import polynomial
from rotorid.models.rotor import RotorModel
from rotorid.models.structure import ForceBalance, force_balance
from rotorid.results.machine import Machine
from rotorid.results.modes import partners

ALIKE = 1e-3
"""Share by which x and y of one place may differ, and their size from one: digits of a drawing."""


def directions_of(machine: Machine) -> ForceBalance:
    """Return which equation tells the forces on each coordinate, by virtual work."""
    return force_balance(machine.model, np.real(machine.matrices(0.0)[2]))


def plane_column(machine: Machine, plane: str) -> Complexes:
    """Return what an unbalance of 1 kg m in a plane does to the equations, over Omega^2, (row,).

    A plane is a pair ``x2,y2`` of coordinates, of combinations of them such as
    ``x + 0.1*theta_y, y - 0.1*theta_x``, or of inputs; or the name of a place. Of a model that
    moves along one axis only it is the one direction.

    Raises
    ------
    InputError
        For what names no plane.
    """
    if "," not in plane and _one_axis(machine):
        column = _force_column(machine, plane.strip())
        if column is not None and column.any():
            return column.astype(complex)
    for pair in _readings(machine, plane):
        columns = [_force_column(machine, name) for name in pair]
        if columns[0] is not None and columns[1] is not None:
            combined = not {*pair} & {*machine.model.inputs}
            _check_pair(machine, plane, columns[0], columns[1], combined=combined)
            return np.asarray(columns[0] - 1j * columns[1])
    raise InputError(
        f"the plane {plane[:60]!r}",
        f"a pair of coordinates or inputs, {_offered(machine)}",
        "name the two directions in which its force acts, x before y: --plane x2,y2",
        place="plane",
    )


def _one_axis(machine: Machine) -> bool:
    """Tell whether all displacements of a model are along one axis, as their names say."""
    units = machine.model.units
    moved = [name for name in machine.model.coordinates if units[name] == "m"]
    return len({re.sub(r"[\d_].*", "", name) for name in moved}) == 1


def _check_pair(machine: Machine, plane: str, *columns: Floats, combined: bool) -> None:
    """Refuse what is not x and y of one place: couples, y before x, parts or multiples of it."""
    if _parallel(*columns):
        raise InputError(
            f"one direction twice: {plane[:60]!r}",
            f"the two directions in which a force acts, {_offered(machine)}",
            "name the one alone" if _one_axis(machine) else "name them, x before y",
            place="plane",
        )
    directions, names = directions_of(machine), list(machine.model.coordinates)
    lengths = np.array([machine.model.units[name] == "m" for name in names])
    if any(directions.forces(column)[k] for column in columns for k in directions.faults):
        return  # inputs: what they do stands in the equations, whatever these are
    first, second = (np.where(lengths, directions.forces(column), 0.0) for column in columns)
    turned = np.zeros(len(names))
    for a, b in partners(names):
        turned[b] += first[a]
        turned[a] -= first[b]
    x, y = np.array(partners(names), dtype=np.int64).reshape(-1, 2).T
    size = np.hypot(first[x].sum(), first[y].sum())
    if not (first.any() and second.any()):
        found = "a couple, where a mass makes a force"
    elif turned.any() and np.allclose(second, -turned):
        found = "a pair in which y comes before x"
    elif turned.any() and not np.allclose(second, turned, atol=ALIKE * size):
        found = "two directions that are not x and y of one place"
    elif combined and _levers_differ(machine, *columns):
        found = "x and y of two places along the axis, as a sign that is wrong makes them"
    elif combined and turned.any() and abs(size - 1) > ALIKE:
        found = f"{size:.4g} times the motion of a place"
    else:
        return
    raise InputError(
        f"{found}: {plane[:60]!r}",
        f"the two directions in which a force acts, {_offered(machine)}",
        "name them, x before y",
        place="plane",
    )


def _parallel(first: Floats, second: Floats) -> bool:
    """Tell whether two forces do the same, up to their size."""
    product = np.linalg.norm(first) * np.linalg.norm(second)
    return bool(product > 0 and abs(first @ second) > (1 - 1e-9) * product)


def _levers_differ(machine: Machine, *columns: Floats) -> bool:
    """Tell whether y acts at another lever than x; which sign that has, the inputs tell."""
    directions, names = directions_of(machine), machine.model.coordinates
    angles = [pair for pair in partners(names) if machine.model.units[names[pair[0]]] != "m"]

    def levers(x: Floats, y: Floats) -> Floats:
        one, other = (directions.forces(column) for column in (x, y))
        return np.array([(one[b], other[a]) for a, b in angles]).reshape(-1, 2)

    forces, inputs = machine.input_matrix(), partners(machine.model.inputs)
    known = [levers(forces[:, a], forces[:, b]) for a, b in inputs]
    signs = {-1.0} if isinstance(machine.model, RotorModel) else set[float]()
    signs |= {float(sign) for pair in known for sign in np.sign(pair.prod(axis=1)) if sign}
    found = levers(*columns)
    if len(signs) != 1 or not found.size:
        return False
    away = np.abs(found[:, 1] - signs.pop() * found[:, 0])
    return bool((away > ALIKE * np.abs(found).max(axis=1)).any())


def _readings(machine: Machine, plane: str) -> Iterator[tuple[str, str]]:
    """Yield what a text may mean, the pair that it writes first."""
    parts = [part.strip() for part in plane.split(",")]
    if len(parts) == 2 and all(parts):
        yield parts[0], parts[1]
    elif len(parts) == 1:
        for x, y in (("x_{}", "y_{}"), ("x{}", "y{}"), ("F_x{}", "F_y{}"), ("F_x_{}", "F_y_{}")):
            yield x.format(parts[0]), y.format(parts[0])


def _offered(machine: Machine) -> str:
    """Return some planes that a machine has."""
    model = machine.model
    named = list(machine.model.coordinates)
    pairs = [f"{named[a]},{named[b]}" for a, b in partners(named) if model.units[named[a]] == "m"]
    pairs = [pair for pair in pairs if "node" not in pair] or pairs
    if not pairs and _one_axis(machine):
        pairs = [name for name in named if model.units[name] == "m"]
    forces = [name for name in model.inputs if model.units[name] == "N"]
    inputs = [f"{forces[a]},{forces[b]}" for a, b in partners(forces)]
    return (
        ("such as " + " or ".join([*pairs[:3], *inputs[:2]])) if pairs or inputs else "of x and y"
    )


def _force_column(machine: Machine, text: str) -> Floats | None:
    """Return what a force of 1 N does there to the equations, shape (row,); None for no place."""
    if text in machine.model.inputs:
        if machine.model.units[text] != "N":
            raise InputError(
                f"the input {text} in {machine.model.units[text]} for a plane",
                f"the two directions in which a force acts, {_offered(machine)}",
                "name them, x before y",
                place="plane",
            )
        return np.asarray(machine.input_matrix()[:, machine.model.inputs.index(text)])
    shares = shares_of(machine, text)
    return None if shares is None else directions_of(machine).column(shares)


def shares_of(machine: Machine, text: str) -> Floats | None:
    """Return the coordinates that a text combines, shape (coordinate,); None where it does not."""
    model = machine.model
    names = list(model.coordinates)
    if isinstance(model, RotorModel) and text in model.readings:
        known = model.readings[text]
        return np.array([known.get(name, 0.0) for name in names])
    if text in names:
        return np.asarray(np.eye(len(names))[names.index(text)])
    values = {**dict(machine.fixed), **dict(zip(machine.names, machine.values, strict=True))}
    parameters = [name for name in values if name.isidentifier()]
    try:
        terms = polynomial(text, [*names, *parameters])
    except InputError:
        return None
    found = np.zeros(len(names))
    for powers, coefficient in terms.items():
        own = np.array(powers[: len(names)])
        if own.sum() != 1:
            return None
        size = [values[p] ** n for p, n in zip(parameters, powers[len(names) :], strict=True)]
        found[int(own.argmax())] += float(coefficient) * float(np.prod(size))
    return found


def require_shares(machine: Machine, kind: str, text: str, cure: str) -> Floats:
    """Return the coordinates that a text combines, shape (coordinate,), or refuse it."""
    found = shares_of(machine, text)
    if found is None:
        raise InputError(
            f"the {kind} {text[:60]!r}",
            f"a combination of {', '.join(machine.model.coordinates[:8])}",
            cure,
            place=f"{kind}s",
        )
    return found


def rotor_mass(machine: Machine) -> float | None:
    """Return the mass that moves with all positions in x; None where there is none."""
    names = machine.model.coordinates
    along = [a for a, _ in partners(names) if machine.model.units[names[a]] == "m"]
    if not along:
        return None
    shares = np.zeros(len(names))
    shares[along] = 1.0
    mass = np.real(machine.matrices(0.0)[2])
    directions = directions_of(machine)
    if any(shares[k] for k in directions.faults):
        return None
    found = float(shares @ directions.forces(mass @ shares))
    return found if found > 0 else None
