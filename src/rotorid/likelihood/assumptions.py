"""What is assumed: whatever was taken as exact, how wrong it plausibly is, and what that moves.

With J the Jacobian of the whitened residual and D its derivative by an error of plausible size, the
unknowns move by ``-J^+ D``, and ``(1 - J J^+) D`` is left in the residual: what raises the cost by
less than the warning of a doubtful model needs is unseen (docs/maximum-likelihood.md, section 6).
Nothing is fitted: an assumption is a column, and a product with the factorization at the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np
import scipy

from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import DIRECTION, MATTERS, weighed
from rotorid.answer.parts import DOUBTFUL, Shift
from rotorid.core.distributions import chance_of_any
from rotorid.core.linalg import column_lengths
from rotorid.core.notes import Note
from rotorid.core.values import Complexes, Floats, fact, frozen
from rotorid.data.lines import Lines
from rotorid.data.observation import Observation
from rotorid.likelihood.case import Case, Rival, not_asked
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.effects import Drives, Turns
from rotorid.likelihood.fit import Fit
from rotorid.likelihood.inference import freedom, infer, weights_of_rows
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.linear import DISTINCT
from rotorid.likelihood.mode_rows import pencil_at
from rotorid.likelihood.problem import Point
from rotorid.likelihood.rivals_model import bows, levers, parts_between, trials, turned_magnets
from rotorid.likelihood.rivals_read import WINDOWS, blurred
from rotorid.likelihood.solver import Solution
from rotorid.likelihood.unknowns import TAKEN_AS_EXACT, Plausible, Unknown, amount, force_scale
from rotorid.likelihood.whitening import as_complex
from rotorid.models.rotor import RotorModel
from rotorid.models.rotor.fem import by_share, exact_numbers, pushed
from rotorid.models.structure import Structure, holding

SHARE = 0.01
"""Share by which a value that is held, or a scale, is plausibly wrong: a ruler, a data sheet, a
calibration by hand."""
TURNED = np.radians(0.1)
"""Angle by which a sensor or a magnet is turned out of its axis: what mounting by eye reaches."""
MISPLACED = np.radians(2.0)
"""Angle by which a trial mass sits beside the hole that was written down, or the hole itself."""
CROSSTALK = 0.001  # share of one sensor's reading in another's: neighbours in one amplifier
BOWED = 1e-6  # displacement in m by which a shaft is bent: what straightening leaves
CASING = 50.0
"""Mass of what the bearings stand on, over that of the rotor: a machine's frame. A lighter one
shifts the answer by more, and shows itself sooner."""
MOUNTS = (("free", 0.0), ("on mounts of 8 Hz", 2 * np.pi * 8.0))
"""How such a casing stands, and its natural frequency in rad/s: on a bench, and on rubber."""
MOUNT_DAMPING = 0.05  # damping ratio of rubber mounts: keeps a line beside their frequency finite
PART = 0.01  # share of the mass that weighing the parts and sharing out the shaft may well miss
BEYOND = 5.0
"""Deviations by which such a part, or what records show to be there, moves a parameter unseen above
which it matters: beyond chance."""
FOLLOWS = 0.1
"""Share by which a stiffness, a damping or a magnet's constant changes from standstill to the
highest speed, at the least, where films, seals or eddy currents make it."""
TAKEN_OVER = 1e-6
"""What is left of a column when the unknowns have taken their share, over its square, below which
they take it over: exactly so at the corrected lines, but for rounding."""
FAINT = 0.01  # deviations that an error of plausible size makes, at least, to be a direction
ALIKE = 0.9
"""Share of the largest score from which on another is named too: which it is no record tells."""
LED = 0.9  # correlation with the rotor angle from which on it makes four fifths of a variance


@frozen
class Assumed:
    """Something that was taken as exact, and what errors of a plausible size do."""

    about: str  # "rotor angle"; what is wrong together, in one way or another, has one name
    size: str  # as one would write it: "1 deg"
    text: str  # how it is taken: "exact: 1 deg of error"
    cure: str  # what settles it, or says better how well it is known
    effect: Floats  # (row, error): what errors of that size do to the residual
    step: Floats | float = 0.0  # (free, error): what they do to the unknowns by themselves
    least: float = MATTERS  # deviations from which on it is told
    errors: tuple[str, ...] = ()  # the names of several errors: "gain[x1]"
    # what it adds to values that are held; None of a machine's part that stands in no value, with
    # which what follows from the others moves otherwise
    held: Mapping[str, float] | None = field(default_factory=dict)
    # what it adds to values that follow the speed, over Omega^2, as the effect is
    grows: Mapping[str, float] = field(default_factory=dict)
    shown: bool = False  # the records themselves hold what makes it

    @property
    def names(self) -> tuple[str, ...]:
        return self.errors or (self.about,)

    def moved(self, fit: Fit) -> Floats:
        """Return the deviations by which it may move each unknown unseen, (free,), 0 of others."""
        if not self.effect.any():
            return np.zeros(len(fit.layout.free))
        std, layout = fit.inference.std, fit.layout
        named = np.array([i < layout.named and i not in layout.idle for i in layout.free], bool)
        std = np.where(named & (std > 0), std, np.inf)
        return np.asarray(np.linalg.norm(self._unseen(fit)[1] / std[:, None], axis=1))

    @fact
    def _unseen(self, fit: Fit) -> tuple[Floats, Floats]:
        """Return its ways, (error, way), and by how much they move the unknowns, (free, way)."""
        linear = fit.solution.point.linear
        ways = np.ones((1, 1)) if self.grows else linear.unseen(self.effect, _excess(fit))
        return ways, (self.step - linear.taken(self.effect)) @ ways

    def shift(self, fit: Fit) -> Shift:
        """Return the same for what follows from the unknowns, and from values that are held."""
        ways, moved = self._unseen(fit)
        every = dict(zip(fit.layout.names(), moved, strict=True))
        every |= {name: size * ways[0] for name, size in (self.held or {}).items()}
        moves = {name: tuple(float(f"{x:.4g}") for x in by) for name, by in every.items()}
        grows, seen = dict(self.grows), 0.0
        if grows:
            rest = fit.solution.point.linear.rest(self.effect)
            seen = float(np.linalg.norm(rest) / np.sqrt(_excess(fit)))
        return Shift(self.about, self.size, self.text, self.cure, moves, grows, seen)


def _excess(fit: Fit) -> float:
    """Return what may be added to the cost before a warning tells."""
    expected = fit.inference.expectation
    return expected.exceeded(DOUBTFUL) - expected.mean


def assumed(estimate: Estimate, fit: Fit) -> Estimate:
    """Return an accepted answer with what it assumes, and how far that goes.

    What the records show to be there, and matters, stands first.
    """
    if not len(fit.layout.free):
        return estimate
    names, every = fit.layout.names(), list(assumptions(fit))
    shifts = [one.shift(fit) for one in every]
    found = ((s.note, one.moved(fit), one.least) for s, one in zip(shifts, every, strict=True))
    total, notes = weighed(found, names)
    shifts = [s for s, one in zip(shifts, every, strict=True) if one.held is not None]
    shifts += [one.shift(fit) for one in following(fit)]
    if every:
        of = dict(zip(names, total.tolist(), strict=True))
        parameters = tuple(
            v if v.fixed or not v.std else replace(v, std_assumed=v.std * of.get(v.name, 0.0))
            for v in estimate.parameters
        )
        estimate = estimate.with_(parameters=parameters)
    speeds = np.abs(np.concatenate([*(r.lines.speed for r in fit.records), []]))
    ends = (float(speeds.min()), float(speeds.max())) if len(speeds) else None
    estimate = estimate.with_(speeds=ends, shifts=tuple(shifts))
    there = {one.about for one in every if one.shown}
    notes.sort(key=lambda note: note.about not in there or (note.value or 0.0) <= BEYOND)
    return estimate.with_notes(*notes, *_led_by_the_angle(fit), *contradicted(fit, every))


def contradicted(fit: Fit, every: Sequence[Assumed]) -> Iterator[Note]:
    """Test each error alone, and each value known beforehand, against what the model leaves.

    What shows in one direction drowns in a sum over a hundred. Along the rest of a column, what
    noise leaves is normal; its deviation on lines is known from the periods only.
    """
    point, inference = fit.solution.point, fit.inference
    known = point.problem.known.relations.texts
    if not fit.records or inference.expectation.dof <= 0:
        return
    columns = [(one.names, one.effect) for one in every]
    columns += [((text,), point.slack(text)) for text in known]
    effect = np.concatenate([np.zeros((len(point.residual), 0)), *(e for _, e in columns)], axis=1)
    rest, whole = point.linear.rest(effect), np.linalg.norm(effect, axis=0)
    length = np.linalg.norm(rest, axis=0)
    # One that would not show at a hundred times its size is none.
    (seen,) = np.nonzero((length > DISTINCT * whole) & (length > FAINT))
    if not len(seen):
        return
    unit = rest[:, seen] / length[seen]
    costs = inference.records
    noise = np.linalg.norm(unit / weights_of_rows(point, costs)[:, None], axis=0)
    along = np.abs(point.linear.residual @ unit) / noise
    chances = 2 * scipy.special.stdtr(freedom(point, costs, unit**2), -along)
    chance = chance_of_any(float(chances.min()), unit.T @ unit)
    if chance >= DOUBTFUL:
        return
    order = np.lexsort([-along, chances])
    most = float(along[order[0]])
    names = [name for each, _ in columns for name in each]
    alike = list(dict.fromkeys(names[seen[k]] for k in order if along[k] > ALIKE * most))
    pair = [name for name in alike if name in known][:2]
    apart = ", which contradict each other" if len(pair) > 1 else ""
    on = tuple(pair if apart else alike[:3])
    text = (
        f"the model is doubtful: what it leaves is {most:.2g} std off along {' or '.join(on)}"
        f"{apart}, the most of {len(seen)} directions (p = {chance:.1g})"
    )
    cure = "check that, or have it estimated; values may be off by more than their std"
    yield Note(DIRECTION, "doubts", text, cure, on, most, "1")


def accused(case: Case) -> Iterator[tuple[Rival, float]]:
    """Yield what errors of a plausible size explain together, and the drop of the cost.

    Where several channels are off by as much as calibrations are, no error alone explains it.
    """
    for one in assumptions(Fit(Solution(case.point, True, 0), infer(case.point), case.records)):
        says = f"{one.about}: errors of about {one.size} together"
        rival = Rival(one.about, says, one.cure, lambda case: case, on=one.names, kind="errors")
        yield rival, case.point.linear.evidence(one.effect, BEYOND)


def assumptions(fit: Fit) -> Iterator[Assumed]:
    """Yield all that is assumed, each with its columns: one evaluation serves them all."""
    records, structure = fit.records, fit.case.places
    scales = force_scale(records, None)
    kinds = [(plausible, plausible.kind(records, None)) for plausible in TAKEN_AS_EXACT]
    exact = [(plausible, not_asked(fit.case, unknowns)) for plausible, unknowns in kinds]
    parts, bent, magnets, axes = list[Unknown](), list[Unknown](), list[Unknown](), list[Unknown]()
    if structure is not None and records:
        parts, magnets = parts_between(structure), list(levers(structure, fit.case.model))
        bent = bows(structure)
        axes = list(turned_magnets(structure, fit.case.model))
    every = (unknown for _, unknowns in exact for unknown in unknowns)
    point = fit.case.beside([*scales, *every, *parts, *bent, *magnets, *axes])
    common = list(_scale(fit, point.by(*(u.term for u in scales))))
    yield from common
    for plausible, unknowns in exact:
        yield from _exact(fit, point, plausible, unknowns, bool(common))
    yield from _held(fit, point)
    yield from _constrained(fit)
    yield from _in_tests(fit)
    if structure is not None and records:
        yield from _parts(structure.mass, {p.term: point.by(p.term) for p in parts})
        yield from _bent(point, bent)
        if not structure.balance.faults:
            yield from _ground(fit, structure)
            if structure.pairs:
                text, cure = "aligned: axes turned by 0.1 deg", "measure the directions of the axes"
                said, way = ("axes", "0.1 deg", text, cure), TURNED * structure.turn()
                off = {each.term: TURNED * point.by(each.term) for each in axes}
                yield from _elsewhere(fit, structure, said, "turn", way, off)
        if isinstance(fit.case.model, RotorModel):
            yield from _numbers(fit, structure, fit.case.model)
            stated = fit.case.model.rotor.tolerances.places
            by = SHARE * fit.case.model.rotor.length if stated is None else stated
            cure = "state it: places in [tolerances] of the rotor file"
            said = "drawn places", f"{1e3 * by:.3g} mm", f"exact: {1e3 * by:.3g} mm of error", cure
            off = {each.term: by * point.by(each.term) for each in magnets}
            sensors = (sensor for record in records for sensor in record.sensors)
            told = {s.channel.name for s in sensors if any(any(t.powers) for t in s.terms)}
            yield from _elsewhere(fit, structure, said, "plane", by * structure.along(), off, told)
    text, cure = "apart: 0.1 % of a reading in the next", "measure it with one sensor moved"
    found = [_crosstalk(*each) for each in zip(fit.solution.point.records, records, strict=True)]
    yield from _by_rows(fit, ("cross-talk", "0.1 %", text, cure), found)
    yield from _analysers(fit)
    yield from _speeds(fit)
    yield from _slips(fit)
    yield from _between_speeds(fit)


def _exact(
    fit: Fit, point: Point, plausible: Plausible, unknowns: Sequence[Unknown], scaled: bool
) -> Iterator[Assumed]:
    """Yield what of one kind was taken as exact; `scaled`: beside one scale of all inputs."""
    names = [s.name for u in unknowns for s in u.scalars if s.unit == plausible.unit]
    if not names:
        return
    effect = point.by(*names) * plausible.size
    if scaled and plausible.in_scale:  # beside one common to all inputs, or to all sensors
        inputs = {c.name for record in fit.records for c in record.inputs}
        driven = np.array([bool(inputs & gain.on) for gain in unknowns])
        for group in (driven, ~driven):
            effect[:, group] -= effect[:, group].mean(axis=1, keepdims=True)
    text = f"{plausible.taken}: {plausible.written} of {plausible.error}"
    about, size, cure = plausible.about, plausible.written, plausible.cure
    yield Assumed(about, size, text, cure, effect, errors=tuple(names))


def _scale(fit: Fit, columns: Floats) -> Iterator[Assumed]:
    """Yield the scale of forces that laws make, where the parameters take it over unseen."""
    column, linear = columns.sum(axis=1), fit.solution.point.linear
    if not column.any():
        return
    channels = [c for record in fit.records for c in record.inputs]
    made = any(channel.law is not None or channel.drive is not None for channel in channels)
    if not made or any(e.part == "force" for e, _ in fit.layout.acting(Drives)):
        return
    left = linear.rest(column)
    if np.isfinite(linear.taken(column)).all() and left @ left <= TAKEN_OVER * (column @ column):
        cure = "set force_scale_std, or weigh the rotor"
        yield _share("force scale", SHARE * column[:, None], cure)


def _share(about: str, effect: Floats, cure: str, step: Floats | float = 0.0) -> Assumed:
    return Assumed(about, "1 %", "exact: 1 % of error", cure, effect, step)


def _held(fit: Fit, point: Point) -> Iterator[Assumed]:
    """Yield each value that is fixed, of one record or of all, and all lengths among them."""
    layout, values = fit.layout, fit.solution.point.unknowns
    trial = list(trials(fit.case))
    for each in trial:
        yield from _of_trial(fit, point, *each)
    held = [
        unknown
        for i, unknown in enumerate(layout.unknowns[: layout.named])
        if unknown.fixed and values[i] != 0 and i not in layout.idle
        if not any(i in pair for _, *pair in trial)
    ]
    size = {u.name: SHARE * values[layout.index[u.name]] for u in held}
    loads = {layout.unknowns[i].name for i in layout.load_only()}
    lengths = [unknown for unknown in held if unknown.unit == "m" and unknown.name not in loads]
    groups = [(u.name, [u]) for u in held]
    if len(lengths) > 1:  # one ruler
        groups.append(("all lengths", lengths))
    for about, members in groups:
        off = {u.name: size[u.name] for u in members}
        effect = point.by(*off) @ [*off.values()]
        cure = 'state how well it is known (value = "..", std = ".."), or free it'
        yield replace(_share(about, effect[:, None], cure), held=off)


def _in_tests(fit: Fit) -> Iterator[Assumed]:
    """Yield each value that was otherwise when natural frequencies were measured."""
    point = fit.solution.point
    modes = point.problem.known.modes
    for unknown, value in sorted(modes.held()):
        if value:
            moved = partial(modes.moved, point.unknowns, unknown, value)
            effect = np.zeros(len(point.residual))
            effect[-len(modes) :] = _by_error(moved)
            stated = fit.layout.unknowns[unknown]
            about = f"{stated.name} of a mode{amount(value, stated.unit)}"
            yield _share(about, effect[:, None], "weigh or measure it, and state it to more digits")


def _by_error(values: Callable[[float], Any]) -> Any:
    """Return what an error of a share does to values of what is stated, times a factor."""
    return (values(1 + SHARE) - values(1 - SHARE)) / 2


def _of_trial(fit: Fit, point: Point, record: int, *pair: int) -> Iterator[Assumed]:
    """Yield a trial mass where it is fixed, and an unbalance that moved when it was mounted."""
    unknowns = [fit.layout.unknowns[i] for i in pair]
    (a, b), about = point.unknowns[[*pair]], f"trial mass[{record}]"
    names, columns = [u.name for u in unknowns], point.by(*(u.name for u in unknowns))
    size, text = f"1 % of {about}", f"as in other records: 1 % of {about} beside"
    moved = SHARE * np.hypot(a, b) * columns
    errors = tuple(f"moved {axis}[{record}]" for axis in "xy")
    cure = "run again without the trial mass, and give that record too"
    yield Assumed(f"unbalance[{record}]", size, text, cure, moved, errors=errors)
    exactly = [unknown.fixed for unknown in unknowns]  # the other is free to be elsewhere
    if any(exactly):
        ways = np.array([[SHARE * a, -MISPLACED * b], [SHARE * b, MISPLACED * a]])
        errors, text = (f"amount of {about}", f"angle of {about}"), "exact: 1 % and 2 deg of error"
        cure = f"weigh it, measure its angle, and state std of {' and '.join(names)}"
        effect = columns * exactly @ ways
        yield Assumed(about, "1 % and 2 deg", text, cure, effect, errors=errors)


def _constrained(fit: Fit) -> Iterator[Assumed]:
    """Yield each relation that holds exactly, off by a share of its terms."""
    point, exact, free = fit.solution.point, fit.problem.exact, fit.layout.free
    if not len(exact):
        return
    size = point.sizes[free]
    scale = np.where(size > 0, size, 1.0)
    ways = np.linalg.pinv(exact.jacobian(point.unknowns)[:, free] * scale)
    stated, sizes = exact.texts, exact.sizes(point.unknowns) / 2  # both sides of it
    for row, text in enumerate(stated):
        step = (scale * ways[:, row] * SHARE * sizes[row])[:, None]
        cure = "give the constraint a std"
        yield _share(text, point.jacobian @ step, cure, step)


def following(fit: Fit) -> Iterator[Assumed]:
    """Yield the growth with the square of the speed of each value that may follow the speed."""
    layout, point, values = fit.layout, fit.solution.point, fit.case.values
    if layout.base or not fit.records or values is None or not np.isfinite(values).all():
        return
    whole = getattr(layout.model, "whole", None) or layout.model  # a reduced rotor has no places
    may = {layout.model.parameter_names.index(name) for name in holding(whole, values)}
    may |= {at for _, effect, at in layout.replaced if effect.parameter in may}
    magnets = (at.tolist() for _, e, at in layout.wherever(Drives) if e.part in ("ki", "ks"))
    speeds = zip(point.by_line(point.residual), fit.records, strict=True)
    per_row = [(rows * 0 + r.lines.speed[:, None] ** 2).ravel() for rows, r in speeds]
    squares = _over(fit, per_row)[:, None]
    for i in sorted(may.union(*magnets) & {*layout.free.tolist()} - layout.idle):
        name, size = layout.unknowns[i].name, FOLLOWS * abs(float(point.unknowns[i]))
        text = "alike at all speeds: 10 % more at the highest"
        cure = "a record near that speed settles it"
        effect = size * squares * point.columns[:, [i]]
        yield Assumed(f"{name} over the speed", "10 %", text, cure, effect, grows={name: size})


def _between_speeds(fit: Fit) -> Iterator[Assumed]:
    """Yield the same between the speeds of the records, the value being what they tell on average.

    At its own speed, a coast-down cannot tell stiffness that grows with its square from mass.
    """
    highest = max((float((r.lines.speed**2).max()) for r in fit.records), default=0.0)
    for one in following(fit) if highest else ():
        column = fit.solution.point.columns[:, [fit.layout.index[name] for name in one.grows]]
        average = column @ (column.T @ one.effect) / max(float((column**2).sum()), 1e-300)
        effect = (one.effect - average) / highest
        cure = "weigh the rotor, or excite it at each speed"
        yield replace(one, effect=effect, cure=cure, grows={}, held=None)


def _parts(whole: float, columns: Mapping[str, Floats]) -> Iterator[Assumed]:
    """Yield a part of the shaft that the model leaves out; `columns`: of 1 kg of each.

    Where masses stand at a few places, what lies between them was shared out by hand.
    """
    mass = PART * whole
    for name, column in columns.items():
        text = f"complete: a missing {name} of 1 % of all ({mass:.2g} kg)"
        cure = "lines about higher modes or a sensor there show it"
        effect, errors = mass * column, (name,)
        yield Assumed("model", "1 %", text, cure, effect, least=BEYOND, errors=errors, held=None)


def _bent(point: Point, bent: Sequence[Unknown]) -> Iterator[Assumed]:
    names = [scalar.name for bow in bent for scalar in bow.scalars]
    if names:
        text = f"straight: a bow of {1e6 * BOWED:g} um"
        cure = "records at several speeds, with low ones, tell a bow from unbalance"
        effect = BOWED * point.by(*names)
        yield Assumed("bow", f"{1e6 * BOWED:g} um", text, cure, effect, errors=tuple(names))


def _ground(fit: Fit, structure: Structure) -> Iterator[Assumed]:
    cure = "read the casing with an accelerometer, or weigh the rotor"
    every = list(zip(fit.solution.point.records, fit.records, strict=True))
    for standing, natural in MOUNTS:
        text = f"at rest: a casing of {CASING:g} times the rotor's mass, {standing},"
        said = "ground", f"{CASING:g} rotor masses, {standing}", text, cure
        found = [_recoil(*each, structure, natural) for each in every]
        yield from _by_rows(fit, said, found)


def _over(fit: Fit, columns: Sequence[Floats]) -> Floats:
    """Return columns over all records, and over the rows of what is known, which they leave."""
    none = np.zeros((len(fit.solution.point.known), *columns[0].shape[1:]))
    return np.concatenate([*columns, none])


Said = tuple[str, str, str, str]  # what is assumed, its error's size, how it is taken, the cure
Rows = Mapping[str, Complexes]  # what errors do to the equations of a record, (line, row)


def _by_rows(fit: Fit, said: Said, found: Sequence[Rows], **more: Any) -> Iterator[Assumed]:
    """Yield what errors do that have a value in all records, such as of a channel."""
    if names := tuple(dict.fromkeys(name for rows in found for name in rows)):
        columns = list[Floats]()
        for at, rows in zip(fit.solution.point.records, found, strict=True):
            none = np.zeros((at.problem.lines, at.problem.all_rows), dtype=np.complex128)
            columns.append(at.whiten(np.stack([rows.get(n, none) for n in names], axis=2)))
        yield Assumed(*said, _over(fit, columns), errors=names, **more)


def _recoil(at: Evaluation, record: Observation, structure: Structure, natural: float) -> Rows:
    """Return what a casing that gives way does.

    The rotor pushes it by ``-t'(M q" - g)``, t a translation and g the unbalance; it moves by
    ``x_c = h t'(M q" - g)``, and in its frame each mass has the inertial force ``-M t x_c"``.
    """
    omega, motion = record.lines.omega[:, None], _motion(at, structure)
    rows = at.problem.scales.rows[: at.equations]
    unbalance = structure.forces((at.loads[:, : at.equations] * rows).T).T
    mass = structure.inertia
    held = natural**2 + 2j * MOUNT_DAMPING * natural * omega
    give = omega**2 / (held - omega**2) if natural else np.full(omega.shape, -1.0)
    weight = CASING * structure.mass
    forces = np.zeros_like(motion)
    for along in structure.translations():
        reaction = (-(omega**2) * (motion @ mass) - unbalance) @ along
        forces += give * reaction[:, None] / max(weight, 1e-300) * (mass @ along)
    return {"ground": _rows(at, structure, forces)}


def _elsewhere(
    fit: Fit,
    structure: Structure,
    said: Said,
    what: str,
    way: Floats,
    off: Mapping[str, Floats],
    told: Collection[str] = (),
) -> Iterator[Assumed]:
    """Yield sensors that read what displacements gain along a way, and magnets that are off it.

    `way`: (coordinate, coordinate); `off`: what the magnets do to the residual; `told`: sensors
    whose parameters tell how far they are.
    """
    found = list[Rows]()
    for at, record in zip(fit.solution.point.records, fit.records, strict=True):
        beside = structure.own(_motion(at, structure) @ way.T) / at.problem.scales.coordinates
        read, names = at.readings_of(as_complex(beside)), _sensors(at, record)
        each = zip(names, np.diag([float(name not in told) for name in names]), strict=True)
        found.append({f"{what}[{n}]": _misread(at, record, read * one) for n, one in each})
    for one in _by_rows(fit, said, found):
        effect = np.column_stack([one.effect, *off.values()])
        yield replace(one, effect=effect, errors=(*one.errors, *off))


def _rows(at: Evaluation, structure: Structure, forces: Complexes) -> Complexes:
    """Return what forces on the coordinates, (line, coordinate), do to the equations, scaled."""
    rows = np.zeros((len(forces), at.problem.all_rows), dtype=np.complex128)
    own = structure.in_rows(forces.T).T
    rows[:, : at.equations] = own / at.problem.scales.rows[: at.equations]
    return rows


def _motion(at: Evaluation, structure: Structure) -> Complexes:
    """Return the motion of the coordinates, (line, coordinate), in SI."""
    return structure.motion(as_complex(at.corrected()[1] * at.problem.scales.coordinates))


def _numbers(fit: Fit, structure: Structure, model: RotorModel) -> Iterator[Assumed]:
    """Yield the numbers of a drawing by their kind: of materials, lengths, diameters."""
    evaluations = fit.solution.point.records
    lines = list[tuple[Mapping[str, float], Floats, Floats, Complexes]]()
    for number, (at, record) in enumerate(zip(evaluations, fit.records, strict=True)):
        layout = fit.layout.of_record(number)
        values = np.asarray(fit.case.values if layout.base else at.unknowns[layout.held])
        known = {**dict(model.held), **dict(zip(model.parameter_names, values, strict=True))}
        lines.append((known, record.lines.omega, record.lines.speed, -_motion(at, structure)))
    for kind, numbers in exact_numbers(model.rotor).items():
        share = getattr(model.rotor.tolerances, kind)
        blocks = {f"{kind}[{name}]": by_share(model.rotor, *of) for name, of in numbers.items()}
        if share:
            found = [
                {n: _rows(at, structure, share * pushed(b, *motion)) for n, b in blocks.items()}
                for at, motion in zip(evaluations, lines, strict=True)
            ]
            size, cure = f"{100 * share:g} %", f"state it: {kind} in [tolerances] of the rotor file"
            said = f"drawn {kind}", size, f"exact: {size} of error", cure
            yield from _by_rows(fit, said, found, held=None)


def _misread(at: Evaluation, record: Observation, errors: Complexes) -> Complexes:
    """Return what readings too large by errors, (line, sensor), do to the equations, (line, row).

    The forces that a law makes of them are too large by its slope, which is taken as even.
    """
    rows = at.plain[:, :, at.forces :] @ errors[:, :, None]
    for force, passed in record.passed.items():
        weights = [passed.law.position.get(name, 0.0) for name in _sensors(at, record)]
        size = (errors @ weights)[:, None, None] * float(np.mean(passed.slope))
        rows = rows + at.plain[:, :, [force]] * size
    return as_complex(-rows[:, :, 0])


def _sensors(at: Evaluation, record: Observation) -> list[str]:
    return [record.lines.channels[column].name for column in at.problem.order[at.forces :]]


def _crosstalk(at: Evaluation, record: Observation) -> Rows:
    """Return a share of each sensor's reading in the next one of its unit, and back."""
    names, units = _sensors(at, record), {c.name: c.unit for c in record.lines.channels}
    true = CROSSTALK * (at.state.factors * at.corrected()[0])[:, at.forces :]
    each = np.eye(len(names))
    return {
        f"cross-talk[{names[i]}, {names[j]}]": _misread(at, record, true[:, [j]] * each[i])
        for k in range(len(names) - 1)
        for i, j in ((k, k + 1), (k + 1, k))
        if units[names[i]] == units[names[j]]
    }


