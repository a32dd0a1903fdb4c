"""
Hierarchy on a sphere
=====================

Each segment is cut into two halves of equal area, then each of those again: a binary tree. Its
nodes have the colours of their segments on the levels K = 1, 2 and 3. A sphere's first three cuts
are great circles at right angles, or nearly, since each level is found with the ones above fixed.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure3.png"
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from gallery import count_pieces, parser, save, table
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import phaseatlas as pa
from phaseatlas import datasets, plot

arguments = parser(__file__, __doc__).parse_args()
size = 130 if arguments.quick else 280
direction = (0.9, 0.5, 0.7)

sphere = datasets.icosphere(4 if arguments.quick else 5)
with ThreadPoolExecutor(2) as pool:
    tree = pa.segment(sphere, levels=3, executor=pool)

rows = []
for level in (1, 2, 3):
    labels = tree.labels_at(level)
    areas = np.bincount(labels, weights=sphere.face_areas) / sphere.area
    rows.append(
        {
            "K": level,
            "segments": len(areas),
            "pieces": count_pieces(sphere, labels).sum(),
            "smallest area x 2^K": float(areas.min() * 2**level),
            "largest area x 2^K": float(areas.max() * 2**level),
            "new length": sum(d.length for d in tree.diagnostics if d.level == level - 1),
        }
    )
table(rows)

# %%
# The tree: node i of level k is the colour 2^k - 2 + i.
colours = plot.palette(14)
inches = size / 100
figure = Figure(figsize=(1.35 * inches, inches), dpi=100, facecolor="white")
canvas = FigureCanvasAgg(figure)
axes = figure.add_axes((0, 0, 1, 1), xlim=(-0.05, 1.05), ylim=(-3.4, 0.4))
axes.set_axis_off()
place = [(np.arange(2**level) + 0.5) / 2**level for level in range(4)]
for level in (1, 2, 3):
    for i, x in enumerate(place[level]):
        axes.plot([place[level - 1][i // 2], x], [1 - level, -level], color="0.6", zorder=0)
    axes.scatter(place[level], np.full(2**level, -level), s=0.6 * size, zorder=1,
                 c=colours[2**level - 2 :][: 2**level], edgecolors="0.2")  # fmt: skip
axes.scatter(place[0], [0], s=0.6 * size, c="white", edgecolors="0.2")
canvas.draw()
panels = [(np.asarray(canvas.buffer_rgba())[..., :3] / 255.0, "the tree")]

# %%
# The weights of a level are a partition of unity: they blend the colours across the borders.
for level in (1, 2, 3):
    blended = tree.weights_at(level).T @ colours[2**level - 2 :][: 2**level]
    (view,) = plot.render(sphere, blended, views=1, size=size, direction=direction)
    panels.append((view, f"K = {level}"))

save(arguments.folder, "figure3", [panels])
