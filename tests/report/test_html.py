"""Reports: self-contained, well-formed, true to the figures, proof against hostile names."""

import base64
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from rotorid.demo import DemoResult, findings, run_demo
from rotorid.demo.paper import TABLE
from rotorid.estimate import (
    EquationMisfit,
    Estimate,
    LineMisfit,
    Misfit,
    Provenance,
    SourceFile,
    Suspect,
)
from rotorid.estimators import LeastSquares
from rotorid.identify import identify
from rotorid.models import Model, load_model, parse_model
from rotorid.record import Channel, PeriodicRecord
from rotorid.report.demo import demo_report
from rotorid.report.estimate import estimate_report, validation_report
from rotorid.rig.steady_state import simulate
from rotorid.signals.average import average
from rotorid.tables import table

HOSTILE = "</title><script>alert(1)</script>${{ 7*7 }} $x_{$ & \"'>\n\u65e5"
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Reads a page: its text, images and attributes; fails where tags do not match."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    @property
    def words(self) -> str:
        return " ".join(self.text.split())

    def values(self, name: str) -> list[str]:
        return [value for key, value in self.attributes if key == name]


def check_self_contained(page: Page, images: int) -> None:
    assert not {"script", "link", "iframe", "object", "embed", "base", "form", "a"} & {*page.tags}
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert not page.values("href") + page.values("style")
    sources = page.values("src")
    assert len(sources) == images
    for source in sources:
        kind, _, data = source.partition(",")
        assert kind == "data:image/svg+xml;base64"
        root = ElementTree.fromstring(base64.b64decode(data))
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        linked = {v for e in root.iter() for k, v in e.attrib.items() if k.endswith("href")}
        assert all(v.startswith(("#", "data:")) for v in linked)
    assert all(page.values("alt"))


@pytest.fixture(scope="module")
def demo() -> DemoResult:
    return run_demo(12, rng=np.random.default_rng(3))


@pytest.fixture(scope="module")
def model() -> Model:
    return load_model("jeffcott")


@pytest.fixture(scope="module")
def demo_page(demo: DemoResult) -> Page:
    return Page(demo_report(demo))


def record(model: Model, noise: float = 1e-3, periods: int = 40) -> PeriodicRecord:
    t = np.arange(100) / 1000.0
    forces = np.column_stack(
        [np.cos(20 * np.pi * t) + np.cos(60 * np.pi * t), np.sin(20 * np.pi * t)]
    )
    motion = simulate(
        model,
        model.values(model.nominal),
        1e3 * forces,
        sample_rate=1000.0,
        periods=periods,
        speed=40 * np.pi,
        noise={"F_x": noise, "F_y": noise, "x": 1e-3 * noise, "y": 1e-3 * noise},
        rng=np.random.default_rng(4),
    )
    return average(motion, 10.0, harmonics=[1, 2, 3])


@pytest.fixture(scope="module")
def periods(model: Model) -> PeriodicRecord:
    return record(model)


@pytest.fixture(scope="module")
def estimate(model: Model, periods: PeriodicRecord) -> Estimate:
    return identify(model, periods, LeastSquares())


@pytest.fixture(scope="module")
def estimate_page(estimate: Estimate, model: Model, periods: PeriodicRecord) -> Page:
    return Page(estimate_report(estimate, model, [periods]))


def test_demo_report_is_self_contained(demo_page: Page) -> None:
    check_self_contained(demo_page, images=3)


def test_demo_report_holds_table_findings_and_deviations(demo: DemoResult, demo_page: Page) -> None:
    words = demo_page.words
    assert " ".join(findings(demo)) in words
    for row in TABLE:
        index = demo.names.index(row.base)
        cells = [
            text
            for printed, name in zip((*row.errors, None), demo.estimators, strict=True)
            for text in (
                *([] if printed is None else [f"{printed:.3f}"]),
                f"{demo.median(name)[index]:.3f}",
                f"{demo.rms(name)[index]:.3f}",
                f"{demo.bias(name)[index]:+.3f}".replace("-", "\N{MINUS SIGN}"),
            )
        ]
        assert row.base in words
        assert " ".join([*cells, f"{demo.bound_percent[index]:.3f}"]) in words
        ratios = [f"{demo.scatter_over_stated(name)[index]:.2f}" for name in demo.estimators]
        assert f"{row.base}{''.join(ratios)}" in words.replace(" ", "").replace(
            row.base.replace(" ", ""), row.base
        )
    assert "xi m2 Omega^2 = 77.112 N" in words


def test_demo_report_of_one_run() -> None:
    page = Page(demo_report(run_demo(1, rng=np.random.default_rng(3))))
    assert "bias cannot be told from scatter" in page.words
    assert "Do the stated deviations hold?" not in page.words


def test_estimate_report_shows_the_estimate(
    estimate: Estimate, model: Model, estimate_page: Page
) -> None:
    page = estimate_page
    check_self_contained(page, images=3)
    for shown in estimate.tables:
        for row in shown.rows:
            assert "".join(row) in page.text.replace("\n", "")
    for note in estimate.notes:
        assert note in page.words
    for text in (model.title, *model.texts, "simulation", "Correlation of the parameters"):
        assert text in page.words


def test_every_record_has_its_pictures(
    estimate: Estimate, model: Model, periods: PeriodicRecord
) -> None:
    page = Page(estimate_report(estimate, model, [periods, periods]))
    check_self_contained(page, images=5)
    assert "Spectra, record 2" in page.words


