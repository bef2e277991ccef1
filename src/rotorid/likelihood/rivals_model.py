"""Rival hypotheses on the model: terms that it may lack, and what was stated of it.

Bounds, known values and measured modes may be wrong, and an unbalance that a record states: two
parameters that loads alone hold, a quarter turn apart. Where that was typed at a wrong angle no
derivative shows it, and a turned mark explains it as well. Both are set free to find the angle;
then the mass is held, and turned by that angle alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import combinations, combinations_with_replacement
from itertools import product as product_of

import numpy as np

from rotorid.core.linalg import coupled
from rotorid.core.values import Floats
from rotorid.likelihood.case import Case, Rival, freed, rivals
from rotorid.likelihood.effects import Drives, Entry, Replaces, RowLoad
from rotorid.likelihood.mode_rows import ModalRows
from rotorid.likelihood.problem import Point
from rotorid.likelihood.relations import Limit
from rotorid.likelihood.rivals_read import quarter, worst_records
from rotorid.likelihood.solver import bounds_held
from rotorid.likelihood.unknowns import Scalar, Unknown, amount
from rotorid.models import Model
from rotorid.models.expressions import Expression, product, symbol
from rotorid.models.knowledge import Mode, number
from rotorid.models.rotor import RotorModel
from rotorid.models.rotor.fem import Piece, Span, by_share, gathered, spans
from rotorid.models.structure import Structure

BENDS = "bending of the shaft"
STIFFEN = (
    "the shaft bends: take a rotor file of its drawing, or a model with a bending mode (docs/"
    "write-a-model.md), or only lines far below its first bending frequency"
)
"""What to do about a rotor that is not rigid."""
BENDING = 4
"""Order of the derivative by which a shaft that bends differs from a rigid one: the inertial force,
of the second, bends it, and what it bends by is accelerated in turn."""
UNITS_AT = ("N/m", "kg", "N s/m", "kg m"), ("N m/rad", "kg m^2", "N m s/rad", "kg m^2")
"""Of a stiffness, a mass, a damping and a load at a displacement, and at a tilt."""
K, K_SPEED, D, D_SPEED, M = (0, 0), (0, 1), (1, 0), (1, 1), (2, 0)
"""Matrices by the derivative that they multiply, and by the power of the speed."""


def find_candidates(structure: Structure, *, still: bool = False) -> list[Unknown]:
    """Return the terms that may be missing; `still`: no rotor turns."""
    bending = [_bending(structure)] if structure.pairs and not structure.springs else []
    return [
        *(_term(structure, *each) for each in _of_parts(structure, still)),
        *bending,
        *_sleeves(structure),
        *_to_ground(structure, still),
        *parts_between(structure),
    ]


Matrices = Mapping[tuple[int, int], Floats]


def _of_parts(structure: Structure, still: bool) -> Iterator[tuple[str, str, Matrices]]:
    springs, masses = structure.springs, structure.masses
    several = [(", ".join(n for n, _ in springs), _sum(springs))] if len(springs) > 1 else []
    for name, matrix in (*springs, *several):
        yield f"damping {name}", "s", {D: matrix}
        if not still:  # in the rotating frame: C (q' - Omega J q)
            turning = -matrix @ structure.turn()
            yield f"rotating damping {name}", "s", {K_SPEED: turning, D: matrix}
    for name, matrix in masses:
        yield f"damping {name}", "1/s", {D: matrix}
    for kind, energies in ((K, springs), (M, masses)):
        for name, matrix in energies:
            parts = coupled(matrix)
            for part in parts[1:]:
                block = np.zeros_like(matrix)
                block[np.ix_(part, part)] = matrix[np.ix_(part, part)]
                where = f" at {structure.coordinates[part[0]]}" if len(parts) > 2 else ""
                yield f"asymmetry {name}{where}", "1", {kind: block}


def _bending(structure: Structure) -> Unknown:
    """Return what a shaft that bends adds to a rigid rotor, far below its first bending mode.

    With a compliance C between forces and readings, y = S q + C F, and F = B^-1 M q" of the rigid
    rotor, its equations become M q" + M A M q"" = B F with A = S^-1 C B^-1: symmetric where
    sensors stand beside their magnets, and the same in both planes.
    """
    heavy, parts, units = _sum(structure.masses), list[Matrices](), structure.units
    for one, other in combinations_with_replacement(structure.pairs, 2):
        alike = (units[one[0]] == "m") == (units[other[0]] == "m")
        matrix = _in_both_planes(len(heavy), one, other, alike=alike)
        parts.append({(BENDING, 0): heavy @ matrix @ heavy})
    unit = "m/N" if units[structure.pairs[0][0]] == "m" else "rad/(N m)"
    # Its unknowns have units of their own.
    term = _term(structure, BENDS, unit, *parts)
    return replace(term, cure=STIFFEN, size=lambda v: float(v[0]))


def _in_both_planes(
    size: int, one: tuple[int, int], other: tuple[int, int], *, alike: bool
) -> Floats:
    matrix = np.zeros((size, size))
    for a in (0, 1):  # lengths go with tilts of their plane: x with theta_y, y with -theta_x
        b, sign = (a, 1.0) if alike else (1 - a, 1.0 - 2.0 * a)
        matrix[one[a], other[b]] = matrix[other[b], one[a]] = sign
    return matrix


def _sleeves(structure: Structure) -> Iterator[Unknown]:
    """Yield a mass on a rigid rotor off its centre: what of it no mass and no inertia takes up."""
    units = structure.units
    for one, other in combinations(structure.pairs, 2) if not structure.springs else ():
        if units[one[0]] == "m" and units[other[0]] == "rad":
            places = ", ".join(structure.coordinates[k] for k in one)
            matrix = _in_both_planes(len(units), one, other, alike=False)
            term = _term(structure, f"mass beside {places}", "kg m", {M: matrix})
            yield replace(term, cure="add it where it sits, as mass times distance and its square")


def _sum(parts: Sequence[tuple[str, Floats]]) -> Floats:
    return np.asarray(np.sum([matrix for _, matrix in parts], axis=0))


def _to_ground(structure: Structure, still: bool) -> Iterator[Unknown]:
    """Yield what may act at one place: each pair of coordinates, or each that has no partner."""
    n = len(structure.coordinates)
    for group in _places(structure):
        names = ", ".join(structure.coordinates[k] for k in sorted(group))
        stiff, mass, rate, load = UNITS_AT[structure.units[group[0]] == "rad"]
        one = np.diag(np.isin(np.arange(n), group).astype(float))
        yield _term(structure, f"stiffness to ground {names}", stiff, {K: one})
        yield _term(structure, f"mass at {names}", mass, {M: one})
        if not still:
            yield _load(structure, f"load at {names}", load, group)
        if len(group) == 2:
            cross = -one @ structure.turn()
            yield _term(structure, f"cross-coupling to ground {names}", stiff, {K: cross})
            if not still:
                yield _term(structure, f"gyroscopic {names}", mass, {D_SPEED: cross})
            yield _term(structure, f"damping to ground {names}", rate, {D: one})


def _places(structure: Structure) -> Iterator[tuple[int, ...]]:
    """Yield the coordinates of each place whose equations tell the forces there."""
    for group in (*structure.pairs, *((k,) for k in structure.lone)):
        if not structure.balance.faults.keys() & {*group}:
            yield group


def parts_between(structure: Structure) -> list[Unknown]:
    """Return a mass halfway between each two places of a shaft; none of a drawing: it bends."""
    found, unknown = list[Unknown](), structure.balance.faults.keys()
    places = [p for p in structure.pairs if structure.units[p[0]] == "m" and not unknown & {*p}]
    for one, other in combinations(places, 2) if not structure.slopes else ():
        half = np.zeros((2, len(structure.coordinates)))  # the mean of both, in x and in y
        half[[0, 1], one] = half[[0, 1], other] = 0.5
        names = (structure.coordinates[min(one)], structure.coordinates[min(other)])
        text = f"mass between {names[0]} and {names[1]}"
        found.append(_term(structure, text, "kg", {M: half.T @ half}))
    return found


def bows(structure: Structure) -> list[Unknown]:
    """Return a bow at each place: the springs pull to where it turns, K b in place of 0.

    None of a drawing, which says nothing of the shape.
    """
    if not structure.springs or structure.slopes:
        return []
    stiffness, names = structure.in_rows(_sum(structure.springs)), structure.coordinates
    (cos, sin), found = _turning(0), list[Unknown]()
    for group in _places(structure):
        along = ((0, 0, cos, 1.0), (0, 1, sin, -1.0), (1, 0, sin, 1.0), (1, 1, cos, 1.0))
        loads = [
            RowLoad(int(r), signal, sign * float(stiffness[r, group[k]]), (part,))
            for k, part, signal, sign in along[: 2 * len(group)]
            for r in np.flatnonzero(stiffness[:, group[k]])
        ]
        if loads and structure.units[group[0]] == "m":
            name = f"bow at {', '.join(names[k] for k in sorted(group))}"
            found.append(_missing(name, "m", loads))
    return found


def _load(structure: Structure, name: str, unit: str, group: Sequence[int]) -> Unknown:
    """Return a free load of the rotor's speed, two amplitudes on each coordinate."""
    rows, scales = structure.balance.rows, structure.balance.scales
    loads = [
        RowLoad(int(rows[c]), signal, float(scales[c]), (2 * k + part,))
        for k, c in enumerate(group)
        for part, signal in enumerate(_turning(2))
    ]
    return _missing(name, unit, loads)


