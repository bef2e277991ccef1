"""Draft experiment files: roles of columns guessed from names and units."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Container, Generator, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import field, replace
from difflib import SequenceMatcher
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import tomlkit
import tomlkit.items

from rotorid.core.errors import InputError, ReadError
from rotorid.core.files import MARK, Kind
from rotorid.core.toml import inline
from rotorid.core.units import converts, si_factor
from rotorid.core.values import Floats, frozen, grouped
from rotorid.experiment.schema import OPEN, left_open
from rotorid.io import open_table
from rotorid.io.clock import UNITS, even_rate, is_time, leaf, read_clock, unit_of_time
from rotorid.io.columns import check_magnitude, largest_of
from rotorid.io.table import RATES, OneFile, Rate, Stored, columns_across
from rotorid.io.text import DelimitedTable
from rotorid.models import Model, load_model
from rotorid.models.base import monomial_name
from rotorid.models.equations import combination_text
from rotorid.signals.period_search import Period, common_period

_Line = tuple[str, Any, str]
"""A key, its value, and what is told of it; a remark without a key."""
_Container = TypeVar("_Container", tomlkit.TOMLDocument, tomlkit.items.Table)
_MARK = r"tach\w*|trig\w*|puls\w*|mark\w*|index"
Role = Literal["time", "speed", "keyphasor", "angle", "channel"]
_ROLES: tuple[tuple[Role, re.Pattern[str], str], ...] = (
    ("speed", re.compile(r"(n_?)?rpm|speed\w*|drehzahl|omega\w*", re.I), "rad/s"),
    ("keyphasor", re.compile(rf"kp|key\b.*|key_?ph\w*|{_MARK}|(zero|null)_?({_MARK})", re.I), ""),
    ("angle", re.compile(r"enc\w*|angle\w*|phi|rotor_?angle", re.I), "rad"),
)
_UNIT_IN_NAME = re.compile(r"[munµk][AVN]|[munµ]m|mil|deg|[munµ]?rad")
_CURRENT = re.compile(r"i[abxyz]{0,2}(?![a-z])|cur|coil", re.I)
"""What a current is called, where no unit says so: iA_x, I 1 X."""
_WORDS = {
    "force": "f",
    **dict.fromkeys(("current", "coil"), "i"),
    **dict.fromkeys(("moment", "torque"), "m"),
    **dict.fromkeys(("position", "pos", "displacement", "disp", "sensor", "probe", "gap"), ""),
}
"""How models write words that stand in names."""
_LIKE = 0.7  # likeness of names from which on a column is taken for a quantity
_TIE = 0.05  # by which a name must be likelier than the next
_PLANES = (*"ablr", "left", "right", "front", "rear", "top", "bottom", "de", "nde")
_AXES = ("xyz", "vw", "hv")
"""Letters of axes at right angles in the order x, y: V and W off the vertical, others H and V."""
_MAGNETS = ("13", "24")
"""Figures of V13 and W24, the axes of a bearing by the numbers of their magnets."""
_FIRST_OF_POSITION = ("p", "s", "d", "x")
_RATE = re.compile(r"(?P<rate>fs|sampl(e|ing)_?(rate|freq\w*))|dt|ts", re.I)
"""What scalars are called that hold the sample rate, or its inverse."""
_PARTS = {"amplitude": r"a|abs|amp\w*|mag\w*", "phase": r"p|ph\w*|arg|angle"}
_PARTS |= {"real": "re(al)?", "imag": r"im(ag\w*)?"}
"""Words in the names of the two columns that are one reading of a table."""
_FREQUENCY, _COHERENCE = re.compile(r"f|freq\w*|hz", re.I), re.compile(r"coh\w*|gamma\w*", re.I)
_NAMELESS = re.compile(r"^\d+$|\[\d+\]$")
_EXCITATION = re.compile(
    r"(ex|exc\w*|ref\w*|dist(urb\w*)?|noise|chirp|sweep|inj\w*|add\w*)(_|\d|\b)", re.I
)


@frozen
class Found:
    """A column of a file."""

    name: str
    values: Floats  # (sample,)
    unit: str | None
    role: Role
    assumed: str = field(default="", compare=False)  # of what it stands for
    # what a reading of a table says of its columns
    said: Mapping[str, str] = field(default_factory=dict, compare=False)

    @property
    def label(self) -> str:
        """Its name without its unit."""
        return self.name.removesuffix(f"_{self.unit}")

    def measures(self, *units: str) -> bool:
        told = self.unit or ("A" if _CURRENT.match(leaf(self.name)) else "")
        return bool(told) and any(converts(told, unit) for unit in units)


def _unit_in(name: str) -> str | None:
    """Return the unit that ends a name: x1_um, i_x1_A; the A of i_x_A may be a bearing."""
    stem, _, unit = name.rpartition("_")
    single = {"i": "A", "f": "N", "u": "V", "v": "V"}.get(_plain(leaf(stem))[:1])
    told = _UNIT_IN_NAME.fullmatch(unit) or (unit == single and _place(stem))
    return unit if stem and told else None


def role_of(name: str, unit: str | None) -> Role:
    """Return what a column is by its name, where its unit does not contradict."""
    if is_time(name, unit):
        return "time"
    for role, pattern, expected in _ROLES:
        if pattern.fullmatch(leaf(name)) and (not unit or not expected or converts(unit, expected)):
            return role
    return "channel"


def is_excitation(column: Found) -> bool:
    return _EXCITATION.match(leaf(column.name)) is not None


def assign(model: Model, columns: Sequence[Found]) -> dict[str, Found]:
    """Return the column of each input and coordinate of a model that one can be told for.

    Names must be alike, and units, where there are any, convert; each column is used once, and a
    quantity for which two are as likely gets none.
    """
    ranked = _ranked(model, columns)
    found: dict[str, Found | None] = {}
    used: set[int] = set()
    for score, _, quantity, place in ranked:
        if score < _LIKE or quantity in found or place in used:
            continue
        free = (s for s, _, q, p in ranked if q == quantity and p != place and p not in used)
        if score < 1 and next(free, 0.0) >= score - _TIE:
            found[quantity] = None  # qm, qg: the name alone does not tell
        else:
            found[quantity] = columns[place]
            used.add(place)
    return {quantity: column for quantity, column in found.items() if column is not None}


def _ranked(model: Model, columns: Sequence[Found]) -> list[tuple[float, int, str, int]]:
    """Return likeness, rank, quantity and place of what may belong together, the likest first."""
    options = ((k, _options(one.label, is_input=False)) for k, one in enumerate(columns))
    places = grouped((marks, k) for k, names in options for marks in set(map(_marks, names)))
    found = []
    for rank, (quantity, unit) in enumerate(_quantities(model).items()):
        for place in places.get(_marks(_plain(quantity)), ()):
            column = columns[place]
            if column.unit is None or converts(column.unit, unit):
                score = likeness(quantity, column.label, quantity in model.inputs)
                if score >= _LIKE - _TIE:
                    found.append((score, rank, quantity, place))
    return sorted(found, key=lambda each: (-each[0], *each[1:]))


def by_planes(
    model: Model, columns: Sequence[Found], taken: Mapping[str, Found]
) -> dict[str, Found]:
    """Return columns of planes in their order: "Pos A X", "Pos B X" may be x1, x3 of a model."""
    planes = list(dict.fromkeys(key[0] for name in model.inputs if (key := _place(name))))
    found: dict[str, Found] = {}
    free = [c for c in columns if c not in taken.values()]
    for names in (model.inputs, model.coordinates):
        wanted = {key: name for name in names if (key := _place(name)) and key[0] in planes}
        left = {name for name in wanted.values() if name not in taken}
        like = [c for c in free if left and c.measures(model.units[min(left)])]
        if len(left) == len(like):
            found |= _in_order(wanted, like, planes, free)
    return found


def _in_order(
    wanted: Mapping[tuple[str, str], str],
    like: Sequence[Found],
    planes: Sequence[str],
    columns: Sequence[Found],
) -> dict[str, Found]:
    """Return the columns of quantities by plane and axis; all or none.

    Planes are in the order in which any columns first name them, so that currents and positions
    have one.
    """
    for letters in _AXES:
        keys = [_place(c.label, letters) for c in like]
        places = {key: column for key, column in zip(keys, like, strict=True) if key}
        every = dict.fromkeys(key[0] for c in columns if (key := _place(c.label, letters)))
        theirs = [plane for plane in every if any(plane == one for one, _ in places)]
        if len(theirs) == len(planes) and len(places) == len(like):
            break
    else:
        return {}
    order = dict(zip(planes, theirs, strict=True)) | dict(zip(_AXES[0], letters, strict=False))
    used = [part for part in (*_AXES[0], *planes) if any(part in key for key in wanted)]
    said = ", ".join(f"{order[m].upper()} for {m}" for m in used if order.get(m, m) != m)
    assumed = said and f"taken {said}, by their order: check"
    found = {
        name: replace(column, assumed=assumed)
        for (plane, axis), name in wanted.items()
        if (column := places.get((order[plane], order.get(axis, ""))))
    }
    return found if len(found) == len(like) else {}


def _place(name: str, letters: str = _AXES[0]) -> tuple[str, str] | None:
    """Return plane and axis of a name such as F_x1, "Pos A X", s_yb; None without just one each."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|_", " ", leaf(name))
    found = re.findall(r"[A-Za-z]+|\d+", spaced)
    parts: list[str] = []
    for part in map(str.lower, found):  # an axis stands beside a letter: "xa", "bx", "fx"
        parts += part if len(part) == 2 and len(set(letters) & set(part)) == 1 else [part]
    axes = [part for part in parts if part in tuple(letters)]
    planes = [part for part in parts if part.isdigit() or part in _PLANES]
    if letters != _AXES[0] and len(planes) > 1:
        planes = [part for part in planes if part not in _MAGNETS]
    return (planes[0], axes[0]) if len(axes) == len(planes) == 1 else None


