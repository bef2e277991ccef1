"""Reading in a process of its own: some packages end theirs with a damaged file.

What comes back is text and arrays of numbers, from which the parent builds what a reader returns:
nothing that a file says is run, whatever became of the child. Where a system has no fork, as
Windows, or its libraries do not bear one, as Apple's, the child is a new interpreter.
"""

from __future__ import annotations

import faulthandler
import gc
import json
import os
import pickle
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib import import_module
from io import BufferedWriter
from threading import Timer
from typing import IO, Any

import numpy as np

from rotorid.core.errors import InputError, ReadError

LEAST, SPEED = 3, 5e6
"""Seconds of the processor that any file may take, and bytes a second beyond: packages read faster
by ten times, and with a damaged file some never end."""

PATIENCE = 10
"""Times these seconds that a new interpreter has by the clock."""

MEMORY, COPIES = 2_000_000_000, 4
"""Bytes that any file may take beyond what this process holds already, and copies of the file."""

DESCRIPTORS = 1024
"""Files that may be open at once."""

FORKS = hasattr(os, "fork") and sys.platform != "darwin"
"""Whether this system makes a process that reads by itself, in milliseconds."""

_ANSWER, _REFUSAL, _END = range(3)  # what is sent: a value, an error, no more
_LENGTH = 8  # bytes that say how long the text of an answer is


def in_child(work: Callable[..., Any], file: str, *arguments: Any) -> Any:
    """Return what ``work(*arguments)`` returns, run in a child; its `InputError` is raised here."""
    return next(from_child(_once, file, work, arguments))


def _once(work: Callable[..., Any], arguments: tuple[Any, ...]) -> Iterator[Any]:
    yield work(*arguments)


def from_child(work: Callable[..., Iterator[Any]], file: str, *arguments: Any) -> Iterator[Any]:
    """Yield what ``work(*arguments)`` yields in a child, which goes on reading a little ahead.

    A child that ends before its work does, or does not end, is a damaged file.
    """
    answers, end = (_forked if FORKS else _spawned)(work, file, arguments)
    try:
        with answers as stream:
            while (answer := _received(stream, file))[0] == _ANSWER:
                yield answer[1]
    finally:
        end()
    if answer[0] == _REFUSAL:
        raise answer[1]


Started = tuple[IO[bytes], Callable[[], None]]
"""What a child sends, and how it is ended."""


def _forked(work: Callable[..., Iterator[Any]], file: str, arguments: tuple[Any, ...]) -> Started:
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

    def end() -> None:
        with suppress(ProcessLookupError, ChildProcessError):  # where others see to its end
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)

    return open(receiver, "rb"), end


def _spawned(work: Callable[..., Iterator[Any]], file: str, arguments: tuple[Any, ...]) -> Started:
    """Start an interpreter, which is told its work by this process, and by nobody else."""
    child = subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )
    assert child.stdin is not None
    assert child.stdout is not None
    with suppress(BrokenPipeError), child.stdin as told:
        pickle.dump((file, work, arguments), told)
    late = Timer(PATIENCE * _seconds(_size(file)), child.kill)
    late.daemon = True
    late.start()

    def end() -> None:
        late.cancel()
        child.kill()
        child.wait()

    return child.stdout, end


def _answer(
    sender: int, file: str, work: Callable[..., Iterator[Any]], arguments: tuple[Any, ...]
) -> None:
    """Send what the work yields, or its `InputError`."""
    if sender != 2:  # as where that is closed
        _silence()
    with open(sender, "wb") as stream:
        try:
            _bound(_size(file))
            for answer in work(*arguments):
                _send(stream, (_ANSWER, answer))
            _send(stream, (_END, None))
        except BrokenPipeError:  # no more is asked for
            raise
        except InputError as error:
            _send(stream, (_REFUSAL, error))
        except Exception as error:  # an end without an answer would say less
            told = f"{type(error).__name__}: {error}"
            _send(stream, (_REFUSAL, ReadError(told, "a whole file", "export it again")))


def _send(stream: BufferedWriter, answer: tuple[int, Any]) -> None:
    """Send a value as text: what its arrays hold goes after it as it lies in memory."""
    arrays: list[np.ndarray] = []
    text = json.dumps(_plain(answer, arrays)).encode()
    stream.write(len(text).to_bytes(_LENGTH, "little") + text)
    for array in arrays:
        stream.write(_bytes_of(array))
    stream.flush()


