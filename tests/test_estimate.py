"""Results: their JSON and back, whatever is in them; files that are no results."""

import json
import math
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from bank import JEFFCOTT, THREE_MASS, Grid
from hypothesis import given, settings
from hypothesis import strategies as st
from severities import causes

import rotorid as rid
from rotorid.answer.estimate import check_units
from rotorid.answer.parts import SourceFile
from rotorid.core.notes import Severity

FINITE = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.text(st.characters(exclude_categories=("Cs",)), max_size=12)
WORDS = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=12)
NAMED = WORDS | st.tuples(WORDS, WORDS).map(" ".join)  # what can be printed
UNITS = st.sampled_from(["1", "kg", "N/m", "kg m^2", "m", "rad", "N s/m", "V m"])
DEVIATIONS = st.none() | FINITE.map(abs)
ROOTS = st.floats(-1e100, 1e100).map(lambda x: x if abs(x) > 1e-100 else 0.0)
ASSIGNMENTS = st.lists(st.tuples(NAMES, FINITE), max_size=3).map(tuple)
SOURCES = st.lists(st.builds(SourceFile, NAMES, NAMES), max_size=2).map(tuple)

PLACES = st.lists(NAMES, max_size=2).map(tuple)
SAID = (NAMES, st.sampled_from(get_args(Severity)), NAMES, NAMES, PLACES)
NOTES = st.builds(rid.Note, *SAID, DEVIATIONS, NAMES, DEVIATIONS, DEVIATIONS)


@st.composite
def estimates(draw):
    values = st.builds(rid.Value, NAMED, UNITS, FINITE, DEVIATIONS, DEVIATIONS, st.booleans())
    bare = st.builds(rid.Value, NAMED, UNITS, FINITE, DEVIATIONS)
    parameters, nuisance = draw(st.lists(values, max_size=3)), draw(st.lists(bare, max_size=3))
    free = [v for v in [*parameters, *nuisance] if not v.fixed] if draw(st.booleans()) else []
    size = len(free)
    root = np.array(draw(st.lists(ROOTS, min_size=size**2, max_size=size**2))).reshape(size, size)
    stated = {id(v): s for v, s in zip(free, np.sqrt((root**2).sum(axis=1)).tolist(), strict=True)}
    parameters, nuisance = (
        tuple(replace(v, std=stated.get(id(v), v.std)) for v in several)
        for several in (parameters, nuisance)
    )
    return rid.Estimate(
        model=draw(NAMES),
        method=draw(NAMES),
        status=draw(st.sampled_from(["ok", "rejected", "not_identifiable", "not_converged"])),
        parameters=parameters,
        nuisance=nuisance,
        derived=tuple(draw(st.lists(bare, max_size=3))),
        covariance=root @ root.T,
        misfit=draw(st.none() | st.builds(rid.Misfit, FINITE, FINITE, st.integers(0, 999), FINITE)),
        notes=tuple(draw(st.lists(NOTES, max_size=5))),
        prediction=draw(st.dictionaries(NAMES, st.none() | st.builds(rid.Prediction, FINITE))),
        lines_hz=tuple(draw(st.lists(FINITE, max_size=3))),
        periods=draw(st.integers(0, 10**6)),
        condition_number=draw(DEVIATIONS),
        line_misfit=tuple(
            draw(st.lists(st.builds(rid.LineMisfit, st.integers(0, 9), FINITE, FINITE, FINITE)))
        ),
        alternatives=tuple(draw(st.lists(st.builds(rid.Alternative, FINITE, ASSIGNMENTS)))),
        provenance=draw(st.none() | st.builds(rid.Provenance, SOURCES, NAMES, NAMES, NAMES)),
    )


def again(estimate: rid.Estimate, folder: Path) -> rid.Estimate:
    """Return an estimate by way of its file."""
    estimate.save(folder / "result.json")
    return rid.load_estimate(folder / "result.json")


def read(data: dict, folder: Path) -> rid.Estimate:
    """Return what a file of these keys holds."""
    (folder / "result.json").write_text(json.dumps(data), encoding="utf-8")
    return rid.load_estimate(folder / "result.json")


@settings(max_examples=40, deadline=None)
@given(estimate=estimates())
def test_writing_then_reading_is_the_identity(estimate, tmp_path_factory):
    assert again(estimate, tmp_path_factory.mktemp("estimate")) == estimate


def test_what_is_not_determined_comes_back_as_it_was(tmp_path):
    still = replace(THREE_MASS, grids=(Grid(250, 5000.0),))
    estimate = rid.Batch().estimate(still.model, still.records)
    found = again(estimate, tmp_path)
    assert math.isnan(found.value("I_p"))
    assert found.value("m1") == estimate.value("m1")
    assert found == estimate
    assert str(found) == str(estimate)
    assert found._repr_html_() == estimate._repr_html_()


