"""Sensitivity of the loop, its poles, and its peak between the lines."""

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy
import scipy.signal
from io_writers import write_table
from linear_machines import estimate_of
from report_pages import Page, check_self_contained
from result_cases import (
    FUNDAMENTAL,
    LAST,
    Graded,
    exact,
    exact_peak,
    loop,
    measured,
    pair,
    played,
    sampled_loop,
)

import rotorid as rid
from rotorid import InputError, load_rig
from rotorid.models.modal import poles_of
from rotorid.results import sensitivity
from rotorid.results import sensitivity_peak as peak
from rotorid.results.loops import _from_above, poles_on_the_right
from rotorid.results.sensitivity import AxisSensitivity, settles_elsewhere, worst_of, zone_of
from rotorid.results.sensitivity_peak import LineWindow, LoopLines, Peak, RationalCurve, peak_of


def loop_lines(e: np.ndarray, r: np.ndarray | None = None) -> LoopLines:
    """Return e and r, 1 unless told otherwise, on lines of 0, 1, 2 ... Hz without a rotation."""
    added = np.ones(len(e)) if r is None else r
    none = np.zeros((len(e), 0)) + 0j
    return LoopLines(np.arange(float(len(e))), e + 0j, added[:, None] + 0j, none, 0)


def window(e: np.ndarray, r: np.ndarray | None = None) -> LineWindow:
    lines = loop_lines(e, r)
    place, weight = np.linspace(-1.0, 1.0, len(e)), np.ones(len(e))
    return LineWindow(place, lines.e, lines.r, lines.rotation, 0, weight)


# Sensitivity after ISO 14839-3, held against the loop in closed form.


def curve(values: list[complex], low: float, high: float, peak: float = 0.0) -> AxisSensitivity:
    """Return an axis of lines from 1 Hz, its peak in an interval."""
    found, lines = np.array(values) + 0j, np.arange(1.0, len(values) + 1)
    peak = peak or float(np.abs(found).max())
    return AxisSensitivity("x", lines, found, np.full(len(values), 0.1), peak, 2.0, (low, high))


def test_zones_and_what_is_undecided():
    def of(low: float, high: float) -> AxisSensitivity:
        return curve([1.0], low, high, (low + high) / 2)

    assert sensitivity.LIMITS == {"A": 3.0, "B": 4.0, "C": 5.0}
    assert [zone_of(p) for p in (2.999, 3.0, 4.0, 5.0)] == ["A", "B", "C", "D"]
    assert of(2.4, 2.6).verdict == "zone A"
    assert of(2.7, 3.1).verdict == "undecided between A and B"
    assert of(2.9, 4.1).verdict == worst_of([of(2.9, 4.1)]) == "undecided between A, B and C"
    assert (of(2.9, 4.1).zone, of(2.9, 6.0).zone) == ("A, B or C", "A, B, C or D")
    assert of(9.0, 11.0).peak_db == pytest.approx(20.0)
    assert worst_of([of(2.4, 2.6), of(3.3, 3.7)]) == "zone B"
    assert worst_of([of(2.7, 3.1), of(2.4, 2.6)]) == "undecided between A and B"


def test_a_peak_that_the_band_leaves_out_is_in_no_zone():
    inside = curve([0.5, 2.0, 1.5], 1.9, 2.1)
    assert (inside.zone, inside.doubt) == ("A", "")
    for values in ([0.5, 1.0, 2.0], [2.0, 1.5, 1.3]):
        rising = curve(values, 1.9, 2.1)
        assert rising.zone == "A or worse"
        assert "widen the band" in rising.verdict
        assert worst_of([inside, rising]).startswith("zone A or worse (x: it is largest at an end")
    assert curve([1.81, 2.0, 1.5], 1.9, 2.1).zone == "A or worse"  # the end may be the highest
    assert curve([1.79, 2.0, 1.5], 1.9, 2.1).zone == "A"
    assert curve([0.7, 1.2, 1.19], 1.1, 1.3).zone == "A"  # S has come to 1
    assert curve([1.0, 2.0, 6.0], 5.5, 6.5).verdict == "zone D"
    small = curve([0.001, 0.004, 0.001], 0.003, 0.005)
    assert small.zone == "A or worse"
    assert "not in one unit" in small.verdict


@pytest.mark.parametrize(
    ("mean", "end", "zone"),
    [(-0.11, 0.79, "A or worse"), (-0.09, 0.79, "A"), (-0.11, 0.81, "A")],
)
def test_no_loop_is_below_1_on_average(mean, end, zone):
    """Unless it is above 1 beyond the band, of which the end tells: by two deviations of 0.1."""
    size = np.array([1.2, 2.0, 1.0, 1.0, 1.0, end])
    size[2:5] = np.exp((6 * mean - np.log(1.2) - np.log(2.0) - np.log(end)) / 3)
    axis = curve(list(size), 1.95, 2.05)
    assert axis.zone == zone
    assert ("no loop does (Bode)" in axis.verdict) == (zone != "A")


@pytest.mark.parametrize(("gain", "zone"), [(1.0, "A"), (2.0, "A or worse")])
def test_a_reference_twice_too_large_while_the_loop_still_has_gain(gain, zone):
    """S of a mass under a controller with a delay: 1.2 at the end of the band, or half of it."""
    lines = np.arange(5.0, 600.0, 4.0)
    s = 2j * np.pi * lines
    control = (4e5 + 900 * s) * np.exp(-3e-4 * s)
    axis = played_back(lines, 1 / (1 + control / (2 * s**2 - 2e5)) / gain)
    assert axis.peak == pytest.approx(2.0 / gain, rel=0.2)
    assert axis.zone == zone
    assert ("not in one unit or gain" in axis.verdict) == (gain > 1)


def played_back(lines: np.ndarray, values: np.ndarray) -> AxisSensitivity:
    rng = np.random.default_rng(0)
    drawn = 1e-3 * rng.standard_normal((2, 8, len(lines)))
    spectra = np.stack([values + drawn[0] + 1j * drawn[1], np.ones((8, len(lines)))], axis=-1)
    known = {"names": ("e", "r"), "periods": 8, "fundamental": 1.0, "turns": 0.0}
    record = SimpleNamespace(spectra=spectra, frequency=lines, **known)
    raw = sensitivity._of_periods([record], {"e": "r"})
    return sensitivity._single(sensitivity._settled(sensitivity._axis("e", *raw[0])))


