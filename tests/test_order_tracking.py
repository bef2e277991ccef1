"""Run-ups cut into tables of phasors by the rotor angle."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from coast_down import KNOWN, MODEL, TRIAL, TRUTH, run_down
from io_writers import write_table
from working_folder import load

import rotorid as rid
from rotorid import InputError

JEFFCOTT = rid.parse_model(MODEL)
SLOWER = {**TRUTH, "c": 300.0}


def turning(
    phasors: complex | np.ndarray,
    noise: float = 0.0,
    low: float = 20.0,
    high: float = 40.0,
    seconds: float = 20.0,
    drift: float = 0.0,
) -> rid.Record:
    """Return a channel that reads Re(X exp(i phi)), 20 to 40 revolutions per second."""
    rng = np.random.default_rng(7)
    time = np.arange(int(seconds * 2000)) / 2000.0
    angle = 2 * np.pi * (low * time + (high - low) / seconds * time**2 / 2)
    samples = (phasors * np.exp(1j * angle)).real + drift * time
    samples = samples + 0.3 * np.cos(2 * angle) + noise * rng.standard_normal(len(time))
    return rid.Record([rid.Channel("x", "m")], samples[:, None], 2000.0, 1.0, angle)


@pytest.mark.parametrize("sense", [1, -1])
def test_phasors_are_what_turns_with_the_rotor(sense):
    """A drift, twice the speed and an offset are something else."""
    record = turning(2.0 * np.exp(-0.7j), low=sense * 20.0, high=sense * 40.0, drift=0.05)
    table = rid.phasors(record)
    assert np.ptp(table.speed) > 15 * 2 * np.pi
    assert (np.sign(table.speed) == sense).all()
    np.testing.assert_allclose(table.frequency, np.abs(table.speed) / (2 * np.pi))
    sine = np.exp(-0.7j * sense)  # backward, a line is the conjugate of its phasor
    np.testing.assert_allclose(table.mean[:, 0], sine, rtol=1e-6)


def test_the_speed_is_that_of_the_middle_of_the_segment():
    table = rid.phasors(turning(1.0), 8)
    turns = 8 * (np.arange(len(table.speed)) + 0.5)
    # 20 t + t^2 / 2 = turns: the speed 20 + t there, less what the middle of the time lies ahead.
    np.testing.assert_allclose(table.frequency, np.sqrt(20**2 + 2 * turns), rtol=1e-4)


def test_the_covariance_is_that_of_the_phasors():
    table = rid.phasors(turning(2.0, noise=0.1), 8)
    ratio = (np.abs(table.mean[:, 0] - 1.0) ** 2) / table.covariance.matrices[:, 0, 0].real
    # F of 2 and 2 n degrees of freedom: mean n / (n - 1), over 75 segments known to 15 %.
    n = table.covariance.dof
    assert n == 6
    assert ratio.mean() * (n - 1) / n == pytest.approx(1.0, abs=0.4)
    # White noise of 0.1: 2 sigma^2 / N of each part of X, half of it both parts of a line.
    samples = 2000 * 8 / table.frequency
    size = (table.covariance.matrices[:, 0, 0].real * samples).mean()
    assert size == pytest.approx(0.01, rel=0.15)


def test_short_segments_share_a_covariance():
    table = rid.phasors(turning(2.0, noise=0.1), 4)
    assert (table.covariance.shared, table.covariance.dof) == (3, 6)
    matrices = table.covariance.matrices[:, 0, 0].real * 2000 * 4 / table.frequency
    np.testing.assert_allclose(matrices[:3], matrices[0], rtol=0.02)


def test_segments_are_as_long_as_the_phasors_let_them():
    """A phasor that turns about itself once in six seconds bends in segments of two."""
    time = np.arange(40000) / 2000.0
    straight = rid.phasors(turning(2.0, noise=0.01, seconds=60.0))
    bent = rid.phasors(turning(2.0 * np.exp(2j * np.pi * time / 6), noise=0.01))
    # Turns pass as f^2 / (2 f'): f' is 1/3 and 1 Hz/s.
    assert round(np.diff(straight.frequency**2).mean() * 3 / 2) == 64
    assert round(np.diff(bent.frequency**2).mean() / 2) < 32
    assert not [w for w in bent.warnings if "bend" in w]
    (told,) = rid.phasors(turning(2.0 * np.exp(2j * np.pi * time / 6), noise=0.01), 64).warnings[:1]
    assert "bend within their segments" in told


def test_a_run_down_gives_the_rotor():
    rng = np.random.default_rng(2)
    bare = rid.phasors(run_down(rng, 3e-4))
    trial = {"t_x": TRIAL.real, "t_y": TRIAL.imag}
    weighed = rid.phasors(run_down(rng, 3e-4, trial=TRIAL)).with_parameters(**trial)
    estimate = rid.identify(JEFFCOTT, [bare, weighed], rid.MaximumLikelihood(fixed=KNOWN))
    assert estimate.status == "ok"
    assert not [w for w in estimate.warnings if "settle" in w]
    for name, value in SLOWER.items():
        std = estimate.std(name) or 0.0
        assert 0 < std < 0.1 * abs(value)
        assert abs(estimate.value(name) - value) < 4 * std


@pytest.mark.slow
def test_a_run_down_too_fast_to_settle_is_told():
    """At 60 N s/m the motion decays with 6 1/s, and 26 rad/s^2 are most of its square."""
    table = rid.phasors(run_down(np.random.default_rng(3), 1e-6, damping=60.0))
    assert any("too fast to settle: near 4" in w for w in table.warnings)
    estimate = rid.identify(JEFFCOTT, table, rid.MaximumLikelihood(fixed={**KNOWN, "m": 5.0}))
    assert estimate.status != "ok"
    assert any("too fast to settle" in w for w in estimate.warnings)


@pytest.mark.slow
def test_error_bars_of_run_downs():
    """Unbalance, damping and stiffness of 70 run-downs with a trial mass."""
    ratios, method = [], rid.MaximumLikelihood(fixed=KNOWN, effort="quick")
    for number in range(70):
        rng = np.random.default_rng([number, 5])
        tables = [rid.phasors(run_down(rng, 3e-4, trial=t)) for t in (0.0, TRIAL)]
        runs = [tables[0], tables[1].with_parameters(t_x=TRIAL.real, t_y=TRIAL.imag)]
        estimate = rid.identify(JEFFCOTT, runs, method)
        assert estimate.status == "ok"
        errors = [(n, estimate.value(n) - v) for n, v in SLOWER.items()]
        ratios.append([error / (estimate.std(n) or np.nan) for n, error in errors])
    # 70 numbers each, and of five that belong together: within two of their deviations.
    rms = np.sqrt((np.array(ratios) ** 2).mean(axis=0))
    assert (rms > 0.8).all()
    assert (rms < 1.2).all()
    assert 0.92 <= (np.abs(ratios) < 1.96).mean() <= 0.98


def test_samples_left_out_leave_their_segments_out():
    record = turning(2.0, noise=0.01)
    valid = np.ones(len(record.samples), dtype=bool)
    valid[20000] = False
    whole, gap = rid.phasors(record, 8), rid.phasors(replace(record, valid=valid), 8)
    assert len(gap.speed) == len(whole.speed) - 1


def test_what_is_skipped():
    assert rid.phasors(turning(2.0, noise=0.01), 8, skip=10.0).frequency.min() > 30.0
    with pytest.raises(InputError, match="found skip = 100 s"):
        rid.phasors(turning(1.0), skip=100.0)


@pytest.mark.parametrize(
    ("record", "revolutions", "message"),
    [
        (rid.Record([rid.Channel("x")], np.zeros((900, 1)), 100.0), None, "without rotation"),
        (turning(1.0, seconds=0.25), None, r"found 7\.\d* revolutions without a gap; expected 8"),
        (turning(1.0, low=260.0, high=300.0), None, r"7\.\d* samples per revolution"),
        (turning(1.0, low=20.0, high=-20.0), None, r"turns back at 10 s"),
        (turning(1.0), 3, "found 3 revolutions; expected 4 or more"),
    ],
)
def test_records_that_are_no_run_up(record, revolutions, message):
    with pytest.raises(InputError, match=message):
        rid.phasors(record, revolutions)


CUT = """
model = "model.toml"
[[records]]
kind = "phasors"
file = "run.csv"
sample_rate = "2 kHz"
angle = { column = "phi", unit = "rad" }
[channels]
x = { column = "x", unit = "um" }
y = { column = "y", unit = "um" }
[parameters]
m = { fixed = "5 kg" }
t_x = { fixed = "0 kg m" }
t_y = { fixed = "0 kg m" }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run-down")
    record = run_down(np.random.default_rng(6), 1e-4)
    pulse = (np.asarray(record.angle) % (2 * np.pi) < 0.8).astype(float)
    columns, digits = (1e6 * record.samples, record.angle, pulse), ["%.1f", "%.1f", "%.5f", "%d"]
    write_table(folder / "run.csv", "x,y,phi,kp", *columns, fmt=digits)
    (folder / "model.toml").write_text(MODEL)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("mark", ['angle = { column = "phi", unit = "rad" }', 'keyphasor = "kp"'])
