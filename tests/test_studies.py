"""Studies: many identifications as one job, the same whatever the workers and interruptions."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from threading import Timer

import numpy as np
import pytest

import rotorid as rid
from rotorid import cli
from rotorid.core.watch import watched
from rotorid.studies.fleet import ALARM, FleetResult, fleet_parameter
from rotorid.studies.plan import load_study
from rotorid.studies.run import Processes
from rotorid.studies.store import PART, Store, held, read_rows

pytest.importorskip("pyarrow", reason="no package that keeps the rows of a study")
STUDY = """
rig = "three-mass"
cases = 6
seed = 3
timeout = "100 s"
[vary]
duration = "0.5 s"
settling = "0.2 s"
parameters.m1 = { spread = "5 %" }
rotation.phase = { from = "-180 deg", to = "3 rad" }
experiment.estimator.method = "batch"
[[variants]]
label = "plain"
[[variants]]
label = "too fast"
rotation.speed = "1e9 rpm"
"""


def write(folder: Path, text: str = STUDY) -> Path:
    (folder / "study.toml").write_text(text)
    return folder / "study.toml"


def frame(folder: Path):
    """Return the rows without what no two runs have in common."""
    return read_rows(folder).drop(["seconds"])


def command(study: Path, out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "rotorid", "study", str(study), "--out", str(out), *more]


def test_a_study_holds_a_row_per_case_and_what_failed(tmp_path, output):
    study, out = write(tmp_path), tmp_path / "results"
    shown = output("study", study, "--out", out, "--workers", "1")
    assert "3 ok, 3 failed" in shown
    assert "unstable loop" in shown
    rows = read_rows(out)
    first = ["case", "point", "seed", "status", "verdict", "p_value", "seconds", "error"]
    assert rows.column_names[:8] == first
    found = rows.to_pylist()
    assert [row["case"] for row in found] == list(range(6))
    assert [row["status"] for row in found] == ["ok", "failed"] * 3
    assert found[0]["m1_true"] == found[0]["vary.parameters.m1"] == pytest.approx(0.833, rel=0.2)
    for row in found[::2]:
        inside = abs(row["m1"] - row["m1_true"]) < 1.96 * row["m1_std"]
        assert row["m1_covered"] == inside
        assert row["k1*L1"] == pytest.approx(row["k1*L1_true"], rel=0.2)
    told = json.loads((out / "summary.json").read_text())
    plain, fast = told["groups"]
    assert (plain["label"], plain["statuses"], fast["accuracy"]) == ("plain", {"ok": 3}, [])
    errors = np.array([row["m1"] - row["m1_true"] for row in found[::2]])
    m1 = next(part for part in plain["accuracy"] if part["name"] == "m1")
    assert m1["bias"] == pytest.approx(errors.mean())
    assert m1["rms"] == pytest.approx(np.sqrt((errors**2).mean()))
    low, high = m1["interval"]
    assert 0 <= low < m1["cover"] <= high <= 1
    # The worst case is ready to be identified, and gives what its row says.
    worst = Path(told["worst"][0])
    again, row = rid.load_experiment(worst).identify(), found[int(worst.parent.name[5:])]
    assert again.value("m1") == row["m1"]
    assert "Parameters: plain" in (out / "summary.html").read_text()
    assert output("study", study, "--out", out, "--summary") == shown


def test_noise_on_lines_is_a_case_of_its_number_alone(tmp_path, refusal):
    text = STUDY.replace("seed = 3", 'seed = 3\nnoise = "lines"').replace(
        'experiment.estimator.method = "batch"', 'experiment.estimator.effort = "quick"'
    )
    told = refusal("study", write(tmp_path, text), "--out", tmp_path / "o")
    assert "833333 revolutions in a period" in told
    assert 'write noise = "samples"' in told
    plan = load_study(write(tmp_path, text.partition("[[")[0]))
    first, second, again = (plan.case(number).run() | {"seconds": 0} for number in (0, 1, 0))
    assert first == again
    assert (first["status"], second["status"]) == ("ok", "ok")
    assert first["m1"] != second["m1"]
    assert abs(first["m1"] - first["m1_true"]) < 5 * first["m1_std"]
    told = replace(plan.case(0), changes=[(["estimator", "method"], "batch")]).run()["error"]
    assert "not one record of periods for ml" in told
    told = replace(plan.case(0), changes=[(["records", "0", "until"], "0.4 s")]).run()["error"]
    assert "found a record that until or mask cuts" in told


@pytest.mark.parametrize("name", ["error", "m_std"])
def test_a_parameter_named_as_a_column_is_refused(name, tmp_path):
    model = """
        title = "a mass on a spring"
        equations = ["m*x'' + NAME*x = F"]
        coordinates = { x = "m" }
        inputs = { F = "N" }
        parameters = { m = { unit = "kg", nominal = 1 }, NAME = { unit = "N/m", nominal = 2 } }
    """
    (tmp_path / "mass.toml").write_text(model.replace("NAME", name))
    t = np.arange(400) / 100
    slow, fast = np.cos(np.pi * np.outer([1, 3], t))
    force = (2 - np.pi**2) * slow + (2 - 9 * np.pi**2) * fast
    samples = np.column_stack([force, slow + fast])
    text = "\n".join(["F,x", *(f"{force!r},{x!r}" for force, x in samples.tolist())])
    (tmp_path / "run.csv").write_text(text)
    (tmp_path / "run.toml").write_text("""
        model = "mass.toml"
        channels = { F = { column = "F", unit = "N" }, x = { column = "x", unit = "m" } }
        estimator.method = "ls"
        [[records]]
        file = "run.csv"
        sample_rate = "100 Hz"
        fundamental = "0.5 Hz"
        harmonics = [1, 3]
    """)
    study = write(tmp_path, 'experiments = ["run.toml"]')
    assert f"a parameter with the column {name}" in load_study(study).case(0).run()["error"]


def row(case: int) -> dict[str, object]:
    """Return a row; that of one case has a column more."""
    said = {"case": case, "verdict": "ok", "seconds": 0.0, "error": None, "m": case / 3}
    return {**said, "late": 1.0} if case == PART + 2 else said


def test_what_is_kept_is_kept_wherever_the_journal_is_cut(tmp_path):
    """Rows come in any order; a part is written with its last; the rest is read again."""
    order, files = np.random.default_rng(1).permutation(PART + 5).tolist(), []
    for cut in (0, 1, PART // 2, PART + 4):
        folder = tmp_path / str(cut)
        store = Store(folder, "it", resume=False, timeout=1.0)
        for case in order[:cut]:
            store.add(row(case))
        with (folder / "journal.jsonl").open("a") as journal:
            journal.write(json.dumps(row(order[cut]))[: 7 * cut])  # killed while it was written
        store = Store(folder, "it", resume=True, timeout=1.0)
        assert [case for case in order if case in store] == order[:cut]
        for case in order[cut:]:
            store.add(row(case))
        assert len(store) == PART + 5
        store.close()
        files.append([path.read_bytes() for path in sorted(folder.rglob("part-*"))])
    assert read_rows(folder).to_pylist() == [
        {**row(c), "late": row(c).get("late")} for c in sorted(order)
    ]
    assert files == [files[0]] * 4


def test_cases_follow_from_their_numbers_and_are_made_when_asked_for(tmp_path):
    text = STUDY.replace("cases = 6", "cases = 1_000_000_000").replace(
        '"0.5 s"', '["0.5 s", "2 s"]'
    )
    plan = load_study(write(tmp_path, text))
    assert (len(plan), plan.points) == (10**9, 4)
    assert [plan.label(k) for k in range(4)] == [
        *("plain, duration = 0.5 s", "plain, duration = 2 s"),
        *("too fast, duration = 0.5 s", "too fast, duration = 2 s"),
    ]
    last = plan.case(10**9 - 1)
    assert (last.point, last.settings["vary.duration"]) == (3, 2.0)
    assert last == load_study(tmp_path / "study.toml").case(10**9 - 1)
    cases = [plan.case(k) for k in range(200)]
    assert len({case.seed for case in cases}) == 200
    phases = np.array([case.settings["vary.rotation.phase"] for case in cases])
    assert -np.pi < phases.min() < -2.8 < 2.7 < phases.max() < 3.0
    masses = np.array([case.settings["vary.parameters.m1"] for case in cases]) / 0.83339
    assert masses.std() == pytest.approx(0.05, rel=0.2)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('rig = "three-mass"', "", "found no source of records"),
        ('rig = "three-mass"', 'noise = "lines"\nexperiments = ["f"]', "of measured records"),
        ('rig = "three-mass"', 'experiments = ["fleet/*.toml"]', "no file 'fleet/*.toml'"),
        ('estimator.method = "batch"', 'serial = " "', "experiment.serial: found"),
        ("duration", "durration", "unknown key 'durration'"),
        ('spread = "5 %"', 'from = "1 kg", to = "1 m"', "vary.parameters.m1: found unit 'm'"),
        ('spread = "5 %"', 'spread = "-5 %"', "found a spread of -5 %; expected 0 to 100 %"),
        ('estimator.method = "batch"', "date = 20260301", "year, month and day as in 2026-03-01"),
        ("parameters.m1", "parameters.m9", "vary.parameters.m9: found no m9 there"),
        ("cases = 6", "cases = 0", "cases: found 0"),
        ('"0.5 s"', "[]", "vary.duration: found an empty grid"),
        (
            '"0.5 s"',
            "2026-01-01",
            "vary.duration: found datetime.date(2026, 1, 1); expected a number",
        ),
        ('to = "3 rad"', 'to = "-4 rad"', "expected a range; write the lower limit in from"),
        ("[vary]", '[vary]\nfaults = [["backwards"], []]', "found the fault 'backwards'"),
        ("estimator.method", "estimator.metod", "did you mean method?"),
        (
            'estimator.method = "batch"',
            'parameters.m22.start = "8 kg"',
            "study.toml: experiment.parameters.m22: found 'm22', which is no parameter",
        ),
    ],
)
def test_what_cannot_be_studied_is_told_before_anything_runs(old, new, told, tmp_path, refusal):
    assert told in refusal(
        "study", write(tmp_path, STUDY.replace(old, new)), "--out", tmp_path / "o"
    )
    assert not (tmp_path / "o").exists()


def test_a_damaged_part_is_named_and_its_cases_run_again_without_it(tmp_path, refusal):
    study, out = write(tmp_path, STUDY.replace("cases = 6", "cases = 1")), tmp_path / "results"
    rid.study(study, out, workers=1)
    (part,) = out.rglob("part-*")
    part.write_bytes(part.read_bytes()[:-20])
    for how in ("--resume", "--summary"):
        told = refusal("study", study, "--out", out, how)
        assert f"{part}: found a damaged file" in told
        assert "delete it; --resume repeats its cases" in told
    part.unlink()
    assert rid.study(study, out, workers=1, resume=True).groups[0].statuses == {"ok": 1}


def test_results_are_gone_on_with_only_where_that_is_asked_for(tmp_path, refusal):
    study, out = write(tmp_path), tmp_path / "results"
    Store(out, load_study(study).identity, resume=False, timeout=1.0)
    assert "go on with --resume" in refusal("study", study, "--out", out)
    write(tmp_path, STUDY.replace("seed = 3", "seed = 4"))
    for how in ("--resume", "--summary"):
        assert "results of another study" in refusal("study", study, "--out", out, how)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("journal.jsonl", b"[1]\n", "journal.jsonl: line 1: found [1]; expected a row of a case"),
        ("journal.jsonl", b'{"a": 1}\n', "line 1: found {'a': 1}; expected a row of a case"),
        ("study.json", b"\xff", "found results of another study"),
        ("study.json", None, "study.json: found no such file beside results"),
    ],
)
def test_a_damaged_folder_is_told_of_and_kept(name, content, told, tmp_path, refusal):
    study, out = write(tmp_path), tmp_path / "results"
    Store(out, load_study(study).identity, resume=False, timeout=1.0)
    (out / name).unlink() if content is None else (out / name).write_bytes(content)
    before = {path: path.read_bytes() for path in out.rglob("*.json*")}
    for how in (["--resume"], ["--summary"], [])[: 3 if content is None else 2]:
        assert told in refusal("study", study, "--out", out, *how)
    assert {path: path.read_bytes() for path in out.rglob("*.json*")} == before


def test_one_run_at_a_time_works_on_a_folder(tmp_path, refusal):
    with held(tmp_path / "results"):
        told = refusal("study", write(tmp_path), "--out", tmp_path / "results", "--resume")
    assert "found a study that runs" in told
    with held(tmp_path / "results"):
        pass


FLEET = """
rig = "three-mass"
vary.duration = "0.5 s"
vary.experiment.serial = ["9", "10", "11", "12", "13", "14", "15", "16"]
vary.experiment.date = ["2026-03-01", "2026-06-01"]
"""


def test_a_fleet_tells_who_differs_and_who_changed(tmp_path, output):
    """m of serial 12 is off by 40 std; k of serial 10 changes by 12, and stays like the others."""
    pandas = pytest.importorskip("pandas", reason="nothing else that reads the rows")
    study, out, rng = write(tmp_path, FLEET), tmp_path / "results", np.random.default_rng(1)
    plan = load_study(study)
    store = Store(out, plan.identity, resume=False, timeout=1.0)
    for case in range(16):
        serial, date = plan.label(case).split(", ")
        said = {"serial": serial[9:], "date": date[7:]}
        noise = rng.standard_normal(2)
        m, k = 2 + 0.01 * (noise[0] + 40 * (said["serial"] == "12")), 5 + noise[1] / 2
        k += {"10 2026-03-01": -3.0, "10 2026-06-01": 3.0}.get(
            f"{said['serial']} {said['date']}", 0
        )
        values = {"m": m, "m_std": 0.01, "k": k, "k_std": 0.5, "b": 1.0, "b_std": None}
        ends = "true", "covered", "std_assumed"
        values |= {f"{name}_{end}": None for name in "mkb" for end in ends}
        values["m_std_assumed"] = 0.01 * case
        status = "rejected" if case == 15 else "ok"
        store.add({**plan.case(case).row(status, 0.1, **said), **values})
    store.close()
    said = list[str]()
    with watched(lambda say, *_: said.append(say)):
        shown = output("study", study, "--out", out, "--summary")
    told = {"reading results": 1, "summarizing points of the grid": 1}
    told |= {"sorting results into fleets": 15, "comparing machines of a fleet": 3}
    assert {say: said.count(say) for say in told} == told
    assert shown.count(" differs by ") == shown.count(" changed by ") == 1
    assert "m of serial 12 differs by +" in shown
    head, *rows = shown[shown.index("\nfleet") + 1 :].splitlines()
    assert "half of its 95 %  if assumptions err  scatter" in head
    assert [row.split()[5] for row in rows[:2]] == ["0.14", "-"]  # case 15 is rejected
    assert "k of serial 10 changed by +8." in shown
    assert "std between 2026-03-01 and 2026-06-01 (p < 1e-6)" in shown
    told = json.loads((out / "summary.json").read_text())
    (all_machines,), (m, k) = told["groups"], told["fleet"]
    assert (all_machines["label"], all_machines["cases"]) == ("", 16)
    assert [each["serial"] for each in k["machines"]] == [str(n) for n in range(9, 17)]
    assert [len(each["results"]) for each in m["machines"]] == [2] * 7 + [1]
    assert k["interval"][0] < 5 < k["interval"][1]
    assert "k of serial 10 changed by" in (out / "summary.html").read_text()
    rows = pandas.read_parquet(out / "results.parquet").pivot(index="serial", columns="date")
    assert rows["m"]["2026-06-01"]["12"] == m["machines"][3]["results"][1][2]


def test_fleets_count_a_record_once_and_pool_one_model_and_method(tmp_path, output):
    for number in (0, 2):
        (tmp_path / str(number)).mkdir()
        load_study(write(tmp_path)).case(number).write(tmp_path / str(number))
    shutil.copy(tmp_path / "0" / "run.h5", tmp_path / "copy.h5")
    swapped = {"k2": "m3", "m3": "k2"}  # a mass by the name of a stiffness
    text = rid.load_model("three-mass").file_text
    text = re.sub(r"\b(k2|m3)\b", lambda name: swapped[name[0]], text)
    (tmp_path / "swapped.toml").write_text(text)
    study = """
