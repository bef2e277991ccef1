"""Whether the samples of an HDF5 data set are there: what nobody wrote reads as its fill value, 0.

A data set may be announced and never written, in whole or in part; its samples may lie in other
files, or be put together from other data sets, of which one may be gone.
"""

from __future__ import annotations

import math
import os
from typing import Any

import h5py
import numpy as np

from rotorid.core.errors import ReadError
from rotorid.core.files import check_beside, check_regular
from rotorid.core.limits import CHUNK_BYTES, PARTS, REFERENCES
from rotorid.io.hdf5_nodes import find, opened
from rotorid.io.table import check_held

_REWRITE = "write the data set whole, or cut it to what was recorded (dataset.resize in h5py)"


def check_stored(dataset: h5py.Dataset, file: str, depth: int = 0) -> int:
    """Refuse a data set that is not there whole; return the bytes of the files that hold it."""
    plan = dataset.id.get_create_plist()
    layout = plan.get_layout()
    held = check_regular(file).st_size
    if not dataset.size:
        return held
    if layout == h5py.h5d.VIRTUAL:
        held += _check_virtual(dataset, plan, file, depth)
    elif plan.get_external_count():
        held += _check_external(dataset, plan, file, depth)
    elif layout == h5py.h5d.CHUNKED:
        _check_chunks(dataset, file)
    elif not dataset.id.get_storage_size() and not _tells_gaps(dataset):
        raise _gap(dataset, "no sample written", file)
    check_held(dataset.size * dataset.dtype.itemsize, held, file)
    return held


def _check_chunks(dataset: h5py.Dataset, file: str) -> None:
    """Refuse chunks that fill the memory, and those that nobody wrote."""
    size = math.prod(dataset.chunks) * dataset.dtype.itemsize
    if size > CHUNK_BYTES:
        raise ReadError(
            f"chunks of {size // 10**6} MB in {_name(dataset)}",
            f"chunks of {CHUNK_BYTES // 10**6} MB at most, since each is unpacked whole",
            "write smaller chunks: h5repack -l CHUNK=10000",
            file=file,
        )
    pairs = zip(dataset.shape, dataset.chunks, strict=True)
    expected = math.prod(-(-length // chunk) for length, chunk in pairs)
    written = dataset.id.get_num_chunks()
    if written < expected and not _tells_gaps(dataset):
        raise _gap(dataset, f"{expected - written} of {expected} chunks never written", file)


def _check_external(dataset: h5py.Dataset, plan: Any, file: str, depth: int) -> int:
    """Look at the files that hold the samples; return their bytes."""
    needed, held = dataset.size * dataset.dtype.itemsize, 0
    if depth:
        raise ReadError(
            f"samples of {_name(dataset)} in files of their own",
            "parts that hold their samples",
            "write the parts whole: h5repack -l CONTI",
            file=file,
        )
    for number in range(plan.get_external_count()):
        name, offset, size = plan.get_external(number)
        path = check_beside(os.fsdecode(name), file)
        there = max(path.stat().st_size - offset, 0)
        size = min(size, needed)  # the last may be without end
        if there < size:
            raise _gap(dataset, f"{there} of {size} bytes in {path.name}", file)
        needed, held = needed - size, held + there
    if needed:
        raise _gap(dataset, f"{needed} bytes too few in the files that hold it", file)
    return held


def _check_virtual(dataset: h5py.Dataset, plan: Any, file: str, depth: int) -> int:
    """Look at the parts of a virtual data set, and that they fill it; return their files' bytes."""
    count, files = plan.get_virtual_count(), {}
    if count > PARTS or depth >= REFERENCES:
        found = f"{count} parts" if count > PARTS else f"parts of parts, {depth} deep,"
        raise ReadError(
            f"{found} of {_name(dataset)}",
            f"{PARTS} at most",
            "write it whole: h5repack",
            file=file,
        )
    covered = h5py.h5s.create_simple(dataset.shape)
    covered.select_none()
    for number in range(count):
        name = plan.get_virtual_filename(number)
        inner = plan.get_virtual_dsetname(number)
        target, origin = plan.get_virtual_vspace(number), plan.get_virtual_srcspace(number)
        if any("%b" in text.replace("%%", "") for text in (name, inner)) or _endless(target):
            raise ReadError(
                f"parts without end in {_name(dataset)}",
                "a virtual data set of parts that are named",
                "write it whole, or name each part",
                file=file,
            )
        name, inner = name.replace("%%", "%"), inner.replace("%%", "%")
        path = file if name == "." else str(check_beside(name, file))
        files[path] = _check_part(path, inner, origin, target, dataset, depth)
        _add(covered, target)
    if covered.get_select_npoints() < dataset.size:
        missing = dataset.size - covered.get_select_npoints()
        raise _gap(dataset, f"{missing} samples in none of its parts", file)
    return sum(files.values())


def _check_part(
    path: str, name: str, origin: Any, target: Any, whole: h5py.Dataset, depth: int
) -> int:
    """Look at one part of a virtual data set; return the bytes of the files that hold it."""
    with opened(path) as data:
        node = find(data, name)
        if node is None or node.field is not None or node.kind is not None:
            raise ReadError(
                f"no numbers {name[:80]!r}, a part of {_name(whole)}",
                "a data set there",
                "write that part again",
                file=path,
            )
        if origin.get_select_type() == h5py.h5s.SEL_ALL:  # as many as there are
            there: tuple[int, ...] = (node.dataset.size,)
            needed: tuple[int, ...] = (target.get_select_npoints(),)
            fits = there == needed
        else:
            there = node.dataset.shape
            needed = tuple(int(last) + 1 for last in origin.get_select_bounds()[1])
            fits = len(there) == len(needed) and all(np.greater_equal(there, needed))
        if not fits:
            raise _gap(node.dataset, f"{there} where {whole.name} takes {needed}", path)
        return check_stored(node.dataset, path, depth + 1)


def _endless(space: Any) -> bool:
    """Tell whether a selection goes on without end: then HDF5 does not say how much it is."""
    try:
        return not 0 <= space.get_select_npoints() < 2**62
    except RuntimeError:
        return True


def _add(covered: Any, space: Any) -> None:
    kind, either = space.get_select_type(), h5py.h5s.SELECT_OR
    if kind == h5py.h5s.SEL_ALL:
        covered.select_all()
    elif kind == h5py.h5s.SEL_HYPERSLABS and covered.get_select_type() != h5py.h5s.SEL_ALL:
        if space.is_regular_hyperslab():
            start, stride, count, block = space.get_regular_hyperslab()
            covered.select_hyperslab(start, count, stride, block, op=either)
        else:
            for first, last in space.get_select_hyper_blocklist():
                covered.select_hyperslab(
                    tuple(first), (1,) * len(first), None, tuple(last - first + 1), op=either
                )


def _tells_gaps(dataset: h5py.Dataset) -> bool:
    """Tell whether what was not written reads as no number, of which the record's checks tell."""
    return dataset.dtype.kind == "f" and bool(np.isnan(dataset.fillvalue))


def _name(dataset: h5py.Dataset) -> str:
    return repr(str(dataset.name)[:80])


def _gap(dataset: h5py.Dataset, found: str, file: str) -> ReadError:
    return ReadError(
        f"{found}: a gap in {_name(dataset)}", "every sample in the file", _REWRITE, file=file
    )
