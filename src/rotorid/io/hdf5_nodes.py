"""What is in an HDF5 file, and where: links are followed inside the file only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import h5py

from rotorid.errors import ReadError
from rotorid.io.table import is_numeric, reading
from rotorid.limits import DEPTH, NODES

_HOPS = 16  # links that lead to links: what HDF5 itself allows
_ELSEWHERE = "a link into another file"
_TEXTS = (b"char", b"cell")  # what MATLAB calls text as codes, and cells


@dataclass(frozen=True)
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


class Contents(Mapping[str, tuple[int, ...]]):
    """Shapes of the numeric arrays of a file by path.

    One that is asked for by its path is looked at by itself; all are only where names are searched.

    Parameters
    ----------
    file : str
    """

    def __init__(self, file: str) -> None:
        self._file, self._walked = file, False
        self._known: dict[str, tuple[int, ...]] = {}
        self.others: dict[str, str] = {}

    def __getitem__(self, path: str) -> tuple[int, ...]:
        """Return the shape of the array of a path."""
        if path not in self._known and not self._walked and path == "/".join(_steps(path)):
            with opened(self._file) as data:
                self._note(path, find(data, path, self.others))
        return self._known[path]

    def __iter__(self) -> Iterator[str]:
        """Go through the paths of all arrays."""
        if not self._walked:
            with opened(self._file) as data:
                known: dict[str, tuple[int, ...]] = {}
                self._known, known = known, self._known
                for path, dataset in _walk(data, self._file):
                    self._note(path, Node(dataset, None, ()))
                self._known |= known  # those found behind links
            self._walked = True
        return iter(self._known)

    def __len__(self) -> int:
        """Return how many arrays there are."""
        return sum(1 for _ in self)

    def _note(self, path: str, node: Node | None) -> None:
        if node is None or node.dataset.shape is None:
            return
        names = node.dataset.dtype.names
        if node.field is None and names:  # a table of records
            for name in names:
                self._note(f"{path}/{name}", Node(node.dataset, name, ()))
        elif (kind := node.kind) is None:
            self._known[path] = tuple(node.dataset.shape)
        else:
            self.others[path] = kind


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


def _walk(data: h5py.File, file: str) -> Iterator[tuple[str, h5py.Dataset]]:
    """Yield the data sets of a file with their paths, each object once."""
    seen, count = {h5py.h5o.get_info(data.id).addr}, 0
    waiting: list[tuple[str, h5py.Group]] = [("", data["/"])]
    while waiting:
        prefix, group = waiting.pop()
        inner: list[tuple[str, h5py.Group]] = []
        for key in group:
            key, shown = _raw(key), _shown(key)
            if shown[:1] == "#" or group.id.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                continue  # "#refs#" holds the cells of MATLAB
            count += 1
            path, node = prefix + shown, _open(group, key)
            _check_bounds(count, path, file)
            if node is None:  # a type that has a name
                continue
            address = h5py.h5o.get_info(node.id).addr
            if address in seen:
                continue
            seen.add(address)
            if isinstance(node, h5py.Group):
                inner.append((f"{path}/", node))
            elif isinstance(node, h5py.Dataset):
                yield path, node
        waiting += reversed(inner)


def _check_bounds(count: int, path: str, file: str) -> None:
    """Refuse to look through more than one has patience for."""
    if count > NODES or path.count("/") > DEPTH:
        many = f"more than {NODES} groups and data sets"
        raise ReadError(
            many if count > NODES else f"more than {DEPTH} groups in one another",
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
