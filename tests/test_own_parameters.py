"""Parameters that differ between records: a trial mass, an unbalance that every record has."""

import numpy as np
import pytest
from coast_down import (
    EXPERIMENT,
    KNOWN,
    MODEL,
    RPM,
    TRIAL,
    TRUTH,
    WITH_TRIAL,
    coast,
    identify,
    of_two,
    write_two,
)

import rotorid as rid
from rotorid import InputError
from rotorid.testing import phasor_lines

TRUE = rid.parse_model(MODEL)


def table(trial: complex = 0.0, noise: float = 0.0, seed: int = 1) -> rid.Lines:
    parts = np.random.default_rng(seed).standard_normal((2, len(RPM), 2)) * noise
    channels = [rid.Channel("x", "m"), rid.Channel("y", "m")]
    values = coast(RPM, trial) + parts[0] + 1j * parts[1]
    return phasor_lines(channels, RPM * np.pi / 30, values, 1e-6)


@pytest.fixture
def folder(tmp_path):
    write_two(tmp_path)
    return tmp_path


def test_a_trial_mass_tells_the_scale(folder):
    estimate = identify(folder, of_two())
    assert estimate.status == "ok"
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-8)
    fixed = {v.name: v.value for v in estimate.parameters if v.fixed}
    assert fixed == {"t_x": 0, "t_y": 0, "t_x[1]": 5e-5, "t_y[1]": pytest.approx(2e-5)}
    assert estimate.value("u_x + t_x[1]") == pytest.approx(1.5e-4, rel=1e-8)
    assert estimate.value("u_x + t_x") == pytest.approx(1e-4, rel=1e-8)


def test_the_same_from_python():
    records = [table(), table(TRIAL).with_parameters(t_x="50 g mm", t_y=2e-5)]
    estimate = rid.identify(TRUE, records, rid.MaximumLikelihood(fixed=KNOWN))
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-8)


def test_a_trial_mass_that_is_known_with_a_deviation_sets_the_deviation_of_the_scale():
    known = {"t_x": (5e-5, 5e-7), "t_y": (2e-5, 2e-7)}
    records = [table(noise=1e-6), table(TRIAL, 1e-6, 2).with_parameters(**known)]
    estimate = rid.identify(TRUE, records, rid.MaximumLikelihood(fixed=KNOWN))
    assert estimate.status == "ok"
    weight = np.hypot(5e-5 / 5e-7, 2e-5 / 2e-7)  # of two readings of one factor
    assert (estimate.std("m") or 0) / estimate.value("m") == pytest.approx(1 / weight, rel=0.3)
    assert estimate["t_x[1]"].std is not None
    assert not any(v.name == "t_x" and not v.fixed for v in estimate.parameters)


def test_every_record_has_an_unbalance_of_its_own(folder):
    damped = '[records.parameters]\nc = { fixed = "60 N s/m" }\n'
    records = EXPERIMENT.replace("[channels]", f"{damped}[channels]")
    each = records + "u_x = { each = true }\nu_y = { each = true }\n"
    estimate = identify(folder, of_two(each))
    assert estimate.status == "ok"
    names = [v.name for v in estimate.parameters]
    assert ", ".join(names) == "m, c, k, t_x, t_y, c[1], u_x[0], u_x[1], u_y[0], u_y[1]"
    expected = {"u_x[0]": 1e-4, "u_x[1]": 1.5e-4, "u_y[0]": -5e-5, "u_y[1]": -3e-5, "c": 60.0}
    assert {n: estimate.value(n) for n in expected} == pytest.approx(expected, rel=1e-8)
    assert len(estimate.covariance) == len(estimate.free) == 6
    assert [v.name for v in estimate.free][2:] == names[6:]


def test_what_is_known_of_each():
    records = [table(), table(TRIAL)]
    fixed = {**KNOWN, "m": 5.0, "u_x[1]": 1.5e-4}
    chosen = rid.MaximumLikelihood(fixed=fixed, each=("u_x", "u_y"), start={"u_x[0]": 2e-4})
    estimate = rid.identify(TRUE, records, chosen)
    assert estimate["u_x[1]"].fixed
    assert estimate.value("u_x[0]") == pytest.approx(1e-4, rel=1e-8)
    assert estimate.value("u_y[1]") == pytest.approx(-3e-5, rel=1e-8)


def test_a_constraint_on_each_holds_in_every_record():
    records = [table(), table(TRIAL)]
    known = {"fixed": KNOWN, "constraints": (rid.Constraint("m", 5.0),)}
    chosen = rid.MaximumLikelihood(each=("m", "u_x", "u_y"), **known)
    estimate = rid.identify(TRUE, records, chosen)
    assert estimate.status == "ok"
    assert estimate.value("m[0]") == pytest.approx(5.0) == estimate.value("m[1]")


def test_prediction_takes_what_each_record_has(folder):
    records = [table(), table(TRIAL)]
    chosen = rid.MaximumLikelihood(fixed={**KNOWN, "m": 5.0}, each=("u_x", "u_y"))
    estimate = rid.identify(TRUE, records, chosen)
    assert rid.predict(TRUE, estimate, records)["x"].relative_error < 1e-6
    assert rid.predict(TRUE, estimate, records[::-1])["x"].relative_error > 0.1
    stated = records[1].with_parameters(u_x=1.5e-4, u_y=-3e-5)
    assert rid.predict(TRUE, estimate, stated)["x"].relative_error < 1e-6
    with pytest.raises(InputError, match="without 'u_x'"):
        rid.predict(TRUE, estimate, [*records, records[0]])


T_X = 't_x = { fixed = "5e-5 kg m" }'


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (T_X, 't_q = { fixed = "1 kg m" }', r"records\.1\.param.*t_q"),
        (T_X, 't_x = { start = "1 kg m" }', r"unknown key 'start'"),
        (T_X, 't_x = { fixed = "1 kg" }', r"t_x\.fixed: found unit"),
        (T_X, 't_x = { value = "1 kg m" }', r"fixed, or value and std"),
        (T_X, 't_x = { value = "1 kg m", std = "0 kg m" }', r"t_x\.std: found 0"),
        ('t_x = { fixed = "0 kg m" }', 't_x = { fixed = "0 kg m", each = true }', "fixed, or each"),
    ],
)
def test_what_is_no_knowledge_of_a_record(folder, old, new, message):
    with pytest.raises(InputError, match=message):
        identify(folder, of_two(WITH_TRIAL.replace(old, new)))


@pytest.mark.parametrize("method", ["ls", "batch", "sequential"])
def test_other_methods_say_that_they_need_ml(folder, method):
    with pytest.raises(InputError, match=r"records\.1\.parameters: found parameters that differ"):
        identify(folder, of_two(WITH_TRIAL) + f'[estimator]\nmethod = "{method}"\n')


def test_each_of_what_there_is_not():
    with pytest.raises(InputError, match="each: found each of 'q'"):
        rid.identify(TRUE, table(), rid.MaximumLikelihood(each=("q",)))


def test_base_parameters_know_no_records_of_their_own():
    chosen = rid.MaximumLikelihood(each=("u_x",), base=True)
    with pytest.raises(InputError, match=r"u_x\[0\], a parameter that differs"):
        rid.identify(TRUE, [table(), table()], chosen)
