"""Damaged files of every format through the command line: see `fuzz_run.py` and `fuzz_harness.py`.

Where one of these fails, it prints the seed and the number of the file that did it, and
`python tests/fuzz_run.py --seed SEED --only FORMAT:NUMBER` runs that one again.
"""

import itertools
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import FrameType

import fuzz_harness as harness
import h5py
import numpy as np
import pytest
from commit import SEED, seed_of_commit
from corpus import CASES
from corpus.texts import named
from fuzz_files import FORMATS
from fuzz_harness import SECONDS, Case, faults_of, run_cases, too_slow
from fuzz_mutations import reworded
from fuzz_run import builds_of, findings
from hypothesis import given, settings
from hypothesis import strategies as st
from model_text import model_of

from rotorid import (
    Batch,
    Channel,
    InputError,
    LeastSquares,
    Record,
    Sequential,
    average,
    parse_model,
)
from rotorid.testing import open_table

TEXTS = [name for name, one in FORMATS.items() if one.damage is reworded]
GROUPS = (TEXTS, [name for name in FORMATS if name not in TEXTS])


@pytest.fixture(scope="module")
def packages():
    for package in ("pyarrow", "nptdms", "pyuff", "asammdf"):
        pytest.importorskip(package)


# A thousand files, 100 of each kind that is read by itself: 20 are the same in every run, so that a
# run says what a change did; the others are the commit's own, so that the search goes on. Formats
# that are read by one piece of code share them: see `Format.share`. What one file in thirty does is
# found with 97 %, one in a hundred by four commits. What those find was there before, more often
# than not: it is a fault all the same, and the seed that is printed finds it again.
@pytest.mark.slow
@pytest.mark.parametrize("formats", GROUPS, ids=["texts", "others"])
def test_damaged_files_of_each_format(formats, packages):
    own = seed_of_commit()
    builds = builds_of(formats, SEED, range(20)) + builds_of(formats, own, range(20, 100))
    found = findings(formats, builds)
    assert not found, f"--seed {SEED}, and {own} from number 20 on\n{found}"


@pytest.fixture(scope="module")
def corpus(request, packages):
    """What came of every case of the corpus that is a test of this run."""
    tests = [item for item in request.session.items if item.name.startswith("test_corpus[")]
    names = [item.callspec.params["name"] for item in tests]
    builds = [lambda name=name: replace(CASES[name](), name=name) for name in names]
    return {outcome.name: outcome for outcome in run_cases(builds)}


LONG = ("mat: version 4, a million empty matrices",)  # for all the seconds that reading has
NAMES = [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in CASES]


@pytest.mark.sampled(24)
@pytest.mark.parametrize("name", NAMES)
def test_corpus(name, corpus):
    assert not corpus[name].faults, corpus[name]


CASE = Case("one", ("models",))
GOOD = "rotorid: run.csv: found nothing; expected numbers; write some\n"


@pytest.mark.parametrize(
    ("code", "out", "told", "fault"),
    [
        (4, "", "", "exit 4"),
        (None, "", "Traceback (most recent call last)", "exit None"),
        (0, "", "Traceback (most recent call last)", "Traceback"),
        (1, "", "rotorid: internal error, KeyError: 1\n", "internal error"),
        (2, "", "", "0 lines"),
        (2, "", GOOD * 2, "2 lines"),
        (2, "", "rotorid: " + "a" * 600 + "\n", "610 characters"),
        (0, "\x1b[31m", "", "prints '\\x1b'"),
        (0, "", "RuntimeWarning: overflow\n", "something else"),
    ],
)
def test_what_is_said_is_judged(code, out, told, fault):
    assert any(found.startswith(fault) for found in faults_of(CASE, code, out, told))
    assert not faults_of(CASE, 2, "", GOOD)


def in_a_child(work: Callable[[], object]) -> None:
    if not (child := os.fork()):
        work()
        os._exit(0)
    os.waitpid(child, 0)


def outcomes(*cases: Case) -> list[tuple[str, ...]]:
    builds = [lambda case=case: case for case in cases]
    return [tuple(o.faults) for o in run_cases(builds)]


