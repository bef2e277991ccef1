"""Files: what may be opened and how much is read; written whole or not at all."""

import contextlib
import io
import json
import os
import socket
import stat
import time
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import jsonschema
import pytest
from working_folder import EXPERIMENT, short_rig, simulated

import rotorid as rid
from rotorid import InputError, ReadError, cli, load_rig
from rotorid.answer.result_file import RESULT_BYTES, RESULT_OBJECTS, RESULT_VALUES
from rotorid.commands import console
from rotorid.core import files
from rotorid.core.toml import TOML_BYTES, TOML_VALUES, parse_toml
from rotorid.io import READERS
from rotorid.testing import open_table

# What may be opened, how much of it is read, and that anything else is told at once.


def listening(path: Path) -> None:
    here = os.getcwd()
    os.chdir(path.parent)  # names of sockets are short
    try:
        socket.socket(socket.AF_UNIX).bind(path.name)
    finally:
        os.chdir(here)


ODD: dict[str, tuple[Callable[[Path], object], str]] = {
    "pipe": (os.mkfifo, "a pipe"),
    "circle": (lambda path: path.symlink_to(path), "too many .*links"),
    "zeros": (lambda path: path.symlink_to("/dev/zero"), "a device"),
    "folder": (Path.mkdir, "a folder"),
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
def test_only_regular_files_are_opened(odd, tmp_path):
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


def test_commands_refuse_devices_and_pipes(tmp_path, refusal):
    experiment = tmp_path / "run.toml"
    experiment.write_text(EXPERIMENT)
    os.mkfifo(tmp_path / "run.csv")
    more = {"simulate": ["--out", "no.h5"], "export": ["--to", "no.csv"], "validate": [experiment]}
    for command in ("identify", "inspect", "report", *more):
        told = refusal(command, "/dev/zero", *more.get(command, []))
        assert "/dev/zero: found a device" in told
    assert "run.csv: found a pipe" in refusal("identify", experiment)


def test_bounds_of_bytes(tmp_path):
    path = tmp_path / "run.toml"
    path.write_bytes(b"#" * TOML_BYTES)
    assert len(files.read_regular(path, TOML_BYTES, "text", "cut it")) == 1_000_000
    path.write_bytes(b"#" * (TOML_BYTES + 1))
    for load in (rid.load_model, rid.load_experiment, load_rig):
        with pytest.raises(ReadError, match="more than 1000 kB"):
            load(path)
    with path.open("wb") as stream:
        stream.truncate(RESULT_BYTES + 1)
    with pytest.raises(ReadError, match="more than 32000 kB"):
        rid.load_estimate(path)


def test_bounds_of_values(tmp_path):
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


def test_byte_order_marks(tmp_path):
    """Editors of Windows put them before TOML and JSON: that is no fault."""
    path, result = tmp_path / "run.toml", tmp_path / "run.json"
    path.write_text(EXPERIMENT, encoding="utf-8-sig")
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
def test_toml_that_is_none(data, found):
    with pytest.raises(ReadError, match=found) as told:
        rid.models.loader.parse_model(data)
    assert len(str(told.value)) < 300


# Files written whole or not at all, and never over what the program did not write.


KIND = files.Kind("rotorid test")


def fail() -> bytes:
    raise OSError(28, "No space left on device")


def test_all_or_nothing(tmp_path):
    first, second = tmp_path / "a.json", tmp_path / "b.html"
    first.write_text("old")
    with pytest.raises(OSError, match="No space left"):
        files.write_files({first: lambda: b"new", second: fail})
    assert first.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_a_disk_that_fills_names_the_users_file(tmp_path, monkeypatch):
    """Not the file beside it, which is gone again; whatever step it is that fails."""
    for step in ("fsync", "replace", "open"):
        target = tmp_path / f"{step}.json"
        target.write_text("old")
        with monkeypatch.context() as patch:
            patch.setattr(f"rotorid.core.files.os.{step}", lambda *_, **__: fail())
            with pytest.raises(OSError, match="No space left on device") as found:
                files.write_whole(target, b"new")
        assert found.value.filename == str(target)
        assert target.read_text() == "old"
        target.unlink()
        assert not list(tmp_path.iterdir())


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "a.json", tmp_path / "link.json"
    link.symlink_to(target)
    files.write_whole(link, b"new")  # it led to nothing
    assert target.read_text() == "new"
    files.write_whole(link, b"newer")
    assert target.read_text() == "newer"
    assert link.is_symlink()


def test_the_mode_of_a_file_stays(tmp_path):
    target, new = tmp_path / "a.json", tmp_path / "new.json"
    target.write_text("old")
    target.chmod(0o600)
    before = os.umask(0o027)
    try:
        files.write_files({target: lambda: b"new", new: lambda: b"new"})
    finally:
        os.umask(before)
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    assert stat.S_IMODE(new.stat().st_mode) == 0o640


def test_devices_and_pipes_are_written_directly(tmp_path):
    files.write_whole("/dev/null", b"gone")
    assert not Path("/dev/null").is_file()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    files.write_whole(pipe, b"answer")
    assert os.read(reading, 100) == b"answer"
    os.close(reading)


def test_names_as_long_as_the_disk_allows(tmp_path):
    target = tmp_path / ("n" * 250 + ".json")
    files.write_whole(target, b"new")
    assert target.read_bytes() == b"new"
    assert len(list(tmp_path.iterdir())) == 1


def test_what_a_killed_process_left_is_in_nobodys_way(tmp_path):
    """In a container the next process has the same number."""
    left = tmp_path / f".a.json.{os.getpid()}-0.part"
    left.write_text("half")
    files.write_whole(tmp_path / "a.json", b"new")
    assert (tmp_path / "a.json").read_bytes() == b"new"
    assert left.read_text() == "half"


def test_targets(tmp_path):
    files.check_target(tmp_path / "new.json")
    files.check_target(Path("/dev/null"))
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    for target, found in (
        (tmp_path / "none" / "new.json", "no such folder"),
        (tmp_path, "a file to write"),
        (loop, "symbolic links"),
        (tmp_path / ("n" * 300), "too long"),
        (Path("a\0b"), "null"),
        (Path(__file__) / "a.json", "Not a directory"),
    ):
        with pytest.raises(InputError, match=found):
            files.check_target(target)


def test_a_file_of_others_is_kept(tmp_path):
    target = tmp_path / "a.json"
    files.check_target(target, KIND)
    target.touch()  # as mktemp does: there is nothing to lose
    files.check_target(target, KIND)
    own = KIND.signed(f'{{"mass": 2, "written": "{files.MARK}"}}'.encode())
    quoting = own.replace(b"2", b'"%s"' % files.MARK.encode().replace(b"0", b"1"), 1)
    for data in (own, KIND.signed(quoting.replace(own[-66:-2], b"0" * 64))):
        target.write_bytes(data)
        files.check_target(target, KIND)
    other = files.Kind("rotorid other").signed(f'{{"mass": 2, "written": "{files.MARK}"}}'.encode())
    for data in (other, own.replace(b"2", b"3", 1), own + b"\n", files.MARK.encode(), b"[]", b"\0"):
        target.write_bytes(data)
        with pytest.raises(InputError, match=r"`rotorid test` did not write.*--force"):
            files.check_target(target, KIND)
        files.check_target(target, KIND, force=True)


def test_one_file_for_two(tmp_path):
    one, other, link = tmp_path / "a", tmp_path / "b", tmp_path / "c"
    link.symlink_to(one)
    files.check_apart([one, other], [])
    files.check_apart([Path("/dev/null"), Path("/dev/null")], [Path("/dev/null")])
    with pytest.raises(InputError, match="an input of this run"):
        files.check_apart([one], [link])
    with pytest.raises(InputError, match="another output of this run"):
        files.check_apart([one, link], [])


def test_what_came_meanwhile_is_kept(tmp_path):
    new, old = tmp_path / "new.json", tmp_path / "old.json"
    old.write_text("old")
    found = {new: files.seen(new), old: files.seen(old)}
    assert found[new] is None
    files.write_files({new: lambda: b"mine", old: lambda: b"mine"}, found)
    assert new.read_text() == old.read_text() == "mine"
    for late in (new, old):
        found = {path: files.seen(path) for path in (new, old)}

        def another(late: Path = late) -> bytes:
            late.write_text("somebody else's")
            return b"mine again"

        with pytest.raises(InputError, match=f"{late.name}: found a file that another program"):
            files.write_files({new: another, old: lambda: b"mine again"}, found)
        assert late.read_text() == "somebody else's"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.json", "old.json"]


def test_a_command_keeps_what_came_while_it_worked(tmp_path, monkeypatch):
    target = tmp_path / "new.json"
    for force in (False, True):
        target.unlink(missing_ok=True)
        console.check_outputs((target, KIND), force=force)
        target.write_text("precious notes")
        if force:
            console.write((target, lambda: b"mine"))
            assert target.read_text() == "mine"
        else:
            with pytest.raises(InputError, match=r"another program changed.*--force"):
                console.write((target, lambda: b"mine"))
            assert target.read_text() == "precious notes"


# JSON Schemas of `rotorid schema` take what the program reads, and no misspelt key.


ROOT = Path(__file__).parents[1]
LIBRARY = ROOT / "src" / "rotorid"
SHIPPED = [
    *(("rig", path) for path in sorted((LIBRARY / "rig" / "library").glob("*.toml"))),
    *(("model", path) for path in sorted((LIBRARY / "models" / "library").glob("*.toml"))),
    *(("experiment", path) for path in sorted((ROOT / "examples").rglob("*.toml"))),
    *(("study", path) for path in sorted((ROOT / "docs").glob("*.toml"))),
]


@cache
def validator_of(kind: str) -> jsonschema.Draft202012Validator:
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        assert cli.run(["schema", kind]) == 0
    found = json.loads(shown.getvalue())
    jsonschema.Draft202012Validator.check_schema(found)
    return jsonschema.Draft202012Validator(found)


@pytest.mark.parametrize(("kind", "path"), SHIPPED, ids=lambda value: Path(value).stem)
def test_a_shipped_file_fits_and_a_misspelt_key_does_not(kind, path):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    kind = "rotor" if "sections" in table else kind
    validator = validator_of(kind)
    validator.validate(table)
    with pytest.raises(jsonschema.ValidationError, match="Additional properties"):
        validator.validate({**table, "tiitle": "x"})


def test_the_experiment_file_of_a_rig_fits(tmp_path):
    table = tomllib.loads(simulated(tmp_path, short_rig()).read_text(encoding="utf-8"))
    validator = validator_of("experiment")
    validator.validate(table)
    table["records"][0]["fundamentall"] = "20 Hz"
    with pytest.raises(jsonschema.ValidationError, match="fundamentall"):
        validator.validate(table)


def test_it_is_printed_and_written_again(tmp_path, output, refusal):
    target = tmp_path / "rig.json"
    for _ in range(2):  # what it wrote itself it may replace
        output("schema", "rig", "--out", target)
    assert target.read_text() == output("schema", "rig")
    target.write_text("{}")
    refusal("schema", "rig", "--out", target)
    assert target.read_text() == "{}"