def displacement(model: Model, name: str) -> str:
    """Return what does work with an input, B'q, as text: ``x1``, ``x - L_a*theta_y``."""
    parts = {}
    for term in (t for t in model.input_terms if model.inputs[t.input] == name):
        factor = monomial_name(tuple(model.monomials[term.monomial]), model.parameter_names)
        product = "*".join(filter(None, (factor, model.coordinates[term.row])))
        parts[product] = float(f"{term.coefficient:.12g}")
    return combination_text(parts)


def sensors_at_inputs(model: Model, columns: Sequence[Found]) -> dict[str, Found]:
    beside = {displacement(model, name) for name in model.inputs} - set(model.coordinates)
    return _at_inputs(model, columns, "m") if beside else {}


def _at_inputs(model: Model, columns: Sequence[Found], unit: str) -> dict[str, Found]:
    """Return the columns of a unit in the planes of the inputs; nothing where one is left over."""
    inputs = {key: name for name in model.inputs if (key := _place(name))}
    like = [c for c in columns if c.measures(unit)]
    planes = list(dict.fromkeys(plane for plane, _ in inputs))
    whole = len(inputs) == len(model.inputs) == len(like)
    return _in_order(inputs, like, planes, columns) if whole else {}


def currents(
    model: Model, columns: Sequence[Found], taken: Mapping[str, Found]
) -> dict[str, Found]:
    if not set(model.inputs) & set(taken) and (ordered := _at_inputs(model, columns, "A")):
        return ordered
    free, found = [c for c in columns if c.measures("A")], dict[str, Found]()
    for name in model.inputs:
        scores = [likeness(name[1:], c.label.lstrip("iI"), False) for c in free]
        if name not in taken and (best := max(scores, default=0.0)) >= _LIKE:
            found[name] = free.pop(scores.index(best))
    return found


