"""Hierarchical segmentation, section 4: a binary tree of phase fields and its leaves."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import scipy.cluster.vq
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from . import _core, ipopt
from .functionals import Area, Connectedness, Distortion, Perimeter, indicator
from .io import write_whole
from .optimise import AREA_CONSTRAINTS, AreaConstraint, Iteration, Result, minimise
from .surface import Surface

__all__ = [
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "Progress",
    "SegmentTree",
    "segment",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Initial = Literal["auto", "random", "normals"]
INITIALS = get_args(Initial)
Solver = Literal["lbfgs", "ipopt"]

# Continuation starts where epsilon is about this part of the square root of the segment's area:
# the interface is then as wide as the segment, and few local minima are left.
_COARSEST = 0.2
# With distortion it starts narrower: a limb that is thinner than the interface has no inside, and
# the border must find the way along it before it has shrunk to its shortest.
_COARSEST_DISTORTED = 0.1
_MINIMISE: dict[Solver, Callable[..., Result]] = {
    "lbfgs": minimise,
    "ipopt": ipopt.minimise,
}
_COARSE: dict[Solver, dict[str, Any]] = {
    "lbfgs": {"tolerance": 1e-5, "max_updates": 1},
    "ipopt": {"tolerance": 1e-5},
}
# The distortion is stiff: with 1e-8, as without it, half of the steps gain nothing.
_DISTORTED: dict[Solver, dict[str, Any]] = {"lbfgs": {"tolerance": 1e-6}, "ipopt": {}}
# First steps of each start: the better half of them goes on, for twice as many, until one is
# left. Steps in which noise parts into phases.
_START_STEPS = 20
_NOISE_STEPS = 15
# The connectedness functional sees all that the distortion does: its threshold is about the value
# at which that starts to penalise the other phase. Masses saturate at epsilon^2, the area of the
# least island: an island at the tip of a limb spares so much distortion that its own small mass
# would not hold it.
_THRESHOLD = 0.3
_PLATEAU = 0.5
# Crumbs up to this part of the area of their node, or of this many faces, are relabelled: faces
# at the tips of a jagged interface. Larger ones are turned over and the node is solved again,
# each round with a heavier connectedness term.
_CRUMB_SHARE = 1e-3
_CRUMB_FACES = 4
_REPAIR_ROUNDS = 4
_REPAIR_STEPS = 1000
# Normals closer than this are the same; a split by normals is +-tanh of this many deviations.
_SAME_NORMALS = 1e-9
_SPLIT_SLOPE = 6.0
_REPAIR_GROWTH = 10.0

_FORMAT = 1


class CollapsedError(RuntimeError):
    """One of the two phases of a node took no face: there is nothing to split."""


class DisconnectedError(RuntimeError):
    """A segment that was to be connected is not, and repair did not help."""


@dataclass(frozen=True)
class Progress:
    """Where a segmentation is, as handed to the progress callback after every step.

    Attributes
    ----------
    level, node : int
        Level of the tree, from 1, and node on it, from 0.
    epsilon : float
        Interface width of the continuation's present stage, relative to sqrt(area).
    iteration : int
        Steps taken in this node.
    energy : float
        Weighted sum of the functionals on the surface scaled to unit area.
    """

    level: int
    node: int
    epsilon: float
    iteration: int
    energy: float


@dataclass(frozen=True)
class Diagnostics:
    """How one node of the tree was split.

    Attributes
    ----------
    level, node : int
        The node that was split: level 0 is the whole surface.
    energy : float
        Weighted sum of the functionals, surface scaled to unit area.
    length : float
        Length of the new interface in the units of the surface: perimeter / sqrt(2).
    violation : float
        Relative violation of the area constraint.
    iterations, evaluations : int
        Steps and evaluations, over all stages.
    converged : bool
        Whether the last stage converged within its limit of steps.
    components : (int, int)
        Components of the two sharp segments as the solver left them.
    repairs : int
        Times that crumbs were turned over and the node, or its next stage, solved again.
    relabelled_faces : int
        Faces of small crumbs, which got the label of what surrounds them.
    relabelled_area : float
        Their part of the area of the node.
    level_set : float
        Value of u, averaged over a face, that separates the sharp segments.
    """

    level: int
    node: int
    energy: float
    length: float
    violation: float
    iterations: int
    evaluations: int
    converged: bool
    components: tuple[int, int]
    repairs: int
    relabelled_faces: int
    relabelled_area: float
    level_set: float


@dataclass(frozen=True)
class _Settings:
    """What all nodes share; lengths relative to sqrt(area)."""

    epsilon: float
    coarsest: float | None
    delta: float
    eta: float
    sigma: float
    kappa: float
    connected: bool
    area: AreaConstraint
    penalty: float
    distortion: float
    law: Literal["sharp", "paper"]
    initial: Initial
    seed: int
    solver: Solver
    max_iterations: int


@dataclass(frozen=True)
class _Node:
    """One node to split, self-contained so that any executor can take it."""

    surface: Surface
    settings: _Settings
    level: int
    index: int
    weight: Floats | None
    faces: NDArray[np.bool_]
    initial: Floats | None


@dataclass(frozen=True)
class _Split:
    u: Floats
    positive: NDArray[np.bool_]
    diagnostics: Diagnostics


@dataclass(frozen=True, eq=False)
class SegmentTree:
    """A binary tree of phase fields and the segments at its leaves.

    Node `i` of level `k` has the children `2 i` (u > 0) and `2 i + 1` (u < 0) on level `k + 1`.

    Attributes
    ----------
    surface : Surface
        The surface as given.
    levels : int
        Number of levels; there are 2**levels leaves.
    epsilon : float
        Interface width in the units of the surface.
    delta : float
        Half width of the plateaus of the indicator chi.
    fields : (2**levels - 1, n) array
        Phase fields, level by level.
    labels : (m,) array of int
        Leaf of each face. Labels descend the tree, so that those of a level are the labels of
        the next divided by two: at each node a face goes to the child of larger weight, up to
        the `level_set` of the node that balances the areas and its relabelled faces.
    diagnostics : tuple of Diagnostics
        One for each field.
    """

    surface: Surface
    levels: int
    epsilon: float
    delta: float
    fields: Floats
    labels: Ints
    diagnostics: tuple[Diagnostics, ...]

    @cached_property
    def weights(self) -> Floats:
        """Diffuse indicators of the leaves, (2**levels, n): a partition of unity."""
        return self.weights_at(self.levels)

    def weights_at(self, level: int) -> Floats:
        """Diffuse indicators chi^alpha of a level, (2**level, n), section 4 of the paper.

        Raises
        ------
        ValueError
            For a level outside 0..levels.
        """
        self._check_level(level)
        weights = np.ones((1, self.surface.n_vertices))
        for k in range(level):
            fields = self.fields[2**k - 1 : 2 ** (k + 1) - 1]
            positive = indicator(fields, self.delta)
            children = np.stack([weights * positive, weights * (1 - positive)], axis=1)
            weights = children.reshape(2 ** (k + 1), -1)
        return weights

    def labels_at(self, level: int) -> Ints:
        """Node of each face on a level, (m,).

        Raises
        ------
        ValueError
            For a level outside 0..levels.
        """
        self._check_level(level)
        return self.labels >> (self.levels - level)

    @cached_property
    def areas(self) -> Floats:
        """Areas of the sharp leaves, (2**levels,), in the units of the surface squared."""
        return np.bincount(
            self.labels, weights=self.surface.face_areas, minlength=2**self.levels
        ).astype(np.float64)

    @cached_property
    def components(self) -> Ints:
        """Number of connected components of each sharp leaf, (2**levels,)."""
        parts = _core.label_components(self.surface._mesh, self.labels)
        _, first = np.unique(parts, return_index=True)
        return np.bincount(self.labels[first], minlength=2**self.levels)

    @cached_property
    def interface_length(self) -> float:
        """Length of the edges between different leaves, in the units of the surface."""
        f, k = np.nonzero(self.surface.face_neighbours >= 0)
        g = self.surface.face_neighbours[f, k]
        seam = (f < g) & (self.labels[f] != self.labels[g])
        f, k = f[seam], k[seam]
        ends = self.surface.vertices[
            np.stack([self.surface.faces[f, k], self.surface.faces[f, (k + 1) % 3]])
        ]
        return float(np.linalg.norm(ends[0] - ends[1], axis=1).sum())

    def save(self, path: str | PathLike[str]) -> None:
        """Write the tree to an `.npz` file, whole or not at all.

        The keys are vertices, faces, fields, weights, labels, levels, epsilon, delta,
        diagnostics (JSON) and format.
        """
        arrays: dict[str, Any] = {
            "vertices": self.surface.vertices,
            "faces": self.surface.faces,
            "fields": self.fields,
            "weights": self.weights,
            "labels": self.labels,
            "levels": self.levels,
            "epsilon": self.epsilon,
            "delta": self.delta,
            "diagnostics": json.dumps([asdict(d) for d in self.diagnostics]),
            "format": _FORMAT,
        }
        with write_whole(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **arrays)

    @staticmethod
    def load(path: str | PathLike[str]) -> SegmentTree:
        """Read a tree that `save` wrote.

        Raises
        ------
        ValueError
            For a file that is no segmentation, or of a newer format.
        FileNotFoundError
            For a missing file.
        """
        try:
            with np.load(Path(path), allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
            version = int(arrays["format"])
            if version <= _FORMAT:
                return _tree(arrays)
        except FileNotFoundError:
            raise
        except Exception as error:
            reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            raise ValueError(f"{path}: no segmentation: {reason}") from error
        raise ValueError(f"{path}: format {version} is newer than {_FORMAT}")

    def _check_level(self, level: int) -> None:
        if not 0 <= level <= self.levels:
            raise ValueError(f"level: {level} must be in 0..{self.levels}")


def _tree(arrays: dict[str, Any]) -> SegmentTree:
    """Tree of the arrays of a file, checked for what a damaged or foreign one may hold."""
    records = json.loads(str(arrays["diagnostics"]))
    for record in records:
        record["components"] = tuple(record["components"])
    surface = Surface(arrays["vertices"], arrays["faces"])
    if not 1 <= int(arrays["levels"]) <= 16:
        raise ValueError(f"levels: {int(arrays['levels'])} must be in 1..16")
    levels, labels = int(arrays["levels"]), arrays["labels"]
    shapes = {
        "fields": (2**levels - 1, surface.n_vertices),
        "labels": (surface.n_faces,),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name}: shape {arrays[name].shape}, expected {shape}")
    if not np.issubdtype(labels.dtype, np.integer):
        raise ValueError(f"labels: dtype {labels.dtype}, expected an integer")
    if not np.isfinite(arrays["fields"]).all():
        raise ValueError("fields: not all finite")
    if not 0 <= float(arrays["delta"]) < 1:
        raise ValueError(f"delta: {float(arrays['delta'])} must be in [0, 1)")
    if labels.min() < 0 or labels.max() >= 2**levels:
        raise ValueError(f"labels: outside 0..{2**levels - 1}")
    return SegmentTree(
        surface=surface,
        levels=levels,
        epsilon=float(arrays["epsilon"]),
        delta=float(arrays["delta"]),
        fields=arrays["fields"],
        labels=labels,
        diagnostics=tuple(Diagnostics(**record) for record in records),
    )


def segment(
    surface: Surface,
    levels: int = 1,
    *,
    epsilon: float | None = None,
    epsilon_start: float | None = None,
    connected: bool = True,
    kappa: float = 1.0,
    delta: float | None = None,
    eta: float = 0.0,
    sigma: float = 1.0,
    area: AreaConstraint = "lagrangian",
    penalty: float = 100.0,
    distortion: float = 0.0,
    law: Literal["sharp", "paper"] = "sharp",
    initial: Initial | ArrayLike = "auto",
    seed: int = 0,
    solver: Solver = "lbfgs",
    max_iterations: int = 5000,
    executor: Executor | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> SegmentTree:
    """Cut a surface into 2**levels segments of equal area and little interface length.

    Each segment is split in two by minimising P[u] + epsilon^-kappa (C[u] + C[-u]) under
    A[u] = half of its area: problem (6) of the paper, weighted with the segment's diffuse
    indicator as in (10). The surface is scaled to unit area first.

    Parameters
    ----------
    surface : Surface
    levels : int, default 1
        Depth of the binary tree.
    epsilon : float, optional
        Interface width in the units of the surface; twice the mean edge length by default. The
        profile takes 2.8 epsilon from -0.9 to 0.9.
    epsilon_start : float, optional
        Where the continuation starts, halving from there; a fifth of the square root of the
        segment's area by default, `epsilon` where `initial` is an array. `epsilon` itself turns
        continuation off.
    connected : bool, default True
        Use the connectedness functional, and require every sharp segment to be connected.
    kappa : float, default 1
        Exponent of the weight of the connectedness functional.
    delta : float, optional
        Half width of the plateaus of the indicator chi; a tenth of epsilon / sqrt(area) by
        default.
    eta : float, default 0
        Added to the parent's indicator in the perimeter, equation (7).
    sigma : float, default 1
        Penalty outside the parent, equation (7), with the surface scaled to unit area. A field
        fades to 0 where its parent's indicator falls below about epsilon / sigma: with much
        less, siblings would mix along the whole border of their parent.
    area : {"lagrangian", "penalty", "none"}
        Meet the areas to 1e-5 by an augmented Lagrangian, or with Ipopt to 1e-8 as a constraint,
        only penalise their deviation, or leave them free.
    penalty : float, default 100
        Weight of the quadratic penalty on the relative deviation of the area, half of whose
        square it multiplies; the first weight of the augmented Lagrangian.
    distortion : float, default 0
        Weight omega of the conformal distortion, equation (13), with the surface scaled to unit
        area; 0 leaves it out.
    law : {"sharp", "paper"}
        Of the distortion; see `functionals.Distortion`.
    initial : {"auto", "random", "normals"} or array, default "auto"
        Random values in [-1, 1], two clusters of normals, or fields of shape (n,) for the root
        or (2**levels - 1, n) for all nodes. "auto" is "random" without distortion, and with it
        the best of three solves: from random values, from the split along a principal axis of the
        normals that is best after a few steps, and from the segments of least perimeter.
    seed : int, default 0
        Of the random values.
    solver : {"lbfgs", "ipopt"}
        L-BFGS, or Ipopt from the extra `ipopt`: Newton steps with the exact Hessian where neither
        connectedness nor distortion takes part, limited memory where they do.
    max_iterations : int, default 5000
        Limit on the steps of each stage of a node.
    executor : concurrent.futures.Executor, optional
        Runs the nodes of a level side by side; the result does not depend on it.
    progress : callable, optional
        Called with a `Progress` after each step; with an executor, after each node.

    Returns
    -------
    SegmentTree

    Raises
    ------
    ValueError
        For an argument that cannot be used.
    DisconnectedError
        Where `connected` was asked for and a segment stays in pieces.
    CollapsedError
        Where a phase is empty, for want of an area constraint or of faces.

    Warns
    -----
    RuntimeWarning
        For each node whose solve did not converge.
    """
    length = float(np.sqrt(surface.area))
    settings = _settings(
        epsilon=(2 * surface.mean_edge_length if epsilon is None else epsilon) / length,
        coarsest=None if epsilon_start is None else epsilon_start / length,
        connected=connected,
        kappa=kappa,
        delta=delta,
        eta=eta,
        sigma=sigma,
        area=area,
        penalty=penalty,
        distortion=distortion,
        law=law,
        initial=initial if isinstance(initial, str) else "auto",
        seed=seed,
        solver=solver,
        max_iterations=max_iterations,
    )
    if not 1 <= levels <= 16:
        raise ValueError(f"levels: {levels} must be in 1..16")
    if 2**levels > surface.n_faces:
        raise ValueError(f"levels: {levels} asks for more segments than {surface.n_faces} faces")
    starts = _given_fields(surface, levels, initial)
    unit = surface.scaled(1 / length)

    fields: list[Floats] = []
    diagnostics: list[Diagnostics] = []
    labels = np.zeros(surface.n_faces, dtype=np.int64)
    weights: list[Floats | None] = [None]
    for level in range(levels):
        nodes = [
            _Node(
                surface=unit,
                settings=settings,
                level=level,
                index=index,
                weight=weights[index],
                faces=labels == index,
                initial=starts.get(2**level - 1 + index),
            )
            for index in range(2**level)
        ]
        labels = 2 * labels
        children: list[Floats | None] = []
        for node, split in zip(nodes, _run(nodes, executor, progress), strict=True):
            fields.append(split.u)
            diagnostics.append(split.diagnostics)
            if not split.diagnostics.converged:
                warnings.warn(_unconverged(split.diagnostics), RuntimeWarning, stacklevel=2)
            labels[node.faces & ~split.positive] += 1
            inside = 1.0 if node.weight is None else node.weight
            chi = indicator(split.u, settings.delta)
            children += [inside * chi, inside * (1 - chi)]
        weights = children

    return SegmentTree(
        surface=surface,
        levels=levels,
        epsilon=settings.epsilon * length,
        delta=settings.delta,
        fields=np.stack(fields),
        labels=labels,
        diagnostics=tuple(_in_units(d, length) for d in diagnostics),
    )


def _settings(
    *,
    epsilon: float,
    coarsest: float | None,
    delta: float | None,
    sigma: float,
    solver: Solver,
    **others: Any,
) -> _Settings:
    positive = {
        "epsilon": epsilon,
        "epsilon_start": coarsest,
        "sigma": sigma,
        "penalty": others["penalty"],
    }
    for name, value in positive.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name}: {value} must be a positive number")
    if coarsest is not None and coarsest < epsilon:
        raise ValueError(f"epsilon_start: must be at least epsilon, {coarsest / epsilon:g} of it")
    for name in ("eta", "kappa", "distortion"):
        if not (np.isfinite(others[name]) and others[name] >= 0):
            raise ValueError(f"{name}: {others[name]} must be a number of at least 0")
    for name, least in {"seed": 0, "max_iterations": 1}.items():
        if others[name] < least:
            raise ValueError(f"{name}: {others[name]} must be at least {least}")
    if epsilon >= 1:
        raise ValueError(f"epsilon: {epsilon:g} times the square root of the area; must be below 1")
    if solver not in _MINIMISE:
        raise ValueError(f"solver: {solver!r} must be one of {tuple(_MINIMISE)}")
    if solver == "ipopt":
        ipopt.require()
    if others["initial"] not in INITIALS:
        raise ValueError(f"initial: {others['initial']!r} must be an array or one of {INITIALS}")
    if others["law"] not in ("sharp", "paper"):
        raise ValueError(f'law: {others["law"]!r} must be "sharp" or "paper"')
    if others["area"] not in AREA_CONSTRAINTS:
        raise ValueError(f"area: {others['area']!r} must be one of {AREA_CONSTRAINTS}")
    delta = epsilon / 10 if delta is None else delta
    if not 0 <= delta < 1:
        raise ValueError(f"delta: {delta} must be in [0, 1)")
    return _Settings(
        epsilon=epsilon,
        coarsest=coarsest,
        delta=delta,
        sigma=sigma,
        solver=solver,
        **others,
    )


def _given_fields(surface: Surface, levels: int, initial: Initial | ArrayLike) -> dict[int, Floats]:
    if isinstance(initial, str):
        return {}
    fields = np.asarray(initial, dtype=np.float64)
    shapes = [(surface.n_vertices,), (2**levels - 1, surface.n_vertices)]
    if fields.shape not in shapes:
        raise ValueError(f"initial: shape {fields.shape}, expected {shapes[0]} or {shapes[1]}")
    fields = fields.reshape(-1, surface.n_vertices)
    return {i: surface.vector("initial", field) for i, field in enumerate(fields)}


def _run(
    nodes: Sequence[_Node],
    executor: Executor | None,
    progress: Callable[[Progress], None] | None,
) -> list[_Split]:
    # Set here too: limits that overlapping threads set and reset would undo one another.
    with threadpool_limits(1, user_api="blas"):
        if executor is None:
            return [_split(node, progress) for node in nodes]
        futures = [executor.submit(_split, node) for node in nodes]
        splits = []
        for node, future in zip(nodes, futures, strict=True):
            try:
                split = future.result()
            except BaseException:
                for other in futures:
                    other.cancel()
                raise
            splits.append(split)
            if progress is not None:
                done = split.diagnostics
                progress(
                    Progress(
                        node.level + 1,
                        node.index,
                        node.settings.epsilon,
                        done.iterations,
                        done.energy,
                    )
                )
        return splits


def _split(node: _Node, progress: Callable[[Progress], None] | None = None) -> _Split:
    """Split one node: continuation in epsilon, then the check of the sharp segments."""
    # OpenBLAS shares sums over more than 10,000 terms among its threads: the sums then depend on
    # their number, and threads that spin beside those of the core cost far more than they give.
    with threadpool_limits(1, user_api="blas"):
        support = _support(node)
        if support is None:
            return _solve(node, progress)
        part, vertices, faces = support
        split = _solve(part, progress)
        u = np.zeros(node.surface.n_vertices)
        u[vertices] = split.u
        positive = np.zeros(node.surface.n_faces, dtype=np.bool_)
        positive[faces] = split.positive
        return replace(split, u=u, positive=positive)


def _support(node: _Node) -> tuple[_Node, Ints, Ints] | None:
    """The node on the part of the surface that its indicator reaches, its vertices and faces.

    With all faces within two rings of a vertex where w > 0, no term that u enters is lost: further
    off u is 0. Only paths far outside the parent are, and s is 0 at the border of the part, where
    the penalty of equation (12) has made it so. None where that part is the whole surface or in
    pieces.
    """
    surface = node.surface
    if node.weight is None:
        return None
    reached = node.weight > 0
    reached[surface.faces[node.faces]] = True
    for _ in range(2):
        reached[surface.faces[reached[surface.faces].any(axis=1)]] = True
    covered = np.all(reached[surface.faces], axis=1)
    inside = _with_whole_fans(surface, covered)
    parts = _core.label_components(surface._mesh, inside.astype(np.int64))[inside]
    if inside.all() or parts.min() != parts.max():
        return None
    faces = np.flatnonzero(inside)
    vertices, corners = np.unique(surface.faces[faces], return_inverse=True)
    part = replace(
        node,
        surface=Surface(surface.vertices[vertices], corners.reshape(-1, 3)),
        weight=node.weight[vertices],
        faces=node.faces[faces],
        initial=None if node.initial is None else node.initial[vertices],
    )
    return part, vertices, faces


def _with_whole_fans(surface: Surface, inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Add the faces around each vertex where the set of faces touches itself, until none is left.

    The faces at a vertex less the edges between them are the fans that they form.
    """
    neighbours = surface.face_neighbours
    while True:
        between = (neighbours >= 0) & inside[:, None] & inside[neighbours]
        fans = np.bincount(surface.faces[inside].reshape(-1), minlength=surface.n_vertices)
        # Each edge between two faces is seen from both, at one of its ends each time.
        fans -= np.bincount(surface.faces[between], minlength=surface.n_vertices)
        pinched = fans > 1
        if not pinched.any():
            return inside
        inside = inside | pinched[surface.faces].any(axis=1)


