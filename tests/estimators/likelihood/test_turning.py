"""The rotation against the angle that was given: slow creep, steps, and no false alarm."""

import re
from types import SimpleNamespace

import adverse
import numpy as np
import pytest
from adverse import FUNDAMENTAL, RATE, TURN

import rotorid as rid
from rotorid.likelihood import doubts_angle as turning


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
    angle = record.speed * np.arange(len(record.samples)) / RATE
    half = len(angle) // 2
    moved = np.where(np.arange(len(angle)) < half, angle, angle + 0.05)
    wrapped = moved % (2 * np.pi)
    for wanted, column in (("ok", angle), ("rejected", moved), ("rejected", wrapped)):
        told = rid.Record(record.channels, record.samples, RATE, record.speed, angle=column)
        periods = rid.average(told, FUNDAMENTAL, harmonics=trial.harmonics)
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
    assert pytest.approx(2 * np.pi) == TURN


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
