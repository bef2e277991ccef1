"""What the columns of a file are, by their names and units: time, rotation, channels of a model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from functools import lru_cache
from typing import Literal

from rotorid.errors import InputError
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.models.base import monomial_name
from rotorid.record import Floats
from rotorid.units import si_factor

_MARK = r"tach\w*|trig\w*|puls\w*|mark\w*|index"
Role = Literal["time", "speed", "keyphasor", "angle", "channel"]
_ROLES: tuple[tuple[Role, re.Pattern[str], str], ...] = (
    ("time", re.compile(r"t|time\b.*|zeit|clock|timestamp|x_value|x_axis|abscissa", re.I), "s"),
    ("speed", re.compile(r"(n_?)?rpm|speed\w*|drehzahl|omega\w*", re.I), "rad/s"),
    ("keyphasor", re.compile(rf"kp|key\b.*|key_?ph\w*|{_MARK}|(zero|null)_?({_MARK})", re.I), ""),
    ("angle", re.compile(r"enc\w*|angle\w*|phi|rotor_?angle", re.I), "rad"),
)
_WORDS = {
    "force": "f",
    "current": "i",
    "coil": "i",
    "position": "",
    "pos": "",
    "displacement": "",
    "disp": "",
    "sensor": "",
    "probe": "",
    "gap": "",
    "moment": "m",
    "torque": "m",
}
_LIKE = 0.7  # likeness of names from which on a column is taken for a quantity
_TIE = 0.05  # by which a name must be likelier than the next
_PLANES = (*"ablr", "left", "right", "front", "rear", "top", "bottom", "de", "nde")
_AXES = ("xyz", "vw", "hv")
"""Letters of axes at right angles, in the order x, y: probes off the vertical are V and W, others
H and V."""
_MAGNETS = ("13", "24")
"""Figures of V13 and W24, the axes of a bearing by the numbers of their magnets."""
_FIRST_OF_POSITION = ("p", "s", "d", "x")
_LAW_UNIT = "A"
_EXCITATION = re.compile(
    r"(ex|exc\w*|ref\w*|dist(urb\w*)?|noise|chirp|sweep|inj\w*|add\w*)(_|\d|\b)", re.I
)

_NO_PATH = re.compile(r"\b([A-Za-z0-9])/([xyzXYZ])\b")  # plane and axis


@frozen
class Found:
    """A column of a file.

    Parameters
    ----------
    name : str
    values : array, shape (sample,)
    unit : str or None
    role : Role
    """

    name: str
    values: Floats
    unit: str | None
    role: Role


def role_of(name: str, unit: str | None) -> Role:
    """Return what a column is by its name, where its unit does not contradict."""
    leaf = _leaf(name)
    for role, pattern, expected in _ROLES:
        if pattern.fullmatch(leaf) and (not unit or not expected or converts(unit, expected)):
            return role
    return "channel"


def _leaf(name: str) -> str:
    """Return the last part of a path; "Pos A/X" is none."""
    return _NO_PATH.sub(r"\1 \2", name).rsplit("/", 1)[-1]


def is_excitation(column: Found) -> bool:
    """Tell whether a column is by its name what was added to the commands."""
    return _EXCITATION.match(_leaf(column.name)) is not None


@lru_cache(maxsize=4096)
def converts(unit: str, expected: str) -> bool:
    """Tell whether a unit is one of a quantity."""
    try:
        si_factor(unit, expected)
    except InputError:
        return False
    return True


def assign(model: Model, columns: Sequence[Found]) -> dict[str, Found]:
    """Return the column of each input and coordinate of a model that one can be told for.

    Names must be alike, and units, where there are any, convert; each column is used once, and a
    quantity for which two are as likely gets none.
    """
    ranked = _ranked(model, columns)
    rivals: dict[str, list[tuple[float, int]]] = {}
    for score, _, quantity, place in ranked:
        rivals.setdefault(quantity, []).append((score, place))
    found: dict[str, Found] = {}
    used: set[int] = set()
    undecided: set[str] = set()
    for score, _, quantity, place in ranked:
        if score < _LIKE or quantity in found or place in used or quantity in undecided:
            continue
        others = (s for s, p in rivals[quantity] if p != place and p not in used)
        if score < 1 and next(others, 0.0) >= score - _TIE:
            undecided.add(quantity)  # qm, qg: the name alone does not tell
            continue
        found[quantity] = columns[place]
        used.add(place)
    return found


def _ranked(model: Model, columns: Sequence[Found]) -> list[tuple[float, int, str, int]]:
    """Return likeness, rank, quantity and place of what may belong together, the likest first."""
    quantities = {name: model.units[name] for name in (*model.inputs, *model.coordinates)}
    places: dict[tuple[str, ...], list[int]] = {}
    for place, column in enumerate(columns):
        for marks in {_marks(option) for option in _options(column.name, is_input=False)}:
            places.setdefault(marks, []).append(place)
    found = []
    for rank, (quantity, unit) in enumerate(quantities.items()):
        for place in places.get(_marks(_plain(quantity)), ()):
            column = columns[place]
            if column.unit is None or converts(column.unit, unit):
                score = likeness(quantity, column.name, quantity in model.inputs)
                if score >= _LIKE - _TIE:
                    found.append((score, rank, quantity, place))
    return sorted(found, key=lambda each: (-each[0], *each[1:]))


def by_planes(
    model: Model, columns: Sequence[Found], taken: Mapping[str, Found]
) -> dict[str, tuple[Found, str]]:
    """Return columns of bearing planes that the model calls otherwise, with what was assumed.

    A logger's "Pos A X" and "Pos B X" are x1 and x3 of a model whose inputs are in the planes 1
    and 3: as many planes, in their order. Nothing is told where a plane or an axis is left over.
    """
    planes = _planes({name: name for name in model.inputs})
    found: dict[str, tuple[Found, str]] = {}
    free = [c for c in columns if c.unit and c not in taken.values()]
    for names in (model.inputs, model.coordinates):
        wanted = {key: name for name in names if (key := _place(name)) and key[0] in planes}
        left = {name for name in wanted.values() if name not in taken}
        like = [c for c in free if left and converts(c.unit or "", model.units[min(left)])]
        if len(left) == len(like):
            found |= _in_order(wanted, like, planes)
    return found


def _in_order(
    wanted: Mapping[tuple[str, str], str], like: Sequence[Found], planes: Sequence[str]
) -> dict[str, tuple[Found, str]]:
    """Return the columns of quantities by plane and axis, with what was assumed; all or none."""
    for letters in _AXES:
        keys = [_place(c.name, letters) for c in like]
        places = {key: column for key, column in zip(keys, like, strict=True) if key}
        theirs = list(dict.fromkeys(plane for plane, _ in places))
        if len(theirs) == len(planes) and len(places) == len(like):
            break
    else:
        return {}
    order = dict(zip(planes, theirs, strict=True)) | dict(zip(_AXES[0], letters, strict=False))
    used = [part for part in (*_AXES[0], *planes) if any(part in key for key in wanted)]
    said = ", ".join(f"{order[m].upper()} for {m}" for m in used if order.get(m, m) != m)
    note = said and f"taken {said}, by their order: check"
    found = {
        name: (column, note)
        for (plane, axis), name in wanted.items()
        if (column := places.get((order[plane], order.get(axis, ""))))
    }
    return found if len(found) == len(like) else {}


def _planes(names: Mapping[str, str]) -> list[str]:
    """Return the planes that names hold, in order."""
    return list(dict.fromkeys(key[0] for name in names.values() if (key := _place(name))))


def _place(name: str, letters: str = _AXES[0]) -> tuple[str, str] | None:
    """Return plane and axis of a name such as F_x1, "Pos A X", s_yb; None without just one each."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|_", " ", _leaf(name))
    found = re.findall(r"[A-Za-z]+|\d+", spaced)
    parts = [p for part in found for p in _apart(part.lower(), letters)]
    axes = [part for part in parts if part in tuple(letters)]
    planes = [part for part in parts if part.isdigit() or part in _PLANES]
    if letters != _AXES[0] and len(planes) > 1:
        planes = [part for part in planes if part not in _MAGNETS]
    return (planes[0], axes[0]) if len(axes) == len(planes) == 1 else None


