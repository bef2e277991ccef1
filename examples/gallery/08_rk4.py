"""
A public balancing table: Bently RK-4
=====================================

A rotor kit with two discs turned with known masses in its holes at two speeds, and a keyphasor and
four probes were read (github.com/M-Nouioua/rk4-rotor-unbalance-estimation, data CC BY 4.0 at
doi.org/10.5281/zenodo.23152815). Published there for 85 known unbalances: influence coefficients
err by 6.46 g mm and 22.9 degrees in the mean, a learned model by 6.25 g mm and 6.1 degrees. Here
rotorid identifies the kit from its drawing and *three* conditions, and tells the unbalance of four
others. Their readings are not ours to pass on: seven conditions of that repository's
``analysis/features.csv`` lie as ``rk4/phasors.csv`` in the folder that ``ROTORID_DATA`` names, or
this page shows the drawing and the figures of an earlier run only.
"""

import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import rotorid as rid
from rotorid.report.records import drawing

table = Path(os.environ.get("ROTORID_DATA", "no-data")) / "rk4" / "phasors.csv"
print("the data are", "here" if table.is_file() else "not here: only the drawing is shown")

# %%
# The drawing: shaft and discs as published, the discs at the quarter points. What it does not
# show is a parameter: the stiffness of the bearings with its main directions, damping, *where the
# probes are*, and the direction of hole 0, seen from the mark.

here = Path(__file__).parent if "__file__" in globals() else Path.cwd()  # as a page is built
rotor_file = here.parent / "rk4" / "rotor.toml"
print("\n".join(drawing(rid.load_model(rotor_file).rotor)))

# %%
# Those who measured have subtracted the reading of the balanced rotor. Readings repeated at once
# scatter by .0015 mil, but what was subtracted differs from one change of masses to the next by far
# more: 6 g mm (A002) move probe b less than 3 g mm (A001) do. So the readings of a condition are
# averaged, and 0.02 mil are stated, with which the misfit of the machine below is that of noise.
# Prior knowledge is vague (bearings, probes), the damping that published.

UNBALANCE = {  # g mm: disc 1 (x, y), disc 2 (x, y)
    "A012": (0, 0, 24, 0),
    "C001": (8.485281, 8.485281, 0, 0),
    "B048": (0, -30, 0, 30),
    "A001": (3, 0, 0, 0),
    "A002": (6, 0, 0, 0),
    "A013": (0, 0, 30, 0),
    "B041": (-12, 0, 12, 0),
}
LEARNED = ("A012", "C001", "B048")  # a mass on either disc, and a couple
OTHERS = tuple(name for name in UNBALANCE if name not in LEARNED)
OWN = ("x_1", "y_1", "x_2", "y_2")
PROBES = {"x_a": "plane1_x", "y_a": "plane1_y", "x_b": "plane2_x", "y_b": "plane2_y"}
KNOWN = """
[parameters]
kx = { value = "4e5 N/m", std = "2e5 N/m" }
ky = { value = "4e5 N/m", std = "2e5 N/m" }
kxy = { value = "0 N/m", std = "1e5 N/m" }
c = { value = "14 1/s", std = "5 1/s" }
z_a = { value = "60 mm", std = "30 mm" }
z_b = { value = "480 mm", std = "30 mm" }

[[constraints]]                             # of length one: the unit of the readings is mil
expression = "p^2 + q^2"
value = "1"
std = "0.05"
"""
folder = Path(tempfile.mkdtemp())


def averaged(source):
    """Write the means of the readings of each condition and speed; return them."""
    rows = np.genfromtxt(source, delimiter=",", names=True, dtype=None, encoding="utf-8")
    columns, found = rows.dtype.names[1:], {}
    for row in rows:
        key = row["condition_id"], round(float(row["rpm"]), -2)
        found.setdefault(key, []).append([row[name] for name in columns])
    means = {key: np.mean(each, axis=0) for key, each in found.items()}
    lines = [",".join([key[0], *map(str, mean)]) for key, mean in means.items()]
    (folder / "means.csv").write_text("\n".join([",".join(rows.dtype.names), *lines]))
    return means


def experiment(conditions, masses, known):
    """Return the experiment of some conditions, with the masses that a record states."""
    text = f'model = "{rotor_file.as_posix()}"\n[channels]\n'
    for name, column in PROBES.items():
        parts = f'real = "{column}_resp_re", imag = "{column}_resp_im", unit = "mil"'
        text += f'{name} = {{ {parts}, std = "0.02 mil", lag = true }}\n'
    for condition in conditions:
        text += '[[records]]\nkind = "phasors"\nfile = "means.csv"\n'
        text += 'speed = { column = "rpm", unit = "rpm" }\n'
        text += f'rows = {{ column = "condition_id", is = "{condition}" }}\n[records.parameters]\n'
        stated = zip(OWN, masses.get(condition, ()), strict=False)
        text += "".join(f'{name} = {{ fixed = "{value} g mm" }}\n' for name, value in stated)
    path = folder / "experiment.toml"
    path.write_text(text + known)
    return rid.load_experiment(path)


# %%
# The machine from three conditions. Where the probes are comes out with its deviation.

