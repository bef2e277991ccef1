"""The table of adverse records: what was done, to which machines, and what it must be called."""

from collections.abc import Callable
from typing import Any

import numpy as np
from adverse import FUNDAMENTAL, RATE, ROTATION, TURN, Case, Edit, Trial
from rotor_bank import Floats
from scipy import signal

# What is done to a record: to its plant, its samples, or what is said of them.


def sensor(trial: Trial, number: int = 0) -> str:
    return trial.sensors[number]


def scaled(which: str, factor: float, count: int = 1) -> Edit:
    """Multiply some columns: the first so many `inputs` or `sensors`; all for 0."""

    def edit(trial: Trial) -> None:
        names: list[str] = getattr(trial, which)
        for name in names[: count or None]:
            trial.columns[name] *= factor

    return edit


def swapped(which: str, *pairs: tuple[int, int]) -> Edit:

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
    limit = 0.8 * np.abs(x).max()
    return np.clip(x, -limit, limit)


def coarse(steps: float) -> Callable[[Trial, Floats], Floats]:

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

    def change(_: Trial, x: Floats) -> Floats:
        omega = TURN * np.fft.rfftfreq(len(x), 1 / RATE)
        return np.fft.irfft(np.fft.rfft(x) * np.exp(-1j * omega * time), n=len(x))

    return change


def stretched(ppm: float) -> Callable[[Trial, Floats], Floats]:
    """Sample with a clock that is slow."""

    def change(_: Trial, x: Floats) -> Floats:
        place = np.arange(len(x)) * (1 + 1e-6 * ppm)
        fine = signal.resample(x, 8 * len(x))
        return np.interp(np.minimum(8 * place, 8.0 * len(x) - 1), np.arange(8 * len(x)), fine)

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
    return added(lambda _t, time, _x: size * np.cos(TURN * hertz * time + 1.0))


def once(size: float, order: int = 1) -> Callable[[Trial, Floats], Floats]:
    turn = TURN * ROTATION * FUNDAMENTAL * order
    return added(lambda _t, time, _x: size * np.cos(turn * time + 0.7))


def spikes(count: int) -> Callable[[Trial, Floats], Floats]:

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
    for name, x in trial.columns.items():
        trial.columns[name] = np.tile(x[: trial.size], trial.periods)


def first_only(count: int) -> Edit:

    def edit(trial: Trial) -> None:
        for name, x in trial.columns.items():
            trial.columns[name] = x[: count * trial.size]

    return edit


def gap(trial: Trial) -> None:
    trial.columns[sensor(trial)][500:520] = np.nan


def copied(which: str) -> Edit:

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

    def edit(trial: Trial) -> None:
        trial.noise *= factor

    return edit


def at_rest(trial: Trial) -> None:
    """Stand still; what turns is known."""
    trial.rotation = trial.speed = 0.0
    names = [n for n in ("I_p", "xi", "zeta", "mu", "eta") if n in trial.machine.truth]
    trial.options["fixed"] = {n: trial.machine.truth[n] for n in names}


# -------------------------------------------------------------------------------------------------
# The cases.


NOT_OK = "rejected not_identifiable not_converged refused"
RIGHT = "ok"
ANY = f"ok {NOT_OK}"
ALL, SMALL, BIG = "jeffcott rigid three", "jeffcott rigid", "three eight"
J, R, T = "jeffcott", "rigid", "three"
AT_REST = "three three jeffcott rigid"  # of the first, which takes long, half the records