def _apart(part: str, letters: str) -> list[str]:
    """Part an axis from the letter beside it: "xa", "bx", "fx"."""
    return list(part) if len(part) == 2 and len(set(letters) & set(part)) == 1 else [part]


def displacement(model: Model, name: str) -> str:
    """Return what does work with an input, B'q, as text: ``x1``, ``x - L_a*theta_y``."""
    text = ""
    for term in (t for t in model.input_terms if model.inputs[t.input] == name):
        factor = monomial_name(tuple(model.monomials[term.monomial]), model.parameter_names)
        size = "" if abs(term.coefficient) == 1 else f"{abs(term.coefficient):.12g}"
        sign = (" + ", " - ")[term.coefficient < 0] if text else ("", "-")[term.coefficient < 0]
        product = "*".join(filter(None, (size, factor, model.coordinates[term.row])))
        text += sign + product
    return text


def sensors_at_inputs(model: Model, columns: Sequence[Found]) -> dict[str, tuple[Found, str]]:
    """Return columns of sensors in the planes of inputs that are not coordinates, by input.

    Nothing for a model whose coordinates are in these planes, or where a plane is left over.
    """
    inputs = {key: name for name in model.inputs if (key := _place(name))}
    told = [displacement(model, name) for name in model.inputs]
    like = [c for c in columns if c.unit and converts(c.unit, "m")]
    bare = set(told) <= set(model.coordinates)
    if bare or not len(inputs) == len(model.inputs) == len(like):
        return {}
    return _in_order(inputs, like, _planes({name: name for name in model.inputs}))


