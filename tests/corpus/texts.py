"""Models, experiments, rigs, results and tables that are text; and files that are none."""

import json
from collections.abc import Callable, Sequence
from functools import partial

import fuzz_files as good
from fuzz_harness import Case

IDENTIFY = ("identify", "experiment.toml", "--json", "out.json")


def named(head: str, more: str = "") -> bytes:
    """Return a model of one coordinate with the equation given."""
    return f"""
title = "one mass"
equations = [{json.dumps(head)}]
coordinates = {{ x = "m" }}
inputs = {{ F = "N" }}
parameters = {{ m = {{ unit = "kg" }}, c = {{ unit = "N s/m" }}, k = {{ unit = "N/m" }} {more}}}
""".encode()


def answered(
    files: dict[str, bytes],
    arguments: Sequence[str] = IDENTIFY,
    codes: tuple[int, ...] = (0, 1, 2),
    outputs: tuple[str, ...] = ("out.json",),
    says: str = "",
) -> Callable[[], Case]:
    return lambda: Case("", tuple(arguments), files, None, outputs, codes, says)


refused = partial(answered, codes=(2,))


def record(**changed: bytes) -> dict[str, bytes]:
    """Return the files of a good record, some of them replaced."""
    files = {"model.toml": good.MODEL, "experiment.toml": good.OF_CSV, "run.csv": good.good_csv()}
    return files | {name.replace("_", "."): content for name, content in changed.items()}


def model(head: str) -> Callable[[], Case]:
    return lambda: Case("", ("models", "model.toml"), {"model.toml": named(head)})


def roots(depth: int) -> str:
    """Return nested roots: each turns the text before it into a new sum."""
    text = "(x+1)"
    for _ in range(depth):
        text = f"({text}^(1/3)+x)"
    return f"m*x'' + c*{text} = F"


EXPRESSIONS = {
    "nested cube roots": roots(16),
    "nested cube roots, many": roots(60),
    "nested square roots": "m*x'' + c*" + "sqrt(x+" * 60 + "1" + ")" * 60 + " = F",
    "sums of high powers of cosines": "m*x'' + "
    + " + ".join(f"c*cos(pi/2)^{n}*x^{n}" for n in range(31, 2, -2))
    + " = F",
    "a power of a power of a decimal": "m*x'' + (1.1^300)^300*c*x' = F",
    "a power of a power of an integer": "m*x'' + ((9^99)^99)^99*c*x' = F",
    "a sum to the power 40": "m*x'' + (x + x' + c + m + k + 1)^40 = F",
    "a product of sums": "m*x'' + " + "*".join(["(x + x' + c + k + 1)"] * 30) + " = F",
    "a root of a negative sum": "m*x'' + c*(x - 5)^(1/3)*(x-6)^(1/5)*(x-7)^(1/7) = F",
    "a power of a thousand digits": f"m*x'' + c*x^{'9' * 1000} = F",
    "a number of five thousand digits": f"m*x'' + {'9' * 5000}*c*x' = F",
    "a number with an exponent of a million": "m*x'' + 1e1000000*c*x' = F",
    "exp of exp of exp": "m*x'' + c*" + "exp(" * 9 + "x" + ")" * 9 + " = F",
    "exp of a large number": "m*x'' + c*exp(exp(exp(10)))*x' = F",
    "zero to the power zero": "m*x'' + c*0^0*x' + k*0^-1*x = F",
    "ten thousand terms": "m*x'' + " + " + ".join(f"{n}*c*x'" for n in range(1, 10001)) + " = F",
    "two thousand different terms": "m*x'' + "
    + " + ".join(f"c*sin({n}*x)" for n in range(1, 2001))
    + " = F",
    "a fraction of huge numbers": "m*x'' + c*x'*" + "/".join(["123456789"] * 300) + " = F",
    "trigonometry to be simplified": "m*x'' + c*"
    + "*".join(f"(sin({n}*x)^2 + cos({n}*x)^2 + tan(x/{n}))" for n in range(1, 12))
    + " = F",
    "a derivative of order fifty": "m*x" + "'" * 50 + " + c*x' = F",
    "fractions of fractions": "m*x'' + c*" + "1/(x+" * 40 + "1" + ")" * 40 + " = F",
    "a lambda": "m*x'' + (lambda: c)()*x' = F",
    "letters of other alphabets": "m*x'' + \u0441*x' = F",  # a Cyrillic c
    "superscripts": "m*x'' + c*x\u00b2 = F",
    "a null": "m*x''\0 + c*x' = F",
}