def _solve(node: _Node, progress: Callable[[Progress], None] | None) -> _Split:
    """Split a node; where distortion leaves it in pieces, again from its shortest interface."""
    try:
        return _attempt(node, progress)
    except DisconnectedError:
        if node.settings.distortion == 0 or node.initial is not None:
            raise
    settings = replace(node.settings, distortion=0.0)
    shortest = _attempt(replace(node, settings=settings), progress)
    return _attempt(replace(node, initial=shortest.u), progress)


def _attempt(node: _Node, progress: Callable[[Progress], None] | None) -> _Split:
    solver = _NodeSolver(node, progress)
    solver.solve()
    positive, level_set = solver.sharp()
    found = _count_components(node, positive)
    if min(found) == 0:
        raise CollapsedError(
            f"level {node.level + 1}, node {node.index}: the "
            f"{'positive' if found[0] == 0 else 'negative'} phase is empty; the area is off by "
            f"{100 * solver.violation:.2g} % of its target"
        )
    crumbs = np.zeros_like(positive)
    if node.settings.connected:
        crumbs = _crumbs(node, positive)
        for k in range(_REPAIR_ROUNDS):
            if not solver.repair(crumbs, positive):
                break
            solver.resolve(_REPAIR_GROWTH ** (k + 1))
            positive, level_set = solver.sharp()
            crumbs = _crumbs(node, positive)
        if not _small(node, crumbs):
            raise DisconnectedError(
                f"level {node.level + 1}, node {node.index}: {100 * _share(node, crumbs):.2g} % of "
                f"the area is cut off from the segments after {solver.repairs} rounds of repair"
            )
        positive = positive ^ crumbs
        components = _count_components(node, positive)
        if components != (1, 1):
            raise DisconnectedError(
                f"level {node.level + 1}, node {node.index}: the two segments have "
                f"{components[0]} and {components[1]} components"
            )
    return _Split(
        u=solver.u,
        positive=positive,
        diagnostics=Diagnostics(
            level=node.level,
            node=node.index,
            energy=solver.energy,
            length=solver.length(),
            violation=solver.violation,
            iterations=solver.iterations,
            evaluations=solver.evaluations,
            converged=solver.converged,
            components=found,
            repairs=solver.repairs,
            relabelled_faces=int(crumbs.sum()),
            relabelled_area=_share(node, crumbs),
            level_set=level_set,
        ),
    )


