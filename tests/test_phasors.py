"""Tables of 1x phasors: a row per speed, on a rotor solved here by a few lines of numpy."""

import re
from contextlib import nullcontext
from json import loads

import h5py
import numpy as np
import pytest
from coast_down import EXPERIMENT, MODEL, PROBES, RECORD, RPM, TRUTH, coast, identify, load, write
from io_writers import write_table
from model_text import model_text
from working_folder import shaken

import rotorid as rid
from rotorid import InputError
from rotorid.testing import phasor_lines


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "model.toml").write_text(MODEL)
    write(tmp_path / "run.csv", RPM, coast(RPM))
    return tmp_path


def test_deviations_of_other_rows_are_refused(folder):
    """Data sets of a file may differ in length, columns of a text table may not."""
    table = np.genfromtxt(folder / "run.csv", delimiter=",", names=True)
    with h5py.File(folder / "run.h5", "w") as data:
        for name in table.dtype.names:
            data[name] = table[name]
        data["s"] = np.full(len(table) - 1, 1.0)
    text = EXPERIMENT.replace("run.csv", "run.h5").replace('std = "1 um"', 'std = "s"')
    count = len(table)
    with pytest.raises(InputError, match=f"channels.x.std: found {count - 1} and {count} rows"):
        identify(folder, text)


@pytest.mark.parametrize("senses", [(1,), (-1,), (-1, 1)])
def test_exact_phasors_give_the_rotor_back(folder, senses):
    rpm = np.concatenate([sense * RPM for sense in senses])
    write(folder / "run.csv", rpm, coast(rpm))
    estimate = identify(folder)
    assert estimate.status == "ok"
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-9)


CONDITIONS = """
[[records]]
kind = "phasors"
file = "all.csv"
rows = { column = "run", is = "bare" }
speed = { column = "n", unit = "rpm" }
same_speed = "0.1 rpm"
[[records]]
kind = "phasors"
file = "all.csv"
rows = { column = "run", is = "with 2 g" }
speed = { column = "n", unit = "rpm" }
same_speed = "0.1 rpm"
"""


def test_conditions_of_one_table_are_records(folder):
    """Chosen by a column of text; readings at speeds that differ a little are repeated ones."""
    rng, rows = np.random.default_rng(1), ["run,n,xr,xi,yr,yi"]
    for name in ("bare", "with 2 g"):
        for rpm in np.repeat(RPM, 3) + rng.uniform(-0.04, 0.04, 3 * len(RPM)):
            noise = 1e-6 * (rng.normal(size=2) + 1j * rng.normal(size=2))
            ((x, y),) = (coast(np.array([rpm])) + noise).tolist()
            rows.append(f"{name},{rpm},{x.real},{x.imag},{y.real},{y.imag}")
    (folder / "all.csv").write_text("\n".join(rows))
    channels = "\n".join(f'{c} = {{ real = "{c}r", imag = "{c}i", unit = "m" }}' for c in "xy")
    _, head, known = EXPERIMENT.partition("[parameters]")
    text = f'model = "model.toml"{CONDITIONS}[channels]\n{channels}\n{head}{known}'
    records = load(folder, text).records()
    assert [len(one.speed) for one in records] == [len(RPM), len(RPM)]
    assert identify(folder, text).value("k") == pytest.approx(TRUTH["k"], rel=1e-3)
    for old, new, told in (
        ('"with 2 g"', '"with 2g"', "rows.is: found no row whose run is 'with 2g'.*with 2 g"),
        ('is = "with 2 g"', "is = true", "rows.is.*found True"),
        ('"with 2 g"', '"bare"', "the phasors of records.0 again.*give each its own rows"),
        ('"0.1 rpm"', '"0.001 rpm"', "no std"),
        ('"0.1 rpm"', '"300 rpm"', "follow the speed .*a smaller same_speed"),
    ):
        with pytest.raises(InputError, match=told):
            identify(folder, text.replace(old, new))


