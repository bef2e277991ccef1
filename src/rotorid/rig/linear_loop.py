"""The loop of a rig, linearized at its centre: its steps, its growth, its noise line by line."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy import linalg

from rotorid.core.values import Array, Complexes, Floats, frozen
from rotorid.rig.kernel import Steps
from rotorid.rig.machine import RigMachine
from rotorid.rig.plant import Lags, Plant, Rows


def exact_steps(rig: RigMachine, plant: Plant, lags: Lags, speed: float) -> Steps:
    """Return the exact steps of a rig linearized at its centre, at a speed (matrix exponential)."""
    a, cuts = _continuous(rig, plant.at(speed), lags, speed)
    lengths = rig.schedule.length
    step = {length: linalg.expm(a * length) for length in set(lengths)}
    steps = np.array([step[length] for length in lengths])[:, : cuts[0]]
    blocks = np.split(steps, cuts, axis=2)
    return Steps(True, *(np.ascontiguousarray(block) for block in blocks))


def _continuous(
    rig: RigMachine, plant: Plant, lags: Lags, speed: float
) -> tuple[Floats, list[int]]:
    """Return the rates of [x, commands, random forces, loads], and where each of these begins."""
    n, inputs = plant.force.shape
    ki, ks = np.array([part.slopes for part in rig.parts]).T
    lag = np.array([part.time_constant for part in rig.parts])
    noise = noise_matrix(rig, plant)
    lagging, z = np.flatnonzero(lag > 0), 2 * n + np.count_nonzero(lag)
    states = z + len(lags.floor)
    first, last = states + inputs, states + inputs + noise.shape[1]
    size = last + 2 * len(plant.harmonics)
    a = np.zeros((size, size))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, : 2 * n] = plant.motion[0]
    a[n : 2 * n, :n] += (plant.force * ks) @ plant.displacement
    a[n : 2 * n, :first] += (plant.force * ki) @ _rows(rig, lags.effective)
    rates = 1.0 / lag[lagging]
    a[2 * n : z, 2 * n : z] = -np.diag(rates)
    a[2 * n + np.arange(len(lagging)), states + lagging] = rates
    a[z:states, :first] = _rows(rig, lags.rate)
    a[n : 2 * n, first:last] = noise
    a[n : 2 * n, last:] = plant.load[0].transpose(1, 0, 2).reshape(n, -1)
    for h, multiple in enumerate(plant.harmonics):
        turn = np.array([[0.0, -1.0], [1.0, 0.0]]) * multiple * speed
        a[last + 2 * h : last + 2 * h + 2, last + 2 * h : last + 2 * h + 2] = turn
    return a, [states, first, last]


def _rows(rig: RigMachine, signal: Rows) -> Floats:
    """Return a signal, where no iron has hysteresis, as a matrix over [x, held commands]."""
    motion, electric, state = signal
    lags, inputs = np.array([part.time_constant > 0 for part in rig.parts]), len(rig.parts)
    current = electric[:, :inputs] + electric[:, inputs:]
    return np.hstack([motion, current[:, lags], state, current * ~lags])


def noise_matrix(rig: RigMachine, plant: Plant) -> Floats:
    """Return the accelerations per random force and per disturbance, shape (coordinate, noise)."""
    own = np.eye(len(plant.force))
    inputs = dict(zip(rig.model.inputs, plant.force.T, strict=True))
    moved = dict(zip(rig.model.coordinates, own, strict=True))
    pushed = dict(zip(rig.model.coordinates, np.linalg.solve(plant.mass, own).T, strict=True))
    columns = [(inputs | pushed)[name] for name in rig.process_noise]
    for part in rig.disturbances:
        columns.append(sum((inputs | moved)[name] for name in part.on))
    return np.ascontiguousarray(np.array(columns).reshape(len(columns), len(own)).T, dtype=float)


def growth(rig: RigMachine, plant: Plant, speed: float) -> tuple[float, float, str]:
    """Return growth rate (1/s), frequency (Hz) and axis of the loop's least stable motion."""
    values, vectors = np.linalg.eig(followed(rig, plant, speed, noises=0).state)
    worst = int(np.argmax(np.abs(values)))
    radius, angle = float(np.abs(values[worst])), float(np.abs(np.angle(values[worst])))
    moving = np.abs(vectors[:, worst])
    at_actuators = np.abs(plant.displacement @ moving[: len(plant.force)])
    axis = rig.model.inputs[int(np.argmax(at_actuators))]
    duration = rig.schedule.duration
    return float(np.log(max(radius, 1e-300))) / duration, angle / duration / (2 * np.pi), axis


class Pattern(NamedTuple):
    """The linear loop over one pattern of its events: ``x+ = state x + noise w``, w white.

    x: rotor and amplifiers, controller, commands held and waiting, as the kernel keeps them. The
    sum of ``shown[e] [x; w]``, each at its `offset` in s, is the mean of the logger's columns.
    """

    state: Floats  # (state, state)
    noise: Floats  # (state, noise)
    shown: Floats  # (log, column, state + noise): inputs before sensors
    offset: Floats  # (log,)


