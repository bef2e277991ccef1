"""The text of results, and the verdict on them."""

from dataclasses import replace

import numpy as np
import pytest
from severities import causes

from rotorid import (
    Alternative,
    Estimate,
    LineMisfit,
    Misfit,
    Note,
    Prediction,
    Suspect,
    Unbalance,
    Value,
)
from rotorid.answer.estimate import page
from rotorid.answer.parts import ChannelEvidence, Evidence, RecordEvidence
from rotorid.answer.predict import ChannelError
from rotorid.core.tables import page_text
from rotorid.report import html
from rotorid.report.drawn import Axis, Curve, Panel, thinned
from rotorid.report.estimate_report import validation_table, verdict_of

# What a user reads after a fit.


REMARK = "the rotation is not <synchronous> [bold]with[/bold] the excitation"
ESTIMATE = Estimate(
    "three-mass",
    "ml",
    "rejected",
    (
        Value("m1", "kg", 0.83339, 0.0021, 0.0042),
        Value("k1", "N/m", 883570.0, 1000.0, 2000.0),
        Value("I_p", "kg m^2", 0.048275, 2.1e-5, 4.2e-5),
        Value("ratio", "1", -12.0, 0.5, 1.0),
        Value("xi", "m", 0.0, 1e-7, 2e-7),
        Value("L1", "m", 0.3, 0.0, 0.0, fixed=True),
        Value("mu", "rad", 7.4e-5),
    ),
    nuisance=(Value("gain[x1]", "1", 1.01, 0.005),),
    derived=(Value("m1", "kg", 0.83339, 0.0021), Value("k1*L1", "N", 265071.0, 300.0)),
    misfit=Misfit(1053.2, 84.2, 82, 1e-9),
    notes=(
        *causes(Suspect("damping k1", 96000.0), Suspect("x/y asymmetry of k1", 8319.0)),
        Note("record", "remarks", REMARK),
    ),
    prediction={"F_x1": Prediction(0.00412), "F_y1": None},
    lines_hz=(20.0, 60.0, 220.0),
    periods=260,
    condition_number=25.99,
)


def test_numbers_show_two_digits_of_noise():
    rows = {line.split()[0]: line.split() for line in str(ESTIMATE).splitlines() if line}
    assert rows["parameters"] == ["parameters", "value", "std", "std", "%", "inflated", "unit"]
    assert rows["ratio"] == ["ratio", "-12.00", "0.50", "4.2", "1.0"]
    assert rows["xi"][1:] == ["0", "1.0e-07", "2.0e-07", "m"]
    assert rows["I_p"] == ["I_p", "0.048275", "2.1e-05", "0.044", "4.2e-05", "kg", "m^2"]
    assert rows["k1"] == ["k1", "883600", "1000", "0.11", "2000", "N/m"]
    assert rows["L1"] == ["L1", "0.3", "fixed", "m"]
    assert rows["mu"] == ["mu", "7.4e-05", "-", "rad"]
    assert rows["gain[x1]"] == ["gain[x1]", "1.0100", "0.0050", "0.50"]
    assert rows["k1*L1"] == ["k1*L1", "265070", "300", "0.11", "N"]


def test_what_there_is_to_say():
    text = str(ESTIMATE)
    assert text.startswith("three-mass, ml: rejected\n")
    for note in (
        "misfit 1053; 84.2 expected from noise (82 degrees of freedom), p = 1e-09",
        "relative prediction error: F_x1 0.412 %, F_y1 zero",
        "suspect              misfit reduction",
        "damping k1                      96000",
        "260 periods, 3 lines from 20 to 220 Hz",
        "condition number 25.99",
        "inflated: std as if all of the misfit were noise",
        f"warning: {REMARK}",
    ):
        assert note in text.splitlines()
    assert text.count("m1 ") == 1  # derived from itself: said once
    assert "suspect" not in str(ESTIMATE.with_(status="ok"))


