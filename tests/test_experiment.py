"""Experiment files, on exact records of the Jeffcott rotor written in odd units."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from bank import recovered
from io_writers import write_table
from working_folder import load, shaken

import rotorid as rid
from rotorid import InputError
from rotorid.experiment.read import dynamics_of
from rotorid.experiment.schema import DynamicsEntry
from rotorid.force.laws import Differential

MODEL = rid.load_model("jeffcott")
TRUTH = MODEL.nominal
RATE, PERIOD, SPEED, PHASE = 2000.0, 200, 2 * np.pi * 30.0, 0.7
EXPERIMENT = """
model = "jeffcott"

[[records]]
file = "run.h5"
sample_rate = "2 kHz"
speed = "1800 rpm"
phase = "0.7 rad"
fundamental = "10 Hz"
harmonics = [1, 2, 3, 5]
skip = "0.02 s"

[channels]
F_x = { column = "force/x", unit = "mN" }
F_y = { column = "force/y", unit = "N", scale = 2 }
x = { column = "position[0]", unit = "um" }
y = { column = "position[1]" }
"""
SUM = 's = { column = "sum", unit = "m", reads = '


def write(path: Path, speed: float = SPEED, delay_samples: int = 0) -> None:
    record = shaken(periods=4, speed=speed, phase=PHASE, noise=0.0)
    samples = np.roll(record.samples, delay_samples, axis=0)
    with h5py.File(path, "w") as data:
        data["force/x"] = 1e3 * samples[:, 0]
        data["force/y"] = 0.5 * samples[:, 1]
        data["position"] = np.column_stack([1e6 * samples[:, 2], 1e3 * samples[:, 3]])
        data["position"].attrs["units"] = ["um", "mm"]
        data["sum"] = samples[:, 2] + 0.5 * samples[:, 3]


@pytest.fixture
def folder(tmp_path):
    write(tmp_path / "run.h5")
    return tmp_path


def estimate(experiment: rid.Experiment, method: str = "batch") -> rid.Estimate:
    asked = experiment.entry.estimator.method or method
    return rid.identify(experiment.model, experiment.records(asked), experiment.estimator(asked))


def check_truth(found: rid.Estimate, rtol: float = 1e-9) -> None:
    truth = dict(zip(MODEL.base.names, MODEL.base_values(MODEL.values(TRUTH)), strict=True))
    recovered(found, truth, rtol)


@pytest.mark.parametrize("method", ["ls", "batch", "sequential"])
def test_exact_record_gives_exact_parameters(folder, method):
    """Units, scale, columns of a 2-D dataset, speed, phase and skip, all at once."""
    check_truth(estimate(load(folder, EXPERIMENT), method))


def test_what_the_file_says(folder):
    experiment = load(folder, EXPERIMENT)
    (record,) = experiment.measured()
    (periods,) = experiment.records()
    assert record.names == ("F_x", "F_y", "x", "y")
    assert [channel.unit for channel in record.channels] == ["N", "N", "m", "m"]
    assert record.speed == pytest.approx(SPEED)
    assert record.rotor_angle()[0] == pytest.approx(PHASE)
    assert periods.harmonics.tolist() == [1, 2, 3, 5]
    assert periods.periods == 3
    assert periods.time[0, 0] == pytest.approx(0.02)
    assert experiment.estimator() == rid.MaximumLikelihood()
    assert experiment.estimator("batch") == rid.Batch(free_weight=100.0)
    assert experiment.estimator("ls") == rid.LeastSquares()


def test_time_period_samples_and_band(folder):
    with h5py.File(folder / "run.h5", "a") as data:
        data["t"] = np.arange(4 * PERIOD) / RATE
    text = EXPERIMENT.replace('sample_rate = "2 kHz"', 'time = "t"')
    text = text.replace('fundamental = "10 Hz"', "period_samples = 200")
    text = text.replace("harmonics = [1, 2, 3, 5]", 'band = ["0.005 kHz", "50 Hz"]')
    (periods,) = load(folder, text).records()
    assert periods.harmonics.tolist() == [1, 2, 3, 4, 5]
    assert periods.sample_rate == pytest.approx(RATE, rel=1e-12)
    check_truth(estimate(load(folder, text)))


def test_a_delay_is_corrected(folder):
    """All columns 3 samples late, and the rotor angle counted from the file's first sample."""
    write(folder / "run.h5", delay_samples=3)
    late = EXPERIMENT.replace(" }", ', delay = "1.5 ms" }')
    check_truth(estimate(load(folder, late)), rtol=1e-8)
    wrong = estimate(load(folder, EXPERIMENT))
    assert abs(wrong.value("m*xi") / (TRUTH["m"] * TRUTH["xi"]) - 1) > 0.01


