"""Models taken elsewhere: files, state space, the machine of an estimate."""

import csv
import json
import math
from pathlib import Path

import control
import numpy as np
import pytest
from linear_machines import SUPPORTED, estimate_of, model_of
from model_text import model_text
from scipy.io import loadmat

import rotorid as rid
from rotorid import Estimate, InputError, Value, export, load_model
from rotorid.answer.parts import SourceFile
from rotorid.results.machine import machine_of

# Estimates for other programs, read back with readers of their own.


ESTIMATE = Estimate(
    "three-mass",
    "ml",
    "ok",
    (
        Value("m1", "kg", 0.1 + 0.2, 0.01, 0.02),
        Value("L1", "m", 0.3, 0.0, 0.0, fixed=True),
        Value("k_1*L1^2", "N m", 1.5e5, 30.0),
    ),
    nuisance=(Value("gain[x1]", "1", 1.01, 0.005),),
    derived=(Value("a, b & c", "m", math.nan, None),),
    covariance=np.array([[1e-4, 0.1, 0.0], [0.1, 900.0, 0.2], [0.0, 0.2, 2.5e-5]]),
)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_csv_holds_every_digit(tmp_path):
    export(ESTIMATE, tmp_path / "a.csv")
    rows = rows_of(tmp_path / "a.csv")
    assert [row["name"] for row in rows] == ["m1", "L1", "k_1*L1^2", "gain[x1]", "a, b & c"]
    assert float(rows[0]["value"]) == 0.1 + 0.2
    names = ["m1", "k_1*L1^2", "gain[x1]"]
    found = [[float(rows[i][f"cov[{name}]"]) for name in names] for i in (0, 2, 3)]
    np.testing.assert_array_equal(found, ESTIMATE.covariance)
    assert rows[1]["cov[m1]"] is None  # fixed: no row of the covariance
    assert rows[4]["std"] == ""


def test_mat_comes_back(tmp_path):
    export(ESTIMATE, tmp_path / "a.mat")
    found = loadmat(tmp_path / "a.mat", simplify_cells=True)["estimate"]
    assert list(found["name"]) == ["m1", "L1", "k_1*L1^2", "gain[x1]", "a, b & c"]
    assert list(found["covariance_name"]) == ["m1", "k_1*L1^2", "gain[x1]"]
    np.testing.assert_array_equal(found["covariance"], ESTIMATE.covariance)
    np.testing.assert_array_equal(found["value"][:4], [0.1 + 0.2, 0.3, 1.5e5, 1.01])
    assert np.isnan(found["std"][4])
    assert found["status"] == "ok"


def test_tex_escapes_names(tmp_path):
    export(ESTIMATE, tmp_path / "a.tex")
    text = (tmp_path / "a.tex").read_text(encoding="utf-8")
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 4
    assert r"k\_1*L1\textasciicircum{}2 & 150000 & 30 & 0.020" in text
    assert r"a, b \& c" in text
    assert r"covariance & m1 & k\_1*L1\textasciicircum{}2 & gain[x1] \\" in text


def test_an_ending_that_is_unknown(tmp_path):
    with pytest.raises(InputError, match=r"found the ending '\.xls'; expected one of \.csv, \.mat"):
        export(ESTIMATE, tmp_path / "a.xls")


