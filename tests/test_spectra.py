"""Records without periods: their lines, and what is found in them."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bank import agrees
from io_writers import write_table
from levitated import (
    KNOWN,
    MODEL,
    QUICK,
    RATE,
    SPEED,
    TRUTH,
    levitated,
    levitated_together,
    lines_of,
)
from linear_machines import written
from scipy.linalg import expm

import rotorid as rid
from rotorid import InputError, cli, identify, spectra
from rotorid.data.whole_record import TRANSIENT
from rotorid.experiment.duplicates import Wave, check_rotation
from rotorid.likelihood import fit
from rotorid.likelihood.unknowns import Nuisances, phases
from rotorid.signals import local_polynomial
from rotorid.signals.checks.rotation import MUCH, shown_rotation
from rotorid.signals.local_polynomial import columns_of, local_covariance
from rotorid.testing import bind_all

# -------------------------------------------------------------------------------------------------
# Lines of whole records: transient, loads on no line, noise from references, quiet or inputs.


def deviations(estimate) -> np.ndarray:
    return np.array([(estimate.value(n) - v) / estimate.std(n) for n, v in TRUTH.items()])


@pytest.fixture(scope="module")
def record():
    return levitated(1)


@pytest.mark.slow
def test_without_references_the_misfit_sees_the_closed_loop():
    """Inputs taken as free of noise, where the loop feeds the sensor's noise into them."""
    loud = levitated(1, excitation=5.0, noise_std=1e-5)
    strong = replace(loud, channels=loud.channels[:4], samples=loud.samples[:, :4])
    estimate = identify(MODEL, spectra(strong, (2.0, 200.0), inputs=MODEL.inputs), KNOWN)
    assert any("free of noise" in warning for warning in estimate.warnings)
    assert estimate.misfit.p_value < 1e-3
    first = next(w for w in estimate.warnings if w.startswith("the data reject the model"))
    assert first.endswith("give references or a quiet record first")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("order", "low"), [(None, 1.5), (0, 1.1)])
def test_the_transient_is_needed(record, order, low):
    lines = lines_of(record)
    assert lines.transient == TRANSIENT == 2
    without = identify(MODEL, replace(lines, transient=order), QUICK)
    assert without.misfit.cost > low * without.misfit.expected


@pytest.mark.parametrize("quiet", [False, True])
def test_a_speed_otherwise_than_stated_is_named_before_anything_is_searched(
    record, quiet, monkeypatch
):
    """The lines show it by themselves; the model at that speed explains them."""
    monkeypatch.setattr(fit, "search", None)
    still = levitated(2, excitation=0.0)
    more = {"quiet": replace(still, speed=-1.01 * SPEED)} if quiet else {}
    lines = lines_of(replace(record, speed=-1.01 * SPEED), **more)
    assert lines.shown == pytest.approx(-SPEED, rel=1e-5)
    lines = lines_of(replace(record, speed=1.01 * SPEED), **more)
    if quiet:  # of which another speed is stated: what it shows is its own
        assert lines.shown is None
        return
    estimate = identify(MODEL, lines, KNOWN)
    assert estimate.status == "rejected"
    assert [s.term for s in estimate.suspects] == ["speed"]
    assert estimate.suspects[0].value == pytest.approx(SPEED, rel=1e-5)
    assert "Hz), which its lines show, with which the misfit falls" in estimate.warnings[0]
    assert abs(estimate.value("k") / TRUTH["k"] - 1) < 0.01


@pytest.mark.sampled(1)
@pytest.mark.parametrize("off", [0.3, -1.1])
def test_a_speed_less_than_a_line_off_is_named(record, off):
    """A display that is off by a revolution a minute: what to write instead is said first."""
    stated = SPEED + 2 * np.pi * off / (len(record.samples) / RATE)
    estimate = identify(MODEL, lines_of(replace(record, speed=stated)), KNOWN)
    assert estimate.status == "rejected"
    assert estimate.suspects[0].term == "speed"
    assert estimate.suspects[0].value == pytest.approx(SPEED, rel=1e-5)
    assert re.search(r"correct speed: 3682\.[12]\d? rpm", estimate.warnings[0])
    assert any("stand out of the noise" in warning for warning in estimate.warnings)
    worst = max(estimate.line_misfit, key=lambda line: line.cost / line.expected)
    assert worst.frequency_hz == pytest.approx(61.37, abs=0.5)