def currents(
    model: Model, columns: Sequence[Found], taken: Mapping[str, Found]
) -> dict[str, tuple[Found, str]]:
    """Return the column of the current of each input that has no force, and what was assumed."""
    free = [c for c in columns if c.unit and converts(c.unit, _LAW_UNIT)]
    inputs = {key: name for name in model.inputs if (key := _place(name))}
    if len(inputs) == len(model.inputs) == len(free) and not set(model.inputs) & set(taken):
        planes = _planes({name: name for name in model.inputs})
        if ordered := _in_order(inputs, free, planes):
            return ordered
    found = {}
    for name in model.inputs:
        if name in taken or not free:
            continue
        best = max(free, key=lambda c: likeness(name[1:], c.name.lstrip("iI"), False))
        if likeness(name[1:], best.name.lstrip("iI"), False) >= _LIKE:
            found[name] = best, ""
            free.remove(best)
    return found


def likeness(quantity: str, column: str, is_input: bool) -> float:
    """Return how alike a quantity of a model and a column's name are, 1 for the same."""
    wanted = _plain(quantity)
    if not wanted:
        return 0.0
    options = _options(column, is_input=is_input)
    return max((_alike(wanted, option) for option in options), default=0.0)


def _options(column: str, *, is_input: bool) -> list[str]:
    """Return what a column's name may be of, in small letters and figures."""
    name = _plain(_leaf(column))
    options = [name]
    if not is_input:
        options += [name[1:] for first in _FIRST_OF_POSITION if name.startswith(first)]
    return [option for option in options if option]


@lru_cache(maxsize=4096)
def _marks(name: str) -> tuple[str, ...]:
    """Return figures and axes of a name, which tell columns apart."""
    return tuple(re.findall(r"\d+|[xyz]", name))


def _alike(wanted: str, name: str) -> float:
    if wanted == name:
        return 1.0
    # Others than these must not stand in for one another.
    if _marks(wanted) != _marks(name):
        return 0.0
    most = 2 * min(len(wanted), len(name)) / (len(wanted) + len(name))
    if 0.95 * most < _LIKE - _TIE:
        return 0.0
    return 0.95 * SequenceMatcher(None, wanted, name).ratio()


@lru_cache(maxsize=4096)
def _plain(name: str) -> str:
    """Return a name in small letters and figures, its words as the models write them."""
    parts = re.findall(r"[a-z]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
    return "".join(_WORDS.get(part, part) for part in parts)
