"""Records drawn on their lines: the noise of a rig in closed loop, period by period, no samples.

Estimators take a record of periods by its lines. A rig runs without noise for as many periods as
its logger has columns, and one. As they are, these are the mean; with lines added to a column in
each of the others, they show what the reader makes of each column. `LineNoise` is the noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.answer.estimate import Estimate
from rotorid.answer.identify import identify
from rotorid.core.errors import InputError, naming
from rotorid.core.values import Complexes, frozen
from rotorid.data.record import PeriodicRecord, Steady, changed
from rotorid.experiment import load_experiment
from rotorid.experiment.experiment import Experiment
from rotorid.rig.file import RigPlan
from rotorid.rig.linear_loop import LineNoise
from rotorid.rig.logger import Logged
from rotorid.rig.rig import Rig
from rotorid.signals.average import average
from rotorid.signals.spectrum import synthesize

NEAR = 1e-6  # share of a column by which it is moved to see what the reader makes of it
LEAST = 2  # periods without which nothing scatters
CLIPPED = 6.0  # deviations of a command that no record reaches


@frozen
class DrawnLines:
    experiment: Experiment
    record: PeriodicRecord  # without noise, a few periods
    periods: int  # of a record that is drawn
    noise: LineNoise
    reads: Complexes  # (line, channel, column): lines of the channels per line of the columns

    @classmethod
    def of(cls, plan: RigPlan, write: Callable[[Logged], Path]) -> DrawnLines:
        """Run a rig without noise; `write` makes files of a record, and returns the experiment."""
        require_lines(plan.rig)
        rig, excitation, rate = plan.rig, plan.rig.excitation, plan.rig.logger.sample_rate
        assert excitation is not None
        length, columns = 1 / excitation.fundamental, len(rig.parts) + len(rig.sensors)
        quiet = replace(plan, rig=without_noise(rig), duration=(1 + columns) * length).record()
        experiment = load_experiment(write(quiet))
        record, skip = _read(experiment), experiment.entry.records[0].skip or 0.0
        size, lines, patterns = record.samples, record.harmonics, length / rig.schedule.duration
        _refuse(f"periods of {size} samples", size != round(rate * length))
        if (periods := round((plan.duration - skip) * rate) // size) < LEAST:
            found = f"{periods} periods in {plan.duration:g} s"
            expected = f"{LEAST} at least"
            raise InputError(found, expected, "write a longer duration", place="duration")
        # What white noise has there is circular, and that of no other line.
        apart = lines[0] > 0 and 2 * lines[-1] < patterns and abs(patterns % 1 - 0.5) > 0.499
        _refuse(f"lines {lines[0]} to {lines[-1]} of {patterns:g} common steps", not apart)
        noise = LineNoise.of(rig, record.omega, length)
        commands = np.linalg.norm(noise.begin[-len(rig.parts) :], axis=1)
        peak = np.abs(quiet.truth.current).max(axis=0) + CLIPPED * commands
        _refuse("commands at their limit", (peak > [part.limit for part in rig.parts]).any())
        step = np.array([NEAR * (np.abs(c.samples).max() or 1.0) for c in quiet.columns])
        wave = synthesize(np.ones((len(lines), 1)), lines, size)
        moves = (np.kron(np.eye(1 + columns, columns, -1), wave) * step).T
        pairs = zip(quiet.columns, moves, strict=True)
        moved = tuple(replace(column, samples=column.samples + move) for column, move in pairs)
        seen = _read(load_experiment(write(replace(quiet, columns=moved)))).spectra
        return cls(
            experiment=replace(experiment, file="run.toml"),
            record=record,
            periods=periods,
            noise=noise,
            reads=np.moveaxis((seen - record.spectra)[1:], 0, -1) / step,
        )

    def draw(self, rng: np.random.Generator) -> PeriodicRecord:
        """Draw the lines of the periods of a record, hence their mean and their covariance."""
        quiet, noise = self.record, self.noise.draw(self.periods, rng)
        noise = (noise.swapaxes(0, 1) @ self.reads.swapaxes(1, 2)).swapaxes(0, 1)
        # Of a sample: that of white noise as strong as it is on the kept lines.
        variance = (np.abs(noise) ** 2).mean(axis=(0, 1)) * quiet.samples
        time = Steady(0, (self.periods, quiet.samples), quiet.sample_rate, quiet.begin)
        phase = quiet.angle[0, 0] - quiet.speed * quiet.begin
        return changed(
            quiet,
            spectra=quiet.spectra[0] + noise,
            variance=np.tile(variance, (quiet.samples, 1)),
            time=time,
            angle=replace(time, offset=phase, slope=quiet.speed),
            source="run.h5",
            warnings=(),  # of samples without noise
            checks=(),
        )

    def identify(self, rng: np.random.Generator) -> Estimate:
        with naming(self.experiment.file):
            return identify(self.experiment.model, [self.draw(rng)], self.experiment.estimator())


def require_lines(rig: Rig) -> None:
    """Refuse a rig whose samples hold what no noise of lines does."""
    turns = rig.rotation.speed / (2 * np.pi * (rig.excitation.fundamental if rig.excitation else 1))
    read, moved = ("quantum", "cubic", "heating", "hum"), ("hysteresis", "heating", "unbiased")
    told = {
        "no excitation": rig.excitation is None,
        "a mark, with its jitter": rig.logger.angle,
        "a speed that changes": not rig.rotation.constant,
        f"{turns:.6g} revolutions in a period": abs(turns - round(turns)) > 1e-9,
        "sensors that round or drift": any(getattr(s, n) for s in rig.sensors for n in read),
        "magnets that stick or drift": any(getattr(p, n) for p in rig.parts for n in moved),
        "flux sensors": any(part.flux for part in rig.parts),
        "faults of samples": rig.spoils or rig.disturbances or rig.gain or rig.contact,
    }
    for found, holds in told.items():
        _refuse(found, holds)


def _refuse(found: str, holds: object) -> None:
    if holds:
        cure = 'write noise = "samples"'
        raise InputError(found, "noise of lines, stationary and linear", cure, place="noise")


def without_noise(rig: Rig) -> Rig:
    """Return the rig with nothing random but its mark."""
    return replace(
        rig,
        process_noise=dict.fromkeys(rig.process_noise, 0.0),
        sensors=tuple(replace(sensor, noise=0.0) for sensor in rig.sensors),
        actuators={name: replace(part, noise=0.0) for name, part in rig.actuators.items()},
    )


def _read(experiment: Experiment) -> PeriodicRecord:
    """Read the record of an experiment, all of it, in periods."""
    (plan, *others), method = experiment.channels, experiment.method()
    whole = not others and plan.entry.made == "periods" and method == "ml"
    _refuse("an experiment that is not one record of periods for ml", not whole)
    _refuse("a record that until or mask cuts", plan.entry.until or plan.entry.mask)
    keys = ("fundamental", "period_samples", "harmonics", "band")
    record = average(experiment.measured()[0], **{key: getattr(plan.entry, key) for key in keys})
    return record.with_parameters(**plan.own)
