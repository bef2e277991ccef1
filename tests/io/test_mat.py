from pathlib import Path

import numpy as np
import pytest
import scipy.io

from rotorid.errors import ReadError
from rotorid.io.mat import open_mat


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "run.mat"
    log = {"x": np.arange(4.0), "sub": {"y": np.arange(4.0)[:, None], "z": np.arange(4.0)}}
    scipy.io.savemat(
        path,
        {
            "t": np.arange(4.0)[:, None],
            "row": np.arange(4.0)[None, :],
            "pulses": np.arange(4, dtype=np.uint8)[:, None],
            "adc": np.arange(8.0).reshape(4, 2),
            "gtau": 35.15,
            "z": np.arange(4.0),
            "label": "run 7",
            "complex": np.arange(4) * 1j,
            "cells": np.array([1, "a"], dtype=object),
            "log": log,
        },
    )
    return path


def test_columns(path: Path) -> None:
    opened = open_mat(path)
    for name in ("t", "row", "pulses", "x", "log/sub/y", "y", "log/sub/z", "z"):
        column = opened.read([opened.find(name)])[opened.find(name)]
        assert column.values.dtype == np.float64
        assert column.values.tolist() == [0, 1, 2, 3]
    assert opened.read(["adc[1]"])["adc[1]"].values.tolist() == [1, 3, 5, 7]
    assert opened.scalar("gtau") == 35.15


def test_names(path: Path) -> None:
    names = {"t", "row", "pulses", "x", "y", "z", "log/sub/z"}
    assert set(open_mat(path).names) == names


@pytest.mark.parametrize("name", ["label", "complex", "cells", "adc", "gtau", "log", "adc[2]"])
def test_names_that_are_no_columns(path: Path, name: str) -> None:
    with pytest.raises(ReadError, match="expected"):
        open_mat(path).find(name)


def test_scalars_by_name(path: Path) -> None:
    with pytest.raises(ReadError, match=r"no scalar variable 'gtua'.*did you mean 'gtau'"):
        open_mat(path).scalar("gtua")


def test_uncompressed_and_compressed(tmp_path: Path) -> None:
    path = tmp_path / "c.mat"
    scipy.io.savemat(path, {"x": np.arange(1000.0)}, do_compression=True)
    assert open_mat(path).read(["x"])["x"].values[-1] == 999.0


def test_files_of_other_kinds(tmp_path: Path, path: Path) -> None:
    other = tmp_path / "other.mat"
    other.write_text("t,x\n1,2\n")
    with pytest.raises(ReadError, match=r"found text; expected a MAT file, as the ending .mat"):
        open_mat(other)
    other.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(ReadError, match="damaged HDF5 data"):
        open_mat(other)
    other.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(99))
    with pytest.raises(ReadError, match="damaged HDF5 data"):
        open_mat(other)
    other.write_bytes(path.read_bytes()[:300])
    with pytest.raises(ReadError, match="damaged MAT data"):
        open_mat(other)


def test_tags_that_scipy_would_trust(tmp_path: Path) -> None:
    """Kinds, sizes and shapes that contradict one another are refused before they are read."""
    path = tmp_path / "c.mat"
    for packed in (False, True):
        scipy.io.savemat(path, {"fx": np.arange(60.0), "log": {"y": 1.0}}, do_compression=packed)
        assert open_mat(path).find("fx") == "fx"
    scipy.io.savemat(path, {"fx": np.arange(60.0)})
    data = path.read_bytes()
    for place, value in ((177, 4), (176, 3), (156, 9), (160, 61), (128, 15), (132, 255)):
        path.write_bytes(data[:place] + bytes([value]) + data[place + 1 :])
        with pytest.raises(ReadError, match="damaged MAT data"):
            open_mat(path)
