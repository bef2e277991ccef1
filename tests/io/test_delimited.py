"""Text tables as data loggers and spreadsheets write them."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotorid import ReadError
from rotorid.io.text import open_delimited


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "record.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "t [ms],x1 [um],F (N)\n0,1.5,2\n1,2,3\n",
        "t,x1,F\nms,um,N\n0,1.5,2\n1,2,3\n",
        "t,x1,F\n[ms],[um],[N]\n0,1.5,2\n1,2,3\n",
        "# logger 7\n% run 3\n\nt [ms]\tx1 [um]\tF [N]\n0\t1.5\t2\n\n# pause\n1\t2\t3\n",
        "t [ms];x1 [um];F [N]\n0;1,5;2\n1;2;3,0\n",  # a spreadsheet with decimal commas
        't [ms];"x1 [um]";F [N];\n0;1.5;2;\n1;2;3;\n',
        " t [ms] , x1 [um] , F [N]\n 0 , 1.5 , 2\n 1 , 2 , 3\n",
        "t [ms],x1 [um],F [N]\r\n0,1.5,2\r\n1,2,3\r\n",
        "\ufefft [ms],x1 [um],F [N]\n0,1.5,2\n1,2,3\n",
        "t [ms],x1 [um],F [N]\n0,1.5,2\n1,2,3".encode("utf-16"),
        "t [ms],x1 [µm],F [N]\n0,1.5,2\n1,2,3\n".encode("latin-1"),
        '"t [ms]","x1 [um]","F [N]"\n"0","1.5","2"\n"1","2","3"\n',
    ],
)
def test_dialects(tmp_path: Path, text: str | bytes) -> None:
    opened = open_delimited(table(tmp_path, text))
    assert opened.names == ("t", "x1", "F")
    columns = opened.read(["F", "x1", "t"])
    assert columns["x1"].values.tolist() == [1.5, 2.0]
    assert columns["F"].values.tolist() == [2.0, 3.0]
    assert columns["t"].values.tolist() == [0.0, 1.0]
    assert columns["F"].unit == "N"
    assert columns["t"].unit == "ms"
    assert columns["x1"].unit in ("um", "µm")


def test_names_without_units(tmp_path: Path) -> None:
    opened = open_delimited(table(tmp_path, "pos (filtered),n [-],m/s^2\n1,2,3\n"))
    assert opened.names == ("pos (filtered)", "n", "m/s^2")
    assert [column.unit for column in opened.read(opened.names).values()] == [None, None, None]


def test_a_row_of_ones_is_data(tmp_path: Path) -> None:
    opened = open_delimited(table(tmp_path, "a,b\n1,1\n2,1\n"))
    assert opened.read(["a"])["a"].values.tolist() == [1.0, 2.0]


def test_columns_not_asked_for_need_not_be_numbers(tmp_path: Path) -> None:
    opened = open_delimited(table(tmp_path, "clock,x\n12:00:01,1\n12:00:02,2\n"))
    assert opened.read(["x"])["x"].values.tolist() == [1.0, 2.0]


def test_not_a_number_is_read_as_such(tmp_path: Path) -> None:
    opened = open_delimited(table(tmp_path, "a,b\n1,NaN\n2,inf\n"))
    np.testing.assert_array_equal(opened.read(["b"])["b"].values, [np.nan, np.inf])


@pytest.mark.parametrize(
    ("text", "place", "found"),
    [
        ("a,b\n3,4\n\n# x\n1,abc\n", "line 5, column b", "'abc'"),
        ("a,b\n3,4\n1,\n", "line 3, column b", "an empty field"),
        ("a,b\n3,4\n\n1\n", "line 4", "too few columns"),
        ("a,b\n3,4\n1", "line 3", "too few columns"),
        ("a;b\n3;4\n1;2,5,5\n", "line 3, column b", "'2,5,5'"),
        ("a,b\n3,4\n1,12:00\n", "line 3, column b", "'12:00'"),
        ("a,b\n3,4\n1,1_000x\n", "line 3, column b", "'1_000x'"),
    ],
)
def test_fields_that_are_no_numbers(tmp_path: Path, text: str, place: str, found: str) -> None:
    opened = open_delimited(table(tmp_path, text))
    with pytest.raises(ReadError, match="expected") as caught:
        opened.read(["a", "b"])
    assert caught.value.place == place
    assert caught.value.found == found


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "an empty file"),
        ("# only this\n", "comments only"),
        (b"\x00\x01\x02" * 99, "binary data"),
        (b"\x89HDF\r\n\x1a\n" + bytes(99), "HDF5 data"),
        (b"PK\x03\x04" + bytes(99), "spreadsheet"),
        (b"MATLAB 5.0 MAT-file" + bytes(99), "MAT v5"),
    ],
)
def test_files_that_are_no_tables(tmp_path: Path, text: str | bytes, found: str) -> None:
    with pytest.raises(ReadError, match=found):
        open_delimited(table(tmp_path, text))


def test_columns_by_name(tmp_path: Path) -> None:
    opened = open_delimited(table(tmp_path, "force_x,b,b\n1,2,3\n"))
    assert opened.find("force_x") == "force_x"
    with pytest.raises(ReadError, match="did you mean 'force_x'"):
        opened.find("force_y")
    with pytest.raises(ReadError, match="'b' 2 times"):
        opened.find("b")
    with pytest.raises(ReadError, match="scalar variable"):
        opened.scalar("gtau")


@given(
    st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3),
        min_size=1,
        max_size=20,
    ),
    st.sampled_from([",", ";", "\t"]),
)
def test_written_then_read(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[float]], mark: str
) -> None:
    text = mark.join("abc") + "\n" + "".join(mark.join(map(repr, row)) + "\n" for row in rows)
    opened = open_delimited(table(tmp_path_factory.mktemp("csv"), text))
    read = opened.read(["a", "b", "c"])
    np.testing.assert_array_equal(np.column_stack([read[n].values for n in "abc"]), rows)


def test_memory_is_a_few_times_that_of_the_numbers(tmp_path: Path) -> None:
    """Nothing of the text is kept, which is three times as long as its numbers."""
    path = tmp_path / "long.csv"
    values = np.random.default_rng(0).standard_normal((20_000, 6))
    np.savetxt(path, values, delimiter=",", header="a,b,c,d,e,f", comments="", fmt="%.17e")
    table = open_delimited(path)
    tracemalloc.start()
    columns = table.read(table.names)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(columns["c"].values, values[:, 2])
    assert peak < 3 * values.nbytes
