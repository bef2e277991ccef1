"""Property tests draw the same examples in every run; of many cases some are fast tests."""

import fcntl
import gc
import os
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from commit import part_of
from hypothesis import settings

# Otherwise each worker, and each child that a test starts, would compile the package anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


def pytest_collection_finish() -> None:
    """Leave what was collected alone: thousands of tests are not looked through at every turn."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        _compile_once()
    gc.collect()
    gc.freeze()


def _compile_once() -> None:
    """Let one of several workers compile the loop of a rig, and the others read what it made."""
    from rotorid import load_rig

    with Path(__file__).open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        load_rig("three-mass").rig.run(1e-3, np.random.default_rng(0))


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a module's tests, in which they work."""
    monkeypatch.chdir(folder)
    return folder


def _printed(capsys: pytest.CaptureFixture[str], arguments: tuple, code: int) -> tuple[str, str]:
    from rotorid import cli

    capsys.readouterr()
    assert cli.run([*map(str, arguments)]) == code, arguments
    return capsys.readouterr()


@pytest.fixture
def output(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command that gives an answer, silent on stderr, and return what it prints."""

    def run(*arguments: object, code: int = 0) -> str:
        out, err = _printed(capsys, arguments, code)
        assert err == ""
        return out

    return run


@pytest.fixture
def refusal(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command that is refused: nothing is printed but the line that it returns."""

    def run(*arguments: object, code: int = 2) -> str:
        out, err = _printed(capsys, arguments, code)
        assert out == ""
        (line,) = err.splitlines()
        assert line.startswith("rotorid: ")
        assert line.isprintable()
        assert "Traceback" not in line
        assert len(line) < 600
        return line

    return run


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of the cases of a test marked ``sampled(count)`` leave so many fast, spread over all.

    With ``parts`` a commit runs one part of the others, an equal share of them.
    """
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled"):
            cases[item.nodeid.partition("[")[0]].append(item)
    left_out = set[pytest.Item]()
    for found in cases.values():
        mark = found[0].get_closest_marker("sampled")
        count = min(mark.args[0], len(found))
        kept = {k * len(found) // count for k in range(count)}
        slow = [item for number, item in enumerate(found) if number not in kept]
        for item in slow:
            item.add_marker(pytest.mark.slow)
        left_out |= {*slow} - {*part_of(slow, mark.kwargs.get("parts", 1))}
    if left_out:
        items[0].config.hook.pytest_deselected(items=[*left_out])
        items[:] = [item for item in items if item not in left_out]
