"""Constants of force laws as they stand in files."""

import numpy as np
import pytest

from rotorid.force.entry import LawEntry

MAGNET = {"law": "differential", "K": "5e-6 N m^2/A^2", "bias": "2 A", "gap": "0.4 mm"}


def test_exact_known_and_unknown_constants() -> None:
    entry = LawEntry(
        **{
            **MAGNET,
            "bias": {"value": "2 A", "std": "50 mA", "shared": "supply"},
            "gap": {"start": "0.4 mm"},
        }
    )
    law = entry.build()
    assert (law.bias, law.std["bias"]) == (2.0, 0.05)
    assert (law.gap, law.std["gap"]) == (4e-4, np.inf)
    assert "constant" not in law.std
    assert set(entry.uncertain) == {"bias", "gap"}
    assert law.shared == {"bias": "supply"}


def test_an_area_is_a_constant_of_either_law() -> None:
    area = {"value": "4 cm^2", "std": "0.1 cm^2", "shared": "poles"}
    horseshoe = LawEntry(law="differential", area=area, turns=200, bias="2 A", gap="0.4 mm")
    law = horseshoe.build()
    assert law.shared == {"constant": "poles"}
    assert law.std["constant"] == pytest.approx(0.025 * law.constant)
    assert LawEntry(law="flux", area=area).build().shared == {"area": "poles"}


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({**MAGNET, "gap": {"value": "1 mm"}}, r"the keys value; expected value and std, or start"),
        ({**MAGNET, "gap": {"start": "1 mm", "shared": 3}}, r"the keys shared, start"),
        ({"law": "linear", "ki": {"start": "1 N/A"}}, r'ki: found .*gains = \["ki"\]'),
        (
            {"law": "linear", "ki": {"value": "1 N/A", "std": "0.1 N/A", "shared": "a"}},
            r"an unknown or shared ki",
        ),
    ],
)
def test_refuses(entry: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        LawEntry(**entry).build()