CASES = (
    Case("nothing at all", "jeffcott rigid three eight", RIGHT),
    # signs
    Case("a sensor upside down", SMALL, NOT_OK, ("sign[", "gain["), data=scaled("sensors", -1)),
    Case("a force upside down", SMALL, NOT_OK, ("sign[", "gain["), data=scaled("inputs", -1)),
    Case("all forces upside down", SMALL, NOT_OK, data=scaled("inputs", -1, 0)),
    Case("all sensors upside down", SMALL, NOT_OK, data=scaled("sensors", -1, 0)),
    Case("the sensors of a plane upside down", R, NOT_OK, data=scaled("sensors", -1, 2)),
    Case("the forces of a plane upside down", R, NOT_OK, data=scaled("inputs", -1, 2)),
    # columns
    Case("two sensors swapped", SMALL, NOT_OK, ("swap[",), data=swapped("sensors", (0, 1))),
    Case("two forces swapped", SMALL, NOT_OK, ("swap[",), data=swapped("inputs", (0, 1))),
    Case("sensors of one axis swapped", R, NOT_OK, ("swap[",), data=swapped("sensors", (0, 2))),
    Case(
        "the sensors of the planes swapped",
        R,
        NOT_OK,
        data=swapped("sensors", (0, 2), (1, 3)),
    ),
    Case(
        "the forces of the planes swapped",
        R,
        NOT_OK,
        data=swapped("inputs", (0, 2), (1, 3)),
    ),
    Case("a sensor read twice", SMALL, NOT_OK, ("copied",), data=copied("sensors")),
    Case("a force read twice", SMALL, NOT_OK, ("copied",), data=copied("inputs")),
    Case(
        "a force in the place of a sensor",
        SMALL,
        NOT_OK,
        data=lambda t: t.columns.update({sensor(t): 1e-6 * t.columns[t.inputs[0]]}),
    ),
    Case(
        "swapped and upside down",
        SMALL,
        NOT_OK,
        data=both(swapped("sensors", (0, 1)), scaled("sensors", -1)),
    ),
    # units
    Case("a sensor in mm", SMALL, NOT_OK, ("unit[", "gain["), data=scaled("sensors", 1e3)),
    Case(
        "a sensor in mil for um",
        SMALL,
        NOT_OK,
        ("unit[", "gain["),
        data=scaled("sensors", 1 / 25.4),
    ),
    Case("a force in kN", SMALL, NOT_OK, ("unit[", "gain["), data=scaled("inputs", 1e-3)),
    Case("a sensor 3 % off", SMALL, NOT_OK, ("gain[",), data=scaled("sensors", 1.03)),
    Case("a force 3 % off", SMALL, NOT_OK, ("gain[",), data=scaled("inputs", 1.03)),
    Case(
        "all sensors in mm, the mass known",
        SMALL,
        NOT_OK,
        ("unit[", "prior m", "gain["),
        data=both(scaled("sensors", 1e3, 0), told("known", "m", lambda m: (m, 0.01 * m))),
    ),
    Case(
        "all forces 10 % off, the mass known",
        SMALL,
        NOT_OK,
        ("gain[", "prior m"),
        data=both(scaled("inputs", 1.1, 0), told("known", "m", lambda m: (m, 0.001 * m))),
    ),
    # speed
    Case(
        "the rotation backwards",
        R,
        NOT_OK,
        ("speed",),
        data=said(speed=lambda t: -t.speed),
    ),
    Case(
        "the rotation of a disc backwards",
        J,
        NOT_OK,
        ("speed", "load at", "runout["),
        data=said(speed=lambda t: -t.speed),
    ),
    Case(
        "rad/s given as rpm",
        SMALL,
        NOT_OK,
        ("speed",),
        data=said(speed=lambda t: t.speed * TURN / 60),
    ),
    Case("Hz given as rpm", SMALL, NOT_OK, ("speed",), data=said(speed=lambda t: t.speed / 60)),
    Case("no speed", SMALL, NOT_OK, ("speed",), data=said(speed=0.0)),
    Case("twice the speed", SMALL, NOT_OK, ("speed",), data=said(speed=lambda t: 2 * t.speed)),
    Case("half the speed", SMALL, NOT_OK, ("speed",), data=said(speed=lambda t: t.speed / 2)),
    Case(
        "a speed off by .06 %", SMALL, NOT_OK, ("speed", "wander", "drift"), plant=turning(0.9994)
    ),
    Case("628.3 rad/s for 6000 rpm", SMALL, ANY, plant=turning(1 - 3e-5)),
    Case("a speed off by a tenth", SMALL, NOT_OK, ("speed", "wander"), plant=turning(1.1)),
    # rate, period, order
    Case(
        "twice the rate and the fundamental",
        SMALL,
        NOT_OK,
        data=said(rate=2 * RATE, fundamental=2 * FUNDAMENTAL),
    ),
    Case("twice the rate", SMALL, NOT_OK, data=said(rate=2 * RATE)),
    Case("half the rate", SMALL, NOT_OK, data=said(rate=RATE / 2)),
    Case(
        "twice the fundamental",
        SMALL,
        NOT_OK,
        ("multiple period", "lines below noise"),
        data=said(fundamental=2 * FUNDAMENTAL),
    ),
    Case(
        "half the fundamental",
        SMALL,
        NOT_OK,
        ("lines below noise",),
        data=said(fundamental=FUNDAMENTAL / 2),
    ),
    Case("a period one sample short", SMALL, NOT_OK, data=said(fundamental=RATE / 199)),
    Case(
        "even lines for odd ones",
        SMALL,
        NOT_OK,
        ("lines below noise",),
        data=said(harmonics=(2, 4, 6, 8, 10)),
    ),
    Case("the line of the rotation left out", SMALL, NOT_OK, data=said(harmonics=(1, 3, 5, 9, 11))),
    Case("one line only", SMALL, NOT_OK, data=said(harmonics=(7,))),
    # bad data
    Case("a dead sensor", ALL, NOT_OK, ("dead",), data=column(dead)),
    Case("all sensors dead", ALL, "refused", data=column(dead, -1)),
    Case("a dead force", SMALL, NOT_OK, data=column(dead, which="i")),
    Case("a sensor stuck half-way", SMALL, "refused", ("stuck",), data=column(stuck)),
    Case("a clipped sensor", SMALL, NOT_OK, ("clipped",), data=column(clipped)),
    Case("a clipped force", SMALL, NOT_OK, ("clipped",), data=column(clipped, which="i")),
    Case("a sensor of 4 bits", SMALL, ANY, data=column(coarse(16))),
    Case("all sensors of 6 bits", SMALL, ANY, data=column(coarse(64), -1)),
    Case("a knock", ALL, NOT_OK, ("knock",), data=column(added(knock), -1)),
    Case("spikes in a sensor", ALL, ANY, data=column(spikes(5))),
    Case("a transient at the start", ALL, NOT_OK, ("settled",), data=column(added(settling), -1)),
    Case("a gain that drifts by 3 %", ALL, NOT_OK, ("drift",), data=column(warming(0.03))),
    Case("an offset that drifts", SMALL, ANY, data=column(ramp(5.0), -1)),
    Case("a sensor that walks at random", ALL, ANY, data=column(added(wandering))),
    Case("one sample lost", ALL, NOT_OK, ("lost samples",), data=column(lost(1), -1, "a")),
    Case("twenty samples lost", ALL, NOT_OK, ("lost samples",), data=column(lost(20), -1, "a")),
    Case("a sample twice", ALL, NOT_OK, ("lost samples",), data=column(lost(-1), -1, "a")),
    Case(
        "a sample lost in the forces",
        ALL,
        NOT_OK,
        ("lost samples",),
        data=both(column(lost(1), -1, "i"), column(lost(0), -1)),
    ),
    Case("two clocks, 50 ppm", ALL, NOT_OK, ("clocks",), data=column(stretched(50), -1)),
    Case("missing values", ALL, "refused", ("finite",), data=gap),
    Case("identical periods", ALL, NOT_OK, ("identical periods",), data=tiled),
    Case(
        "one sensor's periods identical",
        SMALL,
        ANY,
        data=column(lambda t, x: np.tile(x[: t.size], t.periods)),
    ),
    Case("two periods", ALL, ANY, data=first_only(2)),
    Case("three periods", ALL, ANY, data=first_only(3)),
    Case("less than two periods", ALL, "refused", ("period",), data=first_only(1)),
    Case("hum on a line", SMALL, NOT_OK, ("line 60 Hz",), data=column(line(60.0, 0.05), -1)),
    Case("hum beside the lines", ALL, ANY, data=column(line(50.0, 0.05), -1)),
    Case("a sensor a sample late", ALL, NOT_OK, ("delay[",), data=column(late(1 / RATE))),
    Case("all sensors a sample late", ALL, NOT_OK, ("delay[",), data=column(late(1 / RATE), -1)),
    Case(
        "a filter on all sensors",
        ALL,
        NOT_OK,
        ("delay[", "bandwidth"),
        data=column(filtered(1000.0), -1),
    ),
    Case("runout of a sensor", SMALL, NOT_OK, data=column(once(0.2))),
    Case("a bent sensor", SMALL, NOT_OK, data=column(bent(0.1))),
    # the model
    Case("a mass more at one place", ALL, NOT_OK, ("mass", "asymmetry m"), plant=heavier),
    Case("a mass between two places", "eight", NOT_OK, plant=between),
    Case("damping left out", R, NOT_OK, plant=damped),
    Case(
        "a shaft softer in y",
        "jeffcott three",
        NOT_OK,
        ("asymmetry", "stiffness"),
        plant=asymmetric,
    ),
    Case("a seal", ALL, NOT_OK, plant=sealed),
    Case("k_s left out", "rigid three", NOT_OK, ("stiffness",), plant=grounded),
    Case("a spring that stiffens", ALL, NOT_OK, plant=hardening),
    Case("a sensor 30 mm off", R, NOT_OK, ("plane[", "gain["), data=elsewhere),
    # what is known
    Case("a mass fixed 10 % off", ALL, NOT_OK, data=told("fixed", "m m2", lambda m: 1.1 * m)),
    Case("a length fixed 10 % off", R, NOT_OK, data=told("fixed", "L_b", lambda x: 1.1 * x)),
    Case(
        "a mass known 20 deviations off",
        ALL,
        NOT_OK,
        data=told("known", "m m2", lambda m: (1.1 * m, 0.005 * m)),
    ),
    Case(
        "a mass bounded from above, too low",
        SMALL,
        NOT_OK,
        data=told("bounds", "m m2", lambda m: (None, 0.9 * m)),
    ),
    Case("a start a hundred times off", ALL, ANY, data=told("start", "m m2", lambda m: 100 * m)),
    Case(
        "runout freed at one speed", "rigid", NOT_OK, data=lambda t: t.options.update(runout=True)
    ),
    # excitation
    Case("equal forces", "rigid three", ANY, plant=equal(1.0)),
    Case("nearly equal forces", "rigid three", ANY, plant=equal(0.95)),
    Case("one axis driven", ALL, ANY, plant=one_axis),
    Case("one line driven", ALL, ANY, plant=one_line),
    Case("a twentieth of the excitation", ALL, ANY, plant=weak(0.05)),
    Case("no excitation", SMALL, NOT_OK, plant=weak(0.0)),
    Case("ten times the noise", ALL, ANY, plant=noisier(10.0)),
    Case("a hundred times the noise", ALL, ANY, plant=noisier(100.0)),
    Case("at rest, equal forces", AT_REST, ANY, plant=both(at_rest, equal(1.0))),
    Case("at rest, one axis", AT_REST, ANY, plant=both(at_rest, one_axis)),
    # other methods
    Case(
        "batch, a sensor upside down",
        J,
        NOT_OK,
        data=both(scaled("sensors", -1), said(method="batch")),
    ),
    Case(
        "ls, two forces swapped", J, NOT_OK, data=both(swapped("inputs", (0, 1)), said(method="ls"))
    ),
    Case(
        "sequential, backwards",
        "eight",
        NOT_OK,
        data=both(said(speed=lambda t: -t.speed), said(method="sequential")),
    ),
    Case(
        "batch, identical periods",
        J,
        "ok rejected",
        ("identical periods",),
        data=both(tiled, said(method="batch")),
    ),
    Case(
        "batch, a knock",
        J,
        NOT_OK,
        ("knock",),
        data=both(column(added(knock), -1), said(method="batch")),
    ),
    Case("batch, no speed", J, NOT_OK, data=both(said(speed=0.0), said(method="batch"))),
)
