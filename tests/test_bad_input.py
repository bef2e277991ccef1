"""Bad input: exit code 2, one line with file, place, found, expected and cure, nothing written."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from working_folder import make

import rotorid as rid
from rotorid import cli

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


@dataclass(frozen=True)
class Case:
    """Files of an experiment, one of them bad; and what its line must say: file, place, words."""

    file: str
    place: str | None
    message: str
    experiment: str = EXPERIMENT
    model: str = MODEL
    data: str | bytes = table(COLUMNS)
    name: str = "run.csv"

    def write(self, folder: Path) -> None:
        (folder / "experiment.toml").write_text(self.experiment.replace("run.csv", self.name))
        (folder / "model.toml").write_text(self.model)
        data = self.data.encode() if isinstance(self.data, str) else self.data
        (folder / self.name).write_bytes(data)


def told(old: str, new: str, place: str | None, message: str, **more: str) -> Case:
    """Return a case of another text in the experiment file."""
    more = {"file": "experiment.toml", **more}
    return Case(place=place, message=message, experiment=EXPERIMENT.replace(old, new), **more)


def model(old: str, new: str, place: str | None, message: str, file: str = "model.toml") -> Case:
    return Case(file, place, message, model=MODEL.replace(old, new))


def equation(text: str, message: str, place: str | None = "equation 1") -> Case:
    return model("m*x'' + c*x' = F", text, place, message)


def read(data: str | bytes, message: str, place: str = "", name: str = "run.csv") -> Case:
    return Case(name, place, message, data=data, name=name)


RUN = {"file": "run.csv"}
F, X, RATE = 'F = { column = "f", unit = "N" }', 'x = { column = "x", unit = "mm" }', '"100 Hz"'
GAP = table({name: np.delete(column, 77) for name, column in COLUMNS.items()})
HOLE = table({**COLUMNS, "f": np.where(TIME == 1.0, np.nan, COLUMNS["f"])})
ONE, SKIP = "harmonics = [1]", "harmonics = [1]\nskip = "
POSITIVE = MODEL.replace('unit = "kg"', 'unit = "kg", positive = true')
BELOW_ZERO = '[parameters]\nm = { fixed = "-1 kg" }\n\n[estimator]'
FIXED = 'sample_rate = "100 Hz"'
WORDY = "f,x\n1,2\n1,2\noverflow,2\n"
NEWER = b"MATLAB 7.3 MAT-file, by a newer MATLAB".ljust(600)
TERMS = " + ".join(f"{i}*x^{i}" for i in range(1, 9))

CASES = {
    # values without meaning
    "scale of zero": told(
        '"mm"', '"mm", scale = 0', "channels.x.scale", "0; expected a scale other than 0; only"
    ),
    "fixed mass below zero": replace(
        told("[estimator]", BELOW_ZERO, "parameters.m.fixed", "-1; expected more than 0"),
        model=POSITIVE,
    ),
    # unknown keys
    "key": told(
        "model =", 'colour = "red"\nmodel =', "colour",
        "the unknown key 'colour'.*one of model, records, modes, channels.*remove it",
    ),
    "misspelt key": told(
        "fundamental", "fundamentl", "records.0.fundamentl", "'fundamentl'.*did you mean fundament"
    ),
    "misspelt required key": told("model =", "modell =", "modell", "'modell'.*did you mean model"),
    "key of a channel": told("unit =", "units =", "channels.F.units", "'units'.*did you mean unit"),
    "key of a model": model("equations", "equation", "equation", "'equation'.*mean equations"),
    "key of a parameter of a model": model(
        'unit = "kg"', 'unit = "kg", nominl = 3', "parameters.m.nominl", "'nominl'.*mean nominal"
    ),
    # missing columns
    "column": told('"f"', '"force"', "channels.F.column", "no column 'force'; .* t, f, x", **RUN),
    "time column": told(FIXED, 'time = "time"', "time", "no column 'time'", **RUN),
    "channel": told(F, "", "", r"no channel of the input F;.*\[channels\]", **RUN),
    "hidden coordinate": told(X, "", "", "no sensor of any coord.*name a channel after it", **RUN),
    # units that do not convert
    "unit": told('"mm"', '"N"', "channels.x.unit", "unit 'N'; expected .* converts to m", **RUN),
    "no such unit": told('"mm"', '"mmm"', "channels.x.unit", "unknown name mmm", **RUN),
    "unit of a rate": told(
        "100 Hz", "100 N", "records.0.sample_rate", "unit 'N'; .* a unit that converts to Hz"
    ),
    "no unit": told(RATE, "100", "records.0.sample_rate", "'100' without a unit"),
    "unit of a model": model('"kg"', '"kgg"', "parameters.m.unit", "unknown name kgg"),
    # too few periods
    "one period": replace(
        told(
            ONE, SKIP + '"0.01 s"', "",
            "398 samples .*1 whole periods; expected at least two periods of 200 samples", **RUN,
        ),
        data=table({name: column[:399] for name, column in COLUMNS.items()}),
    ),
    "skip more than there is": told(ONE, SKIP + '"1 h"', "", "0 samples after skip", **RUN),
    "period of no whole samples": told(
        "0.5 Hz", "0.7 Hz", "records.0.fundamental", "a period of 142.857 samples"
    ),
    # samples
    "not a number": read(HOLE, "nan in sample 100 of channel 'F', 1 in all"),
    "dropped sample": replace(
        told('sample_rate = "100 Hz"', 'time = "t"', "time", "step of 0.02 s after sample 76"),
        data=GAP,
        **RUN,
    ),
    "a word among the numbers": read(WORDY, "'overflow'", "line 4, column f"),
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
    "a value": model('m = { unit = "kg" }', 'm = "kg"', "parameters.m", "'kg'; expected a table"),
    "division by zero on this record": model(
        "c*x'", "c*x'/t", "", "without a finite value on this record", "run.csv"
    ),
    # files that are not what their ending says
    "text as HDF5": read(table(COLUMNS), "text; .* as the ending .h5 says", name="run.h5"),
    "text as MAT": read(table(COLUMNS), "text; .* as the ending .mat says", name="run.mat"),
    "binary as text": read(bytes(999), "binary data; .* a text table"),
    "HDF5 as text": read(b"\x89HDF\r\n\x1a\n" * 9, "HDF5 data; .* text table"),
    "MAT 7.3": read(NEWER, "damaged HDF5 data", name="run.mat"),
    "no ending": read(table(COLUMNS), "text, no ending", name="run"),
    "no names": read(
        "1,2\n3,4\n", "no column 'f'; expected one of 0, 1; name columns by their number",
        "channels.F.column",
    ),
    "nothing in it": read(b"", "an empty file"),
    "experiment that is no text": told("model", "\x00\ud7ff", None, "no UTF-8|TOML"),
    "no TOML": told("[[records]]", "[[records]", "line 4, column 10", "expected TOML"),
    # sizes
    "a model of 50 MB": model("title", "#" * 50_000_000 + "\ntitle", "", "more than 1000 kB"),
    "an experiment of 50 MB": told(
        "model =", "#" * 50_000_000 + "\nmodel =", "", "more than 1000 kB"
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
    "TOML a thousand deep": told("[1]", f"{'[' * 5000}{']' * 5000}", "", "nesting too deep"),
    "a model a thousand deep": model(
        'equations = ["', f'deep = {"[" * 5000}{"]" * 5000}\nequations = ["', "",
        "nesting too deep",
    ),
    "an expansion of millions of terms": equation(f"m*x'' + c*({TERMS})^30 = F", "expected"),
    "a number of more than 400 digits": told("[1]", f"[{'9' * 10000}]", "", "more than 400 digits"),
    "a band without end": told(
        ONE, 'band = ["0 Hz", "1e11 Hz"]', "records.0.band",
        "the band 0 to 1e.11 Hz; expected 0 Hz to 50 Hz",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_one_line_and_nothing_written(case, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    case.write(tmp_path)
    before = sorted(tmp_path.iterdir())
    outputs = ["--json", "result.json", "--report", "report.html"]
    line = refusal("identify", "experiment.toml", *outputs)
    said = LINE.fullmatch(line)
    assert said is not None, line
    assert said["file"] == case.file, line
    if case.place is not None:
        assert (said["place"] or "") == case.place, line
    assert re.search(case.message, line), line
    assert sorted(tmp_path.iterdir()) == before


def test_the_good_files_are_good(tmp_path, output):
    """What the cases change is what is wrong with them."""
    Case("", "", "").write(tmp_path)
    output("identify", tmp_path / "experiment.toml", "--json", tmp_path / "result.json")
    assert (tmp_path / "result.json").exists()


# Data times a power of ten: the answer of the data, or a line that says what is wrong.


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    return identified(tmp_path_factory.mktemp("plain"), 1.0)


def identified(folder: Path, scale: float) -> rid.Estimate:
    make(folder, scale)
    result = str(folder / "run.json")
    assert cli.run(["identify", str(folder / "run.toml"), "--json", result, "-q"]) == 0
    return rid.load_estimate(result)


@pytest.mark.parametrize("power", [-30, 55])
def test_the_answer_stays(answer, tmp_path, power):
    """Masses and stiffnesses are ratios of what was scaled; what the unbalance does is scaled."""
    found = identified(tmp_path, 10.0**power)
    assert found.status == "ok"
    for one, other in zip(found.parameters, answer.parameters, strict=True):
        scale = 10.0**power if one.unit == "kg m" else 1.0
        assert one.value / scale == pytest.approx(other.value, rel=1e-9)
        assert one.std / scale == pytest.approx(other.std, rel=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("power", [-320, -162, -80, 80, 155, 300])
def test_what_no_machine_measures_is_one_line(tmp_path, capsys, power):
    make(tmp_path, 10.0**power)
    for command in ("identify", "inspect"):
        assert cli.run([command, str(tmp_path / "run.toml")]) in (0, 2)
        printed = capsys.readouterr()
        assert len(printed.err.splitlines()) <= 1
        if command == "identify":
            assert "check the unit and the scale" in printed.err
