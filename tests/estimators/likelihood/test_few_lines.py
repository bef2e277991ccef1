"""An unknown that a few lines of a closed loop tell has an unsure deviation."""

from types import SimpleNamespace

import numpy as np
import pytest
import test_spectra
from test_spectra import MODEL, TRUTH, levitated

import rotorid as rid
from rotorid import MaximumLikelihood
from rotorid.likelihood import doubts as few_lines
from rotorid.likelihood.doubts import told_by_few


def said(found: rid.Estimate) -> list[str]:
    return [text for text in found.warnings if " is told by " in text]


@pytest.mark.slow
def test_the_damping_of_a_short_record_under_control(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(test_spectra.TRUTH, "c", 90.0)
    short, long = (
        rid.identify(
            MODEL,
            rid.spectra(levitated(4, seconds), (2.0, 120.0), references=["r_x", "r_y"]),
            MaximumLikelihood(start={"m": 5.5, "c": 100.0, "k": 4.2e5}),
        )
        for seconds in (0.6, 3.0)
    )
    (told,) = said(short)
    assert told.startswith("c is told by ")
    hertz = float(told.partition("about ")[2].partition(" Hz")[0])
    assert hertz == pytest.approx(np.sqrt(TRUTH["k"] / TRUTH["m"]) / 2 / np.pi, rel=0.3)
    assert not said(long)


class Made:
    """A point and a record, as far as they are looked at."""

    def __init__(self, frequency: np.ndarray, parts: object) -> None:
        self.lines = type("Lines", (), {"frequency": frequency, "parts": parts})()


@pytest.mark.parametrize(
    ("count", "closed", "parts", "told"),
    [
        (9, 0.11, True, True),
        (10, 0.11, True, False),
        (9, 0.09, True, False),
        (9, 0.11, None, False),
    ],
)
def test_how_many_lines_are_few(
    monkeypatch: pytest.MonkeyPatch, count: int, closed: float, parts: object, told: bool
) -> None:
    record = Made(np.arange(100.0), parts)
    shares = np.zeros((100, 2, 3))
    shares[5 : 5 + count] = 0.5
    monkeypatch.setattr(few_lines, "coherence", lambda _: closed)
    names = [SimpleNamespace(name=name) for name in ("c", "xi", "gain[x]")]
    layout = SimpleNamespace(
        free=np.arange(3), held=np.arange(2), load_only=lambda: {1}, unknowns=names
    )
    point = SimpleNamespace(
        linear=SimpleNamespace(told_by=lambda: shares.reshape(200, 3).T),
        by_line=lambda rows: [rows.reshape(100, 2, 3)],
    )
    inference = SimpleNamespace(linear=SimpleNamespace(null=np.zeros((3, 0))))
    solution = SimpleNamespace(point=point, converged=True)
    fit = SimpleNamespace(solution=solution, inference=inference, layout=layout, records=[record])
    notes = told_by_few(fit)
    assert [note.on for note in notes] == [("c",)] * told
