"""`rotorid new`: a draft from records alone, refused until it is complete, then right."""

import re
from dataclasses import replace
from pathlib import Path
from tomllib import loads as parse

import h5py
import numpy as np
import pytest
import scipy.interpolate
import scipy.io
from io_writers import write_table
from working_folder import load, shaken

import rotorid as rid
from rotorid import InputError
from rotorid.experiment import draft as draft_module
from rotorid.experiment.draft import (
    _LIKE,
    Found,
    assign,
    by_planes,
    currents,
    draft,
    is_excitation,
    likeness,
    role_of,
    sensors_at_inputs,
)
from rotorid.signals.period_search import Period

MODEL = rid.load_model("jeffcott")
RATE = 2000.0
SHAKEN = shaken(periods=12, speed=0.0, noise=1e-3)
TIME = 1e3 * np.arange(len(SHAKEN.samples)) / RATE


def write_csv(path: Path) -> Path:
    names = "Time [ms],Fx [N],Fy [N],px [um],py [um]"
    write_table(path, names, TIME, SHAKEN.samples * [1, 1, 1e6, 1e6], fmt="%.10g")
    return path


def test_a_record_of_a_logger(tmp_path):
    text = draft([write_csv(tmp_path / "run.csv")], "jeffcott", tmp_path)
    found = parse(text)
    (record,) = found["records"]
    assert record["file"] == "run.csv"
    assert record["time"] == "Time"
    assert record["fundamental"] == "10 Hz"
    assert record["harmonics"] == [1, 2, 5]
    assert record["speed"] == "?"
    assert found["channels"] == {
        "F_x": {"column": "Fx", "unit": "N"},
        "F_y": {"column": "Fy", "unit": "N"},
        "x": {"column": "px", "unit": "um"},
        "y": {"column": "py", "unit": "um"},
    }
    assert '# m = { start = "5 kg" }' in text
    assert "fixed" not in text  # nobody measures an eccentricity by a ruler
    with pytest.raises(InputError, match=r'found "\?" for speed of records.0; .*comments'):
        load(tmp_path, text)
    estimate = load(tmp_path, text.replace('speed = "?"', 'speed = "0 rpm"')).identify()
    assert estimate.value("m") == pytest.approx(MODEL.nominal["m"], rel=1e-3)


def test_files_of_one_clock_are_one_record(tmp_path, output):
    for name, columns in (("forces", (0, 1)), ("positions", (2, 3))):
        with h5py.File(tmp_path / f"{name}.h5", "w") as data:
            for column in columns:
                data[SHAKEN.names[column]] = SHAKEN.samples[:, column]
    files = [tmp_path / "forces.h5", tmp_path / "positions.h5"]
    text = draft(files, "jeffcott", tmp_path)
    (entry,) = parse(text)["records"]
    assert entry["files"] == ["forces.h5", "positions.h5"]
    assert entry["sample_rate"] == "?"
    assert entry["period_samples"] == 200
    assert parse(text)["channels"]["F_x"] == {"column": "F_x", "unit": "?"}
    for file in files:
        with h5py.File(file, "a") as data:
            data["time_s"] = np.arange(len(TIME)) / RATE
    text = draft(files, "jeffcott", tmp_path)
    (entry,) = parse(text)["records"]
    assert entry["time"] == {"column": "forces.h5:time_s", "unit": "s"}
    path = tmp_path / "experiment.toml"
    path.write_text(text, encoding="utf-8")
    output("inspect", path, "--quiet")


def test_what_is_left_open_is_told_in_one_line(tmp_path, output, refusal):
    np.savetxt(tmp_path / "run.txt", np.random.default_rng(1).normal(size=(300, 3)))
    out = tmp_path / "experiment.toml"
    new = ("new", tmp_path / "run.txt", "--out", out)
    output(*new)
    found = parse(out.read_text())
    assert found["model"] == "?"
    assert found["records"][0]["band"] == ["?", "?"]
    assert "# not used: 2" in out.read_text()
    told = refusal("identify", out)
    assert 'found "?" for model; sample_rate, speed, band of records.0; expected' in told
    output(*new)  # nobody edited it
    out.write_text(out.read_text().replace('"?"', '"jeffcott"', 1))
    assert "choose another name" in refusal(*new)
    for command, name in (("new", "gone.csv"), ("inspect", "gone.csv"), ("inspect", "gone.toml")):
        told = refusal(command, tmp_path / name)
        assert f"{name}: found no such file; expected a " in told


def test_arrays_of_a_matlab_file(tmp_path, output):
    """Matrices, however they lie, are columns, and scalars state the rate."""
    rng = np.random.default_rng(3)
    across, down = rng.normal(size=(3, 400)), rng.normal(size=(400, 2))
    held = {"Acceleration": across, "result": down, "K": np.eye(3), "Fs": 400.0}
    scipy.io.savemat(tmp_path / "run.mat", held)
    out = tmp_path / "run.toml"
    told = output("new", tmp_path / "run.mat", "--model", "jeffcott", "--out", out)
    named = "4 things open: speed of records.0; column of channels.F_x, channels.F_y, channels.x"
    assert f"wrote {out}: {named}; next: rotorid inspect {out}" in told
    text = out.read_text()
    assert f"# {named}." in text
    assert parse(text)["records"][0]["sample_rate"] == "400 Hz"
    used = re.findall(r"# not used: ([^,]+),", text)
    assert used == [*(f"Acceleration[{k}]" for k in range(3)), "result[0]", "result[1]"]
    assert "# Acceleration, 3 x 400: its columns are Acceleration[0] to Acceleration[2]" in text
    assert "# K, 3 x 3: no columns of 400 samples" in text
    record = rid.read_record(tmp_path / "run.mat", sample_rate=400.0)
    assert np.array_equal(record.column("Acceleration[2]"), across[2])
    scipy.io.savemat(tmp_path / "run.mat", {"result": down, "dt": 0.01, "Fs": 0.0})
    assert (
        parse(draft([tmp_path / "run.mat"], None, tmp_path))["records"][0]["sample_rate"]
        == "100 Hz"
    )


