"""Checks of a record before any model."""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest
from levitated import KNOWN, MODEL, SPEED, levitated
from scipy.signal import lfilter

import rotorid as rid
from rotorid import Channel, InputError, Note, PeriodicRecord, Record, average
from rotorid.core.notes import worst
from rotorid.signals.checks import rotation as checks_rotation
from rotorid.signals.checks.channels import check_copied, check_phases, check_probes
from rotorid.signals.checks.periods import Settling, detect_settling
from rotorid.signals.checks.references import DrivenMotion, check_quiet, check_references
from rotorid.signals.checks.registry import Seen, check_periods, check_record, found_by
from rotorid.signals.checks.rotation import rotation_warnings, synchronism
from rotorid.signals.inspection import inspect_record

RATE, F0, SIZE = 5000.0, 20.0, 250
LINES = np.arange(1, 12, 2)
CHANNELS = [Channel("F_x", "N"), Channel("F_y", "N"), Channel("x", "m"), Channel("y", "m")]
SCALE = np.array([10.0, 10.0, 1e-4, 1e-4])

Damage = Callable[[np.ndarray], np.ndarray]


def machine(
    periods: int = 60, noise: float = 0.05, seed: int = 0, colour: float = 0.0, speed: float = 0.0
) -> Record:
    """Four channels with random lines and noise, white or coloured."""
    rng = np.random.default_rng(seed)
    lines = (rng.normal(size=(len(LINES), 4)) + 1j * rng.normal(size=(len(LINES), 4))) * SCALE
    time = np.arange(SIZE * periods) / RATE
    waves = np.exp(2j * np.pi * F0 * np.multiply.outer(time, LINES))
    white = rng.normal(size=(len(time) + 500, 4))
    rough = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], white, axis=0)[500:]
    return Record(CHANNELS, (waves @ lines).real + noise * SCALE * rough, RATE, speed=speed)


def cut(record: Record, fundamental: float = F0, lines: object = LINES) -> PeriodicRecord:
    return average(record, fundamental, harmonics=np.asarray(lines).tolist())


def damaged(record: Record, change: Damage) -> Record:
    return replace(record, samples=change(record.samples.copy()))


def of(column: int, change: Damage) -> Damage:
    def apply(samples: np.ndarray) -> np.ndarray:
        samples[:, column] = change(samples[:, column])
        return samples

    return apply


def told(record: Record, **options: object) -> list[Note]:
    periods = cut(record, **options)  # type: ignore[arg-type]
    return [c for c in periods.checks if c.verdict != "ok"]


def of_check(notes: Iterable[Note], about: str) -> list[Note]:
    return [note for note in notes if note.about == about and note.verdict != "ok"]


def only(found: list[Note], name: str) -> Note:
    grave = [c for c in found if c.verdict in ("warning", "refused")]
    assert [c.about for c in grave] == [name], [str(c) for c in found]
    return grave[0]


