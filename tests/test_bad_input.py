"""Bad input: exit code 2, one line with file, place, found, expected and cure, nothing written."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from rotorid.cli import run

MODEL = """
title = "a mass on a damper"
equations = ["m*x'' + c*x' = F"]
coordinates = { x = "m" }
inputs = { F = "N" }
parameters = { m = { unit = "kg" }, c = { unit = "N s/m" } }
"""
EXPERIMENT = """
model = "model.toml"

[[records]]
file = "run.csv"
sample_rate = "100 Hz"
fundamental = "0.5 Hz"
harmonics = [1]

[channels]
F = { column = "f", unit = "N" }
x = { column = "x", unit = "mm" }

[estimator]
method = "ls"
"""
TIME = np.arange(400) / 100.0
COLUMNS = {"t": TIME, "f": np.cos(np.pi * TIME), "x": np.sin(np.pi * TIME)}
LINE = re.compile(r"rotorid: (?P<file>[^:]*): (?:(?P<place>.+): )?found .+; expected .+; .+")


def table(columns: dict[str, np.ndarray]) -> str:
    rows = np.column_stack(list(columns.values()))
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows.tolist())])


class Case:
    """Files of an experiment, one of them bad; and what its line must say."""

    def __init__(
        self,
        message: str,
        *,
        file: str = "experiment.toml",
        place: str | None = "",
        experiment: tuple[str, str] = ("", ""),
        model: tuple[str, str] = ("", ""),
        data: str | bytes | None = None,
        name: str = "run.csv",
    ) -> None:
        self.message, self.file, self.place = message, file, place
        self.experiment = EXPERIMENT.replace(*experiment).replace("run.csv", name)
        self.model = MODEL.replace(*model)
        self.data, self.name = table(COLUMNS) if data is None else data, name

    def write(self, folder: Path) -> None:
        (folder / "experiment.toml").write_text(self.experiment)
        (folder / "model.toml").write_text(self.model)
        data = self.data.encode() if isinstance(self.data, str) else self.data
        (folder / self.name).write_bytes(data)


def equation(text: str, message: str, place: str = "equation 1") -> Case:
    return Case(message, file="model.toml", place=place, model=("m*x'' + c*x' = F", text))


def channel(old: str, new: str, place: str, message: str, file: str = "run.csv") -> Case:
    return Case(message, file=file, place=place, experiment=(old, new))


GAP = {name: np.delete(column, 77) for name, column in COLUMNS.items()}
HOLE = {**COLUMNS, "f": np.where(TIME == 1.0, np.nan, COLUMNS["f"])}

CASES = {
    # values without meaning
    "scale of zero": channel(
        'unit = "mm"',
        'unit = "mm", scale = 0',
        "channels.x.scale",
        "0; expected a finite scale other than 0",
        file="experiment.toml",
    ),
    "fixed mass below zero": Case(
        "-1; expected more than 0",
        place="parameters.m.fixed",
        experiment=("[estimator]", '[parameters]\nm = { fixed = "-1 kg" }\n\n[estimator]'),
        model=('unit = "kg"', 'unit = "kg", positive = true'),
    ),
    # unknown keys
    "key": Case(
        "the unknown key 'colour'.*one of model, records, modes, channels.*remove it",
        place="colour",
        experiment=("model =", 'colour = "red"\nmodel ='),
    ),
    "misspelt key": Case(
        "'fundamentl'.*did you mean fundamental",
        place="records.0.fundamentl",
        experiment=("fundamental", "fundamentl"),
    ),
    "misspelt required key": Case(
        "'modell'.*did you mean model", place="modell", experiment=("model =", "modell =")
    ),
    "key of a channel": Case(
        "'units'.*did you mean unit", place="channels.F.units", experiment=("unit =", "units =")
    ),
    "key of a model": Case(
        "'equation'.*did you mean equations",
        file="model.toml",
        place="equation",
        model=("equations", "equation"),
    ),
    "key of a parameter of a model": Case(
        "'nominl'.*did you mean nominal",
        file="model.toml",
        place="parameters.m.nominl",
        model=('unit = "kg"', 'unit = "kg", nominl = 3'),
    ),
    # missing columns
    "column": channel('"f"', '"force"', "channels.F.column", "no column 'force'; .* t, f, x"),
    "time column": Case(
        "no column 'time'",
        file="run.csv",
        place="time",
        experiment=('sample_rate = "100 Hz"', 'time = "time"'),
    ),
    "channel": Case(
        "no channel of the input F",
        file="run.csv",
        experiment=('F = { column = "f", unit = "N" }', ""),
    ),
    "hidden coordinate": Case(
        "no sensor of any coordinate.*name a channel after it",
        file="run.csv",
        experiment=('x = { column = "x", unit = "mm" }', ""),
    ),
    # units that do not convert
    "unit": channel('"mm"', '"N"', "channels.x.unit", "unit 'N'; expected .* converts to m"),
    "no such unit": channel('"mm"', '"mmm"', "channels.x.unit", "unknown name mmm"),
    "unit of a rate": Case(
        "unit 'N'; expected a unit that converts to Hz",
        place="records.0.sample_rate",
        experiment=("100 Hz", "100 N"),
    ),
    "no unit": Case(
        "'100' without a unit",
        place="records.0.sample_rate",
        experiment=('"100 Hz"', "100"),
    ),
    "unit of a model": Case(
        "unknown name kgg",
        file="model.toml",
        place="parameters.m.unit",
        model=('"kg"', '"kgg"'),
    ),
    # too few periods
    "one period": Case(
        "398 samples .*1 whole periods; expected at least two periods of 200 samples",
        file="run.csv",
        experiment=("harmonics = [1]", 'harmonics = [1]\nskip = "0.01 s"'),
        data=table({name: column[:399] for name, column in COLUMNS.items()}),
    ),
    "skip more than there is": Case(
        "0 samples after skip",
        file="run.csv",
        experiment=("harmonics = [1]", 'harmonics = [1]\nskip = "1 h"'),
    ),
    "period of no whole samples": Case(
        "a period of 142.857 samples",
        place="records.0.fundamental",
        experiment=("0.5 Hz", "0.7 Hz"),
    ),
    # samples
    "not a number": Case(
        "nan in sample 100 of channel 'F', 1 in all", file="run.csv", data=table(HOLE)
    ),
    "dropped sample": Case(
        "a step of 0.02 s after sample 76",
        file="run.csv",
        place="time",
        experiment=('sample_rate = "100 Hz"', 'time = "t"'),
        data=table(GAP),
    ),
    "a word among the numbers": Case(
        "'overflow'",
        file="run.csv",
        place="line 4, column f",
        data="f,x\n1,2\n1,2\noverflow,2\n",
    ),
    # models
    "not a polynomial": equation(
        "m*sin(c*x) + x'' = F", "sin of c.x, which holds c; expected a polynomial in the param"
    ),
    "a parameter as divisor": equation("x''/m + c*x' = F", "a division by m"),
    "a parameter as exponent": equation("m*x''^c = F", "the exponent c"),
    "an input squared": equation("m*x'' + c*x' = F^2", "F"),
    "unknown name": equation("m*x'' + d*x' = F", "the unknown name 'd'"),
    "unknown function": equation("m*x'' + c*sgn(x') = F", "'sgn'.*did you mean"),
    "division by zero": equation("m*x''/0 + c*x' = F", "a division by zero"),
    "division by what cancels": equation("m*x''/(2*x - x - x) + c*x' = F", "division by zero"),
    "no finite power": equation("m*x''*(c - c)^-1 = F", "of zero|by zero"),
    "no equation": equation("m*x'' + c*x'", "expected an equation", None),
    "two equations in one": equation("m*x'' = F = 0", "'='", "equation 1: column 11"),
    "code": equation("__import__('os').system('touch owned')", "unknown name '__import__'", None),
    "a value": Case(
        "found 'kg'; expected a table",
        file="model.toml",
        place="parameters.m",
        model=('m = { unit = "kg" }', 'm = "kg"'),
    ),
    "division by zero on this record": Case(
        "without a finite value on this record",
        file="run.csv",
        model=("c*x'", "c*x'/t"),
    ),
    # files that are not what their ending says
    "text as HDF5": Case("text; .* as the ending .h5 says", file="run.h5", name="run.h5"),
    "text as MAT": Case("text; .* as the ending .mat says", file="run.mat", name="run.mat"),
    "binary as text": Case("binary data; .* a text table", file="run.csv", data=bytes(999)),
    "HDF5 as text": Case("HDF5 data; .* text table", file="run.csv", data=b"\x89HDF\r\n\x1a\n" * 9),
    "MAT 7.3": Case(
        "damaged HDF5 data",
        file="run.mat",
        name="run.mat",
        data=b"MATLAB 7.3 MAT-file, by a newer MATLAB".ljust(600),
    ),
    "no ending": Case("text, no ending", file="run", name="run"),
    "no names": Case(
        "no column 'f'; expected one of 0, 1; name columns by their number",
        file="run.csv",
        place="channels.F.column",
        data="1,2\n3,4\n",
    ),
    "nothing in it": Case("an empty file", file="run.csv", data=b""),
    "experiment that is no text": Case(
        "no UTF-8|TOML", place=None, experiment=("model", "\x00\ud7ff")
    ),
    "no TOML": Case(
        "expected TOML", place="line 4, column 10", experiment=("[[records]]", "[[records]")
    ),
    # sizes
    "a model of 50 MB": Case(
        "more than 1000 kB", file="model.toml", model=("title", "#" * 50_000_000 + "\ntitle")
    ),
    "an experiment of 50 MB": Case(
        "more than 1000 kB", experiment=("model =", "#" * 50_000_000 + "\nmodel =")
    ),
    "parentheses a thousand deep": equation(
        f"m*x'' + c*{'(' * 1000}x'{')' * 1000} = F", "nesting deeper"
    ),
    "signs a thousand deep": equation(f"m*x'' + c*{'-' * 1000}x' = F", "nesting deeper"),
    "functions a thousand deep": equation(
        f"m*x'' + c*{'sin(' * 1000}x'{')' * 1000} = F", "nesting deeper"
    ),
    "powers a thousand deep": equation(f"m*x'' + c*x'{'^2' * 1000} = F", "nesting deeper|degree"),
    "a tower of powers": equation("m*x'' + c*9^9^9^9^9*x' = F", "the power"),
    "TOML a thousand deep": Case(
        "nesting too deep", experiment=("harmonics = [1]", f"harmonics = {'[' * 5000}{']' * 5000}")
    ),
    "a model a thousand deep": Case(
        "nesting too deep",
        file="model.toml",
        model=('equations = ["', f'deep = {"[" * 5000}{"]" * 5000}\nequations = ["'),
    ),
    "an expansion of millions of terms": equation(
        f"m*x'' + c*({' + '.join(f'{i}*x^{i}' for i in range(1, 9))})^30 = F", "expected"
    ),
    "a number of more than 400 digits": Case(
        "more than 400 digits", experiment=("[1]", f"[{'9' * 10000}]")
    ),
    "a band without end": Case(
        "the band 0 to 1e.11 Hz; expected 0 Hz to 50 Hz",
        place="records.0.band",
        experiment=("harmonics = [1]", 'band = ["0 Hz", "1e11 Hz"]'),
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_one_line_and_nothing_written(case, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    case.write(tmp_path)
    before = sorted(tmp_path.iterdir())
    outputs = ["--json", "result.json", "--report", "report.html"]
    assert run(["identify", "experiment.toml", *outputs]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert len(line) < 600
    said = LINE.fullmatch(line)
    assert said is not None, line
    assert said["file"] == case.file, line
    if case.place is not None:
        assert (said["place"] or "") == case.place, line
    assert re.search(case.message, line), line
    assert sorted(tmp_path.iterdir()) == before


def test_the_good_files_are_good(tmp_path):
    """What the cases change is what is wrong with them."""
    Case("").write(tmp_path)
    target = tmp_path / "result.json"
    assert run(["identify", str(tmp_path / "experiment.toml"), "--json", str(target)]) == 0
    assert target.exists()


@pytest.mark.parametrize("target", ["run.csv", "model.toml", "experiment.toml"])
@pytest.mark.parametrize("option", ["--json", "--report"])
def test_no_input_is_written_over(target, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Case("").write(tmp_path)
    before = (tmp_path / target).read_bytes()
    assert run(["identify", "experiment.toml", option, target]) == 2
    page = option == "--report"  # which no input is
    assert ("a page: .html" if page else "did not write") in capsys.readouterr().err
    assert run(["identify", "experiment.toml", option, target, "--force"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    found = "a report of the ending" if page else "an input of this run"
    assert line.startswith(f"rotorid: {target}: found {found}")
    assert (tmp_path / target).read_bytes() == before


def test_two_outputs_need_two_files(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Case("").write(tmp_path)
    assert run(["identify", "experiment.toml", "--json", "a", "--report", "./a"]) == 2
    assert "another output of this run" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_damaged_hdf5(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with h5py.File(tmp_path / "run.h5", "w") as data:
        for name, column in COLUMNS.items():
            data[name] = column
    whole = (tmp_path / "run.h5").read_bytes()
    case = Case("", name="run.h5", data=whole[: len(whole) // 2])
    case.write(tmp_path)
    assert run(["identify", "experiment.toml"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert LINE.fullmatch(line)
    assert "run.h5: found damaged HDF5 data" in line


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no JSON"),
        ("[]", r"found \[\]; expected"),
        ('{"schema": "rotorid-estimate/9"}', "schema 'rotorid-estimate/9'"),
        ('{"schema": "rotorid-estimate/1"}', "model: found no such key"),
        ("[" * 100_000, "no JSON"),
    ],
)
def test_results_that_are_none(content, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Case("").write(tmp_path)
    (tmp_path / "result.json").write_text(content)
    assert run(["validate", "result.json", "experiment.toml"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert LINE.fullmatch(line)
    assert line.startswith("rotorid: result.json: ")
    assert re.search(message, line)


def test_a_result_of_another_model(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Case("").write(tmp_path)
    assert run(["identify", "experiment.toml", "--json", "result.json"]) == 0
    (tmp_path / "model.toml").write_text(MODEL.replace("c*x'", "k*x").replace("c =", "k ="))
    capsys.readouterr()
    assert run(["validate", "result.json", "experiment.toml"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert LINE.fullmatch(line), line
