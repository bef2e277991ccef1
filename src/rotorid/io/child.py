"""Reading in a process of its own: some packages end theirs with a damaged file.

Apple's libraries do not bear a fork, and Windows has none: there a file is read where it is asked
for.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import pickle
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import BufferedReader, BufferedWriter
from typing import Any

import numpy as np

from rotorid.core.errors import InputError, ReadError

LEAST, SPEED = 3, 5e6
"""Seconds of the processor that any file may take, and bytes a second beyond: packages read faster
by ten times, and with a damaged file some never end."""

MEMORY, COPIES = 2_000_000_000, 4
"""Bytes that any file may take beyond what this process holds already, and copies of the file."""

FORKS = hasattr(os, "fork") and sys.platform != "darwin"
"""Whether this system makes a process that reads by itself, in milliseconds."""

_ANSWER, _REFUSAL, _END = range(3)  # what is sent: a value, an error, no more


def in_child(work: Callable[..., Any], file: str, *arguments: Any) -> Any:
    """Return what ``work(*arguments)`` returns, run in a child; its `InputError` is raised here."""
    return next(from_child(_once, file, work, arguments))


def _once(work: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterator[Any]:
    yield work(*arguments)


def from_child(work: Callable[..., Iterator[Any]], file: str, *arguments: Any) -> Iterator[Any]:
    """Yield what ``work(*arguments)`` yields in a child, which goes on reading a little ahead.

    A child that ends before its work does, or does not end, is a damaged file.
    """
    if not FORKS:
        yield from work(*arguments)
        return
    receiver, sender = os.pipe()
    with warnings.catch_warnings():  # threads of numerical libraries, which the child leaves alone
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        gc.freeze()  # what the parent holds is neither looked through nor copied
        try:
            os.close(receiver)
            _answer(sender, file, work, arguments)
        finally:  # nothing of the parent's is to be written or tidied here
            os._exit(0)
    os.close(sender)
    try:
        with open(receiver, "rb") as stream:
            while (answer := _received(stream, file))[0] == _ANSWER:
                yield answer[1]
    finally:
        with suppress(ProcessLookupError, ChildProcessError):  # where others see to its end
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
    if answer[0] == _REFUSAL:
        raise answer[1]


def _answer(
    sender: int, file: str, work: Callable[..., Iterator[Any]], arguments: tuple[Any, ...]
) -> None:
    """Send what the work yields, or its `InputError`."""
    if sender != 2:  # as where that is closed
        _silence()
    with open(sender, "wb") as stream:
        try:
            _bound(os.path.getsize(file) if os.path.isfile(file) else 0)
            for answer in work(*arguments):
                _send(stream, (_ANSWER, answer))
            _send(stream, (_END,))
        except BrokenPipeError:  # no more is asked for
            raise
        except InputError as error:
            _send(stream, (_REFUSAL, error))
        except Exception as error:  # an end without an answer would say less
            told = f"{type(error).__name__}: {error}"
            _send(stream, (_REFUSAL, ReadError(told, "a whole file", "export it again")))


def _send(stream: BufferedWriter, answer: tuple[Any, ...]) -> None:
    """Send a value: what its arrays hold goes after it as it lies in memory."""
    arrays: list[memoryview] = []
    head = pickle.dumps(answer, 5, buffer_callback=lambda array: arrays.append(array.raw()))
    pickle.dump((head, [array.nbytes for array in arrays]), stream)
    for array in arrays:
        stream.write(array)
    stream.flush()


def _received(stream: BufferedReader, file: str) -> Any:
    """Return what was sent next."""
    try:
        head, sizes = pickle.load(stream)
        arrays = [np.empty(size, np.uint8) for size in sizes]
        for array in arrays:
            if stream.readinto(array.data) < array.size:
                raise EOFError
        return pickle.loads(head, buffers=arrays)
    except (EOFError, pickle.UnpicklingError):
        raise ReadError(
            "a file that ends the program that reads it, or never lets it end",
            "a file that is whole",
            "export the record again",
            file=file,
        ) from None


def _silence() -> None:
    """Leave no words of this process where the answer's are: libraries write theirs as they end."""
    os.environ["LIBC_FATAL_STDERR_"] = "1"  # or glibc's go to the terminal
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    faulthandler.disable()


def _bound(size: int) -> None:
    """Let the system bound time and memory by the size of a file, and keep no core."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    seconds = LEAST + int(size / SPEED)
    for limit, most in (
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_DATA, _held() + MEMORY + COPIES * size),
    ):
        allowed = resource.getrlimit(limit)[1]
        bound = most if allowed == resource.RLIM_INFINITY else min(most, allowed)
        resource.setrlimit(limit, (bound, bound))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _held() -> int:
    """Return the bytes that this process holds to write in."""
    with open("/proc/self/statm", "rb") as told:
        return int(told.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")
