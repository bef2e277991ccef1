"""Pages as HTML, and in a browser."""

import base64
import json
import re
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from browser import browser
from report_pages import Page, titles
from severities import causes
from working_folder import shaken

import rotorid as rid
from rotorid.answer.parts import Evidence, Prior, SourceFile
from rotorid.answer.predict import ChannelError
from rotorid.demo import TABLE, demo_report, findings, run_demo
from rotorid.report.estimate_report import (
    estimate_report,
    groups,
    relations,
    validation_report,
)
from rotorid.report.html import Passage
from rotorid.report.machines import sensitivity_report
from rotorid.results.evidence import record_evidence
from rotorid.results.sensitivity import AxisSensitivity

# Reports: self-contained, well-formed, true to the figures, proof against hostile names.


HOSTILE = "</title><script>alert(1)</script>${{ 7*7 }} $x_{$ & \"'>\n\u65e5"


@pytest.fixture(scope="module")
def demo():
    return run_demo(2, rng=np.random.default_rng(3))


@pytest.fixture(scope="module")
def model():
    return rid.load_model("jeffcott")


@pytest.fixture(scope="module")
def demo_page(demo):
    return Page(demo_report(demo))


def record(noise: float = 0.01, periods: int = 40) -> rid.PeriodicRecord:
    motion = shaken(periods=periods, speed=40 * np.pi, noise=noise)
    return rid.average(motion, 10.0, harmonics=[1, 2, 5])


@pytest.fixture(scope="module")
def periods():
    return record()


@pytest.fixture(scope="module")
def estimate(model, periods):
    return gathered(model, periods)


def gathered(model: rid.Model, *periods: rid.PeriodicRecord) -> rid.Estimate:
    method = rid.LeastSquares()
    return rid.with_evidence(rid.identify(model, periods, method), model, periods, method)


@pytest.fixture(scope="module")
def of_no_machine(estimate):
    """The same of a model that nobody knows: nothing is drawn but what the result holds."""
    return estimate.with_(evidence=None, model="mine", provenance=None)


def test_demo_report_holds_table_and_findings(demo, demo_page):
    assert len(demo_page.plots) == 1
    words = demo_page.words
    first, *others = findings(demo)
    assert words.index(first) < words.index("What the figures show")
    assert " ".join(" ".join(others).split()) in words
    text = "".join(demo_page.text.split())
    for row in TABLE:
        index = demo.names.index(row.base)
        figures = [demo.bound_percent, demo.rms("ml"), *map(demo.rms, [*demo.values][:4])]
        shown = "".join(f"{each[index]:.3f}" for each in figures)
        assert "".join(row.base.split()) + shown in text


def test_estimate_report_shows_the_estimate(estimate, model):
    page = Page(estimate_report(estimate))
    assert titles(page) == [
        "Response of x to F_x",
        "Residual over time",
        "Measured and predicted by frequency",
        "Residual by frequency",
        "Correlation of the parameters",
        "Campbell diagram",
        "Unbalance response",
    ]
    for value in estimate.parameters:
        assert value.name in page.words
    for note in (part for part in estimate.page[1:] if isinstance(part, str)):
        assert note.removeprefix("note, ") in page.words
    for text in (model.title, *model.texts, "simulation", "Accepted: these 5 parameters explain"):
        assert text in page.words


@pytest.mark.slow
def test_the_page_is_that_of_the_file(estimate, tmp_path):
    """The same page from the result alone, to the byte."""
    estimate.save(tmp_path / "run.json")
    assert estimate_report(rid.load_estimate(tmp_path / "run.json")) == estimate_report(estimate)


def test_every_record_has_its_pictures(model, periods):
    page = Page(estimate_report(gathered(model, periods, periods).with_(model="mine")))
    assert "Measured and predicted by frequency, record 2" in titles(page)
    assert "F_x, record 2" in page.words


def test_misfit_suspects_and_warnings_are_shown(of_no_machine):
    rejected = of_no_machine.with_(
        status="rejected",
        misfit=rid.Misfit(120.0, 84.2, 82, 1e-7),
        notes=(
            *causes(rid.Suspect("damping k", 31.0, share=0.9)),
            rid.Note("record", "remarks", "the speed of the record is not that of the file"),
        ),
    )
    words = Page(estimate_report(rejected)).words
    assert "whose misfit is 1.4 times what noise leaves" in words
    assert "What stands out: damping k, which would explain 90 % of it" in words
    assert words.count("the speed of the record is not that of the file") == 1


