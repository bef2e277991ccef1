"""`rotorid inspect`: finished files, drafts, the page, and what cannot be read."""

import json
from pathlib import Path

import pytest

from rotorid.cli import run


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rig")
    assert run(["simulate", "rigid", "--out", str(folder / "rig.h5"), "--seed", "1"]) == 0
    return folder


def test_a_good_record_is_ok(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = rig / "found.json"
    assert run(["inspect", str(rig / "rig.toml"), "--json", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "rig.h5: ok. Nothing stands against identifying" in shown
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["verdict"] == "ok"
    assert found["period_samples"] == 1000
    assert found["sample_rate_hz"] == 10_000.0
    assert found["speed_rad_s"] == pytest.approx(942.478, rel=1e-6)
    assert {check["verdict"] for check in found["checks"]} == {"ok"}
    assert set(found["checks"][0]) == {"check", "channel", "found", "verdict"}
    names = [channel["name"] for channel in found["channels"]]
    assert names[:1] == ["F_xa"]
    assert all(channel["snr_db"] > 30 for channel in found["channels"])


def test_a_draft_is_read_as_far_as_it_goes(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    draft = rig / "draft.toml"
    assert run(["new", str(rig / "rig.h5"), "--model", "rigid", "--out", str(draft)]) == 0
    assert run(["inspect", str(draft)]) == 0
    shown = capsys.readouterr().out
    assert "read as a draft, every column as it is" in shown
    assert "100 periods of 1000 samples" in shown
    assert "encoder" not in shown.split("channel ")[1]


def test_without_a_fundamental_the_period_is_found(
    rig: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = rig / "bare.toml"
    bare.write_text('[[records]]\nfile = "rig.h5"\ntime = "t"\n', encoding="utf-8")
    assert run(["inspect", str(bare)]) == 0
    assert "periods of 1000 samples (found: 0.1 s, 10 Hz)" in capsys.readouterr().out


def test_the_page_stands_alone(rig: Path) -> None:
    page = rig / "found.html"
    assert run(["inspect", str(rig / "rig.toml"), "--report", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    for title in ("Samples", "Lines of the mean period", "From period to period", "Noise that"):
        assert f"<h2>{title}" in text
    assert "http" not in text.split("</head>")[1].replace("http://www.w3.org", "")


def test_a_file_that_is_wrong_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.toml"
    for text in ("model = ", 'model = "rigid"\n', "[[records]]\nspeed = 3\n"):
        broken.write_text(text, encoding="utf-8")
        assert run(["inspect", str(broken)]) == 2
    broken.write_text('[[records]]\nfile = "none.h5"\n', encoding="utf-8")
    assert run(["inspect", str(broken)]) == 2
    assert all(line.startswith("rotorid: ") for line in capsys.readouterr().err.splitlines())