@pytest.mark.slow
def test_what_is_done_is_judged(monkeypatch):
    """A harness that finds nothing must find what there is: a signal, a hang, memory, files."""
    monkeypatch.setattr(harness, "SECONDS", 0.05)
    monkeypatch.setattr(harness, "PATIENCE", 10.0)
    monkeypatch.setattr(harness, "BYTES", 40_000_000)
    monkeypatch.setattr(harness, "LOADED", ())

    endless = '{"status": "ok", "parameters": [{"value": NaN}]}'
    # The system keeps the largest of all children: what weighs comes before what is only slow.
    bad: dict[str, Callable[[], object]] = {
        "signal": lambda: os.kill(os.getpid(), 11),
        "hang": lambda: os.read(os.pipe()[0], 1),
        "slow": lambda: sum(range(10_000_000)),
        "memory": lambda: bytearray(b"a") * (2 * harness.BYTES),
        "memory of a child": lambda: in_a_child(lambda: bytearray(b"a") * (4 * harness.BYTES)),
        "slow child": lambda: in_a_child(lambda: sum(range(10_000_000))),
        "file": lambda: Path("left.part").write_text("half"),
        "change": lambda: Path("model.toml").write_text("gone"),
        "nan": lambda: Path("out.json").write_text(endless),
        "nothing": lambda: None,
    }

    def badly(arguments: list[str]) -> int:
        bad[arguments[0]]()
        return 0

    monkeypatch.setattr("rotorid.cli.run", badly)
    files = {"model.toml": b"title"}
    found = outcomes(*(Case(w, (w,), files, outputs=("out.json",)) for w in bad))
    told = dict(zip(bad, found, strict=True))
    assert told["signal"] == ("SIGSEGV",)
    assert told["hang"] == ("hangs",)
    assert told["slow"][0].endswith(" s")
    assert told["memory"][-1].endswith(" GB")
    assert told["slow child"][0].endswith(" s")
    assert told["memory of a child"][-1].endswith(" GB")
    assert told["file"] == ("changed left.part",)
    assert told["change"] == ("changed model.toml",)
    assert told["nan"] == ("ok with NaN",)
    assert told["nothing"] == ()
    monkeypatch.setattr(harness, "REFERENCE", 1e-6)  # on a machine that is slow itself
    assert outcomes(Case("slow", ("slow",), files)) == [()]


# Hypothesis against what has misled or hung: nested roots, layouts of HDF5.