def rig_with(old: bytes, new: bytes) -> dict[str, bytes]:
    if old not in good.RIG:
        raise ValueError(f"{old!r} is not in the rig")
    return {"model.toml": good.MODEL, "rig.toml": good.RIG.replace(old, new)}


SIMULATE = ("simulate", "rig.toml", "--out", "run.h5")
OF_RIG = ("run.h5", "run.toml")
RIG_FILES = {"model.toml": good.MODEL, "rig.toml": good.RIG}
TITLE = b'title = "a mass held by a magnet"'
HUGE = b"9" * 400
LONG = "n" * 200_000

TABLES = {
    "no rows": "fx,px\n",
    "one row": "fx,px\n1,2\n",
    "words": "fx,px\n" + "a,b\n" * 600,
    "odd names": "__class__,{fx!r},%s%n,\x1b[31m\n" + "1,2,3,4\n" * 600,
    "a very long line": "fx,px\n" + "1," * 5_000_000,
    "a very long name": "f" * 3_000_000 + ",px\n" + "1,2\n" * 600,
    "a hundred thousand columns": ",".join(f"c{i}" for i in range(100_000))
    + "\n"
    + "1," * 99_999
    + "1\n",
    "a preamble without end": "note\n" * 400_000,
    "an open quote": 'fx,px\n"1,2\n' * 600,
    "huge numbers": "fx,px\n" + f"{'9' * 400},1e999\n" * 600,
    "a row of minus signs": "fx,px\n" + "-" * 1_000_000 + ",1\n",
    "a number of a million digits": "fx,px\n" + "1" * 1_000_000 + ",1\n",
    "a clock of nonsense": "t,fx,px\n" + "1e300,1,2\n-1e300,1,2\n" * 60,
    "nulls": "fx,px\n" + "\0" * 100_000,
    "a null in the middle": "fx,px\n" + "1,2\n" * 300 + "\0\0,\0\n1,2\n",
}
ODD_COLUMN = good.good_csv().replace(b"fx", b"\x1b[2Jf\x07x")


def in_model(old: bytes, new: bytes) -> dict[str, bytes]:
    return record(model_toml=good.MODEL.replace(old, new))


def in_experiment(old: bytes, new: bytes) -> dict[str, bytes]:
    return record(experiment_toml=good.OF_CSV.replace(old, new))


def kept(name: str, content: bytes) -> Callable[[], Case]:
    """Return a run that would take the place of a file which no run wrote."""
    return refused({**RIG_FILES, name: content}, SIMULATE, says="--force")