def test_a_misfit_without_degrees_of_freedom_judges_nothing():
    text = str(ESTIMATE.with_(misfit=Misfit(5.662e6, 0.0, 0, 1.0)))
    assert "misfit 5.662e+06, no degrees of freedom" in text.splitlines()


def test_inflated_deviations_show_only_where_they_differ():
    same = Estimate("one", "ls", "ok", (Value("m", "kg", 1.0, 0.1, 0.1),))
    assert "inflated" not in str(same)


def test_notebook():
    html = ESTIMATE._repr_html_()
    assert html.count("<table>") == html.count("</table>") == 4
    assert ">883600</td>" in html
    assert "&lt;synchronous&gt;" in html
    assert "<synchronous>" not in html


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e-300, -1e300, 0.0])
@pytest.mark.parametrize("std", [None, 0.0, np.nan, np.inf, 1e-300, 1e300])
def test_any_number_can_be_shown(value, std):
    assert str(Estimate("one", "ls", "not_identifiable", (Value("m", "kg", value, std, std),)))


def test_predictions():
    first = [ChannelError("F", 0.0405, 0.04, 0.31, 0.01), ChannelError("G", None, None, None)]
    second = [ChannelError("F", 0.0516, 0.002, 1e-9, 0.001)]
    assert [line.split()[:6] for line in validation_table([first]).text().splitlines()[1:]] == [
        ["F", "4.05", "4", "1", "0.31", "predicted"],
        ["G", "zero"],
    ]
    lines = validation_table([first, second]).text().splitlines()
    assert lines[3].split() == ["F,", "record", "2", "5.16", "0.2", "0.1", "1e-09", "fails"]


@pytest.mark.parametrize("intervals", [False, True])
def test_an_angle_that_may_be_any_is_not_told(intervals):
    """Of an unbalance that may as well be none: 30 g mm about zero."""
    planes = [Unbalance("q_x, q_y", "kg m", 3e-11, 1.0, 3e-5, std) for std in (1.57, 1.58)]
    shown = page_text(page(ESTIMATE.with_(unbalance=tuple(planes)), intervals=intervals))
    known, free = (line for line in shown.splitlines() if line.startswith("q_x, q_y"))
    assert "any" not in known
    assert free.rstrip().endswith("any")
    assert "any" not in shown.replace(free, "").partition("unbalance")[2]


def test_suspects_with_what_they_explain():
    gain = Suspect("gain[x2]", 260.0, 0.987, 1.02, "1")
    length = Suspect("prior L1", 3.0, 0.01, 0.305, "m")
    lines = str(ESTIMATE.with_(notes=causes(gain, length))).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("suspect"))
    assert lines[start + 1].split() == ["gain[x2]", "260", "98.7", "1.02"]
    assert lines[start + 2].split() == ["prior", "L1", "3", "1", "0.305", "m"]
    nothing = replace(length, share=0.0009)
    assert "prior L1" not in str(ESTIMATE.with_(notes=causes(gain, nothing)))
    assert "prior L1" in str(ESTIMATE.with_(notes=causes(gain, replace(length, share=0.0011))))


def test_other_answers_stand_beside_this_one():
    other = Alternative(26.0, (("m1", 0.9), ("L1", 0.4)))
    lines = str(ESTIMATE.with_(alternatives=(other,))).splitlines()
    start = lines.index("other answers     this  no. 1")
    assert [line.split() for line in lines[start + 1 : start + 4]] == [
        ["m1", "0.83339", "0.9"],
        ["L1", "0.3", "0.4"],
        ["misfit", "1053", "26"],
    ]


def test_checks_that_are_not_simply_right_are_shown():
    checks = (
        Note("dead", "says", "3 samples alike in 100", on=("x1",)),
        Note("clipping", "passes", "none", on=("y1",)),
    )
    text = str(ESTIMATE.with_(notes=checks))
    assert "note, dead of x1: 3 samples alike in 100" in text.splitlines()
    assert "clipping" not in text