def test_hold_reaches_the_channel(folder):
    held = EXPERIMENT.replace('unit = "mN"', 'unit = "mN", hold = "zero-order", gain_std = 0.0')
    (record,) = load(folder, held).measured()
    assert [channel.hold for channel in record.channels] == [True, False, False, False]


def test_a_sensor_of_a_combination(folder):
    text = EXPERIMENT.replace('y = { column = "position[1]" }', SUM + '"x + y/2" }')
    experiment = load(folder, text)
    assert experiment.measured()[0].channels[3].reads == {"x": 1.0, "y": 0.5}
    check_truth(estimate(experiment))


@pytest.mark.slow
def test_several_records_with_channels_of_their_own(folder):
    write(folder / "fast.h5", speed=2 * SPEED)
    fast = """
[[records]]
file = "fast.h5"
sample_rate = "2 kHz"
speed = "60 Hz"
phase = "0.7 rad"
fundamental = "10 Hz"
harmonics = [1, 2, 5, 6]

[records.channels]
x = { column = "position[0]", unit = "um", scale = 1 }
"""
    experiment = load(folder, EXPERIMENT + fast)
    first, second = experiment.measured()
    assert second.speed == pytest.approx(2 * first.speed)
    check_truth(estimate(experiment))


def test_fixed_parameters_and_constraints(folder):
    fixed = load(folder, EXPERIMENT + '[parameters]\nm = { fixed = "5000 g" }\n')
    assert fixed.fixed == {"m": 5.0}
    found = estimate(fixed)
    assert found["m"].fixed
    assert found.value("k") == pytest.approx(TRUTH["k"], rel=1e-9)
    text = EXPERIMENT + '[[constraints]]\nexpression = "k"\nvalue = "1.1 kN/mm"\n'
    assert estimate(load(folder, text)).value("k") == pytest.approx(1.1e6, rel=1e-12)


def test_a_constraint_may_hold_what_is_fixed(folder):
    text = EXPERIMENT + '[parameters]\nm = { fixed = "4 kg" }\n'
    text += '[[constraints]]\nexpression = "k*m"\nvalue = "4e6 kg N/m"\n'
    found = estimate(load(folder, text))
    assert (found.value("m"), found.value("k")) == (4.0, pytest.approx(1e6, rel=1e-12))
    with pytest.raises(InputError, match="no free parameter"):
        estimate(load(folder, text.replace("k*m", "m^2").replace("4e6 kg N/m", "16 kg^2")))


def test_forces_of_zero_are_said(folder):
    with h5py.File(folder / "run.h5", "r+") as data:
        for name in ("force/x", "force/y"):
            data[name][:] = 0.0
    assert estimate(load(folder, EXPERIMENT)).prediction == {"F_x": None, "F_y": None}


def test_a_start_never_biases(folder):
    check_truth(estimate(load(folder, EXPERIMENT + '[parameters]\nm = { start = "9 kg" }\n')))


