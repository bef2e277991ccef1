"""Tables of 1x phasors: a row per speed, on a rotor solved here by a few lines of numpy."""

from pathlib import Path

import numpy as np
import pytest
from coast_down import EXPERIMENT, MODEL, RPM, TRUTH, coast, identify, load, write

import rotorid as rid
from rotorid.errors import InputError
from rotorid.phasors import phasor_lines


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "model.toml").write_text(MODEL)
    write(tmp_path / "run.csv", RPM, coast(RPM))
    return tmp_path


@pytest.mark.parametrize("sense", [1, -1])
def test_exact_phasors_give_the_rotor_back(folder: Path, sense: int) -> None:
    write(folder / "run.csv", sense * RPM, coast(sense * RPM))
    estimate = identify(folder)
    assert estimate.status == "ok"
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-9)


def test_both_senses_in_one_table(folder: Path) -> None:
    rpm = np.concatenate([-RPM, RPM])
    write(folder / "run.csv", rpm, coast(rpm))
    estimate = identify(folder)
    assert {n: estimate.value(n) for n in TRUTH} == pytest.approx(TRUTH, rel=1e-9)


def test_the_loads_lie_on_their_own_lines() -> None:
    lines = phasor_lines([rid.Channel("x")], [-200.0, 300.0], [[1j], [1j]], 1e-3)

    def turns(time: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        parts = [np.cos(angle), np.sin(angle), np.cos(2 * angle), speed * np.cos(angle)]
        return np.stack(np.broadcast_arrays(*parts), axis=-1)

    expected = [[0.5, 0.5j, 0, -100], [0.5, -0.5j, 0, 150]]
    np.testing.assert_allclose(lines.clock.lines(turns), expected, atol=1e-14)
    np.testing.assert_allclose(lines.omega, [200, 300])
    np.testing.assert_allclose(lines.mean, [[-0.5j], [0.5j]])


def test_inputs_without_a_column_are_zero_and_told(folder: Path) -> None:
    text = EXPERIMENT.replace('"model.toml"', '"jeffcott"').replace(
        't_x = { fixed = "0 kg m" }', ""
    )
    estimate = identify(folder, text.replace('t_y = { fixed = "0 kg m" }', ""))
    assert estimate.value("xi") == pytest.approx(TRUTH["u_x"] / TRUTH["m"], rel=1e-9)
    assert any("F_x, F_y: taken as zero" in w for w in estimate.warnings)


def test_force_phasors_are_inputs(folder: Path) -> None:
    """A known 1x force in place of a known mass sets the scale."""
    turning = RPM * np.pi / 30
    stiffness = TRUTH["k"] - TRUTH["m"] * turning**2 + 1j * TRUTH["c"] * turning
    motion = coast(RPM) + np.column_stack([np.full_like(turning, 50.0) / stiffness, 0 * turning])
    table = np.column_stack([RPM, motion.real, motion.imag, np.full_like(RPM, 50.0), 0 * RPM])
    np.savetxt(
        folder / "run.csv",
        table[:, [0, 1, 3, 2, 4, 5, 6]],
        delimiter=",",
        header="n,xr,xi,yr,yi,f,zero",
        comments="",
    )
    text = """
model = "jeffcott"
[[records]]
kind = "phasors"
file = "run.csv"
speed = { column = "n", unit = "rpm" }
[channels]
x = { real = "xr", imag = "xi", unit = "m", std = "1 um" }
y = { real = "yr", imag = "yi", unit = "m", std = "1 um" }
F_x = { real = "f", imag = "zero", unit = "N", std = "1 mN" }
F_y = { real = "zero", imag = "zero", unit = "N", std = "1 mN" }
"""
    estimate = identify(folder, text)
    assert estimate.status == "ok"
    assert estimate.value("m") == pytest.approx(5.0, rel=1e-9)


def test_only_unbalance_over_mass_is_known_of_a_free_scale(folder: Path) -> None:
    estimate = identify(folder, EXPERIMENT.replace('m = { fixed = "5 kg" }\n', ""))
    assert estimate.status == "not_identifiable"
    told = {v.name: v.value for v in estimate.derived}
    assert told["u_x/m"] == pytest.approx(TRUTH["u_x"] / TRUTH["m"], rel=1e-9)
    assert told["k/m"] == pytest.approx(TRUTH["k"] / TRUTH["m"], rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('file = "run.csv"', 'file = "run.csv"\nskip = "1 s"', "skip in a table of phasors"),
        ('speed = { column = "n", unit = "rpm" }', "", "no speed"),
        ('kind = "phasors"', "", "a column of speeds in a record of samples"),
        ('kind = "phasors"', 'kind = "phasor"', "'samples' or 'phasors'"),
        ('amplitude = "ax", phase = "px"', 'column = "ax"', r"std in a channel of samples"),
        ('phase = "px", ', "", r"channels\.x: phase: found no such key"),
        ('amplitude = "ax"', 'amplitude = "ax", hold = "zero-order"', "hold in a phasor's"),
        ('phase = "px"', 'phase = "qx"', "no column 'qx'|'qx'"),
    ],
)
def test_keys_of_a_table(folder: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        identify(folder, EXPERIMENT.replace(old, new, 1))


def test_a_table_has_no_samples_to_inspect(folder: Path) -> None:
    with pytest.raises(InputError, match=r"records\.0\.kind: found a table of phasors"):
        load(folder).measured()
