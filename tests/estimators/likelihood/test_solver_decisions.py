"""Where the solver turns over: how far it goes on, and what it takes for the same or for lost."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.likelihood import solver
from rotorid.likelihood.relations import Relations


class Stairs:
    """A problem with a way down by even steps, so many to the minimum."""

    def __init__(self, steps: int, cost: float = 1e6, residuals: int = 1) -> None:
        self.steps, self.height, self.residuals = steps, cost, residuals
        self.granted: list[float] = []
        self.layout = SimpleNamespace(free=np.arange(1))
        self.sketch, self.tolerance, self.exact = None, 1e-10, ()

    def best_at(self, unknowns, relaxation=0.0):
        self.granted.append(relaxation)
        cost, none = self.height - 1e-3 * unknowns[0], np.zeros(self.residuals)
        return SimpleNamespace(cost=cost, unknowns=unknowns, residual=none, problem=self)

    def gradient(self, point, bounded=False):
        down = 1e3 * (point.unknowns[0] < self.steps)
        return SimpleNamespace(decrease=down, step=lambda radius: np.ones(1))

    def stepped(self, point, *step):
        return self.best_at(point.unknowns + 1)


@pytest.fixture
def walk_down(monkeypatch):
    """Return a function that makes a way down stairs."""

    def made(*stairs, **more):
        problem = Stairs(*stairs, **more)
        monkeypatch.setattr(solver, "anchored", lambda problem, start: problem)
        monkeypatch.setattr(solver, "tangent", problem.gradient)
        monkeypatch.setattr(solver, "_stepped", problem.stepped)
        return solver._Walk(problem, np.zeros(1), bounded=False)

    return made


def test_a_homotopy_grants_each_stage_a_tenth_of_the_last_and_none_in_the_end(walk_down) -> None:
    problem = walk_down(0).problem
    found = solver._descended(problem, np.zeros(1), solver.STAGES, False)
    assert problem.granted == [10.0, 1.0, 0.1, 0.01, 0.0]
    assert len(found.trail) == 4


@pytest.mark.parametrize(("steps", "arrived"), [(199, True), (200, False)])
def test_the_last_stage_has_two_hundred_steps(walk_down, steps: int, arrived: bool) -> None:
    walk = walk_down(steps)
    point, converged = walk.ended(walk.problem, 0.0, brief=False, near=True)
    assert converged == arrived
    assert point.unknowns[0] == steps


@pytest.mark.parametrize(("spent", "goes_on"), [(999, True), (1000, False)])
def test_a_way_has_a_thousand_jacobians(walk_down, spent: int, goes_on: bool) -> None:
    walk = walk_down(10)
    walk.iterations = spent
    walk.descend(0.0, tolerance=1e-10, limit=1)
    assert (walk.unknowns[0] > 0) == goes_on


@pytest.mark.parametrize(("each", "spent"), [(9.9, 101), (10.1, 61)])
def test_a_brief_way_is_left_after_sixty_jacobians_where_it_is_hopeless(
    walk_down, each, spent
) -> None:
    """So many per residual; one that is not goes on, here to its minimum."""
    walk = walk_down(99, cost=100 * each, residuals=100)
    _, converged = walk.ended(walk.problem, 0.0, brief=True, near=True)
    assert converged == (each < 10)
    assert walk.iterations == spent


@pytest.mark.parametrize(("bends", "at_once"), [(4, True), (5, False)])
def test_four_steps_lead_back_to_the_floor_of_a_valley(
    walk_down, monkeypatch, bends, at_once
) -> None:
    walk = walk_down(10)
    heights = [SimpleNamespace(cost=9.0 * 2.5**k) for k in range(bends + 1)]
    monkeypatch.setattr(solver, "_stepped", lambda *step: heights[-1])
    lower = iter(heights[-2::-1])
    monkeypatch.setattr(solver, "_across", lambda *step: next(lower))
    point = SimpleNamespace(cost=10.0, unknowns=np.zeros(1))
    where = SimpleNamespace(step=lambda radius: np.ones(1))
    trial, radius = walk._forward(point, where, np.inf)
    assert trial is not None
    assert (radius == 4.0) == at_once  # a step that is good at once makes the next one longer


@pytest.mark.parametrize(("off", "same"), [(0.0099, True), (0.0101, False)])
def test_ways_join_within_a_hundredth_of_each_unknown_but_what_is_linear(off, same) -> None:
    problem = SimpleNamespace(rigid=np.array([0, 1]))
    one = np.array([1.0, -200.0, 5.0])
    for place in (0, 1):
        other = one.copy()
        other[place] *= 1 - off
        other[2] = -1.0
        assert solver._same(problem, one, other) == same
        assert solver._same(problem, other, one) == same


@dataclass
class Held:
    """A problem of two unknowns, the first a gain; what is known of them is what is asked."""

    layout: SimpleNamespace
    known: SimpleNamespace


@pytest.mark.parametrize("open_", [False, True])
def test_gains_are_held_to_their_start_and_a_scale_that_nothing_tells_firmly(monkeypatch, open_):
    """A gain three tenths off is one deviation off; all unknowns by a hundredth together, too."""
    unknowns = [
        SimpleNamespace(name="gain", anchored=True),
        SimpleNamespace(name="mass", anchored=False),
    ]
    nothing = SimpleNamespace(joined=lambda rows: Relations(tuple(rows), 2))
    problem = Held(SimpleNamespace(free=np.arange(2), unknowns=unknowns), nothing)
    monkeypatch.setattr(solver, "scale_is_open", lambda *at: open_)
    start = np.array([-2.0, 50.0])
    known = solver.anchored(problem, start).known
    assert known.values(start) == pytest.approx([0.0] * len(known))
    assert known.values(np.array([-2.6, 50.0]))[0] == pytest.approx(-1.0)
    if open_:  # of two unknowns, the sum of what each is off
        assert known.values(np.array([-2.0, 50.5]))[1] == pytest.approx(1.0)
    assert len(known) == 1 + open_


@pytest.mark.parametrize(
    ("stages", "joins"), [((10.0, 1.0, 0.1, 0.01, 0.0), True), ((0.1, 0.0), False)]
)
def test_only_a_way_of_the_same_stages_joins_another(monkeypatch, stages, joins) -> None:
    gone = []
    monkeypatch.setattr(solver, "_descended", lambda *way, brief: gone.append(way[4]))
    trail = (np.ones(1),)
    problem = SimpleNamespace(lowest=None)
    assert solver.elsewhere(problem, np.ones(1), SimpleNamespace(trail=trail), stages) is None
    assert gone == [trail if joins else ()]
