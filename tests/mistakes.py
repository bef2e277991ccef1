"""Deliberate mistakes in the experiment files of the shipped rigs, and what must name each.

A mistake is an edit of the file that `rotorid simulate` writes. It is named where the first
suspect, one that the first warning tells with it, a check, a warning or the refusal holds one of
its words.
"""

import contextlib
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import combinations
from pathlib import Path

import rotorid as rid
from rotorid import InputError
from rotorid.cli import run

Edit = Callable[[str], str]


def put(old: str, new: str, count: int = -1) -> Edit:

    def edit(text: str) -> str:
        assert old in text, old
        return text.replace(old, new, count)

    return edit


def swap(a: str, b: str) -> Edit:
    names = {a: b, b: a}
    columns = re.compile(rf'(?<=column = ")({a}|{b})(?=")')
    return lambda text: columns.sub(lambda found: names[found[0]], text)


def scale(column: str, factor: float) -> Edit:
    return put(f'column = "{column}"', f'column = "{column}", scale = {factor!r}')


def both(*edits: Edit) -> Edit:
    return lambda text: reduce(lambda told, edit: edit(told), edits, text)


def known(line: str) -> Edit:
    return lambda text: f"{text}\n[parameters]\n{line}\n"


def late(text: str) -> str:
    """Let the currents lag by a tenth of a millisecond more than they do."""
    return re.sub(r'(column = "i_[^}]*?)\}', r'\1, delay = "100 us"}', _without_delays(text))


def _without_delays(text: str) -> str:
    return re.sub(r', delay = "[^"]*"', "", text)


@dataclass(frozen=True)
class Mistake:
    """One mistake: the rig, what was done, and the words one of which must be said."""

    rig: str
    what: str
    edit: Edit
    words: tuple[str, ...]

    def edited(self, folder: Path) -> str:
        """Return the experiment file with the mistake, in a folder with its record."""
        return self.edit(experiment_of(self.rig, folder))


SPEED = '"8400 rpm"'
ODD = "[1, 3, 5, 7, 9, 11]"
XYZ = ("x1", "y1", "x2", "y2", "x3", "y3")
THREE, RIGID = "three-mass", "rigid"


def three(what: str, edit: Edit, *words: str) -> Mistake:
    return Mistake(THREE, what, edit, words)


def rigid(what: str, edit: Edit, *words: str) -> Mistake:
    return Mistake(RIGID, what, edit, words)