@pytest.mark.slow
def test_hum_beside_the_rotation_is_not_taken_for_it(record):
    """At the speed of the hum nothing is explained: the answer stays that of the speed stated."""
    hum = 3e-6 * np.sin(2 * np.pi * 59.8 * np.arange(len(record.samples)) / RATE)
    samples = record.samples + hum[:, None] * [0, 0, 1, 1, 0, 0]
    lines = lines_of(replace(record, samples=samples))
    assert lines.shown == pytest.approx(2 * np.pi * 59.8, rel=1e-4)
    estimate = identify(MODEL, lines, KNOWN)
    assert estimate.status == "rejected"
    assert "speed" not in [s.term for s in estimate.suspects[:1]]
    assert estimate.value("xi") == pytest.approx(TRUTH["xi"], rel=0.1)


def tone(place: float, count: int = 200) -> np.ndarray:
    """Return the lines of a tone that stands between them, at a place of its own."""
    k = np.arange(count)
    return (np.where(k % 2, -1, 1) * np.sinc(k - place))[:, None] + 0j


@pytest.mark.parametrize(
    ("stated", "place", "found"),
    [(100.45, 102, True), (100.55, 102, False), (99.1, 102, True), (98.9, 102, False)],
)
def test_where_a_rotation_is_looked_for(stated, place, found):
    """Beyond what the one stated takes up, within three percent, and with lines on both sides."""
    rng = np.random.default_rng(4)
    lines = rng.standard_normal((200, 2, 2)) @ np.array([1, 1j]) + 300 * tone(place + 0.2)
    one = np.ones((200, 1)) + 0j
    shown = shown_rotation(lines, one, one[:, :0], np.array([place]), stated)
    assert (shown is not None) == found
    assert shown is None or abs(shown - place - 0.2) < 0.01


def test_a_rotation_is_told_with_as_many_lines_on_each_side():
    lines, one = tone(147.0, 160), np.ones((160, 1)) + 0j
    shown = shown_rotation(lines, one, one[:, :0], np.array([147]), 149.0)
    assert shown == pytest.approx(147, abs=1e-3)
    assert shown_rotation(lines, one, one[:, :0], np.array([148]), 150.0) is None


@pytest.mark.parametrize(("off", "found"), [(0.2, True), (-1.4, True), (0.004, False)])
def test_a_rotation_less_than_a_line_from_the_one_stated_stands_in_its_place(off, found):
    """Beside a column for the one stated the search would end a line off, at neither of them."""
    rng = np.random.default_rng(5)
    lines = rng.standard_normal((200, 2, 2)) @ np.array([1, 1j]) + 100 * tone(100.4 + off)
    one = np.ones((200, 1)) + 0j
    shown = shown_rotation(lines, one, tone(100.4), np.array([99, 101, 102]), 100.4)
    assert (shown == pytest.approx(100.4 + off, abs=0.005)) == found


@pytest.mark.parametrize(("more", "found"), [(0.9, None), (1.1, 100.6)])
def test_how_much_better_another_place_has_to_be(more, found):
    """What neither place takes up is a line alone: a quarter of what one leaves, or less."""
    lines, stated = tone(100.6), tone(100.4)
    window = slice(88, 113)
    basis = stated[window] / np.linalg.norm(stated[window])
    left = np.linalg.norm(lines[window] - basis @ (basis.T @ lines[window]))
    lines[108] += left / np.sqrt((MUCH - 1) * more)
    shown = shown_rotation(lines, lines[:, :0], stated, np.array([100]), 100.4)
    assert shown == (found if found is None else pytest.approx(found, abs=0.01))


def test_only_what_lies_between_skip_and_until_is_used(record):
    lines = lines_of(record, skip=1.0, until=4.0)
    assert np.diff(lines.frequency) == pytest.approx(1 / 3)
    assert np.abs(deviations(identify(MODEL, lines, QUICK))).max() < 3.5


