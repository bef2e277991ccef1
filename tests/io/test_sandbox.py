"""A child that reads: its answers, its refusals, and its end."""

import io
import os
import pickle
import signal
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

import rotorid as rid
from rotorid.io import open_table, sandbox
from rotorid.io.sandbox import Sandbox
from rotorid.io.table import Column, Rate


class Served:
    def values(self):
        told = {"unit": "um", 3: None, "both": [1.5, float("inf")], "names": ["a\n", "\udcff"]}
        arrays = np.zeros((0, 3)), np.float32([[1, 2], [3, np.nan]]), np.array([1 + 2j])
        column = Column(np.arange(4.0), "mm", Rate(100.0))
        return [*arrays, np.array(True), told, column, rid.ReadError("a", "b", "c")]

    def counted(self, count):
        yield from range(count)

    def refused(self):
        raise rid.ReadError("nothing", "numbers", "write some", place="x")

    def failed(self):
        raise KeyError("block")

    def ended(self):
        os.kill(os.getpid(), signal.SIGKILL)

    def loud(self):
        os.write(2, b"free(): invalid pointer\n")  # as glibc does where a decoder spoilt its heap
        print("a traceback")
        self.ended()

    def endless(self):
        while True:
            pass

    def busy(self):
        return sum(range(30_000_000))

    def left(self):
        import tempfile

        Path(tempfile.gettempdir(), "left").touch()
        return tempfile.gettempdir()


@contextmanager
def served(file):
    yield Served()


@contextmanager
def not_opened(file):
    raise OSError("no such block")
    yield


@pytest.fixture(params=[pytest.param(True, id="forked"), pytest.param(False, id="spawned")])
def child(request, monkeypatch):
    """Both ways to a child: that of systems that cannot fork works on any."""
    if request.param and not sandbox.FORKS:
        pytest.skip("this system makes no process by itself")
    monkeypatch.setattr(sandbox, "FORKS", request.param)
    return Sandbox(served, "run.mf4", "MDF data")


def test_a_child_answers_what_it_is_asked(child):
    *arrays, told, column, error = child.ask("values")
    *sent, as_told, _, _ = Served().values()
    for found, expected in zip(arrays, sent, strict=True):
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    assert told == as_told
    assert (column.unit, column.rate, column.values.tolist()) == ("mm", Rate(100.0), [0, 1, 2, 3])
    assert str(error) == "found a; expected b; c"
    assert type(error) is rid.ReadError
    for _ in range(2):  # an error is not the end of a child
        with pytest.raises(rid.ReadError, match=r"run\.mf4: x: found nothing; expected numbers"):
            child.ask("refused")
        with pytest.raises(rid.ReadError, match=r"run\.mf4: found damaged MDF data \('block'\)"):
            child.ask("failed")
        assert list(child.stream("counted", 3)) == [0, 1, 2]


@pytest.mark.parametrize("method", ["ended", "loud"])
def test_a_child_that_ends_is_a_damaged_file(method, child, capfd):
    for _ in range(2):
        with pytest.raises(rid.ReadError, match=r"run\.mf4: found a file that ends the program"):
            child.ask(method)
    assert capfd.readouterr() == ("", "")


def test_a_file_that_does_not_open():
    with pytest.raises(rid.ReadError, match=r"run\.h5: found damaged HDF5 data \(no such block\)"):
        Sandbox(not_opened, "run.h5", "HDF5 data")


def test_nothing_is_left_of_a_child(child):
    folder = child.ask("left")
    assert Path(folder, "left").exists()
    child.close()
    assert not Path(folder).exists()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["endless", "busy"])
def test_a_file_has_so_many_seconds_for_all_that_is_asked(method, monkeypatch):
    monkeypatch.setattr(sandbox, "LEAST", 1)
    child = Sandbox(served, "run.mf4")
    answers = (child.ask(method) for _ in range(50))
    with pytest.raises(rid.ReadError, match="or never lets it end"):
        list(answers)


def test_a_file_is_read_by_a_new_interpreter(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["x"] = np.arange(5.0)
        data["x"].attrs["units"] = "um"
    monkeypatch.setattr(sandbox, "FORKS", False)
    found = open_table(tmp_path / "run.h5").read(["x"])["x"]
    assert (found.unit, found.values.tolist()) == ("um", [0, 1, 2, 3, 4])


def framed(text, after=b""):
    return io.BytesIO(len(text).to_bytes(8, "little") + text + after)


@pytest.mark.parametrize(
    "answer",
    [
        framed(pickle.dumps((0, 1))),
        framed(b'["list", 0, ["object", "subprocess", "Popen", "touch RAN"]]'),
        framed(b'["list", 0, ["object", "rotorid.io.sandbox", "open", "x"]]'),
        framed(b'["list", 0, ["error", "rotorid.cli", "main", "", "", "", "", ""]]'),
        framed(b'["list", 0, ["array", "O", 1]]', b"12345678"),
        framed(b'["list", 0, ["array", "<f8", 2]]', b"12345678"),
        framed(b'["list", 0, ["array", "<f8", 100000000000000]]'),
        framed(b'["list", 0, ["array", "<f8", -1]]'),
        io.BytesIO(b"\xff" * 8),
    ],
)
def test_what_a_child_sends_runs_nothing(answer, monkeypatch):
    """Damaged files may make anything of the process that reads them."""
    child = Sandbox(served, "run.mf4")
    monkeypatch.setattr(child, "_answers", answer)
    with pytest.raises(rid.ReadError, match="a file that ends the program"):
        child.ask("values")