def likeness(quantity: str, column: str, is_input: bool) -> float:
    wanted = _plain(quantity)
    options = _options(column, is_input=is_input) if wanted else []
    return max((_alike(wanted, option) for option in options), default=0.0)


def _options(column: str, *, is_input: bool) -> list[str]:
    """Return what a column's name may be of, in small letters and figures."""
    name = _plain(leaf(column))
    beside = [name[1:]] if not is_input and name.startswith(_FIRST_OF_POSITION) else []
    return [option for option in (name, *beside) if option]


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


_SLOWEST = 20.0  # Hz; a logger of vibrations is faster, so slower times are no seconds
_STRIPES, _POWER = 400, 0.03  # of the spectrum, and of its largest: what is above was driven
_DRIVES = ("N", "N m", "A", "V")
_MOTIONS = ("m", "rad")
ABOVE_MOTION = 10.0
"""Cut-off of a draft over the highest frequency of the motion: friction bends above that."""
_EXCITED = 0.03  # of the largest line: what stands above it was excited
_HELD = (
    'a column of commands, each held until the next: add hold = "zero-order", and its delay; '
    "one of measured forces or currents: neither"
)
_MOST_LINES = 30  # that are listed; more make a band
_MOST_NAMES = 8  # of columns that may be one input


@frozen
class _Run:
    files: tuple[Path, ...]
    columns: tuple[Found, ...]
    rate: float | None  # Hz
    clock: _Line  # what is said of it
    arrays: tuple[str, ...]  # what is told of those that are not one column of the record
    table: tuple[_Line, ...] = ()  # what is said of a table, in place of the clock and the rest

    def channels(self) -> list[Found]:
        return [c for c in self.columns if c.role == "channel" and np.isfinite(c.values).all()]

    def moving(self) -> list[Found]:
        """Return the channels that may hold excitation: no counter of samples, no mark."""
        return [
            c for c in self.channels() if even_rate(c.values) is None and not _is_mark(c.values)
        ]

    def driving(self) -> list[Found]:
        return [c for c in self.channels() if is_excitation(c) and np.ptp(c.values) > 0]


DRAFT = Kind("rotorid new")
_NO_RATE = 'as "5 kHz"; a row per speed is kind = "phasors" in its place, per frequency "responses"'
_TWICE = 'many speeds that were read twice tell the noise: then no std, and same_speed = "1 rpm"'
BELOW_HALF = 0.499  # of the sample rate: four digits of it do not exceed a half
_ENOUGH = 10_000  # samples that show whether a column has two values
_HEAD = f"""#:schema experiment.schema.json
# By that file an editor completes and checks. To write it:
#   rotorid schema experiment --out experiment.schema.json

# Draft by `rotorid new`. What it could not find is left open as
# "{OPEN}"; the file is refused until each of these is said.
# %s.
# Next: %srotorid inspect, which takes a draft; when nothing is open, rotorid identify.

"""


