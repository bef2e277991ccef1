"""For those who test models and estimators: records straight from their lines, over many seeds.

Besides, `phasor_lines` makes lines of a table of phasors, and `parse_rig` a rig of its text. `bind`
and `bind_all` say what the channels of lines are to a model, as estimators see them. `open_table`
shows the columns that a reader finds in a file; a `Source` says which column is a channel; `forces`
turns the currents of a record into forces, by their laws.

White noise on samples is white noise on every line of every period: independent, circular, of
variance s^2 / samples. Drawing it there, on the kept lines only, gives records that no test could
tell from sampled ones, a hundred times faster.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from rotorid.core.errors import require_names
from rotorid.core.values import Floats
from rotorid.data.observation import bind as bind
from rotorid.data.observation import bind_all as bind_all
from rotorid.data.record import Channel, PeriodicRecord
from rotorid.data.table_lines import phasor_lines as phasor_lines
from rotorid.force.reading import forces as forces
from rotorid.io import Source as Source
from rotorid.io import open_table as open_table
from rotorid.likelihood.bound import Plan
from rotorid.models import Model
from rotorid.rig.file import parse_rig as parse_rig
from rotorid.signals.spectrum import line_spectra, synthesize


def line_record(
    model: Model,
    values: ArrayLike,
    forces: ArrayLike,
    *,
    harmonics: Sequence[int],
    fundamental: float,
    sample_rate: float,
    periods: int,
    speed: float = 0.0,
    phase: float = 0.0,
    sensors: Sequence[Channel | str] | None = None,
) -> PeriodicRecord:
    r"""Return the noise-free record of a linear model in steady state, lines only.

    The motion on each line solves ``(K - omega^2 M + 1j omega (D + Omega G)) q = B F + load``.

    Parameters
    ----------
    model : Model
        With equations that are linear in the motion.
    values : array_like, shape (parameter,)
        In SI, in the order of ``model.parameter_names``.
    forces : array_like of complex, shape (line, input)
        In the unit of each input, as `rotorid.average` has them: an amplitude A is a line of A/2.
    harmonics : sequence of int
        Numbers of the lines, multiples of the fundamental.
    fundamental, sample_rate : float
        In Hz.
    periods : int
    speed : float
        In rad/s.
    phase : float
        Angle of the rotor at the first sample in rad.
    sensors : sequence of Channel or str, optional
        What is measured besides the inputs; every coordinate without it.

    Returns
    -------
    PeriodicRecord

    Raises
    ------
    InputError
        For forces of another shape, and sensors of what is no coordinate.

    Examples
    --------
    >>> import numpy as np, rotorid as rid
    >>> from rotorid.testing import add_noise, line_record
    >>> model = rid.load_model("jeffcott")
    >>> truth = {"m": 2.0, "c": 60.0, "k": 4e5, "xi": 0.0, "zeta": 0.0}
    >>> forces = np.exp(2j * np.pi * np.random.default_rng(1).uniform(size=(5, 2)))
    >>> record = line_record(
    ...     model,
    ...     [truth[name] for name in model.parameter_names],
    ...     forces,
    ...     harmonics=[3, 7, 11, 15, 19],
    ...     fundamental=5.0,
    ...     sample_rate=1000.0,
    ...     periods=40,
    ...     speed=2 * np.pi * 35.0,
    ... )
    >>> deviation = {"F_x": 0.01, "F_y": 0.01, "x": 1e-8, "y": 1e-8}
    >>> noisy = add_noise(record, deviation, np.random.default_rng(2))
    >>> estimate = rid.identify(model, noisy, rid.MaximumLikelihood())
    >>> estimate.status, round(estimate.value("m"), 2)
    ('ok', 2.0)
    """
    plan = Plan(forces, harmonics, fundamental, sample_rate, periods, {}, speed, sensors)
    planned, inputs = plan.record(model), len(model.inputs)
    for channel in planned.channels[inputs:]:
        cure = "write the combination in these coordinates"
        require_names(channel.combination, model.coordinates, "a sensor of {}", cure)
    lines, samples, force = planned.harmonics, planned.samples, planned.spectra[0, :, :inputs]
    time = np.arange(periods * samples).reshape(periods, samples) / sample_rate
    linear, mu = model.require_linear(), model.monomial_values(np.asarray(values, dtype=float))
    omega = 2 * np.pi * lines * sample_rate / samples
    load = linear.load_columns(time[0], speed * time[0] + phase, speed) @ mu
    right = force @ linear.input_matrix(mu).T + line_spectra(load, lines)
    motion = linear.response(omega, np.asarray(values, dtype=float), speed, right)
    read = (channel.combination for channel in planned.channels[inputs:])
    reads = np.array([[each.get(q, 0.0) for q in model.coordinates] for each in read])
    mean = np.concatenate([force, motion @ reads.T], axis=1)
    return replace(
        planned,
        spectra=np.repeat(mean[None], periods, axis=0),
        mean=synthesize(mean, lines, samples),
        time=time,
        angle=speed * time + phase,
        source="simulation",
    )


def add_noise(
    record: PeriodicRecord, deviation: Mapping[str, float], rng: np.random.Generator
) -> PeriodicRecord:
    """Return a record with white noise on its channels.

    Parameters
    ----------
    record : PeriodicRecord
    deviation : mapping of str to float
        Standard deviation of a sample by the name of a channel, in its unit; 0 for others.
    rng : numpy.random.Generator

    Returns
    -------
    PeriodicRecord
    """
    std = np.array([deviation.get(name, 0.0) for name in record.names])
    drawn: Floats = rng.standard_normal((*record.spectra.shape, 2))
    real = record.multiplicity == 1.0  # DC and the Nyquist line
    parts = np.where(real[:, None, None], np.array([1.0, 0.0]), np.sqrt(0.5))
    noise = (drawn * parts).view(np.complex128)[..., 0] * (std / np.sqrt(record.samples))
    return replace(record, spectra=record.spectra + noise, variance=record.variance + std**2)
