"""Periodic records straight from their lines, for statistics over many seeds.

White noise on samples is white noise on every line of every period: independent, circular, of
variance s^2 / samples. Drawing it there, on the kept lines only, gives records that no test could
tell from sampled ones, a hundred times faster.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError
from rotorid.core.values import Complexes, Floats
from rotorid.data.record import Channel, PeriodicRecord
from rotorid.models import Model
from rotorid.signals.spectrum import line_spectra, synthesize


def line_record(
    model: Model,
    values: ArrayLike,
    forces: ArrayLike,
    *,
    harmonics: Sequence[int],
    fundamental: float,
    sample_rate: float,
    periods: int,
    speed: float = 0.0,
    phase: float = 0.0,
    sensors: Sequence[Channel | str] | None = None,
) -> PeriodicRecord:
    """Return the noise-free record of a linear model in steady state, lines only."""
    lines, force = np.array(harmonics, dtype=np.int64), np.asarray(forces, dtype=np.complex128)
    if force.shape != (len(lines), len(model.inputs)):
        raise InputError(
            f"forces of shape {force.shape}",
            f"({len(lines)}, {len(model.inputs)}): (line, input)",
            "give one line per harmonic",
        )
    samples = round(sample_rate / fundamental)
    channels = _channels(model, model.coordinates if sensors is None else sensors)
    time = np.arange(periods * samples).reshape(periods, samples) / sample_rate
    linear, mu = model.require_linear(), model.monomial_values(np.asarray(values, dtype=float))
    omega = 2 * np.pi * lines * sample_rate / samples
    load = linear.load_columns(time[0], speed * time[0] + phase, speed) @ mu
    right = force @ linear.input_matrix(mu).T + line_spectra(load, lines)
    motion = linear.response(omega, np.asarray(values, dtype=float), speed, right)
    reads = np.array(
        [
            [c.combination.get(q, 0.0) for q in model.coordinates]
            for c in channels[len(model.inputs) :]
        ]
    )
    mean = np.concatenate([force, motion @ reads.T], axis=1)
    return PeriodicRecord(
        channels=channels,
        sample_rate=sample_rate,
        harmonics=lines,
        spectra=np.repeat(mean[None], periods, axis=0),
        variance=np.zeros((samples, len(channels))),
        mean=synthesize(mean, lines, samples),
        speed=speed,
        time=time,
        angle=speed * time + phase,
        source="simulation",
    )


def _channels(model: Model, sensors: Sequence[Channel | str]) -> tuple[Channel, ...]:
    read = [Channel(s, model.units.get(s, "")) if isinstance(s, str) else s for s in sensors]
    for channel in read:
        strange = [name for name in channel.combination if name not in model.coordinates]
        if strange:
            raise InputError(
                f"a sensor of {strange[0]!r}",
                f"one of {', '.join(model.coordinates)}",
                "write the combination in these coordinates",
            )
    return (*(Channel(name, model.units[name]) for name in model.inputs), *read)


def add_noise(
    record: PeriodicRecord, deviation: Mapping[str, float], rng: np.random.Generator
) -> PeriodicRecord:
    """Return a record with white noise on its channels."""
    std = np.array([deviation.get(name, 0.0) for name in record.names])
    noise = _unit_noise(record, rng) * (std / np.sqrt(record.samples))
    return replace(record, spectra=record.spectra + noise, variance=record.variance + std**2)


def _unit_noise(record: PeriodicRecord, rng: np.random.Generator) -> Complexes:
    """Return circular noise of variance one; real on DC and on the Nyquist line."""
    drawn: Floats = rng.standard_normal((*record.spectra.shape, 2))
    real = record.multiplicity == 1.0
    parts = np.where(real[:, None, None], np.array([1.0, 0.0]), np.sqrt(0.5))
    return np.asarray((drawn * parts).view(np.complex128)[..., 0])
