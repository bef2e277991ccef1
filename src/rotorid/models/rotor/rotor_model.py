"""The model of a drawn rotor; from ROSS and to it, which calls theta_x alpha and theta_y beta."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy

from rotorid.core.errors import InputError, ModelError, require_names
from rotorid.core.values import Floats, Integers, frozen
from rotorid.models.base import BaseParameters, monomial_name, monomial_unit
from rotorid.models.equations import DERIVATIVES, sort_monomials
from rotorid.models.expressions import Expression, Monomial, product, symbol
from rotorid.models.linear_form import InputTerm, StiffnessTable, StiffnessTerm, Term, TermKind
from rotorid.models.model import Model, Motion, Parameter
from rotorid.models.rotor import fem
from rotorid.models.rotor.drawing import (
    CROSSED,
    NONE,
    PLANES,
    ChannelPlace,
    Disc,
    Material,
    Quantity,
    Rotor,
    Section,
    SensorPlace,
    Support,
)
from rotorid.models.structure import Structure, energies, find_structure, force_balance

DEPENDENT = 1e-9  # share left of a matrix that others make up: rounding leaves 1e-13
WORTH = 4e7  # lines times coordinates cubed up to which the whole rotor is solved: some seconds
STANDS = 0.01
"""Share of an element by which a sensor may sit beside the node that was made for it: the motion
between two nodes errs with the fourth power of the distance."""
LAGGING = "lagging"
"""Kind of a signal that structural damping multiplies: it is a quarter turn ahead on every line."""
_TURNING = [
    product([(symbol("Omega"), Fraction(2)), (Expression(name, (symbol("phi"),)), Fraction(1))])
    for name in ("cos", "sin")
]


@frozen
class RotorModel(Model):
    """A model from a drawing: M, D, G, K are sums of constant matrices times monomials."""

    rotor: Rotor = field(kw_only=True)  # the drawing
    pieces: tuple[fem.Piece, ...] = field(kw_only=True, compare=False, repr=False)
    loads: tuple[fem.Piece, ...] = field(kw_only=True, compare=False, repr=False)
    push: Floats = field(kw_only=True, compare=False, repr=False)  # (row, input): B
    # of a reduced rotor: which coordinates of the whole its first ones are, and what it was made of
    kept: Integers | None = field(kw_only=True, default=None, compare=False, repr=False)
    # (coordinate of the whole, coordinate): how these move with its own
    basis: Floats | None = field(kw_only=True, default=None, compare=False, repr=False)
    whole: RotorModel | None = field(kw_only=True, default=None, compare=False, repr=False)

    @cached_property
    def readings(self) -> dict[str, dict[str, float]]:
        return fem.readings_of(self.rotor)

    @property
    def used(self) -> frozenset[str]:
        return frozenset(name for p in (*self.pieces, *self.loads) for name, _ in p.factors)

    @cached_property
    def _monomials(self) -> list[Monomial]:
        held = {piece.monomial(self.parameter_names) for piece in (*self.pieces, *self.loads)}
        return sort_monomials({*held, (0,) * len(self.parameters)})

    def _number(self, piece: fem.Piece) -> int:
        """Return which monomial multiplies a piece."""
        return self._places[piece.monomial(self.parameter_names)]

    @cached_property
    def input_terms(self) -> tuple[InputTerm, ...]:
        one = self._places[(0,) * len(self.parameters)]
        entries = np.argwhere(self.push).tolist()
        return tuple(InputTerm(r, c, one, float(self.push[r, c])) for r, c in entries)

    @cached_property
    def _stiffness(self) -> StiffnessTable:
        kinds: dict[TermKind, int] = {}
        parts = []
        for piece in self.pieces:
            speed = [(symbol("Omega"), Fraction(piece.power))] if piece.power else []
            kind = TermKind(piece.order, product(speed), piece.structural)
            entries = piece.matrix.tocoo()
            number = np.full(entries.nnz, kinds.setdefault(kind, len(kinds)))
            monomial = np.full(entries.nnz, self._number(piece))
            row, column = (part.astype(np.int64) for part in (entries.row, entries.col))
            parts.append((number, row, column, monomial, entries.data))
        columns: list[Any] = [np.concatenate(part) for part in zip(*parts, strict=True)]
        return StiffnessTable(tuple(kinds), *columns)

    @cached_property
    def _load_terms(self) -> tuple[Term, ...]:
        found = []
        for load in self.loads:
            number = self._number(load)
            for part, signal in zip(load.matrix.T, _TURNING, strict=True):
                rows = np.flatnonzero(part).tolist()
                found += [Term(row, number, float(part[row]), signal) for row in rows]
        return tuple(found)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The left sides, for what takes them one by one."""
        moving = [Term(t.row, t.monomial, t.coefficient, self._signal(t)) for t in self._stiffness]
        return (*moving, *(replace(t, coefficient=-t.coefficient) for t in self._load_terms))

    def _signal(self, term: StiffnessTerm) -> Expression:
        moved = symbol(self.coordinates[term.column] + DERIVATIVES[term.kind.order])
        held = Expression(LAGGING, (moved,)) if term.kind.structural else moved
        return product([*term.kind.factor.factors, (held, Fraction(1))])

    def signal_value(
        self, index: int, motion: Motion, known: Mapping[Expression, Floats] | None = None
    ) -> Floats:
        if any(base.kind == LAGGING for base, _ in self.signals[index].factors):
            expected = "damping that has a value at each instant, or estimates on lines"
            cure = "use ml, or give internal and external damping in its place"
            raise ModelError("structural damping", expected, cure, place="damping.structural")
        return super().signal_value(index, motion, known)

    @property
    def nonlinear(self) -> bool:
        return False

    def _linear_terms(self) -> tuple[StiffnessTable, tuple[Term, ...]]:
        return self._stiffness, self._load_terms

    @cached_property
    def base(self) -> BaseParameters:
        """The base parameters: monomials whose matrices are no combination of the others'."""
        if self.whole is not None:  # fewer shapes could make matrices alike
            return self.whole.base
        columns = self._columns()
        size = np.linalg.norm(columns, axis=0)
        scaled = np.asarray(np.linalg.qr(columns / np.where(size > 0, size, 1.0), mode="r"))
        kept: list[int] = []
        gather = np.zeros((len(size), len(size)))
        for number, monomial in enumerate(self._monomials):
            if not any(monomial) or not size[number]:
                continue
            found, *_ = np.linalg.lstsq(scaled[:, kept], scaled[:, number], rcond=None)
            rest = scaled[:, number] - scaled[:, kept] @ found
            if np.linalg.norm(rest) > DEPENDENT:
                gather[len(kept), number] = 1.0
                kept.append(number)
            else:
                shares = found * size[number] / size[kept]
                gather[: len(kept), number] = np.where(np.abs(shares) > DEPENDENT, shares, 0.0)
        names, units = self.parameter_names, self.parameter_units
        held = [self._monomials[number] for number in kept]
        return BaseParameters(
            tuple(monomial_name(monomial, names) for monomial in held),
            tuple(monomial_unit(monomial, names, units) for monomial in held),
            gather[: len(kept)].copy(),
            tuple(kept),
        )

    def _columns(self) -> Floats:
        """Return the entries of all matrices and loads, a column for each monomial."""
        table, count = self._stiffness, len(self._monomials)
        width = len(self.coordinates)
        places = (table.kind * width + table.row) * width + table.column
        distinct, row = np.unique(places, return_inverse=True)
        columns = np.zeros((len(distinct), count))
        np.add.at(columns, (row, table.monomial), table.coefficient)
        loads = np.zeros((2, width, count))
        for load in self.loads:
            loads[:, :, self._number(load)] += load.matrix.T
        return np.concatenate([columns, loads.reshape(-1, count)])

    @property
    def measurable(self) -> tuple[str, ...]:
        return self.coordinates if self.kept is None else self.coordinates[: len(self.kept)]

    def reduced(
        self,
        reads: set[str],
        omega: Floats,
        speed: Floats,
        values: Mapping[str, float],
        share: float,
    ) -> RotorModel:
        """Return a model with fewer coordinates, where that pays; equations are as they stand.

        `reads`: those that are measured; omega and speed in rad/s, (line,); `values` about right.
        """
        full = self if self.whole is None else self.whole
        known = {**full.nominal, **values}
        if (
            not share
            or len(omega) * float(len(full.coordinates)) ** 3 <= WORTH
            or not (omega > 0).any()
            or not {name for piece in full.pieces for name, _ in piece.factors} <= known.keys()
        ):
            return full
        pushed = np.concatenate([full.push, *(load.matrix for load in full.loads)], axis=1).any(1)
        shown = {full.coordinates.index(name) for name in reads} | set(np.flatnonzero(pushed))
        kept = np.array(sorted(shown), dtype=np.int64)
        at = np.array([known.get(name, 0.0) for name in full.parameter_names])  # 0: of loads alone
        stiffness = partial(full.require_linear().sparse_stiffness, at)
        kept, basis = fem.reduction(stiffness, kept, fem.points_of(omega, speed), share)
        if basis.shape[1] >= len(full.coordinates):
            return full
        inner = [f"inner{k + 1}" for k in range(basis.shape[1] - len(kept))]
        names = (*(full.coordinates[k] for k in kept), *inner)
        sparse = scipy.sparse.csr_array
        return replace(
            full,
            texts=tuple(f"balance of {q}" for q in names),
            coordinates=names,
            units={**full.units, **dict.fromkeys(inner, "m")},
            pieces=tuple(
                replace(p, matrix=sparse(basis.T @ (p.matrix @ basis))) for p in full.pieces
            ),
            loads=tuple(replace(load, matrix=basis.T @ load.matrix) for load in full.loads),
            push=basis.T @ full.push,
            kept=kept,
            basis=basis,
            whole=full,
        )

    def redrawn(self, values: Mapping[str, float]) -> RotorModel:
        """Return the rotor divided where sensors sit whose places the parameters tell.

        Between nodes, and above all beyond those beside it, what a sensor reads is a polynomial.
        """
        known, floating = {**dict(self.held), **values}, self.rotor.floating
        if not {name for place in floating.values() for name in place.names} <= known.keys():
            return self  # records have their own
        at = {name: place.value(known) for name, place in floating.items()}
        near = STANDS * self.rotor.length / len(self.rotor.nodes)
        inside = all(0 <= z <= self.rotor.length for z in at.values())
        if not inside or all(
            abs(at[name] - place.nominal) <= near for name, place in floating.items()
        ):
            return self
        made = rotor_model(self.rotor.with_places(at), self.parameters, name=self.name)
        parts = ("rotor", "texts", "coordinates", "units", "pieces", "loads", "push")
        other = replace(self, **{part: getattr(made, part) for part in parts})
        return replace(other, **other._with_numbers(dict(self.held)))

    def _with_numbers(self, fixed: Mapping[str, float]) -> dict[str, Any]:
        every = self.pieces, self.loads
        pieces, loads = (tuple(piece.substituted(fixed) for piece in part) for part in every)
        whole = None if self.whole is None else self.whole.substitute(fixed)
        return {"pieces": pieces, "loads": loads, "whole": whole}

    def to_ross(self, values: Mapping[str, float], *, speed: float = 0.0) -> Any:
        """Return the `ross.Rotor`, at values in SI; `speed` in rad/s, on which supports may depend.

        ROSS has no damping of the shaft: a ModelError.
        """
        try:
            import ross
        except ImportError:
            expected = "ROSS 2.3 or later, below 3"
            raise ModelError("no package ross", expected, "pip install rotorid[ross]") from None
        rotor, known = self.rotor, {**dict(self.held), **values, "Omega": speed}
        for name, damping in rotor.damping:
            if damping.value(known):
                told = f"{name} damping of {damping.value(known):g}"
                raise ModelError(told, "none, which ROSS does not have", "put its parameter to 0")
        shaft = []
        for node, section, beam in fem.spans(rotor):
            modulus = section.material.E.times(section.stiffness).value(known)
            constants = {"rho": section.material.density.value(known), "E": modulus}
            material = ross.Material(f"m{node}", **constants, G_s=modulus / section.material.ratio)
            size = {"idl": beam.inner, "odl": beam.outer}
            shaft.append(ross.ShaftElement(beam.length, **size, material=material, n=node))
        discs = [
            ross.DiskElement(
                rotor.node(d.at), d.mass.value(known), d.I_t.value(known), d.I_p.value(known)
            )
            for d in rotor.discs.values()
        ]
        bearings = [
            ross.BearingElement(
                rotor.node(s.at), **{name: q.value(known) for name, q in s.constants.items()}
            )
            for s in rotor.supports.values()
        ]
        return ross.Rotor(shaft, discs, bearings)


