"""Rotor files for tests."""


def random_rotor(rng):
    """Return a stepped rotor of several materials, with discs and supports."""
    count = int(rng.integers(2, 6))
    sections, z, at = [], 0.0, [0.0]
    for _ in range(count):
        length, outer = rng.uniform(0.02, 0.2), rng.uniform(0.008, 0.06)
        inner = outer * rng.uniform(0.1, 0.8) if rng.random() < 0.5 else 0.0
        z += length
        at.append(z)
        material = rng.choice(["one", "two", "three"])
        sections.append(
            f'{{ length = "{length!r} m", outer = "{outer!r} m", inner = "{inner!r} m", '
            f'material = "{material}", elements = {int(rng.integers(1, 3))} }}'
        )
    lines = ["sections = [" + ", ".join(sections) + "]", "[materials]"]
    for name in ("one", "two", "three"):
        E, ratio = rng.uniform(60e9, 220e9), rng.uniform(2.4, 2.8)
        density = rng.uniform(2500, 8000)
        lines.append(
            f'{name} = {{ E = "{E!r} Pa", G = "{E / ratio!r} Pa", density = "{density!r} kg/m^3" }}'
        )
    lines.append("[discs]")
    for k in range(int(rng.integers(1, 4))):
        place = at[int(rng.integers(0, len(at)))]
        mass, turn = rng.uniform(0.1, 5), rng.uniform(1e-4, 1e-2)
        lines.append(
            f'd{k} = {{ at = "{place!r} m", mass = "{mass!r} kg", I_t = "{turn!r} kg m^2", '
            f'I_p = "{1.7 * turn!r} kg m^2" }}'
        )
    lines.append("[supports]")
    for k, place in enumerate((at[0], at[-1])):
        values = rng.uniform(1e5, 1e7, 4), rng.uniform(10, 1000, 4)
        text = [
            f'{kind}{axes} = "{value!r} {unit}"'
            for kind, unit, row in zip("kc", ("N/m", "N s/m"), values, strict=True)
            for axes, value in zip(("xx", "xy", "yx", "yy"), row, strict=True)
        ]
        lines.append(f'b{k} = {{ at = "{place!r} m", {", ".join(text)} }}')
    return "\n".join(lines).replace("np.float64(", "").replace(")", "")


def uniform(*, outer="20 mm", length="1 m", elements=8, more=""):
    """Return a uniform steel shaft."""
    return f"""
sections = [
  {{ length = "{length}", outer = "{outer}", material = "steel", elements = {elements} }},
]
[materials]
steel = {{ E = "210 GPa", G = "80 GPa", density = "7850 kg/m^3" }}
{more}
"""


CORED = """
title = "two cores shrunk onto a shaft with a wheel"
sections = [
  { length = "60 mm", outer = "25 mm", material = "steel", elements = 1 },
  { length = "120 mm", outer = "60 mm", material = "core", stiffness = "s_A", elements = 2 },
  { length = "180 mm", outer = "25 mm", material = "steel", elements = 3 },
  { length = "120 mm", outer = "50 mm", material = "core", stiffness = "s_B", elements = 2 },
  { length = "70 mm", outer = "25 mm", material = "steel", elements = 1 },
]
[materials]
steel = { E = "210 GPa", G = "81 GPa", density = "7850 kg/m^3" }
core = { E = "20 GPa", G = "7.7 GPa", density = "7700 kg/m^3" }
[discs]
wheel = { at = "550 mm", mass = "m_w", I_t = "1.5e-3 kg m^2", I_p = "2.8e-3 kg m^2" }
[supports]
left = { at = "0 mm", k = "k_s" }
right = { at = "480 mm", k = "k_s" }
[parameters]
s_A = { unit = "1", nominal = 1.0, positive = true }
s_B = { unit = "1", nominal = 1.0, positive = true }
m_w = { unit = "kg", nominal = 1.2, positive = true }
k_s = { unit = "N/m", nominal = 1.0e6, positive = true }
"""
