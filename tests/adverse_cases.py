"""The table of adverse records: what was done, to which machines, and what it must be called."""

from collections.abc import Callable
from typing import Any

import numpy as np
from adverse import FUNDAMENTAL, RATE, ROTATION, TURN, Case, Edit, Trial
from rotor_bank import Floats
from scipy import signal

Change = Callable[[Trial, Floats], Floats]

# What is done to a record: to its plant, its samples, or what is said of them.


def both(*edits: Edit) -> Edit:
    def edit(trial: Trial) -> None:
        for each in edits:
            each(trial)

    return edit


def said(**values: Any) -> Edit:
    """Say something else of the record, or of the trial; a function is given the trial."""

    def edit(trial: Trial) -> None:
        for name, value in values.items():
            setattr(trial, name, value(trial) if callable(value) else value)

    return edit


def times(name: str, factor: float) -> Edit:
    """Say something, or have something, so many times as large as it is."""
    return said(**{name: lambda trial: getattr(trial, name) * factor})


def told(kind: str, name: str, make: Callable[[float], Any]) -> Edit:
    """Say something of a parameter, made of its true value: of the first that the machine has."""

    def edit(trial: Trial) -> None:
        known = next(n for n in name.split() if n in trial.machine.truth)
        value = make(trial.machine.truth[known])
        trial.options.setdefault(kind, {})[known] = value

    return edit


def column(change: Change, number: int = 0, which: str = "s") -> Edit:
    """Change the samples of one channel; -1: of all of its kind; "a": of all channels."""

    def edit(trial: Trial) -> None:
        names = {"s": trial.sensors, "i": trial.inputs, "a": list(trial.columns)}[which]
        for name in names if number < 0 else [names[number]]:
            trial.columns[name] = change(trial, trial.columns[name])

    return edit


def scaled(which: str, factor: float, count: int = 1) -> Edit:
    """Multiply some columns: the first so many `inputs` or `sensors`; all for 0."""

    def edit(trial: Trial) -> None:
        for name in getattr(trial, which)[: count or None]:
            trial.columns[name] *= factor

    return edit


def swapped(which: str, *pairs: tuple[int, int]) -> Edit:
    def edit(trial: Trial) -> None:
        names, columns = getattr(trial, which), trial.columns
        for a, b in pairs:
            columns[names[a]], columns[names[b]] = columns[names[b]], columns[names[a]]

    return edit


def copied(which: str) -> Edit:
    def edit(trial: Trial) -> None:
        names: list[str] = getattr(trial, which)
        trial.columns[names[1]] = trial.columns[names[0]].copy()

    return edit


def clipped(_: Trial, x: Floats) -> Floats:
    limit = 0.8 * np.abs(x).max()
    return np.clip(x, -limit, limit)


def coarse(steps: float) -> Change:
    """Round to so many steps from peak to peak."""
    return lambda _, x: np.ptp(x) / steps * np.round(x / (np.ptp(x) / steps))


def lost(count: int) -> Change:
    """Leave out samples; fewer than none: repeat some."""

    def change(_: Trial, x: Floats) -> Floats:
        k = int(0.4 * len(x)) + 37
        return np.concatenate([x[:k], x[k + count :]])[: len(x) - 25]

    return change


def late(_: Trial, x: Floats) -> Floats:
    """Come a sample later."""
    omega = TURN * np.fft.rfftfreq(len(x), 1 / RATE)
    return np.fft.irfft(np.fft.rfft(x) * np.exp(-1j * omega / RATE), n=len(x))


def stretched(_: Trial, x: Floats) -> Floats:
    """Be sampled with a clock that is slow by 50 ppm."""
    place = np.arange(len(x)) * (1 + 50e-6)
    fine = signal.resample(x, 8 * len(x))
    return np.interp(np.minimum(8 * place, 8.0 * len(x) - 1), np.arange(8 * len(x)), fine)


def filtered(_: Trial, x: Floats) -> Floats:
    """Pass a second-order low-pass filter of 1 kHz, as an analogue one does."""
    s = 1j * np.fft.rfftfreq(len(x), 1 / RATE) / 1000.0
    return np.fft.irfft(np.fft.rfft(x) / (1 + np.sqrt(2) * s + s**2), n=len(x))


