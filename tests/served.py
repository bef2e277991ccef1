"""What a child of a test answers: of few imports, since some are new interpreters."""

import os
import signal
import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rotorid.core.errors import ReadError
from rotorid.io.table import Column, Rate


class Served:
    def values(self):
        told = {"unit": "um", "no": None, "both": [1.5, float("inf")], "names": ["a\n", "\udcff"]}
        arrays = np.zeros((0, 3)), np.float32([[1, 2], [3, np.nan]]), np.array([1 + 2j])
        column = Column(np.arange(4.0), "mm", Rate(100.0))
        return [*arrays, np.array(True), told, column, ReadError("a", "b", "c")]

    def counted(self, count):
        yield from range(count)

    def refused(self):
        raise ReadError("nothing", "numbers", "write some", place="x")

    def failed(self):
        raise KeyError("block")

    def loud(self):
        os.write(2, b"free(): invalid pointer\n")  # as glibc does where a decoder spoilt its heap
        print("a traceback")
        os.kill(os.getpid(), signal.SIGKILL)

    def endless(self):
        while True:
            pass

    def busy(self):
        return sum(range(30_000_000))

    def left(self):
        Path(tempfile.gettempdir(), "left").touch()
        return tempfile.gettempdir()


@contextmanager
def served(file):
    yield Served()
