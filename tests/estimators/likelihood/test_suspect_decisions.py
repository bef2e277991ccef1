"""Where suspicion turns over: what is tried, what explains the data, what is a unit's factor."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rotorid.estimate_parts import Suspect
from rotorid.estimators.likelihood import leads, refits, suspects
from rotorid.estimators.likelihood.refits import Case
from rotorid.estimators.likelihood.shifts import Shift
from rotorid.estimators.likelihood.suspects import Finding, Option


def case_of(cost: float, records=()) -> Case:
    """Return what was estimated, at this cost."""
    return Case(SimpleNamespace(), records, SimpleNamespace(cost=cost, unknowns=np.zeros(1)))


def search_of(cost: float, records=()) -> suspects._Search:
    """Return the search for what is wrong where noise alone would leave a cost of 100."""
    return suspects._Search(None, case_of(cost, records), np.zeros(0), None, 100.0)


def finding(term: str, left: float, share: float = 1.0) -> Finding:
    """Return a suspect that leaves so much of the cost, or explains so much of the misfit."""
    return Finding(Suspect(term, 1e6 - left, share, 1.0, "kg"), left, term, "add it")


@pytest.mark.parametrize(("cost", "freed", "asked"), [(299.0, 8, 0), (301.0, 3, 1)])
def test_how_many_candidates_are_freed_before_mistakes_are_thought_of(
    monkeypatch, cost, freed, asked
) -> None:
    """Three where the misfit is three times what noise leaves; then mistakes are tried."""
    options = [Option(f"mass {k}", "kg") for k in range(12)]
    scored = [(o, Suspect(o.term, 50.0 - k, 0.5, 1.0, "kg")) for k, o in enumerate(options)]
    gone, mistakes = [], []
    search = suspects._Search
    monkeypatch.setattr(search, "options", lambda self: options)
    monkeypatch.setattr(search, "scored", lambda self, options: scored)
    monkeypatch.setattr(search, "freed", lambda self, option: gone.append(option.term) or [])
    monkeypatch.setattr(search, "mistakes", lambda self: mistakes.append(1) or [])
    for name in ("shifted", "mistaken_modes", "without_line", "without_bounds", "trial_masses"):
        monkeypatch.setattr(search, name, lambda self: [])
    for name in ("table_leads", "response_leads"):
        monkeypatch.setattr(suspects, name, lambda *case: [])
    found = search_of(cost).findings()
    assert gone == [f"mass {k}" for k in range(freed)]
    assert len(mistakes) == asked
    assert [f.suspect.term for f in found] == [f"mass {k}" for k in range(freed, 12)]


@pytest.mark.parametrize(("left", "explained"), [(299.0, True), (301.0, False)])
def test_what_leaves_three_times_as_much_as_noise_explains_nothing(left, explained) -> None:
    assert search_of(1e6).explained(finding("mass", left)) == explained


@pytest.mark.parametrize(
    ("best", "followed"), [(9.9, [9.9]), (10.1, [10.1, 100.0, 200.0, 300.0, 400.0])]
)
def test_which_mistakes_are_followed_after_the_screening(monkeypatch, best, followed) -> None:
    """One that leaves a hundredth, at once; where it explains the data the others stay. Else 5."""
    gone = []

    def trials(self):
        def follow(cost):
            return lambda: gone.append(cost) or [finding("swap", 100.0)]

        costs = (500.0, 200.0, 100.0, 300.0, 600.0, best, 400.0)
        yield iter([(None, cost, follow(cost)) for cost in costs])

    monkeypatch.setattr(suspects, "screened", lambda prepared, cost: cost)
    monkeypatch.setattr(suspects._Search, "_trials", trials)
    search_of(1e6, 1000.0).mistakes()  # the records as they are leave 1000
    assert gone == followed


class Besides(Shift):
    """A sensor that reads a share of something besides."""

    def column(self, case):
        return None

    def applied(self, records, share):
        return records


def test_five_steps_lead_to_what_a_sensor_reads_besides(monkeypatch) -> None:
    score = SimpleNamespace(drop=lambda column: (1.0, [0.25]))
    costs = iter(np.arange(1e3, 0.0, -1.0))
    monkeypatch.setattr(suspects._Score, "of", lambda point: score)
    monkeypatch.setattr(suspects, "minimized", lambda *at: case_of(next(costs)).point)
    (found,) = search_of(1e6).turned(Besides("plane[x]", "m", "x beside its plane", {}))
    assert found.suspect.value == pytest.approx(1.25)


@pytest.mark.parametrize(
    ("cost", "lines"), [(149.0, []), (151.0, [400]), (999.0, [400]), (1001.0, [100])]
)
def test_a_misfit_is_plain_from_one_and_a_half_times_what_noise_leaves(
    monkeypatch, cost, lines
) -> None:
    """Then a few hundred lines of a record tell suspects apart; a hundred where it is hopeless."""
    asked = []
    monkeypatch.setattr(suspects, "thinned", lambda records, few: asked.append(few) or records)
    monkeypatch.setattr(suspects, "minimized", lambda *at: SimpleNamespace(cost=cost, problem=fit))
    monkeypatch.setattr(suspects, "infer", lambda *at: SimpleNamespace(expectation=noise))
    fit, noise = SimpleNamespace(exact=()), SimpleNamespace(mean=100.0)
    found = suspects.on_fewer_lines(case_of(cost, ("record",)), 100.0)
    assert (asked if found else []) == lines


class Drawn:
    """A rotor that was reduced from one of so many coordinates."""

    def __init__(self, count: int) -> None:
        self.whole = SimpleNamespace(coordinates=range(count))


@pytest.mark.parametrize(("coordinates", "lines"), [(40, [625]), (124, [20]), (128, [])])
def test_the_whole_of_a_rotor_is_searched_on_as_many_lines_as_it_bears(
    monkeypatch, coordinates, lines
) -> None:
    asked = []
    point = SimpleNamespace(cost=1.0, problem=SimpleNamespace(exact=()))
    expectation = SimpleNamespace(mean=50.0)
    for name, stands in {
        "RotorModel": Drawn,
        "moved": lambda record, whole: record,
        "thinned": lambda records, few: asked.append(few),
        "physical_factors": lambda whole: (),
        "replace": lambda at, **changes: at,
        "minimized": lambda *at: point,
        "infer": lambda *at: SimpleNamespace(expectation=expectation),
    }.items():
        monkeypatch.setattr(suspects, name, stands)
    case = case_of(1e3, ("record",))
    case.prepared.layout = SimpleNamespace(model=Drawn(coordinates))
    found, expected = suspects.on_whole_rotor(case, 100.0)
    assert asked == lines
    assert (expected == 50.0) == (found is not case) == bool(lines)


def test_a_dozen_suspects_are_named(monkeypatch) -> None:
    found = [finding(f"mass {k}", 500.0 + k) for k in range(30)]
    monkeypatch.setattr(suspects._Search, "findings", lambda self: found)
    monkeypatch.setattr(suspects, "structure_of", lambda *at: None)
    named = suspects.find_suspects(None, np.zeros(0), case_of(1e6, ("record",)), 100.0).suspects
    assert [suspect.term for suspect in named] == [f"mass {k}" for k in range(12)]


@pytest.mark.parametrize(("share", "drop"), [(0.9e-10, 0.0), (1.1e-10, 4.0)])
def test_a_candidate_that_the_parameters_take_over_is_none(share, drop) -> None:
    """All but this share of its square, which is rounding."""
    score = suspects._Score(np.eye(3)[:, :1], np.array([0.0, 2.0, 0.0]))
    column = 7.0 * np.array([[np.sqrt(1 - share)], [np.sqrt(share)], [0.0]])
    assert score.drop(column)[0] == pytest.approx(drop)


@pytest.mark.parametrize(
    ("left", "alike"), [((100.0, 114.9), 2), ((100.0, 115.1), 1), ((200.0, 229.9), 2)]
)
def test_suspects_that_the_data_cannot_tell_apart(left, alike) -> None:
    """Costs within 15, times what is left over what noise leaves."""
    found = [finding(f"mass {k}", cost) for k, cost in enumerate(left)]
    assert len(suspects.alike(found, 100.0)) == alike


@pytest.mark.parametrize(("left", "tried"), [(114.9, 0), (115.1, 1)])
def test_a_bandwidth_is_tried_where_a_delay_leaves_a_misfit(monkeypatch, left, tried) -> None:
    lag = finding("bandwidth[F]", 100.0)
    monkeypatch.setattr(suspects._Search, "refitted", lambda self, option: lag)
    search = replace(search_of(1e6), model=SimpleNamespace(inputs=("F",)))
    late = replace(finding("delay[F]", left), suspect=Suspect("delay[F]", 1e5, 1.0, -1e-4, "s"))
    delay = SimpleNamespace(channels=frozenset({"F"}))
    assert search.lagging(delay, late) == [lag] * tried


@pytest.mark.parametrize(("share", "lead"), [(0.19, False), (0.21, True)])
def test_a_suspect_that_explains_a_fifth_is_a_lead(share, lead) -> None:
    told = suspects.sentence([finding("mass at x", 200.0, share)], 1e6, 100.0)
    assert ("first suspect: mass at x" in told) == lead
    assert ("none of the 1 suspects explains" in told) != lead


def test_half_a_right_angle_leads_to_where_a_record_begins() -> None:
    """From the angles that are tried, and from that of the mark itself."""
    asked = np.exp(1j * np.array([0.0, *suspects.BEGINNINGS]))
    every = np.exp(1j * np.deg2rad(np.arange(360.0)))
    away = np.degrees(np.abs(np.angle(every[:, None] / asked))).min(axis=1)
    assert away.max() < 23.0


def test_a_screening_grants_errors_as_large_as_the_forces_and_takes_six_steps(monkeypatch) -> None:
    granted, taken = [], []
    point = SimpleNamespace(unknowns=np.zeros(1), cost=1.0)
    monkeypatch.setattr(refits, "evaluated", lambda problem, x, at: granted.append(at) or point)
    monkeypatch.setattr(refits, "_step", lambda problem, at, much: taken.append(much) or point)
    monkeypatch.setattr(refits, "outside", lambda *at: ())
    assert refits._approached(SimpleNamespace(bounds=()), np.zeros(1)) == 1.0
    assert granted == [10.0, 1.0]
    assert taken == [10.0] * 6 + [1.0] * 6


@pytest.mark.parametrize(("left", "shares"), [(0.11, [1.0, 0.3, 0.1]), (0.09, [])])
def test_a_step_of_a_screening_is_made_shorter_twice(monkeypatch, left, shares) -> None:
    """And none is taken where a hundredth of the cost, here 10, is all that it would gain."""
    tried = []
    where = SimpleNamespace(decrease=left, step=lambda: 2.0, spread=lambda step: step, scale=None)
    monkeypatch.setattr(refits, "tangent", lambda *at: where)
    monkeypatch.setattr(refits, "evaluated", lambda problem, x, much: tried.append(x[0] / 2))
    problem = SimpleNamespace(exact=(), layout=SimpleNamespace(free=np.arange(1)))
    point = SimpleNamespace(unknowns=np.zeros(1), cost=10.0)
    assert refits._step(problem, point, 1.0) is None
    assert tried == pytest.approx(shares)


FACTORS = {
    25.4: "mil instead of um, um instead of mil, or inches instead of mm",
    1000.0: "mm instead of um, or mA instead of A",
    1e6: "m instead of um, or uA instead of A",
    57.29578: "degrees instead of radians",
    1.414214: "rms instead of amplitude",
    2.0: "peak to peak instead of amplitude",
    39.37008: "inches instead of m",
    0.2248089: "pounds-force instead of N",
    0.1019716: "kilograms-force instead of N",
    10.0: "ten times",
}


@pytest.mark.parametrize(("factor", "name"), FACTORS.items())
@pytest.mark.parametrize("inverse", [False, True])
def test_factors_of_units(factor, name, inverse) -> None:
    """Each within 3 %; between 9.807 and ten, the one that is nearer."""
    exact = 1 / factor if inverse else factor
    for off in (0.992, 1.008):
        assert leads.snap(-off * exact) == pytest.approx(-exact, rel=1e-6)
        assert leads.factor_name(off * exact) == f" ({name})"
    assert leads.factor_name(-exact) == f" ({name}, upside down)"


@pytest.mark.parametrize(
    ("gain", "exact"),
    [(-1.029, -1.0), (-1.031, None), (0.971, 1.0), (0.969, None), (26.15, 25.4), (26.17, None)],
)
def test_how_close_a_gain_is_to_that_of_a_unit(gain, exact) -> None:
    assert leads.snap(gain) == (None if exact is None else pytest.approx(exact))
    assert leads.factor_name(1.0) == ""
    assert leads.factor_name(-1.0) == " (upside down)"


@pytest.mark.parametrize(("times", "unlike"), [(4.9, False), (5.1, True), (1 / 5.1, True)])
def test_a_channel_unlike_the_others_of_its_kind(monkeypatch, times, unlike) -> None:
    monkeypatch.setattr(leads, "like_groups", lambda record: [["a", "b", "c"]])
    lines = SimpleNamespace(names=("a", "b", "c"), mean=np.array([[1j, 1.0, times], [1, -1, 0]]))
    lines.mean[1, 2] = times
    found = leads.typical_factors(SimpleNamespace(lines=lines))
    assert found == pytest.approx({"a": 1.0, "b": 1.0, "c": 1 / times if unlike else 1.0})


def test_speeds_that_were_mistaken() -> None:
    """Of a rotor that is said to turn at 100 rad/s: what is right instead, either way round."""
    record = SimpleNamespace(lines=SimpleNamespace(speed=np.full(3, 100.0)))
    found = {(lead.said, round(lead.value, 3)) for lead in leads._speeds([record], {})}
    right = {
        "rad/s taken for rpm": 954.930,
        "rpm taken for rad/s": 10.472,
        "Hz taken for rpm": 6000.0,
        "rpm taken for Hz": 1.667,
        "rad/s taken for Hz": 15.915,
        "Hz taken for rad/s": 628.319,
        "twice the true one": 50.0,
        "half the true one": 200.0,
    }
    assert found == {
        ("the rotor turning the other way", -100.0),
        *((f"the speed {said}", speed) for said, speed in right.items()),
        *((f"the speed {said}, and its direction reversed", -v) for said, v in right.items()),
    }


@pytest.mark.parametrize(("channels", "swaps"), [(8, 28), (9, 8)])
def test_swaps_of_many_like_channels_are_those_of_neighbours(monkeypatch, channels, swaps) -> None:
    names = [f"x{k}" for k in range(channels)]
    monkeypatch.setattr(leads, "like_groups", lambda record: [names])
    single, several = leads._swaps(None, [])
    assert (len(single), several) == (swaps, [])
