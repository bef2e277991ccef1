"""TOML files checked against a schema; every fault is one line with file and key."""

from __future__ import annotations

import os
import re
import tomllib
from codecs import BOM_UTF8
from collections.abc import Iterator
from importlib.resources import files
from itertools import islice
from pathlib import Path
from reprlib import Repr
from typing import Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from rotorid.core.errors import InputError, ReadError, nearest, require_type, shortened
from rotorid.core.files import read_regular
from rotorid.core.units import to_si

TOML_BYTES = 1_000_000
"""Of a model, an experiment or a rig: people write them, a few kB at most."""

TOML_VALUES = 20_000
"""Keys and members of lists: a hundred records of twenty channels; each takes 0.1 ms if wrong."""

DIGITS = 400
"""Of a number: a double ends at 309 digits, and turning n digits into a number costs n^2."""

# A key of n parts costs n^2: more than anyone writes by hand are refused before they are parsed.
_LONG_KEY = re.compile(rb"(?<![\w-])(?:(?:[\w-]++|\"[^\"\n]*+\"|'[^'\n]*+')[ \t]*+\.[ \t]*+){32}")
# Hexadecimal numbers of any length become integers, and no text in these files is so long a number.
_LONG_NUMBER = re.compile(rb"[0-9A-Fa-f_]{%d}" % (DIGITS + 1))
_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_QUOTES = "put texts in quotes, and close them on the same line"
_FAULTS = {
    "Invalid value": ("no value", f"write key = value; {_QUOTES}"),
    "Invalid statement": ("no key = value", "write key = value, or a table such as [channels]"),
    "Expected '='": ("a key without a value", "write key = value"),
    "Expected newline": ("more behind the value", f"one key on a line; {_QUOTES}"),
    "Expected ']": ("a table that is not closed", "close it: [channels], or [[records]]"),
    "Illegal character": ("a text that does not end", _QUOTES),
    "Unterminated string": ("a text that does not end", _QUOTES),
    "Unescaped": ("a backslash", "write paths with / or in single quotes"),
    "Unclosed array": (
        "a list that is not closed, or a value without quotes",
        f"{_QUOTES}; close it with ]",
    ),
    "Unclosed inline": (
        "a table that is not closed, or a value without quotes",
        f"{_QUOTES}; close it with }}",
    ),
    "Cannot": ("a key that is there twice", "keep one of the two"),
    "Duplicate": ("a key that is there twice", "keep one of the two"),
}
"""What messages of the parser begin with: what is wrong, and what to do about it."""
S = TypeVar("S", bound="Schema")


class Schema(BaseModel):
    """A table of a TOML file: no key but the declared ones."""

    # Tables within tables are built with the outermost, when it is used, not each by itself too.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


class _AsWritten(GenerateJsonSchema):
    """What may stand in a file: for a value that is made of it, a text, list or table too."""

    def function_before_schema(self, schema: Any) -> JsonSchemaValue:
        made = super().function_before_schema(schema)
        if schema["schema"]["type"] == "model-fields":  # a whole table, looked at beforehand
            return made
        return {"anyOf": [made, {"type": ["string", "array", "object"]}]}


def si(unit: str) -> BeforeValidator:
    """Return what reads a quantity into SI."""
    return BeforeValidator(lambda value: to_si(value, unit))


def json_schema(schema: type[Schema]) -> dict[str, Any]:
    """Return the JSON Schema of a file, by which an editor completes and underlines."""
    found = schema.model_json_schema(schema_generator=_AsWritten)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def read_toml(path: str | Path, schema: type[S]) -> S:
    return parse_toml(read_bytes(path), schema, file=str(path))


def read_bytes(path: str | Path) -> bytes:
    cure = "check that this is the right file"
    return read_regular(path, TOML_BYTES, "a TOML file", cure)


def shipped(package: str) -> tuple[str, ...]:
    every = (path.name for path in files(package).joinpath("library").iterdir())
    return tuple(sorted(name.removesuffix(".toml") for name in every if name.endswith(".toml")))


def read_named(
    name: str | Path, package: str, what: str, cure: str, folder: str | Path = "."
) -> tuple[bytes, str, Path]:
    """Read a file that is shipped by its name, or another by its path; and return both."""
    require_type(name, str, Path, place="name")
    text, known = str(name), shipped(package)
    if text in known:
        resource = files(package).joinpath("library", f"{text}.toml")
        return resource.read_bytes(), text, Path(f"{text}.toml")
    path = Path(folder) / name
    if not path.suffix and not os.path.exists(path):  # pathlib's raises where the name is too long
        expected = f"one of {', '.join(known)}, or the path of a {what} file"
        raise ReadError(f"no {what} {text[:60]!r}", expected, cure)
    return read_bytes(path), path.stem, path


def parse_toml(
    data: bytes, schema: type[S], *, file: str = "", context: dict[str, Any] | None = None
) -> S:
    table = parse_table(data, file=file)
    try:
        return schema.model_validate(table, context=context)
    except ValidationError as error:
        raise _first_fault(error, schema, file) from None
    except RecursionError:
        raise _too_deep(file) from None


