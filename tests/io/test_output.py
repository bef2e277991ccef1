from pathlib import Path

import pytest

from rotorid.errors import InputError
from rotorid.io.output import check_target, write_files


def fail(path: Path) -> None:
    path.write_text("half")
    raise OSError("disk full")


def test_all_or_nothing(tmp_path: Path) -> None:
    first, second = tmp_path / "a.json", tmp_path / "b.html"
    first.write_text("old")
    with pytest.raises(OSError, match="disk full"):
        write_files({first: lambda path: path.write_text("new"), second: fail})
    assert first.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_written(tmp_path: Path) -> None:
    target, link = tmp_path / "a.json", tmp_path / "link.json"
    link.symlink_to(target)
    write_files({link: lambda path: path.write_text("new")})
    assert target.read_text() == "new"
    assert link.is_symlink()


def test_devices_are_written_directly() -> None:
    write_files({Path("/dev/null"): lambda path: path.write_text("gone")})
    assert not Path("/dev/null").is_file()


def test_targets(tmp_path: Path) -> None:
    check_target(tmp_path / "new.json")
    with pytest.raises(InputError, match="no such folder"):
        check_target(tmp_path / "none" / "new.json")
    with pytest.raises(InputError, match="a file to write"):
        check_target(tmp_path)
