"""What is done to a record: to its plant, its samples, or what is said of them."""

from collections.abc import Callable
from typing import Any

import numpy as np
from adverse import FUNDAMENTAL, RATE, ROTATION, TURN, Edit, Trial
from rotor_bank import Floats
from scipy import signal


def sensor(trial: Trial, number: int = 0) -> str:
    """Return the name of a sensor."""
    return trial.sensors[number]


def scaled(which: str, factor: float, count: int = 1) -> Edit:
    """Multiply some columns: the first so many `inputs` or `sensors`; all for 0."""

    def edit(trial: Trial) -> None:
        names: list[str] = getattr(trial, which)
        for name in names[: count or None]:
            trial.columns[name] *= factor

    return edit


def swapped(which: str, *pairs: tuple[int, int]) -> Edit:
    """Exchange columns."""

    def edit(trial: Trial) -> None:
        names: list[str] = getattr(trial, which)
        for a, b in pairs:
            one, other = names[a], names[b]
            columns = trial.columns
            columns[one], columns[other] = columns[other], columns[one]

    return edit


def said(**values: Any) -> Edit:
    """Say something else of the record; a function is given the trial."""

    def edit(trial: Trial) -> None:
        for name, value in values.items():
            setattr(trial, name, value(trial) if callable(value) else value)

    return edit


def told(kind: str, name: str, make: Callable[[float], Any]) -> Edit:
    """Say something of a parameter, made of its true value: of the first that the machine has."""

    def edit(trial: Trial) -> None:
        known = next(n for n in name.split() if n in trial.machine.truth)
        value = make(trial.machine.truth[known])
        trial.options.setdefault(kind, {})[known] = value

    return edit


def both(*edits: Edit) -> Edit:
    """Do several things."""

    def edit(trial: Trial) -> None:
        for each in edits:
            each(trial)

    return edit


def column(change: Callable[[Trial, Floats], Floats], number: int = 0, which: str = "s") -> Edit:
    """Change the samples of one channel; -1: of all of its kind; "a": of all channels."""

    def edit(trial: Trial) -> None:
        names = {"s": trial.sensors, "i": trial.inputs, "a": list(trial.columns)}[which]
        for name in names if number < 0 else [names[number]]:
            trial.columns[name] = change(trial, trial.columns[name])

    return edit


def clipped(_: Trial, x: Floats) -> Floats:
    """Cut at nine tenths of the peak."""
    limit = 0.8 * np.abs(x).max()
    return np.clip(x, -limit, limit)


def coarse(steps: float) -> Callable[[Trial, Floats], Floats]:
    """Round to so many steps from peak to peak."""

    def change(_: Trial, x: Floats) -> Floats:
        step = np.ptp(x) / steps
        return np.asarray(step * np.round(x / step))

    return change


def lost(count: int, at: float = 0.4) -> Callable[[Trial, Floats], Floats]:
    """Leave out samples; fewer than none: repeat some."""

    def change(_: Trial, x: Floats) -> Floats:
        k = int(at * len(x)) + 37
        kept = np.concatenate([x[:k], x[k + count :]])
        return np.asarray(kept[: len(x) - 25])

    return change


def late(time: float) -> Callable[[Trial, Floats], Floats]:
    """Delay a column."""

    def change(_: Trial, x: Floats) -> Floats:
        omega = TURN * np.fft.rfftfreq(len(x), 1 / RATE)
        return np.fft.irfft(np.fft.rfft(x) * np.exp(-1j * omega * time), n=len(x))

    return change


def stretched(ppm: float) -> Callable[[Trial, Floats], Floats]:
    """Sample with a clock that is slow."""

    def change(_: Trial, x: Floats) -> Floats:
        place = np.arange(len(x)) * (1 + 1e-6 * ppm)
        spline = np.interp(place, np.arange(len(x)), x)
        fine = signal.resample(x, 8 * len(x))
        return np.interp(np.minimum(8 * place, 8.0 * len(x) - 1), np.arange(8 * len(x)), fine) + (
            0 * spline
        )

    return change


