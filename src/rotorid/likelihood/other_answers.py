"""Other answers that fit as well: further minima, the profile of the cost.

Where the excitation leaves something at rest, the record fits with more than one answer, and
neither rank nor condition number at the estimate shows it (docs/maximum-likelihood.md, section 2).
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import product

import numpy as np

from rotorid.core.linalg import covariance_root, whole_svd
from rotorid.core.notes import Note
from rotorid.core.values import Booleans, Floats, frozen
from rotorid.core.watch import watch
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.inference import Inference, infer
from rotorid.likelihood.linear import Linearized
from rotorid.likelihood.problem import Point, Problem
from rotorid.likelihood.response import responses
from rotorid.likelihood.solver import STAGES, Solution, beside, elsewhere, settle, solve
from rotorid.likelihood.starts import AGREE, FINE_STAGES, further_starts
from rotorid.likelihood.symmetric_answers import APART, CLOSE, Mirrors, exchanged

OTHERS = "other answers"  # what the notes are about
WEAKEST = 2  # directions along which the valley is followed
STRIDE = 0.5  # length of a step, in deviations of its direction
STEEP = 4.0  # rise over one step from which on it has left the floor, or the valley its bend
SHORTEST = 1 / 64  # share of the stride below which a wall ends the valley
STRIDES = 40  # steps one way: three deviations take 6; those that a bend shortens took up to 37
HALF = 0.5  # share of its value by which an unknown may move in one step
RISEN = 9.0
"""Rise up to which the valley is followed: chance goes further in 3 of 1000 records. A rotor driven
on one axis at rest had k1 off by 8 deviations of the interval that a rise of 4 gives."""
LIKELY = 4.0  # rise up to which the size of loads is asked: that of the interval of 95 %
BEGUN = 1.0
"""Rise of one deviation. Below it its root says nothing of the width: rounding, and a floor not
quite reached."""
ENDLESS = 8.0
"""Deviations wider by this factor are none: the cost hardly tells where the unknown ends. Of
records that inform every parameter to a quarter the widest was 7."""


def explore(point: Point, inference: Inference, told: Booleans) -> tuple[Floats, Point]:
    """Follow the valley of a minimum along its weakest directions, both ways.

    Return by how much deviations are wider than those of the curvature, 1 where they are not,
    (free,), and the lowest point on the way.
    """
    free = point.problem.layout.free
    unit = np.where(told, inference.std, 1.0)
    root = covariance_root(inference.covariance * np.outer(told, told))
    wider, lowest = np.ones(len(free)), point
    for column, stride in product(root.T[-WEAKEST:], (-STRIDE, STRIDE)):
        end = point
        for at in _floor(point, stride * column, unit):
            rise = at.cost - point.cost
            if rise > RISEN:
                break
            end = at if rise <= LIKELY else end
            lowest = min(lowest, at, key=lambda one: one.cost)
            moved = np.abs(at.unknowns - point.unknowns)[free] / unit * told
            wider = np.maximum(wider, moved / np.sqrt(max(rise, BEGUN)))
            if (moved > 2 * ENDLESS).any():
                break
        risen = np.sqrt(max(end.cost - point.cost, BEGUN))
        wider = np.maximum(wider, _of_loads(end, unit) * told / risen)
    return wider, lowest


def _of_loads(end: Point, unit: Floats) -> Floats:
    """Return the deviations of loads at another point, (free,), zero for what is no load.

    A load may come with a factor of its own, as (I_t - I_p) mu: where that nears zero, the same
    load has another size, and another deviation.
    """
    loads = np.isin(end.problem.layout.free, end.problem.affine)
    try:
        found = infer(end).std
    except np.linalg.LinAlgError:
        return np.zeros(len(unit))
    return np.where(loads & np.isfinite(found), found / unit, 0.0)


def _floor(point: Point, change: Floats, unit: Floats) -> Iterator[Point]:
    """Yield points of the floor that begins with a change of the free unknowns."""
    layout, affine = point.problem.layout, point.problem.affine
    free, stride = layout.free, float(np.linalg.norm(change / unit))
    scaling = ~(np.isin(free, affine) | layout.additive[free])
    at, step = point, change
    for _ in range(STRIDES):
        # No unknown, other than a load or a shift, moves by too much of itself.
        asked = scaling & (at.unknowns[free] != 0)
        with np.errstate(over="ignore"):  # beside next to nothing there is no room
            share = np.abs(step[asked] / at.unknowns[free][asked])
        step = step * min(1.0, HALF / max(float(share.max(initial=0.0)), 1e-300))
        found = beside(at, step)
        if found is None or found.cost > at.cost + STEEP:
            step = step / 4
            if np.linalg.norm(step / unit) < SHORTEST * stride:
                return
            continue
        yield found
        onward = (found.unknowns - at.unknowns)[free]
        length = float(np.linalg.norm(onward / unit))
        if length == 0:
            return
        step = onward / length * min(2 * float(np.linalg.norm(step / unit)), stride)
        at = found


TAKEN = 3.0  # stated deviations so many times smaller than the noise-free response gives are noise
TAKEN_ABOUT = 10.0  # the same about the start, where another machine may be that much less informed
SLIGHT = 0.01  # predicted deviation over the value, up to which `TAKEN_ABOUT` is asked instead
BY_NOISE = 0.3
"""Part of the information along a direction that the noise of the inputs accounts for on average,
from which on it may as well be all of it: of a dozen lines chance makes it three times as much."""
OWED = 0.1  # share of an unknown's variance along such directions from which on it is one of theirs
LOOSE = 0.1  # predicted deviation, as a share of the value, from which other answers are looked for
UNLIKELY = 0.01  # p-value below which minima may be several: one good record in a hundred is asked
ASKED = 10  # further starts from which the same answer has to come
ALWAYS = 3
"""Those that are always tried: where the record informs every unknown they join the first way soon,
and so would all."""
OTHERWISE = (FINE_STAGES, STAGES[-3:])
"""Stages of the starts beyond those, in turn. With large errors granted every way may lead to one
minimum (of a record with a hundred times the noise 27 of 28 did), and the lowest be found without
them; of a chain of five masses 7 of 12 starts found it in fine stages, and of 24 in others none."""
WAYS = (STAGES, *OTHERWISE)
"""Of the starts about an unlikely minimum. Of three masses in a hundred times the noise, the best
of two minima at the end of 4 in 10."""
FAR = 3.0  # factor beyond which a start says nothing of the machine: the answer stands for it
NOTHING = 1e-14
"""Share of the largest singular value that a direction of no information has: so that what it gives
is a deviation beyond all others, and no cut decides which has none."""
AROUND = 8  # starts about the given one at which the noise-free response is asked, beside it


def predicted_deviations(problem: Problem, unknowns: Floats) -> Floats:
    """Return the deviations that the noise-free response gives, infinite where it gives none."""
    with suppress(np.linalg.LinAlgError):
        return _predicted(problem.at(unknowns)).std
    return np.full(len(problem.layout.free), np.inf)


def _predicted(point: Point, weights: Sequence[Floats] = ()) -> Linearized:
    """Return the problem linear in the noise-free response; `weights`: of the records' rows."""
    predicted = ((at, responses([at])[0]) for at in point.records)
    silent = [at.with_data(replace(at.problem, data=lines)) for at, lines in predicted]
    quiet = replace(point.problem, likelihoods=tuple(at.problem for at in silent))
    linear = Point(quiet, point.unknowns, silent, point.known).linear
    if weights:
        linear = linear.weighted(np.concatenate([*weights, np.ones(len(point.known))]))
    return linear.filled(NOTHING)


