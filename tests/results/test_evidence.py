"""What a result keeps of its records: true to them, small, and the same when it is read again."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid as rid
from rotorid import with_evidence
from rotorid.answer.estimate import Evidence, Prior
from rotorid.answer.validation import at_best_phase, channel_errors
from rotorid.report.estimate_report import estimate_report
from rotorid.results import evidence as gathering
from rotorid.results.evidence import record_evidence

TURN = 2 * np.pi


@pytest.fixture(scope="module")
def model() -> rid.Model:
    return rid.load_model("jeffcott")


def periods_of(model: rid.Model, harmonics: list[int], seed: int = 4) -> rid.PeriodicRecord:
    t = np.arange(1000) / 1000.0
    angle = TURN * np.outer(t, harmonics)
    forces = 100.0 * np.column_stack([np.cos(angle).sum(axis=1), np.sin(angle).sum(axis=1)])
    record = rid.simulate(
        model,
        model.values(model.nominal),
        forces,
        sample_rate=1000.0,
        periods=20,
        speed=TURN * 20,
        noise={"F_x": 1.0, "F_y": 1.0, "x": 1e-6, "y": 1e-6},
        rng=np.random.default_rng(seed),
    )
    return rid.average(record, 1.0, harmonics=harmonics)


@pytest.fixture(scope="module")
def few(model: rid.Model) -> rid.PeriodicRecord:
    return periods_of(model, [3, 20, 50])


def test_lines_and_waves_are_those_of_the_record(model: rid.Model, few: rid.PeriodicRecord) -> None:
    estimate = rid.identify(model, few, "ml")
    (shown,) = record_evidence(estimate, model, [few])
    assert (shown.kind, shown.lines, shown.lines_per_point) == ("periods", 3, 1)
    assert (shown.periods, shown.samples_per_period, shown.sample_rate_hz) == (20, 1000, 1000.0)
    assert shown.frequency_hz == (3.0, 20.0, 50.0)
    assert shown.speed_rad_s == pytest.approx([TURN * 20] * 2, rel=1e-5)
    stated = rid.predict(model, estimate, few)
    for channel in shown.channels:
        lines = few.mean_spectrum[:, few.index(channel.name)]
        np.testing.assert_allclose(channel.measured, 2 * np.abs(lines), rtol=1e-5)
        if not channel.predicted:
            assert channel.name in ("x", "y")
            continue
        told = stated[channel.name]
        assert told is not None
        assert channel.error == pytest.approx(told.relative_error, rel=1e-5)
        wave = few.mean[:, few.index(channel.name)]
        kept = np.fft.rfft(wave, norm="forward")
        other = np.setdiff1d(np.arange(len(kept)), few.harmonics)
        kept[other] = 0
        period = np.fft.irfft(kept, n=1000, norm="forward")
        time = np.arange(1000) / 1000
        at = np.interp(shown.time_s, time, period, period=1.0)
        np.testing.assert_allclose(channel.wave_measured, at, atol=0.02 * np.abs(period).max())
    assert [channel.name for channel in shown.channels[:2]] == ["F_x", "F_y"]


@pytest.mark.slow
def test_the_noise_is_that_of_the_difference(model: rid.Model) -> None:
    """Over many records predicted - measured scatters by what is stated, motion included."""
    ratios = []
    for seed in range(12):
        record = periods_of(model, [3, 20, 50], seed)
        estimate = rid.identify(model, record, "ml")
        exact = estimate.with_(
            parameters=tuple(
                replace(v, value=float(x))
                for v, x in zip(estimate.parameters, model.values(model.nominal), strict=True)
            )
        )
        (shown,) = record_evidence(exact, model, [record])
        for channel in shown.channels[:2]:
            ratios += [d / n for d, n in zip(channel.difference, channel.noise, strict=True)]
            assert channel.wave_noise == pytest.approx(
                np.sqrt(np.square(channel.noise).sum() / 2), rel=1e-4
            )
    assert np.mean(np.square(ratios)) == pytest.approx(1.0, abs=0.35)


def test_many_lines_are_thinned_to_their_root_mean_square(model: rid.Model) -> None:
    many = periods_of(model, list(range(1, 451)))
    estimate = rid.identify(model, many, "ls")
    (shown,) = record_evidence(estimate, model, [many])
    assert (shown.lines, shown.lines_per_point, len(shown.frequency_hz)) == (450, 2, 225)
    assert shown.frequency_hz[:2] == (1.5, 3.5)
    (force,) = [c for c in shown.channels if c.name == "F_x"]
    size = 2 * np.abs(many.mean_spectrum[:2, many.index("F_x")])
    assert force.measured[0] == pytest.approx(np.sqrt(np.mean(size**2)), rel=1e-5)


@pytest.mark.slow
def test_many_records_share_the_room(model: rid.Model, few: rid.PeriodicRecord) -> None:
    estimate = rid.identify(model, few, "ls")
    shown = record_evidence(estimate, model, [few] * 40)
    assert {len(one.time_s) for one in shown} == {60_000 // (40 * 4 * 6)}
    assert {len(one.time_s) for one in record_evidence(estimate, model, [few] * 100)} == {60}


def test_a_whole_record_shows_an_excerpt(model: rid.Model) -> None:
    rng = np.random.default_rng(1)
    count, rate = 4000, 1000.0
    spectrum = np.fft.rfft(rng.standard_normal((count, 2)), axis=0)
    spectrum[np.fft.rfftfreq(count, 1 / rate) > 120.0] = 0
    forces = np.fft.irfft(spectrum, n=count, axis=0)
    record, quiet = (
        rid.simulate(
            model,
            model.values(model.nominal),
            size * forces,
            sample_rate=rate,
            periods=1,
            speed=TURN * 20,
            noise={"x": 1e-7, "y": 1e-7, "F_x": 0.1, "F_y": 0.1},
            rng=rng,
        )
        for size in (100.0, 0.0)
    )
    lines = rid.spectra(record, (2.0, 100.0), quiet=quiet)
    estimate = rid.identify(model, lines, "ml")
    (shown,) = record_evidence(estimate, model, [lines])
    assert shown.kind == "lines"
    assert shown.time_s[0] == pytest.approx(2.0, abs=0.03)
    assert np.diff(shown.time_s) == pytest.approx(1 / (10 * shown.frequency_hz[-1]), rel=0.02)
    for channel in (c for c in shown.channels if c.predicted):
        assert channel.noise
        ratio = np.sqrt(np.mean(np.square(channel.difference)) / np.mean(np.square(channel.noise)))
        assert 0.5 < ratio < 1.5  # the loose ends of the record take no noise away
        away = np.subtract(channel.wave_predicted, channel.wave_measured)
        assert np.std(away) == pytest.approx(channel.wave_noise, rel=0.6)
    for error in channel_errors(model, estimate, lines):
        assert error.noise is not None
        assert error.p_value is not None
        assert error.p_value > 1e-4


@pytest.mark.sampled(1)
@pytest.mark.parametrize("whole", [False, True])
def test_a_record_whose_rotor_angle_was_found_is_predicted(model: rid.Model, whole: bool) -> None:
    """Of another record with the same number nothing is known: it is shown as measured."""
    rng = np.random.default_rng(3)
    angle = TURN * np.outer(np.arange(1000) / 1000, [3, 20, 50])
    forces = 100.0 * np.column_stack([np.cos(angle).sum(axis=1), np.sin(angle).sum(axis=1)])
    data: list[rid.PeriodicRecord | rid.Lines] = []
    for phase in (0.0, 2.0):
        record = rid.simulate(
            model,
            model.values(model.nominal),
            forces,
            sample_rate=1000.0,
            periods=20,
            speed=TURN * 20,
            phase=phase,
            noise={"F_x": 1.0, "F_y": 1.0, "x": 1e-6, "y": 1e-6},
            rng=rng,
        )
        record = replace(record, angle=None, phase_known=not phase)
        if whole:
            data.append(rid.spectra(record, (2.0, 60.0), inputs=model.inputs))
        else:
            data.append(rid.average(record, 1.0, harmonics=[3, 20, 50]))
    estimate = rid.identify(model, data, "ml")
    assert estimate.value("phase[1]") == pytest.approx(2.0, abs=0.03)
    for shown in record_evidence(estimate, model, data):
        assert all(c.error < 0.05 for c in shown.channels if c.name in model.inputs)
    _, unknown = record_evidence(estimate, model, data, another=True)
    assert not any(channel.predicted for channel in unknown.channels)
    placed, found = at_best_phase(model, estimate, data[1], 1)
    assert found == pytest.approx(2.0, abs=0.03)
    assert all(e.relative_error < 0.05 for e in channel_errors(model, estimate, placed, 1))
    assert at_best_phase(model, estimate, data[0]) == (data[0], None)


def test_what_was_known_beforehand(model: rid.Model, few: rid.PeriodicRecord) -> None:
    method = rid.MaximumLikelihood(
        fixed={"m": 5.0},
        known={"k": ("1 kN/mm", "10 N/mm")},
        constraints=[rid.Constraint("c + 0.001*k", 1060.0, 5.0)],
        force_scale_std=0.01,
    )
    found = with_evidence(rid.identify(model, few, method), model, few, method)
    assert found.evidence is not None
    assert found.evidence.known == (
        Prior("m", 5.0, 0.0),
        Prior("k", 1e6, 1e4),
        Prior("scale[force]", 1.0, 0.01),
        Prior("c + 0.001*k", 1060.0, 5.0),
    )
    assert found.evidence.prior("x") is None


def test_it_is_read_again_and_stays_small(
    model: rid.Model, few: rid.PeriodicRecord, tmp_path: Path
) -> None:
    estimate = with_evidence(rid.identify(model, few, "ls"), model, few)
    estimate.save(tmp_path / "run.json")
    text = (tmp_path / "run.json").read_text(encoding="utf-8")
    assert rid.load_estimate(tmp_path / "run.json") == estimate
    assert len(text) < 60_000
    assert max(len(line) for line in text.splitlines() if "evidence" not in line) < 3000
    assert rid.load_estimate(tmp_path / "run.json").evidence != Evidence()


def test_an_answer_left_open_shows_what_was_measured(
    model: rid.Model, few: rid.PeriodicRecord
) -> None:
    estimate = rid.identify(model, few, "ls")
    first, *others = estimate.parameters
    lost = estimate.with_(
        parameters=(replace(first, value=float("nan")), *others), status="not_identifiable"
    )
    (shown,) = record_evidence(lost, model, [few])
    assert not any(channel.predicted for channel in shown.channels)
    assert all(channel.measured and channel.noise for channel in shown.channels)


@pytest.mark.parametrize("key", ["measured", "noise", "wave_predicted"])
def test_what_does_not_fit_together_is_refused(
    model: rid.Model, few: rid.PeriodicRecord, tmp_path: Path, key: str
) -> None:
    path = tmp_path / "run.json"
    estimate = with_evidence(rid.identify(model, few, "ls"), model, few)
    data = estimate.to_dict()
    data["evidence"]["records"][0]["channels"][0][key].pop()
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(rid.ReadError, match="numbers of each kind, or none"):
        rid.load_estimate(path)
    data["evidence"]["records"][0]["channels"][0][key] = []
    path.write_text(json.dumps(data), encoding="utf-8")
    assert "run" in estimate_report(rid.load_estimate(path))


def test_lines_that_only_noise_moves_are_left_out_over_time(
    model: rid.Model, few: rid.PeriodicRecord
) -> None:
    """Beside a resonance noise moves a prediction further than the machine moved: not shown."""
    variance = np.array([1.0, 4.1, 0.0])
    told = gathering._telling(np.array([2.0 + 0j, 2.0j, 0.1]), variance)
    assert told.tolist() == [True, False, True]
    assert gathering._telling(np.ones(2, dtype=complex), None).all()
    assert gathering._telling(np.ones(2, dtype=complex), np.full(2, 9.0)).all()  # nothing to show
    estimate = rid.identify(model, few, "ml")
    (shown,) = record_evidence(estimate, model, [few])
    assert {channel.left_out for channel in shown.channels} == {0}
