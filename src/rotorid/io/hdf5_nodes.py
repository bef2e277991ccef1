"""What is in an HDF5 file, and where: links are followed inside the file only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import h5py

from rotorid.core.errors import ReadError
from rotorid.core.frozen import frozen
from rotorid.core.limits import DEPTH, NODES
from rotorid.io.child import in_child
from rotorid.io.table import is_numeric, reading

FIRST = 50
"""Groups and data sets that are looked at when a file is opened: 10 ms."""

_HOPS = 16  # links that lead to links: what HDF5 itself allows
_ELSEWHERE = "a link into another file"
_TEXTS = (b"char", b"cell")  # what MATLAB calls text as codes, and cells


@frozen
class Node:
    """A data set, the field of it where it is a table of records, and the groups above it."""

    dataset: h5py.Dataset
    field: str | None
    above: tuple[h5py.Group, ...]

    @property
    def kind(self) -> str | None:
        """Say what it holds in place of real numbers; None where it holds these."""
        dtype = self.dataset.dtype if self.field is None else self.dataset.dtype[self.field]
        return _kind(dtype) or (_matlab_kind(self.dataset) if self.field is None else None)


@dataclass
class Found:
    """Shapes of numeric arrays by path, and what else there is.

    `whole` says that these are all of a file, `aliases` that other paths lead to them, too.
    """

    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    others: dict[str, str] = field(default_factory=dict)
    whole: bool = False
    aliases: bool = False

    def note(self, path: str, node: Node | None) -> None:
        """Take up a data set, or the fields of one that is a table of records."""
        if node is None or node.dataset.shape is None:
            return
        names = node.dataset.dtype.names
        if node.field is None and names:
            for name in names:
                self.note(f"{path}/{name}", Node(node.dataset, name, ()))
        elif (kind := node.kind) is None:
            self.shapes[path] = tuple(node.dataset.shape)
        else:
            self.others[path] = kind


class Contents(Mapping[str, tuple[int, ...]]):
    """Shapes of the numeric arrays of a file by path.

    Some are looked at when the file is opened. Of those of a larger file one that is asked for by
    its path is looked at by itself; all are only where names are searched.
    """

    def __init__(self, file: str) -> None:
        self._file, self._asked = file, set[str]()
        self._found: Found = in_child(_look, file, file, FIRST)

    @property
    def others(self) -> dict[str, str]:
        """What else there is, as far as it was looked at."""
        return self._found.others

    def __getitem__(self, path: str) -> tuple[int, ...]:
        """Return the shape of the array of a path, which links may lead to."""
        found = self._found
        new = path not in found.shapes and path not in self._asked
        if new and (found.aliases or not found.whole) and path == "/".join(_steps(path)):
            self._asked.add(path)
            there: Found = in_child(_look_at, self._file, self._file, path)
            found.shapes |= there.shapes
            found.others |= there.others
        return found.shapes[path]

    def __iter__(self) -> Iterator[str]:
        """Go through the paths of all arrays."""
        if not self._found.whole:
            every: Found = in_child(_look, self._file, self._file, NODES)
            every.shapes |= self._found.shapes  # those found behind links
            self._found.others.update(every.others)
            self._found = replace(every, others=self._found.others)
        return iter(self._found.shapes)

    def __len__(self) -> int:
        """Return how many arrays there are."""
        return sum(1 for _ in self)


def _look(file: str, most: int) -> Found:
    """Return what is in a file; where only some of it is asked for, up to what cannot be read."""
    found = Found()
    with opened(file) as data:
        try:
            for path, node in _walk(data, file, most, found):
                found.note(path, node)
        except Exception:
            if most >= NODES:
                raise
            return found
    return replace(found, whole=True)


def _look_at(file: str, path: str) -> Found:
    found = Found()
    with opened(file) as data:
        found.note(path, find(data, path, found.others))
    return found


@contextmanager
def opened(file: str) -> Iterator[h5py.File]:
    """Open an HDF5 file."""
    with reading(file, "HDF5 data"), h5py.File(file, "r") as data:
        yield data


def find(data: h5py.File, path: str, others: dict[str, str] | None = None) -> Node | None:
    """Return the data set of a path; None where there is none.

    Parameters
    ----------
    data : File
    path : str
    others : dict, optional
        Where links into other files, which are not followed, are noted.
    """
    steps, above, hops = _steps(path), [data["/"]], 0
    while steps:
        name, *steps = steps
        key = _key(above[-1], name)
        links = above[-1].id.links
        kind = None if key is None else links.get_info(key).type
        if kind == h5py.h5l.TYPE_SOFT and hops < _HOPS:
            hops, target = hops + 1, _shown(links.get_val(key))
            above = above[:1] if target.startswith("/") else above
            steps = [*_steps(target), *steps]
            continue
        if kind == h5py.h5l.TYPE_EXTERNAL and others is not None:
            file = _shown(links.get_val(key)[0])
            others[path.strip("/")] = f"{_ELSEWHERE} ({file[:80]}: name it in files)"
        if key is None or kind != h5py.h5l.TYPE_HARD:
            return None
        node = _open(above[-1], key)
        if isinstance(node, h5py.Dataset):
            field = steps[0] if len(steps) == 1 else None
            fitting = not steps if field is None else field in (node.dtype.names or ())
            return Node(node, field, tuple(above)) if fitting else None
        if not isinstance(node, h5py.Group) or len(above) > DEPTH:
            return None
        above.append(node)
    return None


def _walk(data: h5py.File, file: str, most: int, found: Found) -> Iterator[tuple[str, Node]]:
    """Yield the data sets of a file with their paths, each object once."""
    seen, count = {h5py.h5o.get_info(data.id).addr}, 0
    waiting: list[tuple[str, tuple[h5py.Group, ...]]] = [("", (data["/"],))]
    while waiting:
        prefix, above = waiting.pop()
        inner: list[tuple[str, tuple[h5py.Group, ...]]] = []
        for key in (group := above[-1]):
            key, shown = _raw(key), _shown(key)
            if shown[:1] == "#" or group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                found.aliases = True
                continue  # "#refs#" holds the cells of MATLAB
            count, path = count + 1, prefix + shown
            _check_bounds(count, path, file, most)
            node = _open(group, key)
            if node is None:  # a type that has a name
                continue
            address = h5py.h5o.get_info(node.id).addr
            if address in seen:
                found.aliases = True
                continue
            seen.add(address)
            if isinstance(node, h5py.Group):
                inner.append((f"{path}/", (*above, node)))
            elif isinstance(node, h5py.Dataset):
                yield path, Node(node, None, above)
        waiting += reversed(inner)


def _check_bounds(count: int, path: str, file: str, most: int) -> None:
    """Refuse to look through more than one has patience for."""
    if count > most or path.count("/") > DEPTH:
        many = f"more than {most} groups and data sets"
        raise ReadError(
            many if count > most else f"more than {DEPTH} groups in one another",
            "fewer to look through for a name",
            "write the whole path of each column, such as run1/x",
            file=file,
        )


def _steps(path: str) -> list[str]:
    return [step for step in path.split("/") if step not in ("", ".")]


def _key(group: h5py.Group, name: str) -> bytes | None:
    """Return a name as the file has it: in UTF-8, or as older programs of Windows wrote it."""
    for encoding in ("utf-8", "latin-1") if "\0" not in name else ():
        try:
            key = name.encode(encoding)
        except UnicodeEncodeError:
            continue
        if group.id.links.exists(key):
            return key
    return None


def _shown(key: str | bytes) -> str:
    """Return a name with the letters that it was written in."""
    raw = _raw(key)
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _raw(key: str | bytes) -> bytes:
    """Return a name as h5py takes and gives it: text, where it can be decoded."""
    return key if isinstance(key, bytes) else key.encode("utf-8", "surrogateescape")


def _open(group: h5py.Group, name: bytes) -> Any:
    """Open a node; what a data set keeps in files beside it counts from the folder of its file."""
    access = h5py.h5p.create(h5py.h5p.DATASET_ACCESS)
    access.set_efile_prefix(b"${ORIGIN}")
    match h5py.h5o.get_info(group.id, name).type:
        case h5py.h5o.TYPE_DATASET:
            return h5py.Dataset(h5py.h5d.open(group.id, name, access))
        case h5py.h5o.TYPE_GROUP:
            return h5py.Group(h5py.h5g.open(group.id, name))
    return None


def _kind(dtype: Any) -> str | None:
    """Say what a type holds in place of real numbers."""
    if dtype.kind == "b":
        return None  # a bit is an enumeration, too
    found = {
        "text": h5py.check_string_dtype(dtype) is not None or dtype.kind in "SU",
        "lists": h5py.check_vlen_dtype(dtype) is not None,
        "references": h5py.check_ref_dtype(dtype) is not None,
        "names of an enumeration": h5py.check_enum_dtype(dtype) is not None,
        "complex numbers": dtype.kind == "c",
        "a table of records": bool(dtype.names),
        "another type": not is_numeric(dtype),
    }
    return next((kind for kind, is_it in found.items() if is_it), None)


def _matlab_kind(dataset: h5py.Dataset) -> str | None:
    """Say where MATLAB wrote no numbers: text as codes, or an empty array as its size."""
    if "MATLAB_empty" in dataset.attrs:
        return "nothing"
    kind = dataset.attrs.get("MATLAB_class", b"")
    return "text or cells" if isinstance(kind, bytes) and kind in _TEXTS else None
