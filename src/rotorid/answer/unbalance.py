"""The unbalance that an estimate states, as a balancer counts it: amount and angle per plane."""

from __future__ import annotations

from functools import cache

import numpy as np

from rotorid.answer.derived import base_of, deviation
from rotorid.answer.estimate import Estimate, Unbalance
from rotorid.core.notes import Note
from rotorid.core.values import Complexes
from rotorid.models import Model
from rotorid.models.expressions import Expression, symbol
from rotorid.models.linear_form import rotation_line, speed_factor
from rotorid.models.model import fact
from rotorid.models.structure import force_balance

SPEEDS = (1.0, 2.0, 3.0, 4.0)  # rad/s: tell a square from other powers up to the cube
TURNING = symbol("phi")
ALIKE = 1e-9  # of the amount: two rows hold one unbalance, a quarter turn apart


def with_unbalance(model: Model, estimate: Estimate) -> Estimate:
    """Return an estimate with the unbalance of each plane, and what keeps one from being told.

    A load of one row is Re(U Omega^2 exp(i phi)); x and y of one plane have U and -i U.
    """
    typed, told = _columns(model), base_of(model, estimate, physical=estimate.method == "ml")
    if told is None or not typed.any() or len(model.texts) != len(model.coordinates):
        return estimate
    base, jacobian = told
    coefficients, known = model.coefficients
    inertia = np.zeros((len(model.texts), len(model.coordinates)))
    for signal, factor in enumerate(model.motion_factors):
        if factor is not None and factor[1] == 2:
            size = speed_factor(factor[2], SPEEDS[0])
            inertia[:, factor[0]] += size * (coefficients[signal] @ base + known[signal])
    balance = force_balance(model, inertia)
    columns = balance.forces(typed)
    lost = [(c, fault) for c, fault in balance.faults.items() if columns[c].any()]
    columns[[c for c, _ in lost]] = 0.0
    amounts, answers = columns @ base, columns @ jacobian
    planes = tuple(
        _plane(model, rows, complex(amounts[rows[0]]), answers[rows[0]], estimate)
        for rows in _planes(amounts)
    )
    notes = (
        Note(
            "unbalance",
            "remarks",
            f"no unbalance of {model.coordinates[c]} in g mm, and no correction mass, from the "
            f"model's {fault}",
            f"write that equation as the force on {model.coordinates[c]}",
            on=(model.coordinates[c],),
        )
        for c, fault in lost
    )
    return estimate.with_(unbalance=planes).with_notes(*notes)


@fact
def _columns(model: Model) -> Complexes:
    """Return U / base parameter of each row, shape (row, base): the part that grows as Omega^2.

    What turns with the rotor and does not grow so, a bent shaft or a magnetic pull, is none.
    """
    bases = {monomial: base for base, monomial in enumerate(model.base.kept)}
    columns = np.zeros((len(model.texts), len(bases)), dtype=complex)
    line = cache(_growing)
    if model.linear is not None:
        loads, sign = model.linear.load_terms, 1.0
    else:
        still = {signal for k, signal in enumerate(model.signals) if not model.moves(k)}
        loads, sign = tuple(term for term in model.terms if term.signal in still), -1.0
    for term in loads:
        if term.monomial in bases and TURNING in term.signal.free_symbols:
            columns[term.row, bases[term.monomial]] += sign * term.coefficient * line(term.signal)
    return columns


def _growing(signal: Expression) -> complex:
    """Return g / Omega^2 of a load Re(g exp(i phi)), 0 where it does not grow so."""
    first, second, third, fourth = (rotation_line(signal, speed) for speed in SPEEDS)
    line = (third - 2 * second + first) / 2
    cubic = fourth - 3 * third + 3 * second - first
    grows = abs(line) > ALIKE * abs(fourth)  # else what is left of it is rounding
    return line if grows and np.isfinite(cubic) and abs(cubic) <= ALIKE * abs(fourth) else 0j


def _planes(amounts: Complexes) -> list[tuple[int, ...]]:
    """Return the rows of each plane, x before y; a load without a partner is alone."""
    noise = 1e-12 * np.abs(amounts).max(initial=0.0)
    rows = [i for i in range(len(amounts)) if np.abs(amounts[i]) > noise]
    found: list[tuple[int, ...]] = []
    while rows:
        first = rows.pop(0)
        near = ALIKE * abs(amounts[first])
        after = [i for i in rows if abs(amounts[i] + 1j * amounts[first]) <= near]
        before = [i for i in rows if abs(amounts[i] - 1j * amounts[first]) <= near]
        plane = (first, after[0]) if after else (before[0], first) if before else (first,)
        found.append(plane)
        rows = [i for i in rows if i not in plane]
    return found


def _plane(
    model: Model, rows: tuple[int, ...], amount: complex, answer: Complexes, estimate: Estimate
) -> Unbalance:
    names = [model.coordinates[row] for row in rows]
    unit = "kg m^2" if model.units[names[0]] == "rad" else "kg m"
    along = np.exp(-1j * np.angle(amount)) * answer  # real: amount; imaginary: angle
    std: list[float] | list[None] = [None, None]
    covariance = estimate.covariance
    if len(covariance) == len(answer) and np.isfinite(covariance).all():
        parts = (along.real, along.imag / abs(amount))
        std = [deviation(part, covariance) for part in parts]
    return Unbalance(", ".join(names), unit, abs(amount), float(np.angle(amount)), *std)
