"""What the unbalance of a machine makes it do: its response over the speed, with bands."""

from __future__ import annotations

import numpy as np

from rotorid.errors import InputError
from rotorid.estimate import Estimate
from rotorid.frozen import frozen
from rotorid.models import Model
from rotorid.record import Complexes, Floats
from rotorid.results.machine import Machine, machine_of
from rotorid.results.modes import finite_speed
from rotorid.values import ByContent

POINTS = 241
"""Speeds of a response curve."""


@frozen
class UnbalanceResponse(ByContent):
    """Motion on the rotation's line over the speed: ``q = Re(Q exp(i phi))``.

    Parameters
    ----------
    coordinates : sequence of str
    speed : array, shape (speed,)
        rad/s.
    motion : complex array, shape (speed, coordinate)
        NaN at an undamped critical speed.
    std : array, shape (speed, coordinate)
        Of the amplitude; NaN where nothing is known of the deviations.
    """

    coordinates: tuple[str, ...]
    speed: Floats
    motion: Complexes
    std: Floats


def unbalance_response(
    source: Estimate | Model, speeds: Floats | float | str, *, record: int = 0
) -> UnbalanceResponse:
    """Return the motion that the identified unbalance makes at some speeds, with deviations.

    ``Z(Omega) Q = g(Omega)`` without forces at the inputs, by the delta method.

    Parameters
    ----------
    source : Estimate or Model
    speeds : array, shape (speed,), or float or str
        rad/s; one speed with its unit as text.
    record : int
        Whose values are taken of what every record has to itself.

    Returns
    -------
    UnbalanceResponse

    Raises
    ------
    InputError
        For a machine whose equations hold no unbalance, and as `rid.modes`.

    Examples
    --------
    >>> import rotorid as rid
    >>> found = rid.unbalance_response(rid.load_model("jeffcott"), "3000 rpm")
    >>> f"{abs(found.motion[0, 0]) * 1e6:.1f} um"
    '21.8 um'
    """
    if isinstance(speeds, str):
        speeds = finite_speed(speeds)
    return response_of(machine_of(source, record), np.atleast_1d(np.asarray(speeds, dtype=float)))


def response_of(machine: Machine, speeds: Floats) -> UnbalanceResponse:
    """Return the response of a machine."""
    if not machine.linear.load_terms:
        raise InputError(
            f"the model {machine.model.name!r} without unbalance",
            "terms in cos(phi) and sin(phi)",
            "write the unbalance into its equations",
        )
    shape = (len(speeds), machine.linear.coordinates)
    motion = np.full(shape, np.nan, dtype=np.complex128)
    std = np.full(shape, np.nan)
    for k, speed in enumerate(speeds.tolist()):
        try:
            motion[k], slopes = machine.response(speed)
        except InputError:
            continue
        if machine.covariance is not None:
            std[k] = amplitude_std(motion[k], slopes @ machine.root)
    return UnbalanceResponse(machine.model.coordinates, speeds, motion, std)


def amplitude_std(value: Complexes, root: Complexes) -> Floats:
    """Return the deviation of |value|, which has a root of its covariance, (..., unknown).

    Where the value is small beside its deviations there is no direction: that of the vector then.
    """
    size = np.abs(value)
    whole = np.sqrt((np.abs(root) ** 2).sum(axis=-1))
    direction = np.where(size > 0, value / np.where(size > 0, size, 1.0), 1.0)
    along = np.linalg.norm((direction.conj()[..., None] * root).real, axis=-1)
    return np.asarray(np.where(size > whole, along, whole))
