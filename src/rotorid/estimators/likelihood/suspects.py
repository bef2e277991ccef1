"""The score test: which term, were it in the model, would lower the cost most.

A candidate adds a column D to the Jacobian J of the whitened residual r. With what J can explain
taken out of it, d = (1 - J J^+) D, freeing the candidate lowers the cost by (d' r)^2 / d' d, to
first order: no further fit is needed, so that all candidates can be tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.estimate import Suspect
from rotorid.estimators.likelihood.candidates import (
    Candidate,
    find_candidates,
    find_structure,
)
from rotorid.estimators.likelihood.cost import Evaluation
from rotorid.estimators.likelihood.inference import projected_jacobian
from rotorid.estimators.likelihood.problem import Point
from rotorid.estimators.likelihood.unknowns import input_channels, sensor_channels
from rotorid.models import Model
from rotorid.record import Complexes, Floats, PeriodicRecord

KEPT = 12
"""Suspects that an estimate names."""
DISTINCT = 1e-10
"""Least share of a candidate that the parameters of the model cannot take over."""


def find_suspects(
    model: Model, values: Floats, records: Sequence[PeriodicRecord], point: Point
) -> tuple[Suspect, ...]:
    """Rank what may be missing from the model."""
    names: list[str] = []
    blocks: list[Floats] = []
    terms: list[Candidate] = []
    fastest = max((record.speed for record in records), key=abs)
    if np.isfinite(values).all():
        structure = find_structure(model, values, fastest)
        if structure is not None:
            terms = find_candidates(structure)
            if fastest == 0:
                terms = [t for t in terms if not t.name.startswith("rotating")]
    channels = _channel_names(model, records, point)
    names = [*(term.name for term in terms), *channels]
    for record, at in zip(records, point.records, strict=True):
        data, motion = at.corrected()
        columns = [_term_columns(term, at, motion, record.speed) for term in terms]
        columns += _channel_columns(channels, model, record, at, data)
        blocks.append(at.whiten(np.stack(columns, axis=2)))
    blocks.append(np.zeros((len(point.problem.known), len(names))))
    return _ranked(names, np.concatenate(blocks), point)


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


def _term_columns(term: Candidate, at: Evaluation, motion: Complexes, speed: float) -> Complexes:
    """Return ``-dZ q`` in scaled rows, shape (line, row)."""
    scales, p = at.problem.scales, at.problem
    position = motion * scales.coordinates
    s = 1j * p.calibration.omega[:, None]
    k, d, m = term.matrices(speed)
    force = position @ k.T + s * (position @ d.T) + s**2 * (position @ m.T)
    rows = np.zeros((p.lines, p.all_rows), dtype=np.complex128)
    rows[:, : p.rows] = -force / scales.rows
    return rows


def _channel_names(model: Model, records: Sequence[PeriodicRecord], point: Point) -> list[str]:
    """Return gain and delay of each channel, and common delays, that are not unknowns already."""
    channels = dict.fromkeys(
        c.name for r in records for c in (*input_channels(model, r), *sensor_channels(model, r))
    )
    named = [f"{kind}[{name}]" for name in channels for kind in ("gain", "delay")]
    named += ["delay[force]", "delay[position]"]
    return [name for name in named if name not in point.problem.layout.index]


def _channel_columns(
    names: Sequence[str],
    model: Model,
    record: PeriodicRecord,
    at: Evaluation,
    data: Complexes,
) -> list[Complexes]:
    inputs = [c.name for c in input_channels(model, record)]
    sensors = [c.name for c in sensor_channels(model, record)]
    order = [*inputs, *sensors]
    acted = at.columns * data[:, None, :]  # (line, row, channel): L z by channel
    rate = 1j * at.problem.calibration.omega[:, None]
    zero = np.zeros(acted.shape[:2], dtype=np.complex128)
    columns = []
    for name in names:
        kind, channel = name[:-1].split("[", 1)
        which = {"force": inputs, "position": sensors}.get(channel, [channel])
        members = [order.index(c) for c in which if c in order]
        total = acted[:, :, members].sum(axis=2) if members else zero
        columns.append(total * rate if kind == "delay" else -total)
    return columns
