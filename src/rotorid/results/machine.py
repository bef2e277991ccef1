"""A linear machine at uncertain values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property
from pathlib import PurePath
from typing import Any

import numpy as np

from rotorid.answer.derived import physical_fit, require_parameters
from rotorid.answer.estimate import Estimate
from rotorid.answer.judge import MATTERS, weighed
from rotorid.answer.parts import SAME_SPEED, Shift, Value, under
from rotorid.core.errors import InputError, ModelError, require_type
from rotorid.core.linalg import covariance_root
from rotorid.core.notes import Note
from rotorid.core.toml import table_within
from rotorid.core.values import Complexes, Floats, Result, frozen
from rotorid.force.entry import LawEntry, law_keys
from rotorid.force.laws import Differential, Linear
from rotorid.likelihood.mode_rows import Pencil
from rotorid.likelihood.relations import Monomials
from rotorid.models import LinearForm, Model, load_model, parse_model, shipped_models
from rotorid.models.equations import combination_text, sensor_terms
from rotorid.models.linear_form import StiffnessTable, solved
from rotorid.models.structure import ForceBalance, force_balance


def own_model(estimate: Estimate) -> Model:
    """Return the model that an estimate was made with, from the estimate alone.

    Parameters
    ----------
    estimate : Estimate
        It holds its model file's text; one of an older version, which does not, is taken to be of
        the shipped model of that name.

    Returns
    -------
    Model

    Raises
    ------
    InputError
        For an older estimate of a model that is not shipped.

    Examples
    --------
    >>> import rotorid as rid
    >>> mass = rid.Value("m", "kg", 2.0, std=0.01)
    >>> rid.own_model(rid.Estimate("jeffcott", "ml", "ok", (mass,))).coordinates
    ('x', 'y')
    """
    require_type(estimate, Estimate, place="estimate")
    source = estimate.provenance
    if source is not None and source.model:
        model = parse_model(
            source.model, name=estimate.model, file=f"the result's {estimate.model}"
        )
        return model.substitute(dict(source.held))
    files = () if source is None else source.files
    own = any(PurePath(f.file).name == f"{estimate.model}.toml" for f in files[1:])
    if estimate.model in shipped_models() and not own:
        return load_model(estimate.model)
    found = f"a result of {estimate.model[:60]!r} without the text of its model"
    cure = "identify again with this version"
    raise InputError(found, "a result that holds it, or one of a shipped model", cure)


STEP = 1e-4
"""Share of a speed by which it is moved for derivatives: what depends on it is a polynomial of low
degree, and central differences of a cubic are right to the square of this."""
SIDE = 0.05
"""Share of a deviation by which the values are moved to either side for a derivative."""
SMALL = 1e-3
"""Share of a value by which it is moved for the derivative by that value alone."""
NEAR = 0.01
"""Share by which values are moved to see which modes are one in general, and not by chance."""


Laws = Mapping[str, tuple[float, float]]
"""ki and ks of inputs, in N/A and N/m."""


@frozen
class Machine:
    """A machine that is linear in its coordinates, at its values.

    No force acts at its inputs: neither those of a controller nor the negative stiffness of
    magnets, which is part of their force law. Bearings are in it where its equations hold them.
    """

    model: Model  # with what is fixed substituted
    linear: LinearForm
    # what is not fixed: physical parameters, or base parameters of a least-squares result
    names: tuple[str, ...]
    values: Floats  # (unknown,): SI
    covariance: Floats | None  # (unknown, unknown), or None: ``None`` where nothing is known of it
    monomials: Monomials  # of the model's monomials, by the unknowns
    used: Floats  # (monomial,): 0 for those that are part of another one's base parameter, else 1
    fixed: tuple[tuple[str, float], ...] = ()  # sequence of (name, value): what was substituted, SI
    status: str = "ok"  # of the estimate; "ok" for a model
    verdict: str = "ok"  # the same, or doubtful; what is assumed is asked anew
    remarks: tuple[str, ...] = ()  # what is to be said with every answer
    undetermined: tuple[str, ...] = ()  # parameters that are taken as zero
    record: int = 0  # whose values these are
    speeds: tuple[float, float] | None = None  # the lowest and the highest of the records
    shifts: tuple[Shift, ...] = ()  # what errors of what is assumed move
    _pencils: dict[float, Pencil] = field(
        default_factory=dict, init=False, compare=False, repr=False
    )
    solutions: dict[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    @cached_property
    def steady(self) -> bool:
        """Whether M, D and K are the same at every speed."""
        return not any(kind.factor.free_symbols for kind in self._terms.kinds)

    def pencil(self, speed: float) -> Pencil:
        """Return M, D + Omega G and K at a speed, by the unknowns."""
        if speed not in self._pencils:
            self._pencils.clear()
            size = self.linear.coordinates
            self._pencils[speed] = Pencil(self._terms, speed, self.monomials, (size, size))
        return self._pencils[speed]

    @cached_property
    def _terms(self) -> StiffnessTable:
        table = self.linear.stiffness
        return table.where(np.asarray(self.used, dtype=bool)[table.monomial])

    def matrices(self, speed: float) -> Floats | Complexes:
        """Return K, D + Omega G and M, shape (3, row, coordinate)."""
        return self.pencil(speed).matrices(self.values)

    def inertia(self, speed: float = 0.0) -> Floats:
        mass = np.real(self.matrices(speed)[2])
        balance = force_balance(self.model, mass)
        return np.asarray(np.abs(np.diag(balance.forces(mass))))

    def matrices_by_speed(self, speed: float) -> Floats | Complexes:
        step = STEP * max(abs(speed), 1.0)
        above, below = self.matrices(speed + step), self.matrices(speed - step)
        slopes: Floats | Complexes = (above - below) / (2 * step)
        return slopes

    def load(self, speed: float) -> tuple[Complexes, Complexes]:
        """Return g, of ``Re(g exp(i phi))``, (row,), and its derivative, (row, unknown)."""
        columns = self.linear.rotation_columns(speed) * self.used
        mu, slopes = self.monomials.values(self.values), self.monomials.jacobian(self.values)
        return np.asarray(columns @ mu), np.asarray(columns @ slopes)

    def response(self, speed: float) -> tuple[Complexes, Complexes]:
        """Return the motion Q that the unbalance makes, (coordinate,), and its derivative.

        ``q = Re(Q exp(i phi))``. Refused at an undamped critical speed.
        """
        load, by_load = self.load(speed)
        motion = self.answer(speed, load[:, None])[:, 0]
        pencil, table = self.pencil(speed), self._terms
        weight = pencil.weight.conj() if speed < 0 else pencil.weight
        # d (Z q) by the monomials, at the motion q
        by_monomial = np.zeros((len(motion), len(self.used)), dtype=np.complex128)
        terms = weight * (1j * speed) ** table.order * motion[table.column]
        np.add.at(by_monomial, (table.row, table.monomial), terms)
        by_stiffness = by_monomial @ self.monomials.jacobian(self.values)
        return motion, self.answer(speed, by_load - by_stiffness)

    def answer(self, speed: float, loads: Complexes) -> Complexes:
        """Return the motion that loads on the rotation's line make, (coordinate, load)."""
        stiffness, damping, mass = parts = self.matrices(speed)
        if speed < 0:  # structural damping lags there too
            stiffness = stiffness.conj()
        size = np.einsum("p,pij->ij", abs(speed) ** np.arange(3), np.abs(parts))  # they may cancel
        matrix = (1j * speed) ** 2 * mass + 1j * speed * damping + stiffness
        return np.asarray(solved(matrix[None], loads[None], np.array([speed]), size[None])[0])

    def input_matrix(self) -> Floats:
        """B, shape (row, input)."""
        return self.linear.input_matrix(self.monomials.values(self.values) * self.used)

    def law(self, name: str, known: Laws) -> tuple[float, float]:
        """Return ki and ks of an input: as they were identified, else as known, else NaN."""
        values = dict(zip(self.names, self.values.tolist(), strict=True))
        ki, ks = known.get(name, (np.nan, np.nan))
        several = (v for n, v in values.items() if n[:3] == "ks[" and name in n[3:-1].split(", "))
        return values.get(f"ki[{name}]", ki), next(several, values.get("ks", ks))

    @property
    def spread(self) -> Floats:
        if self.covariance is None:
            return np.zeros(len(self.values))
        return np.asarray(np.sqrt(np.diag(self.covariance).clip(0)))

    @property
    def root(self) -> Floats:
        """R with ``R R' = covariance``, shape (unknown, unknown)."""
        assert self.covariance is not None
        return covariance_root(self.covariance)

    def changes(
        self, found: Callable[[Machine], Floats | Complexes], root: Floats | None = None
    ) -> Complexes:
        """Return how what follows from a machine changes along the columns of a root, (column, ..).

        The sum of the squares over those of `root` is its variance, as all values are uncertain.
        """
        if root is None:
            root = np.zeros((1, 0)) if self.covariance is None else self.root
        columns = [c for c in root.T if c.any()]
        if not columns:
            return np.zeros((0, *found(self).shape), dtype=np.complex128)
        sides = [(found(self._moved(SIDE * c)), found(self._moved(-SIDE * c))) for c in columns]
        return np.array([(a - b) / (2 * SIDE) for a, b in sides], dtype=np.complex128)

    def _moved(self, by: Floats) -> Machine:
        return replace(self, values=self.values + by)

    def recorded(self, speed: float) -> bool:
        low, high = self.speeds or (0.0, np.inf)
        return low * (1 - SAME_SPEED) <= abs(speed) <= high * (1 + SAME_SPEED)

    def assumed(
        self, speed: float, names: Sequence[str], std: Floats, by: Callable[[Floats], Floats]
    ) -> tuple[Floats, list[Note]]:
        """Return how far errors of what is assumed move results at a speed, and notes on them.

        NaN at the speeds of the records. `by` says what the results deviate by for a root of the
        covariance, (unknown, column): what an error moves is one too.
        """
        if self.speeds is None or self.recorded(speed) or not std.size:
            return np.full(std.shape, np.nan), []
        scale, found = np.where(std > 0, std, np.inf), list[tuple[Note, Floats, float]]()
        for shift in self.shifts:
            moves = shift.at(abs(speed), self.speeds[1])
            none = np.zeros(len(next(iter(moves.values()))))
            own = [moves.get(f"{n}[{self.record}]", moves.get(n, none)) for n in self.names]
            found.append((shift.note, (by(np.array(own)) / scale).ravel(), MATTERS))
        total, notes = weighed(found, names)
        return total.reshape(std.shape) * std, notes

    def assumed_of(
        self, speed: float, names: Sequence[str], std: Floats, found: Callable[[Machine], Complexes]
    ) -> tuple[Floats, list[Note]]:
        """Return the same of the real parts of what is found, by differences."""
        size = SMALL * np.where(self.values != 0, np.abs(self.values), 1.0)
        beyond = not self.recorded(speed)
        slopes = self.changes(found, np.diag(size)).real.T / size if beyond else np.zeros(())
        return self.assumed(speed, names, std, lambda by: np.linalg.norm(slopes @ by, axis=1))

    @property
    def needed(self) -> list[int]:
        held = {m for m in self.linear.stiffness.monomials if self.used[m]}
        count = len(self.names)
        return sorted({u for m in held for u in self.monomials.factors[m].tolist() if u < count})

    @property
    def elsewhere(self) -> Machine:
        """The machine at other values, near these, that keep what is certain between them."""
        rng, values = np.random.default_rng(0), self.values
        if self.covariance is None:
            return replace(self, values=values * (1 + NEAR * rng.uniform(-1, 1, len(values))))
        # A combination of its columns: within what is certain, the same way on any processor.
        scale = np.where(self.spread > 0, self.spread, 1.0)
        correlation = self.covariance / np.outer(scale, scale)
        moved = scale * (correlation @ rng.standard_normal(len(values)))
        size = np.where(values != 0, np.abs(values), np.inf)
        largest = float((np.abs(moved) / size)[self.needed].max(initial=0.0))
        return replace(self, values=values + (NEAR / largest * moved if largest > 0 else 0.0))


