"""Python as people use it: quantities as text, names of methods, views in a notebook."""

import pickle
import re
from base64 import b64decode
from contextlib import nullcontext

import numpy as np
import pandas as pd
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


def three_mass() -> rid.Estimate:
    """A result of the shipped rotor, each value within a thousandth."""
    model = rid.load_model("three-mass")
    found = [rid.Value(p.name, p.unit, p.nominal, 1e-3 * p.nominal) for p in model.parameters]
    spread = np.diag([value.std**2 for value in found])
    return rid.Estimate(model.name, "ml", "ok", tuple(found), covariance=spread)


@pytest.mark.parametrize(
    ("find", "told"),
    [
        (lambda e: rid.modes(e, "6000 rpm"), "the free rotor, without its bearings"),
        (lambda e: rid.campbell(e, "20000 rpm"), "critical speed"),
        (lambda e: rid.unbalance_response(e, "6000 rpm"), "at 6000 rpm"),
        (lambda e: rid.balance(e, ["x1,y1", "x2,y2"], "6000 rpm"), "correction"),
        (lambda e: e, "parameters"),
    ],
)
def test_every_result_shows_itself(find, told):
    """In a terminal, in a notebook and as a picture, all of one page; alike after a pickle."""
    found = find(three_mass())
    assert told in str(found)
    html = found._repr_html_()
    assert "<table>" in html
    assert 'src="data:image/png' in html
    assert "\n" not in repr(found)
    assert found.plot()._repr_png_().startswith(b"\x89PNG")
    assert pickle.loads(pickle.dumps(found)) == found


@pytest.mark.parametrize("name", ["jeffcott", "rigid"])
def test_modes_of_a_single_place_show_their_table(name):
    """They have no shapes: a notebook showed a ValueError."""
    found = rid.modes(rid.load_model(name), "600 rpm")
    assert "<table>" in found._repr_html_()
    with pytest.raises(rid.InputError, match="nothing to draw"):
        found.plot()


def test_one_order_of_arguments():
    """The speed is the second argument of whatever has one."""
    model, speed = rid.load_model("three-mass"), "6000 rpm"
    assert rid.modes(model, speed) == rid.modes(model, speed=speed)
    assert (rid.state_space(model, speed).A == rid.state_space(model, speed=speed).A).all()


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: rid.modes(None), "source: found None; expected Estimate or Model; rid.identify"),
        (lambda: rid.campbell("run.json", 5.0), "found str 'run.json'; expected Estimate or Model"),
        (lambda: rid.balance(3, ["x,y"], 5.0), "found int 3; expected Estimate or Model"),
        (lambda: rid.identify(three_mass(), None, "ml"), "model: found Estimate; expected Model"),
        (lambda: rid.identify(rid.load_model("jeffcott"), None, "ml"), "periods: found None"),
        (lambda: rid.identify(rid.load_model("jeffcott"), [], 3), "estimator: found int 3"),
        (lambda: rid.MaximumLikelihood(constraints=3), "constraints: found int 3"),
        (lambda: rid.MaximumLikelihood(modes=["5 Hz"]), "modes[0]: found str"),
        (lambda: rid.unbalance_response(three_mass(), [None]), "speed: found None"),
        (
            lambda: rid.average(rid.Record([rid.Channel("x")], [[0.0]], 1.0), 0.5, harmonics="all"),
            "harmonics: found str 'all'; expected a list of Real",
        ),
        (lambda: rid.Channel("a", reads="x''"), "reads: found str \"x''\"; expected Mapping"),
        (lambda: rid.average(None, 5.0), "found None; expected Record; rid.read_record"),
        (lambda: rid.read_record(pd.DataFrame({"x": [1.0]})), "by rid.Record.from_frame"),
        (lambda: rid.load_estimate(three_mass()), "found Estimate; expected str or Path"),
        (lambda: rid.Record.from_frame([1.0]), "found list; expected a pandas data frame"),
        (lambda: rid.modes(three_mass(), ["0 rpm"]), "speed: found list; expected a number in rad"),
        (
            lambda: rid.balance(three_mass(), [("x2", "y2")], 9.0),
            "planes: found tuple; expected the name",
        ),
    ],
)
def test_wrong_types_are_refused_with_what_is_taken(call, said):
    with pytest.raises(rid.InputError, match=re.escape(said)) as found:
        call()
    assert isinstance(found.value, TypeError)


def test_a_data_frame_is_a_record(record):
    """There and back, by times or by dates; what is no even time is refused, and how uneven."""
    frame = record.to_frame()
    back = rid.Record.from_frame(frame, speed=record.speed)
    assert (back.names, back.sample_rate, back.speed) == (record.names, 10e3, record.speed)
    assert (back.samples == record.samples).all()
    start = pd.Timestamp("2026-03-02 10:14")
    small = pd.DataFrame({"x": [1, 2, 3]}, index=[start + pd.Timedelta(k, "ms") for k in range(3)])
    found = rid.Record.from_frame(small, units={"x": "um"})
    named = small.rename(columns={"x": "x [um]"})
    assert found == rid.Record.from_frame(named)
    assert rid.Record.from_frame(named, units={"x": "mm"}).samples[0, 0] == 1e-3
    assert found == rid.Record([rid.Channel("x", "m")], [[1e-6], [2e-6], [3e-6]], "1 kHz")
    assert rid.Record.from_frame(small.reset_index(drop=True), sample_rate="2 kHz").start == 0.0
    with pytest.raises(rid.InputError, match="found complex numbers; expected columns of numbers"):
        rid.Record.from_frame(1j * small)
    with pytest.raises(rid.InputError, match="an index of int64, 3 long"):
        rid.Record.from_frame(small.reset_index(drop=True))
    for jitter, refused in ((0.019, False), (0.021, True)):  # half of it lies beside the middle
        uneven = pd.DataFrame({"x": [1.0, 2.0, 3.0]}, index=[0.0, 1.0 + jitter / 2, 2.0])
        with pytest.raises(rid.InputError, match="evenly") if refused else nullcontext():
            rid.Record.from_frame(uneven)
