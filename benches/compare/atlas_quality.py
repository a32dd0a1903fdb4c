"""Atlases of phaseatlas and of other tools, rated by the same figures in one run.

    python benches/compare/atlas_quality.py FOLDER_OF_MESHES [--output docs] [--only spot hand]

A tool that is not installed is left out: xatlas, uvunwrap, geotex, open3d (UVAtlas). Writes
`atlas_quality.md`, a table a mesh and the geometric means, and `atlas_quality.png`, seam against
distortion. Seconds are of the CPU, of a tool's own calls: neither start-up nor imports.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

import phaseatlas as pa
from phaseatlas.atlas.metrics import atlas_metrics
from phaseatlas.partitioning.partition import Effort

Uv = NDArray[np.float64]
Tool = Callable[[pa.Surface], Uv]

# Figures of `Atlas.metrics` in the table, and how many digits they are worth.
COLUMNS = {
    "charts": ".3g",
    "non_disk": "g",
    "seam": ".2f",
    "yamabe": ".5f",
    "qc": ".3f",
    "hencky": ".5f",
    "flips": "g",
    "overlap": ".2g",
    "packing": ".1f",
    "seconds": ".2f",
}
# Those with a geometric mean; the others have zeros.
MEANS = ("charts", "seam", "yamabe", "qc", "hencky", "packing", "seconds")


def by_energy(effort: Effort) -> Tool:
    return lambda surface: pa.build_atlas(pa.partition(surface, effort=effort)).uv


def by_tree(surface: pa.Surface) -> Uv:
    return pa.build_atlas(pa.segment(surface, 3, distortion=10.0)).uv


def cut(surface: pa.Surface) -> pa.Atlas:
    _, segmentation = pa.cut_along_seams(pa.partition(surface))
    return pa.build_atlas(segmentation, flatten="isometric")


def with_xatlas(surface: pa.Surface) -> Uv:
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(surface.vertices.astype(np.float32), surface.faces.astype(np.uint32))
    options = xatlas.PackOptions()
    options.padding, options.resolution = 4, 1024
    atlas.generate(pack_options=options)
    _, faces, uv = atlas[0]
    corners: Uv = uv[faces].astype(np.float64)
    return corners


def with_uvunwrap(surface: pa.Surface) -> Uv:
    import uvunwrap

    mesh = uvunwrap.Mesh(surface.vertices.reshape(-1).tolist(), surface.faces.reshape(-1).tolist())
    atlas = uvunwrap.generate([mesh])
    uv: Uv = np.array(atlas.meshes[0].corner_uvs, dtype=np.float64).reshape(-1, 3, 2)
    return uv


def with_geotex(surface: pa.Surface) -> Uv:
    import geotex

    uv = geotex.make_atlas(surface.vertices, surface.faces.astype(np.uint32))
    return np.asarray(uv, dtype=np.float64).reshape(-1, 3, 2)


def with_uvatlas(surface: pa.Surface) -> Uv:
    import open3d

    mesh = open3d.t.geometry.TriangleMesh(
        open3d.core.Tensor(surface.vertices.astype(np.float32)),
        open3d.core.Tensor(surface.faces.astype(np.int64)),
    )
    mesh.compute_uvatlas(size=1024, gutter=4.0)
    uv: Uv = mesh.triangle.texture_uvs.numpy().astype(np.float64)
    return uv


TOOLS: dict[str, Tool] = {
    "phaseatlas fast": by_energy("fast"),
    "phaseatlas": by_energy("normal"),
    "phaseatlas best": by_energy("best"),
    "phaseatlas, 8 equal areas, omega 10": by_tree,
    "xatlas": with_xatlas,
    "uvunwrap": with_uvunwrap,
    "geotex": with_geotex,
    "UVAtlas (open3d)": with_uvatlas,
}
NEEDS = {
    "xatlas": "xatlas",
    "uvunwrap": "uvunwrap",
    "geotex": "geotex",
    "UVAtlas (open3d)": "open3d",
}


def rated(tool: Tool, surface: pa.Surface) -> dict[str, float]:
    start = time.process_time()
    uv = tool(surface)
    seconds = time.process_time() - start
    return {**atlas_metrics(surface, uv), "seconds": seconds}


def rated_cut(surface: pa.Surface) -> dict[str, float]:
    """The cut surface is another one, so its atlas rates itself."""
    start = time.process_time()
    atlas = cut(surface)
    seconds = time.process_time() - start
    return {**atlas.metrics(), "seconds": seconds}


def table(title: str, rows: dict[str, dict[str, float]], columns: tuple[str, ...]) -> list[str]:
    lines = [
        f"## {title}",
        "",
        f"| tool | {' | '.join(columns)} |",
        "|---" * (len(columns) + 1) + "|",
    ]
    lines += [
        f"| {name} | {' | '.join(format(row[c], COLUMNS[c]) for c in columns)} |"
        for name, row in rows.items()
    ]
    return [*lines, ""]


def scatter(means: dict[str, dict[str, float]], path: Path) -> None:
    figure = Figure(figsize=(8, 5), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    own_names = [name for name in means if name.startswith("phaseatlas")]
    for name, row in means.items():
        own = name in own_names
        # Ours lie close together: their names stand in steps.
        step = 14 * own_names.index(name) if own else 0
        axes.scatter(row["seam"], row["hencky"], s=60, color="#c0392b" if own else "#5d6d7e")
        axes.annotate(name, (row["seam"], row["hencky"]), (8, 4 + step), textcoords="offset points")
    axes.margins(x=0.18, y=0.12)
    axes.set(yscale="log", xlabel="seam / sqrt(area)", ylabel="Hencky distortion")
    axes.set_title("Geometric means over the meshes; lower left is better")
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description="Rate atlases of several tools.")
    parser.add_argument("meshes", type=Path)
    parser.add_argument("--output", type=Path, default=Path("docs"))
    parser.add_argument("--only", nargs="*", help="names of meshes")
    parser.add_argument("--tools", nargs="*", default=list(TOOLS), help="all by default")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    tools = {
        name: tool
        for name, tool in TOOLS.items()
        if name in arguments.tools
        if name not in NEEDS or importlib.util.find_spec(NEEDS[name]) is not None
    }
    paths = [
        path
        for path in sorted(arguments.meshes.glob("*.obj"))
        if not arguments.only or path.stem in arguments.only
    ]
    found: dict[str, dict[str, dict[str, float]]] = {}
    lines: list[str] = []
    for path in paths:
        surface = pa.load(path)
        rows = {name: rated(tool, surface) for name, tool in tools.items()}
        rows["phaseatlas --cut"] = rated_cut(surface)
        found[path.stem] = rows
        lines += table(f"{path.stem}, {surface.n_faces} faces", rows, tuple(COLUMNS))
        print("\n".join(lines[-len(rows) - 5 :]), flush=True)
    names = list(next(iter(found.values())))
    means = {
        name: {
            column: float(
                np.exp(np.mean([np.log(max(rows[name][column], 1e-9)) for rows in found.values()]))
            )
            for column in MEANS
        }
        for name in names
    }
    head = ["# Atlases, rated", "", __doc__.split("\n\n")[0], ""]
    mean_lines = table(f"Geometric means over {', '.join(found)}", means, MEANS)
    text = "\n".join(
        [*head, *mean_lines, "![Seam against distortion](atlas_quality.png)", "", *lines]
    )
    (arguments.output / "atlas_quality.md").write_text(text)
    scatter(means, arguments.output / "atlas_quality.png")
    print("\n".join(mean_lines))


if __name__ == "__main__":
    main()
