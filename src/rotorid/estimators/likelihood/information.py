"""What the records tell without their noise, and other answers that fit as well.

Where the excitation leaves something at rest, the record fits with more than one answer, and
neither rank nor condition number at the estimate shows it: noise, or a resonance that the estimate
puts on a line, fills the Jacobian (theory, section 7). Three questions are asked instead.

- Would the noise-free response to the measured forces give the stated deviations, at the answer
  and about the start? If they are much smaller, noise was taken for information.
- Do other starts end at another answer with as low a cost, or do the equations have one?
- Does the cost rise over the stated deviations as they say? Along the bent valley of a weakly
  excited rotor other parameters leave their intervals long before the cost does: their deviations
  are widened to what the cost says.

Further starts cost little where the record informs all unknowns: they join the way of the first
after one or two stages of the homotopy. Three are always tried, eight where the deviations
predicted at the start are a tenth of the values or more, and the last question is asked there too;
eight as well where chance seldom leaves such a cost.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.inference import Inference, along_relations, infer
from rotorid.estimators.likelihood.mirrors import APART, CLOSE, Mirrors, exchanged
from rotorid.estimators.likelihood.problem import Point, Problem
from rotorid.estimators.likelihood.response import response, responses
from rotorid.estimators.likelihood.search import AGREE, further_starts
from rotorid.estimators.likelihood.solver import STAGES, Solution, elsewhere, settle
from rotorid.estimators.likelihood.valley import ENDLESS, Valley, explore
from rotorid.frozen import frozen
from rotorid.linalg import whole_svd
from rotorid.record import Floats

TAKEN = 3.0
"""Stated deviations so many times smaller than the noise-free response gives are noise."""
TAKEN_ABOUT = 10.0
"""The same about the start, where a machine that differs may be that much less informed."""
SLIGHT = 0.01
"""Predicted deviation, as a share of the value, up to which `TAKEN_ABOUT` is asked instead."""
BY_NOISE = 0.3
"""Part of the information along a direction that the noise of the inputs accounts for on average,
from which on it may as well be all of it: of a dozen lines chance makes it three times as much."""
OWED = 0.1
"""Share of an unknown's variance along such directions from which on it is one of theirs."""
LOOSE = 0.1
"""Predicted deviation, as a share of the value, from which other answers are looked for."""
UNLIKELY = 0.01
"""Below this p-value a minimum may be one of several: of a hundred good records, one is asked."""
ALWAYS = 3
"""Further starts that are always tried: those of an informed record join the first way soon."""
LATE = STAGES[-3:]
"""Stages of the starts beyond those: with large errors granted every way may lead to one minimum
(of a record with a hundred times the noise 27 of 28 did), and the lowest be found without them."""
FAR = 3.0
"""A start off by more than this factor says nothing of the machine: the answer stands for it."""
AROUND = 8
"""Starts about the given one at which the noise-free response is asked, beside it."""


@frozen
class Doubt:
    """Why a minimum is not the answer.

    Parameters
    ----------
    noise : sequence of str
        Unknowns whose stated deviations are noise taken for information.
    bent : sequence of str
        Unknowns whose stated deviations do not hold: the cost is no parabola over them.
    alternatives : sequence of Point
        Other minima that fit as well.
    exchanges : sequence of str
        Which parts change places in some of them, and what would tell them apart.
    """

    noise: tuple[str, ...] = ()
    bent: tuple[str, ...] = ()
    alternatives: tuple[Point, ...] = ()
    exchanges: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.noise or self.bent or self.alternatives)


def noise_free(point: Point) -> Point:
    """Return the problem at a point where the sensors read just what the forces make of it."""
    silent = []
    for at in point.records:
        clean = copy.copy(at.problem)
        clean.data = response(at)
        silent.append(at.with_data(clean))
    quiet = replace(point.problem, likelihoods=tuple(at.problem for at in silent))
    return Point(quiet, point.unknowns, silent, point.known)


def predicted_deviations(problem: Problem, unknowns: Floats) -> Floats:
    """Return the deviations that the noise-free response gives, infinite where it gives none."""
    try:
        return _deviations_of(_predicted_root(problem.at(unknowns))[0])
    except np.linalg.LinAlgError:
        return np.full(len(problem.layout.free), np.inf)


