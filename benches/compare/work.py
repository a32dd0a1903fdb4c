"""The pieces of work and, for each, its contenders: phaseatlas and its peers."""

from __future__ import annotations

import functools
import importlib
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
import scipy.sparse.linalg
import threadpoolctl
from numpy.typing import NDArray

import phaseatlas as pa
from phaseatlas import _core
from surfaces import cap, caps, halves, noise

__all__ = ["OURS", "PART", "Work", "check", "works"]

Floats = NDArray[np.float64]

OURS = "phaseatlas"
# Contenders of this mark do a part of the work only: a bound, not a peer.
PART = "(part)"

_AGREEMENT = 1e-8
# OpenMP's threads spin for 0.2 s after their work by default.
_PAUSE = 0.25
# The sharp law of the distortion: weight and regularisation of its penalty.
_SHARP_PENALTY, _SHARP_ETA = 30.0, 1e-6


@dataclass(frozen=True)
class Work:
    """One piece of work.

    Attributes
    ----------
    name : str
    contenders : dict
        Function without arguments that does the work, or why there is none. What the functions
        return is compared with `agree`, but for parts.
    agree : callable
        Takes what phaseatlas and a peer returned; returns the relative difference.
    authors : float, optional
        Seconds of the authors' program on 40,962 vertices.
    pause : float, default 0
        Seconds to wait before a call, for the threads of a peer before it to come to rest.
    """

    name: str
    contenders: dict[str, Callable[[], Any] | str]
    agree: Callable[[Any, Any], float]
    authors: float | None = None
    pause: float = 0.0


def check(work: Work) -> None:
    """Call every contender once and compare the results, to a relative 1e-8.

    Raises
    ------
    AssertionError
        Where a peer computes something else.
    """
    calls = {name: call for name, call in work.contenders.items() if not isinstance(call, str)}
    ours = calls[OURS]()
    for name, call in calls.items():
        theirs = call()
        if name != OURS and not name.endswith(PART):
            difference = work.agree(ours, theirs)
            if not difference <= _AGREEMENT:
                raise AssertionError(f"{work.name}: {name} differs by {difference:.1e}")


def works(surface: pa.Surface, subdivisions: int, *, is_sphere: bool) -> Iterator[Work]:
    """All pieces of work on one surface of unit area, epsilon twice the mean edge length."""
    epsilon = 2 * surface.mean_edge_length
    yield _set_up(surface)
    yield _perimeter(surface, epsilon)
    yield _area(surface, epsilon)
    yield _stiffness(surface)
    for count, seconds, field in (
        (11, None, caps),
        (20, 0.134, caps),
        (250, 2.5, noise),
    ):
        yield _connectedness(surface, epsilon, count, field(surface, epsilon, count), seconds)
    yield from _distortion(surface, epsilon)
    if is_sphere:
        yield _flattening(cap(subdivisions))


def _set_up(surface: pa.Surface) -> Work:
    vertices, faces = np.array(surface.vertices), np.array(surface.faces)

    def ours() -> Any:
        new = pa.Surface(vertices, faces)
        return new.stiffness, new.mass, new.angle_defects, new.face_neighbours

    def libigl(igl: Any) -> Callable[[], Any]:
        barycentric = igl.MassMatrixType.MASSMATRIX_TYPE_BARYCENTRIC
        return lambda: (
            -igl.cotmatrix(vertices, faces),
            igl.massmatrix(vertices, faces, barycentric).diagonal(),
            igl.gaussian_curvature(vertices, faces),
            igl.triangle_triangle_adjacency(faces)[0],
        )

    def agree(a: Any, b: Any) -> float:
        return max(
            float(abs(a[0] - b[0]).sum() / abs(a[0]).sum()),
            _difference(a[1], b[1]),
            # The defects are small differences of angles.
            float(np.abs(a[2] - b[2]).max()) / (2 * np.pi),
            _difference(a[3], b[3]),
        )

    return Work(
        "surface: checks, stiffness, mass, curvature, adjacency",
        {OURS: ours, "libigl": _peer("igl", libigl)},
        agree,
    )


