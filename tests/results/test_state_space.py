"""State space: the response of the machine itself, in scipy, python-control and MATLAB's files."""

import json

import control
import numpy as np
import pytest
from linear_machines import SUPPORTED, estimate_of, model_of
from scipy.io import loadmat

import rotorid as rid
from rotorid import cli
from rotorid.results.machine import machine_of

OMEGA = 2 * np.pi * np.array([0.7, 11.0, 36.0, 90.0, 333.0, 900.0])
SENSOR = """
title = "a mass, a massless joint and a sensor's dashpot"
equations = ["m*x'' + k*(x - z) = F", "h*z + k*(z - x) = T", "c*s' + g*(s - z) = 0"]
coordinates = { x = "m", z = "m", s = "m" }
inputs = { F = "N", T = "N" }
[parameters]
m = { unit = "kg", nominal = 2.0 }
k = { unit = "N/m", nominal = 3e5 }
h = { unit = "N/m", nominal = 7e5 }
c = { unit = "N s/m", nominal = 50.0 }
g = { unit = "N/m", nominal = 2e4 }
"""


def direct(source: rid.Estimate | rid.Model, speed: float) -> np.ndarray:
    """Return Z^-1 B on the lines, (line, coordinate, input)."""
    machine = machine_of(source)
    push = machine.input_matrix()
    return np.array([np.linalg.solve(machine.dynamic_stiffness(w, speed), push) for w in OMEGA])


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
    for j in range(len(plant.inputs)):
        scipys = plant.to_scipy()
        a, b, c, d = scipys.A, scipys.B[:, [j]], scipys.C, scipys.D[:, [j]]
        states = [np.linalg.solve(1j * w * np.eye(len(a)) - a, b) for w in OMEGA]
        answer = np.array([c @ x + d for x in states])[..., 0]
        assert np.abs(answer - expected[:, :, j]).max() < 1e-9 * size


@pytest.mark.parametrize(("k", "count"), [(0.0, 0), (2e5, 1)])
def test_a_machine_of_one_mode_or_none(k: float, count: int):
    """With deviations, of which pairs of modes are told."""
    text = SENSOR.replace(SENSOR[SENSOR.index("equations") : SENSOR.index("coord")], "E\n")
    text = """
    title = "a mass"
    equations = ["m*s'' + k*s = F"]
    coordinates = { s = "m" }
    inputs = { F = "N" }
    [parameters]
    m = { unit = "kg", nominal = 2.0 }
    k = { unit = "N/m", nominal = 2e5 }
    """
    found = rid.modes(estimate_of(model_of(text), {"k": k}))
    assert len(found.modes) == count


def test_a_machine_beyond_all_bounds():
    with pytest.raises(rid.InputError, match="found a machine beyond all bounds"):
        rid.state_space(estimate_of(model_of(SUPPORTED), {"m": 1e-310}))


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


def test_poles_are_those_of_the_modes():
    model = model_of(SUPPORTED)
    poles = np.linalg.eigvals(rid.state_space(model, speed=500.0).A)
    found = rid.modes(model, speed=500.0)
    own = np.sort(poles.imag[poles.imag > 1])
    assert own == pytest.approx([mode.eigenvalue.imag for mode in found.modes])


def test_files(tmp_path, capsys):
    path = tmp_path / "run.json"
    estimate = estimate_of(rid.load_model("three-mass"))
    estimate.save(path)
    to = str(tmp_path / "plant.json")
    assert cli.run(["export", str(path), "--to", to, "--speed", "8400 rpm"]) == 0
    assert "16 states at 8400 rpm" in capsys.readouterr().out
    data = json.loads((tmp_path / "plant.json").read_text())
    plant = rid.state_space(estimate, speed="8400 rpm")
    assert data["schema"] == "rotorid-state-space/1"
    assert data["inputs"][0] == {"name": "F_x1", "unit": "N"}
    for name in "ABCD":
        assert (np.array(data[name]) == getattr(plant, name)).all()
    mat = str(tmp_path / "plant.mat")
    assert cli.run(["export", str(path), "--to", mat, "--speed", "8400 rpm"]) == 0
    struct = loadmat(mat, squeeze_me=True)["plant"]
    system = control.ss(*(np.atleast_2d(struct[name].item()) for name in "ABCD"))
    expected = direct(estimate, plant.speed)
    found = np.moveaxis(system(1j * OMEGA), 2, 0)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert list(struct["input_name"].item()) == ["F_x1", "F_y1", "F_x3", "F_y3"]
    assert struct["speed"].item() == plant.speed


def test_what_has_no_state_space(tmp_path, capsys):
    friction = rid.Estimate("emps", "ls", "ok", (rid.Value("M", "kg", 95.0, 1.0),))
    rid.export(friction, tmp_path / "a.mat")
    assert "plant" not in loadmat(tmp_path / "a.mat")
    friction.save(tmp_path / "a.json")
    assert cli.run(["export", str(tmp_path / "a.json"), "--to", str(tmp_path / "b.json")]) == 2
    assert "leave that term out" in capsys.readouterr().err
    assert not (tmp_path / "b.json").exists()
    with pytest.raises(rid.InputError, match="the output 'z'"):
        rid.state_space(model_of(SUPPORTED), outputs=["z"])
    with pytest.raises(rid.InputError, match="1 coordinates and 0 equations without inertia"):
        rid.state_space(model_of(SENSOR.replace("h*z +", "h*z + 0.1*c*x' +")))
    flexible = rid.load_model("flexible").file_text
    lossy = flexible.replace('internal = "c_i"', 'structural = "c_i"')
    with pytest.raises(rid.InputError, match=r"structural damping.*internal or external"):
        rid.state_space(model_of(lossy.replace('c_i = { unit = "s"', 'c_i = { unit = "1"')))
