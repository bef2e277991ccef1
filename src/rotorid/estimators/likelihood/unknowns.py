"""The unknowns of a likelihood: parameters of the model, then nuisances, in one vector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rotorid.errors import InputError
from rotorid.estimators import regression
from rotorid.models import Model
from rotorid.models.linear import LinearForm
from rotorid.record import Channel, Floats, Integers, PeriodicRecord


@dataclass(frozen=True)
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
    """

    name: str
    unit: str
    start: float
    std: float | None = None
    prior: float = 0.0
    nuisance: bool = False
    positive: bool = False

    @property
    def fixed(self) -> bool:
        """Known exactly."""
        return self.std == 0.0


@dataclass(frozen=True)
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
    """

    runout: bool = False
    gains: tuple[str, ...] = ()
    delays: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for given, allowed, key in (
            (self.gains, ("ki", "ks", "ks*"), "gains"),
            (self.delays, ("force", "position"), "delays"),
        ):
            for name in given:
                if name not in allowed:
                    raise InputError(
                        repr(name), f"one of {', '.join(allowed)}", "correct it", place=key
                    )
        if {"ks", "ks*"} <= set(self.gains):
            raise InputError("both ks and ks*", "one of them", "drop one", place="gains")


def linear_form(model: Model) -> LinearForm:
    """Return the linear form, found once."""
    return model.linear or model.require_linear()


@dataclass(frozen=True)
class Layout:
    """Names of the unknowns, and the monomials of the model in their terms.

    Parameters
    ----------
    model : Model
        With what is fixed left in (physical) or put in (base).
    unknowns : sequence of Unknown
    monomial_factors : sequence of tuple of int or None
        The unknowns whose product each monomial of the model is; ``None`` where another monomial
        stands for it.
    base : bool
        The parameters are the base ones.
    """

    model: Model
    unknowns: tuple[Unknown, ...]
    monomial_factors: tuple[tuple[int, ...] | None, ...]
    base: bool
    index: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        index = {unknown.name: i for i, unknown in enumerate(self.unknowns)}
        object.__setattr__(self, "index", index)

    @cached_property
    def start(self) -> Floats:
        """Starting values, shape (unknown,)."""
        return np.array([unknown.start for unknown in self.unknowns])

    @cached_property
    def free(self) -> Integers:
        """Indices of the unknowns that are not fixed."""
        return np.flatnonzero([not unknown.fixed for unknown in self.unknowns])

    def load_only(self) -> set[int]:
        """Return the parameters that only loads hold, each load at most one: the unbalance."""
        model = self.model
        linear = linear_form(model)
        elsewhere = {t.monomial for t in linear.stiffness} | {
            b.monomial for b in linear.input_terms
        }
        others = {i for m in elsewhere for i in self.monomial_factors[m] or ()}
        found: set[int] = set()
        entangled: set[int] = set()
        for term in linear.load_terms:
            factors = self.monomial_factors[term.monomial] or ()
            only = [i for i in factors if i not in others]
            found |= set(only)
            if len(only) > 1:
                entangled |= set(only)
        return found - entangled

    @property
    def parameters(self) -> int:
        """Number of parameters of the model among the unknowns; they come first."""
        return sum(not unknown.nuisance for unknown in self.unknowns)


def physical_factors(model: Model) -> tuple[tuple[int, ...], ...]:
    """Return each monomial as a product of physical parameters."""
    parameters = np.arange(len(model.parameters))
    return tuple(tuple(np.repeat(parameters, powers).tolist()) for powers in model.monomials)


def base_factors(model: Model) -> tuple[tuple[int, ...] | None, ...]:
    """Return each monomial as a base parameter, nothing (merged into another), or one."""
    kept = {monomial: base for base, monomial in enumerate(model.base.kept)}
    factors: list[tuple[int, ...] | None] = []
    for monomial, powers in enumerate(model.monomials):
        if not powers.any():
            factors.append(())
        else:
            factors.append((kept[monomial],) if monomial in kept else None)
    for term in model.input_terms:
        if model.monomials[term.monomial].any():
            held = model.parameter_names[int(model.monomials[term.monomial].argmax())]
            raise InputError(
                f"{held}, which multiplies an input",
                "inputs with known factors, where base parameters are asked for",
                "fix its value, or estimate the physical parameters",
            )
    return tuple(factors)


def sensor_channels(model: Model, record: PeriodicRecord) -> tuple[Channel, ...]:
    """Return the channels of a record that read coordinates."""
    sensors = []
    for channel in record.channels:
        if channel.name in model.inputs and channel.reads is None:
            continue
        unknown = [name for name in channel.combination if name not in model.coordinates]
        if unknown:
            raise InputError(
                f"a channel that reads {unknown[0]!r}",
                f"inputs ({', '.join(model.inputs)}) or coordinates "
                f"({', '.join(model.coordinates)})",
                "correct its name, or drop it",
                file=record.source,
                place=channel.name,
            )
        sensors.append(channel)
    if not sensors:
        raise InputError(
            "no sensor of any coordinate", "at least one", "name a channel", file=record.source
        )
    return tuple(sensors)


def input_channels(model: Model, record: PeriodicRecord) -> tuple[Channel, ...]:
    """Return the channel of each input of the model, in order."""
    return tuple(record.channels[index] for index in regression.input_channels(model, record))


def nuisance_unknowns(
    model: Model, records: Sequence[PeriodicRecord], nuisances: Nuisances
) -> tuple[Unknown, ...]:
    """Return the nuisance unknowns of several records of one machine."""
    inputs = {c.name: c for record in records for c in input_channels(model, record)}
    sensors = {c.name: c for record in records for c in sensor_channels(model, record)}
    found: list[Unknown] = []
    if "ki" in nuisances.gains:
        for channel in inputs.values():
            ki = 1.0 if channel.drive is None else channel.drive.ki
            unit = "1" if channel.drive is None else "N/A"
            found.append(Unknown(f"ki[{channel.name}]", unit, ki, nuisance=True))
    found += _stiffness_unknowns(inputs, nuisances)
    if nuisances.runout:
        for channel in sensors.values():
            found += [
                Unknown(f"runout[{channel.name}].{part}", channel.unit, 0.0, nuisance=True)
                for part in ("cos", "sin")
            ]
    everything = {**inputs, **sensors}.values()
    found += [
        Unknown(f"gain[{c.name}]", "1", 1.0, c.gain_std, 1.0, nuisance=True, positive=True)
        for c in everything
        if c.gain_std > 0
    ]
    found += [Unknown(f"delay[{kind}]", "s", 0.0, nuisance=True) for kind in nuisances.delays]
    found += [
        Unknown(f"delay[{c.name}]", "s", c.delay, c.delay_std, c.delay, nuisance=True)
        for c in everything
        if c.delay_std > 0
    ]
    found += [
        Unknown(f"phase[{number}]", "rad", 0.0, nuisance=True)
        for number, record in enumerate(records)
        if not record.phase_known
    ]
    return tuple(found)


def _stiffness_unknowns(inputs: Mapping[str, Channel], nuisances: Nuisances) -> list[Unknown]:
    if not {"ks", "ks*"} & set(nuisances.gains):
        return []
    driven = {name: c.drive for name, c in inputs.items() if c.drive is not None}
    if not driven:
        raise InputError(
            "an unknown ks, but forces instead of currents",
            "channels with a linear force law",
            "give law, current, position and ki of each",
            place="gains",
        )
    if "ks" in nuisances.gains:
        mean = float(np.mean([drive.ks for drive in driven.values()]))
        return [Unknown("ks", "N/m", mean, nuisance=True)]
    return [
        Unknown(f"ks[{name}]", "N/m", drive.ks, nuisance=True) for name, drive in driven.items()
    ]