@pytest.mark.parametrize(("p_value", "shown"), [(0.009, True), (0.011, False)])
def test_where_the_misfit_lies_is_told_below_one_in_a_hundred(p_value, shown):
    lines = tuple(LineMisfit(0, 10.0 * i, 20.0 - i, 12.0) for i in range(1, 12))
    text = str(ESTIMATE.with_(misfit=Misfit(99.0, 84.2, 82, p_value), line_misfit=lines))
    assert ("misfit by line" in text) == shown
    if shown:
        assert "80 Hz" in text  # eight, what a screen holds
        assert "90 Hz" not in text


def test_intervals_on_request():
    shown = page_text(ESTIMATE.summary(intervals=True))
    rows = {line.split()[0]: line.split() for line in shown.splitlines() if line}
    assert rows["parameters"] == ["parameters", "value", "95", "%", "from", "to", "unit"]
    # 1.96 of the inflated deviations where there are such: 2e-7, 2 * 1.0, ...
    assert rows["xi"] == ["xi", "0.00000000", "-0.00000039", "0.00000039", "m"]
    assert rows["ratio"] == ["ratio", "-12.0", "-14.0", "-10.0"]
    assert rows["gain[x1]"] == ["gain[x1]", "1.0100", "1.0002", "1.0198"]
    assert rows["L1"] == ["L1", "0.3", "fixed", "m"]
    assert rows["mu"] == ["mu", "7.4e-05", "-", "-", "rad"]


def test_unbalance_in_the_units_of_a_balancer():
    planes = (
        Unbalance("x2, y2", "kg m", 2e-4, np.pi / 3, 1e-7, 1e-3),
        Unbalance("theta_x, theta_y", "kg m^2", 3.4e-6, -np.pi / 2),
    )
    found = ESTIMATE.with_(unbalance=planes)
    rows = [line.split() for line in str(found).splitlines()]
    assert ["x2,", "y2", "200.00", "0.10", "g", "mm", "60.000", "0.057"] in rows
    assert ["theta_x,", "theta_y", "3400", "-", "g", "mm^2", "-90", "-"] in rows
    ends = page_text(found.summary(intervals=True)).splitlines()
    told = "x2, y2 200.00 199.80 200.20 g mm 60.000 59.888 60.112"
    assert told in [" ".join(line.split()) for line in ends]


PAIRS = {(0, 1): 0.951, (1, 2): -0.99, (2, 3): 0.949}
MANY = {(i, j): 0.97 for j in range(4) for i in range(j)}


@pytest.mark.parametrize(
    ("names", "correlations", "said"),
    [
        ("abcd", PAIRS, "b with c -0.990, a with b +0.951"),
        ("abcde", MANY, "in combination: a, b, c, d, up to 0.970"),
    ],
)
def test_parameters_known_together_are_named_once(names, correlations, said):
    values = tuple(Value(name, "kg", 1.0, 0.1) for name in names)
    correlation = np.eye(len(names))
    for (i, j), r in correlations.items():
        correlation[i, j] = correlation[j, i] = r
    found = Estimate("m", "ml", "ok", values, covariance=0.01 * correlation)
    (note,) = (text for text in found.page if str(text).startswith("strongly correlated"))
    assert note.endswith(said)


def test_what_matters_stands_first():
    text = str(ESTIMATE)
    places = [text.index(word) for word in ("parameters", "nuisance", "suspect", "derived")]
    assert places == sorted(places)
    batch = str(ESTIMATE.with_(method="batch"))  # the physical ones are derived there
    assert batch.index("derived") < batch.index("nuisance")


def test_sentences_break_between_words():
    sentence = "warning: " + "some words " * 20
    lines = page_text([sentence.strip()], 40).splitlines()
    assert max(map(len, lines)) <= 40
    assert all(line.startswith("  ") for line in lines[1:])
    assert page_text([sentence.strip()]) == sentence.strip()
    assert " ".join(line.strip() for line in lines) == sentence.strip()


# The sentence that a report begins with, and what a page decides by itself.


