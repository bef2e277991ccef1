"""What a report needs of records and their prediction, gathered into the result itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import Estimator
from rotorid.answer.parts import (
    ChannelEvidence,
    Evidence,
    Numbers,
    Prior,
    RecordEvidence,
    ResponseEvidence,
)
from rotorid.answer.predict import Forecast, as_found
from rotorid.core.distributions import HALF_WIDTH
from rotorid.core.errors import InputError, require_type
from rotorid.core.values import Booleans, Complexes, Floats, frozen
from rotorid.data.lines import PhasorClock, SampledClock, SilentClock
from rotorid.data.observation import Data, Observation, bind
from rotorid.likelihood.unknowns import Nuisances, unknowns_of
from rotorid.linear.regression import Predicted
from rotorid.models import Model
from rotorid.models.equations import combination_text
from rotorid.results.loops import plant_response
from rotorid.results.machine import directions_of, machine_of, shares_of

MOST_LINES = 400
"""Values of a channel over frequency: what a screen tells apart."""
MOST_SAMPLES = 500
"""Values of a channel over time."""
MOST_NUMBERS = 60_000
"""Numbers of all records together, about half a megabyte of text."""
FEWEST = 60
"""Values of a channel that many channels and records leave it."""
PER_CYCLE = 10
"""Values in the shortest period of an excerpt."""
DIGITS = 6
"""Significant digits that are kept: more than a picture shows and a measurement has."""
MOST_COORDINATES = 200
"""Coordinates up to which a response is told, for it takes the whole machine on each line."""
CURVES = 6
"""Sequences of numbers that a channel holds."""


def with_evidence(
    estimate: Estimate,
    model: Model,
    records: Data | Sequence[Data],
    estimator: Estimator | None = None,
) -> Estimate:
    """Return an estimate together with what a report shows of its records.

    A long record is thinned: one value stands for several lines that lie side by side. All numbers
    are rounded to six digits.

    Parameters
    ----------
    estimate : Estimate
    model : Model
    records : PeriodicRecord, Lines or FilteredRecord, or sequence of them
        Those that the estimate was made of.
    estimator : Estimator, optional
        That made it: says what was known beforehand.

    Returns
    -------
    Estimate
        The same, its `evidence` filled in.

    Raises
    ------
    InputError
        For records that do not fit the model.

    Examples
    --------
    >>> import rotorid as rid
    >>> model = rid.load_model("jeffcott")
    >>> turn = 2 * np.pi * np.arange(100) / 100
    >>> forces = np.column_stack([400.0 * np.cos(3 * turn), 300.0 * np.sin(5 * turn)])
    >>> record = rid.simulate(model, model.values(model.nominal), forces, sample_rate=1000.0,
    ...                       periods=3, speed=2 * np.pi * 30.0)
    >>> periods = rid.average(record, 10.0, harmonics=[1, 3, 5])
    >>> estimate = rid.identify(model, periods, "ls")
    >>> shown = with_evidence(estimate, model, periods).evidence.records[0]
    >>> shown.frequency_hz, [channel.name for channel in shown.channels]
    ((10.0, 30.0, 50.0), ['F_x', 'F_y', 'x', 'y'])
    """
    require_type(estimate, Estimate, place="estimate")
    data = records if isinstance(records, Sequence) else [records]
    gathered = Evidence(
        record_evidence(estimate, model, data), tuple(_known(estimate, model, data, estimator))
    )
    return estimate.with_(evidence=gathered)


def record_evidence(
    estimate: Estimate, model: Model, records: Sequence[Data], *, another: bool = False
) -> tuple[RecordEvidence, ...]:
    """Return what a report shows of records; of `another`, noise holds the values' deviations."""
    bound = [bind(as_found(model, estimate), record) for record in records]
    channels = sum(len(one.lines.channels) for one in bound)
    most = MOST_NUMBERS // max(1, channels * CURVES)
    return tuple(
        _record(estimate, one, number, most, another=another) for number, one in enumerate(bound)
    )


