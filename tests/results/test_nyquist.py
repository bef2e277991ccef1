"""Poles of a loop counted on the right, against eigenvalues."""

import numpy as np
import pytest
import scipy

import rotorid as rid
from rotorid.results.loops import _from_above, plant_poles, poles_on_the_right

GRID = 2 * np.pi * np.concatenate([np.geomspace(1e-3, 1, 200)[:-1], np.geomspace(1, 1e5, 12000)])


class Loop:
    """A plant and a controller kp + kd s + ki / s behind a low pass of the second order."""

    def __init__(self, rng: np.random.Generator) -> None:
        n = int(rng.integers(1, 5))
        root, other = rng.standard_normal((2, n, n))
        turned = rng.standard_normal((n, n))
        self.mass = root @ root.T + np.eye(n)
        self.stiffness = (other @ other.T) * rng.choice([1e4, 0.0]) + np.diag(
            rng.uniform(-1e4, 2e4, n)  # magnets
        )
        self.damping = rng.choice([0.0, 0.1, 5.0]) * np.eye(n)
        self.damping += rng.choice([0.0, 50.0]) * (turned - turned.T)  # gyroscopic
        m = int(rng.integers(1, n + 1))
        self.push = rng.standard_normal((n, m))
        self.reads = self.push.T + rng.choice([0.0, 0.3]) * rng.standard_normal((m, n))
        self.gains = rng.uniform([-6e3, -60.0], [3e4, 200.0])
        self.integral = float(rng.choice([0.0, 0.0, 1e5]))
        self.corner = float(rng.choice([1e3, 1e4]))

    def controller(self, s):
        lag = 1 + s / self.corner
        return -(self.gains[0] + self.gains[1] * s / lag + self.integral / s) / lag

    def returned(self, omega):
        s = 1j * omega[:, None, None]
        plant = s**2 * self.mass + s * self.damping + self.stiffness
        driven = np.broadcast_to(self.push + 0j, (len(omega), *self.push.shape))
        answer = self.reads @ np.linalg.solve(plant, driven)
        return np.eye(answer.shape[1]) - self.controller(s) * answer

    def poles(self):
        """Return the poles of the closed loop, from the matrix polynomial it makes."""
        c, k, d = self.corner, *self.gains
        if self.integral:
            below = np.poly1d([1 / c**2, 2 / c, 1, 0])
            above = -np.poly1d([k / c + d, k + self.integral / c, self.integral])
        else:
            below = np.poly1d([1 / c**2, 2 / c, 1])
            above = -np.poly1d([k / c + d, k])
        n, order = len(self.mass), len(below.c) + 1
        terms = np.zeros((order + 1, n, n))
        for i, part in enumerate(below.c[::-1]):
            for j, matrix in enumerate((self.stiffness, self.damping, self.mass)):
                terms[i + j] += part * matrix
        for i, part in enumerate(above.c[::-1]):
            terms[i] -= part * self.push @ self.reads
        left, right = np.eye(order * n, k=n), np.eye(order * n)
        left[-n:] = -np.hstack(terms[:-1])
        right[-n:, -n:] = terms[-1]
        return scipy.linalg.eigvals(left, right)


@pytest.mark.slow
def test_random_loops_are_counted_as_their_eigenvalues_are():
    rng = np.random.default_rng(4)
    told, untold = [], 0
    for _ in range(150):
        loop = Loop(rng)
        poles = loop.poles()
        if ((np.abs(poles.real) < 0.1) & (np.abs(poles) > 1e-2)).any():
            continue  # neither stable nor not, to the digits of the lines
        plant = plant_poles(loop.stiffness, loop.damping, loop.mass)
        found = poles_on_the_right(GRID, loop.returned(GRID), plant)
        if isinstance(found, str):
            untold += 1
        else:
            told.append((found, int((poles.real > 0.1).sum())))
    assert all(found == wanted for found, wanted in told)
    assert len({wanted for _, wanted in told}) >= 4
    assert untold < 0.05 * len(told)


def single(kp: float, kd: float, delay: float, omega, k: float = 0.0):
    """Return 1 + L and the plant's poles of 1 kg on a spring with a controller and a delay."""
    s = 1j * omega
    returned = 1 + (kp + kd * s) * np.exp(-s * delay) / (s**2 + k)
    return returned[:, None, None], plant_poles(np.array([[k]]), np.zeros((1, 1)), np.eye(1))