def _perimeter(surface: pa.Surface, epsilon: float) -> Work:
    functional = pa.functionals.Perimeter(surface, epsilon)
    u = halves(surface, epsilon)
    stiffness, mass = surface.stiffness, surface.mass

    def with_scipy() -> tuple[float, Floats]:
        flux = epsilon * (stiffness @ u)
        well = u * u - 1
        value = 0.5 * _dot(u, flux) + 9 / 16 / epsilon * _dot(mass, well * well)
        return value, flux + (9 / 4 / epsilon) * mass * well * u

    return Work(
        "perimeter, value + gradient",
        {
            OURS: lambda: functional.value_and_gradient(u),
            "SciPy": with_scipy,
            f"SciPy, matrix times u alone {PART}": lambda: stiffness @ u,
            f"NumPy, reading the matrix once {PART}": lambda: (
                stiffness.data.sum(),
                stiffness.indices.sum(),
            ),
        },
        _differences,
        6.2e-3,
    )


def _area(surface: pa.Surface, epsilon: float) -> Work:
    functional = pa.functionals.Area(surface, epsilon)
    u = halves(surface, epsilon)
    delta, mass = epsilon / 10, surface.mass

    def with_numpy() -> tuple[float, Floats]:
        return _dot(mass, pa.functionals.indicator(u, delta)), mass * _slope(u, delta)

    return Work(
        "area, value + gradient",
        {OURS: lambda: functional.value_and_gradient(u), "NumPy": with_numpy},
        _differences,
    )


def _stiffness(surface: pa.Surface) -> Work:
    weight = np.random.default_rng(3).uniform(size=surface.n_vertices)
    faces, vertices, n = surface.faces, surface.vertices, surface.n_vertices
    rows, columns = faces, np.roll(faces, -1, axis=1)
    opposite = vertices[np.roll(faces, -2, axis=1)]
    a, b = vertices[rows] - opposite, vertices[columns] - opposite
    cotangents = (a * b).sum(axis=2) / np.linalg.norm(np.cross(a, b), axis=2)
    ends = (np.concatenate([rows, columns]).ravel(), np.concatenate([columns, rows]).ravel())

    def assemble() -> Any:
        values = (-0.5 * surface.face_mean(weight)[:, None] * cotangents).ravel()
        return scipy.sparse.csr_array((np.concatenate([values, values]), ends), shape=(n, n))

    def libigl(igl: Any) -> Callable[[], Any]:
        v, f = np.array(vertices), np.array(faces)
        return lambda: igl.cotmatrix(v, f)

    i, j = surface.edges.T
    mesh = _core.TriangleMesh(surface.vertices, surface.faces)
    return Work(
        "stiffness of another weight",
        {
            OURS: lambda: mesh.edge_stiffness(weight),
            "SciPy": assemble,
            f"libigl, cotmatrix of weight 1 {PART}": _peer("igl", libigl),
        },
        lambda ours, theirs: _difference(ours, np.asarray(theirs[i, j])),
    )


def _connectedness(
    surface: pa.Surface, epsilon: float, count: int, u: Floats, authors: float | None
) -> Work:
    functional = pa.functionals.Connectedness(surface, epsilon, phase="positive")
    graph, masses = _contracted(surface, epsilon, u)
    components = np.arange(len(masses))

    def dijkstra() -> Any:
        return scipy.sparse.csgraph.dijkstra(
            graph, indices=components[:-1], return_predecessors=True
        )

    def agree(ours: Any, theirs: Any) -> float:
        distances = theirs[0][:, : len(masses)]
        pairs = np.triu(np.outer(masses[:-1], masses), 1)
        return _difference(ours[0], 2 * (pairs * distances).sum())

    return Work(
        f"connectedness, {count} components ({len(masses)} found), one phase",
        {
            OURS: lambda: functional.value_and_gradient(u),
            "SciPy, Dijkstra alone, its graph given": dijkstra,
        },
        agree,
        authors,
    )


