"""The levitated rig and the modes of its rotor against ROSS (ross-rotordynamics 2.3.0).

    make bench

makes an environment of its own for ROSS, runs a comparable rotor there and the shipped three-mass
rig here.

ROSS's rotor: the three masses as discs on a massless elastic shaft of two elements, magnetic
bearings with PID at both ends, 10 kHz; its nodes have 6 degrees of freedom each, so 18 in place
of 8. For the modes it hangs on springs of 1 mN/m. `run_time_response` goes by Newmark's method,
which is its closed loop with magnetic bearings, and open loop on springs and dampers by its default
method. Its controller runs at the steps of the integration, without hold, delay, noise, or limits.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROSS = Path(__file__).parents[1] / "build" / "bench" / "env" / "ross" / "bin" / "python"
SPEED = 880.0  # rad/s
BENDING = 8.8357e5 * 0.3**3 / 3  # E I of a shaft as stiff as k1 at its tip
DURATION, SHORT, RATE = 13.0, 1.0, 10_000


def in_ross() -> None:
    """Run inside ROSS's environment; prints JSON."""
    import contextlib
    import io

    import numpy as np
    import ross as rs

    steel = rs.Material(name="light", rho=1e-3, E=211e9, G_s=81.2e9)
    across = (64 * BENDING / 211e9 / np.pi) ** 0.25
    shaft = [
        rs.ShaftElement(0.3, 0.0, across, material=steel, n=n, shear_effects=False) for n in (0, 1)
    ]
    discs = [
        rs.DiskElement(n=0, m=0.83339, Id=1e-7, Ip=1e-7),
        rs.DiskElement(n=1, m=11.322, Id=2.5425e-2, Ip=4.8275e-2),
        rs.DiskElement(n=2, m=0.83339, Id=1e-7, Ip=1e-7),
    ]
    magnetic = [
        rs.MagneticBearingElement(
            n=n, g0=4e-4, i0=2.0, ag=4e-4, nw=140, kp_pid=2.4e4, ki_pid=1e4, kd_pid=8.0, n_f=12e3,
            sensors_axis_rotation=0.0,
        )
        for n in (0, 2)
    ]  # fmt: skip
    springs = [rs.BearingElement(n=n, kxx=2e5, cxx=800.0) for n in (0, 2)]
    t = np.arange(round(SHORT * RATE)) / RATE
    found = {}
    for name, bearings, method in (
        ("closed loop, Newmark", magnetic, "newmark"),
        ("open loop on springs, default", springs, "default"),
    ):
        rotor = rs.Rotor(shaft, discs, bearings)
        force = np.zeros((len(t), rotor.ndof))
        for dof in (0, 1, 12, 13):
            force[:, dof] = sum(14.0 * np.cos(2 * np.pi * 20 * k * t) for k in (1, 3, 5, 7, 9, 11))
        rotor_run = lambda n: rotor.run_time_response(SPEED, force[:n], t[:n], method=method)  # noqa: E731, B023
        with contextlib.redirect_stdout(io.StringIO()):
            rotor_run(50)
            start = time.process_time()
            response = rotor_run(len(t))
            took = time.process_time() - start
        largest = float(np.abs(response.yout[:, [0, 1, 12, 13]]).max())
        found[name] = {"seconds": took, "dof": rotor.ndof, "largest": largest}
    rotor = rs.Rotor(shaft, discs, [rs.BearingElement(n=n, kxx=1e-3, cxx=0.0) for n in (0, 2)])
    hertz = rotor.run_modal(SPEED).wn / (2 * np.pi)
    start = time.process_time()
    rotor.run_modal(SPEED + 1.0)  # at another speed: it remembers the answer
    took = time.process_time() - start
    modes = {"seconds": took, "hertz": sorted(h for h in hertz if 1.0 < h < 1e3)}
    print(json.dumps({"runs": found, "modes": modes}))


def main() -> None:
    import numpy as np

    from rotorid import load_model, load_rig, modes

    rig = load_rig("three-mass").rig
    rig.run(0.01, np.random.default_rng(0))
    start = time.process_time()
    rig.run(DURATION, np.random.default_rng(0))
    ours = time.process_time() - start
    print(f"rotorid, {DURATION:g} s closed loop with noise, 8 degrees of freedom: {ours:.2f} s")
    clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    run = subprocess.run(
        [ROSS, __file__, "--in-ross"], check=True, capture_output=True, text=True, env=clean
    )
    model, theirs = load_model("three-mass"), json.loads(run.stdout.splitlines()[-1])
    modes(model, SPEED + 1.0)
    start = time.process_time()
    found = modes(model, SPEED).modes
    took = time.process_time() - start
    off = max(
        abs(m.frequency_hz / h - 1) for m, h in zip(found, theirs["modes"]["hertz"], strict=True)
    )
    print(
        f"modes: rotorid {1e3 * took:.1f} ms, ROSS {1e3 * theirs['modes']['seconds']:.1f} ms; "
        f"{len(found)} frequencies differ by {off:.1e} at most"
    )
    for name, result in theirs["runs"].items():
        whole = result["seconds"] * DURATION / SHORT
        print(
            f"ROSS, {name}, {result['dof']} degrees of freedom: {result['seconds']:.2f} s for "
            f"{SHORT:g} s, so {whole:.0f} s for {DURATION:g} s ({whole / ours:.0f} times ours); "
            f"largest displacement {1e6 * result['largest']:.0f} um"
        )


if __name__ == "__main__":
    in_ross() if "--in-ross" in sys.argv else main()