def test_matrices_of_another_group_are_told_and_no_columns(tmp_path):
    """As the truth beside a simulated record: nothing of it is inspected."""
    path, rows = tmp_path / "run.h5", np.random.default_rng(1).normal(size=(300, 2))
    with h5py.File(path, "w") as data:
        data["truth/force"] = rows
    assert rid.read_record(path, sample_rate=1e3).names == ("force[0]", "force[1]")
    with h5py.File(path, "a") as data:
        data["x"] = rows[:, 0]
    assert rid.read_record(path, sample_rate=1e3).names == ("x",)
    text = draft([path], None, tmp_path)
    assert "# truth/force, 300 x 2: its columns are truth/force[0] to truth/force[1]" in text
    assert "not used: force" not in text
    # A column whose name a matrix of another group has too is named by its whole path.
    groups = {"first": {"values": rows}, "second": {"values": rows[:, 0]}}
    scipy.io.savemat(tmp_path / "run.mat", groups)
    text = draft([tmp_path / "run.mat"], None, tmp_path)
    assert "# not used: second/values, " in text
    assert "# first/values, 300 x 2: its columns are first/values[0] to first/values[1]" in text


@pytest.mark.parametrize(("step", "time"), [(0.0025, {"column": "0", "unit": "s"}), (1.0, None)])
def test_equal_steps_without_a_name_are_times_unless_they_count(tmp_path, step, time):
    noise = np.random.default_rng(1).normal(size=400)
    np.savetxt(tmp_path / "run.csv", np.column_stack([step * np.arange(400), noise]), delimiter=",")
    assert parse(draft([tmp_path / "run.csv"], None, tmp_path))["records"][0].get("time") == time


@pytest.mark.parametrize(("other", "found"), [(250, 500), (173, None)])
def test_a_period_is_one_that_columns_share(tmp_path, other, found):
    """What comes back in its own time in every column is no period."""
    rng, place = np.random.default_rng(2), np.arange(4000)
    columns = [rng.normal(size=n)[place % n] for n in (500, other)]
    write_table(tmp_path / "run.csv", "a,b", np.column_stack(columns))
    assert (
        parse(draft([tmp_path / "run.csv"], None, tmp_path))["records"][0].get("period_samples")
        == found
    )


@pytest.mark.parametrize(("rises", "found"), [([0], None), ([0, 7], 50)])
def test_a_mark_is_no_excitation_but_two_levels_that_jump_unevenly_are(tmp_path, rises, found):
    noise = np.random.default_rng(3).normal(size=(4000, 2))
    two = 5.0 * np.isin(np.arange(4000) % 50, rises)
    write_table(tmp_path / "run.csv", "a,b,c", np.column_stack([noise, two]))
    (record,) = parse(draft([tmp_path / "run.csv"], "jeffcott", tmp_path))["records"]
    assert record.get("period_samples") == found


@pytest.mark.parametrize("repeats", [True, False])
def test_a_band_ends_below_half_the_sample_rate(tmp_path, repeats):
    rate, rng, place = 12356.7, np.random.default_rng(4), np.arange(4000)
    noise = rng.normal(size=(4000, 2))[place % 250 if repeats else place]
    write_table(tmp_path / "run.csv", "t_s,F_x,x", np.column_stack([place / rate, noise]))
    (record,) = parse(draft([tmp_path / "run.csv"], "jeffcott", tmp_path))["records"]
    assert 0.99 * rate / 2 < float(record["band"][1].split()[0]) <= rate / 2


def test_a_nonlinear_model_takes_every_line(tmp_path):
    place = np.arange(4000) / 500
    motion = np.sin(2 * np.pi * place) + 0.3 * np.sin(6 * np.pi * place)
    write_table(tmp_path / "run.csv", "q_m,F_N", np.column_stack([motion, motion]))
    (record,) = parse(draft([tmp_path / "run.csv"], "emps", tmp_path))["records"]
    assert record["period_samples"] == 500
    assert "harmonics" not in record
    assert record["band"] == ["?", "?"]  # the sample rate is open


def test_currents_need_a_law(tmp_path):
    names, speed = "t [ms],i_x [A],i_y [A],x [um],y [um],n_rpm", np.full(len(TIME), 1800.0)
    write_table(tmp_path / "run.csv", names, TIME, SHAKEN.samples, speed)
    found = parse(draft([tmp_path / "run.csv"], "jeffcott", tmp_path))
    law = {"law": "linear", "current": {"column": "i_x", "unit": "A"}}
    assert found["channels"]["F_x"] == law | {"position": "x", "ki": "?", "ks": "?"}
    assert found["records"][0]["speed"] == "1800 rpm"


def write_planes(path: Path, places: str, *kinds: str) -> Path:
    """Write noise as the columns of several kinds at four places."""
    names = [kind.format(place) for kind in kinds for place in places.split()]
    table = np.random.default_rng(1).normal(size=(400, len(names)))
    write_table(path, ";".join(names), table, separator=";")
    return path


