"""Mistakes that are plain are told on a hundred lines, before thousands are searched."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from test_spectra import KNOWN, MODEL, levitated

import rotorid as rid
from rotorid.likelihood import rivals as plain
from rotorid.likelihood import solver
from rotorid.likelihood.problem import Point, Problem, Tangent
from rotorid.likelihood.starts import PLAIN_LINES

tangent = solver.tangent


def mistaken(exchanged: bool, factor: float) -> rid.Lines:
    """Return a thousand lines of a record whose sensors are exchanged, or one has another gain."""
    record = levitated(1)
    samples, (x, y) = record.samples.copy(), map(record.names.index, "xy")
    if exchanged:
        samples[:, [x, y]] = samples[:, [y, x]]
    samples[:, x] *= factor
    wrong = replace(record, samples=samples)
    return rid.spectra(wrong, (2.0, 200.0), references=["r_x", "r_y"])


@pytest.fixture(params=["swap[x, y]", "sign[x]"])
def term(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.slow
def test_what_is_plain_is_told_before_anything_is_searched(
    term: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines, steps = mistaken(term == "swap[x, y]", -1.0 if term == "sign[x]" else 1.0), []

    def counting(point: Point, *rest: object) -> Tangent:
        steps.append(len(point.records[0].problem.data))
        return tangent(point, *rest)

    monkeypatch.setattr(solver, "tangent", counting)
    monkeypatch.setattr(plain.RivalSearch, "trials", None)
    monkeypatch.setattr(plain, "searched", None)
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status == "rejected"
    assert term in [suspect.term for suspect in estimate.suspects]
    assert all(suspect.share == pytest.approx(1.0, abs=0.01) for suspect in estimate.suspects)
    assert "first suspect" in estimate.warnings[0]
    assert "of the 991 lines" in estimate.warnings[0]
    assert 991 not in steps
    for name, true in (("m", 5.0), ("k", 4e5)):  # those of the machine, not of the mistake
        assert estimate.value(name) == pytest.approx(true, rel=0.02)


@pytest.mark.slow
def test_what_no_single_mistake_explains_is_searched_on_a_hundred_lines(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Here two: sensors exchanged, one of them a quarter short."""
    lines, asked = mistaken(True, 0.25), []

    def counting(problem: Problem, *rest: object) -> object:
        asked.append(len(problem.likelihoods[0].data))
        return searched(problem, *rest)

    searched = plain.searched
    monkeypatch.setattr(plain, "searched", counting)
    monkeypatch.setattr(
        plain.RivalSearch, "trials", lambda _: iter([plain.Tried(0, 0, plain.Causes)])
    )
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status in ("rejected", "not_converged")
    assert len(asked) == 1
    assert asked[0] <= PLAIN_LINES == 100


@pytest.mark.parametrize(
    ("costs", "followed"),
    [((10.0, 19.9, 20.1), 2), ((10.0,) * 6, 4), ((10.0, 14.0, 16.0, 12.0, 11.0), 4)],
)
def test_which_mistakes_are_followed(costs: tuple[float, ...], followed: int) -> None:
    """Four at the most, screened within twice the lowest cost; those that explain are kept."""

    def changed(cost: float) -> SimpleNamespace:
        there = SimpleNamespace(point=SimpleNamespace(cost=cost), gross=False)
        return SimpleNamespace(screened=lambda: cost, settled=lambda way: there)

    mistakes = [SimpleNamespace(change=lambda _, cost=cost: changed(cost)) for cost in costs]
    found = plain._without_a_mistake(None, mistakes)
    assert [there.point.cost for _, there in found] == sorted(costs)[:followed]
