"""
Charts of least energy
======================

What `phaseatlas atlas` makes of a model without any option: the charts that cost least in seam,
cuts and distortion together, each a disk whose map is a bijection, flattened with least stretch.
The checker is as even on fingers and legs as on backs, since the charts open along limbs. Left is
the packed layout, each chart in a colour of its own, right the surface from two sides.

The table has the lengths of the seams in roots of the area; yamabe, the mean squared log scale of
the conformal maps, rates the charts, and hencky, after flattening, the layout.
"""

# sphinx_gallery_thumbnail_path = "gallery/charts.png"
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from gallery import parser, save, table
from PIL import Image

import phaseatlas as pa
from phaseatlas import plot

arguments = parser(__file__, __doc__)
arguments.add_argument("--model", type=Path, nargs="+", default=[], help="the meshes")
arguments = arguments.parse_args()
size = 160 if arguments.quick else 420
resolution = 256 if arguments.quick else 2048

surfaces = {path.stem: pa.load(path) for path in arguments.model}
if not surfaces:
    surfaces = {"starfish": pa.datasets.starfish(3 if arguments.quick else 5)}

rows, shown = [], []
for name, surface in surfaces.items():
    charts = pa.partition(surface)
    atlas = pa.build_atlas(charts)
    checker = atlas.bake(resolution=resolution, blend=False)
    with TemporaryDirectory() as folder:
        plot.uv_layout(atlas, checker, Path(folder, "layout.png"), size=size)
        picture = np.asarray(Image.open(Path(folder, "layout.png")).convert("RGB"))
    shown.append([(picture, name)])
    figures = atlas.metrics()
    rows.append({"model": name} | {key: figures[key] for key in ("charts", "seam", "yamabe")})
    rows[-1] |= {key: figures[key] for key in ("qc", "hencky", "flips", "overlap", "packing")}

table(rows)
save(arguments.folder, "charts", shown)
