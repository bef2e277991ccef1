"""How far long work is: said where it is done, shown by whoever watches, in a context as a log."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Event, Thread
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Watch(Protocol):
    """Told what is being done, how much of it is done already, and the best found so far.

    Told nothing, ``say = ""``, but the steps that what was told last has taken, it goes on.
    """

    def __call__(self, say: str, done: int = 0, of: int | None = None, best: str = "") -> None:
        """Take what is being done; `of` is None where nobody knows how much there is."""


def silent(say: str, done: int = 0, of: int | None = None, best: str = "") -> None:
    """Tell nobody."""


_WATCH: ContextVar[Watch] = ContextVar("watch", default=silent)


@contextmanager
def watched(by: Watch) -> Iterator[None]:
    token = _WATCH.set(by)
    try:
        yield
    finally:
        _WATCH.reset(token)


def watch(say: str, done: int = 0, of: int | None = None, best: str = "") -> None:
    """Tell the watch of this context what is being done, and how far it is."""
    _WATCH.get()(say, done, of, best)


def counting(items: Sequence[Item], say: str) -> Iterator[Item]:
    for number, item in enumerate(items):
        watch(say, number, len(items) if len(items) > 1 else None)
        yield item


POLLED = 0.2
"""Seconds after which compiled work is looked at again."""


@contextmanager
def polled(say: str, done: Callable[[], int], of: int) -> Iterator[None]:
    """Tell how far compiled work is, which tells nothing itself, by what it has done so far."""
    tell, ended = _WATCH.get(), Event()

    def poll() -> None:
        while not ended.wait(POLLED):
            tell(say, done(), of)

    tell(say, 0, of)
    thread = Thread(target=poll, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


MINUTES = 99.5
"""Seconds from which on what is left is told in minutes."""


def words(say: str, done: int, of: int | None, left: float | None) -> str:
    """Return what is being done, how far it is, and how long it still takes.

    >>> words("trying possible mistakes", 12, 40, 19.7)
    'trying possible mistakes, 12 of 40, about 20 s left'
    >>> words("reading", 0, None, 99.0), words("reading", 0, None, 100.0)
    ('reading, about 99 s left', 'reading, about 2 min left')
    """
    count = f", {done} of {of}" if of else ""
    if left is None:
        return say + count
    time_left = f"{left:.0f} s" if left < MINUTES else f"{left / 60:.0f} min"
    return f"{say}{count}, about {time_left} left"


class Pace:
    """How long a stage of work still takes, by what was done of it so far."""

    def __init__(self) -> None:
        self._stage: tuple[str, int | None, float, int] = ("", None, 0.0, 0)

    def left(self, say: str, done: int, of: int | None) -> float | None:
        """Return the seconds that are left of a stage; None where nothing tells."""
        now = time.monotonic()
        if (say, of) != self._stage[:2]:
            self._stage = (say, of, now, done)
        _, _, since, before = self._stage
        if of is None or done <= before:
            return None
        return (now - since) / (done - before) * max(0, of - done)
