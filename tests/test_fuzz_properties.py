"""Hypothesis against what has misled or hung: nested roots, layouts of HDF5, scales, copies."""

import itertools
import json
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

import fuzz_files as good
import h5py
import numpy as np
import pytest
from corpus.texts import named
from fuzz_harness import SECONDS
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import rotorid as rid
from rotorid import InputError, parse_model
from rotorid.cli import run
from rotorid.testing import open_table


@contextmanager
def in_time() -> Iterator[None]:
    """Raise where more of the processor is taken than a command may."""

    def late(_: int, __: FrameType | None) -> None:
        raise TimeoutError(f"more than {SECONDS} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
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
    whole = count == 240
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
            raw = path.with_name("raw.bin")
            raw.write_bytes(values[:count].tobytes())
            place = [("raw.bin", 0, h5py.h5f.UNLIMITED)]
            data.create_dataset("x", (240,), layout["dtype"], external=place)
            return values, whole
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


def identified(folder: Path, method: str) -> dict | None:
    """Return the result of the record in a folder; None where it is refused."""
    (folder / "out.json").unlink(missing_ok=True)
    asked = ["identify", str(folder / "experiment.toml"), "--method", method]
    code = run([*asked, "--json", str(folder / "out.json")])
    if not (folder / "out.json").exists():
        assert code == 2
        return None
    return json.loads((folder / "out.json").read_text())


def laid(folder: Path, force: float = 1.0, motion: float = 1.0) -> None:
    """Lay down the good record, its columns multiplied."""
    fx, px = (values for values, _ in good.columns().values())
    rows = [
        f"{a!r},{b!r}" for a, b in zip((fx * force).tolist(), (px * motion).tolist(), strict=True)
    ]
    (folder / "run.csv").write_text("\n".join(["fx,px", *rows, ""]))
    (folder / "model.toml").write_bytes(good.MODEL)
    (folder / "experiment.toml").write_bytes(good.OF_CSV)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.sampled_from(["ls", "ml", "batch"]),
    st.sampled_from([0, 1, -3, 9, -20, 40, -70, 100, -100, 155, -162, 290, -300]),
    st.sampled_from([0, -6, 12, 30, -60, 120, -155, 200, -290]),
)
def test_scaled_data_scale_the_answer(method, force, motion):
    """Or are refused: m = F / x'' whatever the units, and its deviation with it."""
    assume(abs(force - motion) < 300)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        laid(folder)
        plain = identified(folder, method)
        assert plain is not None
        laid(folder, 10.0**force, 10.0**motion)
        scaled = identified(folder, method)
        if scaled is None or scaled["status"] != "ok":
            assert abs(force) + abs(motion) > 30, "ordinary sizes are refused"
            return
    factor = 10.0 ** (force - motion)
    for one, other in zip(plain["parameters"], scaled["parameters"], strict=True):
        assert other["value"] == pytest.approx(one["value"] * factor, rel=1e-4), one["name"]
        if one["std"]:
            assert other["std"] == pytest.approx(one["std"] * factor, rel=1e-3), one["name"]


def spelled(folder: Path, how: str) -> str:
    """Return another name of the record."""
    if how == "link":
        (folder / "again.csv").symlink_to("run.csv")
    elif how == "hard link":
        os.link(folder / "run.csv", folder / "again.csv")
    elif how == "copy":
        (folder / "again.csv").write_bytes((folder / "run.csv").read_bytes())
    elif how == "format":  # the same samples, written by another program
        good.writers.write_hdf5(folder / "again.h5", good.columns())
    names = {"same": "run.csv", "dot": "./run.csv", "way round": f"../{folder.name}/run.csv"}
    return names.get(how, "again.h5" if how == "format" else "again.csv")


HOW = ["same", "dot", "way round", "link", "hard link", "copy", "format"]


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("method", ["ls", "ml"])
def test_a_record_twice_is_noticed(how, method, tmp_path):
    laid(tmp_path)
    text = (tmp_path / "experiment.toml").read_text()
    entry = text.split("[[records]]")[1].split("[channels]")[0]
    again = entry.replace("run.csv", spelled(tmp_path, how))
    (tmp_path / "experiment.toml").write_text(
        text.replace("[channels]", f"[[records]]{again}[channels]")
    )
    found = identified(tmp_path, method)
    told = "" if found is None else " ".join(found["warnings"])
    assert found is None or "twice" in told


def test_two_parts_of_a_record_are_two_measurements(tmp_path):
    laid(tmp_path)
    text = (tmp_path / "experiment.toml").read_text()
    entry = text.split("[[records]]")[1].split("[channels]")[0]
    first, second = entry + 'until = "0.04 s"\n', entry + 'skip = "0.04 s"\n'
    whole = text.replace(entry, first).replace("[channels]", f"[[records]]{second}[channels]")
    (tmp_path / "experiment.toml").write_text(whole)
    found = identified(tmp_path, "ls")
    assert found is not None
    assert found["status"] == "ok"
    assert rid.load_estimate(tmp_path / "out.json").value("m") == pytest.approx(2.0, rel=1e-3)
