"""`rotorid simulate`: what it writes, and what it does not replace."""

import h5py
import pytest
from working_folder import short_rig

from rotorid import load_experiment


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "short rig.toml"
    path.write_text(short_rig())
    return path


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ['a"b.h5', "a\\b.h5", "a'b c.h5", "schön.h5", "#.h5"])
def test_any_name_and_title_can_be_read_again(rig, tmp_path, name, output):
    out, title = tmp_path / name, 'title = "a\\u0007b"' if name[0] == "#" else 'title = """a\nb"""'
    lines = rig.read_text().splitlines()
    rig.write_text("\n".join([title, *lines[1:]]))  # is a comment of one line
    for _ in range(2):  # its own files are replaced
        output("simulate", rig, "--out", out)
    plan = load_experiment(out.with_suffix(".toml"))
    assert out in plan.files
    assert len(plan.measured("ml")[0].samples) == 2000


@pytest.mark.parametrize("foreign", ["run.h5", "run.toml"])
def test_other_files_are_kept_without_force(rig, tmp_path, output, refusal, foreign):
    command = ("simulate", rig, "--out", tmp_path / "run.h5")
    path = tmp_path / foreign
    if path.suffix == ".h5":
        with h5py.File(path, "w") as data:
            data["measured"] = [1.0]
    else:
        path.write_text("# months of work\n")
    before = path.read_bytes()
    assert "that `rotorid simulate` did not write" in refusal(*command)
    assert path.read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"short rig.toml", foreign}
    output(*command, "--force")
    assert path.read_bytes() != before