def informed_by_noise(point: Point) -> tuple[Floats, Booleans]:
    """Return predicted deviations, and tell which owe to noise that drives nothing, (free,).

    Information is quadratic in the inputs: that of the measured ones is that of the true ones and,
    on average, that of their noise by itself. Where it seems to be noise it is asked again with as
    much of each line as the readings bear out.
    """
    none = np.zeros(len(point.problem.layout.free), dtype=bool)
    predicted = np.full(len(none), np.inf)
    try:
        linear = _predicted(point)
        predicted = linear.std
        noise = _by_noise(point)
        told = _owed(noise, linear.root)
        if told.any():
            weights = _borne_out(point)
            every = zip(noise, weights, strict=True)
            weighed = [[part * w[:, None] for part in parts] for parts, w in every]
            told &= _owed(weighed, _predicted(point, weights).root)
    except np.linalg.LinAlgError:
        return predicted, none
    return predicted, told


def _owed(noise: Sequence[Sequence[Floats]], root: Floats) -> Booleans:
    """Tell which deviations owe to some noise, its Jacobians given for each record, (free,)."""
    if not np.isfinite(root).all():
        return np.zeros(len(root), dtype=bool)
    rows = [np.zeros((0, len(root))), *(part for parts in noise for part in parts)]
    _, share, along = whole_svd(np.concatenate(rows) @ root)
    turned = root @ along.T
    # Shares of each row: an estimate astray may have deviations whose squares no number holds.
    largest = np.abs(turned).max(axis=1, keepdims=True, initial=1e-300)
    power = (turned / largest) ** 2
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
        noise = np.maximum(np.linalg.norm(likelihood.noise.factor, axis=2), 1e-300)
        both = likelihood.data, responses([at])[0]
        measured, predicted = (np.linalg.norm((x / noise)[:, first:], axis=1) for x in both)
        share = measured / np.maximum(np.maximum(predicted, measured), 1e-300)
        found.append(np.repeat(share, 2 * likelihood.equations))
    return found