def test_hostile_names_are_text(estimate, periods):
    values = enumerate(estimate.parameters)
    named = tuple(replace(v, name=HOSTILE + str(i), unit=HOSTILE) for i, v in values)
    (shown,) = estimate.evidence.records
    channels = tuple(replace(c, name=HOSTILE + c.name, unit=HOSTILE) for c in shown.channels)
    record = replace(shown, source=HOSTILE, channels=channels)
    evidence = Evidence((record,), (Prior(named[0].name, 1.0, 0.1),))
    hostile = estimate.with_(
        model=HOSTILE,
        method=HOSTILE,
        parameters=named,
        derived=named,
        prediction={HOSTILE: None},
        notes=(
            *causes(rid.Suspect(HOSTILE, 1.0, value=2.0, unit=HOSTILE)),
            rid.Note("record", "remarks", HOSTILE),
        ),
        provenance=rid.Provenance((SourceFile(HOSTILE, "ab"),), HOSTILE, "1", HOSTILE),
        evidence=evidence,
    )
    page = Page(estimate_report(hostile))
    assert page.words.count(" ".join(HOSTILE.split())) > 8
    assert "49" not in page.words[:200]
    texts = json.dumps(page.plots)
    assert "<script" not in texts
    assert "&lt;/title&gt;&lt;script" in texts  # as plotly shows it as text


def test_without_noise_and_with_an_input_that_is_zero(model):
    quiet, driven = record(noise=0.0, periods=2), [1, 0, 1, 1]
    silent = replace(quiet, mean=quiet.mean * driven, spectra=quiet.spectra * driven)
    found = gathered(model, silent)
    assert found.prediction["F_y"] is None
    Page(estimate_report(found))


def test_of_hidden_coordinates(estimate, model, periods):
    kept = {name: getattr(periods, name)[..., :3] for name in ("spectra", "mean", "variance")}
    hidden = replace(periods, channels=periods.channels[:3], **kept)
    found = rid.with_evidence(estimate, model, hidden)
    names = [c.name for c in found.evidence.records[0].channels if c.predicted]
    assert names == ["x"]  # the reading, since a coordinate is hidden
    Page(estimate_report(found.with_(model="mine")))


def test_of_parameters_left_open(model, periods):
    one = replace(periods, harmonics=periods.harmonics[:1], spectra=periods.spectra[:, :1])
    found = gathered(model, one)
    assert found.status == "not_identifiable"
    page = Page(estimate_report(found))
    assert "Residual over time" not in titles(page)
    assert "Measured and predicted by frequency" in titles(page)  # as they were measured
    assert "Not identifiable: " in page.words
    for warning in found.warnings:
        assert warning.removeprefix("not identifiable: ").removeprefix("cure: ") in page.words


def test_where_the_misfit_lies(of_no_machine):
    lines = tuple(rid.LineMisfit(0, f, cost, 12.0) for f, cost in ((10, 11), (20, 90.5), (30, 13)))
    found = of_no_machine.with_(misfit=rid.Misfit(114.5, 36.0, 30, 1e-7), line_misfit=lines)
    page = Page(estimate_report(found))
    assert "Misfit by frequency" in titles(page)
    assert "20 Hz90.5" in page.words
    text = str(found).splitlines()
    start = text.index("misfit by line  found  by noise")
    assert [line.split()[0] for line in text[start + 1 : start + 4]] == ["20", "30", "10"]
    fits = found.with_(misfit=rid.Misfit(37.0, 36.0, 30, 0.4))
    assert "misfit by line" not in str(fits)


def test_where_an_estimate_comes_from(of_no_machine):
    files = (SourceFile("run<1>.csv", "ab12"),)
    source = rid.Provenance(files, "model = 1", "0.1", "rotorid identify", environment="numpy 9")
    page = Page(estimate_report(of_no_machine.with_(provenance=source)))
    command = "rotorid identify, rotorid 0.1, numpy 9"
    for text in ("run<1>.csv", "sha256 ab12", "model = 1", command):
        assert text in page.words


def test_of_an_older_result(of_no_machine):
    """What a result of an older version lacks is said, and the rest is shown."""
    page = Page(estimate_report(of_no_machine))
    assert "holds no evidence of its records" in page.words
    assert "the equations of motion are not shown; identify again" in page.words
    assert titles(page) == ["Correlation of the parameters"]


def test_a_page_without_pictures_has_no_script(of_no_machine):
    page = Page(estimate_report(of_no_machine.with_(covariance=np.zeros((0, 0)))))
    assert "script-src 'none'" in "".join(page.values("content"))


