"""What is added to a command moves the machine later, never earlier."""

import re

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid
from rotorid.signals.checks.references import check_references

COUNT = 8000
RATE = 1000.0


def checks(references: np.ndarray, channels: np.ndarray) -> list[rid.Note]:
    lines = [np.fft.rfft(np.atleast_2d(part).T, axis=0) for part in (references, channels)]
    names = [[f"{kind}{k}" for k in range(lines[n].shape[1])] for n, kind in enumerate("rc")]
    return list(check_references(names[0], lines[0], names[1], lines[1], RATE))


def wave(top: float, seed: int = 1) -> np.ndarray:
    """Return noise up to a frequency."""
    lines = np.fft.rfft(np.random.default_rng(seed).standard_normal(COUNT))
    lines[round(top * COUNT / RATE) :] = 0.0
    return np.fft.irfft(lines)


@pytest.mark.parametrize(("top", "samples", "late"), [(100, 14, False), (100, 17, True)])
def test_how_late_a_reference_is_at_least(top: float, samples: int, late: bool) -> None:
    """Of a band of 100 Hz one and a half widths are 15 ms, at a thousand samples a second 15."""
    told = checks(wave(top), np.roll(wave(top), -samples))
    assert bool(told) == late
    if late:
        assert f"c0 follows it 0.0{samples} s before it comes, {samples} samples" in told[0].found
    assert not checks(wave(top), np.roll(wave(top), 50))


@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        (10.1, "c0 follows it"),
        (10.4, ""),
        (12.3, ""),
        (12.6, "nothing that was measured follows it"),
    ],
)
def test_what_follows_a_reference(noise: float, expected: str) -> None:
    """One that hardly follows, in noise, tells no time; and one of noise alone does not follow."""
    rng = np.random.default_rng(7)
    channel = np.roll(wave(450.0), -40) + noise * rng.standard_normal(COUNT)
    told = checks(wave(450.0), channel)
    assert [check.found.startswith(expected) for check in told] == [True] * bool(expected)


def test_axes_that_are_excited_in_turn() -> None:
    """The second axis follows the first one's reference by half a record, and its own at once."""
    half = np.arange(COUNT) < COUNT // 2
    first = wave(450.0) * half
    second = np.roll(first, COUNT // 2 - 1)
    assert not checks(np.array([first, second]), np.array([first, second]))


def test_excitation_with_a_period() -> None:
    """Any period may be the one that a channel follows: the nearest is taken."""
    period = np.tile(wave(450.0)[:800], 10)
    assert not checks(period, np.roll(period, 30))
    (told,) = checks(period, np.roll(period, -30))
    assert " 30 samples" in told.found
    # A second peak that stands out less is none: most lines are late, the others are not.
    reference = np.fft.rfft(wave(450.0))
    turns = np.exp(2j * np.pi * np.arange(COUNT // 2 + 1) / COUNT)
    drawn = np.random.default_rng(1).random(len(turns))
    for part, late in ((0.57, True), (0.535, False)):
        lines = reference * np.where(drawn < part, turns**300, turns**-3)
        assert bool(checks(wave(450.0), np.fft.irfft(lines))) == late


@pytest.mark.parametrize(("lines", "told"), [(21, False), (23, True)])
def test_a_reference_of_few_lines_tells_nothing(lines: int, told: bool) -> None:
    excited = np.zeros(COUNT // 2 + 1, dtype=complex)
    excited[500 : 500 + lines] = 1.0
    reference = np.fft.irfft(excited)
    noise = np.random.default_rng(1).standard_normal(COUNT)
    assert bool(checks(reference, noise)) == told


@pytest.mark.parametrize(("power", "told"), [(0.8e-2, True), (1.2e-2, False)])
def test_lines_that_are_weak_do_not_count(power: float, told: bool) -> None:
    """A channel that follows on the strong lines alone, and a reference that is weak elsewhere."""
    rng = np.random.default_rng(3)
    strong = np.arange(COUNT // 2 + 1) < 60
    phase = np.exp(2j * np.pi * rng.random(COUNT // 2 + 1))
    reference = np.where(strong, 1.0, np.sqrt(power)) * phase
    other = np.exp(2j * np.pi * rng.random(COUNT // 2 + 1))
    shift = np.exp(2j * np.pi * np.arange(COUNT // 2 + 1) * 400 / COUNT)
    lines = np.where(strong, phase * shift, other)
    found = list(check_references(["r"], reference[:, None], ["c"], lines[:, None], RATE))
    assert ["c follows it" in check.found for check in found] == [told]


@pytest.mark.slow
def test_the_references_of_a_loop() -> None:
    record = levitated(1)
    late = record.samples.copy()
    late[:, 4:] = np.roll(late[:, 4:], 12, axis=0)

    def found(samples: np.ndarray) -> rid.Estimate:
        given = rid.Record(record.channels, samples, record.sample_rate, record.speed)
        lines = rid.spectra(given, (2.0, 120.0), references=["r_x", "r_y"])
        return rid.identify(MODEL, lines, KNOWN)

    assert not [check for check in found(record.samples).checks if check.about == "reference"]
    wrong = found(late)
    assert wrong.status == "ok"  # it makes deviations wider, and none wrong
    told = [check for check in wrong.checks if check.about == "reference"]
    assert [(", ".join(check.on), check.verdict) for check in told] == [
        ("r_x", "warning"),
        ("r_y", "warning"),
    ]
    assert all(re.search(" (9|10|11) samples: it is late by as much", c.found) for c in told)