def clean(number: int) -> Record:
    """Return one of 210 records of few periods and many, or of 150 random ones."""
    each = [(periods, c) for periods in (2, 3, 4, 6, 8, 30, 150) for c in (0.0, 0.9, 0.99)]
    if number < 210:
        (periods, colour), seed = each[number // 10], number % 10
        return machine(periods, seed=seed, colour=colour, noise=10 ** (seed / 4 - 2))
    rng = np.random.default_rng(10_000 + number - 210)
    return machine(
        periods=int(rng.integers(4, 200)),
        noise=10 ** rng.uniform(-2.5, 0.5),
        seed=number - 210,
        colour=float(rng.choice([0.0, 0.5, 0.95, 0.995])),
        speed=2 * np.pi * F0 * float(rng.choice([0, 5, 7, 9])),
    )


@pytest.mark.sampled(1)
@pytest.mark.parametrize("part", range(6))
def test_a_clean_record_gives_no_alarm(part):
    """Of all 360: what calls 1 % is found with 97 %."""
    found = [c for number in range(part, 360, 6) for c in told(clean(number))]
    assert [str(c) for c in found if c.verdict in ("warning", "refused")] == []


def test_everything_looked_at_is_named():
    record = machine()
    periods = cut(record)
    names = [c.about for c in (*check_record(record, periods), *check_periods(periods))]
    assert len(set(names)) == len(names)
    assert {"dead", "copied", "speed", "lost samples"} <= {*names}
    assert worst(check_periods(periods)) == "ok"
    assert worst(()) == "ok"


@pytest.mark.parametrize(
    ("noise", "dead", "on", "verdict"),
    [
        (0.05, of(1, lambda v: 0 * v), ["F_y"], "note"),
        (0.05, of(2, lambda v: 0 * v + 3.3), ["x"], "refused"),
        (0.05, lambda s: s * [1, 1, 0, 0], ["x", "y"], "refused"),
        (0.0, of(3, lambda v: 0 * v), ["y"], "warning"),  # a simulated axis may rest
    ],
)
def test_a_quiet_input_is_a_note_and_a_dead_sensor_more(noise, dead, on, verdict):
    record = damaged(machine(noise=noise), dead)
    found = of_check(check_record(record, cut(record)), "dead")
    assert [(name, c.verdict) for c in found for name in c.on] == [(name, verdict) for name in on]


def clipped_at(part: float) -> Damage:
    return of(2, lambda v: np.clip(v, -part * np.abs(v).max(), part * np.abs(v).max()))


@pytest.mark.parametrize("held", [2, 4, 8])
def test_a_held_command_is_not_clipped(held):
    record = damaged(machine(noise=0.0), lambda s: np.repeat(s[::held], held, axis=0)[: len(s)])
    assert not of_check(check_record(record), "clipped")


@pytest.mark.parametrize("digits", [3, 4, 5])
def test_turning_points_of_few_digits_are_not_clipped(digits):
    """A value near its extreme is written with a coarser last digit than one near zero."""
    time = np.arange(4000) / 1000.0
    wave = 17.3 * np.sin(2 * np.pi * time) + 3 * np.sin(6 * np.pi * time)
    for size, cut in ((1.0, 1.0), (0.0007, 1.0), (1.0, 0.8))[: 2 + (digits > 3)]:
        samples = size * wave.clip(-cut * wave.max(), cut * wave.max())
        written = np.array([float(f"{value:.{digits}g}") for value in samples])
        record = Record([Channel("F", "N")], written[:, None], 1000.0)
        assert bool(of_check(check_record(record), "clipped")) == (cut < 1)


@pytest.mark.parametrize(("cut", "told"), [(1.0, False), (0.9, True)])
def test_turning_points_of_a_coarse_sensor_are_not_clipped(cut, told):
    """4096 counts of a turn, written in degrees with two digits, are multiples of nothing."""
    time = np.arange(5000) / 1000.0
    wave = 120.0 * np.exp(-0.2 * time) * np.sin(11 * time + 1)
    counts = np.round(wave.clip(cut * wave.min(), cut * wave.max()) * 4096 / 360)
    written = np.round(counts * 360 / 4096, 2)
    record = Record([Channel("x", "deg")], written[:, None], 1000.0)
    assert bool(of_check(check_record(record), "clipped")) == told


def test_what_rests_or_is_masked_is_not_clipped():
    """A position that comes to rest at the end of its stroke, in single steps of its encoder."""
    stroke = 0.1 * np.sin(np.linspace(0, 20, 20_000))
    eased = np.round(np.tanh(20 * stroke) / 1e-4) * 1e-4
    resting = Record([Channel("x", "m")], eased[:, None], 1000.0)
    record = damaged(machine(), clipped_at(0.8))
    x = np.abs(record.samples[:, 2])
    for each in (resting, replace(record, valid=x < x.max())):
        assert not of_check(check_record(each), "clipped")


@pytest.mark.parametrize(
    ("noise", "step", "verdict"),
    [
        (0.05, 0.045, "ok"),  # dithered by a scatter of half a step
        (0.5, 0.06, "note"),  # dithered, but coarse
        (0.005, 0.045, "note"),  # repeats in every period, but is fine
        (0.05, 1.0, "note"),  # repeats, and is coarse: deviations hold it
    ],
)
def test_coarse_steps_are_told_by_what_they_do(noise, step, verdict):
    """The scatter is about 0.4 of the noise over the rms of the channel."""

    def rounded(v: np.ndarray) -> np.ndarray:
        quantum = step * v.std()
        return np.round(v / quantum) * quantum

    record = damaged(machine(noise=noise), of(2, rounded))
    found = check_record(record, cut(record))
    assert worst(c for c in found if c.about == "quantized") == verdict


def test_each_copy_of_a_channel_is_told_of_the_first_alone():
    """Three channels that are one: two notes; of two samples, which are alike by chance, none."""
    channels = [Channel(f"x{i}", "m") for i in range(4)]
    noise = np.random.default_rng(3).normal(size=(40, 2))
    values = np.stack([noise[:, 0], 2 * noise[:, 0], noise[:, 1], -noise[:, 0]], axis=1)
    assert [n.on for n in check_copied(channels, values)] == [("x0", "x1"), ("x0", "x3")]
    assert not list(check_copied(channels, values[:2] - values[:2].mean(axis=0)))


def test_the_same_excitation_on_two_axes_is_no_copy():
    """Equal commands, each with noise of its own, or without any; nor is what settles."""

    def same(samples: np.ndarray) -> np.ndarray:
        samples[:, 1] = samples[:, 0] + 1e-3 * np.random.default_rng(5).normal(size=len(samples))
        return samples

    def settled(samples: np.ndarray) -> np.ndarray:
        fading = np.exp(-np.arange(len(samples)) / SIZE)
        return samples * (1 + np.where(fading > 1e-9, fading, 0.0))[:, None]

    for noise, change in ((0.05, same), (0.0, same), (0.0, settled)):
        found = told(damaged(machine(noise=noise), change))
        assert not [c for c in found if c.about.startswith("copied")]


@pytest.mark.parametrize(("count", "at"), [(1, 7000), (1, 8010), (20, 7100), (3, 13_000)])
@pytest.mark.parametrize("speed", [0.0, 2 * np.pi * 140])
def test_lost_samples_are_counted_and_placed(count, at, speed):
    record = damaged(machine(speed=speed), lambda s: np.delete(s, slice(at, at + count), axis=0))
    found = only(told(record), "lost samples")
    assert found.found.startswith(f"{count} sample")
    assert " lost between " in found.found
    begin, end = (float(found.found.split(word)[1].split()[0]) for word in ("between ", "and "))
    assert begin <= at / RATE <= end + 1 / RATE
    assert end - begin < 2.1 / F0
    assert found.verdict == ("refused" if speed else "warning")


def stretched(samples: np.ndarray, ppm: float, columns: slice) -> np.ndarray:
    """Sample some channels with a clock that is slow by so many ppm, exactly: lines turn."""
    out = samples.copy()
    time = np.arange(len(samples)) * (1 + ppm * 1e-6) / RATE
    grid = np.exp(2j * np.pi * F0 * np.multiply.outer(time, LINES))
    rest = np.exp(2j * np.pi * F0 * np.multiply.outer(np.arange(SIZE) / RATE, LINES))
    lines = 2 * (rest.conj().T @ samples.reshape(-1, SIZE, 4).mean(axis=0)) / SIZE
    noise = samples - (np.tile(rest, (len(samples) // SIZE, 1)) @ lines).real
    out[:, columns] = ((grid @ lines).real + noise)[:, columns]
    return out


def coarsely_clipped(samples: np.ndarray) -> np.ndarray:
    fine = clipped_at(0.8)(samples)
    step = fine[:, 2].std() / 200
    fine[:, 2] = np.round(fine[:, 2] / step) * step
    return fine


def knock(samples: np.ndarray) -> np.ndarray:
    samples[5000:5020] += 5 * SCALE
    return samples


ONCE = 30 * SIZE
QUIET = machine(noise=0.0).samples
DAMAGES = {  # of 60 periods, or of so many; the only grave note: its name, channels, verdict, words
    "flat tops": (clipped_at(0.8), 60, "clipped", "x", "warning", "flat tops of .*% of the"),
    "flat tops of a converter": (coarsely_clipped, 60, "clipped", "x", "warning", "flat tops"),
    "a copied sensor": (
        lambda s: s[:, [0, 1, 2, 2]] * [1, 1, 1, 2.5], 60, "copied", "x, y", "refused",
        "y is 2.5 times x",
    ),
    "a copied force": (lambda s: s[:, [0, 0, 2, 3]], 60, "copied", "F_x, F_y", "warning", "F_y is"),
    "a sensor without scatter": (
        of(2, lambda v: QUIET[: len(v), 2]), 60, "identical periods", "x", "warning", "",
    ),
    "one period": (
        lambda s: np.tile(s[:SIZE], (60, 1)), 60, "identical periods", "", "warning",
        "deviations of the result are unknown, not zero",
    ),
    "a measurement that is there twice": (
        lambda s: np.concatenate([s[:ONCE], s[:ONCE]]), 60, "copied periods", "", "warning",
        "^30 of 60 periods are earlier ones again.*period 31 is period 1",
    ),
    "a period that is there twice": (
        lambda s: np.concatenate([s[:ONCE], s[-SIZE:], s[ONCE:]]), 60, "copied periods", "",
        "warning", "1 of",
    ),
    "a sample twice": (
        lambda s: np.insert(s, 7000, s[7000], axis=0), 60, "lost samples", "", "warning",
        "^1 sample too many",
    ),
    "samples lost by the sensors": (
        lambda s: np.hstack([s[:-2, :2], np.delete(s[:, 2:], slice(6000, 6002), axis=0)]), 60,
        "lost samples", "x, y", "refused", "^2 samples lost in x, y only",
    ),
    "a period that is not the one given": (
        lambda s: stretched(s, 20.0, slice(0, 4)), 200, "period", "", "warning",
        r"20.0004 Hz, not 20 .*\(-20 ppm\)|\(-20 ppm\).*20.0004 Hz, not 20",
    ),
    "two clocks": (
        lambda s: stretched(s, 20.0, slice(2, 4)), 200, "clocks", "F_x, F_y", "refused",
        r"^x, y and F_x, F_y run on two clocks, (19\.[89]|20)",
    ),
    "a knock": (knock, 60, "knock", "F_x, F_y, x, y", "warning", r"period 21 \(1 s\)"),
}  # fmt: skip


@pytest.mark.parametrize("what", DAMAGES)
def test_damage_is_named_with_its_channels(what):
    damage, periods, name, channels, verdict, words = DAMAGES[what]
    note = only(told(damaged(machine(periods), damage)), name)
    assert (", ".join(note.on), note.verdict) == (channels, verdict)
    assert re.search(words, note.found)


@pytest.mark.parametrize(("turning", "size"), [(False, "1.9|2"), (True, "")])
def test_a_slow_change_is_a_drift_with_its_size(turning, size):
    """Gaps that grow with heat turn the lines of a closed loop as a second clock does, and more."""
    ramp = np.linspace(-1, 1, 60 * SIZE)[:, None] * np.array([0, 0, 0.01, 0.01])
    cold = machine(noise=0.02)
    warmer = cold.samples * (1 + ramp) + turning * np.roll(cold.samples, 3, axis=0) * ramp
    found = told(replace(cold, samples=warmer))
    drifts = [("drift", (name,), "warning") for name in "xy"]
    assert [(c.about, c.on, c.verdict) for c in found] == drifts
    assert re.search(f" changes by ({size})", found[0].found)


@pytest.mark.parametrize(("grows", "name"), [(True, "drift"), (False, "speed")])
def test_what_changes_the_line_of_the_rotation_alone(grows, name):
    """A gain changes its size, a speed that is a little off its phase."""
    plain, time = machine(noise=0.02), np.arange(60 * SIZE) / RATE
    change = np.linspace(-0.01, 0.01, len(time))
    phase = 2 * np.pi * 7 * F0 * time
    bent = 3 * np.cos(phase) * (1 + change) if grows else 3 * np.cos(phase + change)
    record = damaged(plain, lambda s: s + SCALE * bent[:, None])
    found = told(replace(record, speed=2 * np.pi * 7 * F0))
    assert {c.about for c in found if c.verdict == "warning"} == {name}


@pytest.mark.parametrize("periods", [3, 4, 6, 7, 20])
def test_a_transient_is_found_with_few_periods_too(periods):
    fading = np.exp(-np.arange(periods * SIZE) / 60.0)[:, None]
    record = damaged(machine(periods, noise=0.01), lambda s: s + 3 * SCALE * fading)
    assert "skip" in only(told(record), "settled").found
    (two,) = of_check(told(machine(2)), "settled")
    assert (two.verdict, "2 periods cannot show a transient" in two.found) == ("note", True)


def turning(frequency: float, given: float, periods: int = 100) -> Record:
    """A rotor with unbalance at one speed, said to have another."""
    record = machine(periods, speed=2 * np.pi * given)
    time = np.arange(len(record.samples)) / RATE
    wave = np.cos(2 * np.pi * frequency * time)[:, None] * [0, 0, 1e-4, 1e-4]
    return replace(record, samples=record.samples + wave)


@pytest.mark.parametrize(
    ("true", "given", "words"),
    [
        (93.37, 93.37, ""),  # off the lines
        (140.0, 140.0, ""),  # on one that is excited
        (80.0, 80.0, ""),  # on one that is not
        (93.37, 92.9, "at 93.37"),
        (93.37, 93.37 / 60, "Hz given as rpm?"),
        (80.0, 91.0, "at 80 Hz (4800 rpm)"),
        (93.37, 75.0, "where nothing stands: give the speed at which"),
        (50.33, 0.0, "a line at 50.33"),  # a tone at standstill is a note
    ],
)
def test_a_wrong_speed_is_named_with_the_one_that_the_record_shows(true, given, words):
    record = turning(true, given)
    for start in (0.0, 100.0) if not given else (0.0,):
        found = of_check(told(replace(record, start=start)), "speed")
        assert [c.verdict for c in found] == ["warning" if given else "note"] * bool(words)
        assert all(words in c.found for c in found)


@pytest.mark.parametrize("periods", [2, 3, 6])
def test_a_record_that_does_not_repeat_is_told(periods):
    record = machine(periods)
    rough = np.random.default_rng(3).normal(size=(periods, 1, 4)) * SCALE * 3
    wave = np.cos(2 * np.pi * np.arange(SIZE) / SIZE)[:, None]
    other = replace(record, samples=record.samples + (rough * wave).reshape(-1, 4))
    assert "repeats" in [c.about for c in told(other) if c.verdict == "warning"]


@pytest.mark.parametrize("start", [0.0, 100.0])
def test_a_fundamental_that_is_twice_the_true_one(start):
    """Excited at 20 Hz and its odd multiples, which are lines 1 and 3 of 40 Hz by mistake."""
    record = replace(machine(60), start=start)
    (found,) = of_check(told(record, fundamental=2 * F0, lines=[1, 3]), "multiple period")
    assert (", ".join(found.on), found.verdict) == ("F_x, F_y", "warning")
    assert "the fundamental is 20 Hz, not 40; multiply the harmonics by 2" in found.found


@pytest.mark.parametrize("size", [256, 244, 251, 249, 125, 500, 1000])
@pytest.mark.parametrize(("periods", "noise"), [(30, 0.05), (60, 0.5)])
def test_a_period_that_the_record_contradicts_is_refused(size, periods, noise):
    """2.4 % off, by one sample, by a factor; what it says to write is accepted."""
    record = machine(periods, noise=noise)
    wrong = average(record, period_samples=size, harmonics=LINES.tolist())
    found = only(list(wrong.checks), "given period")
    assert f"write period_samples = {SIZE} in place" in found.text
    assert not of_check(
        average(record, period_samples=SIZE, harmonics=LINES).checks, "given period"
    )
    if found.verdict == "refused":  # else the lines still hold some of it
        assert f'sample_rate = "{RATE * SIZE / size:.9g} Hz"' in found.text
        with pytest.raises(InputError, match=f"write period_samples = {SIZE}"):
            rid.identify(MODEL, wrong, "ml")
        again = replace(record, sample_rate=RATE * SIZE / size)
        assert not of_check(told(again, fundamental=RATE / size), "given period")


def test_a_period_of_which_the_lines_are_multiples_is_as_good():
    """As is one whose lines hold little of what repeats, and one of a rotation between lines."""
    assert not told(machine(), fundamental=F0 / 2, lines=2 * LINES)
    assert not of_check(told(machine(), lines=[2, 4, 6]), "given period")
    record = machine(noise=2.0, speed=2 * np.pi * 93.37)
    turning = 100 * SCALE * np.cos(record.rotor_angle())[:, None]
    assert not of_check(told(replace(record, samples=record.samples + turning)), "given period")


def test_a_rotation_half_way_between_the_lines_is_no_longer_period():
    """It repeats after two periods, and the speed says so."""
    for given, expected in ((90.0, 0), (93.37, 1)):
        record = turning(90.0, given)
        force = 20.0 * np.cos(2 * np.pi * 90.0 * np.arange(len(record.samples)) / RATE)
        found = told(replace(record, samples=record.samples + force[:, None] * [1, 1, 0, 0]))
        assert len([c for c in found if c.about == "multiple period"]) == expected


def test_lines_that_nothing_excites_are_told():
    (found,) = told(machine(), lines=[1, 2, 3, 4, 5])
    assert (found.about, found.verdict) == ("lines below noise", "note")
    assert found.found.startswith("40, 80 Hz hold no input")
    grave = told(machine(), lines=[2, 4, 6])
    assert {c.verdict for c in grave} == {"warning"}
    assert "no line used of any input" in grave[0].found


@pytest.mark.parametrize(
    ("swing", "slip", "tone", "told"),
    [
        (0.0, 0.0, 0.0, False),
        (0.03, 0.0, 0.0, True),
        (0.0, 1.0, 0.0, True),
        (0.0, 0.0, 1e-6, False),  # another machine leaks into the line: it goes round there
    ],
)
def test_a_speed_that_wanders_scatters_the_line_of_the_rotation(swing, slip, tone, told):
    """1x motion of 10 um whose phase swings by this many rad, or slips so many turns; 1 % noise."""
    rng = np.random.default_rng(8)
    time = np.arange(20 * 500) / 5000.0
    phase = 2 * np.pi * (70 + slip / 2) * time + swing * np.sin(2 * np.pi * 0.3 * time)
    motion = 1e-5 * np.cos(phase) + 1e-6 * np.cos(2 * np.pi * 30 * time)
    motion += tone * np.cos(2 * np.pi * 73.1 * time)
    samples = motion + 1e-8 * rng.standard_normal(len(time))
    record = Record([Channel("x", "m")], samples[:, None], 5000.0, speed=2 * np.pi * 70)
    found = checks_rotation.check_wander(average(record, 10.0, harmonics=[1, 2, 3, 5, 7]))
    assert [c.verdict for c in found] == (["warning"] if told else [])


def stopping(part: float, value: float | None = None) -> Damage:
    def change(samples: np.ndarray) -> np.ndarray:
        first = len(samples) // 3
        stays = samples[first] if value is None else value
        samples[first : first + int(part * len(samples))] = stays
        return samples

    return change


def test_a_sensor_that_stops_is_refused():
    found, *others = told(damaged(machine(), of(3, stopping(0.021))))
    assert [other.about for other in others] == ["knock"]
    assert (", ".join(found.on), found.verdict) == ("y", "refused")
    assert "from 1 to 1.063 s" in found.found
    assert not of_check(told(damaged(machine(), of(3, stopping(0.019)))), "stuck")
    for value, verdict in ((0.0, "note"), (5.0, "warning")):  # where it drives nothing, or not
        (check,) = of_check(told(damaged(machine(), of(0, stopping(0.021, value)))), "stuck")
        assert (check.about, ", ".join(check.on), check.verdict) == ("stuck", "F_x", verdict)


def test_what_rests_before_it_is_used_or_at_every_step_is_not_stuck():
    idle = damaged(machine(), of(3, lambda v: np.where(np.arange(len(v)) < 1000, 0.0, v)))
    assert not of_check(average(idle, F0, harmonics=LINES, skip=0.2).checks, "stuck")
    stairs = np.repeat(np.arange(12), 15_000 // 12) % 5 * 1e-4
    few = damaged(machine(2), of(3, stopping(0.08)))  # few samples may well stay the same
    for record in (damaged(machine(), of(3, lambda v: stairs + 0 * v)), few):
        assert not of_check(told(record), "stuck")


@pytest.mark.parametrize(("begins", "told"), [(-0.4, True), (0.0, False)])
def test_a_logger_repeats_an_old_reading_until_the_first_of_its_own(begins, told):
    """What stands and is then set going, without a leap, is neither old nor cut."""
    time = np.arange(4000) / 1000.0
    turned = 5 * np.maximum(time - 0.05, 0.0) + 0.1 * np.maximum(time - 0.05, 0.0) ** 2
    turned = np.round(turned / 3e-3) * 3e-3
    turned[:50] = begins
    record = Record([Channel("q", "rad")], turned[:, None], 1000.0)
    found = check_record(record)
    assert not of_check(found, "clipped")
    assert [note.verdict for note in of_check(found, "stuck")] == ["warning"] * told
    if told:
        assert 'skip = "0.05 s"' in only(found, "stuck").cure
        after = replace(record, samples=record.samples[50:], start=0.05)
        assert not of_check(check_record(after), "stuck")


def rotating(hertz: float, y_phase: float, y_size: float = 1.0) -> Record:
    """Said to turn at 100 Hz, a line that is excited, with a tone elsewhere in x and y."""
    record = machine(speed=2 * np.pi * 100.0)
    turn = 2 * np.pi * hertz * np.arange(len(record.samples)) / RATE
    tone = np.column_stack([0 * turn, 0 * turn, np.cos(turn), y_size * np.cos(turn + y_phase)])
    return replace(record, samples=record.samples + 2e-4 * tone)


@pytest.mark.parametrize("hertz", [110.3, 120.0])
def test_a_tone_that_goes_round_is_the_rotation(hertz, monkeypatch):
    """Square to one another in x and y: an orbit. In phase: hum. Less clear: a light mode."""
    for phase, size, verdict in (
        (np.pi / 2, 1.0, "warning"),
        (-np.pi / 2, 1.9, "warning"),
        (np.pi / 2, 2.1, "note"),
        (np.radians(71), 1.0, "warning"),
        (np.radians(69), 1.0, "note"),
        (0.0, 1.0, "note"),
        (np.pi, 1.0, "note"),
    ):
        (found,) = of_check(told(rotating(hertz, phase, size)), "speed")
        assert found.verdict == verdict, (phase, size)
    monkeypatch.setattr(checks_rotation, "CLEAR", 1e9)
    (found,) = of_check(told(rotating(hertz, np.pi / 2)), "speed")
    assert found.verdict == "note"


def test_a_tone_without_noise_in_samples_of_any_size():
    """Its strength is a number, however large the samples are: warnings are errors here."""
    record = machine(noise=0.0)
    time = np.arange(len(record.samples)) / RATE
    tone = np.sin(2 * np.pi * 12 * F0 * time)[:, None] * SCALE
    for size in (1.0, 1e57):
        larger = replace(record, samples=size * (record.samples + tone))
        periods = average(larger, F0, harmonics=LINES)
        periods = replace(periods, variance=np.zeros_like(periods.variance))
        found = checks_rotation._on_grid(periods, [2, 3])
        assert [each.frequency for each in found] == [240.0, 240.0]
        assert all(1e20 < each.strength < np.inf for each in found)


# Synchronism, settling, distortion: what a run tells before anything is identified.


SLOW_RATE, SLOW_F0, SLOW_SIZE, PERIODS = 1000.0, 10.0, 100, 60
TIME = np.arange(int(PERIODS * SLOW_RATE / SLOW_F0)) / SLOW_RATE
WAVE = sum(np.cos(2 * np.pi * SLOW_F0 * k * TIME + k) for k in (1, 3, 5))


def slow_periods(samples: np.ndarray, **turning: object) -> PeriodicRecord:
    record = Record([Channel("x", "m")], samples[:, None], SLOW_RATE, **turning)
    return average(record, SLOW_F0, harmonics=[1, 3, 5])


def wave_at(speed: float, drift: float = 0.0) -> PeriodicRecord:
    return slow_periods(WAVE, speed=speed, angle=speed * TIME + drift * TIME**2 / 2)


def test_slip_and_drift_are_said():
    periods = wave_at(2 * np.pi * 30.01)
    found = synchronism(periods)
    slip = np.pi * 0.01 * TIME[-1]
    assert found.loss == pytest.approx(1 - np.sin(slip) / slip, rel=1e-3)
    assert found.slip == pytest.approx(2 * slip)
    (warning,) = rotation_warnings(periods)
    assert "3.001 revolutions per period" in warning
    assert "21.6 degrees off over 60 periods" in warning
    assert f"loses {100 * found.loss:.2g} %" in warning
    (warning,) = rotation_warnings(wave_at(2 * np.pi * 30.0, drift=0.5))
    assert "speed changing by 28.6 rpm" in warning


def test_leakage_is_the_spectrum_of_the_unbalance():
    """Half way between two lines, the unbalance leaks into both as a window of that length."""
    periods = wave_at(2 * np.pi * 40.15)
    found = synchronism(periods)
    off = 2 * np.pi * (40.15 - periods.frequency)
    wave = np.abs([np.mean(np.exp(1j * w * TIME)) for w in off])
    np.testing.assert_allclose(found.leakage, wave, rtol=1e-6)


def noisy(transient: float, sigma: float, seed: int) -> PeriodicRecord:
    rng = np.random.default_rng(seed)
    start = transient * np.exp(-8.0 * TIME) * np.cos(2 * np.pi * 11.0 * TIME)
    return slow_periods(WAVE + start + sigma * rng.normal(size=len(TIME)))


def test_a_transient_is_found_and_twice_its_length_dropped():
    for seed in range(10):
        found = detect_settling(noisy(1.0, 0.1, seed))
        assert 2 <= found.periods <= 9
        assert found.drop == pytest.approx(2 * found.periods / SLOW_F0)
        assert found.excess > 3


def test_without_noise_the_transient_is_followed_far_down():
    assert np.exp(-8.0 * detect_settling(noisy(1.0, 0.0, 0)).periods / SLOW_F0) < 1e-7
    assert detect_settling(noisy(0.0, 0.0, 0)).periods == 0


def test_a_drift_another_level_and_few_periods_are_no_transient():
    rng = np.random.default_rng(3)
    level = np.where(np.arange(len(TIME)) < 3120, 1.1, 1.0)
    drifting = WAVE * (1 + 0.1 * np.exp(-0.1 * TIME))
    for samples in (drifting, WAVE * level + 0.01 * rng.normal(size=len(TIME)), WAVE[:700]):
        assert detect_settling(slow_periods(samples)).periods == 0


def test_a_transient_longer_than_half_the_record_is_told():
    """It dies away by a factor of 40 in the first half, and stands a hundred times above noise."""
    start = np.exp(-1.25 * TIME) * np.cos(2 * np.pi * 11.0 * TIME)
    rng = np.random.default_rng(3)
    found = detect_settling(slow_periods(WAVE + start + 1e-4 * rng.normal(size=len(TIME))))
    assert found.periods == PERIODS // 2
    assert found.drop == pytest.approx(PERIODS // 2 / SLOW_F0)
    scatter = "153 times the scatter of the later ones"
    assert Settling(1, 0.2, 153.0).told == f"a transient in the first period, {scatter}"
    assert Settling(3, 0.6, 153.0).told == f"a transient in the first 3 periods, {scatter}"


def distorted(odd: float, even: float, sigma: float, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    answer = WAVE + even * WAVE**2 + odd * WAVE**3 + sigma * rng.normal(size=len(TIME))
    return Record([Channel("F", "N")], answer[:, None], SLOW_RATE)


def distortion(record: Record) -> tuple[float, float]:
    (facts,) = inspect_record(record, period_samples=SLOW_SIZE, harmonics=[1, 3, 5]).channels
    return facts.odd, facts.even


@pytest.mark.parametrize(("odd", "even"), [(0.01, 0.0), (0.0, 0.01), (0.01, 0.02)])
def test_odd_and_even_distortion_are_told_apart(odd, even):
    record = distorted(odd, even, 0.0)
    got_odd, got_even = distortion(record)
    lines = np.abs(np.fft.rfft(record.samples[:SLOW_SIZE, 0], norm="forward")) ** 2
    kept = lines[[1, 3, 5]].sum()
    assert got_odd == pytest.approx(np.sqrt(lines[7:16:2].sum() / kept), abs=1e-9)
    assert got_even == pytest.approx(np.sqrt(lines[2:16:2].sum() / kept), abs=1e-9)
    assert ((got_odd > 1e-3), (got_even > 1e-3)) == (odd > 0, even > 0)
    turning = replace(record, speed=2 * np.pi * 70.0)  # the rotation is left aside
    lines[[7, 14]] = 0.0
    assert distortion(turning)[0] == pytest.approx(np.sqrt(lines[9:16:2].sum() / kept), abs=1e-9)


def test_noise_is_no_distortion():
    """Six lines hold 6 s^2 / (N P), 1.3e-5 of the three that are kept: that is taken off."""
    power = [np.square(distortion(distorted(0.0, 0.0, 0.1, seed))) for seed in range(30)]
    assert np.mean(power) < 4e-6


# Channels that stay at their last value, exactly or to the last digit, where nothing repeats.


COUNT, FIRST, AFTER = 6000, 2000, 3000
PLAY = np.resize([0, 1, 0, -1], AFTER - FIRST)


def slanted(steps: int) -> np.ndarray:
    """Return counts that rise and fall by so many a sample, with a last digit of their own."""
    n = np.arange(COUNT)
    return (steps * (200 - np.abs(n % 400 - 200)) + n // 50 % 2).astype(float)


def stopped(samples: np.ndarray, play: np.ndarray | float = 0.0) -> np.ndarray:
    found = samples.copy()
    found[FIRST + 107 : AFTER] = samples[FIRST + 106] + np.resize(play, AFTER - FIRST - 107)
    return found


def verdict(samples: np.ndarray, unit: str = "m", *, steady: bool = False) -> str:
    record = Record([Channel("c", unit)], samples[:, None], 1000.0)
    periods = average(record, period_samples=3000, harmonics=[1]) if steady else None
    found = of_check(check_record(record, periods), "stuck")
    for check in found:
        assert check.verdict != "refused" or "use the part in which it moves" in check.text
    return found[0].verdict if found else "ok"


@pytest.mark.parametrize("play", [0.0, PLAY])
def test_a_sensor_stops_out_of_full_motion(play):
    """What comes to rest by and by may rest, where nothing has to repeat."""
    assert [verdict(stopped(slanted(steps), play)) for steps in (9, 12)] == ["note", "refused"]
    assert verdict(stopped(slanted(9)), steady=True) == "refused"


def test_the_last_digit_may_play():
    """Three levels are a last digit, four are none."""
    moving = slanted(30)
    assert verdict(stopped(moving, np.resize([0, 1, -1], 5))) == "refused"
    assert verdict(stopped(moving, np.resize([0, 1, -1, 2], 5))) == "ok"
    # Without steps it is a ten-thousandth of the deviation, times two and a half.
    smooth = np.sin(np.arange(COUNT) / 5.0) + 1e-9 * np.random.default_rng(1).random(COUNT)
    play = smooth.std() * np.resize([-0.5, 0.5], 2)
    assert verdict(stopped(smooth, 2.2e-4 * play)) == "refused"
    assert verdict(stopped(smooth, 2.7e-4 * play)) == "ok"


def held(part: float, level: float) -> np.ndarray:
    """Return a drive that changes in a part of its samples, and stops at a level."""
    rng = np.random.default_rng(2)
    changes = rng.random(COUNT) < part
    last = np.maximum.accumulate(np.where(changes, np.arange(COUNT), 0))
    noise = rng.standard_normal(COUNT)[last]
    noise = (noise - noise.mean()) / noise.std()
    noise[FIRST:AFTER] = level
    return noise


def test_a_drive_stops_where_it_does_not_belong():
    """It rests at its mean; and one of steps rests aside of that between them."""
    assert [verdict(held(1.0, level), "N") for level in (0.15, 0.25)] == ["note", "warning"]
    assert [verdict(held(part, 1.0), "N") for part in (0.45, 0.55)] == ["note", "warning"]
    record = Record([Channel("r")], held(1.0, 1.0)[:, None], 1000.0)
    (check,) = found_by("whole", Seen(record, channels=(), references=("r",)))
    assert (check.about, check.verdict) == ("stuck reference", "warning")


@pytest.mark.parametrize(("levels", "told"), [(3, "warning"), (4, "note")])
def test_a_channel_whose_last_digit_is_all_that_moves(levels, told):
    samples = 4e-6 + 1e-7 * np.random.default_rng(3).integers(0, levels, COUNT)
    record = Record([Channel("x", "m")], samples[:, None], 1000.0)
    assert [check.verdict for check in of_check(check_record(record), "quantized")] == [told]
    assert not of_check(check_record(record), "stuck")
    force = replace(record, channels=(Channel("F", "N"),))
    assert [check.verdict for check in of_check(check_record(force), "quantized")] == ["note"]


# Samples that are missing in the middle of a whole record.


PROBES = [Channel("F", "N"), *(Channel(f"x{k}", "m") for k in range(4))]


def found(samples: np.ndarray, channels: list[Channel] = PROBES) -> list[Note]:
    record = Record(channels, samples, 1000.0)
    found = found_by("whole", Seen(record, channels=record.channels))
    return [c for c in found if c.about == "lost samples"]


def resting(size: float, columns: tuple[int, ...] = (1, 2, 3, 4), count: int = 400) -> np.ndarray:
    """Return positions of noise that is one at every second difference, with a jump."""
    noise = np.resize([0.0, 1.0], (count, 1)) / 2 * np.ones(5)
    noise[count // 2 :, list(columns)] += size
    return noise


def test_how_large_a_jump_is():
    """What is usual is one: steps of a half, forth and back, differ by one from their neighbours.

    The jump is the other way than such a step.
    """
    assert not found(resting(8.9))
    (told,) = found(resting(9.1))
    assert (told.about, told.verdict) == ("lost samples", "warning")
    jump = "4 positions jump within a sample at 0.1995 s: samples are missing"
    assert told.found.startswith(jump)


def test_it_takes_half_of_the_positions_and_two():
    assert not found(resting(90.0, (1,)))
    assert found(resting(90.0, (1, 2)))
    more = [*PROBES, Channel("x4", "m")]
    assert not found(np.column_stack([resting(90.0, (1, 2)), resting(0.0)[:, 1]]), more)
    assert not found(resting(90.0, (1,))[:, :2], [Channel("x", "m"), Channel("y", "m")])
    assert not found(resting(90.0), [Channel(c.name, "N") for c in PROBES])


def test_what_is_usual_is_told_by_what_lies_around():
    """Of fifty samples on each side: what is loud farther away does not count."""
    for quiet, told in ((46, False), (54, True)):
        samples = resting(0.0, count=1000)
        samples[np.abs(np.arange(1000) - 499.5) > quiet] *= 30.0
        samples[500:] += 61.0
        assert bool(found(samples)) == told
    assert not found(resting(90.0, count=199))
    assert found(resting(90.0, count=200))


@pytest.mark.parametrize("seed", range(2))
def test_a_whole_record_without_a_gap(seed):
    record = levitated(seed, 2.0)
    assert not found(record.samples, list(record.channels))


# What a table of phasors shows before any model, at the limits.


DEAD, SILENT = [("dead", "refused")], [("silent", "warning")]


@pytest.mark.parametrize(
    ("phasors", "std", "told"),
    [
        ([0, 0], None, DEAD),
        ([0, 1], None, []),
        ([1j, 1j, 1j], None, DEAD),
        ([1j, 1j], None, []),  # two rows may well agree
        ([1, 1.1j, 2.8], 1.0, SILENT),
        ([1, 1.1j, 3.2], 1.0, []),
        ([1, 1.1j, 2.8], None, []),
        ([1, 1.1j, 3.2], None, []),
    ],
)
def test_a_probe_that_reads_nothing_or_the_same_or_not_above_its_noise(phasors, std, told):
    column = np.array(phasors, dtype=np.complex128)[:, None]
    deviation = None if std is None else np.full(column.shape, std)
    assert [(c.about, c.verdict) for c in check_probes(["x"], column, deviation)] == told


@pytest.mark.parametrize(
    ("phases", "degrees", "verdicts"),
    [
        ([0.0, 1.0, 1.4], True, []),
        ([0.0, 1.0, 1.6], True, ["warning"]),
        ([0.0, 1.6], True, []),  # two rows say little
        ([0.0, 3.0, 6.2], True, ["warning"]),
        ([0.0, 3.0, 6.4], True, []),
        ([0.0, 3.0, 12.4], False, []),
        ([0.0, 3.0, 12.7], False, ["refused"]),
        ([0.0, -12.7], False, ["refused"]),
    ],
)
def test_phases_that_are_hardly_in_their_unit(phases, degrees, verdicts):
    assert [c.verdict for c in check_phases("x", np.array(phases), degrees=degrees)] == verdicts


# What is added to a command moves the machine later, never earlier.


LENGTH = 8000
REFERENCE_RATE = 1000.0


def held_against(references: np.ndarray, channels: np.ndarray) -> list[rid.Note]:
    lines = [np.fft.rfft(np.atleast_2d(part).T, axis=0) for part in (references, channels)]
    names = [[f"{kind}{k}" for k in range(lines[n].shape[1])] for n, kind in enumerate("rc")]
    return list(check_references(names[0], lines[0], names[1], lines[1], REFERENCE_RATE))


def wave(top: float, seed: int = 1) -> np.ndarray:
    lines = np.fft.rfft(np.random.default_rng(seed).standard_normal(LENGTH))
    lines[round(top * LENGTH / REFERENCE_RATE) :] = 0.0
    return np.fft.irfft(lines)


@pytest.mark.parametrize(("top", "samples", "late"), [(100, 14, False), (100, 17, True)])
def test_how_late_a_reference_is_at_least(top, samples, late):
    """Of a band of 100 Hz one and a half widths are 15 ms, at a thousand samples a second 15."""
    told = held_against(wave(top), np.roll(wave(top), -samples))
    assert bool(told) == late
    if late:
        assert f"c0 follows it 0.0{samples} s before it comes, {samples} samples" in told[0].found
    assert not held_against(wave(top), np.roll(wave(top), 50))


@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        (10.1, "c0 follows it"),
        (10.4, ""),
        (12.3, ""),
        (12.6, "nothing that was measured follows it"),
    ],
)
def test_what_follows_a_reference(noise, expected):
    """One that hardly follows, in noise, tells no time; and one of noise alone does not follow."""
    rng = np.random.default_rng(7)
    channel = np.roll(wave(450.0), -40) + noise * rng.standard_normal(LENGTH)
    told = held_against(wave(450.0), channel)
    assert [check.found.startswith(expected) for check in told] == [True] * bool(expected)


def test_axes_that_are_excited_in_turn():
    """The second axis follows the first one's reference by half a record, and its own at once."""
    half = np.arange(LENGTH) < LENGTH // 2
    first = wave(450.0) * half
    second = np.roll(first, LENGTH // 2 - 1)
    assert not held_against(np.array([first, second]), np.array([first, second]))


def test_excitation_with_a_period():
    """Any period may be the one that a channel follows: the nearest is taken."""
    period = np.tile(wave(450.0)[:800], 10)
    assert not held_against(period, np.roll(period, 30))
    (told,) = held_against(period, np.roll(period, -30))
    assert " 30 samples" in told.found
    # A second peak that stands out less is none: most lines are late, the others are not.
    reference = np.fft.rfft(wave(450.0))
    turns = np.exp(2j * np.pi * np.arange(LENGTH // 2 + 1) / LENGTH)
    drawn = np.random.default_rng(1).random(len(turns))
    for part, late in ((0.57, True), (0.535, False)):
        lines = reference * np.where(drawn < part, turns**300, turns**-3)
        assert bool(held_against(wave(450.0), np.fft.irfft(lines))) == late


@pytest.mark.parametrize(("lines", "told"), [(21, False), (23, True)])
def test_a_reference_of_few_lines_tells_nothing(lines, told):
    excited = np.zeros(LENGTH // 2 + 1, dtype=complex)
    excited[500 : 500 + lines] = 1.0
    reference = np.fft.irfft(excited)
    noise = np.random.default_rng(1).standard_normal(LENGTH)
    assert bool(held_against(reference, noise)) == told


@pytest.mark.parametrize(("power", "told"), [(0.8e-2, True), (1.2e-2, False)])
def test_lines_that_are_weak_do_not_count(power, told):
    """A channel that follows on the strong lines alone, and a reference that is weak elsewhere."""
    rng = np.random.default_rng(3)
    strong = np.arange(LENGTH // 2 + 1) < 60
    phase = np.exp(2j * np.pi * rng.random(LENGTH // 2 + 1))
    reference = np.where(strong, 1.0, np.sqrt(power)) * phase
    other = np.exp(2j * np.pi * rng.random(LENGTH // 2 + 1))
    shift = np.exp(2j * np.pi * np.arange(LENGTH // 2 + 1) * 400 / LENGTH)
    lines = np.where(strong, phase * shift, other)
    pair = (["r"], reference[:, None], ["c"], lines[:, None])
    found = check_references(*pair, REFERENCE_RATE)
    assert ["c follows it" in check.found for check in found] == [told]


def lines(record: Record, **more: Record) -> rid.Lines:
    return rid.spectra(record, (2.0, 120.0), references=["r_x", "r_y"], **more)


@pytest.mark.slow
def test_the_references_of_a_loop():
    record = levitated(1)
    late = record.samples.copy()
    late[:, 4:] = np.roll(late[:, 4:], 12, axis=0)

    right, wrong = (
        rid.identify(MODEL, lines(replace(record, samples=samples)), KNOWN)
        for samples in (record.samples, late)
    )
    assert not [check for check in right.checks if check.about == "reference"]
    assert wrong.status == "ok"  # it makes deviations wider, and none wrong
    told = [check for check in wrong.checks if check.about == "reference"]
    assert [(*c.on, c.verdict) for c in told] == [("r_x", "warning"), ("r_y", "warning")]
    assert all(re.search(" (9|10|11) samples: it is late by as much", c.found) for c in told)


# A quiet record is held against the one it goes with, by what the unbalance does in both.


PAIR = [Channel("F", "N"), Channel("x", "m")]


def motion(size: float, place: float = 50.0, driven: float = 0.0) -> DrivenMotion:
    """Return lines of which the rotation is one, in the second channel, beside noise and a wave."""
    rng = np.random.default_rng(1)
    turning = np.zeros((200, 2), dtype=np.complex128)
    turning[round(place), 0] = 1.0
    wave = rng.standard_normal((200, 1, 2)) @ np.array([1, 1j])
    channels = (rng.standard_normal((200, 2, 2)) @ np.array([1, 1j])) / np.sqrt(2)
    channels[round(place)] = 0.0
    channels[:, 1:] += size * turning[:, :1] + driven * wave * np.linspace(1, 2, 200)[:, None]
    return DrivenMotion(channels, wave, turning, place)


def rotation_of(record: DrivenMotion, quiet: DrivenMotion, other: float = SPEED) -> list[str]:
    return [", ".join(check.on) for check in check_quiet(PAIR, record, quiet, (SPEED, other))]


def test_the_size_of_the_rotation_and_its_deviation():
    size, std = motion(100.0, driven=1e3).turning()
    assert size[1] == pytest.approx(100.0, abs=2.0)
    assert 0.5 < std[1] < 1.5
    told = [motion(1.0, place=place).turning() is not None for place in (12.0, 13.0, 187.0, 188.0)]
    assert told == [False, True, True, False]


def test_a_rotation_that_differs_is_told():
    assert not rotation_of(motion(1e4), motion(0.71e4))
    assert rotation_of(motion(1e4), motion(0.69e4)) == ["x"]
    assert rotation_of(motion(0.69e4), motion(1e4)) == ["x"]
    # Not where noise may have done it: two deviations of about one each.
    _, std = motion(0.0).turning()
    sure = 6 * np.sqrt(2) * std[1]
    assert not rotation_of(motion(1.02 * sure), motion(0.1 * sure))
    assert rotation_of(motion(1.12 * sure), motion(0.1 * sure)) == ["x"]


def test_speeds_that_are_stated_apart_are_told():
    assert not rotation_of(motion(1e4), motion(1e4), 1.049 * SPEED)
    assert rotation_of(motion(1e4), motion(1e4), 1.051 * SPEED) == [""]
    assert rotation_of(motion(1e4), motion(1e4), 0.0) == [""]


@pytest.mark.slow
def test_a_quiet_record_at_standstill_that_is_said_to_turn():
    quiet = levitated(2, excitation=0.0)
    assert not lines(levitated(1), quiet=quiet).checks
    with pytest.raises(rid.InputError, match="name the file that was recorded without excitation"):
        lines(levitated(1), quiet=levitated(1))
    rng = np.random.default_rng(1)
    still = quiet.samples.std(axis=0) * 0.1 * rng.standard_normal(quiet.samples.shape)
    wrong = replace(quiet, samples=still)
    answer = rid.identify(MODEL, lines(levitated(1), quiet=wrong), KNOWN)
    (told,) = [check for check in answer.checks if check.about == "quiet"]
    assert told.verdict == "warning"
    assert "one of the two was taken at another speed than stated" in told.found
    assert told.found.endswith("at the speed and under the control of the record")