def _contracted(surface: pa.Surface, epsilon: float, u: Floats) -> tuple[Any, Floats]:
    """Dual graph with every component of the positive phase contracted, and their masses.

    The components are the first nodes.
    """
    threshold = 1 - np.sqrt(epsilon)
    values = surface.face_mean(u)
    price = np.minimum(values - threshold, 0) ** 2
    t = np.clip((values - threshold) / (1 - threshold), 0, 1)
    f, k = np.nonzero(surface.face_neighbours >= 0)
    g = surface.face_neighbours[f, k]
    diameters = surface.face_diameters
    weight = (price[f] + price[g]) * 0.25 * (diameters[f] + diameters[g])

    inside = values >= threshold
    m = surface.n_faces
    joined = inside[f] & inside[g]
    adjacency = scipy.sparse.csr_array((joined[joined], (f[joined], g[joined])), shape=(m, m))
    _, parts = scipy.sparse.csgraph.connected_components(adjacency, directed=False)
    _, labels = np.unique(parts[inside], return_inverse=True)
    mass = (surface.face_areas * t * t * (3 - 2 * t))[inside]
    masses = np.bincount(labels, weights=mass).astype(np.float64)
    node = np.empty(m, dtype=np.int64)
    node[inside] = labels
    node[~inside] = len(masses) + np.arange(m - inside.sum())

    tail, head = node[f], node[g]
    keep = tail != head
    tail, head, weight = tail[keep], head[keep], weight[keep]
    # Of several edges between two nodes the shortest counts.
    order = np.lexsort((weight, head, tail))
    tail, head, weight = tail[order], head[order], weight[order]
    first = np.ones(len(tail), dtype=bool)
    first[1:] = (tail[1:] != tail[:-1]) | (head[1:] != head[:-1])
    size = int(node.max()) + 1
    graph = scipy.sparse.csr_array((weight[first], (tail[first], head[first])), shape=(size, size))
    return graph, masses


class _Solver(Protocol):
    """Factorisation of S + diagonal(d), the pattern analysed before."""

    def factor(self, diagonal: Floats) -> None: ...

    def solve(self, b: Floats) -> Floats: ...


class _SuperLU:
    def __init__(self, stiffness: Any) -> None:
        self.matrix, self.diagonal = _with_diagonal(stiffness.tocsc())
        self.values = stiffness.diagonal()

    def factor(self, diagonal: Floats) -> None:
        self.matrix.data[self.diagonal] = self.values + diagonal
        # By its defaults: minimum degree of A + A^T in the symmetric mode has less fill, but took
        # up to eight times longer on these matrices.
        self.factors = scipy.sparse.linalg.splu(self.matrix)

    def solve(self, b: Floats) -> Floats:
        x: Floats = self.factors.solve(b)
        return x


class _Cholmod:
    def __init__(self, stiffness: Any, cholmod: Any) -> None:
        self.matrix, self.diagonal = _with_diagonal(scipy.sparse.csc_matrix(stiffness))
        self.values = stiffness.diagonal()
        self.matrix.data[self.diagonal] += 1.0
        self.factors = cholmod.analyze(self.matrix, ordering_method="amd")

    def factor(self, diagonal: Floats) -> None:
        self.matrix.data[self.diagonal] = self.values + diagonal
        self.factors.cholesky_inplace(self.matrix)

    def solve(self, b: Floats) -> Floats:
        x: Floats = self.factors.solve_A(b)
        return x


class _Pardiso:
    def __init__(self, stiffness: Any, pypardiso: Any) -> None:
        # Matrix type 2: symmetric positive definite, the upper triangle given.
        self.solver = pypardiso.PyPardisoSolver(mtype=2)
        upper = scipy.sparse.csr_matrix(scipy.sparse.triu(stiffness, format="csr"))
        self.matrix, self.diagonal = _with_diagonal(upper)
        self.values = stiffness.diagonal()
        self.matrix.data[self.diagonal] += 1.0
        self.nothing = np.zeros(stiffness.shape[0])
        self.solver.set_phase(11)
        self.solver._call_pardiso(self.matrix, self.nothing)

    def factor(self, diagonal: Floats) -> None:
        self.matrix.data[self.diagonal] = self.values + diagonal
        self.solver.set_phase(22)
        self.solver._call_pardiso(self.matrix, self.nothing)

    def solve(self, b: Floats) -> Floats:
        self.solver.set_phase(33)
        x: Floats = self.solver._call_pardiso(self.matrix, b)
        return x