@pytest.mark.parametrize("size", [0, 1, 7])
def test_a_covariance_of_other_size_is_left_out(tmp_path, size):
    empty = Estimate("m", "ls", "not_identifiable", ())  # has headings only
    for estimate in (empty, ESTIMATE.with_(covariance=np.zeros((size, size)))):
        for name in ("a.csv", "a.mat", "a.tex"):
            export(estimate, tmp_path / name)
    assert "cov[" not in (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert "covariance" not in (tmp_path / "a.tex").read_text(encoding="utf-8")


@pytest.mark.parametrize("ending", ["csv", "mat", "tex", "json"])
def test_a_table_that_a_user_edited_is_kept(ending, tmp_path, output, refusal):
    result, table = tmp_path / "run.json", tmp_path / f"table.{ending}"
    estimate_of(load_model("jeffcott")).save(result)
    order = ("export", result, "--to", table)
    output(*order)
    output(*order)  # nobody edited it
    edited = table.read_bytes().replace(b"0", b"1", 1)
    assert edited != table.read_bytes()
    table.write_bytes(edited)
    assert "edited since" in refusal(*order)
    assert table.read_bytes() == edited
    output(*order, "--force")


def test_a_name_is_no_formula_of_a_spreadsheet(tmp_path):
    names = ["-k1*L1 + k2", "=1+1", "m1"]
    estimate = Estimate("one", "ls", "ok", tuple(Value(n, "kg", 2.0) for n in names))
    export(estimate, tmp_path / "a.csv")
    found = [row["name"] for row in rows_of(tmp_path / "a.csv")]
    assert found == ["'-k1*L1 + k2", "'=1+1", "m1"]


# State space: the response of the machine itself, in scipy, python-control and MATLAB's files.


OMEGA = 2 * np.pi * np.array([0.7, 11.0, 36.0, 90.0, 333.0, 900.0])
SENSOR = model_text(
    "a mass, a massless joint and a sensor's dashpot",
    ["m*x'' + k*(x - z) = F", "h*z + k*(z - x) = T", "c*s' + g*(s - z) = 0"],
    "x m, z m, s m",
    "F N, T N",
    "m 2.0 kg, k 3e5 N/m, h 7e5 N/m, c 50.0 N s/m, g 2e4 N/m",
)


def direct(source: rid.Estimate | rid.Model, speed: float) -> np.ndarray:
    """Return Z^-1 B on the lines, (line, coordinate, input)."""
    machine = machine_of(source)
    stiffness, damping, mass = machine.matrices(speed)
    w, push = OMEGA[:, None, None], machine.input_matrix()[None]
    return np.linalg.solve(stiffness + 1j * w * damping - w**2 * mass, push)


@pytest.mark.parametrize("speed", [0.0, 800.0, -300.0])
@pytest.mark.parametrize("name", ["three-mass", "jeffcott", "rigid", "supported", "sensor"])
def test_the_response_is_that_of_the_machine(name, speed):
    own = {"supported": SUPPORTED, "sensor": SENSOR}
    model = model_of(own[name]) if name in own else rid.load_model(name)
    plant = rid.state_space(model, speed=speed)
    expected = direct(model, speed)
    size = np.abs(expected).max()
    found = plant.to_control()(1j * OMEGA, squeeze=False)
    assert np.abs(np.moveaxis(found, 2, 0) - expected).max() < 1e-9 * size
    found = plant.to_scipy()
    states = [np.linalg.solve(1j * w * np.eye(len(found.A)) - found.A, found.B) for w in OMEGA]
    answer = np.array([found.C @ x + found.D for x in states])
    assert np.abs(answer - expected).max() < 1e-9 * size


@pytest.mark.parametrize(("k", "count"), [(0.0, 0), (2e5, 1)])
def test_a_machine_of_one_mode_or_none(k, count):
    """With deviations, of which pairs of modes are told."""
    text = model_text("a mass", ["m*s'' + k*s = F"], "s m", "F N", "m 2.0 kg, k 2e5 N/m")
    assert len(rid.modes(estimate_of(model_of(text), {"k": k})).modes) == count


def test_an_estimate_is_exported_as_it_is():
    estimate = estimate_of(model_of(SUPPORTED), {"m": 9.0})
    plant = rid.state_space(estimate, speed="3000 rpm", outputs=["x - 0.2*theta_y", "y"])
    assert plant.outputs == (("x - 0.2*theta_y", "m"), ("y", "m"))
    expected = direct(estimate, 100 * np.pi)
    found = plant.to_control()(1j * OMEGA, squeeze=False)
    own = expected[:, 0] - 0.2 * expected[:, 3]
    assert np.abs(found[0].T - own).max() < 1e-9 * np.abs(own).max()
    assert [name for name, _ in plant.states][-2:] == ["theta_x'", "theta_y'"]
    assert plant.states[-1][1] == "rad/s"


def test_massless_coordinates():
    plant = rid.state_space(model_of(SENSOR))
    assert [name for name, _ in plant.states] == ["x", "s", "x'"]
    assert plant.D[1, 1] == pytest.approx(1 / 1e6)  # the joint gives way at once


def test_files(tmp_path, output):
    path = tmp_path / "run.json"
    estimate = estimate_of(rid.load_model("three-mass"))
    estimate.save(path)
    order = ("export", path, "--speed", "8400 rpm", "--to")
    assert "16 states at 8400 rpm" in output(*order, tmp_path / "plant.json")
    data = json.loads((tmp_path / "plant.json").read_text())
    plant = rid.state_space(estimate, speed="8400 rpm")
    assert data["schema"] == "rotorid-state-space/1"
    assert data["inputs"][0] == {"name": "F_x1", "unit": "N"}
    for name in "ABCD":
        assert (np.array(data[name]) == getattr(plant, name)).all()
    output(*order, tmp_path / "plant.mat")
    struct = loadmat(tmp_path / "plant.mat", squeeze_me=True)["plant"]
    system = control.ss(*(np.atleast_2d(struct[name].item()) for name in "ABCD"))
    expected = direct(estimate, plant.speed)
    found = np.moveaxis(system(1j * OMEGA), 2, 0)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert list(struct["input_name"].item()) == ["F_x1", "F_y1", "F_x3", "F_y3"]
    assert struct["speed"].item() == plant.speed


def test_what_has_no_state_space(tmp_path, refusal):
    friction = rid.Estimate("emps", "ls", "ok", (rid.Value("M", "kg", 95.0, 1.0),))
    rid.export(friction, tmp_path / "a.mat")
    assert "plant" not in loadmat(tmp_path / "a.mat")
    friction.save(tmp_path / "a.json")
    told = refusal("export", tmp_path / "a.json", "--to", tmp_path / "b.json")
    assert "leave that term out" in told
    assert not (tmp_path / "b.json").exists()
    with pytest.raises(rid.InputError, match="the output 'z'"):
        rid.state_space(model_of(SUPPORTED), outputs=["z"])
    lossy = rid.load_model("flexible").file_text.replace('internal = "c_i"', 'structural = "c_i"')
    leaky = SENSOR.replace("h*z +", "h*z + 0.1*c*x' +")
    light = SUPPORTED.replace("nominal = 8.0", "nominal = 1e-310")
    for text, message in (
        (leaky, "1 coordinates and 0 equations without inertia"),
        (lossy.replace('c_i = { unit = "s"', 'c_i = { unit = "1"'), "structural.*internal or ext"),
        (light, "found a machine beyond all bounds"),
    ):
        with pytest.raises(rid.InputError, match=message):
            rid.state_space(model_of(text))


# A result holds its model: also when the files are gone, and where values were substituted.


FREE = model_text(
    "a mass between springs",
    ["m*x'' + c*x' + (k + k2)*x = F"],
    *("x mm", "F N", "m 3.1 kg, c 4.0 N s/m, k 4.0 N/mm, k2 N/m"),
)


def identified(model: rid.Model) -> rid.Estimate:
    frequency = np.array([2.0, 5.0, 9.0])
    s = 2j * np.pi * frequency
    response = 1 / (3.0 * s**2 + 4.0 * s + 5e3)
    force, motion = rid.Channel("F", "N"), rid.Channel("x", "m")
    lines = rid.response_lines(force, [motion], frequency, response[:, None], std=1e-9)
    return rid.identify(model, lines, "ml")


def test_the_result_holds_its_model_and_what_was_substituted(tmp_path):
    model = rid.parse_model(FREE).substitute({"k2": 1e3})
    estimate = identified(model)
    estimate.save(tmp_path / "r.json")
    again = rid.load_estimate(tmp_path / "r.json")
    assert again == estimate
    found = rid.own_model(again)
    assert found.parameter_names == ("m", "c", "k")
    assert found.equations == model.equations
    assert found.name == "model"


def test_a_model_file_is_held_also_when_it_is_gone(tmp_path):
    (tmp_path / "mine.toml").write_text(FREE)
    model = rid.load_model(tmp_path / "mine.toml")
    estimate = identified(model.substitute({"k2": 0.0}))
    (tmp_path / "mine.toml").unlink()
    assert rid.own_model(estimate).name == "mine"
    assert rid.own_model(estimate).units == model.units


def test_older_results_fall_back_to_the_shipped_model_of_that_name(tmp_path):
    mass = rid.Value("m", "kg", 2.0, std=0.01)
    path = tmp_path / "old.json"
    rid.Estimate("rigid", "ml", "ok", (mass,)).save(path)
    data = json.loads(path.read_text())
    data["provenance"] = {"files": [], "experiment": "", "version": "0.1", "command": ""}
    path.write_text(json.dumps(data))
    assert rid.own_model(rid.load_estimate(path)) == rid.load_model("rigid")


@pytest.mark.parametrize("name", ["mine", "rigid"])
def test_older_results_of_own_files_are_refused_with_the_cure(name):
    files = (SourceFile("e.toml", "00"), SourceFile(f"models/{name}.toml", "00"))
    estimate = rid.Estimate(name, "ml", "ok", (), provenance=rid.Provenance(files))
    with pytest.raises(rid.InputError, match=r"without the text of its model.*identify again"):
        rid.own_model(estimate)


@pytest.mark.parametrize("write", [rid.Estimate.save, rid.export])
def test_a_file_that_is_no_result_is_not_replaced_from_python_either(tmp_path, write):
    """The record of a test was overwritten without a word."""
    estimate, record = estimate_of(load_model("jeffcott")), tmp_path / "run.csv"
    record.write_text("t,x\n0,1\n")
    with pytest.raises(InputError, match="force=True"):
        write(estimate, record)
    assert record.read_text() == "t,x\n0,1\n"
    write(estimate, record, force=True)
    write(estimate, record)  # its own
    assert record.stat().st_size > 100