def test_the_loads_lie_on_their_own_lines():
    lines = phasor_lines([rid.Channel("x")], [-200.0, 300.0], [[1j], [1j]], 1e-3)

    def turns(time: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        parts = [np.cos(angle), np.sin(angle), np.cos(2 * angle), speed * np.cos(angle)]
        return np.stack(np.broadcast_arrays(*parts), axis=-1)

    expected = [[0.5, 0.5j, 0, -100], [0.5, -0.5j, 0, 150]]
    np.testing.assert_allclose(lines.clock.lines(turns), expected, atol=1e-14)
    np.testing.assert_allclose(lines.omega, [200, 300])
    np.testing.assert_allclose(lines.mean, [[-0.5j], [0.5j]])


def test_inputs_without_a_column_are_zero_and_told(folder):
    text = EXPERIMENT.replace('"model.toml"', '"jeffcott"')
    estimate = identify(folder, text.partition("t_x =")[0])
    assert estimate.value("xi") == pytest.approx(TRUTH["u_x"] / TRUTH["m"], rel=1e-9)
    assert any("F_x, F_y: taken as zero" in w for w in estimate.warnings)


def test_force_phasors_are_inputs(folder):
    """A known 1x force in place of a known mass sets the scale."""
    turning = RPM * np.pi / 30
    stiffness = TRUTH["k"] - TRUTH["m"] * turning**2 + 1j * TRUTH["c"] * turning
    motion = coast(RPM) + np.column_stack([50.0 / stiffness, 0 * turning])
    columns = [motion.real, motion.imag, np.full_like(RPM, 50.0), 0 * RPM]
    write_table(folder / "run.csv", "n,xr,yr,xi,yi,f,zero", RPM, *columns)
    text = f'model = "jeffcott"{RECORD}'
    text += """
[channels]
x = { real = "xr", imag = "xi", unit = "m", std = "1 um" }
y = { real = "yr", imag = "yi", unit = "m", std = "1 um" }
F_x = { real = "f", imag = "zero", unit = "N", std = "1 mN" }
F_y = { real = "zero", imag = "zero", unit = "N", std = "1 mN" }
"""
    estimate = identify(folder, text)
    assert estimate.status == "ok"
    assert estimate.value("m") == pytest.approx(5.0, rel=1e-9)


def test_only_unbalance_over_mass_is_known_of_a_free_scale(folder):
    estimate = identify(folder, EXPERIMENT.replace('m = { fixed = "5 kg" }\n', ""))
    assert estimate.status == "not_identifiable"
    told = {v.name: v.value for v in estimate.derived}
    assert told["u_x/m"] == pytest.approx(TRUTH["u_x"] / TRUTH["m"], rel=1e-9)
    assert told["k/m"] == pytest.approx(TRUTH["k"] / TRUTH["m"], rel=1e-9)
    cures = [w for w in estimate.warnings if w.startswith("cure:")]
    assert cures[0] == "cure: fix one of m, c, k, u_x, u_y"
    assert "a further run with a trial mass" in cures[1]


def test_a_table_has_no_samples_to_inspect(folder):
    with pytest.raises(InputError, match=r"records\.0\.kind: found a table of phasors"):
        load(folder, EXPERIMENT).measured()


def test_a_table_is_inspected(folder, output):
    """What each probe reads, where it is largest, and how clearly; a probe that is dead."""
    (folder / "run.toml").write_text(EXPERIMENT)
    page, json = folder / "page.html", folder / "found.json"
    told = output("inspect", folder / "run.toml", "--json", json, "--report", page)
    assert f"{len(RPM)} rows of 1x phasors, from {RPM.min():.6g} to {RPM.max():.6g} rpm" in told
    size = np.abs(coast(RPM)[:, 0])
    assert f"{1e6 * size.max():.4g}" in told
    assert f"{RPM[size.argmax()]:.6g}" in told
    found = loads(json.read_text())
    assert found["kind"] == "phasors"
    assert found["rows"] == len(RPM)
    assert found["channels"][0]["high"] == pytest.approx(size.max())
    assert "rows of 1x phasors" in page.read_text()
    write(folder / "run.csv", RPM, coast(RPM) * [1, 0])
    assert "refused" in output("inspect", folder / "run.toml")


CHANNELS = [rid.Channel("x", "m"), rid.Channel("y", "m")]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("size", "turn", "unit", "keys"),
    [
        (1e6, -180 / np.pi, '"um"', "lag = true"),
        (2e6, 180 / np.pi, '"um"', "peak_to_peak = true"),
        (1e3 / 25.4e-3, 180 / np.pi, '"mil"', "lag = false"),
        (2e6, 180 / np.pi, '"um"', "scale = 0.5"),
        (1e6, 1.0, '"um"', 'phase_unit = "rad"'),
        (2e3, -1.0, '"mm"', 'phase_unit = "rad", lag = true, peak_to_peak = true'),
    ],
)
def test_how_instruments_state_a_phasor(folder, size, turn, unit, keys):
    write(folder / "run.csv", RPM, coast(RPM), size, turn)
    text = EXPERIMENT.replace('"um", std = "1 um"', f'{unit}, {keys}, std = "1 um"')
    estimate = identify(folder, text)
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-9)
    # Deviations are those of readings with 1 um each: half as much where it is peak to peak.
    deviation = 0.5e-6 if "peak" in keys or "scale" in keys else 1e-6
    exact = phasor_lines(CHANNELS, RPM * np.pi / 30, coast(RPM), deviation)
    fixed = {"m": 5.0, "t_x": 0.0, "t_y": 0.0}
    plain = rid.identify(rid.parse_model(MODEL), exact, rid.MaximumLikelihood(fixed=fixed))
    np.testing.assert_allclose(estimate.covariance, plain.covariance, rtol=1e-6)


