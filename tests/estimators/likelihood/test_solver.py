"""The solver: from far starts, where it turns over, ways beside the records, its linear form."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import scipy
from bank import agrees, steady
from commit import part_of
from model_text import model_text
from result_cases import fit, problem_of
from rotor_bank import SETTINGS, Case, rotor_case

from rotorid import MaximumLikelihood, identify, parse_model
from rotorid.likelihood import problem, solver
from rotorid.likelihood import starts as search
from rotorid.likelihood.linear import Linearized
from rotorid.likelihood.problem import Problem
from rotorid.likelihood.relations import Relations
from rotorid.likelihood.solver import Solution, solve
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models.knowledge import Knowledge
from rotorid.testing import bind_all

# The solver arrives: random rotors from far starts end where a start at the truth ends.


def at_truth(case: Case) -> Problem:
    return problem_of(case, {n: v for n, v in case.truth.items() if n not in case.fixed})


def from_truth(case: Case) -> Solution:
    problem = at_truth(case)
    return solve(problem, problem.layout.start, (0.0,))


def missed(case: Case) -> bool:
    known, records = Knowledge(case.fixed, start=case.start), bind_all(case.model, case.records)
    found = fit(case.model, records, known, Nuisances(), covariance="white").solution
    return not found.converged or found.point.cost > from_truth(case).point.cost + 1e-3


# Seeds that a solver without one of its parts missed: bent valleys, rows without excitation,
# starts from which only the bounded way or another start arrives.
HARD = [
    ("5 sensors, standstill, one axis at a time", 0),
    ("4 sensors, standstill, +-40 %", 6),
    ("4 sensors, standstill, +-40 %", 20),
    ("4 sensors, standstill, one axis at a time", 6),
    ("5 sensors, +-40 %", 8),
    ("4 sensors, +-60 %", 20),
    ("4 sensors, +-60 %", 23),
    ("8 sensors, +-60 %", 9),
]


@pytest.mark.sampled(1, parts=2)
@pytest.mark.parametrize(("setting", "seed"), HARD)
def test_arrives_where_it_is_hard(setting, seed):
    assert not missed(rotor_case(SETTINGS[setting], seed))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("setting", SETTINGS)
def test_arrives(setting):
    """Of four starts, one a commit; with 24 settings they are 96.

    A solver that loses 3.1 % of them passes all with 5 %. `python benchmarks/solver.py 300` counts
    more of them.
    """
    seeds = part_of((1, 100, 101, 102), 4)
    assert not [seed for seed in seeds if missed(rotor_case(SETTINGS[setting], seed))]


@pytest.mark.parametrize(("room", "kept"), [(2.0, True), (1.9, False)])
def test_the_last_points_are_evaluated_once(monkeypatch, room, kept):
    told = at_truth(rotor_case(next(iter(SETTINGS.values())), 0))
    x = told.layout.start
    first = told.best_at(x, 1.0)
    monkeypatch.setattr(problem, "KEPT", int(room * len(first.residual)))
    told.best_at(x)
    assert (told.best_at(x.copy(), 1.0) is first) == kept


@pytest.mark.slow
def test_two_ways_to_a_mass_of_nothing_do_not_agree(monkeypatch):
    """A cost to be believed for the time being is looked past: a further way finds the rotor."""
    case = rotor_case(SETTINGS["8 sensors, noise x 10"], 2)
    problem, right = at_truth(case), from_truth(case)
    unknowns = right.point.unknowns.copy()
    unknowns[problem.layout.index["m2"]] *= 1e-10
    ways = iter([replace(right, point=right.point.problem.best_at(unknowns, 0.0))] * 3)
    monkeypatch.setattr(search, "solve", lambda *way, **how: next(ways, right))
    found = search.searched(problem, problem.layout.start)
    assert found.point.cost == pytest.approx(right.point.cost)


@pytest.mark.parametrize(("gain", "arrived"), [(0.9e-3, True), (1.1e-3, False)])
def test_rounding_may_hide_a_thirtieth_of_a_deviation(monkeypatch, gain, arrived):
    right = from_truth(rotor_case(SETTINGS["8 sensors, noise x 10"], 2))
    walk = solver._Walk(right.point.problem, right.point.unknowns, bounded=False)
    monkeypatch.setattr(solver, "tangent", lambda *at: SimpleNamespace(decrease=gain))
    monkeypatch.setattr(walk, "_forward", lambda *step: (None, 1.0))
    assert walk.descend(0.0, tolerance=1e-10, limit=5)[1] is arrived
    assert not walk.descend(0.1, tolerance=1e-10, limit=5)[1]


def test_the_bank_agrees_with_the_model():
    """Made with numpy alone, its lines leave nothing but noise at the truth."""
    for setting in ("8 sensors, +-40 %", "4 sensors, standstill, one axis at a time"):
        problem = at_truth(rotor_case(SETTINGS[setting], 3))
        assert problem.at(problem.layout.start).cost < 2 * problem.real_equations


@pytest.mark.parametrize(
    ("lowest", "expected", "other", "same"),
    [
        # 809 000 where 292 is expected: rounded to some units of it on a rotor of many coordinates.
        (808988.3, 292.2, 809015.9, True),
        (808988.3, 292.2, 809016.5, False),
        (321.0, 292.2, 321.011, True),
        (321.0, 292.2, 321.013, False),
        (2e5, 1e5, 2e5 + 0.2, True),
        (2e5, 1e5, 2e5 + 0.21, False),
        (1e-9, 0.0, 9e-4, True),
    ],
)
def test_two_ways_led_to_the_same_cost(lowest, expected, other, same):
    inference = SimpleNamespace(expectation=SimpleNamespace(mean=expected))
    best = SimpleNamespace(point=SimpleNamespace(cost=lowest), inference=inference)
    assert search._agreed([(0, lowest), (1, other)], best) == same


# Where the solver turns over: how far it goes on, and what it takes for the same or for lost.


class Stairs:
    """A problem with a way down by even steps, so many to the minimum."""

    def __init__(self, steps: int, cost: float = 1e6, residuals: int = 1) -> None:
        self.steps, self.height, self.residuals = steps, cost, residuals
        self.granted: list[float] = []
        self.layout = SimpleNamespace(free=np.arange(1), start=np.zeros(1))
        self.layout.additive = np.zeros(1, dtype=bool)
        self.rigid, self.sketch, self.tolerance, self.exact = np.arange(1), None, 1e-10, ()

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
    def made(*stairs, **more):
        problem = Stairs(*stairs, **more)
        monkeypatch.setattr(solver, "anchored", lambda problem, start: problem)
        monkeypatch.setattr(solver, "tangent", problem.gradient)
        monkeypatch.setattr(solver, "_stepped", problem.stepped)
        return solver._Walk(problem, np.zeros(1), bounded=False)

    return made


@pytest.mark.parametrize(("promise", "tried"), [(1.1e-2, 25), (0.9e-2, 1)])
def test_a_screening_shortens_no_step_that_promises_a_thousandth(walk_down, promise, tried):
    """Of a cost of 10.0; elsewhere every step is shortened until it helps, if any does."""
    walk, lengths = walk_down(10, cost=10.0), list[float]()
    where = walk.problem.gradient(walk.problem.best_at(np.zeros(1)))
    where.promised = lambda along: promise
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver, "tangent", lambda *at: where)
        patch.setattr(solver, "_stepped", lambda point, where, along, *how: lengths.append(along))
        solver.few_steps(walk.problem, np.zeros(1), (10.0,), 1)
        assert len(lengths) == tried
        walk.descend(10.0, limit=1)
    assert len(lengths) == tried + 25


def test_a_homotopy_grants_each_stage_a_tenth_of_the_last_and_none_in_the_end(walk_down):
    problem = walk_down(0).problem
    found = solver._descended(problem, np.zeros(1), solver.STAGES, False)
    assert problem.granted == [10.0, 1.0, 0.1, 0.01, 0.0]
    assert len(found.trail) == 4


@pytest.mark.parametrize(("steps", "arrived"), [(199, True), (200, False)])
def test_the_last_stage_has_two_hundred_steps(walk_down, steps, arrived):
    walk = walk_down(steps)
    point, converged = walk.ended(walk.problem, 0.0, brief=False, near=True)
    assert converged == arrived
    assert point.unknowns[0] == steps


@pytest.mark.parametrize(
    ("steps", "first", "lost"), [(9, 1e-9, False), (10, 1e-9, True), (10, 2e-9, False)]
)
def test_a_way_ends_where_an_unknown_has_run_off(walk_down, steps, first, lost):
    """Beyond ten thousand million times its first start, or where this way began, here at 1e-9."""
    problem, start = walk_down(steps, cost=1e4).problem, np.full(1, 1e-9)
    problem.layout.start[:] = first
    assert (solver._descended(problem, start, solver.STAGES, False, brief=True) is None) == lost
    assert len(problem.granted) == steps + (1 if lost else 5)


@pytest.mark.parametrize(("spent", "goes_on"), [(999, True), (1000, False)])
def test_a_way_has_a_thousand_jacobians(walk_down, spent, goes_on):
    walk = walk_down(10)
    walk.iterations = spent
    walk.descend(0.0, tolerance=1e-10, limit=1)
    assert (walk.unknowns[0] > 0) == goes_on


@pytest.mark.parametrize(("each", "spent"), [(9.9, 101), (10.1, 61)])
def test_a_brief_way_is_left_after_sixty_jacobians_where_it_is_hopeless(walk_down, each, spent):
    """So many per residual; one that is not goes on, here to its minimum."""
    walk = walk_down(99, cost=100 * each, residuals=100)
    _, converged = walk.ended(walk.problem, 0.0, brief=True, near=True)
    assert converged == (each < 10)
    assert walk.iterations == spent


@pytest.mark.parametrize(("bends", "at_once"), [(4, True), (5, False)])
def test_four_steps_lead_back_to_the_floor_of_a_valley(walk_down, monkeypatch, bends, at_once):
    walk = walk_down(10)
    heights = [SimpleNamespace(cost=9.0 * 2.5**k) for k in range(bends + 1)]
    monkeypatch.setattr(solver, "_stepped", lambda *step: heights[-1])
    lower = iter(heights[-2::-1])
    monkeypatch.setattr(solver, "_across", lambda *step: next(lower))
    point = SimpleNamespace(cost=10.0, unknowns=np.zeros(1))
    where = SimpleNamespace(step=lambda radius: np.ones(1), promised=lambda along: 1.0)
    trial, radius = walk._forward(point, where, np.inf, worth=0.0)
    assert trial is not None
    assert (radius == 4.0) == at_once  # a step that is good at once makes the next one longer


@pytest.mark.parametrize(("effect", "held"), [(0.0, True), (0.9e-9, True), (1.1e-9, False)])
def test_what_a_step_to_a_bound_of_zero_leaves_is_zero(effect, held):
    """Exactly 0 and a value that moves no residual are one answer: at the bound, and determined.

    Of what moves them by more deviations of the noise the size counts, however small it is: with
    a scale that nothing tells, all masses and stiffnesses go towards zero together.
    """
    problem = at_truth(rotor_case(SETTINGS["8 sensors, +-40 %"], 0))
    free, unknowns = problem.layout.free.tolist(), problem.layout.start.copy()
    mass = problem.layout.index["m2"]
    unknowns[mass] = 0.0
    unknowns[mass] = effect / np.linalg.norm(problem.at(unknowns).jacobian[:, free.index(mass)])
    point = problem.at(unknowns)
    assert bool(solver.bounds_held(point)) == held
    assert point.linear.undetermined[free.index(mass)] != held


@pytest.mark.parametrize(("off", "same"), [(0.0099, True), (0.0101, False)])
def test_ways_join_within_a_hundredth_of_each_unknown_but_what_is_linear(off, same):
    problem = SimpleNamespace(rigid=np.array([0, 1]))
    one = np.array([1.0, -200.0, 5.0])
    for place in (0, 1):
        other = one.copy()
        other[place] *= 1 - off
        other[2] = -1.0
        assert solver._same(problem, one, other) == same
        assert solver._same(problem, other, one) == same


@pytest.mark.parametrize("open_", [False, True])
def test_gains_are_held_to_their_start_and_a_scale_that_nothing_tells_firmly(monkeypatch, open_):
    """A gain three tenths off is one deviation off; all unknowns by a hundredth together, too."""
    told = {"gain": True, "mass": False}
    unknowns = [SimpleNamespace(name=name, anchored=held) for name, held in told.items()]
    nothing = SimpleNamespace(joined=lambda rows: Relations(tuple(rows), 2))
    layout = SimpleNamespace(free=np.arange(2), unknowns=unknowns)
    problem = search.Problem(layout, nothing, nothing, nothing)
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
def test_only_a_way_of_the_same_stages_joins_another(monkeypatch, stages, joins):
    gone = []
    monkeypatch.setattr(solver, "_descended", lambda *way, brief: gone.append(way[4]))
    trail = (np.ones(1),)
    problem = SimpleNamespace(lowest=None)
    assert solver.elsewhere(problem, np.ones(1), SimpleNamespace(trail=trail), stages) is None
    assert gone == [trail if joins else ()]


# A mass behind its spring: the way to a minimum where both vanish is no lack of the records.


CHAIN = model_text(
    "Two masses in a row, the force on one, the sensor on the other",
    [
        "m1*x1'' + c1*x1' + k1*x1 + c2*(x1' - x2') + k2*(x1 - x2) = F",
        "m2*x2'' + c2*(x2' - x1') + k2*(x2 - x1) = 0",
    ],
    "x1 m, x2 m",
    "F N",
    "m1 2.5 kg, m2 1.3 kg, c1 20 N s/m, c2 4 N s/m, k1 1.7e5 N/m, k2 0.8e5 N/m",
)
MODEL = parse_model(CHAIN, name="chain")
TRUTH = {"m1": 2.0, "m2": 1.0, "c1": 25.0, "c2": 5.0, "k1": 2e5, "k2": 1e5}


def record_of(seed):
    force = 2.5 * np.exp(2j * np.pi * np.random.default_rng(1).random((19, 1)))
    noise, rng = {"F": 0.02, "x2": 2e-6}, np.random.default_rng(seed)
    return steady(MODEL, TRUTH, force, range(1, 20), sensors=["x2"], noise=noise, rng=rng)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(6))
def test_a_mass_that_is_hidden_behind_its_spring_is_found(seed):
    """From nominal values 20 to 30 % off; two of three ways of old ended at a misfit of 1000."""
    agrees(identify(MODEL, record_of(seed), MaximumLikelihood()), TRUTH)


@pytest.mark.slow
def test_where_noise_excludes_the_minimum_nothing_is_said_of_what_is_open(monkeypatch):
    """Without the further way: it did not arrive, and no parameter is to be fixed."""
    gone = search._gone

    def without(problem, way, best):
        if way.held:
            raise np.linalg.LinAlgError
        return gone(problem, way, best)

    monkeypatch.setattr(search, "_gone", without)
    found = [identify(MODEL, record_of(seed), MaximumLikelihood()) for seed in range(3)]
    lost = [estimate for estimate in found if estimate.status != "ok"]
    assert lost
    for estimate in lost:
        assert estimate.status == "not_converged"
        told = " ".join(estimate.warnings)
        assert "give a nearer start (nominal, start)" in told
        assert "positive = true, min, max" in told
        assert "scale together" not in told
        assert "cure: fix" not in told


@pytest.mark.parametrize(
    ("value", "kept"), [(10.1, False), (9.9, True), (0.11, True), (0.09, False)]
)
@pytest.mark.parametrize("start", [3.0, -3.0])
def test_unknowns_are_held_within_a_factor_of_ten(value, kept, start):
    known = SimpleNamespace(nuisance=False, name="m")
    nuisance = SimpleNamespace(nuisance=True, name="gain")
    layout = SimpleNamespace(free=np.arange(4), unknowns=[known, known, nuisance, known])
    none = Relations((), 4)
    problem = search.Problem(layout, none, none, none)
    object.__setattr__(problem, "affine", np.array([3]))
    held = search._within(problem, np.array([start, 0.0, 1.0, 1.0])).bounds
    inside = held.values(np.array([start * value, 50.0, 50.0, 50.0])) >= 0
    assert len(inside) == 2
    assert inside.all() == kept


# One factorization of the Jacobian, held against refits and brute force on random problems.


def linear_of(jacobian, residual, relations: int = 0, shifts: bool | list[bool] = False):
    """Return the linear form of a problem whose unknowns are of size one."""
    free = jacobian.shape[1]
    of = np.zeros((relations, free)), np.ones(free), np.full(free, shifts)
    return Linearized.of(jacobian, np.array(residual, dtype=float), *of)


def test_evidence_of_errors_is_the_ratio_of_normal_densities():
    rng = np.random.default_rng(3)
    jacobian, errors = rng.standard_normal((12, 3)), 2 * rng.standard_normal((12, 4))
    free = scipy.linalg.null_space(jacobian.T)  # what the unknowns leave
    residual = free @ (free.T @ (errors @ [1.0, -0.5, 0.3, 2.0] + rng.standard_normal(12)))
    found, seen = linear_of(jacobian, residual), free.T @ residual
    spread = np.eye(9) + (free.T @ errors) @ (free.T @ errors).T
    with_errors, without = (
        scipy.stats.multivariate_normal.logpdf(seen, cov=c) for c in (spread, np.eye(9))
    )
    bayes = 2 * (with_errors - without)
    sizes = np.abs((free.T @ errors).T @ np.linalg.solve(spread, seen))  # of the likeliest errors
    assert found.evidence(errors, 1.01 * sizes.max()) == pytest.approx(bayes)
    assert found.evidence(errors, 0.99 * sizes.max()) == -np.inf


ROWS, FREE = 60, 6
KINDS = ("plain", "related", "open", "open and related", "few rows")


class Random:
    """A linear problem: rows ``residual + jacobian @ change``, with relations and open directions.

    Columns differ in size by nine orders, as stiffnesses and dampings do.
    """

    def __init__(self, kind: str, seed: int) -> None:
        self.rng = np.random.default_rng([seed, KINDS.index(kind)])
        rows = 4 if kind == "few rows" else ROWS
        jacobian = self.rng.standard_normal((rows, FREE))
        if kind.startswith("open"):
            jacobian[:, 1] = jacobian[:, 0] - 2 * jacobian[:, 2]
        self.scale = 10.0 ** self.rng.uniform(-6, 3, FREE)
        self.jacobian = jacobian / self.scale
        self.residual = self.rng.standard_normal(rows)
        relations = self.rng.standard_normal((2 if kind.endswith("related") else 0, FREE))
        self.relations = relations / self.scale
        self.linear = self.of(self.jacobian, self.residual)
        right = np.linalg.svd(relations)[2]
        self.along = self.scale[:, None] * right[len(relations) :].T  # where no relation changes
        self.expected_rank = min(rows, FREE - len(relations) - kind.startswith("open"))
        if kind == "open and related":
            self.expected_rank += 1  # the relations tell what was open

    def of(self, jacobian: np.ndarray, residual: np.ndarray) -> Linearized:
        shifts = np.zeros(jacobian.shape[1], dtype=bool)
        missing = jacobian.shape[1] - FREE
        relations = np.pad(self.relations, ((0, 0), (0, missing)))
        typical = np.append(self.scale, np.ones(missing))
        return Linearized.of(jacobian, residual, relations, typical, shifts)

    def refit(self, columns: np.ndarray, rows: np.ndarray | slice = slice(None)) -> float:
        """Return the least cost with further columns, of some rows, along the relations."""
        matrix = np.column_stack([self.jacobian @ self.along, columns])[rows]
        residual = self.residual[rows]
        change = np.linalg.lstsq(matrix, -residual, rcond=1e-12)[0]
        return float(((residual + matrix @ change) ** 2).sum())


@pytest.fixture(params=[(kind, seed) for kind in KINDS for seed in range(4)], ids=str)
def made(request):
    return Random(*request.param)


def test_leverage_sums_to_the_rank(made):
    assert made.linear.rank == made.expected_rank
    assert made.linear.leverage.sum() == pytest.approx(made.expected_rank, rel=1e-9)
    shares = made.linear.told_by().sum(axis=1)
    assert shares == pytest.approx(np.ones(FREE), rel=1e-9)


@pytest.mark.sampled(8)
def test_the_covariance_is_that_of_least_squares_along_the_relations(made):
    inner = made.jacobian @ made.along
    expected = made.along @ np.linalg.pinv(inner.T @ inner, rcond=1e-10) @ made.along.T
    found = made.linear.root @ made.linear.root.T
    if made.linear.rank == made.along.shape[1]:  # what open directions add is a choice of units
        assert found == pytest.approx(expected, rel=1e-6)
    # Whatever is open, the change of the residual is that of the whole projection.
    hat = inner @ np.linalg.pinv(inner, rcond=1e-10)
    assert made.jacobian @ found @ made.jacobian.T == pytest.approx(hat, abs=1e-8)
    assert made.relations @ made.linear.root == pytest.approx(0.0, abs=1e-8)


def test_open_directions_change_neither_the_residual_nor_the_relations(made):
    null = made.linear.scale[:, None] * made.linear.null
    assert null.shape[1] == made.along.shape[1] - made.expected_rank
    for matrix in (made.jacobian, made.relations):
        assert matrix @ null == pytest.approx(0.0, abs=1e-8)


def test_which_unknowns_are_not_determined():
    """The first three make up one another's columns; with relations they need not."""
    assert Random("open", 0).linear.undetermined.tolist() == [True] * 3 + [False] * 3
    assert not Random("open and related", 0).linear.undetermined.any()
    assert Random("few rows", 0).linear.undetermined.all()
    assert not Random("plain", 0).linear.undetermined.any()


