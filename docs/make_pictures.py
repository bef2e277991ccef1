"""Make the pictures of the documentation: ``python docs/make_pictures.py [folder]``.

The pictures of a report are taken in a browser, where there is one (chromium).
"""

import base64
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid import MaximumLikelihood, PeriodicRecord, Record, average, cli, identify, load_model
from rotorid.answer.parts import RecordEvidence
from rotorid.commands.files import NOISE
from rotorid.demo import FUNDAMENTAL, HARMONICS, PERIODS, rms_panel, run_demo, simulate_record
from rotorid.report.drawn import BLUE, GREY, Axis, Curve, Panel
from rotorid.report.figure import figure_of
from rotorid.results.evidence import record_evidence

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
import browser

WIDTH, HEIGHT, SCALE = 1100, 820, 0.75  # CSS pixels of a picture, and its pixels for each of them
LINES = "Measured and predicted by frequency"
PLANES = ("x2 - 0.02*theta_y, y2 + 0.02*theta_x", "x2 + 0.02*theta_y, y2 - 0.02*theta_x")
SHOWN = {  # page, heading at the top of the picture, colours of the window
    "report.png": ("run.html", "h1", "light"),
    "report-lines.png": ("run.html", LINES, "dark"),
    "balance.png": ("balance.html", "h1", "light"),
}
PLACE = """(() => {
  const text = %r;
  const head = [...document.querySelectorAll("h1, h2, h3")].find(
    (h) => h.tagName.toLowerCase() === text || h.innerText === text);
  return head.getBoundingClientRect().top + window.scrollY;
})()"""


def line_filter(record: Record, periods: PeriodicRecord, channel: str) -> Panel:
    """Draw the spectrum of a position before and after the line filter, the paper's Fig. 2."""
    count = periods.periods * periods.samples
    samples = 1e6 * record.column(channel)[-count:]
    frequency = np.fft.rfftfreq(count, 1 / record.sample_rate)
    shown = (frequency > 0) & (frequency <= 1.2 * periods.frequency.max())
    before = 2 * np.abs(np.fft.rfft(samples, norm="forward"))[shown]
    kept = 2e6 * np.abs(periods.mean_spectrum[:, periods.index(channel)])
    floor = np.quantile(before, 0.02) / 2
    return Panel(
        f"1. Keep the excited lines of {PERIODS} periods",
        Axis("frequency in Hz", ends=(0, 1.2 * periods.frequency.max())),
        Axis("amplitude in µm", log=True, ends=(floor, 100 * kept.max())),
        (
            Curve(frequency[shown], before, "before: every line of the record", GREY, "thin"),
            Curve(periods.frequency, kept, "", BLUE, "stems", base=np.full_like(kept, floor)),
            Curve(periods.frequency, kept, "after: the lines of the excitation", BLUE, "dots"),
        ),
        height=3.9,
    )


def overview(folder: Path) -> None:
    """Draw the paper's example: line filter, predicted force, errors of every estimator."""
    rng, model = np.random.default_rng(NOISE), load_model("three-mass")
    result = run_demo(60, rng=rng)
    record = simulate_record(model, rng)
    periods = average(record, FUNDAMENTAL, harmonics=HARMONICS)
    estimate = identify(model, periods, MaximumLikelihood(base=True))
    (predicted,) = record_evidence(estimate, model, [periods])
    errors = rms_panel(result)
    room = replace(errors.x, ends=(0.03, 1e3))  # for the key beside the points
    panels = [
        line_filter(record, periods, "x1"),
        predicted_force(predicted),
        replace(errors, x=room, title="3. Read the rotor's parameters"),
    ]
    figure = figure_of(panels, columns=3, apart=True)
    figure.set_size_inches(10.5, 4.2)  # to be read in a column of 736 pixels
    figure.savefig(folder / "demo.png", dpi=140, metadata={"Software": None})


def predicted_force(record: RecordEvidence) -> Panel:
    """Return the first force over a period, as measured and as predicted."""
    force, time = record.channels[0], 1e3 * np.array(record.time_s)
    curves = (
        Curve(time, np.array(force.wave_measured), "measured", GREY, "thick"),
        Curve(time, np.array(force.wave_predicted), "predicted", BLUE, "line"),
    )
    title = "2. Fit the equations of motion to the forces"
    return Panel(title, Axis("time in ms"), Axis(f"{force.name} in {force.unit}"), curves)


def screens(folder: Path) -> None:
    """Take pictures of the report of the shipped rig."""
    with tempfile.TemporaryDirectory() as name, browser.browser(Path(name) / "browser") as one:
        here = Path(name)
        run, result = here / "run.h5", str(here / "run.json")
        cli.run(["simulate", "three-mass", "--out", str(run)])
        pages = ["--json", result, "--report", str(here / "run.html")]
        cli.run(["identify", str(run.with_suffix(".toml")), *pages])
        planes = [word for plane in PLANES for word in ("--plane", plane)]
        mounted = ["--radius", "60 mm", "--masses", "0.5 g, 1 g, 2 g"]
        cli.run(["balance", result, *planes, *mounted, "--report", str(here / "balance.html")])
        for file, (page, heading, scheme) in SHOWN.items():
            one.show(here / page, WIDTH, scheme)
            top = one.run(PLACE % heading)
            clip = {"x": 0, "y": max(0, top - 30), "width": WIDTH, "height": HEIGHT, "scale": SCALE}
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
