"""Calibration constants as unknowns; several records of one machine."""

from dataclasses import replace

import numpy as np
import pytest

import rotorid as rid
from rotorid import Channel, Constraint, Drive, InputError, MaximumLikelihood, identify
from rotorid.likelihood import unknowns as nuisances
from rotorid.likelihood.effects import Scales
from rotorid.likelihood.unknowns import Scalar, Unknown


def assert_agrees(estimate, truth, sigmas=4.5):
    for value in estimate.free:
        assert value.value == pytest.approx(truth[value.name], abs=sigmas * value.std)


def skewed(record, seconds):
    late = np.exp(-1j * record.omega * seconds)[:, None]
    spectra = record.spectra.copy()
    spectra[:, :, 4:] *= late
    return replace(record, spectra=spectra)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["force", "position"])
def test_common_delay(demo, bearings, kind):
    """It costs nearly nothing: k1 .20 -> .22 % (theory.md, section 3)."""
    record = demo.noisy(skewed(demo.record(bearings), 5e-6), np.random.default_rng(31))
    plain = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    assert plain.misfit.p_value < 1e-3
    estimator = MaximumLikelihood(fixed={"L1": 0.3}, delays=(kind,))
    estimate = identify(demo.model, record, estimator)
    assert estimate.status == "ok"
    sign = {"force": -1, "position": 1}[kind]
    if kind == "position":
        assert_agrees(estimate, {**demo.truth, "delay[position]": 5e-6})
    delay = estimate[f"delay[{kind}]"]
    assert delay.value == pytest.approx(sign * 5e-6, abs=4 * delay.std)
    assert delay.unit == "s"
    clean = demo.noisy(demo.record(bearings), np.random.default_rng(32))
    without = identify(demo.model, clean, MaximumLikelihood(fixed={"L1": 0.3}))
    with_it = identify(demo.model, clean, estimator)
    assert 100 * without.std("k1") / demo.truth["k1"] == pytest.approx(0.20, abs=0.01)
    assert 100 * with_it.std("k1") / demo.truth["k1"] == pytest.approx(0.22, abs=0.01)


def with_gain_priors(record, std):
    channels = tuple(
        replace(c, gain_std=std) if i >= 4 else c for i, c in enumerate(record.channels)
    )
    return replace(record, channels=channels)


def test_gain_priors(demo, bearings):
    """They cost m1 .20 -> .54 %, I_p .05 -> .51 % (theory.md, section 3)."""
    clean = demo.record(bearings)
    wrong = clean.spectra.copy()
    wrong[:, :, 4] *= 1.01
    record = demo.noisy(replace(clean, spectra=wrong), np.random.default_rng(33))
    plain = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    assert plain.status == "rejected"
    assert plain.suspects[0].term == "gain[x1]"
    estimate = identify(
        demo.model, with_gain_priors(record, 0.01), MaximumLikelihood(fixed={"L1": 0.3})
    )
    assert estimate.status == "ok"
    gains = {"gain[x1]": 1.01, "gain[y1]": 1.0, "gain[x3]": 1.0, "gain[y3]": 1.0}
    assert_agrees(estimate, {**demo.truth, **gains})
    assert 100 * estimate.std("m1") / demo.truth["m1"] == pytest.approx(0.54, abs=0.04)
    assert 100 * estimate.std("I_p") / demo.truth["I_p"] == pytest.approx(0.51, abs=0.04)
    # The data tell the gains apart far better than they tell all of them.
    between = estimate.value("gain[x1]") / estimate.value("gain[y1]")
    assert between == pytest.approx(1.01, abs=2e-3)


def test_delay_of_one_channel_with_prior(demo, bearings):
    clean = demo.record(bearings)
    late = clean.spectra.copy()
    late[:, :, clean.index("y3")] *= np.exp(-1j * clean.omega * 20e-6)
    # 12 us of it were corrected on reading: the channel says so, with its deviation.
    late[:, :, clean.index("y3")] *= np.exp(1j * clean.omega * 12e-6)
    channels = tuple(
        replace(c, delay=12e-6, delay_std=10e-6) if c.name == "y3" else c for c in clean.channels
    )
    record = demo.noisy(replace(clean, spectra=late, channels=channels), np.random.default_rng(34))
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    assert estimate.status == "ok"
    assert_agrees(estimate, {**demo.truth, "delay[y3]": 20e-6})
    assert estimate.std("delay[y3]") < 5e-6


