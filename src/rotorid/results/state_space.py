"""A machine as state space: ``x' = A x + B u``, ``y = C x + D u``, from its forces to its motion.

States are the coordinates and their derivatives. Coordinates without inertia have no derivative of
their own: with damping they are states of first order, without it they follow from the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.record import Booleans, Floats, Integers
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import finite_speed
from rotorid.results.planes import shares_of
from rotorid.values import ByContent

SINGULAR = 1e-12
"""Reciprocal condition of a scaled matrix below which it is singular to rounding."""


@frozen
class StateSpace(ByContent):
    """Matrices of a linear machine at one speed, in SI units.

    Parameters
    ----------
    A, B, C, D : array
        Shapes (state, state), (state, input), (output, state), (output, input).
    states, inputs, outputs : sequence of (name, unit)
    speed : float
        rad/s.
    model : str
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[tuple[str, str], ...]
    inputs: tuple[tuple[str, str], ...]
    outputs: tuple[tuple[str, str], ...]
    speed: float
    model: str

    def to_scipy(self) -> Any:
        """Return it as ``scipy.signal.StateSpace``."""
        from scipy.signal import StateSpace as Continuous  # takes its time to load

        return Continuous(self.A, self.B, self.C, self.D)

    def to_control(self) -> Any:
        """Return it as ``control.StateSpace``, with its names.

        Raises
        ------
        ImportError
            Where python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise ImportError("no python-control; install it: pip install control") from None
        named = {  # it allows no points in names
            kind: [name.replace(".", "_") for name, _ in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        return control.ss(self.A, self.B, self.C, self.D, remove_useless_states=False, **named)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        names = {
            kind: [{"name": name, "unit": unit} for name, unit in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        matrices = {name: getattr(self, name).tolist() for name in "ABCD"}
        return {"model": self.model, "speed_rad_s": self.speed, **matrices, **names}


def state_space(
    source: Estimate | Model,
    *,
    speed: float | str = 0.0,
    outputs: Sequence[str] = (),
    record: int = 0,
) -> StateSpace:
    """Return the state space of a result or a model, from its inputs to its coordinates.

    ``M q'' + (D + Omega G) q' + K q = B u`` with the gyroscopic terms of the speed; unbalance is no
    part of it.

    Parameters
    ----------
    source : Estimate or Model
        A model is taken at its nominal values.
    speed : float or str
        rad/s, or a text with unit.
    outputs : sequence of str
        Combinations of coordinates, as a sensor reads them: ``x - 0.2*theta_y``; by default every
        coordinate.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    StateSpace

    Raises
    ------
    InputError
        For a result that leaves the matrices undetermined, structural damping, which has no state
        space, and outputs that are no combination of coordinates.

    Examples
    --------
    >>> import rotorid as rid
    >>> plant = rid.state_space(rid.load_model("jeffcott"))
    >>> plant.A.shape, [name for name, _ in plant.states]
    ((4, 4), ['x', 'y', "x'", "y'"])
    """
    machine = machine_of(source, record)
    turning = finite_speed(speed)
    named = list(outputs) or list(machine.model.coordinates)
    rows = [_output(machine, text) for text in named]
    units = [_unit(machine, row) for row in rows]
    return _spaces(machine, turning, np.array(rows), tuple(zip(named, units, strict=True)))


def _output(machine: Machine, text: str) -> Floats:
    found = shares_of(machine, text)
    if found is None:
        raise InputError(
            f"the output {text[:60]!r}",
            f"a combination of {', '.join(machine.model.coordinates[:8])}",
            "name coordinates, as a sensor reads them",
            place="outputs",
        )
    return found


def _unit(machine: Machine, shares: Floats) -> str:
    """Return the unit of a combination: that of its lengths where it holds any."""
    held = [machine.model.units[machine.model.coordinates[i]] for i in np.flatnonzero(shares)]
    return "m" if "m" in held else held[0] if held else "1"


def _spaces(
    machine: Machine, speed: float, rows: Floats, named: tuple[tuple[str, str], ...]
) -> StateSpace:
    """Build the matrices."""
    matrices = machine.matrices(speed)
    if np.iscomplexobj(matrices):
        raise InputError(
            "structural damping",
            "damping that has a state space",
            "write internal or external damping in its place, right at the frequency of interest",
            file=machine.model.name,
        )
    stiffness, damping, mass = matrices
    push = machine.input_matrix()
    heavy = (mass != 0).any(axis=0)
    held, gain = _condensed(machine, damping, mass, heavy)
    stiffness, damping, mass, push, back, through = held.condense(stiffness, damping, mass, push)
    n = len(mass)
    own = heavy[gain]  # which of the coordinates that are left have a velocity of their own
    body = np.flatnonzero(own)
    light = np.flatnonzero(~own)
    count = n + len(body)
    a, b = np.zeros((count, count)), np.zeros((count, push.shape[1]))
    a[body, n + np.arange(len(body))] = 1.0
    # Rows of inertia for those with mass, of damping for those without: E z' = - F z + B u.
    lead = np.concatenate([damping[:, light], mass[:, body]], axis=1)
    right = np.concatenate([stiffness, damping[:, body]], axis=1)
    slopes = _solved(machine, lead, np.concatenate([-right, push], axis=1))
    order = np.concatenate([light, n + np.arange(len(body))]).astype(np.int64)
    a[order], b[order] = slopes[:, :count], slopes[:, count:]
    model = machine.model
    names = [model.coordinates[i] for i in gain]
    states = [(q, model.units[q]) for q in names]
    states += [(f"{names[i]}'", f"{model.units[names[i]]}/s") for i in body]
    c = np.concatenate([rows @ back, np.zeros((len(rows), len(body)))], axis=1)
    return StateSpace(
        a,
        b,
        c,
        rows @ through,
        tuple(states),
        tuple((name, model.units[name]) for name in model.inputs),
        named,
        speed,
        model.name,
    )


@frozen
class _Condensed:
    """Coordinates that follow from the others at once: what is left, and how they follow."""

    machine: Machine
    kept: Integers
    away: Integers
    rows: Integers

    def condense(
        self, stiffness: Floats, damping: Floats, mass: Floats, push: Floats
    ) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """Return K, D, M and B of what is left, and q = back z + through u."""
        n, inputs = len(stiffness), push.shape[1]
        back, through = np.zeros((n, len(self.kept))), np.zeros((n, inputs))
        back[self.kept, np.arange(len(self.kept))] = 1.0
        if not len(self.away):
            return stiffness, damping, mass, push, back, through
        rest = np.setdiff1d(np.arange(n), self.rows)
        static = np.concatenate([-stiffness[np.ix_(self.rows, self.kept)], push[self.rows]], axis=1)
        follows = _solved(self.machine, stiffness[np.ix_(self.rows, self.away)], static)
        back[self.away], through[self.away] = np.split(follows, [len(self.kept)], axis=1)
        left = stiffness[rest]
        return (
            left @ back,
            damping[np.ix_(rest, self.kept)],
            mass[np.ix_(rest, self.kept)],
            push[rest] - left @ through,
            back,
            through,
        )


def _condensed(
    machine: Machine, damping: Floats, mass: Floats, heavy: Booleans
) -> tuple[_Condensed, Integers]:
    """Return which coordinates have neither inertia nor damping, with the equations of these."""
    bare = ~heavy & ~(damping != 0).any(axis=0)
    rows = np.flatnonzero(~(mass != 0).any(axis=1) & ~(damping != 0).any(axis=1))
    away, kept = np.flatnonzero(bare), np.flatnonzero(~bare)
    if len(rows) != len(away):
        raise InputError(
            f"{len(away)} coordinates and {len(rows)} equations without inertia and damping",
            "as many of one as of the other",
            "give the massless coordinates a little inertia",
            file=machine.model.name,
        )
    return _Condensed(machine, kept, away, rows), kept


def _solved(machine: Machine, matrix: Floats, right: Floats) -> Floats:
    """Solve with a matrix scaled to entries of one size."""
    if not len(matrix):
        return np.zeros((0, right.shape[1]))
    size = np.abs(matrix)
    row = 1 / np.maximum(size.max(axis=1), 1e-300)
    column = 1 / np.maximum((size * row[:, None]).max(axis=0), 1e-300)
    scaled = matrix * row[:, None] * column
    values = np.linalg.svd(scaled, compute_uv=False)
    if values[-1] <= SINGULAR * values[0]:
        raise InputError(
            "an inertia, or a damping of what has none, that is singular",
            "coordinates that each have their own",
            "give the massless coordinates a little inertia",
            file=machine.model.name,
        )
    with np.errstate(over="ignore", invalid="ignore"):
        found = column[:, None] * np.linalg.solve(scaled, right * row[:, None])
    if not np.isfinite(found).all():
        raise InputError(
            "a machine beyond all bounds",
            "a machine with finite values",
            "check the values and their units",
            file=machine.model.name,
        )
    return np.asarray(found)
