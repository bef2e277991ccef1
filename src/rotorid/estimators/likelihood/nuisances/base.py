"""What a nuisance is: unknowns of the measurement, and what they do to a record.

A kind is one file: a frozen class with its unknowns, their units, starts and priors, and its
effect. `Factor` multiplies the lines of some channels, `Reading` adds to readings, `Constant`
multiplies entries of the equations, `Turn` turns the rotor angle. Names such as ``gain[x1]`` are
for people; no code takes them apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Literal, Self

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.observation import Observation
from rotorid.record import Channel, Complexes, Floats


@frozen
class Unknown:
    """One scalar that the likelihood depends on.

    Parameters
    ----------
    name, unit : str
    start : float
        SI.
    std : float or None
        Deviation with which `prior` is known beforehand; ``None``: not known; 0: fixed.
    prior : float
    nuisance : bool
    positive : bool
    additive : bool
        It shifts what it acts on, so that no power of a common scale belongs to it.
    anchored : bool
        It scales inputs or equations, and is held loosely while errors are granted to them.
    """

    name: str
    unit: str
    start: float
    std: float | None = None
    prior: float = 0.0
    nuisance: bool = False
    positive: bool = False
    additive: bool = False
    anchored: bool = False

    @property
    def fixed(self) -> bool:
        """Known exactly."""
        return self.std == 0.0


@frozen
class Nuisances:
    """Which calibration constants are unknown; names as in the experiment file.

    Parameters
    ----------
    runout : bool
        One 1x vector per position sensor, common to all records.
    gains : sequence of {"ki", "ks", "ks*"}
        Force per current of each input, one force per displacement for all, or one per input.
    delays : sequence of {"force", "position"}
        One common delay for all channels of that kind.
    each : sequence of str
        Parameters of the model that every record has to itself.
    force_scale_std : float
        Relative deviation of a scale that all forces have in common; 0 where it is exact.
    """

    runout: bool = False
    gains: tuple[str, ...] = ()
    delays: tuple[str, ...] = ()
    each: tuple[str, ...] = ()
    force_scale_std: float = 0.0

    def __post_init__(self) -> None:
        for given, allowed, key in (
            (self.gains, ("ki", "ks", "ks*"), "gains"),
            (self.delays, ("force", "position"), "delays"),
        ):
            for name in given:
                if name not in allowed:
                    raise InputError(
                        repr(name),
                        f"one of {', '.join(allowed)}",
                        "name one of these, or leave it out",
                        place=key,
                    )
        if not 0 <= self.force_scale_std < 1:
            raise InputError(
                f"{self.force_scale_std}",
                "a share of the forces: 0.01 where they are known to 1 %",
                "give a share below 1, or leave it out",
                place="force_scale_std",
            )
        if {"ks", "ks*"} <= set(self.gains):
            raise InputError("both ks and ks*", "one of them", "drop one", place="gains")


@frozen
class Nuisance(ABC):
    """Unknowns of the measurement and their effect on the records of one machine.

    Parameters
    ----------
    unknowns : sequence of Unknown
    """

    unknowns: tuple[Unknown, ...]

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return those that the settings and the channels of some records ask for."""
        return []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return all of this kind that some records could have, without priors."""
        return []


@frozen
class Factor(Nuisance):
    """Multiplies the lines of channels: true line = factor * corrected line.

    Parameters
    ----------
    channels : set of str
        Names of the channels.
    """

    channels: frozenset[str]

    @abstractmethod
    def factor(self, values: Floats, omega: Floats) -> Complexes:
        """Return true line over corrected line, shape (line,), at the values of its unknowns."""

    @abstractmethod
    def slopes(self, values: Floats, omega: Floats) -> Complexes:
        """Return the derivative of the logarithm of `factor`, shape (line, unknown)."""


@frozen
class Reading(Nuisance):
    """Adds ``cos * cos(n phi) + sin * sin(n phi)`` to what a sensor reads; linear.

    Parameters
    ----------
    channel : str
    order : int
        n.
    """

    channel: str
    order: int = 1


@frozen
class Constant(Nuisance):
    """Stands for a constant of the force law of some inputs, one unknown.

    Parameters
    ----------
    inputs : set of str
    role : {"ki", "ks"}
    """

    inputs: frozenset[str]
    role: Literal["ki", "ks"]


@frozen
class Turn(Nuisance):
    """Adds to the rotor angle of one record.

    Parameters
    ----------
    record : int
    """

    record: int


def all_inputs(records: Sequence[Observation]) -> dict[str, Channel]:
    """Return the channels of inputs of all records by name."""
    return {c.name: c for record in records for c in record.inputs}


def all_sensors(records: Sequence[Observation]) -> dict[str, Channel]:
    """Return the channels of sensors of all records by name."""
    return {s.channel.name: s.channel for record in records for s in record.sensors}


def all_channels(records: Sequence[Observation]) -> list[Channel]:
    """Return inputs, then sensors of all records."""
    return list({**all_inputs(records), **all_sensors(records)}.values())
