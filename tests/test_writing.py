"""Files written whole or not at all, and never over what the program did not write."""

import os
import stat
from pathlib import Path

import pytest

from rotorid import InputError
from rotorid.commands import console
from rotorid.core.files import MARK, Kind, check_apart, check_target, seen, write_files, write_whole

KIND = Kind("rotorid test")


def fail() -> bytes:
    raise OSError(28, "No space left on device")


def test_all_or_nothing(tmp_path: Path) -> None:
    first, second = tmp_path / "a.json", tmp_path / "b.html"
    first.write_text("old")
    with pytest.raises(OSError, match="No space left"):
        write_files({first: lambda: b"new", second: fail})
    assert first.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_a_disk_that_fills_names_the_users_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not the file beside it, which is gone again; whatever step it is that fails."""
    for step in ("fsync", "replace", "open"):
        target = tmp_path / f"{step}.json"
        target.write_text("old")
        with monkeypatch.context() as patch:
            patch.setattr(f"rotorid.core.files.os.{step}", lambda *_, **__: fail())
            with pytest.raises(OSError, match="No space left on device") as found:
                write_whole(target, b"new")
        assert found.value.filename == str(target)
        assert target.read_text() == "old"
        target.unlink()
        assert not list(tmp_path.iterdir())


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    target, link = tmp_path / "a.json", tmp_path / "link.json"
    link.symlink_to(target)
    write_whole(link, b"new")  # it led to nothing
    assert target.read_text() == "new"
    write_whole(link, b"newer")
    assert target.read_text() == "newer"
    assert link.is_symlink()


def test_the_mode_of_a_file_stays(tmp_path: Path) -> None:
    target, new = tmp_path / "a.json", tmp_path / "new.json"
    target.write_text("old")
    target.chmod(0o600)
    before = os.umask(0o027)
    try:
        write_files({target: lambda: b"new", new: lambda: b"new"})
    finally:
        os.umask(before)
    assert stat.S_IMODE(target.stat().st_mode) == 0o600
    assert stat.S_IMODE(new.stat().st_mode) == 0o640


def test_devices_and_pipes_are_written_directly(tmp_path: Path) -> None:
    write_whole("/dev/null", b"gone")
    assert not Path("/dev/null").is_file()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="found a pipe that nobody reads"):
        write_whole(pipe, b"nobody reads this")
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_whole(pipe, b"answer")
    assert os.read(reading, 100) == b"answer"
    os.close(reading)


def test_names_as_long_as_the_disk_allows(tmp_path: Path) -> None:
    target = tmp_path / ("n" * 250 + ".json")
    write_whole(target, b"new")
    assert target.read_bytes() == b"new"
    assert len(list(tmp_path.iterdir())) == 1


def test_what_a_killed_process_left_is_in_nobodys_way(tmp_path: Path) -> None:
    """In a container the next process has the same number."""
    left = tmp_path / f".a.json.{os.getpid()}-0.part"
    left.write_text("half")
    write_whole(tmp_path / "a.json", b"new")
    assert (tmp_path / "a.json").read_bytes() == b"new"
    assert left.read_text() == "half"


def test_targets(tmp_path: Path) -> None:
    check_target(tmp_path / "new.json")
    check_target(Path("/dev/null"))
    with pytest.raises(InputError, match="no such folder"):
        check_target(tmp_path / "none" / "new.json")
    with pytest.raises(InputError, match="a file to write"):
        check_target(tmp_path)
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    with pytest.raises(InputError, match="symbolic links"):
        check_target(loop)
    with pytest.raises(InputError, match="too long"):
        check_target(tmp_path / ("n" * 300))
    with pytest.raises(InputError, match="null"):
        check_target(Path("a\0b"))
    with pytest.raises(InputError, match="Not a directory"):
        check_target(Path(__file__) / "a.json")


def test_a_file_of_others_is_kept(tmp_path: Path) -> None:
    target = tmp_path / "a.json"
    check_target(target, KIND)
    target.touch()  # as mktemp does: there is nothing to lose
    check_target(target, KIND)
    own = KIND.signed(f'{{"mass": 2, "written": "{MARK}"}}'.encode())
    quoting = own.replace(b"2", b'"%s"' % MARK.encode().replace(b"0", b"1"), 1)
    for data in (own, KIND.signed(quoting.replace(own[-66:-2], b"0" * 64))):
        target.write_bytes(data)
        check_target(target, KIND)
    other = Kind("rotorid other").signed(f'{{"mass": 2, "written": "{MARK}"}}'.encode())
    for data in (other, own.replace(b"2", b"3", 1), own + b"\n", MARK.encode(), b"[]", b"\0"):
        target.write_bytes(data)
        with pytest.raises(InputError, match=r"`rotorid test` did not write.*--force"):
            check_target(target, KIND)
        check_target(target, KIND, force=True)


def test_one_file_for_two(tmp_path: Path) -> None:
    one, other, link = tmp_path / "a", tmp_path / "b", tmp_path / "c"
    link.symlink_to(one)
    check_apart([one, other], [])
    check_apart([Path("/dev/null"), Path("/dev/null")], [Path("/dev/null")])
    with pytest.raises(InputError, match="an input of this run"):
        check_apart([one], [link])
    with pytest.raises(InputError, match="another output of this run"):
        check_apart([one, link], [])


def test_what_came_meanwhile_is_kept(tmp_path: Path) -> None:
    new, old = tmp_path / "new.json", tmp_path / "old.json"
    old.write_text("old")
    found = {new: seen(new), old: seen(old)}
    assert found[new] is None
    write_files({new: lambda: b"mine", old: lambda: b"mine"}, found)
    assert new.read_text() == old.read_text() == "mine"
    for late in (new, old):
        found = {path: seen(path) for path in (new, old)}

        def another(late: Path = late) -> bytes:
            late.write_text("somebody else's")
            return b"mine again"

        with pytest.raises(InputError, match=f"{late.name}: found a file that another program"):
            write_files({new: another, old: lambda: b"mine again"}, found)
        assert late.read_text() == "somebody else's"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["new.json", "old.json"]


def test_a_command_keeps_what_came_while_it_worked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