def test_keys_of_the_result_file(tmp_path):
    """The contract of interface.md: exactly these names."""
    estimate = rid.Batch(fixed={"k": 9e5}).estimate(JEFFCOTT.model, JEFFCOTT.records)
    estimate.save(tmp_path / "result.json")
    data = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    contract = (
        "schema version model method status parameters nuisance derived covariance misfit "
        "suspects prediction lines_hz periods warnings alternatives checks provenance verdict "
        "assumptions notes"
    )
    assert {*contract.split()} <= set(data)
    assert data["schema"] == "rotorid-estimate/2"
    keys = {"name", "unit", "value", "std", "std_inflated", "std_assumed", "interval", "fixed"}
    assert all(set(row) == keys for row in data["parameters"])
    assert all(set(row) == {"name", "unit", "value", "std", "interval"} for row in data["derived"])
    assert [row["name"] for row in data["parameters"]] == ["m", "m*xi", "m*zeta", "c", "k"]
    assert [row["fixed"] for row in data["parameters"]] == [False] * 4 + [True]
    assert data["parameters"][-1]["value"] == 9e5
    assert data["parameters"][-1]["std"] == 0
    assert np.array(data["covariance"]).shape == (4, 4)
    assert set(data["prediction"]) == {"F_x", "F_y"}
    assert set(data["prediction"]["F_x"]) == {"relative_error"}
    assert data["misfit"] is None
    assert data["periods"] == 3
    assert data["lines_hz"] == [5.0, 10.0, 20.0]


def test_rows_of_version_2():
    data = json.loads(json.dumps(VALID))
    suspect = {"term": "damping", "drop": 2.0, "share": 0.5, "value": 3.0, "unit": "N s/m"}
    check = {"check": "clipping", "channel": "x1", "found": "3 samples", "verdict": "warning"}
    source = {"files": [{"file": "a.csv", "sha256": "00"}], "experiment": "model = 1"}
    source |= {"version": "0.1", "command": "rotorid identify"}
    assert (data["suspects"], data["checks"]) == ([suspect], [check])
    assert data["alternatives"] == [{"cost": 1.5, "parameters": [{"name": "a", "value": 2.0}]}]
    assert data["provenance"] == source | {"model": "", "held": [], "environment": ""}


def test_a_file_of_version_1_still_loads(tmp_path):
    data = json.loads(json.dumps(VALID))
    for key in ("alternatives", "checks", "provenance", "notes"):
        del data[key]
    data["schema"] = "rotorid-estimate/1"
    data["suspects"] = [{"term": "damping", "drop": 2.0}]
    found = read(data, tmp_path)
    assert found.suspects == (rid.Suspect("damping", 2.0),)
    assert (found.alternatives, found.checks, found.provenance) == ((), (), None)
    assert found.warnings == ("above its noise",)
    assert found.value("a") == 1.0


def test_a_file_without_notes_has_its_warnings_and_checks(tmp_path):
    found = read({k: v for k, v in VALID.items() if k != "notes"}, tmp_path)
    views = ("warnings", "checks", "suspects")
    assert {k: found.to_dict()[k] for k in views} == {k: VALID[k] for k in views}
    assert found.checks == (rid.Note("clipping", "warns", "3 samples", on=("x1",)),)


def test_a_file_of_a_later_version_is_refused_by_name(tmp_path):
    message = "'rotorid-estimate/3'; expected 'rotorid-estimate/1' or"
    with pytest.raises(rid.ReadError, match=message):
        read({**VALID, "schema": "rotorid-estimate/3"}, tmp_path)


def test_numbers_that_are_not_finite_are_null_in_the_file(tmp_path):
    value = rid.Value("a", "kg", math.inf, math.nan)
    other = rid.Alternative(math.nan, (("a", math.inf),))
    lost = {"covariance": [[math.nan]], "misfit": rid.Misfit(math.nan, 1.0, 3, math.nan)}
    broken = rid.Estimate("m", "ml", "not_converged", (value,), alternatives=(other,), **lost)
    found = again(broken, tmp_path)
    text = (tmp_path / "result.json").read_text(encoding="utf-8")
    assert "NaN" not in text
    assert "Infinity" not in text
    assert math.isnan(found.value("a"))
    assert math.isnan(found.covariance[0, 0])
    assert math.isnan(found.alternatives[0].parameters[0][1])