def draft(files: Sequence[Path], model: str | None, folder: Path) -> str:
    """Return an experiment file; files of one length that share no column are one record."""
    loaded = None if model is None else load_model(model, folder=folder)
    runs = [one for run in _runs(files) for one in _of_table(run, loaded)]
    if loaded is not None and not _turns(loaded):
        runs = [replace(run, columns=tuple(map(_still, run.columns))) for run in runs]
    text = tomlkit.document()
    told = "" if model else "rotorid models lists those that there are"
    _written(text, [("model", model or OPEN, told)])
    records = tomlkit.aot()
    for run in runs:
        lines = _record(run, loaded, folder, later=run is not runs[0])
        records.append(_written(tomlkit.table(), lines))
    text["records"] = records
    named = {name for entry in records for name in entry.get("references", [])}
    text["channels"] = _written(tomlkit.table(), _channels(runs[0], loaded, named))
    if loaded is not None:
        text["parameters"] = _written(tomlkit.table(), _parameters(loaded))
    text.add(tomlkit.nl())
    text.add(tomlkit.comment(f"as written: {MARK}"))
    written = text.unwrap()
    return _HEAD % (things_open(written), before_inspecting(written)) + tomlkit.dumps(text)


def things_open(entry: Mapping[str, Any]) -> str:
    """Say how many things a draft leaves open, and which."""
    count, told = left_open(entry)
    return f"{count} thing{'s' * (count > 1)} open: {told}" if count else "nothing open"


def before_inspecting(entry: Mapping[str, Any]) -> str:
    """Say what a draft needs before its records can be read; empty where it is nothing."""
    if any(record.get("sample_rate") == OPEN for record in entry["records"]):
        return "the sample_rate, or the kind of what has no samples, then "
    tables = any("kind" in record for record in entry["records"])
    return "all of these, then " if tables and left_open(entry)[0] else ""


def _runs(files: Sequence[Path]) -> list[_Run]:
    if not files:
        raise InputError("no file", "the files of one record or several", "name them")
    tables = [open_table(path) for path in files]
    read = [_columns(table) for table in tables]
    lengths = {len(c.values) for columns in read for c in columns}
    names = [{c.name for c in columns if c.role != "time"} for columns in read]
    disjoint = len(set().union(*names)) == sum(map(len, names))
    if len(files) > 1 and disjoint and len(lengths) == 1:
        every = [(path, c) for path, columns in zip(files, read, strict=True) for c in columns]
        times, kept = Counter(c.name for _, c in every), dict[str, Found]()
        for path, c in every:
            said = c.name if times[c.name] == 1 else f"{path.name}:{c.name}"
            kept.setdefault(c.name, replace(c, name=said))
        return [_run(tuple(files), list(kept.values()), tables)]
    runs = zip(files, read, tables, strict=True)
    return [_run((path,), columns, [table]) for path, columns, table in runs]


def _columns(table: OneFile) -> list[Found]:
    """Return the columns of the length of the longest that are numbers."""
    found: list[Found] = []
    refused: list[InputError] = []
    keys, unfound = dict[str, str](), dict[str, InputError]()
    for name in table.names:
        try:
            keys[name] = table.find(name)
        except InputError as error:
            unfound[name] = error
    read = table.read_each(list(keys.values())) if keys else {}
    for name in dict.fromkeys(table.names):
        column = unfound[name] if name in unfound else read[keys[name]]
        if isinstance(column, InputError):
            refused.append(column)  # a column of words is no channel
            continue
        values = column.values
        with suppress(InputError):  # numbers that no machine has
            check_magnitude(largest_of(values), 1.0, name)
            if np.isfinite(values).any() and not np.isinf(values).any():
                role, unit = role_of(name, column.unit), column.unit
                unit = unit or (_unit_in(name) if role == "channel" else None)
                found.append(Found(name, values, unit, role))
    longest = max((len(c.values) for c in found), default=0)
    if longest == 0:
        if refused and not found:
            raise refused[0]
        raise ReadError("no columns of numbers", "samples", "check the file", file=table.file)
    return _timed([c for c in found if len(c.values) == longest])


def _timed(columns: list[Found]) -> list[Found]:
    """Take the first column without a name for the time if it rises so: by 1, it may count."""
    timed = (
        c for c in columns if c.role == "time" or (_NAMELESS.search(c.name) and _rises(c.values))
    )
    if (first := next(timed, None)) is None or first.role == "time":
        return columns
    assumed = replace(first, role="time", assumed="it rises in steps alike: check")
    return [assumed if c is first else c for c in columns]


def _rises(values: Floats) -> bool:
    with suppress(ReadError):
        read_clock(values)
        return bool(np.diff(values[:2]) != 1)
    return False


def _run(files: tuple[Path, ...], columns: list[Found], tables: Sequence[OneFile]) -> _Run:
    # The first of the file may be no numbers.
    key = tables[0].find(columns[0].name.removeprefix(f"{files[0].name}:"))
    stated = tables[0].read([key])[key].rate
    arrays = [each for table in tables if isinstance(table, Stored) for each in table.sizes.items()]
    rates = (rate for table in tables if isinstance(table, Stored) for rate in _stated_rates(table))
    told = tuple(_arrays(arrays, len(columns[0].values)))
    return _Run(files, tuple(columns), *_clock(columns, stated, rates), told)


