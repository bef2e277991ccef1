"""Hypothesis against what has misled or hung: nested roots, layouts of HDF5."""

import itertools
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

import h5py
import numpy as np
import pytest
from corpus.texts import named
from fuzz_harness import SECONDS, too_slow
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid import InputError, parse_model
from rotorid.testing import open_table


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


@pytest.mark.parametrize("kind", ["plain", "chunked", "virtual"])
def test_whole_samples_are_read(kind, tmp_path):
    """The property above holds of a reader that refuses all: it must not."""
    layout = {
        "kind": kind, "dtype": "<f8", "chunk": 16, "filters": {"compression": "gzip"},
        "libver": "latest", "shape": "row", "written": 240, "parts": 3, "missing": None,
        "fill": 0.0,
    }  # fmt: skip
    values, whole = lay(tmp_path / "run.h5", layout)
    table = open_table(tmp_path / "run.h5")
    name = table.find("x")
    assert whole
    np.testing.assert_array_equal(table.read([name])[name].values, values)