def _turning(power: int) -> list[Expression]:
    """Return the cosine and the sine of the rotor angle, times a power of the speed."""
    grown = (symbol("Omega"), Fraction(power))
    turning = [(Expression(name, (symbol("phi"),)), Fraction(1)) for name in ("cos", "sin")]
    return [product([grown, factor]) for factor in turning]


def _term(structure: Structure, name: str, unit: str, *parts: Matrices) -> Unknown:
    """Return what adds to the equations, an unknown for each of its parts."""
    entries = [
        Entry(int(r), int(c), order, float(rows[r, c]), power, (part,))
        for part, matrices in enumerate(parts)
        for (order, power), matrix in sorted(matrices.items())
        for rows in [structure.in_rows(matrix)]
        for r, c in np.argwhere(rows)
    ]
    return _missing(name, unit, entries)


def _missing(name: str, unit: str, effects: Sequence[Entry | RowLoad]) -> Unknown:
    count = 1 + max((effect.factors[0] for effect in effects), default=0)
    names = [name] if count == 1 else [f"{name} ({i})" for i in range(count)]
    scalars = tuple(Scalar(each, unit, 0.0, additive=True) for each in names)
    return Unknown(scalars, frozenset(), tuple(effects), name)


def drawn_candidates(structure: Structure, model: RotorModel, values: Floats) -> Iterator[Unknown]:
    """Yield what may be otherwise than drawn of the shaft, as a share of what is drawn."""
    known = dict(zip(model.parameter_names, values.tolist(), strict=True)) | dict(model.held)
    rotor = model.rotor
    every = list(spans(rotor))
    groups = list[tuple[str, str, list[Span]]]()
    groups.append(("stiffness shaft", "correct E of the material, or give it a parameter", every))
    borders = np.cumsum([section.length for section in rotor.sections])
    for place, (section, right) in enumerate(zip(rotor.sections, borders, strict=True), 1):
        inside = [span for span in every if span[1] is section]
        left = 1e3 * (right - section.length)
        cure = f"give the section from {left:g} to {1e3 * right:g} mm a parameter: stiffness"
        groups.append((f"stiffness section {place}", cure, inside))
    for place, border in enumerate(borders[:-1], 1):
        node = rotor.node(border)
        cure = "divide the sections there, and give the short ones a parameter: stiffness"
        groups.append((f"stiffness joint {place}, {place + 1}", cure, every[node - 1 : node + 1]))
    for name, cure, elements in groups:
        pieces = gathered(rotor, by_share(rotor, "E", elements))
        matrices = _elastic(pieces, known, len(structure.coordinates))
        yield replace(_term(structure, name, "1", matrices), cure=cure)


