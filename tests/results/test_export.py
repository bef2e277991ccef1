"""Estimates for other programs, read back with readers of their own."""

import csv
import math

import numpy as np
import pytest
from scipy.io import loadmat

from rotorid import Estimate, InputError, Value, export, load_model
from rotorid.cli import run

ESTIMATE = Estimate(
    "three-mass",
    "ml",
    "ok",
    (
        Value("m1", "kg", 0.1 + 0.2, 0.01, 0.02),
        Value("L1", "m", 0.3, 0.0, 0.0, fixed=True),
        Value("k_1*L1^2", "N m", 1.5e5, 30.0),
    ),
    nuisance=(Value("gain[x1]", "1", 1.01, 0.005),),
    derived=(Value("a, b & c", "m", math.nan, None),),
    covariance=np.array([[1e-4, 0.1, 0.0], [0.1, 900.0, 0.2], [0.0, 0.2, 2.5e-5]]),
)


def test_csv_holds_every_digit(tmp_path):
    export(ESTIMATE, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == ["m1", "L1", "k_1*L1^2", "gain[x1]", "a, b & c"]
    assert float(rows[0]["value"]) == 0.1 + 0.2
    names = ["m1", "k_1*L1^2", "gain[x1]"]
    found = [[float(rows[i][f"cov[{name}]"]) for name in names] for i in (0, 2, 3)]
    np.testing.assert_array_equal(found, ESTIMATE.covariance)
    assert rows[1]["cov[m1]"] is None  # fixed: no row of the covariance
    assert rows[4]["std"] == ""


def test_mat_comes_back(tmp_path):
    export(ESTIMATE, tmp_path / "a.mat")
    found = loadmat(tmp_path / "a.mat", simplify_cells=True)["estimate"]
    assert list(found["name"]) == ["m1", "L1", "k_1*L1^2", "gain[x1]", "a, b & c"]
    assert list(found["covariance_name"]) == ["m1", "k_1*L1^2", "gain[x1]"]
    np.testing.assert_array_equal(found["covariance"], ESTIMATE.covariance)
    np.testing.assert_array_equal(found["value"][:4], [0.1 + 0.2, 0.3, 1.5e5, 1.01])
    assert np.isnan(found["std"][4])
    assert found["status"] == "ok"


def test_tex_escapes_names(tmp_path):
    export(ESTIMATE, tmp_path / "a.tex")
    text = (tmp_path / "a.tex").read_text(encoding="utf-8")
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 4
    assert r"k\_1*L1\textasciicircum{}2 & 150000 & 30 & 0.020" in text
    assert r"a, b \& c" in text
    assert r"covariance & m1 & k\_1*L1\textasciicircum{}2 & gain[x1] \\" in text


def test_an_estimate_of_nothing_has_headings_only(tmp_path):
    empty = Estimate("m", "ls", "not_identifiable", ())
    for name in ("a.csv", "a.mat", "a.tex"):
        export(empty, tmp_path / name)
        assert (tmp_path / name).exists()


def test_an_ending_that_is_unknown(tmp_path):
    with pytest.raises(InputError, match=r"found the ending '\.xls'; expected one of \.csv, \.mat"):
        export(ESTIMATE, tmp_path / "a.xls")


@pytest.mark.parametrize("size", [0, 1, 7])
def test_a_covariance_of_other_size_is_left_out(tmp_path, size):
    odd = ESTIMATE.with_(covariance=np.zeros((size, size)))
    for name in ("a.csv", "a.mat", "a.tex"):
        export(odd, tmp_path / name)
    assert "cov[" not in (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert "covariance" not in (tmp_path / "a.tex").read_text(encoding="utf-8")


@pytest.mark.parametrize("ending", ["csv", "mat", "tex", "json"])
def test_a_table_that_a_user_edited_is_kept(ending, tmp_path, capsys):
    result, table = tmp_path / "run.json", tmp_path / f"table.{ending}"
    model = load_model("jeffcott")
    named = zip(model.parameter_names, model.parameter_units.values(), strict=True)
    Estimate("jeffcott", "ml", "ok", tuple(Value(n, u, 2.0) for n, u in named)).save(result)
    order = ["export", str(result), "--to", str(table)]
    assert run(order) == 0
    assert run(order) == 0  # nobody edited it
    edited = table.read_bytes().replace(b"0", b"1", 1)
    assert edited != table.read_bytes()
    table.write_bytes(edited)
    assert run(order) == 2
    assert "edited since" in capsys.readouterr().err
    assert table.read_bytes() == edited
    assert run([*order, "--force"]) == 0


def test_a_name_is_no_formula_of_a_spreadsheet(tmp_path):
    names = ["-k1*L1 + k2", "=1+1", "m1"]
    estimate = Estimate("one", "ls", "ok", tuple(Value(n, "kg", 2.0) for n in names))
    export(estimate, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(encoding="utf-8", newline="") as stream:
        assert [row["name"] for row in csv.DictReader(stream)] == ["'-k1*L1 + k2", "'=1+1", "m1"]