def test_an_experiment_file_of_samples(folder, mark):
    text = CUT.replace('angle = { column = "phi", unit = "rad" }', mark)
    experiment = load(folder, text + 'c = { start = "200 N s/m" }\n')
    (table,) = experiment.records()
    assert isinstance(table, rid.Lines)
    estimate = rid.identify(experiment.model, [table], experiment.estimator())
    assert estimate.value("k") == pytest.approx(1e6, rel=0.01)
    assert estimate.value("u_x") == pytest.approx(1e-4, rel=0.05)
    assert len(experiment.measured()) == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sample_rate", 'speed = "3000 rpm"\nsample_rate', "speed and angle|found speed"),
        ("sample_rate", 'fundamental = "20 Hz"\nsample_rate', "fundamental in a table of phasors"),
        ("sample_rate", "revolutions = 2\nsample_rate", "revolutions"),
        ('column = "x"', 'amplitude = "x", phase = "y"', "a channel of phasors that no record"),
        ('kind = "phasors"', 'band = ["1 Hz", "9 Hz"]\nrevolutions = 8', "revolutions without"),
    ],
)
def test_keys_of_samples_that_are_cut(folder, old, new, message):
    with pytest.raises(InputError, match=message):
        load(folder, CUT.replace(old, new, 1)).records()


