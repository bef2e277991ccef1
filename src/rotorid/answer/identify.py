"""The front function: a model, records and a method to an estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Protocol

import numpy as np

from rotorid.answer.derived import with_unbalance
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import of_data
from rotorid.answer.parts import Provenance
from rotorid.core.errors import InputError, require_names, require_type
from rotorid.core.notes import Note
from rotorid.data.filtered import FilteredRecord
from rotorid.data.lines import PhasorClock
from rotorid.data.observation import MEASURED, Data, Observation
from rotorid.data.record import PeriodicRecord
from rotorid.models import Model
from rotorid.signals.checks.channels import OF_SAMPLES
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
    for each, notes in zip(data, found, strict=True):
        refusal = next((check for check in notes if check.severity == "refuses"), None)
        if refusal is not None:
            table = isinstance(getattr(each, "clock", None), PhasorClock)
            more = "" if table else "; rotorid inspect shows more"
            cure = refusal.cure or f"mend the record or leave that channel out{more}"
            file = each.lines.source if isinstance(each, Observation) else each.source
            expected = "a record that can be identified"
            raise InputError(str(replace(refusal, cure="")), expected, cure, file=file)
    if not hasattr(estimator, "estimate"):
        require_type(estimator, str, place="estimator")
    chosen = by_name(estimator) if isinstance(estimator, str) else estimator
    estimate = chosen.estimate(model, data)
    silent = (c for notes in found for c in notes if c.about == NO_SCATTER and not c.on)
    if any(c.severity != "passes" for c in silent):
        estimate = without_deviations(estimate)
    estimate = with_unbalance(model, estimate)
    checks, harmless = tried(found, estimate, partial(chosen.estimate, model), data)
    checks, refuted = turning(checks, estimate, data)
    told = of_data([c for c in checks if c not in harmless | refuted], estimate.status)
    # What a result must hold of its model to be used without the model's file.
    text = Provenance(model=model.file_text, held=model.held) if model.file_text else None
    every = (*checks, *estimate.notes)
    return estimate.with_(notes=every, provenance=estimate.provenance or text).with_notes(*told)


SHOWN = 10.0
"""Unbalance over its deviation from which on a rotor turns as stated: at a wrong speed no force
turns that fits the planes, in both directions, as unbalance does."""
MULTIPLE = 0.01
"""Distance of the speed, over that of a tone, from a whole number up to which it is a multiple."""


def turning(
    checks: Sequence[Note], estimate: Estimate, data: Sequence[Data]
) -> tuple[list[Note], set[Note]]:
    """Return checks, with what unbalance says of tones beside the speed; those that it refutes.

    Planes of x and y show that it turns. At a multiple of the true speed misalignment does too.
    """
    ratios = [u.amount / u.std for u in estimate.unbalance if u.std and "," in u.plane]
    clear = max(ratios, default=0.0)
    alone = data[0] if len(data) == 1 else None
    if estimate.status != "ok" or clear < SHOWN or not isinstance(alone, PeriodicRecord):
        return list(checks), set()
    said = f"at the speed given, unbalance stands out by {clear:.3g} std: that is the rotation"
    given = alone.turns * alone.fundamental
    orders = {c: given / c.value for c in checks if c.about == "speed" and c.value}
    apart = [c for c, n in orders.items() if n < 1 or abs(n - round(n)) > MULTIPLE * n]
    told = {c: replace(c, found=f"{c.found}; {said}") if c in apart else c for c in checks}
    return list(told.values()), {told[c] for c in apart}


CLEAR, WEAK = 3.0, 3.0
"""Deviations by which an answer moves without what is wrong; and how much wider these become where
too little is left to show it."""


def tried(
    found: Sequence[Sequence[Note]],
    estimate: Estimate,
    again: Callable[[Sequence[Data]], Estimate],
    data: Sequence[Data],
) -> tuple[list[Note], set[Note]]:
    """Return checks, with what the answer is without what some doubt in part; those it bears."""
    checks = list(dict.fromkeys(note for notes in found for note in notes))
    doubts, left = set[Note](), list[Data | None]()
    for each, notes in zip(data, found, strict=True):
        partly = [n for n in notes if n.severity == "warns"]
        if isinstance(each, FilteredRecord):
            partly = [n for n in partly if n.about in OF_SAMPLES]
            left.append(each.trusted() if partly else each)
        elif isinstance(each, PeriodicRecord):
            partly = [n for n in partly if n.periods]
            left.append(each.trusted(partly) if partly else each)
        else:
            partly = []  # lines hold all samples alike
            left.append(each)
        doubts.update(partly)
    without = [each for each in left if each is not None]
    if not doubts or estimate.status != "ok" or len(without) < len(data):
        return checks, set()
    moved, said = 0.0, "too little is left without such samples to show whether they are wrong"
    some = all(len(each.used) for each in without if isinstance(each, FilteredRecord))
    free = again(without).free if some else ()
    pairs = list(zip(estimate.free, free, strict=bool(free)))
    if pairs and all(w.std and w.std < WEAK * (v.std or 0.0) for v, w in pairs):
        moves = [abs(w.value - v.value) / (w.std or 1.0) for v, w in pairs]
        v, w = pairs[most := int(np.argmax(moves))]
        moved = moves[most]
        said = (
            f"without such samples {v.name} moves by {moved:.2g} std, from {v.value:.6g} to "
            f"{w.value:.6g} {v.unit}"
        )
    told = {c: replace(c, found=f"{c.found}; {said}") if c in doubts else c for c in checks}
    return list(told.values()), {told[c] for c in doubts} if moved <= CLEAR else set()


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
