"""Types of the Rust core; every argument is a C-contiguous array of the type named here."""

from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BYTES_PER_TEXEL",
    "MAX_RESOLUTION",
    "Area",
    "Bake",
    "Connectedness",
    "CutChart",
    "Distortion",
    "LimitedMemory",
    "Perimeter",
    "Placement",
    "ScaledMap",
    "TriangleMesh",
    "__version__",
    "available_memory",
    "bff",
    "cut_chart",
    "label_components",
    "lscm",
    "pack",
    "parse_obj",
    "rasterize",
    "sample",
]

__version__: str
BYTES_PER_TEXEL: int
MAX_RESOLUTION: int

@final
class TriangleMesh:
    def __new__(
        cls, vertices: NDArray[np.float64], faces: NDArray[np.int64], *, accepted: bool = False
    ) -> TriangleMesh: ...
    def areas(self) -> NDArray[np.float64]: ...
    def diameters(self) -> NDArray[np.float64]: ...
    def mass(self) -> NDArray[np.float64]: ...
    def angle_defects(self) -> NDArray[np.float64]: ...
    def on_border(self) -> NDArray[np.bool_]: ...
    def edges(self) -> NDArray[np.int64]: ...
    def neighbours(self) -> NDArray[np.int64]: ...
    def edge_stiffness(self, weight: NDArray[np.float64] | None = None) -> NDArray[np.float64]: ...
    @property
    def euler_characteristic(self) -> int: ...
    @property
    def genus(self) -> int: ...
    @property
    def n_boundary_loops(self) -> int: ...
    @property
    def mean_edge_length(self) -> float: ...

@final
class LimitedMemory:
    def __new__(cls, n: int, capacity: int) -> LimitedMemory: ...
    def __len__(self) -> int: ...
    def clear(self) -> None: ...
    def update(self, step: NDArray[np.float64], change: NDArray[np.float64]) -> bool: ...
    def direction(self, gradient: NDArray[np.float64]) -> NDArray[np.float64]: ...

@final
class Perimeter:
    def __new__(
        cls,
        mesh: TriangleMesh,
        epsilon: float,
        weight: NDArray[np.float64] | None = None,
        eta: float = 0.0,
        sigma: float = 1.0,
    ) -> Perimeter: ...
    def value_and_gradient(self, u: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]: ...
    def hessian(
        self, u: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

@final
class Area:
    def __new__(
        cls, mesh: TriangleMesh, delta: float, weight: NDArray[np.float64] | None = None
    ) -> Area: ...
    @property
    def total(self) -> float: ...
    def value_and_gradient(self, u: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]: ...
    def hessian(self, u: NDArray[np.float64]) -> NDArray[np.float64]: ...

@final
class Connectedness:
    def __new__(
        cls,
        mesh: TriangleMesh,
        threshold: float,
        weight: NDArray[np.float64] | None = None,
        phase: Literal["both", "positive", "negative"] = "both",
        form: Literal["pairs", "tree"] = "pairs",
        saturation: float | None = None,
        plateau: float = 1.0,
        inside: NDArray[np.bool_] | None = None,
    ) -> Connectedness: ...
    def value_and_gradient(self, u: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]: ...
    def components(self, u: NDArray[np.float64]) -> tuple[int, int]: ...

@final
class Distortion:
    def __new__(
        cls,
        mesh: TriangleMesh,
        epsilon: float,
        law: Literal["paper", "sharp"],
        delta: float,
        eta: float,
        weight: NDArray[np.float64] | None = None,
    ) -> Distortion: ...
    def value_and_gradient(self, u: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]: ...
    def log_scale(
        self, u: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

def label_components(mesh: TriangleMesh, labels: NDArray[np.int64]) -> NDArray[np.int64]: ...

@final
class CutChart:
    @property
    def mesh(self) -> TriangleMesh: ...
    @property
    def triangles(self) -> NDArray[np.int64]: ...
    @property
    def vertices(self) -> NDArray[np.int64]: ...
    @property
    def euler_characteristic(self) -> int: ...
    @property
    def length(self) -> float: ...

@final
class ScaledMap:
    @property
    def uv(self) -> NDArray[np.float64]: ...
    @property
    def log_scale(self) -> NDArray[np.float64]: ...

def cut_chart(mesh: TriangleMesh, faces: NDArray[np.int64]) -> CutChart: ...
def lscm(mesh: TriangleMesh) -> NDArray[np.float64]: ...
def bff(mesh: TriangleMesh) -> ScaledMap: ...

@final
class Placement:
    @property
    def low(self) -> NDArray[np.int64]: ...
    @property
    def turns(self) -> NDArray[np.int64]: ...

def pack(
    triangles: NDArray[np.float64], starts: NDArray[np.int64], gap: float, trials: int
) -> Placement: ...
def rasterize(
    uv: NDArray[np.float64], resolution: int
) -> tuple[NDArray[np.int32], NDArray[np.uint8]]: ...
def parse_obj(
    text: bytes,
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]: ...

@final
class Bake:
    def __new__(
        cls,
        uv: NDArray[np.float64],
        faces: NDArray[np.int64],
        triangles: NDArray[np.int64],
        places: NDArray[np.float64],
        weights: NDArray[np.float64] | None,
        scale: float,
        resolution: int,
        background: tuple[int, int, int],
    ) -> Bake: ...
    @property
    def n_tiles(self) -> int: ...
    def places(self, tile: int) -> NDArray[np.float64]: ...
    def paint_values(self, tile: int, values: NDArray[np.float64]) -> None: ...
    def paint_image(self, tile: int, image: NDArray[np.uint8] | NDArray[np.float64]) -> None: ...
    def finish(self, padding: int | None = None) -> NDArray[np.uint8]: ...

def sample(
    image: NDArray[np.uint8] | NDArray[np.float64], places: NDArray[np.float64]
) -> NDArray[np.float64]: ...
def available_memory() -> int: ...
