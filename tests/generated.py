"""Surfaces made by formulas: sixty legal shapes that stand for what people model and scan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

import phaseatlas as pa
from phaseatlas import datasets


def _of(mesh: trimesh.Trimesh, longest: float | None = None) -> pa.Surface:
    """A surface of a mesh, its edges halved until none is longer than `longest`."""
    vertices, faces = mesh.vertices, mesh.faces
    if longest is not None:
        vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, longest)
    mesh = trimesh.Trimesh(vertices, faces)
    mesh.merge_vertices(digits_vertex=9)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return pa.Surface(mesh.vertices, mesh.faces)


def _grid(
    rows: int, columns: int, position: Callable[..., np.ndarray], wrap: tuple[bool, bool]
) -> pa.Surface:
    """A grid of quadrilaterals, each cut in two, closed along the axes that wrap."""
    i, j = np.meshgrid(np.arange(rows - (not wrap[0])), np.arange(columns - (not wrap[1])))
    i, j = i.ravel(), j.ravel()
    corner = lambda a, b: (a % rows) * columns + b % columns  # noqa: E731
    a, b, c, d = corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    s, t = np.meshgrid(
        np.arange(rows) / (rows if wrap[0] else rows - 1),
        np.arange(columns) / (columns if wrap[1] else columns - 1),
        indexing="ij",
    )
    return pa.Surface(position(s.ravel(), t.ravel()), faces)


def box(x: float, y: float, z: float, edge: float) -> pa.Surface:
    return _of(trimesh.creation.box((x, y, z)), edge)


def round_solid(kind: str, radius: float, height: float, sections: int, edge: float) -> pa.Surface:
    """A cone or a cylinder."""
    make = {"cone": trimesh.creation.cone, "cylinder": trimesh.creation.cylinder}[kind]
    return _of(make(radius, height, sections=sections), edge)


def rectangle(x: float, y: float, rows: int, columns: int) -> pa.Surface:
    return _grid(
        rows, columns, lambda s, t: np.stack([x * s, y * t, 0 * s], axis=1), (False, False)
    )


def terrain(rows: int, columns: int, height: float, seed: int) -> pa.Surface:
    phases = np.random.default_rng(seed).random((6, 4))

    def position(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        z = sum(
            np.sin(2 * np.pi * (1 + 3 * a) * s + 7 * b)
            * np.sin(2 * np.pi * (1 + 3 * c) * t + 7 * d)
            for a, b, c, d in phases
        )
        return np.stack([s, t, height * z], axis=1)

    return _grid(rows, columns, position, (False, False))


def tube(
    centre: Callable[[np.ndarray], np.ndarray], radius: float, rows: int, columns: int
) -> pa.Surface:
    """A tube around a closed curve, by its tangents and a frame carried along."""

    def position(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        at, step = 2 * np.pi * s, 1e-4
        tangent = centre(at + step) - centre(at - step)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        normal = centre(at + step) + centre(at - step) - 2 * centre(at)
        normal -= (normal * tangent).sum(axis=1, keepdims=True) * tangent
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        other = np.cross(tangent, normal)
        around = 2 * np.pi * t[:, None]
        return centre(at) + radius * (np.cos(around) * normal + np.sin(around) * other)

    return _grid(rows, columns, position, (True, True))


def _torus_knot(p: int, q: int) -> Callable[[np.ndarray], np.ndarray]:
    def centre(at: np.ndarray) -> np.ndarray:
        r = 2 + np.cos(q * at)
        return np.stack([r * np.cos(p * at), r * np.sin(p * at), -np.sin(q * at)], axis=1)

    return centre


def blob(subdivisions: int, balls: int, reach: float, seed: int) -> pa.Surface:
    """A sphere drawn out towards some balls: limbs and dents."""
    rng = np.random.default_rng(seed)
    sphere = datasets.icosphere(subdivisions)
    axes = rng.normal(size=(balls, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    pull = (reach * np.exp(8 * (sphere.vertices @ axes.T - 1))).sum(axis=1)
    return pa.Surface(sphere.vertices * (1 + pull)[:, None], sphere.faces)


def revolved(profile: list[tuple[float, float]], rows: int, columns: int) -> pa.Surface:
    """An open surface of revolution of a polyline of (radius, height)."""
    points = np.array(profile)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])

    def position(s: np.ndarray, t: np.ndarray) -> np.ndarray:
        radius, height = (np.interp(s * along[-1], along, points[:, k]) for k in (0, 1))
        around = 2 * np.pi * t
        return np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=1)

    return _grid(rows, columns, position, (False, True))


_creation = trimesh.creation

SURFACES: dict[str, Callable[[], pa.Surface]] = {
    "box cube": lambda: box(1, 1, 1, 0.15),
    "box plank": lambda: box(4, 1, 0.2, 0.2),
    "box sheet": lambda: box(1, 1, 0.02, 0.08),
    "box rod": lambda: box(8, 0.4, 0.4, 0.2),
    "box brick coarse": lambda: box(2, 1, 0.5, 0.5),
    "box tall": lambda: box(0.3, 0.5, 3, 0.15),
    "rectangle 16 x 4": lambda: rectangle(16, 4, 41, 11),
    "rectangle square": lambda: rectangle(1, 1, 24, 24),
    "rectangle strip": lambda: rectangle(30, 1, 121, 5),
    "rectangle anisotropic": lambda: rectangle(1, 1, 60, 8),
    "cylinder 16": lambda: round_solid("cylinder", 0.5, 2, 16, 0.25),
    "cylinder 40": lambda: round_solid("cylinder", 0.5, 2, 40, 0.25),
    "cylinder disk": lambda: round_solid("cylinder", 1, 0.1, 32, 0.2),
    "cylinder long": lambda: round_solid("cylinder", 0.2, 6, 16, 0.2),
    "cylinder open": lambda: datasets.cylinder(),
    "cone 16": lambda: round_solid("cone", 0.5, 1, 16, 0.15),
    "cone 32": lambda: round_solid("cone", 0.5, 2, 32, 0.2),
    "cone flat": lambda: round_solid("cone", 1, 0.2, 24, 0.2),
    "cone open": lambda: revolved([(0.05, 1), (0.5, 0)], 24, 32),
    "cone needle": lambda: round_solid("cone", 0.1, 2, 12, 0.1),
    "capsule plain": lambda: _of(_creation.capsule(height=1, radius=0.5, count=(16, 24))),
    "capsule long": lambda: _of(_creation.capsule(height=5, radius=0.5, count=(16, 16))),
    "capsule fine": lambda: _of(_creation.capsule(height=1, radius=0.3, count=(24, 32))),
    "sphere icosahedral": lambda: datasets.icosphere(3),
    "sphere coarse": lambda: datasets.icosphere(2),
    "sphere of latitudes": lambda: _of(_creation.uv_sphere(count=(16, 24))),
    "sphere small units": lambda: datasets.icosphere(3, radius=1e-5),
    "sphere large units": lambda: datasets.icosphere(3, radius=1e6),
    "ellipsoid flat": lambda: pa.Surface(
        datasets.icosphere(3).vertices * (1, 1, 0.1), datasets.icosphere(3).faces
    ),
    "ellipsoid long": lambda: pa.Surface(
        datasets.icosphere(3).vertices * (6, 1, 1), datasets.icosphere(3).faces
    ),
    "torus": lambda: datasets.torus(1.0, 0.4, 48, 20),
    "torus thin": lambda: datasets.torus(1.0, 0.1, 96, 10),
    "torus fat": lambda: datasets.torus(1.0, 0.9, 40, 36),
    "torus coarse": lambda: datasets.torus(1.0, 0.4, 16, 8),
    "terrain low": lambda: terrain(32, 32, 0.01, 0),
    "terrain hills": lambda: terrain(40, 40, 0.05, 1),
    "terrain rough": lambda: terrain(40, 40, 0.15, 2),
    "terrain strip": lambda: terrain(80, 12, 0.05, 3),
    "knot trefoil": lambda: tube(_torus_knot(2, 3), 0.4, 160, 12),
    "knot 3 5": lambda: tube(_torus_knot(3, 5), 0.2, 280, 8),
    "ring waved": lambda: tube(
        lambda at: np.stack([2 * np.cos(at), 2 * np.sin(at), 0.4 * np.cos(3 * at)], axis=1),
        0.3,
        96,
        12,
    ),
    "ring thick": lambda: tube(
        lambda at: np.stack([np.cos(at), np.sin(at), 0.2 * np.cos(2 * at)], axis=1), 0.5, 60, 24
    ),
    "blob two": lambda: blob(3, 2, 0.8, 0),
    "blob five": lambda: blob(4, 5, 1.0, 1),
    "blob eight": lambda: blob(4, 8, 0.5, 2),
    "blob three long": lambda: blob(4, 3, 2.0, 3),
    "blob dented": lambda: blob(3, 4, -0.4, 4),
    "blob coarse": lambda: blob(2, 5, 1.0, 5),
    "annulus thick": lambda: _of(_creation.annulus(0.5, 1, 0.5, sections=24), 0.2),
    "annulus ring": lambda: _of(_creation.annulus(0.8, 1, 0.2, sections=48), 0.2),
    "annulus flat": lambda: revolved([(0.5, 0), (1, 0)], 8, 40),
    "vase": lambda: revolved([(0.3, 0), (0.8, 0.6), (0.3, 1.4), (0.5, 1.8)], 40, 32),
    "dome": lambda: revolved([(0.02, 1), (0.6, 0.8), (1, 0)], 24, 40),
    "funnel": lambda: revolved([(0.05, 0), (0.06, 1), (1, 1.6)], 40, 24),
    "cube rounded": lambda: datasets.rounded_cube(14),
    "starfish": lambda: datasets.starfish(4),
    "starfish coarse": lambda: datasets.starfish(3),
    "sheet wavy": lambda: datasets.sheet(40, 30, amplitude=0.2, periods=2),
    "tetrahedron fine": lambda: _of(
        trimesh.Trimesh(
            [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
            [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)],
        ),
        0.12,
    ),
    "octahedron fine": lambda: _of(
        trimesh.Trimesh(
            [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)],
            [
                (0, 2, 4),
                (2, 1, 4),
                (1, 3, 4),
                (3, 0, 4),
                (2, 0, 5),
                (1, 2, 5),
                (3, 1, 5),
                (0, 3, 5),
            ],
        ),
        0.2,
    ),
}
