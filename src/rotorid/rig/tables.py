"""Tables that a rig hands to its compiled loop: plain arrays and numbers."""

from __future__ import annotations

from typing import NamedTuple

from rotorid.record import Floats, Integers
from rotorid.rig.schedule import Schedule


class Events(NamedTuple):
    """The pattern of events, how often it is repeated, and how often before the record begins."""

    pattern: Schedule
    repeats: int
    settling: int


class Steps(NamedTuple):
    """Exact steps of a linear rig, as `plant.Transitions`; (event, state, ...)."""

    linear: bool
    state: Floats
    command: Floats
    noise: Floats
    load: Floats


class Bearings(NamedTuple):
    """Actuators, one entry per input.

    kind is 0 for F = ki i + ks x, 1 for two opposed magnets; law holds the constants. Commands
    are limited to +-limit; current beyond bias is a fault. lagging holds the inputs whose
    amplifier lags. pair is the other axis of the same auxiliary bearing, or -1.
    """

    kind: Integers
    law: Floats
    limit: Floats
    bias: Floats
    time_constant: Floats
    lagging: Integers
    slew: Floats
    displacement: Floats
    clearance: Floats
    pair: Integers


class Rotor(NamedTuple):
    """Accelerations as `plant.Plant`, and the rotation as `speed.Rotation`."""

    motion: Floats
    load: Floats
    harmonics: Integers
    force: Floats
    noise: Floats
    centre: float
    width: float
    rotation: Floats
    tolerance: float
    floor: Floats


class Loop(NamedTuple):
    """Controller, sensors and what is known of them beforehand.

    error_at_control and error_at_log hold noise, bias and runout of each sensor, drawn and
    computed beforehand; where both clocks tick, the logger sees what the controller saw.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    reads: Integers
    sensors: Floats
    quantum: Floats
    error_at_control: Floats
    error_at_log: Floats
    excitation: Floats
    process: Floats


class Log(NamedTuple):
    """What is recorded, one row per sample; filled by `run`."""

    state: Floats
    reading: Floats
    command: Floats
    current: Floats
    force: Floats
