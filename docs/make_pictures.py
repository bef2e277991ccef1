"""Make the pictures of the documentation: ``python docs/make_pictures.py``."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid

SAMPLE_RATE, PERIOD, PERIODS = 5000.0, 250, 260
SPEED = 2 * np.pi * 140.0
ORDERS = [1, 3, 5, 7, 9, 11]


def seed_record(rng: np.random.Generator) -> rid.Record:
    """Return one noisy record of the seed's example (its section 3)."""
    model = rid.load_model("three-mass")
    angle = 2 * np.pi * np.outer(np.arange(PERIOD) / PERIOD, ORDERS)
    wave = 10 * (np.sin(angle) + np.cos(angle)).sum(axis=1)
    forces = np.column_stack([wave / 2, wave, wave, -wave / 2])
    noise = {name: 1.0 for name in model.inputs} | {name: 22e-6 for name in model.coordinates}
    return rid.simulate(
        model,
        model.values(model.nominal),
        forces,
        sample_rate=SAMPLE_RATE,
        periods=PERIODS,
        speed=SPEED,
        noise=noise,
        rng=rng,
    )


def draw_errors(path: Path) -> None:
    """Draw the errors of one record's estimates, with their 95 % intervals."""
    model = rid.load_model("three-mass")
    truth = model.base_values(model.values(model.nominal))
    periods = rid.average(seed_record(np.random.default_rng(1)), 20.0, harmonics=ORDERS)
    estimators = {
        "least squares": rid.LeastSquares(),
        "weighted (batch)": rid.Batch(),
        "sequential": rid.Sequential(),
    }
    figure, axes = plt.subplots(figsize=(8.0, 4.0), layout="constrained")
    place = np.arange(len(truth))
    for shift, (label, estimator) in zip((-0.24, 0.0, 0.24), estimators.items(), strict=True):
        estimate = rid.identify(model, periods, estimator)
        value = np.array([estimate.value(name) for name in model.base.names])
        std = np.array([estimate.std(name) for name in model.base.names])
        axes.errorbar(
            place + shift,
            100 * (value / truth - 1),
            100 * 1.96 * np.abs(std / truth),
            fmt="o",
            markersize=4,
            capsize=2,
            label=label,
        )
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_xticks(place, model.base.names, rotation=35, ha="right")
    axes.set_ylim(-9, 12.5)
    axes.set_ylabel("error in %, 95 % interval")
    axes.legend(frameon=False, ncols=3, loc="lower left")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    folder = Path(__file__).parent / "images"
    folder.mkdir(exist_ok=True)
    draw_errors(folder / "demo.png")