def _elastic(pieces: tuple[Piece, ...], known: Mapping[str, float], size: int) -> Matrices:
    matrices = {at: np.zeros((size, size)) for at in (K, K_SPEED, D)}
    for piece in pieces:
        if not piece.structural:
            at = D if piece.order else K_SPEED if piece.power else K
            matrices[at] += piece.value(known) * piece.matrix.toarray()
    return matrices


def levers(structure: Structure, model: Model) -> Iterator[Unknown]:
    """Yield that the magnets of a place in a drawing are further along the shaft."""
    if not isinstance(model, RotorModel):
        return
    arms = _arms(structure, structure.along().T)
    for place, name in enumerate(model.rotor.actuators):
        inputs = model.inputs[2 * place : 2 * place + 2]
        scalar = Scalar(f"plane[{', '.join(inputs)}]", "m", 0.0, additive=True)
        cure = f"give {name} in the rotor file the place (at) where it acts"
        on = frozenset(inputs)
        yield Unknown((scalar,), on, (Drives(on, "lever", arms),), cure=cure)


def turned_magnets(structure: Structure, model: Model) -> Iterator[Unknown]:
    """Yield that a magnet is turned in its plane."""
    arms = _arms(structure, structure.turn())
    for name in model.inputs if structure.pairs else ():
        scalar, on = Scalar(f"turn[{name}]", "rad", 0.0, additive=True), frozenset([name])
        yield Unknown((scalar,), on, (Drives(on, "lever", arms),))