BEARINGS = both(swap("x1", "x3"), swap("y1", "y3"))
COILS = both(swap("i_x1", "i_x3"), swap("i_y1", "i_y3"))
ANGLES = swap("theta_x", "theta_y")
NEGATIVE = put('"120 N/A"', '"-120 N/A"')
EVEN = put(ODD, "[2, 4, 6, 8, 10, 12]")
LEVER = put("x - 0.2*theta_y", "x - 0.25*theta_y")
ANGLES_DOWN = both(scale("theta_x", -1), scale("theta_y", -1))
IN_MM = both(*(scale(name, 1e-3) for name in XYZ))
TWICE = put('"10000 Hz"', '"20000 Hz"')
ROTATION = put(ODD, "[1, 3, 5, 9, 11]")
LATE = ("delay[force]", "delay[position]")
MISTAKES = (
    three("columns of x1 and y1 swapped", swap("x1", "y1"), "swap[x1, y1]"),
    three("columns of x1 and x3 swapped", swap("x1", "x3"), "swap[x1, x3]"),
    three("columns of theta_x and theta_y swapped", ANGLES, "swap[theta_x, theta_y]"),
    three("currents x1 and y1 swapped", swap("i_x1", "i_y1"), "swap[F_x1, F_y1]"),
    three("currents x1 and x3 swapped", swap("i_x1", "i_x3"), "swap[F_x1, F_x3]"),
    three("the sensors of the two bearings swapped", BEARINGS, "swap[x1, x3; y1, y3]"),
    three("the currents of the two bearings swapped", COILS, "swap[F_x1, F_x3; F_y1, F_y3]"),
    three("x1 upside down", scale("x1", -1), "sign[x1]"),
    three("x2 upside down", scale("x2", -1), "sign[x2]"),
    three("both angles upside down", ANGLES_DOWN, "sign[theta_x, theta_y]"),
    three("current y1 upside down", scale("i_y1", -1), "sign[F_y1]"),
    three("k_i of all with the wrong sign", NEGATIVE, "sign[F_x1, F_y1, F_x3, F_y3]"),
    three("x1 in mm instead of m", scale("x1", 1e-3), "unit[x1]"),
    three("x3 in mil instead of um", scale("x3", 1 / 25.4), "unit[x3]"),
    three("x1 in mil and upside down", scale("x1", -1 / 25.4), "gain[x1]", "upside down"),
    three("all displacements in mm instead of m", IN_MM, "unit[x1 ... y3]", "unit[force]"),
    three("current x1 in mA instead of A", scale("i_x1", 1e-3), "unit[F_x1]"),
    three("3 % too much gain of x1", scale("x1", 1.03), "gain[x1]"),
    three("rad/s given as rpm", put(SPEED, '"879.645943 rpm"'), "speed"),
    three("Hz given as rpm", put(SPEED, '"140 rpm"'), "speed"),
    three("the rotation backwards", put(SPEED, '"-8400 rpm"'), "speed"),
    three("twice the speed", put(SPEED, '"16800 rpm"'), "speed"),
    three("8410 rpm instead of 8400", put(SPEED, '"8410 rpm"'), "speed"),
    three("no speed", put(f"speed = {SPEED}", ""), "speed"),
    three(
        "twice the sample rate, and the fundamental with it",
        both(TWICE, put('"20 Hz"', '"40 Hz"')),
        "sample_rate",
    ),
    three("twice the sample rate", TWICE, "sample_rate"),
    three("k_i of F_x1 100 N/A", put('"120 N/A"', '"100 N/A"', 1), "gain[F_x1]"),
    three("k_i of all 100 N/A", put('"120 N/A"', '"100 N/A"'), "gain[force]", "ks"),
    three("k_s of all with the wrong sign", put('"200000', '"-200000'), "ks"),
    three("no k_s", put(', ks = "200000 N/m"', ""), "ks"),
    three("the hold left out", put(', hold = "zero-order"', ""), *LATE),
    three("the delay with the wrong sign", put('"-50 us"', '"50 us"'), *LATE),
    three("half the fundamental", put('"20 Hz"', '"10 Hz"'), "period_samples"),
    three("even harmonics instead of odd ones", EVEN, "lines below noise"),
    three("the line of the rotation left out", ROTATION, "xi", "rotation"),
    three("L1 fixed to .33 m", known('L1 = {fixed = "0.33 m"}'), "prior L1"),
    three("m2 fixed to 10 kg", known('m2 = {fixed = "10 kg"}'), "prior m2"),
    three("the force law of x1 at x3", put('position = "x1"', 'position = "x3"'), "position[F_x1]"),
    three("current x1 for x3 too", put('"i_x3"', '"i_x1"'), "copied"),
    three("column x2 for x1 too", put('column = "x1"', 'column = "x2"'), "copied", "x1"),
    rigid("sensors xa and ya swapped", swap("s_xa", "s_ya"), "swap[s_xa, s_ya]"),
    rigid("sensors xa and xb swapped", swap("s_xa", "s_xb"), "swap[s_xa, s_xb]"),
    rigid("currents xa and ya swapped", swap("i_xa", "i_ya"), "swap[F_xa, F_ya]"),
    rigid("sensor xa upside down", scale("s_xa", -1), "sign[s_xa]", "gain[s_xa]"),
    rigid("current xa upside down", scale("i_xa", -1), "sign[F_xa]", "gain[F_xa]"),
    rigid("lever of sensor xa 250 mm, not 200", LEVER, "plane[s_xa]"),
    rigid("512 lines of the encoder", put("lines = 1024", "lines = 512"), "speed"),
    rigid(
        "gap of .4 mm instead of .5",
        put('gap = "0.0005 m"', 'gap = "0.0004 m"'),
        *("gap", "gain[force]", "ks"),
    ),
    rigid("L_a fixed to .25 m", put('fixed = "0.2 m"', 'fixed = "0.25 m"'), "prior L_a"),
    rigid("currents .1 ms late", late, *LATE),
)


# The same rig as a draft has it: the levers of the sensors are parameters.

READ = {"0.2*theta": "L_a*theta", "0.25*theta": "L_b*theta"}
SENSORS = ("s_xa", "s_ya", "s_xb", "s_yb")
CURRENTS = {f"i{name[1:]}": f"F{name[1:]}" for name in SENSORS}
PLANES = (SENSORS[:2], SENSORS[2:])
ALSO = (
    "512 lines of the encoder",
    "gap of .4 mm instead of .5",
    "L_a fixed to .25 m",
    "currents .1 ms late",
)
"""Mistakes of the rigid rig that are made here too: the others are among those of one channel."""


def levers(text: str) -> str:
    """Write the experiment file of the rigid rig with the parameters in what sensors read."""
    for old, new in READ.items():
        text = put(old, new)(text)
    return text


