"""Reading in a process of its own: some packages end theirs with a damaged file.

A child opens a file, and answers what it is asked of it by text and arrays of numbers, from which
each side builds what was meant: nothing that a file says is run, whatever became of the child.
Where fork is missing (Windows) or not borne by libraries (Apple), it is a new interpreter.
"""

from __future__ import annotations

import faulthandler
import gc
import json
import logging
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from threading import Timer
from typing import IO, Any
from weakref import finalize

import numpy as np

from rotorid.core.errors import InputError, ReadError

LEAST, SPEED = 3, 5e6
"""Seconds of the processor that reading any file may take, and bytes a second beyond: packages read
faster by ten times, but thousands of data sets of a few numbers, and with a damaged file some never
end."""

PATIENCE = 10
"""Times these seconds that a new interpreter has for an answer by the clock."""
MEMORY, COPIES = 2_000_000_000, 4
"""Bytes that any file may take beyond what this process holds already, and copies of the file."""

DESCRIPTORS = 1024
"""Files that may be open at once."""
FORKS = hasattr(os, "fork") and sys.platform != "darwin"
"""Whether this system makes a process that reads by itself, in milliseconds."""

_ANSWER, _REFUSAL, _END = range(3)  # what is sent: a value, an error, no more
_LENGTH = 8  # bytes that say how long the text of an answer is
_ARRAY, _OBJECT = "\0array", "\0object"  # keys of a table that stands for one

Opener = Callable[[str], AbstractContextManager[Any]]
"""Opens a file, in the child, for an object whose methods answer what is asked."""


class Sandbox:
    """A child that holds a file open; where it ends early, or takes long, the file is damaged."""

    def __init__(self, opener: Opener, file: str, kind: str = "data") -> None:
        from tempfile import TemporaryDirectory

        self.file, scratch = file, TemporaryDirectory()
        start = _forked if FORKS else _spawned
        self._questions, self._answers, end = start(opener, file, kind, scratch.name)
        self._patience = None if FORKS else PATIENCE * _seconds(file)
        self._late = False  # whether its time was up

        def close(streams: tuple[IO[bytes], ...] = (self._answers, self._questions)) -> None:
            end()
            for stream in streams:
                with suppress(OSError):  # a question that the child did not live to hear
                    stream.close()
            scratch.cleanup()

        self._end = end
        self.close = finalize(self, close)
        try:
            list(self._replies())
        except BaseException:
            self.close()
            raise

    def ask(self, method: str, *arguments: Any) -> Any:
        """Return what a method returns, run in the child; its `InputError` is raised here."""
        (answer,) = self.stream(method, *arguments)
        return answer

    def stream(self, method: str, *arguments: Any) -> Iterator[Any]:
        """Yield what a method yields in the child, which goes on reading a little ahead."""
        with suppress(BrokenPipeError):  # it says so itself, or ended
            _send(self._questions, [method, arguments])
        return self._replies()

    def _replies(self) -> Iterator[Any]:
        while (answer := self._reply())[0] == _ANSWER:
            yield answer[1]
        if answer[0] == _REFUSAL:
            try:
                raise answer[1]
            finally:
                del answer  # an error that its own traceback holds would keep this object, too

    def _reply(self) -> Any:
        late = Timer(self._patience, self._give_up) if self._patience else None
        try:
            if late:
                late.start()
            return _received(self._answers)
        except Exception:  # whatever became of the child
            self._late |= self._end() == getattr(signal, "SIGXCPU", None)  # not on Windows
            found, cure = "a file that ends the program that reads it", "export the record again"
            if self._late:
                found = f"a file that takes more than {_seconds(self.file)} s to read"
                cure += ", in parts or with fewer columns"
            raise ReadError(found, "a file that is whole", cure, file=self.file) from None
        finally:
            if late:
                late.cancel()

    def _give_up(self) -> None:
        self._late = True
        self._end()


Started = tuple[IO[bytes], IO[bytes], Callable[[], int]]
"""Where a child is asked, where it answers, and how it is ended, which returns the signal."""


def _forked(opener: Opener, *work: str) -> Started:
    (asked, questions), (answers, sender) = os.pipe(), os.pipe()
    with warnings.catch_warnings():  # threads of numerical libraries, which the child leaves alone
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if not child:
        gc.freeze()  # what the parent holds is neither looked through nor copied
        try:
            os.close(questions)
            os.close(answers)
            _serve(asked, sender, opener, *work)
        finally:  # nothing of the parent's is to be written or tidied here
            os._exit(0)
    os.close(asked)
    os.close(sender)

    def end() -> int:
        with suppress(ProcessLookupError, ChildProcessError):  # where others see to its end
            os.kill(child, signal.SIGKILL)
            return os.WTERMSIG(os.waitpid(child, 0)[1])
        return 0

    return open(questions, "wb"), open(answers, "rb"), end