def test_signals_are_what_the_phasors_say(folder):
    """Amplitude 2 and lag 90 degrees is 2 cos(phi - 90 degrees) = 2 sin(phi)."""
    (folder / "run.csv").write_text("n,a,p\n600,2,90\n1200,2,450\n")
    channel = 'x = { amplitude = "a", phase = "p", unit = "m", lag = true, std = "1 mm" }'
    text = f'model = "model.toml"{RECORD}[channels]\n{channel}\n'
    (lines,) = load(folder, text).records()
    sine = lines.clock.lines(lambda t, phi, speed: 2 * np.sin(phi)[..., None])
    np.testing.assert_allclose(lines.mean, sine, atol=1e-12)
    np.testing.assert_allclose(lines.speed, [20 * np.pi, 40 * np.pi])
    # A deviation of 1 mm in each part of X is that of 0.5 mm in each part of its line.
    np.testing.assert_allclose(lines.covariance.matrices[:, 0, 0], 2 * (0.5e-3) ** 2)


def test_deviations_from_a_column(folder):
    rng = np.random.default_rng(5)
    phasors = coast(RPM)
    std = np.where(np.arange(len(RPM)) % 4 == 0, 1e-3, 1e-7)
    noise = rng.standard_normal(phasors.shape) + 1j * rng.standard_normal(phasors.shape)
    write(folder / "run.csv", RPM, phasors + std[:, None] * noise)
    table = np.genfromtxt(folder / "run.csv", delimiter=",", skip_header=1)
    write_table(folder / "run.csv", "n,ax,px,ay,py,s", table, 1e6 * std)
    estimate = identify(folder, EXPERIMENT.replace('std = "1 um"', 'std = "s"'))
    assert estimate.status == "ok"
    assert estimate.value("u_x") == pytest.approx(TRUTH["u_x"], rel=1e-3)


def test_a_sensor_of_a_combination_and_with_delay(folder):
    turning = RPM * np.pi / 30
    phasors = coast(RPM)
    seen = 0.6 * phasors[:, 0] + 0.8 * phasors[:, 1]
    lagging = phasors[:, 1] * np.exp(-1j * turning * 20e-6)
    write(folder / "run.csv", RPM, np.column_stack([seen, lagging]))
    text = EXPERIMENT.replace("x = { amp", 's = { reads = "0.6*x + 0.8*y", amp')
    estimate = identify(folder, text.replace('"1 um" }\n[par', '"1 um", delay = "20 us" }\n[par'))
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-5)


def test_repeated_readings_tell_their_noise():
    """Two readings of one speed: half the squared difference is the variance of each."""
    readings = np.repeat(coast(RPM), 2, axis=0)
    readings[::2] += 1e-6 * np.exp(1j * np.arange(len(RPM)))[:, None]
    lines = phasor_lines(CHANNELS, np.repeat(RPM, 2) * np.pi / 30, readings)
    assert len(lines.frequency) == len(RPM)
    assert (lines.covariance.kind, lines.covariance.dof) == ("repeated", len(RPM))
    off = 0.25e-6 * np.exp(1j * np.arange(len(RPM)))[:, None]
    np.testing.assert_allclose(lines.mean, coast(RPM) / 2 + off)
    # |d|^2 / 2 of readings that are lines X / 2; of the mean of two, half of it; cross terms alike.
    np.testing.assert_allclose(lines.covariance.matrices, np.full((40, 2, 2), 0.5e-12 / 4 / 2))


