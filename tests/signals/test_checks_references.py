"""What is added to a command moves the machine later, never earlier."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, SPEED, levitated

import rotorid as rid
from rotorid import Channel
from rotorid.signals.checks.references import DrivenMotion, check_quiet, check_references

# -------------------------------------------------------------------------------------------------
# What is added to a command moves the machine later, never earlier.


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


# -------------------------------------------------------------------------------------------------
# A quiet record is held against the one it goes with, by what the unbalance does in both.


CHANNELS = [Channel("F", "N"), Channel("x", "m")]


def motion(
    size: float, noise: float = 1.0, place: float = 50.0, driven: float = 0.0
) -> DrivenMotion:
    """Return lines of which the rotation is one, in the second channel, beside noise and a wave."""
    rng = np.random.default_rng(1)
    turning = np.zeros((200, 2), dtype=np.complex128)
    turning[round(place), 0] = 1.0
    wave = rng.standard_normal((200, 1, 2)) @ np.array([1, 1j])
    channels = noise * (rng.standard_normal((200, 2, 2)) @ np.array([1, 1j])) / np.sqrt(2)
    channels[round(place)] = 0.0
    channels[:, 1:] += size * turning[:, :1] + driven * wave * np.linspace(1, 2, 200)[:, None]
    return DrivenMotion(channels, wave, turning, place)


def found(record: DrivenMotion, quiet: DrivenMotion, other: float = SPEED) -> list[str]:
    return [", ".join(check.on) for check in check_quiet(CHANNELS, record, quiet, (SPEED, other))]


def test_the_size_of_the_rotation_and_its_deviation() -> None:
    size, std = motion(100.0, driven=1e3).turning()
    assert size[1] == pytest.approx(100.0, abs=2.0)
    assert 0.5 < std[1] < 1.5
    assert motion(1.0, place=12.0).turning() is None
    assert motion(1.0, place=13.0).turning() is not None
    assert motion(1.0, place=187.0).turning() is not None
    assert motion(1.0, place=188.0).turning() is None


def test_a_rotation_that_differs_is_told() -> None:
    assert not found(motion(1e4), motion(0.71e4))
    assert found(motion(1e4), motion(0.69e4)) == ["x"]
    assert found(motion(0.69e4), motion(1e4)) == ["x"]
    # Not where noise may have done it: two deviations of about one each.
    _, std = motion(0.0).turning()
    sure = 6 * np.sqrt(2) * std[1]
    assert not found(motion(1.02 * sure), motion(0.1 * sure))
    assert found(motion(1.12 * sure), motion(0.1 * sure)) == ["x"]


def test_speeds_that_are_stated_apart_are_told() -> None:
    assert not found(motion(1e4), motion(1e4), 1.049 * SPEED)
    assert found(motion(1e4), motion(1e4), 1.051 * SPEED) == [""]
    assert found(motion(1e4), motion(1e4), 0.0) == [""]


def lines(quiet: rid.Record) -> rid.Lines:
    return rid.spectra(levitated(1), (2.0, 120.0), references=["r_x", "r_y"], quiet=quiet)


@pytest.mark.slow
def test_a_quiet_record_at_standstill_that_is_said_to_turn() -> None:
    quiet = levitated(2, excitation=0.0)
    assert not lines(quiet).checks
    rng = np.random.default_rng(1)
    still = quiet.samples.std(axis=0) * 0.1 * rng.standard_normal(quiet.samples.shape)
    wrong = replace(quiet, samples=still)
    answer = rid.identify(MODEL, lines(wrong), KNOWN)
    (told,) = [check for check in answer.checks if check.about == "quiet"]
    assert told.verdict == "warning"
    assert "one of the two was taken at another speed than stated" in told.found
    assert told.found.endswith("at the speed and under the control of the record")


@pytest.mark.slow
def test_the_record_is_not_its_own_quiet_record() -> None:
    with pytest.raises(rid.InputError, match="name the file that was recorded without excitation"):
        lines(levitated(1))
