"""Deviations where the cost is no parabola: those of the interval, not of the curvature."""

from types import SimpleNamespace

import numpy as np
import pytest
from adverse import WRONG
from adverse_cases import CASES
from rotor_bank import SETTINGS, rotor_case

from rotorid.data.observation import bind_all
from rotorid.likelihood import other_answers as information
from rotorid.likelihood import other_answers as valley
from rotorid.likelihood import solver
from rotorid.likelihood.inference import infer
from rotorid.likelihood.preparation import Knowledge, prepare
from rotorid.likelihood.starts import searched


def problem_of(case):
    ready = prepare(case.model, Knowledge(case.fixed, start=case.start), (), False, {})
    return ready.of(bind_all(case.model, case.records)[:1])


def explored(name, seed):
    """Return names, the minimum and its valley."""
    problem = problem_of(rotor_case(SETTINGS[name], seed))
    solution = searched(problem, problem.layout.start)
    inference = solution.inference
    found = valley.explore(solution.point, inference, ~inference.linear.undetermined)
    names = [problem.layout.unknowns[i].name for i in problem.layout.free]
    return dict(zip(names, found.wider, strict=True)), solution, found


@pytest.mark.parametrize("name", ["4 sensors, +-40 %", "8 sensors, +-40 %"])
def test_over_a_parabola_deviations_hold(name):
    wider, _, found = explored(name, 1)
    assert max(wider.values()) < 1.05
    assert not found.falls


def test_a_load_whose_factor_may_vanish_is_hardly_known():
    """I_p is 2.1 deviations from I_t, whose difference stands before mu and eta."""
    wider, _, _ = explored("4 sensors, noise x 10", 4)
    assert min(wider["mu"], wider["eta"]) > 3
    assert max(w for name, w in wider.items() if name not in ("mu", "eta")) < 1.2


def test_a_lower_floor_is_found_and_followed():
    """From beside the minimum the valley leads to it, and the answer is the minimum."""
    case = rotor_case(SETTINGS["4 sensors, noise x 10"], 4)
    problem = problem_of(case)
    solution = searched(problem, problem.layout.start)
    inference = solution.inference
    size, along = np.linalg.eigh(
        inference.covariance / np.outer(inference.linear.scale, inference.linear.scale)
    )
    change = 1.5 * np.sqrt(size[-1]) * along[:, -1] * inference.linear.scale
    off = solver.beside(solution.point, change)
    assert off.cost > solution.point.cost + 0.5
    there = valley.explore(off, infer(off), np.ones(len(change), dtype=bool))
    assert there.falls
    assert there.lowest.cost < off.cost - 0.4
    ended = solver.Solution(off, True, 0)
    again, _, _ = information.questioned(problem, problem.layout.start, ended, infer(off))
    assert again.point.cost == pytest.approx(solution.point.cost, abs=1e-3)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("what", "seed", "called"),
    [
        ("at rest, equal forces", 8, "not_identifiable"),
        ("at rest, equal forces", 14, "ok"),
        ("a hundred times the noise", 5, "not_identifiable"),
    ],
)
def test_what_curvature_understates_is_widened_or_refused(what, seed, called):
    """By the deviations of the curvature these were 30, 7 and 17 off, and called ok."""
    found = next(case for case in CASES if case.what == what).run(seed, leads=False)
    assert found.status == called
    assert found.error < WRONG


def minimum(cost: float = 100.0, *unknowns: float, additive: bool = True) -> SimpleNamespace:
    """Return a point of a problem whose unknowns are shifts, or scale with themselves."""
    count = len(unknowns)
    layout = SimpleNamespace(
        free=np.arange(count), unknowns=[SimpleNamespace(additive=additive)] * count
    )
    problem = SimpleNamespace(layout=layout, affine=np.zeros(0, dtype=int), exact=())
    return SimpleNamespace(cost=cost, unknowns=np.array(unknowns), problem=problem)


def floors(monkeypatch, rise: float | None, step: float = 1.0, at: float = 0.0) -> list[float]:
    """Return the steps that are tried along a valley; each rises so much, or meets a wall."""
    tried: list[float] = []

    def beside(point, change):
        tried.append(float(change[0]))
        if rise is None:
            return None
        return minimum(point.cost + rise, point.unknowns[0] + change[0])

    monkeypatch.setattr(valley, "beside", beside)
    begin = minimum(100.0, at, additive=not at)
    list(valley._floor(begin, np.array([step]), np.ones(1)))
    return tried


def test_how_a_valley_is_followed(monkeypatch):
    assert floors(monkeypatch, 3.9) == [1.0] * 40
    assert floors(monkeypatch, 4.1) == [1.0, 0.25, 0.0625, 0.015625]
    # By half the value, and no step shorter than 1 / 64, which .05 / 4 is.
    assert floors(monkeypatch, None, at=1.6) == pytest.approx([0.8, 0.2, 0.05])
    assert floors(monkeypatch, None, at=1.4) == pytest.approx([0.7, 0.175, 0.04375])
    assert floors(monkeypatch, None, at=2.2) == pytest.approx([1.0, 0.25, 0.0625, 0.015625])


def walked(monkeypatch, *rises: float) -> tuple[list[np.ndarray], list[float], float]:
    """Return the changes that are followed, where loads are asked, and how wide the last is.

    Three unknowns of deviations 1, 2 and 3, of which each point moves two deviations on.
    """
    changes, ends = [], []

    def floor(point, change, unit):
        changes.append(change)
        for k, rise in enumerate(rises, 1):
            yield minimum(100.0 + rise, *(2.0 * k * unit))

    monkeypatch.setattr(valley, "_floor", floor)
    monkeypatch.setattr(valley, "_of_loads", lambda end, unit: ends.append(end.cost) or 0 * unit)
    inference = SimpleNamespace(covariance=np.diag([1.0, 4.0, 9.0]), std=np.array([1.0, 2.0, 3.0]))
    found = valley.explore(minimum(100.0, 0.0, 0.0, 0.0), inference, np.ones(3, bool))
    return changes, ends, found.wider[2]


def test_how_far_a_valley_is_followed(monkeypatch):
    changes, _, _ = walked(monkeypatch, 0.5)
    assert len(changes) == 4  # the two weakest directions, both ways, by half a deviation
    assert sorted(abs(changes[-1]).tolist()) == pytest.approx([0, 0, 1.5])
    for rises, end, wider in (
        ((0.9,), 100.9, 2.0),  # less than one deviation tells no width
        ((1.21,), 101.21, 2 / 1.1),
        ((3.9, 8.9), 103.9, 4 / np.sqrt(8.9)),  # loads are asked where the rise is likely
        ((3.9, 9.1), 103.9, 2 / np.sqrt(3.9)),
        ((2.0, 4.1), 102.0, 4 / np.sqrt(4.1)),
    ):
        _, ends, found = walked(monkeypatch, *rises)
        assert ends == [end] * 4
        assert found == pytest.approx(wider)