def _arms(structure: Structure, way: Floats) -> Mapping[int, Sequence[tuple[int, float]]]:
    """Return what forces on the rows do besides; `way`: of those on coordinates."""
    rows = len(structure.coordinates) if structure.shapes is None else structure.shapes.shape[1]
    moved = structure.in_rows(way @ structure.forces(np.eye(rows)))
    return {
        row: [(int(k), float(moved[k, row])) for k in np.flatnonzero(moved[:, row])]
        for row in range(rows)
    }


@rivals("term")
def _terms(case: Case) -> Iterator[Rival]:
    if case.structure is None:
        return
    still = not any(record.lines.speed.any() for record in case.records)
    drawn = isinstance(case.model, RotorModel)
    add = "add it to the rotor file, as a disc, a support, an unbalance or a damping there"
    for term in find_candidates(case.structure, still=still):
        yield freed(replace(term, cure=add) if drawn else term)


@rivals("term")
def _bows(case: Case) -> Iterator[Rival]:
    """Yield bows, which three speeds tell from unbalance and from an angle."""
    speeds = {float(v) for record in case.records for v in np.abs(record.lines.speed)} - {0.0}
    if case.structure is not None and len(speeds) > 2:
        cure = "look at the motion at low speed; add what the springs pull, such as k*b*cos(phi)"
        yield from (freed(replace(bow, cure=cure)) for bow in bows(case.structure))


@rivals("term")
def _at_magnets(case: Case) -> Iterator[Rival]:
    """Yield what bearings add where forces act, a value for each: B diag(k) B' in K."""
    model, structure = case.model, case.structure
    driven = any(channel.drive for record in case.records for channel in record.inputs)
    if structure is None or case.values is None or driven or isinstance(model, RotorModel):
        return
    matrix = model.require_linear().input_matrix(model.monomial_values(case.values))
    acting = structure.forces(matrix).T[[model.units[name] == "N" for name in model.inputs]]
    turn = structure.turn()
    pairs = [(a, s * b) for a, b in combinations(acting, 2) if (s := quarter(turn, a, b))]
    cure = "write the forces with ki and ks (law), or add the term to the equations"
    kinds = {
        "ks": [{K: -np.outer(a, a) - np.outer(b, b)} for a, b in pairs],
        "cross-coupling of the bearings": [{K: np.outer(a, b) - np.outer(b, a)} for a, b in pairs],
    }
    for name, parts in kinds.items() if pairs else ():
        term = _term(structure, name, "N/m", *parts)
        yield freed(replace(term, cure=cure, size=lambda values: float(np.mean(values))))


@rivals("term")
def _between_records(case: Case) -> Iterator[Rival]:
    structure, layout = case.structure, case.prepared.layout
    if structure is None or layout.base or len(case.records) < 2:
        return
    taken = {effect.parameter for _, effect, _ in layout.replaced}
    for record, (name, matrix) in product_of(worst_records(case), structure.masses):
        if (at := layout.index[name]) not in taken:
            added = _term(structure, f"{name}[{record}]", "1", {M: matrix})
            yield _own(replace(added, record=record), at, name)


def _own(added: Unknown, at: int, name: str) -> Rival:
    """Return the rival that a record has a mass to itself, as with `each`.

    It is scored as inertia `added` in that record: a value of its own takes the record from the
    common one, and beside that other rivals would be scored wrongly.
    """
    record, term = added.record, added.term

    def change(case: Case) -> Case:
        here, shared = float(case.unknowns[at]), case.prepared.layout.unknowns[at]
        scalar = replace(shared, name=term, start=here, std=None)
        return case.plus(replace(added, scalars=(scalar,), effects=(Replaces(at, alone=False),)))

    def value(point: Point) -> float:
        own, others = point.unknowns[[point.problem.layout.index[term], at]]
        return float(own / others - 1)

    which = f"record {(record or 0) + 1}"
    return replace(
        freed(added, on=(which,)),
        term=f"differs between records: {name}",
        says=lambda share: (
            f"{name} of {which} off that of the others by the share{amount(share, '1')}"
        ),
        cure=f"say what was changed on the rotor, or let it differ: {name} = {{ each = true }}",
        change=change,
        value=value,
        size=None,
    )


