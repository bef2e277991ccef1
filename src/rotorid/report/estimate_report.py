"""Pages of an estimate, and of a record that it predicts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from markupsafe import Markup

from rotorid.answer.estimate import (
    ERR,
    FAR,
    ROUNDING,
    Estimate,
    figures,
    on_data,
    on_fit,
    row_of,
    two_digits,
    value_tables,
)
from rotorid.answer.parts import (
    DOUBTFUL,
    EXPLAINS,
    UNDER,
    ChannelEvidence,
    Prior,
    RecordEvidence,
    ResponseEvidence,
    Value,
)
from rotorid.answer.predict import ChannelError
from rotorid.answer.predict import verdict_of as validated
from rotorid.core.errors import InputError
from rotorid.core.tables import Table, table
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.linear.family import Information
from rotorid.models import Model, shipped_models
from rotorid.models.rotor import RotorModel
from rotorid.report import drawn
from rotorid.report.html import Mood, Passage, equations, marked, page_of, rendered
from rotorid.report.machines import machine_part
from rotorid.report.records import cell, told_table
from rotorid.results.loops import plant_response
from rotorid.results.machine import Machine, machine_of, own_model, shares_of
from rotorid.results.modes import amplitude_std

AS_NOISE = 1.5
"""Difference over noise, root mean square, up to which a channel is predicted as well as noise
allows: with tens of lines chance makes 1.3 of it."""
TOLD = 0.5
"""Relative error from which on it is not told: a prediction from noisy forces beside a resonance
says nothing of the fit, which the misfit does."""
METHODS = {
    "ml": "maximum likelihood",
    "batch": "batch least squares",
    "sequential": "sequential least squares",
    "ls": "least squares",
}
MOODS: dict[str, Mood] = {"ok": "good", UNDER: "good", "doubtful": "doubt"}
"""How a verdict is coloured; all others are bad."""


Named = TypeVar("Named", ChannelEvidence, ChannelError)


@frozen
class Verdict:
    sentence: str
    steps: tuple[str, ...] = ()
    left_open: tuple[str, ...] = ()


def verdict_of(estimate: Estimate) -> Verdict:
    warnings = tuple(estimate.warnings)
    if estimate.status == "ok":
        free = sum(not value.fixed for value in estimate.parameters)
        few = "this parameter explains" if free == 1 else f"these {free} parameters explain"
        text = f"Accepted: {few} {_explained(estimate) or 'the records'}"
        text = f"{text}{_misfit_against_noise(estimate)}."
        if estimate.verdict == UNDER:
            first = estimate.assumptions[0]
            text += (
                f" The values rest on what was assumed: an error of {first.size} ({first.assumed}) "
                f"would shift {first.parameter} by {two_digits(first.moves)} std, and the "
                "record would not show it."
            )
        return Verdict(text, warnings)
    if estimate.status == "rejected":
        return Verdict(_rejected(estimate), warnings)
    if estimate.status == "not_identifiable":
        return _open(estimate)
    told = "Not converged: the search did not arrive at an answer, and the values are none."
    return Verdict(told, warnings)


def _explained(estimate: Estimate) -> str:
    errors = {n: p.relative_error for n, p in estimate.prediction.items() if p is not None}
    if not errors:
        return f"{len(estimate.modes)} natural frequencies" if estimate.modes else ""
    records = estimate.evidence.records if estimate.evidence else ()
    units = {c.unit for record in records for c in record.channels if c.name in errors}
    kinds = {"N": "forces", "m": "positions", "A": "currents"}
    told = kinds.get(units.pop(), "channels") if len(units) == 1 else "channels"
    worst = max(errors.values())
    count = f"{len(errors)} {told}" if len(errors) > 1 else next(iter(errors))
    return f"{count} to {100 * worst:.2g} %" if worst < TOLD else count


def _misfit_against_noise(estimate: Estimate) -> str:
    if estimate.misfit is not None:
        p = estimate.misfit.p_value
        if not estimate.misfit.dof:
            return "; as many unknowns as equations, so that nothing tells how well"
        if p >= DOUBTFUL:
            return ", as well as the noise allows"
        return f", though not as well as the noise allows (chance {p:.1g}): read what follows"
    records = estimate.evidence.records if estimate.evidence else ()
    every = (_over_noise(channel) for record in records for channel in record.channels)
    ratios = [ratio for ratio in every if math.isfinite(ratio)]
    if not ratios:
        return "; nothing tells how much of the rest is noise"
    worst = max(ratios)
    if worst <= AS_NOISE:
        return ", as well as the noise allows"
    return f"; the rest is up to {worst:.2g} times what noise makes"


def _over_noise(channel: ChannelEvidence) -> float:
    """Return the difference over the noise, root mean square over all lines; NaN if unknown."""
    if not (channel.difference and channel.noise):
        return math.nan
    noise, wrong = (float(np.mean(np.square(x))) for x in (channel.noise, channel.difference))
    return math.sqrt(wrong / noise) if noise > 0 else math.nan


def _rejected(estimate: Estimate) -> str:
    text = "Rejected: the values below do not explain the records"
    if estimate.misfit is not None and estimate.misfit.expected > 0:
        times = estimate.misfit.cost / estimate.misfit.expected
        if times > 1:
            text += f", whose misfit is {two_digits(times)} times what noise leaves"
    if not estimate.suspects:
        return f"{text}. Nothing that was tried explains it alone."
    first = estimate.suspects[0]
    if first.share is not None and first.share < EXPLAINS:
        return f"{text}. No single cause explains 20 % of it."
    share = "" if first.share is None else f", which would explain {100 * first.share:.0f} % of it"
    freed = ""
    if first.value is not None:
        unit = "" if first.unit in ("", "1") else f" {first.unit}"
        freed = f" (freed it comes to {first.value:.4g}{unit})"
    return f"{text}. What stands out: {first.term}{share}{freed}."


def _open(estimate: Estimate) -> Verdict:
    open_notes = [note for note in estimate.notes if note.severity == "open"]
    left = [note.found for note in open_notes if note.found]
    cures = [note.cure for note in open_notes if note.cure]
    others = [note.text for note in estimate.on_answer if note.severity != "open"]
    told = "the records do not determine every parameter"
    if len(left) > 2:
        told = f"{left[0]}, and {len(left) - 1} more combinations"
    elif left:
        told = "; ".join(left)
    elif estimate.alternatives:
        count = len(estimate.alternatives)
        told = f"{count + 1} answers fit as well as one another"
    every = tuple(left) if len(left) > 2 else ()
    return Verdict(f"Not identifiable: {told}.", (*cures, *others), every)


WIDTH = 140  # of a row's bars, in pixels
_MARGIN = 4
PM = "\N{PLUS-MINUS SIGN}"
Ends = tuple[float, float]


@frozen
class Row:
    name: str
    value: str
    half: str
    percent: str
    unit: str
    assumed: str = ""
    before: str = ""
    moved: str = ""
    # intervals before and now on one scale: their ends in pixels, and in words
    bar: tuple[Ends, Ends, str] | None = None


def groups(estimate: Estimate) -> list[tuple[str, list[Row]]]:
    known = estimate.evidence
    titles = ("", "nuisance parameters", "derived")
    found = [
        (title, [_row(v, known.prior(v.name) if known else None) for v in part if not v.fixed])
        for title, part in zip(titles, estimate.quantities.values(), strict=True)
    ]
    return [(title, rows) for title, rows in found if rows]


def _parameters(estimate: Estimate) -> Passage:
    known = estimate.evidence
    any_known = known is not None and any(known.prior(value.name) for value in estimate.free)
    told = "With standard deviations, or a 95 % interval where it is not symmetric."
    assuming = any(value.std_assumed is not None for value in estimate.parameters)
    if assuming:
        told += f' "{ERR}": how far plausible errors of the assumptions would shift each value.'
    if any_known:
        told += " Bars: prior in grey, result in blue, each row on a scale of its own."
    if estimate.status == "rejected":
        told += " The data reject the model: the intervals do not cover what it lacks."
    held = [f"{v.name} = {v.value:.6g}{_unit(v.unit)}" for v in estimate.parameters if v.fixed]
    more = ("Also known", "; ".join(relations(estimate))), ("Fixed", ", ".join(held))
    return Passage(
        "Parameters",
        told,
        body=rendered(
            "parameters.html", groups=groups(estimate), known=any_known, assuming=assuming
        ),
        after=" ".join(f"{what}: {said}." for what, said in more if said),
    )


def relations(estimate: Estimate) -> list[str]:
    units = {value.name: value.unit for value in (*estimate.parameters, *estimate.nuisance)}
    told = []
    for prior in estimate.evidence.known if estimate.evidence else ():
        if prior.name not in units:
            spread = f" {PM} {prior.std:.2g}" if prior.std else " exactly"
            terms = {units.get(term.strip()) for term in re.split(r"[+-]", prior.name)}
            unit = (terms.pop() or "") if len(terms) == 1 else ""  # of a sum of one unit
            told.append(f"{prior.name} = {prior.value:.6g}{spread}{_unit(unit)}")
    return told


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


def _row(value: Value, prior: Prior | None) -> Row:
    name, number, std, percent, _, assumed, interval, unit = row_of(value)
    row = Row(name, number, interval or std, "" if interval else percent, unit, assumed)
    if not math.isfinite(value.value):
        row = replace(row, value="not determined", half="")
    if prior is None:
        return row
    moved = ""
    if prior.std > 0 and math.isfinite(value.value):
        away = (value.value - prior.value) / prior.std
        moved = "0 std" if abs(away) < ROUNDING else f"{away:+.2g} std"
    moved = moved.replace("-", "\N{MINUS SIGN}")
    bar = None if value.interval else _bar(value, prior)
    return replace(row, before=_interval(prior), moved=moved, bar=bar)


def _interval(known: Value | Prior) -> str:
    if not known.std:
        return f"{known.value:.6g} exactly"
    return f"{figures(known.value, known.std)} {PM} {two_digits(known.std)}"


def _bar(value: Value, prior: Prior) -> tuple[Ends, Ends, str] | None:
    half, before = value.std or 0.0, prior.std
    low = min(prior.value - before, value.value - half)
    high = max(prior.value + before, value.value + half)
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return None
    scale = (WIDTH - 2 * _MARGIN) / (high - low)

    def pixels(middle: float, reach: float) -> Ends:
        at, wide = _MARGIN + scale * (middle - low), max(scale * reach, 0.5)  # to be seen
        return round(at - wide, 1), round(at + wide, 1)

    told = f"before {_interval(prior)}, now {_interval(value)}"
    return pixels(prior.value, before), pixels(value.value, half), told


BEYOND, BETWEEN = 1.2, 300  # factor by which a response is drawn beyond its lines, and its points
KINDS = {
    "periods": "periods",
    "lines": "lines of the whole record",
    "phasors": "table of 1x phasors",
    "responses": "frequency responses",
    "samples": "filtered samples",
}
EARLY = ("unbalance", "suspect", "other answers")
"""Tables that stand before the pictures."""
TITLES = {
    "unbalance": "Unbalance in each plane",
    "suspect": "Possible causes of the misfit",
    "other answers": "Equivalent solutions",
    "check": "Checks of the records and assumptions",
    "natural frequencies": "Measured natural frequencies",
}
PREDICTED = (
    "The prediction error over what was measured, what the noise of all channels alone makes of "
    "it, and the ratio of both: near 1 is as good as the noise allows."
)
MEASURED = (
    "Measured: the model's response plus the residual of the position over the force, so that "
    "other forces and loads are those of the model. Bars and bands hold 95 %; lines whose bar is "
    "longer than the response are left out."
)
EXACT = "Errors of these would shift the values so far, and no misfit would show it."
WITHOUT = (
    "This result holds no evidence of its records, so nothing of them is drawn: identify again "
    "with this version, in Python with_evidence."
)


def estimate_report(estimate: Estimate) -> str:
    remarks = () if estimate.evidence else (WITHOUT,)
    model = None
    try:
        model = own_model(estimate)
    except InputError as error:
        lacking = f"{error.found}: the equations of motion are not shown; {error.cure}."
        remarks = (lacking, *remarks)
    records = estimate.evidence.records if estimate.evidence else ()
    values = value_tables(estimate)
    tables = (one for one in estimate.summary() if isinstance(one, Table))
    others = [one for one in tables if one.headings[0] not in values]
    speeds = [v for record in records for v in record.speed_rad_s if math.isfinite(v)]
    verdict, fastest = verdict_of(estimate), max(speeds, key=abs, default=0.0)
    exact = tuple(
        on_data(check) for check in estimate.checks if check.severity in ("assumes", "says")
    )
    status = estimate.verdict.replace("_", " ")
    responses = [] if model is None else list(_responses(estimate, records))
    pictures = list(record_pictures(records))
    shown = responses if responses and estimate.status == "ok" else pictures[2:]
    page = Passage(
        model.title if model is not None and model.title else estimate.model,
        lead=marked("Model <code>{}</code>, identified by {}", estimate.model, _method(estimate)),
        badge=status,
        verdict=verdict.sentence,
        mood=MOODS.get(estimate.verdict, "bad"),
        urge="To mind:" if estimate.status == "ok" else "What to do next:",
        steps=verdict.steps,
        numbers=tuple(_numbers(estimate, records)),
        picture=shown[0] if shown else None,
        said=remarks,
        parts=(
            Passage("Undetermined combinations", items=verdict.left_open),
            _parameters(estimate),
            *(_titled(one) for one in others if one.headings[0] in EARLY),
            Passage("Prediction error by channel", PREDICTED, channels_table(records)),
            Passage("Assumptions and their effect", EXACT, items=exact),
            _rotor(model),
            *responses,
            *pictures,
            *_own_pictures(estimate, records),
            *([] if model is None or model.linear is None else [machine_part(estimate, fastest)]),
            *(_titled(one) for one in others if one.headings[0] not in EARLY),
            _statistics(estimate),
            Passage("Records", table=records_table(records)),
            *equations(model),
            *_work(estimate, model),
        ),
    )
    return page_of(page, tab=f"{estimate.model}, {estimate.method}: {status}")


def _statistics(estimate: Estimate) -> Passage:
    graver = [check for check in estimate.checks if check.severity in ("warns", "refuses")]
    warned = (f"{check.verdict}, {on_data(check)}" for check in graver)
    return Passage("Fit statistics", items=(*on_fit(estimate), *warned))


def _rotor(model: Model | None) -> Passage:
    drawing = (drawn.drawing(model.rotor),) if isinstance(model, RotorModel) else ()
    return Passage("The rotor", panels=drawing)


def _numbers(estimate: Estimate, records: Sequence[RecordEvidence]) -> Iterator[tuple[str, str]]:
    """Yield the numbers that matter, and what each is: fit; if accepted, unbalance, largest std."""
    errors = [(c.error, name) for name, c in _named([r.channels for r in records])]
    if errors := [each for each in errors if each[0] < TOLD]:
        yield f"{100 * max(errors)[0]:.2g} %", f"off at the most, {max(errors)[1]}"
    if estimate.status != "ok":
        return
    if masses := [plane for plane in estimate.unbalance if plane.unit == "kg m"]:
        most = max(masses, key=lambda plane: plane.amount)
        yield f"{1e6 * most.amount:.4g} g mm", f"unbalance, {most.plane}"
    known = [(v.std / abs(v.value), v.name) for v in estimate.parameters if v.std and v.value]
    if known and max(known)[0] < FAR:
        yield f"{100 * max(known)[0]:.2g} %", f"std of {max(known)[1]}, known least"


def _method(estimate: Estimate) -> str:
    return METHODS.get(estimate.method, estimate.method)


def _work(estimate: Estimate, model: Model | None) -> Iterator[Passage]:
    source = estimate.provenance
    if source is None:
        return
    by = ", ".join(filter(None, (f"rotorid {source.version}", source.environment)))
    item = '{}<br><span class="soft">{}</span>'
    sums = [(f.file, f.sha256 and f"sha256 {f.sha256}") for f in source.files]
    own = model is None or model.name not in shipped_models()
    texts = (("experiment", source.experiment), ("model", source.model if own else ""))
    yield Passage(
        "Provenance",
        body=marked("<p><code>{}</code>, {}</p>", source.command, by)
        if source.command
        else Markup(),
        items=tuple(marked(item, name, told or "too large to be hashed") for name, told in sums),
        parts=tuple(
            Passage(f"The {what} file", body=marked("<pre>{}</pre>", text))
            for what, text in texts
            if text
        ),
    )


def _titled(one: Table) -> Passage:
    head = one.headings[0]
    return Passage(TITLES.get(head, head[:1].upper() + head[1:]), table=one)


def _responses(estimate: Estimate, records: Sequence[RecordEvidence]) -> Iterator[Passage]:
    for number, found in enumerate(record.response for record in records):
        if found is not None:
            where = f", record {number + 1}" if len(records) > 1 else ""
            yield Passage(
                f"Response of {found.position} to {found.force}{where}",
                after="" if number else MEASURED,
                panels=tuple(_response(machine_of(estimate, number), found)),
            )


def _response(machine: Machine, found: ResponseEvidence) -> list[drawn.Panel]:
    lines, force = found.frequency_hz, machine.model.inputs.index(found.force)
    hertz = np.union1d(np.geomspace(lines[0] / BEYOND, BEYOND * lines[-1], BETWEEN), lines)

    def response(at: Machine) -> Complexes:
        reads = np.array([shares_of(at, found.position)])
        return plant_response(at, found.speed_rad_s, 2 * np.pi * hertz, reads, {})[:, 0, force]

    model, root = response(machine), np.moveaxis(machine.changes(response), 0, -1)
    std = np.array([amplitude_std(turn * model, root) for turn in (1, 1j)])
    return drawn.force_response(found, hertz, model, std)


def _own_pictures(estimate: Estimate, records: Sequence[RecordEvidence]) -> Iterator[Passage]:
    rows = estimate.line_misfit
    turning = bool(records) and all(record.kind == "phasors" for record in records)
    if rows:
        panel = drawn.misfit(rows, turning=turning)
        what, where = ("row", "speed") if turning else ("spectral line", "frequency")
        yield Passage(
            f"Misfit by {where}",
            f"Misfit of each {what} over what noise would leave of it; 1 is right on average. "
            f"Those that stand out together say at which {where} the model lacks something.",
            panels=(panel,),
        )
    names = [value.name for value in estimate.free]
    if 1 < len(names) == len(estimate.covariance) and np.isfinite(estimate.correlation).any():
        yield Passage(
            "Correlation of the parameters",
            f"{_strongest(names, estimate.correlation)} Near +1 or \N{MINUS SIGN}1 two "
            "parameters are known as a combination better than one by one.",
            panels=(drawn.correlation(names, estimate.correlation),),
        )


def _strongest(names: Sequence[str], matrix: Floats) -> str:
    size = np.nan_to_num(np.abs(np.triu(matrix, 1)))
    i, j = divmod(int(np.argmax(size)), size.shape[1])
    value = f"{matrix[i, j]:+.2f}".replace("-", "\N{MINUS SIGN}")
    return f"Strongest: {names[i]} with {names[j]}, {value}."


def record_pictures(
    records: Sequence[RecordEvidence], *, another: bool = False
) -> Iterator[Passage]:
    """Draw records as measured and as predicted; of `another`, the values' deviations count too."""
    noise = "noise and the deviations of the values make" if another else "noise makes"
    for number, record in enumerate(records):
        where = f", record {number + 1}" if len(records) > 1 else ""
        each, what = "frequency", "spectral lines"
        if record.kind == "phasors":
            each, what = "speed", "rows of 1x phasors"
        told = f"Amplitudes of {record.lines} {what}"
        if record.lines_per_point > 1:
            told += f", {record.lines_per_point} neighbours together as their root mean square"
        yield Passage(
            f"Residual over time{where}",
            f"Predicted less measured; the band holds 95 % of what {noise} of it.",
            after=_left_out(record),
            panels=tuple(drawn.over_time(record)),
        )
        yield Passage(
            f"Measured and predicted by {each}{where}",
            f"{told}. Where the difference lies in the band or below, it is what "
            f"{noise}. A channel that is not predicted is shown with its own noise.",
            panels=tuple(drawn.lines(record)),
        )
        yield Passage(
            f"Residual by {each}{where}",
            f"Over what {noise} of it: evenly near 1 is noise, what stands out is none.",
            panels=tuple(drawn.residual(record)),
        )


