"""Make the pictures of the documentation: ``python docs/make_pictures.py``."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from rotorid.demo import run_demo

LABELS = {"ls": "least squares", "batch-100": "weighted (batch)", "sequential": "sequential"}


def draw_errors(path: Path) -> None:
    """Draw the errors of the estimates from one record of the demo, with 95 % intervals."""
    result = run_demo(1, rng=np.random.default_rng(1))
    figure, axes = plt.subplots(figsize=(8.0, 4.0), layout="constrained")
    place = np.arange(len(result.names))
    for shift, (name, label) in zip((-0.24, 0.0, 0.24), LABELS.items(), strict=True):
        axes.errorbar(
            place + shift,
            result.errors(name)[0],
            100 * 1.96 * np.abs(result.deviations[name][0] / result.truth),
            fmt="o",
            markersize=4,
            capsize=2,
            label=label,
        )
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.set_xticks(place, result.names, rotation=35, ha="right")
    axes.set_ylabel("error in %, 95 % interval")
    axes.legend(frameon=False, ncols=3, loc="lower left")
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    folder = Path(__file__).parent / "images"
    folder.mkdir(exist_ok=True)
    draw_errors(folder / "demo.png")
