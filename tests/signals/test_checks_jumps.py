"""Samples that are missing in the middle of a whole record."""

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid
from rotorid import Channel, Note, Record
from rotorid.signals.checks.registry import check_whole

CHANNELS = [Channel("F", "N"), *(Channel(f"x{k}", "m") for k in range(4))]


def found(samples: np.ndarray, channels: list[Channel] = CHANNELS) -> list[Note]:
    record = Record(channels, samples, 1000.0)
    return [c for c in check_whole(record, record.channels, ()) if c.about == "lost samples"]


def resting(size: float, columns: tuple[int, ...] = (1, 2, 3, 4), count: int = 400) -> np.ndarray:
    """Return positions of noise that is one at every second difference, with a jump."""
    noise = np.resize([0.0, 1.0], (count, 1)) / 2 * np.ones(5)
    noise[count // 2 :, list(columns)] += size
    return noise


def test_how_large_a_jump_is() -> None:
    """What is usual is one: steps of a half, forth and back, differ by one from their neighbours.

    The jump is the other way than such a step.
    """
    assert not found(resting(8.9))
    (told,) = found(resting(9.1))
    assert (told.about, told.verdict) == ("lost samples", "warning")
    assert told.found.startswith(
        "4 positions jump within a sample at 0.1995 s: samples are missing"
    )


def test_it_takes_half_of_the_positions_and_two() -> None:
    assert not found(resting(90.0, (1,)))
    assert found(resting(90.0, (1, 2)))
    more = [*CHANNELS, Channel("x4", "m")]
    samples = np.column_stack([resting(90.0, (1, 2)), resting(0.0)[:, 1]])
    assert not found(samples, more)
    two = [Channel("x", "m"), Channel("y", "m")]
    assert not found(resting(90.0, (1,))[:, :2], two)
    assert not found(resting(90.0), [Channel(c.name, "N") for c in CHANNELS])


def test_what_is_usual_is_told_by_what_lies_around() -> None:
    """Of fifty samples on each side: what is loud farther away does not count."""
    for quiet, told in ((46, False), (54, True)):
        samples = resting(0.0, count=1000)
        samples[np.abs(np.arange(1000) - 499.5) > quiet] *= 30.0
        samples[500:] += 61.0
        assert bool(found(samples)) == told
    assert not found(resting(90.0, count=199))
    assert found(resting(90.0, count=200))


@pytest.mark.slow
def test_a_gap_in_a_whole_record_is_told() -> None:
    record = levitated(1)
    samples = np.delete(record.samples, slice(12345, 12365), axis=0)
    torn = rid.Record(record.channels, samples, record.sample_rate, record.speed)
    answer = rid.identify(MODEL, rid.spectra(torn, (2.0, 120.0), references=["r_x", "r_y"]), KNOWN)
    assert answer.status == "rejected"
    assert any("2 positions jump within a sample at 2.4689 s: " in w for w in answer.warnings)


@pytest.mark.parametrize("seed", range(4))
def test_a_whole_record_without_a_gap(seed: int) -> None:
    record = levitated(seed, 2.0)
    assert not found(record.samples, list(record.channels))
