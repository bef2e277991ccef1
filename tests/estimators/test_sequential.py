"""Stages derived from the model, and how the error of one goes into the next."""

from dataclasses import replace

import numpy as np
import pytest
from bank import BANK, CHAIN, RIGID, THREE_MASS, TRAIN, Grid, line_response, table

from rotorid import Batch, Channel, Constraint, Record, Sequential, average, parse_model
from rotorid.data.observation import bind_all
from rotorid.linear.estimators import _solve_stages, plan_stages
from rotorid.linear.family import LeastSquaresProblem


def stages_of(problem, constraints=(), **fixed):
    posed = LeastSquaresProblem.of(
        bind_all(problem.model, problem.records), {**problem.known, **fixed}, constraints
    )
    names = posed.names
    return [(rows, [names[u] for u in unknowns]) for rows, unknowns in plan_stages(posed)]


def test_stages_of_the_seed():
    """The paper's (10) and (11)."""
    first, second = stages_of(THREE_MASS)
    assert first == ([0, 1, 6, 7], ["m1", "m3", "k1", "k1*L1", "k2", "k2*L2"])
    assert second[0] == [2, 3, 4, 5]
    assert set(first[1]) | set(second[1]) == set(THREE_MASS.base)
    assert not set(first[1]) & set(second[1])


def test_a_stage_for_each_mass_of_a_train():
    assert stages_of(TRAIN) == [([2], ["a", "k"]), ([1], ["b", "h"]), ([0], ["c", "d"])]


def test_rows_without_an_input_of_their_own():
    assert stages_of(CHAIN) == [([0], ["m_1", "k", "k_3"]), ([1], ["m_2"])]
    assert stages_of(RIGID) == [([0, 1, 2, 3], list(RIGID.base))]


def test_fixed_values_and_constraints_move_unknowns():
    # A known spring drives the second mass as an input does.
    assert stages_of(TRAIN, k=3000.0) == [([1, 2], ["a", "b", "h"]), ([0], ["c", "d"])]
    # b = 2 a, eliminated, leaves a in the rows of both
    found = stages_of(TRAIN, [Constraint("b - 2*a", 0.0)])
    assert found in (
        [([2], ["a", "k"]), ([1], ["h"]), ([0], ["c", "d"])],
        [([2], ["b", "k"]), ([1], ["h"]), ([0], ["c", "d"])],
    )


def test_a_stage_takes_in_the_rows_that_tell_its_unknowns_apart():
    """a and b act through the same column of the driven row; the free row separates them."""
    text = table(
        "t",
        ["m*x'' + (a + b)*x = F", "n*y'' + a*y + b*x = 0"],
        coordinates={"x": "m", "y": "m"},
        inputs={"F": "N"},
        parameters={"m": "kg", "n": "kg", "a": "N/m", "b": "N/m"},
    )
    truth = {"m": 2.0, "n": 1.0, "a": 500.0, "b": 300.0}

    def columns(p, grid):
        M, K = np.diag([p.m, p.n]), np.array([[p.a + p.b, 0], [p.b, p.a]])
        u = np.cos(grid.omega * grid.time) + np.sin(2 * grid.omega * grid.time)
        right = np.column_stack([u, 0 * u])
        q = line_response(grid, (1, 2), lambda w: K - w**2 * M + 0j, right)
        return {"F": u, "x": q[:, 0], "y": q[:, 1]}

    problem = replace(
        TRAIN, text=text, truth=truth, columns=columns, harmonics=(1, 2), base=("m", "n", "a", "b")
    )
    assert stages_of(problem) == [([0, 1], ["m", "n", "a", "b"])]
    estimate = Sequential().estimate(problem.model, problem.records)
    for name, value in truth.items():
        assert estimate.value(name) == pytest.approx(value, rel=1e-9)


