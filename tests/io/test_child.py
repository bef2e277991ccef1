"""A child that reads: its answer, its refusals, and its end."""

import io
import os
import pickle
import signal

import h5py
import numpy as np
import pytest

import rotorid as rid
from rotorid.io import child, open_table
from rotorid.io.child import in_child
from rotorid.io.table import Column, Rate


def refused():
    raise rid.ReadError("nothing", "numbers", "write some", file="run.mf4", place="x")


def failed():
    raise KeyError("block")


def ended():
    os.kill(os.getpid(), signal.SIGKILL)


def loud():
    os.write(2, b"free(): invalid pointer\n")  # as glibc does where a decoder spoilt its heap
    ended()


def endless():
    while True:
        pass


@pytest.mark.slow
def test_a_child_that_does_not_end_is_ended(monkeypatch):
    monkeypatch.setattr(child, "LEAST", 1)
    with pytest.raises(rid.ReadError, match="or never lets it end"):
        in_child(endless, "run.mf4")


@pytest.fixture(params=[pytest.param(True, id="forked"), pytest.param(False, id="spawned")])
def way(request, monkeypatch):
    """Both ways to a child: that of systems that cannot fork works on any."""
    if request.param and not child.FORKS:
        pytest.skip("this system makes no process by itself")
    monkeypatch.setattr(child, "FORKS", request.param)


def values():
    arrays = np.zeros((0, 3)), np.float32([[1, 2], [3, np.nan]]), np.array([1 + 2j]), np.array(True)
    told = {"unit": "um", 3: None, "both": (1.5, float("inf")), "names": {"a\n", "\udcff"}}
    return [*arrays, told, Column(np.arange(4.0), "mm", Rate(100.0)), rid.ReadError("a", "b", "c")]


def test_a_child_answers(way):
    *arrays, told, column, error = in_child(values, "run.mf4")
    for found, sent in zip(arrays, values(), strict=False):
        assert found.dtype == sent.dtype
        np.testing.assert_array_equal(found, sent)
    assert told == values()[4]
    assert (column.unit, column.rate, column.values.tolist()) == ("mm", Rate(100.0), [0, 1, 2, 3])
    assert str(error) == "found a; expected b; c"
    assert type(error) is rid.ReadError


def test_a_file_is_read_by_a_new_interpreter(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "run.h5", "w") as data:
        data["x"] = np.arange(5.0)
        data["x"].attrs["units"] = "um"
    monkeypatch.setattr(child, "FORKS", False)
    found = open_table(tmp_path / "run.h5").read(["x"])["x"]
    assert (found.unit, found.values.tolist()) == ("um", [0, 1, 2, 3, 4])


def framed(text, after=b""):
    return io.BytesIO(len(text).to_bytes(8, "little") + text + after)


@pytest.mark.parametrize(
    "answer",
    [
        framed(pickle.dumps((0, 1))),
        framed(b'["tuple", 0, ["object", "subprocess", "Popen", "touch RAN"]]'),
        framed(b'["tuple", 0, ["object", "rotorid.io.child", "open", "x"]]'),
        framed(b'["tuple", 0, ["error", "rotorid.cli", "main", "", "", "", "", ""]]'),
        framed(b'["tuple", 0, ["array", "O", 1]]', b"12345678"),
        framed(b'["tuple", 0, ["array", "<f8", 2]]', b"12345678"),
        framed(b'["tuple", 0, ["array", "<f8", 100000000000000]]'),
        framed(b'["tuple", 0, ["array", "<f8", -1]]'),
        io.BytesIO(b"\xff" * 8),
    ],
)
def test_what_a_child_sends_runs_nothing(answer):
    """Damaged files may make anything of the process that reads them."""
    with pytest.raises(rid.ReadError, match="a file that ends the program"):
        child._received(answer, "run.h5")


@pytest.mark.parametrize(
    ("work", "told"),
    [
        (refused, "run.mf4: x: found nothing; expected numbers; write some"),
        (failed, "KeyError: 'block'"),
        (ended, "run.mf4: found a file that ends the program that reads it"),
        (loud, "run.mf4: found a file that ends the program that reads it"),
    ],
)
def test_a_child_that_does_not_is_told(work, told, way, capfd):
    with pytest.raises(rid.ReadError, match=told):
        in_child(work, "run.mf4")
    assert capfd.readouterr().err == ""