@pytest.mark.slow
def test_deviations_hold():
    """40 records: rms of error over deviation, coverage, and the misfit test."""
    found = [identify(MODEL, lines_of(record), QUICK) for record in levitated_together(range(40))]
    scaled = np.array([deviations(estimate) for estimate in found])
    p_values = np.array([estimate.misfit.p_value for estimate in found])
    assert 0.85 < np.sqrt((scaled**2).mean()) < 1.15
    assert 0.9 < (np.abs(scaled) < 1.96).mean() < 0.99
    assert (p_values < 0.05).mean() < 0.15
    assert 0.2 < p_values.mean() < 0.8


def test_covariance_of_white_noise_beside_a_smooth_response():
    """C is that of the noise, though the signal is a thousand times larger."""
    rng = np.random.default_rng(3)
    count, channels = 4000, 3
    reference = rng.standard_normal((count, 1, 2)) @ np.array([1, 1j])
    omega = np.linspace(0.0, 1.0, count)[:, None]
    response = 1e3 / (1.5 + 1j * omega) * np.array([1.0, 2.0, -1j])
    mixing = np.array([[1.0, 0, 0], [0.6, 0.8, 0], [0, 0, 0.1]])
    noise = (rng.standard_normal((count, channels, 2)) @ np.array([1, 1j])) @ mixing.T / np.sqrt(2)
    lines = response * reference + noise
    found = local_covariance(lines, reference, reference[:, :0], np.arange(100, 3900))
    assert found.order == 2
    assert found.dof == 2 * found.half + 1 - columns_of(1, False, 2) >= 5 * channels
    np.testing.assert_allclose(found.matrices.mean(axis=0), mixing @ mixing.T, atol=0.04)
    assert 0 < found.leverage < 0.5
    assert not found.bent


def driven(rng: np.random.Generator, response: np.ndarray, channels: int = 1):
    """Return lines of channels that respond alike to one reference, with noise of size one."""
    count = len(response)
    reference = rng.standard_normal((count, 1, 2)) @ np.array([1, 1j])
    noise = rng.standard_normal((count, channels, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    return response[:, None] * reference + noise, reference


NO_ROTATION = np.zeros((3000, 0), dtype=complex)


@pytest.mark.parametrize(("width", "bend"), [(1e6, 1.0), (20.0, 1.2), (2.0, 50.0)])
def test_a_resonance_is_no_noise(monkeypatch, width, bend):
    """A resonance within the window: polynomials leave its bend, a pair of poles does not."""
    response = 1e2 / (1 + 1j * (np.arange(3000) - 1500) / width)
    lines, reference = driven(np.random.default_rng(4), response, 2)

    def power() -> float:
        found = local_covariance(lines, reference, NO_ROTATION, np.arange(1400, 1600))
        return float(np.diagonal(found.matrices, axis1=1, axis2=2).real.mean())

    monkeypatch.setattr(local_polynomial, "ORDERS", (2,))
    assert power() == pytest.approx(1.0, abs=0.1)
    monkeypatch.setattr(local_polynomial, "RESONANT", 1e-300)
    assert power() > bend


def test_the_order_grows_until_no_bend_is_left():
    """More resonances within the window than a pair of poles follows."""
    rng = np.random.default_rng(4)
    at = np.arange(3000)[:, None] - np.array([1480, 1492, 1504, 1516])
    response = (1e2 / (1 + 1j * at / 6.0) * np.array([1, -1, 1j, -1j])).sum(axis=1)
    lines, reference = driven(rng, response)
    assert local_covariance(lines, reference, NO_ROTATION, np.arange(1400, 1600)).order > 2


@pytest.mark.parametrize("channels", [2, 8])
def test_noise_alone_gets_no_poles(channels):
    """Poles that noise alone would choose take noise away: few windows have them."""
    rng = np.random.default_rng(6)
    noise = rng.standard_normal((500, 2 * channels + 9, channels, 2)) @ np.array([1, 1j])
    offset = np.tile(np.linspace(-1, 1, noise.shape[1]), (500, 1))
    powers = offset[:, :, None] ** np.arange(3)
    nothing, kept = np.zeros((*offset.shape, 0), dtype=complex), np.ones(offset.shape, dtype=bool)
    regression = local_polynomial._Regression(20, nothing, nothing, powers, offset, kept)
    _, _, resonant = regression.resonant(noise, np.full(500, noise.shape[1] - 3))
    assert resonant.mean() < 0.02


def test_hum_is_no_resonance():
    """What does not decay within the record stands out of the noise; it leaks as poles do."""
    rng = np.random.default_rng(7)
    lines, reference = driven(rng, np.full(3000, 10.0), 2)
    lines = lines + 300.0 / (np.arange(3000)[:, None] - 1500.3)
    found = local_covariance(lines, reference, NO_ROTATION, np.arange(1400, 1600))
    assert 1500 in found.standing_out


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(band=(100.0, 50.0)), "0 Hz to 2500 Hz"),
        (dict(band=(10.01, 10.02)), "no line between 10.01 and 10.02 Hz"),
        (dict(references=["nothing"]), "the reference 'nothing'"),
        (dict(references=()), "name the columns that hold the excitation"),
        (dict(skip=9.0), "samples between skip and until"),
        (dict(skip=0.0, until=0.01), "to tell noise from motion"),
    ],
)
def test_what_cannot_be_done_is_said(record, change, message):
    given = {"band": (2.0, 200.0), "references": ["r_x", "r_y"], **change}
    with pytest.raises(InputError, match=message):
        spectra(record, **given)


