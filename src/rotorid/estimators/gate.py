"""The gate that every estimate passes: can it be a machine, and does the record agree with itself.

An answer is turned away (``rejected``) where it is no machine (a negative mass, a polar inertia
above the sum of the transverse ones, a negative value of what the model calls positive), where it
does not predict its own record, where the residual of its equations is no noise, and where blocks
of the record contradict one another.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimate import Estimate
from rotorid.estimate_parts import DOUBTFUL, Value
from rotorid.estimators.expectation import Expectation
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.expression import symbol
from rotorid.models.force_balance import force_balance
from rotorid.models.linear import LinearForm, speed_factor
from rotorid.record import Check, Floats
from rotorid.units import dimension_of

REJECTED = 1e-6
"""The p-value below which the data reject the model."""
SURE = 3.0
"""Deviations by which a value is beyond what a machine can have before it is turned away: nearer,
noise alone may have put it there, and a warning says so."""
UNPREDICTED = 0.5
"""Relative error of a prediction, beyond its noise, that turns an answer away: three quarters of
the power of a force are then explained at most."""
APART = 6.0
"""Deviations by which halves of a record may differ: over a hundred parameters chance reaches 4,
and deviations from a dozen periods are themselves a fifth off."""
COMMON = 2.0
"""Deviations of a cost from its mean that noise leaves in some per cent of all records."""
MOVED, BIASED = 1.0, 10.0
"""Deviations of a bias from which on it is told, and from which on the answer is turned away: one
leaves 83 % of intervals right where 95 % are promised; halves of one record tell a bias to a factor
of three, and the second is beyond that."""
CONTRADICTING = frozenset(
    {
        "drift",
        "settled",
        "knock",
        "lost samples",
        "clocks",
        "speed",
        "period",
        "repeats",
        "copied periods",
        "clipped",
        "stuck",
        "wander",
    }
)
"""Checks whose warnings contradict what every method takes for granted: that the machine, its
speed and its period stay what they are, and that the samples are the quantity."""
SILENT = frozenset({"dead", "stuck", "quantized"})
"""Checks whose warnings are of a channel that reads nothing: no suspect explains it better."""
FAR = 100.0
"""Factor to the nominal values from which on it is a unit's: nobody guesses so badly."""
ALIKE = 3.0
"""Ratio of such factors up to which they are one: guesses are right to 40 percent or so."""
_INERTIA = dimension_of("kg m^2")
ROUNDING = 1e-9
"""Share of its terms below which a balance of inertias is rounding."""


@frozen
class Verdict:
    """What the gate says: reasons to turn an estimate away, and mere doubts."""

    faults: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __add__(self, other: Verdict) -> Verdict:
        return Verdict(self.faults + other.faults, self.doubts + other.doubts)


def passed(estimate: Estimate, verdict: Verdict) -> Estimate:
    """Return an estimate as the gate leaves it; an answer that was none before stays none."""
    told = (*verdict.faults, *verdict.doubts)
    status = estimate.status
    if verdict.faults and status == "ok":
        status = "rejected"
    new = tuple(text for text in told if text not in estimate.warnings)
    lead = len(estimate.suspects) > 0  # its sentence says what to do, and stays first
    warnings = (*estimate.warnings[:lead], *new, *estimate.warnings[lead:])
    return replace(estimate, status=status, warnings=warnings)


def data(checks: Sequence[Check]) -> Verdict:
    """Judge an answer by what the data showed before any model."""
    grave = [c for c in checks if c.verdict == "warning" and c.check in CONTRADICTING]
    return Verdict(faults=tuple(f"the data say otherwise: {check}" for check in grave))


def seen_first(estimate: Estimate, checks: Sequence[Check]) -> Estimate:
    """Return an estimate that was turned away, what single channels show by themselves first.

    A suspect can but say that the gain of a dead sensor is 1e-19.
    """
    if estimate.status == "ok":
        return estimate
    found = [str(c) for c in checks if c.check in SILENT and c.verdict == "warning"]
    others = [w for w in estimate.warnings if not any(text in w for text in found)]
    told = [f"before any suspect, see to {text}" for text in found]
    return replace(estimate, warnings=(*told, *others))


def _judge(name: str, size: float, std: float, text: str) -> Verdict:
    """Judge a quantity that should not be negative: `size` below zero, by `std`."""
    if size >= 0:
        return Verdict()
    if size < -SURE * std:
        return Verdict(
            faults=(
                f"{text}: no machine has that; see the suspects and the signs, "
                f"units and columns of the channels beside {name}",
            )
        )
    return Verdict(
        doubts=(f"{text}, though within {SURE:g} deviations of what a machine can have",)
    )


