"""TOML files checked against a schema: limits, and one line for every fault."""

from pathlib import Path

import pytest

from rotorid import ReadError
from rotorid.core.toml import Schema, parse_toml, read_toml


class Row(Schema):
    """A table of one number."""

    number: float


class File(Schema):
    """A file of rows."""

    rows: tuple[Row, ...] = ()
    title: str = ""


def test_a_file_of_a_million_bytes_is_read_and_one_of_more_is_not(tmp_path: Path) -> None:
    path = tmp_path / "long.toml"
    text = 'title = "a"\n#'
    path.write_text(text.ljust(1_000_000, "#"))
    assert read_toml(path, File).title == "a"
    path.write_text(text.ljust(1_000_001, "#"))
    with pytest.raises(ReadError, match="found more than 1000 kB; expected a TOML file written by"):
        read_toml(path, File)


def test_a_key_of_32_parts_is_read_and_of_33_is_not() -> None:
    with pytest.raises(ReadError, match="unknown key 'a'"):
        parse_toml(b".".join([b"a"] * 32) + b" = 1", File)
    with pytest.raises(ReadError, match="a key of more than 32 parts"):
        parse_toml(b".".join([b"a"] * 33) + b" = 1", File)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title = ", "no value in 'title ='.*write key = value"),
        (
            "title = a.csv",
            "line 1, column 9: found no value in 'title = a.csv'.*put texts in quotes",
        ),
        ('title = "a', "a text that does not end"),
        ("zzz = 1\nzzz = 2\n", "line 2.*a key that is there twice in 'zzz = 2'"),
        ("[rows", r"a table that is not closed in '\[rows'"),
        ("title", "a key without a value in 'title'"),
        (r'title = "C:\data"', "a backslash in .*write paths with /"),
        ("rows = [1, 2", "end of document: found a list that is not closed.*close it with"),
        ("title = 'a' 'b'", "more behind the value"),
        (
            "rows = [{ nuber = 1 }]",
            r"rows\.0\.nuber: found the unknown key 'nuber'; .*did you mean",
        ),
        ("zzz = 1", "expected one of rows, title; remove it"),
        ("rows = [{}]", r"rows\.0\.number: found no such key; expected a value; add it"),
        ("rows = [{ number = 'x' }]", r"found 'x'; expected a valid number.*write such a value"),
        ("rows = [3]", r"rows\.0: found 3; expected a table, such as \{ key = value \}"),
        ("title = " + "9" * 5000, "a number of more than 400 digits.*with fewer digits"),
    ],
)
def test_faults_are_one_line_with_place_and_cure(text: str, message: str) -> None:
    with pytest.raises(ReadError, match=message) as found:
        parse_toml(text.encode(), File, file="a.toml")
    assert str(found.value).startswith("a.toml: ")
    assert "\n" not in str(found.value)
