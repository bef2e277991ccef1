"""The rotation beside the periods, on a shaft with one disc whose motion is a closed form."""

import numpy as np
import pytest
from io_writers import write_table

import rotorid as rid
from rotorid.testing import bind

RATE, SIZE = 1000.0, 50
FUNDAMENTAL = RATE / SIZE
TRUTH = {"m": 2.0, "c": 60.0, "k": 4e4, "xi": 2e-5, "zeta": -1e-5}
LINES = (1, 2, 4, 5)
STATED = 5e-3  # the share by which a stated speed may be off
MODEL = rid.load_model("jeffcott")


def shaft(turns, periods=40, *, rng=None, stated=None, noise=(0.3, 1e-6), order=2, phi=None):
    """Return a record of so many turns a period; `phi`: its angle, where the speed is not even."""
    t = np.arange(periods * SIZE) / RATE
    omega = 2 * np.pi * turns * FUNDAMENTAL
    angle = omega * t if phi is None else phi
    m, c, k = (TRUTH[name] for name in "mck")
    draw = np.random.default_rng(7)
    force = 5.0 * np.exp(2j * np.pi * draw.random((len(LINES), 2)))
    w = 2 * np.pi * FUNDAMENTAL * np.array(LINES)
    motion = force / (k - m * w**2 + 1j * c * w)[:, None]
    wave = np.exp(1j * np.outer(t, w))
    eccentric = np.array([1.0, -1j]) * (TRUTH["xi"] + 1j * TRUTH["zeta"])
    turned = m * omega**2 * eccentric / (k - m * omega**2 + 1j * c * omega)
    x = (wave @ motion).real + (np.exp(1j * angle)[:, None] * turned).real
    x += 1e-5 * np.cos(order * angle)[:, None]
    columns = np.column_stack([(wave @ force).real, x])
    if rng is not None:
        columns += rng.standard_normal(columns.shape) * np.repeat(noise, 2)
    channels = [rid.Channel(name) for name in ("F_x", "F_y", "x", "y")]
    given = omega if stated is None else 2 * np.pi * stated * FUNDAMENTAL
    return rid.Record(channels, columns, RATE, given, phi), motion, turned


def periods_of(record, harmonics=LINES):
    return rid.average(record, FUNDAMENTAL, harmonics=harmonics)


@pytest.mark.parametrize("turns", [3.75, 4.005, -2.31])
def test_noise_free_lines_are_those_of_the_period_and_of_the_rotation_to_rounding(turns):
    record, motion, turned = shaft(turns)
    periods = periods_of(record)
    assert periods.mean_spectrum[:, 2:] == pytest.approx(motion / 2, rel=1e-9)
    line = (turned if turns > 0 else turned.conj()) / 2
    assert periods.rotation.spectra[:, 2:] == pytest.approx(np.tile(line, (40, 1)), rel=1e-9)
    scatter = periods.spectra - periods.mean_spectrum
    assert np.abs(scatter[..., 2:]).max() < 1e-9 * np.abs(motion).max()
    assert periods.variance[:, 2:].max() < 1e-18 * np.abs(motion).max() ** 2


def test_a_measured_angle_carries_a_rotation_whose_speed_varies():
    t = np.arange(40 * SIZE) / RATE
    phi = 2 * np.pi * FUNDAMENTAL * 3.4 * t + 0.8 * np.sin(2 * np.pi * 0.7 * t) + 0.3
    record, motion, turned = shaft(3.4, phi=phi)
    periods = periods_of(record)
    assert periods.mean_spectrum[:, 2:] == pytest.approx(motion / 2, rel=1e-9)
    assert periods.rotation.spectra.mean(axis=0)[2:] == pytest.approx(
        turned / 2 * np.exp(0.3j), rel=1e-9
    )


@pytest.mark.parametrize("slip", [0.0, 0.03, 0.08, 0.12])
def test_a_rotation_that_gains_less_than_a_tenth_of_a_turn_stays_on_its_line(slip):
    record, motion, turned = shaft(4 + slip / 40)
    periods = periods_of(record)
    assert (periods.rotation is not None) == (slip > 0)
    t = np.arange(40 * SIZE) / SIZE
    wave = (np.exp(2j * np.pi * (4 + slip / 40) * t)[:, None] * turned).real if slip < 0.1 else 0.0
    held = (wave * np.exp(-8j * np.pi * t)[:, None]).mean(axis=0) if slip < 0.1 else 0.0
    lines = motion / 2 + (np.array(LINES) == 4)[:, None] * held
    assert periods.mean_spectrum[:, 2:] == pytest.approx(lines, rel=1e-8)
    scatter = np.abs(periods.spectra - periods.mean_spectrum)[..., 2:].max(axis=(0, 2))
    assert scatter[:2].max() < 1e-9 * np.abs(motion).max()
    assert scatter[2] < np.sqrt(40) * 0.1 / (4 * 40) * np.abs(turned).max()  # as told of its loads


