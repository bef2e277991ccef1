"""What may be opened, how much of it is read, and that anything else is told at once."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid as rid
from rotorid import InputError, ReadError, load_rig
from rotorid.answer.result_file import RESULT_BYTES, RESULT_OBJECTS, RESULT_VALUES
from rotorid.cli import run
from rotorid.core.files import check_beside, check_regular, open_regular, read_regular
from rotorid.core.toml import TOML_BYTES, TOML_VALUES, parse_toml
from rotorid.io import READERS, open_table

EXPERIMENT = """
model = "jeffcott"
[[records]]
file = "{file}"
sample_rate = "2 kHz"
fundamental = "10 Hz"
harmonics = [1]
[channels]
F_x = {{ column = "fx", unit = "N" }}
F_y = {{ column = "fy", unit = "N" }}
x = {{ column = "x", unit = "um" }}
y = {{ column = "y", unit = "um" }}
"""


def pipe(path: Path) -> None:
    os.mkfifo(path)


def circle(path: Path) -> None:
    path.symlink_to(path)


def zeros(path: Path) -> None:
    path.symlink_to("/dev/zero")


def folder(path: Path) -> None:
    path.mkdir()


def listening(path: Path) -> None:
    here = os.getcwd()
    os.chdir(path.parent)  # names of sockets are short
    try:
        socket.socket(socket.AF_UNIX).bind(path.name)
    finally:
        os.chdir(here)


ODD: dict[str, tuple[Callable[[Path], None], str]] = {
    "pipe": (pipe, "a pipe"),
    "circle": (circle, "too many .*links"),
    "zeros": (zeros, "a device"),
    "folder": (folder, "a folder"),
    "socket": (listening, "a socket"),
    "nothing": (lambda path: None, "no such file"),
}
LOADERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "model": ("odd.toml", rid.load_model),
    "experiment": ("odd.toml", rid.load_experiment),
    "rig": ("odd.toml", load_rig),
    "result": ("odd.json", rid.load_estimate),
    **{ending: (f"odd{ending}", open_table) for ending in READERS},
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")
def test_only_regular_files_are_opened(odd: str, tmp_path: Path) -> None:
    make, found = ODD[odd]
    for name, load in LOADERS.values():
        path = tmp_path / name
        if not os.path.lexists(path):
            make(path)
        started = time.monotonic()
        with pytest.raises(ReadError, match=rf"{name}: found {found}.*; expected") as told:
            load(path)
        assert time.monotonic() - started < 2
        assert "\n" not in str(told.value)


@pytest.mark.parametrize("command", ["identify", "inspect", "simulate", "report", "export"])
def test_commands_refuse_devices(command: str, capfd: pytest.CaptureFixture[str]) -> None:
    extra = ["--csv", "never.csv"] if command == "export" else []
    assert run([command, "/dev/zero", *extra]) == 2
    assert capfd.readouterr().err.count("\n") <= 2


def test_validate_refuses_devices(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "run.toml").write_text(EXPERIMENT.format(file="run.csv"))
    assert run(["validate", "/dev/zero", str(tmp_path / "run.toml")]) == 2
    assert "/dev/zero: found a device" in capfd.readouterr().err


def test_a_pipe_for_a_record(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "run.csv")
    (tmp_path / "run.toml").write_text(EXPERIMENT.format(file="run.csv"))
    assert run(["identify", str(tmp_path / "run.toml")]) == 2
    assert "run.csv: found a pipe" in capfd.readouterr().err


def test_a_pipe_put_in_the_place_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the look at a file and its opening: it is opened without waiting, and looked at."""
    path = tmp_path / "run.toml"
    os.mkfifo(path)
    monkeypatch.setattr("rotorid.core.files.check_regular", lambda *_: None)
    with pytest.raises(ReadError, match="found a pipe"):
        open_regular(path)