def test_currents_of_planes_are_those_of_the_model_in_their_order(tmp_path):
    """As forces and positions are: a logger's A and B, the displacement that does work beside."""
    path = write_planes(tmp_path / "run.csv", "AX AY BX BY", "I {} [A]", "Pos {} [um]")
    text = draft([path], "three-mass", tmp_path)
    channels = parse(text)["channels"]
    for name, column, position in (("F_x1", "I AX", "x1"), ("F_y3", "I BY", "y3")):
        assert channels[name]["current"]["column"] == column
        assert channels[name]["position"] == position
    assert "taken A for 1, B for 3, by their order: check" in text
    swapped = draft([path], "rigid", tmp_path)  # B of this model holds the lengths
    law = parse(swapped)["channels"]["F_ya"]
    assert (law["current"]["column"], law["position"]) == ("I AY", "y + L_a*theta_x")
    read = parse(swapped)["channels"]["s_ya"]
    assert read == {"reads": "y + L_a*theta_x", "column": "Pos AY", "unit": "um"}
    assert "x" not in parse(swapped)["channels"]  # a bearing's sensor is not at the centre of mass


def test_a_slash_between_plane_and_axis_is_no_path(tmp_path):
    path = write_planes(tmp_path / "run.csv", "A/X A/Y B/X B/Y", "I {} [mA]", "Weg {} [um]")
    channels = parse(draft([path], "rigid", tmp_path))["channels"]
    assert channels["F_xb"]["current"]["column"] == "I B/X"
    assert channels["s_xb"]["reads"] == "x + L_b*theta_y"
    assert "x" not in channels


@pytest.mark.parametrize(
    ("quantity", "column", "alike"),
    [
        ("F_x1", "Force x1", True),
        ("F_x1", "fx1", True),
        ("x1", "pos_x1", True),
        ("x1", "Sensor X1", True),
        ("x1", "px2", False),
        ("x1", "y1", False),
        ("F_x1", "F_x3", False),
        ("theta_x", "theta_y", False),
        ("F_xa", "F_xb", False),
    ],
)
def test_names(quantity, column, alike):
    assert (likeness(quantity, column, quantity.startswith("F")) >= _LIKE) == alike


def of_unit(unit: str | None, *names: str) -> list[Found]:
    return [Found(name, np.zeros(2), unit, "channel") for name in names]


def test_units_decide_between_names():
    columns = [*of_unit("N", "x"), *of_unit("um", "px")]
    assert assign(MODEL, columns)["x"].name == "px"
    assert assign(rid.load_model("emps"), of_unit(None, "qm", "qg")) == {}
    assert role_of("t", "N") == "channel"
    assert role_of("Time (s)", None) == "time"
    assert {role_of(name, None) for name in ("t/ms", "time_ms", "t [ms]", "run1/T_us")} == {"time"}
    assert {role_of(name, None) for name in ("ts", "times", "pt/ms", "test_s")} == {"channel"}
    assert role_of("log/enc", "deg") == "angle"
    assert currents(MODEL, columns, {}) == {}


def test_hostile_names_stay_in_their_comments(tmp_path):
    names = 't,"] model = ""x",b\x1b[31m\u2028= 1,""",\x07\n'
    path = tmp_path / "run.csv"
    path.write_text(names + "".join(f"{i},{i % 7},{i % 5},1,2\n" for i in range(99)))
    found = parse(draft([path], None, tmp_path))
    assert set(found) == {"model", "records", "channels"}
    assert found["channels"] == {}


def test_a_sweep_for_each_axis_as_a_logger_writes_it(tmp_path):
    """No period: the lines of the whole record, in the band of the sweep, by its references."""
    rate, count = 1000.0, 8000
    time = np.arange(count) / rate
    sweep = 3 * np.sin(2 * np.pi * (20 + 10 * time) * time)  # 20 to 180 Hz
    rng = np.random.default_rng(3)
    for axis in (0, 1):
        columns = np.zeros((count, 6))
        columns[:, axis] = columns[:, 2 + axis] = sweep
        columns[:, 2:] += 0.1 * rng.normal(size=(count, 4))
        header = "t [s],ex_x [N],ex_y [N],Fx [N],Fy [N],x [um],y [um]"
        write_table(tmp_path / f"{axis}.csv", header, time, columns)
    text = draft([tmp_path / "0.csv", tmp_path / "1.csv"], "jeffcott", tmp_path)
    for record, axis in zip(parse(text)["records"], "xy", strict=True):
        low, high = (float(end.removesuffix(" Hz")) for end in record["band"])
        assert 10 < low < 30
        assert 165 < high < 195
        assert record["references"] == [f"ex_{axis}"]
        assert "fundamental" not in record
    experiment = load(tmp_path, text.replace('speed = "?"', 'speed = "0 rpm"'))
    assert experiment.channels[0].sources["F_x"].column == "Fx"


PLANES = ("A X", "A Y", "B X", "B Y")


def write_sweep(path: Path, axis: int, *, marks: bool = True) -> Path:
    """Write one axis swept while the rotor turns, as a logger does that calls its planes A, B."""
    rate, count = 2000.0, 16_000
    time, rng = np.arange(count) / rate, np.random.default_rng(axis)
    sweep = 3 * np.sin(2 * np.pi * (20 + 20 * time) * time)  # 20 to 340 Hz
    turning = 2 * np.pi * 47.3 * time[:, None]
    forces = np.cos(turning + np.arange(4)) + 0.05 * rng.normal(size=(count, 4))
    positions = 5 * np.cos(turning - np.arange(4)) + 0.1 * rng.normal(size=(count, 4))
    references = np.zeros((count, 4))
    references[:, axis] = sweep
    forces[:, axis] += sweep
    positions[:, axis] += 4 * sweep
    columns = [1e3 * time[:, None], positions, forces]
    names = [f"Pos {p} [um]" for p in PLANES] + [f"Force {p} [N]" for p in PLANES]
    if marks:
        columns += [references, 4.9 * (np.cos(turning) > 0.9)]
        names += [f"Ref {p} [N]" for p in PLANES] + ["Key [V]"]
    preamble = "Data logger\nDate: 2025-11-04 14:20:07\nChannels: 13\n\n"
    with path.open("w", encoding="utf-8") as file:
        file.write(preamble)
        write_table(file, ";".join(["Time [ms]", *names]), *columns, separator=";", fmt="%.3f")
    return path


