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
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from . import ipopt
from .arrays import Floats, Ints
from .bisection import (
    INITIALS,
    SOLVERS,
    CollapsedError,
    Diagnostics,
    DisconnectedError,
    Initial,
    Node,
    Progress,
    Settings,
    Solver,
    Split,
    bisect,
)
from .functionals import indicator
from .io import write_whole
from .optimise import AREA_CONSTRAINTS, AreaConstraint
from .segmentation import Segmentation
from .surface import Surface

__all__ = [
    "CollapsedError",
    "Diagnostics",
    "DisconnectedError",
    "Progress",
    "SegmentTree",
    "segment",
]

_FORMAT = 1


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

    def at(self, level: int) -> Segmentation:
        """Return the segments of a level, with `weights_at` and `labels_at` of it.

        Raises
        ------
        ValueError
            For a level outside 0..levels.
        """
        return Segmentation(self.surface, self.labels_at(level), self.weights_at(level))

    @cached_property
    def _leaves(self) -> Segmentation:
        return Segmentation(self.surface, self.labels, self.weights)

    @property
    def areas(self) -> Floats:
        """Areas of the sharp leaves, (2**levels,), in the units of the surface squared."""
        return self._leaves.areas

    @property
    def components(self) -> Ints:
        """Number of connected components of each sharp leaf, (2**levels,)."""
        return self._leaves.components

    @property
    def interface_length(self) -> float:
        """Length of the edges between different leaves, in the units of the surface."""
        return self._leaves.length

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
    coarse: bool = True,
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
        or (2**levels - 1, n) for all nodes. "auto" tries several starts on coarse surfaces and
        goes on from the best, that of least energy and with no segment in pieces: eight of random
        values; with distortion one of them, the split along a principal axis of the normals that is
        best after a few steps, and the segments of least perimeter.
    seed : int, default 0
        Of the random values.
    solver : {"lbfgs", "ipopt"}
        L-BFGS, or Ipopt from the extra `ipopt`: Newton steps with the exact Hessian where neither
        connectedness nor distortion takes part, limited memory where they do.
    max_iterations : int, default 5000
        Limit on the steps of each stage of a node.
    coarse : bool, default True
        Solve the stages of wide interfaces on simplified surfaces, whose edges are still about
        half of the interface width.
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
        coarse=coarse,
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
            Node(
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
) -> Settings:
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
    if solver not in SOLVERS:
        raise ValueError(f"solver: {solver!r} must be one of {tuple(SOLVERS)}")
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
    return Settings(
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
    nodes: Sequence[Node],
    executor: Executor | None,
    progress: Callable[[Progress], None] | None,
) -> list[Split]:
    # Set here too: limits that overlapping threads set and reset would undo one another.
    with threadpool_limits(1, user_api="blas"):
        if executor is None:
            return [bisect(node, progress) for node in nodes]
        futures = [executor.submit(bisect, node) for node in nodes]
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


def _unconverged(diagnostics: Diagnostics) -> str:
    return (
        f"level {diagnostics.level + 1}, node {diagnostics.node}: not converged after "
        f"{diagnostics.iterations} iterations, the area is off by {diagnostics.violation:.1e}"
    )


def _in_units(diagnostics: Diagnostics, length: float) -> Diagnostics:
    return replace(diagnostics, length=diagnostics.length * length)