@pytest.mark.parametrize(("height", "alone"), [(4.9, False), (5.1, True)])
def test_a_peak_of_one_line_alone_is_no_loop_s(height, alone):
    """The lines beside are 2 high."""
    axis = played_back(np.arange(10.0, 30.0), np.r_[np.ones(8), 2, height, 2, np.ones(9)])
    assert ("on the line of 19 Hz alone: the rotation" in axis.verdict) == alone


@pytest.mark.parametrize(("off", "told"), [(0.0, False), (2e-9, True)])
def test_a_command_is_not_its_own_reference(off, told):
    ones = np.ones(10)
    axis = AxisSensitivity("x", np.arange(10.0), ones + off + 0j, 0 * ones, 1.0, 2.0, (1.0, 1.0))
    with nullcontext() if told else pytest.raises(InputError, match="x and its reference the same"):
        assert sensitivity._settled(axis) == axis


def test_how_many_lines_a_peak_is_fitted_to_and_what_they_leave():
    wide, narrow = loop(2e5, 800.0), loop(1.5e5, 340.0)
    for on, error in ((wide, 1.3e-4), (narrow, 5.4e-4)):
        found, _, none = peak_of(on.lines, on.sensitivity)
        assert abs(found / on.peak - 1) < error
        assert none == 0
        # What the curve leaves is counted in its deviation where noise is less than that.
        for size in (1e-6, 1e-4, 0.01):
            found, _, std = peak_of(on.lines, on.sensitivity, np.full(LAST, size))
            assert abs(found - on.peak) < 3 * std
    for count, size in ((5, np.abs(wide.sensitivity[4])), (6, 2.2)):
        here = slice(1, 1 + count)
        found, _, _ = peak_of(wide.lines[here], wide.sensitivity[here])
        assert found == pytest.approx(size, rel=1e-5 if count == 5 else 0.01)


@pytest.mark.slow
def test_a_broad_peak_in_noise_is_held():
    """More lines would have less noise and a bias as large: 78 % held with twenty of them."""
    on, rng = loop(2e5, 800.0), np.random.default_rng(5)
    axes = [rid.sensitivity(played(on, 0.02, 20, rng), {"e": "r"})[0] for _ in range(150)]
    found = [Graded(on.peak, axis) for axis in axes]
    assert 0.91 <= np.mean([each.held for each in found]) <= 0.99
    off = np.array([each.off_db for each in found])
    assert abs(off.mean()) < 0.025
    assert np.sqrt((off**2).mean()) < 0.06


def test_the_rig_s_record_gives_the_peak_of_its_loop():
    periods = measured(0, 20, np.random.default_rng(2))
    (found,) = rid.sensitivity(periods, pair(0))
    assert abs(found.peak_db - 20 * np.log10(exact_peak(0))) < 0.1
    assert found.interval[0] < exact_peak(0) < found.interval[1]
    assert found.verdict == "zone A"
    turn = round(140 / FUNDAMENTAL)
    assert turn * FUNDAMENTAL not in found.frequency_hz  # the rotation answers no excitation
    away = np.abs(np.abs(found.sensitivity) - np.abs(exact(found.frequency_hz, 0))) / found.std
    assert np.sqrt((away**2).mean()) == pytest.approx(1.0, abs=0.3)
    with pytest.raises(rid.InputError, match="no line on which e_F_y1"):
        rid.sensitivity(periods, pair(1))


TWO_LOOPS = [rid.Channel(name) for name in ("e1", "e2", "r1", "r2")]


def two_loops(rng: np.random.Generator, signs: np.ndarray, periods: int = 20) -> np.ndarray:
    """Return e and r of two coupled loops whose S is known, both excited at once."""
    time = np.arange(200 * periods) / 2000.0
    waves = sum(np.cos(2 * np.pi * f * time + f) for f in (10, 20, 30, 40, 50))
    r = waves[:, None] * signs
    e = r @ np.array([[2.5, 0.4], [-0.7, 3.5]]) + 0.02 * rng.standard_normal(r.shape)
    return np.column_stack([e, r])


def test_axes_that_are_excited_together_take_as_many_records():
    rng = np.random.default_rng(4)
    pairs = {"e1": "r1", "e2": "r2"}
    both = []
    for signs in ((1.0, 1.0), (1.0, -1.0)):
        record = rid.Record(TWO_LOOPS, two_loops(rng, np.array(signs)), sample_rate=2000.0)
        both.append(rid.average(record, 10.0, harmonics=[1, 2, 3, 4, 5]))
    first, second = rid.sensitivity(both, pairs)
    assert first.peak == pytest.approx(2.5, abs=0.01)
    assert second.peak == pytest.approx(3.5, abs=0.01)
    assert (zone_of(first.peak), zone_of(second.peak)) == ("A", "B")
    with pytest.raises(rid.InputError, match="as many records as axes"):
        rid.sensitivity(both[0], pairs)