@rivals("drawn")
def _drawn(case: Case) -> Iterator[Rival]:
    model, structure = case.model, case.structure
    if structure is None or not isinstance(model, RotorModel) or case.values is None:
        return
    for term in drawn_candidates(structure, model, case.values):
        yield freed(term)
    for lever in levers(structure, model):
        yield freed(lever, on=tuple(sorted(lever.on)))


@rivals("drawn far")
def _drawn_far(case: Case) -> Iterator[Rival]:
    return (replace(rival, way="both") for rival in _drawn(case))


CLOSE = 1.5
"""Factor of the limit within which what was set free makes the bound the likeliest mistake: a limit
is guessed or mistyped by less, and a unit is off by 2 or more (but for rms, 1.41, where both are
told)."""


def _held_bounds(case: Case) -> dict[Limit, int]:
    found: dict[Limit, int] = {}
    for row in bounds_held(case.point):
        limit = case.prepared.bounds.rows[row].stated
        assert isinstance(limit, Limit)
        found.setdefault(limit, row)
    return found


@rivals("bound")
def _single_bounds(case: Case) -> Iterator[Rival]:
    for limit, row in _held_bounds(case).items():
        yield _without(case, {limit: row})


@rivals("bounds")
def _all_bounds(case: Case) -> Iterator[Rival]:
    held = _held_bounds(case)
    if len(held) > 1:
        listed = ", ".join(map(str, held))
        said = f"the bounds {listed}, which hold with equality"
        yield replace(_without(case, held), says=said, cure="check these bounds", value=None)


def _without(case: Case, held: Mapping[Limit, int]) -> Rival:
    """Return the rival that bounds are too narrow, and what the first of them bounds then is."""
    every, (limit, row) = case.prepared, next(iter(held.items()))
    looser = replace(every, bounds=every.bounds.where(lambda row: row.stated not in held))
    at = every.layout.index.get(limit.expression)
    unit = "" if at is None else every.layout.unknowns[at].unit

    def value(point: Point) -> float:
        return limit.value + limit.way * float(every.bounds.values(point.unknowns)[row])

    def likely(point: Point) -> bool:
        return limit.value != 0 and 1 / CLOSE < value(point) / limit.value < CLOSE

    def said(value: float | None) -> str:
        size = f"{value:.6g}" + ("" if unit in ("", "1") else f" {unit}")
        return f"{limit.expression} = {size}, which the bound {limit} does not let it be"

    cure = "check that bound (min, max), or take it away"
    if not limit.value:
        cure = (
            "look at the signs of the channels and of the terms; where it may have that sign, take "
            "the bound (positive, min, max) away"
        )
    return Rival(
        f"bound {', '.join(map(str, held))}",
        said,
        cure,
        lambda case: case.prepared_as(looser),
        value,
        unit,
        kind="bound",
        way="near",
        likely=likely,
    )


@rivals("known")
def _known(case: Case) -> Iterator[Rival]:
    layout = case.prepared.layout
    for at, scalar in enumerate(layout.unknowns[: layout.named]):
        if scalar.std is not None and at not in layout.idle:
            yield _prior(scalar.name, scalar.unit)


def _prior(name: str, unit: str) -> Rival:
    return Rival(
        f"prior {name}",
        lambda value: f"{name}{amount(value, unit)} instead of what was given",
        f"check {name}",
        lambda case: case.freed(name),
        unit=unit,
        kind="known",
        way="near",
        frees=(name,),
        size=lambda values: float(values[0]),
        forgets=name,
    )


@rivals("mode")
def _modes(case: Case) -> Iterator[Rival]:
    rows = case.prepared.known.modes
    for text in dict.fromkeys(rows.texts):
        yield _mode(text, rows.of_mode(text))


