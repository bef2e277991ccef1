"""`rotorid inspect`: finished files, drafts, the page, and what cannot be read."""

import json
import re

import numpy as np
import pytest
from io_writers import write_table
from working_folder import simulated

from rotorid import load_rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A folder with a record of a rig, and its experiment file."""
    text = load_rig("rigid").text.replace('"10 s"', '"2 s"')
    return simulated(tmp_path_factory.mktemp("rig"), text).parent


def test_a_good_record_is_ok(rig, output):
    out = rig / "found.json"
    shown = output("inspect", rig / "run.toml", "--json", out)
    assert "run.h5: ok. The record is suitable for identification" in shown
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["verdict"] == "ok"
    assert found["period_samples"] == 1000
    assert found["sample_rate_hz"] == 10_000.0
    assert found["speed_rad_s"] == pytest.approx(942.478, rel=1e-6)
    assert {check["verdict"] for check in found["checks"]} == {"ok"}
    assert set(found["checks"][0]) == {"check", "channel", "found", "verdict"}
    assert [channel["name"] for channel in found["channels"]][:1] == ["F_xa"]
    assert all(channel["snr_db"] > 30 for channel in found["channels"])


def test_a_draft_is_read_as_far_as_it_goes(rig, output):
    draft = rig / "draft.toml"
    output("new", rig / "run.h5", "--model", "rigid", "--out", draft)
    shown = output("inspect", draft)
    assert "a draft, shown with its columns as they are" in shown
    assert "20 periods of 1000 samples" in shown
    assert "encoder" not in shown.split("channel ")[1]


@pytest.mark.parametrize(
    ("said", "place"),
    [
        ('time = { unit = "s" }', "records.0.time.column: found no such key"),
        ("time = 3", "records.0.time: found 3"),
        ('fundamental = "0 Hz"', "records.0.fundamental: found '0 Hz'"),
        ('header_row = "x"', "records.0.header_row: found 'x'"),
        ("skip = [1]", "records.0.skip: found [1]"),
        ('harmonics = ["a"]', "records.0.harmonics.0: found 'a'"),
        ("mask = 3", "records.0.mask: found 3"),
        ('file = "?"', "found no name of a file"),
    ],
)
def test_what_is_wrong_in_a_draft_is_told_where_it_is(rig, refusal, said, place):
    draft = rig / "wrong.toml"
    file = "" if said.startswith("file") else 'file = "run.h5"\n'
    draft.write_text(f'model = "?"\n[[records]]\n{file}{said}\n', encoding="utf-8")
    assert place in refusal("inspect", draft)


def test_without_a_fundamental_the_period_is_found(rig, output):
    bare = rig / "bare.toml"
    bare.write_text('[[records]]\nfile = "run.h5"\ntime = "t"\n', encoding="utf-8")
    assert "periods of 1000 samples (found: 0.1 s, 10 Hz)" in output("inspect", bare)


def test_motion_is_told_in_a_unit_of_its_size(tmp_path, output):
    turned = np.random.default_rng(4).normal(size=(500, 2)).cumsum(axis=0) * [3.0, 3e-6]
    write_table(tmp_path / "run.csv", "x [rad],y [rad]", turned)
    draft = '[[records]]\nfile = "run.csv"\nsample_rate = "1 kHz"\n'
    (tmp_path / "run.toml").write_text(draft)
    shown = output("inspect", tmp_path / "run.toml")
    for name, unit, factor in (("x", "rad", 1.0), ("y", "urad", 1e6)):
        least = factor * turned[:, "xy".index(name)].min()
        assert re.search(rf"^{name} +{unit} +{re.escape(f'{least:.4g}')} ", shown, re.MULTILINE)


def test_a_period_of_an_odd_number_of_samples(tmp_path, output):
    """Its highest line lies below half the sample rate."""
    angle = 2 * np.pi * np.arange(6300) / 63
    noise = 0.01 * np.random.default_rng(1).standard_normal((6300, 2))
    columns = np.column_stack([np.cos(angle) + np.cos(3 * angle), np.sin(angle)]) + noise
    write_table(tmp_path / "run.csv", "f [N],x [um]", columns)
    text = 'model = "?"\n[[records]]\nfile = "run.csv"\nsample_rate = "2 kHz"\nspeed = "0 rpm"\n'
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    assert "100 periods of 63 samples" in output("inspect", tmp_path / "run.toml")


@pytest.mark.slow
def test_the_page_stands_alone(rig, output):
    page = rig / "found.html"
    output("inspect", rig / "run.toml", "--report", page)
    text = page.read_text(encoding="utf-8")
    for title in (
        "Samples",
        "Spectrum of the mean period",
        "Deviation of each period",
        "Correlation of the noise",
    ):
        assert f"<h3>{title}" in text
    shown = text.split("</head>")[1].split("<script")[0]
    assert "http" not in shown
    assert "default-src 'none'" in text.split("</head>")[0]


@pytest.mark.parametrize(
    "text",
    ["model = ", 'model = "rigid"', "[[records]]\nspeed = 3", '[[records]]\nfile = "none.h5"'],
)
def test_a_file_that_is_wrong_is_refused(text, tmp_path, refusal):
    (tmp_path / "broken.toml").write_text(text + "\n", encoding="utf-8")
    refusal("inspect", tmp_path / "broken.toml")


def test_a_sweep_is_not_searched_for_a_period(tmp_path, output):
    """Its rotation repeats; beside that the sweep would be noise, knocks, a wandering speed."""
    time = np.arange(20_000) / 2000.0
    turning = 2 * np.pi * 40.0 * time
    sweep = 0.3 * np.sin(2 * np.pi * (5 + 10 * time) * time)
    noise = 0.01 * np.random.default_rng(1).normal(size=(4, len(time)))
    forces, positions = ([np.cos(turning + at) + sweep, np.sin(turning + at)] for at in (0.0, 1.0))
    names = "t [s],Fx [N],Fy [N],x [um],y [um],ref_x [N]"
    columns = np.array([*forces, *positions]) + noise
    write_table(tmp_path / "run.csv", names, time, *columns, sweep)
    path = tmp_path / "run.toml"
    path.write_text(SWEEP, encoding="utf-8")
    shown = output("inspect", path)
    assert "run.csv: ok." in shown
    assert "; no period; speed 2400 rpm" in shown
    headings = next(line for line in shown.splitlines() if line.startswith("channel"))
    assert headings.split() == ["channel", "unit", "low", "high", "rms", "1x", "2x", "3x"]
    band = 'band = ["5 Hz", "205 Hz"]\nreferences = ["ref_x"]'
    for said, other in (('model = "jeffcott"', 'model = "?"'), (band, 'cutoff = "300 Hz"')):
        path.write_text(SWEEP.replace(said, other), encoding="utf-8")
        assert "; no period; speed 2400 rpm" in output("inspect", path)


SWEEP = """model = "jeffcott"

