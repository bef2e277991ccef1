"""Whether an estimate predicts another record within its deviations and the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy

from rotorid.answer.estimate import Estimate
from rotorid.answer.predict import predict_lines
from rotorid.core.distributions import Expectation, line_moments
from rotorid.core.frozen import frozen
from rotorid.core.linalg import covariance_root
from rotorid.core.values import Complexes, Floats
from rotorid.data.observation import Data, Observation, bind
from rotorid.linear.regression import Predicted
from rotorid.models import Model
from rotorid.signals.checks.registry import NO_SCATTER
from rotorid.signals.covariance import correlated_covariance, is_correlated

FAILS = 1e-6
"""Chance of an error this large below which a prediction fails: that of `rejected`."""
UNEXPLAINED = 0.5
"""Relative error from which on a prediction fails where nothing says what noise does. Where noise
and deviations alone make as much, a record proves nothing: any machine would pass."""
STEP = 0.05
"""Step of each value, in its deviations, for the derivative of the prediction."""
STEPS = 24
"""Angles from which that of a record is looked for: its misfit has two waves at most in a turn."""
CHIRP = (5**0.5 - 1) / 2
"""Turns by which the phase of a step grows faster from line to line, for the derivative by the
data: the loose ends of a whole record take up any smooth step, and follow none that turns so."""


@frozen
class ChannelError:
    """How far the prediction of one channel is off."""

    name: str
    # |predicted - measured| / |measured|; None for a channel that is zero
    relative_error: float | None
    # the relative error that the noise of the record alone makes; None where it is not known
    noise: float | None
    # chance that noise and the deviations of the estimate make an error at least as large
    p_value: float | None
    deviations: float | None = None  # the relative error that the deviations of the values make

    @property
    def tells(self) -> bool:
        """Whether a wrong prediction would show: by more than noise and deviations hide."""
        if self.relative_error is None:
            return False
        return float(np.hypot(self.noise or 0.0, self.deviations or 0.0)) < UNEXPLAINED

    @property
    def fails(self) -> bool:
        """Whether the error is more than noise and deviations explain."""
        if self.p_value is not None:
            return self.p_value < FAILS
        return self.relative_error is not None and self.relative_error > UNEXPLAINED


def channel_errors(
    model: Model, estimate: Estimate, record: Data, number: int = 0
) -> list[ChannelError]:
    """Return how far the prediction of each channel of a record is off.

    The error of a line is linear in the measured lines, whose covariance the record tells, and to
    first order in the values, whose covariance the estimate states. The record is taken to be
    another one: of its own record an estimate predicts more than its share. Refuses what `predict`
    does.
    """
    forecast = Forecast(model, estimate, record, number)
    at, noise = forecast.at, forecast.noise
    sizes = _relative(at.wrong, at.size)
    if noise is None:
        return [ChannelError(n, size, None, None) for n, size in zip(at.names, sizes, strict=True)]
    parts = _relative(at.multiplicity @ noise, at.size)
    spreads = _relative(at.multiplicity @ forecast.spread, at.size)
    found = []
    for j, (name, size, part) in enumerate(zip(at.names, sizes, parts, strict=True)):
        if part is None or part < NO_SCATTER:  # rounding
            found.append(ChannelError(name, size, None, None))
            continue
        root, freedom = forecast.by_values[:, j], forecast.covariance[1]
        chance = _chance(_error(at)[:, j], noise[:, j], root, at.multiplicity, freedom)
        found.append(ChannelError(name, size, part, chance, spreads[j]))
    return found


def at_best_phase(
    model: Model, estimate: Estimate, record: Data, number: int = 0
) -> tuple[Data, float | None]:
    """Return a record that does not know its rotor angle with the one that fits best, in rad.

    The rotor angle turns the unbalance and nothing else, so that the error is
    ``a + b exp(i phi) + c exp(-i phi)`` on every line: three predictions tell all others. A record
    that knows its angle is returned as it is, with ``None``.
    """
    bound = bind(model, record)
    if model.linear is None or bound.lines.phase_known or bound.lines.turned(0.0) is bound.lines:
        return record, None
    turns = 2 * np.pi * np.arange(3) / 3
    tried = [bound.with_lines(bound.lines.turned(turn)) for turn in turns]
    found = [Forecast(model, estimate, one, number) for one in tried]
    at, noise = found[0].at, found[0].noise
    size = at.size if noise is None else np.where(noise > 0, noise, np.inf)
    weight = np.sqrt(at.multiplicity[:, None] / np.where(size > 0, size, np.inf))
    waves = np.exp(1j * np.outer(turns, [0, 1, -1]))
    errors = np.stack([weight * _error(one.at) for one in found])
    parts = np.tensordot(waves.conj().T / 3, errors, axes=1).reshape(3, -1)

    def misfit(angle: float) -> float:
        return float((np.abs(np.exp(1j * angle * np.array([0, 1, -1])) @ parts) ** 2).sum())

    around = 2 * np.pi * np.arange(STEPS) / STEPS
    near = around[int(np.argmin([misfit(angle) for angle in around]))]
    ends = (near - around[1], near + around[1])
    best = scipy.optimize.minimize_scalar(misfit, bounds=ends, method="bounded").x
    angle = float(np.angle(np.exp(1j * best)))
    return bound.with_lines(bound.lines.turned(angle)), angle


@frozen
class Forecast:
    """What an estimate predicts of a record, and what is unsure of the error."""

    model: Model
    estimate: Estimate
    record: Data
    number: int = 0  # that of the record

    @cached_property
    def bound(self) -> Observation:
        return bind(self.model, self.record)

    @cached_property
    def at(self) -> Predicted:
        return predict_lines(self.model, self.estimate, [self.record], self.number)[0]

    @cached_property
    def noise(self) -> Floats | None:
        """The variance that the noise of the record gives predicted - measured, (line, predicted).

        None where the model is not linear or nothing is known of the noise.
        """
        if self.model.linear is None or not np.abs(self.bound.lines.covariance.matrices).any():
            return None
        by_data, (covariance, _) = self._by_data, self.covariance
        found = np.einsum("ljc,lcd,ljd->lj", by_data, covariance, by_data.conj()).real
        return np.asarray(found.clip(0))

    @property
    def spread(self) -> Floats:
        """The variance that the deviations of the values give it, (line, predicted)."""
        return np.asarray((np.abs(self.by_values) ** 2).sum(axis=2))

    @cached_property
    def _by_data(self) -> Complexes:
        """The derivative of the error by the measured lines, (line, predicted, channel)."""
        lines, columns = self.bound.lines, []
        turns = np.exp(2j * np.pi * CHIRP * np.arange(len(lines.mean)) ** 2)
        steps = np.where(lines.multiplicity > 1, turns, 1.0)  # real lines stay real
        for channel in range(lines.mean.shape[1]):
            size = float(np.abs(lines.mean[:, channel]).max()) or 1.0
            mean = lines.mean.copy()
            mean[:, channel] += size * steps
            there = replace(self, record=self.bound.with_lines(replace(lines, mean=mean)))
            columns.append(self._change(there) / (size * steps[:, None]))
        return np.stack(columns, axis=2)

    @cached_property
    def by_values(self) -> Complexes:
        """A root of the covariance that the values give the error, (line, predicted, value)."""
        shape, covariance = _error(self.at).shape, self.estimate.covariance
        if not covariance.size or not np.isfinite(covariance).all():
            return np.zeros((*shape, 0), dtype=np.complex128)
        columns = []
        for value in self.estimate.free:
            step = STEP * float(value.std or 0.0)
            if not step > 0:
                columns.append(np.zeros(shape, dtype=np.complex128))
                continue
            there = replace(self, estimate=_moved(self.estimate, value.name, step))
            columns.append(self._change(there) / step)
        return np.asarray(np.stack(columns, axis=2) @ covariance_root(covariance))

    def _change(self, other: Forecast) -> Complexes:
        return np.asarray(_error(other.at) - _error(self.at))

    @cached_property
    def covariance(self) -> tuple[Complexes, Floats]:
        """That of the mean lines, and its degrees of freedom on each line.

        From the neighbouring lines where the errors of one period resemble the next.
        """
        covariance, scatter = self.bound.lines.covariance, self.bound.lines.scatter
        if scatter is not None and covariance.kind == "white":
            each = np.einsum("ljc,plc->plj", self._by_data, scatter - scatter.mean(axis=0))
            size = np.sqrt((np.abs(each) ** 2).mean(axis=0))
            each = each / np.where(size > 0, size, 1.0)
            if is_correlated(each.reshape(len(each), -1, 1)):
                covariance = correlated_covariance(scatter)
        return covariance.matrices, np.full(len(self._by_data), float(covariance.dof))


def _error(at: Predicted) -> Complexes:
    return np.asarray(at.predicted - at.measured)


def _relative(power: Floats, size: Floats) -> list[float | None]:
    return [
        float(np.sqrt(p / whole)) if whole > 0 else None
        for p, whole in zip(power, size, strict=True)
    ]


def _moved(estimate: Estimate, name: str, step: float) -> Estimate:
    moved = {
        kind: tuple(
            replace(v, value=v.value + step) if v.name == name and not v.fixed else v
            for v in getattr(estimate, kind)
        )
        for kind in ("parameters", "nuisance")
    }
    return estimate.with_(**moved)


def _chance(
    error: Complexes, variance: Floats, root: Complexes, multiplicity: Floats, freedom: Floats
) -> float | None:
    """Return the chance of an error at least as large, over all lines of a channel."""
    seen = variance > 0
    if not seen.any():
        return None
    # A complex line has half the variance in each part, a real line all of it in one.
    scale = np.sqrt(multiplicity[seen] / variance[seen])
    parts = [(error.real, root.real), (error.imag, root.imag)]
    x = np.concatenate([e[seen] * scale for e, _ in parts])
    g = np.concatenate([r[seen] * scale[:, None] for _, r in parts])
    left, values, _ = np.linalg.svd(g, full_matrices=False)
    taken = values**2 / (1 + values**2)
    cost = float(x @ x - taken @ (left.T @ x) ** 2)
    mean, spread = line_moments(np.ones(int(seen.sum())), freedom[seen], multiplicity[seen])
    dof = round(float(multiplicity[seen].sum()))
    return Expectation(float(mean.sum()), float(spread.sum()), dof).p_value(cost)


@frozen
class Validated:
    """Whether a result predicts some records."""

    verdict: str  # "predicts" or "fails"
    sentence: str  # what it rests on: the worst channel
    cures: tuple[str, ...] = ()  # what to do where it fails


def verdict_of(records: Sequence[Sequence[ChannelError]]) -> Validated:
    """Return whether records are predicted, and what to do where they are not."""
    every = [(k, channel) for k, record in enumerate(records) for channel in record]
    failing = [pair for pair in every if pair[1].fails]
    several = len(records) > 1
    if failing:
        worst = min(failing, key=lambda pair: (pair[1].p_value or 0.0, -(pair[1].noise or 0)))
        told = f"the result does not predict the record: {_told(*worst, several)}"
        return Validated("fails", told, CURES)
    telling = [pair for pair in every if pair[1].tells]
    if not telling:
        return Validated("fails", f"inconclusive: {_hidden(every, several)}", (LOUDER,))
    worst = max(telling, key=lambda pair: pair[1].relative_error or 0.0)
    how = "within its deviations and the noise"
    if all(channel.p_value is None for _, channel in telling):
        how = f"to better than {100 * UNEXPLAINED:g} %; nothing tells what noise makes"
    told = f"the result predicts the record {how}: at worst {_told(*worst, several)}"
    return Validated("predicts", told)


def _hidden(every: Sequence[tuple[int, ChannelError]], several: bool) -> str:
    known = [pair for pair in every if pair[1].relative_error is not None]
    if not known:
        return "every channel of the record is zero"
    best = min(known, key=lambda pair: np.hypot(pair[1].noise or 0.0, pair[1].deviations or 0.0))
    return f"{_told(*best, several)}, and of no channel less: any machine would pass"


def _told(number: int, channel: ChannelError, several: bool) -> str:
    where = f" of record {number + 1}" if several else ""
    told = f"{channel.name}{where} is off by {100 * (channel.relative_error or 0.0):.3g} %"
    if channel.noise is None:
        return told
    told += f", where noise makes {100 * channel.noise:.2g} %"
    if channel.deviations is not None:
        told += f" and the deviations of the values {100 * channel.deviations:.2g} %"
    return told if channel.p_value is None else f"{told} (p = {channel.p_value:.1g})"


CURES = (
    "Look where it fails: on all lines of one channel alike it is that channel's unit, gain or "
    "sign; about one frequency it is a mode that the model lacks; on the lines of the rotation it "
    "is the rotor angle or the unbalance.",
    "Hold the two experiment files side by side: speed, rotor angle, units, force laws and delays "
    "must be those of each record. Where nothing marks the rotor's angle, each record begins at "
    'another one: phase = "unknown" in all of this experiment.',
    "Identify both records together: if that is accepted, the first record alone did not "
    "determine what the second one needs.",
)
"""What to do where a prediction fails."""
LOUDER = (
    "Take a record with more excitation, of more periods, or of lines where the machine answers; "
    "where the deviations of the values hide the error, identify with more data first."
)
"""What to do where a record proves nothing."""