def _analysers(fit: Fit) -> Iterator[Assumed]:
    """Yield the bias of H1, or of H2, and the window, of responses that an analyser made."""
    every, found = list(zip(fit.solution.point.records, fit.records, strict=True)), list[Rows]()
    shares = [_noise_of_force(at, record.lines) for at, record in every]
    for (at, record), share in zip(every, shares, strict=True):
        inputs = zip(record.inputs, record.input_columns, strict=True)
        of = ", ".join(c.name for c, column in inputs if record.lines.mean[:, column].any())
        error = share * at.corrected()[0][:, at.forces :]
        found.append({f"H1[{of}]": _misread(at, record, error)} if share else {})
    size = f"noise of {100 * max(shares, default=0.0):.2g} % of the force's power"
    cure = "H2 errs the other way; H over the generator's signal, with its std, does not"
    yield from _by_rows(fit, ("H1", size, f"unbiased: {size}", cure), found, shown=True)
    made = (record.lines.analyser for record in fit.records)
    spacing = max((each.spacing for each in made if each is not None), default=0.0)
    cure = 'state window ("none": bursts, impacts, stepped sines), or measure finer lines'
    for window in WINDOWS:
        errors = ((*each, blurred(*each, window)) for each in every)
        of, size = f"window[{window}]", f"{window}, lines of {spacing:.3g} Hz"
        found = [{} if e is None else {of: _misread(at, r, e)} for at, r, e in errors]
        yield from _by_rows(fit, ("window", size, f"narrow: {size}", cure), found)


