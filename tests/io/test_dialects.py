"""Delimited text: its dialects, and its bounds."""

import struct
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from io_writers import WRITERS, write_mdf, write_table

import rotorid as rid
from rotorid import ReadError
from rotorid.io import open_tables
from rotorid.io.table import COLUMNS, check_held
from rotorid.io.text import (
    DIGITS,
    LINE_CHARACTERS,
    PREAMBLE_CHARACTERS,
    find_dialect,
    is_value,
    open_delimited,
)
from rotorid.testing import open_table

# Text tables as programs of measurement write them: preambles, no names, clocks, white space.


CONTROL_DESK = """\
"ControlDesk Next Generation","CSV export 1.0"
"Experiment","magnetic bearing"
"Recorded","03/11/2026 14:02:11"
"Sample rate [Hz]","5000"

"path","Platform()://Model/x1","Platform()://Model/Fx1"
"x_axis","x1","Fx1"
"s","um","N"
"0.0000","1.5","2"
"0.0002","2","3"
"0.0004","2.5","4"
"""
TEST_LAB = """\
Project:\trotor stand
Section:\tRun 3
Channel\tFx1\tx1
Sampling frequency:\t5000 Hz
Number of points:\t3

Time\tFx1\tx1
s\tN\tum
0,0000E+00\t2,0E+00\t1,5E+00
2,0000E-04\t3,0E+00\t2,0E+00
4,0000E-04\t4,0E+00\t2,5E+00
"""
DSPACE = """\
% dSPACE capture, host service
% sampling interval: 0.0002
descriptor=run 3
traces=3

time x1 Fx1
0       1.5   2
0.0002  2.0   3
0.0004  2.5   4
"""
LOGGER = """\
Device;DAQ-8;
Start;11.03.2026;14:02:11
Sample Rate;5;kHz
Clock;x1 (um);Fx1 (N)
14:02:11,0000;1,5;2
14:02:11,0002;2,0;3
14:02:11,0004;2,5;4
"""


def table(folder: Path, text: str | bytes) -> Path:
    path = folder / "run.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


@pytest.mark.parametrize(
    ("text", "time", "units"),
    [
        (CONTROL_DESK, "x_axis", ("um", "N")),
        (TEST_LAB, "Time", ("um", "N")),
        (DSPACE, "time", (None, None)),
        (LOGGER, "Clock", ("um", "N")),
    ],
)
def test_preambles(text, time, units, tmp_path):
    path = table(tmp_path, text)
    columns = open_delimited(path).read(["x1", "Fx1"])
    assert columns["x1"].values.tolist() == [1.5, 2.0, 2.5]
    assert columns["Fx1"].values.tolist() == [2.0, 3.0, 4.0]
    assert (columns["x1"].unit, columns["Fx1"].unit) == units
    assert columns["x1"].rate.hertz == 5000.0
    for asked in ({"columns": ["x1", "Fx1"], "time": time}, {"columns": ["x1"]}):
        assert rid.read_record(path, **asked).sample_rate == pytest.approx(5000.0, rel=1e-7)


@pytest.mark.parametrize(
    "text",
    [
        "0 1.5 2\n1 2 3\n2 2.5 4\n",
        "  0.0   1.5\t2 \n  1.0   2.0\t3 \n  2.0   2.5\t4 \n",
        "0,1.5,2\n1,2,3\n2,2.5,4\n",
        "0;1,5;2\n1;2,0;3\n2;2,5;4\n",
        "# no names here\n0\t1.5\t2\n1\t2\t3\n2\t2.5\t4\n",
        "-0.0e0 +1.5E0 2.\n1 2 3\n2 2.5 4\n",
    ],
)
def test_tables_without_names(text, tmp_path):
    opened = open_delimited(table(tmp_path, text))
    assert opened.names == ("0", "1", "2")
    assert opened.read(["1"])["1"].values.tolist() == [1.5, 2.0, 2.5]
    with pytest.raises(ReadError, match=r"no column 'x'.*name columns by their number, from 0"):
        opened.find("x")


