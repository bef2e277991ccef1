"""Make the pictures of the documentation: ``python docs/make_pictures.py [folder]``.

The pictures of a report are taken in a browser, where there is one (chromium).
"""

import base64
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from rotorid import cli
from rotorid.commands.demo import NOISE
from rotorid.demo import run_demo
from rotorid.report.demo_plots import draw_overview

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import browser

WIDTH, HEIGHT, SCALE = 1100, 820, 0.75  # CSS pixels of a picture, and its pixels for each of them
SHOWN = {  # heading at the top of the picture, width and colours of the window
    "report.png": ("h1", WIDTH, "light"),
    "report-lines.png": ("Measured and predicted on the lines", WIDTH, "dark"),
}
PLACE = """(() => {
  const text = %r;
  const head = [...document.querySelectorAll("h1, h2, h3")].find(
    (h) => h.tagName.toLowerCase() === text || h.innerText === text);
  return head.getBoundingClientRect().top + window.scrollY;
})()"""


def overview(folder: Path) -> None:
    """Draw the paper's example: line filter, predicted force, errors of every estimator."""
    result = run_demo(60, rng=np.random.default_rng(NOISE))
    figure = draw_overview(result)
    figure.savefig(folder / "demo.png", dpi=120, metadata={"Software": None})


def screens(folder: Path) -> None:
    """Take pictures of the report of the shipped rig."""
    with tempfile.TemporaryDirectory() as name, browser.browser(Path(name) / "browser") as one:
        run, page = Path(name) / "run.h5", Path(name) / "run.html"
        cli.run(["simulate", "three-mass", "--out", str(run)])
        cli.run(["identify", str(run.with_suffix(".toml")), "--report", str(page)])
        for file, (heading, width, scheme) in SHOWN.items():
            one.show(page, width, scheme)
            top = one.run(PLACE % heading)
            clip = {"x": 0, "y": max(0, top - 16), "width": width, "height": HEIGHT, "scale": SCALE}
            taken = one.ask("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)
            (folder / file).write_bytes(base64.b64decode(taken["data"]))


def main(folder: Path) -> None:
    """Write every picture into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    if any(map(shutil.which, browser.NAMES)):
        screens(folder)
    overview(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "images")
