"""`rotorid simulate`: what it writes, and what it does not replace."""

from pathlib import Path

import h5py
import pytest
from working_folder import short_rig

from rotorid import load_experiment
from rotorid.cli import run


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "short rig.toml"
    path.write_text(short_rig())
    return str(path)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ['a"b.h5', "a\\b.h5", "a'b c.h5", "schön.h5", "#.h5"])
def test_any_name_and_title_can_be_read_again(rig, tmp_path, name):
    out, title = tmp_path / name, 'title = "a\\u0007b"' if name[0] == "#" else 'title = """a\nb"""'
    lines = Path(rig).read_text().splitlines()
    Path(rig).write_text("\n".join([title, *lines[1:]]))  # is a comment of one line
    for _ in range(2):  # its own files are replaced
        assert run(["simulate", rig, "--out", str(out)]) == 0
    plan = load_experiment(out.with_suffix(".toml"))
    assert out in plan.files
    assert len(plan.measured("ml")[0].samples) == 2000


@pytest.mark.parametrize("foreign", ["run.h5", "run.toml"])
def test_other_files_are_kept_without_force(rig, tmp_path, capsys, foreign):
    out = str(tmp_path / "run.h5")
    path = tmp_path / foreign
    if path.suffix == ".h5":
        with h5py.File(path, "w") as data:
            data["measured"] = [1.0]
    else:
        path.write_text("# months of work\n")
    before = path.read_bytes()
    assert run(["simulate", rig, "--out", out]) == 2
    assert "that `rotorid simulate` did not write" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"short rig.toml", foreign}
    assert run(["simulate", rig, "--out", out, "--force"]) == 0
    assert path.read_bytes() != before
