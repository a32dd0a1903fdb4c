"""Small surfaces made on the spot, for examples, tests and benchmarks.

Every generator returns a :class:`~phaseatlas.surface.Surface` with consistently oriented faces;
closed surfaces point outwards. Lengths are in the unit of the arguments.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse

from .arrays import Floats, Ints
from .surface import Surface

__all__ = ["cylinder", "icosphere", "rounded_cube", "sheet", "starfish", "torus"]


def icosphere(subdivisions: int = 4, radius: float = 1.0) -> Surface:
    """Sphere made by subdividing an icosahedron.

    Parameters
    ----------
    subdivisions : int, default 4
        Number of one-to-four subdivisions; the sphere has ``10 * 4**subdivisions + 2`` vertices.
    radius : float, default 1.0
        Distance of every vertex from the origin.

    Returns
    -------
    Surface
        Closed surface of genus 0 with ``20 * 4**subdivisions`` faces.

    Raises
    ------
    ValueError
        If `subdivisions` is negative or `radius` is not a positive number.
    """
    _require_count("subdivisions", subdivisions, 0)
    _require_positive("radius", radius)
    directions, faces = _unit_icosphere(subdivisions)
    return Surface(radius * directions, faces)


def torus(
    major_radius: float = 1.0, minor_radius: float = 0.4, n_major: int = 96, n_minor: int = 40
) -> Surface:
    """Torus around the z axis with a regular triangulation (six faces at every vertex).

    Parameters
    ----------
    major_radius : float, default 1.0
        Distance of the centre of the tube from the z axis.
    minor_radius : float, default 0.4
        Radius of the tube.
    n_major : int, default 96
        Number of vertices around the z axis.
    n_minor : int, default 40
        Number of vertices around the tube.

    Returns
    -------
    Surface
        Closed surface of genus 1 with ``n_major * n_minor`` vertices and twice as many faces.

    Raises
    ------
    ValueError
        If a radius is not a positive number, `minor_radius` is not smaller than `major_radius`, or
        a count is less than 3.
    """
    _require_positive("major_radius", major_radius)
    _require_positive("minor_radius", minor_radius)
    if minor_radius >= major_radius:
        raise ValueError(
            f"minor_radius: {minor_radius} must be smaller than major_radius, {major_radius}"
        )
    _require_count("n_major", n_major, 3)
    _require_count("n_minor", n_minor, 3)
    around, along = np.meshgrid(
        2.0 * np.pi * np.arange(n_major) / n_major,
        2.0 * np.pi * np.arange(n_minor) / n_minor,
        indexing="ij",
    )
    from_axis = major_radius + minor_radius * np.cos(along)
    vertices = np.stack(
        (from_axis * np.cos(around), from_axis * np.sin(around), minor_radius * np.sin(along)),
        axis=-1,
    )
    return Surface(vertices.reshape(-1, 3), _grid_faces(n_major, n_minor, wrap=(True, True)))


def sheet(
    n_x: int = 40,
    n_y: int = 40,
    size: tuple[float, float] = (1.0, 1.0),
    amplitude: float = 0.0,
    periods: float = 2,
) -> Surface:
    """Rectangular sheet over ``[0, size[0]] x [0, size[1]]``, flat or with waves.

    The height is ``amplitude * sin(2 pi periods x / size[0]) * sin(2 pi periods y / size[1])``.
    Each of the ``n_x * n_y`` rectangular cells is cut along one diagonal, the same for all; the
    normals have a positive z component.

    Parameters
    ----------
    n_x, n_y : int, default 40
        Number of cells along x and y; the vertex ``(i, j)`` of the grid has the index
        ``i * (n_y + 1) + j``.
    size : tuple of float, default (1.0, 1.0)
        Extent along x and y.
    amplitude : float, default 0.0
        Height of the waves, in the unit of `size`; zero gives a flat sheet.
    periods : float, default 2
        Number of waves along each side.

    Returns
    -------
    Surface
        Open surface with one boundary loop, ``(n_x + 1) * (n_y + 1)`` vertices and
        ``2 * n_x * n_y`` faces.

    Raises
    ------
    ValueError
        If a count is less than 1, an extent is not a positive number, or `amplitude` or `periods`
        is not finite.
    """
    _require_count("n_x", n_x, 1)
    _require_count("n_y", n_y, 1)
    _require_positive("size[0]", size[0])
    _require_positive("size[1]", size[1])
    _require_finite("amplitude", amplitude)
    _require_finite("periods", periods)
    s, t = np.meshgrid(
        np.linspace(0.0, 1.0, n_x + 1), np.linspace(0.0, 1.0, n_y + 1), indexing="ij"
    )
    wave = np.sin(2.0 * np.pi * periods * s) * np.sin(2.0 * np.pi * periods * t)
    vertices = np.stack((size[0] * s, size[1] * t, amplitude * wave), axis=-1)
    return Surface(vertices.reshape(-1, 3), _grid_faces(n_x + 1, n_y + 1, wrap=(False, False)))


def cylinder(
    radius: float = 1.0, height: float = 2.0, n_around: int = 48, n_along: int = 16
) -> Surface:
    """Open tube around the z axis, from ``z = 0`` to ``z = height``.

    Parameters
    ----------
    radius : float, default 1.0
        Distance of every vertex from the z axis.
    height : float, default 2.0
        Extent along z.
    n_around : int, default 48
        Number of vertices around the axis.
    n_along : int, default 16
        Number of cells along the axis.

    Returns
    -------
    Surface
        Open surface with two boundary loops, ``n_around * (n_along + 1)`` vertices and
        ``2 * n_around * n_along`` faces, oriented away from the axis.

    Raises
    ------
    ValueError
        If `radius` or `height` is not a positive number, `n_around` is less than 3 or `n_along` is
        less than 1.
    """
    _require_positive("radius", radius)
    _require_positive("height", height)
    _require_count("n_around", n_around, 3)
    _require_count("n_along", n_along, 1)
    around, along = np.meshgrid(
        2.0 * np.pi * np.arange(n_around) / n_around,
        np.linspace(0.0, height, n_along + 1),
        indexing="ij",
    )
    vertices = np.stack((radius * np.cos(around), radius * np.sin(around), along), axis=-1)
    return Surface(vertices.reshape(-1, 3), _grid_faces(n_around, n_along + 1, wrap=(True, False)))


def rounded_cube(cells: int = 40, side: float = 2.0, radius: float = 0.5) -> Surface:
    """Cube around the origin with rounded edges and corners.

    The faces are flat, the edges quarters of cylinders, the corners octants of spheres: the Gauss
    curvature is ``1 / radius**2`` on the corners, pi / 2 in total on each, and zero elsewhere.

    Parameters
    ----------
    cells : int, default 40
        Number of cells of the grid along each side of the cube, up to the middle of the roundings.
    side : float, default 2.0
        Distance of opposite faces.
    radius : float, default 0.5
        Radius of edges and corners, at most half of `side`, which gives a sphere.

    Returns
    -------
    Surface
        Closed surface of genus 0 with ``6 * cells**2 + 2`` vertices and twice as many faces less
        four.

    Raises
    ------
    ValueError
        If `cells` is less than 1, `side` or `radius` is not a positive number or `radius` is
        larger than half of `side`.
    """
    _require_count("cells", cells, 1)
    _require_positive("side", side)
    _require_positive("radius", radius)
    if radius > 0.5 * side:
        raise ValueError(f"radius: {radius} must be at most half of side, {side / 2}")
    lattice, quads = _cube_lattice(cells)
    # Along a line of the grid, from the middle of one rounding to the middle of the next, the
    # arc length runs evenly; past the flat part it is an angle of up to 45 degrees.
    flat = 0.5 * side - radius
    reach = flat + 0.25 * np.pi * radius
    along = reach * (2.0 * lattice / cells - 1.0)
    inner = np.clip(along, -flat, flat)
    direction = np.tan(np.clip((along - inner) / radius, -0.25 * np.pi, 0.25 * np.pi))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    vertices = inner + radius * direction
    # The shorter diagonal of each cell; they differ on the corners only.
    first = np.linalg.norm(vertices[quads[:, 0]] - vertices[quads[:, 2]], axis=1)
    second = np.linalg.norm(vertices[quads[:, 1]] - vertices[quads[:, 3]], axis=1)
    turned = np.where((second < (1.0 - 1e-9) * first)[:, None], np.roll(quads, -1, axis=1), quads)
    faces = np.concatenate((turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]), axis=1)
    return Surface(vertices, faces.reshape(-1, 3))


def _cube_lattice(cells: int) -> tuple[Ints, Ints]:
    """Points (p, 3) of a cube's surface on the lattice 0..cells, and quads (q, 4) outwards."""
    i, j = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    around = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    square = np.stack((i, j), axis=-1).reshape(-1, 1, 2) + around
    corners = []
    for axis in range(3):
        for end in (0, cells):
            side = np.insert(square, axis, end, axis=2)
            # (i, j, outwards) is right-handed for the axes 0 and 2, left-handed for 1.
            corners.append(side if (end > 0) == (axis != 1) else side[:, ::-1])
    points, index = np.unique(np.concatenate(corners).reshape(-1, 3), axis=0, return_inverse=True)
    return points.astype(np.int64), index.reshape(-1, 4).astype(np.int64)