experiments = ["0/run.toml"]
variants = [
  { serial = 1 },
  { serial = "B", records.0.file = "copy.h5" },
  { serial = " B", records.0.file = "2/run.h5" },
  { serial = 1, estimator.method = "ls" },
  { serial = "B", records.0.file = "2/run.h5", estimator.method = "ls" },
  { serial = "B", records.0.file = "2/run.h5", model = "swapped.toml" },
]"""
    shown = output("study", write(tmp_path, study), "--out", tmp_path / "o", "--workers", "1")
    assert "left out, of records that count already, 1 cases" in shown
    assert "case 1 (serial B) repeats case 0 (serial 1)" in shown  # a copy, by another name
    assert "no machine but B has model = swapped.toml" in shown
    assert read_rows(tmp_path / "o")["serial"].to_pylist() == ["1", "B", "B", "1", "B", "B"]
    found = json.loads((tmp_path / "o" / "summary.json").read_text())["fleet"]
    cases = {each["name"][:12]: [m["results"][0][1] for m in each["machines"]] for each in found}
    assert (cases["m3, model = "], cases["m3, method ="]) == ([0, 2], [3, 4])
    assert {len(m["results"]) for each in found for m in each["machines"]} == {1}


@pytest.mark.parametrize("values", ['["11", "A12", "13 mm"]', '[17, "B", "absent"]'])
def test_a_column_with_a_text_is_of_texts(values, tmp_path):
    plan = load_study(write(tmp_path, f'rig = "three-mass"\nvary.experiment.serial = {values}'))
    found = {plan.case(k).settings["vary.experiment.serial"] for k in range(3)}
    assert found in ({"11", "A12", "13 mm"}, {"17", "B", None})


def test_what_machines_have_in_common_in_closed_form():
    """Two of equal deviations scatter by (d^2 / 2 - s^2)^(1/2); those that agree have one mean."""

    def fleet(*pairs: tuple[float, float]):
        told = {str(k): [FleetResult("", k, *pair)] for k, pair in enumerate(pairs)}
        return fleet_parameter("m", told)

    two = fleet((1e-7, 3e-9), (1.1e-7, 3e-9))
    assert two.scatter == pytest.approx(np.sqrt(1e-16 / 2 - 9e-18), rel=1e-9)
    assert two.common == pytest.approx(1.05e-7)
    half = 12.7062 * 1e-8 / 2  # t of one degree of freedom, d / 2
    assert two.interval == pytest.approx((1.05e-7 - half, 1.05e-7 + half), rel=1e-4)
    ends = np.sqrt(1e-16 / 2 / np.array([5.02389, 0.000982069]) - 9e-18)
    assert two.scatter_interval == pytest.approx(ends, rel=1e-4)
    shrunk = 1.05e-7 - 5e-9 * (1 - 9e-18 / (1e-16 / 2))
    assert two.machines[0].shrunk == pytest.approx(shrunk)
    agreed = fleet((1.0, 1.0), (2.0, 2.0), (1.5, 1.0))
    assert agreed.scatter == 0
    assert agreed.common == pytest.approx((1 + 2 / 4 + 1.5) / 2.25)
    assert [each.shrunk for each in agreed.machines] == pytest.approx([agreed.common] * 3)
    assert not [*agreed.remarks, *two.remarks]
    assert "if assumptions err" not in agreed.passage.table.headings
    (told,) = fleet((1.0, 1.0), (1.0, 1.0), (1.01, 1.0)).remarks  # by chance 1 - exp(-1e-4 / 3)
    assert "scatter less than the std of results say (p = 3e-05)" in told


@pytest.mark.slow
@pytest.mark.parametrize(("machines", "fleets"), [(5, 600), (20, 200), (200, 20)])
@pytest.mark.parametrize("scatter", [0.0, 1.0, 10.0])
def test_statements_on_fleets_hold(machines, fleets, scatter):
    rng, held, named = np.random.default_rng(machines), [], []
    for _ in range(fleets):
        true = scatter * rng.standard_normal(machines)
        std = 3 ** rng.uniform(-0.5, 0.5, machines)
        noisy = zip(true + std * rng.standard_normal(machines), std, strict=True)
        found = fleet_parameter(
            "m", {str(k): [FleetResult("", k, *map(float, p))] for k, p in enumerate(noisy)}
        )
        (low, high), (least, most) = found.interval, found.scatter_interval
        inside = [
            abs(each.shrunk - true[int(each.serial)]) < 1.96 * each.shrunk_std
            for each in found.machines
        ]
        held.append((low < 0 < high, least <= scatter <= most, np.mean(inside)))
        named.append(any(each.away.p_value < ALARM for each in found.machines))
    common, between, shrunk = np.mean(held, axis=0)
    wide = 3 * np.sqrt(0.05 * 0.95 / fleets)
    assert min(common, between) > 0.95 - wide
    assert shrunk > 0.925
    assert sum(named) <= ALARM * fleets + 3 * np.sqrt(ALARM * fleets) + 1


@pytest.mark.parametrize("number", [0, -1, 1.5])
def test_a_number_of_workers_is_one_or_more(number, tmp_path):
    with pytest.raises(rid.InputError, match="workers"):
        rid.study(write(tmp_path), tmp_path / "results", workers=number)
    assert not (tmp_path / "results").exists()


def test_what_was_stopped_runs_again_where_that_may_help(tmp_path):
    """In a whole part as in the journal; what the new row says stands before the old one's."""
    stopped = {2: 1.0, 3: 5.0, PART: 1.0}  # s
    store = Store(tmp_path, "it", resume=False, timeout=5.0)
    for case in range(PART + 2):
        verdict = {"verdict": "stopped", "seconds": stopped[case]} if case in stopped else {}
        store.add({**row(case), **verdict})
    with (tmp_path / "journal.jsonl").open("ab") as journal:
        journal.write(b"\0\0\n")  # as an end of the machine leaves it
    store = Store(tmp_path, "it", resume=True, timeout=5.0)
    assert [case for case in range(PART + 2) if case not in store] == [2, PART]
    store.add(row(2))
    verdicts = read_rows(tmp_path)["verdict"].to_pylist()
    assert [verdicts[case] for case in (2, 3)] == ["ok", "stopped"]
    store = Store(tmp_path, "it", resume=True, timeout=6.0)
    assert [case for case in range(PART + 2) if case not in store] == [3, PART]


