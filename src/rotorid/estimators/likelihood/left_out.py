"""Parts that a model may leave out, and how far they may move what it says.

Where masses stand at a few places, what lies between them was shared out by hand: a sleeve, a nut,
a thicker stretch of shaft. Sensors at the bearings alone, below the higher modes, hardly see such a
part: other masses, lengths and stiffnesses take its place, and the cost does not rise.
"""

from __future__ import annotations

import numpy as np

from rotorid.estimators.likelihood.candidates import parts_between
from rotorid.estimators.likelihood.exact import moves_unseen
from rotorid.estimators.likelihood.fit import Fit
from rotorid.estimators.likelihood.refits import Case
from rotorid.estimators.likelihood.result import physical_at
from rotorid.estimators.likelihood.suspects import structure_of
from rotorid.models import Model
from rotorid.record import Check

PART = 0.01
"""Share of the mass that weighing the parts and sharing out the shaft may well miss."""
FAR = 5.0
"""Deviations by which it moves a parameter unseen, above which it is told: beyond chance."""


def parts_left_out(model: Model, fit: Fit) -> list[Check]:
    """Say how far a part between two places of the shaft may move the answer unseen."""
    if not fit.records:
        return []
    structure = structure_of(model, physical_at(model, fit), fit.records)
    if structure is None:
        return []
    units = [model.units[name] for name in model.coordinates]
    parts, size = parts_between(structure, units), PART * structure.mass(units)
    if not parts:
        return []
    wide = Case(fit.prepared, fit.records, fit.solution.point)
    columns = wide.with_unknowns([part.nuisance for part in parts]).point.jacobian
    effects = [
        (part.name, size * columns[:, [k]])
        for k, part in enumerate(parts, len(fit.prepared.layout.free))
    ]
    name, moved = max(moves_unseen(fit, effects), key=lambda each: each[1].max(), default=("", [0]))
    if not np.max(moved) > FAR:
        return []
    layout = fit.prepared.layout
    worst = layout.unknowns[layout.free[int(np.argmax(moved))]].name
    text = (
        f"taken as whole: a {name} of 1 % of all ({size:.2g} kg), left out, may move {worst} by "
        f"{np.max(moved):.2g} deviations unseen; lines about higher modes or a sensor there show it"
    )
    return [Check("model", "", text, "note")]
