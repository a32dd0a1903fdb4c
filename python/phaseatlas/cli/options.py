"""Every option of the command line, once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

__all__ = [
    "Area",
    "Connected",
    "Distortion",
    "EdgeLength",
    "Epsilon",
    "FeatureAngle",
    "Flatten",
    "Folder",
    "Formulation",
    "Initial",
    "Levels",
    "Mesh",
    "Resolution",
    "Seed",
    "Solver",
    "Strict",
    "Texture",
]

Mesh = Annotated[
    Path, typer.Argument(metavar="MESH", help="Triangle mesh: OBJ, PLY, STL, OFF, GLB, ...")
]
Folder = Annotated[
    Path, typer.Argument(metavar="[FOLDER]", help="Where to write; made where missing.")
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Write the output, but exit with code 3 after warnings.")
]

# Of the segmentation.
Levels = Annotated[int, typer.Option(help="Depth of the binary tree: 2^levels segments.")]
Connected = Annotated[
    bool, typer.Option("--connected/--no-connected", help="Keep every segment in one piece.")
]
Epsilon = Annotated[
    float | None,
    typer.Option(
        help="Interface width in the units of the mesh.", show_default="2 mean edge lengths"
    ),
]
Distortion = Annotated[
    float,
    typer.Option(
        help="Weight of the conformal distortion against the interface length, for unit area."
    ),
]
Formulation = Annotated[
    Literal["sharp", "paper"],
    typer.Option("--law", help="Of the distortion: how a phase confines its map."),
]
Area = Annotated[
    Literal["lagrangian", "penalty", "none"],
    typer.Option(help="Meet equal areas, only penalise their deviation, or leave them free."),
]
Solver = Annotated[Literal["lbfgs", "ipopt"], typer.Option(help="Optimiser.")]
Initial = Annotated[
    Literal["auto", "random", "normals"],
    typer.Option(
        help="Start: the best of several, one of random values, or two clusters of normals."
    ),
]
Seed = Annotated[int, typer.Option(help="Seed of the random start.")]

# Of the atlas.
Flatten = Annotated[
    Literal["isometric", "bff", "lscm"],
    typer.Option(help="Chart map: isometric, boundary-first, or least-squares conformal."),
]
Texture = Annotated[
    Path | None,
    typer.Option(help="Image repeated over the charts and blended.", show_default="a checker"),
]
Resolution = Annotated[
    int, typer.Option(help="Side of the baked texture in texels.", min=32, max=16384)
]

# Of remeshing.
EdgeLength = Annotated[
    float | None,
    typer.Option(
        help="Target edge length in the units of the mesh.",
        show_default="the mean, or less for 10,000 vertices",
    ),
]
FeatureAngle = Annotated[
    float, typer.Option(help="Keep creases sharper than this, in degrees; 180 keeps none.")
]