def _deviations_of(root: Floats) -> Floats:
    """Return the deviations of a root of the covariance, infinite where it is beyond numbers."""
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.sqrt((root**2).sum(axis=1))
    return np.where(np.isfinite(found), found, np.inf)


def _predicted_root(point: Point, weights: Sequence[Floats] = ()) -> tuple[Floats, Floats]:
    """Return a root of the covariance that the noise-free response gives, and its unit, (free,).

    `weights`: of the rows of each record, 1 without them.
    """
    scaled, scale, basis = along_relations(noise_free(point), point.problem.exact)
    rows = np.concatenate([np.zeros(0), *weights])
    scaled[: len(rows)] *= rows[:, None]
    _, values, right = whole_svd(scaled)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        spread = right.T / np.maximum(values, 1e-14 * values.max(initial=0.0))
        return scale[:, None] * (basis @ spread), scale


def informed_by_noise(point: Point) -> tuple[Floats, NDArray[np.bool_]]:
    """Return predicted deviations, and tell which owe to noise that drives nothing, (free,).

    Information is quadratic in the inputs: that of the measured ones is that of the true ones and,
    on average, that of their noise by itself. Where it seems to be noise it is asked again with as
    much of each line as the readings bear out.
    """
    none = np.zeros(len(point.problem.layout.free), dtype=bool)
    try:
        root, scale = _predicted_root(point)
    except np.linalg.LinAlgError:
        return np.full(len(none), np.inf), none
    predicted = _deviations_of(root)
    try:
        noise = _by_noise(point)
        told = _owed(noise, root, scale)
        if told.any():
            weights = _borne_out(point)
            weighed = [n * w[:, None] for n, w in zip(noise, weights, strict=True)]
            told &= _owed(weighed, *_predicted_root(point, weights))
    except np.linalg.LinAlgError:
        return predicted, none
    return predicted, told


def _owed(noise: Sequence[Floats], root: Floats, scale: Floats) -> NDArray[np.bool_]:
    """Tell which deviations owe to some noise, its Jacobian given for each record, (free,)."""
    if not np.isfinite(root).all():
        return np.zeros(len(root), dtype=bool)
    rows = [part.reshape(-1, len(root)) for part in noise]
    _, share, along = whole_svd(np.concatenate([np.zeros((0, len(root))), *rows]) @ root)
    power = (root / scale[:, None] @ along.T) ** 2
    owed = power[:, share**2 > BY_NOISE].sum(axis=1)
    return np.asarray(owed > OWED * power.sum(axis=1))


def _borne_out(point: Point) -> list[Floats]:
    """Return for each record the measured readings over the predicted ones, at most 1, (row,).

    Forces measured with noise, on a line beside a resonance without damping, predict a thousand
    times the motion that was there. That informs of nothing, for or against: nobody read it.
    """
    found = []
    for at in point.records:
        likelihood = at.problem
        first = likelihood.inputs - likelihood.indirect
        noise = np.maximum(np.linalg.norm(likelihood.factor, axis=2), 1e-300)
        measured, predicted = (
            np.linalg.norm((data / noise)[:, first:], axis=1)
            for data in (likelihood.data, response(at))
        )
        share = measured / np.maximum(np.maximum(predicted, measured), 1e-300)
        found.append(np.repeat(share, 2 * likelihood.equations))
    return found


def _by_noise(point: Point) -> list[Floats]:
    """Return the Jacobians that the noise of the inputs would make by itself, (input, row, free).

    Information is quadratic in the inputs: that of true inputs and their noise is the sum of both.
    """
    free, affine = point.problem.layout.free, point.problem.affine
    still = point.unknowns.copy()
    still[affine] = 0.0  # what turns is no noise
    found = []
    for at in point.records:
        likelihood, count = at.problem, at.forces
        driven = copy.copy(likelihood)
        driven.load = np.zeros_like(likelihood.load)
        # What laws with other constants add comes of the samples, not of this noise.
        driven.calibration = replace(likelihood.calibration, reread=())
        quiet, idle = driven.evaluate(still, like=at), _idle_share(at, count)
        every = []
        for column in range(count):
            driven = copy.copy(driven)
            driven.data = np.zeros_like(likelihood.data)
            driven.data[:, :count] = idle * likelihood.factor[:, :count, column]
            every.append(quiet.with_data(driven))
        parts = np.zeros((count, likelihood.lines * 2 * likelihood.equations, len(free)))
        for part, pushed, data in zip(parts, every, responses(every), strict=True):
            driven = copy.copy(pushed.problem)
            driven.data = data
            part[:] = quiet.with_data(driven).jacobian()[:, free]
        parts[:, :, np.isin(free, affine)] = 0.0
        found.append(parts)
    return found


