"""The same data twice: the same file, a copy of it, the same column for two channels."""

import shutil
import time
from contextlib import nullcontext
from pathlib import Path

import h5py
import numpy as np
import pytest
from io_writers import write_table
from model_text import model_text

import rotorid as rid
from rotorid import InputError, response_lines
from rotorid.experiment.duplicates import MOST, Prints, check_tables, shared
from rotorid.testing import phasor_lines

TWO = ["m*x'' + c*x' = F + G"]
MODEL = model_text("a mass on a damper, shaken by two", TWO, "x m", "F N, G N", "m kg, c N s/m")
HEAD = 'model = "model.toml"\nestimator = { method = "ls" }\n'
RECORD = """
[[records]]
file = "{file}"
sample_rate = "1 kHz"
fundamental = "10 Hz"
{more}
"""
CHANNELS = """
[channels]
F = { column = "fx", unit = "N" }
G = { column = "gx", unit = "N" }
x = { column = "px", unit = "um" }
"""
LINES = "harmonics = [1, 2]"
TIME = np.arange(1000) / 1000.0


def columns(noise: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(noise)
    force, other = np.cos(20 * np.pi * TIME), np.cos(40 * np.pi * TIME)
    motion = np.sin(20 * np.pi * TIME + 0.3) + np.sin(40 * np.pi * TIME)
    return {
        "fx": force,
        "gx": other,
        "px": motion + 1e-3 * rng.standard_normal(1000),
        "qx": motion + 1e-3 * rng.standard_normal(1000),
    }


def write(path: Path, values: dict[str, np.ndarray]) -> None:
    if path.suffix == ".h5":
        with h5py.File(path, "w") as data:
            for name, one in values.items():
                data[name] = one
    else:
        write_table(path, ",".join(values), *values.values(), fmt="%.17g")


@pytest.fixture
def load(tmp_path):
    """Load an experiment of records, each a file and what is said of it."""
    (tmp_path / "model.toml").write_text(MODEL)

    def make(*records: tuple[str, str], channels: str = CHANNELS):
        text = HEAD + "".join(RECORD.format(file=f, more=more) for f, more in records) + channels
        (tmp_path / "run.toml").write_text(text)
        return rid.load_experiment(tmp_path / "run.toml")

    return make


def test_a_file_twice(load, tmp_path):
    """Its deviations would be too small by the root of how often it is listed."""
    (tmp_path / "link.csv").symlink_to("run.csv")
    (tmp_path / "more").mkdir()
    for again in ("run.csv", "more/../run.csv", str(tmp_path / "run.csv"), "link.csv"):
        for more in (LINES, LINES + '\nskip = "0.5 s"', "harmonics = [2]"):
            with pytest.raises(InputError, match=r"run.toml: records\.1: .* of records\.0 again"):
                load(("run.csv", LINES), (again, more))
    with pytest.raises(InputError, match=r"records\.1: found the samples of records\.0 again"):
        load(*[("run.csv", LINES)] * 200)
    with pytest.raises(InputError, match=r"records\.2.*remove one.*skip and until"):
        load(("run.csv", LINES), ("other.csv", LINES), ("run.csv", LINES))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (LINES + '\nuntil = "0.5 s"', LINES + '\nskip = "0.5 s"'),
        ("harmonics = [1]", "harmonics = [2, 3]"),
        ('band = ["5 Hz", "15 Hz"]', 'band = ["16 Hz", "30 Hz"]'),
        (LINES + '\nmask = "one"', LINES + '\nmask = "two"'),
        (LINES, LINES + '\n[records.channels]\nx = { column = "qx", unit = "um" }'),
    ],
)
def test_a_file_for_two_records(first, second, load):
    """Other times, other lines, other sensors are other data."""
    assert len(load(("run.csv", first), ("run.csv", second)).entry.records) == 2


def test_the_noise_of_the_record_itself(load):
    whole = RECORD.replace('fundamental = "10 Hz"', "").format(
        file="run.csv", more='band = ["5 Hz", "50 Hz"]\nquiet = "./run.csv"'
    )
    with pytest.raises(InputError, match=r"records\.0\.quiet: found the record itself"):
        load(channels=whole + CHANNELS)


