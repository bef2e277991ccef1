"""Values: frozen, equal by content, their arrays read-only."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Sequence
from contextlib import suppress
from dataclasses import fields
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen as frozen
from rotorid.core.frozen import same as same
from rotorid.core.tables import Page, page_html, page_text, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


Array = NDArray[Any]
Key = TypeVar("Key", bound=Hashable)
Member = TypeVar("Member")
Arguments = ParamSpec("Arguments")
Kind = TypeVar("Kind")
Found = TypeVar("Found")


def grouped(pairs: Iterable[tuple[Key, Member]]) -> dict[Key, list[Member]]:
    """Return the members of each key, both in the order of the pairs."""
    found: dict[Key, list[Member]] = {}
    for key, member in pairs:
        found.setdefault(key, []).append(member)
    return found


def fact(
    work: Callable[Concatenate[Kind, Arguments], Found],
) -> Callable[Concatenate[Kind, Arguments], Found]:
    """Keep what a function finds of a value there, for its last arguments: many ask."""
    name = f"{work.__module__}.{work.__qualname__}"

    @wraps(work)
    def found(value: Kind, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Found:
        asked = args, kwargs
        kept = vars(value).get(name)  # once: another thread may ask something else meanwhile
        if kept is None or kept[0] != asked:
            kept = vars(value)[name] = asked, work(value, *args, **kwargs)
        answer: Found = kept[1]
        return answer

    return found


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


class Arrays:
    """A base of frozen dataclasses that hold measured arrays: read-only, and brief to look at."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            value = vars(self).get(each.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, each.name, read_only(value))

    def __repr__(self) -> str:
        """Return the fields, arrays by their shape, names for channels: what fits a screen."""
        told = (f"{f.name}={_brief(getattr(self, f.name))}" for f in fields(self) if f.repr)  # type: ignore[arg-type]
        return f"{type(self).__name__}({', '.join(told)})"

    @property
    def page(self) -> Page:
        """What there is to read: sentences and tables, here the fields."""
        rows = [(f.name, _brief(getattr(self, f.name))) for f in fields(self) if f.repr]  # type: ignore[arg-type]
        return [table((type(self).__name__, "holds"), rows)]

    def _repr_html_(self) -> str:
        return page_html(self.page)


class Shown(Arrays):
    """A base of what shows itself: text and HTML come from its page, pictures from its panels."""

    @abstractmethod
    def _drawn(self) -> tuple[Sequence[Any], str]:
        """Return the panels and their title."""

    def __str__(self) -> str:
        return page_text(self.page)

    def _repr_html_(self) -> str:
        with suppress(ImportError, InputError):
            from rotorid.report.figure import image_of  # takes its time to load

            return super()._repr_html_() + image_of(*self._drawn())
        return super()._repr_html_()

    def plot(self) -> Figure:
        """Draw it: samples over time, lines and noise of periods, or what a result says.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; ``savefig("name.png")`` writes it.

        Raises
        ------
        InputError
            Where there is nothing to draw, such as an estimate without covariance.
        ImportError
            Where matplotlib is not installed.
        """
        from rotorid.report.figure import figure_of  # takes its time to load

        return figure_of(self._drawn()[0])


class Result(Shown):
    """A base of what is made of an estimate; its report says how each is told and drawn."""

    @property
    def page(self) -> Page:
        from rotorid.report.machines import RESULTS  # takes its time to load

        return RESULTS[type(self)][0](self)

    def _drawn(self) -> tuple[Sequence[Any], str]:
        from rotorid.report.machines import RESULTS

        return RESULTS[type(self)][1](self), type(self).__name__


def import_pandas() -> Any:
    """Return pandas, which few need."""
    try:
        import pandas
    except ImportError:
        raise ImportError("no pandas for a data frame; install it: pip install pandas") from None
    return pandas


LONGEST = 80
"""Characters of a field in a brief text."""


def _brief(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"<{'x'.join(map(str, value.shape)) or 'one'} {value.dtype}>"
    if isinstance(value, tuple) and value and all(hasattr(v, "name") for v in value):
        value = tuple(v.name for v in value)
    elif isinstance(value, tuple) and len(value) > 3:
        return f"<{len(value)} of {type(value[0]).__name__}>"
    text = repr(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
