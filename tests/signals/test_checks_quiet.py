"""A quiet record is held against the one it goes with, by what the unbalance does in both."""

from dataclasses import replace

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, SPEED, levitated

import rotorid as rid
from rotorid import Channel
from rotorid.signals.checks.references import DrivenMotion, check_quiet

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