def confounded(second):
    """Return a model whose first stage cannot tell c from g at one speed; `second` is row 2."""
    text = table(
        "t",
        ["a*x'' + c*x' + g*Omega*x' + k*(x - y) = u", f"b*y'' + {second} + k*(y - x) = 0"],
        coordinates={"x": "m", "y": "m"},
        inputs={"u": "N"},
        parameters={"a": "kg", "b": "kg", "c": "N s/m", "g": "N s^2/m", "k": "N/m"},
    )
    truth = {"a": 1.0, "b": 2.0, "c": 7.0, "g": 0.2, "k": 900.0}

    def columns(p, grid):
        below = p.g * grid.speed if "Omega" in second else 0.0 if second == "0" else p.c
        M, D = np.diag([p.a, p.b]), np.diag([p.c + p.g * grid.speed, below])
        K = p.k * np.array([[1, -1], [-1, 1]])
        u = np.cos(2 * grid.omega * grid.time) + np.cos(3 * grid.omega * grid.time)
        right = np.column_stack([u, 0 * u])
        q = line_response(grid, (2, 3), lambda w: K + 1j * w * D - w**2 * M, right)
        return {"u": u, "x": q[:, 0], "y": q[:, 1]}

    return replace(
        TRAIN,
        text=text,
        truth=truth,
        columns=columns,
        grids=(Grid(turns=4),),
        harmonics=(2, 3),
        base=("a", "b", "c", "g", "k"),
    )


@pytest.mark.parametrize("method", [Sequential, Batch], ids=lambda m: m.__name__)
def test_what_one_stage_leaves_open_and_no_other_determines(method):
    problem = confounded("0")
    estimate = method().estimate(problem.model, problem.records)
    assert estimate.status == "not_identifiable"
    assert "not identifiable: c, g are determined only together" in estimate.warnings
    assert np.isnan([estimate.value("c"), estimate.value("g")]).all()
    for name in "abk":
        assert estimate.value(name) == pytest.approx(problem.truth[name], rel=1e-9)


@pytest.mark.parametrize("second", ["c*y'", "g*Omega*y'"])
@pytest.mark.parametrize("method", [Sequential, Batch], ids=lambda m: m.__name__)
def test_what_one_stage_leaves_open_is_no_zero_in_the_next(method, second):
    """Row 2 tells c from g; the rows of the first stage wait for it."""
    problem = confounded(second)
    assert stages_of(problem) == [([0], ["a", "c", "g", "k"]), ([1], ["b"])]
    estimate = method().estimate(problem.model, problem.records)
    assert estimate.status == "ok"
    assert estimate.warnings == ()
    for name, value in problem.truth.items():
        assert estimate.value(name) == pytest.approx(value, rel=1e-9)


