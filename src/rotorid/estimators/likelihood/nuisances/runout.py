"""Runout: what a position sensor reads of the shaft's own roundness, once per revolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from rotorid.estimators.likelihood.nuisances.base import Nuisances, Reading, Unknown
from rotorid.observation import Observation


class Runout(Reading):
    """``y = C q + cos * cos(phi) + sin * sin(phi)``, common to all records."""

    @classmethod
    def asked(cls, records: Sequence[Observation], wanted: Nuisances) -> list[Self]:
        """Return that of every position sensor, where it is asked for."""
        return cls.every(records) if wanted.runout else []

    @classmethod
    def every(cls, records: Sequence[Observation]) -> list[Self]:
        """Return that of every position sensor."""
        sensors = {s.channel.name: s for r in records for s in r.sensors if s.order == 0}
        return [
            cls(
                tuple(
                    Unknown(
                        f"runout[{name}].{part}",
                        sensor.channel.unit,
                        0.0,
                        nuisance=True,
                        additive=True,
                    )
                    for part in ("cos", "sin")
                ),
                name,
            )
            for name, sensor in sensors.items()
        ]