def _speeds(fit: Fit) -> Iterator[Assumed]:
    """Yield the stated speeds of rotations beside the periods, whose angle no mark measures.

    A speed that is off makes the periods scatter, by which lines are weighed: no misfit shows it.
    """
    found, slips = list[Rows](), [0.0]
    for k, (at, record) in enumerate(zip(fit.solution.point.records, fit.records, strict=True)):
        periodic = record.periodic
        rotation = None if periodic is None else periodic.rotation
        if periodic is None or rotation is None or rotation.moved is None:
            found.append({})
            continue
        own = int(np.searchsorted(periodic.frequency, periodic.turns * periodic.fundamental))
        moved = np.insert(rotation.moved[:-1], own, rotation.moved[-1], axis=0)
        there = np.array(at.problem.order) < moved.shape[1]  # inputs without a channel stand behind
        columns = moved[:, np.array(at.problem.order)[there], None]
        found.append({f"speed[{k}]": as_complex((at.columns[:, :, there] @ columns)[:, :, 0])})
        slips.append(rotation.slip)
    size = f"{max(slips) * 30 / np.pi:.2g} rpm"
    cure = "record a mark (encoder or keyphasor), or more periods, which tell the speed"
    for one in _by_rows(fit, ("speed", size, f"as stated: {size} of error", cure), found):
        yield replace(one, effect=one.effect - fit.solution.point.linear.rest(one.effect))