def _spawned(opener: Opener, *work: str) -> Started:
    """Start an interpreter, which is told its work by this process, and by nobody else."""
    child = subprocess.Popen(
        [sys.executable, "-m", __name__, opener.__module__, opener.__qualname__, *work],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    assert child.stdin is not None
    assert child.stdout is not None

    def end() -> int:
        child.kill()
        return -child.wait()

    return child.stdin, child.stdout, end


def _serve(asked: int, sender: int, opener: Opener, file: str, kind: str, scratch: str) -> None:
    import tempfile

    _silence(asked, sender)
    tempfile.tempdir = scratch  # what packages leave there goes with it
    with open(asked, "rb") as questions, open(sender, "wb") as answers, ExitStack() as held:
        served = None
        with _refusing(answers, file, kind):
            _bound(file)
            served = held.enter_context(opener(file))
        while served is not None:
            method, arguments = _received(questions)
            with _refusing(answers, file, kind):
                found = getattr(served, method)(*arguments)
                for answer in found if isinstance(found, Iterator) else [found]:
                    _send(answers, (_ANSWER, answer))


@contextmanager
def _refusing(answers: IO[bytes], file: str, kind: str) -> Iterator[None]:
    """Send the end of an answer, or an error in one line."""
    try:
        yield
        told: tuple[int, Any] = (_END, None)
    except InputError as error:
        told = _REFUSAL, error.at(file=file)
    except BrokenPipeError:  # no more is asked for
        raise
    except MemoryError:
        told = _REFUSAL, too_large(file)
    except Exception as error:
        told = _REFUSAL, damaged(error, kind, file)
    _send(answers, told)


def damaged(error: Exception, kind: str, file: str) -> ReadError:
    text = str(error).partition("\n")[0][:160] or type(error).__name__
    return ReadError(f"damaged {kind} ({text})", f"whole {kind}", "write it again", file=file)


def too_large(file: str) -> ReadError:
    return ReadError(
        "more samples than memory holds", "a record that fits", "cut the record", file=file
    )


def _send(stream: IO[bytes], value: Any) -> None:
    """Send a value as text: what its arrays hold goes after it as it lies in memory."""
    arrays: list[np.ndarray] = []

    def plain(value: Any) -> Any:
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, np.ndarray):
            arrays.append(np.ascontiguousarray(value))
            return {_ARRAY: [value.dtype.str, *value.shape]}
        return {_OBJECT: [type(value).__module__, type(value).__name__, vars(value)]}

    text = json.dumps(value, default=plain).encode()
    stream.write(len(text).to_bytes(_LENGTH, "little") + text)
    for array in arrays:
        stream.write(_bytes_of(array))
    stream.flush()


def _received(stream: IO[bytes]) -> Any:

    def read(count: int) -> bytes:
        if len(data := stream.read(count)) < count:
            raise EOFError
        return data

    text = read(int.from_bytes(read(_LENGTH), "little"))
    return json.loads(text, object_hook=lambda held: _built(held, stream))


def _built(held: dict[str, Any], stream: IO[bytes]) -> Any:
    """Return what a table stands for: classes are those of the readers, and no others."""
    if _ARRAY in held:
        kind, *shape = held[_ARRAY]
        if np.dtype(kind).kind not in "biufc":
            raise TypeError(f"an array of {kind} from a child")
        array = np.empty(shape, kind)
        if stream.readinto(_bytes_of(array)) < array.nbytes:  # type: ignore[attr-defined]
            raise EOFError
        return array
    if _OBJECT not in held:
        return held
    module, name, fields = held[_OBJECT]
    found: Any = getattr(import_module(module), name) if module.startswith("rotorid.") else None
    if not (isinstance(found, type) and (is_dataclass(found) or issubclass(found, InputError))):
        raise TypeError(f"{module}.{name} from a child")
    return found(**fields)


def _bytes_of(array: np.ndarray) -> memoryview:
    return array.reshape(-1).view(np.uint8).data


def _silence(*kept: int) -> None:
    """Leave no words of this process where the answer's are: libraries write theirs as they end."""
    os.environ["LIBC_FATAL_STDERR_"] = "1"  # or glibc's go to the terminal
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in {1, 2} - {*kept}:  # as where that was closed before
        os.dup2(nowhere, stream)
    sys.stdout = sys.stderr = open(nowhere, "w")  # noqa: SIM115 - as long as this process
    logging.disable()
    faulthandler.disable()


def _size(file: str) -> int:
    return os.path.getsize(file) if os.path.isfile(file) else 0


def _seconds(file: str) -> int:
    return LEAST + int(_size(file) / SPEED)


def _bound(file: str) -> None:
    """Let the system bound what a file may take by its size, and keep no core."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    room = MEMORY + COPIES * _size(file)
    limits = {
        resource.RLIMIT_CPU: _seconds(file),
        resource.RLIMIT_FSIZE: room,
        resource.RLIMIT_NOFILE: DESCRIPTORS,
        resource.RLIMIT_CORE: 0,
    }
    if sys.platform == "linux":  # which counts what is written to, and not what is only reserved
        held = int(Path("/proc/self/statm").read_text().split()[5]) * os.sysconf("SC_PAGE_SIZE")
        limits[resource.RLIMIT_DATA] = held + room
    for limit, most in limits.items():
        allowed = resource.getrlimit(limit)[1]
        bound = most if allowed == resource.RLIM_INFINITY else min(most, allowed)
        # a second more lets the signal tell that the time was up
        resource.setrlimit(limit, (bound, bound + (limit == resource.RLIMIT_CPU and bound == most)))


if __name__ == "__main__":  # a new interpreter, which its parent tells its work
    _, module, name, *work = sys.argv
    _serve(os.dup(0), os.dup(1), getattr(import_module(module), name), *work)
