"""The gate that every estimate passes: can it be a machine, and does the record agree with itself.

An answer is turned away (``rejected``) where it is no machine (a negative mass, a polar inertia
above the sum of the transverse ones, a negative value of what the model calls positive), where it
does not predict its own record, where the residual of its equations is no noise, and where blocks
of the record contradict one another.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from rotorid.answer.derived import base_of, deviation
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import judge
from rotorid.answer.parts import DOUBTFUL, Value
from rotorid.core.distributions import Expectation
from rotorid.core.notes import Note, Severity
from rotorid.core.units import dimension_of
from rotorid.core.values import Floats
from rotorid.models import Model
from rotorid.models.linear_form import LinearForm
from rotorid.models.structure import force_balance

REJECTED = 1e-6  # the p-value below which the data reject the model
SURE = 3.0
"""Deviations by which a value is beyond what a machine can have before it is turned away: nearer,
noise alone may have put it there, and a warning says so."""
UNPREDICTED = 0.5
"""Relative error of a prediction, beyond its noise, that turns an answer away: three quarters of
the power of a force are then explained at most."""
APART = 6.0
"""Deviations by which halves of a record may differ: over a hundred parameters chance reaches 4,
and deviations from a dozen periods are themselves a fifth off."""
COMMON = 2.0  # deviations of a cost from its mean that noise leaves in some per cent of all records
MOVED, BIASED = 1.0, 10.0
"""Deviations of a bias from which on it is told, and from which on the answer is turned away: one
leaves 83 % of intervals right where 95 % are promised; halves of one record tell a bias to a factor
of three, and the second is beyond that."""
FAR = 100.0  # factor to the nominal values from which on it is a unit's: nobody guesses so badly
ALIKE = 3.0  # ratio of such factors up to which they are one: guesses are right to 40 percent or so
_INERTIA = dimension_of("kg m^2")
ROUNDING = 1e-9  # share of its terms below which a balance of inertias is rounding


def _negative(about: str, size: float, std: float, text: str, *on: str) -> Iterator[Note]:
    """Judge a quantity that should not be negative, and zero hardly: its size, by `std`."""
    size = size or -1e-300
    if size < -SURE * std:
        beside = " and ".join(on)
        cure = f"see the suspects and the signs, units and columns of the channels beside {beside}"
        yield Note(about, "rejects", f"{text}: physically impossible", cure, on=on)
    elif size < 0:
        near = f"{text}, though within {SURE:g} deviations of what a machine can have"
        yield Note(about, "doubts", near, on=on)


def physical(model: Model, estimate: Estimate) -> list[Note]:
    fixed = {v.name: v.value for v in estimate.parameters if v.fixed}
    free = [v for v in estimate.parameters if not v.fixed]
    if not all(np.isfinite([v.value, v.std if v.std is not None else 0.0]).all() for v in free):
        return []
    told = [*_signs(model, (*estimate.parameters, *estimate.derived)), *_one_scale(model, free)]
    reduced, names = model.substitute(fixed), {v.name for v in free}
    physical, covariance = {*reduced.parameter_names} == names, np.nan_to_num(estimate.covariance)
    found = base_of(reduced, estimate, physical=physical)
    if found is None or len(covariance) != found[1].shape[1]:
        return told
    if not physical and {*reduced.base.names} != names:
        return told
    base, slopes = found
    covariance = slopes @ covariance @ slopes.T
    alone = {note.on for note in told}
    told += (n for n in _positive_sums(reduced, base, covariance) if n.on not in alone)
    if reduced.linear is not None and judge(told) == "ok":  # one reason is enough
        # Of a balance of inertias noise says nothing that a user could act on.
        omega = 2 * np.pi * max(estimate.lines_hz, default=0.0)
        inertia = _inertia(reduced, reduced.linear, base, covariance, omega)
        told += [note for note in inertia if note.severity == "rejects"]
    return told


def _one_scale(model: Model, free: Sequence[Value]) -> Iterator[Note]:
    """Doubt inertias and stiffnesses that are all as many times what the model's author expected.

    So they come out where all positions, or all forces, are in another unit: every balance of
    forces holds as well.
    """
    ratios = []
    for value in free:
        powers, nominal = dict(dimension_of(value.unit).powers), model.nominal.get(value.name)
        kg, m, s = (powers.get(unit, 0) for unit in ("kg", "m", "s"))
        if kg == 1 and m in (0, 2) and s in (0, -2) and nominal and value.value:
            ratios.append(abs(value.value / nominal))
    if len(ratios) < 2 or max(ratios) > ALIKE * min(ratios):
        return
    middle = float(np.exp(np.mean(np.log(ratios))))
    if not 1 / FAR < middle < FAR:
        text = (
            f"all inertias and stiffnesses are about {middle:.2g} times their nominal values: so "
            "they come out where all positions, or all forces, are in another unit than "
            "[channels] says"
        )
        yield Note("scale", "doubts", text, "look the units up", value=middle, unit="1")


def _signs(model: Model, values: Sequence[Value]) -> Iterator[Note]:
    positive = {p.name for p in model.parameters if p.positive}
    for v in {v.name: v for v in reversed(values)}.values():
        if v.name in positive and np.isfinite(v.value) and not v.fixed:
            if not v.value:
                yield Note("positive", "doubts", f"{v.name} is held at its limit, 0", on=(v.name,))
                continue
            text = f"{v.name} = {v.value:.6g} {v.unit}, which the model declares positive"
            yield from _negative("positive", v.value, float(v.std or 0.0), text, v.name)


def _positive_sums(reduced: Model, base: Floats, covariance: Floats) -> Iterator[Note]:
    positive = np.array([p.positive for p in reduced.parameters], dtype=bool)
    for index, (name, unit) in enumerate(zip(reduced.base.names, reduced.base.units, strict=True)):
        gathered = np.asarray(reduced.base.gather[index])
        used = reduced.monomials[gathered != 0]
        if (gathered >= 0).all() and (used[:, ~positive] == 0).all():
            text = f"{name} = {base[index]:.6g} {unit}, a sum of positive parameters"
            std = float(np.sqrt(max(covariance[index, index], 0.0)))
            yield from _negative("positive", float(base[index]), std, text, name)


def _parts(reduced: Model, linear: LinearForm, base: Floats, omega: float) -> tuple[Floats, Floats]:
    """Return M and G by base parameter, (base + 1, row, coordinate); the last part is known.

    An inertia whose force is rounding of the forces in its row, at the fastest motion, is none.
    """
    parts = np.zeros((len(base), linear.monomials))
    parts[np.arange(len(base) - 1), list(reduced.base.kept)] = 1.0
    parts[-1, ~reduced.monomials.any(axis=1)] = 1.0
    found = linear.weighed(parts, omega)
    mass, damping, gyroscopic, stiffness = found.M, found.D, found.G, found.K
    if omega > 0:  # of natural frequencies alone there are no lines
        acting = omega**2 * (np.abs(mass) + np.abs(gyroscopic)) + omega * np.abs(damping)
        forces = np.tensordot(np.abs(base), acting + np.abs(stiffness), 1)
        inert = omega**2 * np.abs(np.tensordot(base, mass, 1))
        mass[:, inert < ROUNDING * forces.sum(axis=1, keepdims=True)] = 0.0
    return mass, gyroscopic


def _inertia(
    reduced: Model, linear: LinearForm, base: Floats, covariance: Floats, omega: float
) -> Iterator[Note]:
    """Judge M, which is positive, and G, which no polar inertia makes larger than M allows."""
    base, covariance = np.append(base, 1.0), np.pad(covariance, (0, 1))
    mass, gyroscopic = _parts(reduced, linear, base, omega)
    whole = np.tensordot(base, mass, 1)
    if linear.rows != linear.coordinates or not whole.any():
        return
    balance = force_balance(reduced, whole)
    if balance.faults:
        return  # sums of equations, or scaled: no energy to see
    # What has the sign of its inertia turned is not turned back: that is what is judged.
    rows, scales = balance.rows, np.abs(balance.scales)[:, None]
    mass, gyroscopic = mass[:, rows] / scales, gyroscopic[:, rows] / scales
    whole = np.tensordot(base, mass, 1)
    if np.abs(whole - whole.T).max() > ROUNDING * np.abs(whole).max():
        return
    scale = np.sqrt(np.abs(np.diag(whole)))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(whole / np.outer(scale, scale))
    lowest = vectors[:, 0] / scale
    if values[0] < -ROUNDING:
        slopes = np.einsum("i,bij,j->b", lowest, mass, lowest)
        std = deviation(slopes, covariance)
        where = reduced.coordinates[int(np.abs(vectors[:, 0]).argmax())]
        text = f"a negative inertia of {where}"
        yield from _negative("inertia", float(values[0]), std, text, where)
    yield from _polar(reduced, mass, gyroscopic, base, covariance)


def _polar(
    reduced: Model, mass: Floats, gyroscopic: Floats, base: Floats, covariance: Floats
) -> Iterator[Note]:
    """Judge G by M, and by the sense that the model's author gave it."""
    turning = (gyroscopic - gyroscopic.transpose(0, 2, 1)) / 2
    # G at the nominal values, whose sense the model's author gave it; zero without any.
    nominal = [reduced.nominal.get(name, np.nan) for name in reduced.parameter_names]
    author = np.append(reduced.base_values(nominal), 1.0)
    drawn = np.nan_to_num(np.tensordot(author, turning, 1)) * bool(np.isfinite(author).all())
    for i, j in np.argwhere(np.triu(np.tensordot(base, turning, 1)) != 0).tolist():
        if not _by_inertia(reduced, (i, j), gyroscopic):
            continue
        polar, a, b = turning[:, i, j], reduced.coordinates[i], reduced.coordinates[j]
        polar = polar * np.sign(polar @ base)
        transverse = mass[:, i, i] + mass[:, j, j]
        slopes, size = transverse - polar, float(polar @ base)
        if slopes @ base < -ROUNDING * np.abs(slopes * base).sum():
            text = (
                f"a polar inertia of {size:.4g} about {a}, {b}, above the sum of the transverse "
                f"ones, {base @ transverse:.4g}"
            )
            std = deviation(slopes, covariance)
            yield from _negative("inertia", float(slopes @ base), std, text, a, b)
        # Of a sum of inertias the sign may be either.
        backwards = drawn[i, j] * (turning[:, i, j] @ base) < 0 and np.count_nonzero(polar) == 1
        if backwards and size > SURE * deviation(polar, covariance):
            text = (
                f"a polar inertia of {-size:.4g} about {a}, {b}, against the sense of rotation: "
                "physically impossible"
            )
            cure = "the speed is stated backwards, or two axes are exchanged, or one is upside down"
            yield Note("inertia", "rejects", text, cure, on=(a, b))


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


