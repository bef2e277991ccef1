"""From a bound record to its `Likelihood`: entries, loads, sensing, calibration.

Sensors of positions with known coefficients are solved for coordinates. A sensor of a derivative,
or with parameters among its coefficients, is a row more beside the equations of motion,
``y - C(omega, theta) q = 0``, and its channel stands among the inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats, fact, frozen
from rotorid.data.lines import Clock, Lines, Signal
from rotorid.data.observation import Observation, combined
from rotorid.data.record import Channel
from rotorid.likelihood.cost import Entries, EntrySlopes, Likelihood, Sensing
from rotorid.likelihood.effects import (
    Adds,
    Calibration,
    Drives,
    Entry,
    Factors,
    Reads,
    Rereads,
    RowLoad,
    Scales,
    Turns,
    at_unknowns,
)
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.relations import Monomials
from rotorid.likelihood.whitening import Sizes, Transient, find_scales, noise_factor
from rotorid.models.equations import SensorTerm
from rotorid.models.expressions import Expression, evaluate, symbol
from rotorid.models.linear_form import StiffnessTable, TermKind, speed_factor
from rotorid.signals.covariance import LineCovariance

PHASE_STEPS = 16
"""Angles of a revolution that tell the orders of loads which have more: up to the seventh."""


@frozen
class Terms:
    """The terms of [Z, -B], each by its product of unknowns."""

    table: StiffnessTable
    monomials: Monomials  # of all unknowns
    where: Mapping[Factors, int]  # each product of unknowns among them

    @classmethod
    def of(cls, layout: Layout, further: Sequence[Entry], loads: Sequence[RowLoad] = ()) -> Terms:
        table, products = layout.model.require_linear().stiffness, layout.monomial_factors
        further = [replace(term, factors=tuple(sorted(term.factors))) for term in further]
        used = {factors for factors in products if factors is not None}
        used |= {term.factors for term in further} | {load.factors for load in loads}
        where = {factors: i for i, factors in enumerate(sorted(used))}
        kinds = tuple(dict.fromkeys((*table.kinds, *(term.kind for term in further))))
        number = {kind: k for k, kind in enumerate(kinds)}
        place = np.array([-1 if f is None else where[f] for f in products], dtype=np.int64)
        own_kind = np.array([number[kind] for kind in table.kinds], dtype=np.int64)
        own = own_kind[table.kind], table.row, table.column, place[table.monomial]
        others = [(number[t.kind], t.row, t.column, where[t.factors]) for t in further]
        behind = np.array(others, dtype=np.int64).reshape(-1, 4).T
        kept = place[table.monomial] >= 0
        pairs = zip(own, behind, strict=True)
        kind, row, column, monomial = (np.append(a[kept], b) for a, b in pairs)
        coefficient = np.append(table.coefficient[kept], [t.coefficient for t in further])
        monomials = Monomials.of(list(where), len(layout.unknowns))
        table = StiffnessTable(kinds, kind, row, column, monomial, coefficient)
        return cls(table, monomials, where)

    def entries(self, lines: Lines, columns: int) -> Entries:
        """Return those of [P, B], P = -Z, on lines; kinds that are alike on these are one."""
        weights: dict[tuple[int, bytes], Complexes] = {}
        table, sizes, keys = self.table, [], []
        for kind in table.kinds:
            size, along = profile(kind, lines)
            keys.append((kind.order, b"" if along is None else along.tobytes()))
            power = (1j * lines.omega) ** kind.order
            weights[keys[-1]] = np.asarray(power if along is None else power * along)
            sizes.append(size)
        every = np.array(sizes)[table.kind]
        place = np.array([list(weights).index(key) for key in keys])
        table, every = table.where(every != 0), every[every != 0]
        coefficient, along = -table.coefficient * every, np.stack(list(weights.values()), axis=1)
        kinds, orders = place[table.kind], np.array([order for order, _ in weights], np.int64)
        at = table.row, table.column, table.monomial, kinds
        return Entries(*at, coefficient, along, orders, columns)


def profile(kind: TermKind, lines: Lines) -> tuple[float, Complexes | None]:
    """Return a number that terms of a kind have in common, or a factor of each line, and one."""
    distinct = np.unique(lines.speed)
    values = np.array([speed_factor(kind.factor, value) for value in distinct])
    along = values[np.searchsorted(distinct, lines.speed)]
    if kind.structural:
        along = along * 1j * (lines.omega > 0)
    first = along[0] if len(along) else 1.0
    if first.imag == 0 and (along == first).all():
        return float(first.real), None
    return 1.0, np.asarray(along, dtype=np.complex128)


def other_terms(layout: Layout, observation: Observation) -> list[Entry]:
    """Return the entries of ``[Z, -B]`` besides the model's own stiffness; inputs come last.

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
        arms = [(e.arms, (at,)) for e, at in acting if e.part == "lever"]
        levers = [(*arm, lever) for of, lever in arms for arm in of.get(b.row, ())]
        for row, arm, lever in [(b.row, 1.0, ()), *levers]:
            common, size = factors + scale + lever, -b.coefficient * arm
            terms.append(Entry(row, column, 0, size * ki, factors=common + gain))
            if channel.drive is None:
                continue
            ks, slope = _constant(acting, "ks", channel.drive.ks)
            for t in _displacement(layout, channel):
                there = common + slope + _parameters(layout, t)
                coefficient = size * ks * t.coefficient
                terms.append(Entry(row, t.coordinate, 0, coefficient, factors=there))
                there_too = [(*arm, at) for of, at in arms for arm in of.get(t.coordinate, ())]
                for slope_at, share, at in () if lever else there_too:
                    gained = coefficient * share
                    terms.append(Entry(row, slope_at, 0, gained, factors=there + at))
    further = at_unknowns(layout.acting(Entry))
    return [*terms, *further, *_sensor_rows(layout, observation)]


