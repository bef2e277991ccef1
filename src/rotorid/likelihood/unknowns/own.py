"""A parameter that is not the same in all records: a trial mass, an unbalance that was changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Self

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.data.observation import Observation
from rotorid.likelihood.effects import Effect, Replaces
from rotorid.likelihood.unknowns.base import Nuisances, Scalar, Unknown
from rotorid.models.priors import own_in_si


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
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        given = [own_in_si(record) for record in records]
        found = []
        parameters = records[0].model.parameters if records else ()
        for index, parameter in enumerate(parameters):
            every = parameter.name in wanted.each
            owners = [k for k, own in enumerate(given) if every or parameter.name in own]
            for k in owners:
                value, std = given[k].get(parameter.name, (np.nan, None))
                unknown = Scalar(
                    f"{parameter.name}[{k}]",
                    parameter.unit,
                    value,
                    std,
                    nuisance=False,
                    positive=parameter.positive,
                )
                alone = len(owners) == len(records)
                found.append(cls((unknown,), frozenset([parameter.name]), index, alone, record=k))
        return found
