"""phaseatlas info and phaseatlas remesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import options
from .output import check_output
from .process import Record, say
from .report import say_meshes, say_surface, say_written

__all__ = ["info", "remesh"]


def remesh(
    mesh: options.Mesh,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="OUT.obj, .ply, .glb, .off or .stl.")
    ],
    edge_length: options.EdgeLength = None,
    feature_angle: options.FeatureAngle = 45.0,
    strict: options.Strict = False,
) -> Record:
    """Remesh a mesh with even triangles; coarse or uneven ones segment better for it."""
    from ..io import MESH_SUFFIXES, load, save_mesh
    from ..remesh import remesh as remesh_surface

    check_output(output, [mesh], *MESH_SUFFIXES)
    surface = remesh_surface(load(mesh), edge_length, feature_angle)
    save_mesh(surface, output)
    say_surface(surface)
    say_written(output)
    from ..scene.describe import figures

    return {"input": str(mesh), "output": str(output), "files": [str(output)], **figures(surface)}


def info(mesh: options.Mesh) -> Record:
    """Print what a file of meshes holds: size, topology, defects, materials, textures, instances.

    Any file will do: what is no manifold is repaired first, and what that took is said.
    """
    from ..scene.describe import describe
    from ..scene.document import read_document
    from ..scene.scene import scene_in

    document = read_document(mesh)
    scene = scene_in(document)
    say_surface(scene)
    say_meshes(document.meshes, scene)
    say(*scene.report.sentences())
    return describe(document, scene)