@pytest.mark.slow
def test_planes_of_a_logger_are_those_of_the_model_in_their_order(tmp_path):
    files = [write_sweep(tmp_path / f"{axis}.csv", axis) for axis in (0, 3)]
    text = draft(files, "three-mass", tmp_path)
    found = parse(text)
    for record, axis in zip(found["records"], (0, 3), strict=True):
        assert record["keyphasor"] == "Key"
        assert record["references"] == [f"Ref {PLANES[axis]}"]
        assert "fundamental" not in record
        assert "period_samples" not in record
    channels = found["channels"]
    for name, plane in zip(("x1", "y1", "x3", "y3"), PLANES, strict=True):
        assert channels[name] == {"column": f"Pos {plane}", "unit": "um"}
        assert channels[f"F_{name}"] == {"column": f"Force {plane}", "unit": "N"}
    assert set(channels) == {"x1", "y1", "x3", "y3", "F_x1", "F_y1", "F_x3", "F_y3"}
    assert text.count("taken A for 1, B for 3, by their order: check") == 8
    assert 'add hold = "zero-order"' in text
    assert '# m1 = { start = "0.83339 kg" }' in text
    assert load(tmp_path, text).channels[0].sources["F_x3"].column == "Force B X"
    rigid = draft(files, "rigid", tmp_path)
    assert parse(rigid)["channels"]["F_yb"] == {"column": "Force B Y", "unit": "N"}
    assert "by their order" not in rigid  # it calls its planes a and b too


def test_currents_and_positions_take_the_planes_in_one_order():
    columns = of_unit("A", "I AX", "I AY", "I BX", "I BY")
    columns += of_unit("um", "Pos BX", "Pos BY", "Pos AX", "Pos AY")
    model = rid.load_model("three-mass")
    found = by_planes(model, columns, {}) | currents(model, columns, {})
    named = {name: column.name for name, column in found.items()}
    for place, plane in (("x1", "AX"), ("y3", "BY")):
        assert named[place] == f"Pos {plane}"
        assert named[f"F_{place}"] == f"I {plane}"


def test_the_rotation_beside_a_sweep_is_no_period(tmp_path):
    """Three of four axes hold the unbalance alone, which repeats; the excitation does not."""
    path = write_sweep(tmp_path / "0.csv", 0, marks=False)
    (record,) = parse(draft([path], "three-mass", tmp_path))["records"]
    assert "period_samples" not in record
    assert "fundamental" not in record
    assert record["band"] != ["?", "?"]


def test_planes_left_over_are_not_guessed():
    model = rid.load_model("three-mass")
    four = of_unit("N", *(f"Force {plane}" for plane in PLANES))
    assert set(by_planes(model, four, {})) == {"F_x1", "F_y1", "F_x3", "F_y3"}
    assert by_planes(model, four[:3], {}) == {}
    for more in ("Force C X", "Force A X 2", "Sum"):
        assert by_planes(model, [*four, *of_unit("N", more)], {}) == {}
    assert by_planes(MODEL, four, {}) == {}  # one plane, which has no name
    told = by_planes(model, of_unit("N", "fxR", "fyR", "fxL", "fyL"), {})
    assert told["F_x1"].assumed == "taken R for 1, L for 3, by their order: check"


@pytest.mark.parametrize(
    ("names", "assumed"),
    [
        (["V1", "W1", "V2", "W2"], "V for x, W for y, 2 for 3"),
        (["V13 DE", "W24 DE", "V13 NDE", "W24 NDE"], "V for x, W for y, DE for 1, NDE for 3"),
        (["V13", "W13", "V24", "W24"], "V for x, W for y, 13 for 1, 24 for 3"),
        (["1H", "1V", "3H", "3V"], "H for x, V for y"),
        (["y1", "x1", "y2", "x2"], "2 for 3"),
    ],
)
def test_probes_at_right_angles_are_the_axes_of_the_model(names, assumed):
    """Whatever their letters are: forces, currents and positions alike, and what is assumed."""
    x1, y1 = (1, 0) if names[0] == "y1" else (0, 1)
    model = rid.load_model("three-mass")
    gaps = of_unit("mm", *(f"gap {name}" for name in names))
    coils = of_unit("A", *(f"coil_{name}" for name in names))
    told = by_planes(model, [*gaps, *coils], {})
    assert told == {"x1": gaps[x1], "y1": gaps[y1], "x3": gaps[2 + x1], "y3": gaps[2 + y1]}
    taken = f"taken {assumed}, by their order: check"
    assert {column.assumed for column in told.values()} == {taken}
    assert currents(model, [*gaps, *coils], {})["F_y3"] == coils[2 + y1]
    rigid = sensors_at_inputs(rid.load_model("rigid"), gaps)
    assert rigid["F_xb"] == gaps[2 + x1]
    assert by_planes(model, gaps[:3], {}) == {}
    assert by_planes(model, [*gaps[:3], replace(gaps[3], name="gap Z2")], {}) == {}


