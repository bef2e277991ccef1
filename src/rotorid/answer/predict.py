"""How well an estimate predicts a record, its own or better another one.

Whether the error is within the deviations of the estimate and the noise, a record tells whose
noise is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from rotorid.answer.derived import base_of, require_parameters
from rotorid.answer.estimate import Estimate
from rotorid.answer.parts import Prediction
from rotorid.core.distributions import Expectation, line_moments
from rotorid.core.errors import InputError, require_type
from rotorid.core.linalg import covariance_root
from rotorid.core.values import Complexes, Floats, frozen
from rotorid.data.observation import Data, Observation, Records, bind, bind_all
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.problem import Point
from rotorid.likelihood.response import by_likelihood
from rotorid.likelihood.unknowns import Nuisances, own_parameters, unknowns_of
from rotorid.linear.estimators import filtered_records
from rotorid.linear.regression import (
    Equations,
    Predicted,
    Regression,
    SampledRegression,
    relative_errors,
)
from rotorid.models import Model
from rotorid.models.knowledge import Knowledge
from rotorid.signals.checks.registry import NO_SCATTER
from rotorid.signals.covariance import correlated_covariance, is_correlated

FAILS = 1e-6  # chance of an error this large below which a prediction fails: that of `rejected`
UNEXPLAINED = 0.5
"""Relative error from which on a prediction fails where nothing says what noise does. Where noise
and deviations alone make as much, a record proves nothing: any machine would pass."""
STEP = 0.05  # step of each value, in its deviations, for the derivative of the prediction
CHIRP = (5**0.5 - 1) / 2
"""Turns by which the phase of a step grows faster from line to line, for the derivative by the
data: the loose ends of a whole record take up any smooth step, and follow none that turns so."""


def predict(
    model: Model, estimate: Estimate, records: Data | Sequence[Data]
) -> dict[str, Prediction | None]:
    """Return how well an estimate predicts records, channel by channel.

    Where every coordinate is measured, inputs are predicted: what the equations of motion leave
    over is laid to the inputs, ``B u = Z q - g``. Where some are hidden, readings are:
    ``y = C Z^-1 (B u + g)``.

    Parameters
    ----------
    model : Model
        The one that was identified.
    estimate : Estimate
    records : PeriodicRecord, Lines or FilteredRecord, or sequence of them
        The same records, or better other ones.

    Returns
    -------
    dict of channel name to Prediction
        ``|lines(measured - predicted)| / |lines(measured)|``; ``None`` for a channel that is zero.

    Raises
    ------
    InputError
        For an estimate that is not of this model, or that lacks values, and for a rotor angle of
        unknown phase.

    References
    ----------
    Levy and Arogeti, equation (12).

    Examples
    --------
    >>> import rotorid as rid
    >>> model = rid.load_model("jeffcott")
    >>> turn = 2 * np.pi * np.arange(100) / 100
    >>> forces = np.column_stack([400.0 * np.cos(3 * turn), 300.0 * np.sin(5 * turn)])
    >>> values = model.values(model.nominal)
    >>> record = rid.simulate(model, values, forces, sample_rate=1000.0, periods=3,
    ...                       speed=2 * np.pi * 30.0)
    >>> periods = rid.average(record, 10.0, harmonics=[1, 3, 5])
    >>> estimate = rid.identify(model, periods, rid.LeastSquares())
    >>> predict(model, estimate, periods)["F_x"].relative_error < 1e-3
    True
    """
    require_type(estimate, Estimate, place="estimate")
    data = records if isinstance(records, Sequence) else [records]
    return relative_errors(predict_lines(model, estimate, data))


def as_found(model: Model, estimate: Estimate) -> Model:
    """Return the model for the values of an estimate, as it was identified with."""
    return model.redrawn({value.name: value.value for value in estimate.parameters})


def predict_lines(
    model: Model, estimate: Estimate, records: Sequence[Data], first: int = 0
) -> list[Predicted]:
    """Return the lines that an estimate predicts, record by record, beside the measured ones.

    What every record has to itself is taken from the record of the same number, `first` that of
    the first one here.
    """
    for number, record in enumerate(records, start=first):
        own = record.own if isinstance(record, Observation) else record.parameters
        require_parameters(model, estimate, number, own)
    needed = (*estimate.parameters, *estimate.nuisance)
    if unknown := [value.name for value in needed if not np.isfinite(value.value)]:
        expected = "a value of every parameter"
        cure = "fix one or measure more, then identify again"
        raise InputError(f"a result that leaves {', '.join(unknown)} undetermined", expected, cure)
    model = as_found(model, estimate)
    bound = bind_all(model, records)
    filtered = filtered_records(bound)
    if filtered or model.linear is None:
        reduced = model.substitute({v.name: v.value for v in estimate.parameters if v.fixed})
        found = base_of(reduced, estimate, physical=False)
        assert found is not None  # all values are there
        return [_equations(replace(r, model=reduced), found[0]).predicted(found[0]) for r in bound]
    return by_likelihood(bound, _at_estimate(model, estimate, bound, first).records)


def _equations(record: Observation, base: Floats) -> Equations:
    """Return the equations of a record; of samples those that see the motion as leaves least."""
    if record.filtered is None:
        return Regression(record)
    return min(SampledRegression(record).ways(), key=lambda way: way.misfit(base))


def _at_estimate(model: Model, estimate: Estimate, records: Records, first: int) -> Point:
    values = {v.name: v.value for v in (*estimate.parameters, *estimate.nuisance)}
    numbered, names = list[Observation](), model.parameter_names
    for number, record in enumerate(records, first):
        if not record.lines.phase_known:
            told = "a rotor angle of unknown phase"
            cure = "give the phase, or a keyphasor or angle column"
            raise InputError(told, "a known phase", cure, file=record.lines.source)
        found = {n: values[f"{n}[{number}]"] for n in names if f"{n}[{number}]" in values}
        numbered.append(replace(record, own={**found, **record.own}))
    own = own_parameters(numbered, Nuisances())
    base = not {*names} <= values.keys() | {name for n in own for name in n.on}
    # The phase of a record is its own, and says nothing of another's.
    shared = [
        n
        for n in unknowns_of(records)
        if {u.name for u in n.scalars} <= values.keys() and n.record is None
    ]
    # Parameters of the estimate's single records are in `own`, under the numbers of these ones.
    single = {f"{n}[{k}]" for n in names for k in range(len(values))}
    held = {v.name: v.value for v in estimate.parameters if v.fixed and v.name not in single}
    common = {scalar.name for unknown in shared for scalar in unknown.scalars}
    known = {v.name for v in estimate.parameters} - single | common
    start = {name: values[name] for name in known - held.keys()}
    prepared = prepare(model, Knowledge(fixed=held, start=start), [*own, *shared], base, {})
    return prepared.of(records).at(prepared.layout.start)


@frozen
class ChannelError:
    name: str
    # |predicted - measured| / |measured|; None for a channel that is zero
    relative_error: float | None
    # the relative error that the noise of the record alone makes; None where it is not known
    noise: float | None = None
    # chance that noise and the deviations of the estimate make an error at least as large
    p_value: float | None = None
    deviations: float | None = None  # the relative error that the deviations of the values make

    def __str__(self) -> str:
        told = f"{self.name} is off by {100 * (self.relative_error or 0.0):.3g} %"
        if self.noise is None:
            return told
        told += f", where noise makes {100 * self.noise:.2g} %"
        if self.deviations is not None:
            told += f" and the deviations of the values {100 * self.deviations:.2g} %"
        return told if self.p_value is None else f"{told} (p = {self.p_value:.1g})"

    @property
    def tells(self) -> bool:
        if self.relative_error is None:
            return False
        return float(np.hypot(self.noise or 0.0, self.deviations or 0.0)) < UNEXPLAINED

    @property
    def fails(self) -> bool:
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
    noise = np.zeros(at.measured.shape) if noise is None else noise
    found = []
    for j, (name, whole) in enumerate(zip(at.names, at.size, strict=True)):
        wrong, part = (_relative(power[j], whole) for power in (at.wrong, at.multiplicity @ noise))
        error = ChannelError(name, wrong)
        if part is not None and part >= NO_SCATTER:  # else rounding
            root, freedom = forecast.by_values[:, j], forecast.covariance[1]
            chance = _chance(_error(at)[:, j], noise[:, j], root, at.multiplicity, freedom)
            spread = _relative(float(at.multiplicity @ forecast.spread[:, j]), whole)
            error = ChannelError(name, wrong, part, chance, spread)
        found.append(error)
    return found


def at_best_phase(
    model: Model, estimate: Estimate, record: Data, number: int = 0
) -> tuple[Data, float | None]:
    """Return a record that does not know its rotor angle with the one that fits best, in rad.

    The rotor angle turns the unbalance and nothing else, so that the error is
    ``a + b exp(i phi) + c exp(-i phi)`` on every line: three predictions tell all others. A record
    that knows its angle is returned as it is, with ``None``.
    """
    bound = bind(as_found(model, estimate), record)
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

    # Where its derivative vanishes, exp(i phi) is a root of a polynomial; other roots cost more.
    a, b, c = parts
    once, twice = np.vdot(a, b) + np.vdot(c, a), 2 * np.vdot(c, b)
    roots = np.roots([twice, once, 0.0, -np.conj(once), -np.conj(twice)])
    angle = float(min(np.angle(roots), key=misfit, default=0.0))
    return bound.with_lines(bound.lines.turned(angle)), angle


@frozen
class Forecast:
    model: Model
    estimate: Estimate
    record: Data
    number: int = 0  # that of the record

    @cached_property
    def bound(self) -> Observation:
        return bind(as_found(self.model, self.estimate), self.record)

    @cached_property
    def at(self) -> Predicted:
        return predict_lines(self.model, self.estimate, [self.record], self.number)[0]

    @cached_property
    def noise(self) -> Floats | None:
        """The variance that noise gives predicted - measured, (line, predicted); None: unknown."""
        if self.model.linear is None or not np.abs(self.bound.lines.covariance.matrices).any():
            return None
        by_data, (covariance, _) = self.by_data, self.covariance
        found = np.einsum("ljc,lcd,ljd->lj", by_data, covariance, by_data.conj()).real
        return np.asarray(found.clip(0))

    @property
    def spread(self) -> Floats:
        """The variance that the deviations of the values give it, (line, predicted)."""
        return np.asarray((np.abs(self.by_values) ** 2).sum(axis=2))

    @cached_property
    def by_data(self) -> Complexes:
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
            each = np.einsum("ljc,plc->plj", self.by_data, scatter - scatter.mean(axis=0))
            size = np.sqrt((np.abs(each) ** 2).mean(axis=0))
            each = each / np.where(size > 0, size, 1.0)
            if is_correlated(each.reshape(len(each), -1, 1)):
                covariance = correlated_covariance(scatter)
        return covariance.matrices, np.full(len(self.by_data), float(covariance.dof))


def _error(at: Predicted) -> Complexes:
    return np.asarray(at.predicted - at.measured)


def _relative(power: float, whole: float) -> float | None:
    return float(np.sqrt(power / whole)) if whole > 0 else None


def _moved(estimate: Estimate, name: str, step: float) -> Estimate:
    parameters, nuisance = (
        tuple(replace(v, value=v.value + step) if v.name == name and not v.fixed else v for v in of)
        for of in (estimate.parameters, estimate.nuisance)
    )
    return estimate.with_(parameters=parameters, nuisance=nuisance)


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
    verdict: str  # "predicts" or "fails"
    sentence: str  # what it rests on: the worst channel
    cures: tuple[str, ...] = ()  # what to do where it fails


def verdict_of(records: Sequence[Sequence[ChannelError]]) -> Validated:
    every = [channel for record in records for channel in record]
    if len(records) > 1:
        numbered = enumerate(records, 1)
        every = [replace(c, name=f"{c.name} of record {k}") for k, each in numbered for c in each]
    if failing := [channel for channel in every if channel.fails]:
        worst = min(failing, key=lambda channel: (channel.p_value or 0.0, -(channel.noise or 0)))
        return Validated("fails", f"the result does not predict the record: {worst}", CURES)
    if not (telling := [channel for channel in every if channel.tells]):
        return Validated("fails", f"inconclusive: {_hidden(every)}", (LOUDER,))
    worst = max(telling, key=lambda channel: channel.relative_error or 0.0)
    how = "within its deviations and the noise"
    if all(channel.p_value is None for channel in telling):
        how = f"to better than {100 * UNEXPLAINED:g} %; nothing tells what noise makes"
    return Validated("predicts", f"the result predicts the record {how}: at worst {worst}")


def _hidden(every: Sequence[ChannelError]) -> str:
    if not (known := [channel for channel in every if channel.relative_error is not None]):
        return "every channel of the record is zero"
    best = min(known, key=lambda channel: np.hypot(channel.noise or 0.0, channel.deviations or 0.0))
    return f"{best}, and of no channel less: any machine would pass"


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
