"""A line that something else fills is named, and only where nothing else explains the data."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from adverse_cases import CASES
from fitting import fit

from rotorid import MaximumLikelihood, identify
from rotorid.data.observation import bind
from rotorid.likelihood import rivals_records as line_leads
from rotorid.likelihood.case import Case
from rotorid.likelihood.preparation import Knowledge
from rotorid.likelihood.problem import Point
from rotorid.likelihood.relations import Relations
from rotorid.likelihood.unknowns import Nuisances


@pytest.fixture(scope="module")
def record(demo):
    quiet = replace(demo, force_noise=0.05, position_noise=5e-7)
    return quiet.noisy(demo.record(periods=60), np.random.default_rng(5))


def shaken(record, harmonic, size=2e-6):
    """Add a tone of one phase to all displacements along x."""
    spectra = record.spectra.copy()
    columns = [record.index(name) for name in ("x1", "x2", "x3")]
    spectra[:, list(record.harmonics).index(harmonic), columns] += size * np.exp(0.4j)
    return replace(record, spectra=spectra)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("harmonic", "hertz", "told"),
    [
        (3, 60, "where hum of the mains stands"),
        (5, 100, "where hum of the mains stands"),
        (11, 220, "which something else makes, such as a base that shakes"),
    ],
)
def test_a_line_that_something_else_fills_is_named(demo, record, harmonic, hertz, told):
    estimate = identify(demo.model, shaken(record, harmonic), MaximumLikelihood())
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == f"line {hertz} Hz"
    assert estimate.suspects[0].share > 0.99
    assert f"the line at {hertz} Hz, {told}" in estimate.warnings[0]
    assert "leave it out of the harmonics" in estimate.warnings[0]


def test_how_near_to_the_mains_a_line_is_theirs():
    assert line_leads.source(49.96).startswith("where hum")
    assert line_leads.source(49.9).startswith("which")
    assert line_leads.source(150.0) == line_leads.source(240.0) == line_leads.source(50.0)
    assert line_leads.source(0.01).startswith("which")


@pytest.mark.slow
def test_the_line_of_the_rotation_is_left_to_runout(demo, record):
    estimate = identify(demo.model, shaken(record, 7, 1e-5), MaximumLikelihood())
    assert estimate.status == "rejected"
    assert not any(s.term.startswith("line ") for s in estimate.suspects)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["no speed", "rad/s given as rpm", "runout of a sensor"])
def test_a_wrong_speed_is_no_odd_line(what):
    """Of the right speed's own line nothing is known then, and leaving it out would do as well."""
    (case,) = (c for c in CASES if c.what == what)
    for seed in range(2):
        assert not any(
            text.startswith("line ") and "below" not in text
            for text in (*case.run(100 + seed).said,)
        )


def test_the_drop_is_what_a_refit_without_the_line_gains(demo, record):
    bad = bind(demo.model, shaken(record, 3, 2e-8))
    found = fit(demo.model, [bad], Knowledge(), Nuisances())
    point = found.solution.point
    case = Case(found.problem, found.records, point.unknowns, found=point)
    drops = {line: drop for drop, _, line in line_leads._drops(case)}
    assert sorted(drops) == [0, 1, 2, 4, 5]  # not the rotation's, 140 Hz
    worst = max(drops, key=lambda k: drops[k])
    assert bad.lines.frequency[worst] == 60
    again = case.reading(lambda records: line_leads.without(records, 0, worst))
    assert case.point.cost - again.minimized().cost == pytest.approx(drops[worst], rel=0.02)


@pytest.mark.parametrize(("share", "told"), [(0.49, False), (0.51, True)])
def test_a_line_that_holds_half_of_the_misfit_is_one_too_many(monkeypatch, share, told):
    monkeypatch.setattr(line_leads, "_drops", lambda case: iter([(1e3 * share, 0, 1)]))
    lines = SimpleNamespace(frequency=np.array([20.0, 40.0]))
    point = SimpleNamespace(cost=1100.0)
    case = SimpleNamespace(records=[SimpleNamespace(lines=lines)], point=point, expected=100.0)
    assert len(list(line_leads._line(case))) == told


@pytest.mark.parametrize(
    ("hertz", "hum"),
    [
        (50.04, True),
        (50.06, False),
        (149.86, True),
        (59.95, True),
        (60.07, False),
        (180.1, True),
        (25.0, False),
        (30.0, False),
        (75.0, False),
        (90.0, False),
    ],
)
def test_lines_of_the_mains(hertz, hum):
    """A thousandth beside them, or on their multiples."""
    assert ("hum of the mains" in line_leads.source(hertz)) == hum


def test_lines_of_the_rotation_are_no_odd_ones():
    """The first three orders, from a quarter of the lines' distance on; and lines of no period."""
    frequency = 10.0 * np.arange(1, 13) - 2.4
    lines = SimpleNamespace(frequency=frequency, speed=np.full(12, 2 * np.pi * 30.0), scatter=1)
    at = SimpleNamespace(problem=SimpleNamespace(equations=1, lines=12), residual=np.ones(24))
    at.jacobian = lambda: np.zeros((24, 0))
    known = SimpleNamespace(jacobian=lambda *at: np.zeros((0, 0)))
    layout = SimpleNamespace(free=np.zeros(0, dtype=int), unknowns=())
    problem = SimpleNamespace(layout=layout, exact=Relations((), 0), known=known)
    none = np.zeros(0)
    point = Point(problem, none, [at], none)
    case = SimpleNamespace(records=[SimpleNamespace(lines=lines)], point=point)
    assert [line for *_, line in line_leads._drops(case)] == [0, 1, 3, 4, 6, 7, 9, 10, 11]
    lines.frequency = frequency - 0.2  # .26 of the distance
    assert len(list(line_leads._drops(case))) == 12


def test_a_line_that_is_left_out_weighs_a_millionth(demo, record):
    seen = bind(demo.model, record)
    (without,) = line_leads.without([seen], 0, 2)
    ratio = without.lines.covariance.matrices / seen.lines.covariance.matrices
    weight = 1 / np.sqrt(np.abs(ratio[:, 0, 0]))
    assert weight == pytest.approx([1, 1, 1e-6, 1, 1, 1])
