"""Offsets that drift are taken out and told; what only looks like it is left."""

from dataclasses import replace

import numpy as np
import pytest
from adverse_cases import CASES

from rotorid import Channel, Record, average

RATE, F0, SIZE = 4000.0, 20.0, 200


def machine(periods=40, noise=1e-7, seed=0):
    rng = np.random.default_rng(seed)
    time = np.arange(SIZE * periods) / RATE
    wave = sum(np.cos(2 * np.pi * F0 * k * time + k) / k for k in (1, 3, 5))
    samples = 1e-5 * wave[:, None] * [1.0, 0.7] + noise * rng.standard_normal((len(time), 2))
    return Record([Channel("x", "m"), Channel("y", "m")], samples, RATE)


def drifting(record, shape):
    return replace(record, samples=record.samples + np.stack([shape, 0 * shape], axis=1))


def told(periods):
    return [c for c in periods.checks if c.about == "drift" and c.verdict != "ok"]


@pytest.mark.parametrize("periods", [6, 40])
def test_a_ramp_is_taken_out_and_told(periods):
    clean = machine(periods)
    ramp = np.linspace(0, 2e-4, len(clean.samples))
    found = average(drifting(clean, ramp), F0, harmonics=[1, 3, 5])
    kept = average(clean, F0, harmonics=[1, 3, 5])
    (note,) = told(found)
    assert (", ".join(note.on), note.verdict) == ("x", "note")
    assert "the offset drifts by" in note.found
    assert "a straight line was taken out" in note.found
    assert np.abs(found.mean_spectrum - kept.mean_spectrum).max() < 1e-8
    assert not told(kept)


def test_a_ramp_below_the_noise_is_left():
    record = machine()
    std = 1e-7 / np.sqrt(len(record.samples))  # of a mean line
    small = np.linspace(0, 0.2 * std * 2 * np.pi * 40, len(record.samples))
    assert not told(average(drifting(record, small), F0, harmonics=[1, 3, 5]))


def test_a_step_of_the_offset_is_no_ramp():
    record = machine()
    step = np.where(np.arange(len(record.samples)) < 0.3 * len(record.samples), 0.0, 1e-4)
    assert not any(
        "straight" in c.found for c in told(average(drifting(record, step), F0, harmonics=[1]))
    )


def test_too_few_periods_show_no_ramp():
    record = machine(5)
    ramp = np.linspace(0, 2e-4, len(record.samples))
    assert not any(
        "straight" in c.found for c in told(average(drifting(record, ramp), F0, harmonics=[1]))
    )


def test_a_drift_of_offsets_leaves_the_answer_right():
    (case,) = (c for c in CASES if c.what == "an offset that drifts")
    for seed in range(4):
        found = case.run(seed, leads=False)
        assert found.status == "ok"
        assert found.error < 5