if table.is_file():
    means = averaged(table)
    machine = experiment(LEARNED, UNBALANCE, KNOWN).identify()
    told = [v for v in machine.parameters if not v.fixed]
    print(machine.verdict, machine.misfit)
    print("\n".join(f"{v.name:4} {v.value:10.4g} +- {v.std:.2g} {v.unit}" for v in told))

# %%
# The unbalance of the four others: each a record of its own, the machine known with its
# deviations. Beside it influence coefficients from the same three conditions, by least squares over
# probes and speeds.


def influence(condition):
    """Return what influence coefficients of LEARNED say of a condition: two discs, g mm."""
    rows, right = [], []
    for (name, speed), mean in means.items():
        beside = [key for key in means if key[1] == speed and key[0] in LEARNED]
        if name != condition:
            continue
        trial = np.array([UNBALANCE[key[0]] for key in beside]) @ TO_DISCS
        readings = np.array([means[key][1::2] + 1j * means[key][2::2] for key in beside])
        rows.append(np.linalg.lstsq(trial, readings, rcond=None)[0].T)
        right.append(mean[1::2] + 1j * mean[2::2])
    return np.linalg.lstsq(np.vstack(rows), np.concatenate(right), rcond=None)[0]


def errors(found):
    """Return the mean error of the amount in g mm, and of the angle in degrees where mass is."""
    true = {name: np.array(UNBALANCE[name]) @ TO_DISCS for name in found}
    amount = [abs(abs(found[name]) - abs(true[name])) for name in found]
    angle = [
        abs(np.degrees(np.angle(u / t)))
        for name in found
        for u, t in zip(found[name], true[name], strict=True)
        if t
    ]
    return np.mean(amount), np.mean(angle)


TO_DISCS = np.array([[1, 0], [1j, 0], [0, 1], [0, 1j]])
if table.is_file():
    known = "[parameters]\n" + "".join(
        f'{v.name} = {{ value = "{v.value!r} {v.unit}", std = "{v.std!r} {v.unit}" }}\n'
        for v in told
    )
    mine, theirs, spread = {}, {}, {}
    for name in OTHERS:
        found = experiment([name], {}, known).identify()
        mine[name] = 1e6 * np.array([found.value(each) for each in OWN]) @ TO_DISCS
        spread[name] = 1e6 * np.array([found.std(each) for each in OWN])
        theirs[name] = influence(name)
        shown = " ".join(f"{u.real:6.1f} {u.imag:6.1f}" for u in mine[name])
        print(f"{name}, {found.verdict}: {shown} +- {spread[name].round(1)}; {UNBALANCE[name]}")
    print("rotorid: {:.2f} g mm, {:.1f} degrees".format(*errors(mine)))
    print("influence coefficients: {:.2f} g mm, {:.1f} degrees".format(*errors(theirs)))

# %%
# On 26 November 2026 ``ROTORID_DATA=.. python examples/gallery/08_rk4.py`` came to this:
#
# ====================== =========== ============ ===================== ================
# mean error             amount      angle        angle without B041    angle of B041
# ====================== =========== ============ ===================== ================
# rotorid                3.32 g mm   75.8 degrees 26 degrees            151 degrees
# influence coefficients 6.73 g mm   54.6 degrees 23 degrees            102 degrees
# ====================== =========== ============ ===================== ================
#
# With A012 and C001 alone, which was tried first, it is 5.3 against 6.8 g mm, over the five others.
# (The published figures are of 85 other conditions.) The amount counts both discs, the angle those
# with a mass: of 3 g mm (A001) none can be told. Fourteen of the sixteen numbers told lie within
# one deviation. The other two, x of both discs in B041, are off by four: of that couple of 12 g mm
# the opposite is told. Its x probe of plane 1 reads .06 mil where the y probe reads .01, which no
# unbalance explains. The deviations hold as far as what was subtracted scatters by .02 mil, and
# for that record it does not.

# %%
# One label wrong: what was mounted in C001 and in B048 is exchanged. The first suspect names it.

if table.is_file():
    exchanged = UNBALANCE | {"C001": UNBALANCE["B048"], "B048": UNBALANCE["C001"]}
    wrong = experiment((*LEARNED, "A013"), exchanged, KNOWN).identify()
    print(wrong.verdict, *(each for each in wrong.warnings if "first suspect" in each), sep="\n")

# %%
# Each disc of the others: what was mounted, what rotorid tells with its deviation, and what
# influence coefficients tell.

if table.is_file():
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.4), layout="constrained", sharey=True)
    for disc, axis in enumerate(axes):
        for number, name in enumerate(OTHERS):
            true, colour = (np.array(UNBALANCE[name]) @ TO_DISCS)[disc], f"C{number}"
            axis.plot(true.real, true.imag, "o", mfc="none", ms=11, color=colour)
            u, (width, height) = mine[name][disc], spread[name][2 * disc : 2 * disc + 2]
            axis.errorbar(u.real, u.imag, height, width, "o", color=colour, label=name)
            axis.plot(theirs[name][disc].real, theirs[name][disc].imag, "x", color=colour)
        axis.set_xlabel(f"disc {disc + 1}: x in g mm")
        axis.set_aspect("equal")
    axes[0].set_ylabel("y in g mm")
    axes[1].legend(title="ring mounted, dot told,\ncross influence coefficients")
    plt.show()