def _plain(value: Any, arrays: list[np.ndarray]) -> Any:
    """Return a value as lists and texts; an array is named by its type and shape."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray):
        arrays.append(np.ascontiguousarray(value))
        return ["array", value.dtype.str, *value.shape]
    if isinstance(value, Mapping):
        return ["dict", *([_plain(k, arrays), _plain(v, arrays)] for k, v in value.items())]
    kind = type(value)
    if isinstance(value, list | tuple | set):
        return [kind.__name__, *(_plain(each, arrays) for each in value)]
    if isinstance(value, InputError):
        parts = value.found, value.expected, value.cure, value.file, value.place
        return ["error", kind.__module__, kind.__name__, *parts]
    if not is_dataclass(value):
        raise TypeError(f"no plain layout of {kind.__name__}")
    held = (_plain(getattr(value, part.name), arrays) for part in fields(value))
    return ["object", kind.__module__, kind.__name__, *held]


def _received(stream: IO[bytes], file: str) -> Any:
    """Return what was sent next."""
    try:
        text = _read(stream, int.from_bytes(_read(stream, _LENGTH), "little"))
        return _built(json.loads(text), stream)
    except Exception:  # whatever became of the child
        raise ReadError(
            "a file that ends the program that reads it, or never lets it end",
            "a file that is whole",
            "export the record again",
            file=file,
        ) from None


def _read(stream: IO[bytes], count: int) -> bytes:
    data = stream.read(count)
    if len(data) < count:
        raise EOFError
    return data


def _built(plain: Any, stream: IO[bytes]) -> Any:
    """Return what a plain layout stands for: classes are those of the readers, and no others."""
    if not isinstance(plain, list):
        return plain
    kind, *parts = plain
    match kind:
        case "array":
            return _array(*parts, stream=stream)
        case "dict":
            return {_built(key, stream): _built(value, stream) for key, value in parts}
        case "list" | "tuple" | "set":
            several = [_built(each, stream) for each in parts]
            return {"list": list, "tuple": tuple, "set": set}[kind](several)
    module, name, *held = parts
    if not module.startswith("rotorid."):
        raise TypeError(f"{module}.{name} from a child")
    found: Any = getattr(import_module(module), name)
    if kind == "error" and issubclass(found, InputError):
        *said, file, place = held
        return found(*said, file=file, place=place)
    if kind == "object" and isinstance(found, type) and is_dataclass(found):
        names = [part.name for part in fields(found)]
        return found(**{n: _built(v, stream) for n, v in zip(names, held, strict=True)})
    raise TypeError(f"{kind} {module}.{name} from a child")


def _array(kind: str, *shape: int, stream: IO[bytes]) -> np.ndarray:
    dtype = np.dtype(kind)
    if dtype.kind not in "biufc":
        raise TypeError(f"an array of {kind} from a child")
    found = np.empty(shape, dtype)
    if stream.readinto(_bytes_of(found)) < found.nbytes:  # type: ignore[attr-defined]
        raise EOFError
    return found


def _bytes_of(array: np.ndarray) -> memoryview:
    return array.reshape(-1).view(np.uint8).data


def _silence() -> None:
    """Leave no words of this process where the answer's are: libraries write theirs as they end."""
    os.environ["LIBC_FATAL_STDERR_"] = "1"  # or glibc's go to the terminal
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    faulthandler.disable()


def _size(file: str) -> int:
    return os.path.getsize(file) if os.path.isfile(file) else 0


def _seconds(size: int) -> int:
    return LEAST + int(size / SPEED)


def _bound(size: int) -> None:
    """Let the system bound what a file of this size may take, and keep no core."""
    try:
        import resource
    except ImportError:  # Windows has no such limits
        return
    room = MEMORY + COPIES * size
    limits = {
        resource.RLIMIT_CPU: _seconds(size),
        resource.RLIMIT_FSIZE: room,
        resource.RLIMIT_NOFILE: DESCRIPTORS,
        resource.RLIMIT_CORE: 0,
    }
    if sys.platform == "linux":  # which counts what is written to, and not what is only reserved
        limits[resource.RLIMIT_DATA] = _held() + room
    for limit, most in limits.items():
        allowed = resource.getrlimit(limit)[1]
        bound = most if allowed == resource.RLIM_INFINITY else min(most, allowed)
        resource.setrlimit(limit, (bound, bound))


def _held() -> int:
    """Return the bytes that this process holds to write in."""
    with open("/proc/self/statm", "rb") as told:
        return int(told.read().split()[5]) * os.sysconf("SC_PAGE_SIZE")


def _main() -> None:
    """Do the work that the parent of a new interpreter tells it."""
    file, work, arguments = pickle.load(sys.stdin.buffer)
    sender = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a library prints is no answer
    _answer(sender, file, work, arguments)


if __name__ == "__main__":
    _main()
