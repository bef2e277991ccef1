"""The sample rate that the lines above a text table state, in the many ways it is written.

What may be read in two ways is not read: then the rate has to be given, which costs a line, while
a rate misread by a factor of a thousand makes masses a million times too large, and nothing shows.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from rotorid.errors import InputError
from rotorid.io.table import Rate
from rotorid.limits import PREAMBLE_CHARACTERS
from rotorid.units import si_factor

SLOWEST = 10.0
"""Hz: no rotor is sampled more slowly, while a rate that lost three digits to a thousands mark is
below it, and so is one made of how long was recorded, or of the hour of the day."""
_HIGHEST = 1e12
# Every part takes all that it can and gives nothing back: the time grows with the line alone.
_VALUE = (
    r"[^\d+\-.\[(]*+(?:[\[(](?P<unit>[^\])]*+)[\])])?[^\d+\-.]*+"
    r"(?P<value>[\d.,]++(?:[eE][+-]?\d++)?)(?P<gap>[\s;,\"]*+)(?P<after>[^\s;,\"]*+)"
)
_RATE = re.compile(
    r"(?:sampl(?:e|ing)[ _-]?(?:rate|freq(?:uency)?)|scan[ _-]?rate)\b" + _VALUE, re.I
)
_STEP = re.compile(
    r"(?:delta_x|sampl(?:e|ing)[ _-]?(?:interval|time|period)|time[ _-]?step)\b" + _VALUE, re.I
)
_GROUPS = r"[1-9]\d{0,2}(?:%s\d{3})+"
_PER_SECOND = re.compile(
    r"(k|m|g)?(?:hz|sa?/s(?:ec)?|sps|samples/s(?:ec(?:ond)?)?)|1/s|s\^-1", re.I
)
_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9}
_SECONDS = {"s": "s", "sec": "s", "ms": "ms", "msec": "ms", "us": "us", "µs": "us", "ns": "ns"}


def stated_rate(lines: Sequence[str], delimiter: str, mark: str) -> Rate | None:
    """Return the sample rate that lines state, if they do so beyond doubt.

    Parameters
    ----------
    lines : sequence of str
        Those before the numbers.
    delimiter : str
        Of the table: lines above it are often written with it too.
    mark : str
        Its decimal mark; empty where all its numbers are whole.
    """
    for line in lines:
        for pattern, unit in ((_RATE, "Hz"), (_STEP, "s")):
            match = pattern.search(line[:PREAMBLE_CHARACTERS])
            found = None if match is None else number(match["value"], delimiter, mark)
            if match is None or found is None:
                continue
            factor = (
                _factor(match["unit"], match["value"] + match["gap"], match["after"], unit) or 0.0
            )
            value, digits = found[0] * factor, found[1]
            if unit == "s":
                value = 1 / value if value > 1 / _HIGHEST else 0.0
            if SLOWEST <= value < _HIGHEST:
                rounding = 0.5 * 10.0 ** (1 - digits) if digits else 0.0
                return Rate(value, max(rounding, 1e-12))
    return None


def number(text: str, delimiter: str, mark: str) -> tuple[float, int] | None:
    """Return a number and how many digits it is rounded to, 0 for a whole one.

    A comma or point before groups of three digits is a decimal mark, or stands between thousands:
    the numbers of the table tell which. None where they do not.
    """
    mantissa, _, exponent = text.lower().strip(".,").partition("e")
    if delimiter == "," and not re.fullmatch(_GROUPS % "," + r"(?:\.\d*)?", mantissa):
        mantissa, comma, _ = mantissa.partition(",")  # what follows is another field
        exponent = "" if comma else exponent
    decimal = max((m for m in ",." if m in mantissa), key=mantissa.rfind, default="")
    if decimal and re.fullmatch(_GROUPS % re.escape(decimal), mantissa):
        several = mantissa.count(decimal) > 1
        known = "." if delimiter == "," else mark
        if not known and decimal == "," and not several:
            return None
        if several or (known and decimal != known):
            decimal = ""  # it stands between thousands
    whole, _, part = mantissa.partition(decimal) if decimal else (mantissa, "", "")
    other = re.sub(r"\d", "", whole)
    if other and not re.fullmatch(_GROUPS % re.escape(other[0]), whole):
        return None
    digits = re.sub(r"\D", "", whole)
    if not re.fullmatch(r"\d*", part) or not digits + part:
        return None
    try:
        value = float(f"{digits}.{part}e{exponent or 0}")
    except ValueError:
        return None
    return value, (len((digits + part).lstrip("0")) or 1) if decimal else 0


def _factor(unit: str | None, before: str, after: str, base: str) -> float | None:
    """Return what turns a number into Hz or s; None for a unit, or a word, that says nothing."""
    # Behind a delimiter stands a field of its own, which may be anything.
    beside = before[-1:].isdigit() or before.endswith(" ")
    for text, sure in ((after, beside), (unit or "", True)):
        if not text:
            continue
        known = _known(text.strip(), base)
        if known is not None:
            return known
        if sure or "/s" in text or "hz" in text.lower():
            return None
    return 1.0


def _known(text: str, base: str) -> float | None:
    """Return the size of a unit of rates, or of times."""
    if base == "Hz":
        match = _PER_SECOND.fullmatch(text)
        return None if match is None else _PREFIXES[(match[1] or "").lower()]
    try:
        return si_factor(_SECONDS.get(text.lower(), text), base)
    except InputError:
        return None
