"""Lagging amplifiers: the rig's own files are right for its own reader, images and all."""

import json
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np
import pytest

from rotorid import Channel, Record, load_rig
from rotorid.cli import run
from rotorid.force.channel_dynamics import Constant, FirstOrder
from rotorid.force.laws import Differential
from rotorid.force.reading import ForceReading, forces
from rotorid.rig.logger import decimated

LIBRARY = files("rotorid.rig") / "library"
RIGID = (LIBRARY / "rigid.toml").read_text("utf-8").replace('"10 s"', '"5 s"')
LINEAR = (LIBRARY / "three-mass.toml").read_text("utf-8").replace('"13 s"', '"5 s"')
FILES = {
    "magnets, measured": RIGID,
    "magnets, commanded": RIGID.replace('current = "measured"', 'current = "command"'),
    "flux": RIGID.replace(
        'bandwidth = "1.5 kHz"',
        'bandwidth = "1.5 kHz"\nflux = { area = "4 cm^2", noise = "1 mT" }',
    ),
    "linear, commanded": LINEAR.replace('limit = "3 A"', 'limit = "3 A"\nbandwidth = "1 kHz"'),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", FILES)
def test_a_rigs_own_file_is_accepted(name: str, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(FILES[name])
    out, result = tmp_path / "run.h5", tmp_path / "run.json"
    assert run(["simulate", str(tmp_path / "rig.toml"), "--out", str(out)]) == 0
    assert run(["identify", str(tmp_path / "run.toml"), "--json", str(result)]) == 0
    found = json.loads(result.read_text())
    assert found["status"] == "ok"
    assert found["misfit"]["p_value"] > 0.001
    truth = load_rig("rigid" if "linear" not in name else "three-mass").rig.values
    for parameter in found["parameters"]:
        if not parameter["fixed"]:
            off = abs(parameter["value"] - truth[parameter["name"]])
            assert off < 5 * parameter["std"], parameter["name"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FILES if "linear" not in name])
def test_a_rigs_own_file_is_accepted_at_a_hundredth_of_its_noise(name: str, tmp_path: Path) -> None:
    """No image, and no kink of the currents, is left: a lag of .1 us would be rejected."""

    def less(match: re.Match[str]) -> str:
        return f'{match[1]}"{float(match[2]) / 100:g} {match[3]}"'

    text = re.sub(r'((?:noise|jitter) = )"([\d.]+) (\w+)"', less, FILES[name])
    text = re.sub(r'(\nF_\w+ = )"([\d.]+) (N)"', less, text).replace('"5 s"', '"2 s"')
    (tmp_path / "rig.toml").write_text(text)
    out, result = tmp_path / "run.h5", tmp_path / "run.json"
    assert run(["simulate", str(tmp_path / "rig.toml"), "--out", str(out)]) == 0
    assert run(["identify", str(tmp_path / "run.toml"), "--json", str(result)]) == 0
    found = json.loads(result.read_text())
    assert found["status"] == "ok"
    assert found["misfit"]["cost"] < 2 * found["misfit"]["expected"]


@pytest.mark.slow
def test_a_rig_without_bias(tmp_path: Path) -> None:
    """One magnet at a time; currents logged as fast as they bend give the rotor."""
    text = RIGID.replace('"5 s"', '"2 s"').replace('bias = "2.5 A"', 'bias = "0 A"')
    text = text.replace('limit = "2.4 A"', 'limit = "4 A"')
    text = text.replace('sample_rate = "10 kHz"', 'sample_rate = "40 kHz"')
    (tmp_path / "rig.toml").write_text(text.replace("oversampling = 8", "oversampling = 2"))
    out, result = tmp_path / "run.h5", tmp_path / "run.json"
    assert run(["simulate", str(tmp_path / "rig.toml"), "--out", str(out)]) == 0
    assert 'bias = "0 A"' in out.with_suffix(".toml").read_text()
    with h5py.File(out) as data:
        force, current = data["truth/force"][:, 0], data["truth/current"][:, 0]
    assert np.all(force * current >= 0)
    assert np.min(np.abs(current)) < 0.01 < 1 < np.max(np.abs(current))
    assert run(["identify", str(tmp_path / "run.toml"), "--json", str(result)]) == 0
    found = json.loads(result.read_text())
    assert found["status"] == "ok"
    for parameter in found["parameters"]:
        if not parameter["fixed"]:
            off = parameter["value"] - load_rig("rigid").rig.values[parameter["name"]]
            assert abs(off) < 4 * parameter["std"], parameter["name"]


def test_an_amplifier_in_a_law_that_bends() -> None:
    """A held command, a first-order lag, opposed magnets: the force against fine integration."""
    rate, period, lag, fine = 10e3, 1000, 1 / (2 * np.pi * 1500.0), 40
    law = Differential(constant=1e-5, bias=2.0, gap=4e-4)
    t = np.arange(period) / rate
    command = 0.6 * np.cos(2 * np.pi * 110.0 * t) + 0.4 * np.sin(2 * np.pi * 290.0 * t)

    def place(time: np.ndarray) -> np.ndarray:
        return 5e-5 * np.cos(2 * np.pi * 70.0 * time + 1.0)

    step = 1 / rate / fine
    steps = np.exp(-step * np.arange(fine) / lag)
    current, flowing = 0.0, np.zeros(period * fine)
    for _ in range(3):  # until it repeats
        for k, held in enumerate(command):
            flowing[k * fine : (k + 1) * fine] = held + (current - held) * steps
            current = held + (current - held) * np.exp(-fine * step / lag)
    # The rotor turns smoothly between the fine steps, on which the current is exact.
    when = np.arange(period * fine) * step
    truth = np.fft.rfft(law.force(flowing, place(when)))[:40] / fine
    behind = FirstOrder(bandwidth=Constant("bandwidth", "Hz", 1500.0), actuator=True)
    channels = [Channel("i", "A", hold=True, dynamics=behind), Channel("x", "m")]
    samples = np.tile(np.stack([command, place(t)], axis=1), (4, 1))
    record = Record(channels, samples, rate)
    read = forces(record, {"F": ForceReading(law, ("i",), {"x": 1.0})}, period=period)
    found = np.fft.rfft(read.column("F")[period : 2 * period])[:40]
    assert np.abs(found - truth).max() < 3e-4 * np.abs(truth).max()
    plain = replace(record, channels=(replace(channels[0], dynamics=None), channels[1]))
    wrong = forces(plain, {"F": ForceReading(law, ("i",), {"x": 1.0})}, period=period)
    lines = np.fft.rfft(wrong.column("F")[period : 2 * period])[:40]
    assert np.abs(lines - truth).max() > 0.05 * np.abs(truth).max()


def test_converters_let_lines_through_and_images_not() -> None:
    every, count = 8, 4000
    t = np.arange(count * every) / every
    inside = np.cos(2 * np.pi * 0.09 * t + 0.3)
    image = np.cos(2 * np.pi * 0.95 * t)
    kept = decimated(np.stack([inside, image], axis=1), every)
    assert kept.shape == (count, 2)
    middle = slice(50, -50)
    np.testing.assert_allclose(kept[middle, 0], inside[::every][middle], atol=3e-6)
    assert np.abs(kept[middle, 1]).max() < 3e-6
    np.testing.assert_array_equal(decimated(inside, 1), inside)