def filtered(hertz: float) -> Callable[[Trial, Floats], Floats]:
    """Pass a second-order low-pass filter, as an analogue one does."""

    def change(_: Trial, x: Floats) -> Floats:
        s = 1j * np.fft.rfftfreq(len(x), 1 / RATE) / hertz
        return np.fft.irfft(np.fft.rfft(x) / (1 + np.sqrt(2) * s + s**2), n=len(x))

    return change


def added(make: Callable[[Trial, Floats, Floats], Floats]) -> Callable[[Trial, Floats], Floats]:
    """Add something that depends on time, in units of the rms of the column."""

    def change(trial: Trial, x: Floats) -> Floats:
        time = np.arange(len(x)) / RATE
        return np.asarray(x + x.std() * make(trial, time, x))

    return change


def line(hertz: float, size: float) -> Callable[[Trial, Floats], Floats]:
    """Add a tone."""
    return added(lambda _t, time, _x: size * np.cos(TURN * hertz * time + 1.0))


def once(size: float, order: int = 1) -> Callable[[Trial, Floats], Floats]:
    """Add runout of an order."""
    turn = TURN * ROTATION * FUNDAMENTAL * order
    return added(lambda _t, time, _x: size * np.cos(turn * time + 0.7))


def spikes(count: int) -> Callable[[Trial, Floats], Floats]:
    """Throw single samples far off."""

    def make(trial: Trial, time: Floats, _x: Floats) -> Floats:
        found = np.zeros(len(time))
        found[trial.rng.integers(0, len(time), count)] = 50.0
        return found

    return added(make)


def knock(_t: Trial, time: Floats, _x: Floats) -> Floats:
    """Ring once."""
    since = np.maximum(time - 0.93, 0)
    return np.asarray(4 * np.exp(-60 * since) * np.sin(TURN * 171 * since))


def settling(_t: Trial, time: Floats, _x: Floats) -> Floats:
    """Die away over some periods."""
    return np.asarray(3 * np.exp(-time / 0.12) * np.cos(TURN * 67 * time))


def wandering(trial: Trial, time: Floats, x: Floats) -> Floats:
    """Walk at random."""
    return np.asarray(np.cumsum(trial.rng.standard_normal(len(x))) / np.sqrt(len(x)) * 3)


def ramp(size: float) -> Callable[[Trial, Floats], Floats]:
    """Add a slow ramp, in units of the rms."""
    return added(lambda _t, time, _x: size * time / time[-1])


def warming(rate: float) -> Callable[[Trial, Floats], Floats]:
    """Let the gain drift."""
    return lambda _, x: x * (1 + rate * np.linspace(0, 1, len(x)))


def dead(_: Trial, x: Floats) -> Floats:
    return 0 * x