JUDGED = Estimate(
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
    record = RecordEvidence("run.h5", "periods", frequency_hz=(10.0, 20.0), channels=channels)
    return Evidence((record,))


@pytest.mark.parametrize(
    ("p_value", "end"),
    [
        (0.5, ", as well as the noise allows."),
        (1e-4, ", though not as well as the noise allows (chance 0.0001): read what follows."),
    ],
)
def test_accepted_by_a_likelihood(p_value, end):
    found = verdict_of(JUDGED.with_(misfit=Misfit(80.0, 82.0, 80, p_value)))
    start = "Accepted: these 2 parameters explain 2 channels to 0.12 %"
    assert found.sentence == start + end
    assert "nothing tells how well" in verdict_of(JUDGED.with_(misfit=Misfit(0, 0, 0, 1))).sentence
    forces = JUDGED.with_(evidence=shown(channel("F_x", 1, 1), channel("F_y", 1, 1)))
    assert "explain 2 forces to" in verdict_of(forces).sentence


@pytest.mark.parametrize(
    ("away", "noise", "end"),
    [
        (1.4, 1.0, ", as well as the noise allows."),
        (9.0, 1.0, "; the rest is up to 9 times what noise makes."),
        (9.0, 0.0, "; nothing tells how much of the rest is noise."),
    ],
)
def test_accepted_without_a_likelihood(away, noise, end):
    found = JUDGED.with_(misfit=None, evidence=shown(channel("F_x", away, noise)))
    assert verdict_of(found).sentence.endswith(end)


def test_a_prediction_that_noise_spoils_is_not_told():
    found = JUDGED.with_(prediction={"x": Prediction(0.75), "y": Prediction(0.2)})
    assert "explain 2 channels, as well as" in verdict_of(found).sentence


def test_what_stands_out():
    suspects = (Suspect("gain[x1]", 99.0, 0.987, 1.02, "1"), Suspect("delay[x1]", 3.0))
    found = JUDGED.with_(
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


def test_what_is_left_open_comes_with_its_cure():
    left = [Note("not identifiable", "open", f"a{i} is not determined") for i in range(3)]
    cure = Note("not identifiable", "open", cure="fix a0")
    found = JUDGED.with_notes(*left, Note("record", "remarks", "note"), cure)
    assert found.status == "not_identifiable"
    assert found.warnings[-1] == "cure: fix a0"
    told = verdict_of(found)
    assert told.sentence == "Not identifiable: a0 is not determined, and 2 more combinations."
    assert told.steps == ("fix a0", "note")
    assert told.left_open == tuple(f"a{i} is not determined" for i in range(3))
    two = verdict_of(JUDGED.with_notes(*left[:2]))
    assert two.sentence == "Not identifiable: a0 is not determined; a1 is not determined."
    lost = verdict_of(JUDGED.with_notes(Note("search", "unfinished", "start nearer")))
    assert lost.sentence.startswith("Not converged: ")
    assert lost.steps == ("start nearer",)


def test_what_is_thinned_keeps_its_extremes():
    x = np.arange(10_000.0)
    y = np.sin(x)
    y[4321], y[4322] = 50.0, np.nan
    edge = Curve(x, y + 1, "band", look="band", base=np.where(x == 77, -9.0, 0.0))
    found = thinned(Panel(curves=(Curve(x, y, "a"), edge)), 100)
    line, band = found.curves
    assert len(line.x) <= 100
    assert line.y.max() == 50.0
    assert line.x[np.argmax(line.y)] == 4321
    assert (len(band.x), band.base.min()) == (50, -9.0)
    assert thinned(found, 100) == found or len(thinned(found, 100).curves[0].x) == len(line.x)


@pytest.mark.slow
def test_a_page_with_too_much_is_thinned_until_it_fits():
    rng = np.random.default_rng(1)
    many = [
        Panel("", Axis("t"), Axis("y"), (Curve(np.arange(4000.0), rng.standard_normal(4000), ""),))
        for _ in range(60)
    ]
    assert 200_000 < len(html.plots_text(many)) <= html.MOST_DATA