def _sure(verdict: Verdict) -> Verdict:
    """Leave out doubts: of a balance of inertias noise says nothing that a user could act on."""
    return Verdict(verdict.faults)


def physical(model: Model, estimate: Estimate) -> Verdict:
    """Judge whether the values of an estimate can be a machine's."""
    fixed = {v.name: v.value for v in estimate.parameters if v.fixed}
    free = [v for v in estimate.parameters if not v.fixed]
    if not all(np.isfinite([v.value, v.std if v.std is not None else 0.0]).all() for v in free):
        return Verdict()
    total = _signs(model, (*estimate.parameters, *estimate.derived)) + _one_scale(model, free)
    reduced = model.substitute(fixed)
    found = _base(reduced, free, estimate.covariance)
    if found is None:
        return total
    base, covariance = found
    total += _positive_sums(reduced, base, covariance)
    if reduced.linear is not None and not _negative(total):
        total += _inertia(reduced, reduced.linear, base, covariance)
    return total


def _one_scale(model: Model, free: Sequence[Value]) -> Verdict:
    """Doubt inertias and stiffnesses that are all as many times what the model's author expected.

    So they come out where all positions, or all forces, are in another unit: every balance of
    forces holds as well.
    """
    ratios = []
    for value in free:
        powers, nominal = dict(dimension_of(value.unit).powers), model.nominal.get(value.name)
        inertia_or_stiffness = (
            powers.get("kg", 0) == 1
            and powers.get("m", 0) in (0, 2)
            and powers.get("s", 0) in (0, -2)
        )
        if inertia_or_stiffness and nominal and value.value:
            ratios.append(abs(value.value / nominal))
    if len(ratios) < 2 or max(ratios) > ALIKE * min(ratios):
        return Verdict()
    middle = float(np.exp(np.mean(np.log(ratios))))
    if 1 / FAR < middle < FAR:
        return Verdict()
    return Verdict(
        doubts=(
            f"all inertias and stiffnesses are about {middle:.2g} times their nominal values: so "
            "they come out where all positions, or all forces, are in another unit than "
            "[channels] says; look the units up",
        )
    )


def _negative(verdict: Verdict) -> bool:
    """Tell whether something was said already: one reason is enough."""
    return bool(verdict.faults)


def _signs(model: Model, values: Sequence[Value]) -> Verdict:
    """Judge parameters that the model declares positive."""
    positive = {p.name for p in model.parameters if p.positive}
    total = Verdict()
    for v in {v.name: v for v in reversed(values)}.values():
        if v.name in positive and np.isfinite(v.value) and not v.fixed:
            text = f"{v.name} = {v.value:.6g} {v.unit}, which the model declares positive"
            size = v.value if v.value else -1e-300
            total += _judge(v.name, size, float(v.std or 0.0), text)
    return total


def _base(
    reduced: Model, free: Sequence[Value], covariance: Floats
) -> tuple[Floats, Floats] | None:
    """Return base parameters and their covariance, from physical or base ones."""
    found: Mapping[str, float] = {v.name: v.value for v in free}
    count = len(free)
    if len(covariance) < count:
        return None
    own = np.nan_to_num(covariance[:count, :count])
    names = [v.name for v in free]
    if {*reduced.parameter_names} == {*names}:
        order = [names.index(name) for name in reduced.parameter_names]
        values = np.array([found[name] for name in reduced.parameter_names])
        slopes = reduced.base_jacobian(values)
        return reduced.base_values(values), slopes @ own[np.ix_(order, order)] @ slopes.T
    if {*reduced.base.names} == {*names}:
        order = [names.index(name) for name in reduced.base.names]
        return np.array([found[n] for n in reduced.base.names]), own[np.ix_(order, order)]
    return None


def _positive_sums(reduced: Model, base: Floats, covariance: Floats) -> Verdict:
    """Judge base parameters that are sums of products of positive parameters."""
    positive = np.array([p.positive for p in reduced.parameters], dtype=bool)
    total = Verdict()
    for index, (name, unit) in enumerate(zip(reduced.base.names, reduced.base.units, strict=True)):
        gathered = np.asarray(reduced.base.gather[index])
        used = reduced.monomials[gathered != 0]
        if (gathered >= 0).all() and (used[:, ~positive] == 0).all():
            text = f"{name} = {base[index]:.6g} {unit}, a sum of positive parameters"
            std = float(np.sqrt(max(covariance[index, index], 0.0)))
            total += _judge(name, float(base[index]) or -1e-300, std, text)
    return total