def rotor_model(
    rotor: Rotor, parameters: Sequence[Parameter], *, name: str, title: str = "", source: str = ""
) -> RotorModel:
    coordinates = tuple(name for node in rotor.nodes for name in node.coordinates)
    inputs = tuple(f"F_{axis}{place}" for place in rotor.actuators for axis in "xy")
    shown = (*coordinates, *fem.readings_of(rotor))
    units = {q: "rad" if q.startswith("theta") else "m" for q in shown}
    return RotorModel(
        name,
        title or name,
        source,
        tuple(f"balance of {q}" for q in coordinates),
        coordinates,
        inputs,
        {**units, **dict.fromkeys(inputs, "N")},
        tuple(parameters),
        (),
        rotor=rotor,
        pieces=fem.gathered(rotor, fem.blocks_of(rotor)),
        loads=fem.loads_of(rotor),
        push=fem.inputs_of(rotor),
    )


def inertia(model: RotorModel, values: Mapping[str, float]) -> tuple[float, ...]:
    """Return mass, its centre from the left end, and I_t and I_p about it, in SI."""
    matrices = model.require_linear().matrices(model.values(values))
    across, tilt, other = np.zeros((3, len(model.coordinates)))
    across[0::4] = 1.0
    tilt[0::4], tilt[3::4] = model.rotor.positions, 1.0
    mass = across @ matrices.M @ across
    centre = across @ matrices.M @ tilt / mass
    turned = tilt - centre * across
    other[1::4], other[2::4] = -turned[0::4], turned[3::4]
    about = turned @ matrices.M @ turned, other @ matrices.G @ turned
    return float(mass), float(centre), *map(float, about)