class OfAMachine(Result):
    """A base of results of one machine: model, its coordinates, status and remarks are of it."""

    machine: Machine

    model: Any = property(lambda self: self.machine.model.name)
    coordinates: Any = property(lambda self: self.machine.model.coordinates)
    status: Any = property(lambda self: self.machine.status)
    verdict: Any = property(lambda self: under(self.machine.verdict, self.notes))
    remarks: Any = property(lambda self: self.machine.remarks)


def machine_of(source: Estimate | Model, record: int = 0) -> Machine:
    """Return an estimate's machine, with the values of a record, or a model's, at nominal ones."""
    require_type(source, Estimate, Model, place="source")
    if isinstance(source, Model):
        model, source = source, _nominal(source)
    elif source.status == "not_converged":
        cure = "see its warnings, and identify again"
        raise InputError("a result that has not converged", "one that is ok, or rejected", cure)
    else:
        model = own_model(source)
    seen = source.evidence.records if source.evidence else ()
    last = max([0, len(seen) - 1, *(each.record for each in source.line_misfit)])
    if record > last and (seen or source.line_misfit):
        told = f"record {record}, of a result of {last + 1}"
        raise InputError(told, f"an index from 0 to {last}", "count from 0", place="record")
    source = _of_record(model, source, record)
    fixed = {v.name: v.value for v in source.parameters if v.fixed}
    off = {name for shift in source.shifts for name in shift.moves}  # no constant, if without std
    known = {*model.parameter_names} - off
    reduced = model.substitute({n: v for n, v in fixed.items() if n in known})
    linear = _linear(reduced)
    require_parameters(model, source)
    covariance, remarks = _stated(source)
    machine = _machine(reduced, linear, source, covariance)
    machine = replace(machine, fixed=tuple(fixed.items()), status=source.status, remarks=remarks)
    machine = replace(machine, record=record, speeds=source.speeds, shifts=source.shifts)
    machine = replace(machine, verdict="doubtful" if source.doubt else source.status)
    return _determined(machine)