def estimate_of(**changes):
    values = (rid.Value("a", "kg", 1.0, 0.1), rid.Value("b", "1", math.nan, math.nan))
    known = {"covariance": np.diag([0.01, np.nan]), "prediction": {"F": rid.Prediction(0.1)}}
    return rid.Estimate("m", "ls", "not_identifiable", values, **{**known, **changes})


GOOD = rid.Estimate("m", "ml", "ok", (rid.Value("a", "kg", 1.0, 0.1),), covariance=[[0.01]])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    "changes",
    [
        lambda x: {"parameters": (rid.Value("a", "kg", x, 0.1),)},
        lambda x: {"parameters": (rid.Value("a", "kg", 1.0, x),)},
        lambda x: {"parameters": (rid.Value("a", "kg", 1.0, 0.1, x),)},
        lambda x: {"nuisance": (rid.Value("gain[x]", "1", x, 0.1),)},
        lambda x: {"derived": (rid.Value("k", "N/m", 1.0, x),)},
        lambda x: {"covariance": [[x]]},
        lambda x: {"misfit": rid.Misfit(x, 1.0, 3, 0.5)},
    ],
)
def test_ok_is_finite(changes, bad):
    """Whoever makes the estimate: what is not finite is not called ok, nor read as such."""
    with pytest.raises(rid.InputError, match=r"finite .* in an estimate called ok"):
        GOOD.with_(**changes(bad))
    assert GOOD.with_(status="not_converged", **changes(bad)).status == "not_converged"


TWO = (rid.Value("m", "kg", 2.0, std=0.1), rid.Value("k", "N/m", 3.0, std=0.2))


@pytest.mark.parametrize(
    ("values", "covariance", "message"),
    [
        ({"std": -0.1}, [], r"parameters\.0\.std: found -0.1"),
        ({"std_inflated": -1.0}, [], r"parameters\.0\.std_inflated: found -1"),
        ({}, [[-0.01, 0], [0, 0.04]], "found -0.01 where m has a std of 0.1"),
        ({"std": None}, [[-0.01, 0], [0, 0.04]], "found -0.01 where m has"),
        ({}, [[0.01, 0], [0, 0.0401]], "found 0.0401 where k has a std of 0.2"),
        ({}, [[0.01, 0.01], [0, 0.04]], "found a matrix that is not symmetric"),
        ({}, [[0.01, 0.03], [0.03, 0.04]], "found a combination of a negative variance"),
        ({}, [[0.01]], "found 1 rows for 2 free quantities"),
    ],
)
def test_a_result_that_contradicts_itself_is_refused(values, covariance, message, tmp_path):
    """What follows from it would state deviations that are too small."""
    both = (replace(TWO[0], **values), TWO[1])
    with pytest.raises(rid.ReadError, match=f"{message}.*this one was edited"):
        again(rid.Estimate("one", "ls", "ok", both, covariance=np.array(covariance)), tmp_path)
    whole = rid.Estimate("one", "ls", "ok", TWO, covariance=np.array([[0.01, 0.02], [0.02, 0.04]]))
    assert again(whole, tmp_path) == whole


def test_other_units_than_those_of_the_model():
    check_units(rid.Estimate("one", "ls", "ok", TWO), {"m": "kg"})
    with pytest.raises(rid.InputError, match="found m in 'kg'; expected g, as its model has it"):
        check_units(rid.Estimate("one", "ls", "ok", TWO), {"m": "g", "k": "N/m"})
    own = (rid.Value("t[1]", "kg m", 2.0),)
    with pytest.raises(rid.InputError, match=r"found t\[1\] in 'kg m'"):
        check_units(rid.Estimate("one", "ls", "ok", own), {"t": "g mm"})


def test_what_is_not_stated_need_not_be_finite():
    silent = GOOD.with_(parameters=(rid.Value("a", "kg", 1.0, None),), covariance=[[math.nan]])
    assert silent.status == "ok"
    assert GOOD.with_(derived=(rid.Value("L1", "m", math.nan),)).status == "ok"


def test_arrays_are_read_only_and_its_own():
    given = np.eye(2)
    estimate = estimate_of(covariance=given)
    with pytest.raises(ValueError, match="read-only"):
        estimate.covariance[0, 0] = 2.0
    given[0, 0] = 5.0
    assert estimate.covariance[0, 0] == 1.0


def test_repr_fits_a_screen():
    many = tuple(rid.Value(f"parameter{i}", "kg", 1e5 * i, 1.0) for i in range(500))
    text = repr(rid.Estimate("a long name " * 20, "ml", "ok", many))
    assert len(text) < 240
    assert "\n" not in text
    assert "ml: ok; parameter0 = 0, parameter1 = 1e+05" in text