# Longitude and latitude (degrees), reach beyond the body and angular width (radians) of the limbs:
# unequal on purpose, so that no symmetry of the shape hides a preference of an algorithm.
_LIMBS = np.array(
    [
        [0.0, 4.0, 1.25, 0.36],
        [68.0, -6.0, 0.95, 0.34],
        [139.0, 8.0, 1.10, 0.38],
        [218.0, -4.0, 0.80, 0.36],
        [287.0, 5.0, 1.35, 0.37],
        [100.0, 78.0, 0.45, 0.42],
    ]
)
_BODY_RADIUS = 0.6
_RELAXATION_SWEEPS = 60


def starfish(subdivisions: int = 5) -> Surface:
    """Blob with five long limbs near a plane and a short one on top, all of different sizes.

    The surface is a radial graph over the unit sphere, hence free of self-intersections. The
    vertices are spread evenly by moving each of them towards the mean of its neighbours and back to
    the graph.

    Parameters
    ----------
    subdivisions : int, default 5
        Subdivisions of the icosahedron; the surface has ``10 * 4**subdivisions + 2`` vertices.

    Returns
    -------
    Surface
        Closed smooth surface of genus 0 and a diameter of about 3.5; the worst triangle quality
        ``4 sqrt(3) area / sum(edge**2)`` stays above 0.5 from 3 subdivisions on.

    Raises
    ------
    ValueError
        If `subdivisions` is less than 3: coarser triangles do not resolve the limbs.
    """
    _require_count("subdivisions", subdivisions, 3)
    directions, faces = _unit_icosphere(subdivisions)
    average = _neighbour_average(len(directions), faces)
    # Sweeps diffuse over a distance that grows like the square root of their number, so a finer
    # mesh needs four times as many for the same shape.
    sweeps = _RELAXATION_SWEEPS * 4 ** max(subdivisions - 4, 0)
    for _ in range(sweeps):
        mean: Floats = average @ _on_starfish(directions)
        directions = 0.5 * (directions + mean / np.linalg.norm(mean, axis=1, keepdims=True))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Surface(_on_starfish(directions), faces)


