"""Sensors that read something besides what they are said to read.

A sensor beside its plane reads an angle too, one that is not aligned reads the other axis. Its
share is no factor of a channel: the column is what the sensor would read more, and the sensor is
changed as the share is found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from rotorid.estimators.likelihood.candidates import Structure
from rotorid.estimators.likelihood.refits import Case
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.combination import SensorTerm
from rotorid.observation import Observation, Sensor
from rotorid.record import Floats


@frozen
class Shift:
    """A share of further coordinates in what sensors read.

    Parameters
    ----------
    term : str
        ``plane[x1]``, ``crosstalk[x1, y1]``, ``rotation[x1, y1]``.
    unit : str
    said : str
    shares : mapping of str to (coordinate, coefficient)
        What each sensor reads more, for a share of one.
    given : float
        What the sensors are said to read already.
    """

    term: str
    unit: str
    said: str
    shares: dict[str, tuple[int, float]]
    given: float = 0.0

    def applied(self, records: Sequence[Observation], share: float) -> tuple[Observation, ...]:
        """Return records whose sensors read that share more."""
        return tuple(
            replace(record, sensors=tuple(self._reading(s, share) for s in record.sensors))
            for record in records
        )

    def _reading(self, sensor: Sensor, share: float) -> Sensor:
        more = self.shares.get(sensor.channel.name)
        if more is None:
            return sensor
        still = (0,) * len(sensor.terms[0].powers)
        added = SensorTerm(more[0], 0, still, more[1] * share)
        return replace(sensor, terms=(*sensor.terms, added))

    def column(self, case: Case) -> Floats:
        """Return the derivative of the whitened residual by the share."""
        blocks = []
        for record, at in zip(case.records, case.point.records, strict=True):
            motion = at.corrected()[1] * at.problem.scales.coordinates
            first = len(record.inputs) + len(record.indirect)
            rows = np.zeros((at.problem.lines, at.problem.all_rows), dtype=np.complex128)
            for k, sensor in enumerate(record.direct):
                more = self.shares.get(sensor.channel.name)
                if more is not None:
                    rows -= at.plain[:, :, first + k] * (more[1] * motion[:, more[0], None])
            blocks.append(at.whiten(rows[:, :, None]))
        blocks.append(np.zeros((len(case.point.known), 1)))
        return np.concatenate(blocks)


def shifts(record: Observation, structure: Structure | None) -> Iterator[Shift]:
    """Yield sensors out of their plane, cross-talk, and planes whose axes are turned."""
    if structure is None:
        return
    model, turn = record.model, structure.turn()
    partner = {k: int(np.abs(turn[k]).argmax()) for k in range(len(turn)) if turn[k].any()}
    reads = {s.channel.name: row for s, row in zip(record.direct, record.reads, strict=True)}
    for name, row in reads.items():
        lengths = [k for k in np.flatnonzero(row) if model.units[model.coordinates[k]] == "m"]
        if len(lengths) != 1 or lengths[0] not in partner:
            continue
        seen, size = int(lengths[0]), float(row[lengths[0]])
        for angle in _angles(model, structure, seen):
            label = model.coordinates[angle]
            said = f"{name} beside its plane: it reads {label} too, with the lever"
            yield Shift(f"plane[{name}]", "m", said, {name: (angle, 1.0)}, float(row[angle]))
        other = partner[seen]
        label = model.coordinates[other]
        said = f"cross-talk from {label} into {name}: its share"
        yield Shift(f"crosstalk[{name}, {label}]", "1", said, {name: (other, size)})
    yield from _planes(model, reads, structure)
    yield from _rotations(record, reads, structure, partner)


def _planes(model: Model, reads: dict[str, Floats], structure: Structure) -> Iterator[Shift]:
    """Yield planes of which both sensors, and all sensors, are further along the shaft."""
    turn, found = structure.turn(), list[tuple[str, str, int, dict[str, tuple[int, float]]]]()
    for (one, row), (other, partner) in permutations(reads.items(), 2):
        lengths = [k for k in np.flatnonzero(row) if model.units[model.coordinates[k]] == "m"]
        image = turn @ row
        side = float(np.sign(image @ partner))
        if len(lengths) != 1 or not image.any() or not np.allclose(side * image, partner):
            continue
        for angle in _angles(model, structure, int(lengths[0])):
            lever = np.zeros(len(row))
            lever[angle] = row[lengths[0]]
            across = side * turn @ lever
            beside = int(np.abs(across).argmax())
            both = {one: (angle, float(lever[angle])), other: (beside, float(across[beside]))}
            if across[beside] and (other, one) not in {(a, b) for a, b, _, _ in found}:
                found.append((one, other, angle, both))
    for one, other, _, both in found:
        said = f"{one} and {other} beside their plane: they read angles too, with the lever"
        yield Shift(f"plane[{one}, {other}]", "m", said, both)
    for angle in dict.fromkeys(angle for _, _, angle, _ in found):
        every = [both for _, _, at, both in found if at == angle]
        shares = {name: share for both in every for name, share in both.items()}
        if len(every) > 1:
            said = "all sensors further along the shaft than stated, by"
            yield Shift(f"plane[{', '.join(shares)}]", "m", said, shares)


def _angles(model: Model, structure: Structure, seen: int) -> list[int]:
    """Return the angles in the plane of a displacement: its slope, or those that a spring ties."""
    if seen in structure.slopes:
        return [structure.slopes[seen]]
    angles = [
        k for pair in structure.pairs for k in pair if model.units[model.coordinates[k]] != "m"
    ]
    tied = [k for k in angles if any(abs(m[seen, k]) > 0 for _, m in structure.springs)]
    return tied or angles


def _rotations(
    record: Observation,
    reads: dict[str, Floats],
    structure: Structure,
    partner: dict[int, int],
) -> Iterator[Shift]:
    """Yield planes whose two sensors are turned together, by an angle in rad."""
    single = {int(np.flatnonzero(r)[0]): n for n, r in reads.items() if (r != 0).sum() == 1}
    for a, b in structure.pairs:
        if a in single and b in single:
            one, other = single[a], single[b]
            term = f"rotation[{one}, {other}]"
            said = f"the axes of {one} and {other} turned by the angle"
            yield Shift(term, "rad", said, {one: (b, 1.0), other: (a, -1.0)})
