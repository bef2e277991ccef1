"""How fast maximum likelihood is: the demo's record, scipy on the same residual, a large model.

    OPENBLAS_NUM_THREADS=1 python benchmarks/ml.py

From line spectra to estimate, all stages of the homotopy, from starts +-40 % off: for the paper's
rotor with all coordinates measured and with its four bearing sensors, and for a shaft of 40
coordinates with 60 lines and 25 parameters. What the told answer takes is held against its minimum
by a ratio, which no machine moves: facts of the model are found once. Beside the first two the same
stages of the same residual by `scipy.optimize.least_squares`, which takes its derivatives by
differences.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from rotorid import MaximumLikelihood
from rotorid.answer.identify import identify
from rotorid.data.observation import Observation, bind
from rotorid.data.record import PeriodicRecord
from rotorid.demo import demo_plan
from rotorid.likelihood.fit import Fit, Fitting, answered
from rotorid.likelihood.preparation import prepare
from rotorid.likelihood.solver import STAGES
from rotorid.likelihood.unknowns import Nuisances
from rotorid.models import Model, load_model, parse_model
from rotorid.models.knowledge import Knowledge
from rotorid.testing import add_noise, line_record

UNBALANCE = {"xi", "zeta", "mu", "eta"}
BEARINGS = ("x1", "y1", "x3", "y3")


def demo_record(model: Model, sensors: tuple[str, ...] | None, seed: int) -> PeriodicRecord:
    """Return the demo's record, its lines only."""
    plan = demo_plan(model)
    clean = line_record(
        model,
        model.values(model.nominal),
        plan.forces,
        harmonics=plan.harmonics,
        fundamental=plan.fundamental,
        sample_rate=plan.sample_rate,
        periods=plan.periods,
        speed=plan.speed,
        sensors=sensors,
    )
    return add_noise(clean, plan.noise, np.random.default_rng(seed))


def start_of(model: Model, seed: int, spread: float = 0.4) -> dict[str, float]:
    """Return starts within +-spread of the truth, of what is not unbalance."""
    rng = np.random.default_rng(seed)
    return {
        name: value * (1 + spread * rng.uniform(-1, 1))
        for name, value in model.nominal.items()
        if name not in UNBALANCE
    }


def median_time(work: Callable[[int], object], repeats: int) -> float:
    """Return the median processor time in s of work on several seeds, after one to warm up."""
    work(0)
    times = []
    for seed in range(repeats):
        begin = time.process_time()
        work(seed)
        times.append(time.process_time() - begin)
    return float(np.median(times))


def by_scipy(model: Model, record: PeriodicRecord, knowledge: Knowledge) -> tuple[float, int]:
    """Return cost and evaluations of scipy on the same residual, stage after stage."""
    prepared = prepare(model, knowledge, (), False, {})
    problem = prepared.of([bind(model, record)])
    layout = prepared.layout
    x, free = layout.start.copy(), layout.free
    # Unbalance starts from zero: its scale is that of what the model declares.
    scale = np.array([abs(model.nominal[layout.unknowns[i].name]) for i in free])
    evaluations = 0
    for relaxation in STAGES:

        def residual(z: np.ndarray, relaxation: float = relaxation) -> np.ndarray:
            nonlocal evaluations
            evaluations += 1
            moved = x.copy()
            moved[free] = z * scale
            return problem.at(moved, relaxation).residual

        last = relaxation == 0
        tolerance = 1e-10 if last else 1e-3
        found = least_squares(
            residual, x[free] / scale, method="lm", xtol=tolerance, ftol=tolerance
        )
        x[free] = found.x * scale
    return problem.at(x).cost, evaluations


def minimum(model: Model, records: Sequence[Observation], knowledge: Knowledge) -> Fit:
    """Return the minimum with its deviations, without a word of what it means."""
    steps = Fitting(model, knowledge, Nuisances(), covariance="white").located(records)
    return answered(deque(steps, maxlen=1).pop().fit)


def compare(name: str, sensors: tuple[str, ...] | None, fixed: dict[str, float]) -> None:
    model = load_model("three-mass")
    records = [demo_record(model, sensors, seed) for seed in range(40)]
    starts = [{n: v for n, v in start_of(model, s).items() if n not in fixed} for s in range(40)]
    known = [Knowledge(fixed=fixed, start=start) for start in starts]

    def ours(seed: int) -> float:
        found = minimum(model, [bind(model, records[seed])], known[seed])
        return found.solution.point.cost

    def whole(seed: int) -> object:
        estimator = MaximumLikelihood(fixed=fixed, start=starts[seed])
        return identify(model, records[seed], estimator)

    def theirs(seed: int) -> float:
        return by_scipy(model, records[seed], known[seed])[0]

    fitted, estimated, other = (
        median_time(ours, 40),
        median_time(whole, 40),
        median_time(theirs, 8),
    )
    agree = sum(abs(theirs(seed) - ours(seed)) < 1e-3 * ours(seed) for seed in range(8))
    evaluations = by_scipy(model, records[0], known[0])[1]
    print(
        f"{name}: {1e3 * fitted:.1f} ms to the minimum and its covariance, "
        f"{1e3 * estimated:.1f} ms to the told answer, {estimated / fitted:.2f} times as long; "
        f"scipy {1e3 * other:.0f} ms ({evaluations} evaluations), {other / fitted:.0f} times as "
        f"long, with the same minimum in {agree} of 8"
    )


