"""Rig files, and what is refused in them."""

import re
import time
from collections.abc import Callable
from dataclasses import replace

import h5py
import numpy as np
import pytest
from rigs import recorded, with_actuators, with_magnets
from working_folder import simulated

import rotorid as rid
from rotorid import InputError, load_experiment, load_rig
from rotorid.force.laws import Differential, Linear
from rotorid.rig.files import experiment_text, record_bytes
from rotorid.rig.parts import Actuator, Coil, Encoder
from rotorid.rig.rig import RigError, growth
from rotorid.signals.multisine import multisine
from rotorid.testing import parse_rig

# Rig files, the shipped ones and others; and the files that a rig leaves.


TEXT = load_rig("three-mass").text


def changed(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new)


def test_the_seeds_rotor_as_it_is_described():
    plan = load_rig("three-mass")
    rig = plan.rig
    assert plan.duration == 13.0
    assert rig.rotation.speed == pytest.approx(2 * np.pi * 140.0)
    assert rig.parts[0].law == Linear(ki=120.0, ks=2e5)
    assert rig.parts[0].noise * 120.0 == pytest.approx(1.0)
    assert {sensor.noise for sensor in rig.sensors} == {2e-6}
    assert set(rig.process_noise.values()) == {2.0}
    t = np.arange(500) / 10e3
    turns = 2 * np.pi * 20.0 * np.multiply.outer(t, [1, 3, 5, 7, 9, 11])
    seed = (10 * np.sin(turns) + 10 * np.cos(turns)).sum(axis=1)
    shares = np.array([0.5, 1.0, 1.0, -0.5])
    np.testing.assert_allclose(rig.excitation.samples(10e3), np.outer(seed, shares), atol=1e-10)


@pytest.mark.parametrize("name", ["flexible", "rigid", "three-mass"])
def test_shipped_rigs_float_at_rest_and_at_speed(name):
    rig = load_rig(name).rig
    for speed in (0.0, rig.rotation.speed / 2, rig.rotation.speed):
        turning = replace(rig, rotation=replace(rig.rotation, speed=speed))
        assert growth(turning, turning.plant(1.0), speed)[0] < -5.0


def test_one_actuator_may_differ_and_parameters_replace_nominal_values():
    text = changed("[sensors]", '[actuators.F_y1]\nki = "100 N/A"\nnoise = "1 mA"\n\n[sensors]')
    rig = parse_rig(text + '\n[parameters]\nm2 = "11 kg"\nL1 = "25 cm"\n').rig
    assert [part.law.ki for part in rig.parts] == [120.0, 100.0, 120.0, 120.0]
    assert (rig.parts[1].law.ks, rig.parts[1].noise) == (2e5, 1e-3)
    assert (rig.values["m2"], rig.values["L1"]) == (11.0, 0.25)


def test_rigid_rig_holds_every_kind_of_key():
    rig = load_rig("rigid").rig
    part = rig.parts[0]
    assert isinstance(part.law, Differential)
    assert part.slew == pytest.approx(150.0 / 25e-3)
    assert rig.logger.angle == Encoder(1024, np.radians(0.05))
    assert rig.feedback == ("s_xa", "s_ya", "s_xb", "s_yb")
    assert rig.excitation.crest_factor.max() < 1.5


TF = 'kind = "transfer-function"\n'
PID = re.search(r"stiffness.*\n.*\n.*\n.*\n", TEXT).group()


def test_a_transfer_function_on_every_axis():
    keys = TF + "numerator = [-9e3, 8.7e3]\ndenominator = [1.0, -0.2]\n"
    controller = parse_rig(changed(PID, keys)).rig.controller
    z = np.exp(2j * np.pi * 100.0 * 1e-4)
    expected = (-9e3 * z + 8.7e3) / (z - 0.2)
    found = controller.response([200 * np.pi])[0]
    np.testing.assert_allclose(found, expected * np.eye(4), atol=1e-6)


def test_a_gain_may_be_zero():
    controller = parse_rig(changed('damping = "800 N s/m"', 'damping = "0 N s/m"')).rig.controller
    np.testing.assert_allclose(np.diag(controller.D), -(2e5 + 2e5) / 120.0)


def test_a_state_space():
    D = (-4e3 * np.eye(4)).tolist()
    controller = parse_rig(changed(PID, f'kind = "state-space"\nD = {D}\n')).rig.controller
    np.testing.assert_array_equal(controller.D, D)
    assert controller.states == 0


