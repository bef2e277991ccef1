"""Model files to models."""

from __future__ import annotations

import functools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import ConfigDict, Field

from rotorid.core.errors import ModelError, naming
from rotorid.core.toml import Schema, parse_toml, read_named, shipped, table_within
from rotorid.core.units import check_unit
from rotorid.models.equations import MAX_NAMES, check_names, split_equations
from rotorid.models.expressions import RESERVED, symbol
from rotorid.models.linear_form import runs_by_time
from rotorid.models.model import DeclaredParameter, Model

LIBRARY = "rotorid.models"


class ModelFile(Schema):
    """A model file."""

    title: str
    source: str = ""
    equations: list[str] = Field(min_length=1, max_length=MAX_NAMES)
    coordinates: dict[str, str] = Field(min_length=1, max_length=MAX_NAMES)
    inputs: dict[str, str] = Field(default_factory=dict, max_length=MAX_NAMES)
    parameters: dict[str, DeclaredParameter] = Field(min_length=1, max_length=MAX_NAMES)


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
    ('emps', 'flexible', 'jeffcott', 'rigid', 'three-mass')
    """
    return shipped(LIBRARY)


def load_model(name: str | Path, *, folder: str | Path = ".") -> Model:
    """Load a shipped model by its name, or a model or rotor file by its path.

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
    cure = "list the models with rotorid models, or give a path ending in .toml"
    data, found, path = read_named(name, LIBRARY, "model", cure, folder)
    return parse_model(data, name=found, file=str(path))


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
    return _parsed(data.encode() if isinstance(data, str) else bytes(data), name, file)


@functools.lru_cache(maxsize=8)  # a result carries the text of its model, and is asked often
def _parsed(raw: bytes, name: str, file: str) -> Model:
    if "sections" in table_within(raw):
        return replace(_build_rotor(raw, name, file), file_text=raw.decode())
    return _build(raw, name, file)


class _Declared(Schema):
    """The parameters of a rotor file, which its quantities hold."""

    model_config = ConfigDict(extra="ignore")
    parameters: dict[str, DeclaredParameter] = Field(default_factory=dict)


def _build_rotor(data: bytes, name: str, file: str) -> Model:
    from rotorid.models.rotor.drawing import Rotor  # scipy: where a rotor is drawn
    from rotorid.models.rotor.fem import divided
    from rotorid.models.rotor.rotor_model import rotor_model

    declared = parse_toml(data, _Declared, file=file).parameters
    with naming(file):
        check_names(parameters=declared)
        parameters = tuple(row.parameter(key) for key, row in declared.items())
    rotor = parse_toml(data, Rotor, file=file, context={"parameters": parameters})
    with naming(file):
        drawn, said = divided(rotor), {"title": rotor.title, "source": rotor.source}
        model = rotor_model(drawn, parameters, name=name, **said)
        places = (*model.coordinates, *model.readings)
        check_names(places=places, actuators=model.inputs, parameters=declared)
    return model


def _build(data: bytes, name: str, file: str) -> Model:
    entry = parse_toml(data, ModelFile, file=file)
    with naming(file):
        check_names(coordinates=entry.coordinates, inputs=entry.inputs, parameters=entry.parameters)
        units = {
            key: check_unit(unit, place=f"{table}.{key}")
            for table, rows in (("coordinates", entry.coordinates), ("inputs", entry.inputs))
            for key, unit in rows.items()
        }
        parameters = tuple(row.parameter(key) for key, row in entry.parameters.items())
        names = tuple(entry.coordinates), tuple(entry.inputs)
        equations = split_equations(entry.equations, *names, tuple(entry.parameters))
        head = (name, entry.title, entry.source, tuple(entry.equations), *names, units)
        model = Model(*head, parameters, equations, data.decode())
        _check_use(model)
        _check_angle(model)
    return model


def _check_use(model: Model) -> None:
    used = {str(s) for t in model.terms for s in t.signal.free_symbols}
    used |= {model.inputs[t.input] for t in model.input_terms}
    driving = {t.monomial for t in model.input_terms}
    kept = [i for i, c in enumerate(model.base.gather.T) if c.any() or i in driving]
    used |= {model.parameter_names[i] for i in np.flatnonzero(model.monomials[kept].any(axis=0))}
    written = set(re.findall(r"\w+", " ".join(model.texts)))
    only_read = {*model.parameter_names} - written
    for name in (*model.coordinates, *model.inputs, *model.parameter_names):
        if name not in only_read and not {name, name + "'", name + "''"} & used:
            expected = "every declared name in an equation"
            cure = "use it or remove it; what it multiplies may vanish"
            raise ModelError(f"{name!r} in no equation", expected, cure, place="equations")


def _check_angle(model: Model) -> None:
    """Refuse a load that turns with the rotor from when the record began, not from its mark."""
    reserved = {symbol(name) for name in RESERVED}
    rows = {t.signal: t.row for t in model.terms if t.signal.free_symbols <= reserved}
    for signal, row in rows.items():
        if (wrong := runs_by_time(signal)) is not None:
            told = f"{wrong}, a load that turns with the rotor, counted from when a record began"
            expected = "the angle of the rotor, which its mark tells"
            cure = "write phi, which is Omega*t where nothing else is known of the angle"
            raise ModelError(told, expected, cure, place=f"equation {row + 1}")