def test_of_a_validation(estimate, model, periods):
    shown = record_evidence(estimate, model, [periods], another=True)
    for chance, said in ((0.2, "The result predicts the record"), (1e-9, "does not predict")):
        found = [[ChannelError("F_x", 0.03, 0.01, chance, 0.004)]]
        page = Page(validation_report(estimate, model, found, shown, ["a note"]))
        for text in (said, "F_x3", "a note", "where noise makes 1 %", "the values 0.4 %"):
            assert text in page.words
        assert ("What to do next" in page.words) == (chance < 1e-6)


def test_what_was_known_stands_beside(estimate):
    first = estimate.parameters[0]
    prior = Prior(first.name, first.value + 2 * first.std, 4 * first.std)
    known = estimate.with_(evidence=Evidence((), (prior, Prior("m + c", 1.5, 0.0))))
    (row, *others), *_ = (rows for _, rows in groups(known))
    assert row.moved == "\N{MINUS SIGN}0.5 std"
    before, after = row.bar[:2]
    assert before[0] < after[0] < after[1] < before[1]
    assert (after[1] - after[0]) / (before[1] - before[0]) == pytest.approx(0.25, abs=0.01)
    assert all(other.bar is None for other in others)
    assert relations(known) == ["m + c = 1.5 exactly"]
    a, b = (v.name for v in estimate.parameters if v.unit == "kg m")
    weighed = known.with_(evidence=Evidence((), (Prior(f"{a} + {b}", 12.0, 0.01),)))
    assert relations(weighed) == [f"{a} + {b} = 12 \N{PLUS-MINUS SIGN} 0.01 kg m"]
    page = Page(estimate_report(known))
    assert "prior and result" in page.words
    assert "Also known: m + c = 1.5 exactly" in page.words


def test_what_was_assumed_stands_in_the_verdict_and_beside_each_value():
    mass = rid.Value("m", "kg", 2.0, 0.01, std_assumed=0.123)
    told = rid.Note("ground", "assumes", "at rest", "weigh", ("m",), 12.3, "1", size="50 rotors")
    for notes, under in (((told,), True), ((replace(told, value=4.9),), False)):
        page = Page(estimate_report(rid.Estimate("rigid", "ml", "ok", (mass,), notes=notes)))
        sentence = "an error of 50 rotors (ground) would shift m by 12 std"
        assert (sentence in page.words) == under
        assert ("ok under assumptions" in page.words) == under
        assert "if assumptions err" in page.words
        assert "0.12" in page.words
    plain = Page(
        estimate_report(rid.Estimate("rigid", "ml", "ok", (replace(mass, std_assumed=None),)))
    )
    assert "if assumptions err" not in plain.words


@pytest.mark.parametrize(("value", "shown"), [(9.9e-5, "0"), (1.1e-4, "0.00011"), (2e-3, "0.0020")])
def test_what_rounding_leaves_of_zero_is_zero(value, shown):
    """A phase that is known to be zero, and nothing of the record says otherwise."""
    phase = rid.Value("phase[0]", "rad", value, 0.02)
    known = Evidence((), (Prior("phase[0]", 0.0, 0.02),))
    estimate = rid.Estimate("rigid", "ml", "ok", (phase,), evidence=known)
    ((row,),) = (rows for _, rows in groups(estimate))
    assert row.percent == ("" if value < 2e-3 else "1000")
    assert row.moved == {"0": "0 std", "0.00011": "+0.0055 std"}.get(shown, "+0.1 std")
    assert (row.value == "0") == (shown == "0")
    assert f"phase[0]  {shown}" in re.sub(" {3,}", "  ", str(estimate))


# Pages in a real browser: drawn whole at every width, by day and by night, and on paper.