class _NodeSolver:
    """The solves of one node and what is built once for all of them."""

    def __init__(self, node: _Node, progress: Callable[[Progress], None] | None) -> None:
        self.node = node
        self.progress = progress
        surface = node.surface
        self.inside = np.ones(surface.n_vertices) if node.weight is None else node.weight
        self.diagonal = surface.stiffness.diagonal()
        self.area = Area(
            surface, node.settings.epsilon, delta=node.settings.delta, weight=node.weight
        )
        self.size = float(np.sqrt(self.area.total))
        self.u = np.zeros(surface.n_vertices) if node.initial is None else node.initial
        self.multiplier = 0.0
        self.penalty = node.settings.penalty
        self.energy = np.nan
        self.violation = np.nan
        self.iterations = 0
        self.evaluations = 0
        self.repairs = 0
        self.converged = False

    def solve(self) -> None:
        """Halve epsilon down to its value, each stage from the minimiser of the last."""
        stages, settings = self._stages(), self.node.settings
        if self.node.initial is not None or settings.distortion == 0:
            if self.node.initial is None:
                self._start(stages)
            self._descend(stages)
            return
        # None of these is the best start everywhere, and a wide interface does not tell.
        starts: dict[str, list[Callable[[float], None]]] = {
            "random": [self._parted_noise],
            "normals": [self._clustered],
            "auto": [self._parted_noise, self._split_by_normals, self._shortest],
        }
        best: tuple[Any, ...] = (np.inf,)
        for start in starts[settings.initial]:
            self.multiplier, self.penalty = 0.0, settings.penalty
            start(stages[0])
            self._descend(stages)
            if self.energy < best[0]:
                best = (
                    self.energy,
                    self.u,
                    self.multiplier,
                    self.penalty,
                    self.violation,
                    self.converged,
                )
        self.energy, self.u, self.multiplier, self.penalty, self.violation, self.converged = best

    def _descend(self, stages: list[float]) -> None:
        for k, epsilon in enumerate(stages):
            last = k == len(stages) - 1
            self._stage(epsilon, last=last)
            if self.node.settings.connected and not last:
                # A coarse stage is cheap to repair: what it leaves apart would have to grow a
                # bridge, or melt, on the finer ones.
                self.repair(*self._found_crumbs())

    def resolve(self, weight: float) -> None:
        """Solve again from the present field with a heavier connectedness term."""
        self._stage(
            self.node.settings.epsilon,
            weight=weight,
            last=True,
            max_iterations=min(_REPAIR_STEPS, self.node.settings.max_iterations),
        )

    def _start(self, stages: list[float]) -> None:
        """Set the field without distortion to start from; drop the stages that are done."""
        self.u = (
            _clusters(self.node) if self.node.settings.initial == "normals" else _noise(self.node)
        )
        if len(stages) > 1:
            # The widest interface is found by its perimeter alone: noise has hundreds of
            # components.
            self._stage(stages.pop(0), alone=True)

    def _clustered(self, _: float) -> None:
        """Set two clusters of normals."""
        self.u = _clusters(self.node)

    def _parted_noise(self, epsilon: float) -> None:
        """Set random values after the few steps in which they part into a labyrinth of phases."""
        self.u = _noise(self.node)
        self._stage(0.5 * epsilon, alone=True, max_iterations=_NOISE_STEPS)

    def _split_by_normals(self, epsilon: float) -> None:
        """Set the split along the principal axis of the normals that is best after some steps."""
        rivals = [(0.0, u, 0.0, self.penalty) for u in _splits_of_normals(self.node, self.inside)]
        steps = _START_STEPS
        while len(rivals) > 1:
            tried = []
            for _, self.u, self.multiplier, self.penalty in rivals:
                self._stage(epsilon, max_iterations=steps)
                tried.append((self.energy, self.u, self.multiplier, self.penalty))
            tried.sort(key=lambda rival: rival[0])
            rivals = tried[: len(tried) // 2]
            steps *= 2
        if rivals:
            _, self.u, self.multiplier, self.penalty = rivals[0]

    def _shortest(self, epsilon: float) -> None:
        """Set the field of least perimeter."""
        self.u = _noise(self.node)
        for stage in self._halved(epsilon, self.size * _COARSEST):
            self._stage(stage, alone=True)

    def _stages(self) -> list[float]:
        settings = self.node.settings
        if settings.coarsest is not None:
            coarsest = settings.coarsest
        elif self.node.initial is not None:
            coarsest = 0.0
        else:
            coarsest = self.size * (_COARSEST_DISTORTED if settings.distortion > 0 else _COARSEST)
        return self._halved(settings.epsilon, coarsest)

    def _halved(self, epsilon: float, coarsest: float) -> list[float]:
        """Halving widths down to `epsilon`, from at most `coarsest`."""
        stages = [epsilon]
        while 2 * stages[0] <= coarsest:
            stages.insert(0, 2 * stages[0])
        return stages

    def _stage(
        self,
        epsilon: float,
        *,
        last: bool = False,
        alone: bool = False,
        weight: float = 1.0,
        max_iterations: int | None = None,
    ) -> None:
        """Minimise at one interface width; the perimeter `alone`, or all functionals."""
        node, settings = self.node, self.node.settings
        terms: list[tuple[float, Any]] = [(1.0, self._perimeter(epsilon))]
        if settings.connected and not alone:
            connectedness = Connectedness(
                node.surface,
                epsilon,
                weight=node.weight,
                # Only these become segments: a bridge through a neighbour's faces is none.
                inside=node.faces,
                threshold=_THRESHOLD,
                plateau=_PLATEAU,
                saturation=epsilon**2,
                form="tree",
            )
            terms.append((weight * epsilon**-settings.kappa, connectedness))
        if settings.distortion > 0 and not alone:
            distortion = Distortion(
                node.surface,
                epsilon,
                law=settings.law,
                delta=settings.delta,
                weight=node.weight,
            )
            terms.append((settings.distortion, distortion))
        mass = node.surface.mass
        # The diagonal of the perimeter's Hessian at the pure phases, Psi''(1) = 9/2.
        hessian = (self.inside + settings.eta) * (epsilon * self.diagonal + 4.5 / epsilon * mass)
        hessian += 2 / settings.sigma * (1 - self.inside) * mass
        before = self.iterations

        def report(iteration: Iteration) -> None:
            if self.progress is not None:
                self.progress(
                    Progress(
                        node.level + 1,
                        node.index,
                        epsilon,
                        before + iteration.number,
                        iteration.energy,
                    )
                )

        result = _MINIMISE[settings.solver](
            terms,
            self.area,
            0.5 * self.area.total,
            self.u,
            scale=np.sqrt(hessian),
            # The perimeter alone, with the areas free, would shrink to one phase.
            area="lagrangian" if alone and settings.area == "none" else settings.area,
            multiplier=self.multiplier,
            penalty=self.penalty,
            max_iterations=settings.max_iterations if max_iterations is None else max_iterations,
            callback=report,
            **self._tolerances(last),
        )
        self.u = result.u
        self.multiplier = result.multiplier
        self.penalty = result.penalty
        self.energy = result.energy
        self.violation = result.violation
        self.iterations += result.iterations
        self.evaluations += result.evaluations
        self.converged = result.converged

    def _tolerances(self, last: bool) -> dict[str, Any]:
        settings = self.node.settings
        if not last:
            return _COARSE[settings.solver]
        return _DISTORTED[settings.solver] if settings.distortion > 0 else {}

    def _perimeter(self, epsilon: float) -> Perimeter:
        settings = self.node.settings
        return Perimeter(
            self.node.surface,
            epsilon,
            weight=self.node.weight,
            eta=settings.eta,
            sigma=settings.sigma,
        )

    def length(self) -> float:
        """Length of the interface: the weighted perimeter without its confinement, over sqrt 2."""
        confinement = (1 - self.inside) @ (self.node.surface.mass * self.u**2)
        value, _ = self._perimeter(self.node.settings.epsilon).value_and_gradient(self.u)
        return float(value - confinement / self.node.settings.sigma) / float(np.sqrt(2))

    def sharp(self) -> tuple[NDArray[np.bool_], float]:
        """Faces of the positive segment, (m,), and the level set that bounds them.

        The level is the one that halves the area of the node's faces: 0, by symmetry, but for
        the size of a face, which the finest segments feel. Where the area is only penalised,
        or free, it is 0. Where that level would tear a segment which the connectedness
        functional holds together, it is the nearest that the functional sees beyond.
        """
        node, settings = self.node, self.node.settings
        values = node.surface.face_mean(self.u)
        faces = np.flatnonzero(node.faces)
        level = 0.0
        if settings.area == "lagrangian":
            order = np.argsort(-values[faces], kind="stable")
            areas = np.cumsum(node.surface.face_areas[faces[order]])
            half = int(np.argmin(np.abs(areas - 0.5 * areas[-1])))
            level = float(values[faces[order[half]]])
        positive = node.faces & (values >= level)
        held = float(np.clip(level, -_THRESHOLD, _THRESHOLD))
        if settings.connected and level != held and _count_components(node, positive) != (1, 1):
            level = held
            positive = node.faces & (values >= level)
        return positive, level

    def repair(self, crumbs: NDArray[np.bool_], positive: NDArray[np.bool_]) -> bool:
        """Give the vertices of crumbs the value of the other phase, if there is enough of them."""
        if _small(self.node, crumbs):
            return False
        faces = self.node.surface.faces
        u = self.u.copy()
        u[faces[crumbs & positive]] = -1.0
        u[faces[crumbs & ~positive]] = 1.0
        self.u = u
        self.repairs += 1
        return True

    def _found_crumbs(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        positive, _ = self.sharp()
        return _crumbs(self.node, positive), positive


def _rng(node: _Node) -> np.random.Generator:
    return np.random.default_rng([node.settings.seed, node.level, node.index])


def _noise(node: _Node) -> Floats:
    return _rng(node).uniform(-1, 1, node.surface.n_vertices)


def _clusters(node: _Node) -> Floats:
    """Two clusters of normals."""
    normals = node.surface.vertex_normals
    members = np.unique(node.surface.faces[node.faces])
    if np.ptp(normals[members], axis=0).max() < _SAME_NORMALS:
        raise ValueError('initial: "normals" needs normals that differ; this surface is flat')
    _, cluster = scipy.cluster.vq.kmeans2(normals[members], 2, minit="++", rng=_rng(node))
    u = np.zeros(node.surface.n_vertices)
    u[members] = np.where(cluster == 0, 1.0, -1.0)
    return u


def _splits_of_normals(node: _Node, inside: Floats) -> list[Floats]:
    """Fields that halve the area along each principal axis of the normals, widest first."""
    normals = node.surface.vertex_normals
    measure = inside * node.surface.mass
    _, axes = np.linalg.eigh((normals * measure[:, None]).T @ normals)
    splits = []
    for axis in axes.T[::-1]:
        along = normals @ axis
        order = np.argsort(along, kind="stable")
        below = np.cumsum(measure[order])
        along -= along[order[np.searchsorted(below, 0.5 * below[-1])]]
        width = float(np.sqrt(measure @ along**2 / below[-1]))
        if width > _SAME_NORMALS:
            splits.append(np.tanh(_SPLIT_SLOPE * along / width))
    return splits


def _parts(node: _Node, positive: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Side of each face (0 and 1 in the node, -1 outside) and its component."""
    sides = np.where(node.faces, np.where(positive, 0, 1), -1)
    return sides, _core.label_components(node.surface._mesh, sides)


def _count_components(node: _Node, positive: NDArray[np.bool_]) -> tuple[int, int]:
    sides, parts = _parts(node, positive)
    return len(np.unique(parts[sides == 0])), len(np.unique(parts[sides == 1]))


def _crumbs(node: _Node, positive: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Faces to move to the other side so that both sides connect, where the node does.

    All components but the largest of the positive side move; then all but the largest of what
    the negative side has become.
    """
    moved = np.zeros_like(positive)
    for side in (0, 1):
        sides, parts = _parts(node, positive ^ moved)
        mine = np.flatnonzero(sides == side)
        if len(mine) == 0:
            continue
        areas = np.bincount(parts[mine], weights=node.surface.face_areas[mine])
        moved[mine[parts[mine] != np.argmax(areas)]] ^= True
    return moved


def _small(node: _Node, crumbs: NDArray[np.bool_]) -> bool:
    return bool(crumbs.sum() <= _CRUMB_FACES) or _share(node, crumbs) <= _CRUMB_SHARE


def _share(node: _Node, faces: NDArray[np.bool_]) -> float:
    areas = node.surface.face_areas
    return float(areas[faces].sum() / areas[node.faces].sum())


def _unconverged(diagnostics: Diagnostics) -> str:
    return (
        f"level {diagnostics.level + 1}, node {diagnostics.node}: not converged after "
        f"{diagnostics.iterations} iterations, the area is off by {diagnostics.violation:.1e}"
    )


def _in_units(diagnostics: Diagnostics, length: float) -> Diagnostics:
    return replace(diagnostics, length=diagnostics.length * length)
