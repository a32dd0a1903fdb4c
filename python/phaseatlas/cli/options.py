"""Every option of the command line, once."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

__all__ = [
    "Area",
    "AtlasDistortion",
    "AtlasLevels",
    "Charts",
    "Connected",
    "Creases",
    "Cut",
    "Density",
    "Distortion",
    "EdgeLength",
    "Effort",
    "Epsilon",
    "FeatureAngle",
    "Flatten",
    "Folder",
    "Formulation",
    "Initial",
    "Json",
    "Keep",
    "Levels",
    "MaxCharts",
    "MaxDistortion",
    "Mesh",
    "MeshOrNpz",
    "Mips",
    "Outlines",
    "Padding",
    "Pages",
    "Quiet",
    "Rebake",
    "Resolution",
    "SeamCost",
    "Seams",
    "Seed",
    "SegmentLevels",
    "Shares",
    "Solver",
    "Stack",
    "Strict",
    "Symmetry",
    "Texture",
    "Threads",
    "Udim",
    "Unit",
    "UvSet",
    "Verbose",
    "Weld",
    "parsed_shares",
]

Mesh = Annotated[
    Path, typer.Argument(metavar="MESH", help="Mesh: OBJ, PLY, STL, OFF, GLB or glTF.")
]
MeshOrNpz = Annotated[
    Path,
    typer.Argument(
        metavar="MESH",
        help="Mesh: OBJ, PLY, STL, OFF, GLB or glTF; or the .npz file of segment or atlas.",
    ),
]
Folder = Annotated[
    Path, typer.Argument(metavar="[FOLDER]", help="Where to write; made where missing.")
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Write the output, but exit with code 3 after warnings.")
]

# Of every command.
Json = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="[FILE.json|-]",
        help="Write a record of the run; with - to standard output, and nothing else there.",
        show_default="no record",
    ),
]
Quiet = Annotated[
    bool, typer.Option("-q", "--quiet", help="Print warnings and errors alone, no progress.")
]
Verbose = Annotated[
    bool, typer.Option("-v", "--verbose", help="Tell each step on the error stream.")
]
Threads = Annotated[
    int | None,
    typer.Option(help="Number of threads.", show_default="that of the cores", min=1),
]

# Of the segmentation.
Levels = Annotated[int, typer.Option(help="Depth of the binary tree: 2^levels segments.")]
SegmentLevels = Annotated[
    int | None, typer.Option(help="Depth of the binary tree: 2^levels segments.", show_default="3")
]
Shares = Annotated[
    str | None,
    typer.Option(
        help="Instead of --levels: areas of the segments in proportion, such as 1,2,4.",
        show_default="equal",
    ),
]
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
Seed = Annotated[int, typer.Option(help="Seed of what is random.")]

# Where seams may run.
SeamCost = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Vertex attribute of a PLY or glTF file: factors on the length of seams, cheap where "
        "they may run; COLOR_0 is the red of vertex colours.",
        show_default="1",
    ),
]
Seams = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Edges that must be cut: a text file with a path of vertex numbers from 0 in each "
        "line, or an OBJ file with l elements.",
    ),
]
Keep = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FACES",
        help="A region without seams: a material, a mesh, a property of PLY faces, or a text file "
        "of polygon numbers from 0. May be given several times.",
    ),
]
Creases = Annotated[
    float | None,
    typer.Option(
        metavar="ANGLE",
        help="Make edges sharper than this cheap for seams, in degrees.",
        show_default="none",
    ),
]

# Of the charts by energy.
AtlasLevels = Annotated[
    int | None,
    typer.Option(
        help="Take the 2^levels segments of equal area of the binary tree for charts.",
        show_default="charts by energy",
    ),
]
AtlasDistortion = Annotated[
    float | None,
    typer.Option(
        help="Weight of the distortion against the length of the seams, for unit area.",
        show_default="600; 0 with --levels",
    ),
]
MaxDistortion = Annotated[
    float | None,
    typer.Option(
        help="Bound on the root mean square log scale, 0.05 for texels that vary by 5 %.",
        show_default="none",
    ),
]
MaxCharts = Annotated[
    int | None, typer.Option(help="Bound on the number of charts.", show_default="none")
]
Effort = Annotated[
    Literal["fast", "normal", "best"], typer.Option(help="How long to search for better charts.")
]
Symmetry = Annotated[
    Literal["x", "y", "z"] | None,
    typer.Option(
        help="Cut along the plane of symmetry across this axis, and mirror the charts of one half.",
        show_default="none",
    ),
]
Stack = Annotated[
    bool, typer.Option("--stack", help="Lay mirrored charts over each other: half the texels.")
]

# Of the atlas.
Flatten = Annotated[
    Literal["isometric", "bff", "lscm"] | None,
    typer.Option(
        help="Chart map: least stretch, boundary-first, or least-squares conformal.",
        show_default="isometric; with --levels bff",
    ),
]
Cut = Annotated[
    bool,
    typer.Option(
        "--cut", help="Cut triangles along straightened seams: the mesh written is a new one."
    ),
]
Texture = Annotated[
    Path | None,
    typer.Option(
        help="Image repeated over the charts and blended, or the word checker.",
        show_default="no texture",
    ),
]
Rebake = Annotated[
    bool,
    typer.Option(
        "--rebake", help="Bake the file's own textures and colours into pictures of the atlas."
    ),
]
Padding = Annotated[
    int, typer.Option(help="Least distance between charts in texels of the last mip level.", min=0)
]
Mips = Annotated[
    int, typer.Option(help="Mip levels whose texels never touch two charts.", min=0, max=14)
]
Density = Annotated[
    float | None,
    typer.Option(
        help="Texels a unit length of the mesh; the resolution follows.", show_default="none"
    ),
]
Pages = Annotated[
    int, typer.Option(help="Number of textures that share the charts.", min=1, max=100)
]
Udim = Annotated[
    bool,
    typer.Option("--udim", help="Put the pages into UDIM tiles, 1001 and so on, and not into one."),
]
UvSet = Annotated[
    int | None,
    typer.Option(
        help="Set of texture coordinates to write in a glTF file, the others stay.",
        show_default="0, the old sets move up by one",
        min=0,
    ),
]
Weld = Annotated[
    float, typer.Option(help="Join vertices nearer than this, in the units of the mesh.", min=0.0)
]
Resolution = Annotated[
    int | None,
    typer.Option(
        help="Side of the baked texture in texels.",
        show_default="1024, or what --density needs",
        min=32,
        max=16384,
    ),
]

# Beside the atlas.
Charts = Annotated[
    Path | None,
    typer.Option(help="Write FILE.glb, too: a mesh for each overlapping chart, with its weight."),
]
Outlines = Annotated[
    Path | None,
    typer.Option(help="Write FILE.svg or .dxf, too: the flat charts 1:1, with matching notches."),
]
Unit = Annotated[
    Literal["mm", "cm", "m", "in", "ft"] | None,
    typer.Option(
        help="Unit of the mesh, for --outlines.", show_default="m for GLB and glTF, else mm"
    ),
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


def parsed_shares(text: str | None) -> tuple[float, ...] | None:
    """Numbers of an option; ValueError for anything but two or more positive ones."""
    if text is None:
        return None
    try:
        shares = tuple(float(number) for number in text.split(","))
    except ValueError:
        shares = ()
    if len(shares) < 2 or not all(0 < share < math.inf for share in shares):
        raise ValueError(f"shares: {text!r} must be two or more positive numbers, such as 1,2,4")
    return shares