def filtered(rng: np.random.Generator, seconds: int = 10) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of two loops, r noise and e a resonance of it, and the peak of each."""
    samples = 1000 * seconds
    r = rng.standard_normal((samples, 2))
    e, peaks = [], []
    for j, (hertz, narrow) in enumerate([(60.0, 4.0), (110.0, 5.0)]):
        b, a = map(np.asarray, scipy.signal.iirpeak(hertz, narrow, fs=1000.0))
        top = 1.2 * (j + 1) * b + a
        e.append(scipy.signal.lfilter(top, a, r[:, j]) + 0.1 * rng.standard_normal(samples))
        peaks.append(np.abs(scipy.signal.freqz(top, a, 20000)[1]).max())
    e[0] = e[0] + 0.2 * r[:, 1]
    return np.column_stack([*e, r]), np.array(peaks)


@pytest.mark.parametrize(
    ("pairs", "band", "message"),
    [
        ({"e1": "r1"}, None, "without a band"),
        ({"z": "r1"}, (20.0, 300.0), "no channel 'z'"),
        ({"e1": "r1"}, (20.0, 20.5), "lines in the band"),
        ({}, (20.0, 300.0), "no axes"),
    ],
)
def test_whole_records_of_which_no_sensitivity_can_be_told(pairs, band, message):
    samples, _ = filtered(np.random.default_rng(5))
    record = rid.Record(TWO_LOOPS, samples, sample_rate=1000.0)
    with pytest.raises(rid.InputError, match=message):
        rid.sensitivity(record, pairs, band=band)


@pytest.mark.parametrize(
    ("first", "factor", "said"),
    [
        (80.0, 1.0, "zone A or worse: nothing tells it from"),
        (5.0, 1.0, "zone C"),
        (80.0, 1e3, "zone A or worse: on average it stays below 1, as no loop does"),
    ],
)
def test_a_peak_where_nothing_was_excited_is_no_peak_that_is_not_there(first, factor, said):
    """S is 4.5 at 40 Hz and 1.3 at 150; the sweep of r begins above the peak, or below.

    The unit of r is told first: a window with little excitation is none of its reasons.
    """
    rng, time = np.random.default_rng(3), np.arange(6_000) / 2000.0
    r = scipy.signal.chirp(time, first, time[-1], 300.0)
    parts = [r, 1e-3 * rng.standard_normal(len(time))]
    for hertz, width, gain in ((40.0, 4.0, 3.5), (150.0, 3.0, 0.3)):
        parts.append(gain * scipy.signal.lfilter(*scipy.signal.iirpeak(hertz, width, fs=2000.0), r))
    channels = [rid.Channel("e"), rid.Channel("r")]
    record = rid.Record(channels, np.column_stack([sum(parts), factor * r]), sample_rate=2000.0)
    (axis,) = rid.sensitivity(record, {"e": "r"}, band=("20 Hz", "250 Hz"))
    assert axis.verdict.startswith(said)


def looked_at(monkeypatch, unsure: float = 0.0, size: float | None = None) -> list[float]:
    """Have every peak be a tenth of its frequency, or so high; return where it was looked."""
    asked: list[float] = []

    def peak_near(_, hertz: float) -> SimpleNamespace:
        asked.append(hertz)
        high = size or hertz / 10
        found = SimpleNamespace(hertz=hertz, reach=1.0, size=high, value=high + 0j, std=0.01)
        found.unsure = 0.0 if len(asked) == 1 else unsure
        found.interval = lambda chance: (high - 0.1, high + 0.1)
        return found

    monkeypatch.setattr(sensitivity, "peak_near", peak_near)
    return asked


@pytest.mark.parametrize(
    ("below", "between", "above", "end", "zone"),
    [
        (3, 3, 3, 1.2, "A"),
        (4, 0, 0, 1.2, "A or worse"),
        (0, 4, 0, 1.2, "A or worse"),
        (0, 0, 4, 1.2, "A or worse"),
        (0, 0, 9, 1.01, "A"),
    ],
)
def test_four_windows_that_do_not_tell_may_hold_a_peak(
    monkeypatch, below, between, above, end, zone
):
    """Past the end no more where S has come to 1."""
    frequency = np.arange(10.0, 40.0)
    looked_at(monkeypatch)
    values = np.full(30, end + 0j)
    values[0] = 0.5
    raw = frequency, values, np.full(30, 2e-4), np.full(30, 10.0)
    gap = 25.0 + np.arange(1, between + 1) / 10
    windows = np.sort([*np.arange(below), *frequency, *gap, *(40.0 + np.arange(above))])
    found = sensitivity.Windowed(loop_lines(np.ones(1)), windows, raw, [(2.0, 20.0)])
    assert sensitivity._located("x", found).zone == zone


@pytest.mark.slow
def test_plant_and_controller_tell_the_loop_between_the_lines_and_at_other_speeds():
    rig = load_rig("three-mass").rig
    names, period = rig.model.inputs, rig.controller.period

    def control(omega: np.ndarray) -> np.ndarray:
        """Return the controller with its hold and delay."""
        lag = np.exp(-1j * omega * (period / 2 + rig.delay))
        hold = np.sinc(omega * period / (2 * np.pi)) * lag
        return rig.controller.response(omega) * hold[:, None, None]

    laws = {name: part.slopes for name, part in zip(names, rig.parts, strict=True)}
    estimate = estimate_of(rig.model, percent=0.1)
    frequency = np.arange(2.0, 250.0, 0.5)
    options = {"sensors": ["x1", "y1", "x3", "y3"], "laws": laws}
    found = rid.loop_sensitivity(estimate, control, frequency, speed="8400 rpm", **options)
    assert [axis.axis for axis in found.axes] == list(names)
    first = found.axes[0]
    assert abs(first.peak_db - 20 * np.log10(exact_peak(0))) < 0.05
    assert first.interval[0] < first.peak < first.interval[1]
    assert np.abs(first.sensitivity) == pytest.approx(np.abs(exact(frequency, 0)), rel=5e-3)
    still = rid.loop_sensitivity(estimate, control, frequency, **options)
    assert still.axes[0].peak != pytest.approx(first.peak, rel=1e-4)
    assert found.return_difference.shape == (len(frequency),)
    known = rid.loop_sensitivity(rig.model, control, frequency, **options)
    assert known.axes[0].interval == (known.axes[0].peak, known.axes[0].peak)
    with pytest.raises(rid.InputError, match="a controller's response of shape"):
        rid.loop_sensitivity(estimate, lambda w: np.zeros((len(w), 4, 3)), frequency, **options)
    with pytest.raises(rid.InputError, match="the sensor 'z'"):
        rid.loop_sensitivity(estimate, control, frequency, sensors=["z"])


HEADER = "e1,e2,r1,r2,x,y"
CHANNELS = """
[channels]
F_x = { column = "e1", unit = "mN" }
F_y = { column = "e2", unit = "mN" }
x = { column = "x", unit = "um" }
y = { column = "y", unit = "um" }
"""
REFERENCES = 'references = ["r1", "r2"]'
EXPERIMENT = f"""
model = "jeffcott"
[[records]]
file = "run.csv"
sample_rate = "1 kHz"
band = ["20 Hz", "300 Hz"]
{REFERENCES}
{CHANNELS}"""


@pytest.mark.slow
def test_the_command_of_a_whole_record(tmp_path, monkeypatch, output, refusal):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(5)
    samples, peaks = filtered(rng)
    write_table("run.csv", HEADER, samples, rng.standard_normal((len(samples), 2)))
    (tmp_path / "run.toml").write_text(EXPERIMENT)
    said = output("sensitivity", "run.toml", "--json", "s.json", "--report", "s.html")
    assert said.startswith("Zone B: the largest sensitivity is ")
    page = Page((tmp_path / "s.html").read_text())
    check_self_contained(page)
    assert "rotorid sensitivity run.toml --json s.json --report s.html" in page.words
    for at, size in ((0, 3.0), (1, 4.0), (2, 5.0)):  # the limits of ISO 14839-3
        assert page.plots["plot-2"]["data"][at]["y"] == [size, size]
    found = json.loads((tmp_path / "s.json").read_text())
    assert [axis["axis"] for axis in found["axes"]] == ["F_x", "F_y"]
    for axis, size in zip(found["axes"], peaks, strict=True):
        assert axis["peak"] == pytest.approx(size, rel=0.02)
        assert axis["interval"][0] < size < axis["interval"][1]
    (tmp_path / "bare.toml").write_text(EXPERIMENT.replace(REFERENCES, ""))
    said = refusal("sensitivity", "bare.toml")
    assert "no columns of what was added to the commands" in said
    assert "rid.loop_sensitivity takes an identified plant" in said
    assert "F_x" not in output("sensitivity", "bare.toml", "--pair", "F_y=r2")  # enough
    assert "write --pair F_x1=r_x1" in refusal("sensitivity", "bare.toml", "--pair", "F_y")


ONE_AXIS = """
[[records]]
file = "{}.csv"
sample_rate = "1 kHz"
band = ["20 Hz", "300 Hz"]
references = ["{}"]
"""


@pytest.mark.parametrize("columns", [("sweep", "sweep"), ("r1", "r2")])
def test_records_that_excite_one_axis_each_tell_its_own_loop(tmp_path, output, refusal, columns):
    """As sweeps of one axis after the other: each file has a reference, the samples tell whose."""
    rng, text = np.random.default_rng(7), ""
    for axis in (1, 0):
        samples, peaks = filtered(rng)
        e, r = samples[:, :2], samples[:, 2 + axis]
        e[:, 1 - axis] = 0.3 * rng.standard_normal(len(e)) + 0.4 * np.roll(r, 3)  # the other axis
        none = rng.standard_normal((len(e), 2))
        write_table(tmp_path / f"{axis}.csv", f"e1,e2,{columns[axis]},x,y", e, r, none)
        text += ONE_AXIS.format(axis, columns[axis])
    (tmp_path / "run.toml").write_text(f'model = "jeffcott"{text}{CHANNELS}')
    run = ("sensitivity", tmp_path / "run.toml", "--json", tmp_path / "s.json", "--force")
    pairs = ("--pair", "F_x=r1", "--pair", "F_y=r2") if columns[0] == "r1" else ()
    for given in ((), pairs):
        output(*run, *given)
        found = json.loads((tmp_path / "s.json").read_text())["axes"]
        told = {axis["axis"]: axis["peak"] for axis in found}
        assert told == pytest.approx(dict(zip(("F_x", "F_y"), peaks, strict=True)), rel=0.05)
    assert "--pair: found no column 'r9'" in refusal(*run, "--pair", "F_y=r9")
    twice = ("--pair", "F_y=r8", "--pair", "F_y=r9")
    assert "--pair: found two references of F_y; expected one" in refusal(*run, *twice)
    wrong = (tmp_path / "run.toml").read_text().replace(f'["{columns[0]}"]', '["r9"]')
    (tmp_path / "run.toml").write_text(wrong)
    assert ".references: found no column 'r9'" in refusal(*run)


RECORD = """
[[records]]
file = "plus.csv"
sample_rate = "2 kHz"
fundamental = "10 Hz"
harmonics = [1, 2, 3, 4, 5]
"""
OTHER = RECORD.replace("plus", "minus")
PERIODS = 'model = "jeffcott"' + RECORD + OTHER + CHANNELS


def test_the_command_of_periods_with_their_references(tmp_path, monkeypatch, output, refusal):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(6)
    for name, signs in (("plus", (1.0, 1.0)), ("minus", (1.0, -1.0))):
        samples = two_loops(rng, np.array(signs))
        write_table(f"{name}.csv", HEADER, samples, rng.standard_normal((len(samples), 2)))
    (tmp_path / "run.toml").write_text(PERIODS)
    both = ("--pair", "F_x=r1", "--pair", "F_y=r2")
    assert "Zone B" in output("sensitivity", "run.toml", *both, "--json", "s.json")
    first, second = json.loads((tmp_path / "s.json").read_text())["axes"]
    assert first["peak"] == pytest.approx(2.5, abs=0.01)  # mN over mN, though channels are in N
    assert second["peak"] == pytest.approx(3.5, abs=0.01)
    # A column beside the channels stands for itself.
    assert "e1" in output("sensitivity", "run.toml", "--pair", "e1=r1", "--pair", "F_y=r2")
    assert "--pair: found no column 'r9'" in refusal("sensitivity", "run.toml", "--pair", "F_x=r9")
    (tmp_path / "one.toml").write_text(PERIODS.replace(OTHER, ""))
    assert "repeat with other signs: + +, + -" in refusal("sensitivity", "one.toml", *both)
    mixed = PERIODS.replace('fundamental = "10 Hz"\nharmonics = [1, 2, 3, 4, 5]', "X", 1)
    (tmp_path / "mixed.toml").write_text(mixed.replace("X", 'band = ["8 Hz", "60 Hz"]'))
    said = refusal("sensitivity", "mixed.toml", "--pair", "F_x=r1")
    assert "an experiment file for each" in said


# Where a sensitivity turns over: what is a peak, what is an axis' own, what lines tell nothing.


FEW_LINES = np.arange(1.0, 41.0)


def resonance(at: float, width: float = 1.0) -> np.ndarray:
    """Return a pole on the lines, of size 1 where it is highest, whose half width is given."""
    return 1 / (1 + 1j * (FEW_LINES - at) / width)


def test_a_peak_is_told_to_a_twentieth_of_a_line():
    places = 20 + np.linspace(0.0, 1.0, 21)
    found = np.array([peak_of(FEW_LINES, resonance(at)) for at in places])
    assert np.abs(found[:, 1] - places).max() < 0.05
    assert np.abs(found[:, 0] - 1).max() < 1e-3


@pytest.mark.parametrize(("above", "peak"), [(1.49, True), (1.51, False)])
def test_a_peak_half_as_high_again_as_any_line_is_none(above, peak):
    width = 0.5 / np.sqrt(above**2 - 1)
    size, where, _ = peak_of(FEW_LINES, resonance(20.5, width))
    assert size == pytest.approx(1.0 if peak else 1 / above, rel=1e-4)
    assert (where == pytest.approx(20.5, abs=0.01)) == peak


def test_the_interval_holds_the_peak_with_95_percent():
    """One line, whose size scatters like its real part; the fewer periods tell it, the wider."""
    one = np.ones(1)
    for freedom, times in ((1e9, 1.96), (9.0, 2.10)):
        found = sensitivity._axis("x", one, 2 * one + 0j, 2e-6 * one, freedom * one)
        assert np.diff(found.interval)[0] / 2e-3 == pytest.approx(times, rel=1e-3)


def window_of(monkeypatch, deviation: float = 0.1) -> tuple[int, list[float]]:
    """Return in how many windows of 190 lines S = 1 is told, and the chance asked of each."""
    chances: list[float] = []

    def middle(part, loud, chance):
        chances.append(chance)
        return 1 + 0j, deviation**2, 10.0, 1.0, 0.0

    monkeypatch.setattr(sensitivity, "_middle", middle)
    found = sensitivity._windows(loop_lines(np.ones(190)))
    assert len(found.middles) == len(chances)
    assert len(found.raw[0]) == len(found.candidates)
    return len(found.candidates), chances


@pytest.mark.parametrize(("deviation", "told"), [(0.29, True), (0.31, False)])
def test_a_line_that_was_not_excited_says_nothing(monkeypatch, deviation, told):
    windows, chances = window_of(monkeypatch, deviation)
    assert windows == (len(chances) if told else 0)


def test_noise_alone_gives_poles_to_one_of_a_hundred_records(monkeypatch):
    assert sum(window_of(monkeypatch)[1]) == pytest.approx(0.01, rel=0.1)


def test_what_a_window_asks_for():
    """S and the transient have 6 unknowns; a dozen degrees of freedom are left for the noise."""
    with pytest.raises(InputError, match=r"18 lines in the band; expected 19 or more"):
        sensitivity._windows(loop_lines(np.ones(18)))


@pytest.mark.parametrize(("poles", "noise"), [(2, 1e-9), (0, 0.1)])
def test_a_window_has_two_poles_where_noise_alone_does_not_explain_them(poles, noise):
    rng = np.random.default_rng(7)
    offset = np.arange(-9, 10) / 9
    r, drawn = rng.standard_normal((2, 19, 2)) @ np.array([1.0, 1j])
    below = (1 + 6j * (offset - 0.2)) * (1 + 5j * (offset + 0.5)) if poles else 1.0
    e = (2 + offset) * r / below + noise * drawn
    found = sensitivity._middle(window(e, r), float(np.abs(r).max()), 1e-3)
    value, _, freedom, _, _ = found
    assert freedom == 13 - poles
    exact = 2 / ((1 - 1.2j) * (1 + 2.5j)) if poles else 2.0
    assert abs(value / exact - 1) < 3 * noise


@pytest.mark.parametrize(("unsure", "peak"), [(0.01, 3.0), (0.099, 3.0), (0.101, 1.0)])
def test_three_peaks_of_an_axis_are_looked_at(monkeypatch, unsure, peak):
    """Of five, the higher the further down; one that is not known to a tenth is none."""
    asked = looked_at(monkeypatch, unsure)
    raw = (np.array([5.0]), np.ones(1) + 0j, np.ones(1), np.ones(1))
    candidates = [(9.0 - k, 10.0 * k) for k in range(1, 6)]
    found = sensitivity.Windowed(loop_lines(np.ones(1)), raw[0], raw, candidates)
    assert sensitivity._located("x", found).peak == peak
    assert asked == [10.0, 20.0, 30.0][: 2 + (peak == 3.0)]


def test_three_times_the_rotation_answers_no_excitation():
    record = SimpleNamespace(turns=10.0, fundamental=5.0)
    assert [sensitivity._rotates(record, 50.0 * n) for n in range(1, 6)] == [True] * 3 + [False] * 2
    assert [sensitivity._rotates(record, hertz) for hertz in (102.4, 102.6)] == [True, False]


def periods(*excitation: float) -> SimpleNamespace:
    """Return periods of a line on which S is 2 and 3, and what was added to two axes."""
    r = np.array(excitation)
    lines = np.tile(np.concatenate([r * [2.0, 3.0], r]) + 0j, (4, 1, 1))
    known = {"names": ("e1", "e2", "r1", "r2"), "periods": len(lines), "turns": 0.0}
    return SimpleNamespace(spectra=lines, frequency=np.array([10.0]), fundamental=10.0, **known)


@pytest.mark.parametrize("unit", [1.0, 1e3])
@pytest.mark.parametrize(("records", "alone"), [(1, 0.9e-5), (1, 1.1e-5), (2, 0.9e-6), (2, 1.1e-6)])
def test_what_counts_as_an_axis_own(records, alone, unit):
    """Of one record the share of the other axis, which is silent below a hundred-thousandth of its
    loudest line; of two, how far their directions are apart. The unit of one axis is no matter."""
    if records == 1:
        made, told = [periods(1.0, alone), periods(0.0, 1.0)], alone < 1e-5
        made[1].frequency = np.array([20.0])
    else:
        made, told = [periods(1.0, 1.0), periods(1.0, 1.0 + 4 * alone)], alone > 1e-6
    for record in made:
        record.spectra[..., 3] *= unit
    with nullcontext() if told else pytest.raises(InputError, match="no line on which"):
        assert len(sensitivity._of_periods(made, {"e1": "r1", "e2": "r2"})) == 2


def test_a_reference_that_never_repeats_is_no_noise():
    r = np.random.default_rng(3).standard_normal((200, 2)) @ np.array([[1, 2], [1j, 1 - 1j]])
    record = periods(1.0, 0.0)
    record.names, record.frequency = ("e", "r"), np.array([10.0, 20.0])
    record.periods, record.spectra = len(r), np.stack([2 * r, r], axis=-1)
    ((_, values, *_),) = sensitivity._of_periods([record], {"e": "r"})
    assert values == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize(("times", "lines"), [(4.9, 1), (5.1, 2)])
def test_a_reference_within_its_own_noise_is_none(times, lines):
    """Its second line scatters by 0.01 to both sides, so that its mean is known to 0.005."""
    scatter = 0.01 * np.array([1, -1, 1, -1])
    r = np.stack([np.ones(4), times * 0.005 + scatter], axis=1)
    record = periods(1.0, 0.0)
    record.names, record.frequency = ("e", "r"), np.array([10.0, 20.0])
    record.spectra = np.stack([2 * r + 0j, r + 0j], axis=-1)
    ((found, *_),) = sensitivity._of_periods([record], {"e": "r"})
    assert len(found) == lines


# Poles of a loop counted on the right, against eigenvalues.


GRID = 2 * np.pi * np.concatenate([np.geomspace(1e-3, 1, 200)[:-1], np.geomspace(1, 1e5, 12000)])


class Loop:
    """A plant and a controller kp + kd s + ki / s behind a low pass of the second order."""

    def __init__(self, rng: np.random.Generator) -> None:
        n = int(rng.integers(1, 5))
        root, other = rng.standard_normal((2, n, n))
        turned = rng.standard_normal((n, n))
        self.mass = root @ root.T + np.eye(n)
        self.stiffness = (other @ other.T) * rng.choice([1e4, 0.0])
        self.stiffness += np.diag(rng.uniform(-1e4, 2e4, n))  # magnets
        self.damping = rng.choice([0.0, 0.1, 5.0]) * np.eye(n)
        self.damping += rng.choice([0.0, 50.0]) * (turned - turned.T)  # gyroscopic
        m = int(rng.integers(1, n + 1))
        self.push = rng.standard_normal((n, m))
        self.reads = self.push.T + rng.choice([0.0, 0.3]) * rng.standard_normal((m, n))
        self.gains = rng.uniform([-6e3, -60.0], [3e4, 200.0])
        self.integral = float(rng.choice([0.0, 0.0, 1e5]))
        self.corner = float(rng.choice([1e3, 1e4]))

    def controller(self, s):
        lag = 1 + s / self.corner
        return -(self.gains[0] + self.gains[1] * s / lag + self.integral / s) / lag

    def returned(self, omega):
        s = 1j * omega[:, None, None]
        plant = s**2 * self.mass + s * self.damping + self.stiffness
        driven = np.broadcast_to(self.push + 0j, (len(omega), *self.push.shape))
        answer = self.reads @ np.linalg.solve(plant, driven)
        return np.eye(answer.shape[1]) - self.controller(s) * answer

    def poles(self):
        """Return the poles of the closed loop, from the states of plant and controllers."""
        (n, m), rest = self.push.shape, 1 / self.corner
        below = [rest**2, 2 * rest, 1, 0]
        slow = np.polymul([rest, 1], [self.gains[0], self.integral])
        above = -np.polyadd(slow, [self.gains[1], 0, 0])
        a, b, c, _ = scipy.signal.tf2ss(above, below)
        memory, drive, command = (np.kron(np.eye(m), part) for part in (a, b, c))
        forces = np.hstack([-self.stiffness, -self.damping, self.push @ command])
        act = np.linalg.solve(self.mass, forces)
        states = [
            np.hstack([np.zeros((n, n)), np.eye(n), np.zeros((n, 3 * m))]),
            act,
            np.hstack([drive @ self.reads, np.zeros((3 * m, n)), memory]),
        ]
        return np.linalg.eigvals(np.vstack(states))


@pytest.mark.slow
def test_random_loops_are_counted_as_their_eigenvalues_are():
    rng = np.random.default_rng(4)
    told, untold = [], 0
    for _ in range(150):
        loop = Loop(rng)
        poles = loop.poles()
        if ((np.abs(poles.real) < 0.1) & (np.abs(poles) > 1e-2)).any():
            continue  # neither stable nor not, to the digits of the lines
        plant = poles_of(loop.mass, loop.damping, loop.stiffness)
        found = poles_on_the_right(GRID, loop.returned(GRID), plant)
        if isinstance(found, str):
            untold += 1
        else:
            told.append((found, int((poles.real > 0.1).sum())))
    assert all(found == wanted for found, wanted in told)
    assert len({wanted for _, wanted in told}) >= 4
    assert untold < 0.05 * len(told)


def single(kp: float, kd: float, delay: float, omega, k: float = 0.0):
    """Return 1 + L and the plant's poles of 1 kg on a spring with a controller and a delay."""
    s = 1j * omega
    returned = 1 + (kp + kd * s) * np.exp(-s * delay) / (s**2 + k)
    return returned[:, None, None], poles_of(np.eye(1), np.zeros((1, 1)), np.array([[k]]))