def _by_noise(point: Point) -> list[list[Floats]]:
    """Return the Jacobians that the noise of each input alone would make, record by record."""
    free, affine = point.problem.layout.free, point.problem.affine
    still = point.unknowns.copy()
    still[affine] = 0.0  # what turns is no noise
    found = []
    for at in point.records:
        likelihood, count = at.problem, at.forces
        # What laws with other constants add comes of the samples, not of this noise.
        calibration = replace(likelihood.calibration, reread=())
        driven = replace(likelihood, load=np.zeros_like(likelihood.load), calibration=calibration)
        quiet, idle = Evaluation(driven, still, like=at), _idle_share(at, count)
        every = []
        for column in range(count):
            noise = np.zeros_like(likelihood.data)
            noise[:, :count] = idle * likelihood.noise.factor[:, :count, column]
            every.append(quiet.with_data(replace(driven, data=noise)))
        readings = zip(every, responses(every), strict=True)
        pushed = [quiet.with_data(replace(at.problem, data=data)) for at, data in readings]
        turning = np.isin(free, affine)
        found.append([np.where(turning, 0.0, at.jacobian()[:, free]) for at in pushed])
    return found


def _idle_share(at: Evaluation, count: int) -> Floats:
    """Return the deviation of what drives nothing over that of the inputs' noise, (line, input).

    In closed loop most of it drives the machine like any force, and informs. What does not drive is
    in the equation errors, so that it is no more than V allows: ``V - s^2 b b^H`` stays positive,
    b the input's column, up to ``s^2 = 1 / (b^H V^-1 b)``.
    """
    columns = at.whitened_columns()[:, :, :count]
    allowed = 1 / np.maximum((np.abs(columns) ** 2).sum(axis=1), 1e-300)
    noise = (np.abs(at.problem.noise.factor[:, :count]) ** 2).sum(axis=2)
    return np.asarray(np.sqrt(allowed / np.maximum(np.maximum(noise, allowed), 1e-300)))


def questioned(
    solution: Solution, mirrors: Mirrors
) -> tuple[Solution, Inference, tuple[Point, ...], list[Note]]:
    """Return the lowest minimum found, how far it may be off, others, and what is doubtful."""
    at = _Minimum(solution)
    others = [mirrors.as_started(end) for end in at.minima()]
    others += [image for image, _ in mirrors.images(solution)]
    if (lower := _lower(others, solution)) is not None:
        others.append(solution)
        at = _Minimum(lower)
    _, lowest = at.valley
    if lowest is not at.solution.point:
        with suppress(np.linalg.LinAlgError):
            bottom = mirrors.as_started(settle(lowest.problem, lowest.unknowns))
            if _lower([bottom], at.solution):
                others.append(at.solution)
                at = _Minimum(bottom)
    answers, exchanges = other_answers(mirrors, at.solution, others)
    notes = [*doubt_notes(at.problem, answers, exchanges, *at.doubts())]
    wider, _ = at.valley
    covariance = at.inference.covariance * np.outer(wider, wider)
    return at.solution, replace(at.inference, covariance=covariance, bend=wider), answers, notes


