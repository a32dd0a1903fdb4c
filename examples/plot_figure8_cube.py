"""
A rounded cube
==============

All Gauss curvature of a cube with rounded edges sits on its eight corners. With the distortion
in the objective the border does not follow the edges of the cube: it crosses the corners, where it
lets the flattening relax the curvature, and stays short in between. The charts are flattened
conformally, so the lines of the texture meet at right angles, and its squares on the cube have
nearly one size.

The radius gives the paper's largest curvature, 3.12 on a cube of side 2; omega = 10 is in these
units, which is omega times the square root of the area on a surface of unit area.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure8.png"
import numpy as np
from gallery import parser, planar, save, table

import phaseatlas as pa
from phaseatlas import datasets, plot
from phaseatlas.atlas import bake as texture

arguments = parser(__file__, __doc__).parse_args()
size = 140 if arguments.quick else 300
direction = (1.0, 0.62, 0.72)

cube = datasets.rounded_cube(20 if arguments.quick else 40, side=2.0, radius=0.566)
curvature = cube.angle_defects / cube.mass
shown = plot.scalar_colors(curvature, low=0, high=3.12, colormap="viridis")
above = [(*plot.render(cube, shown, views=1, size=size, direction=direction), "Gauss curvature")]

rows = []
for omega in (0.0, 10.0):
    tree = pa.segment(cube, distortion=omega * np.sqrt(cube.area))
    (u,) = tree.fields
    # The diffuse interface as a density on the vertices: Psi(u) has its bulk there.
    on_interface = cube.mass * (1 - u**2) ** 2
    atlas = pa.build_atlas(tree)
    metrics = atlas.metrics()
    rows.append(
        {
            "omega": omega,
            "length": tree.diagnostics[0].length,
            "mean K on the interface": float(on_interface @ curvature / on_interface.sum()),
            "yamabe": metrics["yamabe"],
            "hencky": metrics["hencky"],
            "qc": metrics["qc"],
            "pieces": int(tree.components.sum()),
        }
    )
    for k, view in enumerate(
        plot.render(cube, plot.scalar_colors(u), size=size, direction=direction)
    ):
        above.append((view, f"omega = {omega:g}" + ", other side" * k))
table(rows)
print(f"mean K of the surface  {4 * np.pi / cube.area:.4g}")

# %%
# A texture on the plane of each chart and on the cube; the blending weights join the two.
checker = texture.checker(size=512, squares=4)
tiles = 4 / np.sqrt(cube.area)
below = []
extent = max(np.ptp(chart.uv, axis=0).max() for chart in atlas.charts)
for chart in atlas.charts:
    flat = planar(chart)
    uv = tiles * chart.uv[chart.triangles]
    tall = max(16, int(size * np.ptp(chart.uv[:, 1]) / extent))
    (view,) = plot.render_textured(flat, uv, checker, views=1, size=tall, direction=(0, 0, 1))
    below.append((view, f"chart {chart.segment}"))
baked = atlas.bake(checker, resolution=512 if arguments.quick else 2048)
for k, view in enumerate(
    plot.render_textured(cube, atlas.uv, baked, size=size, direction=direction)
):
    below.append((view, "texture" + ", other side" * k))

save(arguments.folder, "figure8", [above, below])