def test_a_delay_and_a_negative_stiffness():
    omega = np.geomspace(0.1, 1e5, 5000)
    for delay, count in ((0.0, 0), (5e-3, 0), (5e-2, 2), (0.5, None)):
        found = poles_on_the_right(omega, *single(1e3, 20.0, delay, omega))
        assert found == count or (count is None and isinstance(found, int) and found > 2)
    assert poles_on_the_right(omega, *single(500.0, 20.0, 0.0, omega, k=-1e3)) == 1
    assert poles_on_the_right(omega, *single(1500.0, 20.0, 0.0, omega, k=-1e3)) == 0
    assert poles_on_the_right(omega, *single(0.0, 0.0, 0.0, omega)) == 0  # free, and not held


def test_lines_that_do_not_tell_say_why():
    def said(omega, kd=20.0, k=1e3):
        return poles_on_the_right(omega, *single(1e3, kd, 0.0, omega, k=k))

    assert said(np.geomspace(0.1, 1e4, 500)) == 0
    # |L| at the end is .8 at 53.2 rad/s
    assert said(np.geomspace(0.1, 55.0, 500)) == 0
    assert "widen the band" in str(said(np.geomspace(0.1, 51.0, 500)))

    def apart(step):  # about a pole .2 1/s left of the axis: D turns by 2 atan(step / .4)
        omega = np.sqrt(2000 - 0.04) + step * (np.arange(-100, 3000) + 0.5)
        return said(omega[omega > 0.5], kd=0.4)

    assert apart(0.4) == 0  # 90 degrees
    assert "closer" in str(apart(0.6))  # 113 degrees

    def begun(first):  # a magnet's negative stiffness that is not overcome: a pole at +14.5 1/s
        omega = np.geomspace(first, 1e5, 6000)
        return poles_on_the_right(omega, *single(500.0, 20.0, 0.0, omega, k=-1e3))

    assert begun(8.0) == 1
    assert "lower" in str(begun(12.0))
    pole = np.array([1e3j, -1e3j])
    for omega, values in (([1e3], np.ones(1)), ([1e2, 1e3, 1e4], np.array([1.0, np.nan, 1.0]))):
        answer = poles_on_the_right(np.array(omega), values[:, None, None], pole)
        assert answer == "its lines are too few, or one is on a pole of the plant"


