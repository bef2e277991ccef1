"""Good files of every format, what libraries write of odd data, and the commands for them.

The record in all of them is one: a mass on a damper, four periods of twenty samples, with a little
noise. It is short so that the structure of a file is a good part of its bytes.
"""

import contextlib
import functools
import io
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import fuzz_mutations as mutations
import h5py
import io_writers as writers
import numpy as np
import scipy.io
import scipy.sparse
from fuzz_harness import Case

MODEL = b"""
title = "a mass on a damper"
equations = ["m*x'' + c*x' + k*x + c*mu*x' = F"]
coordinates = { x = "m" }
inputs = { F = "N" }
parameters = { m = { unit = "kg", nominal = 2.0, positive = true }, \
c = { unit = "N s/m", nominal = 100.0 }, k = { unit = "N/m" }, mu = { unit = "1" } }
"""
SPRINGS = b"""
[coordinates]
x = "m"
y = "m"
theta = "rad"
[inputs]
F = "N"
[parameters]
m = { unit = "kg", nominal = 1.5, positive = true }
k = { unit = "N/m", nominal = 1e4 }
c = { unit = "N s/m" }
L = { unit = "m", nominal = 0.2 }
u = { unit = "m" }
"""
EQUATIONS = b"""title = "two masses"
equations = [
  "m*x'' + c*x' + k*(x - y - L*theta) = F + m*u*Omega^2*cos(phi)",
  "m*y'' - k*(x - y)*exp(-t/3) + c*sqrt(abs(y'))*sign(y') + 0.5*c*tanh(y'/2) = 0",
  "m*L^2*theta'' - Omega*m*L^2*theta' - L*k*(x - y)/(1 + pi) + k*L^2*sin(theta) = 0",
]
"""
EXPERIMENT = """
model = "model.toml"

[[records]]
file = "{name}"
sample_rate = "1 kHz"
fundamental = "50 Hz"
harmonics = [1, 2]

[channels]
F = {{ column = "fx", unit = "N" }}
x = {{ column = "px", unit = "um" }}

[parameters]
k = {{ fixed = "0 N/m" }}
mu = {{ fixed = "0" }}
"""
OF_CSV = EXPERIMENT.format(name="run.csv").encode()
LONGER = b"""
model = "model.toml"
estimator = { method = "ml", runout = false, gains = ["ki"], delays = ["position"] }
[[records]]
files = ["run.csv"]
time = "t"
speed = "3000 rpm"
phase = "10 deg"
fundamental = "50 Hz"
harmonics = [1, 2, 3]
skip = "0.01 s"
until = "0.08 s"
[records.channels]
x = { column = "px", unit = "um", delay = { std = "20 us" } }
[[records]]
file = "run.csv"
sample_rate = "1 kHz"
band = ["40 Hz", "110 Hz"]
period_samples = 20
[channels]
x = { column = "px", unit = "um" }
[channels.F]
law = "linear"
current = { column = "fx", unit = "A" }
position = "x"
ki = "1 N/A"
ks = "2 N/m"
[parameters]
m = { start = "0.9 kg" }
k = { value = "0 N/m", std = "1 mN/m" }
mu = { fixed = "0" }
[[constraints]]
expression = "2*m"
value = "4 kg"
std = "1 kg"
"""
PHASORS = b"""
model = "jeffcott"
[[records]]
kind = "phasors"
file = "run.csv"
speed = { column = "n", unit = "rpm" }
[channels]
x = { amplitude = "a", phase = "p", unit = "um", std = "1 um" }
y = { real = "re", imag = "im", unit = "um", std = "1 um" }
[parameters]
m = { fixed = "5 kg" }
[[modes]]
frequency = "71 Hz"
std = "1 Hz"
damping = { value = 0.01, std = 0.005 }
speed = "0 rpm"
"""
ROTOR = b"""
title = "Test rotor"
sections = [
  { length = "94 mm", outer = "8 mm", material = "steel", elements = 1 },
  { length = "38 mm", outer = "8 mm", material = "steel", stiffness = "s_A", elements = 1 },
  { length = "220 mm", outer = "20 mm", inner = "4 mm", material = "steel", elements = 2 },
]
[materials]
steel = { E = "211 GPa", G = "81 GPa", density = "7860 kg/m^3" }
[discs]
A = { at = "94 mm", mass = "0.85 kg", I_t = "4.8e-4 kg m^2", I_p = "4.0e-4 kg m^2" }
wheel = { at = "352 mm", mass = "m_w", I_t = "4e-3 kg m^2", I_p = "8e-3 kg m^2" }
[actuators]
A = { at = "94 mm" }
[sensors]
a = { at = "132 mm" }
[supports]
left = { at = "0 mm", k = "k_l", c = "50 N s/m" }
right = { at = "352 mm", kxx = "1e6 N/m", kyy = "2e6 N/m", cxy = "3 N s/m" }
[unbalance]
wheel = { at = "352 mm", x = "u_x", y = "1e-5 kg m" }
[damping]
internal = "1e-5 s"
[parameters]
m_w = { unit = "kg", nominal = 1.28, positive = true }
k_l = { unit = "N/m", nominal = 1e6 }
s_A = { unit = "1", nominal = 1.0 }
u_x = { unit = "kg m", nominal = 1e-5 }
"""
RESPONSES = """
model = "model.toml"
[[records]]
kind = "responses"
file = "{name}"
averages = 20

[channels]
x1 = {{ input = "F", reads = "x", column = "1+X/1+X" }}

[parameters]
k = {{ fixed = "0 N/m" }}
mu = {{ fixed = "0" }}
"""
RIG = b"""
title = "a mass held by a magnet"
model = "model.toml"
duration = "0.1 s"
settling = "0.1 s"
clearance = "1 mm"

[rotation]
speed = "600 rpm"
phase = "30 deg"

[controller]
rate = "1 kHz"
delay = "0.2 ms"
stiffness = "2000 N/m"
damping = "60 N s/m"
integral = "100 N/(m s)"

[actuators.all]
law = "linear"
ki = "12 N/A"
ks = "100 N/m"
limit = "4 A"
bandwidth = "300 Hz"
supply = "50 V"
inductance = "10 mH"
noise = "1 mA"

[sensors]
s_x = { reads = "x", noise = "0.5 um" }

[excitation]
fundamental = "50 Hz"
odd = 3
phases = "schroeder"

[excitation.signals]
F = { amplitude = "1 N", phase = "90 deg" }

[process_noise]
F = "0.1 N"

[logger]
sample_rate = "1 kHz"
current = "measured"
oversampling = 2
encoder = { lines = 64, jitter = "0.05 deg" }

[parameters]
m = "2 kg"
c = "5 N s/m"
k = "0 N/m"
mu = "0"
"""


