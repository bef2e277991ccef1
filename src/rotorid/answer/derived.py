"""Quantities that follow from an estimate, by the delta method and minimum distance.

The unbalance is counted as a balancer counts it: amount and angle per plane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cache

import numpy as np

from rotorid.answer.estimate import Estimate, check_units
from rotorid.answer.parts import Unbalance, Value
from rotorid.core.errors import InputError
from rotorid.core.linalg import column_lengths
from rotorid.core.notes import Note
from rotorid.core.values import Booleans, Complexes, Floats, fact
from rotorid.models import Model
from rotorid.models.expressions import Expression, symbol
from rotorid.models.linear_form import rotation_line, speed_factor
from rotorid.models.structure import force_balance

RANK_TOLERANCE = 1e-9


def base_of(model: Model, estimate: Estimate, *, physical: bool) -> tuple[Floats, Floats] | None:
    """Return the base parameters, and their slopes by each free value; None where one lacks."""
    found = {value.name: value.value for value in estimate.parameters}
    names = model.parameter_names if physical else model.base.names
    values = np.array([found.get(name, np.nan) for name in names])
    if not np.isfinite(values).all():
        return None
    free = [value.name for value in estimate.free]
    slopes = np.array([[name == other for other in free] for name in names], dtype=float)
    slopes = slopes.reshape(len(names), len(free))
    if physical:
        return model.base_values(values), model.base_jacobian(values) @ slopes
    return values, slopes


def require_parameters(
    model: Model, estimate: Estimate, number: int = 0, given: Iterable[str] = ()
) -> None:
    """Refuse an estimate that lacks what a record needs, physical or base, or has other units."""
    found, names = {v.name for v in estimate.parameters}, model.parameter_names
    told = {*given, *(n for n in names if n in found or f"{n}[{number}]" in found)}
    missing = [name for name in names if name not in told]
    if missing and not any(f"{n}[{k}]" in found for n in names for k in (0, number)):
        fixed = {v.name: v.value for v in estimate.parameters if v.fixed}
        missing = sorted(fixed.keys() - {*names})
        missing = missing or [n for n in model.substitute(fixed).base.names if n not in found]
    if missing:
        raise InputError(
            f"a result of {estimate.model!r} without {missing[0]!r}",
            f"the parameters of {model.name!r}: {', '.join(names)}, or its base parameters: "
            f"{', '.join(model.base.names)}",
            "use a result of this model",
        )
    check_units(estimate, model.parameter_units)


def deviation(slopes: Floats, covariance: Floats) -> float:
    return float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))


def base_from_physical(
    model: Model, values: Floats, covariance: Floats, names: Sequence[str]
) -> tuple[Value, ...]:
    jacobian = model.base_jacobian(values)
    std = np.sqrt(np.einsum("bi,ij,bj->b", jacobian, covariance, jacobian).clip(0))
    own = tuple(names) == model.parameter_names
    called = model.base.names if own else model.base_named(names)
    found = zip(called, model.base.units, model.base_values(values), std, strict=True)
    return tuple(Value(name, unit, float(value), float(s)) for name, unit, value, s in found)


def physical_from_base(model: Model, base: Floats, covariance: Floats) -> tuple[Value, ...]:
    values, spread, determined = physical_fit(model, base, covariance)
    std = np.sqrt((spread**2).sum(axis=1))
    return tuple(
        Value(p.name, p.unit, float(values[i]), float(std[i]))
        for i, p in enumerate(model.parameters)
        if determined[i]
    )


def physical_fit(model: Model, base: Floats, covariance: Floats) -> tuple[Floats, Floats, Booleans]:
    """Return the physical parameters nearest to base ones, S with covariance SS', and which hold.

    The fit ``min (base - base(p))' C^-1 (base - base(p))`` with the covariance C of the base
    parameters; where there are as many of one as of the other it is the exact solution.
    """
    known = np.isfinite(base)
    count = len(model.parameters)
    if not known.any():
        return np.full(count, np.nan), np.zeros((count, 0)), np.zeros(count, dtype=bool)
    start, told = physical_start(model, base), base[known]
    covariance = covariance[np.ix_(known, known)]
    # A floor keeps C positive.
    floor = 1e-9 * np.where(told != 0, np.abs(told), np.abs(told).max() or 1.0)
    scale = np.maximum(np.sqrt(np.diag(covariance).clip(0)), floor)
    correlation = covariance / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    variances, directions = np.linalg.eigh(correlation)
    whitener = directions.T / np.sqrt(np.maximum(variances, 1e-12))[:, None] / scale
    size = np.where(start != 0, np.abs(start), 1.0)

    def residual(scaled: Floats) -> Floats:
        return np.asarray(whitener @ (model.base_values(scaled * size) - base)[known])

    def jacobian(scaled: Floats) -> Floats:
        return np.asarray(whitener @ (model.base_jacobian(scaled * size)[known] * size))

    # All parameters move, those too that stay undetermined: held at a start that contradicts
    # the base they would pull at the others.
    scaled = _gauss_newton(residual, jacobian, start / size)
    slopes = jacobian(scaled)
    length = column_lengths(slopes)
    _, singular, directions = np.linalg.svd(slopes / length)
    rank = int((singular > RANK_TOLERANCE * singular.max(initial=1e-300)).sum())
    spread = directions[:rank].T / singular[:rank] / length[:, None]
    determined = (np.abs(directions[rank:]) < 1e-6).all(axis=0)
    return scaled * size, spread * size[:, None], determined


def _gauss_newton(
    residual: Callable[[Floats], Floats], jacobian: Callable[[Floats], Floats], x: Floats
) -> Floats:
    """Minimize a sum of squares; what it does not determine stays as near as it can."""
    with np.errstate(over="ignore", invalid="ignore"):
        value = residual(x)
        for _ in range(100):
            slope = jacobian(x)
            length = column_lengths(slope)
            slope = slope / length
            if not np.isfinite(slope).all():
                break
            step = np.linalg.lstsq(slope, -value, rcond=RANK_TOLERANCE)[0] / length
            while np.abs(step).max() > 1e-14 * np.abs(x).max():
                trial = residual(x + step)
                if trial @ trial < value @ value:
                    break
                step = step / 2
            else:
                break
            x, value = x + step, trial
    return x


def physical_start(model: Model, base: Floats) -> Floats:
    """Solve the base parameters one by one for the single parameter still unknown in each."""
    nominal = model.nominal
    values = np.array([nominal.get(name, 1.0) for name in model.parameter_names])
    known = np.zeros(len(values), dtype=bool)
    progress = True
    while progress:
        progress = False
        for gathered, value in zip(model.base.gather, base, strict=True):
            used = (model.monomials[gathered != 0] > 0).any(axis=0)
            unknown = np.flatnonzero(used & ~known)
            if len(unknown) == 1 and np.isfinite(value):
                (index,) = unknown
                values[index] = _root(model, gathered, value, values, int(index))
                known[index] = progress = True
    return values


def _root(model: Model, gathered: Floats, value: float, values: Floats, index: int) -> float:
    """Return the root nearest the start of one base parameter, a polynomial in one unknown."""
    powers = model.monomials[:, index]
    others = values.copy()
    others[index] = 1.0
    factors = gathered * model.monomial_values(others)
    coefficients = np.array([factors[powers == n].sum() for n in range(powers.max() + 1)])
    coefficients[0] -= value
    roots = np.roots(coefficients[::-1])
    real = roots[np.abs(roots.imag) < 1e-6 * (np.abs(roots) + 1e-300)].real
    if model.parameters[index].positive and (real > 0).any():
        real = real[real > 0]
    if not real.size:
        return float(values[index])
    return float(real[np.abs(real - values[index]).argmin()])


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
    notes = []
    for name, fault in ((model.coordinates[c], fault) for c, fault in lost):
        text = f"no unbalance of {name} in g mm, and no correction mass, from the model's {fault}"
        cure = f"write that equation as the force on {name}"
        notes.append(Note("unbalance", "remarks", text, cure, on=(name,)))
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
