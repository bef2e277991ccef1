"""The unknowns of a likelihood: parameters of the model, then nuisances, in one vector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from rotorid.core.values import Booleans, Floats, Integers, fact, frozen
from rotorid.data.observation import Observation
from rotorid.likelihood.effects import E, Effect, Reads, Replaces
from rotorid.likelihood.unknowns import Scalar, Unknown
from rotorid.models import Model


@frozen
class Layout:
    model: Model  # with what is fixed left in (physical) or put in (base)
    unknowns: tuple[Scalar, ...]  # parameters, then those of the nuisances in order
    base: bool = False  # the parameters are the base ones
    # those of parameters that differ between records (`Own`) first
    nuisances: tuple[Unknown, ...] = ()
    # of the layout of one record: parameters that it has to itself, and their unknowns
    own: Mapping[int, int] = field(default_factory=dict)
    record: int | None = None  # which one it is of, if of one
    index: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        index = {unknown.name: i for i, unknown in enumerate(self.unknowns)}
        object.__setattr__(self, "index", index)

    @cached_property
    def start(self) -> Floats:
        return np.array([unknown.start for unknown in self.unknowns])

    @cached_property
    def free(self) -> Integers:
        return np.flatnonzero([not unknown.fixed for unknown in self.unknowns])

    @cached_property
    def additive(self) -> Booleans:
        return np.array([unknown.additive for unknown in self.unknowns], dtype=bool)

    def names(self, which: Booleans | slice = slice(None)) -> tuple[str, ...]:
        """Return the names of the free unknowns, or of some."""
        return tuple(self.unknowns[i].name for i in self.free[which])

    def where(self, *names: str) -> list[int]:
        return [self.index[name] for name in names]

    def acting(self, kind: type[E]) -> list[tuple[E, Integers]]:
        """Return the effects of a kind on the record, each with the indices of its scalars."""
        return [(e, at) for record, e, at in self.wherever(kind) if record in (None, self.record)]

    def wherever(self, kind: type[E]) -> list[tuple[int | None, E, Integers]]:
        return [(record, e, at) for record, e, at in self._effects if isinstance(e, kind)]

    @cached_property
    def _effects(self) -> list[tuple[int | None, Effect, Integers]]:
        found, last = list[tuple[int | None, Effect, Integers]](), self.parameters
        for unknown in self.nuisances:
            at = last + np.arange(len(unknown.scalars))
            found += [(unknown.record, effect, at) for effect in unknown.effects]
            last += len(at)
        return found

    @cached_property
    def replaced(self) -> tuple[tuple[int, Replaces, int], ...]:
        """The parameters that single records have to themselves: record, parameter, unknown."""
        every = self.wherever(Replaces)
        return tuple((record, e, int(at[0])) for record, e, at in every if record is not None)

    def of_record(self, number: int) -> Layout:
        own = {effect.parameter: at for record, effect, at in self.replaced if record == number}
        return replace(self, own=own, record=number)

    @cached_property
    def monomial_factors(self) -> tuple[tuple[int, ...] | None, ...]:
        """The unknowns whose product each monomial of the model is; None: another stands for it."""
        factors, own = _factors(self.model, self.base), self.own
        return tuple(f and tuple(sorted(own.get(i, i) for i in f)) for f in factors)

    def observed(self, record: Observation) -> Observation:
        """Return a record with rows of their own for the sensors that read unknown shares."""
        if not (apart := {effect.channel for effect, _ in self.acting(Reads)}):
            return record
        sensors = (replace(s, apart=s.apart or s.channel.name in apart) for s in record.sensors)
        return replace(record, sensors=tuple(sensors))

    @property
    def held(self) -> Integers:
        """Where the parameters of the model stand among the unknowns, shape (parameter,)."""
        return np.array([self.own.get(i, i) for i in range(self.parameters)], dtype=np.int64)

    @cached_property
    def idle(self) -> frozenset[int]:
        """Parameters that every record has to itself: the common unknown stands for nothing."""
        return frozenset(effect.parameter for _, effect, _ in self.replaced if effect.alone)

    def load_only(self) -> set[int]:
        """Return the parameters that only loads hold, each load at most one: the unbalance."""
        model = self.model
        linear = model.require_linear()
        elsewhere = {*linear.stiffness.monomials, *(b.monomial for b in linear.input_terms)}
        others = {i for m in elsewhere for i in self.monomial_factors[m] or ()}
        of_loads = [self.monomial_factors[term.monomial] or () for term in linear.load_terms]
        only = [[i for i in factors if i not in others] for factors in of_loads]
        entangled = {i for each in only if len(each) > 1 for i in each}
        alike = {i for each in only for i in each} - entangled
        return alike | {at for _, effect, at in self.replaced if effect.parameter in alike}

    @cached_property
    def parameters(self) -> int:
        """Number of parameters of the model; they come first among the unknowns."""
        return len(self.model.base.names if self.base else self.model.parameters)

    @cached_property
    def named(self) -> int:
        return self.parameters + len(self.replaced)


@fact
def _factors(model: Model, base: bool) -> list[tuple[int, ...] | None]:
    """Return each monomial in parameters; in base ones it may be merged into another."""
    if not base:
        return [tuple(np.repeat(np.arange(len(m)), m).tolist()) for m in model.monomials]
    kept = {monomial: (number,) for number, monomial in enumerate(model.base.kept)}
    constant = {int(m): () for m in np.flatnonzero(~model.monomials.any(axis=1))}
    factors: dict[int, tuple[int, ...]] = {**kept, **constant}
    return [factors.get(m) for m in range(len(model.monomials))]