def _slips(fit: Fit) -> Iterator[Assumed]:
    """Yield stated speeds that neither a mark nor the rotation in the lines confirms."""
    found = list[Rows]()
    for k, (at, record) in enumerate(zip(fit.solution.point.records, fit.records, strict=True)):
        still = not record.lines.speed.any() or record.lines.marked
        beside = record.periodic is not None and record.periodic.rotation is not None
        if still or beside or np.linalg.norm(at.whitened_loads(at.loads)) > BEYOND:
            found.append({})
        else:
            found.append({f"speed[{k}]": _slipped(at, fit.layout.of_record(k), record.lines)})
    cure = "record a mark (encoder or keyphasor)"
    yield from _by_rows(fit, ("speed", "1 %", "as stated: a slip of 1 %", cure), found)


def _slipped(at: Evaluation, layout: Layout, lines: Lines) -> Complexes:
    """Return what a speed does to the equations that is a share of the stated one too large."""
    stiffness, damping, mass = _by_error(
        lambda part: pencil_at(layout, part * float(lines.speed[0])).matrices(at.unknowns)
    )
    scales, s = at.problem.scales, 1j * lines.omega[:, None]
    motion = at.corrected()[1] * scales.coordinates
    forces = motion @ stiffness.T + s * (motion @ damping.T + s * (motion @ mass.T))
    rows = np.zeros((len(s), at.problem.all_rows), dtype=np.complex128)
    rows[:, : at.equations] = -forces / scales.rows[: at.equations]
    return rows


