"""What the equations of motion may miss or have otherwise, and what sensors may read besides.

A term, a force that turns with the rotor, an actuator or a sensor beside its place: no setting asks
for these, they are freed one at a time, to see what they explain. A parameter that is not the same
in all records: a trial mass, an unbalance that was changed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Self

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.likelihood.effects import Drives, Effect, Entry, Reads, Replaces, RowLoad
from rotorid.likelihood.unknowns.kinds import Nuisances, Scalar, Unknown, amount
from rotorid.models import Parameter
from rotorid.models.constraints import own_in_si


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


Stated = Mapping[int, tuple[float, float | None]]
"""Values of single records, by their numbers, with deviations."""


@frozen
class Own(Unknown):
    """The value of a parameter in one record, in place of the one that the others share."""

    setting = "each"

    record: int = field(kw_only=True)
    parameter: int  # which of the model's
    alone: bool  # every record has a value of its own: none is shared

    def effects(self) -> Sequence[Effect]:
        return (Replaces(self.parameter, self.alone),)

    @classmethod
    def of(cls, index: int, parameter: Parameter, told: Stated, records: int) -> list[Self]:
        """Return a parameter of the model in the records, of so many, that say it themselves."""
        name, unit, alone = parameter.name, parameter.unit, len(told) == records
        found = []
        for k, (value, std) in told.items():
            one = Scalar(
                f"{name}[{k}]", unit, value, std, nuisance=False, positive=parameter.positive
            )
            found.append(cls((one,), frozenset([name]), index, alone, record=k))
        return found

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        given = [own_in_si(record) for record in records]
        found = []
        for index, parameter in enumerate(records[0].model.parameters if records else ()):
            name = parameter.name
            told: Stated = {
                k: own.get(name, (np.nan, None))
                for k, own in enumerate(given)
                if name in own or name in wanted.each
            }
            found += cls.of(index, parameter, told, len(records))
        return found
