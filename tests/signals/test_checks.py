"""Checks of the data before any model: each mistake is named, and noise is none."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from adverse_cases import CASES
from scipy.signal import lfilter

from rotorid import Channel, Note, PeriodicRecord, Record, average
from rotorid.core.notes import worst
from rotorid.signals.checks import rotation as checks_rotation
from rotorid.signals.checks.channels import check_copied
from rotorid.signals.checks.registry import check_periods, check_record

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
    samples = (waves @ lines).real + noise * SCALE * rough
    return Record(CHANNELS, samples, RATE, speed=speed)


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


def only(found: list[Note], name: str) -> Note:
    grave = [c for c in found if c.verdict in ("warning", "refused")]
    assert [c.about for c in grave] == [name], [str(c) for c in found]
    return grave[0]


@pytest.mark.sampled(7)
@pytest.mark.parametrize("periods", [2, 3, 4, 6, 8, 30, 150])
@pytest.mark.parametrize("colour", [0.0, 0.9, 0.99])
def test_a_clean_record_gives_no_alarm(periods: int, colour: float) -> None:
    for seed in range(10):
        found = told(machine(periods, seed=seed, colour=colour, noise=10 ** (seed / 4 - 2)))
        assert [str(c) for c in found if c.verdict in ("warning", "refused")] == []


def test_everything_looked_at_is_named() -> None:
    record = machine()
    periods = cut(record)
    names = [c.about for c in (*check_record(record, periods), *check_periods(periods))]
    assert len(set(names)) == len(names)
    assert {"dead", "copied", "speed", "lost samples"} <= {*names}
    assert worst(check_periods(periods)) == "ok"
    assert worst(()) == "ok"


def test_a_quiet_input_is_a_note_and_a_dead_sensor_more() -> None:
    quiet = damaged(machine(), of(1, lambda v: 0 * v))
    assert next((c.about, ", ".join(c.on), c.verdict) for c in told(quiet)) == (
        "dead",
        "F_y",
        "note",
    )
    dead = only(told(damaged(machine(), of(2, lambda v: 0 * v + 3.3))), "dead")
    assert (", ".join(dead.on), dead.verdict) == ("x", "refused")
    assert "3.3 in every sample" in dead.found


def test_no_living_sensor_is_refused() -> None:
    record = damaged(machine(), lambda s: s * [1, 1, 0, 0])
    assert {c.verdict for c in check_record(record) if c.about == "dead"} == {"refused"}


def test_without_noise_a_sensor_may_rest() -> None:
    """A simulated axis that nothing excites is zero, and nothing is wrong with it."""
    record = damaged(machine(noise=0.0), of(3, lambda v: 0 * v))
    periods = cut(record)
    assert worst(c for c in check_record(record, periods) if c.about == "dead") == "warning"


def clipped_at(part: float) -> Damage:
    return of(2, lambda v: np.clip(v, -part * np.abs(v).max(), part * np.abs(v).max()))


def test_clipping_is_found_with_its_level() -> None:
    found = only(told(damaged(machine(), clipped_at(0.8))), "clipped")
    assert ", ".join(found.on) == "x"
    assert "flat tops of" in found.found
    assert "% of the samples" in found.found


def test_a_converter_that_clips_is_found() -> None:
    fine = damaged(machine(), clipped_at(0.8))
    step = fine.samples[:, 2].std() / 200
    record = damaged(fine, of(2, lambda v: np.round(v / step) * step))
    assert only(told(record), "clipped").on == ("x",)


@pytest.mark.parametrize("held", [2, 4, 8])
def test_a_held_command_is_not_clipped(held: int) -> None:
    record = damaged(machine(noise=0.0), lambda s: np.repeat(s[::held], held, axis=0)[: len(s)])
    assert not [c for c in check_record(record) if c.about == "clipped" and c.verdict != "ok"]


def test_a_rest_at_the_end_of_the_stroke_is_not_clipped() -> None:
    """A position that comes to rest in single steps of its encoder."""
    stroke = 0.1 * np.clip(np.sin(np.linspace(0, 20, 20_000)) * 1.0, -1, 1)
    eased = np.round(np.tanh(20 * stroke) / 1e-4) * 1e-4
    record = Record([Channel("x", "m")], eased[:, None], 1000.0)
    assert not [c for c in check_record(record) if c.about == "clipped" and c.verdict != "ok"]


def test_two_levels_are_not_clipped() -> None:
    rng = np.random.default_rng(0)
    levels = np.repeat(rng.choice([-1.0, 1.0], 2000), 10)
    record = Record([Channel("F", "N")], levels[:, None], 1000.0)
    assert not [c for c in check_record(record) if c.about == "clipped" and c.verdict != "ok"]


@pytest.mark.parametrize(
    ("noise", "step", "verdict"),
    [
        (0.05, 0.045, "ok"),  # dithered by a scatter of half a step
        (0.5, 0.06, "note"),  # dithered, but coarse
        (0.005, 0.045, "note"),  # repeats in every period, but is fine
        (0.05, 0.15, "warning"),  # repeats, and is coarse
        (0.05, 1.0, "warning"),
    ],
)
def test_coarse_steps_are_told_by_what_they_do(noise: float, step: float, verdict: str) -> None:
    """The scatter is about 0.4 of the noise over the rms of the channel."""

    def rounded(v: np.ndarray) -> np.ndarray:
        quantum = step * v.std()
        return np.round(v / quantum) * quantum

    record = damaged(machine(noise=noise), of(2, rounded))
    found = check_record(record, cut(record))
    assert worst(c for c in found if c.about == "quantized") == verdict


def test_a_copied_sensor_is_refused_and_a_copied_force_told() -> None:
    def sensor(samples: np.ndarray) -> np.ndarray:
        samples[:, 3] = 2.5 * samples[:, 2]
        return samples

    def force(samples: np.ndarray) -> np.ndarray:
        samples[:, 1] = samples[:, 0]
        return samples

    found = only(told(damaged(machine(), sensor)), "copied")
    assert (", ".join(found.on), found.verdict) == ("x, y", "refused")
    assert "y is 2.5 times x" in found.found
    assert only(told(damaged(machine(), force)), "copied").verdict == "warning"


def test_each_copy_of_a_channel_is_told_of_the_first_alone() -> None:
    """Three channels that are one: two notes; of two samples, which are alike by chance, none."""
    channels = [Channel(f"x{i}", "m") for i in range(4)]
    noise = np.random.default_rng(3).normal(size=(40, 2))
    values = np.stack([noise[:, 0], 2 * noise[:, 0], noise[:, 1], -noise[:, 0]], axis=1)
    assert [n.on for n in check_copied(channels, values)] == [("x0", "x1"), ("x0", "x3")]
    assert not list(check_copied(channels, values[:2] - values[:2].mean(axis=0)))


def test_the_same_excitation_on_two_axes_is_no_copy() -> None:
    """Equal commands, each with noise of its own; or without any."""

    def same(samples: np.ndarray) -> np.ndarray:
        samples[:, 1] = samples[:, 0] + 1e-3 * np.random.default_rng(5).normal(size=len(samples))
        return samples

    assert not [c for c in told(damaged(machine(), same)) if c.about == "copied"]
    exact = machine(noise=0.0)
    assert not [c for c in told(damaged(exact, same)) if c.about == "copied"]


def test_identical_periods_are_said() -> None:
    tiled = damaged(machine(), lambda s: np.tile(s[:SIZE], (60, 1)))
    found = only(told(tiled), "identical periods")
    assert "deviations of the result are unknown, not zero" in found.found


def test_a_measurement_that_is_there_twice_is_said() -> None:
    once = 30 * SIZE
    appended = damaged(machine(), lambda s: np.concatenate([s[:once], s[:once]]))
    found = only(told(appended), "copied periods")
    assert found.found.startswith("30 of 60 periods are earlier ones again")
    assert "period 31 is period 1" in found.found
    single = damaged(machine(), lambda s: np.concatenate([s[:once], s[-SIZE:], s[once:]]))
    assert "1 of" in only(told(single), "copied periods").found


def test_what_settles_without_noise_is_no_copy() -> None:
    def settled(samples: np.ndarray) -> np.ndarray:
        fading = np.exp(-np.arange(len(samples)) / SIZE)
        return samples * (1 + np.where(fading > 1e-9, fading, 0.0))[:, None]

    quiet = damaged(machine(noise=0.0), settled)
    assert not [c for c in told(quiet) if c.about == "copied periods"]


def test_one_channel_without_scatter_is_named() -> None:
    column = machine(noise=0.0).samples
    for c, verdict in ((0, "note"), (2, "warning")):
        record = damaged(machine(), of(c, lambda v, c=c: column[:, c]))  # type: ignore[misc]
        (found,) = [k for k in told(record) if k.about == "identical periods"]
        assert (", ".join(found.on), found.verdict) == (CHANNELS[c].name, verdict)


@pytest.mark.parametrize(("count", "at"), [(1, 7000), (1, 8010), (20, 7100), (3, 13_000)])
@pytest.mark.parametrize("speed", [0.0, 2 * np.pi * 140])
def test_lost_samples_are_counted_and_placed(count: int, at: int, speed: float) -> None:
    record = damaged(machine(speed=speed), lambda s: np.delete(s, slice(at, at + count), axis=0))
    found = only(told(record), "lost samples")
    assert found.found.startswith(f"{count} sample")
    assert " lost between " in found.found
    begin, end = (float(found.found.split(word)[1].split()[0]) for word in ("between ", "and "))
    assert begin <= at / RATE <= end + 1 / RATE
    assert end - begin < 2.1 / F0
    assert found.verdict == ("refused" if speed else "warning")


def test_a_sample_twice_is_found() -> None:
    record = damaged(machine(), lambda s: np.insert(s, 7000, s[7000], axis=0))
    assert only(told(record), "lost samples").found.startswith("1 sample too many")


def test_samples_lost_by_some_channels_are_refused() -> None:
    record = damaged(
        machine(),
        lambda s: np.hstack([s[:-2, :2], np.delete(s[:, 2:], slice(6000, 6002), axis=0)]),
    )
    found = only(told(record), "lost samples")
    assert (", ".join(found.on), found.verdict) == ("x, y", "refused")
    assert found.found.startswith("2 samples lost in x, y only")


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


def test_a_period_that_is_not_the_one_given_is_found_with_its_true_value() -> None:
    found = only(told(damaged(machine(200), lambda s: stretched(s, 20.0, slice(0, 4)))), "period")
    assert "(-20 ppm)" in found.found
    assert "20.0004 Hz, not 20" in found.found


def test_two_clocks_are_found_with_the_channels_of_each() -> None:
    record = damaged(machine(200), lambda s: stretched(s, 20.0, slice(2, 4)))
    found = only(told(record), "clocks")
    assert found.verdict == "refused"
    assert found.found.startswith("x, y and F_x, F_y run on two clocks, ")
    assert float(found.found.split("clocks, ")[1].split()[0]) == pytest.approx(20.0, rel=0.01)


def test_lines_whose_size_changes_too_are_no_second_clock() -> None:
    """Gaps that grow with heat turn the lines of a closed loop as a clock does, and more."""
    ramp = np.linspace(-1, 1, 60 * SIZE)[:, None] * np.array([0, 0, 0.01, 0.01])

    def warmer(samples: np.ndarray) -> np.ndarray:
        return samples * (1 + ramp) + np.roll(samples, 3, axis=0) * ramp

    found = told(damaged(machine(noise=0.02), warmer))
    assert {(c.about, ", ".join(c.on)) for c in found} == {("drift", "x"), ("drift", "y")}


def test_a_knock_is_named_by_period_and_time() -> None:
    def knock(samples: np.ndarray) -> np.ndarray:
        samples[5000:5020] += 5 * SCALE
        return samples

    found = only(told(damaged(machine(), knock)), "knock")
    assert "period 21 (1 s)" in found.found
    assert ", ".join(found.on) == "F_x, F_y, x, y"


def test_a_slow_change_is_a_drift_with_its_size() -> None:
    ramp = np.linspace(0.99, 1.01, 60 * SIZE)[:, None] ** np.array([0, 0, 1, 1])
    found = told(damaged(machine(noise=0.02), lambda s: s * ramp))
    assert {(c.about, ", ".join(c.on), c.verdict) for c in found} == {
        ("drift", "x", "warning"),
        ("drift", "y", "warning"),
    }
    assert " changes by 1.9" in found[0].found or " changes by 2" in found[0].found


@pytest.mark.parametrize(("grows", "name"), [(True, "drift"), (False, "speed")])
def test_what_changes_the_line_of_the_rotation_alone(grows: bool, name: str) -> None:
    """A gain changes its size, a speed that is a little off its phase."""
    plain, time = machine(noise=0.02), np.arange(60 * SIZE) / RATE
    change = np.linspace(-0.01, 0.01, len(time))
    phase = 2 * np.pi * 7 * F0 * time
    bent = 3 * np.cos(phase) * (1 + change) if grows else 3 * np.cos(phase + change)
    found = told(
        replace(damaged(plain, lambda s: s + SCALE * bent[:, None]), speed=2 * np.pi * 7 * F0)
    )
    assert {c.about for c in found if c.verdict == "warning"} == {name}


def test_a_transient_of_sensors_takes_no_samples_from_a_force() -> None:
    """What the sensors show together looks like a shift by eleven samples, and is none."""
    (case,) = (c for c in CASES if c.what == "a transient at the start")
    found = case.run(7, leads=False)
    assert case.holds(found, leads=False), found


@pytest.mark.parametrize("periods", [3, 4, 6, 7, 20])
def test_a_transient_is_found_with_few_periods_too(periods: int) -> None:
    def start(samples: np.ndarray) -> np.ndarray:
        return samples + 3 * SCALE * np.exp(-np.arange(len(samples)) / 60.0)[:, None]

    found = only(told(damaged(machine(periods, noise=0.01), start)), "settled")
    assert "skip" in found.found


def test_two_periods_show_no_transient_and_it_is_said() -> None:
    (found,) = [c for c in told(machine(2)) if c.about == "settled"]
    assert found.verdict == "note"
    assert "2 periods cannot show a transient" in found.found


def turning(frequency: float, given: float, periods: int = 100) -> Record:
    """A rotor with unbalance at one speed, said to have another."""
    record = machine(periods, speed=2 * np.pi * given)
    time = np.arange(len(record.samples)) / RATE
    wave = np.cos(2 * np.pi * frequency * time)[:, None] * [0, 0, 1e-4, 1e-4]
    return replace(record, samples=record.samples + wave)


@pytest.mark.parametrize("speed", [93.37, 97.1, 140.0, 80.0])
def test_the_right_speed_is_no_matter(speed: float) -> None:
    """Off the lines, on one that is excited, on one that is not."""
    assert not [c for c in told(turning(speed, speed)) if c.about == "speed"]


@pytest.mark.parametrize(
    ("true", "given", "words"),
    [
        (93.37, 92.9, "at 93.37"),
        (93.37, 93.37 * 2 * np.pi / 60, "rad/s given as rpm?"),
        (93.37, 93.37 / 60, "Hz given as rpm?"),
        (93.37, 93.37 / (2 * np.pi), "Hz given as rad/s?"),
        (80.0, 91.0, "at 80 Hz (4800 rpm)"),
        (93.37, 75.0, "where nothing stands: give the speed at which"),
    ],
)
def test_a_wrong_speed_is_named_with_the_one_that_the_record_shows(
    true: float, given: float, words: str
) -> None:
    (found,) = [c for c in told(turning(true, given)) if c.about == "speed"]
    assert found.verdict == "warning"
    assert words in found.found


@pytest.mark.parametrize("periods", [2, 3, 6])
def test_a_record_that_does_not_repeat_is_told(periods: int) -> None:
    record = machine(periods)
    rough = np.random.default_rng(3).normal(size=(periods, 1, 4)) * SCALE * 3
    wave = np.cos(2 * np.pi * np.arange(SIZE) / SIZE)[:, None]
    other = replace(record, samples=record.samples + (rough * wave).reshape(-1, 4))
    assert "repeats" in [c.about for c in told(other) if c.verdict == "warning"]


@pytest.mark.parametrize("start", [0.0, 100.0])
def test_a_fundamental_that_is_twice_the_true_one(start: float) -> None:
    """Excited at 20 Hz and its odd multiples, said to be 40 Hz."""
    record = replace(machine(60), start=start)
    (found,) = [c for c in told(record, fundamental=2 * F0) if c.about == "multiple period"]
    assert (", ".join(found.on), found.verdict) == ("F_x, F_y", "warning")
    assert "the fundamental is 20 Hz, not 40; multiply the harmonics by 2" in found.found


def test_a_rotation_half_way_between_the_lines_is_no_longer_period() -> None:
    """It repeats after two periods, and the speed says so."""
    for given, expected in ((90.0, 0), (93.37, 1)):
        record = turning(90.0, given)
        force = 20.0 * np.cos(2 * np.pi * 90.0 * np.arange(len(record.samples)) / RATE)
        samples = record.samples + force[:, None] * [1, 1, 0, 0]
        found = told(replace(record, samples=samples))
        assert len([c for c in found if c.about == "multiple period"]) == expected


@pytest.mark.parametrize("start", [0.0, 100.0])
def test_a_tone_at_standstill_is_a_note(start: float) -> None:
    record = replace(turning(50.33, 0.0), start=start)
    (found,) = [c for c in told(record) if c.about == "speed"]
    assert found.verdict == "note"
    assert "a line at 50.33" in found.found


def test_masked_samples_are_not_looked_at() -> None:
    record = damaged(machine(), clipped_at(0.8))
    masked = replace(
        record, valid=np.abs(record.samples[:, 2]) < np.abs(record.samples[:, 2]).max()
    )
    assert "clipped" not in [c.about for c in check_record(masked) if c.verdict != "ok"]


def test_lines_that_nothing_excites_are_told() -> None:
    (found,) = told(machine(), lines=[1, 2, 3, 4, 5])
    assert (found.about, found.verdict) == ("lines below noise", "note")
    assert found.found.startswith("40, 80 Hz hold no input")
    grave = told(machine(), lines=[2, 4, 6])
    assert {c.verdict for c in grave} == {"warning"}
    assert "no line used of any input" in grave[0].found


@pytest.mark.slow
def test_random_machines_raise_no_alarm() -> None:
    """At most 1 in 1000 of clean records may be called anything; of 300, then, none."""
    alarms = []
    for seed in range(300):
        rng = np.random.default_rng(10_000 + seed)
        record = machine(
            periods=int(rng.integers(4, 200)),
            noise=10 ** rng.uniform(-2.5, 0.5),
            seed=seed,
            colour=float(rng.choice([0.0, 0.5, 0.95, 0.995])),
            speed=2 * np.pi * F0 * float(rng.choice([0, 5, 7, 9])),
        )
        alarms += [(seed, str(c)) for c in told(record) if c.verdict in ("warning", "refused")]
    assert alarms == []


@pytest.mark.parametrize(("swing", "told"), [(0.0, False), (0.03, True)])
def test_a_speed_that_wanders_scatters_the_line_of_the_rotation(swing, told):
    """1x motion of 10 um whose phase swings by this many rad; 1 % noise."""
    rng = np.random.default_rng(8)
    time = np.arange(20 * 500) / 5000.0
    phase = 2 * np.pi * 70 * time + swing * np.sin(2 * np.pi * 0.3 * time)
    motion = 1e-5 * np.cos(phase) + 1e-6 * np.cos(2 * np.pi * 30 * time)
    samples = motion + 1e-8 * rng.standard_normal(len(time))
    record = Record([Channel("x", "m")], samples[:, None], 5000.0, speed=2 * np.pi * 70)
    periods = average(record, 10.0, harmonics=[1, 2, 3, 5, 7])
    found = checks_rotation.check_wander(periods)
    assert [c.verdict for c in found] == (["warning"] if told else [])


def stopping(part: float, value: float | None = None) -> Damage:
    """Hold one value for a part of the record."""

    def change(samples: np.ndarray) -> np.ndarray:
        first = len(samples) // 3
        stays = samples[first] if value is None else value
        samples[first : first + int(part * len(samples))] = stays
        return samples

    return change


def stuck(record: Record) -> list[Note]:
    return [note for note in told(record) if note.about == "stuck"]


def test_a_sensor_that_stops_is_refused() -> None:
    found, *others = told(damaged(machine(), of(3, stopping(0.021))))
    assert [other.about for other in others] == ["knock"]
    assert (", ".join(found.on), found.verdict) == ("y", "refused")
    assert "from 1 to 1.063 s" in found.found
    assert not stuck(damaged(machine(), of(3, stopping(0.019))))
    for value, verdict in ((0.0, "note"), (5.0, "warning")):  # where it drives nothing, or not
        (check,) = stuck(damaged(machine(), of(0, stopping(0.021, value))))
        assert (check.about, ", ".join(check.on), check.verdict) == ("stuck", "F_x", verdict)


def test_what_rests_before_it_is_used_or_at_every_step_is_not_stuck() -> None:
    idle = damaged(machine(), of(3, lambda v: np.where(np.arange(len(v)) < 1000, 0.0, v)))
    periods = average(idle, F0, harmonics=LINES.tolist(), skip=0.2)
    assert "stuck" not in [c.about for c in periods.checks if c.verdict != "ok"]
    stairs = np.repeat(np.arange(12), 15_000 // 12) % 5 * 1e-4
    assert not stuck(damaged(machine(), of(3, lambda v: stairs + 0 * v)))
    # Few samples may well stay the same.
    few = damaged(machine(2), of(3, stopping(0.08)))
    assert not stuck(few)


def rotating(hertz: float, y_phase: float, y_size: float = 1.0) -> Record:
    """Said to turn at 100 Hz, a line that is excited, with a tone elsewhere in x and y."""
    record = machine(speed=2 * np.pi * 100.0)
    turn = 2 * np.pi * hertz * np.arange(len(record.samples)) / RATE
    tone = np.column_stack([0 * turn, 0 * turn, np.cos(turn), y_size * np.cos(turn + y_phase)])
    return replace(record, samples=record.samples + 2e-4 * tone)


@pytest.mark.parametrize("hertz", [110.3, 120.0])
def test_a_tone_that_goes_round_is_the_rotation(hertz: float) -> None:
    """Square to one another in x and y: an orbit. In phase: hum."""
    assert (np.radians(20.0), 2.0) == (checks_rotation.SQUARE, checks_rotation.ROUND)
    for phase, size, verdict in (
        (np.pi / 2, 1.0, "warning"),
        (-np.pi / 2, 1.9, "warning"),
        (np.pi / 2, 2.1, "note"),
        (np.radians(71), 1.0, "warning"),
        (np.radians(69), 1.0, "note"),
        (0.0, 1.0, "note"),
        (np.pi, 1.0, "note"),
    ):
        (found,) = [c for c in told(rotating(hertz, phase, size)) if c.about == "speed"]
        assert found.verdict == verdict, (phase, size)


def test_a_light_mode_that_goes_round_is_no_rotation(monkeypatch: pytest.MonkeyPatch) -> None:
    """What stands out less than clearly stays a note."""
    record = rotating(110.3, np.pi / 2)
    monkeypatch.setattr(checks_rotation, "CLEAR", 1e9)
    (found,) = [c for c in told(record) if c.about == "speed"]
    assert found.verdict == "note"


def test_a_tone_without_noise_in_samples_of_any_size() -> None:
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
