"""The sentence that a report begins with, and what a page decides by itself."""

from dataclasses import replace

import numpy as np
import pytest
from severities import causes

from rotorid import Estimate, Misfit, Note, Prediction, Suspect, Value
from rotorid.answer.estimate import ChannelEvidence, Evidence, RecordEvidence
from rotorid.report import html
from rotorid.report.drawn import Axis, Curve, Panel, thinned
from rotorid.report.estimate_report import channel_ratios, verdict_of

ESTIMATE = Estimate(
    "jeffcott",
    "ml",
    "ok",
    (Value("m", "kg", 5.0, 0.01), Value("k", "N/m", 1e6, 10.0), Value("c", "N s/m", 1, 0, 0, True)),
    misfit=Misfit(80.0, 82.0, 80, 0.5),
    prediction={"F_x": Prediction(0.0012), "F_y": Prediction(0.0009), "F_z": None},
)


def channel(name: str, away: float, noise: float, unit: str = "N") -> ChannelEvidence:
    return ChannelEvidence(name, unit, (1.0, 1.0), (1.0, 1.0), (away, away), (noise, noise))


def shown(*channels: ChannelEvidence) -> Evidence:
    return Evidence(
        (RecordEvidence("run.h5", "periods", frequency_hz=(10.0, 20.0), channels=channels),)
    )


@pytest.mark.parametrize(
    ("p_value", "end"),
    [
        (0.5, ", as well as the noise allows."),
        (1e-4, ", though not as well as the noise allows (chance 0.0001): read what follows."),
    ],
)
def test_accepted_by_a_likelihood(p_value: float, end: str) -> None:
    found = verdict_of(ESTIMATE.with_(misfit=Misfit(80.0, 82.0, 80, p_value)))
    start = "Accepted: these 2 parameters explain 2 channels to 0.12 %"
    assert found.sentence == start + end
    assert (
        "nothing tells how well" in verdict_of(ESTIMATE.with_(misfit=Misfit(0, 0, 0, 1))).sentence
    )
    forces = ESTIMATE.with_(evidence=shown(channel("F_x", 1, 1), channel("F_y", 1, 1)))
    assert "explain 2 forces to" in verdict_of(forces).sentence


@pytest.mark.parametrize(
    ("away", "noise", "end"),
    [
        (1.4, 1.0, ", as well as the noise allows."),
        (9.0, 1.0, "; the rest is up to 9 times what noise makes."),
        (9.0, 0.0, "; nothing tells how much of the rest is noise."),
    ],
)
def test_accepted_without_a_likelihood(away: float, noise: float, end: str) -> None:
    found = ESTIMATE.with_(misfit=None, evidence=shown(channel("F_x", away, noise)))
    assert verdict_of(found).sentence.endswith(end)
    ((number, name, ratio),) = channel_ratios(found)
    assert (number, name) == (0, "F_x")
    assert ratio == pytest.approx(away / noise) if noise else np.isnan(ratio)


def test_a_prediction_that_noise_spoils_is_not_told() -> None:
    found = ESTIMATE.with_(prediction={"x": Prediction(0.75), "y": Prediction(0.2)})
    assert "explain 2 channels, as well as" in verdict_of(found).sentence


def test_what_stands_out() -> None:
    suspects = (Suspect("gain[x1]", 99.0, 0.987, 1.02, "1"), Suspect("delay[x1]", 3.0))
    found = ESTIMATE.with_(
        status="rejected",
        misfit=Misfit(820.0, 82.0, 80, 0.0),
        notes=(*causes(*suspects), Note("misfit", "rejects", "do")),
    )
    told = verdict_of(found)
    assert told.sentence == (
        "Rejected: the values below do not explain the records, whose misfit is 10 times what "
        "noise leaves. What stands out: gain[x1], which would explain 99 % of it (freed it comes "
        "to 1.02)."
    )
    assert told.steps == ("do",)
    weak = Suspect("runout[x1]", 9.0, 0.199, 1e-7, "m")
    none = verdict_of(found.with_(notes=causes(weak))).sentence
    assert none.endswith("No single cause explains 20 % of it.")
    alone = verdict_of(found.with_(notes=())).sentence
    assert alone.endswith("Nothing that was tried explains it alone.")


def test_what_is_left_open_comes_with_its_cure() -> None:
    left = [Note("not identifiable", "open", f"a{i} is not determined") for i in range(3)]
    cure = Note("not identifiable", "open", cure="fix a0")
    found = ESTIMATE.with_notes(*left, Note("record", "remarks", "note"), cure)
    assert found.status == "not_identifiable"
    assert found.warnings[-1] == "cure: fix a0"
    told = verdict_of(found)
    assert told.sentence == "Not identifiable: a0 is not determined, and 2 more combinations."
    assert told.steps == ("fix a0", "note")
    assert told.left_open == tuple(f"a{i} is not determined" for i in range(3))
    two = verdict_of(ESTIMATE.with_notes(*left[:2]))
    assert two.sentence == "Not identifiable: a0 is not determined; a1 is not determined."
    lost = verdict_of(ESTIMATE.with_notes(Note("search", "unfinished", "start nearer")))
    assert lost.sentence.startswith("Not converged: ")
    assert lost.steps == ("start nearer",)


def test_what_is_thinned_keeps_its_extremes() -> None:
    x = np.arange(10_000.0)
    y = np.sin(x)
    y[4321], y[4322] = 50.0, np.nan
    edge = Curve(x, y + 1, "band", look="band", base=np.where(x == 77, -9.0, 0.0))
    found = thinned(Panel(curves=(Curve(x, y, "a"), edge)), 100)
    line, band = found.curves
    assert len(line.x) <= 100
    assert line.y.max() == 50.0
    assert line.x[np.argmax(line.y)] == 4321
    assert band.base is not None
    assert (len(band.x), band.base.min()) == (50, -9.0)
    assert thinned(found, 100) == found or len(thinned(found, 100).curves[0].x) == len(line.x)


@pytest.mark.slow
def test_a_page_with_too_much_is_thinned_until_it_fits() -> None:
    rng = np.random.default_rng(1)
    many = [
        Panel("", Axis("t"), Axis("y"), (Curve(np.arange(4000.0), rng.standard_normal(4000), ""),))
        for _ in range(60)
    ]
    text = html.plots_text(many)
    assert 200_000 < len(text) <= html.MOST_DATA
    same = [replace(many[0], title=str(i)) for i in range(50)]
    assert len(html.plots_text(same)) < 3 * len(html.plots_text(many[:1]))  # a list stands once
