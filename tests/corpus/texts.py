"""Models, experiments, rigs, results and tables that are text; and files that are none."""

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import fuzz_files as good
from fuzz_harness import Case

IDENTIFY = ("identify", "experiment.toml", "--json", "out.json")
LEAST_SQUARES = (*IDENTIFY, "--method", "ls")
RECORD = b"""file = "run.csv"
sample_rate = "1 kHz"
fundamental = "50 Hz"
harmonics = [1, 2]
"""


def named(head: str, *, title: str = "one mass", more: str = "") -> bytes:
    """Return a model of one coordinate with the equation given."""
    return f"""
title = {json.dumps(title)}
equations = [{json.dumps(head)}]
coordinates = {{ x = "m" }}
inputs = {{ F = "N" }}
parameters = {{ m = {{ unit = "kg" }}, c = {{ unit = "N s/m" }}, k = {{ unit = "N/m" }} {more}}}
""".encode()


def refused(
    files: dict[str, bytes],
    arguments: Sequence[str] = IDENTIFY,
    says: str = "",
    prepare: Callable[[Path], object] | None = None,
) -> Callable[[], Case]:
    """Return what makes a case that must be refused."""
    return lambda: Case(
        "", tuple(arguments), files, prepare, outputs=("out.json",), codes=(2,), says=says
    )


def answered(
    files: dict[str, bytes],
    arguments: Sequence[str] = IDENTIFY,
    codes: tuple[int, ...] = (0, 1, 2),
    check: Callable[[dict[str, Any]], str] | None = None,
    outputs: tuple[str, ...] = ("out.json",),
    prepare: Callable[[Path], object] | None = None,
) -> Callable[[], Case]:
    """Return what makes a case that may be answered, with one of these exit codes."""
    return lambda: Case("", tuple(arguments), files, prepare, outputs, codes, check=check)


def record(**changed: bytes) -> dict[str, bytes]:
    """Return the files of a good record, some of them replaced."""
    files = {
        "model.toml": good.MODEL,
        "experiment.toml": good.OF_CSV,
        "run.csv": good.good_csv(),
    }
    return files | {name.replace("_", "."): content for name, content in changed.items()}


def model(head: str, **options: str) -> Callable[[], Case]:
    """Return what makes a case of an equation: shown, or refused."""
    return lambda: Case("", ("models", "model.toml"), {"model.toml": named(head, **options)})


def scaled(factor: float) -> dict[str, bytes]:
    """Return a record whose samples are all multiplied by a factor."""
    fx, px = (values * factor for values, _ in good.columns().values())
    rows = [f"{a!r},{b!r}" for a, b in zip(fx.tolist(), px.tolist(), strict=True)]
    return record(run_csv="\n".join(["fx [N],px [um]", *rows, ""]).encode())


def told_twice(result: dict[str, Any]) -> str:
    """Say what is wrong where a record that is listed twice is taken for two."""
    told = " ".join(result["warnings"])
    return "" if "twice" in told or "same" in told else "the same data twice, and ok"


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
    "a tower of powers": "m*x'' + c*9^9^9^9*x' = F",
    "a sum to the power 40": "m*x'' + (x + x' + c + m + k + 1)^40 = F",
    "a product of sums": "m*x'' + " + "*".join(["(x + x' + c + k + 1)"] * 30) + " = F",
    "a root of a negative sum": "m*x'' + c*(x - 5)^(1/3)*(x-6)^(1/5)*(x-7)^(1/7) = F",
    "a power of a thousand digits": f"m*x'' + c*x^{'9' * 1000} = F",
    "a number of five thousand digits": f"m*x'' + {'9' * 5000}*c*x' = F",
    "a number with an exponent of a million": "m*x'' + 1e1000000*c*x' = F",
    "exp of exp of exp": "m*x'' + c*" + "exp(" * 9 + "x" + ")" * 9 + " = F",
    "exp of a large number": "m*x'' + c*exp(exp(exp(10)))*x' = F",
    "a division by zero": "m*x'' + c*x'/(1 - 1) = F",
    "zero to the power zero": "m*x'' + c*0^0*x' + k*0^-1*x = F",
    "a thousand brackets": "m*x'' + " + "(" * 1000 + "c" + ")" * 1000 + "*x' = F",
    "a thousand signs": "m*x'' + " + "-" * 1000 + "c*x' = F",
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
    "names of Python": "m*x'' + __import__('os').system('true')*c = F",
    "a lambda": "m*x'' + (lambda: c)()*x' = F",
    "letters of other alphabets": "m*x'' + \u0441*x' = F",  # a Cyrillic c
    "superscripts": "m*x'' + c*x\u00b2 = F",
    "a null": "m*x''\0 + c*x' = F",
}


