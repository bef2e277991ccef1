"""Whether a few lines of a closed loop tell an unknown, within a window that tells their noise.

The damping of a rotor that is lightly damped is told by the lines on which it resonates. Under
control the noise of the loop changes there from line to line, since the rotor hardly lets the
controller move it, and a window of tens of lines takes the mean of it: what few lines tell then
scatters by more than its deviation, and neither misfit nor halves show it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.estimators.likelihood.inference import along_relations
from rotorid.estimators.likelihood.problem import Point
from rotorid.linalg import whole_svd
from rotorid.observation import Observation
from rotorid.record import Floats

CLOSED = 0.1
"""Mean coherence between the noise of inputs and sensors, beyond that of chance, that shows a
closed loop (a levitated rotor has .4)."""
FEW = 10.0
"""Lines that tell an unknown, below which its deviation is unsure: of a damping ratio of .005 in a
closed loop, 3 to 6 lines scatter by 2.5 to 4.3 deviations, 20 lines by 1.1."""
RANK = 1e-10
"""Singular values of the scaled Jacobian below this share of the largest are rounding."""


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


def told_by_few(point: Point, records: Sequence[Observation]) -> Iterator[str]:
    """Say which unknowns few lines of whole records tell, in a closed loop.

    Not of the unbalance, which the line of the rotation tells.
    """
    if not any(r.lines.parts is not None and coherence(r) > CLOSED for r in records):
        return
    layout = point.problem.layout
    loads = layout.load_only()
    weights = _weights(point, records)
    names = [layout.unknowns[i].name for i in layout.free]
    for name, index, each in zip(names, layout.free, weights, strict=True):
        if index not in layout.held or index in loads or not each.any():
            continue
        count = float(each.sum() ** 2 / (each**2).sum())
        if count >= FEW:
            continue
        hertz = np.concatenate([record.lines.frequency for record in records])
        yield (
            f"{name} is told by {count:.2g} lines about {hertz[each.argmax()]:.4g} Hz, closer than "
            "the window in which noise is told from motion: in a closed loop noise changes there, "
            "and the deviation may be several times too small; record several times longer"
        )


def _weights(point: Point, records: Sequence[Observation]) -> list[Floats]:
    """Return of each free unknown what each line of the records tells, (line,)."""
    scaled, scale, basis = along_relations(point, point.problem.exact)
    left, values, right = whole_svd(scaled)
    kept = values > RANK * values.max(initial=0.0)
    directions = scale[:, None] * (basis @ right[kept].T) / values[kept]
    found = []
    for direction in directions:
        size = float(np.linalg.norm(direction))
        rows = (left[:, kept] @ (direction / size if size > 0 else direction)) ** 2
        parts, first = [], 0
        for at in point.records:
            size_of_record = len(at.residual)
            parts.append(
                rows[first : first + size_of_record].reshape(at.problem.lines, -1).sum(axis=1)
            )
            first += size_of_record
        found.append(np.concatenate(parts))
    return found