def _record(
    estimate: Estimate, record: Observation, number: int, most: int, *, another: bool
) -> RecordEvidence:
    found = spread = response = None
    phases = {value.name: value.value for value in estimate.nuisance}
    phase = phases.get(f"phase[{number}]", math.nan)
    if not another and math.isfinite(phase):
        record = record.with_lines(record.lines.turned(phase))
    if record.lines.phase_known:
        with suppress(InputError):  # a record whose prediction is refused is shown as measured
            forecast = Forecast(record.model, estimate, record, number)
            found = forecast.at
            spread = forecast.noise
            if another and spread is not None:
                spread = spread + forecast.spread
            response = None if another else _response(forecast)
    if record.filtered is not None:
        return _of_samples(record, found, max(FEWEST, min(most, 2 * MOST_SAMPLES)))
    lines = record.lines
    size = -(-len(lines.frequency) // max(FEWEST, min(most, MOST_LINES))) or 1
    speeds = (lines.speed.min(), lines.speed.max()) if len(lines.speed) else ()
    time = _times(record, max(FEWEST, min(most, MOST_SAMPLES)))
    kinds = {PhasorClock: "phasors", SilentClock: "responses"}
    kind: Any = "lines" if lines.transient is not None else kinds.get(type(lines.clock), "periods")
    seen = lines.clock.period if isinstance(lines.clock, SampledClock) else np.zeros(0)
    steps = np.diff(seen)
    return RecordEvidence(
        source=lines.source,
        kind=kind,
        lines=len(lines.frequency),
        lines_per_point=size,
        periods=lines.periods if lines.scatter is not None else 0,
        samples_per_period=len(seen) if lines.transient is None else 0,
        sample_rate_hz=_rounded([1 / steps[0] if len(steps) else math.nan])[0],
        speed_rad_s=_rounded(speeds),
        frequency_hz=_rounded([f.mean() for f in _grouped(lines.frequency, size)]),
        time_s=_rounded(time),
        channels=tuple(_Shown(record, size, time).channels(found, spread)),
        response=response,
    )


def _response(forecast: Forecast) -> ResponseEvidence | None:
    """Return the force that tells most, at the position that moves most like its place; or None."""
    record, lines, found = forecast.bound, forecast.bound.lines, forecast.at
    at, inputs = np.flatnonzero(lines.frequency > 0), list(record.input_columns)
    whole = len(record.model.coordinates) > MOST_COORDINATES
    if whole or found.samples is not None or not (inputs and len(at)) or np.ptp(lines.speed):
        return None
    at, speed = at[:: -(-len(at) // MOST_LINES)], float(lines.speed[0])
    machine = machine_of(forecast.estimate, forecast.number)
    spelt = [(s.channel, combination_text(s.channel.combination)) for s in record.sensors]
    read = [(*each, r) for each in spelt if (r := shares_of(machine, each[1])) is not None]
    if not read:  # accelerometers alone tell no position
        return None
    rows = np.array([r for *_, r in read]).reshape(len(read), -1)
    places = directions_of(machine).forces(machine.input_matrix())
    reads, omega = np.vstack([rows, places.T]), 2 * np.pi * lines.frequency[at]
    model, moved = np.split(plant_response(machine, speed, omega, reads, {}), [len(read)], axis=1)
    driven = np.diagonal(moved, axis1=1, axis2=2)[:, None]
    unlike = (np.abs(model - driven) / (np.abs(model) + np.abs(driven))).sum(axis=0)
    # What is left of the inputs moves positions as the inputs do.
    own = np.array([[-float(c.name == name) for name in found.names] for c, *_ in read])
    by_left = model if found.names == record.model.inputs else own + 0 * model[..., :1]
    left = by_left @ (found.predicted - found.measured)[at, :, None]
    by_data = by_left @ forecast.by_data[at]
    power = (by_data @ forecast.covariance[0][at] * by_data.conj()).sum(axis=2).real.clip(0)
    force = lines.mean[at][:, None, inputs]
    with np.errstate(divide="ignore", invalid="ignore"):
        points, std = model + left / force, np.sqrt(power)[..., None] / np.abs(force)
        score = np.log(np.abs(model) / np.where(std > 0, std, np.abs(left / force)))
    # By the response that the model has: of lines without force noise would choose the largest.
    told = score > np.log(HALF_WIDTH / np.sqrt(2))
    if not told.any():
        return None
    unlike = np.where(told.any(axis=0), unlike, np.inf)
    told &= unlike == unlike.min(axis=0)
    i, j = divmod(int(np.argmax(np.where(told, score, 0.0).sum(axis=0))), len(inputs))
    kept = np.flatnonzero(told[:, i, j])
    kept = kept[:: -(-len(kept) // FEWEST)]
    seen = (lines.frequency[at], points[:, i, j].real, points[:, i, j].imag, std[:, i, j])
    drawn = (tuple(each[kept].tolist()) for each in seen)
    unit = f"{read[i][0].unit}/{record.inputs[j].unit}"
    return ResponseEvidence(record.model.inputs[j], read[i][1], unit, speed, *drawn)


def _times(record: Observation, most: int) -> Floats:
    """Return the times at which a record is shown: a period, or an excerpt of the whole."""
    lines, clock = record.lines, record.lines.clock
    highest = float(lines.frequency.max(initial=0.0))
    if not isinstance(clock, SampledClock) or len(clock.period) < 2:
        return np.zeros(0)
    length = float(np.ptp(clock.period))
    if lines.transient is None:
        length *= len(clock.period) / (len(clock.period) - 1)
        count = min(most, max(len(clock.period), int(PER_CYCLE * highest * length)))
        return np.asarray(np.arange(count) * length / count)
    if not highest:
        return np.zeros(0)
    step = 1 / (PER_CYCLE * highest)
    count = min(most, max(2, int(length / 2 / step)))
    return np.asarray(length / 2 + step * np.arange(count))


@frozen
class _Shown:
    """A record as it is shown: `size` neighbouring lines in one value, and the times."""

    record: Observation
    size: int
    time: Floats

    def channels(self, found: Predicted | None, spread: Floats | None) -> Iterator[ChannelEvidence]:
        lines = self.record.lines
        own = np.diagonal(lines.covariance.matrices, axis1=1, axis2=2).real.clip(0)
        told = () if found is None else found.names
        if found is not None:
            noise = own[:, list(map(lines.names.index, told))] if spread is None else spread
            for j, name in enumerate(told):
                both = (found.measured[:, j], found.predicted[:, j])
                yield self.channel(name, found.units[j], both, noise[:, j])
        for c, channel in enumerate(lines.channels):
            if channel.name not in told:
                yield self.channel(channel.name, channel.unit, (lines.mean[:, c],), own[:, c])

    def channel(
        self, name: str, unit: str, both: tuple[Complexes, ...], noise: Floats
    ) -> ChannelEvidence:
        """Return one channel, as measured and as predicted: its lines, what they make over time."""
        c, measured = self.record.lines.multiplicity, both[0]
        variance = noise if noise.any() else None
        made: dict[str, Any] = {"measured": self.amplitude(measured)}
        if variance is not None:
            made["noise"] = self.amplitude(np.sqrt(variance))
        if len(both) > 1:
            away, told = both[1] - measured, _telling(measured, variance)
            power, wrong = (float(c[told] @ np.abs(x[told]) ** 2) for x in (measured, away))
            made["predicted"], made["difference"] = map(self.amplitude, (both[1], away))
            made["error"] = _rounded([math.sqrt(wrong / power) if power > 0 else math.nan])[0]
            made["left_out"] = int((~told).sum())
            if len(self.time):
                turns = np.exp(2j * np.pi * np.outer(self.time, self.record.lines.frequency[told]))
                waves = (turns @ (c[told, None] * np.column_stack(both)[told])).real
                spread = math.nan if variance is None else math.sqrt(c[told] @ variance[told])
                made["wave_measured"], made["wave_predicted"] = map(_rounded, waves.T)
                made["wave_noise"] = _rounded([spread])[0]
        return ChannelEvidence(name, unit, **made)

    def amplitude(self, lines: Complexes | Floats) -> Numbers:
        """Return amplitudes, of several lines together their root mean square."""
        square = (self.record.lines.multiplicity * np.abs(lines)) ** 2
        return _rounded([math.sqrt(part.mean()) for part in _grouped(square, self.size)])


def _telling(measured: Complexes, variance: Floats | None) -> Booleans:
    """Return the lines on which noise moves a prediction less than the channel moved; else all."""
    told = np.abs(measured) ** 2 > (-1.0 if variance is None else variance)
    return np.asarray(told | ~told.any())


def _of_samples(record: Observation, found: Predicted | None, most: int) -> RecordEvidence:
    filtered = record.filtered
    assert filtered is not None
    base = RecordEvidence(
        source=filtered.source,
        kind="samples",
        sample_rate_hz=float(filtered.record.sample_rate),
        speed_rad_s=_rounded([filtered.speed] * 2),
    )
    if found is None or found.samples is None:
        return base
    step = -(-len(found.measured) // most) or 1
    time = found.samples / filtered.record.sample_rate
    size, wrong = found.size, found.wrong
    channels = tuple(
        ChannelEvidence(
            name,
            found.units[j],
            wave_measured=_rounded(found.measured[::step, j].real),
            wave_predicted=_rounded(found.predicted[::step, j].real),
            error=_rounded([math.sqrt(wrong[j] / size[j]) if size[j] > 0 else math.nan])[0],
        )
        for j, name in enumerate(found.names)
    )
    return replace(base, time_s=_rounded(time[::step]), channels=channels)


def _grouped(values: Floats, size: int) -> Iterator[Floats]:
    for start in range(0, len(values), size):
        yield values[start : start + size]


def _rounded(values: Sequence[float] | Floats) -> Numbers:
    return tuple(float(f"{value:.{DIGITS}g}") for value in values)


def _known(
    estimate: Estimate, model: Model, records: Sequence[Data], estimator: Estimator | None
) -> Iterator[Prior]:
    for value in estimate.parameters:
        if value.fixed:
            yield Prior(value.name, value.value, 0.0)
    asked = getattr(estimator, "knowledge", None)
    if asked is not None:
        for name, (value, std) in asked(model).known.items():
            yield Prior(name, value, std)
    named = {value.name for value in estimate.nuisance}
    bound = [bind(model, record) for record in records]
    wanted: Any = Nuisances() if asked is None else estimator  # maximum likelihood has both
    for nuisance in unknowns_of(bound, wanted):
        for unknown in nuisance.scalars:
            if unknown.name in named and unknown.std:
                yield Prior(unknown.name, unknown.prior, unknown.std)
    for constraint in getattr(estimator, "constraints", ()):
        yield Prior(constraint.expression, constraint.value, constraint.std)