def test_force_slope_of_each_input(levitated):
    truth, model = levitated.truth, levitated.machine.model
    rng = np.random.default_rng(35)
    records = [levitated.noisy(levitated.record(hertz), rng) for hertz in (140.0, 100.0)]
    total = Constraint("m1 + m2 + m3", sum(truth[name] for name in ("m1", "m2", "m3")))
    estimator = MaximumLikelihood(
        fixed={"L1": 0.3}, runout=True, gains=("ki", "ks*"), constraints=(total,)
    )
    estimate = identify(model, records, estimator)
    assert estimate.status == "ok", estimate.warnings
    each = {f"ks[{name}]": truth["ks"] for name in model.inputs}
    assert_agrees(estimate, {**truth, **each})
    assert estimate["ki[F_x1]"].unit == "N/A"
    assert estimate["ks[F_x1]"].unit == "N/m"


def test_known_force_law_is_not_a_nuisance(levitated):
    """Currents with known constants: the displacement in the law is the true one."""
    quiet = replace(levitated, runout={})
    truth, model = levitated.truth, levitated.machine.model
    record = quiet.noisy(quiet.record(140.0), np.random.default_rng(36))
    estimate = identify(model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    assert estimate.status == "ok"
    assert estimate.nuisance == ()
    assert_agrees(estimate, truth)
    # A slope that is 1 % off is seen.
    off = tuple(
        replace(c, drive=replace(c.drive, ks=1.05 * c.drive.ks)) if c.drive else c
        for c in record.channels
    )
    wrong = identify(model, replace(record, channels=off), MaximumLikelihood(fixed={"L1": 0.3}))
    assert wrong.value("k1") != pytest.approx(truth["k1"], abs=3 * wrong.std("k1"))


def test_nuisances_may_be_fixed_or_known(levitated):
    truth, model = levitated.truth, levitated.machine.model
    rng = np.random.default_rng(37)
    records = [levitated.noisy(levitated.record(hertz), rng) for hertz in (140.0, 100.0)]
    estimator = MaximumLikelihood(
        fixed={"L1": 0.3, "ki[F_x1]": 120.0},
        known={"ks": (2e5, 2e3)},
        runout=True,
        gains=("ki", "ks"),
    )
    estimate = identify(model, records, estimator)
    assert estimate.status == "ok"
    assert_agrees(estimate, truth)
    assert "ki[F_x1]" not in [value.name for value in estimate.nuisance]
    assert estimate.std("ks") <= 2e3 * 1.01
    assert estimate.covariance.shape == (len(estimate.free),) * 2


def test_records_with_different_sensors_lines_and_speeds(demo, bearings):
    rng = np.random.default_rng(38)
    sensors = [*bearings[:2], Channel("probe", "m", reads={"x2": 1.0, "theta_y": -0.02})]
    records = [
        demo.noisy(demo.record(bearings, hertz=140.0), rng),
        demo.noisy(demo.record(sensors, hertz=60.0, harmonics=(2, 3, 4, 6), periods=100), rng),
        demo.noisy(demo.record(bearings, hertz=0.0, harmonics=(1, 5, 9), periods=50), rng),
    ]
    estimate = identify(demo.model, records, MaximumLikelihood(fixed={"L1": 0.3}))
    assert estimate.status == "ok"
    assert_agrees(estimate, demo.truth)
    assert estimate.misfit.dof == 2 * (6 * 4 + 4 * 3 + 3 * 4) - 12
    assert estimate.periods == 50
    assert {m.record for m in estimate.line_misfit} == {0, 1, 2}
    alone = identify(demo.model, records[0], MaximumLikelihood(fixed={"L1": 0.3}))
    for value in estimate.free:
        assert value.std < alone.std(value.name) * 1.02


def test_the_same_record_twice_halves_the_variance(demo, bearings):
    """To the few-periods correction, which knows of two records with half the freedom each."""
    record = demo.noisy(demo.record(bearings), np.random.default_rng(39))
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    one, two = (identify(demo.model, [record] * n, estimator) for n in (1, 2))
    assert two.misfit.cost == pytest.approx(2 * one.misfit.cost, rel=1e-9)
    for value in one.free:
        assert two.value(value.name) == pytest.approx(value.value, abs=1e-4 * value.std)
        assert two.std(value.name) == pytest.approx(value.std / np.sqrt(2), rel=0.01)


def test_combination_sensors_equal_the_coordinates_they_read(demo):
    """A full set of combinations is a change of coordinates: nothing else changes."""
    reads = [{"x1": 1.0, "x3": 0.5}, {"x3": 1.0, "x1": -0.2}, {"y1": 2.0}, {"y3": 1.0, "y1": 0.1}]
    channels = [Channel(f"s{i}", "m", reads=r) for i, r in enumerate(reads)]
    plain = demo.noisy(demo.record(["x1", "x3", "y1", "y3"]), np.random.default_rng(40))
    matrix = np.zeros((8, 8))
    matrix[:4, :4] = np.eye(4)
    for i, r in enumerate(reads):
        for name, share in r.items():
            matrix[4 + i, plain.index(name)] = share
    mixed = replace(
        plain,
        spectra=plain.spectra @ matrix.T,
        channels=(*plain.channels[:4], *channels),
    )
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    one, two = (identify(demo.model, record, estimator) for record in (plain, mixed))
    assert two.misfit.cost == pytest.approx(one.misfit.cost, rel=1e-8)
    for value in one.free:
        assert two.value(value.name) == pytest.approx(value.value, abs=1e-3 * value.std)


def test_redundant_sensors_are_checked_against_each_other(demo, bearings):
    again = Channel("again", "m", reads={"x1": 1.0})
    clean = demo.record([*bearings, again])
    record = demo.noisy(clean, np.random.default_rng(41))
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    assert estimate.status == "ok"
    assert estimate.misfit.dof == 6 * 2 * 5 - 12
    spectra = record.spectra.copy()
    spectra[:, :, record.index("again")] *= 1.02
    wrong = replace(record, spectra=spectra)
    estimate = identify(demo.model, wrong, MaximumLikelihood(fixed={"L1": 0.3}))
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term in ("gain[again]", "gain[x1]")


def test_refuses_a_force_law_at_an_unknown_place(demo, bearings):
    clean = demo.record(bearings)
    channels = (
        replace(clean.channels[0], drive=Drive(120.0, 2e5, {"x9": 1.0})),
        *clean.channels[1:],
    )
    with pytest.raises(InputError, match="F_x1: found a force law at 'x9'"):
        identify(
            demo.model, replace(clean, channels=channels), MaximumLikelihood(fixed={"L1": 0.3})
        )


def test_levers_of_a_force_law_are_parameters(tmp_path):
    """A rigid rotor whose currents act where L_a and L_b say, its sensors 20 mm further out."""
    model, ki, ks, out = rid.load_model("rigid"), 95.0, 4e5, 0.02
    values = model.values(model.nominal)
    turn = 2 * np.pi * np.outer(np.arange(250) / 250, [1, 3, 5, 7, 9])
    waves = np.column_stack([np.cos(turn + k * turn[:, :1]).sum(axis=1) for k in range(4)])
    force = 20.0 * (waves - waves.mean(axis=0))
    run = rid.simulate(model, values, force, sample_rate=5e3, periods=4, speed=2 * np.pi * 100)
    x, y, tilt_x, tilt_y = (run.column(name) for name in model.coordinates)
    arms = {"xa": (x, tilt_y, -0.2), "ya": (y, tilt_x, 0.2), "xb": (x, tilt_y, 0.25)}
    arms["yb"] = (y, tilt_x, -0.25)
    columns = {}
    for plane, (shift, tilt, arm) in arms.items():
        columns[f"i_{plane}"] = (run.column(f"F_{plane}") - ks * (shift + arm * tilt)) / ki
        columns[f"s_{plane}"] = shift + (arm + np.sign(arm) * out) * tilt
    header = ",".join(columns)
    table = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    lines = ['model = "rigid"', "[[records]]", 'file = "run.csv"', 'sample_rate = "5 kHz"']
    lines += [
        'speed = "100 Hz"',
        "period_samples = 250",
        "harmonics = [1, 3, 5, 7, 9]",
        "[channels]",
    ]
    for plane, (lever, other) in {
        "xa": ("x - L_a*theta_y", " - 0.02*theta_y"), "ya": ("y + L_a*theta_x", " + 0.02*theta_x"),
        "xb": ("x + L_b*theta_y", " + 0.02*theta_y"), "yb": ("y - L_b*theta_x", " - 0.02*theta_x"),
    }.items():  # fmt: skip
        law = f'law = "linear", position = "{lever}", ki = "95 N/A", ks = "4e5 N/m"'
        lines.append(f'F_{plane} = {{ {law}, current = {{ column = "i_{plane}", unit = "A" }} }}')
        reads = f'reads = "{lever}{other}"'
        lines.append(f's_{plane} = {{ {reads}, column = "s_{plane}", unit = "m" }}')
    path = tmp_path / "run.toml"
    path.write_text("\n".join([*lines, "[parameters]", 'L_a = { fixed = "0.2 m" }']))
    found = rid.load_experiment(path).identify()
    for name, truth in zip(model.parameter_names, values, strict=True):
        assert found.value(name) == pytest.approx(float(truth), rel=1e-6), name
    path.write_text("\n".join(lines).replace('"x - L_a*theta_y"', '"x\' - L_a*theta_y"'))
    with pytest.raises(InputError, match="holds a derivative"):
        rid.load_experiment(path)


def test_refuses_channels_that_fit_nothing(demo, bearings):
    clean = demo.record(bearings)
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    strange = replace(clean.channels[5], name="z9")
    with pytest.raises(InputError, match="z9: found a channel that reads 'z9'"):
        identify(
            demo.model,
            replace(clean, channels=(*clean.channels[:5], strange, *clean.channels[6:])),
            estimator,
        )
    fewer = replace(clean, channels=clean.channels[1:], spectra=clean.spectra[:, :, 1:])
    with pytest.raises(InputError, match="no channel of the input F_x1"):
        identify(demo.model, fewer, estimator)
    blind = replace(clean, channels=clean.channels[:4], spectra=clean.spectra[:, :, :4])
    with pytest.raises(InputError, match="no sensor of any coordinate"):
        identify(demo.model, blind, estimator)


def test_what_the_marks_leave_open_is_in_the_direction_of_the_unbalance(demo, bearings):
    """A phase known to 0.02 rad: the amplitude keeps its deviation, the direction takes it over."""
    rng = np.random.default_rng(41)
    record = demo.noisy(demo.record(bearings, phase=0.0), rng)
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    exact = identify(demo.model, record, estimator)
    open_ = identify(demo.model, replace(record, phase_std=0.02), estimator)
    assert [v.name for v in open_.nuisance] == ["phase[0]"]
    assert open_.std("phase[0]") == pytest.approx(0.02, rel=0.01)
    xi, zeta = demo.truth["xi"], demo.truth["zeta"]
    assert open_.std("xi") == pytest.approx(np.hypot(exact.std("xi"), 0.02 * zeta), rel=0.02)
    assert open_.std("zeta") == pytest.approx(np.hypot(exact.std("zeta"), 0.02 * xi), rel=0.02)
    assert open_.std("m2") == pytest.approx(exact.std("m2"), rel=1e-6)


def test_a_phase_that_its_prior_alone_determines_is_determined(demo, bearings):
    """One speed: the unbalance takes any turn, and the phase ends at its prior, at zero."""
    record = demo.noisy(demo.record(bearings), np.random.default_rng(43))
    record = replace(record, phase_std=0.01)
    estimate = identify(demo.model, record, MaximumLikelihood(fixed={"L1": 0.3}))
    assert "phase[0]" not in " ".join(estimate.warnings)
    assert estimate.std("phase[0]") == pytest.approx(0.01, rel=1e-3)


def stretches(records, wanted):
    """A kind that the package does not have: a gain that grows with the square of frequency."""
    sensors = frozenset(s.channel.name for r in records for s in r.sensors)
    scales = Scales(
        sensors,
        lambda values, omega: 1 / (1 + values[0] * omega**2 + 0j),
        lambda values, omega: (-(omega**2) / (1 + values[0] * omega**2) + 0j)[:, None],
    )
    return [Unknown((Scalar("stretch[position]", "s^2", 0.0, additive=True),), sensors, (scales,))]


@pytest.mark.slow
def test_a_further_kind_is_one_function(demo, bearings, monkeypatch):
    """Start, fit, deviation, report and the record's covariance: nothing else knows of it."""
    size = 2e-7
    record = demo.record(bearings)
    spectra = record.spectra.copy()
    spectra[:, :, 4:] *= (1 + size * record.omega**2)[:, None]
    noisy = demo.noisy(replace(record, spectra=spectra), np.random.default_rng(5))
    estimator = MaximumLikelihood(fixed={"L1": 0.3})
    assert identify(demo.model, noisy, estimator).status == "rejected"
    monkeypatch.setattr(nuisances, "KINDS", (*nuisances.KINDS, stretches))
    estimate = identify(demo.model, noisy, estimator)
    assert estimate.status == "ok"
    assert_agrees(estimate, {**demo.truth, "stretch[position]": size})
    assert estimate["stretch[position]"].std < size / 10
    assert "stretch[position]" in str(estimate)
