"""Doubts about an answer: a catalogue of functions that yield notes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from rotorid.answer import machine_checks
from rotorid.answer.derived import deviation
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import Status
from rotorid.core.errors import InputError
from rotorid.core.notes import Note
from rotorid.core.units import dimension_of
from rotorid.core.values import Floats
from rotorid.data.lines import SampledClock
from rotorid.data.observation import Observation
from rotorid.likelihood.assembly import assemble
from rotorid.likelihood.assumptions import assumed
from rotorid.likelihood.cost import Evaluation
from rotorid.likelihood.doubts_angle import ANGLE, against_angle, told
from rotorid.likelihood.fit import Fit
from rotorid.likelihood.inference import likeness
from rotorid.likelihood.mode_rows import pencil_at
from rotorid.likelihood.profile import profiled
from rotorid.likelihood.rivals_read import SPEEDS, is_response, is_table
from rotorid.likelihood.unknowns import Scalar
from rotorid.models import Model
from rotorid.models.modal import eigenmodes

Doubt = Callable[[Fit], Iterable[Note]]
CATALOGUE: list[tuple[Doubt, tuple[Status, ...]]] = []
"""Each doubt, and the statuses of answers on which it is cast, none for any; as they are told."""


def doubt(*when: Status) -> Callable[[Doubt], Doubt]:
    def entered(function: Doubt) -> Doubt:
        CATALOGUE.append((function, when))
        return function

    return entered


def doubted(model: Model, estimate: Estimate, fit: Fit, *, speed: bool = False) -> Estimate:
    """Return an answer with all doubts about it; `speed`: one is suspected to be wrong."""
    judged, whole = estimate, fit.layout
    if whole.named > whole.parameters:  # where records have their own, the first's
        held = whole.of_record(0).held
        found = {v.name: v for v in estimate.parameters}
        pairs = zip(held, model.parameter_names, strict=True)
        values = tuple(replace(found[whole.unknowns[i].name], name=name) for i, name in pairs)
        free = [int(i) for i in held if not whole.unknowns[i].fixed]
        covariance = fit.covariance[np.ix_(free, free)]
        judged = estimate.with_(parameters=values, nuisance=(), derived=(), covariance=covariance)
    notes = machine_checks.physical(model, judged)
    for cast, when in CATALOGUE:
        if (not when or estimate.status in when) and not (speed and cast is straying):
            notes += cast(fit)
    estimate = estimate.with_notes(*notes)
    if estimate.status == "ok":
        return assumed(profiled(estimate, fit), fit)
    # What the others have made of the answer may call for it.
    return estimate.with_notes(*blocks_scatter(fit)) if estimate.status == "rejected" else estimate


def _determined(fit: Fit) -> bool:
    return fit.solution.converged and not fit.inference.linear.null.shape[1]


TELLING = 1e-6  # share of the largest singular value of a half's scaled Jacobian that tells nothing
LEAST_PERIODS = 4  # periods of a part from which it is held against others


@doubt("ok", "rejected")
def halves_differ(fit: Fit) -> Iterable[Note]:
    names, point, records = fit.layout.names(), fit.solution.point, fit.records
    if (parted := answers_of_parts(fit, 2)) is not None:
        turning = {fit.layout.unknowns[i].name for i in fit.problem.affine}
        return machine_checks.agreement(names, parted, fit.inference.std, turning)
    # Of whole records: a step of Gauss-Newton with the lines of each half alone.
    cut = [record.lines.parts for record in records if record.lines.parts is not None]
    if not cut or len(cut) < len(records):
        return ()
    linear = []
    try:
        for lines in zip(*(parts(2) for parts in cut), strict=True):
            halves = [r.with_lines(half) for r, half in zip(records, lines, strict=True)]
            if any(r.lines.names != h.lines.names for r, h in zip(records, halves, strict=True)):
                return ()
            there = point.problem.of(halves).at(point.unknowns)
            linear.append(there.linear.cut(TELLING))
    except (InputError, np.linalg.LinAlgError):  # too short
        return ()
    std = np.hypot(linear[0].std, linear[1].std) / 2
    lost = linear[0].undetermined | linear[1].undetermined | ~np.isfinite(std)
    steps = np.array([-at.taken(at.residual) for at in linear])
    return machine_checks.agreement(names, steps, np.where(lost, 0.0, std))


def answers_of_parts(fit: Fit, parts: int) -> Floats | None:
    """Return how parts of the periods differ to first order, (part, free); None if too few."""
    point, records = fit.solution.point, fit.records
    if not records or any(r.lines.periods < parts * LEAST_PERIODS for r in records):
        return None
    columns = []
    for number, (record, at) in enumerate(zip(records, point.records, strict=True)):
        scatter, clock = record.lines.scatter, record.lines.clock
        assert scatter is not None
        every = at.period_residual(scatter[:, :, at.problem.order])
        mean = every.mean(axis=0)
        means = [part.mean(axis=0) - mean for part in np.array_split(every, parts)]
        changes = at.stacked(np.stack(means, axis=2))
        columns.append(changes)
        if not isinstance(clock, SampledClock) or clock.orders:
            continue
        if len(clock.grid(timed=False)[0]) == 1:
            continue
        # The rotation is not synchronous with the periods: its loads turn from part to part.
        for k, part in enumerate(np.array_split(np.arange(len(clock.time)), parts)):
            shorter = replace(clock, time=clock.time[part], angle=clock.angle[part])
            other = record.with_lines(replace(record.lines, clock=shorter))
            likelihood = assemble(point.problem.layout, other, number)
            own = Evaluation(likelihood, at.unknowns, like=at)
            changes[:, k] += own.residual - at.residual
    known = np.zeros((len(point.known), parts))
    return -point.linear.taken(np.concatenate([*columns, known])).T


FAR = 30.0
"""Factor by which a stiffness is off its start, at least, before the unit of speed is doubted: of
the units that are mistaken, rad/s for Hz changes it least, by 39."""
NEAR = 3.0  # factor within which the answer lies about its start once the unit is put right
SURE = 1000.0
"""Factor of a stiffness from which on the answer is turned away: rpm for Hz, 3600; nobody's start
is off by so much and right in every parameter but for the one factor of time."""


@doubt()
def unit_of_speed(fit: Fit) -> Iterator[Note]:
    """Say that the speeds of tables look like those of another unit (section 12).

    With all speeds a factor f off, stiffnesses are f^2 and dampings f times what they are; with
    all frequencies of responses, masses are f^-2 times.
    """
    records, layout, unknowns = fit.records, fit.layout, fit.solution.point.unknowns
    force = bool(records) and all(map(is_response, records))
    if not records:
        what = "the measured natural frequencies"
    elif len(fit.problem.known.modes):
        return  # two kinds of data hold each other's unit
    elif force or all(map(is_table, records)):
        what = "the frequencies of the responses" if force else "the speeds of the table"
    else:
        return
    inner = [int(i) for i in layout.free if i < layout.parameters]
    powers = {i: _of_time(layout.unknowns[i], force) for i in inner}
    at = [i for i, power in powers.items() if power and unknowns[i] * layout.start[i] > 0]
    if not at:
        return
    power = np.array([powers[i] for i in at])
    ratio = np.log(np.maximum(unknowns[at] / layout.start[at], 1e-300))
    if np.abs(ratio * 2 / power).max() < np.log(FAR):
        return
    off = {said: float(np.abs(ratio + power * np.log(f)).max()) for said, f in SPEEDS.items()}
    said = min(off, key=lambda name: off[name])
    factor = SPEEDS[said]
    if off[said] > np.log(NEAR) or factor in (0.5, 2.0):
        return
    names = ", ".join(layout.unknowns[i].name for i in at)
    text = (
        f"{names} are far off their start, and within a factor {np.exp(off[said]):.2g} of it with "
        f"{what} {factor:.4g} times as large ({said}): the data cannot tell, so check their "
        "unit, or give a nearer start"
    )
    sure = max(factor, 1 / factor) ** 2 > SURE
    yield Note("unit of the speed", "rejects" if sure else "doubts", text)


def _of_time(unknown: Scalar, force: bool) -> float:
    """Return the power of 1 / time in a parameter: 2 of a stiffness, where masses stay.

    Where forces stay, 0 of a stiffness, and -2 of a mass: kg = N s^2 / m.
    """
    powers = dict(dimension_of(unknown.unit).powers)
    return -float(powers.get("s", 0)) - (2 * float(powers.get("kg", 0)) if force else 0.0)


@doubt()
def creeping_angle(fit: Fit) -> Iterator[Note]:
    for record, creep in zip(fit.records, fit.creeps, strict=True):
        if creep is not None and (creep.strays or creep.jumps):
            yield Note(ANGLE, "rejects", told(record, creep))
        elif creep is not None and creep.creeps:
            yield Note(ANGLE, "doubts", f"{told(record, creep)}; until then its angle is unsure")


@doubt()
def straying(fit: Fit) -> Iterator[Note]:
    return against_angle(fit.solution.point, fit.records)


GROWS = 3.0
"""Deviations by which a damping is below zero before it counts: no free machine that grows has a
steady response, and a damping of zero is estimated as often below as above."""
NONE = 1e-9  # damping ratio below which a growth is rounding: of a model without damping


@doubt()
def growing(fit: Fit) -> Iterator[Note]:
    layout, unknowns, covariance = fit.layout, fit.solution.point.unknowns, fit.covariance
    linear = layout.model.require_linear()
    if not _determined(fit) or linear.rows != linear.coordinates:
        return
    for number, record in enumerate(fit.records):
        if not is_response(record):
            continue
        pencil = pencil_at(layout.of_record(number), float(record.lines.speed[0]))
        stiffness, damping, mass = pencil.matrices(unknowns)
        modes = eigenmodes(mass, damping, stiffness)
        for value, left, right in zip(modes.values, modes.left, modes.right, strict=True):
            gram = left.conj() @ (2 * value * mass + damping) @ right
            slope = pencil.slopes(value, left[None], right[None], unknowns)[0, 0] / gram
            std = deviation(slope.real, covariance)
            if value.real > max(GROWS * std, NONE * abs(value)):
                text = (
                    f"a mode at {value.imag / (2 * np.pi):.4g} Hz with a damping ratio of "
                    f"{-value.real / abs(value):.3g}: a machine that grows by itself has no "
                    "frequency response, so the phases count the other way (set lag = true in "
                    "the channels), or a response has the wrong sign"
                )
                yield Note("growing mode", "rejects", text)
                return


CLOSED = 0.1
"""Mean coherence between the noise of inputs and sensors, beyond that of chance, that shows a
closed loop (a levitated rotor has .4)."""
FEW = 10.0
"""Lines that tell an unknown, below which its deviation is unsure: of a damping ratio of .005 in a
closed loop, 3 to 6 lines scatter by 2.5 to 4.3 deviations, 20 lines by 1.1."""


def coherence(record: Observation) -> float:
    """Return the mean coherence of the noise of inputs and sensors, less that of chance."""
    matrices = record.lines.covariance.matrices
    inputs, sensors = list(record.input_columns), [s.column for s in record.sensors]
    power = np.einsum("kii->ki", matrices).real
    cross = np.abs(matrices[:, inputs][:, :, sensors]) ** 2
    whole = power[:, inputs][:, :, None] * power[:, sensors][:, None, :]
    if not (whole > 0).any():
        return 0.0
    found = float((cross[whole > 0] / whole[whole > 0]).mean())
    return found - 1 / max(record.lines.covariance.dof, 1)


@doubt()
def told_by_few(fit: Fit) -> Iterator[Note]:
    point, records, layout = fit.solution.point, fit.records, fit.layout
    closed = any(r.lines.parts is not None and coherence(r) > CLOSED for r in records)
    if not closed or not _determined(fit):
        return
    kept = np.isin(layout.free, list({*layout.held.tolist()} - layout.load_only()))
    shares = [rows.sum(axis=1) for rows in point.by_line(point.linear.told_by().T)]
    hertz = np.concatenate([record.lines.frequency for record in records])
    for name, held, each in zip(fit.layout.names(), kept, np.concatenate(shares).T, strict=True):
        count = float(each.sum() ** 2 / (each**2).sum()) if held and each.any() else np.inf
        if count >= FEW:
            continue
        text = (
            f"{name} is told by {count:.2g} lines about {hertz[each.argmax()]:.4g} Hz, closer than "
            "the window in which noise is told from motion: in a closed loop noise changes there, "
            "and the deviation may be several times too small"
        )
        yield Note("few lines", "doubts", text, "record several times longer", on=(name,))


TOO_GOOD = 1e-6  # chance of a cost this low below which the noise was taken for more than it is
POWER = 12
"""Periods per sensor below which, in closed loop, the misfit test has no power: J / E[J] is .37
there for a right model, since what carries over between periods cancels in the mean."""
MISFIT = 1e-3  # p-value below which what neighbouring lines have in common may be the model's error
ORDERLY = 3.0  # deviations of a correlation from row to row beyond which rows are not independent
STILL = 1e-6  # scatter over a deviation below which blocks tell no value: it is known beforehand
BLOCKS = 8  # parts of a record whose scatter is told beside the stated deviations


@doubt()
def too_good(fit: Fit) -> Iterator[Note]:
    cost, expected = fit.solution.point.cost, fit.inference.expectation
    # Of measured modes alone the deviations are what the user stated.
    if not fit.records or expected.dof <= 0 or not 1 - expected.p_value(cost) < TOO_GOOD:
        return
    said, cure = f"the misfit is {cost:.4g} where {expected.mean:.4g} is expected", ""
    if all(record.lines.covariance.kind == "stated" for record in fit.records):
        said += (
            f": the stated std is too large, {np.sqrt(cost / expected.mean):.2g} times as much "
            "would do, and deviations are too wide"
        )
    else:
        said += (
            ", too good to be chance: the scatter that was taken for noise holds more than noise "
            "(settling, drift, motion that carries over between periods), and deviations are too "
            "wide"
        )
        cure = "skip more, record longer, or look at the record with rotorid inspect"
    yield Note("too good", "doubts", said, cure)


@doubt("rejected")
def scattered(fit: Fit) -> Iterator[Note]:
    if not all(map(is_table, fit.records)):
        return
    order, count = 0.0, 0.0
    for at in fit.solution.point.records:
        left = at.problem.data - at.corrected()[0]
        size = np.sqrt((np.abs(left) ** 2).mean(axis=0))
        left = left[:, size > 0] / size[size > 0]
        order += float((left[1:] * left[:-1].conj()).real.sum())
        count += left[1:].size
    # Independent rows give a correlation of zero within 1 / sqrt(2 numbers).
    if abs(order) < ORDERLY * np.sqrt(count / 2):
        times = float(np.sqrt(fit.solution.point.cost / fit.inference.expectation.mean))
        text = (
            "what the model leaves has no order from row to row: perhaps it is noise, and the "
            f"stated std is too small ({times:.2g} times as much would do), or the speeds are "
            "rounded"
        )
        yield Note("order of rows", "doubts", text, value=times, unit="1")


@doubt()
def few_periods(fit: Fit) -> Iterator[Note]:
    for record in fit.records:
        periods, sensors = record.lines.periods, len(record.sensors)
        white = record.lines.covariance.kind == "white" and record.lines.scatter is not None
        if white and periods < POWER * sensors and coherence(record) > CLOSED:
            text = (
                f"{periods} periods for {sensors} sensors in closed loop: below {POWER * sensors} "
                "the misfit hardly tells a wrong model from a right one, and deviations are too "
                "wide"
            )
            yield Note("few periods", "doubts", text, "record more periods")


@doubt()
def sensors_alike(fit: Fit) -> Iterator[Note]:
    shared = fit.shared
    if shared is not None:
        text = (
            f"{', '.join(shared.names[:8])} share noise on each line, as of a force that was "
            "not measured, where each was stated by itself: deviations are widened by up to "
            f"{shared.factor:.2g}, to what the lines scatter by"
        )
        yield Note("shared noise", "doubts", text, on=shared.names)


@doubt()
def lines_alike(fit: Fit) -> Iterator[Note]:
    misfit = fit.inference.expectation.p_value(fit.solution.point.cost) < MISFIT
    for record, at in zip(fit.records, fit.solution.point.records, strict=True):
        correlation = likeness(at, record)
        if misfit or not correlation:
            continue
        names = ", ".join(sensor.channel.name for sensor in record.sensors)
        text = (
            f"the residuals of neighbouring lines of {names} are alike (correlation "
            f"{correlation:.2f}), as a window such as Hann makes them: deviations and misfit "
            "hold what lines through one have in common; keep every second line (every = 2)"
        )
        yield Note("neighbouring lines", "doubts", text)


def blocks_scatter(fit: Fit) -> Iterator[Note]:
    most = min((r.lines.periods // LEAST_PERIODS for r in fit.records), default=0)
    parts = min(BLOCKS, most)
    answers = answers_of_parts(fit, parts) if parts >= 3 else None
    if answers is None:
        return
    std = fit.inference.std
    with np.errstate(over="ignore"):  # blocks of an estimate astray may end anywhere
        spread = answers.std(axis=0, ddof=1) / np.sqrt(parts)
    stated = (std > 0) & np.isfinite(std) & (spread > STILL * std) & np.isfinite(spread)
    ratio = spread[stated] / std[stated]
    if ratio.size:
        text = (
            f"between {parts} blocks of the record the answers scatter by {ratio.min():.2g} to "
            f"{ratio.max():.2g} times the stated deviations: this shows repeatability, not "
            "model validity"
        )
        yield Note("blocks", "remarks", text)