def followed(rig: RigMachine, plant: Plant, speed: float, noises: int) -> Pattern:
    """Follow the states, and the first so many noises, through the events as the kernel does."""
    schedule, controller, lags = rig.schedule, rig.controller, rig.lags(plant)
    steps = exact_steps(rig, plant, lags, speed)
    rotor, memory, inputs = steps.state.shape[1], controller.states, controller.commands
    slots = schedule.lag + 1  # commands that wait at the start of a pattern, the newest last
    size = rotor + memory + (slots + 1) * inputs
    x, m, rest = np.split(np.eye(size, size + noises), [rotor, rotor + memory])
    held, *waiting = np.split(rest, slots + 1)
    forces = [*rig.process_noise.values()] + [0.0] * len(rig.disturbances)
    every, drawn, shown, at = rig.logger.oversampling, size, list[Floats](), list[float]()

    def white(stds: Iterable[float]) -> Floats:
        nonlocal drawn
        std = np.array([*stds])
        drawn += len(std)
        return std[:, None] * np.eye(len(std), size + noises, drawn - len(std))

    def signal(rows: Rows) -> Floats:
        return _rows(rig, rows) @ np.vstack([x, held])

    for e, offset in enumerate(schedule.offset.tolist()):
        reads = schedule.control[e] >= 0
        sampled = schedule.log[e] >= 0 and schedule.log[e] % every == 0
        if reads or sampled:
            error = white(sensor.noise for sensor in rig.sensors)
        if reads:
            push, read = white(forces), (signal(lags.reading) + error)[rig.fed_back]
            waiting.append(controller.C @ m + controller.D @ read)
            m = controller.A @ m + controller.B @ read
        if schedule.apply[e] >= 0:
            # Commands since the pattern began, and those from before it, counted from its start.
            held = waiting[slots + schedule.apply[e] - schedule.lag]
        if schedule.log[e] >= 0:
            column = np.zeros((inputs + len(rig.sensors), size + noises))
            if rig.logger.current == "measured":
                column[:inputs] = signal(lags.recorded) / every
            elif sampled:
                column[:inputs] = waiting[-1]
            if sampled:
                column[:inputs] += white(part.noise for part in rig.parts)
                column[inputs:] = signal(lags.logged) + error
            shown.append(column * every / schedule.logs)
            at.append(offset)
        x = steps.state[e] @ x + steps.command[e] @ held + steps.noise[e] @ push
    after = np.vstack([x, m, held, *waiting[-slots:]])
    return Pattern(after[:, :size], after[:, size:], np.array(shown), np.array(at))


@frozen
class LineNoise:
    """Noise of the lines of successive periods, of a rig in closed loop.

    With z = exp(i omega T) and n patterns of duration T in a period, so that z^n = 1, the lines of
    a period follow exactly from those of its white noise, W, and from the states at its ends:

    ``Y = [shown_w W + shown_x R (noise W - z (x[n] - x[0]))] / n``, ``R = (z - state)^-1``,
    ``x[n] = state^n x[0] + v``, ``E v W^H = (1 - state^n) R noise``:

    what a period leaves to the next, and one line to others, is in them.
    """

    own: Complexes  # (line, column, noise): Y per white noise of variance 1
    ends: Complexes  # (line, column, state): Y per x[n] - x[0]
    over: Floats  # (state, state): state^n
    driven: Complexes  # (line, state, noise): v per white noise
    rest: Floats  # (state, state): root of the covariance of what else is in v
    begin: Floats  # (state, state): root of the covariance of x[0]

    @classmethod
    def of(cls, rig: RigMachine, omega: Floats, period: float) -> LineNoise:
        """Return the noise of lines at rad/s, DC excepted, of a period of whole patterns, in s."""
        plan, sensors, columns = rig.schedule, len(rig.sensors), len(rig.sensors) + len(rig.parts)
        noises = plan.controls * (sensors + len(rig.process_noise)) + plan.logs * columns
        loop = followed(rig, rig.plant(period), rig.rotation.speed, noises)
        one, count = np.eye(len(loop.state)), round(period / plan.duration)
        z = np.exp(1j * omega * plan.duration)[:, None, None]
        shown = np.tensordot(np.exp(-1j * np.outer(omega, loop.offset)), loop.shown, 1)
        resolved = np.linalg.solve(z * one - loop.state, one)
        read, over = shown[:, :, : len(one)] @ resolved, np.linalg.matrix_power(loop.state, count)
        settled = linalg.solve_discrete_lyapunov(loop.state, loop.noise @ loop.noise.T)
        driven = (one - over) @ resolved @ loop.noise / np.sqrt(count)
        told = 2 * np.einsum("lsw,ltw->st", driven, driven.conj()).real
        return cls(
            own=(shown[:, :, len(one) :] + read @ loop.noise) / np.sqrt(count),
            ends=-z * read / count,
            over=over,
            driven=driven,
            rest=_root(settled - over @ settled @ over.T - told),
            begin=_root(settled),
        )

    def draw(self, periods: int, rng: np.random.Generator) -> Complexes:
        """Return the noise of successive periods, shape (period, line, column)."""
        shape = (periods, len(self.own), self.own.shape[2])
        white = np.sqrt(0.5) * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
        v = 2 * np.tensordot(white, self.driven, ([1, 2], [0, 2])).real
        v += rng.standard_normal(v.shape) @ self.rest.T
        states = [self.begin @ rng.standard_normal(len(self.begin))]
        for each in v:
            states.append(self.over @ states[-1] + each)
        ends = np.tensordot(np.diff(states, axis=0), self.ends, (1, 2))
        own = white.swapaxes(0, 1) @ self.own.swapaxes(1, 2)  # (line, period, column)
        return np.asarray(own.swapaxes(0, 1) + ends)


def _root(covariance: Array) -> Floats:
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