def test_paths_are_relative_to_the_experiment(folder, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "mine.toml").write_text(rid.load_model("jeffcott").file_text)
    (other / "experiment.toml").write_text(EXPERIMENT.replace('"jeffcott"', '"mine.toml"'))
    experiment = rid.load_experiment(other / "experiment.toml", folder=folder)
    assert experiment.model.name == "mine"
    check_truth(estimate(experiment))


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ('"1800 rpm"', '"1800 rpn"', "records.0.speed", "unknown name rpn"),
        ('"1800 rpm"', "1800", "records.0.speed", "without a unit"),
        ('"2 kHz"', '"0 Hz"', "records.0.sample_rate", "greater than or equal to"),
        ('"2 kHz"', '"1e300 Hz"', "records.0.sample_rate", "less than or equal to"),
        ('"0.02 s"', '"-1 s"', "records.0.skip", "greater than or equal to 0"),
        ("harmonics = [1, 2, 3, 5]", "", "records.0: harmonics, band", "neither.*add one"),
        ("[1, 2, 3, 5]", '[1]\nband = ["0 Hz", "9 Hz"]', "records.0: harmonics, band", "both"),
        ("[1, 2, 3, 5]", '[1, "2"]', "records.0.harmonics.1", "a valid integer"),
        ("[1, 2, 3, 5]", "[1, 2.5]", "records.0.harmonics.1", "a valid integer"),
        ("harmonics = [1, 2, 3, 5]", 'band = ["9 Hz", "5 Hz"]', "records.0.band", "lower end"),
        ("harmonics = [1, 2, 3, 5]", 'band = "9 Hz"', "records.0.band", "two frequencies"),
        ('"0.7 rad"', '"unknwn"', "records.0.phase", "a number and a unit"),
        ("fundamental", "fundamentl", "records.0.fundamentl", "did you mean fundamental"),
        ("[channels]", "[channel]", "channel", "did you mean channels"),
        ("scale = 2", "scale = [2]", "channels.F_y.scale", "a finite scale, or the"),
        ("scale = 2", "scale = nan", "channels.F_y.scale", "a finite scale"),
        ("scale = 2", 'hold = "zoh"', "channels.F_y.hold", "'none' or 'zero-order'"),
        ("scale = 2", 'delay = { std = "0 us" }', "channels.F_y.delay.std", "greater than 0"),
        ("scale = 2", 'delay = { sd = "1 us" }', "channels.F_y.delay.sd", "did you mean std"),
        ("scale = 2", "gain_std = -1", "channels.F_y.gain_std", "greater than or equal to 0"),
        ("F_x =", "Fx =", "channels.Fx", "one of F_x, F_y, x, y; did you mean F_x"),
        ('\ny = { column = "position[1]" }', "\ny = 3", "channels.y", "a table"),
        ("F_x = { column", "F_x = { law", "channels.F_x.law", "'linear', 'differential' or 'flux'"),
    ],
)
def test_refused_keys(folder, old, new, place, message):
    assert old in EXPERIMENT
    with pytest.raises(InputError, match=message) as caught:
        load(folder, EXPERIMENT.replace(old, new))
    assert caught.value.file.endswith("experiment.toml")
    assert caught.value.place == place


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('speed = "1800 rpm"\nphase = "0.7 rad"', 'keyphasor = "Kee"', "keyphasor"),
        (
            'speed = "1800 rpm"\nphase = "0.7 rad"',
            'angle = { column = "Kee", unit = "deg" }',
            "angle",
        ),
        (
            'fundamental = "10 Hz"\nharmonics = [1, 2, 3, 5]',
            'band = ["5 Hz", "60 Hz"]\nreferences = ["Kee"]',
            "references",
        ),
    ],
)
def test_a_column_beside_the_channels_is_named_where_it_stands(folder, old, new, place):
    assert old in EXPERIMENT
    with pytest.raises(InputError, match=f"records.0.{place}: found no .*'Kee'"):
        estimate(load(folder, EXPERIMENT.replace(old, new)), "ml")