@functools.cache
def columns() -> dict[str, tuple[np.ndarray, str]]:
    """Return the force and the position of m = 2 kg, c = 300 N s/m, with noise of a millionth."""
    rng = np.random.default_rng(11)
    time = np.arange(80) / 1000.0
    force, motion = np.zeros(80), np.zeros(80)
    for n in (1, 2, 3):
        s, turn = 100j * np.pi * n, np.exp(100j * np.pi * n * time + n)
        force, motion = force + turn.real, motion + (turn / (2 * s**2 + 300 * s)).real * 1e6
    return {
        "fx": (force + 1e-6 * rng.standard_normal(80), "N"),
        "px": (motion + 1e-5 * rng.standard_normal(80), "um"),
    }


def written(write: Callable[[Path], object], name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write(Path(folder) / name)
        return (Path(folder) / name).read_bytes()


def _columns_of(write: Callable[..., object], name: str, **options: object) -> bytes:
    return written(lambda path: write(path, columns(), **options), name)


def _timed_csv(
    separator: str = ",", decimal: str = ".", preamble: str = "", units: bool = True
) -> bytes:
    """Return a table with a clock, as a logger of another country writes it."""
    rows = [separator.join(("t [s]", "fx [N]", "px [um]") if units else ("t", "fx", "px"))]
    for number, pair in enumerate(zip(*(v for v, _ in columns().values()), strict=True)):
        row = [f"{x:.9g}".replace(".", decimal) for x in (number / 1000, *pair)]
        rows.append(separator.join(row))
    return (preamble + "\n".join(rows) + "\n").encode()


PREAMBLE = """Logger 7, serial 1234
Date: 2026-03-11 14:02:11
Sample rate: 1000 Hz
Channels: 2

"""


def _mat(**options: object) -> bytes:
    def write(path: Path) -> None:
        values = {name: value[:, None] for name, (value, _) in columns().items()}
        log: dict[str, object] = {"rate": 1000.0, "name": "run"}
        extra = {"log": log, "cells": np.array([1.0, "a"], dtype=object), "z": np.array([1 + 2j])}
        scipy.io.savemat(path, values | ({} if options.get("format") == "4" else extra), **options)

    return written(write, "run.mat")


def _hdf5(libver: str = "earliest", **filters: object) -> bytes:
    def write(path: Path) -> None:
        with h5py.File(path, "w", libver=libver) as data:
            for name, (values, unit) in columns().items():
                made = data.create_dataset(f"run/{name}", data=values, **filters)
                made.attrs["units"] = unit
            data["run"].attrs["sample_rate"] = 1000.0
            data["run/both"] = np.stack([v for v, _ in columns().values()], axis=1)
            data["link"] = h5py.SoftLink("/run/fx")

    return written(write, "run.h5")


def _universal(binary: int = 0) -> bytes:
    return _columns_of(writers.write_uff, "run.uff", binary=binary)


def _responses(binary: int = 0) -> bytes:
    frequency = np.arange(5.0, 60.0, 2.5)
    values = 1 / (2 * (2j * np.pi * frequency) ** 2 + 600j * np.pi * frequency)
    at = {"response": (1, 1), "force": (1, 1), "frequency": frequency}
    sets = [
        {**at, "values": values, "quantity": 8, "unit": "m"},
        {**at, "values": np.full(len(frequency), 0.9)},
    ]
    return written(lambda path: writers.write_responses(path, sets, binary=binary), "run.uff")


def phasor_rows() -> np.ndarray:
    rpm = np.linspace(1000, 4000, 8)
    omega = rpm * np.pi / 30
    motion = 1e6 * 1e-4 * omega**2 / (1e6 - 5 * omega**2 + 60j * omega)
    return np.column_stack(
        [rpm, np.abs(motion), np.degrees(np.angle(motion)), motion.imag, -motion.real]
    )


def phasor_table(rows: np.ndarray | None = None) -> bytes:
    rows = phasor_rows() if rows is None else rows
    return written(lambda path: writers.write_table(path, "n,a,p,re,im", rows), "run.csv")


def _result(method: str) -> bytes:
    from rotorid.cli import run

    def write(path: Path) -> None:
        folder = path.parent
        (folder / "model.toml").write_bytes(MODEL)
        (folder / "run.csv").write_bytes(_columns_of(writers.write_csv, "run.csv"))
        (folder / "experiment.toml").write_text(EXPERIMENT.format(name="run.csv"))
        asked = ["identify", str(folder / "experiment.toml"), "--json", str(path)]
        with contextlib.redirect_stdout(io.StringIO()):
            code = run([*asked, "--method", method])
        if code:
            raise RuntimeError("a good record is not identified")

    return written(write, "result.json")


# What writing libraries make of data that are no columns of a record.


def _odd_array(rng: Random) -> np.ndarray:
    shape = rng.choice(
        [(80,), (80, 1), (1, 80), (80, 2), (2, 80), (), (0,), (0, 2), (79,), (4, 20, 1), (1, 1),
         (2,), (3, 80), (8000,)]
    )  # fmt: skip
    kind = rng.choice(
        ["f8", "f4", "f2", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?", "c8", "c16", ">f8",
         ">i4"]
    )  # fmt: skip
    count = int(np.prod(shape))
    values = np.sin(np.arange(count) * 0.31416 + rng.random()).reshape(shape) * 100
    if kind[-2:] in ("f8", "f4", "f2"):
        values = values * rng.choice([1, 1, 1, 1e-162, 1e155, 1e300, 0])
        if rng.random() < 0.3 and count:
            np.put(values, rng.randrange(count), rng.choice([np.nan, np.inf, -np.inf, 1e308]))
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(values).astype(kind)


_ROW = [("fx", "f8"), ("px", "i4"), ("s", "S4")]


def _odd_hdf5(path: Path, rng: Random) -> None:
    odd: Sequence[object] = ([b"a"] * 80, "text", np.void(b"1234"), np.zeros(80, _ROW))
    with h5py.File(path, "w", libver=rng.choice(["earliest", "latest"])) as data:
        for name in ("fx", "px", rng.choice(["time", "a/fx", "a/b/px"])):
            kind = rng.randrange(6)
            if kind == 0:
                data[name] = rng.choice(odd)
            elif kind == 1:  # declared, never written
                values = _odd_array(rng)
                data.create_dataset(name, shape=values.shape, dtype=values.dtype)
            else:
                data[name] = _odd_array(rng)
        for key in ("units", "sample_rate"):
            data["fx"].attrs[key] = rng.choice(
                [1e3, "1 kHz", "N", np.zeros(3), b"\xff", -1, 0, float("nan"), [1, 2]]
            )


def _odd_mat(path: Path, rng: Random) -> None:
    values: dict[str, object] = {"fx": _odd_array(rng), "px": _odd_array(rng)}
    version = rng.choice(["4", "5"])
    if version == "5":
        cell = np.empty((2,), dtype=object)
        cell[:] = [_odd_array(rng), "text"]
        values |= {"s": {"fx": _odd_array(rng), "in": {"px": _odd_array(rng)}}, "cell": cell}
        if rng.random() < 0.3:
            values["px"] = scipy.sparse.csc_array(np.eye(9))
    else:
        values = {k: v for k, v in values.items() if np.ndim(v) <= 2 and np.size(v)}
        values = {k: np.asarray(v, float) for k, v in values.items() if not np.iscomplexobj(v)}
    scipy.io.savemat(path, values, format=version, do_compression=rng.random() < 0.5)


Content = bytes | Callable[[], bytes]
Damage = Callable[[bytes, Random, Sequence[bytes]], bytes]
Commands = Sequence[tuple[int, tuple[str, ...], tuple[str, ...]]]


@functools.cache
def made(content: Content) -> bytes:
    return content if isinstance(content, bytes) else content()


@dataclass(frozen=True)
class Format:
    """A format: its good files, how they are damaged, and what is asked of a damaged one.

    An entry of `commands` is a weight, the arguments, and what they may write.
    """

    name: str
    file: str
    good: Sequence[Content]
    damage: Damage = mutations.damaged
    odd: Callable[[Path, Random], None] | None = None
    experiment: str | bytes = EXPERIMENT
    beside: Mapping[str, Content] = field(default_factory=dict)
    commands: Commands = ()
    # Of the files that are asked for: an answer of some takes long. One reader reads delimited
    # text of whatever format. What a child reads takes most, by whatever package, and is told in
    # the same way: ten formats with a quarter each are two and a half.
    share: float = 1.0

    def files(self, damaged: bytes) -> dict[str, bytes]:
        """Return what stands in the folder: a good model and experiment, and the damaged file."""
        text = self.experiment
        told = text if isinstance(text, bytes) else text.format(name=self.file).encode()
        files = {"model.toml": MODEL, "experiment.toml": told}
        beside = {name: made(content) for name, content in self.beside.items()}
        return {**files, **beside, self.file: damaged}

    def case(self, seed: int, number: int) -> Case:
        """Return a damaged file and a command, always the same for the same numbers."""
        rng = Random(f"{seed} {self.name} {number}")
        good = [made(content) for content in self.good]
        if self.odd is not None and rng.random() < 0.15:
            damaged = _odd_file(self.odd, rng, self.file)
        else:
            damaged = self.damage(rng.choice(good), rng, good)
        _, arguments, outputs = rng.choices(self.commands, [c[0] for c in self.commands])[0]
        return Case(f"{self.name}:{number}", arguments, self.files(damaged), outputs=outputs)

    def whole(self) -> list[Case]:
        return [
            Case(f"{self.name} {arguments[0]}", arguments, self.files(data), outputs=outputs)
            for data in map(made, self.good)
            for _, arguments, outputs in self.commands
        ]


def _odd_file(odd: Callable[[Path, Random], None], rng: Random, name: str) -> bytes:
    """Return a file of odd data; a library that refuses to write them writes others."""
    for _ in range(20):
        try:
            return written(lambda path: odd(path, rng), name)
        except Exception:
            continue
    raise RuntimeError(f"{name}: its library writes nothing")


_OUT, _JSON = ("out.json",), ("--json", "out.json")
_LS = ("identify", "experiment.toml", "--method", "ls", *_JSON)
_ML, _SEEN = ("identify", "experiment.toml", *_JSON), ("inspect", "experiment.toml", *_JSON)
_RECORD_COMMANDS = ((7, _LS, _OUT), (1, _ML, _OUT), (2, _SEEN, _OUT))


def _drafted(file: str) -> Commands:
    draft = ("new", file, "--model", "model.toml", "--out", "draft.toml")
    return (*_RECORD_COMMANDS, (2, draft, ("draft.toml",)))


_ANSWERS = ((3, _ML, _OUT), (1, _LS, _OUT), (1, _SEEN, _OUT))
_MODES = ("modes", "model.toml", "--speed", "3000 rpm", *_JSON)
_RIG_COMMANDS = ((1, ("simulate", "rig.toml", "--out", "out.h5"), ("out.h5", "out.toml")),)
_RESULT_COMMANDS = (
    (2, ("modes", "result.json", "--json", "out.json"), _OUT),
    (2, ("balance", "result.json", "--plane", "x", "--speed", "3000 rpm", *_JSON), _OUT),
    (3, ("export", "result.json", "--to", "result.csv"), ("result.csv",)),
    (3, ("export", "result.json", "--to", "result.tex"), ("result.tex",)),
    (2, ("export", "result.json", "--to", "result.mat"), ("result.mat",)),
    (6, ("validate", "result.json", "experiment.toml", "--json", "out.json"), _OUT),
)


def good_csv() -> bytes:
    return _columns_of(writers.write_csv, "run.csv")


def _records() -> Iterator[Format]:
    """Yield the formats of records: what a logger writes, and a draft is made of."""

    def logged(name: str, file: str, *good: Content, **more: Any) -> Format:
        return Format(name, file, good, **{"commands": _drafted(file), "share": 0.25, **more})

    def by(write: Callable[..., object], name: str) -> Content:
        return partial(_columns_of, write, name)

    text = {"damage": mutations.reworded}
    table, chunks = text | {"share": 0.4}, {"chunks": (16,)}
    german = partial(_timed_csv, ";", ",")
    yield logged("csv", "run.csv", good_csv, _timed_csv, german, **table)
    headed = [partial(_timed_csv, *marks, PREAMBLE) for marks in ("\t.", ";,")]
    yield logged("txt", "run.txt", *headed, **table)
    yield logged("lvm", "run.lvm", by(writers.write_lvm, "run.lvm"), **table)
    packed = partial(_hdf5, compression="gzip", **chunks)
    latest = partial(_hdf5, "latest", maxshape=(None,), shuffle=True, **chunks)
    plain = by(writers.write_hdf5, "run.h5")
    yield logged("hdf5", "run.h5", _hdf5, packed, latest, plain, odd=_odd_hdf5)
    yield logged("mat4", "run.mat", partial(_mat, format="4"), odd=_odd_mat)
    yield logged("mat5", "run.mat", _mat, by(writers.write_mat5, "run.mat"), odd=_odd_mat)
    inside = {"damage": mutations.damaged_inside, "odd": _odd_mat}
    yield logged("mat5-packed", "run.mat", partial(_mat, do_compression=True), **inside)
    yield logged("mat73", "run.mat", by(writers.write_mat73, "run.mat"))
    yield logged("parquet", "run.parquet", by(writers.write_parquet, "run.parquet"))
    yield logged("tdms", "run.tdms", by(writers.write_tdms, "run.tdms"))
    yield logged("mdf", "run.mf4", by(writers.write_mdf, "run.mf4"))
    yield logged("uff", "run.uff", _universal, _responses, **text)
    yield logged("uff-binary", "run.uff", partial(_universal, 1), partial(_responses, 1))


def _others() -> Iterator[Format]:
    """Yield what is said of records, tables of few numbers, models, rigs and results."""

    def said(name: str, file: str, *good: Content, **more: Any) -> Format:
        given = {"damage": mutations.reworded, "commands": _ANSWERS, **more}
        return Format(name, file, good, **given)

    table, log = {"run.csv": phasor_table}, {"run.csv": good_csv}
    clock = {"run.csv": partial(_timed_csv, units=False)}
    yield said("experiment", "experiment.toml", OF_CSV, LONGER, beside=clock)
    yield said("phasors", "experiment.toml", PHASORS, beside=table, share=0.2)
    yield said("phasor-table", "run.csv", phasor_table, experiment=PHASORS, share=0.2)
    of_responses = {"experiment": RESPONSES, "share": 0.2}
    yield said("responses", "run.uff", _responses, **of_responses)
    binary = of_responses | {"damage": mutations.damaged}
    yield said("responses-binary", "run.uff", partial(_responses, 1), **binary)
    shown = (1, ("models", "model.toml"), ())
    yield said("equations", "model.toml", MODEL, EQUATIONS + SPRINGS, commands=(shown,), share=0.2)
    yield said("rotor", "model.toml", ROTOR, commands=(shown, (1, _MODES, _OUT)))
    both = {"beside": log, "experiment": OF_CSV}
    yield said("model", "model.toml", MODEL, **both, commands=((3, *shown[1:]), *_ANSWERS))
    yield said("rig", "rig.toml", RIG, commands=_RIG_COMMANDS)
    results = (partial(_result, "ls"), partial(_result, "ml"))
    yield said("result", "result.json", *results, **both, commands=_RESULT_COMMANDS)


FORMATS: Mapping[str, Format] = {one.name: one for one in (*_records(), *_others())}