SHOWN = ("models", "model.toml")
TEXT_CASES: dict[str, Callable[[], Case]] = {
    # files that a command must not replace
    "simulate beside an experiment of one's own": kept("run.toml", good.OF_CSV),
    "simulate beside notes": kept("run.toml", b"# mine\n"),
    "simulate over a record of one's own": kept("run.h5", b"\x89HDF\r\n\x1a\nmine"),
    "simulate over its own rig": refused(RIG_FILES, ("simulate", "rig.toml", "--out", "rig.h5")),
    "a draft over an experiment": refused(record(), ("new", "run.csv", "--out", "experiment.toml")),
    # expressions
    **{f"model: {name}": model(text) for name, text in EXPRESSIONS.items()},
    "a hundred thousand parameters": refused(
        {"model.toml": named("m*x'' = F", "," + ",".join(f"p{n} = {{}}" for n in range(10**5)))},
        SHOWN,
    ),
    # tables
    **{f"a table: {name}": refused(record(run_csv=t.encode())) for name, t in TABLES.items()},
    "names of bytes": refused(record(run_csv=b"\xff\xfe\x00\x01,px\n1,2\n" * 50)),
    "half an utf-16": refused(record(run_csv="fx,px\n1,2\n".encode("utf-16")[:-3])),
    "escape sequences in a column": refused(record(run_csv=ODD_COLUMN)),
    "escape sequences in a column, drafted": answered(
        record(run_csv=ODD_COLUMN), ("new", "run.csv")
    ),
    "text that turns the line round": refused(
        record(run_csv=good.good_csv().replace(b"fx", "\u202e\u2066f".encode()))
    ),
    # names of files
    "a name with a null": refused(in_experiment(b"run.csv", rb"a\u0000b")),
    "an empty name": refused({}, ("identify", "")),
    "an endless record of random bytes": refused({}, ("new", "/dev/urandom")),
    "a terminal for a record": refused({}, ("new", "/dev/tty")),
    # texts that go to a terminal or into a file
    "escape sequences in a title": answered(
        in_model(b"a mass on a damper", rb"\u001b]0;owned\u0007\u001b[2J"), SHOWN, (0, 2)
    ),
    "a title of 200 kB": answered(in_model(b"a mass on a damper", LONG.encode()), SHOWN, (0, 2)),
    "an unknown key of 200 kB": refused({"model.toml": LONG.encode() + b" = 1"}, SHOWN),
    "a unit of 200 kB": refused(in_model(b'"kg"', f'"{LONG}"'.encode())),
    "a unit with an escape sequence": refused(in_model(b'"kg"', rb'"\u001b[2Jkg"')),
    "a unit of forty letters and a dot": refused(
        in_experiment(b'"1 kHz"', b'"0.' + b"h" * 40 + b'1 s"')
    ),
    "a unit of powers": refused(in_model(b'"kg"', b'"kg^9^9^9^9"')),
    "a quantity of powers": refused(in_experiment(b'"1 kHz"', b'"9**9**9**9 kHz"')),
    "lines of keys in a rig's title": answered(
        rig_with(TITLE, rb'title = "a\nmethod = 1\n[channels]\nF = 3"'), SIMULATE, (0, 2), OF_RIG
    ),
    "an escape sequence in a rig's title": answered(
        rig_with(TITLE, rb'title = "\u001b[2J"'), SIMULATE, (0, 2), OF_RIG
    ),
    # numbers of TOML
    "a huge integer for harmonics": refused(in_experiment(b"[1, 2]", b"[" + HUGE + b"]")),
    "huge harmonics": refused(in_experiment(b"[1, 2]", b"[1, 2, 1000000000000]")),
    "a huge nominal": answered(in_model(b"nominal = 2.0", b"nominal = 1" + b"0" * 400)),
    "a nominal without end": answered(in_model(b"nominal = 2.0", b"nominal = inf")),
    "a fixed value that is no number": answered(in_experiment(b'"0 N/m"', b'"nan N/m"')),
    "a sample rate of 1e300": answered(in_experiment(b"1 kHz", b"1e300 kHz")),
    "a sample rate of 1e-300": answered(in_experiment(b"1 kHz", b"1e-300 kHz")),
    "a fundamental of 1e-300": answered(in_experiment(b"50 Hz", b"1e-300 Hz")),
    "a huge seed": refused(RIG_FILES, (*SIMULATE, "--seed", "-1")),
    "a rig of a year": refused(rig_with(b'duration = "0.1 s"', b'duration = "1e9 s"'), SIMULATE),
    "a rig at 1 THz": refused(
        rig_with(b'sample_rate = "1 kHz"', b'sample_rate = "1 THz"'), SIMULATE
    ),
    "a rig of a million harmonics": answered(
        rig_with(b"odd = 3", b"odd = 1000000"), SIMULATE, outputs=OF_RIG
    ),
    "a rig whose encoder has 1e18 lines": answered(
        rig_with(b"lines = 64", b"lines = 1000000000000000000"), SIMULATE, outputs=OF_RIG
    ),
    "a rig of enormous oversampling": answered(
        rig_with(b"oversampling = 2", b"oversampling = 2000000000"), SIMULATE, outputs=OF_RIG
    ),
    "a hundred thousand keys": refused(
        {"model.toml": b"".join(b"k%d = 1\n" % n for n in range(90_000))}, SHOWN
    ),
    "lines that end as Windows ends them": answered(
        {n: c.replace(b"\n", b"\r\n") for n, c in record().items()}, codes=(0,)
    ),
}