def other_answers(
    mirrors: Mirrors, solution: Solution, others: Sequence[Solution] = ()
) -> tuple[tuple[Point, ...], list[str]]:
    """Return which mirror images of a minimum, and which other ends, are other answers.

    And which parts change places in some of them, and what would tell them apart.
    Over a parabola a cost that is higher by `CLOSE` is less than four deviations away: a point
    that fits as well from further off belies the deviations, be it a minimum or not.
    """
    point, images = solution.point, mirrors.images(solution)
    told, std = _Minimum(solution).told, solution.inference.std

    def apart(one: Point, other: Point) -> bool:
        away = np.abs(one.unknowns - other.unknowns)[point.problem.layout.free]
        return bool((away[told] > APART * std[told]).any())

    answers = [point]
    ends = [end.point for end in (*(image for image, _ in images), *others)]
    for end in sorted(ends, key=lambda end: end.cost):
        fits = end.cost <= point.cost + CLOSE
        if fits and all(apart(end, answer) for answer in answers):
            answers.append(end)
    parts = [
        exchanged(mirrors.layout, exchange, point.unknowns)
        for image, exchange in images
        if len(answers) > 1 and exchange.pairs and apart(image.point, point)
    ]
    return tuple(answers[1:]), parts


def _lower(others: Sequence[Solution], solution: Solution) -> Solution | None:
    cost = solution.point.cost
    below = [o for o in others if o.converged and o.point.cost < cost * (1 - AGREE) - 1e-3]
    return min(below, key=lambda o: o.point.cost, default=None)