def test_a_score_is_the_drop_of_the_cost_of_a_refit(made):
    rows = len(made.residual)
    inside = made.jacobian @ made.along
    for count in (1, 3):
        columns = 1e5 * made.rng.standard_normal((rows, count))
        columns[:, 0] += 1e7 * inside @ made.rng.standard_normal(inside.shape[1])
        drop, change = made.linear.score(columns)
        before = made.refit(np.zeros((rows, 0)))
        assert drop == pytest.approx(before - made.refit(columns), rel=1e-6, abs=1e-9)
        if rows == ROWS:
            wide = made.of(np.column_stack([made.jacobian, columns]), made.residual)
            assert change == pytest.approx(-wide.taken(made.residual)[FREE:], rel=1e-6)


def test_columns_that_the_unknowns_take_over_lower_no_cost(made):
    columns = made.jacobian @ made.along @ made.rng.standard_normal((made.along.shape[1], 2))
    drop, _ = made.linear.score(columns)
    assert drop == pytest.approx(0.0, abs=1e-12)
    assert made.linear.rest(columns) == pytest.approx(0.0, abs=1e-8)
    change = made.linear.taken(columns)
    assert made.jacobian @ change == pytest.approx(columns, rel=1e-6, abs=1e-8)
    assert made.relations @ change == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("share", "drop"), [(0.9e-5, 0.0), (1.1e-5, 4.0)])
