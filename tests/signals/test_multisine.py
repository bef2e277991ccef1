"""Multisines against their definition; phases, lines, tables."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import wavfile

import rotorid as rid
from rotorid import InputError
from rotorid.rig.files import write_excitation
from rotorid.signals.multisine import (
    Multisine,
    full_harmonics,
    leave_out,
    minimize_crest,
    multisine,
    odd_harmonics,
    orthogonal,
    schroeder_phases,
)


def test_samples_are_the_sum_of_the_lines() -> None:
    rng = np.random.default_rng(0)
    lines = np.array([1, 4, 5])
    amplitudes = rng.normal(size=(3, 2)) + 1j * rng.normal(size=(3, 2))
    signals = Multisine(2.0, lines, amplitudes, ("a", "b"))
    t = np.arange(50) / 100.0
    wave = np.exp(2j * np.pi * 2.0 * np.multiply.outer(t, lines))
    np.testing.assert_allclose(signals.samples(100.0), (wave @ amplitudes).real, atol=1e-12)
    np.testing.assert_allclose(signals.rms, signals.samples(100.0).std(axis=0))


def test_the_seed_is_a_multisine_of_zero_phases() -> None:
    lines = [1, 3, 5, 7, 9, 11]
    signals = multisine(20.0, lines, {"F": 10 * np.sqrt(2)}, phases="zero").scaled(
        np.exp(-1j * np.pi / 4)
    )
    t = np.arange(250) / 5000.0
    turns = 2 * np.pi * 20.0 * np.multiply.outer(t, lines)
    seed = (10 * np.sin(turns) + 10 * np.cos(turns)).sum(axis=1)
    np.testing.assert_allclose(signals.samples(5000.0)[:, 0], seed, atol=1e-11)


@given(st.integers(2, 40), st.integers(2, 6))
def test_sets_of_lines(highest: int, group: int) -> None:
    odd, full = odd_harmonics(2 * highest), full_harmonics(highest)
    assert (odd % 2 == 1).all()
    assert odd[-1] == 2 * highest - 1
    np.testing.assert_array_equal(full, np.arange(1, highest + 1))
    kept = leave_out(odd, group, np.random.default_rng(1))
    assert len(odd) - len(kept) == len(odd) // group
    assert set(kept) <= set(odd)


def test_schroeder_phases_of_a_flat_spectrum() -> None:
    n = np.arange(8)
    np.testing.assert_allclose(schroeder_phases(np.ones(8)), -np.pi * n * (n + 1) / 8)


def test_schroeder_beats_random_phases() -> None:
    lines = full_harmonics(60)
    sweep = multisine(1.0, lines, {"u": 1.0}).crest_factor[0]
    rng = np.random.default_rng(3)
    chance = [
        multisine(1.0, lines, {"u": 1.0}, phases="random", rng=rng).crest_factor[0]
        for _ in range(20)
    ]
    assert sweep < 1.8 < np.median(chance)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("lines", [odd_harmonics(11), odd_harmonics(79), full_harmonics(31)])
def test_crest_factor_is_minimized_and_amplitudes_are_kept(lines) -> None:
    start = multisine(20.0, lines, {"a": 2.0, "b": 3.0})
    better = minimize_crest(start)
    np.testing.assert_allclose(np.abs(better.amplitudes), np.abs(start.amplitudes))
    assert (better.crest_factor < 0.9 * start.crest_factor).all()
    assert (better.crest_factor < 1.48).all()


def test_minimizing_never_makes_it_worse() -> None:
    best = minimize_crest(multisine(1.0, full_harmonics(9), {"u": 1.0}))
    assert minimize_crest(best, steps=1).crest_factor[0] <= best.crest_factor[0] * (1 + 1e-12)


def test_inputs_apart_by_lines() -> None:
    signals = multisine(1.0, full_harmonics(12), {"a": 1.0, "b": 2.0, "c": 1.0}, apart=True)
    assert (np.count_nonzero(signals.amplitudes, axis=1) == 1).all()
    assert (np.count_nonzero(signals.amplitudes, axis=0) == 4).all()


def test_orthogonal_runs_tell_inputs_apart_best() -> None:
    runs = orthogonal(multisine(1.0, [1, 2, 5], {n: 1.0 for n in "abcd"}))
    assert len(runs) == 4
    for line in range(3):
        matrix = np.stack([run.amplitudes[line] for run in runs], axis=1)
        assert np.linalg.cond(matrix) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Multisine(1.0, [0, 1], np.ones((2, 1)), ["u"]), "whole numbers from 1"),
        (lambda: Multisine(1.0, [2, 1], np.ones((2, 1)), ["u"]), "increasing numbers"),
        (lambda: Multisine(1.0, [1], np.ones((2, 1)), ["u"]), r"amplitudes of shape \(2, 1\)"),
        (lambda: Multisine(1.0, [1], [[np.nan]], ["u"]), "finite numbers"),
        (lambda: Multisine(0.0, [1], [[1.0]], ["u"]), "more than 0 Hz"),
        (lambda: multisine(3.0, [1], {"u": 1.0}).samples(100.0), "whole multiple"),
        (lambda: multisine(10.0, [7], {"u": 1.0}).samples(140.0), "more than 140 Hz"),
        (lambda: multisine(1.0, [1, 2], {"u": [1.0, 2.0, 3.0]}), "2, for each signal"),
        (lambda: multisine(1.0, [1], {"u": 1.0}, phases="random"), "pass rng"),
        (lambda: leave_out([1, 3], 1, np.random.default_rng(0)), "2 or more"),
    ],
)
def test_bad_multisines_are_refused(build, message: str) -> None:
    with pytest.raises(InputError, match=message):
        build()


@pytest.fixture
def played() -> Multisine:
    return multisine(20.0, odd_harmonics(11), {"F_x1": 3.0, "F_y1": 1.0})


@pytest.mark.parametrize("ending", ["csv", "h5"])
def test_tables_are_read_back(tmp_path: Path, played: Multisine, ending: str) -> None:
    file = tmp_path / f"table.{ending}"
    write_excitation(played, file, 5000.0)
    record = rid.read_record(file, columns=["F_x1", "F_y1"], time="t")
    np.testing.assert_allclose(record.samples, played.samples(5000.0), rtol=1e-14)
    assert record.sample_rate == pytest.approx(5000.0)
    assert [channel.unit for channel in record.channels] == ["N", "N"]


def test_wav_is_in_parts_of_full_scale(tmp_path: Path, played: Multisine) -> None:
    write_excitation(played, tmp_path / "table.wav", 5000.0, full_scale=20.0)
    rate, samples = wavfile.read(tmp_path / "table.wav")
    assert rate == 5000
    np.testing.assert_allclose(20.0 * samples, played.samples(5000.0), atol=2e-6)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("t.txt", {}, "the ending '.txt'"),
        ("t.wav", {}, "give full_scale; the peak is"),
        ("t.wav", {"full_scale": 1.0}, "at most the full scale of 1"),
    ],
)
def test_tables_that_cannot_be_written(
    tmp_path: Path, played: Multisine, name: str, options: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        write_excitation(played, tmp_path / name, 5000.0, **options)
    assert not list(tmp_path.iterdir())
