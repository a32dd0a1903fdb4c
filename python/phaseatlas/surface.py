"""A triangle surface: validated topology and the quantities that depend on it alone."""

from __future__ import annotations

from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from . import _core
from .arrays import Bools, Floats, Ints
from .checks import matrix, vector
from .normals import face_normals, vertex_normals
from .notebook import Pictured
from .seam_factors import at_edges, at_interfaces, check_factors, of_both_sides

__all__ = ["Surface"]

Array = TypeVar("Array", bound=NDArray[Any])


class Surface(Pictured):
    """An orientable, connected, manifold triangle mesh of any genus, with or without boundary.

    Parameters
    ----------
    vertices : (n, 3) array_like of float
        Vertex positions.
    faces : (m, 3) array_like of int
        Vertex indices of each face, all faces in one orientation.

    Attributes
    ----------
    seam_costs : (m, 3) array or None
        Factor on the length of a seam along each edge, from both sides the same, see
        `with_seam_costs`; None for 1.
    vertex_seam_costs : (n,) array or None
        Another factor, linear in each face, at the vertices; None for 1.

    Raises
    ------
    ValueError
        For an empty mesh, a wrong shape, a coordinate that is not finite, an index out of range,
        a degenerate face, an unreferenced vertex, a non-manifold edge or vertex, faces of
        inconsistent orientation and several components. The message names the culprit.
    """

    def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None:
        self._build(vertices, faces, accepted=False)

    def _build(
        self,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        accepted: bool,
        pieces: bool = False,
        costs: tuple[Floats | None, Floats | None] = (None, None),
    ) -> None:
        self.vertices: Floats = matrix("vertices", vertices, np.float64)
        self.faces: Ints = matrix("faces", faces, np.int64)
        of_edges, self.vertex_seam_costs = costs
        self._mesh = _core.TriangleMesh(
            self.vertices,
            self.faces,
            accepted=accepted,
            pieces=pieces,
            seam_costs=at_edges(self.faces, *costs),
        )
        self.seam_costs: Floats | None = (
            None if of_edges is None else of_both_sides(self.faces, self.face_neighbours, of_edges)
        )
        self.vertices.flags.writeable = False
        self.faces.flags.writeable = False

    def __repr__(self) -> str:
        return (
            f"Surface({self.n_vertices} vertices, {self.n_faces} faces, genus {self.genus}, "
            f"{self.n_boundary_loops} boundary loops)"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return _accepted, (self.vertices, self.faces, self.seam_costs, self.vertex_seam_costs)

    @property
    def n_vertices(self) -> int:
        """Number of vertices, n."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of faces, m."""
        return len(self.faces)

    @property
    def n_edges(self) -> int:
        """Number of edges."""
        return len(self.edges)

    @property
    def euler_characteristic(self) -> int:
        """V - E + F."""
        return self._mesh.euler_characteristic

    @property
    def genus(self) -> int:
        """Genus of the surface with its boundary loops capped."""
        return self._mesh.genus

    @property
    def n_boundary_loops(self) -> int:
        """Number of boundary loops."""
        return self._mesh.n_boundary_loops

    @cached_property
    def area(self) -> float:
        """Total area."""
        return float(self.face_areas.sum())

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean edge length h."""
        return self._mesh.mean_edge_length

    @cached_property
    def face_areas(self) -> Floats:
        """Area of each face, (m,)."""
        return _read_only(self._mesh.areas())

    @cached_property
    def face_diameters(self) -> Floats:
        """Longest edge of each face, (m,)."""
        return _read_only(self._mesh.diameters())

    @cached_property
    def mass(self) -> Floats:
        """Lumped mass, a third of the area of a vertex' faces, (n,)."""
        return _read_only(self._mesh.mass())

    @cached_property
    def face_normals(self) -> Floats:
        """Unit normals of the faces, (m, 3)."""
        return _read_only(face_normals(self.vertices, self.faces))

    @cached_property
    def vertex_normals(self) -> Floats:
        """Unit normals at the vertices, the mean of their faces by area, (n, 3)."""
        return _read_only(vertex_normals(self.vertices, self.faces))

    @cached_property
    def angle_defects(self) -> Floats:
        """Integrated Gauss curvature, (n,): 2 pi - sum of angles, at the boundary pi - sum."""
        return _read_only(self._mesh.angle_defects())

    @cached_property
    def on_border(self) -> Bools:
        """Whether a vertex lies on a boundary loop, (n,)."""
        return _read_only(self._mesh.on_border())

    @cached_property
    def edges(self) -> Ints:
        """Every edge once, smaller vertex first, sorted, (e, 2)."""
        return _read_only(self._mesh.edges())

    @cached_property
    def face_neighbours(self) -> Ints:
        """Face across edge (f[k], f[(k + 1) % 3]), -1 at the boundary, (m, 3)."""
        return _read_only(self._mesh.neighbours())

    @cached_property
    def total_seam_costs(self) -> Floats | None:
        """Factor on the length of a seam along each edge, all in all, (m, 3); None for 1."""
        return at_edges(self.faces, self.seam_costs, self.vertex_seam_costs)

    @cached_property
    def diffuse_seam_costs(self) -> Floats | None:
        """Factor on the length of a diffuse interface at each vertex, (n,); None for 1."""
        return at_interfaces(self.faces, self.seam_costs, self.vertex_seam_costs, self.n_vertices)

    @cached_property
    def face_quality(self) -> Floats:
        """4 sqrt(3) area / sum of squared edges of each face, 1 for equilateral, (m,)."""
        corners = self.vertices[self.faces]
        squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
        quality: Floats = 4 * np.sqrt(3) * self.face_areas / squares
        return quality

    @cached_property
    def adjacency(self) -> Any:
        """Vertices that share an edge, an (n, n) CSR array of ones."""
        return self._symmetric(np.ones(self.n_edges), np.zeros(self.n_vertices))

    @cached_property
    def stiffness(self) -> Any:
        """Cotangent stiffness S_ij = integral grad theta_i . grad theta_j, (n, n) CSR."""
        return self._symmetric(self._mesh.edge_stiffness())

    @cached_property
    def stiffness_diagonal(self) -> Floats:
        """Diagonal of the stiffness, (n,), without the matrix."""
        return _read_only(self._diagonal(self._mesh.edge_stiffness()))

    def weighted_stiffness(self, weight: ArrayLike) -> Any:
        """Stiffness S_ij = integral w grad theta_i . grad theta_j by midpoint quadrature.

        Parameters
        ----------
        weight : (n,) array_like of float
            Weight at the vertices; a face takes the mean of its corners.

        Returns
        -------
        scipy.sparse.csr_array, (n, n)

        Raises
        ------
        ValueError
            For a weight of another shape or with a value that is not finite.
        """
        return self._symmetric(self._mesh.edge_stiffness(self.vector("weight", weight)))

    def label_components(self, labels: ArrayLike) -> Ints:
        """Number the edge-connected components of faces of equal label, (m,) to (m,).

        Parameters
        ----------
        labels : (m,) array_like of int
            Label of each face.

        Returns
        -------
        (m,) array of int
            Component of each face, from 0, in the order of their first faces.

        Raises
        ------
        ValueError
            For labels of another shape.
        """
        array = np.ascontiguousarray(labels, dtype=np.int64)
        if array.shape != (self.n_faces,):
            raise ValueError(f"labels: shape {array.shape} must be ({self.n_faces},)")
        return _core.label_components(self._mesh, array)

    def cut_to_disk(self, faces: Ints) -> _core.CutChart:
        """Cut connected faces open to a disk along shortest paths.

        Parameters
        ----------
        faces : (k,) array of int
            Faces that are connected across edges.

        Returns
        -------
        CutChart
            `mesh`, the disk; `triangles` (k, 3), the faces in its vertices; `vertices` (p,), the
            vertex of this surface of each of them; `length` of the cut; and the
            `euler_characteristic` before it.

        Raises
        ------
        ValueError
            For faces that are not connected.
        """
        return _core.cut_chart(self._mesh, np.ascontiguousarray(faces, dtype=np.int64))

    def screened(self, epsilon: Floats) -> _core.Screened:
        """Factor the equation u - div(epsilon^2 grad u) = f, which spreads indicators of labels.

        Parameters
        ----------
        epsilon : (m,) array
            Width in each face.

        Returns
        -------
        Screened
            `spread(labels, chosen)` is (k, n): for each of the k chosen labels the share of its
            faces around each vertex, spread over epsilon. All labels together sum to 1.
        """
        return _core.Screened(self._mesh, np.ascontiguousarray(epsilon, dtype=np.float64))

    def one_chart(self, distortion: float) -> _core.Partition:
        """Start a partition of a single chart, which the moves of `Partition` improve.

        Parameters
        ----------
        distortion : float
            Weight of the mean squared log scale against the length of the seams in roots of the
            area.
        """
        return _core.Partition(self._mesh, distortion)

    def face_mean(self, values: Floats) -> Floats:
        """Mean over the corners of each face of a vertex quantity, (n, ...) to (m, ...)."""
        a, b, c = self.faces.T
        mean: Floats = (values[a] + values[b] + values[c]) / 3
        return mean

    def scaled(self, factor: float) -> Surface:
        """Return the surface with all lengths multiplied by `factor`, a positive number.

        Raises
        ------
        ValueError
            For a factor with which lengths overflow or areas vanish.
        """
        if not (np.isfinite(factor) and factor > 0):
            raise ValueError(f"factor: {factor} must be a positive number")
        costs = self.seam_costs, self.vertex_seam_costs
        return _accepted(self.vertices * factor, self.faces, *costs)

    def with_seam_costs(
        self, seam_costs: ArrayLike | None, vertex_seam_costs: ArrayLike | None = None
    ) -> Surface:
        """Return the surface with factors on the length of seams, in place of those that it has.

        Parameters
        ----------
        seam_costs : (m, 3) array_like of float or None
            Positive factor of edge (f[k], f[(k + 1) % 3]) of each face f; the larger one of its two
            faces counts. No seam runs along an edge whose factor is infinite. None for 1.
        vertex_seam_costs : (n,) array_like of float, optional
            Another positive factor, linear in each face, at the vertices. An edge has the mean of
            its ends.

        Raises
        ------
        ValueError
            For another shape, or a factor that is not positive.
        """
        costs = check_factors(seam_costs, vertex_seam_costs, self.n_faces, self.n_vertices)
        return _accepted(self.vertices, self.faces, *costs)

    def simplified(self, n_faces: int) -> tuple[Surface, NDArray[np.uint32]]:
        """Collapse edges until so many faces are left, or more where none can go.

        Returns
        -------
        Surface
            Of the same genus, with the same boundary loops and no seam costs.
        (n,) array of uint32
            Its vertex that each vertex has collapsed to.
        """
        vertices, faces, collapsed_to = _core.simplify(self._mesh, n_faces)
        return _accepted(vertices, faces), collapsed_to

    def submesh(self, faces: Ints | Bools) -> tuple[Surface, Ints]:
        """Return some of the faces as a surface, and its vertices as vertices of this one.

        Parameters
        ----------
        faces : (k,) array of int, or (m,) array of bool
            The faces to keep; they must form a surface.

        Returns
        -------
        Surface
            Of the k faces, in their order.
        (p,) array of int
            Vertex of this surface of each of its vertices, sorted.

        Raises
        ------
        ValueError
            For faces that form no surface, as where two of them touch at a vertex alone.
        """
        vertices, corners = np.unique(self.faces[faces], return_inverse=True)
        costs, at_vertices = self.seam_costs, self.vertex_seam_costs
        part = _accepted(
            self.vertices[vertices],
            corners.reshape(-1, 3),
            None if costs is None else costs[faces],
            None if at_vertices is None else at_vertices[vertices],
        )
        return part, vertices

    def vector(self, argument: str, values: ArrayLike) -> Floats:
        """Check and convert one finite value a vertex; `argument` names it in the error."""
        return vector(argument, values, self.n_vertices)

    def _symmetric(self, edge_values: Floats, diagonal: Floats | None = None) -> Any:
        """CSR matrix of one value an edge; its rows sum to 0 without a `diagonal`.

        Every edge and vertex has its entry, be it 0.
        """
        a, b = self.edges.T
        if diagonal is None:
            diagonal = self._diagonal(edge_values)
        vertices = np.arange(self.n_vertices)
        values = np.concatenate([edge_values, edge_values, diagonal])
        entries = np.concatenate([a, b, vertices]), np.concatenate([b, a, vertices])
        return scipy.sparse.csr_array((values, entries), shape=(self.n_vertices, self.n_vertices))

    def _diagonal(self, edge_values: Floats) -> Floats:
        """Diagonal of the matrix of one value an edge whose rows sum to 0."""
        ends = self.edges.reshape(-1)
        sums = np.bincount(ends, np.repeat(edge_values, 2), minlength=self.n_vertices)
        return -sums.astype(np.float64)


def _accepted(
    vertices: Floats,
    faces: Ints,
    seam_costs: Floats | None = None,
    vertex_seam_costs: Floats | None = None,
) -> Surface:
    """Surface of faces that were accepted before, which scaling may have made thinner."""
    surface = Surface.__new__(Surface)
    surface._build(vertices, faces, accepted=True, costs=(seam_costs, vertex_seam_costs))
    return surface


def _read_only(array: Array) -> Array:
    array.flags.writeable = False
    return array