@frozen
class _Minimum:
    """A minimum with what its deviations are held against; arrays of shape (free,).

    `told`: unknowns with a stated deviation; `rigid`: those among them on which more depends than a
    load; `loose`: those whose deviation, stated or expected of the start, is a tenth of the value.
    """

    solution: Solution

    @property
    def problem(self) -> Problem:
        return self.solution.point.problem

    @property
    def inference(self) -> Inference:
        return self.solution.inference

    @cached_property
    def told(self) -> Booleans:
        return ~self.inference.linear.undetermined & (self.inference.std > 0)

    @cached_property
    def value(self) -> Floats:
        return np.abs(self.solution.point.unknowns[self.problem.layout.free])

    @cached_property
    def rigid(self) -> Booleans:
        loads = np.isin(self.problem.layout.free, self.problem.affine)
        return self.told & ~loads & (self.value > 0)

    @cached_property
    def loose(self) -> Booleans:
        (about,) = self.about(0)
        expected = predicted_deviations(self.problem, about)
        wide = expected > LOOSE * np.abs(about[self.problem.layout.free])
        return self.rigid & (wide | (self.inference.std > LOOSE * self.value))

    @cached_property
    def valley(self) -> tuple[Floats, Point]:
        """By how much deviations are wider than stated, and the lowest point of the valley."""
        if not self.loose.any():
            return np.ones(len(self.inference.std)), self.solution.point
        return explore(self.solution.point, self.inference, self.told)

    def minima(self) -> list[Solution]:
        """Return where further starts end, other than on the way that led here.

        All of them where one of the first did not join that way, where chance seldom leaves such a
        cost, or where something is loose. Of such a cost, and once one ends lower, each goes its
        whole way: ways that join at first may part again.
        """
        found, cost = list[Solution](), self.solution.point.cost
        whole = self.inference.expectation.p_value(cost) < UNLIKELY
        every = whole or bool(self.loose.any())
        always, asked = ALWAYS * self.problem.effort, ASKED * self.problem.effort
        starts = further_starts(self.problem, self.problem.layout.start, asked)
        for number, start in enumerate(starts):
            if number >= always and not every:
                break
            watch("asking whether other answers fit as well", number, asked if every else always)
            end: Solution | None = None
            with suppress(np.linalg.LinAlgError):
                if whole:
                    end = solve(self.problem, start, WAYS[number % len(WAYS)], brief=True)
                else:
                    stages = STAGES if number < always else OTHERWISE[number % 2]
                    end = elsewhere(self.problem, start, self.solution, stages)
            if end is not None:
                every = True
                found.append(end)
                whole = whole or _lower([end], self.solution) is not None
        return found

    def doubts(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Name the unknowns whose deviations are noise taken for information, or have no end."""
        predicted, taken = informed_by_noise(self.solution.point)
        # A resonance beside a line may well be seen sharper than from the measured forces alone.
        slight = self.rigid & (predicted < SLIGHT * self.value)
        taken = taken | (predicted > np.where(slight, TAKEN_ABOUT, TAKEN) * self.inference.std)
        names = self.problem.layout.names
        if not self.loose.any():
            return names(self.told & taken), ()
        noise = self.rigid & (taken | self.taken_about())
        return names(noise), names(self.rigid & (self.valley[0] > ENDLESS))

    def taken_about(self) -> Booleans:
        """Tell which deviations no plausible machine would give with these forces."""
        taken = np.ones(len(self.inference.std), dtype=bool)
        for x in self.about(AROUND):
            # A resonance that happens to lie beside a line informs more than those of all others.
            value = np.abs(x[self.problem.layout.free])
            least = np.maximum(TAKEN_ABOUT * self.inference.std, LOOSE * value)
            taken &= predicted_deviations(self.problem, x) > least
        return taken

    def about(self, count: int) -> list[Floats]:
        """Return the start, or an answer far from it, and others about it, with loads as found."""
        start, unknowns = self.problem.layout.start, self.solution.point.unknowns
        affine, rigid = self.problem.affine, self.problem.rigid
        a, b = np.abs(start[rigid]), np.abs(unknowns[rigid])
        if (np.maximum(a, b) > FAR * np.minimum(a, b)).any():
            start = unknowns
        points = [start.copy(), *further_starts(self.problem, start, count)]
        for x in points:
            x[affine] = unknowns[affine]
        return points


def doubt_notes(
    problem: Problem,
    answers: Sequence[Point],
    exchanges: Sequence[str],
    noise: tuple[str, ...] = (),
    bent: tuple[str, ...] = (),
) -> Iterator[Note]:
    if noise:
        text = (
            f"{', '.join(noise)}: their stated deviations are noise taken "
            "for information; the noise-free response to the measured forces gives more than "
            f"{TAKEN:g} times as much"
        )
        yield Note(OTHERS, "open", text, on=noise)
    if answers:
        costs = ", ".join(f"{other.cost:.4g}" for other in answers)
        text = f"other answers fit as well (misfit {costs}); see the alternatives"
        yield Note(OTHERS, "open", text)
    if bent:
        text = (
            f"{', '.join(bent)}: they move together much further than their stated "
            "deviations before the misfit rises"
        )
        yield Note(OTHERS, "open", text, on=bent)
    for exchange in exchanges:
        yield Note(OTHERS, "open", cure=exchange)
    if noise or bent or (answers and not exchanges):
        yield Note(OTHERS, "open", cure=_cure(problem, {*(noise or bent)}))


def _cure(problem: Problem, doubtful: Container[str]) -> str:
    if not problem.likelihoods:
        return (
            "natural frequencies of another configuration, with other parameters that are known "
            "([[modes]] parameters), a record with a measured force, a known value, or a bound"
        )
    layout = problem.layout
    asked = [k for k, name in enumerate(layout.names()) if name in doubtful]
    before = predicted_deviations(problem, layout.start)
    helped = []
    for j, name in enumerate(layout.model.inputs):
        turned = (
            replace(at, data=at.data * np.where(np.arange(at.data.shape[1]) == j, -1.0, 1.0))
            for at in problem.likelihoods
        )
        other = replace(problem, likelihoods=tuple(turned))
        after = predicted_deviations(other, layout.start)
        if asked and (after[asked] * TAKEN < before[asked]).any():
            helped.append(name)
    if helped:
        return f"drive {' or '.join(helped)} against the other inputs, not with them"
    return (
        "excite what is at rest: unequal forces on the inputs, lines nearer to the resonances, "
        "another speed, more amplitude, or a sensor of a hidden coordinate"
    )