def fifo(name: str, keep: dict[str, bytes], arguments: Sequence[str]) -> Callable[[], Case]:
    """Return a case with a pipe, to which nobody writes, in place of a file."""
    return refused(keep, arguments, prepare=lambda folder: os.mkfifo(folder / name))


def linked(name: str, target: str) -> Callable[[Path], object]:
    """Return what puts a symbolic link in place of a file."""

    def link(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(target)

    return link


def rig_with(old: bytes, new: bytes) -> dict[str, bytes]:
    """Return a rig with one thing changed."""
    if old not in good.RIG:
        raise ValueError(f"{old!r} is not in the rig")
    return {"model.toml": good.MODEL, "rig.toml": good.RIG.replace(old, new)}


SIMULATE = ("simulate", "rig.toml", "--out", "run.h5")
OF_RIG = ("run.h5", "run.toml")
RIG_FILES = {"model.toml": good.MODEL, "rig.toml": good.RIG}
TITLE = b'title = "a mass held by a magnet"'
HUGE = b"9" * 400
SAMPLES = RECORD.decode()


def several(count: int, *, channels: bytes = b"") -> bytes:
    """Return an experiment that lists one file many times."""
    begin, end = good.OF_CSV.split(b"[[records]]")[0], good.OF_CSV.split(b"[channels]")[1]
    return begin + (b"[[records]]\n" + RECORD) * count + b"[channels]\n" + channels + end


def of_hundred() -> dict[str, bytes]:
    """Return a model of a hundred coordinates, all of which read one column."""
    names = [f"x{n}" for n in range(100)]
    equations = [f"m*{n}'' + c*{n}' = F" for n in names]
    text = f'title = "a hundred"\nequations = {json.dumps(equations)}\n[coordinates]\n'
    text += "".join(f'{n} = "m"\n' for n in names) + '[inputs]\nF = "N"\n[parameters]\n'
    text += 'm = { unit = "kg", nominal = 2.0 }\nc = { unit = "N s/m", nominal = 300.0 }\n'
    channels = "".join(f'{n} = {{ column = "px", unit = "um" }}\n' for n in names)
    told = 'model = "model.toml"\n[[records]]\n' + SAMPLES + "[channels]\n" + channels
    told += 'F = { column = "fx", unit = "N" }\n'
    return record(model_toml=text.encode(), experiment_toml=told.encode())


def escaped_title() -> bytes:
    return good.MODEL.replace(b"a mass on a damper", rb"\u001b]0;owned\u0007\u001b[2J")


LONG = "n" * 200_000
RESULT = good.FORMATS["result"].good
EXPORT = ("export", "result.json", "--to", "out.json.csv")
VALIDATE = ("validate", "result.json", "experiment.toml", "--json", "out.json")


def result_with(change: Callable[[dict[str, Any]], object]) -> Callable[[], Case]:
    """Return a case of a result that was changed, to be validated."""

    def make() -> Case:
        result = json.loads(RESULT()[0])
        change(result)
        files = record(result_json=json.dumps(result).encode())
        return Case("", VALIDATE, files, outputs=("out.json",))

    return make


TEXT_CASES: dict[str, Callable[[], Case]] = {
    # files that a command must not replace
    "simulate beside an experiment of one's own": refused(
        {**RIG_FILES, "run.toml": good.OF_CSV}, SIMULATE, "--force"
    ),
    "simulate beside notes": refused({**RIG_FILES, "run.toml": b"# mine\n"}, SIMULATE, "--force"),
    "simulate over a record of one's own": refused(
        {**RIG_FILES, "run.h5": b"\x89HDF\r\n\x1a\nmine"}, SIMULATE, "--force"
    ),
    "simulate over its own rig": refused(RIG_FILES, ("simulate", "rig.toml", "--out", "rig.h5")),
    "a result over its record": refused(
        record(), ("identify", "experiment.toml", "--json", "run.csv")
    ),
    "a result over its model": refused(
        record(), ("identify", "experiment.toml", "--json", "model.toml")
    ),
    "a draft over an experiment": refused(record(), ("new", "run.csv", "--out", "experiment.toml")),
    "a report over notes": refused(
        record(**{"notes_html": b"mine"}),
        ("identify", "experiment.toml", "--report", "model.toml"),
    ),
    # the same data twice
    "a record listed 200 times": answered(
        record(experiment_toml=several(200)), LEAST_SQUARES, check=told_twice
    ),
    "a record listed twice": answered(record(experiment_toml=several(2)), check=told_twice),
    "a column for a hundred coordinates": refused(of_hundred(), says="'px' for x0"),
    # numbers beyond what squares hold
    **{
        f"samples of 1e{power}": answered(scaled(10.0**power), arguments)
        for power in (-320, -162, -100, 100, 155, 200, 300)
        for arguments in (IDENTIFY,)
    },
    "samples of 1e-162, least squares": answered(scaled(1e-162), LEAST_SQUARES),
    "samples of 1e160, least squares": answered(scaled(1e160), LEAST_SQUARES),
    "samples of 1e160, inspected": answered(
        scaled(1e160), ("inspect", "experiment.toml", "--json", "out.json")
    ),
    # expressions
    **{f"model: {name}": model(text) for name, text in EXPRESSIONS.items()},
    "a hundred thousand parameters": refused(
        {
            "model.toml": named(
                "m*x'' = F", more="," + ",".join(f"p{n} = {{}}" for n in range(10**5))
            )
        },
        ("models", "model.toml"),
    ),
    # tables
    "a header of brackets": refused(record(run_csv=b' ("' * 66_000 + b"\n1,2\n3,4\n")),
    "a header of open units": refused(record(run_csv=b"fx [" * 50_000 + b"\n1,2\n3,4\n")),
    "a header of blanks": refused(record(run_csv=b"fx" + b" " * 500_000 + b",px\n1,2\n")),
    "a preamble of brackets": refused(
        record(run_csv=(b"( [" * 10_000 + b"\n") * 40 + b"fx,px\n1,2\n")
    ),
    "a row of minus signs": refused(record(run_csv=b"fx,px\n" + b"-" * 1_000_000 + b",1\n")),
    "a number of a million digits": refused(
        record(run_csv=b"fx,px\n" + b"1" * 1_000_000 + b",1\n")
    ),
    "a clock of nonsense": refused(record(run_csv=b"t,fx,px\n" + b"1e300,1,2\n-1e300,1,2\n" * 60)),
    "nulls in a table": refused(record(run_csv=b"fx,px\n" + b"\0" * 100_000)),
    "escape sequences in a column": refused(
        record(run_csv=good.good_csv().replace(b"fx", b"\x1b[2Jf\x07x"))
    ),
    "escape sequences in a column, drafted": answered(
        record(run_csv=good.good_csv().replace(b"fx", b"\x1b[2Jf\x07x")), ("new", "run.csv")
    ),
    "a column name of 200 kB": refused(
        record(run_csv=good.good_csv().replace(b"fx", LONG.encode()))
    ),
    "text that turns the line round": refused(
        record(run_csv=good.good_csv().replace(b"fx", "\u202e\u2066f".encode()))
    ),
    # pipes, devices, links
    "a pipe for a model": fifo("model.toml", {"experiment.toml": good.OF_CSV}, IDENTIFY),
    "a pipe for a model, shown": fifo("model.toml", {}, ("models", "model.toml")),
    "a pipe for an experiment": fifo("experiment.toml", {}, IDENTIFY),
    "a pipe for an experiment, inspected": fifo(
        "experiment.toml", {}, ("inspect", "experiment.toml")
    ),
    "a pipe for a rig": fifo("rig.toml", {}, SIMULATE),
    "a pipe for a result": fifo("result.json", {}, ("report", "result.json")),
    "a pipe for a result, exported": fifo("result.json", {}, EXPORT),
    "a pipe for a record": fifo(
        "run.csv", {"model.toml": good.MODEL, "experiment.toml": good.OF_CSV}, IDENTIFY
    ),
    "a pipe for a record, drafted": fifo("run.csv", {}, ("new", "run.csv")),
    "an endless result": refused(record(), ("validate", "/dev/zero", "experiment.toml")),
    "an endless result, exported": refused({}, ("export", "/dev/zero", "--to", "out.csv")),
    "an endless experiment": refused({}, ("identify", "/dev/zero")),
    "an endless model": refused({}, ("models", "/dev/zero")),
    "an endless record": refused(
        record(experiment_toml=good.OF_CSV.replace(b"run.csv", b"/dev/zero"))
    ),
    "an endless record of random bytes": refused({}, ("new", "/dev/urandom")),
    "a terminal for a record": refused({}, ("new", "/dev/tty")),
    "a folder for a record": refused({}, ("new", ".")),
    "a folder for an experiment": refused({}, ("identify", ".")),
    "a model that links to itself": refused(record(), prepare=linked("model.toml", "model.toml")),
    "a record that links to itself": refused(record(), prepare=linked("run.csv", "run.csv")),
    "an experiment that links to itself": refused(
        record(), prepare=linked("experiment.toml", "experiment.toml")
    ),
    "an output that links to itself": refused(record(), prepare=linked("out.json", "out.json")),
    "a record that links to a device": refused(record(), prepare=linked("run.csv", "/dev/zero")),
    "a name with a null": refused(
        record(experiment_toml=good.OF_CSV.replace(b"run.csv", rb"a\u0000b"))
    ),
    "a name of a million characters": refused({}, ("identify", "a" * 100_000)),
    "an escape sequence for a name": refused({}, ("identify", "\x1b[2J\x07.toml")),
    "a name that is no UTF-8": refused({}, ("identify", "\udcff\udcfe.toml")),
    "an empty name": refused({}, ("identify", "")),
    # texts that go to a terminal or into a file
    "escape sequences in a title": answered(
        {"model.toml": escaped_title()}, ("models", "model.toml"), (0, 2)
    ),
    "a title of 200 kB": answered(
        {"model.toml": good.MODEL.replace(b"a mass on a damper", LONG.encode())},
        ("models", "model.toml"),
        (0, 2),
    ),
    "an unknown key of 200 kB": refused(
        {"model.toml": LONG.encode() + b" = 1"}, ("models", "model.toml")
    ),
    "a unit of 200 kB": refused(
        record(model_toml=good.MODEL.replace(b'"kg"', f'"{LONG}"'.encode()))
    ),
    "a unit with an escape sequence": refused(
        record(model_toml=good.MODEL.replace(b'"kg"', rb'"\u001b[2Jkg"'))
    ),
    "a unit of forty letters and a dot": refused(
        record(experiment_toml=good.OF_CSV.replace(b'"1 kHz"', b'"0.' + b"h" * 40 + b'1 s"'))
    ),
    "a unit of powers": refused(record(model_toml=good.MODEL.replace(b'"kg"', b'"kg^9^9^9^9"'))),
    "a quantity of powers": refused(
        record(experiment_toml=good.OF_CSV.replace(b'"1 kHz"', b'"9**9**9**9 kHz"'))
    ),
    "lines of keys in a rig's title": answered(
        rig_with(TITLE, rb'title = "a\nmethod = 1\n[channels]\nF = 3"'),
        SIMULATE,
        (0, 2),
        outputs=OF_RIG,
    ),
    "an escape sequence in a rig's title": answered(
        rig_with(TITLE, rb'title = "\u001b[2J"'), SIMULATE, (0, 2), outputs=OF_RIG
    ),
    # numbers of TOML and JSON
    "a huge integer for harmonics": refused(
        record(experiment_toml=good.OF_CSV.replace(b"[1, 2]", b"[" + HUGE + b"]"))
    ),
    "huge harmonics": refused(
        record(experiment_toml=good.OF_CSV.replace(b"[1, 2]", b"[1, 2, 1000000000000]"))
    ),
    "a huge nominal": answered(
        record(model_toml=good.MODEL.replace(b"nominal = 2.0", b"nominal = 1" + b"0" * 400))
    ),
    "a nominal without end": answered(
        record(model_toml=good.MODEL.replace(b"nominal = 2.0", b"nominal = inf"))
    ),
    "a fixed value that is no number": answered(
        record(experiment_toml=good.OF_CSV.replace(b'"0 N/m"', b'"nan N/m"'))
    ),
    "a sample rate of 1e300": answered(
        record(experiment_toml=good.OF_CSV.replace(b"1 kHz", b"1e300 kHz"))
    ),
    "a sample rate of 1e-300": answered(
        record(experiment_toml=good.OF_CSV.replace(b"1 kHz", b"1e-300 kHz"))
    ),
    "a fundamental of 1e-300": answered(
        record(experiment_toml=good.OF_CSV.replace(b"50 Hz", b"1e-300 Hz"))
    ),
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
    "lists in lists of TOML": refused(
        {"model.toml": b"a = " + b"[" * 50_000}, ("models", "model.toml")
    ),
    "a hundred thousand keys": refused(
        {"model.toml": b"".join(b"k%d = 1\n" % n for n in range(90_000))}, ("models", "model.toml")
    ),
    "lists in lists of JSON": refused(record(result_json=b"[" * 100_000), VALIDATE),
    "a result with a huge integer": result_with(lambda r: r["parameters"][0].update(value=10**400)),
    "a result of infinity": result_with(lambda r: r["parameters"][0].update(value=1e999)),
    "a result whose covariance is no matrix": result_with(
        lambda r: r.update(covariance=[[1.0], []])
    ),
    "a result of negative variance": result_with(
        lambda r: r.update(covariance=[[-1.0, 0.0], [0.0, -1.0]])
    ),
    "a result without parameters": result_with(lambda r: r.update(parameters=[], covariance=[])),
    "a result of another model": result_with(lambda r: r.update(model="../../etc/passwd")),
    # marks that are no fault
    "a byte-order mark in all TOML": answered(
        record(
            model_toml=b"\xef\xbb\xbf" + good.MODEL, experiment_toml=b"\xef\xbb\xbf" + good.OF_CSV
        ),
        codes=(0,),
    ),
    "a byte-order mark in a table": answered(
        record(run_csv=b"\xef\xbb\xbf" + good.good_csv()), codes=(0,)
    ),
    "a byte-order mark in a result": lambda: Case(
        "",
        VALIDATE,
        record(result_json=b"\xef\xbb\xbf" + RESULT()[0]),
        outputs=("out.json",),
        codes=(0,),
    ),
    "lines that end as Windows ends them": answered(
        {n: c.replace(b"\n", b"\r\n") for n, c in record().items()}, codes=(0,)
    ),
}