def _mode(text: str, rows: ModalRows) -> Rival:
    def said(value: float | None) -> str:
        size = "" if value is None else f", which is {value:.6g} Hz by everything else"
        return f"{text} as measured{size}"

    return Rival(
        text,
        said,
        "check that frequency, and which mode it is",
        lambda case: case.freed(text),
        lambda point: rows.first_hertz(point.unknowns),
        "Hz",
        kind="term",
        way="near",
        forgets=text,
    )


UNITS = {"rad/s": 2 * np.pi, "cycles per minute": 60.0}
"""Units in which frequencies are written by mistake: so many of them are one Hz."""


@rivals("modes")
def _wrong_unit(case: Case) -> Iterator[Rival]:
    for name, factor in UNITS.items() if len(case.prepared.known.modes) else ():
        said = f"natural frequencies in {name}, not in Hz"
        cure = "write frequency and std in [[modes]] with their unit"
        scaled = partial(_with_modes, change=partial(_scaled, factor=factor))
        yield Rival("unit[modes]", said, cure, scaled, 1 / factor, "1", kind="unit")


def _scaled(mode: Mode, factor: float) -> Mode:
    hertz, std, _ = mode.in_si
    return replace(mode, frequency=hertz / factor, std=std / factor)


@rivals("modes")
def _skipped(case: Case) -> Iterator[Rival]:
    """Yield that a mode below one, and so below all above it, was not found in the test."""
    for each in case.prepared.known.modes.configurations:
        for first in each.modes if number(each.modes[-1]) < len(each.pattern) else ():
            above = [mode for mode in each.modes if number(mode) >= number(first)]
            true = number(first) + 1
            term = f"skipped below {first.in_si[0]:.4g} Hz"
            said = f"a mode below {first} that was not measured, so that this one is number {true}"
            raised = partial(_with_modes, change=partial(_raised, above=above))
            yield Rival(term, said, f"write mode = {true} there", raised, float(true), "1")


def _raised(mode: Mode, above: Sequence[Mode]) -> Mode:
    return replace(mode, mode=number(mode) + 1) if mode in above else mode


def _with_modes(case: Case, change: Callable[[Mode], Mode]) -> Case:
    known = case.prepared.known
    before = known.modes.configurations
    changed = tuple(replace(each, modes=tuple(map(change, each.modes))) for each in before)
    other = replace(known, modes=ModalRows(changed))
    return case.prepared_as(replace(case.prepared, known=other))


QUARTER = 1e-9  # share of a load within which another is the same a quarter turn on: rounding


@rivals("trial")
def _moved_masses(case: Case) -> Iterator[Rival]:
    layout = case.prepared.layout
    for record, *parts in trials(case):
        names = [layout.unknowns[i].name for i in parts]
        if (free := case.freed(*names).minimized()) is None:
            continue
        given, found = (complex(*at[parts]) for at in (layout.start, free.unknowns))
        there = complex(given * np.exp(1j * np.angle(found / given)))
        was, now = (float(np.degrees(np.angle(at))) for at in (given, there))
        said = (
            f"the trial mass of record {record + 1} ({', '.join(names)}) at {now:.4g} deg "
            f"instead of {was:.4g} deg"
        )
        cure = (
            "check where it sat, from which mark and which way that angle counts, and whether the "
            "files of two records are exchanged"
        )
        held = dict(zip(names, (there.real, there.imag), strict=True))
        turned, on = partial(Case.held, values=held), (f"record {record + 1}",)
        yield Rival(f"trial mass[{record}]", said, cure, turned, float(np.radians(now)), "rad", on)


def trials(case: Case) -> Iterator[tuple[int, int, int]]:
    """Yield the unbalances that records state: which record, and the unknowns of both parts."""
    layout = case.prepared.layout
    if layout.base:
        return
    only = layout.load_only()
    slopes = layout.model.monomial_jacobian(layout.start[: layout.parameters])
    loads = layout.model.require_linear().rotation_columns(1.0) @ slopes
    for (record, one, i), (its, other, j) in combinations(layout.replaced, 2):
        stated = all(layout.unknowns[k].std is not None for k in (i, j))
        unbalance = {one.parameter, other.parameter} <= only
        if record != its or not (stated and unbalance and layout.start[[i, j]].any()):
            continue
        a, b = loads[:, one.parameter], loads[:, other.parameter]
        if not (a.any() and b.any()):
            continue
        for pair, off in (((i, j), b - 1j * a), ((j, i), b + 1j * a)):
            if (np.abs(off) <= QUARTER * np.abs(a).max()).all():
                yield record, *pair