def _in_levers() -> Iterator[Mistake]:
    for names in (SENSORS, tuple(CURRENTS)):
        for a, b in combinations(names, 2):
            told = f"swap[{CURRENTS.get(a, a)}, {CURRENTS.get(b, b)}]"
            yield Mistake(LEVERS, f"{a} and {b} swapped", swap(a, b), (told,))
        for a in names:
            told = CURRENTS.get(a, a)
            yield Mistake(LEVERS, f"{a} upside down", scale(a, -1), (f"sign[{told}]",))
    for a in SENSORS:
        yield Mistake(LEVERS, f"{a} in mil", scale(a, 1 / 25.4), (f"unit[{a}]",))
        yield Mistake(LEVERS, f"{a} in mm", scale(a, 1e-3), (f"unit[{a}]",))
        yield Mistake(LEVERS, f"5 % too much of {a}", scale(a, 1.05), (f"gain[{a}]",))
    xa, ya, xb, yb = SENSORS
    longer = put("x - L_a*theta_y", "x - 1.25*L_a*theta_y")
    yield Mistake(LEVERS, "lever of s_xa 1.25 L_a", longer, ("plane[s_xa]",))
    every = both(*(scale(a, 1e-3) for a in SENSORS))
    yield Mistake(LEVERS, "all sensors in mm", every, ("unit[s_xa ... s_yb]",))
    bearings = both(swap(xa, xb), swap(ya, yb))
    yield Mistake(LEVERS, "the bearings swapped", bearings, ("swap[s_xa, s_xb; s_ya, s_yb]",))
    axes = both(swap(xa, ya), swap(xb, yb))
    yield Mistake(LEVERS, "x and y swapped", axes, ("swap[s_xa, s_ya; s_xb, s_yb]",))
    for plane in PLANES:
        down = both(*(scale(a, -1) for a in plane))
        yield Mistake(LEVERS, f"{plane} upside down", down, (f"sign[{', '.join(plane)}]",))
    # The data cannot tell this from all forces upside down.
    down = both(*(scale(a, -1) for a in SENSORS))
    yield Mistake(LEVERS, "all sensors upside down", down, (f"sign[{', '.join(SENSORS)}]",))
    for mistake in MISTAKES:
        if mistake.rig == RIGID and mistake.what in ALSO:
            yield replace(mistake, rig=LEVERS)


LEVERS = "levers"
MISTAKES_IN_LEVERS = tuple(_in_levers())


BAD = ("warning", "refused")


@dataclass(frozen=True)
class Verdict:
    """What `identify` said of a mistake: what stood first, what named it (empty: nothing), all."""

    mistake: Mistake
    status: str
    first: str
    by: str
    said: Sequence[str] = field(repr=False)

    @property
    def named(self) -> bool:
        return bool(self.by)


def experiment_of(rig: str, folder: Path) -> str:
    """Return the experiment file of a shipped rig, whose record lies in a folder from then on."""
    if rig == LEVERS:
        return levers(experiment_of(RIGID, folder))
    path = folder / f"{rig}.h5"
    if not path.exists():
        with contextlib.redirect_stdout(io.StringIO()):
            assert run(["simulate", rig, "--out", str(path)]) == 0
    return path.with_suffix(".toml").read_text("utf-8")


def judge(mistake: Mistake, folder: Path) -> Verdict:
    """Make a mistake in the experiment file of a rig, in a folder with its record, and identify."""
    path = folder / f"{mistake.rig}-wrong.toml"
    path.write_text(mistake.edited(folder), "utf-8")
    try:
        found = rid.load_experiment(path).identify()
    except InputError as error:
        by = "refusal" if _holds(mistake, [str(error)]) else ""
        return Verdict(mistake, "refused", str(error).split(": ", 1)[-1], by, [str(error)])
    suspects, warnings = found.suspects, found.warnings
    told = {
        "first suspect": [s.term for s in suspects[:1]],
        "told with the first": warnings[:1] if suspects else [],
        "check": [f"{c.about}: {c.found}" for c in found.checks if c.verdict in BAD],
        "warning": warnings[1:] if suspects else warnings,
    }
    first = next(text for texts in told.values() for text in texts)
    by = next((name for name, texts in told.items() if _holds(mistake, texts)), "")
    said = [*found.warnings, *(f"{check.found}; {check.cure}" for check in found.checks)]
    return Verdict(mistake, found.status, first, by, said)


def _holds(mistake: Mistake, texts: Sequence[str]) -> bool:
    """Tell whether one of the words is there: `ks`, but not in `checks`."""
    return any(re.search(rf"(?<!\w){re.escape(w)}(?!\w)", t) for w in mistake.words for t in texts)