def _noise_of_force(at: Evaluation, lines: Lines) -> float:
    """Return a of the noise ``a |H|^2 + b`` that coherences show, b one of each reading.

    Noise of the force is in proportion to what it would cause. H1 is too small by a, as H2 is too
    large where the noise is one of readings. What the force makes is in every line: none has less,
    but for the scatter of coherences, also where the noise of readings is another at each line.
    """
    made, sensors = lines.analyser, at.problem.order[at.forces :]
    if made is None or made.averages is None:
        return 0.0
    noise = (made.averages - 1) * np.einsum("kii->ki", lines.covariance.matrices)[:, sensors].real
    size = np.abs(at.corrected()[0][:, at.forces :]) ** 2
    even = np.broadcast_to(np.eye(len(sensors)), (*noise.shape, len(sensors)))
    parts = np.concatenate([size[:, :, None], even], axis=2)[noise > 0]
    noise, weight, found = noise[noise > 0], noise[noise > 0], np.zeros(1)
    least = np.quantile(noise / parts[:, 0], 0.25) if len(noise) else 0.0
    most = least * (1 + 2 / np.sqrt(made.averages))
    for _ in range(3):  # its own scatter is in proportion to what the noise is
        scaled = parts / weight[:, None]
        scale = column_lengths(scaled)
        found = scipy.optimize.nnls(scaled / scale, noise / weight)[0] / scale
        weight = parts @ found
    return float(min(found[0], most))


def _led_by_the_angle(fit: Fit) -> Iterator[Note]:
    layout, free = fit.layout, fit.layout.free
    turning = {int(i) for _, _, at in layout.wherever(Turns) for i in at}
    turned = [k for k, i in enumerate(free) if i in turning and layout.unknowns[i].std]
    std = fit.inference.std
    unit = np.where((std > 0) & np.isfinite(std), std, np.inf)
    share = np.abs(fit.inference.covariance / unit / unit[:, None])[:, turned]
    most = (free < layout.named) & (share.max(axis=1, initial=0.0) > LED)
    if led := ", ".join(layout.names(most)):
        worst = np.degrees(max(layout.unknowns[free[k]].std or 0.0 for k in turned))
        text = (
            f"known to {worst:.2g} deg, which is most of the deviations of {led}: "
            "state the speed to more digits, or record a mark; with one, state how far the delay "
            "between mark and columns is known, by angle_lag_std: one sample at most is taken"
        )
        yield Note("rotor angle", "says", text)
