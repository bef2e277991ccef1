"""What is known with a deviation: rows of the residual beside those of the lines."""

from __future__ import annotations

from dataclasses import field, replace

import numpy as np

from rotorid.core.frozen import frozen
from rotorid.core.values import Floats
from rotorid.likelihood.layout import Layout
from rotorid.likelihood.modal import ModalRows, modal_rows
from rotorid.likelihood.relations import Relations


@frozen
class Known:
    """What is known with a deviation, rows beside the lines: relations, then measured modes."""

    relations: Relations
    modes: ModalRows = field(default_factory=ModalRows)

    def __len__(self) -> int:
        return len(self.relations) + len(self.modes)

    @property
    def texts(self) -> tuple[str, ...]:
        """What each row is, for messages."""
        return self.relations.texts + self.modes.texts

    def values(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        """Return the residuals, of deviation one, shape (row,)."""
        found = self.relations.values(unknowns)
        if not len(self.modes):
            return found
        return np.concatenate([found, self.modes.values(unknowns, relaxation)])

    def jacobian(self, unknowns: Floats, relaxation: float = 0.0) -> Floats:
        """Return their derivative, shape (row, unknown)."""
        found = self.relations.jacobian(unknowns)
        if not len(self.modes):
            return found
        return np.concatenate([found, self.modes.jacobian(unknowns, relaxation)])

    def linear_in(self) -> list[int]:
        """Return the unknowns on which no relation depends but linearly, each by itself."""
        return self.relations.linear_in()

    def joined(self, other: Relations) -> Known:
        """Return these rows with further relations."""
        return replace(self, relations=self.relations.joined(other))

    def without(self, text: str) -> Known:
        """Return the rows but those of one text."""
        kept = np.array(
            [i for i, t in enumerate(self.relations.texts) if t != text], dtype=np.int64
        )
        return Known(self.relations.subset(kept), self.modes.without(text))

    def within(self, layout: Layout, relations: Relations, generic: Floats) -> Known:
        """Return the rows over the unknowns of a wider layout."""
        if not len(self.modes):
            return Known(relations)
        return Known(relations, modal_rows(layout, self.modes.modes, generic))
