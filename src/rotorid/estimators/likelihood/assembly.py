"""From a model and a record to a `Likelihood`: entries, loads, sensing, calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.errors import InputError
from rotorid.estimators.likelihood.calibration import Calibration
from rotorid.estimators.likelihood.cost import Entries, Likelihood, Scatter, Sensing
from rotorid.estimators.likelihood.noise import noise_factor
from rotorid.estimators.likelihood.polynomial import Monomials
from rotorid.estimators.likelihood.scaling import Scales, find_scales
from rotorid.estimators.likelihood.unknowns import (
    Layout,
    input_channels,
    linear_form,
    sensor_channels,
)
from rotorid.estimators.regression import time_and_angle
from rotorid.models import Model
from rotorid.models.evaluation import evaluate
from rotorid.models.expression import Expression
from rotorid.models.linear import LinearForm
from rotorid.record import Channel, Complexes, Floats, Integers, PeriodicRecord
from rotorid.signals.covariance import LineCovariance
from rotorid.signals.spectrum import line_spectra

Factors = tuple[int, ...]
PHASE_STEPS = 16


@dataclass(frozen=True)
class Term:
    """``coefficient * product of unknowns * (i omega)^order`` in a row and a column of [P, B]."""

    row: int
    column: int
    order: int
    factors: Factors
    coefficient: float


def speed_factors(linear: LinearForm, speed: float) -> dict[Expression, float]:
    """Return the value of each distinct factor of the speed among the entries of Z."""
    distinct = dict.fromkeys(term.factor for term in linear.stiffness)
    return {factor: float(evaluate(factor, {"Omega": speed})) for factor in distinct}


def equation_terms(layout: Layout, inputs: Sequence[Channel], speed: float) -> list[Term]:
    """Return the entries of ``[P, B]``, P = -Z, at one speed; columns of B after those of P.

    An input whose channel holds a current acts as ``ki i + ks x``: ki scales its column of B, and
    ks x, with the true displacement, is a stiffness of the machine.
    """
    model = layout.model
    linear = linear_form(model)
    factor = speed_factors(linear, speed)
    terms = []
    for t in linear.stiffness:
        factors = layout.monomial_factors[t.monomial]
        if factors is not None and factor[t.factor] != 0:
            value = -t.coefficient * factor[t.factor]
            terms.append(Term(t.row, t.column, t.order, factors, value))
    for b in linear.input_terms:
        factors = layout.monomial_factors[b.monomial]
        assert factors is not None
        channel = inputs[b.input]
        ki, gain = _constant(
            layout, f"ki[{channel.name}]", None if channel.drive is None else channel.drive.ki
        )
        column = linear.coordinates + b.input
        terms.append(Term(b.row, column, 0, factors + gain, b.coefficient * ki))
        if channel.drive is None:
            continue
        unknown = "ks" if "ks" in layout.index else f"ks[{channel.name}]"
        ks, slope = _constant(layout, unknown, channel.drive.ks)
        for name, share in channel.drive.position.items():
            if name not in model.coordinates:
                raise InputError(
                    f"a force law at {name!r}",
                    f"one of {', '.join(model.coordinates)}",
                    "name the displacement in that bearing",
                    place=channel.name,
                )
            where = model.coordinates.index(name)
            terms.append(Term(b.row, where, 0, factors + slope, b.coefficient * ks * share))
    return terms


def _constant(layout: Layout, name: str, known: float | None) -> tuple[float, Factors]:
    """Return a constant as (number, unknowns): one of the two is trivial."""
    if name in layout.index:
        return 1.0, (layout.index[name],)
    return (1.0 if known is None else known), ()


def monomial_table(
    layout: Layout, terms: Sequence[Term]
) -> tuple[Monomials, Mapping[Factors, int]]:
    """Return the monomials in use, and where each product of unknowns stands among them."""
    loads = {f for f in layout.monomial_factors if f is not None}
    distinct = sorted(loads | {tuple(sorted(term.factors)) for term in terms})
    exponents = np.zeros((len(distinct), len(layout.unknowns)), dtype=np.int64)
    for row, factors in enumerate(distinct):
        for unknown in factors:
            exponents[row, unknown] += 1
    return Monomials.from_exponents(exponents), {f: i for i, f in enumerate(distinct)}


def load_lines(
    layout: Layout, record: PeriodicRecord, where: Mapping[Factors, int], phase_unknown: bool
) -> tuple[Complexes, Floats]:
    """Return the columns of g by order of the rotor angle, and the orders."""
    linear = linear_form(layout.model)
    signals = list(dict.fromkeys(term.signal for term in linear.load_terms))
    steps = PHASE_STEPS if phase_unknown else 1
    shifts = 2 * np.pi * np.arange(steps) / steps
    time, angle = time_and_angle(layout.model, record)
    lines = np.zeros((steps, len(record.harmonics), len(signals)), dtype=np.complex128)
    for step, shift in enumerate(shifts):
        known = {"t": time, "phi": angle + shift, "Omega": record.speed}
        values = [
            np.broadcast_to(evaluate(signal, known), angle.shape).mean(axis=0) for signal in signals
        ]
        if values:
            lines[step] = _lines(np.stack(values, axis=1), record.harmonics)
    if phase_unknown:
        lines = np.fft.fft(lines, axis=0) / steps
        size = np.abs(lines).max(axis=(1, 2), initial=0.0)
        used = np.flatnonzero(size > 1e-12 * size.max(initial=0.0))
        orders = np.fft.fftfreq(steps, 1 / steps)[used]
        lines = lines[used]
    else:
        orders = np.zeros(1)
    columns = np.zeros(
        (len(lines), len(record.harmonics), linear.rows, len(where)), dtype=np.complex128
    )
    for term in linear.load_terms:
        factors = layout.monomial_factors[term.monomial]
        if factors is not None:
            target = where[tuple(sorted(factors))]
            signal = lines[:, :, signals.index(term.signal)]
            columns[:, :, term.row, target] += term.coefficient * signal
    return columns, np.asarray(orders, dtype=np.float64)


def _lines(samples: Floats, harmonics: Integers) -> Complexes:
    """Return lines with what is rounding set to zero: a load that misses a line misses it."""
    lines = line_spectra(samples, harmonics)
    size = np.sqrt((samples**2).mean(axis=0))
    return np.where(np.abs(lines) > 1e-11 * size, lines, 0.0)


def sensing_of(reads: Floats) -> Sensing:
    """Split coordinates into what sensors read and what they do not."""
    sensors, coordinates = reads.shape
    used = (reads != 0).sum(axis=0)
    if ((reads != 0).sum(axis=1) == 1).all() and used.max() <= 1:
        where = np.abs(reads).argmax(axis=1)
        right = np.zeros((coordinates, sensors))
        right[where, np.arange(sensors)] = 1 / reads[np.arange(sensors), where]
        hidden = np.eye(coordinates)[:, used == 0]
        return Sensing(right, hidden, np.zeros((0, sensors)), reads)
    left, size, basis = np.linalg.svd(reads)
    rank = int((size > 1e-10 * size[0]).sum())
    right = basis[:rank].T / size[:rank] @ left[:, :rank].T
    return Sensing(right, basis[rank:].T, left[:, rank:].T, reads)


def sensor_matrix(model: Model, sensors: Sequence[Channel]) -> Floats:
    """Return C, shape (sensor, coordinate)."""
    return np.array([[s.combination.get(q, 0.0) for q in model.coordinates] for s in sensors])


def channel_order(model: Model, record: PeriodicRecord) -> list[int]:
    """Return the channels of a record in the order of the kernel: inputs, then sensors."""
    channels = (*input_channels(model, record), *sensor_channels(model, record))
    return [record.index(channel.name) for channel in channels]


def assemble(
    layout: Layout, record: PeriodicRecord, covariance: LineCovariance, number: int = 0
) -> Likelihood:
    """Build the likelihood of one record."""
    model = layout.model
    inputs, sensors = input_channels(model, record), sensor_channels(model, record)
    order = channel_order(model, record)
    data = record.mean_spectrum[:, order]
    ordered = replace(covariance, matrices=covariance.matrices[:, order][:, :, order])
    terms = equation_terms(layout, inputs, record.speed)
    monomials, where = monomial_table(layout, terms)
    phase = layout.index.get(f"phase[{number}]")
    load, orders = load_lines(layout, record, where, phase is not None)
    entries = _entries(terms, where, record.omega)
    reads = sensor_matrix(model, sensors)
    scales = _scales(layout, entries, monomials, reads, data)
    rows = len(model.texts)
    columns = np.append(scales.coordinates, np.ones(len(inputs)))
    scaled = replace(
        entries, weight=entries.weight * columns[entries.column] / scales.rows[entries.row]
    )
    sensing = sensing_of(reads * scales.coordinates)
    equations = rows + len(sensing.redundancy) - sensing.hidden.shape[1]
    noise = noise_factor(ordered, data, len(inputs), equations)
    calibration = _calibration(layout, record, inputs, sensors, phase, orders)
    return Likelihood(
        scaled,
        monomials,
        load / scales.rows[:, None],
        rows,
        sensing,
        calibration,
        data,
        noise,
        scales,
        record.multiplicity,
    )


def _entries(terms: Sequence[Term], where: Mapping[Factors, int], omega: Floats) -> Entries:
    order = np.array([term.order for term in terms])
    coefficient = np.array([term.coefficient for term in terms])
    return Entries(
        np.array([term.row for term in terms], dtype=np.int64),
        np.array([term.column for term in terms], dtype=np.int64),
        np.array([where[tuple(sorted(term.factors))] for term in terms], dtype=np.int64),
        coefficient * (1j * omega[:, None]) ** order,
    )


def _scales(
    layout: Layout, entries: Entries, monomials: Monomials, reads: Floats, data: Complexes
) -> Scales:
    """Scales of rows and coordinates at the start, tied to the sizes of forces and readings."""
    n, rows = len(layout.model.coordinates), len(layout.model.texts)
    inputs = data.shape[1] - len(reads)
    matrix = np.zeros((len(data), rows, n + inputs), dtype=np.complex128)
    values = entries.weight * monomials.values(layout.start)[entries.monomial]
    flat = entries.row * (n + inputs) + entries.column
    Scatter.by(flat).into(matrix.reshape(len(data), -1), values[:, Scatter.by(flat).order])
    forces = (matrix[:, :, n:] @ data[:, :inputs, None])[:, :, 0]
    scales = find_scales(matrix[:, :, :n], forces, reads, data[:, inputs:])
    ratio = np.sqrt((np.abs(forces) ** 2).mean(axis=0)) / scales.rows
    driven = ratio > 0
    if driven.any():
        scales = replace(scales, rows=scales.rows * np.sqrt((ratio[driven] ** 2).mean()))
    return scales


def _calibration(
    layout: Layout,
    record: PeriodicRecord,
    inputs: Sequence[Channel],
    sensors: Sequence[Channel],
    phase: int | None,
    orders: Floats,
) -> Calibration:
    channels = (*inputs, *sensors)
    gain_channel, gain_unknown = _unknowns(layout, "gain[{}]", channels)
    acting, unknown, known = _delays(layout, inputs, sensors)
    sensor, cos = _unknowns(layout, "runout[{}].cos", sensors)
    return Calibration(
        record.omega,
        len(channels),
        len(sensors),
        gain_channel,
        gain_unknown,
        acting if len(unknown) else None,
        unknown,
        known,
        _rotation(layout.model, record) if len(sensor) else None,
        sensor,
        cos,
        _unknowns(layout, "runout[{}].sin", sensors)[1],
        phase,
        orders,
    )


def _unknowns(
    layout: Layout, pattern: str, channels: Sequence[Channel]
) -> tuple[Integers, Integers]:
    """Return which channels have an unknown of this name, and which it is."""
    names = [pattern.format(channel.name) for channel in channels]
    found = [(k, layout.index[name]) for k, name in enumerate(names) if name in layout.index]
    pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _delays(
    layout: Layout, inputs: Sequence[Channel], sensors: Sequence[Channel]
) -> tuple[Floats, Integers, Floats]:
    """Return where each unknown delay acts, (channel, delay), which it is, what was corrected."""
    channels = (*inputs, *sensors)
    single, unknown = _unknowns(layout, "delay[{}]", channels)
    acting = [np.eye(len(channels))[k] for k in single]
    unknowns, known = unknown.tolist(), [channels[k].delay for k in single]
    is_input = np.arange(len(channels)) < len(inputs)
    for kind, which in (("force", is_input), ("position", ~is_input)):
        if f"delay[{kind}]" in layout.index:
            acting.append(which.astype(float))
            unknowns.append(layout.index[f"delay[{kind}]"])
            known.append(0.0)
    columns = np.array(acting).reshape(len(acting), len(channels)).T
    return columns, np.array(unknowns, dtype=np.int64), np.array(known, dtype=float)


def _rotation(model: Model, record: PeriodicRecord) -> Complexes:
    """Return the lines of exp(i phi) and exp(-i phi), shape (line, 2)."""
    _, angle = time_and_angle(model, record)
    turning = np.exp(1j * angle).mean(axis=0)
    parts = _lines(np.stack([turning.real, turning.imag], axis=1), record.harmonics)
    return np.stack([parts[:, 0] + 1j * parts[:, 1], parts[:, 0] - 1j * parts[:, 1]], axis=1)