def test_misfit_suspects_and_warnings_are_shown(
    estimate: Estimate, model: Model, periods: PeriodicRecord
) -> None:
    rejected = estimate.with_(
        status="rejected",
        misfit=Misfit(120.0, 84.2, 82, 1e-7),
        suspects=(Suspect("damping k", 31.0),),
        warnings=("the data reject the model",),
    )
    words = Page(estimate_report(rejected, model, [periods])).words
    assert "misfit 120 where noise alone leaves 84.2" in words
    assert "damping k31" in words
    assert words.count("the data reject the model") == 1


def test_hostile_names_are_text(estimate: Estimate, model: Model, periods: PeriodicRecord) -> None:
    named = tuple(
        replace(v, name=HOSTILE + str(i), unit=HOSTILE) for i, v in enumerate(estimate.parameters)
    )
    hostile = estimate.with_(
        model=HOSTILE,
        method=HOSTILE,
        parameters=named,
        derived=named,
        suspects=(Suspect(HOSTILE, 1.0),),
        prediction={HOSTILE: None},
        warnings=(HOSTILE,),
    )
    channels = [*periods.channels[:3], Channel(HOSTILE, HOSTILE, {"y": 1.0})]
    other = replace(periods, source=HOSTILE, channels=tuple(channels))
    page = Page(estimate_report(hostile, replace(model, title=HOSTILE), [other]))
    check_self_contained(page, images=2)
    assert page.words.count(" ".join(HOSTILE.split())) > 8
    assert "49" not in page.words.replace(str(hostile), "")[:200]


def test_forces_of_long_names_are_drawn() -> None:
    long = "F_" + "x" * 60
    model = parse_model(
        f"""
        title = "a mass"
        equations = ["m*x'' = {long}"]
        coordinates = {{ x = "m" }}
        inputs = {{ {long} = "N" }}
        parameters = {{ m = {{ unit = "kg", nominal = 2.0 }} }}"""
    )
    wave = 100 * np.cos(2 * np.pi * np.arange(50) / 50)[:, None]
    motion = simulate(model, [2.0], wave, sample_rate=500.0, periods=3)
    periods = average(motion, 10.0, harmonics=[1])
    found = identify(model, periods, LeastSquares())
    check_self_contained(Page(estimate_report(found, model, [periods])), images=2)


def test_without_noise_and_with_an_input_that_is_zero(model: Model) -> None:
    quiet = record(model, noise=0.0, periods=2)
    silent = replace(
        quiet,
        mean=quiet.mean * [1, 0, 1, 1],
        spectra=quiet.spectra * [1, 0, 1, 1],
    )
    found = identify(model, silent, LeastSquares())
    page = Page(estimate_report(found, model, [silent]))
    assert found.prediction["F_y"] is None
    check_self_contained(page, images=3)


def test_of_hidden_coordinates(estimate: Estimate, model: Model, periods: PeriodicRecord) -> None:
    hidden = replace(
        periods,
        channels=periods.channels[:3],
        spectra=periods.spectra[..., :3],
        mean=periods.mean[:, :3],
        variance=periods.variance[:, :3],
    )
    page = Page(estimate_report(estimate, model, [hidden]))
    alt = ["Measured and predicted", "Spectra", "Correlation of the parameters"]
    assert page.values("alt") == alt  # the readings, since a coordinate is hidden


def test_of_parameters_left_open(model: Model, periods: PeriodicRecord) -> None:
    one = replace(periods, harmonics=periods.harmonics[:1], spectra=periods.spectra[:, :1])
    found = identify(model, one, LeastSquares())
    assert found.status == "not_identifiable"
    page = Page(estimate_report(found, model, [one]))
    assert "Measured and predicted" not in page.words
    assert "not identifiable" in page.words
    for warning in found.warnings:
        assert warning in page.words


def test_where_the_misfit_lies(estimate: Estimate, model: Model, periods: PeriodicRecord) -> None:
    lines = tuple(LineMisfit(0, f, cost, 12.0) for f, cost in ((10, 11), (20, 90.5), (30, 13)))
    rows = tuple(EquationMisfit(0, name, cost, 18.0) for name, cost in (("x", 70.25), ("y", 20)))
    found = estimate.with_(
        misfit=Misfit(114.5, 36.0, 30, 1e-7), line_misfit=lines, equation_misfit=rows
    )
    page = Page(estimate_report(found, model, [periods]))
    check_self_contained(page, images=4)
    assert "Misfit line by line" in page.values("alt")
    assert "20 Hz90.5" in page.words
    assert "x70.2518" in page.words
    text = str(found).splitlines()
    start = text.index("misfit by line  found  by noise")
    assert [line.split()[0] for line in text[start + 1 : start + 4]] == ["20", "30", "10"]
    fits = found.with_(misfit=Misfit(37.0, 36.0, 30, 0.4))
    assert "misfit by line" not in str(fits)


def test_where_an_estimate_comes_from(
    estimate: Estimate, model: Model, periods: PeriodicRecord
) -> None:
    source = Provenance((SourceFile("run<1>.csv", "ab12"),), "model = 1", "0.1", "rotorid identify")
    page = Page(estimate_report(estimate.with_(provenance=source), model, [periods]))
    for text in ("run<1>.csv", "sha256 ab12", "model = 1", "rotorid identify, rotorid 0.1"):
        assert text in page.words


def test_of_an_estimate_alone(estimate: Estimate) -> None:
    page = Page(estimate_report(estimate, None, [], ["run.csv is not there"]))
    check_self_contained(page, images=1)
    assert "run.csv is not there" in page.words
    assert "Records" not in page.words


def test_of_a_validation(estimate: Estimate, model: Model, periods: PeriodicRecord) -> None:
    page = Page(
        validation_report(
            estimate, model, [periods], [table(("name", "error"), [("F_x", "3 %")]), "a note"]
        )
    )
    check_self_contained(page, images=2)
    for text in ("validation", "F_x3 %", "a note", "Measured and predicted"):
        assert text in page.words