def test_feedback_from_named_sensors():
    text = changed("x1 = { noise", 's1 = { reads = "x1 + 0.01*theta_y", noise')
    with pytest.raises(InputError, match=r"controller: feedback: found no sensor .* at F_x1"):
        parse_rig(text)
    wired = text.replace("[controller]", '[controller]\nfeedback = { F_x1 = "s1" }', 1)
    assert parse_rig(wired).rig.feedback == ("s1", "y1", "x3", "y3")


def test_multisines_of_a_file():
    old = TEXT[TEXT.index("harmonics = ") : TEXT.index("[excitation.signals]")]
    text = changed(old, 'odd = 39\nleave_out = 4\nphases = "random"\nseed = 3\n\n')
    with pytest.raises(InputError, match=r"excitation.seed: found the unknown key 'seed'"):
        parse_rig(text)
    assert len(parse_rig(text.replace("seed = 3\n", "")).rig.excitation.harmonics) == 15
    full = parse_rig(changed(old, "full = 12\napart = true\n\n")).rig.excitation
    assert (np.count_nonzero(full.amplitudes, axis=1) == 1).all()
    most = parse_rig(changed("harmonics = [1, 3, 5, 7, 9, 11]", "full = 250")).rig
    assert len(most.excitation.harmonics) == 250


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("harmonics = [1, 3, 5, 7, 9, 11]", "odd = 1000000001", "excitation: found lines up to"),
        ("harmonics = [1, 3, 5, 7, 9, 11]", "full = 251", "up to 5020 Hz; expected at most half"),
        ('"20 Hz"', '"1 uHz"', r"fundamental: found a period of 1e\+10"),
        ('delay = "50 us"', 'delay = "500 s"', "delay: found 500 s; expected at most 100 steps"),
    ],
)
def test_what_would_fill_the_memory_is_refused(old, new, message):
    started = time.process_time()
    with pytest.raises(InputError, match=message):
        _ = parse_rig(changed(old, new)).rig.schedule
    assert time.process_time() - started < 1


def test_currents_as_excitation():
    text = re.sub(r'amplitude = "[\d.]+ N"', 'amplitude = "50 mA"', TEXT)
    excitation = parse_rig(text).rig.excitation
    assert excitation.unit == "A"
    np.testing.assert_allclose(np.abs(excitation.amplitudes), 0.05)


