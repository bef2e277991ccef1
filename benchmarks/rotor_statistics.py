"""What the intervals of a drawn rotor hold, record by record; all of the shipped one.

    python benchmarks/rotor_statistics.py [COUNT [ROWS]]
    python benchmarks/rotor_statistics.py dampings [COUNT [ROWS]]
    python benchmarks/rotor_statistics.py frequencies [COUNT [ROWS]]

Line spectra of four sensors and four forces with a covariance that is known, ten unknowns; of the
first `MODES` records also the modes at speed and nearly at rest, where forward and backward whirl
come close, and of the first `CRITICALS` the critical speeds. `dampings`: all three kinds of it, and
amplifiers of an unknown bandwidth. `frequencies`: two stiffness factors, a mass and the stiffness
of two springs from three natural frequencies of the free rotor and three of it on the springs, no
record. With a file ROWS every draw is a line of it, and what it holds is not drawn again.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import numpy as np
import scipy.linalg
from rotor_files import CORED

import rotorid as rid
import rotorid.models
from rotorid.force.channel_dynamics import UNKNOWN, Constant, FirstOrder
from rotorid.results.machine import machine_of
from rotorid.results.modes import critical_speeds
from rotorid.testing import line_record

FLEXIBLE = (Path(rotorid.models.__file__).parent / "library" / "flexible.toml").read_text("utf-8")
SENSORS = ("x_a", "y_a", "x_b", "y_b")
SPEED = 2 * np.pi * 100
SLOW = 2 * np.pi * 0.1
"""Forward and backward whirl lie 1 mHz apart, one or two deviations."""
LINES = (3, 6, 9, 10, *range(12, 61, 3))  # the rotation is on the tenth
PERIODS = 60
MODES, CRITICALS = 500, 500
BAND = 2000.0
"""Hz up to which modes are looked at."""
NORMAL = 1.959964
BANDWIDTH = 800.0
HAMMER = 2e-4
"""Deviation of a natural frequency, as a share of it."""


def drawn(number, model, bandwidth=None):
    """Return the truth of a record and its lines."""
    rng = np.random.default_rng([2026, number])
    forces = 6 * np.exp(2j * np.pi * rng.random((len(LINES), 4)))
    plan = rid.Plan(
        forces,
        LINES,
        10.0,
        20000.0,
        PERIODS,
        noise={**dict.fromkeys(model.inputs, 0.16), **dict.fromkeys(SENSORS, 0.5e-6)},
        speed=SPEED,
        sensors=SENSORS,
    )
    values = {
        name: value * rng.uniform(0.9, 1.1) if value else value
        for name, value in model.nominal.items()
    }
    values["I_p_w"] = values["I_t_w"] * model.nominal["I_p_w"] / model.nominal["I_t_w"]  # a disc's
    record = line_record(
        model,
        model.values(values),
        forces,
        harmonics=LINES,
        fundamental=10.0,
        sample_rate=20000.0,
        periods=1,
        speed=SPEED,
        sensors=SENSORS,
    )
    lines, mean = plan.lines(model), record.spectra[0].copy()
    if bandwidth is not None:  # the columns of the forces are those before the amplifiers
        mean[:, :4] *= 1 + 10j * np.array(LINES)[:, None] / bandwidth
    std = np.sqrt(np.einsum("kii->ki", lines.covariance.matrices).real / 2)
    noise = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape))
    return values, replace(lines, mean=mean + noise)


def away(estimate, truth):
    """Return the errors in deviations, by name."""
    return {
        v.name: (v.value - truth[v.name]) / v.std
        for v in (*estimate.parameters, *estimate.nuisance)
        if not v.fixed and v.std
    }


def row(estimate, truth):
    """Return what is kept of an estimate."""
    found = {"status": estimate.status, "away": away(estimate, truth)}
    if estimate.misfit is not None:
        found |= {"cost": estimate.misfit.cost, "expected": estimate.misfit.expected}
        found["p"] = estimate.misfit.p_value
    return found


def true_modes(model, values, speed):
    """Return lambda of the lightly damped modes below `BAND`, ascending."""
    m = model.require_linear().matrices(model.values(values), speed)
    n = len(m.M)
    unit = 1e3
    lower = scipy.linalg.solve(m.M, np.hstack([-m.K / unit, -(m.D + speed * m.G)]))
    matrix = np.block([[np.zeros((n, n)), unit * np.eye(n)], [lower]])
    found = scipy.linalg.eigvals(matrix)
    light = (found.imag > 2 * np.pi) & (found.imag < 2 * np.pi * BAND)
    found = found[light & (np.abs(found.real) < 0.1 * np.abs(found))]
    polished = [polished_mode(m.M, m.D + speed * m.G, m.K, value) for value in found]
    return np.array(sorted(polished, key=lambda value: value.imag))


def polished_mode(mass, damping, stiffness, value):
    """Return lambda without the rounding of the state matrix, by two-sided inverse iteration.

    That is as large as the damping of 3e-6 which internal damping gives the nutation at 11 Hz.
    """
    rng = np.random.default_rng(1)
    right, left = rng.standard_normal((2, len(mass)))
    for _ in range(3):
        pencil = value**2 * mass + value * damping + stiffness
        factor = scipy.linalg.lu_factor(pencil)
        right = scipy.linalg.lu_solve(factor, right)
        left = scipy.linalg.lu_solve(factor, left, trans=2)
        right, left = right / np.linalg.norm(right), left / np.linalg.norm(left)
        slope = 2 * value * mass + damping
        value = value - (left.conj() @ pencil @ right) / (left.conj() @ slope @ right)
    return value


def true_criticals(model, values):
    """Return the two critical speeds of the first bending: the natural frequency there again."""
    found = []
    for which in (0, 1):
        speed = 2 * np.pi * 230.0
        for _ in range(12):
            near = [v.imag for v in true_modes(model, values, speed) if v.imag > 2 * np.pi * 150]
            speed = near[which]
        found.append(speed)
    return found


def of_modes(estimate, model, truth, speed):
    """Return errors in deviations, and whether the interval holds, of each mode; how many close."""
    found = [
        m
        for m in rid.modes(estimate, speed=speed).modes
        if 1.0 < m.frequency_hz < BAND and abs(m.damping_ratio) < 0.1
    ]
    true = true_modes(model, truth, speed)
    if len(true) != len(found):
        return {"lost": len(true) - len(found)}
    hertz = true.imag / (2 * np.pi)
    pairs = list(zip(found, hertz, -true.real / np.abs(true), strict=True))
    return {
        "frequency": [(m.frequency_hz - t) / m.std_hz for m, t, _ in pairs],
        "held": [bool(m.interval_hz[0] <= t <= m.interval_hz[1]) for m, t, _ in pairs],
        "damping": [(m.damping_ratio - z) / m.damping_std for m, _, z in pairs],
        "close": sum(m.close for m in found),
    }


def records(number):
    """Identify one record, ten unknowns."""
    model = rid.load_model("flexible")
    truth, lines = drawn(number, model)
    estimate = rid.identify(model, lines, "ml")
    found = row(estimate, truth)
    if number < MODES and estimate.status == "ok":
        found["modes"] = of_modes(estimate, model, truth, SPEED)
        found["modes, slow"] = of_modes(estimate, model, truth, SLOW)
    if number < CRITICALS and estimate.status == "ok":
        speeds = critical_speeds(machine_of(estimate), 1600.0)
        true = true_criticals(model, truth)
        if len(speeds) == len(true):
            held = [c.interval[0] <= t <= c.interval[1] for c, t in zip(speeds, true, strict=True)]
            found["criticals"] = [bool(each) for each in held]
        else:
            found["criticals"] = [False, False]
    return found


DAMPED = (
    FLEXIBLE.replace('internal = "c_i"', 'internal = "c_i"\nexternal = "c_e"\nstructural = "eta"')
    + 'c_e = { unit = "1/s", nominal = 2.0 }\neta = { unit = "1", nominal = 4e-3 }\n'
)


def dampings(number):
    """Identify one record with three kinds of damping, amplifiers of unknown bandwidth before."""
    model = rid.parse_model(DAMPED)
    truth, lines = drawn(number, model, BANDWIDTH)
    lag = FirstOrder(
        bandwidth=Constant("bandwidth", "Hz", 1000.0, UNKNOWN), actuator=True, shared="amplifiers"
    )
    channels = tuple(
        replace(c, dynamics=lag) if c.name in model.inputs else c for c in lines.channels
    )
    corrected = np.ones(lines.mean.shape, dtype=complex)
    corrected[:, :4] = lag.correction(lines.omega)[:, None]
    matrices = lines.covariance.matrices * corrected[:, :, None] * corrected[:, None, :].conj()
    lines = replace(
        lines,
        channels=channels,
        mean=lines.mean * corrected,
        covariance=replace(lines.covariance, matrices=matrices),
    )
    estimate = rid.identify(model, lines, "ml")
    return row(estimate, truth | {"bandwidth[amplifiers]": BANDWIDTH})


SOUGHT = {"s_A": 0.2, "s_B": 0.2, "m_w": 0.1, "k_s": 0.3}
"""What is sought, and by what share it is off its nominal value at the most."""


def hammered(number):
    """Return the model, the truth, and what a hammer test of the free and sprung rotor gave."""
    rng = np.random.default_rng([1313, number])
    model = rid.parse_model(CORED)
    truth = {n: v * (1 + SOUGHT[n] * rng.uniform(-1, 1)) for n, v in model.nominal.items()}
    modes = []
    for test in ({"k_s": 0.0}, {}):
        m = model.require_linear().matrices(model.values(truth | test), 0.0)
        squares = scipy.linalg.eigh(m.K, m.M, eigvals_only=True)
        hertz = np.sqrt(squares[squares > (2 * np.pi) ** 2])[:6:2] / (2 * np.pi)  # two planes
        modes += [
            rid.Mode(f * (1 + HAMMER * rng.standard_normal()), f * HAMMER, parameters=test)
            for f in hertz
        ]
    return model, truth, modes


def frequencies(number):
    """Identify one rotor from six natural frequencies."""
    model, truth, modes = hammered(number)
    estimate = rid.identify(model, [], rid.MaximumLikelihood(modes=modes))
    return row(estimate, truth)


def percent(held):
    """Return shares in percent, by column."""
    return ", ".join(f"{100 * share:.1f}" for share in np.atleast_1d(np.mean(held, axis=0)))


def told(rows):
    """Print what all rows together hold."""
    good = [each for each in rows if each["status"] in ("ok", "rejected")]
    counts = {s: sum(each["status"] == s for each in rows) for s in {e["status"] for e in rows}}
    errors = np.array([list(each["away"].values()) for each in good])
    names = list(good[0]["away"])
    each = ", ".join(
        f"{name} {100 * held:.1f} (rms {rms:.2f})"
        for name, held, rms in zip(
            names,
            (np.abs(errors) < NORMAL).mean(axis=0),
            np.sqrt((errors**2).mean(axis=0)),
            strict=True,
        )
    )
    ratio = np.sum([e["cost"] for e in good]) / np.sum([e["expected"] for e in good])
    error = np.std([e["cost"] / e["expected"] for e in good]) / np.sqrt(len(good))
    print(
        f"{len(rows)} draws, {counts}: {100 * (np.abs(errors) < NORMAL).mean():.2f} % held ({each})"
    )
    print(f"  J {ratio:.4f} +- {error:.4f} of its expectation")
    print(f"  rejected at 5 %: {100 * np.mean([e['p'] < 0.05 for e in good]):.1f} %")
    for kind in ("modes", "modes, slow"):
        some = [each[kind] for each in good if kind in each and "held" in each[kind]]
        if some:
            ratios = percent(np.abs([each["damping"] for each in some]) < NORMAL)
            print(
                f"  {kind}, {len(some)} records, {sum(e['close'] for e in some)} close: "
                f"frequencies {percent([e['held'] for e in some])}; damping {ratios} % held"
            )
    lost = sum("lost" in each.get(kind, {}) for each in good for kind in ("modes", "modes, slow"))
    criticals = [each["criticals"] for each in good if "criticals" in each]
    if criticals:
        print(f"  critical speeds, {len(criticals)} records: {percent(criticals)} %; lost {lost}")
    sys.stdout.flush()


def main(kind: Callable, count: int, path: Path | None) -> None:
    """Draw what is not in the file yet."""
    rows = []
    if path is not None and path.exists():
        rows = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    begin = time.process_time()
    for number in range(len(rows), count):
        rows.append(kind(number))
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
        if (number + 1) % 50 == 0:
            told(rows)
    told(rows)
    print(f"{time.process_time() - begin:.0f} s of processor time")


if __name__ == "__main__":
    words = sys.argv[1:]
    kinds = {"dampings": dampings, "frequencies": frequencies}
    chosen = kinds[words.pop(0)] if words and words[0] in kinds else records
    main(chosen, int(words[0]) if words else 1000, Path(words[1]) if len(words) > 1 else None)
