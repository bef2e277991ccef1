"""Unknowns of the measurement: scalars with units, starts and priors, and what they do to records.

A kind is one function that returns the unknowns of some records: those that the settings and the
channels ask for, or, where nothing is said of what is wanted, all that there could be, without
priors. `KINDS` is their order in results. What no setting asks for is freed where the data reject
the model, to see what it explains. Names such as ``gain[x1]`` are for people; no code takes them
apart.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import KW_ONLY, replace
from inspect import cleandoc
from typing import Annotated, Literal, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import Field, Strict

from rotorid.core.errors import InputError, require_names
from rotorid.core.values import Complexes, Floats, frozen, grouped
from rotorid.data.observation import Observation, Records
from rotorid.data.record import Channel
from rotorid.force.channel_dynamics import UNKNOWN, Constant, Dynamics, FirstOrder
from rotorid.force.laws import KNEE, KNEE_CONSTANT, Law
from rotorid.likelihood.effects import Adds, Drives, Effect, Replaces, Rereads, Scales, Turns
from rotorid.models.expressions import symbol
from rotorid.models.knowledge import own_in_si


@frozen
class Scalar:
    name: str
    unit: str
    start: float  # SI
    # deviation with which `prior` is known beforehand; ``None``: not known; 0: fixed
    std: float | None = None
    prior: float = np.nan  # where nothing else is said, the start it was made with
    nuisance: bool = True  # no parameter of the model
    positive: bool = False
    # it shifts what it acts on, so that no power of a common scale belongs to it
    additive: bool = False
    # it scales inputs or equations, and is held loosely while errors are granted to them
    anchored: bool = False

    def __post_init__(self) -> None:
        if np.isnan(self.prior):
            object.__setattr__(self, "prior", self.start)

    @property
    def fixed(self) -> bool:
        return self.std == 0.0


@frozen(kw_only=True)
class Nuisances:
    """Which constants of the measurement are unknown.

    Its fields are those of `MaximumLikelihood` too, and, but for `each`, keys of the table
    ``[estimator]`` of an experiment file, which holds values to the types that stand here.

    Parameters
    ----------
    runout : bool
        Each position sensor reads an unknown 1x runout, common to all records.
    gains : sequence of {"ki", "ks", "ks*"}
        Constants of the force laws to estimate: the force per current of each input; the force
        per displacement, one for all inputs whose laws state the same (those of a bearing), or one
        per input.
    delays : sequence of str
        "force", "position": one unknown delay common to all channels of the kind; the name of a
        channel: one of its own.
    each : sequence of str
        Parameters that every record has to itself: ``u_x[0]``, ``u_x[1]``, names that may stand
        in `fixed`, `known` and `start` too.
    force_scale_std : float
        Relative deviation of a scale common to all forces, `scale[force]`; 0 takes it as exact.
    """

    runout: Annotated[bool, Strict()] = False
    gains: tuple[Literal["ki", "ks", "ks*"], ...] = ()
    delays: tuple[str, ...] = ()
    each: tuple[str, ...] = ()
    force_scale_std: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.0

    def __init_subclass__(cls) -> None:
        """Describe the fields in the estimator that has them."""
        super().__init_subclass__()
        told = cleandoc(Nuisances.__doc__ or "").partition("----------\n")[2]
        own, references, rest = cleandoc(cls.__doc__ or "").partition("\n\nReferences\n")
        cls.__doc__ = f"{own}\n{told}{references}{rest}"

    def __post_init__(self) -> None:
        for name, kind in get_type_hints(Nuisances).items():
            if get_origin(kind) is tuple:
                object.__setattr__(self, name, tuple(dict.fromkeys(getattr(self, name))))
                allowed = get_args(get_args(kind)[0])  # of a list of any names none
                given = getattr(self, name) if allowed else ()
                cure = "name one of these, or leave it out"
                require_names(given, allowed, cure=cure, place=name)
        if not 0 <= self.force_scale_std < 1:
            expected = "a share of the forces: 0.01 where they are known to 1 %"
            cure = "give a share below 1, or leave it out"
            raise InputError(f"{self.force_scale_std}", expected, cure, place="force_scale_std")
        if {"ks", "ks*"} <= set(self.gains):
            raise InputError("both ks and ks*", "one of them", "drop one", place="gains")


def _amplitude(values: Floats) -> float:
    if len(values) == 1:
        return float(values[0])
    return float(np.linalg.norm(values) / np.sqrt(max(1.0, len(values) / 2)))


@frozen
class Unknown:
    scalars: tuple[Scalar, ...]
    on: frozenset[str]  # names of the channels or parameters that it acts on
    effects: tuple[Effect, ...]
    name: str = ""  # that its scalars share, where they are several
    _: KW_ONLY
    record: int | None = None  # the only record that has it, if one
    # as what it is set free by itself where the data reject the model, if at all
    rival: Literal["", "term", "lag"] = ""
    alternative_to: str = ""  # the term that stands for the same: the first in the layout acts
    # what it is said to be, without its name; what is said of its size besides; what to do about it
    phrase: str = ""
    remark: Callable[[float], str] = lambda size: ""
    cure: str = "add the term to the model"
    # what takes it as stated, where it was asked for: no parameter of the file stands for it
    held: str = "state its value in the channel"
    size: Callable[[Floats], float] = _amplitude  # what is told of the values of its scalars
    # of a size and the inputs: another unknown that at first looks like this one, if one does
    instead: Callable[[float, Collection[str]], Unknown | None] = lambda size, inputs: None

    @property
    def term(self) -> str:
        return self.name or self.scalars[0].name

    @property
    def unit(self) -> str:
        return self.scalars[0].unit

    def said(self, size: float | None) -> str:
        remark = "" if size is None else self.remark(size)
        return f"{self.phrase or self.term}{amount(size, self.unit)}{remark}"


def amount(value: float | None, unit: str) -> str:
    """Return `` = value unit`` for people; nothing where no value is known."""
    return "" if value is None else f" = {value:.4g}{'' if unit == '1' else f' {unit}'}"


Kind = Callable[[Records, Nuisances | None], list[Unknown]]


def _inputs(records: Records) -> dict[str, Channel]:
    return {c.name: c for record in records for c in record.inputs}


def _sensors(records: Records) -> dict[str, Channel]:
    return {s.channel.name: s.channel for record in records for s in record.sensors}


def _channels(records: Records) -> list[Channel]:
    return list({**_inputs(records), **_sensors(records)}.values())


def _with_samples(records: Records) -> list[Observation]:
    return [record for record in records if record.lines.samples is not None]


# Factors of channels.

FACTORS = {
    "mil instead of um, um instead of mil, or inches instead of mm": 25.4,
    "mm instead of um, or mA instead of A": 1e3,
    "m instead of um, or uA instead of A": 1e6,
    "degrees instead of radians": 180 / np.pi,
    "rms instead of amplitude": np.sqrt(2),
    "peak to peak instead of amplitude": 2.0,
    "inches instead of m": 1 / 0.0254,
    "pounds-force instead of N": 1 / 4.4482216152605,
    "kilograms-force instead of N": 1 / 9.80665,
    "ten times": 10.0,
}
"""Factors by which a reading is off where a unit was mistaken; each may be its inverse."""
SNAP = 0.03  # a free factor this near that of a unit is taken for it: calibrations are off by less


def factor_name(gain: float) -> str:
    name, _ = _nearest(abs(gain)) or ("", 1.0)
    told = ", ".join(filter(None, (name, "upside down" if gain < 0 else "")))
    return f" ({told})" if told else ""


def snap(gain: float) -> float | None:
    """Return the sign and unit factor that a gain is close to, or None."""
    near = _nearest(abs(gain))
    return None if near is None else float(np.copysign(near[1], gain))


def _nearest(size: float) -> tuple[str, float] | None:
    factors = [("", 1.0), *((n, way) for n, f in FACTORS.items() for way in (f, 1 / f))]
    name, exact = min(factors, key=lambda known: abs(size / known[1] - 1))
    return (name, exact) if abs(size / exact - 1) < SNAP else None


def _scaled(on: frozenset[str], power: int) -> Scales:
    """Return quantity = reading * s^power."""
    return Scales(
        on,
        lambda values, omega: np.full(len(omega), values[0] ** power, dtype=np.complex128),
        lambda values, omega: np.full((len(omega), 1), power / (values[0] or 1e-300) + 0j),
    )


def gains(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return gains: reading = gain * quantity."""
    found = []
    for channel in _channels(records):
        if wanted is None or channel.gain_std > 0:
            name, std = f"gain[{channel.name}]", None if wanted is None else channel.gain_std
            scalar = Scalar(name, "1", 1.0, std, positive=True, anchored=True)
            on = frozenset([channel.name])
            found.append(Unknown((scalar,), on, (_scaled(on, -1),)))
    return found