def _constant(
    acting: Sequence[tuple[Drives, int]], part: str, known: float
) -> tuple[float, Factors]:
    """Return a constant of a force law as (number, unknowns): one of the two is trivial."""
    unknown = next((at for effect, at in acting if effect.part == part), None)
    return (known, ()) if unknown is None else (1.0, (unknown,))


def _displacement(layout: Layout, channel: Channel) -> tuple[SensorTerm, ...]:
    assert channel.drive is not None
    terms = combined(channel.drive.position, layout.model, "a force law at", channel.name)
    if any(t.order for t in terms):
        told, cure = "a force law at a velocity or an acceleration", "leave the dots out"
        raise InputError(told, "the displacement in that bearing", cure, place=channel.name)
    _require_known(layout, terms, "a force law at a displacement", channel.name)
    return terms


def _require_known(layout: Layout, terms: Sequence[SensorTerm], what: str, place: str) -> None:
    if layout.base and any(any(t.powers) for t in terms):
        told = f"{what} with parameters among its coefficients"
        expected = "known coefficients, where base parameters are asked for"
        cure = "put their values in, or estimate the physical parameters"
        raise InputError(told, expected, cure, place=place)


def _parameters(layout: Layout, term: SensorTerm) -> Factors:
    return tuple(np.repeat(layout.held, term.powers).tolist()) if any(term.powers) else ()


def _sensor_rows(layout: Layout, observation: Observation) -> list[Entry]:
    """Return the rows of indirect sensors: what each reads, less the reading."""
    model, terms = layout.model, []
    first_row = len(model.texts)
    first_column = len(model.coordinates) + len(model.inputs)
    for k, sensor in enumerate(observation.indirect):
        row = first_row + k
        terms.append(Entry(row, first_column + k, 0, -1.0, factors=()))
        _require_known(layout, sensor.terms, "a sensor", sensor.channel.name)
        for t in sensor.terms:
            held = _parameters(layout, t)
            terms.append(Entry(row, t.coordinate, t.order, t.coefficient, factors=held))
        terms += [
            Entry(row, effect.coordinate, 0, effect.coefficient, factors=(int(at[0]),))
            for effect, at in layout.acting(Reads)
            if effect.channel == sensor.channel.name
        ]
    return terms


def every_load(layout: Layout) -> list[RowLoad]:
    model = [
        RowLoad(term.row, term.signal, term.coefficient, factors)
        for term in layout.model.require_linear().load_terms
        if (factors := layout.monomial_factors[term.monomial]) is not None
    ]
    return model + at_unknowns(layout.acting(RowLoad))


