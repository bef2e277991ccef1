"""Model files: TOML to `Model`. The shipped models are such files too."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
from pydantic import Field

from rotorid.errors import InputError, ModelError, ReadError
from rotorid.models.expression import FUNCTIONS, RESERVED
from rotorid.models.model import Model, Parameter, build_model
from rotorid.models.terms import Names
from rotorid.toml import Schema, parse_toml, read_bytes
from rotorid.units import check_unit, si_factor

MAX_NAMES = 500
_NAME = re.compile(r"[^\W\d]\w{0,63}")


class _ParameterEntry(Schema):
    unit: str
    nominal: float | None = Field(None, allow_inf_nan=False)
    positive: bool = False


class _ModelFile(Schema):
    title: str
    source: str = ""
    equations: list[str] = Field(min_length=1, max_length=MAX_NAMES)
    coordinates: dict[str, str] = Field(min_length=1, max_length=MAX_NAMES)
    inputs: dict[str, str] = Field(default_factory=dict, max_length=MAX_NAMES)
    parameters: dict[str, _ParameterEntry] = Field(min_length=1, max_length=MAX_NAMES)


def shipped_models() -> tuple[str, ...]:
    """Return the names of the models in the package.

    Returns
    -------
    tuple of str

    Raises
    ------
    OSError
        Where the package's own files cannot be read.

    Examples
    --------
    >>> shipped_models()
    ('emps', 'jeffcott', 'rigid', 'three-mass')
    """
    library = files("rotorid.models").joinpath("library")
    return tuple(
        sorted(p.name.removesuffix(".toml") for p in library.iterdir() if p.name.endswith(".toml"))
    )


def load_model(name: str | Path, *, folder: str | Path = ".") -> Model:
    """Load a shipped model by its name, or a model file by its path.

    Parameters
    ----------
    name : str or Path
        A name of `shipped_models`, or the path of a TOML file.
    folder : str or Path
        What a relative path is relative to.

    Returns
    -------
    Model

    Raises
    ------
    ReadError
        For a file that cannot be read or does not fit the format.
    ModelError
        For equations that make no model; file and equation are named.

    Examples
    --------
    >>> load_model("three-mass").coordinates
    ('x1', 'y1', 'x2', 'y2', 'theta_x', 'theta_y', 'x3', 'y3')
    """
    text = str(name)
    if text in shipped_models():
        resource = files("rotorid.models").joinpath("library").joinpath(f"{text}.toml")
        return parse_model(resource.read_bytes(), name=text, file=f"{text}.toml")
    path = Path(folder) / name
    if not path.suffix and not os.path.exists(path):  # pathlib's raises where the name is too long
        raise ReadError(
            f"no model {text[:60]!r}",
            f"one of {', '.join(shipped_models())}, or the path of a model file",
            "list the models with rotorid models, or give a path ending in .toml",
        )
    return parse_model(read_bytes(path), name=path.stem, file=str(path))


def parse_model(data: bytes | str, *, name: str = "model", file: str = "") -> Model:
    r"""Return the model that the text of a model file describes.

    Parameters
    ----------
    data : bytes or str
        TOML.
    name : str
        What to call the model.
    file : str
        For messages.

    Returns
    -------
    Model

    Raises
    ------
    ReadError, ModelError
        As `load_model`.

    Examples
    --------
    >>> model = parse_model('''
    ... title = "a mass on a spring"
    ... equations = ["m*x\'\' + k*x = F"]
    ... coordinates = { x = "m" }
    ... inputs = { F = "N" }
    ... parameters = { m = { unit = "kg" }, k = { unit = "N/mm" } }''')
    >>> model.base.names, model.base.units
    (('m', 'k'), ('kg', 'N/m'))
    """
    raw = data.encode() if isinstance(data, str) else data
    model = _build(parse_toml(raw, _ModelFile, file=file), name, file)
    return replace(model, file_text=raw.decode())


def _build(entry: _ModelFile, name: str, file: str) -> Model:
    names = Names(tuple(entry.coordinates), tuple(entry.inputs), tuple(entry.parameters))
    try:
        _check_names(names)
        units = {
            key: check_unit(unit, place=f"{table}.{key}")
            for table, rows in (("coordinates", entry.coordinates), ("inputs", entry.inputs))
            for key, unit in rows.items()
        }
        parameters = [_parameter(key, row) for key, row in entry.parameters.items()]
        model = build_model(
            name, entry.title, entry.source, entry.equations, names, units, parameters
        )
        _check_use(model)
    except InputError as error:
        raise error.at(file=file) from None
    return model


def _parameter(name: str, entry: _ParameterEntry) -> Parameter:
    place = f"parameters.{name}.unit"
    unit = check_unit(entry.unit, place=place)
    factor = si_factor(entry.unit, place=place)
    nominal = None if entry.nominal is None else entry.nominal * factor
    if entry.positive and nominal is not None and nominal <= 0:
        raise ModelError(
            f"{entry.nominal}",
            "a positive number, since positive = true",
            "give a nominal above 0, or leave out positive",
            place=f"parameters.{name}.nominal",
        )
    return Parameter(name, unit, nominal, entry.positive)


def _check_names(names: Names) -> None:
    taken = {*RESERVED, "pi", *FUNCTIONS}
    tables = {
        "coordinates": names.coordinates,
        "inputs": names.inputs,
        "parameters": names.parameters,
    }
    for table, members in tables.items():
        for name in members:
            if not _NAME.fullmatch(name):
                raise ModelError(
                    f"the name {name[:60]!r}",
                    "a letter, then letters, digits and _, 64 in all at most",
                    "rename it",
                    place=table,
                )
            if name in taken:
                raise ModelError(
                    f"the name {name!r} again",
                    "a name used once and not reserved "
                    f"({', '.join([*RESERVED, 'pi', *FUNCTIONS])})",
                    "rename it",
                    place=table,
                )
            taken.add(name)


def _check_use(model: Model) -> None:
    used = {str(s) for t in model.terms for s in t.signal.free_symbols}
    used |= {model.inputs[t.input] for t in model.input_terms}
    driving = {t.monomial for t in model.input_terms}
    kept = [i for i, c in enumerate(model.base.gather.T) if c.any() or i in driving]
    used |= {model.parameter_names[i] for i in np.flatnonzero(model.monomials[kept].any(axis=0))}
    for name in _declared(model):
        if not {name, name + "'", name + "''"} & used:
            raise ModelError(
                f"{name!r} in no equation",
                "every declared name in an equation",
                "use it or remove it; what it multiplies may vanish",
                place="equations",
            )


def _declared(model: Model) -> Iterable[str]:
    return (*model.coordinates, *model.inputs, *model.parameter_names)
