"""What an unknown of the measurement is.

A kind is one class: its scalars with units, starts and priors, its effects, and what is said of it.
Names such as ``gain[x1]`` are for people; no code takes them apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import field
from typing import ClassVar, Literal, Self

import numpy as np

from rotorid.core.errors import InputError, require_names
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.data.observation import Observation
from rotorid.data.record import Channel
from rotorid.likelihood.effects import Effect


@frozen
class Scalar:
    """One scalar that the likelihood depends on."""

    name: str
    unit: str
    start: float  # SI
    # deviation with which `prior` is known beforehand; ``None``: not known; 0: fixed
    std: float | None = None
    prior: float = np.nan  # where nothing else is said, the start it was made with
    nuisance: bool = True  # no parameter of the model
    positive: bool = False
    # it shifts what it acts on, so that no power of a common scale belongs to it
    additive: bool = False
    # it scales inputs or equations, and is held loosely while errors are granted to them
    anchored: bool = False

    def __post_init__(self) -> None:
        if np.isnan(self.prior):
            object.__setattr__(self, "prior", self.start)

    @property
    def fixed(self) -> bool:
        return self.std == 0.0


@frozen(kw_only=True)
class Nuisances:
    """Which constants of the measurement are unknown; names as in the experiment file.

    `MaximumLikelihood` has these fields, and explains them.
    """

    runout: bool = False  # one 1x vector per position sensor, common to all records
    # sequence of {"ki", "ks", "ks*"}: force per current of each input, one force per displacement
    # for all, or one per input
    gains: tuple[str, ...] = ()
    # sequence of {"force", "position"}: one common delay for all channels of that kind
    delays: tuple[str, ...] = ()
    each: tuple[str, ...] = ()  # parameters of the model that every record has to itself
    # relative deviation of a scale that all forces have in common; 0 where it is exact
    force_scale_std: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gains", "delays", "each"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for given, allowed, key in (
            (self.gains, ("ki", "ks", "ks*"), "gains"),
            (self.delays, ("force", "position"), "delays"),
        ):
            require_names(given, allowed, cure="name one of these, or leave it out", place=key)
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
class Plausible:
    """By how much something is wrong that is taken as exact, and what to say of it."""

    about: str
    unit: str  # of the scalars meant
    size: float  # SI
    # how it is taken, with the size as one would write it; what answers it
    text: str
    cure: str
    in_scale: bool = False  # one of all forces, or of all sensors, is the scale, told by itself


@frozen
class Unknown(ABC):
    """Scalars of the measurement, and what they do to the records of one machine."""

    # its key in [estimator] or at a channel; "" where it is a rival alone
    setting: ClassVar[str] = ""
    # how wrong it may be where it is not asked for
    plausible: ClassVar[Plausible | None] = None
    # as what `every` of it is set free by itself where the data reject the model, if at all
    rival: ClassVar[Literal["", "term", "lag"]] = ""

    scalars: tuple[Scalar, ...]
    on: frozenset[str]  # names of the channels or parameters that it acts on
    record: int | None = field(default=None, kw_only=True)  # the only record that has it, if one
    # the term that stands for the same: of the two the first in the layout acts
    alternative_to: str = field(default="", kw_only=True)
    # what to do where it explains the data
    cure: str = field(default="add the term to the model", kw_only=True)

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return those that the settings and the channels of some records ask for."""
        return []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return all of this kind that some records could have, without priors."""
        return []

    @abstractmethod
    def effects(self) -> Sequence[Effect]:
        """Return what it does to a record."""

    @property
    def term(self) -> str:
        """Its name, which the parts of a vector share."""
        return self.scalars[0].name

    @property
    def unit(self) -> str:
        return self.scalars[0].unit

    def size(self, values: Floats) -> float:
        """Return what a person is told of the values of its scalars: of a vector the amplitude."""
        if len(values) == 1:
            return float(values[0])
        return float(np.linalg.norm(values) / np.sqrt(max(1.0, len(values) / 2)))

    def told(self, value: float | None) -> tuple[str, str]:
        """Say what it would be at a size, and what to do about it."""
        return f"{self.term}{amount(value, self.unit)}", self.cure

    def instead(self, value: float, inputs: Collection[str]) -> Unknown | None:
        """Return another unknown that at first looks like this one at a size, if one does."""
        return None


def amount(value: float | None, unit: str) -> str:
    """Return `` = value unit`` for people; nothing where no value is known."""
    return "" if value is None else f" = {value:.4g}{'' if unit == '1' else f' {unit}'}"


def all_inputs(records: Sequence[Observation]) -> dict[str, Channel]:
    return {c.name: c for record in records for c in record.inputs}


def all_sensors(records: Sequence[Observation]) -> dict[str, Channel]:
    return {s.channel.name: s.channel for record in records for s in record.sensors}


def all_channels(records: Sequence[Observation]) -> list[Channel]:
    return list({**all_inputs(records), **all_sensors(records)}.values())
