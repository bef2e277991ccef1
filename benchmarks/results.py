"""What the deviations of modes, critical speeds and balancing hold, record by record.

    OPENBLAS_NUM_THREADS=1 python benchmarks/results.py modes 500
    OPENBLAS_NUM_THREADS=1 python benchmarks/results.py dampings 2500
    OPENBLAS_NUM_THREADS=1 python benchmarks/results.py balancing 500
    OPENBLAS_NUM_THREADS=1 python benchmarks/results.py sensitivity 500

A line after every fifty records. `modes`: an anisotropic rotor whose two bounce modes lie within a
few deviations of each other, identified from fifteen lines. `dampings`: damping ratios of the same
records from the minimum next to the truth, without the search, so that chance is told from a fault
by thousands. `balancing`: random rigid rotors in
two planes, four sensors with runout, unknown k_i, two speeds. `sensitivity`: loops of the shipped
rotor with controllers of peaks from 1.9 to 6.3, by lines of 5 Hz with noise, and nearly without;
as many pairs of coupled loops by whole records of noise; a tenth as many simulations of the rig.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import numpy as np
import scipy.signal
from result_cases import (
    Found,
    Graded,
    balanced,
    by_periods,
    by_the_rig,
    close_case,
    covered,
    held,
    true_modes,
    values_at_the_minimum,
)

import rotorid as rid
from rotorid.results.sensitivity import zone_of


def modes(count: int) -> None:
    """Print what intervals of modes and critical speeds hold."""
    found, begin = [], time.process_time()
    for seed in range(count):
        found.append(_identified(seed))
        if (seed + 1) % 50 and seed + 1 < count:
            continue
        good = [each for each in found if each.status == "ok"]
        print(f"{seed + 1} records, {len(good)} ok, {time.process_time() - begin:.0f} s")
        close = np.array([each.close for each in good])
        held = np.array([covered(each.frequency) for each in good])
        rms = _rms(np.array([each.frequency for each in good]))
        print(f"  frequency: cover {_percent(held)}, rms of error / deviation {rms}")
        among = f"{100 * held[close].mean():.1f} %" if close.any() else "-"
        print(f"  close: {_percent(close)}, of which covered {among}")
        ratios = np.array([each.damping for each in good])
        away = (ratios[..., 0] - ratios[..., 2]) / ratios[..., 1]
        rms = ", ".join(f"{v:.2f}" for v in np.sqrt((away**2).mean(axis=0)))
        print(f"  damping: cover {_percent(np.abs(away) < 1.96)}, rms {rms}")
        criticals = np.array([each.critical for each in good])
        print(
            f"  critical: cover {_percent(np.array([covered(c) for c in criticals]))}, "
            f"rms {_rms(criticals)}",
            flush=True,
        )


def dampings(count: int) -> None:
    """Print what damping ratios hold in the first 500 records, which modes has, and the others."""
    away = np.array([_ratio_errors(seed) for seed in range(count)])
    for name, part in (("first 500", away[:500]), ("others", away[500:])):
        if len(part):
            rms = ", ".join(f"{v:.3f}" for v in np.sqrt((part**2).mean(axis=0)))
            held = _percent(np.abs(part) < 1.959964)
            print(f"{name}, {len(part)} records: cover {held}, rms {rms}", flush=True)


def _ratio_errors(seed: int) -> np.ndarray:
    """Return the errors of the damping ratios of a record, in deviations by the delta method."""

    def ratios(values: dict[str, float]) -> np.ndarray:
        found = true_modes(values, 800.0)
        return -found.real / np.abs(found)

    case = close_case(seed)
    values, covariance = values_at_the_minimum(case)
    found = dict(case.truth) | values
    slopes = []
    for name, std in zip(values, np.sqrt(np.diag(covariance)), strict=True):
        sides = [ratios(found | {name: found[name] + way * 1e-4 * std}) for way in (1, -1)]
        slopes.append((sides[0] - sides[1]) / (2e-4 * std))
    spread = np.sqrt(np.einsum("im,ij,jm->m", slopes, covariance, slopes))
    return (ratios(found) - ratios(dict(case.truth))) / spread


def _by_noise(seed: int, samples: int = 20000) -> list[Graded]:
    """Grade two coupled loops by a whole record with noise added to both commands.

    Each S is 1 beside a resonance whose peak is known exactly.
    """
    rng = np.random.default_rng([seed, 14840])
    rate = 1000.0
    r = rng.standard_normal((samples, 2))
    e, peaks = [], []
    for j in range(2):
        b, a = scipy.signal.iirpeak(rng.uniform(40.0, 150.0), rng.uniform(2.0, 5.0), fs=rate)
        top = rng.uniform(1.0, 4.5) * np.asarray(b) + np.asarray(a)
        e.append(scipy.signal.lfilter(top, a, r[:, j]) + 0.1 * rng.standard_normal(samples))
        peaks.append(np.abs(scipy.signal.freqz(top, a, 20000)[1]).max())
    e[0] = e[0] + 0.2 * r[:, 1]
    channels = [rid.Channel(name) for name in ("e1", "e2", "r1", "r2")]
    record = rid.Record(channels, np.column_stack([*e, r]), sample_rate=rate)
    found = rid.sensitivity(record, {"e1": "r1", "e2": "r2"}, band=("20 Hz", "300 Hz"))
    return [Graded(peak, axis) for peak, axis in zip(peaks, found, strict=True)]


def _identified(seed: int, speed: float = 800.0) -> Found:
    """Identify a random machine with two close modes, and hold its modes against the truth."""
    case = close_case(seed, speed)
    estimator = rid.MaximumLikelihood(fixed=case.fixed, start=case.start)
    estimate = rid.identify(case.model, case.records, estimator)
    return held(case, estimate, speed) if estimate.status == "ok" else Found(estimate.status)


def _rms(rows: np.ndarray) -> str:
    away = (rows[..., 0] - rows[..., 4]) / rows[..., 1]
    return ", ".join(f"{v:.2f}" for v in np.sqrt((away**2).mean(axis=0)))


def _percent(held: np.ndarray) -> str:
    return ", ".join(f"{100 * v:.1f}" for v in held.mean(axis=0)) + " %"


def balancing(count: int) -> None:
    """Print what the stated residual holds, and how much of the unbalance is gone."""
    found, begin = [], time.process_time()
    for seed in range(count):
        found.append(balanced(seed))
        if (seed + 1) % 50 and seed + 1 < count:
            continue
        good = [each for each in found if each.status == "ok"]
        left, before = np.array([e.left for e in good]), np.array([e.before for e in good])
        stated = np.array([e.stated for e in good])
        gone = 100 * (1 - np.median(left.sum(axis=1) / before.sum(axis=1)))
        print(
            f"{seed + 1} rotors, {len(good)} ok, {time.process_time() - begin:.0f} s: residual "
            f"below the stated one {_percent(left <= stated)}, median removed {gone:.2f} %",
            flush=True,
        )


def sensitivity(count: int) -> None:
    """Print how far off peaks are, what their intervals hold, and which zones are wrong."""
    for seeds, name, graded in (
        (count, "periods", lambda seed: [by_periods(seed)]),
        (count // 5, "periods, hardly any noise", lambda seed: [by_periods(seed, (1e-4, 1e-3))]),
        (count // 2, "whole records", _by_noise),
        (count // 10, "the rig", lambda seed: [by_the_rig(seed)]),
    ):
        begin = time.process_time()
        found = [each for seed in range(seeds) for each in graded(seed)]
        off = np.array([each.off_db for each in found])
        across = [len({*map(zone_of, each.axis.interval)}) > 1 for each in found]
        print(
            f"{name}: {len(found)} loops, {time.process_time() - begin:.0f} s: "
            f"peak off by {off.mean():+.3f} dB, rms {np.sqrt((off**2).mean()):.3f}, "
            f"beyond .1 dB {100 * (np.abs(off) > 0.1).mean():.1f} %; "
            f"cover {100 * np.mean([each.held for each in found]):.1f} %; "
            f"wrong zone {100 * np.mean([each.wrong for each in found]):.1f} %, "
            f"undecided {100 * np.mean(across):.1f} %",
            flush=True,
        )


if __name__ == "__main__":
    kinds = {"modes": modes, "dampings": dampings}
    kinds |= {"balancing": balancing, "sensitivity": sensitivity}
    kinds[sys.argv[1]](int(sys.argv[2]))
