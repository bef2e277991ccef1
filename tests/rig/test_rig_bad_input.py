"""What may go wrong with a rig or its record: one line each, exit code 2, nothing written."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rotorid import InputError
from rotorid.cli import run
from rotorid.force.laws import Differential
from rotorid.rig.file import load_rig, parse_rig
from rotorid.rig.parts import Actuator, Coil
from rotorid.rig.rig import RigError

TEXT = load_rig("three-mass").text
MAGNETS = """law = "differential"
K = "5e-6 N m^2/A^2"
bias = "1.5 A"
gap = "0.5 mm"
"""


def with_magnets(extra: str = "", old: str = "", new: str = "") -> str:
    head, rest = TEXT.split("[actuators.all]")
    magnets = MAGNETS.replace(old, new) if old else MAGNETS
    return f"{head}[actuators.all]\n{magnets}{extra}\n[sensors]{rest.split('[sensors]')[1]}"


def one_line(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> str:
    assert run(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert re.search(r"found .+; expected .+; .+", printed.err), printed.err
    return printed.err


RIGS = {
    "unstable: sign": (
        TEXT.replace('stiffness = "2e5 N/m"', 'stiffness = "-2e5 N/m"'),
        r"an unstable loop at 879.646 rad/s: .* every [\d.e-]+ s with .* Hz, most of all at F_",
    ),
    "unstable: delay": (TEXT.replace('"50 us"', '"900 us"'), "shorten the delay"),
    "unstable: no damping": (
        TEXT.replace('damping = "800 N s/m"', 'damping = "-1 N s/m"'),
        "add damping",
    ),
    "touches": (
        TEXT.replace('"250 um"', '"80 um"'),
        r"touching the auxiliary bearing at F_\w+, 0\.\d+ s after switching on; expected a disp"
        r"lacement below the clearance of 80 um",
    ),
    "zero gap": (with_magnets(old='"0.5 mm"', new='"0 mm"'), "gap = 0.0; expected more than 0 m"),
    "limit beyond bias": (with_magnets('limit = "2 A"'), "a current limit of 2 A beyond the bias"),
    "current beyond bias": (
        with_magnets(old='bias = "1.5 A"', new='bias = "0.4 A"'),
        r"a current of -?\d\.\d+ A at F_\w+, [\d.]+ s after switching on; expected less than the "
        "bias of 0.4 A",
    ),
}


@pytest.mark.parametrize("fault", RIGS)
def test_a_rig_that_cannot_run(fault: str, tmp_path: Path, capsys) -> None:
    text, message = RIGS[fault]
    rig, out = tmp_path / "rig.toml", tmp_path / "run.h5"
    rig.write_text(text)
    line = one_line(capsys, ["simulate", str(rig), "--out", str(out)])
    assert re.search(message, line), line
    assert "rig" in line.split("found")[0]
    assert not out.exists()
    assert not out.with_suffix(".toml").exists()


def test_faults_tell_when_and_where() -> None:
    with pytest.raises(RigError) as caught:
        parse_rig(RIGS["touches"][0]).run()
    assert 0 < caught.value.time < 2.0
    assert caught.value.where in load_rig("three-mass").rig.model.inputs
    with pytest.raises(RigError) as caught:
        parse_rig(RIGS["unstable: sign"][0]).run()
    assert caught.value.time == 0.0


def test_the_time_of_touching_is_right() -> None:
    rig = replace(load_rig("three-mass").rig, settling=0.0, clearance=1.0)
    free = rig.run(0.1, np.random.default_rng(0)).truth.position
    radius = np.maximum(np.hypot(*free[:, [0, 1]].T), np.hypot(*free[:, [6, 7]].T))
    first = np.flatnonzero(radius > 80e-6)[0] / 10e3
    with pytest.raises(RigError) as caught:
        replace(rig, clearance=80e-6).run(0.1, np.random.default_rng(0))
    assert caught.value.time == pytest.approx(first, abs=1e-4)


@pytest.mark.parametrize("slew", [np.inf, 5e4])
def test_magnets_touch_at_their_gap_at_the_latest(magnetic, slew: float) -> None:
    shaken = replace(magnetic, excitation=magnetic.excitation.scaled(8 * np.ones(4)))
    parts = {
        name: replace(part, slew=slew, bandwidth=2000.0) for name, part in shaken.actuators.items()
    }
    with pytest.raises(RigError, match="expected a displacement below the clearance of 500 um"):
        replace(shaken, clearance=1.0, actuators=parts).run(1.0, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: {"actuators": {}}, "actuators: found no actuator of F_x1"),
        (lambda r: {"actuators": {**r.actuators, "F": Actuator()}}, "actuators: found 'F'"),
        (lambda r: {"feedback": ("x1", "y1", "x3", "y9")}, "feedback: found 'y9'"),
        (lambda r: {"feedback": ("x1", "y1", "x3")}, "from 4 positions to 4 commands"),
        (lambda r: {"clearance": 0.0}, "clearance: found 0.0"),
        (lambda r: {"settling": -1.0}, "settling: found -1.0"),
    ],
)
def test_parts_that_do_not_fit(change: Callable, message: str) -> None:
    rig = load_rig("three-mass").rig
    with pytest.raises(InputError, match=message):
        replace(rig, **change(rig))


def test_a_coil_needs_a_bias() -> None:
    law = Differential(constant=5e-6, bias=0.0, gap=5e-4)
    with pytest.raises(InputError, match=r"coil: found a coil of magnets without bias; expected a"):
        Actuator(law, coil=Coil(resistance=2.0, inductance=0.03, bandwidth=800.0))


def test_out_must_be_hdf5_and_not_the_rig(tmp_path: Path, capsys) -> None:
    assert "the ending '.csv'" in one_line(
        capsys, ["simulate", "three-mass", "--out", str(tmp_path / "run.csv")]
    )
    rig = tmp_path / "rig.toml"
    rig.write_text(TEXT)
    line = one_line(capsys, ["simulate", str(rig), "--out", str(tmp_path / "rig.h5")])
    assert "where the experiment file goes" in line
    assert rig.read_text() == TEXT
    nowhere = str(tmp_path / "no" / "run.h5")
    assert "no such folder" in one_line(capsys, ["simulate", "three-mass", "--out", nowhere])


@pytest.fixture
def marked(tmp_path: Path) -> Callable[[str, Callable], Path]:
    """A short record with a mark of the angle, one of its columns spoiled."""

    def write(mark: str, spoil: dict[str, Callable]) -> Path:
        rig = tmp_path / "rig.toml"
        rig.write_text(TEXT.replace('"13 s"', '"1 s"') + mark + "\n")
        assert run(["simulate", str(rig), "--out", str(tmp_path / "run.h5")]) == 0
        with h5py.File(tmp_path / "run.h5", "r+") as data:
            for name, change in spoil.items():
                data[name][...] = change(data[name][...])
        return tmp_path / "run.toml"

    return write


ENCODER, KEYPHASOR = "encoder = { lines = 1024 }", "keyphasor = {}"


def turned_around(column: np.ndarray) -> np.ndarray:
    half = len(column) // 2
    return np.concatenate([column[:half], column[:half][::-1]])


MARKS = {
    "no pulse": (
        KEYPHASOR,
        {"keyphasor": np.zeros_like},
        "run.h5: found a column without a pulse",
    ),
    "turns around": (
        ENCODER,
        {"encoder": turned_around},
        r"run.h5: found an encoder that turns around",
    ),
}


@pytest.mark.parametrize("fault", MARKS)
def test_marks_that_give_no_angle(fault: str, marked, capsys) -> None:
    mark, spoil, message = MARKS[fault]
    experiment = marked(mark, spoil)
    capsys.readouterr()
    line = one_line(capsys, ["identify", str(experiment), "--method", "batch"])
    assert re.search(message, line), line


def test_sample_times_that_jump(marked, capsys) -> None:
    def jump(time: np.ndarray) -> np.ndarray:
        time[7000:] += 3e-4
        return time

    experiment = marked("", {"t": jump})
    text = experiment.read_text().replace('sample_rate = "10000 Hz"', 'time = "t"')
    experiment.write_text(text)
    capsys.readouterr()
    line = one_line(capsys, ["identify", str(experiment), "--method", "batch"])
    assert re.search(r"run.h5: time: found a step of 0.0004 s after sample 6999", line), line


LAW = 'law = "linear"'
CHANNELS = {
    "current beyond bias": (
        LAW + ".*",
        'law = "differential", current = { column = "i_x1", unit = "A" }, position = "x1", '
        'K = "1e-6 N m^2/A^2", bias = "0.2 A", gap = "0.5 mm" }',
        r"run.h5: F_x1: found current -?[\d.]+ A at sample \d+, \d+ such in all; expected less "
        "than the bias of 0.2 A",
    ),
    "zero gap": (
        LAW + ".*",
        'law = "differential", current = { column = "i_x1", unit = "A" }, position = "x1", '
        'K = "1e-6 N m^2/A^2", bias = "2 A", gap = "0 mm" }',
        "run.toml: channels.F_x1: gap: found gap = 0.0",
    ),
    "no constant": (', ki = "120 N/A"', "", "run.toml: channels.F_x1: found no ki"),
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
        'ks = "200000 N/m"',
        'ks = { value = "2e5 N/m", std = "1e4 N/m" }',
        "channels.F_x1.ks: found a deviation of ks",
    ),
    "a law for a coordinate": (
        r"\nx1 = .*",
        '\nx1 = { law = "linear", current = { column = "x1" }, position = "x2", ki = "1 N/A" }',
        "channels.x1: found a force law for x1",
    ),
    "no sensor there": (
        r"\nx1 = .*",
        "",
        "no sensors that give the displacement 1*x1",
    ),
    "speed and mark": (
        r'speed = "[^"]*"',
        'speed = "8400 rpm"\nkeyphasor = "x1"',
        "records.0: speed, keyphasor: found both",
    ),
    "phase and mark": (
        r'speed = "[^"]*"\nphase = "[^"]*"',
        'phase = "3 deg"\nkeyphasor = "x1"',
        "records.0: phase, keyphasor: found both",
    ),
    "angle without scale": (
        r'speed = "[^"]*"',
        'angle = { column = "x1" }',
        "records.0.angle: found column alone; expected the unit",
    ),
}


@pytest.mark.parametrize("fault", CHANNELS)
def test_channels_that_give_no_force(fault: str, marked, capsys) -> None:
    pattern, new, message = CHANNELS[fault]
    experiment = marked("", {})
    text, count = re.subn(pattern, new, experiment.read_text(), count=1)
    assert count == 1
    experiment.write_text(text)
    capsys.readouterr()
    line = one_line(capsys, ["identify", str(experiment), "--method", "batch"])
    assert message in line or re.search(message, line), line