BAD = [
    ("[rotation]", "[rotatoin]", "rotatoin: found the unknown key 'rotatoin'.*did you mean"),
    ('"13 s"', '"13 m"', "duration: found unit 'm'; expected a unit that converts to s"),
    ('rate = "10 kHz"', 'rate = "0 Hz"', "controller: rate: found 0.0 Hz; expected more than 0"),
    ('"2 s"', '"61 s"', "settling: found 61 s; expected at most 60 s, or as long"),
    ('"13 s"', '"0 s"', "duration: found 0.0 s; expected one sample or more"),
    ('"13 s"', '"1e9 s"', r"duration: found 1e\+13 samples.*expected at most 5000000"),
    ('ki = "120 N/A"', "", "actuators.all: found no ki"),
    ('ki = "120 N/A"', 'ki = "0 N/A"', "actuators.all: ki: found ki = 0.0"),
    ('limit = "3 A"', 'limit = "3 N"', "actuators.all: limit: found unit 'N'"),
    ('limit = "3 A"', 'gap = "1 mm"', "gap with the linear law"),
    ('limit = "3 A"', 'supply = "60 V"', "one of supply and inductance"),
    ('limit = "3 A"', 'supply = "60 V"\ninductance = "20 mH"', "a slew limit without bandwidth"),
    ("x1 = { noise", "x9 = { noise", r"sensors: found 'x9'; expected one of x1, y1"),
    ('"2 um" }', '"2 kg" }', r"sensors.x1.noise: found unit 'kg'"),
    ('"2 um" }', '"-2 um" }', "sensors.x1: noise: found noise = -2e-06; expected 0 or more"),
    ("F_x1 = { amp", "F_x7 = { amp", "excitation: found 'F_x7'; expected one of F_x1"),
    ("[1, 3, 5, 7, 9, 11]", "[1, 3, 5000]", "sample_rate: found 10000 Hz for a line at 100000 Hz"),
    ("[1, 3, 5, 7, 9, 11]", "[3, 1]", "excitation: found harmonics .*increasing"),
    ("[1, 3, 5, 7, 9, 11]", "[1, 3]\nodd = 5", "excitation: found harmonics and odd"),
    ('fundamental = "20 Hz"', 'fundamental = "30 Hz"', "10000 Hz for a fundamental of 30 Hz"),
    ('F_x1 = "2 N"', 'theta_x = "2 N"', "process_noise.theta_x: found unit 'N'"),
    ('model = "three-mass"', 'model = "emps"', "sensors: found 'x1'; expected one of q"),
    ('stiffness = "2e5 N/m"', "", "controller: found no stiffness; expected stiffness and damping"),
    (PID, TF, "controller: found no numerator"),
    (PID, TF + "numerator = [1.0, 2.0]\ndenominator = [1.0]\n", "a controller cannot look ahead"),
    (PID, 'kind = "state-space"\nD = [[1.0]]\n', "a controller from 1 positions to 1 commands"),
    (PID, 'kind = "state-space"\n', "controller: found no D"),
    ('sample_rate = "10 kHz"', 'sample_rate = "10001 Hz"', "a ratio of whole numbers"),
    ('current = "command"', 'current = "amps"', "logger.current: found 'amps'"),
    ('current = "command"', "encoder = { lines = 10 }\nkeyphasor = {}", "encoder: found both"),
    ('current = "command"', "encoder = { lines = 0 }", "logger: lines: found lines = 0"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_bad_rig_files_are_refused(old, new, message):
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    with pytest.raises(InputError, match=message) as caught:
        parse_rig(text, name="my.toml", file="my.toml").run()
    assert str(caught.value).startswith("my.toml: ")
    assert "\n" not in str(caught.value)


def test_rigs_that_are_not_there():
    with pytest.raises(InputError, match="no rig 'three-mas'; expected one of flexible, rigid"):
        load_rig("three-mas")
    with pytest.raises(InputError, match=r"absent.toml: found no such file"):
        load_rig("absent.toml")
    with pytest.raises(InputError, match=r"odd.toml: found"):
        parse_rig(b"\xff\xfe", file="odd.toml")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    plan = parse_rig(TEXT.replace('"13 s"', '"1 s"'), name="short")
    record = plan.run()
    (folder / "run.h5").write_bytes(record_bytes(record, rig_text=plan.text))
    (folder / "run.toml").write_text(experiment_text(plan, record, "run.h5"))
    return folder


def test_the_loggers_file(written):
    columns = {f"i_{name}" for name in ("x1", "y1", "x3", "y3")}
    columns |= {*rid.load_model("three-mass").coordinates}
    assert set(rid.read_record(written / "run.h5", time="t").names) == columns  # and no truth
    with h5py.File(written / "run.h5") as data:
        assert set(data) == {"t", "truth"} | columns
        assert data["i_x1"].attrs["units"] == "A"
        assert data["theta_x"].attrs["units"] == "rad"
        np.testing.assert_allclose(data["t"][:3], [0.0, 1e-4, 2e-4])
        truth = data["truth"]
        assert truth["parameters"].attrs["m2"] == 11.322
        assert list(truth["force"].attrs["columns"]) == ["F_x1", "F_y1", "F_x3", "F_y3"]
        assert truth["position"].shape == (10_000, 8)
        assert truth.attrs["rig"].startswith("title = ")


def test_a_reader_makes_the_same_record(written):
    plan = parse_rig(TEXT.replace('"13 s"', '"1 s"'))
    (read,) = load_experiment(written / "run.toml").measured("ml")
    made = plan.run()
    for one, other in zip(read.channels, made.channels, strict=True):
        assert one.delay == pytest.approx(other.delay, abs=1e-15)
        assert replace(one, delay=other.delay) == other
    np.testing.assert_array_equal(read.samples, made.samples)
    assert read.speed == made.speed
    (as_forces,) = load_experiment(written / "run.toml").measured("batch")
    assert {c.unit for c in as_forces.channels} == {"N", "m", "rad"}


@pytest.mark.slow
def test_experiment_of_magnets_their_iron_and_combinations():
    text = load_rig("rigid").text.replace("[actuators.all]", '[actuators.all]\niron = "2e-5 m"')
    short = parse_rig(text.replace('"10 s"', '"0.3 s"'))
    text = experiment_text(short, short.run(), "run.h5")
    assert 'law = "differential"' in text
    assert 'iron = "2e-05 m"' in text
    assert 'position = "s_xa"' in text
    assert 's_xa = {reads = "x - 0.2*theta_y", column = "s_xa", unit = "m"}' in text
    assert 'L_a = {fixed = "0.2 m"}' in text
    assert 'angle = {column = "encoder", lines = 1024}' in text


@pytest.mark.slow
def test_flux_densities_through_the_files(tmp_path):
    old = 'bandwidth = "1.5 kHz"'
    flux = f'{old}\nflux = {{ area = "4 cm^2", noise = "0.1 mT" }}'
    plan = parse_rig(load_rig("rigid").text.replace(old, flux).replace('"10 s"', '"0.5 s"'))
    record = plan.run()
    text = experiment_text(plan, record, "run.h5")
    assert 'flux = [{column = "b1_xa", unit = "T"}, {column = "b2_xa", unit = "T"}]' in text
    (tmp_path / "run.h5").write_bytes(record_bytes(record))
    (tmp_path / "run.toml").write_text(text)
    (read,) = load_experiment(tmp_path / "run.toml").measured("batch")
    assert read.names[:4] == plan.rig.model.inputs
    np.testing.assert_allclose(read.samples[:, :4], record.samples[:, :4], atol=1e-9)


def test_a_rig_without_excitation_has_no_experiment():
    start, end = TEXT.index("[excitation]"), TEXT.index("[process_noise]")
    plan = parse_rig((TEXT[:start] + TEXT[end:]).replace('"13 s"', '"0.1 s"'))
    with pytest.raises(InputError, match=r"excitation: found a rig without excitation"):
        experiment_text(plan, plan.run(), "run.h5")


@pytest.fixture
def edited(written):
    """Return how a changed experiment file reads its record."""

    def read(method: str, change: Callable[[str], str] = str) -> rid.Record:
        file = written / "edited.toml"
        file.write_text(change((written / "run.toml").read_text()))
        return load_experiment(file).measured(method)[0]

    return read


def test_hold_and_delay_may_stand_beside_the_law(edited):
    def moved(text: str) -> str:
        text = re.sub(r', hold = "zero-order", delay = "-50 us"\}', "}", text)
        return text.replace(LAW, f'{LAW}, hold = "zero-order", delay = "-50 us"')

    np.testing.assert_array_equal(edited("batch").samples, edited("batch", moved).samples)


def test_a_record_may_name_sensors_of_all_records(edited):
    def own(text: str) -> str:
        (law,) = re.findall(r"\nF_x1 = .*", text)
        text = text.replace(law, "").replace("\nx1 = {", '\ns1 = {reads = "x1", ')
        own = law.replace('position = "x1"', 'position = "s1"')
        return text.replace("[channels]", f"[records.channels]{own}\n\n[channels]")

    one, other = edited("batch"), edited("batch", own)
    np.testing.assert_array_equal(one.column("F_x1"), other.column("F_x1"))


def test_deviations_of_constants_reach_the_gain(edited):
    known = 'ki = { value = "120 N/A", std = "1.2 N/A" }'
    record = edited("ml", lambda text: text.replace('ki = "120 N/A"', known, 1))
    assert record.channels[0].gain_std == pytest.approx(0.01)
    assert record.channels[1].gain_std == 0.0


# What may go wrong with a rig or its record: one line each, exit code 2, nothing written.


@pytest.fixture
def one_line(refusal):
    """Return the refusal of a command, which says what was found, what was expected, the cure."""

    def run(*arguments: object) -> str:
        line = refusal(*arguments)
        assert re.search(r"found .+; expected .+; .+", line), line
        return line

    return run


RIGS = {
    "unstable: sign": (
        changed('stiffness = "2e5 N/m"', 'stiffness = "-2e5 N/m"'),
        r"an unstable loop at 879.646 rad/s: .* every [\d.e-]+ s with .* Hz, most of all at F_",
    ),
    "unstable: delay": (changed('"50 us"', '"900 us"'), "shorten the delay"),
    "unstable: no damping": (changed('"800 N s/m"', '"-1 N s/m"'), "add damping"),
    "touches": (
        changed('"250 um"', '"80 um"'),
        r"touching the auxiliary bearing at F_\w+, 0\.\d+ s after switching on; expected a disp"
        r"lacement below the clearance of 80 um",
    ),
    "zero gap": (with_magnets(gap="0 mm"), "gap = 0.0; expected more than 0 m"),
    "limit beyond bias": (
        with_magnets(more='limit = "2 A"'),
        "a current limit of 2 A beyond the bias",
    ),
    "current beyond bias": (
        with_magnets(bias="0.4 A"),
        r"a current of -?\d\.\d+ A at F_\w+, [\d.]+ s after switching on; expected less than the "
        "bias of 0.4 A",
    ),
}


@pytest.mark.parametrize("fault", RIGS)
def test_a_rig_that_cannot_run(fault, tmp_path, one_line):
    text, message = RIGS[fault]
    rig, out = tmp_path / "rig.toml", tmp_path / "run.h5"
    rig.write_text(text)
    line = one_line("simulate", rig, "--out", out)
    assert re.search(message, line), line
    assert "rig" in line.split("found")[0]
    assert not out.exists()
    assert not out.with_suffix(".toml").exists()


def test_faults_tell_when_and_where():
    with pytest.raises(RigError, match=r"unstable.*from the first instant"):
        parse_rig(RIGS["unstable: sign"][0]).run()
    rig = replace(load_rig("three-mass").rig, settling=0.0, clearance=1.0)
    free = rig.run(0.1, np.random.default_rng(0)).truth.position
    radius = np.maximum(np.hypot(*free[:, [0, 1]].T), np.hypot(*free[:, [6, 7]].T))
    first = np.flatnonzero(radius > 80e-6)[0] / 10e3
    with pytest.raises(RigError, match="touching") as caught:
        replace(rig, clearance=80e-6).run(0.1, np.random.default_rng(0))
    where, when = re.search(r"at (\w+), (\S+) s after", str(caught.value)).groups()
    assert float(when) == pytest.approx(first, abs=1e-4)
    assert where in rig.model.inputs


@pytest.mark.parametrize("slew", [np.inf, 5e4])
def test_magnets_touch_at_their_gap_at_the_latest(magnetic, slew):
    excitation = magnetic.excitation.scaled(8 * np.ones(4))
    rig = with_actuators(magnetic, slew=slew, bandwidth=2000.0)
    with pytest.raises(RigError, match="expected a displacement below the clearance of 500 um"):
        recorded(replace(rig, clearance=1.0, excitation=excitation), 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: {"actuators": {}}, "actuators: found no actuator of F_x1"),
        (lambda r: {"actuators": {**r.actuators, "F": Actuator()}}, "actuators: found 'F'"),
        (lambda r: {"feedback": ("x1", "y1", "x3", "y9")}, "feedback: found 'y9'"),
        (lambda r: {"feedback": ("x1", "y1", "x3")}, "from 4 positions to 4 commands"),
        (lambda _: {"excitation": multisine(20.0, [1], {"F_z": 1.0})}, "excitation: found 'F_z'"),
        (lambda r: {"clearance": 0.0}, "clearance: found clearance = 0.0"),
        (lambda r: {"settling": -1.0}, "settling: found settling = -1.0"),
    ],
)
def test_parts_that_do_not_fit(change, message):
    rig = load_rig("three-mass").rig
    with pytest.raises(InputError, match=message):
        replace(rig, **change(rig))