def _stated(source: Estimate) -> tuple[Floats | None, tuple[str, ...]]:
    """Return the covariance that counts, None where nothing is known, and what is to be said."""
    stated = bool(source.parameters) and len(source.free) == len(source.covariance)
    covariance, remarks = source.covariance if stated else None, list[str]()
    determined = [np.isfinite(value.value) for value in source.free]
    if covariance is not None and not np.isfinite(np.diag(covariance)[determined]).all():
        covariance = None
        remarks.append("the result states no deviations, and so does nothing that follows from it")
    elif covariance is not None and not (np.diag(covariance) > 0).any():
        covariance = None
        remarks.append("all parameters are fixed, so that nothing is known of deviations")
    if source.status == "rejected":
        # Deviations grow as if all of the misfit were noise.
        ratios = [v.std_inflated / v.std for v in source.parameters if v.std and v.std_inflated]
        ratio = max([1.0, *(r for r in ratios if np.isfinite(r))])
        covariance = None if covariance is None else covariance * ratio**2
        remarks.append(
            "warning: the data reject the model; deviations are inflated as if all of the "
            "misfit were noise"
        )
    if source.doubt:
        remarks.append(f"warning: the result is doubtful ({source.doubt}), and so is this")
    if source.status == "not_identifiable":
        remarks.append("warning: the result is not_identifiable; others fit as well")
    return covariance, tuple(remarks)