def test_bounds_of_bytes(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_bytes(b"#" * TOML_BYTES)
    assert len(read_regular(path, TOML_BYTES, "text", "cut it")) == 1_000_000
    path.write_bytes(b"#" * (TOML_BYTES + 1))
    for load in (rid.load_model, rid.load_experiment, load_rig):
        with pytest.raises(ReadError, match="more than 1000 kB"):
            load(path)
    with path.open("wb") as stream:
        stream.truncate(RESULT_BYTES + 1)
    with pytest.raises(ReadError, match="more than 32000 kB"):
        rid.load_estimate(path)


def test_bounds_of_values(tmp_path: Path) -> None:
    """Of TOML and of results: what has far too many is not looked at one by one."""
    path = tmp_path / "run.json"
    for text, count in ((b"1,", RESULT_VALUES), (b"{}", RESULT_OBJECTS)):
        for more, found in ((0, "no JSON"), (1, "more than 1500000 values")):
            path.write_bytes(text * (count + more))
            with pytest.raises(ReadError, match=found):
                rid.load_estimate(path)
    path.write_text('{"schema": "rotorid-estimate/2", "parameters": [' + "1," * 20_000 + "1]}")
    with pytest.raises(ReadError, match=r"found 200.. faults"):
        rid.load_estimate(path)
    lists = b"records = [" + b"1," * (TOML_VALUES - 1) + b"]"
    with pytest.raises(ReadError, match="no such key"):
        parse_toml(lists, rid.experiment.schema.ExperimentFile)
    with pytest.raises(ReadError, match="more than 20000 values"):
        parse_toml(lists + b"\nmodel = 1", rid.experiment.schema.ExperimentFile)


def test_byte_order_marks(tmp_path: Path) -> None:
    """Editors of Windows put them before TOML and JSON: that is no fault."""
    path, result = tmp_path / "run.toml", tmp_path / "run.json"
    path.write_text(EXPERIMENT.format(file="run.csv"), encoding="utf-8-sig")
    assert rid.load_experiment(path).model.name == "jeffcott"
    rid.Estimate("one", "ls", "ok", (rid.Value("m", "kg", 2.0, std=0.01),)).save(result)
    result.write_text(result.read_text(), encoding="utf-8-sig")
    assert rid.load_estimate(result).value("m") == 2.0


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"title = '\xe9'", "byte 9 that is no UTF-8"),
        (b"title = 0x" + b"f" * 500, "a number of more than 400 digits"),
        (b"title = " + b"9" * 401, "a number of more than 400 digits"),
        (b"title = " + b"9" * 400, "9999.*expected a valid string"),
        ("title = 1".encode("utf-16"), "byte 0 that is no UTF-8"),
    ],
)
def test_toml_that_is_none(data: bytes, found: str) -> None:
    with pytest.raises(ReadError, match=found) as told:
        rid.models.loader.parse_model(data)
    assert len(str(told.value)) < 300


@pytest.mark.parametrize("number", ["9" * 5000, "1e999", "-" + "9" * 400, "NaN"])
def test_numbers_of_results(number: str, tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_text('{"schema": ' + number + "}")
    with pytest.raises(ReadError, match=r"run\.json") as told:
        rid.load_estimate(path)
    assert len(str(told.value)) < 300


def test_files_that_a_record_names(tmp_path: Path) -> None:
    """They lie below its folder, wherever links lead, and are regular files."""
    record = tmp_path / "data" / "run.h5"
    (tmp_path / "data" / "parts").mkdir(parents=True)
    for path in (record, record.with_name("a.h5"), tmp_path / "outside.h5"):
        path.write_bytes(b"x")
    (tmp_path / "data" / "parts" / "b.h5").write_bytes(b"x")
    record.with_name("link.h5").symlink_to(tmp_path / "outside.h5")
    circle(record.with_name("circle.h5"))
    pipe(record.with_name("pipe.h5"))
    for name in ("a.h5", "parts/b.h5", "parts/../a.h5", str(record.with_name("a.h5"))):
        assert check_beside(name, record).is_file()
    for name in ("../outside.h5", "link.h5", "/dev/zero", str(tmp_path / "outside.h5"), "a\0b"):
        with pytest.raises(ReadError, match="expected samples in the record, or in files below"):
            check_beside(name, record)
    with pytest.raises(ReadError, match="found a pipe; expected a part of"):
        check_beside("pipe.h5", record)
    with pytest.raises(ReadError, match="no such file"):
        check_beside("gone.h5", record)
    with pytest.raises(InputError, match=r"run\.h5: found samples in|links"):
        check_beside("circle.h5", record)


def test_regular_files_are_taken(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("x")
    (tmp_path / "link.csv").symlink_to(path)
    assert check_regular(tmp_path / "link.csv").st_size == 1
    with open_regular(tmp_path / "link.csv") as stream:
        assert stream.read() == b"x"
