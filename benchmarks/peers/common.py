"""What every entrant has: the case as it is read, the rotor in complex coordinates, the answer.

The rotor of the paper is isotropic, so that its two planes are one: z = x + i y at each mass and
theta = theta_y - i theta_x at the disc, one line at +omega and one at -omega for each harmonic.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

NAMES = ("m1", "m2", "m3", "I_t", "I_p", "k1", "k2", "L1", "L2", "xi", "zeta", "mu", "eta")
FORCES = {0: ("F_x1", "F_y1"), 3: ("F_x3", "F_y3")}
READINGS = {0: ("x1", "y1"), 1: ("x2", "y2"), 2: ("theta_y", "theta_x"), 3: ("x3", "y3")}
SIGN = {"theta_x": -1.0}


def pencil(p: Mapping[str, float], speed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return M, C, K of (-omega^2 M + omega C + K) z = B f + g."""
    mass = np.diag([p["m1"], p["m2"], p["I_t"], p["m3"]])
    gyroscopic = np.diag([0.0, 0.0, p["I_p"] * speed, 0.0])
    bent = np.array([[1.0, -1.0, p["L1"], 0.0], [0.0, 1.0, p["L2"], -1.0]])
    return mass, gyroscopic, bent.T @ np.diag([p["k1"], p["k2"]]) @ bent


def unbalance(p: Mapping[str, float], speed: float) -> np.ndarray:
    """Return g of g exp(i Omega t)."""
    static = p["m2"] * (p["xi"] + 1j * p["zeta"])
    dynamic = (p["I_t"] - p["I_p"]) * (p["eta"] - 1j * p["mu"])
    return speed**2 * np.array([0.0, static, dynamic, 0.0])


def frequencies(p: Mapping[str, float], speed: float) -> np.ndarray:
    """Return the natural frequencies of both whirls in Hz, ascending."""
    mass, gyroscopic, stiffness = pencil(p, speed)
    lower = np.hstack([np.linalg.solve(mass, stiffness), np.linalg.solve(mass, gyroscopic)])
    matrix = np.vstack([np.hstack([np.zeros((4, 4)), np.eye(4)]), lower])
    return np.sort(np.abs(np.linalg.eigvals(matrix).real)) / (2 * np.pi)


class Lines(NamedTuple):
    """Lines of the mean period in complex coordinates, and the variance E |noise|^2 of each."""

    omega: np.ndarray  # (line,), of both signs
    force: np.ndarray  # (line, 2), on coordinates 0 and 3
    reading: np.ndarray  # (line, reading)
    force_variance: np.ndarray
    reading_variance: np.ndarray


