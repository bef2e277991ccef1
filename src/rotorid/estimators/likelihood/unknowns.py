"""The unknowns of a likelihood: parameters of the model, then nuisances, in one vector."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from rotorid.errors import InputError
from rotorid.estimators.likelihood.nuisances import Constant, Nuisance, Own, Unknown
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.linear import LinearForm
from rotorid.record import Floats, Integers


def linear_form(model: Model) -> LinearForm:
    """Return the linear form, found once; a `ModelError` names the term that is not linear."""
    return model.linear or model.require_linear()


@frozen
class Layout:
    """Names of the unknowns, and the monomials of the model in their terms.

    Parameters
    ----------
    model : Model
        With what is fixed left in (physical) or put in (base).
    unknowns : sequence of Unknown
        Parameters, then those of the nuisances in order.
    monomial_factors : sequence of tuple of int or None
        The unknowns whose product each monomial of the model is; ``None`` where another monomial
        stands for it.
    base : bool
        The parameters are the base ones.
    nuisances : sequence of Nuisance
        Those of parameters that differ between records (`Own`) first.
    own : mapping of int to int
        Of the layout of one record: parameters that it has to itself, and their unknowns.
    """

    model: Model
    unknowns: tuple[Unknown, ...]
    monomial_factors: tuple[tuple[int, ...] | None, ...]
    base: bool
    nuisances: tuple[Nuisance, ...] = ()
    own: Mapping[int, int] = field(default_factory=dict)
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

    def places(self) -> Iterator[tuple[Nuisance, Integers]]:
        """Yield each nuisance with the indices of its unknowns."""
        first = self.parameters
        for nuisance in self.nuisances:
            last = first + len(nuisance.unknowns)
            yield nuisance, np.arange(first, last)
            first = last

    def of_record(self, number: int) -> Layout:
        """Return the layout with the parameters that a record has to itself in their places."""
        own = {
            nuisance.parameter: int(at[0])
            for nuisance, at in self.places()
            if isinstance(nuisance, Own) and nuisance.record == number
        }
        if not own:
            return self
        factors = tuple(
            None if f is None else tuple(sorted(own.get(i, i) for i in f))
            for f in self.monomial_factors
        )
        return replace(self, monomial_factors=factors, own=own)

    @property
    def held(self) -> Integers:
        """Where the parameters of the model stand among the unknowns, shape (parameter,)."""
        return np.array([self.own.get(i, i) for i in range(self.parameters)], dtype=np.int64)

    @cached_property
    def idle(self) -> frozenset[int]:
        """Parameters that every record has to itself: the common unknown stands for nothing."""
        return frozenset(n.parameter for n in self.nuisances if isinstance(n, Own) and n.alone)

    def constant(self, name: str, role: str) -> int | None:
        """Return the unknown that stands for a constant of an input's force law, if one does."""
        for nuisance, where in self.places():
            if isinstance(nuisance, Constant) and nuisance.role == role and name in nuisance.inputs:
                return int(where[0])
        return None

    def load_only(self) -> set[int]:
        """Return the parameters that only loads hold, each load at most one: the unbalance."""
        model = self.model
        linear = linear_form(model)
        elsewhere = {*linear.stiffness.monomials, *(b.monomial for b in linear.input_terms)}
        others = {i for m in elsewhere for i in self.monomial_factors[m] or ()}
        found: set[int] = set()
        entangled: set[int] = set()
        for term in linear.load_terms:
            factors = self.monomial_factors[term.monomial] or ()
            only = [i for i in factors if i not in others]
            found |= set(only)
            if len(only) > 1:
                entangled |= set(only)
        alike = found - entangled
        own = ((n, at) for n, at in self.places() if isinstance(n, Own))
        return alike | {int(at[0]) for n, at in own if n.parameter in alike}

    @cached_property
    def parameters(self) -> int:
        """Number of parameters of the model; they come first among the unknowns."""
        return len(self.model.base.names if self.base else self.model.parameters)

    @cached_property
    def named(self) -> int:
        """Number of unknowns that are parameters, those of single records included."""
        return self.parameters + sum(isinstance(n, Own) for n in self.nuisances)


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
