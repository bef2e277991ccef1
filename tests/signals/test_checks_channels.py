"""Channels before any model: that stay at their last value, that jump, and tables of phasors."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid
from rotorid import Channel, Note, Record, average
from rotorid.signals.checks.channels import check_phases, check_probes
from rotorid.signals.checks.registry import check_record, check_whole

# -------------------------------------------------------------------------------------------------
# Channels that stay at their last value, exactly or to the last digit, where nothing repeats.


COUNT, FIRST, AFTER = 6000, 2000, 3000
PLAY = np.resize([0, 1, 0, -1], AFTER - FIRST)


def slanted(steps: int) -> np.ndarray:
    """Return counts that rise and fall by so many a sample, with a last digit of their own."""
    n = np.arange(COUNT)
    return (steps * (200 - np.abs(n % 400 - 200)) + n // 50 % 2).astype(float)


def stopped(samples: np.ndarray, play: np.ndarray | float = 0.0) -> np.ndarray:
    found = samples.copy()
    found[FIRST + 107 : AFTER] = samples[FIRST + 106] + np.resize(play, AFTER - FIRST - 107)
    return found


def checks(samples: np.ndarray, unit: str = "m", *, steady: bool = False) -> list[Note]:
    record = Record([Channel("c", unit)], samples[:, None], 1000.0)
    periods = average(record, period_samples=3000, harmonics=[1]) if steady else None
    return of(check_record(record, periods), "stuck")


def of(notes: Iterable[Note], about: str) -> list[Note]:
    return [note for note in notes if note.about == about and note.severity != "passes"]


def verdict(samples: np.ndarray, unit: str = "m", *, steady: bool = False) -> str:
    found = checks(samples, unit, steady=steady)
    return found[0].verdict if found else "ok"


@pytest.mark.parametrize("play", [0.0, PLAY])
def test_a_sensor_stops_out_of_full_motion(play: np.ndarray | float) -> None:
    """What comes to rest by and by may rest, where nothing has to repeat."""
    found = [verdict(stopped(slanted(steps), play)) for steps in (9, 12)]
    assert found == ["note", "refused"]
    assert verdict(stopped(slanted(9)), steady=True) == "refused"
    (check,) = checks(stopped(slanted(12), play))
    assert "from 2.106 to 3 s" in check.found
    assert "use the part in which it moves" in check.found


def test_the_last_digit_may_play() -> None:
    """Three levels are a last digit, four are none."""
    moving = slanted(30)
    assert verdict(stopped(moving, np.resize([0, 1, -1], 5))) == "refused"
    assert verdict(stopped(moving, np.resize([0, 1, -1, 2], 5))) == "ok"
    # Without steps it is a ten-thousandth of the deviation, times two and a half.
    smooth = np.sin(np.arange(COUNT) / 5.0) + 1e-9 * np.random.default_rng(1).random(COUNT)
    play = smooth.std() * np.resize([-0.5, 0.5], 2)
    assert verdict(stopped(smooth, 2.2e-4 * play)) == "refused"
    assert verdict(stopped(smooth, 2.7e-4 * play)) == "ok"


def held(part: float, level: float) -> np.ndarray:
    """Return a drive that changes in a part of its samples, and stops at a level."""
    rng = np.random.default_rng(2)
    changes = rng.random(COUNT) < part
    noise = rng.standard_normal(COUNT)[
        np.maximum.accumulate(np.where(changes, np.arange(COUNT), 0))
    ]
    noise = (noise - noise.mean()) / noise.std()
    noise[FIRST:AFTER] = level
    return noise


def test_a_drive_stops_where_it_does_not_belong() -> None:
    """It rests at its mean; and one of steps rests aside of that between them."""
    assert [verdict(held(1.0, level), "N") for level in (0.15, 0.25)] == ["note", "warning"]
    assert [verdict(held(part, 1.0), "N") for part in (0.45, 0.55)] == ["note", "warning"]
    record = Record([Channel("r")], held(1.0, 1.0)[:, None], 1000.0)
    (check,) = check_whole(record, (), ("r",))
    assert (check.about, check.verdict) == ("stuck reference", "warning")


@pytest.mark.parametrize(("levels", "told"), [(3, "warning"), (4, "note")])
def test_a_channel_whose_last_digit_is_all_that_moves(levels: int, told: str) -> None:
    samples = 4e-6 + 1e-7 * np.random.default_rng(3).integers(0, levels, COUNT)
    record = Record([Channel("x", "m")], samples[:, None], 1000.0)
    assert [check.verdict for check in of(check_record(record), "quantized")] == [told]
    assert not of(check_record(record), "stuck")
    force = replace(record, channels=(Channel("F", "N"),))
    assert [check.verdict for check in of(check_record(force), "quantized")] == ["note"]


# -------------------------------------------------------------------------------------------------
# Samples that are missing in the middle of a whole record.


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


# -------------------------------------------------------------------------------------------------
# What a table of phasors shows before any model, at the limits.


def probed(phasors: list[complex], std: float | None = None) -> list[tuple[str, str]]:
    column = np.array(phasors, dtype=np.complex128)[:, None]
    deviation = None if std is None else np.full(column.shape, std)
    return [(c.about, c.verdict) for c in check_probes(["x"], column, deviation)]


def test_a_probe_that_reads_nothing_or_ever_the_same() -> None:
    assert probed([0, 0]) == [("dead", "refused")]
    assert probed([0, 1]) == []
    assert probed([1j, 1j, 1j]) == [("dead", "refused")]
    assert probed([1j, 1j]) == []  # two rows may well agree


@pytest.mark.parametrize(("highest", "silent"), [(2.8, True), (3.2, False)])
def test_a_probe_that_does_not_rise_above_its_noise(highest: float, silent: bool) -> None:
    assert probed([1, 1.1j, highest], 1.0) == ([("silent", "warning")] if silent else [])
    assert probed([1, 1.1j, highest]) == []


@pytest.mark.parametrize(
    ("phases", "degrees", "verdicts"),
    [
        ([0.0, 1.0, 1.4], True, []),
        ([0.0, 1.0, 1.6], True, ["warning"]),
        ([0.0, 1.6], True, []),  # two rows say little
        ([0.0, 3.0, 6.2], True, ["warning"]),
        ([0.0, 3.0, 6.4], True, []),
        ([0.0, 3.0, 12.4], False, []),
        ([0.0, 3.0, 12.7], False, ["refused"]),
        ([0.0, -12.7], False, ["refused"]),
    ],
)
def test_phases_that_are_hardly_in_their_unit(
    phases: list[float], degrees: bool, verdicts: list[str]
) -> None:
    checks = check_phases("x", np.array(phases), degrees=degrees)
    assert [c.verdict for c in checks] == verdicts
