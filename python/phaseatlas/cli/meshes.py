"""phaseatlas info and phaseatlas remesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options
from .output import check_output
from .report import say_surface

__all__ = ["info", "remesh"]


def remesh(
    mesh: options.Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.obj, .ply, .glb, .off or .stl.")
    ],
    edge_length: options.EdgeLength = None,
    feature_angle: options.FeatureAngle = 45.0,
    strict: options.Strict = False,
) -> None:
    """Remesh a mesh with even triangles; coarse or uneven ones segment better for it."""
    from ..io import MESH_SUFFIXES, load, save_mesh
    from ..remesh import remesh as remesh_surface

    check_output(output, [mesh], *MESH_SUFFIXES)
    surface = remesh_surface(load(mesh), edge_length, feature_angle)
    save_mesh(surface, output)
    say_surface(surface)


def info(mesh: options.Mesh) -> None:
    """Print what a mesh is: size, topology, area, edge lengths, quality."""
    from ..io import load

    say_surface(load(mesh))
