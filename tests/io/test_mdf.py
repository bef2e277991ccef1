"""Conversions of MDF channels: numbers as asammdf has them, and nothing of the file is run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rotorid import ReadError
from rotorid.testing import open_table

asammdf = pytest.importorskip("asammdf")
MDF, Signal = asammdf.MDF, asammdf.Signal

ENDINGS = {"3.30": ".mdf", "4.10": ".mf4"}
VERSIONS = tuple(ENDINGS)
TIME = np.arange(40) / 1000
X = np.linspace(-3.3, 8.1, 40)
WHOLE = np.arange(40, dtype=np.int16) - 5
RUN = "__import__('os').system('touch RAN')"
REFUSED = "found a conversion by the formula .*; export the channel in physical values"


def block(version: str, **values: Any) -> Any:
    from asammdf.blocks import v2_v3_blocks, v4_blocks

    module = v4_blocks if version >= "4" else v2_v3_blocks
    return module.ChannelConversion(**values)


def formula(version: str) -> Any:
    return block(version, conversion_type=3 if version >= "4" else 10, formula=RUN)


def text_or(other: Any, kind: int = 7, **bounds: float) -> Any:
    """Return a table of MDF 4: 200 means no signal, all else is another conversion."""
    bounds = bounds or {"val_0": 200.0}
    size = {"val_param_nr": len(bounds), "ref_param_nr": 2, "links_nr": 6}
    parts = {"text_0": b"no signal", "default_addr": other}
    return block("4.10", conversion_type=kind, **size, **bounds, **parts)


def write(version: str, conversions: Mapping[str, Any], samples: np.ndarray = X) -> Path:
    """Write channels over time, fx and px and those named, with conversions by their names."""
    names = [name for name in dict.fromkeys(("fx", "px", *conversions)) if name != "time"]
    with MDF(version=version) as data:
        data.append([Signal(samples, TIME, name=name, unit="N") for name in names])
        for channel in data.groups[0].channels:
            if channel.name in conversions:
                channel.conversion = conversions[channel.name]
        data.save(f"run{ENDINGS[version]}", overwrite=True)
    return Path(f"run{ENDINGS[version]}")


@pytest.fixture(autouse=True)
def where_it_would_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("channel", ["time", "fx"])
@pytest.mark.parametrize("version", VERSIONS)
def test_formulas_are_refused_and_not_run(version, channel, nested):
    conversion = formula(version)
    if nested and version < "4":
        sizes = {"conversion_type": 12, "ref_param_nr": 2, "lower_0": 200.0, "upper_0": 201.0}
        texts = {"text_0": b"no signal", "default_addr": b'"2*{X}+1"'}
        conversion = block(version, **sizes, **texts)
    elif nested:
        conversion = text_or(text_or(conversion), 8, lower_0=200.0, upper_0=201.0)
    path = write(version, {channel: conversion})
    opened = open_table(path)
    assert opened.names == ["time", "fx", "px"]
    with pytest.raises(ReadError, match=rf"{path}: 0/{channel}: {REFUSED}"):
        opened.read(["0/fx"])
    if channel == "fx":
        np.testing.assert_array_equal(opened.read(["0/px"])["0/px"].values, X)
    assert not Path("RAN").exists()


@pytest.mark.parametrize("version", VERSIONS)
def test_a_draft_runs_no_formula(version, output, refusal):
    path = write(version, {"fx": formula(version)})
    assert "px" in output("new", path)
    write(version, {"time": formula(version)})
    assert "0/time: found a conversion by the formula" in refusal("new", path)
    assert not Path("RAN").exists()


def test_messages_of_a_bus_are_not_converted_as_the_file_is_opened():
    from asammdf.blocks import v4_constants as constants

    kinds = {"BusChannel": "u1", "ID": "u4", "DLC": "u1", "DataLength": "u1", "DataBytes": "(8,)u1"}
    dtype = np.dtype([(f"CAN_DataFrame.{name}", kind) for name, kind in kinds.items()])
    bus = asammdf.Source("CAN", "CAN", "", constants.SOURCE_BUS, constants.BUS_TYPE_CAN)
    with MDF(version="4.10") as data:
        frames = Signal(np.zeros(40, dtype), TIME, name="CAN_DataFrame", source=bus)
        data.append(frames, acq_source=bus, common_timebase=True)
        group = data.groups[0]
        group.channel_group.flags |= constants.FLAG_CG_BUS_EVENT
        for channel in group.channels[2:4]:
            channel.conversion = formula("4.10")
        data.save("bus.mf4")
    opened = open_table(Path("bus.mf4"))
    with pytest.raises(ReadError, match=REFUSED):
        opened.read(["0/CAN_DataFrame.ID"])
    assert not Path("RAN").exists()


@pytest.mark.parametrize("version", VERSIONS)
def test_asammdf_converts_nothing(version, monkeypatch):
    """Whatever a channel is read for: its samples, its times, its unit, or another channel."""
    linear = {"conversion_type": 1 if version >= "4" else 0, "a": 2.0, "b": 1.0}
    path = write(version, dict.fromkeys(("time", "fx"), block(version, **linear)))
    converting = type(block(version, **linear))
    monkeypatch.setattr(converting, "convert", lambda *_, **__: Path("RAN").touch())
    opened = open_table(path)
    for column in opened.read([f"0/{name}" for name in opened.names]).values():
        assert column.rate.hertz == pytest.approx(500)
        assert column.start == 1.0
    assert not Path("RAN").exists()


def pairs(count: str, number: int) -> dict[str, float]:
    raw, physical = (-2.0, 0.0, 1.5, 6.0), (5.0, -1.0, 4.0, 2.0)
    return {count: number} | {
        f"{name}_{i}": value
        for name, values in (("raw", raw), ("phys", physical))
        for i, value in enumerate(values)
    }


SIX = {"P1": 0.3, "P2": -2.0, "P3": 7.0, "P4": 0.1, "P5": 0.7, "P6": 30.0}
INVERSE = SIX | {"P1": 40.0, "P4": 2.0}
RATIO = dict.fromkeys(SIX, 0.0) | {"P2": 3.0, "P6": 7.0}
HYPERBOLIC = dict.fromkeys(SIX, 0.0) | {"P1": 3.0, "P4": 2.0}
CANCELLED = dict.fromkeys(SIX, 0.0) | {"P1": 3.0, "P5": 7.0}
GROWING = dict.fromkeys(SIX, 0.0) | {"P1": 4.0, "P2": 3.0, "P3": 1.0, "P6": 1.0, "P7": 0.5}
FALLING = dict.fromkeys(SIX, 0.0) | {"P3": 1.0, "P4": 4.0, "P5": 2.0, "P6": 0.5, "P7": -9.0}
RANGES = {"val_param_nr": 7, "default": -7.0, "lower_0": -2.0, "upper_0": 1.0, "phys_0": 3.0} | {
    "lower_1": 4.0, "upper_1": 6.0, "phys_1": 9.0,
}  # fmt: skip
KNOWN: dict[str, dict[str, Any]] = {
    "3.30": {
        "linear": {"conversion_type": 0, "a": 2.5, "b": -1.0},
        "interpolated": {"conversion_type": 1} | pairs("ref_param_nr", 4),
        "nearest": {"conversion_type": 2} | pairs("ref_param_nr", 4),
        "hyperbolic": {"conversion_type": 6} | INVERSE,
        "ratio-hyperbolic": {"conversion_type": 6} | HYPERBOLIC,
        "exponential": {"conversion_type": 7} | GROWING,
        "exponential-inverse": {"conversion_type": 7} | FALLING,
        "logarithmic": {"conversion_type": 8} | GROWING | {"P7": -30.0},
        "rational": {"conversion_type": 9} | SIX,
        "ratio": {"conversion_type": 9} | RATIO,
    },
    "4.10": {
        "none": {"conversion_type": 0},
        "linear": {"conversion_type": 1, "a": 2.5, "b": -1.0},
        "rational": {"conversion_type": 2} | SIX,
        "ratio": {"conversion_type": 2} | RATIO,
        "cancelled": {"conversion_type": 2} | CANCELLED,
        "interpolated": {"conversion_type": 4} | pairs("val_param_nr", 8),
        "nearest": {"conversion_type": 5} | pairs("val_param_nr", 8),
        "ranges": {"conversion_type": 6} | RANGES,
    },
}


@pytest.mark.parametrize("samples", [X, X.astype(np.float32), WHOLE], ids=["f8", "f4", "i2"])
@pytest.mark.parametrize("version", VERSIONS)
def test_numbers_are_those_of_asammdf(version, samples):
    made = {f"0/{name}": block(version, **values) for name, values in KNOWN[version].items()}
    path = write(version, {name[2:]: conversion for name, conversion in made.items()}, samples)
    found = open_table(path).read(made)
    with MDF(path) as data:
        expected = {name: data.get(name[2:]).samples for name in made}
    if samples is WHOLE and "0/ranges" in made:  # asammdf has integers at the ends of ranges only
        inside = ((WHOLE >= -2) & (WHOLE <= 1), (WHOLE >= 4) & (WHOLE <= 6))
        expected["0/ranges"] = np.select(inside, [3.0, 9.0], -7.0)
    digits = 2e-5 if samples.dtype == np.float32 else 1e-13
    for name, column in found.items():
        within = {"rtol": digits, "atol": digits, "err_msg": name}
        np.testing.assert_allclose(column.values, expected[name], **within)
        assert column.values.dtype == np.float64
        assert column.unit == ("N" if version >= "4" else None)


@pytest.mark.parametrize("bounds", [{}, {"kind": 8, "lower_0": 200.0, "upper_0": 201.0}])
def test_texts_among_numbers_are_missing_samples(bounds):
    samples = np.where(np.arange(40) % 7 == 3, 200.0, X)
    linear = block("4.10", conversion_type=1, a=2.5, b=-1.0)
    path = write("4.10", {"fx": text_or(linear, **bounds)}, samples)
    found = open_table(path).read(["0/fx"])["0/fx"].values
    with MDF(path) as data:
        expected = data.get("fx").samples
    assert np.isnan(found).sum() == 6
    np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_texts_alone_are_no_numbers():
    path = write("4.10", {"fx": text_or(b"a signal")})
    with pytest.raises(ReadError, match="0/fx: found a conversion to text; expected real numbers"):
        open_table(path).read(["0/fx"])


def test_missing_and_invalid_samples_are_no_numbers():
    table = block("4.10", **KNOWN["4.10"]["nearest"])
    samples, invalid = X.copy(), np.arange(40) == 11
    samples[3] = np.nan
    with MDF(version="4.10") as data:
        data.append([Signal(samples, TIME, name="fx", conversion=table, invalidation_bits=invalid)])
        data.save("run.mf4")
    found = open_table(Path("run.mf4")).read(["0/fx"])["0/fx"].values
    assert np.flatnonzero(np.isnan(found)).tolist() == [3, 11]


def test_a_group_of_many_channels_is_unpacked_once(tmp_path, monkeypatch):
    """Thousands of channels, each by itself, took more seconds than a file has."""
    from asammdf.blocks.mdf_v4 import MDF4

    samples = np.random.default_rng(3).standard_normal((50, 400))
    with MDF(version="4.10") as made:
        made.append([Signal(samples[k], np.arange(400) / 1e3, name=f"c{k}") for k in range(50)])
        made.save(tmp_path / "run.mf4", compression=2)
    load, seen = MDF4._load_data, tmp_path / "unpacked"

    def counted(*given, **more):
        with seen.open("a") as file:
            file.write(".")
        return load(*given, **more)

    monkeypatch.setattr(MDF4, "_load_data", counted)
    found = open_table(tmp_path / "run.mf4").read([f"c{k}" for k in range(50)])
    for k in range(50):
        np.testing.assert_array_equal(found[f"c{k}"].values, samples[k])
    assert 0 < len(seen.read_text()) < 10  # as it is opened too
