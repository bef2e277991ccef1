"""Is the closed loop stable? The matrix that carries all states over one pattern of events."""

from __future__ import annotations

import numpy as np

from rotorid.record import Floats
from rotorid.rig.controller import Controller
from rotorid.rig.schedule import Schedule


def loop_matrix(
    schedule: Schedule,
    state: Floats,
    command: Floats,
    controller: Controller,
    reads: Floats,
) -> Floats:
    """Return the matrix that carries the loop over one pattern of events, without inputs.

    Its states are those of the rotor and the amplifiers, of the controller, and the commands that
    wait or are held, as the kernel keeps them.
    """
    rotor, memory, inputs = state.shape[1], controller.states, controller.commands
    slots = schedule.lag + 1  # commands that wait at the start of a pattern, the newest last
    size = rotor + memory + (slots + 1) * inputs
    identity = np.eye(size)
    x, m = identity[:rotor], identity[rotor : rotor + memory]
    rest = identity[rotor + memory :].reshape(slots + 1, inputs, size)
    held, waiting = rest[0], list(rest[1:])
    for e in range(len(schedule.offset)):
        if schedule.control[e] >= 0:
            y = reads @ x
            waiting.append(controller.C @ m + controller.D @ y)
            m = controller.A @ m + controller.B @ y
        if schedule.apply[e] >= 0:
            # Commands since the pattern began, and those from before it, counted from its start.
            held = waiting[slots + schedule.apply[e] - schedule.lag]
        x = state[e] @ x + command[e] @ held
    return np.vstack([x, m, held, *waiting[-slots:]])


def worst_mode(matrix: Floats) -> tuple[float, float, Floats]:
    """Return size and angle (rad) of the largest eigenvalue and the size of its motion."""
    values, vectors = np.linalg.eig(matrix)
    worst = int(np.argmax(np.abs(values)))
    return (
        float(np.abs(values[worst])),
        float(np.abs(np.angle(values[worst]))),
        np.abs(vectors[:, worst]),
    )