def _idle_share(at: Evaluation, count: int) -> Floats:
    """Return the deviation of what drives nothing over that of the inputs' noise, (line, input).

    In closed loop most of it drives the machine like any force, and informs. What does not drive is
    in the equation errors, so that it is no more than V allows: ``V - s^2 b b^H`` stays positive,
    b the input's column, up to ``s^2 = 1 / (b^H V^-1 b)``.
    """
    columns = at.whitened_columns()[:, :, :count]
    allowed = 1 / np.maximum((np.abs(columns) ** 2).sum(axis=1), 1e-300)
    noise = (np.abs(at.problem.factor[:, :count]) ** 2).sum(axis=2)
    return np.asarray(np.sqrt(allowed / np.maximum(np.maximum(noise, allowed), 1e-300)))


def questioned(
    problem: Problem,
    start: Floats,
    solution: Solution,
    inference: Inference,
    mirrors: Mirrors | None = None,
) -> tuple[Solution, Inference, Doubt]:
    """Return the lowest minimum that is found, how far it may be off, and whether it is the answer.

    Further starts and the valley of the minimum itself may lead to a lower one, and so may the
    other places of hidden parts, where a prior tells them.
    """
    mirrors = mirrors or Mirrors(problem.layout)
    asked = _Asked.of(problem, start, solution, inference)
    unlikely = inference.expectation.p_value(solution.point.cost) < UNLIKELY
    others = _minima(problem, start, solution, unlikely or bool(asked.loose.any()))
    others = [mirrors.as_started(other) for other in others]
    others += [image.solution for image in mirrors.images(solution)]
    lower = _lower(others, solution)
    if lower is not None:
        others = [*(o for o in others if o is not lower), solution]
        solution, inference = lower, infer(lower.point, problem.exact)
        asked = _Asked.of(problem, start, solution, inference)
    valley = asked.valley(inference)
    lower = _lower([mirrors.as_started(end) for end in _bottom(valley)], solution)
    if lower is not None:
        others.append(solution)
        solution, inference = lower, infer(lower.point, problem.exact)
        asked = _Asked.of(problem, start, solution, inference)
        valley = asked.valley(inference)
    apart = _others(mirrors, solution, others, asked.stated, asked.told)
    doubt = asked.doubt(valley.wider)
    doubt = replace(doubt, alternatives=apart.alternatives, exchanges=apart.exchanges)
    covariance = inference.covariance * np.outer(valley.wider, valley.wider)
    return solution, replace(inference, covariance=covariance), doubt


def mirrored(mirrors: Mirrors, solution: Solution, inference: Inference) -> Doubt:
    """Return the other answers that the equations make of one."""
    stated = np.sqrt(np.diag(inference.covariance).clip(0))
    return _others(mirrors, solution, (), stated, ~inference.undetermined & (stated > 0))


def _others(
    mirrors: Mirrors,
    solution: Solution,
    others: Sequence[Solution],
    stated: Floats,
    told: NDArray[np.bool_],
) -> Doubt:
    """Return which of the mirror images and of other ends are other answers."""
    images = mirrors.images(solution)
    ends = [*(image.solution for image in images), *others]
    apart = tuple(_apart(ends, solution, stated, told))
    layout, x = mirrors.layout, solution.point.unknowns
    parts = tuple(
        exchanged(layout, image.exchange, x)
        for image in images
        if image.exchange and _distance(image.solution.point, solution.point, stated, told) > APART
    )
    return Doubt(alternatives=apart, exchanges=parts if apart else ())