def test_a_quiet_record_of_another_kind_is_refused(record):
    with pytest.raises(InputError, match="a sample rate of 1000"):
        lines_of(record, quiet=replace(record, sample_rate=1000.0))
    few = replace(record, channels=record.channels[:2], samples=record.samples[:, :2])
    with pytest.raises(InputError, match="no channel 'x'"):
        lines_of(record, quiet=few)


# -------------------------------------------------------------------------------------------------
# What is wrong with a whole record is told, where the misfit may not show it.


def lines_with(record: rid.Record, samples: np.ndarray) -> rid.Lines:
    return lines_of(replace(record, samples=samples), band=(2.0, 120.0))


@pytest.mark.slow
def test_references_that_are_not_logged_to_the_end_are_told(record):
    """What they drove counts as noise then: too little is left of it in the misfit."""
    samples = record.samples.copy()
    samples[len(samples) // 2 :, [record.names.index(name) for name in ("r_x", "r_y")]] = 0.0
    wrong = rid.identify(MODEL, lines_with(record, samples), KNOWN)
    right = rid.identify(MODEL, lines_with(record, record.samples), KNOWN)
    assert right.status == "ok"
    assert not [w for w in right.warnings if "far below" in w]
    assert wrong.misfit.cost < 0.95 * wrong.misfit.expected
    assert any("is far below" in w and "references are late" in w for w in wrong.warnings)


def frozen(record: rid.Record, name: str, value: float | None = None) -> np.ndarray:
    """Return samples of which a channel stays at its last value, or at another, from 3.5 s on."""
    samples, column = record.samples.copy(), record.names.index(name)
    at = round(0.7 * len(samples))
    samples[at:, column] = samples[at - 1, column] if value is None else value
    return samples


def test_an_input_that_stops_is_told_before_any_suspect(record):
    found = rid.identify(MODEL, lines_with(record, frozen(record, "F_x")), KNOWN)
    assert found.status == "rejected"
    assert found.warnings[0].startswith("before any suspect, see to stuck, F_x: ")
    assert sum("stuck, F_x" in text for text in found.warnings) == 1


def test_a_reference_that_stops_is_told(record):
    """It makes deviations too wide, and no answer wrong; at zero an axis may have been at rest."""
    for value, verdict in ((None, "warning"), (0.0, "note")):
        (told,) = lines_with(record, frozen(record, "r_x", value)).checks
        assert (told.about, ", ".join(told.on), told.verdict) == ("stuck reference", "r_x", verdict)


@pytest.mark.parametrize(
    ("names", "value", "verdict"),
    [(("r_x",), 7.0, "warning"), (("r_x",), 0.0, "note"), (("r_x", "r_y"), 0.0, "warning")],
)
def test_references_that_never_move_are_told(record, names, value, verdict):
    samples = record.samples.copy()
    samples[:, [record.names.index(name) for name in names]] = value
    told = lines_with(record, samples).checks
    assert [(check.on, check.verdict) for check in told] == [(names, verdict)]
    assert "name the column of the excitation" in told[0].found


# -------------------------------------------------------------------------------------------------
# Halves of whole records are held against each other: what changed meanwhile shows.


HELD = written(
    "a mass on a spring, held by a loop",
    ["m*x'' + c*x' + k*x = F"],
    *("x m", "F N", "m 2.0 kg, c 60.0 N s/m, k 2e5 N/m"),
)
SAMPLED, COUNT = 2000.0, 12000


def shaken(rng: np.random.Generator, stiffer: float = 0.0, gain: float = 0.0) -> rid.Record:
    """Return a mass that noise shakes, by the exact step of a force that is held."""
    force = rng.standard_normal(COUNT)
    position = np.empty(COUNT)
    state = np.zeros(2)
    for part in range(2):
        stiffness = 2e5 * (1 + stiffer * part)
        step = expm(np.array([[0, 1, 0], [-stiffness / 2, -30.0, 0.5], [0, 0, 0]]) / SAMPLED)
        for n in range(part * COUNT // 2, (part + 1) * COUNT // 2):
            position[n] = state[0]
            state = step[:2, :2] @ state + step[:2, 2] * force[n]
    position[COUNT // 2 :] *= 1 + gain
    noisy = position + 3e-7 * rng.standard_normal(COUNT)
    channels = [rid.Channel("F", "N", hold=True), rid.Channel("x", "m")]
    return rid.Record(channels, np.column_stack([force, noisy]), SAMPLED)


def answer(each: rid.Record) -> rid.Estimate:
    return rid.identify(HELD, rid.spectra(each, (5.0, 150.0), inputs=["F"]), "ml")


@pytest.mark.slow
def test_nothing_is_said_of_a_record_in_which_nothing_changed():
    for seed in range(4):
        found = answer(shaken(np.random.default_rng(seed)))
        assert found.status == "ok", found.warnings


@pytest.mark.parametrize(("change", "named"), [({"stiffer": 0.05}, "k"), ({"gain": 0.03}, "mk")])
def test_what_changed_in_the_middle_is_told(change, named):
    found = answer(shaken(np.random.default_rng(1), **change))
    assert found.status == "rejected"
    (told,) = [text for text in found.warnings if "halves of the record differ by" in text]
    assert any(f"deviations in {name}" in told for name in named)


def test_a_record_without_windows_has_no_halves():
    lines = rid.spectra(shaken(np.random.default_rng(1)), (5.0, 150.0), inputs=["F"])
    assert len(lines.parts(2)) == 2
    assert lines.parts(3)[2].names == lines.names


# Experiment files of records without periods, end to end through the command.


EXPERIMENT = """
model = "jeffcott"

[[records]]
file = "run.csv"
sample_rate = "5 kHz"
speed = "{rpm} rpm"
band = ["2 Hz", "200 Hz"]
{noise}

[channels]
F_x = {{ column = "fx", unit = "N", hold = "zero-order" }}
F_y = {{ column = "fy", unit = "N", hold = "zero-order" }}
x = {{ column = "px", unit = "um" }}
y = {{ column = "py", unit = "um" }}

[parameters]
m = {{ start = "5.5 kg" }}
c = {{ start = "450 N s/m" }}
k = {{ start = "4.3e5 N/m" }}
"""
HEADER = "fx,fy,px,py,ex,ey"
REFERENCES = 'references = ["ex", "ey"]'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    write_whole(folder / "run.csv", levitated(1))
    return folder


def write_whole(path: Path, record: rid.Record) -> None:
    write_table(path, HEADER, record.samples * [1, 1, 1e6, 1e6, 1, 1])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("noise", [REFERENCES, 'quiet = "quiet.csv"'])
def test_a_record_without_periods_is_identified(folder, noise):
    if "quiet" in noise:
        write_whole(folder / "quiet.csv", levitated(2, excitation=0.0))
    path, result = folder / "run.toml", folder / "run.json"
    path.write_text(EXPERIMENT.format(noise=noise, rpm=SPEED * 30 / np.pi), encoding="utf-8")
    assert cli.run(["identify", str(path), "--json", str(result)]) == 0
    agrees(rid.load_estimate(result), TRUTH, 4)


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        ('references = ["ex"]\nquiet = "quiet.csv"', "one of references and quiet"),
        ('references = ["ex"]\nfundamental = "10 Hz"', "remove references"),
        ('references = ["none"]', "none"),
    ],
)
def test_what_does_not_go_together_is_refused(folder, noise, message, refusal):
    path = folder / "wrong.toml"
    path.write_text(EXPERIMENT.format(noise=noise, rpm=3000), encoding="utf-8")
    assert message in refusal("identify", path)


def turning_file(folder: Path, turning: str, second: str = "") -> Path:
    """Write an experiment of two records, of which something more is said of the second."""
    text = EXPERIMENT.format(noise=REFERENCES, rpm=0).replace('speed = "0 rpm"', turning)
    head, record, rest = re.split(r"(?=\[\[records|\[channels)", text)
    both = "".join(record.replace("run.csv", f"{name}.csv") for name in ("first", "second"))
    path = folder / "run.toml"
    path.write_text(f"{head}{both}{second}\n{rest.partition('[parameters]')[0]}", "utf-8")
    return path


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """Two records of one rotor: the second begins an eighth of a turn later in its rotation."""
    folder = tmp_path_factory.mktemp("turning")
    later = round(np.pi / 4 / SPEED * RATE)
    for name, seed, first in (("first", 1, 0), ("second", 2, later)):
        record = levitated(seed, excitation=5.0)
        write_whole(folder / f"{name}.csv", replace(record, samples=record.samples[first:]))
    return folder


@pytest.mark.slow
def test_records_that_count_the_angle_from_two_zeros_are_refused(turning):
    """One unbalance would have two directions; fitted, it takes minutes to reject them."""
    speed = f'speed = "{SPEED * 30 / np.pi} rpm"'
    bare = rid.load_experiment(turning_file(turning, speed))
    said = r"run.toml: records.1.phase: .* at 4[0-9.]+ deg .*phase = \"unknown\""
    with pytest.raises(InputError, match=said):
        bare.records()
    for said in ('phase = "unknown"', 'phase = "0 deg"', f'phase = "{SPEED * 0.002} rad"'):
        assert len(rid.load_experiment(turning_file(turning, speed, said)).records()) == 2
    other = f'speed = "{1.1 * SPEED * 30 / np.pi} rpm"'  # it does not: nothing can be said
    assert len(rid.load_experiment(turning_file(turning, other)).records()) == 2
    assert len(rid.load_experiment(turning_file(turning, "")).records()) == 2


@pytest.mark.sampled(1)
@pytest.mark.parametrize("turn", [2.0, 3.1, 4.5])
def test_an_unknown_phase_starts_where_the_rotation_stands(turn):
    """From the other side of the circle the search ended nowhere, after minutes."""
    later = round(turn / SPEED * RATE)
    runs = [levitated(1), levitated(2)]
    runs[1] = replace(runs[1], samples=runs[1].samples[later:], phase_known=False)
    lines = [lines_of(run) for run in runs]
    (asked,) = phases(bind_all(MODEL, lines), Nuisances())
    there = np.angle(np.exp(1j * SPEED * later / RATE))
    assert np.abs(np.angle(np.exp(1j * (asked.scalars[0].start - there)))) < 0.1
    elsewhere = replace(lines[0], speed=1.03 * lines[0].speed)
    (asked,) = phases(bind_all(MODEL, [elsewhere, lines[1]]), Nuisances())
    assert asked.scalars[0].start == 0.0
    estimate = rid.identify(MODEL, lines, KNOWN)
    assert estimate.status == "ok"
    phase = estimate["phase[1]"]
    assert abs(np.angle(np.exp(1j * (phase.value - there)))) < 4 * phase.std


@pytest.mark.slow
def test_a_record_in_another_unit_is_refused(turning):
    """Its rotation is a thousand times that of the other, which turns at the same speed."""
    told = f'speed = "{SPEED * 30 / np.pi} rpm"'
    second = 'phase = "unknown"\n[records.channels]'
    for name in "xy":
        second += f'\n{name} = {{ column = "p{name}", unit = "mm" }}'
    said = r"records.1.channels: found a rotation [0-9.]+e\+03 times .* correct unit"
    with pytest.raises(InputError, match=said):
        rid.load_experiment(turning_file(turning, told, second)).records()
    scaled = second.replace('"mm"', '"nm"').replace("e-3", "")
    with pytest.raises(InputError, match=r"records.1.channels: found a rotation 0.001[0-9]* times"):
        rid.load_experiment(turning_file(turning, told, scaled)).records()


WAVE = Wave(0, 300.0, ("x", "y"), np.array([1e-5, 2e-5j]))


def test_a_wave_that_is_another_as_a_whole():
    def factor(phasors: np.ndarray, speed: float = 300.0) -> complex | None:
        return replace(WAVE, number=1, speed=speed, phasors=phasors).over(WAVE)

    turn = np.exp(0.5j)
    assert factor(WAVE.phasors * turn) == pytest.approx(turn)
    assert factor(WAVE.phasors * turn, 301.0) is None
    assert factor(WAVE.phasors * turn, 300.2) == pytest.approx(turn)
    assert factor(WAVE.phasors * [turn, 1.0]) is None  # another machine
    assert WAVE.over(replace(WAVE, number=1, phasors=0 * WAVE.phasors)) is None


@pytest.mark.parametrize("factor", [1.2 * np.exp(0.5j), 90.0, np.exp(0.15j)])
def test_another_unbalance_is_no_mistake(factor):
    check_rotation(replace(WAVE, number=1, phasors=factor * WAVE.phasors), [WAVE], "run.toml")
    turned = replace(WAVE, number=1, phasors=1j * WAVE.phasors, told=True)
    check_rotation(turned, [WAVE], "run.toml")


RINGING = """
title = "a mass that rings down"
equations = ["m*x'' + c*x' + k*x = 0"]
coordinates = { x = "m" }
[parameters]
m = { unit = "kg", nominal = 2.2, positive = true }
c = { unit = "N s/m", nominal = 1.0 }
k = { unit = "N/m", nominal = 4500.0, positive = true }
"""


def test_a_free_decay_tells_damping_and_stiffness_of_a_known_mass():
    model, truth, rate = rid.parse_model(RINGING), {"c": 3.0, "k": 5000.0}, 500.0
    pole = complex(-0.75, np.sqrt(2500.0 - 0.75**2))
    ring = 1e-3 * np.exp(pole * np.arange(4000) / rate).real
    noise = 2e-6 * np.random.default_rng(3).normal(size=6000)
    decay, rest = (
        rid.Record([rid.Channel("x")], samples[:, None], sample_rate=rate)
        for samples in (ring + noise[:4000], noise[4000:])
    )
    with pytest.raises(InputError, match="record the machine once without"):
        rid.spectra(decay, (1.0, 40.0))
    lines = rid.spectra(decay, (1.0, 40.0), quiet=rest)
    estimate = rid.identify(model, lines, rid.MaximumLikelihood(fixed={"m": 2.0}))
    assert estimate.status == "ok"
    agrees(estimate, truth, 4)
    assert estimate.std("c") < 0.01
    ratios = {v.name: v for v in rid.identify(model, lines, "ml").derived}
    for name, true in {"c/m": 1.5, "k/m": 2500.0}.items():
        assert abs(ratios[name].value - true) < 4 * ratios[name].std
    low = rid.filtered(decay, 40.0)
    batch = rid.identify(model, low, rid.Batch(fixed={"m": 2.0}))
    assert batch.status == "ok"
    agrees(batch, truth, 4)
    # What is a multiple of the known m x'' is no force that the equation lacks.
    assert batch.std("k") < 5
    assert batch.std("c") < 0.1
    (found,) = batch.prediction.values()
    assert 0.01 < found.relative_error < 0.1