@pytest.mark.parametrize(
    ("added", "place", "message"),
    [
        ('[parameters]\nmm = { fixed = "1 kg" }', "parameters.mm", "did you mean m"),
        ('[parameters]\nm = { fixed = "1 m" }', "parameters.m.fixed", "converts to kg"),
        ("[parameters]\nm = { fixed = 1 }", "parameters.m.fixed", "without a unit"),
        ('[parameters]\nm = { value = "1 kg" }', "parameters.m", "or value and std"),
        ('[parameters]\nm = { value = "1 kg", std = "0 g" }', "parameters.m.std", "more than 0"),
        ('[parameters]\nm = { fixed = "1 kg", start = "1 kg" }', "parameters.m", "keep one"),
        ('[[constraints]]\nexpression = "m + k"\nvalue = "1 kg"', None, "unit .* converts to"),
        ('[[constraints]]\nexpression = "m +"\nvalue = "1 kg"', None, "end of the text"),
        ('[[constraints]]\nexpression = "m*z"\nvalue = "1 kg"', None, "unknown name 'z'"),
        ('[[constraints]]\nexpression = "7"\nvalue = "1 kg"', "constraints.0", "of parameters"),
        ('[[constraints]]\nexpression = "m"\nvalue = "1 m"', "constraints.0.value", "to kg"),
        ('[estimator]\nmethod = "mle"', "estimator.method", "'ls', 'batch', 'sequential'"),
        ("[estimator]\nfree_weight = 0", "estimator.free_weight", "greater than 0"),
        ("[estimator]\nrunout = 1", "estimator.runout", "a valid boolean"),
        ('[estimator]\ngains = ["kx"]', "estimator.gains.0", "'ki', 'ks' or 'ks"),
        ('[estimator]\ndelays = ["current"]', "estimator.delays", "one of force, position, F_x"),
        ("[parameters]\nm = {}", "parameters.m", "min and max may stand beside"),
        ('[parameters]\nm = { min = "1 m" }', "parameters.m.min", "converts to kg"),
        ('[parameters]\nm = { fixed = "1 kg", max = "2 kg" }', "parameters.m", "keep one"),
        ('[[constraints]]\nexpression = "m"', "constraints.0", "found nothing; expected value"),
        ('[[constraints]]\nexpression = "m"\nvalue = "1 kg"\nmin = "1 kg"', None, "min and value"),
        ('[records.channels]\nz = { column = "z" }', "records.0: channels.z", "no input or coord"),
        ('s = { column = "sum", reads = "x" }', "channels.s.unit", "no unit"),
        (SUM + '"x*y" }', "channels.s.reads", "a linear"),
        (SUM + '"x + 1" }', "channels.s.reads", "a linear"),
        (SUM + '"x + z" }', "channels.s.reads", "unknown name"),
        (SUM + '"sin(x)" }', "channels.s.reads", "sin of x"),
    ],
)
def test_refused_knowledge(folder, added, place, message):
    with pytest.raises(InputError, match=message) as caught:
        load(folder, EXPERIMENT + added + "\n")
    assert caught.value.file.endswith("experiment.toml")
    if place is not None:
        assert caught.value.place == place


@pytest.mark.parametrize(
    ("added", "place"),
    [
        ('[parameters]\nm = { value = "5 kg", std = "1 g" }', "parameters.m.std"),
        ('[[constraints]]\nexpression = "m"\nvalue = "5 kg"\nstd = "1 g"', "constraints.0.std"),
        (SUM + '"x", gain_std = 0.1 }', "channels.s.gain_std"),
        (SUM + '"x", delay = { std = "1 us" } }', "channels.s.delay.std"),
        ("[estimator]\nrunout = true", "estimator.runout"),
        ('[estimator]\ngains = ["ki"]', "estimator.gains"),
        ('[estimator]\ndelays = ["force"]', "estimator.delays"),
        ('[parameters]\nm = { max = "6 kg" }', "parameters.m.min, max"),
        ('[[constraints]]\nexpression = "m"\nmax = "6 kg"', "constraints.0.min, max"),
        ("[parameters]\nm = { each = true }", "parameters.m.each"),
    ],
)
def test_deviations_need_a_likelihood(folder, added, place):
    experiment = load(folder, EXPERIMENT + added + "\n")
    for method in ("ls", "batch", "sequential"):
        with pytest.raises(InputError, match="use ml") as caught:
            experiment.estimator(method)
        assert caught.value.place == place