def _left_out(record: RecordEvidence) -> str:
    left = max((channel.left_out for channel in record.channels), default=0)
    told = (
        f"Without {left} of {record.lines} lines beside a resonance, where the noise of the forces "
        "alone moves the model further than the machine moved."
    )
    return told if left else ""


def channels_table(records: Sequence[RecordEvidence]) -> Table | None:
    rows = []
    for name, c in _named([record.channels for record in records]):
        if not math.isnan(c.error):
            ratio = _over_noise(c) or math.nan  # of a prediction that is met whole it says nothing
            shown = (100 * c.error, 100 * c.error / ratio, ratio)
            rows.append((name, *(cell(x, ".3g") for x in shown)))
    headings = ("channel", "off by %", "noise makes %", "difference / noise")
    return table(headings, rows) if rows else None


def records_table(records: Sequence[RecordEvidence]) -> Table | None:
    first = ("record", "used as", "periods", "samples per period", "sample rate in Hz")
    headings = (*first, "lines", "speed in rpm", "channels")
    rows = [
        (
            f"{number}: {record.source}" if record.source else str(number),
            KINDS[record.kind],
            str(record.periods or ""),
            str(record.samples_per_period or ""),
            cell(record.sample_rate_hz, ".6g"),
            str(record.lines or ""),
            " to ".join(dict.fromkeys(f"{30 / math.pi * v:.6g}" for v in record.speed_rad_s)),
            ", ".join(channel.name for channel in record.channels),
        )
        for number, record in enumerate(records, start=1)
    ]
    return told_table(headings, rows) if rows else None


