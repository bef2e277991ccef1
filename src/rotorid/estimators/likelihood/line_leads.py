"""One line that holds more than excitation and rotation: hum of the mains, a base that shakes.

Such a line contradicts all others, whatever is freed in the model. Without it, its covariance
beyond all bounds, the cost falls by r_k' (1 - H_k)^-1 r_k to first order, r_k its rows of the
residual and H_k what the unknowns can do there: no refit is needed to find it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from rotorid.estimators.likelihood.inference import projected_jacobian
from rotorid.estimators.likelihood.leads import Lead
from rotorid.estimators.likelihood.refits import Case
from rotorid.linalg import whole_svd
from rotorid.observation import Observation

HOLDS = 0.5
"""Share of the excess misfit, at least, that leaving out one line takes away."""
FORGOTTEN = 1e12
"""Factor on the covariance of a line that takes no part any more."""
ORDERS = 3
"""Orders of the rotation whose lines are left to runout and unbalance."""
BESIDE = 0.25
"""Share of the distance of lines within which one is an order of the rotation."""
MAINS = (50.0, 60.0)
"""Frequencies of the mains, Hz."""
ON = 1e-3
"""Distance from a multiple of the mains, relative, within which a line is theirs: they are held to
4e-3 at worst, and to 1e-3 in all but a few hours."""


def line_lead(case: Case, excess: float) -> Lead | None:
    """Return the lead that one line of the records is wrong, if leaving it out helps enough."""
    drop, number, line = max(_drops(case), default=(0.0, 0, 0))
    if not drop > HOLDS * excess:
        return None
    hertz = float(case.records[number].lines.frequency[line])
    where = f" of record {number + 1}" if len(case.records) > 1 else ""
    return Lead(
        f"line {hertz:.6g} Hz{where}",
        f"the line at {hertz:.6g} Hz{where}, {source(hertz)}, left out",
        "leave it out of the harmonics, or stop its source",
        lambda records: without(records, number, line),
    )


def source(hertz: float) -> str:
    """Say what a line comes from, as far as its frequency tells."""
    for mains in MAINS:
        multiple = round(hertz / mains)
        if multiple and abs(hertz / mains - multiple) < ON * multiple:
            return "where hum of the mains stands"
    return "which something else makes, such as a base that shakes or another machine"


def without(records: Sequence[Observation], number: int, line: int) -> list[Observation]:
    """Return records of which one line takes no part."""
    record = records[number]
    matrices = record.lines.covariance.matrices.copy()
    matrices[line] *= FORGOTTEN
    covariance = replace(record.lines.covariance, matrices=matrices)
    changed = record.with_lines(replace(record.lines, covariance=covariance))
    return [*records[:number], changed, *records[number + 1 :]]


def _drops(case: Case) -> Iterator[tuple[float, int, int]]:
    """Yield by how much the cost falls without each line, its record and its number."""
    left, values, _ = whole_svd(projected_jacobian(case.point))
    left = left[:, values > 1e-9 * values.max(initial=0.0)]
    first = 0
    for number, (record, at) in enumerate(zip(case.records, case.point.records, strict=True)):
        rows, lines = 2 * at.problem.equations, record.lines
        orders = np.abs(lines.frequency[:, None] - np.arange(ORDERS + 1) * _turns(record))
        apart = (orders > BESIDE * np.diff(lines.frequency).min(initial=np.inf)).all(axis=1)
        for k in np.flatnonzero(apart) if lines.scatter is not None else ():
            part = slice(first + int(k) * rows, first + (int(k) + 1) * rows)
            free = np.eye(rows) - left[part] @ left[part].T
            residual = case.point.residual[part]
            solved = np.linalg.lstsq(free, residual, rcond=1e-6)[0]
            yield float(residual @ solved), number, int(k)
        first += at.problem.lines * rows


def _turns(record: Observation) -> float:
    """Return the frequency of the rotation in Hz."""
    return float(np.abs(record.lines.speed).mean()) / (2 * np.pi)
