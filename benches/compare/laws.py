"""Which law of the distortion cuts better segments: sharp Yamabe energy at equal seam length.

    python benches/compare/laws.py MESH ... [--weights 0.1 0.3 1 3 10] [--levels 1] [--connected]

Each mesh is segmented with both laws and several weights omega. The energy that counts is that
of the sharp segments, u = 0 on their borders, which belongs to neither law. The weights of the two
laws do not compare, their segments of the same seam do: the last line is the geometric mean of the
ratio of the energies, paper / sharp, over the seams that both laws reach.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import phaseatlas as pa
from phaseatlas.atlas.metrics import uv_topology, yamabe_factors

LAWS: tuple[Literal["sharp"], Literal["paper"]] = ("sharp", "paper")


def yamabe_energy(surface: pa.Surface, labels: NDArray[np.int64]) -> float:
    """Integral of the squared log scale of the sharp segments over the area."""
    # A layout that is continuous within each segment and nowhere else.
    uv = np.stack(
        [surface.faces, np.broadcast_to(labels[:, None], surface.faces.shape)], axis=2
    ).astype(float)
    topology = uv_topology(surface, uv)
    factors = yamabe_factors(surface, topology)
    mass = np.bincount(
        topology.corner.reshape(-1),
        np.repeat(surface.face_areas / 3, 3),
        minlength=topology.n_vertices,
    )
    return float(mass @ factors**2 / surface.area)


def lower_envelope(points: list[tuple[float, float]]) -> NDArray[np.float64]:
    """Seams ascending with the least energy up to each."""
    rows = np.array(sorted(points))
    rows[:, 1] = np.minimum.accumulate(rows[:, 1])
    return rows


def ratio(curves: dict[str, list[tuple[float, float]]]) -> float:
    """Mean ratio of the energies, paper / sharp, over the seams that both reach."""
    sharp, paper = (lower_envelope(curves[law]) for law in LAWS)
    low, high = max(sharp[0, 0], paper[0, 0]), min(sharp[-1, 0], paper[-1, 0])
    if low >= high:
        return float("nan")
    seams = np.linspace(low, high, 50)
    logs = [np.interp(seams, c[:, 0], np.log(c[:, 1])) for c in (paper, sharp)]
    return float(np.exp((logs[0] - logs[1]).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare the laws of the distortion.")
    parser.add_argument("meshes", nargs="+", type=Path)
    parser.add_argument("--weights", nargs="+", type=float, default=[0.1, 0.3, 1.0, 3.0, 10.0])
    parser.add_argument("--levels", type=int, default=1)
    parser.add_argument("--connected", action="store_true")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)
    console = Console(width=100)
    for mesh in arguments.meshes:
        surface = pa.load(mesh)
        length = np.sqrt(surface.area)
        table = Table(title=mesh.stem)
        for heading in (
            "law",
            "omega",
            "seam / sqrt(area)",
            "Yamabe energy",
            "components",
            "seconds",
        ):
            table.add_column(heading, justify="right")
        curves: dict[str, list[tuple[float, float]]] = {}
        for law in LAWS:
            curves[law] = []
            for weight in arguments.weights:
                start = time.perf_counter()
                try:
                    tree = pa.segment(
                        surface,
                        arguments.levels,
                        distortion=weight,
                        law=law,
                        connected=arguments.connected,
                    )
                except (pa.DisconnectedError, pa.CollapsedError) as error:
                    table.add_row(law, f"{weight:g}", type(error).__name__)
                    continue
                point = tree.interface_length / length, yamabe_energy(surface, tree.labels)
                curves[law].append(point)
                table.add_row(
                    law,
                    f"{weight:g}",
                    f"{point[0]:.3f}",
                    f"{point[1]:.4g}",
                    " ".join(map(str, tree.components)),
                    f"{time.perf_counter() - start:.1f}",
                )
        console.print(table)
        if all(curves.values()):
            console.print(f"{mesh.stem}: energy at equal seam, paper / sharp: {ratio(curves):.3g}")


if __name__ == "__main__":
    main()