def _of_record(model: Model, source: Estimate, record: int) -> Estimate:
    """Return an estimate with the values of one record under their own names.

    A common value that they stand for has theirs in exchange, with its row of the covariance.
    """
    there, renamed = [v.name for v in source.parameters], dict[str, str]()
    for name in model.parameter_names:
        if f"{name}[{record}]" in there:
            renamed[f"{name}[{record}]"] = name
        elif name not in there and (own := [v for v in there if v.startswith(f"{name}[")]):
            expected = f"one that has: {', '.join(own)}"
            cure = "say which record"
            raise InputError(f"record {record}, which has no {name} of its own", expected, cure)
    kept = [v for v in source.parameters if not (v.fixed and v.name in renamed.values())]
    names = renamed | {common: own for own, common in renamed.items()}
    found = (replace(v, name=names.get(v.name, v.name)) for v in kept)
    return source.with_(parameters=tuple(found))


def _nominal(model: Model) -> Estimate:
    missing = [name for name in model.parameter_names if name not in model.nominal]
    if missing:
        found = f"no nominal value of {', '.join(missing)}"
        cure = "give nominal in the model file, or take a result"
        raise InputError(found, "a value of every parameter", cure, file=model.name)
    units, nominal = model.parameter_units, model.nominal
    values = tuple(Value(name, units[name], nominal[name]) for name in model.parameter_names)
    return Estimate(model.name, "", "ok", values)


