"""How finely a shaft is divided."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from rotorid.errors import ModelError
from rotorid.models.rotor.drawing import SAME, Rotor
from rotorid.record import Floats

CONVERGED = 1e-3
"""Change of the first three bending frequencies, free, that twice the elements may bring."""
BENDING = 3
FINER = 1.25
"""How much shorter the elements are that are tried next."""


def divided(rotor: Rotor, elements: Sequence[int | None], limit: int) -> Rotor:
    """Return a rotor whose sections have the elements asked for, the others as many as needed.

    As many as make the first three bending frequencies of the free shaft, without what stands on
    it, converge: elements of about one length, shortened until
    twice as many change the frequencies by no more than `CONVERGED`.
    """
    size = max(section.length for section in rotor.sections)
    while True:
        counts = [
            given or max(1, int(np.ceil(section.length / size - SAME)))
            for section, given in zip(rotor.sections, elements, strict=True)
        ]
        if sum(counts) + len(rotor.places) > limit:
            raise ModelError(
                f"more than {limit} elements",
                "as many as the bending modes in the band of the records need",
                "leave elements out, or draw fewer sections",
                place="sections",
            )
        found = _meshed(rotor, counts)
        if None not in elements:
            return found
        # Twice as many of a section need not be: a place in its middle divides it already.
        mine, theirs = bending(found), bending(found, parts=2)
        if len(mine) == BENDING and (np.abs(mine - theirs) <= CONVERGED * theirs).all():
            return found
        size /= FINER


def _meshed(rotor: Rotor, elements: Sequence[int]) -> Rotor:
    """Return the rotor with so many elements in each section."""
    sections = zip(rotor.sections, elements, strict=True)
    return replace(rotor, sections=tuple(replace(s, elements=count) for s, count in sections))


def bending(rotor: Rotor, parts: int = 1) -> Floats:
    """Return the first bending frequencies of the shaft alone in one plane, free, in rad/s.

    Each of its elements is divided into so many parts.
    """
    nodes = parts * (len(rotor.nodes) - 1) + 1
    mass, stiffness = np.zeros((2 * nodes, 2 * nodes)), np.zeros((2 * nodes, 2 * nodes))
    for number, section, whole in rotor.spans():
        beam = section.beam(whole.length / parts)
        for node in range(parts * number, parts * (number + 1)):
            where = slice(2 * node, 2 * node + 4)
            stiffness[where, where] += beam.stiffness()
            mass[where, where] += section.heaviness * (beam.translation() + beam.rotation())
    scale = 1 / np.sqrt(np.diag(mass))
    scaled = [scale[:, None] * matrix * scale for matrix in (stiffness, mass)]
    squares = scipy.linalg.eigh(*scaled, eigvals_only=True)
    return np.asarray(np.sqrt(squares[2 : 2 + BENDING].clip(0)))