def _of_table(run: _Run, model: Model | None) -> Iterator[_Run]:
    """Yield the records of a table without times: one for each text of a column of words."""
    speeds = [c for c in run.columns if c.role == "speed" or leaf(c.name) == "n"]
    axes = speeds or [c for c in run.columns if _FREQUENCY.fullmatch(leaf(c.name))]
    readings, opened = list(_readings(run.columns)), open_table(run.files[0])
    words = opened.dialect.words if isinstance(opened, DelimitedTable) else ()
    if run.clock[1] != OPEN or not readings or not (axes or words):
        yield run
        return
    unit = "rpm" if speeds else "Hz"
    axis = {"column": axes[0].name, "unit": axes[0].unit or unit} if axes else OPEN
    said, table = {"std": OPEN}, [("kind", "phasors", ""), ("speed", axis, _TWICE)]
    if axes and not speeds:
        table = [("kind", "responses", ""), ("frequency", axis, "")]
        if seen := [c.name for c in run.columns if _COHERENCE.match(leaf(c.name))]:
            said = {"coherence": seen[0]}
            table += [("averages", OPEN, "of the coherence")]
        inputs = [] if model is None else list(model.inputs)
        said["input"] = inputs[0] if len(inputs) == 1 else OPEN
    if isinstance(opened, Stored):
        table += [
            ("", "", "words that tell conditions are read in text tables alone: export as .csv")
        ]
    columns = [replace(c, said={**c.said, **said}) for c in readings]
    used = {c.name for c in axes[:1]} | {name for c in columns for name in c.said.values()}
    columns += [c for c in run.columns if c.name not in used]
    texts = ((name, list(dict.fromkeys(opened.texts(name)))) for name in words)
    column, several = next((c for c in texts if 1 < len(c[1]) <= _MOST_LINES), ("", []))
    rows = [[("rows", {"column": column, "is": text}, "")] for text in several]
    yield from (replace(run, columns=tuple(columns), table=(*table, *one)) for one in rows or [[]])


def _readings(columns: Sequence[Found]) -> Iterator[Found]:
    """Yield what two columns are by their names: amplitude and phase, or real and imaginary."""
    found = dict[str, dict[str, Found]]()
    for column in columns:
        words = re.findall(r"\b[ap](?=[xyz])|[A-Za-z]+|\d+", leaf(column.label))
        for (k, word), (part, pattern) in product(enumerate(words), _PARTS.items()):
            if re.fullmatch(pattern, word, re.I):
                found.setdefault("_".join(words[:k] + words[k + 1 :]), {})[part] = column
    for (name, parts), pair in product(found.items(), (("amplitude", "phase"), ("real", "imag"))):
        if set(pair) <= parts.keys():
            first = parts[pair[0]]
            said = {part: parts[part].name for part in pair} | {"unit": first.unit or OPEN}
            if pair[1] == "phase" and parts["phase"].unit == "rad":
                said["phase_unit"] = "rad"
            motion = (first.unit or "").partition("/N")[0] or None
            yield replace(first, name=name, unit=motion, said=said, role="channel")


def _stated_rates(table: Stored) -> Iterator[tuple[float, str]]:
    """Yield the sample rates that scalars of a file state, in Hz, and what is told of each."""
    for path, shape in table.sizes.items():
        if (named := _RATE.fullmatch(leaf(path))) and math.prod(shape) == 1:
            with suppress(InputError, ZeroDivisionError):
                value = table.scalar(path)
                rate = value if named["rate"] else 1 / value
                if RATES[0] <= rate <= RATES[1]:
                    yield rate, f"the file states {path} = {value:.9g}: check"


def _arrays(arrays: Iterable[tuple[str, tuple[int, ...]]], samples: int) -> Iterator[str]:
    """Tell of matrices, and of arrays that are no columns of the record."""
    for path, shape in arrays:
        size, across = " x ".join(map(str, shape)), columns_across(shape)
        if across > 1 and max(shape) == samples:
            yield f"{path}, {size}: its columns are {path}[0] to {path}[{across - 1}]"
        elif math.prod(shape) > 1 and (not across or max(shape) != samples):
            yield f"{path}, {size}: no columns of {samples} samples"


