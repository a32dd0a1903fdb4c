"""
For engineers: many files, balanced patches
===========================================

Solvers on several machines, panels that cost the same, cluster trees of boundary-element methods:
they need patches that are connected and of the right sizes. This page cuts a folder of meshes into
patches for machines of unequal speed, checks what came out, and keeps it in files that NumPy
reads.
"""

# sphinx_gallery_thumbnail_number = 1
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import phaseatlas as pa
from phaseatlas import plot

folder = Path(tempfile.mkdtemp())

# %%
# A folder of meshes
# ------------------
# Files of your own would stand here.
shapes = {
    "torus": pa.datasets.torus(1.0, 0.4, 64, 26),
    "cube": pa.datasets.rounded_cube(16),
    "starfish": pa.datasets.starfish(4),
}
for name, surface in shapes.items():
    pa.save_mesh(surface, folder / f"{name}.obj")
files = sorted(folder.glob("*.obj"))
print([file.name for file in files])

# %%
# An atlas for each of them
# -------------------------
# ``phaseatlas batch`` takes files, folders and patterns, and makes atlases side by side, as many as
# fit into memory. One mesh that fails does not stop the others. Whatever ends a batch, ``--resume``
# goes on with what is missing, failed or changed. ``--dask ADDRESS`` lets a cluster do the work.
command = [sys.executable, "-m", "phaseatlas", "batch", folder, "-o", folder / "atlases"]
print(subprocess.run(command, capture_output=True, text=True, check=True).stdout)

# %%
# ``manifest.jsonl`` has a line of JSON for each mesh: what was made with which options, how long it
# took, and the :doc:`figures </metrics>` of the atlas.
for line in (folder / "atlases" / "manifest.jsonl").read_text().splitlines():
    record = json.loads(line)
    figures = record["metrics"]
    print(
        f"{Path(record['input']).name:13} {figures['charts']} charts, seam {figures['seam']:.2f}, "
        f"packing {figures['packing']:.0f} %"
    )

# %%
# Patches for machines of unequal speed
# -------------------------------------
# Three machines are to get one, two and three parts of the work. ``shares`` are any positive
# numbers. The fields are solved first with the area as a constraint; whole faces then follow to
# the size of a face.
shares = [1, 2, 3]


def patches(path):
    """Cut one mesh and keep the result beside it."""
    tree = pa.segment(pa.load(path), shares=shares)
    tree.save(path.with_suffix(".npz"))
    return tree


# The core gives the lock of Python back, so that two threads keep two cores busy. The results do
# not depend on the order or the number of threads.
with ThreadPoolExecutor(2) as pool:
    trees = list(pool.map(patches, files))

# %%
# Are they connected, and how far are the areas from what was asked for?
wanted = np.array(shares) / sum(shares)
print("mesh       pieces     shares of the area     worst miss  cut/sqrt(area)")
for file, tree in zip(files, trees, strict=True):
    got = tree.areas / tree.surface.area
    miss = np.abs(got / wanted - 1).max()
    cut = tree.interface_length / np.sqrt(tree.surface.area)
    print(f"{file.stem:10} {tree.components}    {np.round(got, 4)}    {miss:9.1e}   {cut:.2f}")
    assert tree.components.tolist() == [1, 1, 1]

# %%
# Look at them.
figure, axes = plt.subplots(1, len(trees), figsize=(10, 3.6), layout="constrained")
for axis, file, tree in zip(axes, files, trees, strict=True):
    (view,) = plot.render(tree.surface, tree.labels, views=1, size=360)
    axis.imshow(np.clip(view, 0, 1))
    axis.set_axis_off()
    axis.set_title(file.stem)

# %%
# What a solver needs
# -------------------
# Which faces does a machine get, and with which others does it exchange data? ``cluster_tree``
# gives a permutation that puts the faces of each patch side by side, and the length of the boundary
# between each pair of patches. :doc:`/engineering` has more, with outlines for a cutter.
tree = pa.SegmentTree.load(folder / "torus.npz")
clusters = tree.cluster_tree()
for leaf in clusters.leaves:
    first, last = clusters.ranges[leaf]
    print(f"node {leaf}: faces permutation[{first}:{last}]")
for (a, b), length in zip(clusters.neighbours, clusters.lengths, strict=True):
    print(f"patches {a} and {b} share a boundary of length {length:.2f}")

# %%
# The files are plain arrays, for programs that know nothing of this package. The weights are a
# partition of unity on the vertices: additive Schwarz methods blend the solutions of overlapping
# patches with them.
with np.load(folder / "torus.npz") as file:
    labels, weights = file["labels"], file["weights"]
print("faces of each patch", np.bincount(labels))
print("sum of the weights", weights.sum(axis=0).min(), "to", weights.sum(axis=0).max())
print("vertices in more than one patch", int(((weights > 0.01).sum(axis=0) > 1).sum()))