def readings(rng, relative: float, absolute: float, speeds: int = 60, each: int = 2):
    """Return the lines of a resonance that was read several times at each speed, and its size."""
    speed = np.repeat(np.linspace(0.5, 1.5, speeds), each) * 300.0
    exact = 1e-5 * 9e4 / (9e4 - speed**2 + 10j * speed)
    one, other = rng.standard_normal((2, len(speed), 2, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    size = np.hypot(relative * np.abs(exact), absolute)[:, None] * np.sqrt(2)
    noisy = np.column_stack([exact, -1j * exact]) + size * (0.8 * one + 0.6 * other)
    lines = phasor_lines(CHANNELS, speed, noisy)
    return lines, size[::each, 0] / 2


@pytest.mark.parametrize(("relative", "absolute"), [(0.03, 0.0), (0.02, 1e-6), (0.0, 1e-6)])
def test_noise_that_grows_with_the_amplitude_is_told(relative, absolute):
    rng = np.random.default_rng(5)
    ratios = []
    for _ in range(40):
        lines, size = readings(rng, relative, absolute)
        assert (len(lines.warnings) == 2) == (relative > 0)
        ratios.append(np.sqrt(2 * np.abs(lines.covariance.matrices[:, 0, 0])) / size)
    top, end = np.abs(lines.mean[:, 0]).argmax(), 0
    for line in (top, end):
        assert np.mean([ratio[line] for ratio in ratios]) == pytest.approx(1, abs=0.15)
    if relative:
        assert "to grow with the amplitude" in lines.warnings[0]


def test_repeated_readings_must_be_enough():
    speed = np.append(RPM, RPM[:9]) * np.pi / 30
    phasors = np.append(coast(RPM), coast(RPM[:9]) + 1e-6, axis=0)
    with pytest.raises(InputError, match=r"9 repeated readings and no std; .* 10 repeated"):
        phasor_lines(CHANNELS, speed, phasors)
    with pytest.raises(InputError, match=r"no std and no speed twice.*write std"):
        phasor_lines(CHANNELS, RPM, coast(RPM))


@pytest.mark.parametrize(
    ("row", "old", "new", "message"),
    [
        ("", 'std = "1 um"', 'std = "0 um"', r"channels\.x\.std: found 0 um; expected a deviation"),
        ("", 'std = "1 um"', 'std = "-1 um"', r"channels\.x\.std: found -1 um"),
        ("", 'std = "1 um"', 'std = "1 kg"', r"channels\.x\.std: found unit 'kg'"),
        ("", 'std = "1 um"', "std = 1", r"channels\.x\.std: found 1 without a unit"),
        ("", 'std = "1 um"', 'scale = 0, std = "1 um"', r"channels\.x\.scale: found 0"),
        ("", 'std = "1 um"', 'std = "sigma"', r"channels\.x\.std: found 'sigma'"),
        ("", 'unit = "um", std = "1 um" }\ny', 'unit = "um" }\ny', r"found no std of x"),
        ("", 'unit = "um"', 'unit = "kg"', r"channels\.x\.unit: found unit 'kg'"),
        ("", 'unit = "um", ', "", r"channels\.x\.unit: found no unit"),
        ("", 'phase = "px"', 'phase = "px", phase_unit = "m"', r"channels\.x\.phase_unit"),
        ("", "x = { amp", "q = { amp", r"channels\.q: found 'q', which is no input"),
        ("", 'column = "n", unit = "rpm"', 'column = "n", unit = "m"', r"speed.*unit 'm'"),
        ("", 'column = "n", unit = "rpm"', 'column = "n"', r"speed: found no unit"),
        ("", 'column = "n", unit = "rpm"', 'column = "q", unit = "rpm"', r"speed.*'q'"),
        ("0,1,2,3,4", "", "", r"found a speed of 0 in row 41"),
        ("3000,nan,2,3,4", "", "", r"channels\.x\.amplitude: found nan in row 41 of 'ax'"),
        ("3000,-1,2,3,4", "", "", r"channels\.x\.amplitude: found the amplitude -1e-06 in row 41"),
        ("fast,1,2,3,4", "", "", r"run\.csv: "),
        ("3000,1,2,3", "", "", r"run\.csv: "),
        ("", 'file = "run.csv"', 'file = "run.csv"\nskip = "1 s"', "skip in a table of phasors"),
        ("", 'speed = { column = "n", unit = "rpm" }', "", "no speed"),
        ("", 'kind = "phasors"', "", "a column of speeds in a record of samples"),
        ("", 'kind = "phasors"', 'kind = "phasor"', "'samples', 'phasors' or 'responses'"),
        ("", 'amplitude = "ax", phase = "px"', 'column = "ax"', r"std in a channel of samples"),
        ("", 'phase = "px", ', "", r"channels\.x: phase: found no such key"),
        ("", 'amplitude = "ax"', 'amplitude = "ax", hold = "zero-order"', "hold in a phasor's"),
        ("", 'phase = "px"', 'phase = "qx"', "no column 'qx'|'qx'"),
    ],
)
def test_bad_input_is_one_line(folder, row, old, new, message, refusal):
    with (folder / "run.csv").open("a") as stream:
        stream.write(row + "\n" if row else "")
    text = EXPERIMENT.replace(old, new, 1) if old else EXPERIMENT
    (folder / "experiment.toml").write_text(text)
    assert re.search(message, refusal("identify", folder / "experiment.toml"))


WHIRLING = model_text(
    "Rigid rotor in two different elastic bearings",
    [
        "m*x'' + 2*c*x' + (k_a + k_b)*x + KL*b = Omega^2*u*cos(phi)",
        "m*y'' + 2*c*y' + 1.5*(k_a + k_b)*y + 1.5*KL*a = Omega^2*u*sin(phi)",
        "I_t*a'' - Omega*I_p*b' + 1.5*KL*y + 1.5*KLL*a + d*a' = Omega^2*w*sin(phi)",
        "I_t*b'' + Omega*I_p*a' + KL*x + KLL*b + d*b' = Omega^2*w*cos(phi)",
    ],
    "x m, y m, a rad, b rad",
    "",
    "m +9.0 kg, c 30.0 N s/m, d 0.4 N m s, k_a +1.2e5 N/m, k_b +1.8e5 N/m, L_a m, L_b m, "
    "I_t +0.25 kg m^2, I_p +0.12 kg m^2, u kg m, w kg m^2",
)
WHIRLING = WHIRLING.replace("KLL", "(k_a*L_a^2 + k_b*L_b^2)").replace("KL", "(k_b*L_b - k_a*L_a)")


@pytest.mark.parametrize("senses", [(1,), (-1,), (1, -1)])
def test_gyroscopic_moments_follow_the_speed_of_each_row(senses):
    """Two whirls of a rigid rotor in bearings that differ in x and y, solved row by row."""
    m, c, d, k_a, k_b, l_a, l_b, i_t, i_p = 10.0, 40.0, 0.5, 1e5, 2e5, 0.2, 0.25, 0.2, 0.15
    u, w = 2e-4, 3e-5
    k, kl, kll = k_a + k_b, k_b * l_b - k_a * l_a, k_a * l_a**2 + k_b * l_b**2
    stiffness = np.array(
        [[k, 0, 0, kl], [0, 1.5 * k, 1.5 * kl, 0], [0, 1.5 * kl, 1.5 * kll, 0], [kl, 0, 0, kll]]
    )
    speeds = np.concatenate([s * np.linspace(60.0, 400.0, 30) for s in senses])
    phasors = []
    for speed in speeds:
        turning = np.zeros((4, 4))
        turning[2, 3], turning[3, 2] = -speed * i_p, speed * i_p
        damping = np.diag([2 * c, 2 * c, d, d]) + turning
        dynamic = stiffness + 1j * speed * damping - speed**2 * np.diag([m, m, i_t, i_t])
        # cos phi is Re exp(i phi), sin phi is Re(-i exp(i phi)), whichever way phi runs.
        load = speed**2 * np.array([u, -1j * u, -1j * w, w])
        phasors.append(np.linalg.solve(dynamic, load))
    channels = [*CHANNELS, rid.Channel("a", "rad"), rid.Channel("b", "rad")]
    lines = phasor_lines(channels, speeds, phasors, [1e-7] * 4)
    known = {"L_a": l_a, "L_b": l_b, "m": m}
    estimate = rid.identify(rid.parse_model(WHIRLING), lines, rid.MaximumLikelihood(fixed=known))
    assert estimate.status == "ok"
    truth = {"c": c, "d": d, "k_a": k_a, "k_b": k_b, "I_t": i_t, "I_p": i_p, "u": u, "w": w}
    assert {n: estimate.value(n) for n in truth} == pytest.approx(truth, rel=1e-6)


@pytest.mark.parametrize(("apart", "rows"), [(0.8e-9, 20), (1.3e-9, 32)])
def test_speeds_that_are_the_same_but_for_rounding(apart, rows):
    rng = np.random.default_rng(1)
    speed = np.linspace(100.0, 300.0, 20)
    speed = np.concatenate([speed, speed[:12] * (1 + apart)])
    phasors = rng.standard_normal((32, 1)) + 0j
    with nullcontext() if rows == 20 else pytest.raises(InputError, match="and no speed twice"):
        assert len(phasor_lines([rid.Channel("x")], speed, phasors).speed) == rows


@pytest.mark.parametrize(("size", "told"), [(1.555, False), (1.58, True)])
def test_from_which_scatter_on_a_std_is_doubted(size, told):
    """Twelve pairs of one channel: chi-squared with 24 degrees of freedom."""
    speed = np.repeat(np.linspace(100.0, 300.0, 12), 2)
    sides = np.tile([1.0, -1.0], 12) * np.exp(1j * (np.arange(24) // 2))
    # Each pair scatters by `size` deviations: sum |d|^2 / s^2 = 24 size^2, 24 expected.
    lines = phasor_lines([rid.Channel("x")], speed, (size * sides)[:, None], 1.0)
    assert bool(lines.warnings) == told


def test_loads_turn_with_the_angle():
    """What reaches 1x of 64 angles: the 63rd and 65th multiple, of which no load is made."""
    clock = phasor_lines([rid.Channel("x")], [200.0], [[1.0]], 1.0).clock
    for order, expected in ((1, 0.5), (2, 0.0), (31, 0.0), (62, 0.0), (63, 0.5)):
        lines = clock.lines(lambda t, phi, speed, n=order: np.cos(n * phi)[..., None])
        assert abs(lines[0, 0]) == pytest.approx(expected, abs=1e-12)
    with pytest.raises(InputError, match="a load that depends on t in a table"):
        clock.lines(lambda t, phi, speed: np.cos(t)[..., None], timed=True)


@pytest.mark.parametrize("method", ["ls", "batch", "sequential"])
def test_a_table_is_for_ml(folder, method):
    experiment = load(folder, EXPERIMENT)
    chosen = experiment.estimator(method)
    with pytest.raises(InputError, match=r"found a table, which has no samples.*use ml"):
        rid.identify(experiment.model, experiment.records(method), chosen)


def test_a_table_beside_samples(folder):
    """Forces at standstill tell the mass; the table in the same file tells the unbalance."""
    write_table(folder / "shaken.csv", "fx,fy,x,y", shaken(speed=0.0, periods=40).samples)
    text = """
model = "jeffcott"
[[records]]
file = "shaken.csv"
sample_rate = "2 kHz"
fundamental = "10 Hz"
harmonics = [1, 2, 5]
"""
    text += f"{RECORD}[records.channels]{PROBES}"
    text += """
[channels]
F_x = { column = "fx", unit = "N" }
F_y = { column = "fy", unit = "N" }
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
"""
    estimate = identify(folder, text)
    assert estimate.status == "ok"
    assert estimate.value("m") == pytest.approx(5.0, rel=1e-2)
    assert estimate.value("xi") == pytest.approx(TRUTH["u_x"] / 5.0, rel=1e-3)


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf, 1e61, 1e-61])
def test_deviations_and_readings_beyond_all_bounds(size):
    """The squares of their squares would leave what doubles hold."""
    rows = np.full((3, 1), 1e-6 + 0j)
    with pytest.raises(InputError, match=r"std: found a deviation of .* in row 1; expected more"):
        phasor_lines([CHANNELS[0]], [1.0, 2.0, 3.0], rows, size)
    if not abs(size) < 1e60:
        rows[1] = size
        with pytest.raises(InputError, match=r"in row 2, phasors .*below 1e\+60"):
            phasor_lines([CHANNELS[0]], [1.0, 2.0, 3.0], rows, 1e-6)