[[records]]
file = "run.csv"
time = "t"
speed = "2400 rpm"
band = ["5 Hz", "205 Hz"]
references = ["ref_x"]

[channels]
F_x = { column = "Fx", unit = "N" }
F_y = { column = "Fy", unit = "N" }
x = { column = "x", unit = "um" }
y = { column = "y", unit = "um" }
"""


def test_a_run_up_is_not_searched_for_a_period(tmp_path, output, refusal):
    """Its mark tells the speed: a clearer line elsewhere asks for its pulses, not for a speed."""
    count = np.arange(1000)
    mark = (count % 20 == 0).astype(float)
    noise = 1e-3 * np.random.default_rng(1).normal(size=1000)
    write_table(tmp_path / "a.csv", "ac,ir", np.sin(2.7 * count) + noise, mark, fmt="%.6g")
    path = tmp_path / "a.toml"
    path.write_text(RUN_UP, encoding="utf-8")
    shown = output("inspect", path)
    assert "count its pulses per revolution" in shown
    assert "no period found" not in shown
    path.write_text(RUN_UP.replace('"ir"', '"$\\tir$"'), encoding="utf-8")  # a tab in TOML
    write_table(tmp_path / "a.csv", r"ac,$\tir$", mark, mark)
    assert r"single quotes: '$\tir$'" in refusal("inspect", path)
    # A table has no samples that a draft could show: the error of its channel is told.
    mistake = RUN_UP.replace('keyphasor = "ir"\nsample_rate = "1 kHz"', 'speed = "9 rpm"')
    mistake = mistake.replace('column = "ac"', 'amplitude = "ac", phase = "ir"')
    path.write_text(mistake.replace('"um"', '"N/m"'), encoding="utf-8")
    told = refusal("inspect", path)
    assert "channels.x.unit" in told
    assert "change what the quantity is" in told


RUN_UP = """model = "jeffcott"

[[records]]
kind = "phasors"
file = "a.csv"
keyphasor = "ir"
sample_rate = "1 kHz"

[channels]
x = { column = "ac", unit = "um" }
"""


def test_natural_frequencies_without_a_record_are_shown(tmp_path, output):
    """It was refused, with a record as the cure, where `identify` needs none."""
    out = tmp_path / "m.toml"
    first = 'frequency = "22.6 Hz"\nstd = "0.05 Hz"\ndamping = { value = 0.002, std = 0.0005 }\n'
    second = (
        'frequency = "2400 rpm"\nstd = "0.1 Hz"\nspeed = "300 rpm"\nparameters = { m = "2 kg" }'
    )
    out.write_text(f'model = "jeffcott"\n[[modes]]\n{first}[[modes]]\n{second}\n')
    shown = output("inspect", out, "--json", tmp_path / "m.json", "--report", tmp_path / "m.html")
    told = "22.6 Hz, std 0.05 Hz, damping ratio 0.002, std 0.0005, at 0 rpm"
    assert f"measured natural frequencies: {told}; 40 Hz, std 0.1 Hz, at 300 rpm, m = 2 kg" in shown
    assert told in (tmp_path / "m.html").read_text()
    assert json.loads((tmp_path / "m.json").read_text())["told"] == shown.strip()
