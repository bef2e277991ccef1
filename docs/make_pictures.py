"""Make the pictures of the documentation: ``python docs/make_pictures.py [folder]``."""

import sys
from pathlib import Path

import numpy as np

from rotorid.commands.demo import NOISE
from rotorid.demo import run_demo
from rotorid.report.demo_plots import draw_overview


def main(folder: Path) -> None:
    """Write every picture into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    result = run_demo(60, rng=np.random.default_rng(NOISE))
    figure = draw_overview(result)
    figure.savefig(folder / "demo.png", dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "images")