def test_a_coil_needs_a_bias():
    law = Differential(K=5e-6, bias=0.0, gap=5e-4)
    with pytest.raises(InputError, match=r"coil: found a coil of magnets without bias; expected a"):
        Actuator(law, coil=Coil(resistance=2.0, inductance=0.03, bandwidth=800.0))


def test_out_must_be_hdf5_and_not_the_rig(tmp_path, one_line):
    for name, told in (("run.csv", "the ending '.csv'"), ("no/run.h5", "no such folder")):
        assert told in one_line("simulate", "three-mass", "--out", tmp_path / name)
    rig = tmp_path / "rig.toml"
    rig.write_text(TEXT)
    line = one_line("simulate", rig, "--out", tmp_path / "rig.h5")
    assert "where the experiment file goes" in line
    assert rig.read_text() == TEXT


def turned_around(column: np.ndarray) -> np.ndarray:
    half = len(column) // 2
    return np.concatenate([column[:half], column[:half][::-1]])


def jumping(time: np.ndarray) -> np.ndarray:
    return time + 3e-4 * (np.arange(len(time)) >= 7000)


SPOILT = {  # what marks the angle, the column that is spoilt, how, and what is told
    "no pulse": ("keyphasor = {}", "keyphasor", np.zeros_like, "a column without a pulse"),
    "turns around": (
        "encoder = { lines = 1024 }", "encoder", turned_around, "an encoder that turns around",
    ),
    "jumps": ("", "t", jumping, "a step of 0.0004 s after sample 6999"),
}  # fmt: skip