LOOKS = [(400, "dark"), (1280, "light"), (2560, "dark")]
MORE = [(400, "light"), (1280, "dark"), (2560, "light")]
INK = {"light": "rgb(32, 33, 36)", "dark": "rgb(232, 234, 237)"}
LARGEST = 6e6  # byte
INJECTED = "</script><img src=x onerror=alert(1)>"
HERTZ = np.arange(1.0, 99.0)
PEAK = 1 + 1.2 / (1 + 0.1j * (HERTZ - 40.0))
LOOP = AxisSensitivity(INJECTED, HERTZ, PEAK, np.full(98, 0.05), 2.2, 40.0, (2.1, 2.3))


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory, demo):
    """What the commands write of a rig's record, one channel under a hostile name."""
    folder = tmp_path_factory.mktemp("pages")
    record, experiment, result = (str(folder / f"run.{end}") for end in ("h5", "toml", "json"))
    hostile, turning = str(folder / "hostile.json"), ("--speed", "9000 rpm", "--to", "20000 rpm")
    planes = ("--plane", "F_xa,F_ya", "--plane", "F_xb,F_yb", "--radius", "30 mm")

    def run(*arguments: str) -> None:
        assert rid.cli.run(arguments) == 0, arguments

    run("simulate", "rigid", "--out", record)
    run("identify", experiment, "--json", result)
    text = Path(result).read_text(encoding="utf-8")
    Path(hostile).write_text(text.replace('"s_xb"', json.dumps(INJECTED)), encoding="utf-8")
    shown = {
        "estimate": ("report", hostile, "--out"),
        "inspect": ("inspect", experiment, "--report"),
        "validate": ("validate", result, experiment, "--report"),
        "modes": ("modes", result, *turning, "--report"),
        "balance": ("balance", result, *planes, "--report"),
        "drawing": ("modes", "flexible", *turning, "--report"),
    }
    for name, command in shown.items():
        run(*command, str(folder / f"{name}.html"))
    made = {
        "sensitivity": sensitivity_report([LOOP], INJECTED),
        "whole": _of_whole_records(),
        "demo": demo_report(demo),
    }
    for name, page in made.items():
        (folder / f"{name}.html").write_text(page, encoding="utf-8")
    files = [folder / f"{name}.html" for name in (*shown, *made)]
    assert INJECTED.replace("<", "&lt;").replace(">", "&gt;") in files[0].read_text("utf-8")
    return files


def _of_whole_records() -> str:
    """Return the page of two records without periods, the second of which begins anywhere."""
    model, rng = rid.load_model("jeffcott"), np.random.default_rng(1)
    noise = {"F_x": 1.0, "F_y": 1.0, "x": 1e-6, "y": 1e-6}
    data = []
    for phase in (0.0, 2.0):
        waves = np.fft.irfft(rng.standard_normal((240, 2)) * 1e4, n=4000, axis=0)  # to 60 Hz
        when = {"sample_rate": 1000.0, "periods": 1, "speed": "1200 rpm", "phase": phase}
        values = model.values(model.nominal)
        record = rid.simulate(model, values, waves, noise=noise, rng=rng, **when)
        turning = replace(record, angle=None, phase_known=phase == 0)
        data.append(rid.spectra(turning, (2.0, 60.0), inputs=model.inputs))
    page = estimate_report(rid.with_evidence(rid.identify(model, data, "ml"), model, data))
    assert "Residual over time, record 2" in page
    return page


@pytest.mark.slow
def test_every_page_at_every_width_by_day_and_by_night(one, pages):
    for page in pages:
        looks = [*LOOKS, *MORE] if page is pages[0] else LOOKS[:2]
        for width, scheme in looks:
            seen = one.show(page, width, scheme)
            where = f"{page.name}, {width} px, {scheme}"
            assert page.stat().st_size < LARGEST, where
            assert seen["places"] == seen["drawn"] > 0, where
            assert seen["overflow"] <= 0, where
            assert seen["ink"] == INK[scheme], where
            assert one.complaints() == [], where


@pytest.mark.slow
def test_on_paper(one, pages):
    one.show(pages[0], 400, "dark")
    one.run('window.dispatchEvent(new Event("beforeprint"))')
    assert one.seen()["wide"] == 0
    one.run('window.dispatchEvent(new Event("afterprint"))')
    paper = base64.b64decode(one.ask("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert paper.startswith(b"%PDF")
    assert 4 <= paper.count(b"/Type /Page\n") + paper.count(b"/Type /Page ") <= 40
    assert one.complaints() == []


def test_the_first_screen_says_how_well_and_where_things_stand(estimate):
    """The numbers that matter, a date, a way to every part; deviations are those of the screen."""
    html = estimate_report(estimate)
    page = Page(html)
    (first, rest) = html[html.index("<body") :].split("<nav>")
    assert first.count("<dt>") == 3
    assert f"written {date.today()}" in first
    assert 'class="plot"' in first
    assert rest.count("<li><a href=") == rest.partition("</nav>")[2].count('<section id="part-')
    mass = estimate["m"]
    assert f"{100 * mass.std / mass.value:.2g}" in page.words
    assert f"{100 * mass.std / mass.value:.2g}" in str(estimate)


def test_a_part_whose_parts_are_empty_has_no_heading():
    assert not Passage("empty", parts=(Passage("one"), Passage("two"))).holds
    assert Passage("full", parts=(Passage("one", items=("a",)),)).holds