def stuck(_: Trial, x: Floats) -> Floats:
    """Stay at one value from the middle on."""
    return np.where(np.arange(len(x)) < len(x) // 2, x, x[len(x) // 2])


def bent(size: float) -> Callable[[Trial, Floats], Floats]:
    """Bend a characteristic: a cubic share at the peak."""
    return lambda _, x: x * (1 + size * (x / np.abs(x).max()) ** 2)


def tiled(trial: Trial) -> None:
    """Copy the first period."""
    for name, x in trial.columns.items():
        trial.columns[name] = np.tile(x[: trial.size], trial.periods)


def first_only(count: int) -> Edit:
    """Keep so many periods."""

    def edit(trial: Trial) -> None:
        for name, x in trial.columns.items():
            trial.columns[name] = x[: count * trial.size]

    return edit


def gap(trial: Trial) -> None:
    trial.columns[sensor(trial)][500:520] = np.nan


def copied(which: str) -> Edit:
    """Read one column twice."""

    def edit(trial: Trial) -> None:
        names: list[str] = getattr(trial, which)
        trial.columns[names[1]] = trial.columns[names[0]].copy()

    return edit


def heavier(trial: Trial) -> None:
    """Add a third of the first mass at the first coordinate."""
    more = np.zeros_like(trial.machine.inertia)
    more[0, 0] = 0.3 * trial.machine.inertia[0, 0]
    trial.change(inertia=trial.machine.inertia + more)


def between(trial: Trial) -> None:
    """Add a mass in the middle of the shaft between the first two masses."""
    length, row = trial.machine.truth["L1"], np.zeros((2, 8))
    row[0, [0, 2, 5]] = 0.5, 0.5, length / 8
    row[1, [1, 3, 4]] = 0.5, 0.5, -length / 8
    trial.change(inertia=trial.machine.inertia + 0.2 * row.T @ row)


def damped(trial: Trial) -> None:
    m = trial.machine
    stiff = m.stiffness if m.stiffness.any() else 1e6 * m.inertia
    trial.change(damping=m.damping + 3e-5 * stiff)


def asymmetric(trial: Trial) -> None:
    """Be softer in y."""
    stiffness = trial.machine.stiffness.copy()
    odd = np.arange(1, len(stiffness), 2)
    if len(stiffness) == 8:
        odd = np.array([1, 3, 4, 7])
    stiffness[np.ix_(odd, odd)] *= 0.97
    trial.change(stiffness=stiffness)


def sealed(trial: Trial) -> None:
    """Push square to the displacement, as a seal does."""
    stiffness = trial.machine.stiffness.copy()
    size = 0.02 * (TURN * 100) ** 2 * trial.machine.inertia[0, 0]
    stiffness[0, 1] += size
    stiffness[1, 0] -= size
    trial.change(stiffness=stiffness)


def grounded(trial: Trial) -> None:
    """Pull at the first mass, as a force law without its k_s does."""
    stiffness = trial.machine.stiffness.copy()
    for k in (0, 1):
        stiffness[k, k] -= 0.05 * (TURN * 100) ** 2 * trial.machine.inertia[0, 0]
    trial.change(stiffness=stiffness)


def hardening(trial: Trial) -> None:
    """Let a spring at the first coordinate stiffen by a few percent at the peak."""
    m = trial.machine
    trial.cubic = (0, 0.02 * max(m.stiffness[0, 0], (TURN * 20) ** 2 * m.inertia[0, 0]))


def loaded(trial: Trial) -> None:
    """Add unbalance where the model has none."""
    load = trial.machine.unbalance.copy()
    load[:2] += np.array([1, -1j]) * np.abs(trial.machine.unbalance).max() * 0.5
    trial.change(unbalance=load)


def elsewhere(trial: Trial) -> None:
    """Say that a sensor sits 30 mm from where it is."""
    trial.reads["s_xa"] = {"x": 1.0, "theta_y": -0.2}


def equal(share: float) -> Edit:
    """Drive all axes alike, the second half with a share."""

    def edit(trial: Trial) -> None:
        trial.forces = trial.forces[:, :1] * np.ones(trial.forces.shape[1])
        trial.forces[:, trial.forces.shape[1] // 2 :] *= share

    return edit


def one_axis(trial: Trial) -> None:
    trial.forces[:, 1:] = 0


def weak(factor: float) -> Edit:
    """Excite less."""

    def edit(trial: Trial) -> None:
        trial.forces = trial.forces * factor

    return edit


def one_line(trial: Trial) -> None:
    trial.forces[1:] = 0


def turning(factor: float) -> Edit:
    """Turn at another speed than is said."""

    def edit(trial: Trial) -> None:
        trial.rotation *= factor

    return edit


def noisier(factor: float) -> Edit:
    """Raise the noise of the sensors."""

    def edit(trial: Trial) -> None:
        trial.noise *= factor

    return edit


def at_rest(trial: Trial) -> None:
    """Stand still; what turns is known."""
    trial.rotation = trial.speed = 0.0
    names = [n for n in ("I_p", "xi", "zeta", "mu", "eta") if n in trial.machine.truth]
    trial.options["fixed"] = {n: trial.machine.truth[n] for n in names}