def test_data_frame_without_pandas(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas") as found:
        estimate_of().to_frame()
    assert "\n" not in str(found.value)


def test_access_by_name():
    estimate = rid.Batch().estimate(JEFFCOTT.model, JEFFCOTT.records)
    assert estimate["m"].unit == "kg"
    assert estimate.value("xi") == pytest.approx(1.5e-5)
    assert [v.name for v in estimate.free] == list(JEFFCOTT.base)
    with pytest.raises(KeyError, match="'q'; there are: m, m"):
        estimate["q"]
    with pytest.raises(KeyError, match="there are"):
        estimate.std("q")


def test_correlation():
    cov = np.array([[4.0, 3.0, 0.0], [3.0, 9.0, 0.0], [0.0, 0.0, 0.0]])
    values = tuple(rid.Value(n, "1", 1.0, 1.0) for n in "abc")
    found = rid.Estimate("m", "ls", "ok", values, covariance=cov).correlation
    np.testing.assert_allclose(found, [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 0]])


VALID = GOOD.with_(
    method="ls",
    prediction={"F": rid.Prediction(0.1)},
    misfit=rid.Misfit(1.0, 1.0, 3, 0.5),
    notes=(
        *causes(rid.Suspect("damping", 2.0, 0.5, 3.0, "N s/m")),
        rid.Note("clipping", "warns", "3 samples", on=("x1",)),
        rid.Note("misfit", "doubts", "above its noise"),
    ),
    alternatives=(rid.Alternative(1.5, (("a", 2.0),)),),
    provenance=rid.Provenance((SourceFile("a.csv", "00"),), "model = 1", "0.1", "rotorid identify"),
).to_dict()
JUNK = [None, "x", 3, -1.5, [], {}, [1], {"a": 1}, [[1, 2], [3]], True, 10**400, "nan"]


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(sorted(VALID)), st.sampled_from(JUNK), st.booleans())
def test_a_damaged_file_is_read_or_refused(key, junk, drop):
    data = json.loads(json.dumps(VALID))
    if drop:
        del data[key]
    else:
        data[key] = junk
    check(json.dumps(data))


NUMBERS = ("1", "9" * 5000, "1e999", "-" + "9" * 400, "NaN")


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", "3", "null", "{}", "\0", "é", "[" * 10**5, "NaN"),
        *(f'{{"schema": {number}}}' for number in NUMBERS),
    ],
)
def test_files_that_are_no_results(text):
    assert 0 < len(check(text)) < 300


def check(text):
    """Return the refusal of a text, checked for its form; "" where it is read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        path.write_text(text, encoding="utf-8")
        try:
            found = rid.load_estimate(path)
        except rid.ReadError as error:
            message = str(error)
        else:
            assert str(found)
            return ""
    assert re.search(r"result\.json: (\S+: )?found .*; expected .*; write one with", message)
    assert "\n" not in message
    return message


def test_a_prediction_that_noise_spoils_is_explained_where_the_cost_is_in_order():
    """Sweeps of a rotor that floats: beside its modes the noise of the forces predicts motion."""
    good = rid.Estimate(
        "m", "ml", "ok", (), misfit=rid.Misfit(98.0, 99.0, 90, 0.5),
        prediction={"x1": rid.Prediction(18.1), "y1": None}, lines_hz=(5.0, 600.0), periods=1,
    )  # fmt: skip
    assert "see the misfit): x1 more than 1000 %, y1 zero" in str(good)
    assert "no periods, 2 lines from 5 to 600 Hz" in str(good)
    for other in (
        replace(good, status="rejected"),
        replace(good, misfit=None),
        replace(good, prediction={"x1": rid.Prediction(0.29)}),
    ):
        assert "lightly damped resonance" not in str(other)
    assert "lightly damped resonance" in str(replace(good, prediction={"x1": rid.Prediction(0.31)}))
    assert "\n260 periods, 2 lines" in str(replace(good, periods=260))


@pytest.mark.parametrize(
    ("key", "text"),
    [("unit", "kg\x1b[2J"), ("unit", "=cmd"), ("name", "a\nb"), ("name", "")],
)
def test_names_and_units_of_a_file_are_checked(key, text, tmp_path):
    one = rid.Estimate("one", "ls", "ok", (rid.Value("m", "kg", 2.0, std=0.01),))
    assert again(one, tmp_path).value("m") == 2.0
    data = json.loads((tmp_path / "result.json").read_text())
    data["parameters"][0][key] = text
    with pytest.raises(rid.InputError, match=rf"parameters\.0\.{key}") as told_of:
        read(data, tmp_path)
    assert str(told_of.value).isprintable()
