"""One wrong speed among several records: the record is named, and its own speed told."""

from dataclasses import replace

import numpy as np
import pytest

from rotorid import MaximumLikelihood, identify, load_model
from rotorid.testing import add_noise, line_record

TRUTH = {"m": 2.0, "c": 30.0, "k": 2e5, "xi": 2e-5, "zeta": 1e-5}
MODEL = load_model("jeffcott")
NOISE = {"F_x": 0.02, "F_y": 0.02, "x": 1e-7, "y": 1e-7}


@pytest.fixture(scope="module")
def records():
    """Records at 20, 30 and 40 Hz, whose lines stand at 10 to 70 Hz."""
    rng = np.random.default_rng(8)
    found = []
    for hertz in (20.0, 30.0, 40.0):
        clean = line_record(
            MODEL,
            MODEL.values({**MODEL.nominal, **TRUTH}),
            np.array([[3 - 4j, 5], [5j, 4 - 3j], [4, -5j], [-3j, 4], [5, 3j], [2j, -4]]),
            harmonics=(1, 2, 3, 4, 5, 7),
            fundamental=10.0,
            sample_rate=2000.0,
            periods=40,
            speed=2 * np.pi * hertz,
        )
        found.append(add_noise(clean, NOISE, rng))
    return found


def told_otherwise(record, hertz):
    """Return a record that is said to have turned at another speed."""
    speed = 2 * np.pi * hertz
    return replace(record, speed=speed, angle=np.asarray(record.time) * speed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "hertz", "words"),
    [
        (2, -40.0, "the rotor of record 3 turning the other way"),
        (1, 30 * np.pi / 30, "speed of record 2"),  # rad/s taken for rpm
        (0, 30.0, "a speed of record 1 of 1200 rpm, which the data show"),
    ],
)
def test_the_record_with_a_wrong_speed_is_named(records, number, hertz, words):
    given = [told_otherwise(r, hertz) if k == number else r for k, r in enumerate(records)]
    estimate = identify(MODEL, given, MaximumLikelihood())
    first = estimate.suspects[0]
    assert (first.term, first.unit) == (f"speed[{number}]", "rad/s")
    assert first.value == pytest.approx(records[number].speed, rel=1e-6)
    assert words in estimate.warnings[0]
    assert f"{records[number].speed * 30 / np.pi:.6g} rpm would do" in estimate.warnings[0]
