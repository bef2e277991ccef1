"""From a bound record to its `Likelihood`: entries, loads, sensing, calibration.

Sensors of positions with known coefficients are solved for coordinates. A sensor of a derivative,
or with parameters among its coefficients, is a row more beside the equations of motion,
``y - C(omega, theta) q = 0``, and its channel stands among the inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Complexes, Floats, Integers
from rotorid.data.lines import Lines, Signal
from rotorid.data.observation import Observation, combined
from rotorid.data.record import Channel
from rotorid.likelihood.cost import Entries, EntrySlopes, Likelihood, Sensing
from rotorid.likelihood.effects import (
    Adds,
    Calibration,
    Drives,
    Entry,
    Reads,
    Rereads,
    RowLoad,
    Scales,
    Turns,
)
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.relations import Monomials
from rotorid.likelihood.whitening import Sizes, Transient, find_scales, noise_factor
from rotorid.models.equations import SensorTerm
from rotorid.models.expressions import Expression, evaluate, symbol
from rotorid.models.linear_form import speed_factor
from rotorid.signals.covariance import LineCovariance

Factors = tuple[int, ...]
PHASE_STEPS = 16
"""Angles of a revolution that tell the orders of loads which are no polynomials of cos(phi) and
sin(phi): up to the seventh."""


@frozen
class MatrixTerm:
    """``coefficient * product of unknowns * (i omega)^order`` in a row and a column of [P, B].

    Where it depends on the line otherwise than by its order, `along` is a factor of each line.
    """

    row: int
    column: int
    order: int
    factors: Factors
    coefficient: float
    along: Complexes | None = None


@frozen
class Stiffness:
    """The terms of P = -Z of a model, in columns; `place` is that of the kind in `profiles`."""

    # (term,)
    row: Integers
    column: Integers
    place: Integers
    monomial: Integers
    coefficient: Floats  # (term,)
    # sequence of (int, complex array or None): order, and the factor of each line where it is not
    # the same on all
    profiles: tuple[tuple[int, Complexes | None], ...]

    @classmethod
    def of(cls, layout: Layout, lines: Lines) -> Stiffness:
        table = layout.model.require_linear().stiffness
        found = [
            (order, *_profile(factor, structural, lines.omega, lines.speed))
            for order, factor, structural in table.kinds
        ]
        every: Floats = np.array([size for _, size, _ in found], dtype=float)[table.kind]
        profiles = tuple((order, along) for order, _, along in found)
        stands = np.array([f is not None for f in layout.monomial_factors], dtype=bool)
        kept = (every != 0) & stands[table.monomial]
        coefficient = -table.coefficient[kept] * every[kept]
        row, column, kind = table.row[kept], table.column[kept], table.kind[kept]
        return cls(row, column, kind, table.monomial[kept], coefficient, profiles)


def other_terms(layout: Layout, observation: Observation) -> list[MatrixTerm]:
    """Return the entries of ``[P, B]`` besides the model's own stiffness; columns of B come last.

    An input whose channel holds a current acts as ``ki i + ks x``: ki scales its column of B, and
    ks x, with the true displacement, is a stiffness of the machine.
    """
    linear, drives, terms = layout.model.require_linear(), layout.acting(Drives), []
    for b in linear.input_terms:
        factors = layout.monomial_factors[b.monomial]
        assert factors is not None
        channel = observation.inputs[b.input]
        acting = [(e, int(at[0])) for e, at in drives if channel.name in e.inputs]
        known = 1.0 if channel.drive is None else channel.drive.ki
        ki, gain = _constant(acting, "ki", known)
        column = linear.coordinates + b.input
        scale = tuple(at for effect, at in acting if effect.part == "force")
        levers = [(*e.arms[b.row], (at,)) for e, at in acting if e.part == "lever"]
        for row, arm, lever in [(b.row, 1.0, ()), *levers]:
            common, size = factors + scale + lever, b.coefficient * arm
            terms.append(MatrixTerm(row, column, 0, tuple(sorted(common + gain)), size * ki))
            if channel.drive is None:
                continue
            ks, slope = _constant(acting, "ks", channel.drive.ks)
            for t in _displacement(layout, channel):
                there = tuple(sorted(common + slope + _parameters(layout, t)))
                terms.append(MatrixTerm(row, t.coordinate, 0, there, size * ks * t.coefficient))
    return [*terms, *_further_terms(layout, observation), *_sensor_rows(layout, observation)]


def _constant(
    acting: Sequence[tuple[Drives, int]], part: str, known: float
) -> tuple[float, Factors]:
    """Return a constant of a force law as (number, unknowns): one of the two is trivial."""
    unknown = next((at for effect, at in acting if effect.part == part), None)
    return (known, ()) if unknown is None else (1.0, (unknown,))


def _further_terms(layout: Layout, observation: Observation) -> list[MatrixTerm]:
    acting = layout.acting(Entry)
    # Entries of one power share one array, so that they are of one kind.
    powers = {
        power: _common(observation.lines.speed**power)
        for power in {e.speed_power for e, _ in acting}
    }
    found = []
    for e, at in acting:
        size, along = powers[e.speed_power]
        term = (e.row, e.column, e.order, (int(at[e.unknown]),))
        found.append(MatrixTerm(*term, -e.coefficient * size, along))
    return found


def _profile(
    factor: Expression, structural: bool, omega: Floats, speed: Floats
) -> tuple[float, Complexes | None]:
    distinct = np.unique(speed)
    values = np.array([speed_factor(factor, value) for value in distinct])
    along = values[np.searchsorted(distinct, speed)]
    return _common(along * 1j * (omega > 0) if structural else along)


def _common(along: Complexes | Floats) -> tuple[float, Complexes | None]:
    """Return a factor of every line, and what is left of it: nothing where all lines are alike."""
    first = along[0] if len(along) else 1.0
    if first.imag == 0 and (along == first).all():
        return float(first.real), None
    return 1.0, np.asarray(along, dtype=np.complex128)


def _displacement(layout: Layout, channel: Channel) -> tuple[SensorTerm, ...]:
    """Return the displacement in the bearing of an input, levers that are parameters included."""
    assert channel.drive is not None
    terms = combined(channel.drive.position, layout.model, "a force law", channel.name)
    if any(t.order for t in terms):
        raise InputError(
            "a force law at a velocity or an acceleration",
            "the displacement in that bearing",
            "leave the dots out",
            place=channel.name,
        )
    _require_known(layout, terms, "a force law at a displacement", channel.name)
    return terms


def _require_known(layout: Layout, terms: Sequence[SensorTerm], what: str, place: str) -> None:
    if layout.base and any(any(t.powers) for t in terms):
        raise InputError(
            f"{what} with parameters among its coefficients",
            "known coefficients, where base parameters are asked for",
            "put their values in, or estimate the physical parameters",
            place=place,
        )


def _parameters(layout: Layout, term: SensorTerm) -> Factors:
    return tuple(np.repeat(layout.held, term.powers).tolist()) if any(term.powers) else ()


def _sensor_rows(layout: Layout, observation: Observation) -> list[MatrixTerm]:
    """Return the rows of indirect sensors: the reading, less what it reads."""
    model, terms = layout.model, []
    first_row = len(model.texts)
    first_column = len(model.coordinates) + len(model.inputs)
    for k, sensor in enumerate(observation.indirect):
        terms.append(MatrixTerm(first_row + k, first_column + k, 0, (), 1.0))
        _require_known(layout, sensor.terms, "a sensor", sensor.channel.name)
        for t in sensor.terms:
            factors = _parameters(layout, t)
            terms.append(MatrixTerm(first_row + k, t.coordinate, t.order, factors, -t.coefficient))
        for effect, at in layout.acting(Reads):
            if effect.channel == sensor.channel.name:
                share = MatrixTerm(
                    first_row + k, effect.coordinate, 0, tuple(at.tolist()), -effect.coefficient
                )
                terms.append(share)
    return terms


def monomial_table(
    layout: Layout, terms: Sequence[MatrixTerm | Load]
) -> tuple[Monomials, Mapping[Factors, int]]:
    """Return the monomials in use, and where each product of unknowns stands among them."""
    of_model = {factors for factors in layout.monomial_factors if factors is not None}
    distinct = sorted(of_model | {term.factors for term in terms})
    table = Monomials.of(distinct, len(layout.unknowns))
    return table, {factors: i for i, factors in enumerate(distinct)}


@frozen
class Load:
    """``coefficient * product of unknowns * signal`` in a row of g."""

    row: int
    factors: Factors
    signal: Expression
    coefficient: float


def every_load(layout: Layout) -> list[Load]:
    model = [
        Load(term.row, factors, term.signal, term.coefficient)
        for term in layout.model.require_linear().load_terms
        if (factors := layout.monomial_factors[term.monomial]) is not None
    ]
    return model + [
        Load(load.row, (int(at[load.unknown]),), load.signal, load.coefficient)
        for load, at in layout.acting(RowLoad)
    ]


def load_lines(
    loads: Sequence[Load], lines: Lines, rows: Floats, phase_unknown: bool
) -> tuple[Complexes, Floats]:
    """Return the columns of g, one for each product of unknowns, and the orders of the rotor angle.

    Shapes (order, line, row, product), the products ascending, and (order,); `rows`: the scales.
    """
    signals = list(dict.fromkeys(load.signal for load in loads))
    timed = any(symbol("t") in signal.free_symbols for signal in signals)
    steps = phase_steps(signals) if phase_unknown else 1
    found = np.zeros((steps, len(lines.omega), len(signals)), dtype=np.complex128)
    for step, shift in enumerate(2 * np.pi * np.arange(steps) / steps):
        if signals:
            found[step] = lines.clock.lines(_signal(signals, shift), timed=timed)
    orders: Floats = np.zeros(1)
    if phase_unknown:
        found = np.fft.fft(found, axis=0) / steps
        size = np.abs(found).max(axis=(1, 2), initial=0.0)
        used = np.flatnonzero(size > 1e-12 * size.max(initial=0.0))
        orders = np.asarray(np.fft.fftfreq(steps, 1 / steps)[used], dtype=np.float64)
        found = found[used]
    products = sorted({load.factors for load in loads})
    columns = np.zeros((len(found), len(lines.omega), len(rows), len(products)), np.complex128)
    for load in loads:
        signal = found[:, :, signals.index(load.signal)]
        columns[:, :, load.row, products.index(load.factors)] += load.coefficient * signal
    return np.asarray(columns / rows[:, None], dtype=np.complex128), orders


def phase_steps(signals: Sequence[Expression]) -> int:
    """Return how many angles of a revolution tell every order of some loads: 2 n + 1 tell n."""
    degrees = [_degree(signal) for signal in signals]
    known = [degree for degree in degrees if degree is not None]
    return 2 * max(known, default=0) + 1 if len(known) == len(degrees) else PHASE_STEPS


def _degree(signal: Expression) -> int | None:
    """Return the degree of a polynomial of cos(phi) and sin(phi), None for another function."""
    phi = symbol("phi")
    if phi not in signal.free_symbols:
        return 0
    if signal.kind in ("cos", "sin"):
        return 1 if signal.parts == (phi,) else None
    if signal.kind == "sum":
        parts = [_degree(part) for part in signal.parts]
        return None if None in parts else max(part for part in parts if part is not None)
    if signal.kind not in ("product", "power"):
        return None
    total = 0
    for base, exponent in signal.factors:
        degree = _degree(base)
        if degree is None or (degree and (exponent < 0 or exponent.denominator != 1)):
            return None
        total += degree * int(exponent) if degree else 0
    return total


def _signal(signals: Sequence[Expression], shift: float) -> Signal:
    """Return expressions in t, phi and Omega as a function, the angle moved by `shift`."""

    def values(time: Floats, angle: Floats, speed: Floats) -> Floats:
        known = {"t": time, "phi": angle + shift, "Omega": speed}
        shape = np.broadcast_shapes(np.shape(time), np.shape(angle), np.shape(speed))
        return np.stack([np.broadcast_to(evaluate(s, known), shape) for s in signals], axis=-1)

    return values


def sensing_of(reads: Floats, rank: int) -> Sensing:
    sensors, coordinates = reads.shape
    used = (reads != 0).sum(axis=0)
    if ((reads != 0).sum(axis=1) == 1).all() and used.max(initial=0) <= 1:
        where = np.abs(reads).argmax(axis=1)
        right = np.zeros((coordinates, sensors))
        right[where, np.arange(sensors)] = 1 / reads[np.arange(sensors), where]
        hidden = np.eye(coordinates)[:, used == 0]
        return Sensing(right, hidden, np.zeros((0, sensors)), reads)
    left, size, basis = np.linalg.svd(reads)
    right = basis[:rank].T / size[:rank] @ left[:, :rank].T
    return Sensing(right, basis[rank:].T, left[:, rank:].T, reads)


def assemble(
    layout: Layout, observation: Observation, number: int = 0, like: Likelihood | None = None
) -> Likelihood:
    """Build the likelihood of one record, the `number`-th of its machine.

    `like` is one of the same record, whose noise is factored already.
    """
    layout = layout.of_record(number)
    observation = layout.observed(observation)
    lines, reads = observation.lines, observation.reads
    order = list(observation.order)
    data = lines.mean[:, order]
    ordered = replace(lines.covariance, matrices=lines.covariance.matrices[:, order][:, :, order])
    stiffness, terms = Stiffness.of(layout, lines), other_terms(layout, observation)
    loads = every_load(layout)
    monomials, where = monomial_table(layout, [*terms, *loads])
    phase = next((int(at[0]) for _, at in layout.acting(Turns)), None)
    entries = _entries(layout, stiffness, terms, where, lines.omega)
    rows, width = len(layout.model.texts) + len(observation.indirect), data.shape[1] - len(reads)
    scales = _scales(layout, entries, monomials, rows, reads, data, ordered)
    on_channels = layout.acting(Scales), layout.acting(Adds), layout.acting(Rereads)
    turned = phase is not None
    load, orders = load_lines(loads, lines, scales.rows, turned)
    columns = np.append(scales.coordinates, np.ones(width))
    scaled = replace(
        entries,
        coefficient=entries.coefficient * columns[entries.column] / scales.rows[entries.row],
    )
    sensing = sensing_of(reads * scales.coordinates, observation.rank)
    equations = rows + len(sensing.redundancy) - sensing.hidden.shape[1]
    if like is not None and like.order == order:
        noise = like.noise
    else:
        noise = noise_factor(ordered, data, len(observation.inputs), equations)
    return Likelihood(
        scaled,
        EntrySlopes.of(scaled, monomials, rows, reads.shape[1] + width),
        monomials,
        load,
        np.array(sorted({where[each.factors] for each in loads}), dtype=np.int64),
        rows,
        sensing,
        Calibration.of(observation, *on_channels, phase, orders),
        data,
        noise,
        scales,
        lines.multiplicity,
        len(observation.indirect),
        _transient(observation),
        order,
        lambda other: load_lines(loads, other, scales.rows, turned)[0],
    )


def _transient(observation: Observation) -> Transient | None:
    """Return what loose ends add: to each equation, and to sensors of derivatives their own.

    Integrating by parts leaves ``q`` at the ends of the window for a velocity, and ``i omega q``
    beside it for an acceleration.
    """
    order = observation.lines.transient
    if order is None:
        return None
    own = [sensor.order - 1 for sensor in observation.indirect]
    orders = np.array([order] * len(observation.model.texts) + own, dtype=np.int64)
    return Transient.of(orders, observation.lines.omega)


def _entries(
    layout: Layout,
    stiffness: Stiffness,
    terms: Sequence[MatrixTerm],
    where: Mapping[Factors, int],
    omega: Floats,
) -> Entries:
    profiles = [*stiffness.profiles, *((t.order, t.along) for t in terms)]
    kinds: dict[tuple[int, int], int] = {}
    weights = []
    for order, along in profiles:
        if (order, id(along)) not in kinds:
            kinds[order, id(along)] = len(kinds)
            power = (1j * omega) ** order
            weights.append(power if along is None else power * along)
    kind = np.array([kinds[order, id(along)] for order, along in profiles], dtype=np.int64)
    place = np.array([-1 if f is None else where[f] for f in layout.monomial_factors])
    own = (stiffness.row, stiffness.column, place[stiffness.monomial], kind[stiffness.place])
    further = np.array(
        [(t.row, t.column, where[t.factors]) for t in terms], dtype=np.int64
    ).reshape(-1, 3)
    others = (*further.T, kind[len(stiffness.profiles) :])
    row, column, monomial, kind = (np.concatenate(pair) for pair in zip(own, others, strict=True))
    coefficient = np.append(stiffness.coefficient, [term.coefficient for term in terms])
    return Entries(row, column, monomial, kind, coefficient, np.stack(weights, axis=1))


def _scales(
    layout: Layout,
    entries: Entries,
    monomials: Monomials,
    rows: int,
    reads: Floats,
    data: Complexes,
    covariance: LineCovariance,
) -> Sizes:
    n, inputs = len(layout.model.coordinates), data.shape[1] - len(reads)
    matrix = entries.matrix(monomials.values(layout.start), rows, n + inputs)
    forces = (matrix[:, :, n:] @ data[:, :inputs, None])[:, :, 0]
    variance = np.einsum("kii->ki", covariance.matrices).real.clip(0)
    pushed = (np.abs(matrix[:, :, n:]) ** 2 @ variance[:, :inputs, None])[:, :, 0]
    noise = [np.sqrt(v.mean(axis=0)) for v in (pushed, variance[:, inputs:])]
    scales = find_scales(matrix[:, :, :n], forces, reads, data[:, inputs:], noise[0], noise[1])
    ratio = np.sqrt((np.abs(forces) ** 2).mean(axis=0)) / scales.rows
    driven = ratio > 0
    if driven.any():
        scales = replace(scales, rows=scales.rows * np.sqrt((ratio[driven] ** 2).mean()))
    return scales