def test_a_delay_and_a_negative_stiffness():
    omega = np.geomspace(0.1, 1e5, 5000)
    for delay, count in ((0.0, 0), (5e-3, 0), (5e-2, 2), (0.5, None)):
        found = poles_on_the_right(omega, *single(1e3, 20.0, delay, omega))
        assert found == count or (count is None and isinstance(found, int) and found > 2)
    assert poles_on_the_right(omega, *single(500.0, 20.0, 0.0, omega, k=-1e3)) == 1
    assert poles_on_the_right(omega, *single(1500.0, 20.0, 0.0, omega, k=-1e3)) == 0
    assert poles_on_the_right(omega, *single(0.0, 0.0, 0.0, omega)) == 0  # free, and not held


def test_lines_that_do_not_tell_say_why():
    def said(omega, kd=20.0, k=1e3):
        return poles_on_the_right(omega, *single(1e3, kd, 0.0, omega, k=k))

    assert said(np.geomspace(0.1, 1e4, 500)) == 0
    # |L| at the end is .8 at 53.2 rad/s
    assert said(np.geomspace(0.1, 55.0, 500)) == 0
    assert "widen the band" in str(said(np.geomspace(0.1, 51.0, 500)))

    def apart(step):  # about a pole .2 1/s left of the axis: D turns by 2 atan(step / .4)
        omega = np.sqrt(2000 - 0.04) + step * (np.arange(-100, 3000) + 0.5)
        return said(omega[omega > 0.5], kd=0.4)

    assert apart(0.4) == 0  # 90 degrees
    assert "closer" in str(apart(0.6))  # 113 degrees

    def begun(first):  # a magnet's negative stiffness that is not overcome: a pole at +14.5 1/s
        omega = np.geomspace(first, 1e5, 6000)
        return poles_on_the_right(omega, *single(500.0, 20.0, 0.0, omega, k=-1e3))

    assert begun(8.0) == 1
    assert "lower" in str(begun(12.0))
    pole = np.array([1e3j, -1e3j])
    for omega, values in (([1e3], np.ones(1)), ([1e2, 1e3, 1e4], np.array([1.0, np.nan, 1.0]))):
        answer = poles_on_the_right(np.array(omega), values[:, None, None], pole)
        assert answer == "its lines are too few, or one is on a pole of the plant"


def test_a_loop_that_runs_away_has_no_sensitivity():
    """Its S on the lines is a number all the same, and small."""
    model = rid.load_model("rigid")
    a, b = model.nominal["L_a"], model.nominal["L_b"]
    sensors = [f"x - {a}*theta_y", f"y + {a}*theta_x", f"x + {b}*theta_y", f"y - {b}*theta_x"]
    laws = dict.fromkeys(model.inputs, (100.0, 2e5))

    def found(kp, kd, hertz):
        def control(omega):
            return -(kp + 1j * omega * kd)[:, None, None] * np.eye(4)

        return list(rid.loop_sensitivity(model, control, hertz, sensors=sensors, laws=laws).axes)

    hertz = np.arange(0.5, 2000.0, 1.0)
    assert [axis.zone for axis in found(8e3, 20.0, hertz)[:2]] == ["A", "A"]
    for kp, kd in ((8e3, -20.0), (500.0, 5.0)):
        for axis in found(kp, kd, hertz):
            assert np.isinf(axis.peak)
            assert axis.zone == "D"
            assert "not stable" in axis.verdict
            assert np.abs(axis.sensitivity).max() < 10
    (axis, *_) = found(8e3, 20.0, np.arange(0.5, 60.0, 1.0))
    assert axis.zone == "A or worse"
    assert "not told, the loop still acts at its end" in axis.verdict


@pytest.mark.parametrize(
    ("away", "angle"),
    [
        (1 + 1j, 0.25),
        (1.1e-9 - 1j, -0.5),
        (-0.9e-9 - 1j, -0.5),  # on the axis, to rounding
        (-1.1e-9 - 1j, 1.5),
        (-1 + 1j, 0.75),
    ],
)
def test_a_pole_on_the_right_has_gone_past_half_a_turn(away, angle):
    assert _from_above(np.array([7.0 * away]))[0] / np.pi == pytest.approx(angle, abs=1e-6)