def _clock(
    columns: Sequence[Found], stated: Rate | None, scalars: Iterable[tuple[float, str]] = ()
) -> tuple[float | None, _Line]:
    """Return the sample rate, and the line of the column of times, or that of the rate."""
    rate = None if stated is None else stated.hertz
    for column in columns:
        with np.errstate(invalid="ignore"):  # infinity less infinity
            rises = len(column.values) > 2 and bool(np.all(np.diff(column.values) > 0))
        if column.role != "time" or not rises:
            continue
        said: Any = column.name if column.unit else {"column": column.name, "unit": OPEN}
        note = column.assumed
        try:
            clock = read_clock(column.values).rate
        except ReadError as error:
            said, note = _column(column), f"{error.found}; {error.cure}"
        else:
            nice = float(f"{clock.hertz:.4g}")  # if jitter, or the digits of the times, allow it
            found = nice if abs(nice / clock.hertz - 1) <= clock.rounding else clock.hertz
            said_unit = unit_of_time(column.name, column.unit)
            unit = said_unit or _likely_unit(found, rate)
            rate = found / si_factor(unit, "s")
            if not column.unit:
                said["unit"] = unit
                if unit != "s" and said_unit is None:
                    note = _and(f"taken for {unit}: in s it were {found:.4g} Hz", note)
        if rate is not None:
            note = _and(f"{rate:.6g} Hz, {len(column.values) / rate:.4g} s", note)
        return rate, ("time", said, note)
    if rate is not None:
        return rate, ("", None, f"the file states {rate:.9g} Hz")
    for rate, note in scalars:
        return rate, ("sample_rate", f"{rate:.9g} Hz", note)
    return None, ("sample_rate", OPEN, _NO_RATE)


def _likely_unit(told: float, stated: float | None) -> str:
    """Return the unit in which sample times tell the stated rate, or else one of a logger."""
    rates = {unit: told / si_factor(unit, "s") for unit in UNITS}
    likely = [unit for unit, rate in rates.items() if stated and abs(rate / stated - 1) < 0.01]
    return (likely or [unit for unit, rate in rates.items() if rate >= _SLOWEST] or ["s"])[0]


def _record(run: _Run, model: Model | None, folder: Path, *, later: bool) -> Iterator[_Line]:
    names = []
    for path in run.files:
        place, base = path.resolve(), folder.resolve()
        names.append(
            place.relative_to(base).as_posix() if place.is_relative_to(base) else str(place)
        )
    yield ("file", names[0], "") if len(names) == 1 else ("files", names, "")
    if run.table:
        yield from run.table
        return
    yield run.clock
    for line in _rotation(run, model):
        yield line
        if line[0] == "speed" and later and (model is None or unbalanced(model)):
            told = "nothing tells how the rotor stood when this record began; not at standstill"
            yield "phase", "unknown", told
    yield from _excitation(run, model)


def _rotation(run: _Run, model: Model | None) -> Iterator[_Line]:
    by_role = {c.role: c for c in run.columns}
    if speed := by_role.get("speed"):
        unit = speed.unit or "rpm"
        told = f"mean of {speed.name}, deviation {np.std(speed.values):.3g} {unit}"
        yield "speed", f"{np.mean(speed.values):.6g} {unit}", told
    elif mark := by_role.get("keyphasor"):
        yield "keyphasor", mark.name, ""
    elif angle := by_role.get("angle"):
        told = "deg or rad; of a counter, lines = 1024 in place of the unit"
        yield "angle", _column(angle), "" if angle.unit else told
    elif model is None or _turns(model):
        yield "speed", OPEN, 'of the rotation, "8400 rpm"; "0 rpm" at standstill'


def _is_mark(values: Floats) -> bool:
    """Tell whether a column of two values rises evenly, as of a mark that passes once a turn."""
    rises = np.flatnonzero(np.diff(values) > 0)
    return (
        len(np.unique(values[:_ENOUGH])) == 2
        and len(rises) > 2
        and bool(np.ptp(np.diff(rises)) <= 1)
    )


def _turns(model: Model) -> bool:
    return unbalanced(model) or any(re.search(r"\bOmega\b", text) for text in model.texts)


def _still(column: Found) -> Found:
    """Return a column of what does not turn: its angles and speeds are motion."""
    return column if column.role == "time" else replace(column, role="channel")


def unbalanced(model: Model) -> bool:
    return any(re.search(r"\bphi\b", text) for text in model.texts)


def _excitation(run: _Run, model: Model | None) -> Iterator[_Line]:
    sources = run.driving() or run.moving()
    turning, rate = model is None or _turns(model), run.rate
    free = model is not None and not model.inputs and not turning
    torn = rate is None and run.clock[0] == "time"  # a period across a gap is none
    found = None if free or torn else common_period([c.values for c in sources], turning)
    bends = model is not None and (free or model.linear is None)
    if found is None:
        yield from _filter(run, rate, model) if model and bends else _whole_record(run, rate)
        return
    period, repeating = found
    told = f"found in {sources[repeating[0]].name}, correlation {period.correlation:.3g}"
    frequency = None if rate is None else period.fundamental(rate)
    if frequency is not None:
        yield "fundamental", f"{frequency:.12g} Hz", told
    else:
        yield "period_samples", round(period.samples), told
    lines = _lines([sources[k].values for k in repeating], period)
    if len(lines) <= _MOST_LINES and not bends:
        yield "harmonics", lines, "with that of the rotation, if the rotor turns"
    else:
        spacing = None if rate is None else rate / round(period.samples)
        ends = (0 if bends else lines[0], lines[-1] + 0.25)
        told = "the mean and every line: the model is not linear" if bends else ""
        yield "band", [f"{k * spacing:.6g} Hz" if spacing else OPEN for k in ends], told