def test_a_copy(load, tmp_path):
    write(tmp_path / "run.h5", columns())
    shutil.copy(tmp_path / "run.h5", tmp_path / "copy.h5")
    with pytest.raises(InputError, match=r"copy\.h5: found 1000 samples that run\.h5 holds too"):
        load(("run.h5", LINES), ("copy.h5", LINES)).records()
    parts = (LINES + '\nuntil = "0.5 s"', LINES + '\nskip = "0.5 s"')
    assert len(load(("run.h5", parts[0]), ("copy.h5", parts[1])).records()) == 2


def test_files_of_holes_are_not_compared(load, tmp_path):
    """Of 300 GB each they would take minutes, and hold nothing."""
    for name in ("run.h5", "copy.h5"):
        with (tmp_path / name).open("wb") as stream:
            stream.truncate(3 * 10**11)
    started = time.process_time()
    with pytest.raises(InputError, match=r"run\.h5: found binary data"):
        load(("run.h5", LINES), ("copy.h5", LINES)).records()
    assert time.process_time() - started < 2


def test_an_export_of_the_same(load, tmp_path):
    """In another format, with other columns beside: every digit of the sensors is the same."""
    write(tmp_path / "run.h5", columns())
    write(tmp_path / "again.csv", {"time": TIME, **columns()})
    with pytest.raises(InputError, match=r"again\.csv: found 1000 .* run\.h5 holds too, in every"):
        load(("run.h5", LINES), ("again.csv", LINES)).records()
    write(tmp_path / "again.csv", columns(1))
    assert len(load(("run.h5", LINES), ("again.csv", LINES)).records()) == 2


PLATES = '[{ column = "fx", unit = "T" }, { column = "fx", unit = "T" }]'
FLUX = f'F = {{ law = "flux", flux = {PLATES}, area = "1 cm^2" }}'


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ('G = { column = "gx"', 'G = { column = "fx"', "channels.G: found 'fx' for F and for G"),
        ('x = { column = "px"', 'x = { column = "fx"', "channels.x: found 'fx' for F and for x"),
        ('x = { column = "px"', 'x = { column = "/fx"', "channels.x: found 'fx' for F and for x"),
        ('F = { column = "fx", unit = "N" }', FLUX, "found 'fx' for F and for F"),
        (
            "[channels]",
            '[channels]\nfar = { column = "px", unit = "um", reads = "2*x" }',
            "found 'px' for far and for x; .* one channel with reads",
        ),
    ],
)
def test_a_column_for_two_channels(old, new, found, load):
    with pytest.raises(InputError, match=found):
        load(("run.csv", LINES), channels=CHANNELS.replace(old, new))


def test_a_column_by_two_names(load, tmp_path):
    write(tmp_path / "run.h5", {f"log/{name}": one for name, one in columns().items()})
    channels = CHANNELS.replace('G = { column = "gx"', 'G = { column = "log/fx"')
    with pytest.raises(InputError, match=r"channels\.G\.column: found 'log/fx' for F and for G"):
        load(("run.h5", LINES), channels=channels).records()


def test_coils_in_series(load, tmp_path):
    """One current may drive two force laws; that is told, for it may be a slip."""
    write(tmp_path / "run.csv", columns())
    law = '{ law = "linear", ki = "20 N/A", ks = "0 N/m", position = "x", current = '
    coils = (f'{name} = {law} {{ column = "fx", unit = "A" }} }}\n' for name in "FG")
    channels = "[channels]\n" + "".join(coils)
    last = 'x = { column = "px", unit = "um" }\n'
    (record,) = load(("run.csv", LINES), channels=channels + last).records("ml")
    assert "the current 'fx' drives F and G: right for coils in series only" in record.warnings
    with pytest.raises(InputError, match="found 'fx' for F and for x"):
        load(("run.csv", LINES), channels=channels + last.replace("px", "fx"))


def test_phasors_and_responses_of_one_column(load):
    phasors = """
[[records]]
kind = "phasors"
file = "table.csv"
speed = { column = "n", unit = "rpm" }
[channels]
F = { amplitude = "a", phase = "p", unit = "N" }
x = { amplitude = "a", phase = "p", unit = "um" }
"""
    with pytest.raises(InputError, match="found 'a' and 'p' for F and for x"):
        load(channels=phasors)


MODES = (
    """
model = "jeffcott"
parameters.m = {{ fixed = "1 kg" }}
[[modes]]
frequency = "10 Hz"
std = "0.1 Hz"
{}
"""
    + '[[modes]]\nfrequency = "10 Hz"\nstd = "0.1 Hz"\n{}\n' * 2
)


