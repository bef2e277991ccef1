"""Who follows a search: is told what it does and how far it is, and may end it.

A search goes through many layers, and each may have something to tell: the watch belongs to the
context, like a log, and not to every call on the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol


class Watch(Protocol):
    """Told what a search does, and once per step of a descent; may raise `Interrupted`."""

    def __call__(self, stage: str, done: int = 0, of: int | None = None) -> None:
        """Take what is being tried and how far it is; an empty stage is a step of the last one."""


class Interrupted(KeyboardInterrupt):
    """Asks a search for the best so far.

    No `Exception`: a descent passes over some of these, and goes on elsewhere.
    """


def silent(stage: str, done: int = 0, of: int | None = None) -> None:
    """Tell nobody."""


_WATCH: ContextVar[Watch] = ContextVar("watch", default=silent)


@contextmanager
def watched(by: Watch) -> Iterator[None]:
    """Let a watch follow what is searched meanwhile."""
    token = _WATCH.set(by)
    try:
        yield
    finally:
        _WATCH.reset(token)


def watch(stage: str = "", done: int = 0, of: int | None = None) -> None:
    """Tell the watch of this context; without a stage that a descent has taken a step."""
    _WATCH.get()(stage, done, of)
