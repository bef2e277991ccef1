"""The cases: what is run, and on which files.

They use the command line alone, and write their files with numpy and h5py; rotor files, mistakes
and bad input are those of `tests`, texts without the package. Only the adverse bank (`adverse`)
makes its samples by modules of `tests` that use the package.

What is dear has fewer seeds than three: the rigs `rigid` and `flexible` with a fault, 1 (without
one, 3); the adverse bank, 1, and 2 where a case is cheap. Rigs with a fault run 2 s, or as long as
the fault takes to come (`LATE`). A family is ordered by seed first, so that every n-th case is a
fair cross-section.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from golden import records
from golden.case import Case, Skipped, Step

ROOT = Path(__file__).parents[1]
RIGS = Path(__file__).parent / "rigs"
"""The shipped rigs, their records 2 s long: as short as tells all faults apart."""
DATA = Path(os.environ.get("ROTORID_DATA", ROOT.parent / "shared" / "data"))
sys.path.append(str(ROOT / "tests"))

IDENTIFY = "identify run.toml --json run.json"
SHARED: dict[str, tuple[str, ...]] = {
    "three-mass": ("simulate three-mass --out three-mass.h5",),
    "rigid": ("simulate rigid --out rigid.h5",),
}
"""Folders that several cases read, and the commands that write them."""


def all_cases() -> list[Case]:
    """Return every case, in the order in which they run."""
    families = (
        *(rigs, mistakes, adverse, commands, texts, rotors, modes, phasors, responses, wholes),
        *(formats, measured, bad_experiments, bad_tables, bad_rigs, bad_drawings, bad_results),
    )
    found = [case for family in families for case in family()]
    assert len({case.name for case in found}) == len(found)
    return found


def put(name: str, text: str) -> Callable[[Path], None]:
    """Write a file."""
    return lambda folder: _ignore((folder / name).write_text(text, "utf-8"))


def put_bytes(name: str, content: bytes) -> Callable[[Path], None]:
    """Write a file of bytes."""
    return lambda folder: _ignore((folder / name).write_bytes(content))


def edit(name: str, change: Callable[[str], str], to: str = "") -> Callable[[Path], None]:
    """Change a file, or write it under another name."""

    def act(folder: Path) -> None:
        text = (folder / name).read_text("utf-8")
        (folder / (to or name)).write_text(change(text), "utf-8")

    return act


def replaced(text: str, old: str, new: str) -> str:
    """Replace a part that must be there, once."""
    assert not old or old in text, old
    return text.replace(old, new, 1) if old else text


def slug(text: str) -> str:
    """Return a text as a part of the name of a case."""
    return re.sub(r"[^\w.+-]+", "-", text).strip("-")


def _ignore(_: object) -> None:
    pass


# ---------------------------------------------------------------------------------------------
# The shipped rigs and their faults.

FAULTS = """
current-loop voltage-limit pwm-ripple eddy hysteresis iron-path saturation bias-mismatch
bias-low low-bias gap force-gain force-gain-one negative-stiffness gap-drift actuators-rotated
sensors-rotated sensor-plane actuator-plane cross-force gravity gravity-45 sensor-bandwidth
sensor-gain sensor-bend gain-drift cross-talk runout-1 runout-2 runout-3 hum quantization
base-motion transient touch-down speed-variation speed-off phase-mark backward keyphasor-logic
keyphasor-missing keyphasor-double encoder-lost encoder-double encoder-index anti-alias skew
sensor-sign sensors-swapped unit dead-sensor clipping nan lost-sample lost-samples two-clocks
notch gain-schedule
"""
LATE = {"touch-down": "5 s", "gain-schedule": "6 s", "speed-variation": "7 s"}
"""Faults that come late, and how long a record holds them."""


def rigs() -> Iterator[Case]:
    """Yield the rigs without and with each fault, by seed; inspected for the first seed."""
    for seed in (1, 2, 3):
        for rig in ("three-mass", "rigid", "flexible"):
            for fault in ("", *(FAULTS.split() if seed == 1 or rig == "three-mass" else ())):
                yield rig_case(rig, fault, seed)
    yield Case("rig/flexible-as-shipped", ("simulate flexible --out run.h5", IDENTIFY))


def rig_case(rig: str, fault: str, seed: int) -> Case:
    """Return a case of a rig: simulated, identified, and inspected for the first seed."""
    text = (RIGS / f"{rig}.toml").read_text("utf-8")
    if fault in LATE:
        text = replaced(text, '"2 s"', f'"{LATE[fault]}"')
    given = f" --fault {fault}" if fault else ""
    steps: list[Step] = [put("rig.toml", text)]
    steps.append(f"simulate rig.toml --out run.h5 --seed {seed}{given}")
    steps += ["inspect run.toml --json found.json"] if seed == 1 else []
    return Case(f"rig/{rig}/{fault or 'none'}/{seed}", (*steps, IDENTIFY))


def mistakes() -> Iterator[Case]:
    """Yield the mistakes in the experiment files of the rigs as they are shipped."""
    from mistakes import MISTAKES

    for rig in SHARED:
        steps = (f"inspect {rig}.toml", f"identify {rig}.toml --json run.json")
        yield Case(f"mistake/{rig}/none", steps, rig)
    for one in MISTAKES:
        steps = (edit(f"{one.rig}.toml", one.edit, "run.toml"), IDENTIFY)
        yield Case(f"mistake/{one.rig}/{slug(one.what)}", steps, one.rig)


# ---------------------------------------------------------------------------------------------
# The adverse bank: its samples, in a file of their own, with an experiment file.

MODELS = {"jeffcott": "jeffcott", "rigid": "rigid", "three": "three-mass", "eight": "three-mass"}
UNITS = {"m": "kg", "c": "N s/m", "k": "N/m", "I": "kg m^2", "L": "m", "x": "m", "z": "m"}
DEAR = ("drift", "lost", "sample", "hum", "walks", "ten times", "hundred", "shaft softer")


def adverse() -> Iterator[Case]:
    """Yield the records of the adverse bank."""
    try:
        from adverse_cases import CASES
    except ImportError as error:
        yield Case("adverse", (_skip(f"the adverse bank cannot be imported: {error}"),))
        return
    for seed in (0, 1):
        for one in CASES:
            if seed == 0 or not any(word in one.what for word in DEAR):
                steps = (_adverse_files(one, seed), IDENTIFY)
                yield Case(f"adverse/{slug(one.what)}/{seed}", steps)


def _skip(reason: str) -> Callable[[Path], None]:
    def act(_: Path) -> None:
        raise Skipped(reason)

    return act


def _adverse_files(one: Any, seed: int) -> Callable[[Path], None]:
    """Return what writes the record of a case, drawn as the bank draws it."""

    def act(folder: Path) -> None:
        from adverse import measure, new_trial

        rng = np.random.default_rng([seed, sum(map(ord, one.what)), len(one.what)])
        kinds = one.machines.split()
        kind = kinds[seed % len(kinds)]
        trial = new_trial(kind, rng)
        if one.plant is not None:
            one.plant(trial)
        measure(trial)
        if one.data is not None:
            one.data(trial)
        records.write_columns(folder / "run.h5", trial.columns)
        (folder / "run.toml").write_text(_adverse_text(trial, MODELS[kind]), "utf-8")

    return act


def _adverse_text(trial: Any, model: str) -> str:
    estimator = [f'method = "{trial.method}"']
    estimator += ["runout = true"] if trial.options.get("runout") else []
    channels = [_adverse_channel(trial, name) for name in trial.columns]
    return f"""
