"""Halves of whole records are held against each other: what changed meanwhile shows."""

import numpy as np
import pytest
from scipy.linalg import expm

import rotorid as rid
from rotorid.likelihood.doubts import answers_of_windows

MODEL = """
title = "a mass on a spring, held by a loop"
equations = ["m*x'' + c*x' + k*x = F"]
coordinates = { x = "m" }
inputs = { F = "N" }
[parameters]
m = { unit = "kg", nominal = 2.0 }
c = { unit = "N s/m", nominal = 60.0 }
k = { unit = "N/m", nominal = 2e5 }
"""
RATE, COUNT = 2000.0, 12000


def record(rng: np.random.Generator, stiffer: float = 0.0, gain: float = 0.0) -> rid.Record:
    """Return a mass that noise shakes, by the exact step of a force that is held."""
    force = rng.standard_normal(COUNT)
    position = np.empty(COUNT)
    state = np.zeros(2)
    for part in range(2):
        stiffness = 2e5 * (1 + stiffer * part)
        step = step_of(stiffness)
        for n in range(part * COUNT // 2, (part + 1) * COUNT // 2):
            position[n] = state[0]
            state = step[:2, :2] @ state + step[:2, 2] * force[n]
    position[COUNT // 2 :] *= 1 + gain
    noisy = position + 3e-7 * rng.standard_normal(COUNT)
    channels = [rid.Channel("F", "N", hold=True), rid.Channel("x", "m")]
    return rid.Record(channels, np.column_stack([force, noisy]), RATE)


def step_of(stiffness: float) -> np.ndarray:
    """Return the step of a sample, of position, velocity and force, exactly."""
    matrix = np.zeros((3, 3))
    matrix[0, 1] = 1.0
    matrix[1] = [-stiffness / 2, -30.0, 0.5]
    return np.asarray(expm(matrix / RATE))


def answer(each: rid.Record) -> rid.Estimate:
    lines = rid.spectra(each, (5.0, 150.0), inputs=["F"])
    return rid.identify(rid.models.parse_model(MODEL), lines, "ml")


@pytest.mark.slow
def test_nothing_is_said_of_a_record_in_which_nothing_changed() -> None:
    for seed in range(4):
        found = answer(record(np.random.default_rng(seed)))
        assert found.status == "ok", found.warnings


@pytest.mark.parametrize(("change", "named"), [({"stiffer": 0.05}, "k"), ({"gain": 0.03}, "mk")])
def test_what_changed_in_the_middle_is_told(change: dict[str, float], named: str) -> None:
    found = answer(record(np.random.default_rng(1), **change))
    assert found.status == "rejected"
    told = [text for text in found.warnings if "halves of the record differ by" in text]
    assert len(told) == 1
    assert any(f"deviations in {name}" in told[0] for name in named)


def test_a_record_without_windows_has_no_halves() -> None:
    lines = rid.spectra(record(np.random.default_rng(1)), (5.0, 150.0), inputs=["F"])
    assert len(lines.parts(2)) == 2
    assert lines.parts(3)[2].names == lines.names
    assert answers_of_windows(None, []) is None