def test_a_loop_that_runs_away_has_no_sensitivity():
    """Its S on the lines is a number all the same, and small."""
    model = rid.load_model("rigid")
    a, b = model.nominal["L_a"], model.nominal["L_b"]
    sensors = [f"x - {a}*theta_y", f"y + {a}*theta_x", f"x + {b}*theta_y", f"y - {b}*theta_x"]
    laws = dict.fromkeys(model.inputs, (100.0, 2e5))

    def found(kp, kd, hertz):
        def control(omega):
            return -(kp + 1j * omega * kd)[:, None, None] * np.eye(4)

        return list(rid.loop_sensitivity(model, control, hertz, sensors=sensors, laws=laws).axes)

    hertz = np.arange(0.5, 2000.0, 1.0)
    assert [axis.zone for axis in found(8e3, 20.0, hertz)[:2]] == ["A", "A"]
    for kp, kd in ((8e3, -20.0), (500.0, 5.0)):
        for axis in found(kp, kd, hertz):
            assert np.isinf(axis.peak)
            assert axis.zone == "D"
            assert "not stable" in axis.verdict
            assert np.abs(axis.sensitivity).max() < 10
    (axis, *_) = found(8e3, 20.0, np.arange(0.5, 60.0, 1.0))
    assert axis.zone == "A or worse"
    assert "not told, the loop still acts at its end" in axis.verdict