def parse_table(data: bytes, *, file: str = "") -> dict[str, Any]:
    """Parse TOML text; what would take long, or is no TOML, is one line."""
    data = data.removeprefix(BOM_UTF8)  # Windows' editors put it there
    if _LONG_KEY.search(data):
        raise ReadError("a key of more than 32 parts", "keys of a few parts", "cut it", file=file)
    if _LONG_NUMBER.search(data):
        cure = "write it with fewer digits, such as 1.5e3"
        raise ReadError(f"a number of more than {DIGITS} digits", "TOML", cure, file=file)
    try:
        table = tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise ReadError(
            f"byte {error.start} that is no UTF-8", "TOML text", "save it as UTF-8", file=file
        ) from None
    except tomllib.TOMLDecodeError as error:
        raise _not_toml(str(error), data.decode("utf-8"), file) from None
    except RecursionError:
        raise _too_deep(file) from None
    if next(islice(members(table), TOML_VALUES, None), None):  # before each is looked at
        expected = "a TOML file written by hand"
        cure = "check that this is the right file"
        raise ReadError(f"more than {TOML_VALUES} values", expected, cure, file=file)
    return table


def members(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield what tables and lists hold, however deep, each with its place."""
    pairs: Any = value.items() if isinstance(value, dict) else ()
    for key, member in enumerate(value) if isinstance(value, list) else pairs:
        inside = f"{place}.{key}" if place else str(key)
        yield inside, member
        yield from members(member, inside)


def inline(value: Any) -> Any:
    """Return a value as it stands on one line; tomlkit leaves blanks out of tables in tables."""
    import tomlkit  # for what writes such files alone

    if isinstance(value, dict):
        table = tomlkit.inline_table()
        for key, inner in value.items():
            table[key] = inline(inner)
        return table
    if isinstance(value, list):
        array = tomlkit.array()
        array.extend(map(inline, value))
        return array
    return value


def table_within(text: str | bytes) -> dict[str, Any]:
    """Parse TOML text that another file holds; empty where it is none, or would take long."""
    data = text.encode("utf-8", "replace") if isinstance(text, str) else text
    try:
        return parse_table(data) if len(data) <= TOML_BYTES else {}
    except InputError:
        return {}


def _not_toml(message: str, text: str, file: str) -> ReadError:
    message, _, place = message.partition(" (at ")
    place = place.rstrip(")")
    known = (told for begin, told in _FAULTS.items() if message.startswith(begin))
    found, cure = next(known, (message.rstrip("."), "write key = value there"))
    lines, number = text.splitlines(), re.match(r"line (\d+)", place)
    at = int(number[1]) - 1 if number else len(lines) - 1
    line = shortened(lines[at].strip(), 60) if 0 <= at < len(lines) else ""
    return ReadError(
        f"{found} in {line!r}" if line else found, "TOML", cure, file=file, place=place
    )


def _too_deep(file: str) -> ReadError:
    return ReadError("nesting too deep", "TOML of a few levels", "flatten it", file=file)


def _first_fault(error: ValidationError, schema: type[Schema], file: str) -> InputError:
    # A misspelt key first: it may be the one that is missing.
    faults = error.errors(include_url=False)
    fault = min(faults, key=lambda f: f["type"] != "extra_forbidden")
    told = dict.fromkeys(("model_type", "dict_type"), "a table, such as { key = value }")
    told["invalid-json-value"] = "a number, a text, true or false, or lists or tables of these"
    fault["msg"] = told.get(fault["type"], fault["msg"])
    if fault["type"] != "extra_forbidden":
        return fault_in_line(fault).at(file=file)
    name, known = str(fault["loc"][-1]), _known_keys(schema, fault["loc"][:-1])
    return ReadError(
        f"the unknown key {name[:60]!r}",
        f"one of {', '.join(known)}" if known else "a known key",
        nearest(name, known, "remove it"),
        file=file,
        place=_place(fault),
    )


def fault_in_line(fault: Any, cure: str = "") -> InputError:
    """Return what pydantic found wrong with one value, in one line."""
    inner, place = fault.get("ctx", {}).get("error"), _place(fault)
    if isinstance(inner, InputError):
        return inner.at(place=place)
    if fault["type"] == "missing":
        return ReadError("no such key", "a value", cure or "add it", place=place)
    expected = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    found, expected = _SHORT.repr(fault["input"]), expected[0].lower() + expected[1:]
    return ReadError(found, expected, cure or "write such a value", place=place)


def _place(fault: Any) -> str:
    return ".".join(str(part)[:60] for part in fault["loc"])


def _known_keys(schema: type[Schema], location: tuple[int | str, ...]) -> list[str]:
    for part in location:  # of an index or a key of a mapping, the schema is that of its members
        if isinstance(part, str) and part in schema.model_fields:
            found = _schemas_in(schema.model_fields[part].annotation)
            if len(found) != 1:
                return []
            schema = found[0]
    return [field.alias or name for name, field in schema.model_fields.items()]


def _schemas_in(annotation: Any) -> list[type[Schema]]:
    if isinstance(annotation, type) and issubclass(annotation, Schema):
        return [annotation]
    return [s for inner in getattr(annotation, "__args__", ()) for s in _schemas_in(inner)]
