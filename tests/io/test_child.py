"""A child that reads: its answer, its refusals, and its end."""

import os
import signal

import pytest

import rotorid as rid
from rotorid.io import child
from rotorid.io.child import in_child


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


def test_a_child_answers():
    assert in_child(sorted, "run.mf4", [3, 1, 2]) == [1, 2, 3]


@pytest.mark.parametrize(
    ("work", "told"),
    [
        (refused, "run.mf4: x: found nothing; expected numbers; write some"),
        (failed, "KeyError: 'block'"),
        (ended, "run.mf4: found a file that ends the program that reads it"),
        (loud, "run.mf4: found a file that ends the program that reads it"),
    ],
)
def test_a_child_that_does_not_is_told(work, told, capfd):
    with pytest.raises(rid.ReadError, match=told):
        in_child(work, "run.mf4")
    assert capfd.readouterr().err == ""
