"""nfoursid: N4SID of the mean period, its lines, with the unbalance as two more inputs.

Its states have no meaning, so that it answers with natural frequencies alone.
"""

import numpy as np
import pandas as pd
from common import Case, enter
from nfoursid.nfoursid import NFourSID

ORDER, BLOCK_ROWS = 16, 3


def solve(case: Case) -> dict:
    if len(case.coordinates) < 4:
        raise ValueError("finds no more states than three rows of the four readings hold")
    names = list(case.told["channels"])
    mean = case.periods.mean(axis=0)
    spectrum = np.fft.rfft(mean, axis=0)
    kept = np.isin(np.arange(len(spectrum)), case.told["harmonics"])
    clean = np.fft.irfft(spectrum * kept[:, None], len(mean), axis=0)
    frame = pd.DataFrame(np.tile(clean / clean.std(axis=0), (3, 1)), columns=names)
    angle = np.tile(case.speed * case.time, 3)
    frame["cos"], frame["sin"] = np.cos(angle), np.sin(angle)
    subspace = NFourSID(frame, names[4:], [*names[:4], "cos", "sin"], BLOCK_ROWS)
    subspace.subspace_identification()
    system, _ = subspace.system_identification(ORDER)
    poles = np.log(np.linalg.eigvals(system.a).astype(complex)) * case.told["sample_rate_hz"]
    return {"frequencies_hz": sorted(poles.imag[poles.imag > 0] / (2 * np.pi))}


if __name__ == "__main__":
    enter(solve)
