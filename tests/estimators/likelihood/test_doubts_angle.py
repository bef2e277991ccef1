"""The rotation against the angle that was given."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import adverse
import numpy as np
import pytest
from severities import doubting, rejecting
from test_spectra import KNOWN, MODEL, RATE, SPEED, TRUTH, levitated

import rotorid as rid
from rotorid import MaximumLikelihood, identify
from rotorid.answer.machine_checks import agreement
from rotorid.likelihood import doubts_angle as turning
from rotorid.likelihood.doubts_angle import _strays
from rotorid.testing import bind_all

# The rotation against the angle that was given: slow creep, steps, and no false alarm.


def made(kind: str, seed: int, factor: float = 1.0) -> adverse.Trial:
    """Return a trial whose rotor turns this much faster than is said."""
    trial = adverse.new_trial(kind, np.random.default_rng([seed, 77]))
    trial.rotation *= factor
    adverse.measure(trial)
    return trial


def errors(trial: adverse.Trial, estimate: rid.Estimate) -> float:
    return adverse.outcome(estimate, trial.machine.truth).error


@pytest.mark.parametrize("kind", ["rigid", "three"])
def test_a_creep_is_told_with_the_speed_and_widens_the_deviations(kind: str) -> None:
    """8400 rpm turn as 8399.75: a twentieth of a radian over 2 s."""
    trial = made(kind, 1, 1 - 3e-5)
    estimate = adverse.estimate_of(trial)
    assert estimate.status == "ok"
    (told,) = [w for w in estimate.warnings if w.startswith("speed: ")]
    speed, off = (float(number) for number in re.findall(r"[\d.]+", told)[:2])
    assert "not 8400" in told
    assert abs(speed - 8399.748) < 4 * off < 0.3
    assert errors(trial, estimate) < 4
    right = adverse.estimate_of(made(kind, 1))
    assert not [w for w in right.warnings if w.startswith("speed: ")]
    assert estimate.std("xi") > 2 * right.std("xi")


def test_a_creep_that_costs_amplitude_is_rejected() -> None:
    estimate = adverse.estimate_of(made("rigid", 2, 1 - 2e-4))
    assert estimate.status == "rejected"
    assert [w for w in estimate.warnings if w.startswith("speed: the unbalance turns with 8398.")]


def creep(rate: float, std: float, step: float = 0.0, periods: int = 100) -> turning.Creep:
    """Return a creep and a step of deviation one."""
    return turning.Creep(rate, std, step, 1.0, 1, periods, 0.0)


def test_from_where_on_the_rotation_moves_against_its_angle() -> None:
    assert [creep(-x, 1.0).creeps for x in (3.4, 3.6)] == [False, True]
    assert [creep(-x, 1.0).strays for x in (5.9, 6.1)] == [False, True]
    # .155 rad over the record cost a thousandth of the unbalance's line.
    assert [creep(x / 100, 1e-9).strays for x in (-0.154, 0.156)] == [False, True]
    assert [creep(0.0, 1.0, -x).jumps for x in (7.9, 8.1)] == [False, True]


@pytest.mark.parametrize(("periods", "asked"), [(7, False), (8, True)])
def test_eight_periods_tell_a_slope_from_scatter(periods, asked) -> None:
    seen = []
    at = SimpleNamespace(
        ends=None, loads=0, whitened_loads=lambda loads: seen.append(1) or np.zeros(4)
    )
    lines = SimpleNamespace(scatter=np.zeros(1), periods=periods, frequency=np.ones(4))
    record = SimpleNamespace(lines=lines, periodic=SimpleNamespace(speed=100.0))
    assert turning._creep(at, record) is None  # nothing turns here
    assert bool(seen) == asked


def test_a_step_between_mark_and_columns_is_rejected() -> None:
    """A quarter of a sample lost in the angle's column only: 3 degrees from half-way on."""
    trial = made("rigid", 3)
    record = adverse.record_of(trial)
    angle = record.speed * np.arange(len(record.samples)) / adverse.RATE
    half = len(angle) // 2
    moved = np.where(np.arange(len(angle)) < half, angle, angle + 0.05)
    wrapped = moved % (2 * np.pi)
    for wanted, column in (("ok", angle), ("rejected", moved), ("rejected", wrapped)):
        told = rid.Record(record.channels, record.samples, adverse.RATE, record.speed, angle=column)
        periods = rid.average(told, adverse.FUNDAMENTAL, harmonics=trial.harmonics)
        fixed = {"L_a": trial.machine.truth["L_a"]}
        estimator = rid.MaximumLikelihood(fixed=fixed, start=trial.machine.truth)
        estimate = rid.identify(trial.machine.model, periods, estimator)
        assert estimate.status == wanted
    (said,) = [w for w in estimate.warnings if "jumps by" in w]
    assert 2 < float(said.split()[4].removeprefix("-")) < 4
    assert "samples were lost between the mark and the columns" in said