def test_how_a_sensor_beside_a_magnet_is_written_is_shown(tmp_path):
    """Where no name tells which is which; a model that has them as coordinates needs none."""
    gaps = np.random.default_rng(1).normal(size=(400, 2))
    path = tmp_path / "run.csv"
    write_table(path, 't [s],gap "one" [um],gap two [um]', np.arange(400) / 1000.0, gaps)
    lines = draft([path], "rigid", tmp_path).splitlines()
    (told,) = (line for line in lines if "a magnet: s_" in line)
    channels = parse(told.partition("magnet: ")[2])
    assert channels["s_xa"]["reads"] == "x - L_a*theta_y"
    assert (channels["s_xa"]["unit"], "gap" in channels["s_xa"]["column"]) == ("um", True)
    assert "beside a magnet" not in draft([path], "three-mass", tmp_path)


def test_currents_that_no_name_tells_apart_leave_a_law_to_be_completed(tmp_path):
    rng = np.random.default_rng(1)
    for part in (1, 2):
        header = "t [s],coil a [A],coil b [A],x [um],y [um],injected [mA]"
        path = tmp_path / f"{part}.csv"
        write_table(path, header, np.arange(400) / 1000.0, rng.normal(size=(400, 5)))
    text = draft([tmp_path / "1.csv", tmp_path / "2.csv"], "jeffcott", tmp_path)
    found = parse(text)
    law = {"law": "linear", "current": {"column": "?", "unit": "A"}}
    assert found["channels"]["F_x"] == law | {"position": "x", "ki": "?", "ks": "?"}
    assert "which column is it? coil a, coil b; F = ki i + ks x" in text
    assert "not used: coil a [A]" in text
    assert "not used: injected" not in text  # it stands in the references
    assert [record.get("phase") for record in found["records"]] == [None, "unknown"]


def test_names_of_what_was_added_and_of_marks():
    for names, added in (
        (["Ref A X", "ref_x1", "ex1", "Exc", "Disturbance x"], True),
        (["Distance A X", "Extension", "Force A X"], False),
    ):
        assert {is_excitation(found) for found in of_unit(None, *names)} == {added}
    marks = ["Key", "Key phasor", "kp", "tacho1", "Marke", "Puls", "zero_mark"]
    assert {role_of(name, "V") for name in marks} == {"keyphasor"}


def test_a_record_in_place_of_the_experiment_is_told(tmp_path, refusal):
    path = write_sweep(tmp_path / "run.csv", 0)
    for command in ("inspect", "identify"):
        told = refusal(command, path)
        assert "expected an experiment file" in told
        assert f"rotorid new {path}" in told


@pytest.mark.parametrize(("size", "name"), [(1.0, "px"), (1e100, "fx"), (1e-200, "fx")])
def test_columns_without_a_spectrum_are_not_searched_for_lines(size, name, tmp_path):
    """A constant one, and one whose squares no number holds; the others are."""
    rng = np.random.default_rng(3)
    values = {"fx": rng.standard_normal(400), "px": rng.standard_normal(400)}
    values[name] = np.full(400, 2.0) if size == 1 else values[name] * size
    write_table(tmp_path / "run.csv", "t,fx,px", np.arange(400) / RATE, values["fx"], values["px"])
    text = draft([tmp_path / "run.csv"], None, tmp_path)
    assert f"where {'fx' if name == 'px' else 'px'} is large" in text


def test_a_record_at_rest_has_no_band(tmp_path):
    write_table(tmp_path / "run.csv", "t,fx,px", np.arange(400) / RATE, np.zeros(400), np.ones(400))
    assert "is large" not in draft([tmp_path / "run.csv"], None, tmp_path)


def test_a_file_without_a_column_of_numbers(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["title"] = "words"
    with pytest.raises(InputError, match=r"run\.h5: found .*expected"):
        draft([tmp_path / "run.h5"], "jeffcott", tmp_path)


def test_the_unit_of_times_may_stand_in_their_name():
    clock = draft_module._clock([Found("run1/t/ms", np.arange(50.0), None, "time")], None)
    assert clock == (1e3, ("time", {"column": "run1/t/ms", "unit": "ms"}, "1000 Hz, 0.05 s"))


@pytest.mark.parametrize(("rate", "unit"), [(19.0, "ms"), (21.0, "s")])
def test_times_that_make_a_slow_logger_are_no_seconds(rate, unit):
    times = Found("t", np.arange(50) / rate, None, "time")
    assert draft_module._clock([times], None)[1][1]["unit"] == unit


@pytest.mark.parametrize(("size", "lines"), [(0.029, [3]), (0.031, [3, 7])])
def test_a_line_that_stands_out_was_excited(size, lines):
    angle = 2 * np.pi * np.arange(500) / 100
    wave = np.cos(3 * angle) + size * np.cos(7 * angle)
    assert draft_module._lines([wave], Period(100.0, 0.5, 1.0)) == lines


@pytest.mark.parametrize(("next_one", "found"), [(0.84, ["x"]), (0.86, [])])
def test_a_name_that_is_hardly_likelier_than_the_next_does_not_tell(monkeypatch, next_one, found):
    ranked = [(0.9, 0, "x", 0), (next_one, 0, "x", 1)]
    monkeypatch.setattr(draft_module, "_ranked", lambda model, columns: ranked)
    columns = [Found(name, np.zeros(3), None, "other") for name in ("qm", "qg")]
    assert list(assign(MODEL, columns)) == found


def test_columns_that_are_no_numbers_are_known_by_one_pass(tmp_path, monkeypatch, output):
    """Halves of halves of two thousand columns took a minute."""
    kept, rows = {3, 500, 1999}, []
    for row in range(40):
        bad = {c for c in range(2000) if c % 40 == row and c not in kept}
        cells = ["1_0" if c in bad and c % 3 else "no" if c in bad else "1.5" for c in range(2000)]
        rows.append(",".join(cells))
    names = ",".join(f"c{c}" for c in range(2000))
    (tmp_path / "run.csv").write_text("\n".join([names, *rows]) + "\n")
    passes, load = [], np.loadtxt
    monkeypatch.setattr(np, "loadtxt", lambda *a, **k: (passes.append(None), load(*a, **k))[1])
    told = re.findall(r"# not used: (\w+)", output("new", tmp_path / "run.csv"))
    assert told == [f"c{c}" for c in sorted(kept)]
    assert len(passes) < 6


def drafted(folder: Path, header: str) -> str:
    rng = np.random.default_rng(1)
    write_table(folder / "run.csv", f"t_ms,{header}", np.arange(300), rng.normal(size=(300, 8)))
    return draft([folder / "run.csv"], "three-mass", folder)


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("x1_um,y1_um,x3_um,y3_um,i_x1_A,i_y1_A,i_x3_A,i_y3_A", "A"),
        ("x1_um,y1_um,x3_um,y3_um,iA_x_mA,iA_y_mA,iB_x_mA,iB_y_mA", "mA"),
        ("x1_um,y1_um,x3_um,y3_um,iA_x,iA_y,iB_x,iB_y", "?"),
        ("x1_um,y1_um,x3_um,y3_um,i1x,i1y,i2x,i2y", "?"),
    ],
)
def test_units_that_end_a_name_and_currents_without_one(tmp_path, header, unit):
    found = parse(drafted(tmp_path, header))["channels"]
    names = header.split(",")
    for name, column in zip(("x1", "y1", "x3", "y3"), names, strict=False):
        assert found[name] == {"column": column, "unit": "um"}
    for name, column in zip(("F_x1", "F_y1", "F_x3", "F_y3"), names[4:], strict=True):
        assert found[name]["current"] == {"column": column, "unit": unit}
        assert found[name]["position"] == f"{name[2:]}"


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        *(("x1_um", "um"), ("gap_mm", "mm"), ("Fx_N", None), ("Fx1_N", "N"), ("u_x1_V", "V")),
        *(("i_x_A", None), ("x1_A", None), ("i_x1_N", None), ("pos_x", None), ("um", None)),
    ],
)
def test_a_letter_that_ends_a_name_may_be_a_bearing(name, unit):
    assert draft_module._unit_in(name) == unit


