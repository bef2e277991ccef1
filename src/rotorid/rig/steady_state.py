"""The periodic answer of a linear model to forces and unbalance, line by line."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.errors import InputError, require_names
from rotorid.core.units import quantity
from rotorid.core.values import Complexes, Floats
from rotorid.data.record import Channel, Record
from rotorid.models import LinearForm, Model
from rotorid.signals.spectrum import line_spectra, synthesize


def steady_state(
    model: Model,
    values: ArrayLike,
    forces: ArrayLike,
    *,
    sample_rate: float | str,
    speed: float | str = 0.0,
    phase: float | str = 0.0,
) -> Floats:
    """Return one period of the coordinates in steady state, to machine precision.

    ``Z(omega_k) q_k = B u_k + g_k`` is solved on every line of the period; no time is stepped, so
    nothing has to settle and nothing leaks.

    Parameters
    ----------
    model : Model
        Linear in its coordinates.
    values : array, shape (parameter,)
        SI.
    forces : array, shape (sample, input)
        One period of the inputs in N or N m, band-limited below the Nyquist frequency.
    sample_rate : float or str
        Hz.
    speed : float or str
        rad/s; a whole number of revolutions fits the period.
    phase : float or str
        Rotor angle in rad at the first sample.

    Returns
    -------
    array, shape (sample, coordinate)

    Raises
    ------
    InputError
        Where the rotation or a load does not fit the period or the sample rate, where a line
        meets an undamped resonance, and for shapes that do not fit the model.
    ModelError
        Where the model is not linear.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> model = load_model("jeffcott")
    >>> values = model.values(model.nominal)
    >>> forces = np.full((8, 2), 1000.0)
    >>> steady_state(model, values, forces, sample_rate=800.0)[0]  # k x = F
    array([0.001, 0.001])
    """
    linear = model.require_linear()
    values, forces = np.asarray(values, dtype=float), np.asarray(forces, dtype=float)
    sample_rate, speed, phase = _in_si(sample_rate, speed, phase)
    _check_numbers(model, values, forces, sample_rate)
    samples = len(forces)
    turns = speed * samples / sample_rate / (2 * np.pi)
    if abs(turns - round(turns)) > 1e-9 * max(1.0, abs(turns)):
        cure = "choose speed and fundamental so that one divides the other"
        raise InputError(f"{turns:.6g} revolutions in a period", "a whole number", cure)
    mu = model.monomial_values(values)
    every = np.arange(samples // 2 + 1)
    driven = line_spectra(forces @ linear.input_matrix(mu).T, every)
    load = _load_lines(linear, mu, samples, sample_rate, speed, phase)
    right = driven + load
    size = np.abs(driven).max() + np.abs(load).max()
    if samples % 2 == 0 and np.abs(right[-1]).max() > 1e-12 * size:
        expected = "forces band-limited below it"
        cure = "leave that line out or sample faster"
        raise InputError(f"a force at {sample_rate / 2:g} Hz, half the sample rate", expected, cure)
    excited = np.flatnonzero(np.abs(right).max(axis=1) > 1e-14 * size)
    omega = 2 * np.pi * excited * sample_rate / samples
    lines = linear.response(omega, values, speed, right[excited])
    return synthesize(lines, excited, samples)


def _in_si(
    sample_rate: float | str, speed: float | str, phase: float | str
) -> tuple[float, float, float]:
    return (
        quantity(sample_rate, "Hz", place="sample_rate"),
        quantity(speed, "rad/s", place="speed"),
        quantity(phase, "rad", place="phase"),
    )


def _check_numbers(model: Model, values: Floats, forces: Floats, sample_rate: float) -> None:
    parameters, inputs = len(model.parameters), len(model.inputs)
    if values.shape != (parameters,):
        raise InputError(
            f"values of shape {values.shape}", f"({parameters},)", "give one value per parameter"
        )
    if forces.ndim != 2 or forces.shape[1] != inputs or len(forces) < 2:
        expected = f"(sample, {inputs}), 2 samples or more"
        raise InputError(f"forces of shape {forces.shape}", expected, "give one column per input")
    if not (np.isfinite(values).all() and np.isfinite(forces).all() and 0 < sample_rate < np.inf):
        cure = "look for NaN and inf in what is passed, and give a positive rate in Hz"
        raise InputError("values, forces or rate not finite", "finite numbers", cure)


def _load_lines(
    linear: LinearForm, mu: Floats, samples: int, sample_rate: float, speed: float, phase: float
) -> Complexes:
    """Return the lines of g, (line, row), none of it left beside them.

    Two periods at twice the sample rate show what does not repeat and what is too fast.
    """
    time = np.arange(4 * samples) / (2 * sample_rate)
    load = linear.load_columns(time, speed * time + phase, speed) @ mu
    lines = line_spectra(load, np.arange(2 * samples + 1))
    kept = np.arange(0, samples + 1, 2)
    beside = np.delete(np.abs(lines), kept, axis=0)
    if beside.max() > 1e-9 * np.abs(lines).max():
        where = np.delete(np.arange(2 * samples + 1), kept)[beside.max(axis=1).argmax()]
        found = f"a load of the model at {where * sample_rate / (2 * samples):g} Hz"
        expected = f"lines of the period, below half the sample rate, {sample_rate / 2:g} Hz"
        raise InputError(found, expected, "choose a period that holds it, or sample faster")
    return lines[kept]


def simulate(
    model: Model,
    values: ArrayLike,
    forces: ArrayLike,
    *,
    sample_rate: float | str,
    periods: int,
    speed: float | str = 0.0,
    phase: float | str = 0.0,
    noise: Mapping[str, float | str] | None = None,
    rng: np.random.Generator | None = None,
) -> Record:
    """Return a record of a model in steady state, with white noise on its channels.

    Parameters
    ----------
    model, values, forces, sample_rate
        As for `steady_state`.
    periods : int
    speed, phase : float or str
        As for `steady_state`.
    noise : mapping of channel name to float or str, optional
        Standard deviation per sample, SI or texts with units; channels left out have none.
    rng : numpy.random.Generator, optional
        Needed where there is noise.

    Returns
    -------
    Record
        Channels: the inputs, then the coordinates.

    Raises
    ------
    InputError
        As `steady_state`; and for noise without `rng`, or on channels that do not exist.

    Examples
    --------
    >>> from rotorid.models import load_model
    >>> model = load_model("jeffcott")
    >>> force = np.zeros((100, 2))
    >>> force[:, 0] = np.cos(2 * np.pi * np.arange(100) / 100)
    >>> record = simulate(model, model.values(model.nominal), force, sample_rate=1e3, periods=3)
    >>> record.names, len(record.samples)
    (('F_x', 'F_y', 'x', 'y'), 300)
    """
    if periods < 1:
        raise InputError(f"{periods} periods", "1 or more", "ask for one period at least")
    sample_rate, speed, phase = _in_si(sample_rate, speed, phase)
    position = steady_state(
        model, values, forces, sample_rate=sample_rate, speed=speed, phase=phase
    )
    names = (*model.inputs, *model.coordinates)
    require_names(noise or {}, names, "noise of {}")
    told = {n: quantity(v, model.units[n], place=n) for n, v in (noise or {}).items()}
    if wrong := [value for value in told.values() if not 0 <= value < np.inf]:
        cure = "give a finite number, 0 or more, for each channel"
        raise InputError(f"noise of {wrong[0]}", "a standard deviation", cure)
    deviation = np.array([told.get(name, 0.0) for name in names])
    samples = np.tile(np.column_stack([np.asarray(forces, dtype=float), position]), (periods, 1))
    if deviation.any():
        if rng is None:
            raise InputError("noise without rng", "a numpy Generator", "pass rng")
        samples = samples + rng.standard_normal(samples.shape) * deviation
    angle = np.asarray(speed * np.arange(len(samples)) / sample_rate + phase, dtype=np.float64)
    channels = tuple(Channel(name, model.units[name]) for name in names)
    return Record(channels, samples, sample_rate, speed, angle, source="simulation")
