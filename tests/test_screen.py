"""Other people's text on a screen and in generated files: printable, cut, and never a key."""

import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from working_folder import make

from rotorid import InputError, cli
from rotorid.core.errors import CELL, LINE, PART, SENTENCE, one_line, printable, shortened
from rotorid.core.tables import page_text, table

EVIL = "\nevil = 1\n#\x1b[2J\u202e"


@given(st.text())
def test_what_is_shown_is_printable(text: str) -> None:
    assert printable(text).isprintable()
    assert printable(text) == text or not text.isprintable()
    assert one_line(text).isprintable()
    assert page_text([text, table([text, "b"], [[text, text]])]).replace("\n", "").isprintable()


def test_escapes_are_python_s() -> None:
    assert printable("a\x1b[31mb\u202ec\udcffd\n") == "a\\x1b[31mb\\u202ec\\udcffd\\n"
    assert printable("µ 日 é\n", keep="\n") == "µ 日 é\n"
    assert one_line(" a \n b ") == "a b"


@pytest.mark.parametrize("most", [PART, LINE, CELL, SENTENCE])
def test_long_texts_keep_both_ends(most: int) -> None:
    text = "begin" + "\x1b" * 200_000 + "end"
    assert len(one_line(text, most)) == most
    assert one_line(text, most).startswith("begin\\x1b")
    assert one_line(text, most).endswith("\\x1bend")
    assert shortened("x" * most, most) == "x" * most
    assert " ... " in shortened("x" * (most + 1), most)


def test_the_cure_is_never_cut_away() -> None:
    long = "y" * 200_000
    told = str(InputError(long, long, "write it otherwise", file=long, place=long))
    assert told.endswith("; write it otherwise")
    assert len(told) < 5 * (PART + 20)


def test_cells_and_sentences_are_cut() -> None:
    shown = page_text(["z" * 200_000, table(["w" * 200_000, "b"], [["v" * 200_000, "1"]])])
    assert max(map(len, shown.splitlines())) <= SENTENCE
    assert len(shown) < SENTENCE + 4 * CELL


@pytest.fixture
def hostile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A record whose names hold newlines, escape sequences and marks of direction."""
    make(tmp_path)
    samples = np.loadtxt(tmp_path / "run.csv", delimiter=",", skiprows=1)
    columns = dict(zip(["F_x", "F_y", "x", "y"], samples.T, strict=True))
    units = {"F_x": "N", "F_y": "N", "x": "m", "y": "m", "other": "V" + EVIL}
    generator = np.random.default_rng(1)
    columns["other"] = generator.standard_normal(len(samples))
    with h5py.File(tmp_path / "evil.h5", "w") as data:
        for name, column in columns.items():
            data[name + EVIL] = column
            data[name + EVIL].attrs["units"] = units[name]
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("model", [[], ["--model", "jeffcott"]])
def test_no_name_of_a_column_writes_a_key(
    hostile: Path, capsys: pytest.CaptureFixture[str], model: list[str]
) -> None:
    assert cli.run(["new", "evil.h5", *model, "--out", "draft.toml"]) == 0
    text = (hostile / "draft.toml").read_text()
    assert text.replace("\n", "").isprintable()
    found = tomllib.loads(text)
    assert set(found) <= {"model", "records", "channels", "parameters", "estimator"}
    assert "evil = 1" in text  # the names are there, in comments
    assert cli.run(["new", "evil.h5", *model]) == 0
    assert capsys.readouterr().out.replace("\n", "").isprintable()


def test_no_title_or_name_of_a_rig_writes_a_key(
    hostile: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (hostile / "rig.toml").read_text().splitlines()
    lines[0] = 'title = "a\\nevil = 1\\u001b[2J\\u202e"'
    rig = "a\nevil = 1\n#\x1b[2J.toml"
    (hostile / rig).write_text("\n".join(lines))
    assert cli.run(["simulate", rig, "--out", "run.h5", "--force"]) == 0
    text = (hostile / "run.toml").read_text()
    assert text.replace("\n", "").isprintable()
    assert set(tomllib.loads(text)) <= {"model", "records", "channels", "parameters"}
    # Its own as long as nobody has completed it.
    assert cli.run(["simulate", rig, "--out", "run.h5", "-q"]) == 0
    (hostile / "run.toml").write_text(text + "# after a day in the laboratory\n")
    capsys.readouterr()
    assert cli.run(["simulate", rig, "--out", "run.h5", "-q"]) == 2
    assert "edited since" in capsys.readouterr().err
    assert "laboratory" in (hostile / "run.toml").read_text()
