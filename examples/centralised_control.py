"""A rotor under one controller of all axes: state feedback with an observer, by scipy.

    python examples/centralised_control.py

The shipped three-mass rig at 8400 rpm, its four PIDs replaced by a centralised controller, every
command of which depends on every position: gyroscopic moments couple the axes, and a quadratic
design uses it. The controller is no part of the identification, which takes currents and positions
as they come; the answer is as good as under the PIDs.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import expm, solve_discrete_are

import rotorid as rid
from rotorid import load_rig
from rotorid.force.reading import forces
from rotorid.rig.controller import Controller
from rotorid.rig.rig import Rig


def plant(rig: Rig, period: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B, C of rotor and bearings from one sample to the next, with one step of delay."""
    linear, speed = rig.model.require_linear(), rig.rotation.speed
    m = linear.matrices(rig.parameters, speed)
    laws = [rig.actuators[name].law.linearize() for name in rig.model.inputs]
    ki, ks = np.diag([law.ki for law in laws]), np.diag([law.ks for law in laws])
    n, inputs = len(m.M), len(laws)
    inertia = np.linalg.solve(m.M, np.hstack([-(m.K - m.B @ ks @ m.B.T), -(m.D + speed * m.G)]))
    rate = np.zeros((2 * n + inputs, 2 * n + inputs))
    rate[:n, n : 2 * n] = np.eye(n)
    rate[n : 2 * n, : 2 * n] = inertia
    rate[n : 2 * n, 2 * n :] = np.linalg.solve(m.M, m.B @ ki)
    step = expm(rate * period)[: 2 * n]
    # The command of one sample flows during the next.
    A = np.block([[step], [np.zeros((inputs, 2 * n + inputs))]])
    B = np.vstack([np.zeros((2 * n, inputs)), np.eye(inputs)])
    C = np.hstack([m.B.T, np.zeros((inputs, n + inputs))])
    return A, B, C


def centralised(rig: Rig) -> Controller:
    """Return the linear-quadratic controller: displacements dear, currents cheap, noise white."""
    period = rig.controller.period
    A, B, C = plant(rig, period)
    dear = C.T @ C / (20e-6) ** 2 + 1e-6 * np.eye(len(A))
    S = solve_discrete_are(A, B, dear, np.eye(B.shape[1]))
    gain = np.linalg.solve(np.eye(B.shape[1]) + B.T @ S @ B, B.T @ S @ A)
    shaken = np.zeros_like(A)
    shaken[: len(A) - B.shape[1], : len(A) - B.shape[1]] = 1e-8 * np.eye(len(A) - B.shape[1])
    shaken[-B.shape[1] :, -B.shape[1] :] = 1e-3 * np.eye(B.shape[1])
    P = solve_discrete_are(A.T, C.T, shaken, (2e-6) ** 2 * np.eye(len(C)))
    observer = np.linalg.solve(C @ P @ C.T + (2e-6) ** 2 * np.eye(len(C)), C @ P @ A.T).T
    return Controller(A - B @ gain - observer @ C, observer, -gain, np.zeros((4, 4)), period)


def main() -> None:
    """Run the rig under either controller and identify both records."""
    rig = load_rig("three-mass").rig
    model, truth = rig.model, rig.values
    whole = replace(rig, controller=centralised(rig))
    across = np.abs(whole.controller.response([880.0])[0])
    print(f"command of F_x1 by y3 over that by x1, at 140 Hz: {across[0, 3] / across[0, 0]:.2f}")
    for name, machine in (("four PIDs", rig), ("centralised", whole)):
        record = machine.run(13.0, np.random.default_rng(1))
        periods = rid.average(forces(record, drives=False), 20.0, harmonics=[1, 3, 5, 7, 9, 11])
        found = rid.identify(model, periods, rid.MaximumLikelihood())
        off = max(abs(p.value - truth[p.name]) / p.std for p in found.parameters)
        std = found.std("m1")
        print(f"{name}: {found.status}, largest error {off:.2f} deviations, m1 to {std:.4f} kg")


if __name__ == "__main__":
    main()
