"""Channels that stay at their last value, exactly or to the last digit, where nothing repeats."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from rotorid import Channel, Note, Record, average
from rotorid.signals.checks.registry import check_record, check_whole

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