def structure_of(model: Model, values: Floats, speed: float) -> Structure | None:
    places = places_of(model, values, speed)
    if places is None or not isinstance(model, RotorModel):
        return places
    if model.whole is not None:
        return None  # what a model lacks acts on the coordinates of the whole
    springs, masses = energies(model, values, speed, places.balance)
    return replace(places, springs=springs, masses=masses)


def places_of(model: Model, values: Floats, speed: float) -> Structure | None:
    """Return the structure of a model; a drawing says where all of it is, and no springs."""
    if not np.isfinite(values).all():
        return None
    if not isinstance(model, RotorModel):
        return find_structure(model, values, speed)
    whole = model if model.whole is None else model.whole
    pairs: list[tuple[int, int]] = []
    slopes: dict[int, int] = {}
    for number, node in enumerate(model.rotor.nodes):
        x, y, around_x, around_y = range(PLANES * number, PLANES * (number + 1))
        slopes |= {x: around_y, y: around_x}
        pairs += [(x, y), (around_x, around_y)] if node.named else []
    every = range(0, len(whole.coordinates), PLANES)
    planes = (tuple(every), tuple(x + 1 for x in every))
    inertia = whole.require_linear().matrices(values, speed).M
    balance = force_balance(whole, inertia)
    names, units = whole.coordinates, tuple(whole.units[name] for name in whole.coordinates)
    found = Structure((), (), tuple(pairs), names, units, balance, (), inertia, planes, slopes)
    if model.kept is None or model.basis is None:
        return found
    shown = np.zeros_like(model.basis)
    shown[model.kept, np.arange(len(model.kept))] = 1.0
    return replace(found, shapes=model.basis, shown=shown)


