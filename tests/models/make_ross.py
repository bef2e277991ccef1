"""Write `ross.npz`: what ROSS makes of twenty random rotors. Run by hand where ROSS is installed.

python tests/models/make_ross.py tests/models/ross.npz
"""

import sys

import numpy as np
from rotor_files import random_rotor

from rotorid import parse_model

ROTORS = 20
LATERAL = (0, 1, 3, 4)
"""Where x, y, theta_x, theta_y stand among the six coordinates of a node of ROSS."""


def lateral(matrix):
    """Return what a matrix of ROSS says of x, y, theta_x and theta_y of its nodes."""
    where = [6 * node + k for node in range(len(matrix) // 6) for k in LATERAL]
    return matrix[np.ix_(where, where)]


def matrices(number):
    """Return M, K and G by ROSS of a random rotor."""
    model = parse_model(random_rotor(np.random.default_rng(number)))
    rotor = model.to_ross(model.nominal)
    speed = 100.0
    return [lateral(m) for m in (rotor.M(speed), rotor.K(speed), rotor.G(), rotor.C(speed))]


if __name__ == "__main__":
    found = {
        f"{name}{number}": matrix
        for number in range(ROTORS)
        for name, matrix in zip("MKGC", matrices(number), strict=True)
    }
    np.savez_compressed(sys.argv[1], **found)