@pytest.mark.sampled(2)
@pytest.mark.parametrize("method", ["ls", "batch", "sequential"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (EXPERIMENT.replace('y = { column = "position[1]" }', ""), "no sensor of y"),
        (EXPERIMENT + '[[constraints]]\nexpression = "m^2"\nvalue = "25 kg^2"\n', "not linear"),
    ],
)
def test_what_only_ml_can_do(folder, text, message, method):
    with pytest.raises(InputError, match=f"{message}.*use ml"):
        estimate(load(folder, text), method)


MODES = """
model = "jeffcott"

[[modes]]
frequency = "{hertz} Hz"
std = "0.02 Hz"
damping = {{ value = {ratio}, std = 1e-4 }}

[parameters]
m = {{ fixed = "{mass} kg" }}
xi = {{ fixed = "0 m" }}
zeta = {{ fixed = "0 m" }}
"""


def modal_test() -> str:
    k, m, c = TRUTH["k"], TRUTH["m"], TRUTH["c"]
    ratio = c / (2 * np.sqrt(k * m))
    hertz = np.sqrt(k / m * (1 - ratio**2)) / (2 * np.pi)
    return MODES.format(hertz=repr(float(hertz)), ratio=repr(float(ratio)), mass=m)


def test_natural_frequencies_alone(tmp_path):
    found = estimate(load(tmp_path, modal_test()), "ml")
    assert found.status == "ok"
    recovered(found, {name: TRUTH[name] for name in "kc"})
    assert found.lines_hz == ()


def test_a_frequency_as_exact_as_its_computation_is_taken():
    assert rid.Mode("5 Hz", "1e-11 Hz").std == 1e-11


def test_natural_frequencies_beside_a_record(folder):
    """The disc carried another mass in the test."""
    k, c = TRUTH["k"], TRUTH["c"]
    hertz = np.sqrt(k / 3 - (c / 6) ** 2) / (2 * np.pi)
    mode = f"""
[[modes]]
frequency = "{float(hertz)!r} Hz"
std = "0.001 Hz"
parameters = {{ m = "3 kg" }}
"""
    found = estimate(load(folder, EXPERIMENT + mode), "ml")
    assert found.value("k") == pytest.approx(k, rel=1e-8)
    assert found.modes[0].fitted_hz == pytest.approx(hertz, rel=1e-9)
    assert found.modes[0].parameters == (("m", 3.0),)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('std = "0.02 Hz"', 'std = "0 Hz"', r"modes\.0: std: found 0 Hz; expected a number above"),
        ('std = "0.02 Hz"', 'std = "1e-13 Hz"', r"modes\.0: std: found 1e-13 Hz, .* 1e-12 of the"),
        ('std = "0.02 Hz"', "", r"modes\.0\.std: found no such key"),
        ('std = "0.02 Hz"', 'std = "2 mm"', r"modes\.0\.std: "),
        ("std = 1e-4", "std = 0", r"modes\.0\.damping\.std: found 0"),
        ("[[modes]]", "[[modes]]\nmode = 0", r"modes\.0\.mode: found 0"),
        (
            "[[modes]]",
            "[[modes]]\nmode = 9",
            r"modes: found a measured mode that would be number 9",
        ),
        ("[[modes]]", '[[modes]]\nparameters = { q = "1 kg" }', r"no parameter of the model"),
        ("[[modes]]", '[[modes]]\nparameters = { m = "1 mm" }', r"modes\.0: m: found unit 'mm'"),
        ("[[modes]]", '[[modes]]\nspeed = "3 kg"', r"modes\.0\.speed: "),
    ],
)
def test_natural_frequencies_refused(tmp_path, old, new, told):
    with pytest.raises(InputError, match=told):
        estimate(load(tmp_path, modal_test().replace(old, new)), "ml")


def test_natural_frequencies_need_ml_and_no_record(tmp_path):
    experiment = load(tmp_path, modal_test())
    with pytest.raises(InputError, match=r"modes: found measured natural frequencies.*use ml"):
        experiment.estimator("batch")
    with pytest.raises(InputError, match="natural frequencies alone; expected a record"):
        experiment.require_records()
    with pytest.raises(InputError, match=r"neither \[\[records\]\] nor \[\[modes\]\]"):
        load(tmp_path, 'model = "jeffcott"')