def _bottom(valley: Valley) -> list[Solution]:
    """Return the minimum near the lowest point of a valley."""
    lowest = valley.lowest
    try:
        return [settle(lowest.problem, lowest.unknowns)] if valley.falls else []
    except np.linalg.LinAlgError:
        return []


def _lower(others: Sequence[Solution], solution: Solution) -> Solution | None:
    """Return the lowest of other minima where it is lower than the solution."""
    cost = solution.point.cost
    below = [o for o in others if o.converged and o.point.cost < cost * (1 - AGREE) - 1e-3]
    return min(below, key=lambda o: o.point.cost, default=None)


@frozen
class _Asked:
    """A minimum with what its deviations are held against; arrays of shape (free,).

    `told`: unknowns with a deviation; `rigid`: those among them on which more depends than a load;
    `loose`: those whose deviation, stated or expected of the start, is a tenth of the value.
    """

    problem: Problem
    start: Floats
    point: Point
    stated: Floats
    told: NDArray[np.bool_]
    rigid: NDArray[np.bool_]
    loose: NDArray[np.bool_]

    @classmethod
    def of(
        cls, problem: Problem, start: Floats, solution: Solution, inference: Inference
    ) -> _Asked:
        point, free = solution.point, problem.layout.free
        stated = np.sqrt(np.diag(inference.covariance).clip(0))
        told = ~inference.undetermined & (stated > 0)
        value = np.abs(point.unknowns[free])
        about = _about(problem, start, point.unknowns, 0)[0]
        rigid = told & ~np.isin(free, problem.affine) & (value > 0)
        expected = predicted_deviations(problem, about)
        loose = rigid & ((expected > LOOSE * np.abs(about[free])) | (stated > LOOSE * value))
        return cls(problem, start, point, stated, told, rigid, loose)

    def valley(self, inference: Inference) -> Valley:
        """Look how far the answer may be off, where the record informs it loosely."""
        if not self.loose.any():
            return Valley(np.ones(len(self.stated)), self.point)
        return explore(self.point, inference, self.told)

    def doubt(self, wider: Floats) -> Doubt:
        """Ask whether noise was taken for information, and whether the deviations have an end."""
        problem, unknowns, stated = self.problem, self.point.unknowns, self.stated
        (predicted, owed), free = informed_by_noise(self.point), problem.layout.free
        # A resonance beside a line may well be seen sharper than from the measured forces alone.
        slight = self.rigid & (predicted < SLIGHT * np.abs(unknowns[free]))
        taken = predicted > np.where(slight, TAKEN_ABOUT, TAKEN) * stated
        taken |= owed
        if not self.loose.any():
            return Doubt(_names(problem, self.told & taken))
        taken |= _taken_about(problem, self.start, unknowns, stated)
        bent = self.rigid & (wider > ENDLESS)
        return Doubt(_names(problem, self.rigid & taken), _names(problem, bent))


def _names(problem: Problem, which: NDArray[np.bool_]) -> tuple[str, ...]:
    return tuple(problem.layout.unknowns[i].name for i in problem.layout.free[which])


def _about(problem: Problem, start: Floats, unknowns: Floats, count: int) -> list[Floats]:
    """Return the start and others about it, with what is linear (unbalance) as it was found.

    A start that is far off is no plausible machine; those about the answer serve then.
    """
    rigid = np.setdiff1d(problem.layout.free, problem.affine)
    a, b = np.abs(start[rigid]), np.abs(unknowns[rigid])
    if (np.maximum(a, b) > FAR * np.minimum(a, b)).any():
        start = unknowns
    points = [start.copy(), *further_starts(problem, start, count)]
    for x in points:
        x[problem.affine] = unknowns[problem.affine]
    return points


def _taken_about(
    problem: Problem, start: Floats, unknowns: Floats, stated: Floats
) -> NDArray[np.bool_]:
    """Tell which deviations no plausible machine would give with these forces, (free,)."""
    taken = np.ones(len(stated), dtype=bool)
    for x in _about(problem, start, unknowns, AROUND):
        # A resonance that happens to lie beside a line informs more than those of all others.
        least = np.maximum(TAKEN_ABOUT * stated, LOOSE * np.abs(x[problem.layout.free]))
        taken &= predicted_deviations(problem, x) > least
    return taken


