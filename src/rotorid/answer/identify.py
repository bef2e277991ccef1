"""The front function: a model, records and a method to an estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Protocol

import numpy as np

from rotorid.answer.derived import with_unbalance
from rotorid.answer.estimate import Estimate, Provenance
from rotorid.answer.judge import of_data
from rotorid.core.errors import InputError, require_names, require_type
from rotorid.core.notes import Note
from rotorid.data.filtered import FilteredRecord
from rotorid.data.lines import PhasorClock
from rotorid.data.observation import MEASURED, Data, Observation
from rotorid.data.record import PeriodicRecord
from rotorid.models import Model
from rotorid.signals.checks.registry import check_periods


class Estimator(Protocol):
    """What `rotorid.identify` needs: one method."""

    def estimate(self, model: Model, records: Sequence[Data]) -> Estimate:
        """Return what the records say of the model's parameters."""
        ...


METHODS = {
    "ls": "LeastSquares",
    "batch": "Batch",
    "sequential": "Sequential",
    "ml": "MaximumLikelihood",
}


def by_name(method: str) -> Estimator:
    require_names([method], METHODS, "the method {}", "name one of these methods")
    estimator: Estimator = getattr(import_module("rotorid"), METHODS[method])()
    return estimator


NO_SCATTER = "identical periods"
"""The check that finds periods without scatter: of a whole record where it names no channel."""


def identify(model: Model, periods: Data | Sequence[Data], estimator: Estimator | str) -> Estimate:
    r"""Estimate the parameters of a model from one record or several.

    Parameters
    ----------
    model : Model
    periods : PeriodicRecord, Lines or FilteredRecord, or sequence of them
        Records of one machine; several are identified together.
    estimator : Estimator or str
        `LeastSquares`, `Batch`, `Sequential`, `MaximumLikelihood`, one of your own, or the name
        of a method: "ls", "batch", "sequential", "ml".

    Returns
    -------
    Estimate
        Its status says whether the parameters are determined.

    Raises
    ------
    InputError
        For records that do not fit the model or the estimator, or whose checks refuse them.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> t = np.arange(400) / 100.0
    >>> motion = np.column_stack([-3.0 * np.pi**2 * np.cos(np.pi * t), 0.75 * np.cos(np.pi * t)])
    >>> record = rid.Record([rid.Channel("F_x"), rid.Channel("x")], motion, sample_rate=100.0)
    >>> model = rid.parse_model('''
    ... title = "a free mass"
    ... equations = ["m*x\'\' = F_x"]
    ... coordinates = { x = "m" }
    ... inputs = { F_x = "N" }
    ... parameters = { m = { unit = "kg" } }''')
    >>> estimate = rid.identify(model, rid.average(record, 0.5, harmonics=[1]), rid.LeastSquares())
    >>> round(estimate.value("m"), 9)
    4.0
    """
    require_type(model, Model, place="model")
    data = periods if isinstance(periods, Sequence) else [periods]
    found = [_checks(each) for each in data]
    for each, checks in zip(data, found, strict=True):
        refusal = next((check for check in checks if check.severity == "refuses"), None)
        if refusal is not None:
            table = isinstance(getattr(each, "clock", None), PhasorClock)
            more = "" if table else "; rotorid inspect shows more"
            cure = refusal.cure or f"mend the record or leave that channel out{more}"
            file = each.lines.source if isinstance(each, Observation) else each.source
            expected = "a record that can be identified"
            raise InputError(str(replace(refusal, cure="")), expected, cure, file=file)
    checks = tuple(dict.fromkeys(check for checks in found for check in checks))
    chosen = by_name(estimator) if isinstance(estimator, str) else estimator
    estimate = chosen.estimate(model, data)
    silent = [c for c in checks if c.about == NO_SCATTER and c.severity != "passes" and not c.on]
    if silent:
        estimate = without_deviations(estimate)
    checks, moved = tried(checks, estimate, partial(chosen.estimate, model), data)
    told = of_data([c for c in checks if moved or c.about not in SAMPLES], estimate.status)
    # What a result must hold of its model to be used without the model's file.
    text = Provenance(model=model.file_text, held=model.held) if model.file_text else None
    every = (*checks, *estimate.notes)
    estimate = estimate.with_(notes=every, provenance=estimate.provenance or text)
    return with_unbalance(model, estimate.with_notes(*told))


SAMPLES = frozenset({"clipped", "stuck"})
"""Checks that doubt some samples of a record, the others being right."""
CLEAR, WEAK = 3.0, 3.0
"""Deviations by which an answer moves without some samples that are wrong; and how much wider these
become where too little is left to show it."""


def tried(
    checks: Sequence[Note],
    estimate: Estimate,
    again: Callable[[Sequence[Data]], Estimate],
    data: Sequence[Data],
) -> tuple[tuple[Note, ...], bool]:
    """Return checks, with what the answer is without samples that they doubt; whether it moves."""
    doubted = [c for c in checks if c.about in SAMPLES and c.severity == "warns"]
    without = [each.trusted() for each in data if isinstance(each, FilteredRecord)]
    if not doubted or estimate.status != "ok" or len(without) < len(data):
        return tuple(checks), True  # lines hold all samples alike
    moved, said = 0.0, "too little is left without such samples to show whether they are wrong"
    free = again(without).free if all(len(each.used) for each in without) else ()
    pairs = list(zip(estimate.free, free, strict=bool(free)))
    if pairs and all(w.std and w.std < WEAK * (v.std or 0.0) for v, w in pairs):
        moved, name = max((abs(w.value - v.value) / (w.std or 1.0), v.name) for v, w in pairs)
        said = f"without such samples {name} moves by {moved:.2g} deviations"
    told = {c: replace(c, found=f"{c.found}; {said}") for c in doubted}
    return tuple(told.get(c, c) for c in checks), moved > CLEAR


def _checks(data: Data) -> tuple[Note, ...]:
    """Return what the data show before any model; lines made by hand are looked at here."""
    require_type(data, *MEASURED, Observation, place="periods")
    held = data.lines if isinstance(data, Observation) else data
    periods = data.periodic if isinstance(data, Observation) else data
    if held.checks or not isinstance(periods, PeriodicRecord):
        return held.checks
    return check_periods(periods)


def without_deviations(estimate: Estimate) -> Estimate:
    """Return an estimate from periods that do not scatter: values, and no deviations, never 0."""
    bare = {
        kind: tuple(
            v if v.fixed else replace(v, std=None, std_inflated=None, interval=None)
            for v in getattr(estimate, kind)
        )
        for kind in ("parameters", "nuisance", "derived")
    }
    told = "the periods are identical: without scatter no deviations can be stated"
    notes = (Note(NO_SCATTER, "doubts", told), *(n for n in estimate.notes if n.drop is None))
    none = np.full(estimate.covariance.shape, np.nan)
    return estimate.with_(**bare, covariance=none, misfit=None, line_misfit=(), notes=notes)