def shaft(stations: int = 20) -> Model:
    """A shaft of lumped masses in two planes: 2 x 20 coordinates, 25 parameters."""
    half = stations // 2
    equations = []
    for axis, other, sign in (("x", "y", "+"), ("y", "x", "-")):
        for i in range(stations):
            mass, here = f"m{i // 2 + 1}", f"{axis}{i}"
            terms = [f"{mass}*{here}''", f"{sign} g*Omega*{other}{i}'", f"+ c*{here}'"]
            for j in (i - 1, i + 1):
                if 0 <= j < stations:
                    terms.append(f"+ k{min(i, j) // 2 + 1}*({here} - {axis}{j})")
            if i in (0, stations - 1):
                terms.append(f"+ ks*{here}")
            right = f"F_{axis}{i}" if i in (0, stations - 1) else "0"
            if i == half:
                wave = ("cos", "sin", "-") if axis == "x" else ("sin", "cos", "+")
                right = f"{mass}*Omega^2*(xi*{wave[0]}(phi) {wave[2]} zeta*{wave[1]}(phi))"
            equations.append(f"{' '.join(terms)} = {right}")
    rng = np.random.default_rng(4)
    text = "equations = [\n" + ",\n".join(f'"{e}"' for e in equations) + "\n]\n"
    lines = ['title = "a shaft"', text, "[coordinates]"]
    lines += [f'{axis}{i} = "m"' for axis in "xy" for i in range(stations)]
    lines += ["[inputs]"]
    lines += [f'F_{axis}{i} = "N"' for axis in "xy" for i in (0, stations - 1)]
    lines += ["[parameters]"]
    for i in range(half):
        value = 1.0 + 0.3 * rng.uniform()
        lines.append(f'm{i + 1} = {{ unit = "kg", nominal = {value:.4f}, positive = true }}')
    for i in range(half):
        value = 2e6 * (1 + 0.3 * rng.uniform())
        lines.append(f'k{i + 1} = {{ unit = "N/m", nominal = {value:.0f}, positive = true }}')
    lines += [
        'ks = { unit = "N/m", nominal = 3e5, positive = true }',
        'c = { unit = "N s/m", nominal = 8.0 }',
        'g = { unit = "kg", nominal = 0.2 }',
        'xi = { unit = "m", nominal = 2e-5 }',
        'zeta = { unit = "m", nominal = -1e-5 }',
    ]
    return parse_model("\n".join(lines))


def large() -> None:
    begin = time.process_time()
    model = shaft()
    model.require_linear()
    parsed = time.process_time() - begin
    stations = (0, 6, 13, 19)
    sensors = tuple(f"{axis}{i}" for axis in "xy" for i in stations)
    harmonics = list(range(1, 61))
    rng = np.random.default_rng(1)
    forces = 5 * np.exp(2j * np.pi * rng.uniform(size=(60, 4)))
    clean = line_record(
        model,
        model.values(model.nominal),
        forces,
        harmonics=harmonics,
        fundamental=5.0,
        sample_rate=2000.0,
        periods=100,
        speed=2 * np.pi * 50.0,
        sensors=sensors,
    )
    noise = {c.name: 0.1 if c.name in model.inputs else 1e-7 for c in clean.channels}
    records = [add_noise(clean, noise, np.random.default_rng(seed)) for seed in range(3)]
    statuses = []

    def work(seed: int) -> None:
        start = start_of(model, seed, 0.1)
        known = Knowledge(start=start)
        found = minimum(model, [bind(model, records[seed])], known)
        solution = found.solution
        statuses.append((solution.converged, found.inference.p_value, solution.iterations))

    taken = median_time(work, 3)
    begin = time.process_time()
    estimate = identify(model, records[0], MaximumLikelihood(start=start_of(model, 0, 0.1)))
    whole = time.process_time() - begin
    print(
        f"a shaft of {len(model.coordinates)} coordinates, {len(harmonics)} lines, "
        f"{len(model.parameters)} parameters, {len(sensors)} sensors: {taken:.2f} s to the minimum "
        f"and its covariance, {whole:.2f} s to the estimate ({estimate.status}); "
        f"iterations {[s[2] for s in statuses]}, parsing the model {parsed:.1f} s"
    )


if __name__ == "__main__":
    compare("all coordinates, 13 parameters", None, {})
    compare("four sensors, 12 parameters", BEARINGS, {"L1": 0.3})
    large()