@pytest.mark.parametrize(
    ("away", "angle"),
    [
        (1 + 1j, 0.25),
        (1.1e-9 - 1j, -0.5),
        (-0.9e-9 - 1j, -0.5),  # on the axis, to rounding
        (-1.1e-9 - 1j, 1.5),
        (-1 + 1j, 0.75),
    ],
)
def test_a_pole_on_the_right_has_gone_past_half_a_turn(away, angle):
    assert _from_above(np.array([7.0 * away]))[0] / np.pi == pytest.approx(angle, abs=1e-6)


# The peak of S on the lines of whole records, held against loops in closed form.


@pytest.mark.sampled(0, parts=2)
@pytest.mark.parametrize(
    ("seconds", "gains", "size"), [(4, (2e4, 10.0), 3.1019), (2, (3e4, 14.0), 3.8956)]
)
def test_a_peak_that_is_narrower_than_a_window_of_lines(seconds, gains, size):
    """2 Hz wide at its half power, windows of 22 lines 5.5 and 11 Hz: parabolas said zone A."""
    record, exact = sampled_loop(*gains, seconds, np.random.default_rng(3))
    assert exact == pytest.approx(size, rel=1e-4)
    (found,) = rid.sensitivity(record, {"e": "r"}, band=("8 Hz", "400 Hz"))
    assert found.interval[0] < exact < found.interval[1]
    assert found.interval[1] / found.interval[0] < 1.01
    assert found.verdict == "zone B"
    assert np.abs(found.sensitivity).max() == pytest.approx(found.peak)  # as it is drawn


