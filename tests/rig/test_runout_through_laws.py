"""Runout where a law takes the displacement from the sensor: it goes into the force as well."""

import re
from pathlib import Path

import pytest

import rotorid as rid
from rotorid import load_rig
from rotorid.cli import run as command

RUNOUT = {"s_xa": (3e-6, 1e-6), "s_ya": (-2e-6, 2e-6), "s_xb": (1e-6, -4e-6), "s_yb": (0.0, 2e-6)}
MARK = "\n\n[channels]"


def record(folder: Path, hertz: int) -> str:
    """Simulate the rigid rotor in its bent magnets; return the experiment file's text."""
    text = load_rig("rigid").text.replace("9000 rpm", f"{60 * hertz} rpm")
    text = text.replace('duration = "10 s"', 'duration = "3 s"')
    for name, (cos, sin) in RUNOUT.items():
        entry = f'runout = [{{ cos = "{cos} m", sin = "{sin} m" }}]'
        text, count = re.subn(rf"^({name} = .*) }}$", rf"\1, {entry} }}", text, flags=re.M)
        assert count == 1
    rig, out = folder / f"rig{hertz}.toml", folder / f"run{hertz}.h5"
    rig.write_text(text)
    assert command(["simulate", str(rig), "--out", str(out), "--seed", "4"]) == 0
    return out.with_suffix(".toml").read_text()


@pytest.mark.slow
def test_two_speeds_tell_runout_from_unbalance(tmp_path: Path) -> None:
    """A force that is read by the law of its magnet is k_s of the runout too large."""
    first, second = record(tmp_path, 150), record(tmp_path, 100)
    also = second[second.index("[[records]]") : second.index(MARK)]
    text = first.replace(MARK, f"\n\n{also}{MARK}").replace(
        "[parameters]", "[estimator]\nrunout = true\n\n[parameters]"
    )
    (tmp_path / "both.toml").write_text(text)
    experiment = rid.load_experiment(tmp_path / "both.toml")
    estimate = rid.identify(experiment.model, experiment.records(), experiment.estimator())
    assert estimate.status == "ok"
    truth = experiment.model.nominal
    for name in ("m", "I_t", "I_p", "xi", "zeta", "mu", "eta"):
        found = estimate[name]
        assert found.value == pytest.approx(truth[name], abs=5 * found.std), name
    assert estimate["xi"].std < 2e-6  # 0.03 m as long as the laws knew of no runout
    for name, parts in RUNOUT.items():
        for part, true in zip(("cos", "sin"), parts, strict=True):
            found = estimate[f"runout[{name}].{part}"]
            assert found.value == pytest.approx(true, abs=5 * found.std)
            assert found.std < 2e-6
