"""Shipped rigs changed for tests, and a slow reference that runs them event by event with scipy."""

import heapq
from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from rotorid import load_rig
from rotorid.force.laws import Differential
from rotorid.rig.parts import angle_and_speed
from rotorid.rig.rig import Rig, RigRecord


def with_magnets(k: str = "5e-6", bias: str = "1.5 A", gap: str = "0.5 mm", more: str = "") -> str:
    """Return the text of the shipped rig with opposed magnets in place of the linear law."""
    head, rest = load_rig("three-mass").text.split("[actuators.all]")
    law = f'law = "differential"\nK = "{k} N m^2/A^2"\nbias = "{bias}"\ngap = "{gap}"\n{more}\n'
    return f"{head}[actuators.all]\n{law}[sensors]{rest.split('[sensors]')[1]}"


def without_noise(rig: Rig) -> Rig:
    quiet = {name: replace(part, noise=0.0) for name, part in rig.actuators.items()}
    sensors = tuple(replace(sensor, noise=0.0) for sensor in rig.sensors)
    return replace(rig, actuators=quiet, sensors=sensors, process_noise={})


def with_actuators(rig: Rig, **changes: object) -> Rig:
    changed = {name: replace(part, **changes) for name, part in rig.actuators.items()}
    return replace(rig, actuators=changed)


def recorded(rig: Rig, duration: float, seed: int = 0) -> RigRecord:
    return rig.run(duration, np.random.default_rng(seed))


def _coil(part, command, current):
    return min(max((command - current) / part.time_constant, -part.slew), part.slew)


def reference_positions(rig: Rig, duration: float) -> np.ndarray:
    """Positions at the logger's samples, by DOP853 from event to event; shape (sample, n)."""
    linear, values = rig.model.require_linear(), rig.parameters
    fixed = linear.matrices(values, rig.rotation.speed)
    mu, parts, nominal = linear.monomial_values(values), rig.parts, rig.rotation.speed
    quarters = linear.load_columns(np.zeros(2), np.array([0.0, np.pi / 2]), nominal) @ mu
    inverse, n, inputs = np.linalg.inv(fixed.M), len(fixed.M), len(parts)
    turning = rig.rotation.numbers
    lagging = parts[0].time_constant > 0

    def force(part, current, position):
        if part.law is None:
            return current
        if isinstance(part.law, Differential):
            return part.law._force(current, position)
        return part.law.ki * current + part.law.ks * position

    def slope(t, z, held):
        angle, speed = angle_and_speed(turning, t)
        q, v, coil = z[:n], z[n : 2 * n], z[2 * n :] if lagging else held
        x = fixed.B.T @ q
        # Numbers of Python: half a million times arithmetic of numpy on one takes seconds.
        u = [force(*each) for each in zip(parts, coil.tolist(), x.tolist(), strict=True)]
        # Unbalance: Omega^2 (cos phi, sin phi).
        load = (speed / nominal) ** 2 * (np.array([np.cos(angle), np.sin(angle)]) @ quarters)
        right = fixed.B @ u + load - fixed.K @ q - (fixed.D + speed * fixed.G) @ v
        if not lagging:
            return np.concatenate([v, inverse @ right])
        coils = [_coil(*each) for each in zip(parts, held.tolist(), coil.tolist(), strict=True)]
        return np.concatenate([v, inverse @ right, coils])

    period, rate = rig.controller.period, rig.logger.sample_rate
    table = rig.excitation.samples(1 / period)
    columns = [rig.excitation.names.index(name) for name in rig.model.inputs]
    table = table[:, columns] / np.array([part.slopes[0] for part in parts])
    settling = round(rig.settling / period)
    names = [sensor.name for sensor in rig.sensors]
    read = [rig.sensors[names.index(f)].combination for f in rig.feedback]
    reads = np.array([[each.get(c, 0.0) for c in rig.model.coordinates] for each in read])
    z = np.zeros(2 * n + (inputs if lagging else 0))
    memory, held = np.zeros(rig.controller.states), np.zeros(inputs)
    samples = round(duration * rate)
    found = np.zeros((samples, n))
    events = [((k - settling) * period, 0, k - settling, None) for k in range(settling)]
    events += [(k * period, 0, k, None) for k in range(int(duration / period) + 1)]
    events += [(k / rate, 2, k, None) for k in range(samples)]
    heapq.heapify(events)
    now = -settling * period
    while events:
        t, kind, k, command = heapq.heappop(events)
        if t - now > 1e-12:
            fine = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-15}
            z = solve_ivp(slope, (now, t), z, args=(held,), **fine).y[:, -1]
            now = t
        if kind == 0:
            y = reads @ z[:n]
            u = rig.controller.C @ memory + rig.controller.D @ y + table[k % len(table)]
            memory = rig.controller.A @ memory + rig.controller.B @ y
            u = np.clip(u, *([s * part.limit for part in parts] for s in (-1, 1)))
            heapq.heappush(events, (t + rig.delay, 1, k, tuple(u)))
        elif kind == 1:
            held = np.array(command)
        else:
            found[k] = z[:n]
            if k == samples - 1:
                break
    return found