def _widest(columns: Iterable[Found]) -> Found | None:
    moving = [c for c in columns if np.ptp(c.values) > 0]
    return max(moving, key=lambda c: float(np.ptp(c.values)), default=None)


def _whole_record(run: _Run, rate: float | None) -> Iterator[_Line]:
    channels, driving = run.moving(), run.driving()
    column = _widest(driving or [c for c in channels if c.measures(*_DRIVES)] or channels)
    if rate is not None and column is not None:
        band = [f"{f:.4g} Hz" for f in _excited_band(column.values, rate)]
        yield "band", band, f"no period found: the whole record, where {column.name} is large"
    else:
        yield "band", [OPEN, OPEN], ""
    if driving:
        names = [c.name for c in driving]
        yield "references", names, "what was added to the commands, free of noise"
    else:
        yield "", None, "references = [..]: columns of the excitation that was added; or"
        yield "", None, 'quiet = "..": a record without it; else the inputs hold no noise'


def _filter(run: _Run, rate: float | None, model: Model) -> Iterator[_Line]:
    """Yield the cut-off for what has no lines: a multiple of the frequencies of the motion."""
    cutoff, told = OPEN, "no period found, and the model is not linear"
    if model.linear is not None:
        told = "nothing drives the model"
    told += ": five to ten times the motion's frequencies"
    of = assign(model, run.channels())
    forces = [of[name].name for name in model.inputs if name in of]
    motions = [c for c in run.moving() if c.name not in forces]
    column = _widest([c for c in motions if c.measures(*_MOTIONS)] or motions)
    if rate is not None and column is not None:
        highest = _excited_band(column.values, rate)[1]
        cutoff = f"{min(ABOVE_MOTION * highest, rate / 4):.3g} Hz"
        told += f", {highest:.3g} Hz in {column.name}"
    yield "cutoff", cutoff, told


