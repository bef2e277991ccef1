"""The noise of lines, drawn without samples, is that of samples."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorid.rig.file import load_rig
from rotorid.rig.linear_loop import LineNoise
from rotorid.signals.spectrum import line_spectra
from rotorid.studies.drawn_lines import without_noise
from rotorid.studies.plan import load_study
from rotorid.studies.study_case import changed

LINES, PERIOD, SIZE = np.array([1, 3, 7, 11]), 1 / 20, 500  # of the shipped rig three-mass
DOCS = Path(__file__).parents[2] / "docs"


def test_noise_of_the_logger_alone_is_white():
    """A line of a period of N samples has s^2 / N, circular, whatever the loop."""
    rig = load_rig("three-mass").rig
    alone = replace(without_noise(rig), actuators=rig.actuators)
    noise = LineNoise.of(alone, 2 * np.pi * LINES / PERIOD, PERIOD)
    drawn = noise.draw(4000, np.random.default_rng(1))
    assert not drawn[:, :, 4:].any()
    own = drawn[:, :, :4].reshape(4000, -1) * np.sqrt(SIZE) / rig.parts[0].noise
    assert own.T @ own.conj() / 4000 == pytest.approx(np.eye(16), abs=0.08)
    assert own.T @ own / 4000 == pytest.approx(np.zeros((16, 16)), abs=0.08)


@pytest.mark.parametrize("kept", ["sensors", "process_noise"])
def test_noise_through_the_loop_is_that_of_its_samples(kept):
    """Variances, correlations of the columns, and what a period leaves to the next."""
    rig = load_rig("three-mass").rig
    rig, periods = replace(without_noise(rig), **{kept: getattr(rig, kept)}), 160
    columns = rig.record(PERIOD * periods, np.random.default_rng(2)).columns
    samples = np.stack([column.samples for column in columns], axis=1)
    seen = line_spectra(samples.reshape(periods, SIZE, -1), LINES)
    noise = LineNoise.of(rig, 2 * np.pi * LINES / PERIOD, PERIOD)
    drawn = noise.draw(8000, np.random.default_rng(3))
    for line in range(len(LINES)):
        large, few = np.cov(drawn[:, line].T), np.cov(seen[:, line].T)
        scale = np.sqrt(np.diag(large).real)
        assert np.abs((few - large) / np.outer(scale, scale)).max() < 4.5 / np.sqrt(periods)
    every = [x - x.mean(axis=0) for x in (seen, drawn)]
    lags = [(x[1:] * x[:-1].conj()).real.mean(axis=0) / x.var(axis=0) for x in every]
    assert np.abs(lags[0] - lags[1]).max() < 4 / np.sqrt(2 * periods)


@pytest.mark.slow
def test_a_study_on_lines_agrees_with_one_of_samples():
    """Deviations, errors and cover of the rigid rotor, on nonlinear magnets, both ways."""
    plan, found = load_study(DOCS / "calibration-rigid.toml"), {}
    for noise in ("samples", "lines"):
        rows = []
        for number in range(0, 300, 15):  # currents measured; no encoder, which has its own errors
            case = plan.case(number)
            for place, value in {("duration",): "2 s", ("logger", "encoder"): "absent"}.items():
                changed(case.rig, place, value)
            rows.append(replace(case, noise=noise, changes=[]).run())
        assert [row["status"] for row in rows] == ["ok"] * 20
        names = [key.removesuffix("_true") for key in rows[0] if key.endswith("_true")]
        each = [[(r[n] - r[f"{n}_true"], r[f"{n}_std"]) for r in rows] for n in names]
        covered = np.mean([[r[f"{n}_covered"] for r in rows] for n in names])
        found[noise] = (*np.sqrt(np.mean(np.square(each), axis=1)).T, covered)
    (rms, std, cover), (own_rms, own_std, own_cover) = found.values()
    assert own_std / std == pytest.approx(np.ones(len(std)), abs=0.1)
    assert own_rms / rms == pytest.approx(np.ones(len(rms)), abs=0.7)
    assert np.log(own_rms / rms).mean() == pytest.approx(0.0, abs=0.3)
    assert own_cover == pytest.approx(cover, abs=0.07)