def _parts(reduced: Model, linear: LinearForm) -> tuple[Floats, Floats]:
    """Return M and G by base parameter, (base + 1, row, coordinate); the last part is known."""
    count = len(reduced.base.names)
    kept = {monomial: b for b, monomial in enumerate(reduced.base.kept)}
    kept |= {int(k): count for k in np.flatnonzero(~reduced.monomials.any(axis=1))}
    shape = (count + 1, linear.rows, linear.coordinates)
    mass, gyroscopic = np.zeros(shape), np.zeros(shape)
    table = linear.stiffness
    part = np.array([kept.get(m, -1) for m in range(linear.monomials)])[table.monomial]
    for number, (order, factor, _) in enumerate(table.kinds):
        chosen = (table.kind == number) & (part >= 0)
        where = part[chosen], table.row[chosen], table.column[chosen]
        if order == 2 and not factor.free_symbols:
            np.add.at(mass, where, table.coefficient[chosen] * speed_factor(factor, 0.0))
        elif order == 1 and factor == symbol("Omega"):
            np.add.at(gyroscopic, where, table.coefficient[chosen])
    return mass, gyroscopic


def _inertia(reduced: Model, linear: LinearForm, base: Floats, covariance: Floats) -> Verdict:
    """Judge M, which is positive, and G, which no polar inertia makes larger than M allows."""
    mass, gyroscopic = _parts(reduced, linear)
    base, covariance = np.append(base, 1.0), np.pad(covariance, (0, 1))
    whole = np.tensordot(base, mass, 1)
    if linear.rows != linear.coordinates or not whole.any():
        return Verdict()
    balance = force_balance(reduced, whole)
    if balance.faults:
        return Verdict()  # sums of equations, or scaled: no energy to see
    # What has the sign of its inertia turned is not turned back: that is what is judged.
    rows, scales = balance.rows, np.abs(balance.scales)[:, None]
    mass, gyroscopic = mass[:, rows] / scales, gyroscopic[:, rows] / scales
    whole = np.tensordot(base, mass, 1)
    if np.abs(whole - whole.T).max() > ROUNDING * np.abs(whole).max():
        return Verdict()
    scale = np.sqrt(np.abs(np.diag(whole)))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    lowest = vectors[:, 0] / scale
    total = Verdict()
    if values[0] < -ROUNDING:
        slopes = np.einsum("i,bij,j->b", lowest, mass, lowest)
        std = float(np.sqrt(max(slopes @ covariance @ slopes, 0.0)))
        where = reduced.coordinates[int(np.abs(vectors[:, 0]).argmax())]
        total += _sure(_judge(where, float(values[0]), std, f"a negative inertia of {where}"))
    turning, drawn = np.tensordot(base, gyroscopic, 1), _drawn_coupling(reduced, gyroscopic)
    for i, j in zip(*np.nonzero(np.triu(np.abs(turning - turning.T) > 0)), strict=True):
        if not _by_inertia(reduced, (i, j), gyroscopic):
            continue
        sign = np.sign(turning[i, j] - turning[j, i])
        slopes = (
            mass[:, i, i] + mass[:, j, j] - sign * (gyroscopic[:, i, j] - gyroscopic[:, j, i]) / 2
        )
        size, terms = float(slopes @ base), float(np.abs(slopes * base).sum())
        if size < -ROUNDING * terms:
            std = float(np.sqrt(max(slopes @ covariance @ slopes, 0.0)))
            a, b = reduced.coordinates[i], reduced.coordinates[j]
            polar = abs(turning[i, j] - turning[j, i]) / 2
            text = (
                f"a polar inertia of {polar:.4g} about {a}, {b}, above the sum of the transverse "
                f"ones, {whole[i, i] + whole[j, j]:.4g}"
            )
            total += _sure(_judge(f"{a} and {b}", size, std, text))
        if sign * (drawn[i, j] - drawn[j, i]) < 0:
            slopes = sign * (gyroscopic[:, i, j] - gyroscopic[:, j, i]) / 2
            if np.count_nonzero(slopes) == 1:  # of a sum of inertias the sign may be either
                total += _backwards(reduced, (i, j), float(slopes @ base), slopes, covariance)
    return total


def _by_inertia(reduced: Model, pair: tuple[int, int], gyroscopic: Floats) -> bool:
    """Tell whether what couples two coordinates by the speed is a polar inertia.

    Between tilts it is; between displacements, where something in kg m^2 stands there. What else
    couples these, as a seal does, no inertia bounds, and it may have either sign.
    """
    if all(reduced.units[reduced.coordinates[k]] == "rad" for k in pair):
        return True
    inertial = [dimension_of(p.unit) == _INERTIA for p in reduced.parameters]
    there = (gyroscopic[:-1, pair[0], pair[1]] != 0) | (gyroscopic[:-1, pair[1], pair[0]] != 0)
    monomials = reduced.monomials[list(reduced.base.kept)][there]
    return bool(there.any() and (monomials[:, inertial] > 0).any(axis=1).all())