FILE = """
model = "jeffcott"
[[records]]
file = "run.csv"
sample_rate = "1 kHz"
fundamental = "20 Hz"
harmonics = [1, 2, 4, 5]
speed = "75.004 Hz"
[channels]
F_x = { column = "F_x", unit = "N" }
F_y = { column = "F_y", unit = "N" }
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
"""


def test_blocks_find_what_the_whole_record_does(tmp_path, monkeypatch):
    record, *_ = shaft(3.75, rng=np.random.default_rng(1), stated=3.7502)
    write_table(tmp_path / "run.csv", "F_x,F_y,x,y", record.samples, fmt="%.17g")
    (tmp_path / "run.toml").write_text(FILE)
    monkeypatch.setattr("rotorid.io.columns.WORTH", 0)
    monkeypatch.setattr("rotorid.io.columns.ROWS", 333)
    (found,), whole = rid.load_experiment(tmp_path / "run.toml").records(), periods_of(record)
    assert found.speed == pytest.approx(whole.speed, rel=1e-12)
    assert found.spectra == pytest.approx(whole.spectra, rel=1e-9)
    assert found.rotation.spectra == pytest.approx(whole.rotation.spectra, rel=1e-9)


def told_of_speed(periods):
    return [c for c in periods.checks if c.about == "speed" and c.severity == "says"]


def test_the_speed_that_the_lines_show_takes_the_place_of_one_that_is_off():
    turns, rng = 3.75, np.random.default_rng(2)
    true = 2 * np.pi * turns * FUNDAMENTAL
    right = periods_of(shaft(turns, rng=rng)[0])
    assert right.speed == true
    assert not told_of_speed(right)
    for off in (3e-4, -6e-3, 0.02):  # .012, .24 and .8 turns in the record
        found = periods_of(shaft(turns, rng=rng, stated=turns + off)[0])
        assert "that speed is used" in told_of_speed(found)[0].text
        assert abs(found.speed - true) < 4 * found.phase_std / 1.0  # the middle is at 1 s
        assert 0 < found.phase_std < 0.05


@pytest.mark.parametrize(("turns", "periods"), [(4 + 0.3 / 12, 12), (3.75, 2), (3.7, 3)])
def test_deviations_are_those_of_the_joint_solution(turns, periods):
    left = []
    for seed in range(150):
        rng = np.random.default_rng(seed)
        record, motion, turned = shaft(turns, periods, rng=rng, order=3)
        lines = bind(MODEL, periods_of(record)).lines
        truth = np.insert(motion, 3 if turns > 4 else 2, turned, axis=0) / 2
        variance = np.diagonal(lines.covariance.matrices, axis1=1, axis2=2).real[:, 2:]
        left.append(np.stack([np.abs(lines.mean[:, 2:] - truth) ** 2, variance]))
    square, stated = np.mean(left, axis=(0, 3))
    assert np.sqrt(square / stated) == pytest.approx(np.ones(5), abs=0.07 * np.sqrt(12 / periods))
    if periods == 12:  # a third of a turn beside a line: both scatter twice as much as alone
        beside = np.sqrt(1 / (1 - np.sinc(0.3) ** 2))
        assert np.sqrt(stated[3] / stated[0]) == pytest.approx(beside, 0.05)


@pytest.mark.parametrize("turns", [4 + 0.02 / 40, 4 + 0.09 / 40, 2 + 0.02 / 40, -4 - 0.05 / 40])
def test_a_right_speed_beside_a_line_or_half_of_one_is_no_drift(turns):
    record, *_ = shaft(turns, rng=np.random.default_rng(8), noise=(0.03, 1e-8))
    assert not [c for c in periods_of(record).checks if c.severity == "warns"]


def test_a_mask_leaves_the_speed_to_be_estimated():
    record, *_ = shaft(3.75, rng=np.random.default_rng(2), stated=3.756)
    valid = np.arange(len(record.samples)) % 400 > 3  # one period of eight
    some = rid.Record(record.channels, record.samples, RATE, record.speed, valid=valid)
    found, truth = periods_of(some), 2 * np.pi * 3.75 * FUNDAMENTAL
    assert found.periods == 35
    assert abs(found.speed - truth) < 0.1 * abs(record.speed - truth)


def identified(seed, turns, periods, stated=None, noise=(0.3, 1e-6)):
    rng = np.random.default_rng([seed, 5])
    record, *_ = shaft(turns, periods, rng=rng, order=3, stated=stated, noise=noise)
    return rid.identify(MODEL, periods_of(record), rid.MaximumLikelihood())


def shift_of(found):
    return next((each for each in found.assumptions if each.assumed == "speed"), None)


@pytest.mark.parametrize(("turns", "periods"), [(7.24, 2), (2.45, 3)])
def test_a_stated_speed_that_no_period_tells_moves_the_unbalance_as_is_said(turns, periods):
    right, off = (
        identified(1, turns, periods, turns * (1 + by), noise=(0.03, 1e-7))
        for by in (0, 0.1 * STATED)
    )
    told = shift_of(right)
    moved = abs(off.value(told.parameter) - right.value(told.parameter))
    assert told.moves == pytest.approx(10 * moved / right.std(told.parameter), rel=0.1)
    assert "record a mark" in told.cure
    assert told.size == f"{60 * FUNDAMENTAL * turns * STATED:.2g} rpm"


