"""Another record is predicted within deviations and noise; that of another rotor is not."""

from dataclasses import replace

import adverse
import numpy as np
import pytest
from adverse import FUNDAMENTAL, TURN

import rotorid as rid
from rotorid import Estimate, PeriodicRecord
from rotorid.answer import validation
from rotorid.answer.validation import ChannelError, channel_errors, verdict_of


def identified(kind: str, seed: int) -> tuple[adverse.Trial, Estimate]:
    trial = adverse.new_trial(kind, np.random.default_rng([seed, 51]))
    adverse.measure(trial)
    return trial, adverse.estimate_of(trial)


def further(trial: adverse.Trial, machine: adverse.Machine | None = None) -> PeriodicRecord:
    """Another record of the same machine, or of another one, with other forces."""
    phases = np.exp(1j * TURN * trial.rng.random(trial.forces.shape))
    other = replace(trial, forces=trial.forces * phases, machine=machine or trial.machine)
    adverse.measure(other)
    return rid.average(adverse.record_of(other), FUNDAMENTAL, harmonics=trial.harmonics)


@pytest.mark.parametrize("kind", ["jeffcott", "rigid", "three", "eight"])
def test_another_record_is_predicted(kind: str) -> None:
    trial, estimate = identified(kind, 1)
    found = channel_errors(trial.machine.model, estimate, further(trial))
    assert verdict_of([found]).verdict == "predicts"
    for channel in found:
        assert channel.p_value is not None
        assert channel.p_value > 1e-4
        assert channel.relative_error is not None
        assert channel.noise is not None
        assert channel.relative_error < 30 * channel.noise


@pytest.mark.parametrize("kind", ["jeffcott", "rigid", "three"])
def test_another_rotor_is_not(kind: str) -> None:
    trial, estimate = identified(kind, 2)
    heavier = replace(trial.machine, inertia=1.02 * trial.machine.inertia)
    found = channel_errors(trial.machine.model, estimate, further(trial, heavier))
    told = verdict_of([found])
    said = told.sentence
    assert told.verdict == "fails"
    assert "the result does not predict the record: " in said
    assert "where noise makes" in said


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["jeffcott", "rigid", "three"])
def test_chances_are_even(kind: str) -> None:
    """Of records of the machine identified, 5 % have a chance below 5 %."""
    low = []
    for seed in range(60):
        trial, estimate = identified(kind, 100 + seed)
        found = channel_errors(trial.machine.model, estimate, further(trial))
        low += [c.p_value < 0.05 for c in found if c.p_value is not None]
    assert 0.01 < np.mean(low) < 0.10


def test_deviations_count() -> None:
    """With values that are not known at all any record of another rotor is predicted."""
    trial, estimate = identified("jeffcott", 2)
    heavier = replace(trial.machine, inertia=1.02 * trial.machine.inertia)
    record = further(trial, heavier)
    unsure = estimate.with_(
        covariance=1e4 * estimate.covariance,
        parameters=tuple(
            replace(v, std=None if v.std is None else 100 * v.std) for v in estimate.parameters
        ),
    )
    assert verdict_of([channel_errors(trial.machine.model, unsure, record)]).verdict == "predicts"
    sure = estimate.with_(covariance=np.zeros((0, 0)))
    assert verdict_of([channel_errors(trial.machine.model, sure, record)]).verdict == "fails"


def test_rounding_of_the_covariance_moves_no_deviation() -> None:
    """Variances of a stiffness and of an unbalance lie 20 powers of ten apart."""
    trial, estimate = identified("jeffcott", 3)
    record, model = further(trial), trial.machine.model
    spread = np.sqrt(np.diag(estimate.covariance))
    assert spread.max() > 1e8 * spread.min()
    rounding = 1e-14 * trial.rng.standard_normal(estimate.covariance.shape)
    rounded = estimate.covariance + (rounding + rounding.T) * np.outer(spread, spread)
    one, other = (
        channel_errors(model, estimate.with_(covariance=c), record)
        for c in (estimate.covariance, rounded)
    )
    for a, b in zip(one, other, strict=True):
        assert a.deviations == pytest.approx(b.deviations, rel=1e-9)


def test_a_record_that_hides_any_error_proves_nothing() -> None:
    hidden = ChannelError("F", 0.4, 0.4, 0.5, 0.31)  # together .506
    told = verdict_of([[hidden, ChannelError("x", 0.6, 0.6, 0.5, 0.0)]])
    assert told.verdict == "fails"
    assert told.sentence.startswith("inconclusive: F is off by 40 %")
    assert told.cures == (validation.LOUDER,)
    shown = ChannelError("G", 0.4, 0.4, 0.5, 0.29)  # .494
    assert verdict_of([[hidden], [shown]]).verdict == "predicts"
    zero = verdict_of([[ChannelError("F", None, None, None)]])
    assert zero.sentence == "inconclusive: every channel of the record is zero"


def test_where_nothing_says_what_noise_does() -> None:
    assert pytest.approx(0.6180339887) == validation.CHIRP
    assert ChannelError("F", 0.51, None, None).fails
    assert not ChannelError("F", 0.49, None, None).fails
    assert not ChannelError("F", None, None, None).fails
    assert ChannelError("F", 0.01, 0.001, 0.9e-6).fails
    assert not ChannelError("F", 0.01, 0.001, 1.1e-6).fails
    rows = [[ChannelError("F", 0.6, None, None)], [ChannelError("x", 0.2, 0.1, 1e-9)]]
    assert verdict_of(rows).sentence.endswith("F of record 1 is off by 60 %")
    model = rid.load_model("jeffcott")
    forces = 100 * np.cos(TURN * np.arange(100) / 100)[:, None] * [1.0, 0.5]
    values = model.values(model.nominal)
    silent = rid.simulate(model, values, forces, sample_rate=1000.0, periods=3)
    periods = rid.average(silent, 10.0, harmonics=[1])
    _, estimate = identified("jeffcott", 3)
    found = channel_errors(model, estimate, periods)
    assert [(c.noise, c.p_value) for c in found] == [(None, None)] * 2