def test_a_column_that_is_taken_over_but_for_rounding_lowers_no_cost(share, drop):
    linear = linear_of(np.eye(3)[:, :1], [0, 2, 0])
    column = 7.0 * np.array([[np.sqrt(1 - share**2)], [share], [0.0]])
    assert linear.score(column)[0] == pytest.approx(drop)


def test_a_step_leads_to_the_least_squares(made):
    change = -made.linear.taken(made.residual)
    left = made.residual + made.jacobian @ change
    assert left @ left == pytest.approx(made.refit(np.zeros((len(left), 0))), rel=1e-9, abs=1e-12)
    assert made.linear.rest(made.residual) == pytest.approx(left, abs=1e-8)


@pytest.mark.parametrize("kind", KINDS[:-1])
def test_without_rows_is_the_cost_of_a_refit_without_them(kind):
    """At the minimum, where the residual is what the unknowns do not take over."""
    made = Random(kind, 7)
    made.residual = made.linear.rest(made.residual)
    linear = made.of(made.jacobian, made.residual)
    for first, last in pairwise((0, 4, 5, 25, 60)):
        rows = np.arange(first, last)
        kept = np.setdiff1d(np.arange(ROWS), rows)
        gained = linear.residual @ linear.residual - made.refit(np.zeros((ROWS, 0)), kept)
        assert linear.without(rows) == pytest.approx(gained, rel=1e-8)


