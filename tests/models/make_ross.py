"""Write `ross.npz`: what ROSS makes of twenty random rotors. Run by hand where ROSS is installed.

python tests/models/make_ross.py tests/models/ross.npz
"""

import sys

import numpy as np
from rotor_files import random_rotor

from rotorid.models import parse_model
from rotorid.models.rotor.ross_rotor import lateral

ROTORS = 20


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