@pytest.mark.parametrize(
    ("name", "current"),
    [("iAx", True), ("I 1 X", True), ("coil_1", True), ("index", False), ("imb_x", False)],
)
def test_what_a_current_is_called(name, current):
    (column,) = of_unit(None, name)
    assert column.measures("A") == current


def test_a_disc_that_may_be_the_second_bearing_is_to_be_checked(tmp_path):
    currents = "i1x,i1y,i2x,i2y"
    doubt = "check: no force acts on x2; of a sensor at a bearing, write x3"
    assert doubt in drafted(tmp_path, f"x1_um,y1_um,x2_um,y2_um,{currents}")
    assert "check: no" not in drafted(tmp_path, f"x1_um,y1_um,x3_um,y3_um,{currents}")


def test_lines_to_copy_where_no_column_looks_like_anything(tmp_path):
    text = drafted(tmp_path, "q1,q2,q3,q4,w1,w2,w3,w4")
    assert '\nx1 = {column = "?", unit = "um"} # one sensor at least: of any coordinate\n' in text
    law = '# F_x1 = {law = "linear", current = {column = "?", unit = "A"}, position = "x1", ki = '
    assert law in text
    assert "# x1 =" not in drafted(tmp_path, "x1_um,y1_um,x3_um,y3_um,i1x,i1y,i2x,i2y")


def test_a_counter_of_samples_holds_no_excitation(tmp_path):
    """It hides no period, and gives no band; times without a name may wander a little."""
    count, noise = np.arange(2000), np.random.default_rng(1).normal(size=(2, 2000))
    waves = np.sin(2 * np.pi * count / 100) + 1e-3 * noise
    write_table(tmp_path / "run.txt", "t,n,u,v", count / 500, count, *waves, fmt="%.6g")
    (record,) = parse(draft([tmp_path / "run.txt"], "jeffcott", tmp_path))["records"]
    assert record["fundamental"] == "5 Hz"
    late = count / 100 + 1e-3 * np.sin(count / 50)
    write_table(tmp_path / "bare.txt", "", late, *waves, fmt="%.4f")
    (record,) = parse(draft([tmp_path / "bare.txt"], "jeffcott", tmp_path))["records"]
    assert record["time"]["column"] == "0"


def test_angles_and_speeds_of_what_does_not_turn_are_motion(tmp_path):
    (tmp_path / "swing.toml").write_text(SWING)
    time = np.arange(4000) / 1e3
    angle = 0.5 * np.exp(-0.1 * time) * np.cos(5.5 * time)
    write_table(tmp_path / "run.csv", "t,phi", time, angle)
    found = parse(draft([tmp_path / "run.csv"], "swing.toml", tmp_path))
    (record,) = found["records"]
    assert "angle" not in record
    assert (
        2 < float(record["cutoff"].removesuffix(" Hz")) < 50
    )  # the decay repeats, driven by nothing
    assert found["channels"]["phi_p"]["column"] == "phi"


