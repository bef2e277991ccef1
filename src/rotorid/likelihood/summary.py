"""From a fit to its `Estimate`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rotorid.answer.derived import base_from_physical, physical_from_base
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import OPEN, judge
from rotorid.answer.machine_checks import REJECTED
from rotorid.answer.parts import DOUBTFUL, Alternative, LineMisfit, Misfit, Value
from rotorid.core.notes import Note, remarks
from rotorid.data.observation import Records
from rotorid.likelihood.assumptions import accused
from rotorid.likelihood.fit import Fit
from rotorid.likelihood.identifiability import (
    determined_combinations,
    find_cures,
    open_combinations,
)
from rotorid.likelihood.mode_rows import close_modes, mode_fits
from rotorid.likelihood.response import by_likelihood
from rotorid.likelihood.rivals import Tried, suspected
from rotorid.linear.regression import relative_errors
from rotorid.models import Model


def summarize(model: Model, fit: Fit, causes: Sequence[Note] = ()) -> Estimate:
    layout, inference, point = fit.layout, fit.inference, fit.solution.point
    expectation = inference.expectation
    # Where a search failed, nothing follows of what the records determine.
    combinations = open_combinations(fit) if fit.solution.converged else []
    notes = (
        *causes,
        *(Note("units", "doubts", fault) for fault in model.unit_faults),
        *_notes(fit),
        *(Note(OPEN, "open", str(found), on=found.names) for found in combinations),
        *(Note(OPEN, "open", cure=cure) for cure in find_cures(fit, combinations)),
    )
    values, units, held = _values(fit), model.parameter_units, fit.problem.substituted
    names = layout.names()
    return Estimate(
        model=model.name,
        method="ml",
        status=judge(notes),
        parameters=(
            *(v for i, v in enumerate(values[: layout.named]) if i not in layout.idle),
            *(Value(name, units[name], value, 0.0, 0.0, True) for name, value in held.items()),
        ),
        nuisance=tuple(v for v in values[layout.named :] if not v.fixed),
        derived=(*_derived(model, fit), *determined_combinations(fit, combinations)),
        covariance=inference.covariance,
        misfit=Misfit(inference.cost, expectation.mean, expectation.dof, inference.p_value),
        prediction=relative_errors(by_likelihood(fit.records, point.records)),
        notes=notes,
        condition_number=inference.linear.condition_number,
        line_misfit=tuple(
            LineMisfit(number, *map(float, line))
            for number, (record, at) in enumerate(zip(fit.records, point.records, strict=True))
            for line in zip(
                record.lines.frequency, at.line_costs, inference.records[number].means, strict=True
            )
        ),
        modes=mode_fits(fit.problem.known.modes, point.unknowns, layout.free, inference.covariance),
        alternatives=tuple(
            Alternative(x.cost, tuple(zip(names, x.unknowns[layout.free].tolist(), strict=True)))
            for x in fit.alternatives
        ),
        **_seen(fit.records),
    )


def _seen(records: Records) -> dict[str, Any]:
    return {
        "lines_hz": tuple(sorted({float(f) for r in records for f in r.lines.frequency})),
        "periods": min((r.lines.periods for r in records), default=0),
    }


def _values(fit: Fit) -> list[Value]:
    unknowns, std, inference = fit.layout.unknowns, fit.std, fit.inference
    mean = inference.expectation.mean
    inflation = float(np.sqrt(max(1.0, inference.cost / mean))) if mean > 0 else 1.0
    values = np.where(np.isfinite(std), fit.solution.point.unknowns, np.nan)
    rows = zip(unknowns, values.tolist(), std.tolist(), (std * inflation).tolist(), strict=True)
    return [Value(u.name, u.unit, x, s, wider, u.fixed) for u, x, s, wider in rows]


def nothing_found(model: Model, records: Records, fixed: Mapping[str, float], why: str) -> Estimate:
    told = remarks("record", (w for r in records for w in r.lines.warnings))
    notes = (*told, Note("search", "unfinished", why))
    known = {name: (value, 0.0, 0.0, True) for name, value in fixed.items()}
    open_ = (np.nan, np.nan, np.nan)
    values = (Value(p.name, p.unit, *known.get(p.name, open_)) for p in model.parameters)
    return Estimate(model.name, "ml", judge(notes), tuple(values), notes=notes, **_seen(records))


def trials_of(fit: Fit) -> Iterator[Tried]:
    if fit.inference.p_value < REJECTED:
        yield from suspected(fit.case, fit.plain, accused)


def _derived(model: Model, fit: Fit) -> tuple[Value, ...]:
    layout, inference = fit.layout, fit.inference
    if layout.base:
        inner = layout.free < layout.parameters
        if inference.linear.undetermined[inner].any():
            return ()
        held = layout.held
        values = fit.solution.point.unknowns[held]
        return physical_from_base(layout.model, values, fit.covariance[np.ix_(held, held)])
    found: dict[str, Value] = {}
    # Of each record under the names of what it has to itself; measured modes need no record.
    for number in range(max(1, len(fit.records))):
        held = layout.of_record(number).held
        values, covariance = fit.solution.point.unknowns[held], fit.covariance[np.ix_(held, held)]
        names = [layout.unknowns[i].name for i in held]
        base = base_from_physical(model, values, covariance, names)
        every = np.zeros((len(base), len(layout.unknowns)))
        every[:, held] = model.base_jacobian(values)
        lost = inference.linear.left_open(every[:, layout.free])
        for v, none in zip(base, lost, strict=True):
            found.setdefault(v.name, Value(v.name, v.unit, np.nan, np.nan) if none else v)
    return tuple(found.values())


def _notes(fit: Fit) -> Iterator[Note]:
    point, inference = fit.solution.point, fit.inference
    yield from remarks("record", (w for record in fit.records for w in record.lines.warnings))
    yield from _mixed(fit)
    for bound in fit.solution.active:
        text = f"the bound {fit.problem.bounds.texts[bound]} is active"
        yield Note("bound", "doubts", f"{text}; its effect is not in the standard deviations")
    if not fit.solution.converged:
        text = (
            "no minimum was found from this start or from others about it, so "
            "nothing is known of what the records determine"
        )
        cure = (
            "give a nearer start (nominal, start), and what is known of it: positive = true, min, "
            "max"
        )
        yield Note("search", "unfinished", text, cure)
    if not fit.records and not inference.expectation.dof and not inference.linear.null.shape[1]:
        text = (
            "as many unknowns as were measured in [[modes]]: nothing is left over that could "
            "contradict the model"
        )
        yield Note("modes", "doubts", text, "measure a further natural frequency")
    yield from close_modes(fit.problem.known.modes, point.unknowns)
    yield from fit.notes
    yield from _on_misfit(fit)


def _mixed(fit: Fit) -> Iterator[Note]:
    for number, at in enumerate(fit.solution.point.records):
        noise = at.problem.noise
        told = fit.records[number].lines.covariance.kind != "coherence"
        if noise.shrunk > 0 and told:
            where = f"record {number + 1}: " if len(fit.records) > 1 else ""
            text = (
                f"{where}too few periods for the covariance of {at.problem.equations} equations "
                f"per line ({noise.dof:g} degrees of freedom, {2 * at.problem.equations} needed): "
                f"it was mixed with its diagonal ({100 * noise.shrunk:.0f} %); deviations and "
                "p-value are rough"
            )
            yield Note("noise", "doubts", text, "record more periods")


def _on_misfit(fit: Fit) -> Iterator[Note]:
    inference = fit.inference
    p_value, cost, expected = inference.p_value, inference.cost, inference.expectation.mean
    kinds = {record.lines.covariance.kind for record in fit.records}
    if p_value < REJECTED:
        text = (
            f"the data reject the model: misfit {cost:.4g} where {expected:.4g} is expected "
            f"(p = {p_value:.1g})"
        )
        cure = (
            "see the suspects; until the cause is found neither std nor std_inflated covers the "
            "error"
        )
        yield Note("misfit", "rejects", text, cure, value=cost, unit="1")
    elif 1 - p_value < REJECTED and "references" in kinds:
        text = (
            f"the misfit, {cost:.6g}, is far below the {expected:.6g} that is expected: what "
            "counts as noise is not all noise, as where references are late or do not hold all "
            "that was added, or where a channel is cut at a limit; until that is found the "
            "deviations are not sure"
        )
        yield Note("misfit", "doubts", text, value=cost, unit="1")
    elif p_value < DOUBTFUL:
        text = (
            f"the model is doubtful: misfit {cost:.4g} where {expected:.4g} is expected "
            f"(p = {p_value:.1g}); where that is not chance, values may be off by more than "
            "std_inflated says: record more periods, or declare gains and delays of the channels "
            "as known with a deviation"
        )
        yield Note("misfit", "doubts", text, value=cost, unit="1")
