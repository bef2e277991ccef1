"""One wrong speed among several records: the record is named, and its own speed told."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.estimate_parts import Suspect
from rotorid.estimators import MaximumLikelihood
from rotorid.estimators.likelihood import leads, suspects
from rotorid.identify import identify
from rotorid.models import load_model
from rotorid.rig.lines import add_noise, line_record

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


def said_to_turn_at(*speeds: float):
    return [SimpleNamespace(lines=SimpleNamespace(speed=np.full(3, speed))) for speed in speeds]


def test_the_speeds_of_all_records_and_of_single_ones():
    found = leads._speeds(said_to_turn_at(100.0, 200.0), {1: [300.0]})
    assert {lead.term for lead in found} == {"speed", "speed[1]"}
    backwards = [lead for lead in found if lead.said.endswith("turning the other way")]
    assert [lead.value for lead in backwards] == [None, -200.0]
    assert "-954.93, -1909.86 rpm one after the other would do" in backwards[0].cure
    assert {lead.value for lead in found if "which the data show" in lead.said} == {300.0, -300.0}
    # What the lines show of one record is no speed of all.
    assert all(lead.term == "speed[1]" for lead in found if "which the data show" in lead.said)


def test_a_record_that_stood_still_may_have_turned():
    found = leads._speeds(said_to_turn_at(0.0, 200.0), {0: [300.0]})
    assert [lead.value for lead in found if lead.term == "speed[0]"] == [300.0, -300.0]


def test_speeds_are_asked_of_the_four_records_that_fit_worst():
    costs = (1.0, 6.0, 2.0, 5.0, 4.0, 3.0)
    lines = SimpleNamespace(frequency=np.array([10.0, 20.0, 30.0]), speed=np.full(3, 100.0))
    point = SimpleNamespace(
        records=[SimpleNamespace(line_costs=np.array([0.0, 1.0, 2.0]) * cost) for cost in costs]
    )
    case = SimpleNamespace(records=[SimpleNamespace(lines=lines)] * 6, point=point)
    found = suspects._Search(None, case, np.zeros(0), None, 1.0).speeds()
    assert list(found) == [1, 3, 4, 5]
    # 100 rad/s lie nearest to 20 Hz; the worst lines are those of 30 and 20 Hz.
    assert found[1] == pytest.approx([2 * np.pi * 20.0, 2 * np.pi * 30.0])


@pytest.mark.parametrize(("apart", "value"), [(0.9e-3, 100.0), (1.1e-3, None)])
def test_speeds_that_fit_alike_are_no_speed(apart, value):
    found = [
        suspects.Finding(Suspect("speed[2]", 1e6, 1.0, size, "rad/s"), left, "a", "b", exact=True)
        for size, left in ((100.0, 70.0), (100.0 * (1 - apart), 70.5), (50.0, 200.0))
    ]
    first = suspects._one_speed(found, 60.0)[0]
    assert first.suspect.value == value
    assert ("another speed of record 3 than the one given" in first.said) == (value is None)
    assert ("rotorid inspect" in first.cure) == (value is None)
