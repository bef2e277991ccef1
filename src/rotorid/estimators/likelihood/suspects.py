"""The score test: which term, were it in the model, would lower the cost most.

A candidate adds a column D to the Jacobian J of the whitened residual r. With what J can explain
taken out of it, d = (1 - J J^+) D, freeing the candidate lowers the cost by (d' r)^2 / d' d, to
first order: no further fit is needed, so that all candidates can be tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimate import Suspect
from rotorid.estimators.likelihood.calibration import factor_columns
from rotorid.estimators.likelihood.candidates import (
    Candidate,
    find_candidates,
    find_structure,
)
from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.inference import projected_jacobian
from rotorid.estimators.likelihood.nuisances import Factor, every_nuisance
from rotorid.estimators.likelihood.problem import Point
from rotorid.models import Model
from rotorid.observation import Observation
from rotorid.record import Complexes, Floats

KEPT = 12
"""Suspects that an estimate names."""
DISTINCT = 1e-10
"""Least share of a candidate that the parameters of the model cannot take over."""


def find_suspects(
    model: Model, values: Floats, records: Sequence[Observation], point: Point
) -> tuple[Suspect, ...]:
    """Rank what may be missing from the model, largest drop first, at most `KEPT`.

    `values` are the physical parameters at the estimate, not finite where they are not known.
    """
    terms: list[Candidate] = []
    fastest = max((float(v) for r in records for v in r.lines.speed), key=abs)
    if np.isfinite(values).all():
        structure = find_structure(model, values, fastest)
        if structure is not None:
            terms = find_candidates(structure)
            if fastest == 0:
                terms = [t for t in terms if not t.rotating]
    factors = _free_factors(records, point)
    blocks: list[Floats] = []
    for record, at in zip(records, point.records, strict=True):
        data, motion = at.corrected()
        columns = [_term_columns(term, at, motion, record.lines.speed) for term in terms]
        columns += [_factor_column(factor, record, at, data) for factor in factors]
        blocks.append(at.whiten(np.stack(columns, axis=2)))
    names = [*(term.name for term in terms), *(f.unknowns[0].name for f in factors)]
    blocks.append(np.zeros((len(point.problem.known), len(names))))
    return _ranked(names, np.concatenate(blocks), point)


def _free_factors(records: Sequence[Observation], point: Point) -> list[Factor]:
    """Return gains, delays and the like that are not unknowns already."""
    known = point.problem.layout.index
    every = [n for n in every_nuisance(records) if isinstance(n, Factor)]
    return [n for n in every if not {u.name for u in n.unknowns} & known.keys()]


def _ranked(names: Sequence[str], columns: Floats, point: Point) -> tuple[Suspect, ...]:
    own = projected_jacobian(point)
    left, values, _ = np.linalg.svd(own, full_matrices=False)
    left = left[:, values > 1e-9 * values.max(initial=0.0)]
    size = np.sqrt((columns**2).sum(axis=0))
    scaled = columns / np.where(size > 0, size, 1.0)
    for _ in range(2):  # once more, against rounding
        scaled = scaled - left @ (left.T @ scaled)
    power = (scaled**2).sum(axis=0)
    distinct = (size > 0) & (power > DISTINCT)
    drop = (scaled.T @ point.residual) ** 2 / np.where(distinct, power, 1.0)
    found = [
        Suspect(name, float(d)) for name, d, ok in zip(names, drop, distinct, strict=True) if ok
    ]
    return tuple(sorted(found, key=lambda suspect: -suspect.drop)[:KEPT])


def _term_columns(term: Candidate, at: Evaluation, motion: Complexes, speed: Floats) -> Complexes:
    """Return ``-dZ q`` in scaled rows, shape (line, row)."""
    scales, p, equations = at.problem.scales, at.problem, at.equations
    position = motion * scales.coordinates
    s = 1j * p.calibration.omega[:, None]
    force = position @ term.k.T + speed[:, None] * (position @ term.k_speed.T)
    force += s * (position @ term.d.T) + s**2 * (position @ term.m.T)
    rows = np.zeros((p.lines, p.all_rows), dtype=np.complex128)
    rows[:, :equations] = -force / scales.rows[:equations]
    return rows


def _factor_column(
    factor: Factor, record: Observation, at: Evaluation, data: Complexes
) -> Complexes:
    """Return the column of a factor that is not an unknown, shape (line, row)."""
    names = [channel.name for channel in record.channels]
    acting = np.flatnonzero([name in factor.channels for name in names])
    start = np.array([unknown.start for unknown in factor.unknowns])
    return factor_columns(factor, start, acting, at, data)[:, :, 0]