def test_a_row_that_alone_tells_an_unknown_fits_itself():
    jacobian = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 2.0]])
    linear = linear_of(jacobian, [0, 2, -1])
    assert linear.without(np.array([0])) == 0.0
    assert linear.without(np.array([1])) == pytest.approx(5.0)  # the third row fits by itself


@pytest.mark.sampled(8)
def test_the_worst_of_what_is_unseen_is_found_by_brute_force(made):
    columns = 3 * made.rng.standard_normal((len(made.residual), 2))
    columns[:, 0] *= 0.02
    std, excess = made.scale * np.linspace(0.5, 2.0, FREE), 7.0
    std[4] = np.inf
    errors = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, np.pi, 20001)]).T
    left = made.linear.rest(columns)
    errors = errors / np.sqrt(1 + ((left @ errors) ** 2).sum(axis=0) / excess)
    worst = np.abs(made.linear.taken(columns) @ errors / std[:, None]).max(axis=1)
    unseen = made.linear.taken(columns) @ made.linear.unseen(columns, excess)
    assert np.linalg.norm(unseen / std[:, None], axis=1) == pytest.approx(worst, rel=1e-6)
    assert worst[4] == 0.0


def test_weighted_rows_are_those_of_a_weighted_jacobian(made):
    weights = made.rng.uniform(0.2, 1.0, len(made.residual))
    whole = made.of(weights[:, None] * made.jacobian, weights * made.residual)
    found = made.linear.determined.weighted(weights)
    fixed = ~made.linear.undetermined
    both = [(at.root @ at.root.T)[np.ix_(fixed, fixed)] for at in (found, whole)]
    assert both[0] == pytest.approx(both[1], rel=1e-6)
    assert found.leverage == pytest.approx(whole.leverage, abs=1e-8)


def test_what_counts_as_rounding():
    """A column by which nothing moves is none, unless it belongs to a shift."""
    jacobian = np.array([[1.0, 1e-13, 1e-13], [2.0, 1e-13, -1e-13], [0.0, 1e-13, 0.0]])
    found = linear_of(jacobian, [1, 1, 1], shifts=[False, False, True])
    assert found.undetermined.tolist() == [False, True, False]
    assert found.rank == 2
    coarse = linear_of(np.array([[2.0, 1.0], [1.0, 2.0]]), [1, 1])
    assert (coarse.rank, coarse.cut(0.5).rank) == (2, 1)


def test_a_derivative_beyond_all_bounds_is_no_information():
    with pytest.raises(np.linalg.LinAlgError, match="beyond all bounds"):
        linear_of(np.full((2, 1), 1e200), [1, 1], shifts=True)
    with pytest.raises(np.linalg.LinAlgError, match="without a free unknown"):
        linear_of(np.ones((2, 1)), [1, 1], relations=1, shifts=True)