@pytest.mark.parametrize(
    ("said", "again"),
    [
        (("mode = 1", "mode = 2", "mode = 1"), 2),
        (("", "", ""), 2),
        (("mode = 1", "mode = 1", ""), 1),
        (("", "", 'speed = "50 Hz"'), None),
        (("mode = 1", "mode = 2", ""), None),
    ],
)
def test_natural_frequencies_twice(said, again, tmp_path):
    told = rf"modes\.{again}: found the natural frequency of modes\.0"
    (tmp_path / "run.toml").write_text(MODES.format(*said))
    with pytest.raises(InputError, match=told) if again else nullcontext():
        assert len(rid.load_experiment(tmp_path / "run.toml").entry.modes) == 3


def scatters(load, folder: Path, first: dict, second: dict, more: str = LINES) -> list[str]:
    """Return what is told of the second of two records, whose first is not told of."""
    write(folder / "run.csv", first)
    write(folder / "again.csv", second)
    one, other = load(("run.csv", more), ("again.csv", more)).records()
    assert not any("scatters as" in text for text in one.warnings)
    return [text for text in other.warnings if "scatters as" in text]


@pytest.mark.parametrize("how", ["units", "digits", "single", "another"])
def test_an_export_with_fewer_digits(how, load, tmp_path):
    """Noise does not repeat: where it does, in other units or digits, that is told."""
    values = columns()
    again = {
        "units": {name: one * 1e-3 for name, one in values.items()},
        "digits": {name: np.round(one, 5) for name, one in values.items()},
        "single": {name: one.astype(np.float32) for name, one in values.items()},
        "another": columns(1),
    }[how]
    said = scatters(load, tmp_path, values, again)
    assert len(said) == (how != "another")
    assert all("run.csv does, period by period" in text for text in said)


@pytest.mark.parametrize(("part", "said"), [(0.2, True), (0.45, False)])
def test_lost_digits_are_noise_of_their_own(part, said, load, tmp_path):
    """Correlations of .98 and .91; .95 is asked for."""
    values, rng = columns(), np.random.default_rng(5)
    again = {**values, "px": values["px"] + part * 1e-3 * rng.standard_normal(1000)}
    more = "harmonics = [1, 2, 3, 4, 5, 6, 7]"
    assert bool(scatters(load, tmp_path, values, again, more)) == said


def test_a_measurement_from_its_fourth_period_on(load, tmp_path):
    values = columns()
    late = {name: 2 * one[300:] for name, one in values.items()}
    (said,) = scatters(load, tmp_path, values, late)
    assert "period by period, 3 periods later (corr" in said
    (said,) = scatters(load, tmp_path, late, values)
    assert "period by period, 3 periods earlier" in said


def test_hum_of_two_records_is_no_copy(load, tmp_path):
    """It meets itself at some lag; with a twentieth of noise to .997, short of .999."""
    rng, made = np.random.default_rng(3), []
    for start in (0.0, 0.4321):
        values = columns(7)
        hum = 0.1 * np.sin(2 * np.pi * 52.3 * (TIME + start))
        made.append({**values, "px": values["px"] + hum + 5e-3 * rng.standard_normal(1000)})
    assert not scatters(load, tmp_path, *made)


def test_scatter_that_is_none_tells_nothing(load, tmp_path):
    """Two exact records of one excitation are alike in all but their rounding."""
    exact = {name: np.resize(one[:100], 1000) for name, one in columns().items()}
    assert not scatters(load, tmp_path, exact, {name: 3 * one for name, one in exact.items()})


@pytest.mark.slow
@pytest.mark.parametrize(("periods", "said"), [(5, True), (4, False)])
def test_few_periods_may_be_alike_by_chance(periods, said, load, tmp_path):
    """Of n periods n - 1 are free, on each line: eight of these are needed."""
    again = {name: one * 1e-3 for name, one in columns().items()}
    until = f'{LINES}\nuntil = "{periods * 0.1} s"\nskip = "0 s"'
    assert bool(scatters(load, tmp_path, columns(), again, until)) == said


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("m = { value = '2 kg', std = '1 g' }", r"constraints\.0: found 'm', which is what param"),
        ("c = { value = '2 N s/m', std = '1 N s/m' }", r"constraints\.1: found '2\*m', .*nts\.0 "),
    ],
)
def test_a_weighing_twice(text, told, load):
    once = '[[constraints]]\nexpression = "{}"\nvalue = "2 kg"\nstd = "1 g"\n'
    more = f"{CHANNELS}[parameters]\n{text}\n{once.format('m')}{once.format('2*m')}"
    with pytest.raises(InputError, match=told):
        load(("run.csv", LINES), channels=more)
    assert len(load(("run.csv", LINES), channels=CHANNELS + once.format("m")).constraints) == 1