def from_ross(
    rotor: Any,
    *,
    actuators: Mapping[str, int] | None = None,
    sensors: Mapping[str, int] | None = None,
    unknown: Sequence[str] | None = None,
) -> RotorModel:
    """Return the model of a ROSS rotor: its shaft, disks and bearings.

    Parameters
    ----------
    rotor : ross.Rotor
        Of cylindrical elements.
    actuators, sensors : mapping of str to int
        Nodes of the actuators, whose inputs are F_x and F_y before the name, and of the sensors.
    unknown : sequence of str, optional
        The parameters to keep; the others are put in as ROSS has them. The parameters are
        ``m_0``, ``I_t_0``, ``I_p_0`` of disk 0; ``kxx_0``, ``cxx_0`` and so on of bearing 0,
        as far as they are not zero; and ``s_0``, a factor on E of shaft element 0.

    Returns
    -------
    RotorModel

    Raises
    ------
    InputError
        For what a model of this package has not: conical elements, bearings that depend on the
        speed or the frequency, a parameter that is none.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> model = load_model("flexible")
    >>> ross_rotor = model.to_ross(model.nominal | {"c_i": 0.0})  # doctest: +SKIP
    >>> from_ross(ross_rotor, unknown=["m_0"]).parameter_names  # doctest: +SKIP
    ('m_0',)
    """
    parameters: list[Parameter] = []
    shaft = _shaft(rotor)
    at = np.concatenate([[0.0], np.cumsum([float(element.L) for element in shaft])])

    def named(name: str, unit: str, value: float, *, positive: bool = True) -> Quantity:
        if not value:
            return NONE
        parameters.append(Parameter(name, unit, float(value), positive and value > 0))
        return Quantity(((((name, 1),), 1.0),))

    sections = tuple(_section(e, named(f"s_{k}", "1", 1.0)) for k, e in enumerate(shaft))
    discs = {
        f"disc{k}": Disc(
            at=float(at[disk.n]),
            mass=named(f"m_{k}", "kg", disk.m),
            I_t=named(f"I_t_{k}", "kg m^2", disk.Id),
            I_p=named(f"I_p_{k}", "kg m^2", disk.Ip),
        )
        for k, disk in enumerate(rotor.disk_elements)
    }
    signed = partial(named, positive=False)
    supports = {
        f"bearing{k}": Support(
            at=float(at[bearing.n]),
            **{
                kind + axes: signed(f"{kind}{axes}_{k}", unit, _constant(bearing, kind + axes))
                for kind, unit in (("k", "N/m"), ("c", "N s/m"))
                for axes in CROSSED
            },
        )
        for k, bearing in enumerate(rotor.bearing_elements)
    }
    pushed = {n: ChannelPlace(at=float(at[node])) for n, node in (actuators or {}).items()}
    read = {n: SensorPlace(at=float(at[node])) for n, node in (sensors or {}).items()}
    every = (s.material for s in sections)
    materials = {f"{m.E.nominal:g} Pa, {m.density.nominal:g} kg/m^3": m for m in every}
    parts: dict[str, Any] = {"sections": sections, "discs": discs, "supports": supports}
    drawn = Rotor.model_construct(**parts, materials=materials, actuators=pushed, sensors=read)
    model = rotor_model(drawn, parameters, name="ross", title=str(getattr(rotor, "tag", "")))
    if unknown is None:
        return model
    cure = "take names from there"
    require_names(unknown, model.parameter_names, "no parameter {}", cure, place="unknown")
    return model.substitute({n: v for n, v in model.nominal.items() if n not in unknown})


def _shaft(rotor: Any) -> list[Any]:
    elements = sorted(rotor.shaft_elements, key=lambda e: int(e.n))
    if [int(e.n) for e in elements] != list(range(len(elements))):
        cure = "put layers into one element, or into the stiffness of a section"
        raise InputError("elements of a shaft side by side", "one element between two nodes", cure)
    return elements


def _section(element: Any, stiffness: Quantity) -> Section:
    if element.odl != element.odr or element.idl != element.idr:
        cure = "divide it into steps of its mean"
        raise InputError(f"the conical element {element.n}", "cylinders", cure)
    size = {"length": float(element.L), "outer": float(element.odl), "inner": float(element.idl)}
    given = {"E": element.material.E, "G": element.material.G_s, "density": element.material.rho}
    material = Material(**{name: Quantity.of(value) for name, value in given.items()})
    return Section(**size, material=material, stiffness=stiffness, elements=1)


def _constant(bearing: Any, name: str) -> float:
    values = np.atleast_1d(np.asarray(getattr(bearing, name), dtype=float))
    if (np.abs(values - values[0]) > 0).any():
        cure = "write a rotor file, whose supports may hold Omega"
        raise InputError(f"{name} of a bearing that depends on the speed", "constants", cure)
    return float(values[0])