@pytest.mark.parametrize(("header", "mark"), [("t x1", " "), ("a note\nt,x1", ",")])
def test_names_as_numpy_writes_them(header, mark, tmp_path):
    np.savetxt(tmp_path / "run.dat", np.arange(6.0).reshape(3, 2), header=header, delimiter=mark)
    assert open_delimited(tmp_path / "run.dat").names == ("t", "x1")


def test_numbers_name_no_column(tmp_path):
    """A log that begins with the settings of its test, their names above their values."""
    path = tmp_path / "swing.txt"
    path.write_text("trigger_deg, sample_rate, seconds\n90, 1000, 5\n-90.36\n-90.64\n-90.91\n")
    opened = open_delimited(path)
    assert opened.names == ("0",)
    assert opened.read(["0"])["0"].values.tolist() == [-90.36, -90.64, -90.91]


def test_header_row(tmp_path):
    path = table(tmp_path, "names,in,line 1\n1,2,3\n4,5,6\n7,8,9\n")
    assert open_delimited(path, header_row=1).names == ("names", "in", "line 1")
    numbered = table(tmp_path, "1,2,3\n10,20,30\n11,21,31\n")
    assert open_delimited(numbered).names == ("0", "1", "2")
    named = open_delimited(numbered, header_row=1)
    assert named.names == ("1", "2", "3")
    assert named.read(["2"])["2"].values.tolist() == [20.0, 21.0]
    assert open_delimited(path, header_row=0).names == ("0", "1", "2")
    with pytest.raises(ReadError, match=r"header_row: found nothing in line 9.*correct header_row"):
        open_delimited(path, header_row=9)


@pytest.mark.parametrize(
    ("stamps", "seconds"),
    [
        (["12:30:59.750", "12:31:00.000", "12:31:00.250"], [0, 0.25, 0.5]),
        (["23:59:59.5", "00:00:00.0", "00:00:00.5"], [0, 0.5, 1.0]),
        (["59:59", "60:00", "60:01"], [0, 1, 2]),
        (["2026-03-11T23:59:59.5", "2026-03-12T00:00:00", "2026-03-12T00:00:00.5Z"], [0, 0.5, 1]),
        (["2026-03-11 10:00:00", "2026-03-11 10:00:01", "2026-03-11 10:00:02"], [0, 1, 2]),
        ([f"11.03.2026 10:00:00.{tenth}" for tenth in (1, 2, 3)], [0, 0.1, 0.2]),
        (["3/11/2026 10:00:00", "3/11/2026 10:00:01", "3/11/2026 10:00:02"], [0, 1, 2]),
    ],
)
def test_clocks(stamps, seconds, tmp_path):
    rows = "".join(f"{stamp},{i}\n" for i, stamp in enumerate(stamps))
    column = open_delimited(table(tmp_path, "clock,x\n" + rows)).read(["clock"])["clock"]
    np.testing.assert_allclose(column.values, seconds, atol=1e-9)
    assert column.unit == "s"


def test_a_clock_that_breaks_off(tmp_path):
    path = table(tmp_path, "clock,x\n10:00:00,1\n10:00:01,1\nend,1\n")
    with pytest.raises(ReadError, match=r"line 4, column clock: found 'end'; expected a time such"):
        open_delimited(path).read(["clock"])


