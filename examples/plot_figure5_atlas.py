"""
Atlases of a model
==================

Above, the segments of K = 2, 3 and 4 levels of one hierarchy, each the weighted mean of the
colours of its indicators, and below them their charts: the domains where an indicator is positive,
flattened, so that the colours of the neighbours show along the borders where charts overlap.

Then a texture, carried to the surface by the charts. Thresholded, every point takes the chart of
its segment and the texture breaks at the borders; blended with the indicators as weights, it
fades from one chart to the next. For this the interface is three times as wide as it need be.

Last, the descent that splits one of the segments of level 3.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure5.png"
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from gallery import descend, parser, phase_pieces, save, table
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter
from scipy.spatial import cKDTree

import phaseatlas as pa
from phaseatlas import datasets, plot
from phaseatlas.atlas import bake as texture
from phaseatlas.atlas.metrics import uv_topology

arguments = parser(__file__, __doc__)
arguments.add_argument("--model", type=Path, help="a mesh; a starfish by default")
arguments = arguments.parse_args()
size = 120 if arguments.quick else 300

if arguments.model is None:
    surface = datasets.starfish(4 if arguments.quick else 5)
else:
    surface = pa.load(arguments.model)
h = surface.mean_edge_length


def cut(levels, epsilon):
    with ThreadPoolExecutor(2) as pool:
        return pa.segment(surface, levels, epsilon=epsilon, executor=pool)


def picture_of_charts(atlas, colours):
    """The domains of the charts in a grid, (size, w, 3); `colours` (n, 3) at the vertices."""
    columns = 2 ** ((len(atlas.charts).bit_length()) // 2)
    cell = 1.06 * max(np.ptp(chart.uv, axis=0).max() for chart in atlas.charts)
    polygons, filled = [], []
    for i, chart in enumerate(atlas.charts):
        centre = 0.5 * (chart.uv.max(axis=0) + chart.uv.min(axis=0))
        place = np.array([i % columns + 0.5, -(i // columns) - 0.5]) * cell
        polygons.append((chart.uv - centre + place)[chart.triangles])
        filled.append(colours[chart.vertices[chart.triangles]].mean(axis=1))
    rows = -(-len(atlas.charts) // columns)
    figure = Figure(figsize=(size * columns / rows / 100, size / 100), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, columns * cell), ylim=(-rows * cell, 0))
    axes.set_axis_off()
    faces = np.concatenate(filled)
    axes.add_collection(
        PolyCollection(np.concatenate(polygons), facecolors=faces, edgecolors=faces, linewidths=0.3)
    )
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3] / 255.0


# %%
# One tree; each of its levels is a segmentation.
tree = cut(4, 2 * h)
segments, charts, rows = [], [], []
for level in (2, 3, 4):
    upper = tree.at(level)
    atlas = pa.build_atlas(upper)
    metrics = atlas.metrics()
    rows.append(
        {
            "K": level,
            "charts": len(atlas.charts),
            "pieces": int(upper.components.sum()),
            "largest/smallest area": float(upper.areas.max() / upper.areas.min()),
            "seam": metrics["seam"],
            "qc": metrics["qc"],
            "hencky": metrics["hencky"],
            "flips": metrics["flips"],
        }
    )
    colours = upper.weights.T @ plot.segment_colors(surface, upper.labels)
    (view,) = plot.render(surface, colours, views=1, size=size)
    segments.append((view, f"K = {level}"))
    charts.append((picture_of_charts(atlas, colours), f"charts of K = {level}"))
table(rows)

# %%
# A texture of pebbles that tiles: each texel takes the grey of the nearest of random points.
rng = np.random.default_rng(4)
points = rng.random((90, 2))
greys = rng.uniform(0.45, 1.0, 90)[:, None] * [1.0, 0.93, 0.82]
grid = np.stack(np.meshgrid(*2 * [(np.arange(512) + 0.5) / 512], indexing="ij"), axis=-1)
near, index = cKDTree(points, boxsize=1.0).query(grid, k=2)
pebbles = greys[index[..., 0]] * np.clip((near[..., 1:] - near[..., :1]) / 0.02, 0.25, 1.0)

wide = cut(2, 6 * h)
atlas = pa.build_atlas(wide)
seams = uv_topology(surface, atlas.uv).seams
face, side = np.nonzero(seams)
other = surface.face_neighbours[face, side]
other_side = np.argmax(surface.face_neighbours[other] == face[:, None], axis=1)


def middle(f, k):
    return 0.5 * (atlas.uv[f, k] + atlas.uv[f, (k + 1) % 3])


# The window of the zoom: where most of the interface is seen.
zoom, window = 4 * size, size
mixed = np.sqrt(1 - wide.weights.max(axis=0))
(seen,) = plot.render(surface, np.repeat(1 - mixed[:, None], 3, axis=1), views=1, size=zoom)
(flat,) = plot.render(surface, np.ones((surface.n_faces, 3)), views=1, size=zoom)
density = uniform_filter((flat - seen)[..., 0], window, mode="constant")
row, column = np.unravel_index(np.argmax(density), density.shape)
row = np.clip(row - window // 2, 0, zoom - window)
column = np.clip(column - window // 2, 0, density.shape[1] - window)

textured, rows = [], []
for blend in (False, True):
    name = "blended" if blend else "thresholded"
    baked = atlas.bake(pebbles, resolution=512 if arguments.quick else 2048, blend=blend)
    jump = texture.sample(baked, middle(face, side)) - texture.sample(
        baked, middle(other, other_side)
    )
    rows.append({"texture": name, "jump at the seams": float(np.abs(jump).mean())})
    (view,) = plot.render_textured(surface, atlas.uv, baked, views=1, size=zoom)
    if blend:
        (small,) = plot.render_textured(surface, atlas.uv, baked, views=1, size=size)
        textured.insert(0, (small, "blended texture"))
    textured.append((view[row : row + window, column : column + window], f"zoomed, {name}"))
print()
table(rows)

# %%
# The descent of the first node of level 3, drawn where its parent's indicator is.
unit = surface.scaled(surface.area**-0.5)
weight = tree.weights_at(3)[0]
# On the coarse surface, where a face is large, two of six starts leave a single one on its own.
seed = 2 if arguments.quick else 0
start = np.random.default_rng(seed).uniform(-1, 1, surface.n_vertices)
steps = [5, 15, 40]
fields, last = descend(unit, 2 * unit.mean_edge_length, start, steps, weight=weight)
descent, rows = [], []
# From the middle of the body towards the segment.
towards = surface.mass @ (weight[:, None] * surface.vertices) / (surface.mass @ weight)
towards -= surface.mass @ surface.vertices / surface.area
for step, u in zip([*steps, last], fields, strict=True):
    found = phase_pieces(unit, u, tree.labels_at(3) == 0)
    rows.append({"step": step, "red pieces": found[0], "blue pieces": found[1]})
    colours = weight[:, None] * plot.scalar_colors(u) + (1 - weight[:, None])
    (view,) = plot.render(surface, colours, views=1, size=4 * size // 5, direction=towards)
    descent.append((view, f"level 4, step {step}"))
print()
table(rows)

save(arguments.folder, "figure5", [segments, charts, textured, descent])
