"""A trial mass at another angle than was said, and exchanged files: both named, with a cure."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from coast_down import RPM, coast, identify, write
from test_own_parameters import MODEL, TRIAL, text

from rotorid.likelihood import rivals_model as trial_leads
from rotorid.likelihood import rivals_records
from rotorid.likelihood.effects import Replaces
from rotorid.likelihood.unknowns import Scalar, Unknown, phase

SAT = np.degrees(np.angle(TRIAL))


def typed(trial: complex) -> str:
    """Return the experiment with another trial mass than the one that was there."""
    told = text().replace('"5e-5 kg m"', f'"{trial.real!r} kg m"')
    return told.replace('"20 g mm"', f'"{trial.imag!r} kg m"')


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(4)
    (tmp_path / "model.toml").write_text(MODEL)
    for name, trial in (("bare", 0.0), ("run", TRIAL)):
        noise = rng.standard_normal((2, len(RPM), 2)) * 1e-7
        write(tmp_path / f"{name}.csv", RPM, coast(RPM, trial) + noise[0] + 1j * noise[1])
    return tmp_path


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "trial",
    [-TRIAL, TRIAL.conjugate(), TRIAL * np.exp(1.2j)],
    ids=["on the other side", "counted the other way", "elsewhere"],
)
def test_a_trial_mass_at_a_wrong_angle(folder: Path, trial: complex) -> None:
    estimate = identify(folder, typed(complex(trial)))
    assert estimate.status != "ok"
    (found,) = [s for s in estimate.suspects if s.term == "trial mass[1]"]
    assert found.share is not None
    assert found.share > 0.999
    assert found.value == pytest.approx(np.angle(TRIAL), abs=0.02)
    first = estimate.warnings[0]
    assert "trial mass" in first
    assert "exchanged" in first
    assert "unknown" not in first


@pytest.mark.slow
def test_the_files_of_two_runs_exchanged(folder: Path) -> None:
    exchanged = text().replace("bare.csv", "other.csv").replace("run.csv", "bare.csv")
    estimate = identify(folder, exchanged.replace("other.csv", "run.csv"))
    told = estimate.warnings[0]
    assert "swap[record 0, record 1]" in {s.term for s in estimate.suspects[:2]}
    assert "exchanged" in told
    assert "unknown" not in told


def test_files_are_exchanged_of_six_pairs_that_state_something(monkeypatch) -> None:
    lines = SimpleNamespace(names=("x",), passive=True)
    records = [SimpleNamespace(lines=lines)] * 5
    given, asked = Scalar("t_x", "kg m", 1.0, 0.0), Scalar("t_x", "kg m", 1.0)
    own = [
        Unknown((u,), frozenset("t"), (Replaces(0, alone=False),), record=k)
        for k, u in ((0, given), (2, given), (4, asked))
    ]
    layout = SimpleNamespace(nuisances=own)
    case = SimpleNamespace(records=records, prepared=SimpleNamespace(layout=layout))
    found = list(rivals_records._exchanges(case))
    pairs = ["0, 1", "0, 2", "0, 3", "0, 4", "1, 2", "2, 3"]
    assert [lead.term for lead in found] == [
        f"swap[record {pair.replace(', ', ', record ')}]" for pair in pairs
    ]
    case.records, case.reading = [0, 1, 2, 3, 4], list
    assert found[3].change(case) == [4, 1, 2, 3, 0]


@pytest.mark.parametrize(("off", "found"), [(0.9e-9, True), (1.1e-9, False)])
@pytest.mark.parametrize("way", [1j, -1j])
def test_the_two_parts_of_a_trial_mass_lie_a_quarter_turn_apart(
    monkeypatch, off: float, found: bool, way: complex
) -> None:
    load = np.array([1.0, -1j])
    loads = {0: load, 1: way * load * (1 + off)}
    monkeypatch.setattr(trial_leads, "_columns", lambda case, parameters: loads)
    unknown = Scalar("t", "kg m", 1.0, 0.0)
    replaced = [(1, Replaces(k, False), k) for k in (0, 1)]
    layout = SimpleNamespace(
        base=False,
        replaced=replaced,
        load_only=lambda: {0, 1},
        unknowns=[unknown] * 2,
        start=np.array([1.0, 0.0]),
    )
    case = SimpleNamespace(prepared=SimpleNamespace(layout=layout))
    order = (0, 1) if way == 1j else (1, 0)
    assert list(trial_leads.trials(case)) == ([(1, *order)] if found else [])


@pytest.mark.parametrize("table", [True, False])
def test_what_is_told_of_a_turned_mark_can_be_done(monkeypatch, table: bool) -> None:
    """A table has no key that sets its phase free."""
    monkeypatch.setattr(rivals_records, "is_table", lambda record: table)
    monkeypatch.setattr(rivals_records, "later_phases", lambda records, starts: [(1, phase(1))])
    layout = SimpleNamespace(index={})
    case = SimpleNamespace(records=["bare", "run"], prepared=SimpleNamespace(layout=layout))
    (rival,) = rivals_records._angles(case)
    assert ('phase = "unknown"' in rival.added.cure) != table