@pytest.mark.parametrize(
    ("line", "rows", "hertz"),
    [
        ("Sample rate: 5,000 Hz", "1.5\t2", 5000),
        ("Sampling rate [Hz]: 5,000", "1.5\t2", 5000),
        ("Sample rate: 1,000,000 Hz", "1\t2", 1e6),
        ("Sample rate: 10.000 Hz", "1,5\t2", 10_000),
        ("Sample rate: 12.345,5 Hz", "1,5\t2", 12345.5),
        ("Sample rate: 5000,25 Hz", "1,5\t2", 5000.25),
        ("Sample rate: 5,000 Hz", "1\t2", None),  # nothing tells which mark it is
        ("Sample rate: 5,000 Hz", "1,5\t2", None),  # 5 Hz, which nobody samples at
        ("Sample rate: 5.000 kHz", "1\t2", 5000),
        ("Sample rate: 5,000 Hz", "1.5,2", 5000),
        ("Sample rate,5000,Channels,4", "1.5,2", 5000),
        ("Sample rate [kS/s]: 10", "1\t2", 10_000),
        ("Sample rate\t10\tkSa/s", "1\t2", 10_000),
        ("Sample rate: 2 MHz", "1\t2", 2e6),
        ("Sample rate: 600 bpm", "1\t2", None),
        ("Sample rate;600;B/s", "1;2", None),
        ("Sample rate: 5000 per channel", "1\t2", None),
        ("Sample time: 12:30:05", "1\t2", None),
        ("Sampling time 11.03.2026", "1\t2", None),
        ("Sampling time 10 s", "1\t2", None),  # how long was recorded
        ("Sampling time 100 ms", "1\t2", 10),
        ("Sampling time 101 ms", "1\t2", None),
        ("Sampling interval: 200 us", "1\t2", 5000),
        ("Sample time: 12:30:05\nSample rate: 5 kHz", "1\t2", 5000),
        ("scan rate (Hz)=2000", "1,2", 2000),
        ("Delta_X\t0.001", "1,2", 1000),
        ("Sample interval [ms]: 0.5", "1,2", 2000),
        ("sampling frequency 1e4 Hz", "1,2", 10_000),
        ("sample time;0.1 ms", "1,2", 10_000),
        ("x" * (PREAMBLE_CHARACTERS - 25) + " sample rate 2000 Hz kept", "1,2", 2000),
        ("x" * (PREAMBLE_CHARACTERS - 10) + " sample rate 2000 Hz", "1,2", None),
    ],
)
def test_rates_beyond_doubt(line, rows, hertz):
    """A rate read a thousand times too small makes masses a million times too large, and ok."""
    dialect = find_dialect([*line.split("\n"), *[rows] * 4])
    assert (dialect.rate and dialect.rate.hertz) == (hertz and pytest.approx(hertz))


@pytest.mark.parametrize("rows", ["-3.67621\t403,848", "1,5;2.5", "0.5 1,000"])
def test_two_decimal_marks(rows):
    """One of the two stands between thousands, and would make a number a thousandth."""
    with pytest.raises(ReadError, match=r"numbers with commas and with points, '[^']*,.*one deci"):
        find_dialect(["a b".replace(" ", rows.strip("0123456789.,-")), *[rows] * 4])


@pytest.mark.parametrize(("rows", "last"), [("0,5;2,5\n", "1.234;0,5"), ("0.5;2.5\n", "1,234;0.5")])
def test_a_mark_between_thousands_further_on(rows, last, tmp_path):
    found = last.split(";")[0]
    with pytest.raises(ReadError, match=rf"line 502, column x: found '{found}'; expected a number"):
        open_delimited(table(tmp_path, f"x;y\n{rows * 500}{last}\n")).read(["x", "y"])


@pytest.mark.parametrize(
    ("header", "row", "names"),
    [
        ("Time (s) fx [N] px", "1 2 3", ("Time", "fx", "px")),
        ("fx [N] px [ um ] py", "1 2 3", ("fx", "px", "py")),
        ("x [mm,N],y", "1,2", ("x [mm,N]", "y")),
        ("X_Value\tfx\tComment", "1\t2", ("X_Value", "fx")),
        ("fx,py,,", "1,2", ("fx", "py")),
    ],
)
def test_names_that_hold_the_delimiter(header, row, names):
    assert find_dialect([header, *[row] * 4]).names == names


@pytest.mark.parametrize(
    ("header", "row"),
    [("a,b,c,d,e", "1,2,3"), ("a b c", "1 2"), ("a (s b c", "1 2"), ("x\ty\tz", "1\t2")],
)
def test_more_names_than_columns(header, row):
    """A name that is cut in two would give every column behind it its neighbour's."""
    with pytest.raises(ReadError, match=r"line 1: found \d names for \d columns"):
        find_dialect([header, *[row] * 4])