@pytest.mark.parametrize(("rate", "refused"), [(270.0, True), (330.0, False)])
def test_samples_per_revolution(rate, refused):
    """Of 40 revolutions per second: 6.75 and 8.25 samples."""
    angle = 2 * np.pi * 40.0 * np.arange(20000) / rate
    samples = np.cos(angle) + 0.01 * np.random.default_rng(1).standard_normal(20000)
    record = rid.Record([rid.Channel("x", "m")], samples[:, None], rate, 1.0, angle)
    message = r"6\.75 samples per revolution; expected 8"
    with pytest.raises(InputError, match=message) if refused else nullcontext():
        assert len(rid.phasors(record).speed) > 20


@pytest.mark.slow
def test_a_table_has_twenty_speeds_at_least():
    """597 turns: nine segments of 64, eighteen of 32, 37 of 16."""
    assert len(rid.phasors(turning(2.0, noise=0.1)).speed) == 37
    assert len(rid.phasors(turning(2.0, noise=0.1, seconds=23.0)).speed) == 21


def test_multiples_of_the_rotation_are_no_noise():
    """Twice and three times the speed are fitted beside it; four times are in the residual."""
    record = turning(2.0, noise=1e-4)
    size = {}
    for order in (3, 4):
        wave = 0.3 * np.cos(order * np.asarray(record.angle) + 0.2)
        noisy = replace(record, samples=record.samples + wave[:, None])
        size[order] = rid.phasors(noisy, 8).covariance.matrices.real.mean()
    assert size[4] > 3 * size[3]


@pytest.mark.parametrize(("noise", "told"), [(2e-4, False), (1e-6, True)])
def test_from_when_on_a_lag_is_told(noise, told):
    """At 300 N s/m and 26 rad/s^2 phasors of .17 mm lag by 3 % of themselves, 5 um."""
    table = rid.phasors(run_down(np.random.default_rng(8), noise), 16)
    assert any("too fast to settle" in w for w in table.warnings) == told