def test_a_case_that_takes_too_long_is_ended_and_runs_with_more_time(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    study = write(tmp_path, STUDY.replace("cases = 6", "cases = 1").replace("100 s", "1 ms"))
    found = rid.study(study, tmp_path / "results", workers=1)
    assert found.errors == (("not done within 0.001 s; raise timeout and --resume", 1),)
    write(tmp_path, study.read_text().replace("1 ms", "100 s"))
    assert rid.study(study, tmp_path / "results", workers=1, resume=True).errors == ()
    assert {path.name for path in tmp_path.iterdir()} == {"study.toml", "results"}


@pytest.mark.slow
def test_measured_experiments_are_a_fleet(tmp_path, output):
    for seed in (1, 2):
        output("simulate", "three-mass", "--out", tmp_path / f"{seed}.h5", "--seed", seed)
    text = 'experiments = ["*[12].toml"]\nvary.estimator.method = ["batch", "ls"]'
    rows = read_rows(_studied(write(tmp_path, text), tmp_path / "results")).to_pylist()
    assert [row["vary.experiment"] for row in rows] == ["1.toml", "1.toml", "2.toml", "2.toml"]
    alone = rid.load_experiment(tmp_path / "2.toml").identify("ls")
    assert rows[3]["m1"] == alone.value("m1")
    assert np.isnan(rows[3]["m1_true"])


def _studied(study: Path, out: Path, **how: object) -> Path:
    rid.study(study, out, **how)
    return out


@pytest.mark.slow
def test_a_killed_study_goes_on_repeats_nothing_and_leaves_no_files(tmp_path, monkeypatch):
    (tmp_path / "temporary").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    study = write(tmp_path, STUDY.replace("cases = 6", "cases = 24"))
    whole = frame(_studied(study, tmp_path / "whole", workers=1))
    out, rng = tmp_path / "killed", np.random.default_rng(2)
    journal, seen = out / "journal.jsonl", {}
    for attempt in range(4):
        more = ["--resume"] * bool(attempt)
        process = subprocess.Popen(command(study, out, "--workers", "2", *more))
        until = len(seen) + rng.integers(1, 5)
        while not journal.exists() or journal.read_text().count("\n") < until:
            time.sleep(0.01)
            assert process.poll() is None
        time.sleep(rng.uniform(0, 0.3))
        process.kill()
        process.wait()
        lines = journal.read_text().splitlines(keepends=True)
        now = {json.loads(line)["case"]: line for line in lines if line.endswith("\n")}
        assert seen.items() <= now.items()
        seen = now
    assert cli.run(["study", str(study), "--out", str(out), "--resume", "--quiet"]) == 0
    assert frame(out).equals(whole)
    times = {row["case"]: row["seconds"] for row in read_rows(out).to_pylist()}
    assert all(json.loads(line)["seconds"] == times[case] for case, line in seen.items())
    assert [path.name for path in (tmp_path / "temporary").glob("tmp*")] == []


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(tmp_path):
    plan, processes = load_study(write(tmp_path)), Processes()
    rows = [processes.run(plan.case(0))]
    (process,) = processes.all
    Timer(0.1, os.kill, (process.pid, signal.SIGKILL)).start()
    rows.append(processes.run(plan.case(0)))
    (second,) = processes.all
    second.kill()
    second.communicate()
    assert process.returncode == -signal.SIGKILL
    assert [{**row, "seconds": 0} for row in rows] == [{**rows[0], "seconds": 0}] * 2


@pytest.mark.slow
def test_a_cluster_gives_the_same_rows(tmp_path):
    distributed = pytest.importorskip("distributed", reason="no Dask to be a cluster")
    study = write(tmp_path)
    here = frame(_studied(study, tmp_path / "here", workers=1))
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        there = _studied(study, tmp_path / "there", scheduler=cluster.scheduler_address)
    assert frame(there).equals(here)
