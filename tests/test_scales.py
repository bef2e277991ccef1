"""Data times a power of ten: the answer of the data, or a line that says what is wrong."""

from pathlib import Path

import pytest
from working_folder import make

import rotorid as rid
from rotorid import cli


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    return identified(tmp_path_factory.mktemp("plain"), 1.0)


def identified(folder: Path, scale: float) -> rid.Estimate:
    make(folder, scale)
    result = str(folder / "run.json")
    assert cli.run(["identify", str(folder / "run.toml"), "--json", result, "-q"]) == 0
    return rid.load_estimate(result)


@pytest.mark.parametrize("power", [-30, 55])
def test_the_answer_stays(answer, tmp_path, power):
    """Masses and stiffnesses are ratios of what was scaled; what the unbalance does is scaled."""
    found = identified(tmp_path, 10.0**power)
    assert found.status == "ok"
    for one, other in zip(found.parameters, answer.parameters, strict=True):
        scale = 10.0**power if one.unit == "kg m" else 1.0
        assert one.value / scale == pytest.approx(other.value, rel=1e-9)
        assert one.std / scale == pytest.approx(other.std, rel=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("power", [-320, -162, -80, 80, 155, 300])
def test_what_no_machine_measures_is_one_line(tmp_path, capsys, power):
    make(tmp_path, 10.0**power)
    for command in ("identify", "inspect"):
        assert cli.run([command, str(tmp_path / "run.toml")]) in (0, 2)
        printed = capsys.readouterr()
        assert len(printed.err.splitlines()) <= 1
        if command == "identify":
            assert "check the unit and the scale" in printed.err