def _excited_band(signal: Floats, rate: float) -> tuple[float, float]:
    power = np.abs(np.fft.rfft(signal - signal.mean())) ** 2
    width = max(1, len(power) // _STRIPES)
    stripes = power[: len(power) // width * width].reshape(-1, width).mean(axis=1)
    above = np.flatnonzero(stripes > _POWER * np.sort(stripes)[-3:].mean())
    spacing = rate / len(signal)
    last = min((above[-1] + 1) * width * spacing, BELOW_HALF * rate)
    return max(above[0] * width, 2) * spacing, last


def _lines(signals: Sequence[Floats], period: Period) -> list[int]:
    """Return the harmonics that stand above the others in any channel, DC left out."""
    size = round(period.samples)
    excited: set[int] = set()
    for signal in signals:
        count = len(signal) // size
        mean = signal[len(signal) - count * size :].reshape(count, size).mean(axis=0)
        level = np.abs(np.fft.rfft(mean))[1 : (size + 1) // 2]  # that at half the rate has no phase
        excited |= {int(k) + 1 for k in np.flatnonzero(level > _EXCITED * level.max())}
    return sorted(excited)


def _channels(run: _Run, model: Model | None, named: Set[str]) -> Iterator[_Line]:
    """Yield the channels, and as remarks what is left over; `named` are those of the records."""
    columns, used = run.channels(), set(named)
    if model is not None:
        if not run.table:
            yield "", None, _HELD
        used |= yield from _of_model(model, [c for c in columns if not is_excitation(c)])
    turns = not run.table and (model is None or _turns(model))
    for column in columns:
        if column.name not in used:
            unit_text = f" [{column.unit}]" if column.unit else ""
            told = f"{column.values.min():.4g} to {column.values.max():.4g}"
            if turns and len(np.unique(column.values[:_ENOUGH])) == 2:
                told += f'; two values, a mark of the rotation? then keyphasor = "{column.name}"'
            name = inline(column.said).as_string() if column.said else column.name + unit_text
            yield "", None, f"not used: {name}, {told}"
    yield from (("", None, told) for told in run.arrays[:_MOST_LINES])


def _of_model(model: Model, measured: Sequence[Found]) -> Generator[_Line, None, set[str]]:
    """Yield the channels of a model, and return the names of the columns that they have."""
    taken = assign(model, measured)
    taken |= by_planes(model, measured, taken)
    sensors = sensors_at_inputs(model, measured)
    taken = {name: column for name, column in taken.items() if column not in sensors.values()}
    laws = currents(model, measured, taken)
    used = [*taken.values(), *sensors.values(), *laws.values()]
    free = [c for c in measured if c not in used]
    hidden, missing, coordinate = list[str](), dict[str, Any](), dict[str, Any]()
    parts = next((c.said for c in measured if c.said), {})
    idle = set(model.inputs) - set(taken) if parts else set()  # 0, or what responses are to
    for name, unit in ((q, u) for q, u in _quantities(model).items() if q not in idle):
        if name in taken:
            said = filter(None, (_perhaps(model, name, taken), taken[name].assumed))
            yield name, _column(taken[name]), "; ".join(said)
        elif name in model.inputs:
            position = displacement(model, name) or (_sensor_name(name) if name in sensors else "")
            channel, told = _input(unit, laws.get(name), position or OPEN, free)
            yield name, channel, told
            if channel.keys() == {"column", "unit"} and not missing and unit in ("N", "N m"):
                missing[name] = _law({"column": OPEN, "unit": "A"}, position or OPEN)
        else:
            hidden.append(f"{name} [{unit}]")
            lacking = {"column": OPEN, "unit": "um" if unit == "m" else unit}
            coordinate = coordinate or {name: dict.fromkeys(parts, OPEN) or lacking}
    for name, column in sensors.items():
        told = "taken to be where the force acts; else write its own distance for the lever"
        sensor = {"reads": displacement(model, name), **_column(column)}
        yield _sensor_name(name), sensor, _and(told, column.assumed)
    if hidden and len(hidden) == len(model.coordinates) and not sensors:
        # Nothing is identified without a sensor: the only column of that kind, or one left open.
        (name, channel), *_ = coordinate.items()
        alike = [c for c in free if c.measures(model.units[name])]
        if len(alike) == len(hidden) == 1:
            used.append(alike[0])
            yield name, _column(alike[0]), f"the only column in {alike[0].unit}: check"
        else:
            names = ", ".join(c.name for c in alike[:_MOST_NAMES]) or "of any coordinate"
            yield name, channel, f"one sensor at least: {names}"
        hidden, coordinate = hidden[1:], {}
    if hidden:
        told = f"no column of its own, or more than one, for {', '.join(hidden)}: not every"
        yield "", None, f"{told} coordinate needs one"
    for name, channel in (missing | coordinate).items() if free else ():
        yield "", None, f"{name} = {inline(channel).as_string()}"
    left = [c for c in free if c.measures("m")]
    reads = ((name, text) for name in model.inputs if "*" in (text := displacement(model, name)))
    if hidden and not sensors and left and (first := next(reads, None)) is not None:
        shown = inline({"reads": first[1], **_column(left[0])}).as_string()
        yield "", None, f"a sensor beside a magnet: {_sensor_name(first[0])} = {shown}"
    return {column.name for column in used}


def _perhaps(model: Model, name: str, taken: Container[str]) -> str:
    """Say that a coordinate without a force may be meant for one of a force, without a column."""
    acted, axis = {displacement(model, one) for one in model.inputs}, _place(name)
    unread = [q for q in model.coordinates if q in acted and q not in taken and name not in acted]
    beside = [q for q in unread if axis and (_place(q) or axis)[1:] == axis[1:]]
    told = f"check: no force acts on {name}; of a sensor at a bearing, write {' or '.join(beside)}"
    return told if beside else ""


def _input(
    unit: str, column: Found | None, position: str, free: Sequence[Found]
) -> tuple[dict[str, Any], str]:
    """Return the channel of an input without a column of forces, and what is said of it."""
    told = "F = ki i + ks x; docs/experiments.md has the other laws"
    if column is not None:
        return _law(_column(column), position), _and(told, column.assumed)
    alike = [c for c in free if c.measures(unit)]
    flows = [c for c in free if c.measures("A")]
    names = ", ".join(c.name for c in (alike or flows)[:_MOST_NAMES])
    which = f"which column is it? {names}" if names else "no column looks like it"
    if flows and not alike:
        return _law({"column": OPEN, "unit": flows[0].unit or OPEN}, position), _and(which, told)
    return {"column": OPEN, "unit": unit}, which


def _law(current: Mapping[str, Any], position: str) -> dict[str, Any]:
    return {"law": "linear", "current": current, "position": position, "ki": OPEN, "ks": OPEN}


def _quantities(model: Model) -> dict[str, str]:
    return {name: model.units[name] for name in (*model.inputs, *model.coordinates)}


def _column(column: Found) -> dict[str, str]:
    return dict(column.said) or {"column": column.name, "unit": column.unit or OPEN}


def _sensor_name(name: str) -> str:
    return f"s_{name.removeprefix('F_')}"


def _parameters(model: Model) -> Iterator[_Line]:
    yield "", None, "what is known beforehand, such as"
    lengths = [p for p in model.parameters if p.positive and converts(p.unit, "m")]
    masses = [p for p in model.parameters if p.nominal is not None and converts(p.unit, "kg")]
    for each in lengths[:1]:
        yield "", None, f'{each.name} = {{ fixed = "300 mm" }}'
    for each in masses[:1]:
        start = f'{each.name} = {{ start = "{each.nominal:g} {each.unit}" }}'
        yield "", None, f"{start}, where yours is more than 40 % off this"
    names = ", ".join(f"{p.name} [{p.unit}]" for p in model.parameters)
    yield "", None, f"parameters: {names}"


def _written(table: _Container, lines: Iterable[_Line]) -> _Container:
    for key, value, told in lines:
        told = "".join(c if c.isprintable() else " " for c in told)
        if not key:
            table.add(tomlkit.comment(told))
            continue
        table[key] = inline(value)
        if told:
            table[key].comment(told)
    return table


def _and(told: str, more: str) -> str:
    return f"{told}; {more}" if more else told