@pytest.mark.sampled(0, parts=3)
@pytest.mark.parametrize(("gain", "zone"), [(2.0, "A or worse"), (1.43, "A or worse"), (0.5, "D")])
def test_a_reference_of_another_unit_or_gain(gain, zone):
    record, exact = sampled_loop(1.5e5, 60.0, 2, np.random.default_rng(4), damping=60.0, gain=gain)
    (found,) = rid.sensitivity(record, {"e": "r"}, band=("8 Hz", "400 Hz"))
    assert found.peak == pytest.approx(exact / gain, rel=0.02)
    assert found.zone == zone
    for said in (found.verdict, worst_of([found])):
        assert "not in one unit or gain, or the loop still has gain there" in said
        assert f"zone {zone}" in said


def test_where_s_comes_to():
    """Edges of LEAST_SETTLED, UNIT and FLAT, and of AT_END where the change is noise."""
    lines = np.linspace(10.0, 300.0, 60)
    quiet = np.full(60, 1e-5)

    def said(values, std=quiet):
        return bool(settles_elsewhere(lines[: len(values)], values + 0j, std[: len(values)]))

    assert "stays at 0.51" in settles_elsewhere(lines, np.full(60, 0.51 + 0j), quiet)
    assert not said(np.ones(60))
    # What falls as the gain of a loop does is its gain.
    for power in (1, 2):
        assert not said(1 + 0.3 * (10 / lines) ** power)
        assert not said(1 - 0.3 * np.exp(-2j * lines / 300) * (300 / lines) ** power)
    assert [said(np.full(60, 1 + off)) for off in (0.029, 0.031, -0.031)] == [False, True, True]
    # A parabola's end is known to .61 of what each of its twenty lines is: a change of twice that.
    off = 4 * 2 * 0.609 * 0.1 * np.sqrt(2)
    noisy = np.full(60, 0.1)
    assert [said(np.full(60, 1 + x * off), noisy) for x in (0.98, 1.02)] == [False, True]
    steps = 1.3 + 0.3 * np.clip((lines - 202.0) / 98.0, 0, 1)
    assert [said(1.5 + slope * (steps - 1.45)) for slope in (0.35, 0.45)] == [True, False]
    assert [said(np.full(count, 0.5)) for count in (14, 15)] == [False, True]


def made(size: int, noise: float, rng: np.random.Generator, coloured: bool = False) -> LineWindow:
    """Return lines of S = 1 + 2 / (1 + 20i x) with a transient of its pole."""
    place = np.linspace(-1.0, 1.0, size)
    below = 1 + 20j * place
    r = rng.standard_normal((size, 2)) @ np.array([1.0, 1j])
    drawn = noise * (rng.standard_normal((size, 2)) @ np.array([1.0, 1j])) / np.sqrt(2)
    drawn = drawn / below * 3 if coloured else drawn
    e = (1 + 2 / below) * r + 0.5 / below + drawn
    return window(e, r)


