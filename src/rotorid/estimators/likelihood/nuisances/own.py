"""A parameter that is not the same in all records: a trial mass, an unbalance that was changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np

from rotorid.estimators.knowledge import own_in_si
from rotorid.estimators.likelihood.nuisances.base import Nuisance, Nuisances, Unknown
from rotorid.frozen import frozen
from rotorid.observation import Observation


@frozen
class Own(Nuisance):
    """The value of a parameter in one record, in place of the one that the others share.

    Parameters
    ----------
    record : int
    parameter : int
        Which of the model's.
    alone : bool
        Every record has a value of its own: none is shared.
    """

    record: int
    parameter: int
    alone: bool

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return those of parameters that every record has to itself, or that a record states."""
        given = [own_in_si(record) for record in records]
        found = []
        parameters = records[0].model.parameters if records else ()
        for index, parameter in enumerate(parameters):
            every = parameter.name in wanted.each
            owners = [k for k, own in enumerate(given) if every or parameter.name in own]
            for k in owners:
                value, std = given[k].get(parameter.name, (np.nan, None))
                unknown = Unknown(
                    f"{parameter.name}[{k}]",
                    parameter.unit,
                    value,
                    std,
                    value if std else 0.0,
                    positive=parameter.positive,
                )
                found.append(cls((unknown,), k, index, len(owners) == len(records)))
        return found