def test_what_an_inspection_needs_first_is_said(tmp_path, output, refusal):
    """Nothing tells the rate of the samples; and volts are no force, so no law makes them."""
    swing = SWING.replace("= 0", "= g*V").replace("[parameters]", '[inputs]\nV = "V"\n[parameters]')
    (tmp_path / "swing.toml").write_text(swing + 'g = { unit = "N m/V" }\n')
    noise = np.random.default_rng(1).normal(size=(2, 400))
    write_table(tmp_path / "run.csv", "phi,drive", *noise)
    out = tmp_path / "run.toml"
    shown = output("new", tmp_path / "run.csv", "--model", tmp_path / "swing.toml", "--out", out)
    said = "the sample_rate, or the kind of what has no samples, then rotorid inspect"
    assert f"; next: {said} {out}" in shown
    text = out.read_text()
    assert f"# Next: {said}, which takes a draft" in text
    assert 'V = {column = "?", unit = "V"}' in text
    assert "law" not in text
    assert "the rate of samples, or the kind of a table" in refusal("inspect", out)
    out.write_text(text.replace('sample_rate = "?"', 'sample_rate = "1 kHz"'))
    assert "400 samples at 1000 Hz" in output("inspect", out)


SWING = """title = "A pendulum"
equations = ["J*phi_p'' + w*sin(phi_p) = 0"]
[coordinates]
phi_p = "rad"
[parameters]
J = { unit = "kg m^2" }
w = { unit = "N m" }
"""


def test_a_column_of_two_values_may_be_a_mark_and_a_file_without_times_a_table(tmp_path):
    time, normal = np.arange(2000) / 1e3, np.random.default_rng(1).normal(size=2000)
    mark = (np.arange(2000) % 20 > 0).astype(float)
    write_table(tmp_path / "run.csv", "t,acc,ir", time, normal, mark)
    text = draft([tmp_path / "run.csv"], "jeffcott", tmp_path)
    assert 'not used: ir, 0 to 1; two values, a mark of the rotation? then keyphasor = "ir"' in text
    assert "acc, " in text
    assert 'kind = "phasors"' not in text
    for names, kind in (("rpm,a1,p1", "phasors"), ("n,ax,px", "phasors"), ("rpm,a1,p2", None)):
        write_table(tmp_path / "runs.csv", names, *np.arange(9.0).reshape(3, 3) ** 2)
        text = draft([tmp_path / "runs.csv"], "jeffcott", tmp_path)
        assert parse(text)["records"][0].get("kind") == kind
        assert 'kind = "phasors"' in text


BALANCING = """condition,rpm,x amp (um),x phase (deg),y amp (um),y phase (deg)
first run,3000,12.1,33,13.0,-57
trial A,3001,15.2,50,15.0,-40
trial B,2999,10.2,20,10.1,-70
"""
READING = {"amplitude": "x amp", "phase": "x phase", "unit": "um", "std": "?"}
LEVELS = "0.1,2,-3\n0.2,2.1,-3.1\n0.4,2.2,-3\n0.8,2.4,-2.9\n"


def conditions(speed: object) -> list[dict[str, object]]:
    rows = ({"column": "condition", "is": each} for each in ("first run", "trial A", "trial B"))
    return [{"kind": "phasors", "speed": speed, "rows": each} for each in rows]


@pytest.mark.parametrize(
    ("table", "records", "channel", "others"),
    [
        (BALANCING, conditions({"column": "rpm", "unit": "rpm"}), READING, {"std": "0.3 um"}),
        (
            re.sub(r",(rpm|\d{4})", "", BALANCING),
            conditions("?"),
            READING,
            {"std": "0.3 um", "speed": "3000 rpm"},
        ),
        (
            "speed_rpm,x_amp_um,x_phase_rad\n3000,12.1,0.3\n4000,15.2,0.5\n5000,10.2,0.4\n",
            [{"kind": "phasors", "speed": {"column": "speed_rpm", "unit": "rpm"}}],
            {
                "amplitude": "x_amp_um",
                "phase": "x_phase_rad",
                "unit": "um",
                "phase_unit": "rad",
                "std": "?",
            },
            {"std": "0.3 um"},
        ),
        (
            "freq (Hz),mag_x (um/N),phase_x (deg)\n" + LEVELS,
            [{"kind": "responses", "frequency": {"column": "freq", "unit": "Hz"}}],
            {"amplitude": "mag_x", "phase": "phase_x", "unit": "um/N", "std": "?", "input": "?"},
            {"std": "0.1 um/N", "input": "F_x"},
        ),
        (
            "f,x_re (um/N),x_im (um/N),coh\n" + LEVELS.replace("\n", ",0.98\n"),
            [
                {
                    "kind": "responses",
                    "frequency": {"column": "f", "unit": "Hz"},
                    "averages": "?",
                }
            ],
            {"real": "x_re", "imag": "x_im", "unit": "um/N", "coherence": "coh", "input": "?"},
            {"input": "F_x"},
        ),
    ],
)
def test_a_table_is_a_record_of_its_kind(tmp_path, output, table, records, channel, others):
    """Of a row per speed or per frequency, a record per condition; filled in, it is read."""
    (tmp_path / "run.csv").write_text(table)
    told = output("new", tmp_path / "run.csv", "--model", "jeffcott", "--out", tmp_path / "d.toml")
    assert "next: all of these, then rotorid inspect" in told
    text = (tmp_path / "d.toml").read_text()
    found = parse(text)
    assert found["records"] == [{"file": "run.csv", **record} for record in records]
    assert found["channels"]["x"] == channel
    assert not {"F_x", "F_y"} & found["channels"].keys()
    for key, value in others.items():
        text = text.replace(f'{key} = "?"', f'{key} = "{value}"')
    (tmp_path / "d.toml").write_text(text.replace('averages = "?"', "averages = 20"))
    shown = output("inspect", tmp_path / "d.toml")
    assert shown.count("1x phasors") + shown.count("responses to F_x") == len(records)


def test_a_binary_table_says_that_its_conditions_are_not_read(tmp_path, output):
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["run"] = [b"first", b"first", b"trial"]
        for name in ("rpm", "x_amp_um", "x_phase_deg"):
            data[name] = [1000.0, 2000.0, 1000.0]
    draft = output("new", tmp_path / "run.h5", "--model", "jeffcott")
    assert "# words that tell conditions are read in text tables alone: export as .csv" in draft