def test_a_record_is_read_once_whatever_method_takes_it(folder):
    """Where the default falls to batch, nothing is read or averaged again."""
    experiment = load(folder, EXPERIMENT)
    (first,) = experiment.records("ml")
    (second,) = experiment.records("batch")
    assert second is first


@pytest.mark.parametrize(
    ("head", "columns"),
    [
        ("f,re,im", (1.0, 1.0, 1.0)),
        ("f [kHz],re,im", (1e-3, 1.0, 1.0)),
        ("w [rad/s],re,im", (2 * np.pi, 1.0, 1.0)),
        ("f [Hz],amplitude,phase [deg]", "deg"),
        ("f,gain,lag [rad]", "rad"),
    ],
)
def test_the_head_of_a_table_of_a_response_is_read(head, columns, tmp_path):
    hertz, value = np.array([10.0, 20.0, 40.0]), np.exp(-0.3j * np.arange(1, 4)) * [0.9, 0.8, 0.7]
    if isinstance(columns, str):
        rows = np.column_stack([hertz, np.abs(value), np.angle(value, deg=columns == "deg")])
    else:
        rows = np.column_stack([hertz, value.real, value.imag]) * columns
    write_table(tmp_path / "amp.csv", head, rows)
    found = dynamics_of(DynamicsEntry(table="amp.csv"), actuator=True, folder=tmp_path)
    np.testing.assert_allclose(found.frequency, hertz, rtol=1e-12)
    np.testing.assert_allclose(found.measured, value, rtol=1e-12)


@pytest.mark.parametrize("head", ["f,mag [dB],phase [deg]", "f,amplitude,phase", "f [s],re,im"])
def test_a_response_in_other_terms_is_refused(head, tmp_path):
    write_table(tmp_path / "amp.csv", head, np.arange(9.0).reshape(3, 3))
    with pytest.raises(InputError, match=r"amp\.csv: .*(amplitude and phase|does not convert|s )"):
        dynamics_of(DynamicsEntry(table="amp.csv"), actuator=True, folder=tmp_path)


def test_an_offset_is_taken_off_the_reading(tmp_path):
    """A sensor that counts from its housing: the law of the magnet wants the place in its gap."""
    rng = np.random.default_rng(4)
    current, place = 0.1 * rng.normal(size=(2, 800)), 5e-3 + 1e-5 * rng.normal(size=(2, 800))
    columns = np.column_stack([current.T + 0.2, 1e3 * place.T])
    write_table(tmp_path / "run.csv", "ix,iy,px,py", columns, fmt="%.17g")
    law = 'law = "differential", K = "1e-5 N m^2/A^2", bias = "2 A", gap = "0.5 mm"'
    channels = [
        f'F_{c} = {{ {law}, position = "{c}", current = {{ column = "i{c}", unit = "A", '
        f'offset = "200 mA" }} }}\n{c} = {{ column = "p{c}", unit = "mm", offset = "5 mm" }}'
        for c in "xy"
    ]
    head = 'model = "jeffcott"\n[[records]]\nfile = "run.csv"\nsample_rate = "2 kHz"\n'
    text = f"{head}fundamental = '10 Hz'\nharmonics = [1]\n[channels]\n" + "\n".join(channels)
    (record,) = load(tmp_path, text).measured()
    np.testing.assert_allclose(record.column("x"), place[0] - 5e-3, atol=1e-15)
    force = Differential(K=1e-5, bias=2.0, gap=5e-4).force(current[1], place[1] - 5e-3)
    np.testing.assert_allclose(record.column("F_y"), force, rtol=1e-9, atol=1e-9)
    for old, new, told in (
        (', offset = "5 mm"', "", r"position .*, beyond|gap"),
        ('"5 mm"', '"5 A"', r"channels.x.offset: .*'A'"),
    ):
        with pytest.raises(InputError, match=told):
            load(tmp_path, text.replace(old, new)).measured()
