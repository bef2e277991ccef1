"""Reading in a process of its own: some packages end theirs with a damaged file."""

from __future__ import annotations

import multiprocessing
import os
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from rotorid.errors import InputError, ReadError

LEAST, SPEED = 5, 5e6
"""Seconds of the processor that any file may take, and bytes a second beyond: packages read faster
by ten times, and with a damaged file some never end."""


def in_child(work: Callable[..., Any], file: str, *arguments: Any) -> Any:
    """Return what ``work(*arguments)`` returns, run in a child; its `InputError` is raised here.

    Raises
    ------
    ReadError
        Where the child ends without an answer, or does not end.
    """
    kinds = multiprocessing.get_all_start_methods()
    context: Any = multiprocessing.get_context("fork" if "fork" in kinds else "spawn")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_answer, args=(sender, file, work, arguments), daemon=True)
    with warnings.catch_warnings():  # threads of numerical libraries, which the child leaves alone
        warnings.simplefilter("ignore", DeprecationWarning)
        child.start()
    sender.close()
    try:
        kind, answer = receiver.recv()
    except EOFError:
        raise ReadError(
            "a file that ends the program that reads it, or never lets it end",
            "a file that is whole",
            "export the record again",
            file=file,
        ) from None
    finally:
        receiver.close()
        child.join()
    if kind is None:
        return answer
    raise kind(*answer[:3], file=answer[3], place=answer[4])


def _answer(
    sender: Connection, file: str, work: Callable[..., Any], arguments: tuple[Any, ...]
) -> None:
    """Send what the work returns, or the parts of its `InputError`."""
    _silence()
    try:
        _bound(LEAST + int(os.path.getsize(file) / SPEED) if os.path.isfile(file) else LEAST)
        sender.send((None, work(*arguments)))
    except InputError as error:
        parts = (error.found, error.expected, error.cure, error.file, error.place)
        sender.send((type(error), parts))
    except Exception as error:  # an end without an answer would print its traceback
        parts = (f"{type(error).__name__}: {error}", "a whole file", "export it again", "", "")
        sender.send((ReadError, parts))


def _silence() -> None:
    """Leave no words of this process where the answer's are: libraries write theirs as they end."""
    os.environ["LIBC_FATAL_STDERR_"] = "1"  # or glibc's go to the terminal
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def _bound(seconds: int) -> None:
    """Let the system end this process after so many seconds of the processor, and keep no core."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
