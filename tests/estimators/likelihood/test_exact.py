"""What is taken as exact without a word, held against records in which it is not."""

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from rotorid import Estimate, MaximumLikelihood, PeriodicRecord, identify, load_model
from rotorid.core.distributions import Expectation
from rotorid.core.units import to_si
from rotorid.core.values import Floats
from rotorid.likelihood.doubts import unseen_excess
from rotorid.likelihood.unknowns import TAKEN_AS_EXACT
from rotorid.testing import add_noise, line_record

FIXED = {"L1": 0.3}
SIZES = {"runout": (1e-6, "m"), "rotor angle": (np.pi / 180, "rad"), "delay": (1e-5, "s")}
Edit = Callable[[PeriodicRecord], PeriodicRecord]


def notes(found: Estimate) -> dict[str, tuple[str, float]]:
    """Return the parameter and the deviations of each note of what is taken as exact."""
    assert found.status == "ok"
    pattern = re.compile(r"assumed (?:zero|exact): .* would shift (\w+) by ([\d.]+) std unseen; ")
    told = {c.about: pattern.match(c.text) for c in found.checks if c.verdict == "note"}
    assert all("e+" not in m[2] for m in told.values() if m)
    return {check: (m[1], float(m[2])) for check, m in told.items() if m}


def quieter(levitated, factor: float):
    machine = levitated.machine
    less = (machine.force_noise * factor, machine.position_noise * factor)
    machine = replace(machine, force_noise=less[0], position_noise=less[1])
    return replace(levitated, machine=machine, runout={})


def recorded(rig, *speeds: float, drives: bool = True) -> list[PeriodicRecord]:
    rng = np.random.default_rng(36)
    return [rig.noisy(rig.record(s, drives=drives), rng) for s in speeds]


def disc() -> PeriodicRecord:
    """A record of one disc on a shaft, two forces and two sensors."""
    model = load_model("jeffcott")
    values = model.values(model.nominal)
    forces = np.full((5, 1), 4 - 3j) * np.array([1.0, 0.6j])
    free = line_record(
        model,
        values,
        forces,
        harmonics=[1, 3, 5, 7, 9],
        fundamental=10.0,
        sample_rate=5000.0,
        periods=200,
        speed=2 * np.pi * 50,
    )
    noise = {"F_x": 1.0, "F_y": 1.0, "x": 2e-6, "y": 2e-6}
    return add_noise(free, noise, np.random.default_rng(4))


def out_of_round(channel: str, size: complex) -> Edit:
    def edit(record: PeriodicRecord) -> PeriodicRecord:
        spectra = record.spectra.copy()
        spectra[:, list(record.harmonics).index(5), record.index(channel)] += size / 2
        return replace(record, spectra=spectra)

    return edit


def louder(channel: str, share: float) -> Edit:
    def edit(record: PeriodicRecord) -> PeriodicRecord:
        spectra = record.spectra.copy()
        spectra[:, :, record.index(channel)] *= 1 + share
        return replace(record, spectra=spectra)

    return edit


def found_after(edits: list[Edit]) -> tuple[Floats, float]:
    """Return values and cost of the disc's record with errors."""
    record = disc()
    for edit in edits:
        record = edit(record)
    found = identify(load_model("jeffcott"), record, "ml")
    assert found.misfit is not None
    return np.array([p.value for p in found.parameters]), found.misfit.cost


@pytest.mark.slow
@pytest.mark.parametrize("check", ["runout", "gain"])
def test_the_worst_unseen_error_is_what_refits_say(check: str) -> None:
    """The estimates' shifts, and the quadratic form of the cost, by identifying again."""
    h = 0.02  # of the plausible size: in the linear range
    units: list[Callable[[float], Edit]] = [
        lambda s, c=c, way=way: out_of_round(c, s * h * 1e-6 * way)
        for c in ("x", "y")
        for way in (1, -1j)
    ]
    if check == "gain":
        units = [lambda s, c=c: louder(c, s * h * 0.01) for c in ("F_x", "F_y", "x", "y")]
    count = len(units)

    def both(edits: list[Callable[[float], Edit]]) -> tuple[Floats, float]:
        (plus, up), (minus, down) = (found_after([e(s) for e in edits]) for s in (1.0, -1.0))
        return (plus - minus) / (2 * h), (up + down - 2 * still) / (2 * h**2)

    still = found_after([])[1]
    single = [both([unit]) for unit in units]
    form = np.diag([cost for _, cost in single])
    for i in range(count):
        for j in range(i):
            cross = both([units[i], units[j]])[1] - single[i][1] - single[j][1]
            form[i, j] = form[j, i] = cross / 2
    moved = np.stack([shift for shift, _ in single], axis=1)
    found = identify(load_model("jeffcott"), disc(), "ml")
    moved /= np.array([[p.std] for p in found.parameters])
    assert found.misfit is not None
    name, size = notes(found)[check]
    # A warning tells below a chance of 1e-3; with 200 periods the cost is chi-squared, nearly.
    mean, dof = found.misfit.expected, found.misfit.dof
    excess = (chi2.isf(1e-3, dof) / dof - 1) * mean
    expected = moved @ np.linalg.solve(np.eye(count) + form / excess, moved.T)
    worst = np.sqrt(np.diag(expected))
    assert name == found.parameters[int(np.argmax(worst))].name
    assert size == pytest.approx(worst.max(), rel=0.06)


