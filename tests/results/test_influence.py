"""Balancing by influence coefficients: a model of which nothing but linearity is known."""

import numpy as np

import rotorid as rid

# One plane and two probes; what a probe reads per force is any complex number.
MODEL = """
title = "One plane, two probes"
equations = ["k*w = Omega^2*((u_x + t_x)*cos(phi) - (u_y + t_y)*sin(phi))"]
[coordinates]
w = "m"
[parameters]
k = { unit = "N/m", nominal = 1e6 }
u_x = { unit = "kg m" }
u_y = { unit = "kg m" }
t_x = { unit = "kg m" }
t_y = { unit = "kg m" }
a_1 = { unit = "1", nominal = 1 }
b_1 = { unit = "s", nominal = 0 }
a_2 = { unit = "1", nominal = 1 }
b_2 = { unit = "s", nominal = 0 }
"""


def experiment(folder, noise: float) -> rid.Experiment:
    influence = np.array([0.3 - 1.1j, -0.8 + 0.4j])
    unbalance = 40 - 25j
    normal = np.random.default_rng(2).normal(size=(2, 2, 2)) @ [1, 1j]
    runs = [influence * (unbalance + trial) + noise * normal[k] for k, trial in enumerate((0, 50))]
    rows = [
        ",".join([name, *(f"{part:.9g}" for z in x for part in (z.real, z.imag))])
        for name, x in zip(("bare", "trial"), runs, strict=True)
    ]
    text = "\n".join(["run,re1,im1,re2,im2", *rows])
    (folder / "runs.csv").write_text(text + "\n")
    (folder / "plane.toml").write_text(MODEL)
    record = """
[[records]]
kind = "phasors"
file = "runs.csv"
speed = "3000 rpm"
rows = {{ column = "run", is = "{}" }}
"""
    (folder / "runs.toml").write_text(
        f"""model = "plane.toml"
{record.format("bare")}{record.format("trial")}
[records.parameters]
t_x = {{ fixed = "50 g mm" }}
[channels]
s1 = {{ reads = "a_1*w + b_1*w'", real = "re1", imag = "im1", unit = "um", std = "0.1 um" }}
s2 = {{ reads = "a_2*w + b_2*w'", real = "re2", imag = "im2", unit = "um", std = "0.1 um" }}
[parameters]
k = {{ fixed = "1e6 N/m" }}
t_x = {{ fixed = "0 g mm" }}
t_y = {{ fixed = "0 g mm" }}
"""
    )
    return rid.load_experiment(folder / "runs.toml")


def test_influence_coefficients_balance_a_machine_of_which_nothing_is_known(tmp_path):
    """Nothing that is assumed would show here: no direction makes the answer doubtful."""
    found = experiment(tmp_path, 0.1).identify()
    assert (found.status, found.misfit.dof) == ("ok", 2)
    assert not [note for note in found.notes if note.about == "direction"]
    assert found.verdict != "doubtful"
    left = np.array([found.value("u_x") - 40e-6, found.value("u_y") + 25e-6])
    assert np.all(np.abs(left) < 3 * np.array([found.std("u_x"), found.std("u_y")]))
    (mounted,) = rid.balance(found, ["w"], "3000 rpm", radius="100 mm").corrections
    correction = mounted.unbalance_kg_m * np.exp(1j * mounted.angle_rad)
    assert abs(correction + (40 - 25j) * 1e-6) < 3 * mounted.std_kg_m