class _OneThread:
    """A solver whose BLAS has one thread from the analysis on."""

    def __init__(self, stiffness: Any, make: Callable[..., _Solver], peer: Any) -> None:
        self.controller = threadpoolctl.ThreadpoolController()
        with self._limit():
            self.solver = make(stiffness, peer)

    def _limit(self) -> Any:
        return self.controller.limit(limits=1, user_api="blas")

    def factor(self, diagonal: Floats) -> None:
        with self._limit():
            self.solver.factor(diagonal)

    def solve(self, b: Floats) -> Floats:
        with self._limit():
            return self.solver.solve(b)


def _with_diagonal(matrix: Any) -> tuple[Any, Any]:
    """The matrix with sorted indices, and where its data has the diagonal."""
    matrix.sort_indices()
    major = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    return matrix, np.flatnonzero(matrix.indices == major)


def _distortion(surface: pa.Surface, epsilon: float) -> Iterator[Work]:
    u = halves(surface, epsilon)
    # phaseatlas keeps of a factorisation what has not changed: every value does from call to call.
    moving = itertools.cycle((u, u * (1 - 1e-10)))
    functional = pa.functionals.Distortion(surface, epsilon)
    stiffness = surface.stiffness
    pairs: dict[str, tuple[_Solver, _Solver] | str] = {}
    for peer, module, make in (
        ("CHOLMOD (AMD)", "sksparse.cholmod", _Cholmod),
        ("MKL Pardiso", "pypardiso", _Pardiso),
    ):
        pairs[peer] = _peer(module, functools.partial(_twice, make, stiffness))
        pairs[f"{peer}, one thread"] = _peer(
            module, functools.partial(_twice, _OneThread, stiffness, make)
        )
    pairs["SciPy splu"] = _twice(_SuperLU, stiffness)

    def contenders(
        ours: Callable[[], Any], theirs: Callable[[tuple[_Solver, _Solver]], Any], mark: str = ""
    ) -> dict[str, Callable[[], Any] | str]:
        calls: dict[str, Callable[[], Any] | str] = {OURS: ours} if not mark else {}
        for name, pair in pairs.items():
            if isinstance(pair, str):
                calls[name + mark] = pair
            else:
                calls[name + mark] = functools.partial(theirs, pair)
        return calls

    yield Work(
        "Yamabe equation, both phases: two refactorisations, two solves",
        contenders(
            lambda: functional.log_scale(next(moving)),
            lambda pair: tuple(
                -_yamabe(surface, epsilon, sign * u, solver)[0]
                for sign, solver in zip((1, -1), pair, strict=True)
            ),
        ),
        _differences,
        pause=_PAUSE,
    )
    diagonals = [_coefficients(surface, epsilon, sign * u)[1] for sign in (1, -1)]
    yield Work(
        "distortion, both phases, value + gradient",
        {
            **contenders(
                lambda: functional.value_and_gradient(next(moving)),
                lambda pair: _value_and_gradient(surface, epsilon, u, pair),
            ),
            **contenders(
                lambda: None,
                lambda pair: _refactor(pair, diagonals),
                f", the two refactorisations alone {PART}",
            ),
        },
        _differences,
        pause=_PAUSE,
    )
    printed = pa.functionals.Distortion(surface, epsilon, law="paper")
    yield Work(
        "distortion by the law of the paper, both phases, value + gradient",
        {OURS: lambda: printed.value_and_gradient(next(moving))},
        _differences,
        0.540,
    )


def _refactor(pair: tuple[_Solver, _Solver], diagonals: list[Floats]) -> None:
    for solver, diagonal in zip(pair, diagonals, strict=True):
        solver.factor(diagonal)