def prediction(estimate: Estimate, noise: Mapping[str, float]) -> Iterator[Note]:
    """Judge how an answer predicts its own record; `noise` is the share that noise explains."""
    for name, found in estimate.prediction.items():
        if found is None:
            continue
        explained = float(np.hypot(UNPREDICTED, 2 * noise.get(name, 0.0)))
        if found.relative_error > explained:
            text = (
                f"{name} is predicted with an error of {100 * found.relative_error:.3g} %, of "
                f"which noise explains {100 * noise.get(name, 0.0):.3g} %: the equations do not "
                "describe this record"
            )
            cure = "check columns, units, signs and the period"
            error = found.relative_error
            yield Note("prediction", "rejects", text, cure, on=(name,), value=error, unit="1")


def residual(cost: float, expected: Expectation) -> Iterator[Note]:
    """Judge the residual of the equations by its scatter over periods, as a likelihood its misfit.

    Deviations are made of that scatter, and hold nothing where the residual is larger.
    """
    if cost <= expected.mean + COMMON * np.sqrt(expected.variance):
        return  # and nothing that knows distributions has to be loaded
    chance = expected.p_value(cost)
    if chance >= DOUBTFUL:
        return
    times = np.sqrt(cost / expected.mean)
    text = f"the equations are off by {times:.3g} times what noise leaves of them "
    text += f"(p = {chance:.1e}): "
    if chance >= REJECTED:
        cure = "for a linear model see what ml says of this record"
        yield Note("residual", "doubts", f"{text}doubtful", cure, value=float(times), unit="1")
        return
    cure = (
        "for a linear model ml names what is missing, for another one look at the terms (friction, "
        "a stiffening spring, play), the units and the signs"
    )
    text += "they do not describe this record, and no deviation holds"
    yield Note("residual", "rejects", text, cure, value=float(times), unit="1")


