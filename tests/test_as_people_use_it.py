"""Python as people use it: quantities as text, names of methods, views in a notebook."""

import re
from base64 import b64decode

import numpy as np
import pytest
from working_folder import load, simulated

import rotorid as rid
from rotorid import load_rig
from rotorid.testing import forces

LINES = [1, 3, 5, 7, 9, 11]


@pytest.fixture(scope="module")
def record():
    """Two seconds of the shipped rig."""
    return load_rig("three-mass").rig.run(2.0, np.random.default_rng(1))


def same_answer(one: rid.Estimate, other: rid.Estimate) -> bool:
    first, second = ([(v.name, v.value, v.std) for v in e.parameters] for e in (one, other))
    return first == second


def test_texts_stand_wherever_numbers_may(record):
    model = rid.load_model("three-mass")
    by_text = rid.average(record, "20 Hz", harmonics=LINES, skip="500 ms")
    assert by_text == rid.average(record, 20.0, harmonics=LINES, skip=0.5)
    by_text_too = rid.average(record, "20 Hz", band=("20 Hz", "0.1 kHz"))
    assert by_text_too == rid.average(record, 20.0, band=(20.0, 100.0))
    mass = "m1 + m2 + m3"
    texts = rid.MaximumLikelihood(
        fixed={"L1": "300 mm"},
        known={"m1": ("833.39 g", "1 g")},
        constraints=(rid.Constraint(mass, "12.98878 kg", "10 g"),),
        bounds={"m2": ("1e4 g", None)},
    )
    numbers = rid.MaximumLikelihood(
        fixed={"L1": 0.3},
        known={"m1": (0.83339, 1e-3)},
        constraints=(rid.Constraint(mass, 12.98878, 0.01),),
        bounds={"m2": (10.0, None)},
    )
    assert same_answer(*[rid.identify(model, by_text, chosen) for chosen in (texts, numbers)])
    as_forces = rid.average(forces(record, period=500), "20 Hz", harmonics=LINES)
    batch = [
        rid.identify(model, as_forces, rid.Batch(constraints=(rid.Constraint(mass, value),)))
        for value in ("12988.78 g", 12.98878)
    ]
    assert same_answer(*batch)


def test_texts_of_records_spectra_and_plans():
    rng = np.random.default_rng(1)
    channels = [rid.Channel("r"), rid.Channel("x")]
    samples = rng.standard_normal((4000, 2))
    text = rid.Record(channels, samples, "1 kHz", "600 rpm")
    number = rid.Record(channels, samples, 1000.0, 20 * np.pi)
    assert text == number
    by_text = rid.spectra(text, ("20 Hz", "0.2 kHz"), references=["r"], skip="0.1 s", until="3 s")
    by_number = rid.spectra(number, (20.0, 200.0), references=["r"], skip=0.1, until=3.0)
    assert np.array_equal(by_text.mean, by_number.mean)
    model = rid.load_model("jeffcott")
    noise = {"F_x": "1 N", "F_y": 1.0, "x": "1 um", "y": 1e-6}
    forces = [[500.0, 0.0], [0.0, 500.0]]
    plan = rid.Plan(forces, [3, 5], "10 Hz", "1 kHz", 100, noise, speed="1800 rpm")
    other = rid.Plan(
        forces, [3, 5], 10.0, 1e3, 100, {**noise, "F_x": 1.0, "x": 1e-6}, speed=60 * np.pi
    )
    bounds = [rid.predict_accuracy(model, p).std("m") for p in (plan, other)]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-12)
    force = np.cos(2 * np.pi * np.outer(np.arange(100), [1, 2]) / 100)
    values = model.values(model.nominal)
    simulated = [
        rid.simulate(model, values, force, sample_rate=rate, periods=2, speed=speed, phase=phase)
        for rate, speed, phase in (("1 kHz", "600 rpm", "90 deg"), (1e3, 20 * np.pi, np.pi / 2))
    ]
    assert np.allclose(simulated[0].samples, simulated[1].samples, rtol=1e-12, atol=0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: rid.Record([rid.Channel("x")], np.zeros((3, 1)), "1 kg"), "sample_rate"),
        (lambda: rid.Record([rid.Channel("x")], np.zeros((3, 1)), "1 kHz", "600"), "unit"),
        (lambda: solved(rid.Constraint("m1 + m2", "2 mm")), "converts to kg"),
        (lambda: solved(rid.Constraint("m1 + L1", "2 kg")), "converts to kg"),
    ],
)
def test_a_wrong_text_says_what_was_expected(wrong, message):
    with pytest.raises(rid.InputError, match=message):
        wrong()


def solved(constraint: rid.Constraint) -> object:
    model = rid.load_model("three-mass")
    return rid.MaximumLikelihood(constraints=(constraint,)).knowledge(model)


def test_an_experiment_file_runs_from_python(tmp_path):
    rig = load_rig("three-mass").text.replace('"13 s"', '"2 s"')
    experiment = rid.load_experiment(simulated(tmp_path, rig))
    estimate = experiment.identify()
    assert (estimate.method, estimate.status) == ("ml", "ok")
    assert experiment.identify("batch").method == "batch"
    assert rid.identify(experiment.model, experiment.records(), "ml") == estimate
    frame = estimate.to_frame()
    assert frame.loc["m2", "unit"] == "kg"
    assert abs(frame.loc["m2", "value"] - 11.322) < 4 * frame.loc["m2", "std"]


def test_what_refuses_an_experiment_names_its_file(tmp_path):
    text = 'model = "jeffcott"\n[[modes]]\nfrequency = "70 Hz"\nstd = "0.1 Hz"\n'
    experiment = load(tmp_path, text)
    with pytest.raises(rid.InputError, match=r"experiment\.toml"):
        experiment.identify("batch")


@pytest.mark.slow
def test_values_show_themselves(record):
    """A repr fits a screen; a notebook gets tables, and no name of a user becomes a tag."""
    model = rid.load_model("three-mass")
    for value in (record, model, rid.average(record, "20 Hz", harmonics=LINES)):
        assert len(repr(value)) < 700
        assert "\n" not in repr(value)
    html = model._repr_html_()
    assert "m1*x1&#x27;&#x27; = -k1*" in html
    assert '<th scope="row">F_x3</th><td>input</td><td>N</td>' in html
    assert "F_x1" in record._repr_html_()
    hostile = rid.Record([rid.Channel("<b>")], np.zeros((3, 1)), "1 kHz")
    assert "<b>" not in hostile._repr_html_()


@pytest.mark.slow
def test_records_draw_themselves_in_a_notebook(record):
    """A picture within the page, and not too large a one, however many channels there are."""
    wide = rid.Record(
        [rid.Channel(f"c{k}") for k in range(40)],
        np.random.default_rng(1).standard_normal((20_000, 40)),
        "1 kHz",
    )
    for value in (rid.average(record, "20 Hz", harmonics=LINES), wide):
        html = value._repr_html_()
        (image,) = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
        assert b64decode(image).startswith(b"\x89PNG")
        assert 5_000 < len(image) <= 150_000
        assert html.startswith("<table>")