@pytest.mark.parametrize("other", ["°C", "degC", "dB", "VDC"])
def test_a_row_of_units_may_hold_some_that_no_record_needs(other):
    """A temperature beside the motion makes no names of the units."""
    dialect = find_dialect(["t;x1;Temp", f"s;um;{other}", *["0,5;1,5;31"] * 4])
    assert dialect.names == ("t", "x1", "Temp")
    assert dialect.units == ("s", "um", None)


# Text tables as data loggers and spreadsheets write them.


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
        "t [ms],x1 [µm],F [N]\n0,1.5,2\n1,2,3\n".encode("utf-8-sig"),
        '"t [ms]","x1 [um]","F [N]"\n"0","1.5","2"\n"1","2","3"\n',
    ],
)
def test_dialects(tmp_path, text):
    opened = open_delimited(table(tmp_path, text))
    assert opened.names == ("t", "x1", "F")
    columns = opened.read(["F", "x1", "t"])
    values = {name: column.values.tolist() for name, column in columns.items()}
    assert values == {"F": [2.0, 3.0], "x1": [1.5, 2.0], "t": [0.0, 1.0]}
    assert (columns["F"].unit, columns["t"].unit) == ("N", "ms")
    assert columns["x1"].unit in ("um", "µm")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("x,b\n1,1\n2,1\n", [1.0, 2.0]),  # a row of ones is data
        ("clock,x\n12:00:01,1\n12:00:02,2\n", [1.0, 2.0]),  # what is not asked for may be words
        ("a,x\n1,NaN\n2,inf\n", [np.nan, np.inf]),
    ],
)
def test_what_is_asked_for_is_read(text, values, tmp_path):
    found = open_delimited(table(tmp_path, text)).read(["x"])["x"].values
    np.testing.assert_array_equal(found, values)


@pytest.mark.parametrize(
    ("text", "place", "found"),
    [
        ("a,b\n1,abc\n2,3\n4,5\n6,7\n", "line 2, column b", "'abc'"),  # no row of names
        ("a,b\n3,4\n\n# x\n1,abc\n", "line 5, column b", "'abc'"),
        ("a,b\n3,4\n1,\n", "line 3, column b", "an empty field"),
        ("a,b\n3,4\n\n1\n", "line 4", "too few columns"),
        ("a,b\n3,4\n1", "line 3", "too few columns"),
        ("a;b\n3;4\n1;2,5,5\n", "line 3, column b", "'2,5,5'"),
        ("a,b\n3,4\n1,12:00\n", "line 3, column b", "'12:00'"),
        ("a,b\n3,4\n1,1_000x\n", "line 3, column b", "'1_000x'"),
    ],
)
def test_fields_that_are_no_numbers(tmp_path, text, place, found):
    opened = open_delimited(table(tmp_path, text))
    assert opened.names == ("a", "b")
    with pytest.raises(ReadError, match="expected") as caught:
        opened.read(["a", "b"])
    assert (caught.value.place, caught.value.found) == (place, found)


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
def test_files_that_are_no_tables(tmp_path, text, found):
    with pytest.raises(ReadError, match=found):
        open_delimited(table(tmp_path, text))


def test_columns_by_name(tmp_path):
    opened = open_delimited(table(tmp_path, "force_x,b,b\n1,2,3\n"))
    assert opened.find("force_x") == "force_x"
    for name, told in (("force_y", "did you mean force_x"), ("b", "'b' 2 times")):
        with pytest.raises(ReadError, match=told):
            opened.find(name)
    with pytest.raises(ReadError, match="scalar variable"):
        opened.scalar("gtau")


ROW = st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3)


@settings(max_examples=50)
@given(st.lists(ROW, min_size=1, max_size=20), st.sampled_from([",", ";", "\t"]))
def test_written_then_read(tmp_path_factory, rows, mark):
    text = mark.join("abc") + "\n" + "".join(mark.join(map(repr, row)) + "\n" for row in rows)
    read = open_delimited(table(tmp_path_factory.mktemp("csv"), text)).read(["a", "b", "c"])
    np.testing.assert_array_equal(np.column_stack([read[n].values for n in "abc"]), rows)