def _machine(
    reduced: Model, linear: LinearForm, source: Estimate, covariance: Floats | None
) -> Machine:
    """Return the machine of an estimate; unknowns of the measurement may act in it, as ki does."""
    values = {v.name: v.value for v in source.parameters}
    physical = {*reduced.parameter_names} <= values.keys()
    names = reduced.parameter_names if physical else reduced.base.names
    found = np.array([values[name] for name in names], dtype=float)
    beside = [v for v in source.nuisance if v.name not in values and source.method == "ml"]
    extra = {v.name: v.value for v in beside if np.isfinite(v.value)}
    own = _arranged(source, covariance, names)
    if not physical and (fitted := _fitted(reduced, linear, found, own)) is not None:
        physical, names = True, reduced.parameter_names
        found, own = fitted
    exponents = reduced.monomials
    used = np.ones(len(exponents))
    if not physical:
        used = np.where(exponents.any(axis=1), 0.0, 1.0)
        used[list(reduced.base.kept)] = 1.0
        exponents = np.zeros((len(exponents), len(names)), dtype=np.int64)
        exponents[list(reduced.base.kept), np.arange(len(names))] = 1
    whole = _arranged(source, covariance, (*names, *extra))
    if whole is not None:
        whole[: len(names), : len(names)] = own
    products = [np.repeat(np.arange(len(names)), powers).tolist() for powers in exponents]
    monomials = Monomials.of(products, len(names) + len(extra))
    every = np.append(found, list(extra.values()))
    return Machine(reduced, linear, (*names, *extra), every, whole, monomials, used)


def _fitted(
    model: Model, linear: LinearForm, base: Floats, covariance: Floats | None
) -> tuple[Floats, Floats | None] | None:
    """Return the physical parameters that fit base ones best, where they determine the machine.

    Base parameters that were estimated one by one hold no free motion and no symmetry any more.
    """
    weights = np.diag((1e-3 * base) ** 2) if covariance is None else covariance
    values, spread, determined = physical_fit(model, base, weights)
    held = list(linear.stiffness.monomials)
    if not determined[(model.monomials[held] > 0).any(axis=0)].all():
        return None
    values = np.where(determined, values, np.nan)
    return values, None if covariance is None else np.asarray(spread @ spread.T)