model = "{model}"

[[records]]
file = "run.h5"
sample_rate = "{float(trial.rate)!r} Hz"
speed = "{float(trial.speed)!r} Hz"
fundamental = "{float(trial.fundamental)!r} Hz"
harmonics = {list(trial.harmonics)}
skip = "{float(trial.skip)!r} s"

[channels]
{chr(10).join(channels)}

[parameters]
{chr(10).join(_adverse_knowledge(trial)) if trial.method == "ml" else ""}

[estimator]
{chr(10).join(estimator)}
"""


def _adverse_channel(trial: Any, name: str) -> str:
    unit = "N" if name in trial.inputs else "rad" if name.startswith("theta") else "m"
    reads = trial.reads.get(name, trial.machine.sensors.get(name, {name: 1.0}))
    text = " + ".join(f"{float(share)!r}*{q}" for q, share in reads.items())
    said = "" if list(reads) == [name] else f', reads = "{text.replace("+ -", "- ")}"'
    return f'{name} = {{ column = "{name}", unit = "{unit}"{said} }}'


def _adverse_knowledge(trial: Any) -> Iterator[str]:
    """Yield what is known: held at the truth, or starting 20 % off, as in the bank."""
    truth, told = trial.machine.truth, trial.options
    fixed = {n: truth[n] for n in trial.machine.fixed} | told.get("fixed", {})
    for name, value in truth.items():
        unit = UNITS.get(name[0], "rad")
        if name in ("mu", "eta"):
            unit = "rad"
        keys = {"fixed": fixed.get(name)}
        if name not in fixed and name not in ("xi", "zeta", "mu", "eta"):
            keys["start"] = value * (1 + 0.2 * trial.rng.uniform(-1, 1))
        if name in told.get("start", {}):
            keys["start"] = told["start"][name]
        keys["value"], keys["std"] = told.get("known", {}).get(name, (None, None))
        keys["min"], keys["max"] = told.get("bounds", {}).get(name, (None, None))
        said = [f'{k} = "{float(v)!r} {unit}"' for k, v in keys.items() if v is not None]
        if said:
            yield f"{name} = {{ {', '.join(said)} }}"


# ---------------------------------------------------------------------------------------------
# Commands on results, and what they say without any.


def commands() -> Iterator[Case]:
    """Yield chains of commands, each on the result of the one before."""
    for rig, plane, speed in (
        ("three-mass", "x1,y1", "8400 rpm"),
        ("rigid", "F_xa,F_ya", "9000 rpm"),
        ("flexible", "F_xA,F_yA", "6000 rpm"),
    ):
        start = (
            put("rig.toml", (RIGS / f"{rig}.toml").read_text("utf-8")),
            "simulate rig.toml --out run.h5 --seed 7",
            IDENTIFY,
        )
        yield Case(f"command/{rig}/modes", (*start, *_on_modes(speed)))
        yield Case(f"command/{rig}/balance", (*start, *_on_balance(plane, speed)))
        yield Case(f"command/{rig}/export", (*start, *_on_files(speed)))
    yield Case("command/disc/all", (*_disc(), IDENTIFY, *_on_disc()))
    for method in ("ls", "batch", "sequential", "ml"):
        named = f"identify run.toml --method {method} --json run.json --report run.html"
        yield Case(f"command/disc/{method}", (*_disc(), named, "validate run.json run.toml"))
    whole = put("run.toml", replaced(records.WHOLE, "band", 'references = ["ex", "ey"]\nband'))
    asked = "sensitivity run.toml --json found.json"
    steps = (whole, _write_whole, asked, f"{asked} --pair F_x=ex --report s.html --force")
    yield Case("command/whole/sensitivity", steps)
    yield Case("command/demo", ("demo --runs 2 --json demo.json",))


def _on_modes(speed: str) -> Sequence[Step]:
    return (
        "modes run.json --json still.json",
        f'modes run.json --speed "{speed}" --json turning.json --report modes.html',
        f'modes run.json --speed "{speed}" --to "{speed}" --json to.json',
        'modes run.json --speed "8400 kg"',
        "modes run.json --record 3",
    )


def _on_balance(plane: str, speed: str) -> Sequence[Step]:
    masses = '--radius "30 mm" --masses "0.5 g, 1 g, 2 g" --holes 24'
    return (
        f"balance run.json --plane {plane} --json one.json",
        f'balance run.json --plane {plane} --speed "{speed}" --radius "30 mm" --json radius.json',
        f"balance run.json --plane {plane} {masses} --report balance.html",
        "balance run.json --plane nowhere",
        "balance run.json",
    )


def _on_files(speed: str) -> Sequence[Step]:
    endings = ("csv", "mat", "tex", "json")
    return (
        *(f"export run.json --to out.{ending}" for ending in endings[:3]),
        *(f'export run.json --to at.{ending} --speed "{speed}"' for ending in endings[1:]),
        "export run.json --to out.xls",
        "export run.json --to run.json",
        "report run.json",
        "report run.json --out run.txt",
        "validate run.json run.toml --json valid.json",
        "identify run.toml --intervals --report interval.html",
    )


def _disc() -> Sequence[Step]:
    def act(folder: Path) -> None:
        records.write_table(folder / "run.csv", records.DISC_HEADER, records.disc())
        records.write_table(folder / "other.csv", records.DISC_HEADER, records.disc(6, 1.02))

    other = records.DISC.replace("run.csv", "other.csv")
    return act, put("run.toml", records.DISC), put("other.toml", other)


def _on_disc() -> Sequence[Step]:
    missing = "\n[parameters]\nm = { fixed = '5 kg' }\n"
    return (
        "inspect run.toml --json found.json --report found.html",
        "validate run.json other.toml --json valid.json --report valid.html",
        "identify run.toml",
        "identify run.toml -q",
        "identify run.toml --intervals",
        "identify run.toml --json run.csv",
        "identify run.toml --json a --report ./a",
        "identify run.toml --report a.pdf",
        "identify none.toml",
        "identify run.toml --method newton",
        "inspect none.toml",
        "validate none.json run.toml",
        "report none.json",
        "sensitivity run.toml",
        edit("run.toml", lambda text: text + missing, "wrong.toml"),
        "identify wrong.toml --strict",
        "identify wrong.toml --json wrong.json",
        "validate wrong.json run.toml",
        "modes wrong.json",
        "balance wrong.json --plane x,y",
        "report wrong.json",
    )


def texts() -> Iterator[Case]:
    """Yield what the program says of itself."""
    names = "balance demo export identify inspect models modes new report sensitivity simulate"
    helps = [f"{name} --help" for name in (*names.split(), "validate")]
    yield Case("text/help", ("--help", *helps))
    shipped = ("emps", "flexible", "jeffcott", "rigid", "three-mass")
    yield Case("text/models", ("models", *(f"models {name}" for name in shipped), "models none"))
    turning = (f'modes {name} --speed "3000 rpm" --json {name}.json' for name in shipped[1:])
    yield Case("text/modes", (*turning, "modes emps", 'modes jeffcott --to "20000 rpm"'))
    wrong = ("nothing", "identify", "simulate", "identify a b", "identify a --colour red")
    yield Case("text/usage", wrong)
    faults = ("--faults", "three-mass", "none --out run.h5", "three-mass --out run.csv")
    unknown = ("three-mass --out run.h5 --fault none", "three-mass --out run.h5 --fault gap=x")
    yield Case("text/simulate", tuple(f"simulate {one}" for one in (*faults, *unknown)))


# ---------------------------------------------------------------------------------------------
# Rotors by their drawing; natural frequencies alone.


def rotors() -> Iterator[Case]:
    """Yield drawn rotors: what they are, and their modes."""
    from rotor_files import CORED, random_rotor, uniform

    drawn = {"cored": CORED, "uniform": uniform()}
    drawn |= {f"random-{k}": random_rotor(np.random.default_rng(k)) for k in range(10)}
    for name, text in drawn.items():
        shown = ("models rotor.toml", "modes rotor.toml --json still.json")
        turning = 'modes rotor.toml --speed "6000 rpm" --to "9000 rpm" --json turning.json'
        yield Case(f"rotor/{name}", (put("rotor.toml", text), *shown, turning))


FREE = (229.37, 632.02, 1186.48)
SPRUNG = (84.56, 109.2, 270.94)
"""Hz: of the rotor `CORED` with s_A = 1.15, s_B = 0.9, m_w = 1.25 kg; hung up, and on 1.2e6 N/m."""
KNOWN = {"s_A": "1.15", "s_B": "0.9", "m_w": "1.25 kg", "k_s": "1.2e6 N/m"}


def modes() -> Iterator[Case]:
    """Yield natural frequencies alone: enough, too few, wrong ones, and bad input."""
    from rotor_files import CORED

    both = [*_mode_tables(FREE, "0 N/m"), *_mode_tables(SPRUNG)]
    swapped = _mode_tables((FREE[0], FREE[2], FREE[1]), "0 N/m")
    cases = {
        "both": both,
        "free": both[:3],
        "sprung": both[3:],
        "as-many-as-unknowns": both[:4],
        "swapped": swapped,
        "skipped": [*_mode_tables(FREE[1:], "0 N/m"), *both[3:]],
        "rad-per-s": [*_mode_tables(np.multiply(FREE, 2 * np.pi), "0 N/m"), *both[3:]],
        "one-wrong": [*_mode_tables((229.37, 632.02, 1250.0), "0 N/m"), *both[3:]],
        "damping": [both[0] + "damping = { value = 0.0025, std = 0.0005 }\n", *both[1:]],
        "no-std": [both[0].replace("std", "stdd"), *both[1:]],
        "below-zero": [both[0].replace("229.37", "-229.37"), *both[1:]],
        "unknown-parameter": [both[0].replace("k_s", "k_t"), *both[1:]],
    }
    for name, tables in cases.items():
        text = "\n".join(['model = "rotor.toml"', *tables])
        yield Case(f"modes/{name}", (put("rotor.toml", CORED), put("run.toml", text), IDENTIFY))
    for name, value in KNOWN.items():
        text = "\n".join(['model = "rotor.toml"', *both, "[parameters]"])
        known = f"{name} = {{ fixed = {value if ' ' not in value else json.dumps(value)} }}"
        steps = (put("rotor.toml", CORED), put("run.toml", f"{text}\n{known}\n"), IDENTIFY)
        yield Case(f"modes/known-{name}", steps)


def _mode_tables(hertz: Sequence[float] | np.ndarray, support: str = "") -> list[str]:
    """Return a table for each frequency, known to 2e-4 of it."""
    held = f'parameters = {{ k_s = "{support}" }}\n' if support else ""
    return [
        f'[[modes]]\nfrequency = "{f:.6g} Hz"\nstd = "{2e-4 * f:.4g} Hz"\n{held}' for f in hertz
    ]


# ---------------------------------------------------------------------------------------------
# Tables, and records without periods.

Table = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
SCALE = ('m = { fixed = "5 kg" }\n', "")
TRIAL = (
    "[channels]",
    """[[records]]