def noise_bias(names: Sequence[str], bias: Floats, std: Floats) -> Iterator[Note]:
    known = (std > 0) & np.isfinite(bias)
    share = np.where(known, bias, 0.0) / np.where(known, std, 1.0)
    worst = int(np.abs(share).argmax())
    if abs(share[worst]) <= MOVED:
        return
    text = (
        f"noise in the measured motion biases {names[worst]} by about {share[worst]:+.2g} of its "
        "deviations, which do not hold that: use ml where the model is linear, record longer, or "
        "excite more"
    )
    severity: Severity = "doubts" if abs(share[worst]) <= BIASED else "rejects"
    yield Note("bias", severity, text, on=(names[worst],), value=float(share[worst]), unit="1")


def agreement(
    names: Sequence[str], halves: Floats, std: Floats, turning: Collection[str] = ()
) -> Iterator[Note]:
    """Judge whether halves of the record agree; `halves` (half, parameter) are deviations.

    `turning`: names of what turns with the rotor, and so with the angle that was stated.
    """
    known = std > 0
    apart = np.abs(halves[0] - halves[1])[known] / (2 * std[known])
    if not apart.size or not np.isfinite(apart).all() or apart.max() <= APART:
        return
    worst = names[np.flatnonzero(known)[int(apart.argmax())]]
    look = (
        "the speed is not the one stated, or wanders; state it to the last digit, or measure the "
        "angle (encoder or keyphasor)"
        if worst in turning
        else "something changed while it was taken; look for settling, drift or a knock (rotorid "
        "inspect), or identify the halves apart"
    )
    text = f"the halves of the record differ by {apart.max():.3g} deviations in {worst}: {look}"
    yield Note("halves", "rejects", text, on=(worst,), value=float(apart.max()), unit="1")
