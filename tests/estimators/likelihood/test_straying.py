"""A speed that changes by a ten-thousandth within a whole record turns the unbalance."""

import re
from dataclasses import replace

import numpy as np
import pytest
from severities import doubting, rejecting
from test_spectra import KNOWN, MODEL, RATE, SPEED, TRUTH, levitated

import rotorid as rid
from rotorid.data.observation import bind_all
from rotorid.likelihood.doubts_angle import _strays


@pytest.fixture(scope="module")
def record() -> rid.Record:
    return levitated(3)


def answer(record: rid.Record, angle: np.ndarray | None = None, **changed: object) -> rid.Estimate:
    """Identify a record of which another angle is stated; at a constant speed it is true."""
    given = replace(record, angle=angle, **changed)
    return rid.identify(MODEL, rid.spectra(given, (2.0, 200.0), references=["r_x", "r_y"]), KNOWN)


def bent(record: rid.Record, size: float) -> np.ndarray:
    """Return the angle of a speed that falls by a part over the record, where it is said to be."""
    time = np.arange(len(record.samples)) / RATE
    return SPEED * time + size * SPEED * time * (time[-1] - time) / (2 * time[-1])


def strays(found: rid.Estimate) -> list[str]:
    return [text for text in found.warnings if "strays from its angle" in text]


@pytest.mark.slow
def test_a_drift_that_the_halves_do_not_tell_is_told(record: rid.Record) -> None:
    right = answer(record)
    assert right.status == "ok"
    assert not strays(right)
    wrong = answer(record, bent(record, 2e-4))
    assert abs(wrong.value("zeta") - TRUTH["zeta"]) > 6 * wrong.std("zeta")
    assert wrong.misfit.p_value > 1e-3
    assert not [text for text in wrong.warnings if "halves of the record" in text]
    assert wrong.status == "rejected"
    (told,) = strays(wrong)
    degrees = float(re.findall(r"by ([\d.]+) degrees", told)[0])
    assert degrees == pytest.approx(np.degrees(2e-4 * SPEED * 5 / 8), rel=0.2)
    assert told.endswith("check the mark of the angle, its lines and its column")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_each_shape_is_told(record: rid.Record, order: int) -> None:
    count = len(record.samples)
    shape = np.polynomial.Legendre.basis(order)(np.linspace(-1, 1, count))
    (told,) = strays(answer(record, SPEED * np.arange(count) / RATE + 0.02 * shape))
    degrees = float(re.findall(r"by ([\d.]+) degrees", told)[0])
    assert degrees == pytest.approx(np.degrees(0.02 * np.ptp(shape)), rel=0.2)


def test_the_speeds_of_a_drift_are_told(record: rid.Record) -> None:
    """Stated is a constant speed; the rotation itself is moved, by the time that samples take."""
    time = np.arange(len(record.samples)) / RATE
    late = np.interp(time + 5e-5 * time * (time - time[-1]) / time[-1], time, np.arange(len(time)))
    whole = np.floor(late).astype(int)
    share = (late - whole)[:, None]
    after = np.minimum(whole + 1, len(time) - 1)
    samples = (1 - share) * record.samples[whole] + share * record.samples[after]
    found = answer(replace(record, samples=samples))
    (told,) = strays(found)
    first, last, stated = map(float, re.findall(r"\d{4}\.\d+|\d{4}", told))
    assert stated == pytest.approx(SPEED * 30 / np.pi, abs=1e-3)
    assert last - first == pytest.approx(1e-4 * stated, rel=0.3)
    assert "record a mark" in told


@pytest.mark.parametrize(
    ("chance", "moved", "size", "faults", "doubts"),
    [
        (0.9e-6, 1.1, 0.1, 1, 0),
        (1.1e-6, 1.1, 0.1, 0, 1),
        (0.9e-4, 1.1, 0.1, 0, 1),
        (1.1e-4, 1.1, 0.1, 0, 0),
        (1e-9, 0.9, 0.1, 0, 0),
        (1e-9, 9.0, 0.49, 1, 0),
        (1e-9, 9.0, 0.51, 0, 0),
    ],
)
def test_what_is_told_and_what_is_sure(
    record: rid.Record,
    chance: float,
    moved: float,
    size: float,
    faults: int,
    doubts: int,
) -> None:
    (bound,) = bind_all(MODEL, [rid.spectra(record, (2.0, 20.0), references=["r_x", "r_y"])])
    judged = list(_strays(bound, np.array([size, 0.0, 0.0]), chance, moved))
    assert (len(rejecting(judged)), len(doubting(judged))) == (faults, doubts)