def test_slope_and_step_by_hand() -> None:
    angles = 0.01 * np.arange(20.0) + np.where(np.arange(20) >= 12, 0.5, 0.0)
    creep = turning._fitted(angles - angles.mean(), 0.001, 10.0)
    assert creep.place == 12
    assert creep.step == pytest.approx(0.5)
    straight = turning._fitted(0.01 * np.arange(20.0), 0.1, 30.0)
    assert straight.rate == pytest.approx(0.01)
    assert straight.std == pytest.approx(0.1 / np.sqrt(20 * (400 - 1) / 12))
    assert straight.angle == pytest.approx(0.3)
    assert not straight.creeps


def test_what_neither_slope_nor_step_explains_is_no_speed() -> None:
    """A tone between the lines turns the line of the rotation to and fro."""
    periodic = SimpleNamespace(time=np.zeros((40, 1)), speed=100.0, fundamental=10.0)
    record = SimpleNamespace(periodic=periodic)
    place = np.arange(40.0)
    noise = np.where(place % 2 == 0, 1.0, -1.0)
    for size, words in ((4.5, "the unbalance turns"), (5.5, "a tone between the lines")):
        creep = turning._fitted(3.0 * (place - 19.5) + size * noise, 1.0, 20.0)
        assert creep.strays
        assert words in turning.told(record, creep)
    straight = turning._fitted(3.0 * (place - 19.5) + noise, 1.0, 20.0)
    assert straight.scatter == pytest.approx(1.0, rel=0.05)


def test_no_creep_without_turning_or_with_few_periods() -> None:
    trial = made("rigid", 4)
    for name, samples in trial.columns.items():
        trial.columns[name] = samples[: 7 * trial.size]
    estimate = adverse.estimate_of(trial)
    assert estimate.status == "ok"


@pytest.mark.slow
def test_creeps_of_good_records_are_standard_normal(monkeypatch: pytest.MonkeyPatch) -> None:
    from good_records import good_record

    from rotorid.likelihood import fit

    found: list[float] = []

    def seen(*args: object) -> tuple[turning.Creep | None, ...]:
        creeps = turning.creeps(*args)  # type: ignore[arg-type]
        found.extend(c.rate / c.std for c in creeps if c is not None)
        return creeps

    monkeypatch.setattr(fit, "creeps", seen)
    for kind in ("jeffcott", "rigid", "three", "rig"):
        for seed in range(40):
            good = good_record(kind, 5000 + seed)
            rid.identify(good.model, good.records(), good.estimator)
    assert len(found) == 160
    assert 0.85 < np.std(found) < 1.15
    assert np.abs(found).max() < 4


# A speed that changes by a ten-thousandth within a whole record turns the unbalance.


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


# Halves of a record against each other, their loads by the rotor angle in each.


ROTATION = 7  # the line of the rotation, 140 Hz


def turned(turning_record, degrees: float):
    """Let the rotation's line turn from period to period, by so much in all, forwards."""
    phase = np.radians(degrees) * (np.arange(turning_record.periods) / turning_record.periods - 0.5)
    spectra = turning_record.spectra.copy()
    spectra[:, list(turning_record.harmonics).index(ROTATION)] *= np.exp(1j * phase)[:, None]
    return replace(turning_record, spectra=spectra)


def stated(turning_record, degrees: float):
    """State a speed with which the rotor turns further by so much over the record."""
    share = (turning_record.time / turning_record.time.max()) - 0.5
    return replace(turning_record, angle=turning_record.angle + np.radians(degrees) * share)


@pytest.fixture
def turning_record(demo):
    """The demonstration without force at the speed of rotation, where only unbalance acts."""
    lines = [k for k in demo.harmonics if k != ROTATION]
    clean = demo.record(harmonics=demo.harmonics)
    still = demo.record(harmonics=demo.harmonics, amplitude=1e-9)
    spectra, at = clean.spectra.copy(), list(clean.harmonics).index(ROTATION)
    spectra[:, at] = still.spectra[:, at]
    assert len(lines) == 5
    return demo.noisy(replace(clean, spectra=spectra), np.random.default_rng(8))


@pytest.mark.slow
def test_a_speed_that_is_off_by_a_hundred_thousandth_is_told(demo, turning_record):
    found = identify(demo.model, stated(turning_record, 6.0), MaximumLikelihood())
    assert found.misfit.p_value > 1e-3  # no misfit of the mean shows it
    assert [w for w in found.warnings if w.startswith("speed: the unbalance turns with")]
    right = identify(demo.model, turning_record, MaximumLikelihood())
    assert right.status == "ok"
    # The angle is no better known than by its creep, and the deviations know it.
    assert found.std("xi") > 3 * right.std("xi")
    (told,) = agreement(["xi"], np.array([[-7.0], [7.0]]), np.ones(1), {"xi"})
    assert "the speed is not the one stated, or wanders" in told.text


@pytest.mark.slow
def test_a_rotation_that_turns_as_stated_is_no_matter(demo, turning_record):
    """Two degrees: less than what the checks of the rotation's line take for a wandering speed."""
    found = identify(demo.model, turned(stated(turning_record, 2.0), 2.0), MaximumLikelihood())
    assert not [w for w in found.warnings if w.startswith("the halves of the record differ")]
    other = identify(demo.model, turned(turning_record, 6.0), MaximumLikelihood())
    assert [w for w in other.warnings if w.startswith("speed: the unbalance turns with")]
