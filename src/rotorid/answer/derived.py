"""Quantities that follow from an estimate, by the delta method and minimum distance."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rotorid.answer.estimate import Estimate, Value
from rotorid.core.linalg import column_lengths
from rotorid.core.values import Booleans, Floats
from rotorid.models import Model

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


def deviation(slopes: Floats, covariance: Floats) -> float:
    return float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))


def base_from_physical(
    model: Model, values: Floats, covariance: Floats, names: Sequence[str] | None = None
) -> tuple[Value, ...]:
    jacobian = model.base_jacobian(values)
    std = np.sqrt(np.einsum("bi,ij,bj->b", jacobian, covariance, jacobian).clip(0))
    own = names is None or tuple(names) == model.parameter_names
    called = model.base.names if own or names is None else model.base_named(names)
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
    start = physical_start(model, base)
    whitener = _whitener(base[known], covariance[np.ix_(known, known)])
    size = np.where(start != 0, np.abs(start), 1.0)

    def residual(scaled: Floats) -> Floats:
        return np.asarray(whitener @ (model.base_values(scaled * size) - base)[known])

    def jacobian(scaled: Floats) -> Floats:
        return np.asarray(whitener @ (model.base_jacobian(scaled * size)[known] * size))

    # All parameters move, those too that stay undetermined: held at a start that contradicts
    # the base they would pull at the others.
    scaled = _gauss_newton(residual, jacobian, start / size)
    determined, spread = _spread(jacobian(scaled))
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


def _whitener(base: Floats, covariance: Floats) -> Floats:
    """Return ``C^-1/2``; a floor keeps C positive."""
    floor = 1e-9 * np.where(base != 0, np.abs(base), np.abs(base).max() or 1.0)
    scale = np.maximum(np.sqrt(np.diag(covariance).clip(0)), floor)
    correlation = covariance / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    size, directions = np.linalg.eigh(correlation)
    return np.asarray(directions.T / np.sqrt(np.maximum(size, 1e-12))[:, None] / scale)


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


def _spread(jacobian: Floats) -> tuple[Booleans, Floats]:
    """Return which parameters a whitened Jacobian determines, and S with covariance SS'."""
    length = column_lengths(jacobian)
    _, singular, directions = np.linalg.svd(jacobian / length)
    rank = int((singular > RANK_TOLERANCE * singular.max(initial=1e-300)).sum())
    determined = (np.abs(directions[rank:]) < 1e-6).all(axis=0)
    spread = directions[:rank].T / singular[:rank] / length[:, None]
    return determined, np.asarray(spread)
