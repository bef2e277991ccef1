"""What the equations of motion may miss: a term, or a force that turns with the rotor.

No setting asks for these: they are freed one at a time, to see what they explain.
"""

from __future__ import annotations

from collections.abc import Mapping

from rotorid.estimators.likelihood.nuisances.base import Nuisance
from rotorid.frozen import frozen
from rotorid.models.expression import Expression


@frozen
class MissingEntry:
    """``coefficient * Omega^speed_power * unknown * d^order / dt^order`` of a coordinate in a row.

    It stands on the left side, as the stiffness does; `unknown` counts among those of its nuisance.
    """

    row: int
    column: int
    order: int
    coefficient: float
    speed_power: int = 0
    unknown: int = 0


@frozen
class MissingLoad:
    """``coefficient * signal(phi, Omega) * unknown`` on the right side of a row.

    `unknown` counts among those of its nuisance.
    """

    row: int
    signal: Expression
    unknown: int
    coefficient: float = 1.0


@frozen
class Missing(Nuisance):
    """A term that the equations may miss.

    Parameters
    ----------
    entries : sequence of MissingEntry
    loads : sequence of MissingLoad
    """

    entries: tuple[MissingEntry, ...] = ()
    loads: tuple[MissingLoad, ...] = ()


@frozen
class Lever(Nuisance):
    """An actuator beside the place that the model gives it: its forces act on the slope too.

    Parameters
    ----------
    arms : mapping of int to (int, float)
        For each row that a force of it acts on, the row of the slope there, and its share of the
        force for a lever of 1 m.
    inputs : set of int
    """

    arms: Mapping[int, tuple[int, float]]
    inputs: frozenset[int]
