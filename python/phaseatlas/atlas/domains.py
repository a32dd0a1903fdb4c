"""Overlapping domains of the segments, section 4, and the weights that blend them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .. import _core
from ..arrays import Bools, Floats, Ints
from ..partitioning.partition import DISTORTION
from ..segmentation import Segmentation
from ..surface import Surface
from .charts import Domain

__all__ = ["blending_weights", "domains", "piece_domain", "pieces", "sharp_weights", "split"]

# Longest edge of faces to attach, in roots of the area: a blend is to be narrow beside a chart.
_LARGE = 0.1


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
    inside = _inside(segmentation, labelled, weight)
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


def pieces(segmentation: Segmentation, segment: int) -> list[Ints]:
    """Return the connected components of the faces of a segment.

    Parameters
    ----------
    segmentation : Segmentation
    segment : int
    """
    labelled = segmentation.labels == segment
    parts = segmentation.surface.label_components(labelled.astype(np.int64))
    return [np.flatnonzero(parts == part) for part in np.unique(parts[labelled])]


def piece_domain(
    segmentation: Segmentation,
    segment: int,
    piece: Ints,
    threshold: float | None,
    *,
    weighted: bool = True,
) -> Domain:
    """Domain of a piece of a segment, with faces around it attached to the disk of the piece.

    The piece is cut to a disk by itself, but a flat one with holes is left as it is. Large faces
    around it are left out: textures do not blend there.

    Parameters
    ----------
    segmentation : Segmentation
        Labels and weights.
    segment : int
        Whose piece.
    piece : (k,) array of int
        Connected faces of the segment, sorted.
    threshold : float, optional
        Of the weight of the faces to attach, at least 0; by default there are none.
    weighted : bool, default True
        Whether the domain is to have the weight of the segment, else it has 1 everywhere.
    """
    surface = segmentation.surface
    labelled = np.zeros(surface.n_faces, dtype=np.bool_)
    labelled[piece] = True
    weight: Floats = np.broadcast_to(1.0, surface.n_vertices)
    if weighted or threshold is not None:
        weight = np.maximum(segmentation.weight(segment) - (threshold or 0.0), 0)
    around = np.zeros_like(labelled)
    if threshold is not None:
        # Of other pieces of the segment only what is next to this one.
        around = _inside(segmentation, labelled, weight) & (segmentation.labels != segment)
        across = surface.face_neighbours[piece]
        around[across[across >= 0]] = True
        # Where faces are this large a blend would cover whole parts of the surface.
        around &= surface.face_diameters <= _LARGE * np.sqrt(surface.area)
    grown = _core.grow_chart(surface._mesh, piece, np.flatnonzero(around & ~labelled))
    order = np.argsort(grown.faces)
    return Domain(
        segment=segment,
        faces=grown.faces[order],
        labelled=labelled[grown.faces[order]],
        weight=weight,
        disk=grown.mesh,
        vertices=grown.vertices,
        triangles=np.ascontiguousarray(grown.triangles[order]),
        cut_length=grown.chart.length,
        sharp=grown.chart.mesh,
    )


def split(domain: Domain) -> list[Ints]:
    """Split the labelled faces of a domain in connected parts: two or a few more.

    Parameters
    ----------
    domain : Domain
        Of a piece, of at least two faces.

    Returns
    -------
    list of array of int
        Faces of each part.
    """
    piece = domain.faces[domain.labelled]
    assert domain.sharp is not None
    core = _core.Partition(domain.sharp, DISTORTION)
    core.forbid_overlap()
    if core.split_failing(2) == 0:
        core.set_cells(2)
    labels = core.labels()
    if not labels.any():
        labels = np.arange(len(piece))
    return [piece[labels == part] for part in range(labels.max() + 1)]


def _inside(segmentation: Segmentation, labelled: Bools, weight: Floats) -> Bools:
    """The labelled faces, those across their boundary, and those with weight."""
    surface = segmentation.surface
    inside: Bools = (weight[surface.faces] > 0).any(axis=1) | labelled
    across = surface.face_neighbours[labelled]
    inside[across[across >= 0]] = True
    return inside


def sharp_weights(surface: Surface, found: Sequence[Domain]) -> Floats:
    """Weights of domains that do not overlap, the same for all, (n,).

    A vertex belongs in equal parts to all domains that it lies in.
    """
    counts = np.zeros(surface.n_vertices)
    for domain in found:
        counts[np.unique(domain.vertices)] += 1
    return 1 / np.maximum(counts, 1)


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