def _on_starfish(directions: Floats) -> Floats:
    """Points (n, 3) of the starfish in the given unit directions (n, 3)."""
    longitude, latitude = np.radians(_LIMBS[:, 0]), np.radians(_LIMBS[:, 1])
    axes = np.stack(
        (
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        )
    )
    # exp((cos(angle) - 1) / width^2) is a Gaussian of the angle near the axis, smooth all round.
    bumps = np.exp((directions @ axes - 1.0) / _LIMBS[:, 3] ** 2)
    radii: Floats = _BODY_RADIUS + bumps @ _LIMBS[:, 2]
    return radii[:, None] * directions


def _unit_icosphere(subdivisions: int) -> tuple[Floats, Ints]:
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)


def _neighbour_average(n_vertices: int, faces: Ints) -> scipy.sparse.csr_array:
    """Matrix (n, n) that maps vertex values to the mean over the neighbours."""
    start = faces.ravel()
    end = np.roll(faces, -1, axis=1).ravel()
    # On a closed surface every edge occurs once in each direction.
    adjacency = scipy.sparse.csr_array(
        (np.ones(len(start)), (start, end)), shape=(n_vertices, n_vertices), dtype=np.float64
    )
    valence = np.bincount(start, minlength=n_vertices)
    return scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 / valence) @ adjacency)


def _grid_faces(rows: int, columns: int, *, wrap: tuple[bool, bool]) -> Ints:
    """Faces of the grid of vertices ``row * columns + column``, closed up where it wraps."""
    row, column = np.meshgrid(
        np.arange(rows if wrap[0] else rows - 1),
        np.arange(columns if wrap[1] else columns - 1),
        indexing="ij",
    )
    next_row, next_column = (row + 1) % rows, (column + 1) % columns
    a = row * columns + column
    b = next_row * columns + column
    c = next_row * columns + next_column
    d = row * columns + next_column
    faces = np.stack((np.stack((a, b, c), axis=-1), np.stack((a, c, d), axis=-1)), axis=-2)
    return faces.reshape(-1, 3).astype(np.int64)


def _require_count(name: str, value: int, smallest: int) -> None:
    if not (np.isfinite(value) and value == int(value) and value >= smallest):
        raise ValueError(f"{name}: {value} must be an integer of at least {smallest}")


def _require_positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{name}: {value} must be a positive number")


def _require_finite(name: str, value: float) -> None:
    if not np.isfinite(value):
        raise ValueError(f"{name}: {value} must be a finite number")