def test_two_stages_by_hand():
    """(5) and (6) with numpy.linalg.lstsq: forces weigh stage 1, transmitted forces stage 2."""
    clean = CHAIN.record(periods=2)
    noise = dict(zip(clean.names, 0.01 * clean.samples.std(axis=0), strict=True))
    record = CHAIN.periodic(periods=40, noise=noise, rng=np.random.default_rng(1))
    found = Sequential().estimate(CHAIN.model, [record])

    grid, keep = Grid(), list(CHAIN.harmonics)
    omega = grid.omega * np.arange(grid.samples // 2 + 1)

    def filtered(x, order=0):
        spectrum = np.fft.rfft(x, axis=-1)
        masked = np.zeros_like(spectrum)
        masked[..., keep] = spectrum[..., keep]
        return np.fft.irfft((1j * omega) ** order * masked, grid.samples, axis=-1)

    F, x1, x2 = (record.mean[:, record.index(n)] for n in ("F", "x1", "x2"))
    stretch = filtered(x1) - filtered(x2)
    columns = np.column_stack([filtered(x1, 2), stretch, filtered(stretch**3)])
    weight = 1 / np.sqrt(record.variance[:, record.index("F")])
    m_1, k, k_3 = np.linalg.lstsq(columns * weight[:, None], filtered(F) * weight, rcond=None)[0]

    each = np.fft.irfft(_full(record.spectra, keep, grid.samples), grid.samples, axis=1)
    own = each[..., record.index("x1")] - each[..., record.index("x2")]
    transmitted = k * own + k_3 * filtered(own**3)
    weight = 1 / transmitted.std(axis=0, ddof=1)
    right = k * stretch + k_3 * filtered(stretch**3)
    m_2 = np.linalg.lstsq((filtered(x2, 2) * weight)[:, None], right * weight, rcond=None)[0][0]
    for name, value in {"m_1": m_1, "k": k, "k_3": k_3, "m_2": m_2}.items():
        assert found.value(name) == pytest.approx(value, rel=1e-7)


def _full(spectra, keep, samples):
    whole = np.zeros((spectra.shape[0], samples // 2 + 1, spectra.shape[2]), dtype=complex)
    whole[:, keep] = samples * spectra
    return whole


@pytest.mark.parametrize("problem", BANK, ids=lambda p: p.name)
@pytest.mark.parametrize("kind", ["batch", "sequential"])
def test_gains_are_the_answer_to_a_change_of_the_forces(problem, kind):
    clean = problem.record(periods=2)
    noise = dict(zip(clean.names, 0.01 * clean.samples.std(axis=0), strict=True))
    record = problem.periodic(periods=5, noise=noise, rng=np.random.default_rng(2))

    def solve(one):
        if kind == "batch":
            return Batch(fixed=problem.known).solve(problem.model, [one])
        posed = LeastSquaresProblem.of(bind_all(problem.model, [one]), problem.known, ())
        return posed, _solve_stages(posed, plan_stages(posed))

    posed, before = solve(record)
    rng = np.random.default_rng(3)
    inputs = [record.index(name) for name in problem.model.inputs]
    size = np.abs(record.mean_spectrum[:, inputs]).max(axis=0)
    change = 1e-6 * size * (rng.standard_normal((len(record.harmonics), len(inputs), 2)) @ [1, 1j])
    change[record.harmonics == 0] = change[record.harmonics == 0].real
    spectra = record.spectra.copy()
    spectra[..., inputs] += change
    _, after = solve(replace(record, spectra=spectra))
    target = change @ posed.model.input_matrix.T
    expected = np.einsum("fkr,kr->f", before.gains[0], target).real
    scale = np.abs(before.values) * 1e-6
    np.testing.assert_allclose((after.values - before.values) / scale, expected / scale, atol=5e-3)


def test_a_driven_row_without_unknowns():
    """Row 1 is normalized and known altogether; the other starts from it all the same."""
    text = table(
        "t",
        ["x'' + 3*x' + 50*x = u", "m*y'' + k*(y - x) + 3*y' = 0"],
        coordinates={"x": "m", "y": "m"},
        inputs={"u": "N"},
        parameters={"m": "kg", "k": "N/m"},
    )
    truth = {"m": 2.0, "k": 700.0}

    def columns(p, grid):
        u = np.cos(grid.omega * grid.time) + np.cos(2 * grid.omega * grid.time)

        def stiffness(w):
            return np.array([[50 + 3j * w - w**2, 0], [-p.k, p.k + 3j * w - p.m * w**2]])

        q = line_response(grid, (1, 2), stiffness, np.column_stack([u, 0 * u]))
        return {"u": u, "x": q[:, 0], "y": q[:, 1]}

    problem = replace(
        TRAIN, text=text, truth=truth, columns=columns, harmonics=(1, 2), base=("m", "k")
    )
    for method in (Sequential, Batch):
        estimate = method().estimate(problem.model, problem.records)
        for name, value in truth.items():
            assert estimate.value(name) == pytest.approx(value, rel=1e-9)


def test_standstill_record_beside_a_turning_one():
    """Stages come from the structure, not from one record's data."""
    grids = (Grid(250, 5000.0), Grid(250, 5000.0, turns=7))
    problem = replace(THREE_MASS, grids=grids)
    for method in (Sequential, Batch):
        estimate = method().estimate(problem.model, problem.records)
        for name, value in problem.true_base.items():
            assert estimate.value(name) == pytest.approx(value, rel=1e-8)


def test_no_stage_at_all():
    """No input and no known term: nothing to start from."""
    text = table(
        "t",
        ["m*x'' + k*x = 0"],
        coordinates={"x": "m"},
        inputs={},
        parameters={"m": "kg", "k": "N/m"},
    )
    record = average(
        Record([Channel("x")], np.random.default_rng(4).standard_normal((60, 1)), 10.0),
        period_samples=20,
        harmonics=[1, 2],
    )
    estimate = Sequential().estimate(parse_model(text), [record])
    assert estimate.status == "not_identifiable"
    assert np.isnan([v.value for v in estimate.parameters]).all()
    assert any(w.startswith("not identifiable: m is in no row that") for w in estimate.warnings)
