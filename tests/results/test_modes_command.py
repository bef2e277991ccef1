"""``rotorid modes`` as its users meet it."""

import json
from pathlib import Path

import pytest
from linear_machines import SUPPORTED, estimate_of, model_of

import rotorid as rid
from rotorid import cli


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "machine.toml").write_text(SUPPORTED)
    estimate_of(rid.load_model(tmp_path / "machine.toml")).save(tmp_path / "result.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_result_alone_gives_modes_and_critical_speeds(folder, capsys):
    (folder / "machine.toml").unlink()
    arguments = ["modes", "result.json", "--speed", "3000 rpm", "--to", "12000 rpm"]
    assert cli.run([*arguments, "--json", "modes.json"]) == 0
    shown = capsys.readouterr().out
    for word in ("without forces at its inputs (T)", "critical speed", "forward", "unbalance"):
        assert word in shown
    found = json.loads((folder / "modes.json").read_text())
    assert found["speed_rad_s"] == pytest.approx(314.159, rel=1e-5)
    assert len(found["modes"]) == len(found["critical_speeds"]) == 4
    first = found["modes"][0]
    for key in ("frequency_hz", "std_hz", "damping_ratio", "damping_std"):
        assert first[key] > 0
    assert first["whirl"] in ("forward", "backward", "planar", "mixed")
    for each in found["critical_speeds"]:
        assert each["std"] > 0
        assert {"speed_rad_s", "std", "whirl"} <= each.keys()
    assert len(found["campbell"]["frequency_hz"]) == 4
    assert set(first["shape"]) == {"x", "y", "theta_x", "theta_y"}


def test_a_model_file_and_a_shipped_model_have_no_deviations(folder, capsys):
    assert cli.run(["modes", "machine.toml", "--json", "modes.json"]) == 0
    found = json.loads((folder / "modes.json").read_text())
    assert {mode["std_hz"] for mode in found["modes"]} == {None}
    assert found["critical_speeds"] == []
    assert cli.run(["modes", "three-mass", "--speed", "-140 Hz"]) == 0
    assert "6 poles at zero" in capsys.readouterr().out


def test_a_result_that_is_not_identifiable_shows_and_ends_with_1(folder, capsys):
    estimate_of(model_of(SUPPORTED), status="not_identifiable").save("open.json")
    assert cli.run(["modes", "open.json"]) == 1
    assert "others fit as well" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing"], "no model 'nothing'"),
        (["none.json"], "none.json"),
        (["emps"], "leave that term out"),
        (["machine.toml", "--speed", "3000"], "without a unit"),
        (["machine.toml", "--speed", "3000 kg"], "unit 'kg'"),
        (["machine.toml", "--to", "0 rpm"], "a speed to go to"),
        (["machine.toml", "--json", "machine.toml"], "machine.toml"),
        (["result.json", "--record", "3"], "no answer"),
    ],
)
def test_what_cannot_be_is_one_line(folder, capsys, arguments, said):
    code = cli.run(["modes", *arguments])
    shown = capsys.readouterr()
    if said == "no answer":  # nothing is a record's own, so that its number does not matter
        assert code == 0
        return
    assert code == 2
    assert shown.out == ""
    assert len(shown.err.splitlines()) == 1
    assert said in shown.err