def write_excerpt(folder: Path, ending: str = "csv") -> None:
    """Write a measurement, and what it holds from its sample 137 on."""
    values = columns()
    write(folder / f"run.{ending}", values)
    write(folder / f"later.{ending}", {name: one[137:] for name, one in values.items()})


SHARED = "found 863 samples that run.csv holds too.*at 0 s here is at 0.137 s there.*remove one"


@pytest.mark.parametrize("more", [LINES, 'band = ["5 Hz", "45 Hz"]', 'cutoff = "45 Hz"'])
def test_excerpts_of_one_measurement_that_overlap(more, load, tmp_path, monkeypatch):
    """Begun at any sample, in files of their own, cut into periods or whole."""
    write_excerpt(tmp_path)
    if more != LINES:
        monkeypatch.setitem(globals(), "RECORD", RECORD.replace('fundamental = "10 Hz"\n', ""))
    experiment = load(("run.csv", more), ("later.csv", more))
    with pytest.raises(InputError, match=SHARED):
        experiment.records("ml")


def test_excerpts_that_are_read_in_blocks(load, tmp_path, monkeypatch):
    monkeypatch.setattr("rotorid.io.columns.WORTH", 0)
    monkeypatch.setattr("rotorid.io.columns.ROWS", 100)
    write_excerpt(tmp_path, "h5")
    with pytest.raises(InputError, match=SHARED.replace("csv", "h5")):
        load(("run.h5", LINES), ("later.h5", LINES)).records()


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ('until = "0.5 s"', 'skip = "0.4 s"'),  # of the file that begins .137 s later
        ("", "harmonics = [3]"),
    ],
)
def test_excerpts_of_which_each_sample_counts_once(first, second, load, tmp_path):
    write_excerpt(tmp_path)
    lines = [LINES if "harmonics" not in more else "" for more in (first, second)]
    load(("run.csv", f"{lines[0]}\n{first}"), ("later.csv", f"{lines[1]}\n{second}")).records()