kind = "phasors"
file = "trial.csv"
speed = { column = "n", unit = "rpm" }
[records.parameters]
t_x = { fixed = "50 g mm" }
t_y = { fixed = "20 g mm" }
[channels]""",
)
LAGGING = ("std =", "lag = true, std =")
PHASORS: dict[str, tuple[Table, tuple[tuple[str, str], ...]]] = {
    "exact": (lambda n, z: (n, z), ()),
    "noisy": (lambda n, z: (n, records.noisy(z, 1e-6, 3)), ()),
    "backward": (lambda n, z: (-n, records.noisy(z, 1e-6, 3)), ()),
    "free-scale": (lambda n, z: (n, records.noisy(z, 1e-6, 3)), (SCALE,)),
    "trial-mass": (lambda n, z: (n, records.noisy(z, 1e-6, 3)), (SCALE, TRIAL)),
    "trial-mass-lag": (lambda n, z: (n, records.noisy(z, 1e-6, 3)), (SCALE, TRIAL, LAGGING)),
    "trial-mass-wrong": (
        lambda n, z: (n, records.noisy(z, 1e-6, 3)),
        (SCALE, TRIAL, ('"20 g mm"', '"-20 g mm"')),
    ),
    "trial-mass-swapped": (lambda n, z: (n, records.noisy(z[:, ::-1], 1e-6, 3)), (SCALE, TRIAL)),
    "one-lag": (
        lambda n, z: (n, records.noisy(z, 1e-6, 3)),
        (('phase = "px",', 'phase = "px", lag = true,'),),
    ),
    "swapped": (lambda n, z: (n, records.noisy(z[:, ::-1], 1e-6, 3)), ()),
    "faster": (lambda n, z: (60 * n, records.noisy(z, 1e-6, 3)), ()),
    "slower": (lambda n, z: (n / 60, records.noisy(z, 1e-6, 3)), ()),
    "dead": (lambda n, z: (n, records.noisy(z, 1e-6, 3) * [1, 0]), ()),
    "gain": (lambda n, z: (n, records.noisy(z * [1.1, 1], 1e-6, 3)), ()),
    "sign": (lambda n, z: (n, records.noisy(z * [-1, 1], 1e-6, 3)), ()),
    "twice": (
        lambda n, z: (np.repeat(n, 2), records.noisy(np.repeat(z, 2, axis=0), 5e-6, 3)),
        ((', std = "1 um"', ""), (', std = "1 um"', "")),
    ),
    "too-small-std": (lambda n, z: (n, records.noisy(z, 2e-5, 3)), ()),
    "one-row-wrong": (lambda n, z: (n, z * np.where(n == n[9], 3.0, 1.0)[:, None]), ()),
    "peak-to-peak": (lambda n, z: (n, z), (LAGGING, ("std =", "peak_to_peak = true, std ="))),
}


def phasors() -> Iterator[Case]:
    """Yield tables of phasors, right and wrong."""
    for name, (change, edits) in PHASORS.items():
        steps = (_phasor_files(change, edits), "inspect run.toml --json found.json", IDENTIFY)
        yield Case(f"phasors/{name}", steps)


def _phasor_files(change: Table, edits: Sequence[tuple[str, str]]) -> Callable[[Path], None]:
    def act(folder: Path) -> None:
        text = records.COAST
        for old, new in edits:
            text = replaced(text, old, new)
        (folder / "model.toml").write_text(records.COAST_MODEL, "utf-8")
        (folder / "run.toml").write_text(text, "utf-8")
        rpm = records.RPM[::2]
        for file, trial in (("run", 0.0), ("trial", 5e-5 + 2e-5j)):
            found = change(rpm, records.coast(rpm, trial))
            records.write_phasors(folder / f"{file}.csv", *found)

    return act


FIRST, THIRD = 'input = "F", amplitude', 'input = "F", reads'
AVERAGES = "averages = 20\n"
RESPONSES: dict[str, tuple[tuple[str, str], ...]] = {
    "right": (),
    "band": ((AVERAGES, AVERAGES + 'band = ["50 Hz", "200 Hz"]\n'),),
    "every-second": ((AVERAGES, AVERAGES + "every = 2\n"),),
    "sign-of-one": ((FIRST, 'input = "F", scale = -1, amplitude'),),
    "sign-of-both": ((FIRST, f"scale = -1, {FIRST}"), (THIRD, f"scale = -1, {THIRD}")),
    "lag": ((FIRST, f"lag = true, {FIRST}"), (THIRD, f"lag = true, {THIRD}")),
    "derivative": (("reads = \"x3''\"", 'reads = "x3\'"'), ("m/s^2/N", "m/s/N")),
    "other-place": (("reads = \"x3''\"", "reads = \"x2''\""),),
    "other-force": ((THIRD, 'input = "G", reads'),),
    "hertz-as-rad": (('unit = "Hz"', 'unit = "rad/s"'),),
    "unit": (("um/N", "mm/N"),),
    "no-input": ((FIRST, 'input = "H", amplitude'),),
    "no-unit": ((', unit = "um/N"', ""),),
    "wrong-unit": (("um/N", "kg"),),
    "no-noise": ((', coherence = "c1"', ""),),
    "coherence-beyond-one": (('"c1"', '"a1"'),),
    "no-averages": ((AVERAGES, ""),),
    "fundamental": ((AVERAGES, AVERAGES + 'fundamental = "3 Hz"\n'),),
    "empty-band": ((AVERAGES, AVERAGES + 'band = ["400 Hz", "500 Hz"]\n'),),
}


def responses() -> Iterator[Case]:
    """Yield tables of frequency responses, right and wrong."""
    for name, edits in RESPONSES.items():
        text = records.CHAIN
        for old, new in edits:
            text = replaced(text, old, new)
        files = (put("chain.toml", records.CHAIN_MODEL), put("run.toml", text), _write_responses)
        shown = "inspect run.toml --json found.json"
        yield Case(f"responses/{name}", (*files, shown, IDENTIFY))


def _write_responses(folder: Path) -> None:
    records.write_responses(folder / "tap.csv")


NOISE = {
    "references": 'references = ["ex", "ey"]\n',
    "quiet": 'quiet = "quiet.csv"\n',
    "inputs": "",
    "both": 'references = ["ex"]\nquiet = "quiet.csv"\n',
    "fundamental": 'references = ["ex"]\nfundamental = "10 Hz"\n',
    "no-such-reference": 'references = ["none"]\n',
}
WHOLE_EDITS = {
    "no-speed": (f'speed = "{records.WHOLE_SPEED * 30 / np.pi!r} rpm"\n', ""),
    "wrong-speed": (f"{records.WHOLE_SPEED * 30 / np.pi!r}", "3000"),
    "swapped": (
        '"px", unit = "um" }\ny = { column = "py"',
        '"py", unit = "um" }\ny = { column = "px"',
    ),
    "sign": ('"px",', '"px", scale = -1,'),
    "unit": ('"py", unit = "um"', '"py", unit = "mil"'),
    "no-hold": ('column = "fx", unit = "N", hold = "zero-order"', 'column = "fx", unit = "N"'),
    "runout": ("[parameters]", "[estimator]\nrunout = true\n[parameters]"),
    "rate": ("5 kHz", "10 kHz"),
}


def wholes() -> Iterator[Case]:
    """Yield records without periods: noise from references, a quiet record or inputs; mistakes."""
    shown = "inspect run.toml --json found.json"
    for name, more in NOISE.items():
        text = replaced(records.WHOLE, "band", f"{more}band")
        yield Case(f"whole/{name}", (put("run.toml", text), _write_whole, shown, IDENTIFY))
    for name, (old, new) in WHOLE_EDITS.items():
        text = replaced(records.WHOLE, "band", f"{NOISE['references']}band")
        steps = (put("run.toml", replaced(text, old, new)), _write_whole, IDENTIFY)
        yield Case(f"whole/{name}", steps)
    asked = "identify run.toml --method batch"
    yield Case("whole/batch", (put("run.toml", records.WHOLE), _write_whole, asked))


def _write_whole(folder: Path) -> None:
    for name, seed, excitation in (("run", 1, 20.0), ("quiet", 2, 0.0)):
        samples = records.levitated(seed, excitation, 3.0)
        records.write_table(folder / f"{name}.csv", "fx,fy,px,py,ex,ey", samples)


def formats() -> Iterator[Case]:
    """Yield drafts of experiment files, from tables of several kinds."""
    drafts = (
        "new run.csv",
        "new run.csv --model jeffcott",
        "new run.csv --model jeffcott --out draft.toml",
        "inspect draft.toml",
        "identify draft.toml",
        "new run.csv --model none",
        "new none.csv",
        "new run.csv --model jeffcott --out run.csv",
        "new run.csv other.csv --model jeffcott",
    )
    yield Case("new/csv", (*_disc(), *drafts))
    hdf5 = ("new run.h5", "new run.h5 --model jeffcott --out draft.toml", "inspect draft.toml")
    yield Case("new/hdf5", (_disc_as_hdf5, *hdf5))
    table = ("new run.csv --model model.toml", "new run.csv")
    yield Case("new/phasors", (_phasor_files(lambda n, z: (n, z), ()), *table))
    taps = put("chain.toml", records.CHAIN_MODEL), _write_responses
    yield Case("new/responses", (*taps, "new tap.csv --model chain.toml", "new tap.csv"))
    for rig in ("three-mass", "rigid", "flexible"):
        text = (RIGS / f"{rig}.toml").read_text("utf-8")
        drafted = f"new run.h5 --model {rig} --out draft.toml"
        steps = (put("rig.toml", text), "simulate rig.toml --out run.h5 --seed 1", drafted)
        yield Case(f"new/{rig}", (*steps, "inspect draft.toml"))


def _disc_as_hdf5(folder: Path) -> None:
    names = records.DISC_HEADER.split(",")
    columns = dict(zip(names, records.disc().T, strict=True))
    records.write_columns(folder / "run.h5", columns)


# ---------------------------------------------------------------------------------------------
# Measured data, where they are at hand.

PERIODIC = ("period_samples", "fundamental", "band", "harmonics", "skip")
ARMS = """
title = "double pendulum"
equations = [
  "(I1 + 0.09*m2 + I2 + 0.6*m2r2*cos(q2))*q1'' + (I2 + 0.3*m2r2*cos(q2))*q2'' - 0.6*m2r2*sin(q2)*q1'*q2' - 0.3*m2r2*sin(q2)*q2'^2 + 9.81*(g1*sin(q1) + m2r2*sin(q1 + q2)) + b1*q1' + f1*sign(q1') = T1",
  "(I2 + 0.3*m2r2*cos(q2))*q1'' + I2*q2'' + 0.3*m2r2*sin(q2)*q1'^2 + 9.81*m2r2*sin(q1 + q2) + b2*q2' + f2*sign(q2') = T2",
]
coordinates = { q1 = "rad", q2 = "rad" }
inputs = { T1 = "N m", T2 = "N m" }
[parameters]
I1 = { unit = "kg m^2" }
I2 = { unit = "kg m^2" }
m2 = { unit = "kg" }
m2r2 = { unit = "kg m" }
g1 = { unit = "kg m" }
b1 = { unit = "N m s" }
b2 = { unit = "N m s" }
f1 = { unit = "N m" }
f2 = { unit = "N m" }
"""  # noqa: E501
SWINGING = """
model = "model.toml"
[[records]]
file = "run.csv"
time = "time"
cutoff = "5 Hz"
decimate = 10
[channels]
T1 = { column = "tau1", unit = "N m" }
T2 = { column = "tau2", unit = "N m" }
q1 = { column = "pos1", unit = "rad" }
q2 = { column = "pos2", unit = "rad" }
[estimator]
method = "ls"
"""


def measured() -> Iterator[Case]:
    """Yield EMPS by every method, with periods and without, and a double pendulum."""
    emps = _linked("emps", "DATA_EMPS.mat", "DATA_EMPS_PULSES.mat")
    written = [
        put(name, (ROOT / "examples" / "emps" / name).read_text("utf-8"))
        for name in ("experiment.toml", "validate.toml")
    ]
    for method in ("ls", "batch", "sequential", "ml"):
        named = f"identify experiment.toml --method {method} --json run.json"
        validated = "validate run.json validate.toml --json valid.json"
        yield Case(f"emps/{method}", (emps, *written, named, validated))
    yield Case("emps/inspect", (emps, *written, "inspect experiment.toml --json found.json"))
    without = "identify whole.toml --method {} --json run.json"
    for method in ("ls", "batch"):
        steps = (emps, *written, edit("experiment.toml", _without_periods, "whole.toml"))
        yield Case(f"emps/without-periods-{method}", (*steps, without.format(method)))
    data = _linked("double-pendulum", "20220812-061157.csv", to="run.csv")
    model, experiment = put("model.toml", ARMS), put("run.toml", SWINGING)
    yield Case("double-pendulum/ls", (data, model, experiment, IDENTIFY))


def _linked(folder: str, *names: str, to: str = "") -> Callable[[Path], None]:
    def act(here: Path) -> None:
        for name in names:
            if not (DATA / folder / name).exists():
                raise Skipped(f"no {folder}/{name}; name the folder of {folder} in ROTORID_DATA")
            (here / (to or name)).symlink_to((DATA / folder / name).resolve())

    return act


def _without_periods(text: str) -> str:
    kept = [line for line in text.splitlines() if line.split(" ")[0] not in PERIODIC]
    return "\n".join(kept).replace(
        "[[records]]", '[[records]]\ncutoff = "100 Hz"\ndecimate = 10', 1
    )


# ---------------------------------------------------------------------------------------------
# Bad input.


def bad_experiments() -> Iterator[Case]:
    """Yield the bad files of `tests/test_bad_input.py`, identified and inspected."""
    from test_bad_input import CASES

    asked = "identify experiment.toml --json result.json"
    for name, one in CASES.items():
        yield Case(f"bad/{slug(name)}", (one.write, asked, "inspect experiment.toml"))
    for file in sorted((ROOT / "tests" / "corpus" / "mat").glob("*.mat")):
        text = records.DISC.replace("run.csv", "run.mat")
        steps = (put_bytes("run.mat", file.read_bytes()), put("run.toml", text))
        yield Case(f"bad/mat/{file.stem}", (*steps, "new run.mat", "identify run.toml"))


ROWS = ("0,1,2,3,4", "3000,nan,2,3,4", "3000,-1,2,3,4", "fast,1,2,3,4", "3000,1,2,3")
TABLE_EDITS = (
    ('file = "run.csv"', 'file = "run.csv"\nskip = "1 s"'),
    ('speed = { column = "n", unit = "rpm" }', ""),
    ('kind = "phasors"', ""),
    ('kind = "phasors"', 'kind = "phasor"'),
    ('amplitude = "ax", phase = "px"', 'column = "ax"'),
    ('phase = "px", ', ""),
    ('amplitude = "ax"', 'amplitude = "ax", hold = "zero-order"'),
    ('phase = "px"', 'phase = "qx"'),
    ('std = "1 um"', 'std = "0 um"'),
    ('std = "1 um"', 'std = "1 kg"'),
    ('std = "1 um"', "std = 1"),
    ('std = "1 um"', 'scale = 0, std = "1 um"'),
    ('std = "1 um"', 'std = "sigma"'),
    (', std = "1 um" }\ny', " }\ny"),
    ('unit = "um"', 'unit = "kg"'),
    ('unit = "um", ', ""),
    ('phase = "px"', 'phase = "px", phase_unit = "m"'),
    ("x = { amp", "q = { amp"),
    ('column = "n", unit = "rpm"', 'column = "n", unit = "m"'),
    ('column = "n", unit = "rpm"', 'column = "q", unit = "rpm"'),
)


def bad_tables() -> Iterator[Case]:
    """Yield tables of phasors that are refused, a step each."""
    exact = _phasor_files(lambda n, z: (n, z), ())
    steps: list[Step] = [exact]
    for old, new in TABLE_EDITS:
        steps += [put("run.toml", replaced(records.COAST, old, new)), "identify run.toml"]
    yield Case("bad-table/keys", tuple(steps))
    steps = [exact]
    for row in ROWS:
        steps += [exact, edit("run.csv", lambda text, row=row: f"{text}{row}\n")]
        steps += ["identify run.toml", "inspect run.toml"]
    yield Case("bad-table/rows", tuple(steps))


RIG_EDITS = (
    ('stiffness = "2e5 N/m"', 'stiffness = "-2e5 N/m"'),
    ('"50 us"', '"900 us"'),
    ('damping = "800 N s/m"', 'damping = "-1 N s/m"'),
    ('"250 um"', '"80 um"'),
    ('model = "three-mass"', 'model = "none"'),
    ('speed = "8400 rpm"', 'speed = "8400 kg"'),
    ('duration = "2 s"', 'duration = "0 s"'),
    ('duration = "2 s"', 'length = "2 s"'),
    ("[sensors]", "[sensor]"),
    ("[rotation]", "[rotation"),
    ("[logger]", "[logger]\nencoder = { lines = 0 }"),
    ("[logger]", "[logger]\nkeyphasor = { colour = 1 }"),
)


def bad_rigs() -> Iterator[Case]:
    """Yield rig files that cannot run, a step each."""
    text = (RIGS / "three-mass.toml").read_text("utf-8")
    steps: list[Step] = []
    for old, new in RIG_EDITS:
        steps += [put("rig.toml", replaced(text, old, new)), "simulate rig.toml --out run.h5"]
    yield Case("bad-rig/files", tuple(steps))
    for size in ("gap=1 mm", "gap=-1", "quantization=0 um", "hum=1 kg", "two-clocks=1"):
        steps = [
            put("rig.toml", text),
            f"simulate rig.toml --out run.h5 --fault {shlex.quote(size)}",
        ]
        yield Case(f"bad-rig/{slug(size)}", tuple(steps))


DRAWING_EDITS = (
    ('length = "60 mm"', 'length = "-60 mm"'),
    ('outer = "25 mm"', 'outer = "25 mm", inner = "25 mm"'),
    ('material = "steel"', 'material = "stel"'),
    ('at = "550 mm"', 'at = "5500 mm"'),
    ('at = "480 mm"', 'at = "0 mm"'),
    ('at = "480 mm"', 'at = "480 kg"'),
    ('at = "480 mm"', 'at = "480"'),
    ("elements = 1 ", "elements = 1000000 "),
    ('mass = "m_w"', 'mass = "m_w + 1"'),
    ('mass = "m_w"', 'mass = "s_A"'),
    ('mass = "m_w"', 'mass = "m_x"'),
    ('mass = "m_w"', 'mass = "-1 kg"'),
    ('mass = "m_w"', 'mass = "1 kg"'),
    ('G = "81 GPa"', 'G = "81 MPa"'),
    ('E = "210 GPa"', 'E = "s_A"'),
    ("nominal = 1.2,", ""),
    ("nominal = 1.2,", "nominal = -1.2,"),
    ("[supports]", "[support]"),
)


def bad_drawings() -> Iterator[Case]:
    """Yield rotor files that are no rotor, a step each."""
    from rotor_files import CORED

    steps: list[Step] = []
    for old, new in DRAWING_EDITS:
        text = replaced(CORED, old, new)
        steps += [put("rotor.toml", text), "models rotor.toml", "modes rotor.toml"]
    yield Case("bad-drawing/files", tuple(steps))


RESULTS: dict[str, Callable[[dict[str, Any]], object]] = {
    "schema": lambda d: d.update(schema="rotorid-estimate/9"),
    "status": lambda d: d.update(status="perfect"),
    "parameters": lambda d: d.update(parameters={}),
    "value": lambda d: d["parameters"][0].update(value="x"),
    "value-missing": lambda d: d["parameters"][0].pop("value"),
    "name-twice": lambda d: d["parameters"][1].update(name=d["parameters"][0]["name"]),
    "name-other": lambda d: d["parameters"][0].update(name="other"),
    "unit": lambda d: d["parameters"][0].update(unit="furlong"),
    "std": lambda d: d["parameters"][0].update(std=-1.0),
    "covariance": lambda d: d.update(covariance=[[1.0]]),
    "model": lambda d: d["provenance"].update(model="nothing"),
    "no-model": lambda d: d["provenance"].pop("model"),
    "no-provenance": lambda d: d.pop("provenance"),
    "no-evidence": lambda d: d.pop("evidence"),
    "check": lambda d: d["checks"][0].update(verdict="fine"),
    "more": lambda d: d.update(colour="red"),
    "warnings": lambda d: d.update(warnings="none"),
    "misfit": lambda d: d.update(misfit=[1]),
}
TEXTS = {
    "nothing": "",
    "list": "[]",
    "schema-alone": '{"schema": "rotorid-estimate/2"}',
    "old-schema-alone": '{"schema": "rotorid-estimate/1"}',
    "deep": "[" * 100_000,
    "no-number": '{"schema": NaN}',
}
ON_RESULT = (
    "validate wrong.json run.toml",
    "report wrong.json --out wrong.html --force",
    "modes wrong.json",
    "export wrong.json --to wrong.csv --force",
    "balance wrong.json --plane x,y",
)


def bad_results() -> Iterator[Case]:
    """Yield result files that are none, or were changed: every command that reads one."""
    start = (*_disc(), IDENTIFY)
    for name, change in RESULTS.items():
        yield Case(f"bad-result/{name}", (*start, _changed_result(change), *ON_RESULT))
    steps: list[Step] = list(_disc())
    for text in TEXTS.values():
        steps += [put("wrong.json", text), *ON_RESULT]
    yield Case("bad-result/texts", tuple(steps))
    other = edit("run.toml", lambda text: text.replace('"jeffcott"', '"rigid"'), "wrong.toml")
    yield Case("bad-result/other-model", (*start, other, "validate run.json wrong.toml"))


def _changed_result(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    def act(folder: Path) -> None:
        data = json.loads((folder / "run.json").read_text("utf-8"))
        change(data)
        (folder / "wrong.json").write_text(json.dumps(data), "utf-8")

    return act
