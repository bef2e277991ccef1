"""`Rig`: a levitated rotor in closed loop, run as a machine is and recorded as a logger does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rotorid.core.errors import InputError
from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.core.watch import polled
from rotorid.force.laws import Differential
from rotorid.rig import kernel
from rotorid.rig.logger import Logged, RigRecord, logged, read
from rotorid.rig.machine import RigMachine
from rotorid.rig.plant import Plant
from rotorid.rig.tables import growth, kernel_tables, load_table, log_table

RIG_SAMPLES = 5_000_000
"""Of a record that a rig makes, with the settling before it: eight minutes at 10 kHz, a third of
a kilobyte each for the columns and the truth beside them."""

# From the samples of the logger's columns, by name, to those that it changes.
Spoil = Callable[[dict[str, Floats], np.random.Generator], dict[str, Floats]]


class RigError(InputError):
    """A rig that cannot run on: what happened, when (s since it was switched on), on which axis."""

    time: float | None = None
    where: str = ""

    def of(self, time: float, where: str) -> RigError:
        self.time, self.where = time, where
        return self

    def at(self, *, file: str = "", place: str = "") -> RigError:
        return super().at(file=file, place=place).of(self.time or 0.0, self.where)


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
        log = log_table(self, samples)
        made = kernel_tables(self, plant, samples, rng)
        events, bearings = made[0], made[2]
        loads, room = load_table(self, plant, events), kernel.room_of(*made)
        with polled("simulating samples", lambda: int(np.count_nonzero(log.state[:, 0])), samples):
            code, axis, time, size = kernel.run(*made, loads, room, log)
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
        return RigError(found, expected, cure).of(time, name)

    def _require_stable(self, plant: Plant, duration: float) -> None:
        """Refuse a loop that grows at any speed of the run."""
        for speed in dict.fromkeys(self.rotation.range_until(duration)):
            rate, frequency, axis = growth(self, plant, speed)
            if rate >= 0:
                raise RigError(
                    f"an unstable loop at {speed:.6g} rad/s: from the first instant it grows by a "
                    f"factor of e every {1 / rate if rate > 0 else np.inf:.3g} s with "
                    f"{frequency:.4g} Hz, most of all at {axis}",
                    "a loop whose free motion decays",
                    "check the sign and the size of the gains against k_i and k_s, add damping, or "
                    "shorten the delay",
                ).of(0.0, axis)