def added(make: Callable[[Trial, Floats], Floats]) -> Change:
    """Add something that depends on time, in units of the rms of the column."""
    return lambda trial, x: x + x.std() * make(trial, np.arange(len(x)) / RATE)


def line(hertz: float) -> Change:
    return added(lambda _, time: 0.05 * np.cos(TURN * hertz * time + 1.0))


def spikes(trial: Trial, time: Floats) -> Floats:
    found = np.zeros(len(time))
    found[trial.rng.integers(0, len(time), 5)] = 50.0
    return found


def knock(_: Trial, time: Floats) -> Floats:
    since = np.maximum(time - 0.93, 0)
    return 4 * np.exp(-60 * since) * np.sin(TURN * 171 * since)


def settling(_: Trial, time: Floats) -> Floats:
    return 3 * np.exp(-time / 0.12) * np.cos(TURN * 67 * time)


def wandering(trial: Trial, time: Floats) -> Floats:
    return np.cumsum(trial.rng.standard_normal(len(time))) / np.sqrt(len(time)) * 3


def runout(_: Trial, time: Floats) -> Floats:
    return 0.2 * np.cos(TURN * ROTATION * FUNDAMENTAL * time + 0.7)


def stuck(_: Trial, x: Floats) -> Floats:
    """Stay at one value from the middle on."""
    return np.where(np.arange(len(x)) < len(x) // 2, x, x[len(x) // 2])


def bent(_: Trial, x: Floats) -> Floats:
    """Have a characteristic with a cubic share at the peak."""
    return x * (1 + 0.1 * (x / np.abs(x).max()) ** 2)


def drifting(_: Trial, x: Floats) -> Floats:
    return x * (1 + 0.03 * np.linspace(0, 1, len(x)))


def creeping(_: Trial, time: Floats) -> Floats:
    return 5 * time / time[-1]


def repeating(trial: Trial, x: Floats) -> Floats:
    return np.tile(x[: trial.size], trial.periods)


def force(trial: Trial, _: Floats) -> Floats:
    return 1e-6 * trial.columns[trial.inputs[0]]


def first_only(count: int) -> Edit:
    return column(lambda trial, x: x[: count * trial.size], -1, "a")


def gap(_: Trial, x: Floats) -> Floats:
    return np.where((np.arange(len(x)) >= 500) & (np.arange(len(x)) < 520), np.nan, x)


def heavier(trial: Trial) -> None:
    """Add a third of the first mass at the first coordinate."""
    mass = trial.machine.rotor.M.copy()
    mass[0, 0] *= 1.3
    trial.change(M=mass)


def between(trial: Trial) -> None:
    """Add a mass in the middle of the shaft between the first two masses."""
    length, row = trial.machine.truth["L1"], np.zeros((2, 8))
    row[0, [0, 2, 5]] = 0.5, 0.5, length / 8
    row[1, [1, 3, 4]] = 0.5, 0.5, -length / 8
    trial.change(M=trial.machine.rotor.M + 0.2 * row.T @ row)


def damped(trial: Trial) -> None:
    m = trial.machine.rotor
    stiff = m.K if m.K.any() else 1e6 * m.M
    trial.change(D=m.D + 3e-5 * stiff)


def asymmetric(trial: Trial) -> None:
    """Be softer in y."""
    stiffness = trial.machine.rotor.K.copy()
    odd = np.array([1, 3, 4, 7]) if len(stiffness) == 8 else np.arange(1, len(stiffness), 2)
    stiffness[np.ix_(odd, odd)] *= 0.97
    trial.change(K=stiffness)


def sealed(trial: Trial) -> None:
    """Push square to the displacement, as a seal does."""
    stiffness = trial.machine.rotor.K.copy()
    size = 0.02 * (TURN * 100) ** 2 * trial.machine.rotor.M[0, 0]
    stiffness[0, 1] += size
    stiffness[1, 0] -= size
    trial.change(K=stiffness)


def grounded(trial: Trial) -> None:
    """Pull at the first mass, as a force law without its k_s does."""
    stiffness = trial.machine.rotor.K.copy()
    stiffness[[0, 1], [0, 1]] -= 0.05 * (TURN * 100) ** 2 * trial.machine.rotor.M[0, 0]
    trial.change(K=stiffness)


def hardening(trial: Trial) -> None:
    """Let a spring at the first coordinate stiffen by a few percent at the peak."""
    m = trial.machine.rotor
    trial.cubic = (0, 0.02 * max(m.K[0, 0], (TURN * 20) ** 2 * m.M[0, 0]))


def equal(share: float) -> Edit:
    """Drive all axes alike, the second half with a share."""

    def edit(trial: Trial) -> None:
        trial.forces = trial.forces[:, :1] * np.ones(trial.forces.shape[1])
        trial.forces[:, trial.forces.shape[1] // 2 :] *= share

    return edit


def one_axis(trial: Trial) -> None:
    trial.forces[:, 1:] = 0


def one_line(trial: Trial) -> None:
    trial.forces[1:] = 0


def at_rest(trial: Trial) -> None:
    """Stand still; what turns is known."""
    trial.rotation = trial.speed = 0.0
    names = [n for n in ("I_p", "xi", "zeta", "mu", "eta") if n in trial.machine.truth]
    trial.options["fixed"] = {n: trial.machine.truth[n] for n in names}


# -------------------------------------------------------------------------------------------------
# The cases.


NOT_OK = "rejected not_identifiable not_converged refused"
ALL, SMALL = "jeffcott rigid three", "jeffcott rigid"
J, R = "jeffcott", "rigid"
AT_REST = "three three jeffcott rigid"  # of the first, which takes long, half the records
UNIT = ("unit[", "gain[")
IN_MM = both(scaled("sensors", 1e3, 0), told("known", "m", lambda m: (m, 0.01 * m)))
STRONGER = both(scaled("inputs", 1.1, 0), told("known", "m", lambda m: (m, 0.001 * m)))
MASSES = "m m2"


def bad(what: str, machines: str, *words: str, data: Edit) -> Case:
    """Return a case of wrong data, or of what is said of them, that must not be called ok."""
    return Case(what, machines, NOT_OK, words, None, data)


def other(what: str, machines: str, *words: str, plant: Edit) -> Case:
    """Return a case of another plant than the model's."""
    return Case(what, machines, NOT_OK, words, plant)


def free(what: str, machines: str, plant: Edit | None = None, data: Edit | None = None) -> Case:
    """Return a case that may be called anything; ok only with a right answer."""
    return Case(what, machines, f"ok {NOT_OK}", (), plant, data)


def noted(what: str, machines: str, word: str, data: Edit) -> Case:
    """Return a case that may be called anything, if it is said; ok only with a right answer."""
    return Case(what, machines, f"ok {NOT_OK}", (word,), None, data)


def refused(what: str, machines: str, *words: str, data: Edit) -> Case:
    return Case(what, machines, "refused", words, None, data)


def by(method: str, edit: Edit) -> Edit:
    """Do something to a record for another method."""
    return both(edit, said(method=method))


MISKNOWN = told("known", MASSES, lambda m: (1.1 * m, 0.005 * m))
BOUNDED = told("bounds", MASSES, lambda m: (None, 0.9 * m))
SWAPPED, DOWN = swapped("sensors", (0, 1)), scaled("sensors", -1)
FASTER = said(rate=2 * RATE, fundamental=2 * FUNDAMENTAL)
IN_FORCES = both(column(lost(1), -1, "i"), column(lost(0), -1))
BELOW = "lines below noise"
BACKWARD = times("speed", -1)
LOST = "lost samples"
CASES = (
    Case("nothing at all", "jeffcott rigid three eight", "ok"),
    # signs
    bad("a sensor upside down", SMALL, "sign[", "gain[", data=scaled("sensors", -1)),
    bad("a force upside down", SMALL, "sign[", "gain[", data=scaled("inputs", -1)),
    bad("all forces upside down", SMALL, data=scaled("inputs", -1, 0)),
    bad("all sensors upside down", SMALL, data=scaled("sensors", -1, 0)),
    bad("the sensors of a plane upside down", R, data=scaled("sensors", -1, 2)),
    bad("the forces of a plane upside down", R, data=scaled("inputs", -1, 2)),
    # columns
    bad("two sensors swapped", SMALL, "swap[", data=swapped("sensors", (0, 1))),
    bad("two forces swapped", SMALL, "swap[", data=swapped("inputs", (0, 1))),
    bad("sensors of one axis swapped", R, "swap[", data=swapped("sensors", (0, 2))),
    bad("the sensors of the planes swapped", R, data=swapped("sensors", (0, 2), (1, 3))),
    bad("the forces of the planes swapped", R, data=swapped("inputs", (0, 2), (1, 3))),
    bad("a sensor read twice", SMALL, "copied", data=copied("sensors")),
    bad("a force read twice", SMALL, "copied", data=copied("inputs")),
    bad("a force in the place of a sensor", SMALL, data=column(force)),
    bad("swapped and upside down", SMALL, data=both(SWAPPED, DOWN)),
    # units
    bad("a sensor in mm", SMALL, *UNIT, data=scaled("sensors", 1e3)),
    bad("a sensor in mil for um", SMALL, *UNIT, data=scaled("sensors", 1 / 25.4)),
    bad("a force in kN", SMALL, *UNIT, data=scaled("inputs", 1e-3)),
    bad("a sensor 3 % off", SMALL, "gain[", data=scaled("sensors", 1.03)),
    bad("a force 3 % off", SMALL, "gain[", data=scaled("inputs", 1.03)),
    bad("all sensors in mm, the mass known", SMALL, *UNIT, "prior m", data=IN_MM),
    bad("all forces 10 % off, the mass known", SMALL, "gain[", "prior m", data=STRONGER),
    # speed
    bad("the rotation backwards", R, "speed", data=BACKWARD),
    bad("the rotation of a disc backwards", J, "speed", "load at", "runout[", data=BACKWARD),
    bad("rad/s given as rpm", SMALL, "speed", data=said(speed=lambda t: t.speed * TURN / 60)),
    bad("Hz given as rpm", SMALL, "speed", data=said(speed=lambda t: t.speed / 60)),
    bad("no speed", SMALL, "speed", data=said(speed=0.0)),
    bad("twice the speed", SMALL, "speed", data=times("speed", 2)),
    bad("half the speed", SMALL, "speed", data=times("speed", 0.5)),
    other(
        "a speed off by .06 %", SMALL, "speed", "wander", "drift", plant=times("rotation", 0.9994)
    ),
    free("628.3 rad/s for 6000 rpm", SMALL, times("rotation", 1 - 3e-5)),
    other("a speed off by a tenth", SMALL, "speed", "wander", plant=times("rotation", 1.1)),
    # rate, period, order
    bad("twice the rate and the fundamental", SMALL, data=FASTER),
    bad("twice the rate", SMALL, data=said(rate=2 * RATE)),
    bad("half the rate", SMALL, data=said(rate=RATE / 2)),
    bad("twice the fundamental", SMALL, "period", data=times("fundamental", 2)),
    bad("half the fundamental", SMALL, "period", data=said(fundamental=FUNDAMENTAL / 2)),
    bad("a period one sample short", SMALL, data=said(fundamental=RATE / 199)),
    bad("even lines for odd ones", SMALL, BELOW, data=said(harmonics=(2, 4, 6, 8, 10))),
    bad("the line of the rotation left out", SMALL, data=said(harmonics=(1, 3, 5, 9, 11))),
    bad("one line only", SMALL, data=said(harmonics=(7,))),
    # bad data
    bad("a dead sensor", ALL, "dead", data=column(lambda _, x: 0 * x)),
    refused("all sensors dead", ALL, data=column(lambda _, x: 0 * x, -1)),
    bad("a dead force", SMALL, data=column(lambda _, x: 0 * x, which="i")),
    refused("a sensor stuck half-way", SMALL, "stuck", data=column(stuck)),
    bad("a clipped sensor", SMALL, "clipped", data=column(clipped)),
    bad("a clipped force", SMALL, "clipped", data=column(clipped, which="i")),
    free("a sensor of 4 bits", SMALL, data=column(coarse(16))),
    free("all sensors of 6 bits", SMALL, data=column(coarse(64), -1)),
    noted("a knock", ALL, "knock", data=column(added(knock), -1)),
    free("spikes in a sensor", ALL, data=column(added(spikes))),
    noted("a transient at the start", ALL, "settled", data=column(added(settling), -1)),
    bad("a gain that drifts by 3 %", ALL, "drift", data=column(drifting)),
    free("an offset that drifts", SMALL, data=column(added(creeping), -1)),
    free("a sensor that walks at random", ALL, data=column(added(wandering))),
    bad("one sample lost", ALL, LOST, data=column(lost(1), -1, "a")),
    bad("twenty samples lost", ALL, LOST, data=column(lost(20), -1, "a")),
    bad("a sample twice", ALL, LOST, data=column(lost(-1), -1, "a")),
    bad("a sample lost in the forces", ALL, LOST, data=IN_FORCES),
    bad("two clocks, 50 ppm", ALL, "clocks", data=column(stretched, -1)),
    refused("missing values", ALL, "finite", data=column(gap)),
    bad("identical periods", ALL, "identical periods", data=column(repeating, -1, "a")),
    free("one sensor's periods identical", SMALL, data=column(repeating)),
    free("two periods", ALL, data=first_only(2)),
    free("three periods", ALL, data=first_only(3)),
    refused("less than two periods", ALL, "period", data=first_only(1)),
    bad("hum on a line", SMALL, "line 60 Hz", data=column(line(60.0), -1)),
    free("hum beside the lines", ALL, data=column(line(50.0), -1)),
    bad("a sensor a sample late", ALL, "delay[", data=column(late)),
    bad("all sensors a sample late", ALL, "delay[", data=column(late, -1)),
    bad("a filter on all sensors", ALL, "delay[", "bandwidth", data=column(filtered, -1)),
    bad("runout of a sensor", SMALL, data=column(added(runout))),
    bad("a bent sensor", SMALL, data=column(bent)),
    # the model
    other("a mass more at one place", ALL, "mass", "asymmetry m", plant=heavier),
    other("a mass between two places", "eight", plant=between),
    other("damping left out", R, plant=damped),
    other("a shaft softer in y", "jeffcott three", "asymmetry", "stiffness", plant=asymmetric),
    other("a seal", ALL, plant=sealed),
    other("k_s left out", "rigid three", "stiffness", plant=grounded),
    other("a spring that stiffens", ALL, plant=hardening),
    bad(
        "a sensor 30 mm off",
        R,
        *("plane[", "gain["),
        data=lambda t: t.reads.update(s_xa={"x": 1.0, "theta_y": -0.2}),
    ),
    # what is known
    bad("a mass fixed 10 % off", ALL, data=told("fixed", MASSES, lambda m: 1.1 * m)),
    bad("a length fixed 10 % off", R, data=told("fixed", "L_b", lambda x: 1.1 * x)),
    bad("a mass known 20 deviations off", ALL, data=MISKNOWN),
    bad("a mass bounded from above, too low", SMALL, data=BOUNDED),
    free("a start a hundred times off", ALL, data=told("start", MASSES, lambda m: 100 * m)),
    bad("runout freed at one speed", R, data=lambda t: t.options.update(runout=True)),
    # excitation
    free("equal forces", "rigid three", equal(1.0)),
    free("nearly equal forces", "rigid three", equal(0.95)),
    free("one axis driven", ALL, one_axis),
    free("one line driven", ALL, one_line),
    free("a twentieth of the excitation", ALL, times("forces", 0.05)),
    other("no excitation", SMALL, plant=times("forces", 0.0)),
    free("ten times the noise", ALL, times("noise", 10.0)),
    free("a hundred times the noise", ALL, times("noise", 100.0)),
    free("at rest, equal forces", AT_REST, both(at_rest, equal(1.0))),
    free("at rest, one axis", AT_REST, both(at_rest, one_axis)),
    # other methods
    bad("batch, a sensor upside down", J, data=by("batch", scaled("sensors", -1))),
    bad("ls, two forces swapped", J, data=by("ls", swapped("inputs", (0, 1)))),
    bad("sequential, backwards", "eight", data=by("sequential", BACKWARD)),
    Case(
        "batch, identical periods",
        J,
        "ok rejected",
        ("identical periods",),
        data=by("batch", column(repeating, -1, "a")),
    ),
    bad("batch, a knock", J, "knock", data=by("batch", column(added(knock), -1))),
    bad("batch, no speed", J, data=by("batch", said(speed=0.0))),
)