def responses(rng: np.random.Generator, noise: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    hertz = np.arange(5.0, 45.0)
    omega = 2 * np.pi * hertz
    exact = 1 / (2e4 - omega**2 + 20j * omega)
    return hertz, exact * (1 + noise * (rng.standard_normal((40, 2)) @ np.array([1, 1j])))


def table_of(hertz: np.ndarray, values: np.ndarray, name: str, order: int = 0) -> rid.Lines:
    found = values * (2j * np.pi * hertz) ** order
    sensor = rid.Channel(name, "m")
    std = 1e-3 * np.abs(found)[:, None]
    return response_lines(rid.Channel("F", "N"), [sensor], hertz, found[:, None], std=std)


def test_one_response_in_two_records():
    """With fewer digits or lines, or as acceleration; one that was measured again is another."""
    rng = np.random.default_rng(1)
    hertz, values = responses(rng)
    one = table_of(hertz, values, "x")
    rounded = np.array([complex(f"{v.real:.5g}{v.imag:+.5g}j") for v in values])
    for again in (
        table_of(hertz, rounded, "x"),
        table_of(hertz[10:], values[10:], "x"),
        table_of(hertz[::2], values[::2], "other"),
        table_of(hertz, values, "a", 2),
    ):
        with pytest.raises(InputError, match=r"the response of .*, noise and all, that"):
            check_tables([one, again], ["F"])
    check_tables([one, table_of(*responses(rng), "x")], ["F"])
    check_tables([one, table_of(hertz[:7], values[:7], "x")], ["F"])  # few may be alike by chance
    check_tables([one, table_of(hertz + 0.5, values, "x")], ["F"])


def test_rows_of_phasors_in_two_records():
    rng = np.random.default_rng(1)
    speed = np.linspace(100.0, 300.0, 30)
    exact = np.stack([1e-5 * speed**2, -1e-5j * speed**2], axis=1)
    channels = [rid.Channel("x", "m"), rid.Channel("y", "m")]

    def read() -> np.ndarray:
        return exact + 0.01 * (rng.standard_normal((30, 2, 2)) @ np.array([1, 1j]))

    values = read()
    one = phasor_lines(channels, speed, values, 0.01)
    for rows, told in ((slice(5, None), "25 rows"), (slice(0, 3), "3 rows")):
        with pytest.raises(InputError, match=f"found {told} that"):
            check_tables([one, phasor_lines(channels, speed[rows], values[rows], 0.01)], [])
    mixed = read()
    check_tables([one, phasor_lines(channels, speed, mixed, 0.01)], [])
    mixed[3:5] = values[3:5]
    check_tables([one, phasor_lines(channels, speed, mixed, 0.01)], [])


# Prints of records: the same samples are found wherever they begin, and nothing else is.


def prints(*blocks):
    found = Prints([f"channel {k}" for k in range(blocks[0].shape[1])])
    for block in blocks:
        found.add(block)
    return found


def noise(count=3000, channels=2, state=0):
    return np.random.default_rng(state).standard_normal((count, channels))


@pytest.mark.parametrize(("begin", "end"), [(0, 3000), (70, 3000), (133, 2900), (1500, 1900)])
def test_an_excerpt_is_found_where_it_is(begin, end):
    whole = noise()
    other, one, excerpt = prints(noise(state=1)), prints(whole), prints(whole[begin:end])
    assert shared([other, one, excerpt]) == [((1, 2), end - begin, (begin, 0))]


def test_each_pair_of_several_that_share_is_found():
    whole = noise(9000)
    parts = [whole[first : first + 6000] for first in (0, 200, 400)]
    apart = [((0, 1), 5800, (200, 0)), ((0, 2), 5600, (400, 0)), ((1, 2), 5800, (200, 0))]
    assert shared([prints(part) for part in parts]) == apart


def test_two_that_overlap_and_blocks_of_any_size():
    whole = noise(20000)
    one = prints(whole[:3], whole[3:17], whole[17:4000], whole[4000:12000])
    assert np.array_equal(one.kept[0], prints(whole[:12000]).kept[0])
    assert shared([one, prints(whole[8000:])]) == [((0, 1), 4000, (8000, 0))]
    assert shared([prints(whole[8000:]), one]) == [((0, 1), 4000, (0, 8000))]


def test_many_samples_leave_few_prints_and_are_found_still():
    whole = noise(2_500_000, 1)
    one = prints(*np.array_split(whole, 30))
    assert MOST / 4 < len(one.kept[0]) <= MOST
    part = prints(whole[1_000_003:1_300_000])
    assert shared([one, part]) == [((0, 1), 299_997, (1_000_003, 0))]


def test_a_few_samples_alike_are_not_told():
    whole = noise(20000)
    assert not shared([prints(whole), prints(np.concatenate([whole[:100], noise(900, 2, 1)]))])


def sweep(count=8000, lag=0.0):
    t = (np.arange(count) + lag) / 5000.0
    return np.stack([np.sin(300 * t**2), np.cos(300 * t**2)], axis=1)


ALIKE = {
    "steady": lambda rng: np.full((5000, 2), 0.5),
    "zeros": lambda rng: np.zeros((5000, 2)),
    "steps": lambda rng: np.repeat(rng.integers(0, 2, (25, 2)), 200, axis=0).astype(float),
    "coarse sines": lambda rng: np.round(4 * sines() + 0.02 * rng.standard_normal((5000, 2))),
    "coarse sweep": lambda rng: np.round(100 * sweep() + 0.2 * rng.standard_normal((8000, 2))),
    "one coarse channel": lambda rng: rng.integers(0, 3, (20000, 1)).astype(float),
}


def sines():
    t = np.arange(5000) / 250
    return np.stack([np.sin(2 * np.pi * t), np.cos(6 * np.pi * t)], axis=1)


@pytest.mark.parametrize("name", ALIKE)
def test_two_measurements_that_are_alike_are_two(name):
    rng = np.random.default_rng(3)
    one, other = (ALIKE[name](rng) for _ in range(2))
    assert not shared([prints(one), prints(other)])


def test_one_that_repeats_itself_is_found_where_it_is_the_same_to_its_end():
    """Whose prints stand nowhere once: without noise every period is like the others."""
    exact = np.tile(sines()[:250], (20, 1))
    found = shared([prints(exact), prints(noise(5000)), prints(exact.copy())])
    assert found == [((0, 2), 5000, (0, 0))]
    assert not shared([prints(exact), prints(exact[:4999])])