def _twice(make: Callable[..., _Solver], *arguments: Any) -> tuple[_Solver, _Solver]:
    return make(*arguments), make(*arguments)


def _coefficients(surface: pa.Surface, epsilon: float, u: Floats) -> tuple[Floats, Floats, Floats]:
    """Source, diagonal and t = max(0, 1 - 4 chi) of the sharp law."""
    t = np.maximum(1 - 4 * pa.functionals.indicator(u, epsilon / 10), 0)
    source = surface.angle_defects * (1 - t * t)
    diagonal = surface.mass * (_SHARP_PENALTY * t * t + _SHARP_ETA) / epsilon**2
    return source, diagonal, t


def _yamabe(
    surface: pa.Surface, epsilon: float, u: Floats, solver: _Solver
) -> tuple[Floats, Floats]:
    source, diagonal, t = _coefficients(surface, epsilon, u)
    solver.factor(diagonal)
    return solver.solve(source), t


def _value_and_gradient(
    surface: pa.Surface, epsilon: float, u: Floats, pair: tuple[_Solver, _Solver]
) -> tuple[float, Floats]:
    value, gradient = 0.0, np.zeros_like(u)
    for sign, solver in zip((1, -1), pair, strict=True):
        s, t = _yamabe(surface, epsilon, sign * u, solver)
        moment = surface.mass * s
        adjoint = solver.solve(moment)
        value += _dot(moment, s)
        # Derivatives of source and penalty by chi.
        force = 8 * t * (surface.angle_defects + _SHARP_PENALTY / epsilon**2 * moment)
        gradient += 2 * sign * _slope(sign * u, epsilon / 10) * adjoint * force
    return value, gradient


def _flattening(disk: pa.Surface) -> Work:
    border = np.flatnonzero(disk.on_border)
    pinned = border[[np.argmin(disk.vertices[border, 0]), np.argmax(disk.vertices[border, 0])]]
    at = np.array([[-1.0, 0.0], [1.0, 0.0]])
    vertices, faces = np.array(disk.vertices), np.array(disk.faces)
    stiffness = disk.stiffness
    mesh = _core.TriangleMesh(disk.vertices, disk.faces)

    def energy(uv: Floats) -> float:
        a, b, c = np.moveaxis(uv[faces], 1, 0)
        p, q = b - a, c - a
        area = 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())
        return 0.5 * float((uv * (stiffness @ uv)).sum()) / abs(area) - 1

    return Work(
        "conformal map of a half: spectral LSCM, least squares with two pins",
        {
            OURS: lambda: _core.lscm(mesh),
            f"{OURS}, boundary-first flattening {PART}": lambda: _core.bff(mesh),
            "libigl, two pins": _peer(
                "igl", lambda igl: lambda: igl.lscm(vertices, faces, pinned, at)[0]
            ),
        },
        # Without pins the map is at least as conformal.
        lambda ours, theirs: max(0.0, energy(ours) - energy(theirs)),
    )


def _peer(module: str, make: Callable[[Any], Any]) -> Any:
    """What `make` makes of the module, or that it is not installed."""
    try:
        peer = importlib.import_module(module)
    except ImportError as error:
        return f"not installed: {error}"
    return make(peer)


def _dot(a: Floats, b: Floats) -> float:
    # BLAS would wake its threads, which takes longer than the product of these lengths.
    return float(np.einsum("i,i", a, b))


def _slope(u: Floats, delta: float) -> Floats:
    """Derivative of the indicator chi."""
    r = 1 - delta
    slope: Floats = np.where(np.abs(u) < r, 3 / (4 * r**3) * (r * r - u * u), 0.0)
    return slope


def _difference(a: Any, b: Any) -> float:
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    return float(np.linalg.norm(a - b) / max(np.linalg.norm(a), np.finfo(float).tiny))


def _differences(ours: Any, theirs: Any) -> float:
    return max(_difference(a, b) for a, b in zip(ours, theirs, strict=True))