def test_memory_is_a_few_times_that_of_the_numbers(tmp_path):
    """Nothing of the text is kept, which is three times as long as its numbers."""
    values = np.random.default_rng(0).standard_normal((20_000, 6))
    write_table(tmp_path / "long.csv", "a,b,c,d,e,f", values, fmt="%.17e")
    table = open_delimited(tmp_path / "long.csv")
    tracemalloc.start()
    columns = table.read(table.names)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_array_equal(columns["c"].values, values[:, 2])
    assert peak < 3 * values.nbytes


# Text tables that are no tables: long lines, fields and heads, in time that grows with them.


ROWS = "1,2\n" * 600


@pytest.mark.parametrize(
    "head",
    [
        '"' + " (" * 60_000 + '",y\n',
        '"a' + " " * 120_000 + '[",y\n',
        '"' + "a[b" * 40_000 + ']",y\n',
        "1" * 120_000 + "x,y\n",
        "1:" * 60_000 + ",y\n",
        ("sample rate " * 90 + "\n") * 390 + "x,y\n",
        ("sampling interval" + " " * 900 + "-\n") * 390 + "x,y\n",
        ("sample time [[[(" * 70 + "\n") * 390 + "x,y\n",
    ],
)
def test_heads_take_time_by_their_length(head, tmp_path):
    """Regular expressions that go back took 49 s for the first, and minutes for the last."""
    path, started = table(tmp_path, head + ROWS), time.process_time()
    opened = open_table(path)
    assert opened.read([opened.names[0]])[opened.names[0]].values[0] == 1
    assert time.process_time() - started < 2


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("x [um]", ("x", "um")),
        ("x(mm/s)", ("x", "mm/s")),
        ("gap [left] [um]", ("gap [left]", "um")),
        ("x []", ("x", None)),
        ("x [-]", ("x", None)),
        ("pos (filtered)", ("pos (filtered)", None)),
        ("m/s^2", ("m/s^2", None)),
        ("x [seven]", ("x [seven]", None)),
        ("[um]", ("[um]", None)),
        ("x [um] raw", ("x [um] raw", None)),
        ("x [um)", ("x [um)", None)),
        ("]", ("]", None)),
        (f"x [{'m' * 65}]", (f"x [{'m' * 65}]", None)),
        ("iy[1]", ("iy", None)),
        (f"x [{'m*' * 31}mm]", ("x", "m*" * 31 + "mm")),
    ],
)
def test_names_with_units(name, found):
    dialect = find_dialect([f"{name},y", *["1,2"] * 4])
    assert (dialect.names[0], dialect.units[0]) == found


def test_rates_that_no_logger_has(tmp_path):
    for interval, kept in (("1e-320", False), ("1e-13", False), ("1e-11", True)):
        path = table(tmp_path, f"Delta_X {interval}\nx,y\n{ROWS}")
        assert (open_table(path).read(["x"])["x"].rate is not None) == kept


def test_long_lines(tmp_path):
    last = "1," + "2" + " " * (LINE_CHARACTERS - 5) + "\n"
    assert open_table(table(tmp_path, "x,y\n" + ROWS + last)).read(["y"])["y"].values[-1] == 2
    for more in ("1,2" + " " * 2 * LINE_CHARACTERS, "1," * LINE_CHARACTERS):
        with pytest.raises(ReadError, match="a line of more than 1048576 characters"):
            open_table(table(tmp_path, "x,y\n" + ROWS + more)).read(["x"])


def test_a_hole_in_the_file(tmp_path):
    """A file of which a terabyte was never written: the line that it makes is not read."""
    path = table(tmp_path, "x,y\n" + "1,2\n" * 20_000)
    with path.open("r+b") as stream:
        stream.truncate(10**12)
    with pytest.raises(ReadError, match="a line of more than"):
        open_table(path).read(["x"])