def _named(records: Sequence[Sequence[Named]]) -> Iterator[tuple[str, Named]]:
    """Yield every channel with its name, and that of its record where there are several."""
    for k, record in enumerate(records, start=1):
        where = f", record {k}" if len(records) > 1 else ""
        yield from ((f"{channel.name}{where}", channel) for channel in record)


CHANCE = (
    "The prediction error, how much of it noise and the std of the values make, and the chance "
    "that both together make one as large. Below one in a million it fails."
)


def validation_report(
    estimate: Estimate,
    model: Model,
    found: Sequence[Sequence[ChannelError]],
    records: Sequence[RecordEvidence],
    notes: Sequence[str] = (),
) -> str:
    reached, pictures = validated(found), list(record_pictures(records, another=True))
    page = Passage(
        "Validation on another record",
        lead=marked("Result of <code>{}</code>, {}", estimate.model, _method(estimate)),
        badge=reached.verdict,
        verdict=f"{reached.sentence[:1].upper()}{reached.sentence[1:]}.",
        mood="good" if reached.verdict == "predicts" else "bad",
        urge="What to do next:",
        steps=reached.cures,
        picture=pictures[2] if pictures else None,
        parts=(
            Passage("Prediction error by channel", CHANCE, validation_table(found)),
            *pictures,
            Passage("Records", table=records_table(records)),
        ),
    )
    tab = f"{estimate.model}, {estimate.method}: {reached.verdict}"
    return page_of(page, tab=tab, model=model, done=notes)


def validation_table(records: Sequence[Sequence[ChannelError]]) -> Table:
    rows = [
        (
            name,
            *(cell(x, ".3g", 100) for x in (c.relative_error, c.noise, c.deviations)),
            cell(c.p_value, ".2g"),
            "zero" if c.relative_error is None else "fails" if c.fails else "predicted",
        )
        for name, c in _named(records)
    ]
    headings = ("channel", "off by %", "by noise %", "by deviations %", "chance", "verdict")
    return table(headings, rows)


def information_lines(records: Iterable[Information | None]) -> list[str]:
    """Return the condition number of the regressor of each record, as it is quoted for robots."""
    return [
        f"condition number of the regressor: {told.scaled_condition_number:.4g} with its "
        f"columns scaled, {told.condition_number:.4g} in SI units as it is"
        for told in records
        if told is not None
    ]
