"""
For artists: a second UV set for a textured model
=================================================

A model has a texture already, and you want a clean layout beside it: for a light map, for
painting, for another engine. This page adds a second set of texture coordinates to a GLB file,
then moves the old texture into a new layout, and looks at both.

You need nothing but the command line. The model is made here, so that the page can run; take a
file of your own instead.
"""

# sphinx_gallery_thumbnail_number = -1
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from PIL import Image

import phaseatlas as pa
from phaseatlas import plot
from phaseatlas.scene.document import read_document

folder = Path(tempfile.mkdtemp())


def phaseatlas(*arguments):
    """Run a command as a shell would, and print what it prints."""
    print("$ phaseatlas", *arguments)
    command = [sys.executable, "-m", "phaseatlas", *arguments]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    print(run.stdout + run.stderr)
    run.check_returncode()


# %%
# A model with a texture
# ----------------------
# A starfish, coloured by a picture that is projected on it from above. Such a projection is quick
# to make and poor: steep sides get a smear of few texels, and the underside shares the texels of
# the top. That is good enough for colours, and useless for a light map.
body = pa.datasets.starfish(4)
low, high = body.vertices.min(axis=0), body.vertices.max(axis=0)
uv = ((body.vertices - low) / (high - low).max())[:, :2]
row, column = np.mgrid[0:256, 0:256] / 256
stripes = 0.5 + 0.5 * np.sin(40 * np.hypot(row - 0.5, column - 0.5))
picture = np.stack([0.9 * np.ones_like(row), 0.35 + 0.5 * stripes, 0.3 + 0.4 * row], axis=2)
image = Image.fromarray(np.uint8(255 * picture))
material = trimesh.visual.material.PBRMaterial(name="skin", baseColorTexture=image)
visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
trimesh.Trimesh(body.vertices, body.faces, visual=visual, process=False).export(
    folder / "model.glb"
)

# %%
# What does the file hold? ``info`` tells size, defects, materials and sets of coordinates.
phaseatlas("info", "model.glb")

# %%
# A new set beside the old one
# ----------------------------
# ``--uv-set 1`` writes the layout as the second set, ``TEXCOORD_1``. All else stays: the
# first set, the material, its texture. Only the vertices on the new seams are doubled. What is
# printed last rates the layout; :doc:`/metrics` says what each figure means.
phaseatlas("atlas", "model.glb", "-o", "two_sets.glb", "--uv-set", "1")

# %%
# Both sets are in the file now. Left is the old one: top and underside lie on each other. Right is
# the new one: each face has a place of its own.
document = read_document(folder / "two_sets.glb")
mesh, carried = document.meshes[0], document.corners(0)
sets = [np.asarray(each).reshape(-1, 3, 2) for each in carried.uvs]
figure, axes = plt.subplots(1, 2, figsize=(9, 4.6), layout="constrained")
titles = ("set 0: the projection", "set 1: the new layout")
for axis, corners, title in zip(axes, sets, titles, strict=True):
    axis.triplot(*corners.reshape(-1, 2).T, np.arange(3 * len(corners)).reshape(-1, 3), lw=0.2)
    axis.set(title=title, aspect="equal", xlim=(0, 1), ylim=(0, 1))

# %%
# The old texture in the new layout
# ---------------------------------
# ``--rebake`` carries the textures of the file to the new coordinates, which become the only ones
# that its materials use. Base colour, normals, roughness, occlusion and emission go along.
phaseatlas("atlas", "model.glb", "-o", "rebaked.glb", "--rebake", "--resolution", "1024")

# %%
# Look at it: above the texture of the file, below the model that it is on, before and after. The
# colours are the same. The projection spent its texels on the top and none on the sides; now they
# are even everywhere.
figure, axes = plt.subplots(2, 2, figsize=(9, 8), layout="constrained")
for (above, below), name in zip(axes.T, ("model.glb", "rebaked.glb"), strict=True):
    (mesh,) = trimesh.load(folder / name, process=False).geometry.values()
    picture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
    corners = mesh.visual.uv[mesh.faces]
    (view,) = plot.render_textured(
        pa.load(folder / name), corners, picture, views=1, size=420, direction=(0.5, -0.9, 0.4)
    )
    for axis, shown, title in ((above, picture, name), (below, np.clip(view, 0, 1), "")):
        axis.imshow(shown)
        axis.set(title=title)
        axis.set_axis_off()

# %%
# A page to look at
# -----------------
# ``view`` makes one file of HTML of it, which works from disk in any browser: the model to turn
# beside its layout, with buttons for texture, checker, charts, stretch and texel density.
phaseatlas("view", "rebaked.glb", "-o", "rebaked.html")

# %%
# Go on from here
# ---------------
# - ``--max-charts 6`` or ``--max-distortion 0.05`` for fewer charts or less stretch.
# - ``--padding 8`` for small mip levels; ``--resolution`` is the texture that it refers to.
# - ``--cut`` straightens seams by cutting faces: shorter seams, but a new mesh.
# - :doc:`Every option </generated/options>`, and :doc:`what is kept of a file </files>`.
