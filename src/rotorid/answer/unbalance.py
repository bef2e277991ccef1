"""The unbalance that an estimate states, as a balancer counts it: amount and angle per plane."""

from __future__ import annotations

from functools import cache

import numpy as np

from rotorid.answer.contents import Unbalance
from rotorid.answer.estimate import Estimate
from rotorid.core.notes import Note
from rotorid.core.values import Complexes, Floats
from rotorid.models import Model
from rotorid.models.expressions import Expression, symbol
from rotorid.models.linear_form import rotation_line, speed_factor
from rotorid.models.model import fact
from rotorid.models.structure import ForceBalance, force_balance

SPEEDS = (1.0, 2.0, 3.0, 4.0)  # rad/s: tell a square from other powers up to the cube
TURNING = symbol("phi")
ALIKE = 1e-9  # of the amount: two rows hold one unbalance, a quarter turn apart


def unbalance_of(model: Model, estimate: Estimate) -> tuple[Unbalance, ...]:
    """Return the unbalance of each plane with its deviations; nothing where it is not told.

    A load of one row is Re(U Omega^2 exp(i phi)); x and y of one plane have U and -i U.
    """
    told = _base_of(model, estimate)
    if told is None:
        return ()
    base, jacobian = told
    columns, _ = _forces(model, base)
    amounts = columns @ base
    answers = columns @ jacobian
    return tuple(
        _plane(model, rows, complex(amounts[rows[0]]), answers[rows[0]], estimate)
        for rows in _planes(amounts)
    )


def unbalance_untold(model: Model, estimate: Estimate) -> tuple[Note, ...]:
    """Return what keeps an unbalance from being told in g mm: equations."""
    told = _base_of(model, estimate)
    faults = {} if told is None else _forces(model, told[0])[1]
    return tuple(
        Note(
            "unbalance",
            "remarks",
            f"no unbalance of {model.coordinates[c]} in g mm, and no correction mass, from the "
            f"model's {fault}",
            f"write that equation as the force on {model.coordinates[c]}",
            on=(model.coordinates[c],),
        )
        for c, fault in faults.items()
    )


def _forces(model: Model, base: Floats) -> tuple[Complexes, dict[int, str]]:
    """Return U / base parameter of each coordinate, and those that are loaded and not told."""
    typed = _columns(model)
    if not typed.any() or len(model.texts) != len(model.coordinates):
        return np.zeros((len(model.coordinates), len(base)), dtype=complex), {}
    balance = _balance_of(model, base)
    columns = balance.forces(typed)
    lost = {c: fault for c, fault in balance.faults.items() if columns[c].any()}
    columns[list(lost)] = 0.0
    return columns, lost


def _balance_of(model: Model, base: Floats) -> ForceBalance:
    coefficients, known = model.coefficients
    inertia = np.zeros((len(model.texts), len(model.coordinates)))
    for signal, factor in enumerate(model.motion_factors):
        if factor is not None and factor[1] == 2:
            size = speed_factor(factor[2], SPEEDS[0])
            inertia[:, factor[0]] += size * (coefficients[signal] @ base + known[signal])
    return force_balance(model, inertia)


def _base_of(model: Model, estimate: Estimate) -> tuple[Floats, Floats] | None:
    """Return the base parameters, and what they change by with each free one of the estimate."""
    value = {v.name: v.value for v in estimate.parameters}
    free = [v.name for v in estimate.free]
    names = model.parameter_names if estimate.method == "ml" else model.base.names
    if not set(names) <= set(value):
        return None
    values = np.array([value[name] for name in names])
    if not np.isfinite(values).all():
        return None
    pick = np.array([[name == other for other in free] for name in names], dtype=float)
    pick = pick.reshape(len(names), len(free))
    if estimate.method != "ml":
        return values, pick
    return model.base_values(values), model.base_jacobian(values) @ pick


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
    deviations: tuple[float | None, float | None] = (None, None)
    covariance = estimate.covariance
    if len(covariance) == len(answer) and np.isfinite(covariance).all():
        parts = (along.real, along.imag / abs(amount))
        first, second = (float(np.sqrt(max(p @ covariance @ p, 0.0))) for p in parts)
        deviations = first, second
    return Unbalance(
        ", ".join(names), unit, abs(amount), float(np.angle(amount)), deviations[0], deviations[1]
    )
