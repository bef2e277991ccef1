"""`Rig`: a levitated rotor in closed loop, run as a machine is and recorded as a logger does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.limits import RIG_SAMPLES
from rotorid.core.values import Floats
from rotorid.core.watch import polled
from rotorid.force.laws import Differential
from rotorid.rig import kernel, kernel_tables
from rotorid.rig.lags import build_lags
from rotorid.rig.logger import Logged, RigRecord, logged, read
from rotorid.rig.plant import Plant
from rotorid.rig.rig_machine import RigMachine

# From the samples of the logger's columns, by name, to those that it changes.
Spoil = Callable[[dict[str, Floats], np.random.Generator], dict[str, Floats]]


class RigError(InputError):
    """A rig that cannot run on: what happened, when (s since it was switched on), on which axis."""

    def __init__(
        self,
        found: str,
        expected: str,
        cure: str,
        *,
        file: str = "",
        place: str = "",
        time: float | None = None,
        where: str = "",
    ) -> None:
        self.time, self.where = time, where
        super().__init__(found, expected, cure, file=file, place=place)

    def at(self, *, file: str = "", place: str = "") -> RigError:
        found = super().at(file=file, place=place)
        found.time, found.where = self.time, self.where
        return found


SETTLED = 60.0
"""s that a rig is given to settle, unless its record is longer: all of it takes time to run."""


@frozen
class Rig(RigMachine):
    """A machine that can be run; its parameters are those of `Machine`, and one more."""

    described: Rig | None = None
    spoils: tuple[Spoil, ...] = ()  # what happens to the logger's columns, one after the other

    def run(self, duration: float, rng: np.random.Generator) -> RigRecord:
        """Run the rig for so many seconds, record it, and read the record.

        A loop that is unstable, a rotor that touches its auxiliary bearing and a current beyond the
        bias are a `RigError`: what, when, and where.
        """
        return read(self.described or self, self.record(duration, rng))

    def record(self, duration: float, rng: np.random.Generator) -> Logged:
        """Run the rig and record it, as `run`, but leave the columns as they are."""
        whole = (duration + self.settling) * self.logger.sample_rate
        if not whole <= RIG_SAMPLES:
            raise InputError(
                f"{whole:.3g} samples, with the settling before them",
                f"at most {RIG_SAMPLES}",
                "run shorter, or sample more slowly",
                place="duration",
            )
        if self.settling > max(SETTLED, duration):
            raise InputError(
                f"{self.settling:g} s",
                f"at most {SETTLED:g} s, or as long as the record",
                "give it less: a bearing settles in a second or two",
                place="settling",
            )
        samples = round(duration * self.logger.sample_rate)
        if samples < 1:
            raise InputError(f"{duration} s", "one sample or more", "run longer", place="duration")
        plant = self.plant(duration)
        self._require_stable(plant, duration)
        events = kernel_tables.event_table(self, samples)
        log = kernel_tables.log_table(self, samples)
        lags = build_lags(self, plant, kernel_tables.sensor_matrix(self))
        tables = (
            events,
            kernel_tables.step_table(self, plant, lags),
            bearings := kernel_tables.bearing_table(self, plant),
            kernel_tables.rotor_table(self, plant),
            lags,
            kernel_tables.loop_table(self, events, samples, rng),
        )
        loads = kernel_tables.load_table(self, plant, events)
        room = kernel.room_of(*tables)
        with polled("simulating samples", lambda: int(np.count_nonzero(log.state[:, 0])), samples):
            code, axis, time, size = kernel.run(*tables, loads, room, log)
        if code != kernel.FINE:
            since = time + events.settling * events.pattern.duration
            raise self._fault(code, axis, since, size, float(bearings.clearance[axis]))
        found = logged(self, plant, log, rng)
        recorded = {column.name: column.samples for column in found.columns}
        for spoil, own in zip(self.spoils, rng.spawn(len(self.spoils)), strict=True):
            recorded |= spoil(recorded, own)
        return replace(
            found, columns=tuple(replace(c, samples=recorded[c.name]) for c in found.columns)
        )

    def _fault(self, code: int, axis: int, time: float, size: float, clearance: float) -> RigError:
        name = self.model.inputs[axis]
        when = f"{time:.6g} s after switching on"
        if code == kernel.TOUCH:
            found = f"the rotor touching the auxiliary bearing at {name}, {when}"
            expected = f"a displacement below the clearance of {clearance * 1e6:.4g} um"
            cure = "lower the excitation or the unbalance, or stiffen the controller"
        elif code == kernel.BEYOND_BIAS:
            law = self.actuators[name].law
            assert isinstance(law, Differential)
            found = f"a current of {size:.4g} A at {name}, {when}"
            expected = f"less than the bias of {law.most:.4g} A"
            cure = "raise the bias, lower the excitation, or limit the current"
        else:
            found = f"no step small enough, {when}"
            expected = f"motion that can be followed to {self.tolerance:g}"
            cure = "check the parameters, or allow a larger tolerance"
            name = ""
        return RigError(found, expected, cure, time=time, where=name)

    def _require_stable(self, plant: Plant, duration: float) -> None:
        """Refuse a loop that grows at any speed of the run."""
        for speed in dict.fromkeys(self.rotation.range_until(duration)):
            rate, frequency, axis = kernel_tables.growth(self, plant, speed)
            if rate >= 0:
                raise RigError(
                    f"an unstable loop at {speed:.6g} rad/s: from the first instant it grows by a "
                    f"factor of e every {1 / rate if rate > 0 else np.inf:.3g} s with "
                    f"{frequency:.4g} Hz, most of all at {axis}",
                    "a loop whose free motion decays",
                    "check the sign and the size of the gains against k_i and k_s, add damping, or "
                    "shorten the delay",
                    time=0.0,
                    where=axis,
                )