def test_cures_of_a_draft_without_a_rate_are_taken(tmp_path, output, refusal):
    """Columns of words are no samples: "leave the column out" was told, which no key does."""
    (tmp_path / "run.csv").write_text("state,q [mm],w [N]\n" + "on,1,2\noff,2,4\non,3,1\n")
    output("new", tmp_path / "run.csv", "--model", "emps", "--out", tmp_path / "d.toml")
    told = refusal("inspect", tmp_path / "d.toml")
    assert 'records.0: sample_rate: found "?"' in told
    text = (tmp_path / "d.toml").read_text()
    for cure in ('sample_rate = "5 kHz"', 'kind = "phasors"'):
        assert cure in told
        (tmp_path / "d.toml").write_text(re.sub("sample_rate = .*", cure, text))
        shown = output if "5 kHz" in cure else refusal
        assert "sample_rate" not in shown("inspect", tmp_path / "d.toml").partition("channel")[0]


@pytest.mark.parametrize(
    ("header", "line"),
    [
        (
            "Force [N],Pos A [mm]",
            'q = {column = "Pos A", unit = "mm"} # the only column in mm: check',
        ),
        ("Force [N],left [mm],right [mm]", "# one sensor at least: left, right"),
    ],
)
def test_a_draft_that_reads_nothing_leaves_a_sensor_open(tmp_path, output, header, line):
    """Nothing open, and suitable, it was; `identify` then found no sensor of any coordinate."""
    columns = header.count(",") + 1
    values = np.random.default_rng(2).normal(size=(400, columns))
    np.savetxt(tmp_path / "run.csv", values, delimiter=",", header=header, comments="")
    told = output("new", tmp_path / "run.csv", "--model", "emps")
    assert line in told
    assert ("channels.q" in told.partition("Next")[0]) == line.startswith("#")


def test_jitter_of_one_logger_is_told_once_with_its_figures(tmp_path):
    """Three records of stamps off by 50 to 60 us; the draft takes the rate that they allow."""
    rng, files = np.random.default_rng(4), [tmp_path / f"run{k}.csv" for k in range(3)]
    clean = shaken(periods=12, speed=0.0, noise=0.0).samples
    for file, size in zip(files, (0.9e-4, 1e-4, 1.1e-4), strict=True):
        noisy = clean + 1e-3 * clean.std(axis=0) * rng.normal(size=clean.shape)
        times = np.arange(len(noisy)) / RATE
        stamps = times + size * rng.uniform(-1, 1, len(times))
        columns = scipy.interpolate.CubicSpline(times, noisy)(stamps) * [1, 1, 1e6, 1e6]
        write_table(file, "t [s],Fx [N],Fy [N],px [um],py [um]", stamps, columns, fmt="%.9g")
    text = draft(files, "jeffcott", tmp_path)
    assert text.count('fundamental = "10 Hz"') == 3
    text = re.sub('phase = "unknown".*', "", text).replace('speed = "?"', 'speed = "0 rpm"')
    known = '[parameters]\nm = { start = "5 kg" }\nxi = { fixed = "0 m" }\nzeta = { fixed = "0 m" }'
    estimate = load(tmp_path, text.replace("[parameters]", known)).identify()
    assert estimate.status == "ok"
    (told,) = (text for text in estimate.warnings if "jitter" in text)
    assert float(re.search(r"jitter by (\S+) s", told)[1]) == pytest.approx(1e-4 / 3**0.5, rel=0.2)
    assert "an error below 0.001 % at 50 Hz" in told
    assert told.endswith(" more like this")


def test_a_period_that_the_motion_does_not_share_is_none(tmp_path):
    """Nine waves of 3.3 Hz, which are most of the force, are three of 1.1 Hz, and 1.09 of 0.4 Hz.

    As periods they gave a friction of 210 +- 78 N in place of 20 N.
    """
    time, omega = np.arange(10_000) / 1e3, 2 * np.pi * np.array([0.4, 1.1, 3.3])
    motion = 0.15 * np.sin(np.outer(time, omega) + np.array([0, 1, 0])) * [1, 0.3, 0.13]
    force = motion @ (-95.0 * omega**2) + 20 * np.sign(np.gradient(motion.sum(axis=1)))
    write_table(tmp_path / "run.csv", "t [s],F [N],q [m]", time, force, motion.sum(axis=1))
    (record,) = parse(draft([tmp_path / "run.csv"], "emps", tmp_path))["records"]
    assert "cutoff" in record
    assert not {"fundamental", "period_samples"} & record.keys()


def test_the_cure_of_a_gap_is_taken_by_an_inspection_of_the_draft(tmp_path, output, refusal):
    """`skip` was not heard of there; and a period was found across the gap, of 1779 samples."""
    whole = np.arange(len(SHAKEN.samples)) // 21 != 10
    names = "t [s],Fx [N],Fy [N],px [um],py [um]"
    write_table(tmp_path / "run.csv", names, TIME[whole] / 1e3, SHAKEN.samples[whole], fmt="%.10g")
    out = tmp_path / "d.toml"
    output("new", tmp_path / "run.csv", "--model", "jeffcott", "--out", out)
    text = out.read_text()
    (cure,) = re.findall('without: (skip = "[^"]*")', refusal("inspect", out))
    assert cure in text
    assert "period_samples" not in text
    out.write_text(re.sub("^speed = .*", cure, text, flags=re.M))
    assert "periods of 200 samples (found: 0.1 s, 10 Hz)" in output("inspect", out)