def _arranged(source: Estimate, covariance: Floats | None, names: Sequence[str]) -> Floats | None:
    """Return the covariance of some quantities: zero of those that it does not hold."""
    if covariance is None:
        return None
    rows = {v.name: k for k, v in reversed([*enumerate(source.free)])}
    held = np.pad(np.nan_to_num(covariance, posinf=0.0, neginf=0.0), (0, 1))
    chosen = [rows.get(name, -1) for name in names]
    return np.asarray(held[np.ix_(chosen, chosen)])


def _determined(machine: Machine) -> Machine:
    """Refuse what leaves the matrices undetermined; the rest that is so is put to zero."""
    bad = ~np.isfinite(machine.values)
    if not bad.any():
        return machine
    lacking = [machine.names[u] for u in machine.needed if bad[u]]
    if lacking:
        expected = "a value of every parameter of the machine"
        cure = "fix one or measure more, then identify again"
        raise InputError(f"a result that leaves {', '.join(lacking)} undetermined", expected, cure)
    covariance = machine.covariance
    if covariance is not None:
        covariance = np.where(bad[:, None] | bad, 0.0, covariance)
    open_ = tuple(name for name, lost in zip(machine.names, bad, strict=True) if lost)
    return replace(
        machine,
        values=np.where(bad, 0.0, machine.values),
        covariance=covariance,
        remarks=(*machine.remarks, f"not determined, and taken as zero: {', '.join(open_)}"),
        undetermined=(*machine.undetermined, *open_),
    )


def _linear(model: Model) -> LinearForm:
    try:
        linear = model.require_linear()
    except ModelError as error:
        raise ModelError(
            error.found,
            "equations linear in the coordinates with constant coefficients",
            "modes, balancing and state space are of linear models: leave that term out",
            file=error.file or model.name,
            place=error.place,
        ) from None
    linear.require_square(model.name)
    return linear


def laws_of(estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Return ki and ks of each input whose law stands in the experiment file of an estimate."""
    text = "" if estimate.provenance is None else estimate.provenance.experiment
    channels = table_within(text).get("channels")
    found = {}
    for name, entry in channels.items() if isinstance(channels, dict) else ():
        if not isinstance(entry, dict) or entry.get("law") not in ("linear", "differential"):
            continue
        try:
            built = LawEntry.model_validate({k: entry[k] for k in law_keys() if k in entry}).build()
        except ValueError:
            continue
        if isinstance(built, Linear | Differential):
            slope = built.linearize()
            found[name] = (slope.ki, slope.ks)
    return found


def directions_of(machine: Machine) -> ForceBalance:
    """Return which equation tells the forces on each coordinate, by virtual work."""
    return force_balance(machine.model, np.real(machine.matrices(0.0)[2]))


def shares_of(machine: Machine, text: str) -> Floats | None:
    """Return the coordinates that a text combines, shape (coordinate,); None where it does not."""
    model = machine.model
    names = list(model.coordinates)
    if text in model.readings:
        text = combination_text(model.readings[text])
    values = {**dict(machine.fixed), **dict(zip(machine.names, machine.values, strict=True))}
    parameters = [name for name in values if name.isidentifier()]
    try:
        terms = sensor_terms(text, names, parameters)
    except InputError:
        return None
    found = np.zeros(len(names))
    for term in terms:
        size = [values[p] ** n for p, n in zip(parameters, term.powers, strict=True)]
        found[term.coordinate] += term.coefficient * float(np.prod(size))
    return None if any(term.order for term in terms) else found


def require_shares(machine: Machine, kind: str, text: str, cure: str) -> Floats:
    found = shares_of(machine, text)
    if found is None:
        expected = f"a combination of {', '.join(machine.model.coordinates[:8])}"
        raise InputError(f"the {kind} {text[:60]!r}", expected, cure, place=f"{kind}s")
    return found
