"""One surface made of another, and the maps between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .arrays import Ints
from .surface import Surface

__all__ = ["Transfer"]


@dataclass(frozen=True, eq=False)
class Transfer:
    """A surface made of another one, such as a simplified one, and the maps between their vertices.

    Attributes
    ----------
    source : Surface
        What the other was made of, with n vertices and m faces.
    target : Surface
        What was made of it, with k vertices.
    forward : (k, n) sparse array
        From values at the vertices of the source to those of the target. Its rows sum to 1, and
        no entry is negative.
    backward : (n, k) sparse array
        The other way, likewise.
    """

    source: Surface
    target: Surface
    forward: Any
    backward: Any

    @cached_property
    def parent_face(self) -> Ints:
        """Face of the target that each face of the source lies nearest to, by centroids, (m,)."""
        from scipy.spatial import cKDTree

        made, given = (s.face_mean(s.vertices) for s in (self.target, self.source))
        _, nearest = cKDTree(made).query(given)
        return np.asarray(nearest, dtype=np.int64)

    def then(self, other: Transfer) -> Transfer:
        """Return the transfer from this source to the target of `other`, made of this target.

        Raises
        ------
        ValueError
            Where `other` starts from another surface.
        """
        if other.source is not self.target:
            raise ValueError("other: its source must be the target of this transfer")
        return Transfer(
            self.source, other.target, other.forward @ self.forward, self.backward @ other.backward
        )
