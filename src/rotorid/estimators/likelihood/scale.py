"""Whether the records tell the scale of the forces; where they do not, what follows it.

A rotor with all masses, stiffnesses and dampings one per cent larger moves as before under forces
one per cent larger. Where no mass and no force is known otherwise, no misfit shows it.
"""

from __future__ import annotations

import numpy as np

from rotorid.estimators.likelihood.fit import Fit
from rotorid.estimators.likelihood.nuisances import Scale
from rotorid.estimators.likelihood.tangent import tangent
from rotorid.record import Check, Floats

TAKEN_OVER = 1e-6
"""What is left of the scale's column when the parameters have taken their share, over its square,
below which they take it over: exactly so at the corrected lines, but for rounding."""
FOLLOWS = 0.5
"""Relative change of a parameter, over that of the scale, from which it is said to follow."""


def scale_note(fit: Fit, column: Floats) -> list[Check]:
    """Say where a scale that is taken as exact is in masses and stiffnesses, and in no misfit.

    column, shape (row,), is the derivative of the residual by the scale.
    """
    channels = [c for record in fit.records for c in record.inputs]
    read = [c.name for c in channels if c.law is not None or c.drive is not None]
    layout = fit.prepared.layout
    if not read or any(isinstance(n, Scale) for n in layout.nuisances):
        return []
    where = tangent(fit.solution.point, fit.problem.exact)  # what is weighed exactly stays
    directions = np.diag(where.scale) if where.basis is None else where.scale[:, None] * where.basis
    rest = fit.solution.point.jacobian @ directions
    size = np.sqrt((rest**2).sum(axis=0))
    unit = np.where(size > 0, size, 1.0)
    found = np.linalg.lstsq(rest / unit, column, rcond=1e-10)[0]
    left = column - rest / unit @ found
    if not np.isfinite(found).all() or left @ left > TAKEN_OVER * (column @ column):
        return []
    value = np.array([fit.solution.point.unknowns[i] for i in layout.free])
    share = np.abs(directions @ (found / unit)) / np.where(value != 0, np.abs(value), np.inf)
    names = [
        layout.unknowns[i].name
        for i, s in zip(layout.free, share, strict=True)
        if i < layout.named and s > FOLLOWS
    ]
    if not names:
        return []
    text = (
        f"taken as exact: 1 % of it is 1 % of {', '.join(names)}, beyond their deviations, and no "
        "misfit shows it; say how well it is known (force_scale_std), or weigh the rotor"
    )
    return [Check("force scale", ", ".join(dict.fromkeys(read)), text, "note")]