@pytest.mark.slow
def test_names_like_a_misspelt_one(tmp_path):
    """The nearest is told, in a time that names of any length and number bear."""
    with pytest.raises(ReadError, match="did you mean fx"):
        open_table(table(tmp_path, "fx,y\n" + ROWS)).find("fxx")
    for count, length in ((10_000, 90), (3, 100_000)):
        names = ",".join(f"{'ab' * (length // 2)}{i}" for i in range(count))
        rows = (",".join("1" * count) + "\n") * 3
        opened = open_table(table(tmp_path, names + "\n" + rows))
        started = time.process_time()
        with pytest.raises(ReadError, match="no column"):
            opened.find("ba" * (length // 2))
        assert time.process_time() - started < 3


@pytest.mark.parametrize("day", ["2024-99-45 12:00:00", "2024-02-30T12:00:00Z"])
def test_days_that_are_none(day, tmp_path):
    path = table(tmp_path, "t,y\n" + f"{day},2\n" * 20)
    with pytest.raises(ReadError, match=r"column t: found .* out of range"):
        open_table(path).read(["t"])


# Parquet, TDMS, MDF and MAT files that stand for far more numbers than their bytes can hold.


TOO_MANY = "bytes of numbers declared in .* bytes; expected numbers that the file holds"


def test_what_bytes_may_stand_for():
    for size, held in ((64_000_000, 1), (250_000_000, 1_000_000)):
        check_held(size, held, "run.h5")
        with pytest.raises(ReadError, match=TOO_MANY):
            check_held(size + 1, held, "run.h5")


@pytest.mark.slow
def test_parquet(tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    pa = pytest.importorskip("pyarrow")
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"x": np.zeros(8_000_001)}), path)
    with pytest.raises(ReadError, match=TOO_MANY):
        open_table(path).read(["x"])
    pq.write_table(pa.table({f"x{i}": np.zeros(500_000) for i in range(20)}), path)
    opened = open_table(path)
    with pytest.raises(ReadError, match=TOO_MANY):
        opened.read([f"x{i}" for i in range(20)])
    started = time.process_time()
    pq.write_table(pa.table({f"x{i}": [1.0, 2.0] for i in range(COLUMNS + 1)}), path)
    with pytest.raises(ReadError, match="found 10001 columns; expected 10000 at most"):
        open_table(path)
    assert time.process_time() - started < 5


def test_mdf(tmp_path):
    """A packed block says how large it is unpacked, and the reader would believe it."""
    asammdf = pytest.importorskip("asammdf")
    write_mdf(tmp_path / "run.mf4", {"x": (np.sin(np.arange(20_000) / 50), "um")})
    path = tmp_path / "packed.mf4"
    with asammdf.MDF(tmp_path / "run.mf4") as data:
        data.save(path, compression=2)
    whole = path.read_bytes()
    assert len(open_table(path).read(["0/x"])["0/x"].values) == 20_000
    place = whole.find(b"##DZ")
    damaged = bytearray(whole)
    for size in (64_000_001, 20_000_000_000, 1 << 62):
        struct.pack_into("<Q", damaged, place + 32, size)
        path.write_bytes(damaged)
        with pytest.raises(ReadError, match=r"ends the program that reads it|damaged MDF data"):
            open_table(path).read(["0/x"])


def test_many_names_take_time_by_their_number(tmp_path):
    def of(count: int, part: str = "c") -> Path:
        rows = [",".join(f"{part}{i}" for i in range(count)), *[",".join("1" * count)] * 3]
        (tmp_path / f"{part}.csv").write_text("\n".join(rows))
        return tmp_path / f"{part}.csv"

    started = time.process_time()
    assert len(open_tables([of(9000, "a"), of(9000, "b")]).names) == 18_000
    assert time.process_time() - started < 4
    assert len(open_table(of(COLUMNS)).names) == 10_000
    with pytest.raises(ReadError, match=r"c.csv: found 10001 columns; expected 10000"):
        open_table(of(COLUMNS + 1))
    assert is_value("1" * DIGITS)
    assert not is_value("1" * (DIGITS + 1))


def test_a_file_twice_by_other_names(tmp_path):
    WRITERS["run.csv"](tmp_path / "run.csv", {"x": (np.ones(4), "um")})
    (tmp_path / "link.csv").symlink_to("run.csv")
    with pytest.raises(ReadError, match="found a file twice"):
        open_tables([tmp_path / "run.csv", tmp_path / "link.csv"])