def load_lines(
    loads: Sequence[RowLoad], lines: Lines, rows: Floats, phase_unknown: bool
) -> tuple[Complexes, Floats]:
    """Return the columns of g, (order, line, row, product), products ascending, and the orders."""
    if not loads:
        return np.zeros((1, len(lines.omega), len(rows), 0), dtype=np.complex128), np.zeros(1)
    place = {signal: k for k, signal in enumerate(dict.fromkeys(load.signal for load in loads))}
    found, orders = _signal_lines(lines.clock, tuple(place), phase_unknown)
    product = {factors: k for k, factors in enumerate(sorted({load.factors for load in loads}))}
    columns = np.zeros((len(found), len(lines.omega), len(rows), len(product)), np.complex128)
    for load in loads:
        signal = found[:, :, place[load.signal]]
        columns[:, :, load.row, product[load.factors]] += load.coefficient * signal
    return np.asarray(columns / rows[:, None], dtype=np.complex128), orders


@fact
def _signal_lines(
    clock: Clock, signals: tuple[Expression, ...], phase_unknown: bool
) -> tuple[Complexes, Floats]:
    timed = any(symbol("t") in signal.free_symbols for signal in signals)
    steps = phase_steps(signals) if phase_unknown else 1
    shifts = 2 * np.pi * np.arange(steps) / steps
    found = np.stack([clock.lines(_signal(signals, shift), timed=timed) for shift in shifts])
    if not phase_unknown:
        return found, np.zeros(1)
    found = np.asarray(np.fft.fft(found, axis=0) / steps)
    size = np.abs(found).max(axis=(1, 2), initial=0.0)
    used = np.flatnonzero(size > 1e-12 * size.max(initial=0.0))
    return found[used], np.asarray(np.fft.fftfreq(steps, 1 / steps)[used], dtype=np.float64)


@lru_cache(maxsize=1000)
def phase_steps(signals: tuple[Expression, ...]) -> int:
    """Return how many angles of a revolution tell every order of some loads: 2 n + 1 tell n."""
    if not signals:
        return 1
    angle = 2 * np.pi * np.arange(4 * PHASE_STEPS) / (4 * PHASE_STEPS)
    # At a time and a speed at which no factor is likely to vanish.
    values = _signal(signals, 0.0)(np.full(1, 0.73), angle, np.full(1, 1.37))
    with np.errstate(all="ignore"):
        size = np.abs(np.fft.rfft(values, axis=0)).max(axis=1)
        seen = np.flatnonzero(~(size <= 1e-12 * size.max()))
    most = int(seen.max(initial=0))
    return 2 * most + 1 if most < PHASE_STEPS else PHASE_STEPS


def _signal(signals: Sequence[Expression], shift: float) -> Signal:
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
    """Build the likelihood of record `number`; `like` has factored the noise of the same one."""
    layout = layout.of_record(number)
    observation = layout.observed(observation)
    lines, reads = observation.lines, observation.reads
    order = list(observation.order)
    data = lines.mean[:, order]
    ordered = replace(lines.covariance, matrices=lines.covariance.matrices[:, order][:, :, order])
    loads = every_load(layout)
    terms = Terms.of(layout, other_terms(layout, observation), loads)
    phase = next((int(at[0]) for _, at in layout.acting(Turns)), None)
    rows, width = len(layout.model.texts) + len(observation.indirect), data.shape[1] - len(reads)
    entries = terms.entries(lines, reads.shape[1] + width)
    monomials = terms.monomials
    scales = _scales(entries.matrix(monomials.values(layout.start), rows), reads, data, ordered)
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
        EntrySlopes.of(scaled, monomials, rows),
        monomials,
        load,
        np.array(sorted({terms.where[each.factors] for each in loads}), dtype=np.int64),
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
    if (order := observation.lines.transient) is None:
        return None
    own = [sensor.order - 1 for sensor in observation.indirect]
    orders = np.array([order] * len(observation.model.texts) + own, dtype=np.int64)
    return Transient.of(orders, observation.lines.omega)


def _scales(matrix: Complexes, reads: Floats, data: Complexes, covariance: LineCovariance) -> Sizes:
    """Return the sizes of rows and coordinates; `matrix`: [P, B] at the start."""
    n, inputs = reads.shape[1], data.shape[1] - len(reads)
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
