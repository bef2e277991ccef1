"""Rows of the residual for measured natural frequencies and damping ratios, and their derivative.

Notation: lambda of ``L = lambda^2 M + lambda (D + Omega G) + K``, with right and left vectors x
and y; ``d lambda = - y^H dL x / y^H (2 lambda M + D) x``. A row is (value - measured) / std.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from rotorid.answer.derived import deviation
from rotorid.answer.parts import ModeFit
from rotorid.core.errors import InputError
from rotorid.core.notes import Note
from rotorid.core.values import Complexes, Floats, Integers, frozen
from rotorid.likelihood.assembly import Terms
from rotorid.likelihood.effects import Entry, at_unknowns
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.relations import Monomials
from rotorid.models.knowledge import Mode, number
from rotorid.models.linear_form import StiffnessTable
from rotorid.models.modal import Eigenmodes, lowest_modes, many, parted

GRANTED = 0.3
"""Relative error granted to a frequency per relaxation, so that records lead until the last stage:
with a tenth of it one frequency 100 deviations off led every search astray, with 3 none either."""
BELOW = 0.5  # share of the lowest measured frequency about which modes of a large machine are found
ABOVE = 2  # modes above the last measured one that are looked at: a skipped one, its neighbour


@frozen
class Pencil:
    """M, D + Omega G and K of one configuration: sums of ``weight * mu[monomial]``."""

    terms: StiffnessTable
    speed: float
    monomials: Monomials  # of all unknowns
    shape: tuple[int, int]  # numbers of equations and of coordinates
    held: Mapping[int, float] = field(default_factory=dict)  # unknowns that were otherwise here

    @cached_property
    def weight(self) -> Floats | Complexes:
        found: Floats | Complexes = self.terms.sizes(self.speed) * self.terms.lag
        return found

    def put(self, unknowns: Floats) -> Floats:
        x = unknowns.copy()
        x[list(self.held)] = list(self.held.values())
        return x

    def matrices(self, unknowns: Floats) -> Floats | Complexes:
        """K, D + Omega G and M, shape (3, row, coordinate)."""
        found: Any = np.zeros((3, *self.shape), dtype=self.weight.dtype)
        t = self.terms
        values = self.weight * self.monomials.values(self.put(unknowns))[t.monomial]
        np.add.at(found, (t.order, t.row, t.column), values)
        return np.asarray(found)

    def slopes(
        self, value: complex | Complexes, left: Complexes, right: Complexes, at: Floats
    ) -> Complexes:
        """Return ``Y^H dL X`` by every unknown, (mode, mode, unknown); vectors as rows.

        Of several groups of modes at once too, each with its value, along further axes in front.
        """
        order, starts, live = self._by_monomial
        t = self.terms
        weight = self.weight[order] * np.asarray(value)[..., None] ** t.order[order]
        rows = left.conj()[..., :, None, t.row[order]] * weight[..., None, None, :]
        terms = rows * right[..., None, :, t.column[order]]
        jacobian = self.monomials.jacobian(self.put(at))
        jacobian[:, list(self.held)] = 0.0
        if not len(live):
            return np.zeros((*terms.shape[:-1], jacobian.shape[1]), dtype=np.complex128)
        return np.asarray(np.add.reduceat(terms, starts, axis=-1) @ jacobian[live])

    @cached_property
    def _by_monomial(self) -> tuple[Integers, Integers, Integers]:
        """The terms in the order of their monomials, where each of these begins, and which."""
        order = np.argsort(self.terms.monomial, kind="stable")
        live, starts = np.unique(self.terms.monomial[order], return_index=True)
        return order, starts, live


@frozen
class Solved:
    mass: Floats | Complexes
    damping: Floats | Complexes
    modes: Eigenmodes
    groups: list[Integers]


@frozen
class MeasuredRow:
    mode: Mode
    value: complex
    slope: Callable[[], Complexes]  # by every unknown

    @property
    def hertz(self) -> float:
        return self.value.imag / (2 * np.pi)

    @property
    def ratio(self) -> float:
        return -self.value.real / abs(self.value)

    def rows(self, relaxation: float) -> Iterator[tuple[float, float, complex]]:
        """Yield error, deviation and w of frequency and damping: they change by Re(w d lambda)."""
        hertz, std, _ = self.mode.in_si
        granted = GRANTED * relaxation
        yield self.hertz - hertz, float(np.hypot(std, granted * hertz)), -1j / (2 * np.pi)
        if self.mode.damping is not None:
            (ratio, std), size = self.mode.damping, abs(self.value)
            weight = -(1 + self.ratio * self.value.conjugate() / size) / size
            yield self.ratio - ratio, float(np.hypot(std, granted)), weight


@frozen
class Configuration:
    modes: tuple[Mode, ...]  # numbered
    pencil: Pencil
    # how many modes each distinct natural frequency has, in ascending order, in general
    pattern: tuple[int, ...]
    # (unknown,): the direction in which frequencies that coincide by chance are parted
    toward: Floats
    count: int  # how many modes are asked for: those that may be numbered, in two planes
    _last: dict[bytes, Solved] = field(default_factory=dict, compare=False, repr=False)

    def solved(self, unknowns: Floats) -> Solved:
        """Return matrices and modes; residual and derivative ask for them one after the other."""
        key = unknowns.tobytes()
        if key not in self._last:
            stiffness, damping, mass = self.pencil.matrices(unknowns)
            below = BELOW * 2 * np.pi * min(mode.in_si[0] for mode in self.modes)
            found = lowest_modes(mass, damping, stiffness, self.count, below)
            self._last.clear()
            self._last[key] = Solved(mass, damping, found, found.grouped(self.pattern))
        return self._last[key]

    def eigenvalues(self, unknowns: Floats) -> Complexes:
        """Return lambda of each distinct natural frequency, ascending."""
        at = self.solved(unknowns)
        return np.array([at.modes.values[group].mean() for group in at.groups])

    def measured(self, unknowns: Floats) -> Iterator[MeasuredRow]:
        at = self.solved(unknowns)
        if number(self.modes[-1]) > len(at.groups):
            raise np.linalg.LinAlgError("fewer natural frequencies than were measured")
        for mode in self.modes:
            group = at.groups[number(mode) - 1]
            value = complex(at.modes.values[group].mean())
            yield MeasuredRow(mode, value, partial(self._slope, unknowns, at, group, value))

    def _slope(self, unknowns: Floats, at: Solved, group: Integers, value: complex) -> Complexes:
        together = next(each for each in at.modes.distinct if group[0] in each)
        cluster = together if len(together) > len(group) else group
        left, right = at.modes.left[cluster], at.modes.right[cluster]
        gram = left.conj() @ (2 * value * at.mass + at.damping) @ right.T
        slopes = self.pencil.slopes(value, left, right, unknowns)
        of_each = parted(gram, slopes, self.toward)
        return np.asarray(of_each[np.isin(cluster, group)].mean(axis=0))


@frozen
class ModalRows:
    """All measured modes as rows of the residual: frequencies, and damping ratios behind each."""

    configurations: tuple[Configuration, ...] = ()

    @property
    def modes(self) -> list[Mode]:
        return [mode for each in self.configurations for mode in each.modes]

    @property
    def texts(self) -> tuple[str, ...]:
        return tuple(str(m) for m in self.modes for _ in range(1 if m.damping is None else 2))

    def __len__(self) -> int:
        return len(self.texts)

    def of_mode(self, name: str, *, others: bool = False) -> ModalRows:
        chosen = (
            replace(each, modes=tuple(m for m in each.modes if (str(m) == name) != others))
            for each in self.configurations
        )
        return ModalRows(tuple(each for each in chosen if each.modes))

    def first_hertz(self, unknowns: Floats) -> float:
        first = self.configurations[0]
        found = first.eigenvalues(unknowns).imag / (2 * np.pi)
        at = number(first.modes[0]) - 1
        return float(found[at]) if at < len(found) else float("nan")

    def measured(self, unknowns: Floats) -> Iterator[MeasuredRow]:
        for each in self.configurations:
            yield from each.measured(unknowns)

    def held(self) -> set[tuple[int, float]]:
        """Return the values that were otherwise in a test, each with its unknown."""
        return {stated for each in self.configurations for stated in each.pencil.held.items()}

    def moved(self, unknowns: Floats, unknown: int, value: float, part: float) -> Floats:
        """Return the rows where such a value was so many times the one stated."""
        configurations = []
        for each in self.configurations:
            held = dict(each.pencil.held)
            if held.get(unknown) == value:
                pencil = replace(each.pencil, held=held | {unknown: part * value})
                each = replace(each, pencil=pencil, _last={})
            configurations.append(each)
        return ModalRows(tuple(configurations)).values(unknowns)

    def values(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        every = (row for each in self.measured(unknowns) for row in each.rows(relaxation))
        return np.array([error / std for error, std, _ in every])

    def jacobian(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        rows = [
            (weight * slope).real / std
            for each in self.measured(unknowns)
            for slope in [each.slope()]
            for _, std, weight in each.rows(relaxation)
        ]
        return np.array(rows).reshape(len(rows), len(unknowns))


def configuration(layout: Layout, modes: Sequence[Mode], generic: Floats) -> Configuration:
    """Return one configuration; the pattern of its modes is that of the generic machine."""
    whole, most = _pencil(layout, modes[0]), 2 * (number(modes[-1]) + ABOVE)
    pencil = _one_of_each(whole) if many(whole.shape[1], most) else whole
    most = most if pencil.shape == whole.shape else most // 2
    free = Configuration(tuple(modes), pencil, (), generic - layout.start, most)
    try:
        pattern = tuple(map(len, free.solved(generic).modes.distinct))
        there = free.eigenvalues(layout.start)
    except np.linalg.LinAlgError:
        pattern, there = (), np.zeros(0, dtype=np.complex128)
    found = replace(free, pattern=pattern)
    count = max(len(pattern), len(there))
    if number(modes[-1]) > count:
        listed = ", ".join(f"{value.imag / (2 * np.pi):.4g}" for value in there)
        raise InputError(
            f"a measured mode that would be number {modes[-1].mode}: {modes[-1]}",
            f"at most {count}: the distinct natural frequencies of the model"
            + (f", {listed} Hz at the start" if listed else ""),
            "leave it out, or say mode = n of those that are measured twice or in two planes",
            place="modes",
        )
    return found


def _one_of_each(pencil: Pencil) -> Pencil:
    """Leave out parts that nothing joins to the rest and that ring as another: one of two planes.

    Whatever the values are, their determinants are the same; here every product of unknowns in
    every matrix has a value of its own, so that what is zero now and acts in one part tells too.
    """
    t, size = pencil.terms, np.abs(pencil.weight)
    term, places = t.monomial * len(t.kinds) + t.kind, (t.row, t.column)
    largest = np.zeros(term.max(initial=0) + 1)
    np.maximum.at(largest, term, size)
    values = np.random.default_rng(0).uniform(0.5, 1.5, len(largest)) / np.maximum(largest, 1e-300)
    matrix = coo_array((pencil.weight * values[term], places), shape=pencil.shape).toarray()
    count, part = connected_components(matrix != 0, directed=False)
    logs = [np.linalg.slogdet(matrix[part == k][:, part == k])[1] for k in range(count)]
    _, kept = np.unique(np.round(logs, 6), return_index=True)
    chosen = np.isin(part, kept)
    place, t = np.cumsum(chosen) - 1, t.where(chosen[t.row])
    t = replace(t, row=place[t.row], column=place[t.column])
    return replace(pencil, terms=t, shape=(int(chosen.sum()),) * 2)


def _pencil(layout: Layout, mode: Mode) -> Pencil:
    layout.model.require_linear().require_square()
    if layout.base and mode.parameters:
        expected = "a machine as in the records, where base parameters are asked for"
        cure = "estimate the physical parameters"
        raise InputError(f"{next(iter(mode.parameters))} of a mode", expected, cure, place="modes")
    held = {layout.index[name]: float(value) for name, value in mode.parameters.items()}
    pencil = replace(pencil_at(layout, mode.in_si[2]), held=held)
    used = set(pencil.monomials.factors[pencil.terms.monomial].ravel().tolist()) - held.keys()
    if used & layout.idle:  # of which record it would be is not known
        name = layout.unknowns[min(used & layout.idle)].name
        told = f"a mode of {name}, which every record has to itself"
        cure = f"state it: parameters = {{ {name} = ... }}"
        raise InputError(told, f"the value of {name} in the test", cure, place="modes")
    return pencil


def pencil_at(layout: Layout, speed: float) -> Pencil:
    further = at_unknowns(layout.acting(Entry))
    terms = Terms.of(layout, [t for t in further if t.order < 3])  # beyond M is no matrix
    linear = layout.model.require_linear()
    return Pencil(terms.table, speed, terms.monomials, (linear.rows, linear.coordinates))


NEAR = 5.0  # deviations of a measured frequency within which another of the model may be meant


def mode_fits(
    modes: ModalRows, unknowns: Floats, free: Integers, covariance: Floats
) -> tuple[ModeFit, ...]:
    found = []
    for each in modes.measured(unknowns):
        hertz, std, speed = each.mode.in_si
        fitted = deviation(each.slope()[free].imag / (2 * np.pi), covariance)
        ratio, spread = each.mode.damping or (None, None)
        held = tuple((name, float(v)) for name, v in each.mode.parameters.items())
        measured = number(each.mode), speed, hertz, std
        frequency, damping = float(each.hertz), float(each.ratio)
        found.append(ModeFit(*measured, frequency, fitted, ratio, spread, damping, held))
    return tuple(found)


def close_modes(modes: ModalRows, unknowns: Floats) -> Iterator[Note]:
    for each in modes.configurations:
        hertz = each.eigenvalues(unknowns).imag / (2 * np.pi)
        taken = {mode.mode for mode in each.modes}
        for mode in each.modes:
            own = hertz[number(mode) - 1]
            for other in (number(mode) - 1, number(mode) + 1):
                there = other not in taken and 1 <= other <= len(hertz)
                if there and abs(hertz[other - 1] - own) < NEAR * mode.in_si[1]:
                    text = (
                        f"{mode}: mode {other} of the model lies at {hertz[other - 1]:.6g} Hz, "
                        f"within {NEAR:g} deviations; which of the two was measured its frequency "
                        "does not tell: hold mode = n against the mode shape"
                    )
                    yield Note("modes", "doubts", text)
