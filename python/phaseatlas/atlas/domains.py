"""Overlapping domains of the segments, section 4, and the weights that blend them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Floats
from ..segmentation import Segmentation
from .charts import Domain

__all__ = ["blending_weights", "domains"]


def domains(segmentation: Segmentation, segment: int, threshold: float) -> list[Domain]:
    """Components of {weight > threshold} that hold faces of the segment, each cut to a disk.

    With these faces, and those across their boundary, so that neighbouring domains always overlap.

    Parameters
    ----------
    segmentation : Segmentation
        Labels and weights.
    segment : int
        Whose domains.
    threshold : float
        Of the weight, at least 0.
    """
    surface = segmentation.surface
    labelled = segmentation.labels == segment
    weight = np.maximum(segmentation.weight(segment) - threshold, 0)
    inside = (weight[surface.faces] > 0).any(axis=1) | labelled
    across = surface.face_neighbours[labelled]
    inside[across[across >= 0]] = True
    parts = surface.label_components(inside.astype(np.int64))
    found = []
    for part in np.unique(parts[labelled]):
        faces = np.flatnonzero(parts == part)
        cut = surface.cut_to_disk(faces)
        found.append(
            Domain(
                segment=segment,
                faces=faces,
                labelled=labelled[faces],
                weight=weight,
                disk=cut.mesh,
                vertices=cut.vertices,
                triangles=cut.triangles,
                cut_length=cut.length,
            )
        )
    return found


def blending_weights(segmentation: Segmentation, found: Sequence[Domain]) -> Floats:
    """Weights of the domains, (domains, n): those of the segment on the domain, 0 elsewhere, sum 1.

    Every face has a positive weight in the domain that labels it: where its weight is above the
    threshold at no corner, it counts there as it was given, or as 1. A vertex without any weight
    belongs in equal parts to all domains that label a face there.
    """
    surface = segmentation.surface
    weights = np.zeros((len(found), surface.n_vertices))
    labelled = np.zeros(weights.shape, dtype=np.bool_)
    for k, domain in enumerate(found):
        members = np.unique(surface.faces[domain.faces])
        weights[k, members] = domain.weight[members]
        own = surface.faces[domain.faces[domain.labelled]]
        labelled[k, own] = True
        bare = np.unique(own[~(weights[k, own] > 0).any(axis=1)])
        given = segmentation.weight(domain.segment)[bare]
        weights[k, bare] = np.where(given > 0, given, 1.0)
    empty = weights.sum(axis=0) == 0
    weights[:, empty] = labelled[:, empty]
    weights /= weights.sum(axis=0)
    return weights