def _drawn_coupling(reduced: Model, gyroscopic: Floats) -> Floats:
    """Return G at the nominal values, whose sense the model's author gave it; zero without any."""
    nominal = reduced.nominal
    if not set(reduced.parameter_names) <= set(nominal):
        return np.zeros(gyroscopic.shape[1:])
    base = reduced.base_values([nominal[name] for name in reduced.parameter_names])
    return np.asarray(np.tensordot(np.append(base, 1.0), gyroscopic, 1))


def _backwards(
    reduced: Model, pair: tuple[int, int], polar: float, slopes: Floats, covariance: Floats
) -> Verdict:
    """Judge a gyroscopic coupling against the sense that the model gives it: turned backwards."""
    std = float(np.sqrt(max(float(slopes @ covariance @ slopes), 0.0)))
    if polar <= SURE * std:
        return Verdict()
    a, b = (reduced.coordinates[i] for i in pair)
    return Verdict(
        faults=(
            f"a polar inertia of {-polar:.4g} about {a}, {b}, against the sense of rotation: no "
            f"machine has that; the speed is stated backwards, or "
            "two axes are exchanged, or one is upside down",
        )
    )


def prediction(estimate: Estimate, noise: Mapping[str, float]) -> Verdict:
    """Judge how an answer predicts its own record; `noise` is the share that noise explains."""
    total = Verdict()
    for name, found in estimate.prediction.items():
        if found is None:
            continue
        explained = float(np.hypot(UNPREDICTED, 2 * noise.get(name, 0.0)))
        if found.relative_error > explained:
            total += Verdict(
                faults=(
                    f"{name} is predicted with an error of {100 * found.relative_error:.3g} %, of "
                    f"which noise explains {100 * noise.get(name, 0.0):.3g} %: the equations do "
                    "not describe this record; check columns, units, signs and the period",
                )
            )
    return total


def residual(cost: float, expected: Expectation) -> Verdict:
    """Judge the residual of the equations by its scatter over periods, as a likelihood its misfit.

    Deviations are made of that scatter, and hold nothing where the residual is larger.
    """
    if cost <= expected.mean + COMMON * np.sqrt(expected.variance):
        return Verdict()  # and nothing that knows distributions has to be loaded
    chance = expected.p_value(cost)
    if chance >= DOUBTFUL:
        return Verdict()
    times = np.sqrt(cost / expected.mean)
    text = (
        f"the equations are off by {times:.3g} times what noise leaves of them (p = {chance:.1e}): "
    )
    if chance >= REJECTED:
        return Verdict(
            doubts=(f"{text}doubtful; for a linear model see what ml says of this record",)
        )
    return Verdict(
        faults=(
            f"{text}they do not describe this record, and no deviation holds; for a linear model "
            "ml names what is missing, for another one look at the terms (friction, a stiffening "
            "spring, play), the units and the signs",
        )
    )


def noise_bias(names: Sequence[str], bias: Floats, std: Floats) -> Verdict:
    """Judge what noise in the measured motion does to an answer, by its deviations."""
    known = (std > 0) & np.isfinite(bias)
    share = np.where(known, bias, 0.0) / np.where(known, std, 1.0)
    worst = int(np.abs(share).argmax())
    if abs(share[worst]) <= MOVED:
        return Verdict()
    text = (
        f"noise in the measured motion biases {names[worst]} by about {share[worst]:+.2g} of its "
        "deviations, which do not hold that: use ml where the model is linear, record longer, or "
        "excite more"
    )
    if abs(share[worst]) <= BIASED:
        return Verdict(doubts=(text,))
    return Verdict(faults=(text,))


def agreement(
    names: Sequence[str], halves: Floats, std: Floats, turning: Collection[str] = ()
) -> Verdict:
    """Judge whether halves of the record agree; `halves` (half, parameter) are deviations.

    `turning`: names of what turns with the rotor, and so with the angle that was stated.
    """
    known = std > 0
    apart = np.abs(halves[0] - halves[1])[known] / (2 * std[known])
    if not apart.size or not np.isfinite(apart).all() or apart.max() <= APART:
        return Verdict()
    worst = names[np.flatnonzero(known)[int(apart.argmax())]]
    look = (
        "the speed is not the one stated, or wanders; state it to the last digit, or measure the "
        "angle (encoder or keyphasor)"
        if worst in turning
        else "something changed while it was taken; look for settling, drift or a knock (rotorid "
        "inspect), or identify the halves apart"
    )
    return Verdict(
        faults=(
            f"the halves of the record differ by {apart.max():.3g} deviations in {worst}: {look}",
        )
    )