def multiplier(name: str, channels: Iterable[str], start: float = 1.0) -> Unknown:
    """Return quantity = s * reading: linear in s, so that a search may pass through zero."""
    on = frozenset(channels)
    return Unknown(
        (Scalar(f"gain[{name}]", "1", start, additive=True),),
        on,
        (_scaled(on, 1),),
        remark=factor_name,
        cure="check the unit, the sign and the calibration of the channel",
        size=lambda values: float(1 / values[0]) if values[0] else np.nan,
    )


def delays(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return by what channels lag; the lines are corrected for the stated delay already."""
    return [
        _late(c.name, [c.name], c.delay, None if wanted is None else c.delay_std or None)
        for c in _channels(records)
        if wanted is None or c.delay_std > 0 or c.name in wanted.delays
    ]


def common_delays(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return one delay of all inputs, ``delay[force]``, or of all sensors, ``delay[position]``."""
    channels = {"force": _inputs(records), "position": _sensors(records)}
    if wanted is not None:
        known = (*channels, *(channel.name for channel in _channels(records)))
        cure = "name one of these, or leave it out"
        require_names(wanted.delays, known, cure=cure, place="delays")
        if "force" in wanted.delays:
            _require_forces(records, "an unknown delay of the forces", "delays")
    return [_late(k, on, 0.0) for k, on in channels.items() if wanted is None or k in wanted.delays]


def _acting(records: Records) -> set[str]:
    """Return the inputs that are not zero throughout, as those are that have no column."""
    return {
        channel.name
        for record in records
        for channel, column in zip(record.inputs, record.input_columns, strict=True)
        if record.lines.mean[:, column].any()
    }


def _require_forces(records: Records, what: str, place: str) -> None:
    if not _acting(records):
        expected = "a record with forces, or with currents that make them"
        cure = "name their columns in [channels], or leave it out"
        raise InputError(f"{what}, but no force in any record", expected, cure, place=place)


def _late(label: str, channels: Iterable[str], known: float, std: float | None = None) -> Unknown:
    on = frozenset(channels)
    scales = Scales(
        on,
        lambda values, omega: np.asarray(np.exp(1j * omega * (values[0] - known))),
        lambda values, omega: np.asarray(1j * omega[:, None]),
    )

    def instead(size: float, inputs: Collection[str]) -> Unknown | None:
        """Return a bandwidth, where the channels lag and do not lead: at first they look alike."""
        actuator, name = on <= {*inputs}, next(iter(on))
        late = size < 0 if actuator else size > 0 and not on & {*inputs}
        if len(on) > 1:
            name = "force" if actuator else "position"
        if not late:
            return None
        flat = FirstOrder(bandwidth=Constant("bandwidth", "Hz", FLAT), actuator=actuator)
        start = 1 / (2 * np.pi * abs(size))
        scalar = Scalar(f"bandwidth[{name}]", "Hz", start, positive=True)
        common = f', shared = "{name}"' * (len(on) > 1)
        cure = f'dynamics = {{ bandwidth = {{ start = "{start:.3g} Hz" }}{common} }}'
        cure = f"declare it: {cure} of the channels"
        return _response((scalar,), on, flat, cure)

    scalar = Scalar(f"delay[{label}]", "s", known, std, additive=True)
    cure = f'give delay or hold of the channels, or have it estimated: delays = ["{label}"]'
    held = "leave it out of delays"
    return Unknown((scalar,), on, (scales,), rival="term", cure=cure, held=held, instead=instead)


def dynamics(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return constants of dynamics; lines are corrected with the given ones."""
    groups: dict[str, tuple[Dynamics, list[str]]] = {}
    for channel in _channels(records):
        given = channel.dynamics
        if given is not None and any(c.std for c in given.constants):
            groups.setdefault(given.shared or channel.name, (given, []))[1].append(channel.name)
    found = []
    for label, (given, names) in groups.items():
        scalars = tuple(
            Scalar(
                f"{constant.name}[{label}]",
                constant.unit,
                constant.value,
                None if wanted is None or constant.std == UNKNOWN else constant.std,
                positive=True,
            )
            for constant in given.constants
        )
        found.append(_response(scalars, frozenset(names), given))
    return found


FLAT = 1e15  # bandwidth in Hz of what has none: of light


def _response(
    scalars: tuple[Scalar, ...],
    on: frozenset[str],
    given: Dynamics,
    cure: str = "check the channel, or declare it unknown",
) -> Unknown:
    def factor(values: Floats, omega: Floats) -> Complexes:
        """H over the H that the lines are corrected for, or one over it for a sensor."""
        ratio = given.response(omega, values) / given.response(omega, given.values)
        return np.asarray(ratio if given.actuator else 1 / ratio)

    def slopes(values: Floats, omega: Floats) -> Complexes:
        found = given.slopes(omega, values)
        return np.asarray(found if given.actuator else -found)

    return Unknown(scalars, on, (Scales(on, factor, slopes),), rival="lag", cure=cure)


# How channels bend: they read too much by ``unknown * shape(samples)``.


def bends(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return ``reading = quantity (1 + unknown * quantity^2)`` of sensors, as of opposed ones.

    And inputs that lag by half the width of a loop, whichever way they go.
    """
    held, found = _with_samples(records) if wanted is None else [], list[Unknown]()
    units = {s.channel.name: s.channel.unit for r in held for s in r.direct}
    for unit, names in grouped((unit, name) for name, unit in units.items()).items():
        for on in [*([name] for name in names), *([names] if len(names) > 1 else [])]:
            term = f"nonlinear {on[0]}" + (f" ... {on[-1]}" if len(on) > 1 else "")
            found.append(_bend(term, f"1/{unit}^2" if unit else "1", on, lambda x: x**3))
    units = {name: c.unit for name, c in _inputs(held).items()}
    found += [_bend(f"hysteresis {name}", unit, [name], _loop) for name, unit in units.items()]
    if len(units) > 1:
        found.append(_bend("hysteresis force", next(iter(units.values())), list(units), _loop))
    return found


def _loop(samples: Floats) -> Floats:
    return np.asarray(np.sign(np.roll(samples, -1) - np.roll(samples, 1)))


def _bend(term: str, unit: str, names: Sequence[str], shape: Callable[[Floats], Floats]) -> Unknown:
    scalars = (Scalar(term, unit, 0.0, additive=True),)
    effects = tuple(Adds(name, shape=shape) for name in names)
    cure = "calibrate what bends over its range, or excite less"
    return Unknown(scalars, frozenset(names), effects, rival="term", cure=cure)


# Constants of forces. They are no factors of a line: the record's samples go through the law again.


def drives(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return ki, the force per current of an input, or per unit of its channel, and ks.

    That is the force per displacement, one for the inputs whose laws state the same (``ks``) or one
    per input (``ks*``).
    """
    inputs = _inputs(records)
    asked = {"ki", "ks", "ks*"} if wanted is None else {*wanted.gains}
    if wanted is not None and asked:
        _require_forces(records, f"an unknown {' and '.join(wanted.gains)}", "gains")
    driven = {n: c.drive for n, c in inputs.items() if c.drive is not None}
    if asked & {"ks", "ks*"} and not driven and wanted is not None:
        told = "an unknown ks, but forces instead of currents"
        cure = "give law, current, position and ki of each"
        raise InputError(told, "channels with a linear force law", cure, place="gains")
    found = []
    acting = _acting(records)
    for name in [n for n in inputs if n in driven or n in acting] if "ki" in asked else ():
        unit, ki = ("N/A", driven[name].ki) if name in driven else ("1", 1.0)
        found.append(_driving("ki", f"ki[{name}]", unit, ki, [name]))
    alike = grouped((drive.ks, name) for name, drive in driven.items())
    for ks, names in alike.items():
        together = "ks" if len(alike) == 1 else f"ks[{', '.join(names)}]"
        if "ks" in asked:
            found.append(_driving("ks", together, "N/m", ks, names))
        if "ks*" in asked and not ("ks" in asked and len(names) == 1 < len(alike)):
            other = together if len(names) > 1 else ""
            found += [_driving("ks*", f"ks[{n}]", "N/m", ks, [n], other) for n in names]
    return found


def force_scale(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return one factor of all forces, currents' and displacements' share alike."""
    std = None if wanted is None else wanted.force_scale_std
    scalar = Scalar("scale[force]", "1", 1.0, std, positive=True, anchored=True)
    on = frozenset(_inputs(records))
    return [] if std == 0 else [Unknown((scalar,), on, (Drives(on, "force"),))]


def _driving(
    asked: str, name: str, unit: str, start: float, inputs: Iterable[str], other: str = ""
) -> Unknown:
    on, scalar = frozenset(inputs), Scalar(name, unit, start, anchored=True)
    effects = (Drives(on, "ki" if asked == "ki" else "ks"),)
    cure = f'check ks of the force laws, or have it estimated: gains = ["{asked}"]'
    held = f'leave "{asked}" out of gains'
    found = Unknown((scalar,), on, effects, alternative_to=other, cure=cure, held=held)
    # A factor of the channel says the same as ki.
    return found if asked == "ki" else replace(found, rival="term")


def law_constants(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return constants of the force laws, each of one or more inputs, all changed by as much."""
    laws = _bent(records)
    every = [(i, name, of) for i, law in laws.items() for name, of in law.constants.items()]
    groups = grouped(((name, of.shared or i), i) for i, name, of in every if of.std)
    common = grouped(((name, ""), i) for i, name, _ in every)
    found = []
    for (name, label), on in (groups | (common if wanted is None else {})).items():
        first, *others = dict.fromkeys(laws[each].constants[name] for each in on)
        if label and others:
            values = sorted((of.value, of.std) for of in (first, *others))
            listed = ", ".join(f"{value:g} +- {std:g}" for value, std in values)
            told = f"{name} of {label} as {listed}"
            expected = "one value and deviation of a constant that is shared"
            cure = "write the same in every channel, or drop shared"
            raise InputError(told, expected, cure, place=f"channels.{on[0]}.{name}")
        mean = float(np.mean([laws[each].constants[name].value for each in on]))
        if label or np.isfinite(mean):
            scalar = Scalar(
                f"{name}[{label}]" if label else name,
                first.unit,
                mean,
                None if wanted is None or np.isinf(first.std) else first.std,
                positive=first.positive,
                additive=not first.positive,
                anchored=True,
            )
            found.append(_reread(scalar, on, name))
    return found


def _reread(scalar: Scalar, inputs: Iterable[str], constant: str) -> Unknown:
    """Return an unknown at whose start the forces are as they were read."""
    on, key = frozenset(inputs), "saturation" if constant == KNEE_CONSTANT else constant
    effects, said = (Rereads(on, constant, scalar.start),), f"{scalar.name} of the force laws"
    start = f'"{scalar.start:.4g} {scalar.unit}"'
    cure = f"give its value, or have it estimated: {key} = {{ start = {start} }} of the channels"
    return Unknown((scalar,), on, effects, rival="term", phrase=said, cure=cure)


def knees(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return how near the iron of all inputs is to its saturation, from not at all: (b_0 / b_s)^4.

    Of the inputs whose law knows a bias, and no saturation; files say the saturation itself.
    """
    biased = [
        name
        for name, law in _bent(records).items()
        if (known := law.constants).keys() >= {"bias", "saturation"}
        and np.isinf(known["saturation"].value)
    ]
    if wanted is not None or not biased:
        return []

    def saturation(values: Floats) -> float:
        """Return b_s / b_0, the flux of the iron's knee over that of the bias."""
        return float(values[0] ** (-1 / KNEE)) if values[0] > 0 else np.inf

    unknown = _reread(Scalar("saturation", "1", 0.0, additive=True), biased, KNEE_CONSTANT)
    return [replace(unknown, size=saturation)]


def _bent(records: Records) -> dict[str, Law]:
    """Return the laws that bend, by the inputs of records with samples that they made."""
    inputs = _inputs(_with_samples(records))
    return {name: channel.law for name, channel in inputs.items() if channel.law is not None}


# What turns with the rotor.

NEAR = 0.02  # share by which the speed of another record may differ that tells a phase's start
HELD = 0.1  # share of the rotation's largest power from which on a line holds it, no excitation
LEAKS = 0.1
"""Amplitude that cos(n phi) leaves on the lines that are used, from which on these hold the n-th
order: one half on a line of it, a third between two lines. What leaks elsewhere is 1e-3 at most,
and a runout of metres would explain any misfit there."""


def phase(number: int, std: float | None = None, start: float = 0.0) -> Unknown:
    """Return that phi = recorded angle + phase, of one record."""
    return Unknown(
        (Scalar(f"phase[{number}]", "rad", start, std, additive=True),),
        frozenset(),
        (Turns(),),
        record=number,
        held="name the column of the mark (keyphasor, angle)",
        size=lambda values: float(np.angle(np.exp(1j * values[0]))),
    )


def phases(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    """Return rotor angles that are known up to a constant only."""
    if wanted is None:
        return [phase(number) for number in range(len(records))]
    found = []
    for number, record in enumerate(records):
        if not record.lines.phase_known:
            found.append(phase(number, start=_phase_start(record, records)))
        elif record.lines.phase_std > 0 and (wanted.runout or _turns(record)):
            found.append(phase(number, record.lines.phase_std))
    return found


def later_phases(records: Records, starts: Sequence[float]) -> list[tuple[int, Unknown]]:
    """Return phases of records that turn, at each start; the first counts the unbalance's angle."""
    turning = [k for k, r in enumerate(records) if _speed(r) != 0 and _turns(r)]
    known = [k for k in turning[1:] if records[k].lines.phase_known]
    return [(k, phase(k, start=start)) for k in known for start in starts]


def _phase_start(record: Observation, records: Records) -> float:
    """Return by what the rotation stands turned against a record that knows its phase.

    From the other side of the circle no minimum is found. At another speed the unbalance is
    answered otherwise, and nothing is taken from it.
    """
    speed = _speed(record)
    for other in records:
        near = abs(_speed(other) - speed) <= NEAR * abs(speed)
        names = [s.channel.name for s in record.sensors]
        if other.lines.phase_known and near and [s.channel.name for s in other.sensors] == names:
            here, there = _wave(record), _wave(other)
            size = np.hypot(np.abs(here), np.abs(there))
            return float(np.angle(np.vdot(there, here / np.where(size > 0, size, 1.0) ** 2)))
    return 0.0


def _speed(record: Observation) -> float:
    return float(np.mean(record.lines.speed))


def _wave(record: Observation) -> Complexes:
    """Return the phasors of the rotation in the sensors, (sensor,); 0 where no line holds it."""
    turn = record.lines.clock.lines(lambda t, phi, speed: np.cos(phi)[..., None])[:, 0]
    power = np.abs(turn) ** 2
    held = np.where(power > HELD * power.max(initial=0.0), turn, 0.0)
    total = float((np.abs(held) ** 2).sum())
    lines = record.lines.mean[:, [s.column for s in record.sensors]]
    return np.asarray(held.conj() @ lines / total if total > 0 else np.zeros(lines.shape[1]) + 0j)


def _turns(record: Observation) -> bool:
    linear = record.model.require_linear()
    return any(symbol("phi") in term.signal.free_symbols for term in linear.load_terms)


def runouts(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    return harmonic_runouts(records, [1]) if wanted is None or wanted.runout else []


def harmonic_runouts(records: Records, orders: Sequence[int] = (2, 3)) -> list[Unknown]:
    """Return ``cos * cos(n phi) + sin * sin(n phi)`` in each, of higher orders if lines hold it."""
    there = [n for n in orders if n == 1 or any(_holds(record, n) for record in records)]
    channels = {s.channel.name: s.channel for r in records for s in r.sensors if s.order == 0}
    return [_runout(name, channel.unit, n) for name, channel in channels.items() for n in there]


def _runout(channel: str, unit: str, order: int) -> Unknown:
    term = f"runout[{channel}{'' if order == 1 else f', order {order}'}]"
    cure = "have it estimated: runout = true"
    if order > 1:
        cure = "true the track of that sensor, or leave lines of that order out of the harmonics"
    parts = [Scalar(f"{term}.{part}", unit, 0.0, additive=True) for part in ("cos", "sin")]
    on, effects = frozenset([channel]), (Adds(channel, order),)
    held = "leave runout out of [estimator]"
    return Unknown(tuple(parts), on, effects, term, rival="term", cure=cure, held=held)


def _holds(record: Observation, order: int) -> bool:
    """Whether a line of a record is a multiple of its rotation, and not what leaks there."""
    wave = record.lines.clock.lines(lambda t, phi, speed: np.cos(order * phi)[..., None])
    return bool(np.abs(wave).max(initial=0.0) > LEAKS)


# Parameters that are not the same in all records: a trial mass, an unbalance that was changed.


def own_parameters(records: Records, wanted: Nuisances | None) -> list[Unknown]:
    if wanted is None or not records:
        return []
    given, found = [own_in_si(record) for record in records], []
    for index, parameter in enumerate(records[0].model.parameters):
        name, unit, positive = parameter.name, parameter.unit, parameter.positive
        told = [k for k, own in enumerate(given) if name in own or name in wanted.each]
        effects, held = (Replaces(index, len(told) == len(records)),), "in [records.parameters]"
        for k in told:
            value, std = given[k].get(name, (np.nan, None))
            scalar = Scalar(f"{name}[{k}]", unit, value, std, nuisance=False, positive=positive)
            found.append(Unknown((scalar,), frozenset([name]), effects, record=k, held=held))
    return found


OF_FORCES: tuple[Kind, ...] = (drives, force_scale, law_constants, knees)
OF_CHANNELS: tuple[Kind, ...] = (bends, runouts, gains, common_delays, delays, dynamics)
# Own parameters are of the model: they stand before what is unknown of the measurement.
KINDS = (own_parameters, *OF_FORCES, *OF_CHANNELS, phases)


def unknowns_of(records: Records, wanted: Nuisances | None = None) -> tuple[Unknown, ...]:
    """Return those that settings and channels ask for, or, without `wanted`, all that could be."""
    return tuple(unknown for kind in KINDS for unknown in kind(records, wanted))


@frozen
class Plausible:
    """By how much something is wrong that is taken as exact, and what to say of it."""

    kind: Kind
    about: str
    unit: str  # of the scalars meant
    size: float  # SI
    written: str  # the size as one would write it
    cure: str
    taken: str = "exact"  # how it is taken, and what its size is of
    error: str = "error"
    in_scale: bool = False  # one of all forces, or of all sensors, is the scale, told by itself


_SAY, _ANGLE = "say how well it is known", "unbalance angles refer to the stated rotor angle"
_DELAY = f'{_SAY}: delay = {{ std = "10 us" }} in the channel'
_RUNOUT = "runout = true estimates it"
TAKEN_AS_EXACT = (
    # Runout of a ground journal; balancing standards allow the probes several times it.
    Plausible(runouts, "runout", "m", 1e-6, "1 um", _RUNOUT, "zero", "it"),
    # A mark is glued on, and a filter of 9 kHz turns 9000 rpm by as much.
    Plausible(phases, "rotor angle", "rad", np.pi / 180, "1 deg", _ANGLE),
    # What calibrating by hand reaches.
    Plausible(
        gains, "gain", "1", 0.01, "1 %", f"{_SAY}: gain_std = 0.01 in the channel", in_scale=True
    ),
    # A tenth of the sample time of many loggers, and the lag of a filter of 16 kHz.
    Plausible(delays, "delay", "s", 1e-5, "10 us", _DELAY),
)
"""Kinds that are taken as exact where nobody asks for them, in the order in which they are told."""