@contextmanager
def in_time() -> Iterator[None]:
    """Raise where more of the processor is taken than a command may."""

    started = time.process_time()

    def late(_: int, __: FrameType | None) -> None:
        taken = time.process_time() - started
        if too_slow(taken):
            raise TimeoutError(f"more than {taken:.1f} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS, SECONDS / 5)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


# Terms whose expansion, simplification or digits grow faster than their text.
ATOMS = st.sampled_from(["x", "x'", "c", "k", "(x+1)", "(c-k)", "2", "3", "1.1", "pi", "Omega"])
POWERS = st.sampled_from(["2", "3", "7", "31", "300", "-1", "0.5", "(1/3)", "(2/7)", "-2.5"])


def grown(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Return roots, powers, sums and functions of a term."""
    root = st.tuples(inner, POWERS, ATOMS).map("({0[0]}^{0[1]}+{0[2]})".format)
    power = st.tuples(inner, POWERS).map("({0[0]})^{0[1]}".format)
    fraction = st.tuples(ATOMS, inner).map("{0[0]}/(1+{0[1]})".format)
    names = st.sampled_from(["sqrt", "cos", "exp", "abs", "tan", "tanh"])
    call = st.tuples(names, inner).map("{0[0]}({0[1]})".format)
    product = st.tuples(inner, inner).map("({0[0]}*({0[1]}))".format)
    return root | power | fraction | call | product


TERMS = st.recursive(ATOMS, grown, max_leaves=30)


@pytest.mark.slow
@settings(max_examples=40)
@given(TERMS, st.integers(1, 12))
def test_nested_roots_and_powers_are_read_or_refused_in_time(term, repeats):
    nested = term
    for _ in range(repeats):
        nested = nested.replace("x+1", f"({term})^(1/3)+x", 1)[:4000]
    for text in (term, nested):
        with in_time(), suppress(InputError):
            str(parse_model(named(f"m*x'' + c*{text} = F")))


VALUES = np.random.default_rng(5).standard_normal(240)


@st.composite
def layouts(draw: st.DrawFn) -> dict[str, object]:
    """Draw how the samples lie in their file."""
    return {
        "kind": draw(st.sampled_from(["plain", "chunked", "virtual", "external", "linked"])),
        "dtype": draw(st.sampled_from([">f8", "<f8", "f4", "f2", "i2", ">i4"])),
        "chunk": draw(st.integers(1, 300)),
        "filters": draw(
            st.sampled_from([{}, {"compression": "gzip"}, {"shuffle": True, "fletcher32": True}])
        ),
        "libver": draw(st.sampled_from(["earliest", "latest"])),
        "shape": draw(st.sampled_from(["1", "row", "column"])),
        "written": draw(st.sampled_from([240, 240, 240, 239, 1, 0])),
        "parts": draw(st.integers(1, 5)),
        "missing": draw(st.sampled_from([None, None, 0, 1])),
        "fill": draw(st.sampled_from([0.0, 1.0, float("nan")])),
        "rows": draw(st.integers(1, 260)),
    }


def shaped(values: np.ndarray, shape: str) -> np.ndarray:
    return {"1": values, "row": values[None, :], "column": values[:, None]}[shape]


def lay(path: Path, layout: dict) -> tuple[np.ndarray, bool]:
    """Write samples as drawn; return what they are, and whether all of them are there."""
    kind, count = layout["kind"], layout["written"]
    values = (VALUES * 100).astype(layout["dtype"])
    with h5py.File(path, "w", libver=layout["libver"]) as data:
        if kind == "plain":
            data["a/x"] = shaped(values, layout["shape"])
            return values, True
        if kind == "chunked":
            made = data.create_dataset(
                "x", (240,), layout["dtype"], chunks=(min(layout["chunk"], 240),),
                fillvalue=layout["fill"] if values.dtype.kind == "f" else 0, **layout["filters"],
            )  # fmt: skip
            if count:
                made[:count] = values[:count]
            # A chunk that was begun is whole to the file: what was not set in it cannot be told.
            begun = -(-count // made.chunks[0]) * made.chunks[0]
            full = np.concatenate([values[:count], np.full(240 - count, made.fillvalue)])
            return full.astype(values.dtype), begun >= 240
        if kind == "external":
            path.with_name("raw.bin").write_bytes(values[:count].tobytes())
            place = [("raw.bin", 0, h5py.h5f.UNLIMITED)]
            data.create_dataset("x", (240,), layout["dtype"], external=place)
            return values, False
        if kind == "linked":
            with h5py.File(path.with_name("other.h5"), "w") as other:
                other["deep/x"] = values
            data["x"] = h5py.ExternalLink("other.h5", "deep/x")
            return values, True
        bounds = np.linspace(0, 240, layout["parts"] + 1).astype(int)
        virtual = h5py.VirtualLayout((240,), layout["dtype"])
        for part, (begin, end) in enumerate(itertools.pairwise(bounds)):
            if part != layout["missing"]:
                with h5py.File(path.with_name(f"part{part}.h5"), "w") as source:
                    source["x"] = values[begin:end]
            virtual[begin:end] = h5py.VirtualSource(f"part{part}.h5", "x", (end - begin,))
        data.create_virtual_dataset("x", virtual, fillvalue=0)
    return values, layout["missing"] is None or layout["missing"] >= layout["parts"]


@pytest.mark.slow
@settings(max_examples=60)
@given(layouts())
def test_samples_are_read_as_they_are_or_not_at_all(layout):
    """However an HDF5 file holds them: a gap is never read as a number."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        values, whole = lay(path, layout)
        try:
            table = open_table(path)
            name = table.find("x")
            read = table.read([name])[name].values
            blocks = [part[name].values for part in table.blocks([name], layout["rows"])]
        except InputError:
            return  # of what is not whole, and of what this reader does not follow
        # A gap of NaN is told with the first such sample, when the record is made.
        assert whole or np.isnan(read).any(), "a gap was read as samples"
        np.testing.assert_array_equal(read, values.astype(float))
        np.testing.assert_array_equal(np.concatenate(blocks), values.astype(float))


# Equations at random, from their text to an estimate: an answer, or an `InputError`.


SYMBOLS = st.sampled_from(
    ["x", "x'", "x''", "y", "y'", "y''", *"abcabc", "2", "0.5", "pi", "Omega", "phi", "t", "1e-3"]
)


def larger(inner):
    pair = st.tuples(inner, st.sampled_from("+-***/"), inner).map("({0[0]} {0[1]} {0[2]})".format)
    names = st.sampled_from(["sin", "cos", "tan", "exp", "sqrt", "abs", "sign", "tanh"])
    call = st.tuples(names, inner).map("{0[0]}({0[1]})".format)
    powers = st.sampled_from(["2", "3", "-1", "0.5", "(1/3)"])
    return pair | call | st.tuples(inner, powers).map("{0[0]}^{0[1]}".format)


SUMS = st.lists(st.recursive(SYMBOLS, larger, max_leaves=6), min_size=1, max_size=4).map(" + ".join)
RIGHT = st.sampled_from(["F", "0", "2*F", "b*F", "F - G"])
EQUATIONS = st.lists(
    st.tuples(SUMS, RIGHT).map("{0[0]} + a*x'' = {0[1]}".format), min_size=1, max_size=2
)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(EQUATIONS, st.integers(0, 2), st.integers(0, 100))
def test_an_answer_or_an_input_error(equations, turns, seed):
    units = [dict.fromkeys("xy", "m"), dict.fromkeys("FG", "N"), dict.fromkeys("abc", "kg")]
    try:
        model = model_of(equations, *units)
    except InputError:
        return
    assert model.unit_faults is not None
    assert model.linear is None or model.linear.rows == len(equations)
    names = [*model.inputs, *model.coordinates]
    samples = np.random.default_rng(seed).standard_normal((60, len(names)))
    record = Record([Channel(n) for n in names], samples, 200.0, 2 * np.pi * 10 * turns)
    periodic = average(record, period_samples=20, harmonics=[0, 1, 2, 3])
    for method in (LeastSquares, Batch, Sequential):
        try:
            estimate = method().estimate(model, [periodic])
        except InputError:
            continue
        assert estimate.status in ("ok", "rejected", "not_identifiable")
        assert str(estimate)
