"""Texts of equations and expressions, read to a tree by recursive descent.

Nothing is ever evaluated as code. What a text may cost is bounded before it is read: its length and
its nesting; what its tree may cost is for `polynomials` and `symbolic`, which make something of it.

    equation = sum "=" sum
    sum      = product (("+" | "-") product)*
    product  = unary (("*" | "/") unary)*
    unary    = ("+" | "-")* power
    power    = atom (("^" | "**") unary)?
    atom     = number | name | function "(" sum ")" | "(" sum ")"
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Literal, NamedTuple

from rotorid.core.errors import ModelError
from rotorid.models import text_cost

MAX_LENGTH = 100_000
MAX_NESTING = 64
_TOKEN = re.compile(
    r"(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[^\W\d]\w*'{0,2})|(?P<sign>\*\*|[-+*/^()=])"
)
_SPACE = re.compile(r"[ \t\f\r\n]*")


class Node(NamedTuple):
    """A part of an expression: what `kind` says of its `parts`.

    `text` is the number, the name, or the function; for a sum and a product the sign before each
    part, ``+`` and ``*`` before the first.
    """

    kind: Literal["number", "name", "call", "sum", "product", "power", "negative", "equation"]
    text: str
    parts: tuple[Node, ...] = ()


class _Token(NamedTuple):
    kind: str
    text: str
    place: int


def read(text: str, start: Literal["sum", "equation"] = "sum") -> Node:
    """Return the tree of an expression, or of an equation."""
    if len(text) > MAX_LENGTH:
        raise ModelError(
            f"{len(text)} characters", f"{MAX_LENGTH} at most", "split it into several equations"
        )
    return _Reader(text, start).read()


def too_deep() -> ModelError:
    return ModelError(
        f"nesting deeper than {MAX_NESTING}", f"{MAX_NESTING} levels at most", "flatten it"
    )


class _Reader:
    """One text, token by token."""

    def __init__(self, text: str, start: str) -> None:
        self.text, self.start, self.nesting = text, start, 0
        self.last = _Token("end", "", 0)
        self.next = self._token(0)

    def read(self) -> Node:
        found = self.sum()
        if self.start == "equation":
            self.needs("=")
            found = Node("equation", "", (found, self.sum()))
        if self.next.kind != "end":
            raise self.unexpected(self.next)
        return found

    def _token(self, place: int) -> _Token:
        space = _SPACE.match(self.text, place)
        place = space.end() if space else place
        if place == len(self.text):
            return _Token("end", "", self.last.place)
        match = _TOKEN.match(self.text, place)
        if match is None:
            return _Token("none", self.text[place], place)
        return _Token(str(match.lastgroup), match.group(), place)

    def taken(self) -> str:
        text_cost.spend(1)
        self.last = self.next
        self.next = self._token(self.last.place + len(self.last.text))
        return self.last.text

    def accepts(self, *signs: str) -> str:
        """Take the next token where it is one of these signs."""
        return self.taken() if self.next.text in signs else ""

    def needs(self, sign: str) -> None:
        if not self.accepts(sign):
            raise self.unexpected(self.next)

    def sum(self) -> Node:
        return self._several("sum", "+", "-", self.product)

    def product(self) -> Node:
        return self._several("product", "*", "/", self.unary)

    def _several(
        self, kind: Literal["sum", "product"], sign: str, other: str, part: Callable[[], Node]
    ) -> Node:
        parts, signs = [part()], [sign]
        while taken := self.accepts(sign, other):
            signs.append(taken)
            parts.append(part())
        return Node(kind, "".join(signs), tuple(parts)) if len(parts) > 1 else parts[0]

    def unary(self) -> Node:
        minuses = 0
        while sign := self.accepts("+", "-"):
            minuses += sign == "-"
        found = self.power()
        if minuses > MAX_NESTING:
            raise too_deep()
        return Node("negative", "", (found,)) if minuses % 2 else found

    def power(self) -> Node:
        base = self.atom()
        return (
            Node("power", "", (base, self.inner(self.unary))) if self.accepts("^", "**") else base
        )

    def atom(self) -> Node:
        if self.next.kind == "number":
            return Node("number", self.taken())
        if self.next.kind == "name":
            name = self.taken()
            if name.endswith("'") or not self.accepts("("):
                return Node("name", name)
            argument = self.inner(self.sum)
            self.needs(")")
            return Node("call", name, (argument,))
        self.needs("(")
        found = self.inner(self.sum)
        self.needs(")")
        return found

    def inner(self, part: Callable[[], Node]) -> Node:
        """Read what stands in parentheses, or above a power."""
        self.nesting += 1
        if self.nesting > MAX_NESTING:
            raise too_deep()
        found = part()
        self.nesting -= 1
        return found

    def unexpected(self, token: _Token) -> ModelError:
        cure = "write a name or a number there, or take out what does not belong"
        if token.kind in ("name", "number") or token.text == "(":
            cure = "write an operator before it: * for a product"
        expected = (
            "an equation: expression = expression" if self.start == "equation" else "an expression"
        )
        return ModelError(
            f"{repr(token.text[:40]) if token.text else 'the end of the text'} "
            f"in {self.text[:60]!r}",
            f"{expected} of names, numbers, + - * / ^ and ( )",
            cure,
            place=f"column {token.place - self.text.rfind(chr(10), 0, token.place)}",
        )
