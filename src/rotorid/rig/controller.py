"""Sampled controllers: decentralized PID, or any discrete transfer function or state space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from rotorid.core.errors import InputError, require_positive
from rotorid.core.values import Complexes, Floats, frozen


@frozen
class Controller:
    """A discrete state space from positions (m) to commands (A or N).

    ``state[k+1] = A state[k] + B y[k]``, ``u[k] = C state[k] + D y[k]``: the sign of the feedback
    is in the matrices, so a controller that pulls back has a negative gain.
    """

    # shapes (state, state), (state, position), (command, state), (command, position)
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    period: float  # time in s between samples

    def __post_init__(self) -> None:
        D = np.atleast_2d(np.asarray(self.D, dtype=float))
        commands, positions = D.shape
        A = np.asarray(self.A, dtype=float)
        n = 0 if A.size == 0 else len(np.atleast_2d(A))
        shapes = {"A": (n, n), "B": (n, positions), "C": (commands, n), "D": D.shape}
        for name, shape in shapes.items():
            given = np.asarray(D if name == "D" else getattr(self, name), dtype=float)
            turned = given.ndim == 2 and n and given.shape != shape
            if given.size != shape[0] * shape[1] or turned:
                raise InputError(
                    f"{name} of shape {given.shape}", f"{shape}", "make A, B, C and D of one size"
                )
            if not np.isfinite(given).all():
                cure = "look for NaN and inf where A, B, C and D are computed"
                raise InputError("numbers that are not finite", "finite matrices", cure)
            object.__setattr__(self, name, given.reshape(shape))
        cure = "give the time between two steps of the controller"
        require_positive(self.period, "s", cure, found="a period of {}")

    @property
    def states(self) -> int:
        return len(self.A)

    @property
    def positions(self) -> int:
        return int(self.D.shape[1])

    @property
    def commands(self) -> int:
        return int(self.D.shape[0])

    def response(self, omega: ArrayLike) -> Complexes:
        """Return the transfer matrix at exp(i omega period), shape (line, command, position)."""
        z = np.exp(1j * np.asarray(omega, dtype=float) * self.period)[:, None, None]
        states = np.linalg.solve(z * np.eye(self.states) - self.A, self.B + 0j * z)
        return np.asarray(self.C @ states + self.D)

    def after(self, first: Controller) -> Controller:
        """Return the controller that reads what another one makes of the positions."""
        inner, outer = first.states, self.states
        return Controller(
            A=np.block([[first.A, np.zeros((inner, outer))], [self.B @ first.C, self.A]]),
            B=np.vstack([first.B, self.B @ first.D]),
            C=np.hstack([self.D @ first.C, self.C]),
            D=self.D @ first.D,
            period=self.period,
        )

    def on_each(self, axes: int) -> Controller:
        return side_by_side([self] * axes)


def side_by_side(controllers: Sequence[Controller]) -> Controller:
    for controller in controllers:
        if controller.period != controllers[0].period:
            found = f"periods {controller.period} s and {controllers[0].period} s"
            raise InputError(found, "one period", "discretize all at one rate")
    blocks = {name: linalg.block_diag(*(getattr(c, name) for c in controllers)) for name in "ABCD"}
    return Controller(**blocks, period=controllers[0].period)


def pid(
    proportional: float, integral: float, derivative: float, filter_frequency: float, period: float
) -> Controller:
    """Return a sampled PID of one axis, fed back negatively: ``u = -(P y + I int y dt + d)``.

    The integral by the forward rule; the derivative as first-order hold through a low-pass,
    ``d[k] = a d[k-1] + D (1 - a) (y[k] - y[k-1]) / T`` with a = exp(-2 pi f T).
    """
    cure = "give the corner of the filter of the derivative"
    require_positive(filter_frequency, "Hz", cure, place="filter_frequency")
    a = np.exp(-2 * np.pi * filter_frequency * period)
    slope = derivative * (1 - a) / period
    # States: the filtered derivative less slope * y; the integral of y, where it has a gain.
    states = slice(None) if integral else slice(1)
    return Controller(
        A=np.diag([a, 1.0])[states, states],
        B=np.array([[(a - 1) * slope], [period]])[states],
        C=np.array([[-1.0, -integral]])[:, states],
        D=np.array([[-(proportional + slope)]]),
        period=period,
    )
