"""The shipped rig with opposed magnets in place of the linear law, as text."""

from rotorid import load_rig


def with_magnets(k: str = "5e-6", bias: str = "1.5 A", gap: str = "0.5 mm", more: str = "") -> str:
    head, rest = load_rig("three-mass").text.split("[actuators.all]")
    law = f'law = "differential"\nK = "{k} N m^2/A^2"\nbias = "{bias}"\ngap = "{gap}"\n{more}\n'
    return f"{head}[actuators.all]\n{law}[sensors]{rest.split('[sensors]')[1]}"
