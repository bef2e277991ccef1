"""What the equations of motion may miss, and what sensors may read besides.

A term, a force that turns with the rotor, an actuator or a sensor beside its place. No setting asks
for these: they are freed one at a time, to see what they explain.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Self

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.likelihood.effects import Drives, Effect, Entry, Reads, RowLoad
from rotorid.likelihood.unknowns.base import Scalar, Unknown, amount


@frozen
class Missing(Unknown):
    """A term that the equations may miss."""

    name: str = ""  # that its scalars share
    entries: tuple[Entry, ...] = ()
    loads: tuple[RowLoad, ...] = ()

    def effects(self) -> Sequence[Effect]:
        return *self.entries, *self.loads

    @property
    def term(self) -> str:
        return self.name or self.scalars[0].name

    def size(self, values: Floats) -> float:
        """Return the first value of entries, whose unknowns have units of their own."""
        return float(values[0]) if self.entries else super().size(values)


@frozen
class Lever(Unknown):
    """An actuator beside the place that the model gives it: its forces act on the slope too."""

    # mapping of int to (int, float): for each row that a force of it acts on, the row of the slope
    # there, and its share of the force for a lever of 1 m
    arms: Mapping[int, tuple[int, float]]

    def effects(self) -> Sequence[Effect]:
        return (Drives(self.on, "lever", self.arms),)


@frozen
class Share(Unknown):
    """A share of further coordinates in what sensors read: a plane, cross-talk, turned axes."""

    phrase: str
    reads: tuple[Reads, ...]  # for a share of one
    given: float = 0.0  # what the sensors are said to read already
    cure: str = field(default="correct reads in [channels], or turn the sensor", kw_only=True)

    @classmethod
    def of(
        cls,
        term: str,
        unit: str,
        said: str,
        shares: Mapping[str, tuple[int, float]],
        given: float = 0.0,
    ) -> Self:
        scalar = Scalar(term, unit, 0.0, additive=True)
        reads = tuple(Reads(name, *more) for name, more in shares.items())
        return cls((scalar,), frozenset(shares), said, reads, given)

    def effects(self) -> Sequence[Effect]:
        return self.reads

    def size(self, values: Floats) -> float:
        return self.given + float(values[0])

    def told(self, value: float | None) -> tuple[str, str]:
        return f"{self.phrase}{amount(value, self.unit)}", self.cure