class Case(NamedTuple):
    """What case.json says, and the samples, shape (period, sample, channel)."""

    told: dict[str, Any]
    periods: np.ndarray

    @property
    def speed(self) -> float:
        return self.told["speed_rad_s"]

    @property
    def time(self) -> np.ndarray:
        return np.arange(self.told["period_samples"]) / self.told["sample_rate_hz"]

    @property
    def coordinates(self) -> list[int]:
        """The coordinates that sensors read."""
        return [k for k, pair in READINGS.items() if pair[0] in self.told["channels"]]

    def column(self, name: str) -> np.ndarray:
        """Return a channel, shape (period, sample), with its sign in complex coordinates."""
        return SIGN.get(name, 1.0) * self.periods[..., list(self.told["channels"]).index(name)]

    def lines(self) -> Lines:
        pairs = [*FORCES.values(), *(READINGS[k] for k in self.coordinates)]
        columns = np.stack([self.column(a) + 1j * self.column(b) for a, b in pairs], axis=-1)
        count, samples = columns.shape[:2]
        both = np.concatenate([self.told["harmonics"], -np.array(self.told["harmonics"])])
        mean = np.fft.fft(columns.mean(axis=0), axis=0)[both] / samples
        variance = columns.var(axis=0, ddof=1).mean(axis=0) / (count * samples)
        omega = 2 * np.pi * both * self.told["sample_rate_hz"] / samples
        return Lines(omega, mean[:, :2], mean[:, 2:], variance[:2], variance[2:])

    def predicted(
        self, p: Mapping[str, float], lines: Lines, force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the readings, shape (line, reading), and the compliance from forces to them."""
        w = lines.omega[:, None, None]
        mass, gyroscopic, stiffness = pencil(p, self.speed)
        compliance = np.linalg.inv(stiffness + w * gyroscopic - w**2 * mass)[:, self.coordinates]
        load = np.isclose(lines.omega, self.speed)[:, None] * unbalance(p, self.speed)
        load[:, list(FORCES)] += force
        return np.einsum("krc,kc->kr", compliance, load), compliance[:, :, list(FORCES)]


def real(z: np.ndarray) -> np.ndarray:
    return np.stack([z.real, z.imag], axis=-1).ravel()


def regression(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return F and b of F theta = b, shapes (sample, coordinate, theta) and (sample, coordinate).

    Of the mean period, its lines derived in the frequency domain; theta is m1, m2, m3, I_t, I_p,
    k1, k2, k1 L1, k2 L2, k1 L1^2 + k2 L2^2, m2 xi, m2 zeta, (I_t - I_p) mu, (I_t - I_p) eta.
    """
    if len(case.coordinates) < len(READINGS):
        raise ValueError("needs the motion of every coordinate")
    lines = case.lines()
    turn = np.exp(1j * np.outer(case.time, lines.omega))
    z, rate, acceleration = (
        turn @ ((1j * lines.omega[:, None]) ** n * lines.reading) for n in (0, 1, 2)
    )
    z1, z2, theta, z3 = z.T
    phi = case.speed**2 * np.exp(1j * case.speed * case.time)
    F = np.zeros((len(z), 4, 14), dtype=complex)
    F[:, [0, 1, 3, 2], [0, 1, 2, 3]] = acceleration[:, [0, 1, 3, 2]]
    F[:, 2, 4] = -1j * case.speed * rate[:, 2]
    F[:, 0, 5], F[:, 1, 5] = z1 - z2, z2 - z1
    F[:, 1, 6], F[:, 3, 6] = z2 - z3, z3 - z2
    F[:, 0, 7], F[:, 1, 7], F[:, 2, 7] = theta, -theta, z1 - z2
    F[:, 1, 8], F[:, 3, 8], F[:, 2, 8] = theta, -theta, z2 - z3
    F[:, 2, 9] = theta
    F[:, 1, 10], F[:, 1, 11], F[:, 2, 12], F[:, 2, 13] = -phi, -1j * phi, 1j * phi, -phi
    b = np.zeros((len(z), 4), dtype=complex)
    b[:, list(FORCES)] = turn @ lines.force
    return F, b


def of_base(theta: np.ndarray, covariance: np.ndarray) -> dict[str, Any]:
    """Return the answer that base parameters and their covariance amount to."""

    def values(t: np.ndarray) -> np.ndarray:
        static, dynamic = t[10:12] / t[1], t[12:14] / (t[3] - t[4])
        return np.array([*t[:7], t[7] / t[5], t[8] / t[6], *static, *dynamic])

    small = 1e-6 * np.where(theta == 0, 1.0, theta)
    slope = np.stack(
        [(values(theta + d) - values(theta - d)) / (2 * d.sum()) for d in np.diag(small)], axis=1
    )
    return answer(values(theta), np.sqrt(np.diag(slope @ covariance @ slope.T)))


def answer(values: Iterable[float], std: Iterable[float] | None = None) -> dict[str, Any]:
    found = {"parameters": dict(zip(NAMES, map(float, values), strict=True))}
    return found if std is None else found | {"std": dict(zip(NAMES, map(float, std), strict=True))}


def enter(solve: Callable[[Case], dict[str, Any]]) -> None:
    """Answer each case in OUT/cases, OUT the argument of the command, in OUT/answers/ENTRANT."""
    out, name = Path(sys.argv[1]), Path(sys.argv[0]).stem.removeprefix("with_")
    answers = out / "answers" / name
    answers.mkdir(parents=True, exist_ok=True)
    for folder in sorted((out / "cases").iterdir()):
        told = json.loads((folder / "case.json").read_text("utf-8"))
        samples = np.load(folder / "record.npy")
        case = Case(told, samples.reshape(-1, told["period_samples"], samples.shape[1]))
        begin = time.process_time()
        try:
            found = solve(case)
        except (ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError) as error:
            found = {"cannot": str(error).splitlines()[0]}
        found["seconds"] = time.process_time() - begin
        found["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        (answers / f"{folder.name}.json").write_text(json.dumps(found), "utf-8")
