"""A result holds its model: also when the files are gone, and where values were substituted."""

import json

import numpy as np
import pytest

import rotorid as rid
from rotorid.answer.estimate import SourceFile

FREE = """
title = "a mass between springs"
equations = ["m*x'' + c*x' + (k + k2)*x = F"]
coordinates = { x = "mm" }
inputs = { F = "N" }
[parameters]
m = { unit = "kg", nominal = 3.1 }
c = { unit = "N s/m", nominal = 4.0 }
k = { unit = "N/mm", nominal = 4.0 }
k2 = { unit = "N/m" }
"""


def identified(model: rid.Model) -> rid.Estimate:
    """Identify from a response without noise."""
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
