"""What the records do not determine, in words, and what would cure it.

A direction along which the logarithms of its members keep simple ratios is a change of unit or of
scale, and is said so (docs/maximum-likelihood.md, section 7).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from math import prod

import numpy as np
from numpy.typing import NDArray

from rotorid.answer.derived import deviation
from rotorid.answer.parts import Value
from rotorid.core.units import multiply_units
from rotorid.core.values import Floats, frozen, grouped
from rotorid.data.lines import SampledClock
from rotorid.data.observation import Observation
from rotorid.data.record import Channel
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.fit import Fit
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.response import simulated

MEMBER = 1e-5  # least part in a direction, relative to the largest, that counts
OFF = 1e-3  # lines by which the rotation may miss one that is its own: it leaks there all the same
LARGEST = 6.5  # powers of a factor are below, the least being 1: more is no change of unit or scale
SHRINKS = 1e-7  # least relative effect of a cure on a direction that counts as determining it


@frozen
class Combination:
    """One direction that the records leave open."""

    names: tuple[str, ...]  # its members; the first is the one that the others are measured by
    slopes: tuple[float, ...]  # d member / d first
    exponents: tuple[Fraction, ...]  # powers of the common factor; none where they do not scale

    def __str__(self) -> str:
        if len(self.names) == 1:
            return f"{self.names[0]} is not determined"
        listed = ", ".join(self.names)
        if not self.exponents:
            return f"{listed} are determined only together"
        powers = dict.fromkeys(self.exponents)
        if len(powers) == 1:
            return f"{listed} scale together"
        groups = []
        for power in powers:
            pairs = zip(self.names, self.exponents, strict=True)
            alike = ", ".join(name for name, e in pairs if e == power)
            groups.append(f"{alike} as s" + ("" if power == 1 else f"^{power}"))
        return f"{listed} scale together ({'; '.join(groups)})"


def open_combinations(fit: Fit) -> list[Combination]:
    linear, layout = fit.inference.linear, fit.layout
    if not linear.null.shape[1]:
        return []
    unknowns = [layout.unknowns[i] for i in layout.free]
    values = fit.solution.point.unknowns[layout.free]
    additive = np.array([unknown.additive for unknown in unknowns])
    found = []
    for row, pivot in _reduced(linear.null.T, np.array([u.nuisance for u in unknowns])):
        members = np.flatnonzero(np.abs(row) > MEMBER * np.abs(row).max())
        change, first = row[members] * linear.scale[members], members.tolist().index(pivot)
        exponents = [] if additive[members].any() else _exponents(change, values[members])
        if 1 in exponents:  # measured by a member of power one
            first = exponents.index(Fraction(1))
        order = [first, *(k for k in range(len(members)) if k != first)]
        names = tuple(unknowns[members[k]].name for k in order)
        slopes = tuple(float(change[k] / change[first]) for k in order)
        found.append(Combination(names, slopes, tuple(exponents[k] for k in order if exponents)))
    return found


def _reduced(rows: Floats, nuisance: NDArray[np.bool_]) -> Iterator[tuple[Floats, int]]:
    """Yield a basis of the rows' span with few members per direction, each with its pivot.

    A pivot is a member of one direction only. Parameters of the model are preferred; then each
    pivot gives way to another member if that takes members away.
    """
    pivots: list[int] = []
    for column in np.flatnonzero(np.abs(rows).max(axis=0) > 1e-4).tolist():
        if len(pivots) < len(rows) and _independent(rows[:, [*pivots, column]]):
            pivots.append(column)

    def through(chosen: list[int]) -> tuple[float, Floats]:
        """Return the basis with these pivots, behind what it is to be small by."""
        basis: Floats = np.asarray(np.linalg.solve(rows[:, chosen], rows), dtype=np.float64)
        largest = np.abs(basis).max(axis=1, keepdims=True)
        members = (np.abs(basis) > MEMBER * largest).sum()
        return float(members + 5 * nuisance[chosen].sum()), basis

    burden, basis = through(pivots)
    improved = True
    while improved:
        improved = False
        for k in range(len(pivots)):
            large = np.abs(basis[k]) > 1e-3 * np.abs(basis[k]).max()
            for column in np.flatnonzero(large).tolist():
                trial = [*pivots[:k], column, *pivots[k + 1 :]]
                if column in pivots or not _independent(rows[:, trial]):
                    continue
                less, other = through(trial)
                if less < burden:
                    pivots, burden, basis, improved = trial, less, other, True
    yield from zip(basis, pivots, strict=True)


def _independent(columns: Floats) -> bool:
    values = np.linalg.svd(columns, compute_uv=False)
    return len(values) == columns.shape[1] and bool(values[-1] > 1e-4 * values[0])


def _exponents(change: Floats, values: Floats) -> list[Fraction]:
    with np.errstate(all="ignore"):  # a value that does nothing may be 0, or as good as 0
        relative = change / values
    size = np.abs(relative)
    if not 0 < size.max() < LARGEST * size.min() < np.inf:
        return []
    for reference in (relative[size.argmin()], relative[size.argmax()]):
        ratios: list[float] = (relative / reference).tolist()
        powers = [Fraction(r).limit_denominator(4) for r in ratios]
        if any(abs(p - r) > 1e-4 for p, r in zip(powers, ratios, strict=True)):
            continue
        whole = [p / min(map(abs, powers)) for p in powers]
        if all(p.denominator == 1 for p in whole):
            return whole if whole[0] > 0 else [-p for p in whole]
    return []


def determined_combinations(fit: Fit, combinations: Sequence[Combination]) -> Iterator[Value]:
    """Yield what is determined of the members: ratios where they scale, differences elsewhere.

    Each member but the first of its combination gives one quantity that the move along all open
    directions leaves as it is.
    """
    layout, unknowns, covariance = fit.layout, fit.solution.point.unknowns, fit.covariance
    firsts = {c.names[0] for c in combinations}
    for name in dict.fromkeys(n for c in combinations for n in c.names if n not in firsts):
        involved = [(c, c.names.index(name)) for c in combinations if name in c.names]
        slopes = {c.names[0]: c.slopes[k] for c, k in involved}
        gradient = np.zeros(len(unknowns))
        gradient[[layout.index[n] for n in (name, *slopes)]] = (1, *(-s for s in slopes.values()))
        spread = deviation(gradient, covariance)
        own = layout.unknowns[layout.index[name]].unit
        if not all(c.exponents for c, _ in involved):
            signed = (f" {'-' if s > 0 else '+'} {abs(s):.6g}*{n}" for n, s in slopes.items())
            text = "".join([name, *signed])
            yield Value(text, own, float(gradient @ unknowns), spread)
            continue
        powers = {c.names[0]: -c.exponents[k] / c.exponents[0] for c, k in involved}
        places = {n: layout.index[n] for n in powers}
        factor = prod(float(unknowns[i]) ** float(powers[n]) for n, i in places.items())
        whole = all(power.denominator == 1 for power in powers.values())
        factors = [(layout.unknowns[i].unit, int(powers[n])) for n, i in places.items()]
        unit = multiply_units([(own, 1), *factors]) if whole else ""
        value = float(unknowns[layout.index[name]]) * factor
        every = {name: Fraction(1), **powers}
        above = [n if p == 1 else f"{n}^{p}" for n, p in every.items() if p > 0]
        below = [n if p == -1 else f"{n}^{-p}" for n, p in every.items() if p < 0]
        text = "/".join(["*".join(above), *below])
        yield Value(text, unit, value, spread * abs(factor))


def _left_open(fit: Fit, record: Observation, number: int) -> int:
    """Return how many directions would stay open with one more record like this."""
    linear, layout = fit.inference.linear, fit.layout
    unknowns = fit.solution.point.unknowns
    nothing = int(linear.null.shape[1])
    try:  # an answer astray says nothing of other records
        with np.errstate(all="ignore"):
            likelihood = simulated(layout, record, unknowns, number)
            jacobian = Evaluation(likelihood, unknowns).jacobian()[:, layout.free] * linear.scale
            size = np.sqrt((jacobian**2).sum(axis=0)).max(initial=0.0)
    except np.linalg.LinAlgError:
        return nothing
    if size == 0 or not np.isfinite(size):
        return nothing
    effect = np.linalg.svd(jacobian @ linear.null / size, compute_uv=False)
    return nothing - int((effect > SHRINKS).sum())


def find_cures(fit: Fit, combinations: Sequence[Combination]) -> list[str]:
    """Return what would determine the open combinations, best first."""
    if not combinations:
        return []
    count = len(combinations)
    sensors = grouped((left, name) for name, left in _sensors(fit))
    helped = [(left, f"a sensor of {' or '.join(names)}") for left, names in sensors.items()]
    every = (*_other_speeds(fit), *helped)
    best = sorted((pair for pair in every if pair[0] < count), key=lambda pair: pair[0])
    return [
        _fixing(fit.layout, combinations),
        *_further_modes(fit, combinations),
        *_total_mass(fit, combinations),
        *_trial_mass(fit, combinations),
        *(text + _rest(left, count) for left, text in best),
    ]


def _rest(left: int, count: int) -> str:
    return "" if left == 0 else f" ({left} of {count} combinations would stay open)"


def _fixing(layout: Layout, combinations: Sequence[Combination]) -> str:
    """Say what to fix, and how it is done where that is no parameter of the file."""
    names = combinations[0].names
    told = f"fix {'one of ' if len(names) > 1 else ''}"
    if len(combinations) > 1:
        names = tuple(combination.names[0] for combination in combinations)
        told = f"fix {len(combinations)} of them, such as "
    every = ((unknown.held, s.name) for unknown in layout.nuisances for s in unknown.scalars)
    ways = grouped((held, name) for held, name in every if name in names)
    how = "; ".join(f"{', '.join(held)}: {way}" for way, held in ways.items())
    return told + ", ".join(names) + (f" ({how})" if how else "")


def _further_modes(fit: Fit, combinations: Sequence[Combination]) -> Iterator[str]:
    modes = fit.problem.known.modes
    if fit.records or not len(modes):
        return
    unknowns = fit.layout.unknowns
    held = [{unknowns[i].name: v for i, v in c.pencil.held.items()} for c in modes.configurations]
    members = {name for combination in combinations for name in combination.names}
    for name in sorted(members.intersection(*held)):
        said = " and ".join(dict.fromkeys(f"{each[name]:g}" for each in held))
        yield (
            f"natural frequencies with {name} as it is in service: all that were measured are "
            f"with {name} = {said} {unknowns[fit.layout.index[name]].unit}"
        )
    missing = len(fit.layout.free) - len(fit.problem.known)
    if missing > 0:
        yield (
            f"at least {missing} more measured in [[modes]], frequencies or damping ratios: "
            f"{len(fit.problem.known)} for {len(fit.layout.free)} unknowns are too few"
        )


def _total_mass(fit: Fit, combinations: Sequence[Combination]) -> list[str]:
    """Try the sum of the masses, which a scale tells, as an exact constraint."""
    unknowns, free, model = fit.layout.unknowns, fit.layout.free, fit.layout.model
    table = model.require_linear().stiffness
    lengths = np.array([model.units[name] == "m" for name in model.coordinates])
    powers = model.monomials[table.monomial]  # those that stand alone before an acceleration
    alone = (table.order == 2) & (powers.sum(axis=1) == 1) & lengths[table.column]
    weighed = {model.parameter_names[i] for i in powers[alone].argmax(axis=1)}
    masses = [k for k, i in enumerate(free) if unknowns[i].name in weighed]
    if len(masses) < 2 or any(u.name in weighed and u.fixed for u in unknowns):
        return []
    null = fit.inference.linear.null[masses]
    along = null.T @ fit.inference.linear.scale[masses]
    if np.abs(null).max() < MEMBER or not np.abs(along).max() > 0:
        return []
    names = " + ".join(unknowns[free[k]].name for k in masses)
    rest = _rest(len(combinations) - 1, len(combinations))
    return [f"weigh the rotor: a constraint on {names}{rest}"]


def _trial_mass(fit: Fit, combinations: Sequence[Combination]) -> list[str]:
    """Say that a known unbalance sets the scale, where no force is measured and all scales."""
    forced = any(np.abs(r.lines.mean[:, list(r.input_columns)]).any() for r in fit.records)
    powers = (c.exponents for c in combinations if c.exponents and len(c.names) > 1)
    together = any(len(set(exponents)) == 1 for exponents in powers)
    if forced or not together:
        return []
    return [
        "a further run with a trial mass: write its unbalance into the equations beside the "
        "rotor's own, 0 kg m in [parameters] and its value in [records.parameters] of that run"
    ]


def _other_speeds(fit: Fit) -> Iterator[tuple[int, str]]:
    """Try each record at the speed of another of its lines: what stays open, and what to do."""
    for number, record in enumerate(fit.records):
        speeds, frequency = np.unique(record.lines.speed), record.lines.frequency
        hertz = float(speeds[0]) / (2 * np.pi)
        others = frequency[(frequency > 0) & (np.abs(frequency - hertz) > 0.01 * abs(hertz))]
        if len(speeds) > 1 or not len(others):
            continue
        nearest = float(others[np.abs(others - hertz).argmin()])
        moved = record.with_lines(record.lines.at_speed(2 * np.pi * nearest))
        left = _left_open(fit, moved, number)
        where = f" as record {number + 1}" if len(fit.records) > 1 else ""
        yield from ((left, text) for text in _rotation_left_out(record, where))
        yield left, f"a further record at another speed{where}, such as {nearest:g} Hz"


def _rotation_left_out(record: Observation, where: str) -> Iterator[str]:
    lines, clock = record.lines, record.lines.clock
    hertz = abs(float(lines.speed[0])) / (2 * np.pi)
    if not isinstance(clock, SampledClock) or lines.transient is not None or not hertz:
        return
    fundamental = float(lines.frequency[-1] / clock.harmonics[-1])
    order = round(hertz / fundamental)
    if abs(hertz - order * fundamental) < OFF * fundamental and order not in clock.harmonics:
        yield (
            f"the line of the rotation{where.replace(' as', ' of')}, {hertz:.6g} Hz, on which "
            f"the unbalance acts: add {order} to harmonics"
        )


def _sensors(fit: Fit) -> Iterator[tuple[str, int]]:
    """Try a sensor of each coordinate that none reads: what stays open."""
    model = fit.layout.model
    for record in fit.records[:1]:
        single = [s.terms[0] for s in record.direct if len(s.terms) == 1]
        seen = {model.coordinates[term.coordinate] for term in single} | {*record.lines.names}
        for name in model.measurable:
            if name not in seen:
                more = record.with_sensor(Channel(name, model.units[name]))
                yield name, _left_open(fit, more, 0)