@pytest.mark.parametrize("fault", SPOILT)
def test_marks_that_give_no_angle_and_times_that_jump(fault, tmp_path, one_line):
    mark, column, spoil, message = SPOILT[fault]
    experiment = simulated(tmp_path, TEXT.replace('"13 s"', '"1 s"') + mark + "\n")
    with h5py.File(tmp_path / "run.h5", "r+") as data:
        data[column][...] = spoil(data[column][...])
    if column == "t":
        text = experiment.read_text().replace('sample_rate = "10000 Hz"', 'time = "t"')
        experiment.write_text(text)
    line = one_line("identify", experiment, "--method", "batch")
    assert re.search(f"run.h5: .*found {message}", line), line


LAW = 'law = "linear"'
MAGNETS = (
    'law = "differential", current = { column = "i_x1", unit = "A" }, position = "x1", '
    'K = "1e-6 N m^2/A^2", '
)
SPEED = r'speed = "[^"]*"'
CHANNELS = {
    "current beyond bias": (
        LAW + ".*",
        MAGNETS + 'bias = "0.2 A", gap = "0.5 mm" }',
        r"run.h5: F_x1: found current -?[\d.]+ A at sample \d+, \d+ such in all; expected less "
        "than the bias of 0.2 A",
    ),
    "zero gap": (
        LAW + ".*", MAGNETS + 'bias = "2 A", gap = "0 mm" }', "channels.F_x1: gap: found gap = 0.0"
    ),
    "no constant": (', ki = "120 N/A"', "", "channels.F_x1: found no ki"),
    "constant of another law": (', ki = "120 N/A"', ', ki = "1 N/A", gap = "1 mm"', "gap with the"),
    "unknown position": ('position = "x1"', 'position = "x7"', "channels.F_x1: position: found"),
    "no current": (r"current = \{[^}]*\}, ", "", "channels.F_x1: current: found no such key"),
    "a column beside a law": (LAW, LAW + ', column = "x1"', "channels.F_x1: column: found column"),
    "hold twice": (LAW, LAW + ', hold = "none"', "hold here and in the column's table"),
    "a constant with a deviation": (
        'ki = "120 N/A"',
        'ki = { value = "120 N/A", std = "1 N/A" }',
        "channels.F_x1.ki: found a deviation; expected exact values, the same in all records, "
        "for this method; use ml",
    ),
    "ks with a deviation": (
        'ks = "200000 N/m"', 'ks = { value = "2e5 N/m", std = "1e4 N/m" }',
        "channels.F_x1.ks: found a deviation of ks",
    ),
    "a law for a coordinate": (
        r"\nx1 = .*",
        '\nx1 = { law = "linear", current = { column = "x1" }, position = "x2", ki = "1 N/A" }',
        "channels.x1: found a force law for x1",
    ),
    "no sensor there": (r"\nx1 = .*", "", "no sensors that give the displacement 1*x1"),
    "speed and mark": (
        SPEED, 'speed = "8400 rpm"\nkeyphasor = "x1"', "records.0: speed, keyphasor: found both"
    ),
    "phase and mark": (
        SPEED + r'\nphase = "[^"]*"', 'phase = "3 deg"\nkeyphasor = "x1"',
        "records.0: phase, keyphasor: found both",
    ),
    "angle without scale": (
        SPEED, 'angle = { column = "x1" }', "records.0.angle: found column alone; expected the unit"
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", CHANNELS)
def test_channels_that_give_no_force(fault, written, one_line):
    pattern, new, message = CHANNELS[fault]
    text, count = re.subn(pattern, new, (written / "run.toml").read_text(), count=1)
    assert count == 1
    experiment = written / "wrong.toml"
    experiment.write_text(text.replace("run.toml", "wrong.toml"))
    line = one_line("identify", experiment, "--method", "batch")
    assert message in line or re.search(message, line), line
