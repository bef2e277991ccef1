"""What may stand on a screen, in a message or in a generated file: printable, and not too long.

Titles, columns, file names and keys of TOML come from files that others wrote. They may hold
escape sequences that a terminal obeys, newlines that begin a new key of a file, marks that turn
the direction of writing, and any length.
"""

from __future__ import annotations

LINE = 590  # characters of a message: what is read as one line, and below what a log cuts
PART = 240  # of one part of it, so that a long one leaves room for the others
CELL = 300  # of a cell of a table: longer than any honest name or finding
SENTENCE = 4_000  # of a sentence between tables: a warning may list fifty names
_GAP = " ... "


def printable(text: str, *, keep: str = "") -> str:
    r"""Return a text with everything that is not printable written as Python writes it.

    Parameters
    ----------
    text : str
    keep : str
        Characters to leave as they are, such as newlines.

    Returns
    -------
    str

    Examples
    --------
    >>> print(printable("a\x1b[2Jb\nc"))
    a\x1b[2Jb\nc
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in keep else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


def shortened(text: str, most: int) -> str:
    """Return a text of at most `most` characters: its beginning and its end.

    Examples
    --------
    >>> shortened("abcdefghijklmnopqrstuvwxyz", 15)
    'abcde ... vwxyz'
    """
    if len(text) <= most:
        return text
    end = (most - len(_GAP)) // 2
    return text[: most - len(_GAP) - end] + _GAP + text[len(text) - end :]


def one_line(text: str, most: int = PART) -> str:
    """Return a text as one printable line, white space as single blanks, cut to `most`."""
    # What is far too long is cut first: escaping it all would take its time.
    return shortened(printable(" ".join(shortened(text, 8 * most).split())), most)
