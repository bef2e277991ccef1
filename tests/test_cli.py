"""The command line as its users meet it: output, files, exit codes."""

import hashlib
import io
import json
import re
import sys
import time
from pathlib import Path

import pytest
from model_text import model_text
from working_folder import EXPERIMENT, write_record

import rotorid as rid
import rotorid.commands.identify
from rotorid import Value, cli, commands
from rotorid.answer.parts import SourceFile
from rotorid.commands.console import show, source_of
from rotorid.core.tables import table


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a noisy record and its experiment file."""
    write_record(tmp_path)
    (tmp_path / "run.toml").write_text(EXPERIMENT)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_identify(folder, output):
    printed = output("identify", "run.toml", "--method", "batch", "--json", "run.json")
    assert printed.startswith("jeffcott, batch: ok\n")
    data = json.loads((folder / "run.json").read_text())
    assert data["schema"] == "rotorid-estimate/2"
    assert [row["name"] for row in data["parameters"]] == ["m", "m*xi", "m*zeta", "c", "k"]
    assert len(data["covariance"]) == 5
    assert set(data["prediction"]) == {"F_x", "F_y"}
    estimate = rid.load_estimate("run.json")
    assert estimate.value("k") == pytest.approx(1e6, rel=1e-3)
    for name in ("m*xi", "kg m", "N s/m", "std %", "20 periods, 4 lines from 10 to 50 Hz"):
        assert name in printed
    assert str(estimate).splitlines() == [line.rstrip() for line in printed.splitlines()]


def test_maximum_likelihood_is_the_default(folder, output):
    """Where the model is linear; few periods are said, and nothing stands in for it."""
    out = output("identify", "run.toml", "--json", "run.json")
    assert out.startswith("jeffcott, ml: ok under assumptions (bow: 1 um would shift xi by ")
    data = json.loads((folder / "run.json").read_text())
    assert [row["name"] for row in data["parameters"]] == ["m", "c", "k", "xi", "zeta"]
    assert data["misfit"]["dof"] == 2 * 4 * 2 - 5
    assert data["suspects"] == []
    shown = [line.rstrip() for line in out.splitlines()]
    assert str(rid.load_estimate("run.json")).splitlines() == shown
    samples = (folder / "run.csv").read_text().splitlines()
    (folder / "run.csv").write_text("\n".join(samples[: 1 + 4 * 200]) + "\n")
    out = output("identify", "run.toml")
    assert out.startswith("jeffcott, ml: ok under assumptions (bow: 1 um would shift xi by ")
    assert "too few periods" in out


def test_method_overrides_the_file(folder, output):
    (folder / "run.toml").write_text(EXPERIMENT + '[estimator]\nmethod = "sequential"\n')
    for options, method in (([], "sequential"), (["--method", "ls"], "ls")):
        assert f"jeffcott, {method}: ok" in output("identify", "run.toml", *options)


def test_validate(folder, output, refusal):
    output("identify", "run.toml", "--json", "run.json")
    entry = EXPERIMENT[EXPERIMENT.index("[[records]]") : EXPERIMENT.index("[chan")]
    halves = entry + 'until = "1 s"\n' + entry + 'skip = "1 s"\n'
    (folder / "both.toml").write_text(EXPERIMENT.replace(entry, halves))
    validate = ("validate", "run.json", "run.toml")
    one = output(*validate, "--json", "validation.json", "--report", "validation.html")
    data = json.loads((folder / "validation.json").read_text())
    assert data["verdict"] == "predicts"
    assert [row["name"] for row in data["channels"]] == ["F_x", "F_y"]
    keys = {"record", "name", "relative_error", "noise", "p_value", "deviations"}
    assert {*data["channels"][0]} == keys
    stated = rid.load_estimate("run.json").prediction
    for row in data["channels"]:
        assert row["relative_error"] == pytest.approx(stated[row["name"]].relative_error)
    page = (folder / "validation.html").read_text()
    assert "The result predicts the record within its deviations and the noise" in page
    first = [line.split()[0] for line in one.splitlines() if line]
    assert first == ["predicts:", "channel", "F_x", "F_y", "note:", "note:"]
    assert "note: the result is ok under assumptions (bow: 1 um would shift xi by " in one
    assert "run.csv is a record that the result was made of, which proves little" in one
    with (folder / "run.csv").open("a") as stream:
        stream.write("\n")
    assert output(*validate).count("note:") == 1
    assert "the result predicts the record within its deviations and the noise" in one
    both = [line for line in output("validate", "run.json", "both.toml").splitlines() if line][2:-1]
    names = [f"{name}, record {k}" for k in (1, 2) for name in ("F_x", "F_y")]
    assert [line.partition("  ")[0] for line in both] == names
    assert all(line.endswith("predicted") for line in both)
    wrong = json.loads((folder / "run.json").read_text())
    for value in wrong["parameters"]:
        value["value"] *= 3.0
    (folder / "wrong.json").write_text(json.dumps(wrong))
    told = output("validate", "wrong.json", "run.toml", "--json", "wrong_too.json", code=1)
    assert "fails: the result does not predict the record: F_" in told
    assert "Hold the two experiment files side by side" in told
    assert json.loads((folder / "wrong_too.json").read_text())["verdict"] == "fails"
    # A factor that the search did not find is as missing as a parameter.
    lost = {"name": "gain[F_x]", "unit": "1", "value": None, "std": None}
    wrong["nuisance"] = [{**wrong["parameters"][0], **lost}]
    wrong["covariance"] = [*([*row, None] for row in wrong["covariance"]), [None] * 6]
    (folder / "lost.json").write_text(json.dumps({**wrong, "status": "not_converged"}))
    told = refusal("validate", "lost.json", "run.toml")
    assert "a result that leaves gain[F_x] undetermined; expected a value of every" in told


def test_another_part_of_the_same_file_is_another_record(folder, output):
    first, *others = (folder / f"{name}.toml" for name in ("first", "apart", "overlapping"))
    for path, part in ((first, "until"), *zip(others, ("skip", "until"), strict=True)):
        path.write_text(EXPERIMENT.replace("[channels]", f'{part} = "1 s"\n[channels]'))
    output("identify", first, "--json", "run.json")
    told = [output("validate", "run.json", other) for other in others]
    assert ["which proves little" in one for one in told] == [False, True]


def test_a_result_of_another_model(folder, output, refusal):
    """Its parameters may have the same names, and its equations be others."""
    output("identify", "run.toml", "--json", "run.json")
    (folder / "other.toml").write_text(rid.load_model("jeffcott").file_text)
    (folder / "other_run.toml").write_text(EXPERIMENT.replace('"jeffcott"', '"other.toml"'))
    told = refusal("validate", "run.json", "other_run.toml")
    assert "run.json: found a result of the model 'jeffcott'; expected one of 'other'" in told


def test_three_mass_in_words(output):
    listed = output("models").splitlines()
    assert [line.split()[0] for line in listed[1:]] == list(rid.shipped_models())
    printed = output("models", "three-mass")
    model = rid.load_model("three-mass")
    for text in (*model.texts, *model.base.names, *model.parameter_names, "kg m^2"):
        assert text in printed
    assert "3: -k1 x1 + k1 x2 - k1*L1 theta_y + k2 x2 - k2 x3 + k2*L2 theta_y" in printed
    assert "5: I_p theta_y" in printed
    assert "D q': zero" in printed
    assert "3: m2*xi*Omega^2*cos(phi) - m2*zeta*Omega^2*sin(phi)" in printed


def test_a_model_file(folder, output):
    equation = "m*q'' + mu*sign(q') = F"
    text = model_text("friction", [equation], "q mm", "F N", "m 1 g, mu N")
    (folder / "mine.toml").write_text(text)
    printed = output("models", "mine.toml")
    assert "mine: friction" in printed
    assert [line.split() for line in printed.splitlines() if line.startswith("m ")] == [
        ["m", "kg", "0.001"],  # inside, everything is SI
        ["m", "kg"],
    ]
    assert "not linear in the coordinates" in printed


def test_demo(tmp_path, output):
    target, machine = tmp_path / "demo.json", tmp_path / "machine.html"
    printed = output("demo", "--runs", "2", "--json", target, "--machine", machine)
    head = printed.partition("Table 1")[0]
    assert head.index("A levitated rotor from its bearings") < head.index("Root mean square")
    rows = [line.split() for line in head.splitlines()]
    errors = {row[0]: float(row[4]) for row in rows if len(row) > 5 and row[4][0] in "+-"}
    assert {"m1", "I_p", "k1", "ki[F_x1]", "ks"} <= set(errors)
    assert max(map(abs, errors.values())) < 4
    sizes = head.partition("Root mean square")[2].splitlines()
    table = [line for line in sizes if line.startswith(("parameter", "m1", "I_t*eta"))]
    assert all(len(line) <= 80 for line in table)  # bound and ml are seen at every width
    assert table[0].split()[:3] == ["parameter", "bound", "ml"]
    assert "rotorid " in machine.read_text(encoding="utf-8")
    for text in ("Table 1", "batch-100", "k1*L1^2 + k2*L2^2", "0.120", "bias", "ml", "bound"):
        assert text in printed
    data = json.loads(target.read_text())
    assert set(data) == {"runs", "noise", "estimators", "bound", "written"}
    row = data["estimators"]["ls"]["I_t*mu - I_p*mu"]
    assert set(row) == {"bias_percent", "rms_percent", "median_abs_percent"}


@pytest.mark.parametrize(
    ("status", "options", "code"),
    [
        ("ok", [], 0),
        ("ok", ["--strict"], 0),
        ("rejected", [], 3),
        ("rejected", ["--strict"], 3),
        ("not_identifiable", [], 1),
        ("not_converged", [], 1),
    ],
)
def test_exit_codes_and_results(folder, monkeypatch, status, options, code):
    """The result is written with its status, whatever it is."""
    estimate = rid.Estimate("jeffcott", "ls", status, (Value("m", "kg", 1.0, 0.1),))
    monkeypatch.setattr(commands.identify, "identify", lambda *_: estimate)
    assert cli.run(["identify", "run.toml", "--json", "run.json", *options]) == code
    assert rid.load_estimate("run.json").status == status


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["identfy"],
        ["identify"],
        ["identify", "run.toml", "--methd", "ls"],
        ["identify", "run.toml", "--method", "mle"],
        ["identify", "run.toml", "more"],
        ["identify", "none.toml"],
        ["identify", "run.toml", "--json"],
        ["identify", "run.toml", "--json", "none/run.json"],
        ["identify", "run.toml", "--report", "."],
        ["validate", "run.toml"],
        ["validate", "run.toml", "run.toml"],
        ["validate", "none.json", "run.toml"],
        ["models", "jeffcot"],
        ["models", "none.toml"],
        ["demo", "--runs", "many"],
        ["demo", "--runs", "0"],
        ["--frob"],
    ],
)
def test_wrong_usage_is_one_line(folder, refusal, arguments):
    before = sorted(folder.iterdir())
    refusal(*arguments)
    assert sorted(folder.iterdir()) == before


def test_help_and_version(output):
    for arguments in (["--help"], ["identify", "-h"]):
        assert output(*arguments)
    assert rid.__version__ in output("--version")


@pytest.mark.parametrize("command", sorted(cli.cli.commands))
def test_every_command_helps_with_an_example(command, output):
    assert f"Example:\n    rotorid {command}" in output(command, "--help")


def test_json_to_the_standard_output(folder, output):
    """Nothing else is there; files that are asked for besides are written."""
    options = ["--method", "batch", "--json", "-", "--report", "run.html"]
    found = json.loads(output("identify", "run.toml", *options))
    assert found["status"] == "ok"
    assert found["provenance"]["files"]
    assert Path("run.html").exists()
    assert not Path("-").exists()
    assert json.loads(output("inspect", "run.toml", "--json", "-"))["verdict"] in ("ok", "note")


def test_quiet(folder, output, refusal):
    for arguments in (["identify", "run.toml", "-q"], ["inspect", "run.toml", "--quiet"]):
        assert output(*arguments) == ""
    assert "none.toml" in refusal("identify", "none.toml", "-q")  # what stops the work is said


def test_intervals(folder, output):
    assert "95 % from" in output("identify", "run.toml", "--intervals")


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("rotorid models t", "plain,three-mass"),
        ("rotorid simulate r", "plain,rigid"),
        ("rotorid simulate mine", "file,mine"),
        ("rotorid new --model j", "plain,jeffcott"),
        ("rotorid identify ru", "file,ru"),
        ("rotorid ex", "plain,export"),
    ],
)
def test_completion(words, offered, monkeypatch, capsys):
    monkeypatch.setenv("_ROTORID_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    with pytest.raises(SystemExit, match="0"):
        cli.cli.main(prog_name="rotorid")
    assert offered in capsys.readouterr().out.splitlines()


def test_debug_shows_the_traceback(folder):
    for arguments in (["identify", "none.toml", "--debug"], ["--debug", "identify", "none.toml"]):
        with pytest.raises(rid.InputError, match=r"none\.toml"):
            cli.run(arguments)


def test_a_result_says_where_it_comes_from(folder, output):
    output("identify", "run.toml", "--method", "ls", "--json", "run.json")
    found = rid.load_estimate("run.json").provenance
    assert found.command == "rotorid identify run.toml --method ls --json run.json"
    assert found.experiment == EXPERIMENT
    assert found.version == rid.__version__
    sums = {source.file: source.sha256 for source in found.files}
    assert sums == {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
        for name in ("run.toml", "run.csv")
    }


def test_what_a_record_is_read_with_is_an_input(folder, refusal):
    """The record that tells the noise, and tables of amplifiers: written over by nobody."""
    (folder / "quiet.csv").write_text((folder / "run.csv").read_text())
    rows = "".join(f"{f},1,{-f / 10}\n" for f in range(0, 999, 9))
    table = f"frequency,magnitude,phase [deg]\n{rows}"
    for name in ("force.csv", "sensor.csv"):
        (folder / name).write_text(table)
    text = EXPERIMENT.replace('unit = "N" }', 'unit = "N", dynamics = { table = "force.csv" } }', 1)
    text = text.replace('unit = "m" }', 'unit = "m", dynamics = { table = "sensor.csv" } }', 1)
    text = re.sub(r"fundamental = .*\n(harmonics = .*\n)?", 'band = ["5 Hz", "90 Hz"]\n', text)
    text = text.replace('file = "run.csv"', 'file = "run.csv"\nquiet = "quiet.csv"')
    (folder / "own.toml").write_text(rid.load_model("jeffcott").file_text)
    (folder / "all.toml").write_text(text.replace('"jeffcott"', '"own.toml"'))
    plan = rid.load_experiment("all.toml")
    named = {path.name for path in plan.files}
    assert {"own.toml", "run.csv", "quiet.csv", "force.csv", "sensor.csv"} <= named
    assert [path.name for path in plan.record_files] == ["run.csv"]
    kept = (folder / "quiet.csv").read_bytes()
    refusal("identify", "all.toml", "--json", "quiet.csv", "--force")
    assert (folder / "quiet.csv").read_bytes() == kept


def test_files_beyond_measure_are_not_hashed(tmp_path, monkeypatch):
    path = tmp_path / "run.h5"
    path.write_bytes(b"small")
    assert source_of(path).sha256 == hashlib.sha256(b"small").hexdigest()
    with path.open("r+b") as stream:
        stream.truncate(10**12)
    started = time.process_time()
    assert source_of(path).sha256 == ""
    assert time.process_time() - started < 1
    path.write_bytes(bytes(range(256)) * 100_000)
    assert source_of(path).sha256 != ""
    monkeypatch.setattr("rotorid.commands.console.HASHED_BYTES", path.stat().st_size - 1)
    assert source_of(path).sha256 == ""


def test_the_report_again(folder, output):
    """The same page from the result alone, its data files gone."""
    options = ["--method", "batch", "--json", "run.json", "--report", "first.HTM"]
    output("identify", "run.toml", *options)
    for name in ("run.csv", "run.toml"):
        (folder / name).unlink()
    assert output("report", "run.json") == "report: run.html\n"
    assert (folder / "run.html").read_bytes() == (folder / "first.HTM").read_bytes()
    html = (folder / "run.html").read_text()
    for text in ("Residual over time", "Correlation of the parameters", "Accepted"):
        assert text in html


def test_the_report_of_a_result_made_in_python(folder, output):
    rid.Estimate("jeffcott", "ls", "ok", (Value("m", "kg", 1.0, 0.1),)).save("bare.json")
    assert "holds no evidence of its records" in output("report", "bare.json")
    assert "holds no evidence of its records" in (folder / "bare.html").read_text()


@pytest.mark.parametrize("ending", [".pdf", ".HTMLX"])
def test_a_report_is_a_page(folder, refusal, ending):
    for command in (["identify", "run.toml"], ["inspect", "run.toml"], ["demo", "--runs", "1"]):
        told = refusal(*command, "--report", f"a{ending}")
        assert f"a.{ending[1:]}: found a report of the ending {ending}; expected a page" in told
        assert "write a.html; a browser prints it to PDF" in told
    assert not (folder / f"a{ending}").exists()


def test_what_fails_for_a_report_takes_no_answer_with_it(folder, monkeypatch, output):
    from rotorid.results import evidence

    def broken(*_: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(evidence, "with_evidence", broken)
    told = output("identify", "run.toml", "--method", "ls", "--json", "run.json")
    assert "kept for a report: ZeroDivisionError: by nothing" in told
    assert rid.load_estimate("run.json").status == "ok"


def test_export(folder, output):
    output("identify", "run.toml", "--method", "batch", "--json", "run.json")
    for ending in (".csv", ".mat", ".tex", ".CSV"):
        told = output("export", "run.json", "--to", f"out{ending}")
        assert told.startswith(f"out{ending}: 5 parameters, 0 nuisance")
        assert ("state space of 4 states" in told) == (ending == ".mat")
        assert (folder / f"out{ending}").stat().st_size > 100


def test_outputs_never_replace_inputs(folder, output, refusal):
    output("identify", "run.toml", "--method", "ls", "--json", "run.json")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    for arguments in (
        ["export", "run.json", "--to", "run.xlsx"],
        ["export", "run.json", "--to", "run"],
        ["export", "run.json", "--to", "run.json"],
        ["export", "run.json"],
        ["report", "run.json", "--out", "run.csv"],
        ["report", "run.json", "--out", "run.json"],
        ["report", "run.toml"],
        ["validate", "run.json", "run.toml", "--json", "run.json"],
    ):
        refusal(*arguments)
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    "arguments",
    [
        ["new", "run.csv", "--out", "run.csv"],
        ["new", "run.csv", "--model", "jeffcott", "--out", "link.csv"],
        ["inspect", "run.toml", "--json", "run.csv"],
        ["inspect", "run.toml", "--json", "run.toml"],
        ["inspect", "draft.toml", "--json", "run.csv"],
        ["identify", "run.toml", "--json", "run.csv"],
    ],
)
def test_not_even_force_replaces_what_is_read(folder, refusal, arguments):
    (folder / "draft.toml").write_text('model = "?"\n[[records]]\nfile = "run.csv"\n')
    (folder / "link.csv").symlink_to("run.csv")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert "--force" in refusal(*arguments)
    assert "found an input of this run" in refusal(*arguments, "--force")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("file", ["/dev/zero", ".", "none.toml", "a\0b", "x" * 5000])
def test_a_report_reads_nothing_that_is_no_file(folder, file, output):
    source = rid.Provenance((SourceFile(file, "00"),), "", "0.1", "")
    found = rid.Estimate("jeffcott", "ls", "ok", (Value("m", "kg", 1.0, 0.1),), provenance=source)
    found.save("odd.json")
    output("report", "odd.json")
    assert "sha256 00" in (folder / "odd.html").read_text()


@pytest.mark.parametrize(("said", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)])
@pytest.mark.parametrize("width", [80, 120, 200])
def test_a_terminal_is_filled_and_coloured_if_it_may_be(monkeypatch, said, coloured, width):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("COLUMNS", str(width))
    for name, value in said.items():
        monkeypatch.setenv(name, value)
    shown = io.StringIO()
    monkeypatch.setattr(shown, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdout", shown)
    sentence = "warning: " + "a word and " * 40
    show(["three-mass, ml: rejected", sentence, table(("name", *"abcdef"), [("x" * 15,) * 7])])
    text = shown.getvalue()
    assert ("\x1b[33m" in text) is coloured
    plain = re.sub(r"\x1b\[\d+m", "", text)
    assert ("\x1b" in plain) is False
    assert width - 20 < max(map(len, plain.splitlines())) <= width