def _minima(problem: Problem, start: Floats, solution: Solution, every: bool) -> list[Solution]:
    """Return where further starts end, other than on the way that led to the solution.

    All of them where one of the first ended elsewhere at nearly as low a cost, or on demand.
    """
    found, strayed = [], every
    for number, other in enumerate(further_starts(problem, start)):
        if number >= ALWAYS and not strayed:
            break
        try:
            stages = STAGES if number < ALWAYS else LATE
            end = elsewhere(problem, other, solution, stages)
        except np.linalg.LinAlgError:
            continue
        if end is None:
            continue
        above = end.point.cost - solution.point.cost
        strayed |= abs(above) > AGREE * solution.point.cost + 1e-3 and above < 10 * CLOSE
        found.append(end)
    return found


def _apart(
    others: Sequence[Solution], solution: Solution, stated: Floats, asked: NDArray[np.bool_]
) -> list[Point]:
    """Return one of each of the ends that fit as well and lie apart, lowest first.

    Over a parabola a cost that is higher by `CLOSE` is less than four deviations away: a point
    that fits as well from further off belies the deviations, be it a minimum or not.
    """
    answers = [solution.point]
    for other in sorted(others, key=lambda s: s.point.cost):
        if other.point.cost > solution.point.cost + CLOSE:
            break
        if all(_distance(other.point, at, stated, asked) > APART for at in answers):
            answers.append(other.point)
    return answers[1:]


def _distance(one: Point, other: Point, stated: Floats, asked: NDArray[np.bool_]) -> float:
    """Return how many deviations two answers lie apart."""
    free = one.problem.layout.free[asked]
    away = np.abs(one.unknowns - other.unknowns)[free] / stated[asked]
    return float(away.max(initial=0.0))


def doubt_warnings(problem: Problem, start: Floats, doubt: Doubt) -> list[str]:
    """Return in words what is doubtful, and what would cure it."""
    found = []
    if doubt.noise:
        found.append(
            f"not identifiable: {', '.join(doubt.noise)}: their stated deviations are noise taken "
            "for information; the noise-free response to the measured forces gives more than "
            f"{TAKEN:g} times as much"
        )
    if doubt.alternatives:
        costs = ", ".join(f"{other.cost:.4g}" for other in doubt.alternatives)
        found.append(
            f"not identifiable: other answers fit as well (misfit {costs}); see the alternatives"
        )
    if doubt.bent:
        found.append(
            f"not identifiable: {', '.join(doubt.bent)}: they move together much further than "
            "their stated deviations before the misfit rises"
        )
    if found:
        found += [f"cure: {exchange}" for exchange in doubt.exchanges]
        if doubt.noise or doubt.bent or not doubt.exchanges:
            found.append(f"cure: {_cure(problem, start, doubt)}")
    return found


def _cure(problem: Problem, start: Floats, doubt: Doubt) -> str:
    """Say which other excitation would inform the doubtful unknowns, tried on the start."""
    if not problem.likelihoods:
        return (
            "natural frequencies of another configuration, with other parameters that are known "
            "([[modes]] parameters), a record with a measured force, a known value, or a bound"
        )
    layout = problem.layout
    named = set(doubt.noise or doubt.bent)
    asked = [k for k, i in enumerate(layout.free) if layout.unknowns[i].name in named]
    before = predicted_deviations(problem, start)
    helped = []
    for j, name in enumerate(layout.model.inputs):
        after = predicted_deviations(_turned(problem, j), start)
        if asked and (after[asked] * TAKEN < before[asked]).any():
            helped.append(name)
    if helped:
        return f"drive {' or '.join(helped)} against the other inputs, not with them"
    return (
        "excite what is at rest: unequal forces on the inputs, lines nearer to the resonances, "
        "another speed, more amplitude, or a sensor of a hidden coordinate"
    )


def _turned(problem: Problem, column: int) -> Problem:
    """Return the problem with one input of the other sign."""
    turned = []
    for likelihood in problem.likelihoods:
        other = copy.copy(likelihood)
        other.data = likelihood.data.copy()
        other.data[:, column] *= -1
        turned.append(other)
    return replace(problem, likelihoods=tuple(turned))