def test_curves_have_the_poles_that_their_lines_tell():
    rng = np.random.default_rng(1)
    exact = peak.best_curve(made(60, 1e-6, rng))
    assert exact.poles == 1
    assert exact.roots[0] == pytest.approx(0.05j, rel=1e-3)
    assert np.abs(exact.at(np.zeros(1))[0]) == pytest.approx(3.0, rel=1e-5)
    # Without poles the same lines are missed, which is seen.
    assert peak.judged(exact, -0.6, 0.6).chance > 1e-3
    assert peak.judged(peak.fitted(exact.part, 0), -0.6, 0.6).chance < 1e-2
    assert [peak.least_lines(2, 2, poles) for poles in peak.POLES] == [28, 29, 33, 37]


@pytest.mark.slow
def test_deviations_of_peaks_hold_with_noise_on_all_lines_and_with_that_of_the_loop():
    """Three lines wide at the half power, where noise of the loop is all there is."""
    for coloured, least in ((False, 0.93), (True, 0.85)):
        rng = np.random.default_rng(2)
        held = []
        for _ in range(60):
            found = peak.judged(peak.best_curve(made(60, 0.1, rng, coloured)), -0.6, 0.6)
            low, high = found.interval(0.95)
            held.append(low < 3.0 < high)
            assert high / low < 2
        assert np.mean(held) >= least


def test_lines_that_tell_no_peak():
    part = made(200, 50.0, np.random.default_rng(5))
    assert peak.peak_near(loop_lines(part.e, part.r[:, 0]), 100.0) is None


# The decisions of a peak's fit, each at its edge.


def curve_of(part: LineWindow, pole: complex, loss: float = 1.0) -> RationalCurve:
    """Return a curve of one pole, or of none, that explains nothing of its lines."""
    below = np.array([-1 / pole]) if pole else np.zeros(0, dtype=np.complex128)
    order = peak.order_of(len(below))
    return RationalCurve(part, order, below, np.zeros(2 * (order + 1), dtype=np.complex128), loss)


@pytest.mark.parametrize(("chance", "poles"), [(0.0095, 1), (0.0105, 0)])
def test_a_pole_more_has_to_gain(monkeypatch, chance, poles):
    part = window(np.ones(100))
    one, none = curve_of(part, 0.1 + 0.2j), curve_of(part, 0.0)
    more = len(one.linear) + 1 - len(none.linear)
    rest = len(part.e) - len(one.linear) - 1
    ratio = scipy.special.fdtri(2 * more, 2 * rest, 1 - chance)
    further = RationalCurve(part, 3, np.zeros(2) + 0j, np.zeros(8) + 0j, 1.0)
    curves = {0: replace(none, loss=1 + ratio * more / rest), 1: one, 2: further}
    monkeypatch.setattr(peak, "fitted", lambda _, poles: curves[poles])
    assert peak.best_curve(part).poles == poles


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8, 0.95, 0.99, 1.0])
def test_noise_has_the_poles_of_the_loop_by_a_share(share):
    """What is left has exactly that share's size on each line: no other weighs it as well."""
    part = window(np.ones(100))
    poles = 1 / np.abs(1 - part.place / (0.1 + 0.05j)) ** 2
    size = 1 - share + share * poles / poles.mean()
    weighed = peak._weighed(curve_of(replace(part, e=np.sqrt(size) + 0j), 0.1 + 0.05j))
    np.testing.assert_allclose(weighed.weight, 1 / np.sqrt(size), rtol=1e-12)


@pytest.mark.parametrize(("lines", "decays"), [(0.48, False), (0.52, True)])
def test_a_pole_that_does_not_decay_is_none(lines, decays):
    spacing = 2 / 99
    assert curve_of(window(np.ones(100)), 0.1 + 1j * lines * spacing).decays == decays


def at(place: float, **given: float | bool) -> Peak:
    whole = {"std": 0.1, "dof": 20.0, "chance": 0.5, "width": np.inf, "inside": True, **given}
    return Peak(value=1.0 + 0j, place=place, **whole)


@pytest.fixture
def climbing(monkeypatch):
    """Climb to a frequency from 500 Hz by windows of 100 lines, 1 Hz apart; and count them."""
    band = loop_lines(np.arange(1000.0), np.arange(1000.0))

    def climb(target: float) -> tuple[Peak | None, int]:
        seen = []

        def highest(begin: float, low: float, high: float) -> Peak:
            seen.append((low, high))
            place = (target - begin) / 49.5 - 1
            return at(float(np.clip(place, low, high)), inside=low < place < high)

        monkeypatch.setattr(peak, "best_curve", lambda part: float(part.e[0].real))
        monkeypatch.setattr(peak, "judged", highest)
        return band.climbed(500.0, 100), len(seen)

    return climb


def test_lines_are_moved_on_to_the_highest_point(climbing):
    middle, inner = 450 + 49.5, 0.6 * 49.5
    assert climbing(middle + inner - 0.4)[1] == 1
    assert climbing(middle + inner + 0.4)[1] == 2
    found, times = climbing(612.0)
    assert (found.hertz, times) == (pytest.approx(612.0), 4)
    assert climbing(630.0) == (None, 4)


def near(monkeypatch, peaks: list[tuple[float, float]]) -> tuple[Peak | None, int]:
    """Return the peak near 500 Hz, and the windows that were tried, of peaks as they come."""
    sizes = []

    def climbed(_: LoopLines, hertz: float, size: int) -> Peak:
        sizes.append(size)
        std, chance = peaks[min(len(sizes), len(peaks)) - 1]
        return replace(at(0.0, std=std, chance=chance), hertz=500.0, span=50.0)

    monkeypatch.setattr(LoopLines, "climbed", climbed)
    lines = np.arange(100_000.0)
    found = peak.peak_near(loop_lines(lines, lines), 500.0)
    assert sizes == [sizes[0] * 2**k for k in range(len(sizes))]
    return found, len(sizes)


@pytest.mark.parametrize(
    ("unsure", "tried"), [([0.1, 0.2], 1 + 3), ([0.2, 0.21, 0.22, 0.1, 0.2], 4 + 3)]
)
def test_wider_windows_are_tried_until_three_tell_no_more(monkeypatch, unsure, tried):
    assert near(monkeypatch, [(std, 0.5) for std in unsure])[1] == tried


@pytest.mark.parametrize(
    ("unsure", "chance", "told"),
    [(0.29, 0.5, True), (0.31, 0.5, False), (0.1, 1.1e-3, True), (0.1, 0.9e-3, False)],
)
def test_a_peak_has_to_be_told_and_followed(monkeypatch, unsure, chance, told):
    found, _ = near(monkeypatch, [(unsure, chance)])
    assert (found is not None) == told