def test_a_speed_that_periods_tell_or_a_mark_measures_is_assumed_no_further():
    few, more = (shift_of(identified(2, 3.75, n, noise=(0.03, 1e-7))) for n in (3, 8))
    assert few.moves > 2
    assert more is None or more.moves < 4  # what noise leaves of it
    t = np.arange(3 * SIZE) / RATE
    record, *_ = shaft(
        3.75, 3, rng=np.random.default_rng(2), phi=2 * np.pi * FUNDAMENTAL * 3.75 * t
    )
    marked = rid.identify(MODEL, periods_of(record), rid.MaximumLikelihood())
    assert shift_of(marked) is None


def test_least_squares_says_what_leaks_into_the_lines_that_it_uses():
    periods = periods_of(shaft(3.74, rng=np.random.default_rng(4))[0])
    for method, said in ((rid.Batch(), True), (rid.MaximumLikelihood(), False)):
        notes = rid.identify(MODEL, periods, method).notes
        assert any("not synchronous" in note.text for note in notes) == said


@pytest.mark.parametrize(("turns", "stated"), [(1.58, 1.58), (2.33, 2.33), (3.9, 3.75)])
def test_a_rotation_beside_the_periods_is_no_other_tone_and_no_longer_period(turns, stated):
    record, *_ = shaft(turns, 20, rng=np.random.default_rng(6), stated=stated, noise=(0.03, 1e-7))
    told = {c.about for c in periods_of(record).checks if c.severity == "warns"}
    assert ("speed" in told) == (turns != stated)
    assert turns != stated or not told


@pytest.mark.parametrize(("strays", "severity"), [(0.2, "passes"), (0.5, "warns")])
def test_a_speed_that_wanders_is_told_where_it_takes_some_of_the_line(strays, severity):
    t = np.arange(60 * SIZE) / RATE
    phi = 2 * np.pi * FUNDAMENTAL * 3.4 * t + strays * np.sin(2 * np.pi * 0.7 * t)
    record, *_ = shaft(3.4, 60, rng=np.random.default_rng(3), phi=phi)
    even = rid.Record(record.channels, record.samples, RATE, record.speed)
    for each, said in ((even, severity), (record, "passes")):
        assert [c.severity for c in periods_of(each).checks if c.about == "wander"] == [said]


def test_the_unbalance_between_lines_is_as_sharp_as_on_one():
    beside, on = identified(1, 3.75, 60), identified(1, 4.0, 60)
    assert beside.status == on.status == "ok"
    for name in ("xi", "zeta"):
        assert beside.std(name) / on.std(name) < 1.3 * (4.0 / 3.75) ** 4
        assert abs(beside.value(name) - TRUTH[name]) < 4 * beside.std(name)


@pytest.mark.sampled(0, parts=2)
@pytest.mark.parametrize(
    ("slip", "periods", "off"),
    [(0.05, 60, 0), (0.2, 60, 0), (0.78, 60, 0), (15.0, 60, 0), (0.2, 60, 0.1), (0.5, 3, 0)],
)
def test_intervals_hold_at_any_place_between_lines(slip, periods, off):
    inside, ok, turns = [], 0, 4 + slip / periods
    for seed in range(100):
        found = identified(seed, turns, periods, turns + off / periods)
        ok += found.status == "ok"
        inside += [abs(found.value(n) - v) < 1.96 * found.std(n) for n, v in TRUTH.items()]
    assert ok >= 98
    assert 0.92 < np.mean(inside) < 0.985


@pytest.mark.parametrize(
    ("turns", "stated", "tone", "status"),
    [
        (4, None, 2.637, "ok"),  # another machine: the unbalance stands where the speed is given
        (2.637, 4, None, "rejected"),  # nothing turns at the speed given
        (5, None, 2.51, "rejected"),  # or what turns there may do so twice per revolution
    ],
)
def test_an_orbit_beside_the_speed_rejects_unless_the_unbalance_tells_the_speed(
    turns, stated, tone, status
):
    record = shaft(turns, 80, rng=np.random.default_rng(1), stated=stated, noise=(0.1, 8e-7))[0]
    channels = [rid.Channel(c.name, unit) for c, unit in zip(record.channels, "NNmm", strict=True)]
    angle = 2 * np.pi * (tone or 0.0) * FUNDAMENTAL * np.arange(len(record.samples)) / RATE
    orbit = 3e-6 * np.column_stack([0 * angle, 0 * angle, np.cos(angle), np.sin(angle)])
    record = rid.Record(channels, record.samples + orbit, RATE, record.speed)
    estimate = rid.identify(MODEL, periods_of(record), "ml")
    (note,) = (n for n in estimate.notes if n.about == "speed" and n.severity == "warns")
    assert estimate.status == status
    assert ("that is the rotation" in note.found) == (status == "ok")