@pytest.mark.slow
def test_a_rotor_angle_off_by_what_is_said_moves_the_unbalance_by_what_is_said(levitated) -> None:
    (record,) = recorded(quieter(levitated, 1.0), 140.0)
    model, estimator = levitated.machine.model, MaximumLikelihood(fixed=FIXED)
    found = identify(model, record, estimator)
    name, size = notes(found)["rotor angle"]
    assert record.angle is not None
    turned = replace(record, angle=record.angle + np.pi / 180)
    off = (identify(model, turned, estimator).value(name) - found.value(name)) / found.std(name)
    assert abs(off) == pytest.approx(size, rel=0.06)
    # Where a deviation of it is stated it is covered.
    assert "rotor angle" not in notes(identify(model, replace(record, phase_std=0.02), estimator))


@pytest.mark.slow
def test_a_rotor_angle_that_nobody_asked_for_is_told_where_it_decides_the_deviations() -> None:
    """A keyphasor's angle is known within a sample: that was most of the deviation of xi."""

    def told(std: float) -> list[str]:
        found = identify(load_model("jeffcott"), replace(disc(), phase_std=std), "ml")
        return [c.found for c in found.checks if "angle_lag_std" in c.found]

    (text,) = told(0.01)
    assert re.match(r"known to 0\.57 deg, which is most of the deviations of xi, zeta: ", text)
    assert told(0.0008) == []  # a correlation of .867
    assert len(told(0.0011)) == 1  # .923


def test_what_no_block_tells_does_not_scatter() -> None:
    """The angle of a rejected record is as known beforehand: by 1e-14 deviations it said."""
    record = louder("x", 0.2)(replace(disc(), phase_std=0.01))
    found = identify(load_model("jeffcott"), record, "ml")
    assert found.status == "rejected"
    (text,) = [w for w in found.warnings if "scatter by" in w]
    assert "e-" not in text


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("share", "told"), [(0.8, True), (1.25, False)])
def test_what_moves_nothing_by_a_deviation_is_not_told(levitated, share: float, told: bool) -> None:
    model, estimator = levitated.machine.model, MaximumLikelihood(fixed=FIXED)
    (record,) = recorded(quieter(levitated, 1.0), 140.0)
    _, size = notes(identify(model, record, estimator))["rotor angle"]
    (louder,) = recorded(quieter(levitated, share * size), 140.0)
    assert ("rotor angle" in notes(identify(model, louder, estimator))) is told


@pytest.mark.slow
def test_what_the_records_tell_is_not_unseen(levitated) -> None:
    """Runout is unbalance at one speed, whatever the noise; at two it is a misfit."""
    model, estimator = levitated.machine.model, MaximumLikelihood(fixed=FIXED)
    rig = quieter(levitated, 0.01)
    _, one = notes(identify(model, recorded(rig, 140.0), estimator))["runout"]
    _, two = notes(identify(model, recorded(rig, 140.0, 100.0), estimator))["runout"]
    assert one > 300
    assert two < one / 5
    asked = replace(estimator, runout=True)
    assert "runout" not in notes(identify(model, recorded(rig, 140.0, 100.0), asked))


@pytest.mark.slow
def test_gains_beside_a_scale_that_is_told_differ(levitated) -> None:
    """Where the scale of all forces has a note of its own, the gains' is of what goes beyond it."""
    model, estimator = levitated.machine.model, MaximumLikelihood(fixed=FIXED)
    rig = quieter(levitated, 0.01)
    driven = identify(model, recorded(rig, 140.0), estimator)
    assert [c.about for c in driven.checks].count("force scale") == 1
    assert notes(driven)["gain"][1] < 20
    # Forces as such: a gain of all is the scale, and no misfit shows it.
    measured = identify(model, recorded(rig, 140.0, drives=False), estimator)
    assert "force scale" not in [c.about for c in measured.checks]
    name, size = notes(measured)["gain"]
    assert size > 0.4 * 0.01 * abs(measured.value(name)) / measured.std(name) > 100


def test_unseen_is_what_no_warning_tells() -> None:
    expected = Expectation(mean=30.0, variance=70.0, dof=28)
    excess = unseen_excess(expected)
    assert expected.p_value(30.0 + excess) == pytest.approx(1e-3, rel=1e-4)
    assert unseen_excess(Expectation(0.0, 0.0, 0)) == np.inf


def test_the_sizes_are_what_is_written() -> None:
    for kind in TAKEN_AS_EXACT:
        shown = re.fullmatch(r"assumed (?:zero|exact): (.*) of (?:it|error)", kind.text)
        assert shown is not None
        if kind.about == "gain":
            assert (shown[1], kind.size) == ("1 %", 0.01)
            continue
        size, unit = SIZES[kind.about]
        assert kind.size == pytest.approx(size)
        assert kind.unit == unit
        assert to_si(shown[1], unit) == pytest.approx(size)
    assert [kind.about for kind in TAKEN_AS_EXACT] == [
        "runout",
        "rotor angle",
        "gain",
        "delay",
    ]
