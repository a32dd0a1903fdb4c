"""
Borders on negative curvature
=============================

A border in a valley or along a saddle lets the flattening relax the most, so with distortion in
the objective the segments of 'fertility' (epsilon = 0.02, unit area) meet where the Gauss
curvature is negative more often than for their length alone. Measured is the part of the diffuse
interface, density (1 - u^2)^2, that lies where K < 0, and the mean of K on it. K is the angle
defect over area after one backward step of diffusion over the length epsilon: single angle defects
of this coarse scan are noise. The part of the whole surface where K < 0 is what a border that does
not care would have.

First the curvature, purple where negative and orange where positive, then the segments without and
with distortion.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure9.png"
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from gallery import parser, save, table

import phaseatlas as pa
from phaseatlas import plot

arguments = parser(__file__, __doc__)
arguments.add_argument("--model", type=Path, default=Path("fertility.obj"), help="the mesh")
arguments.add_argument("--levels", type=int, default=2, help="of the hierarchy")
arguments.add_argument("--seeds", type=int, nargs="+", default=[0], help="of the start")
arguments = arguments.parse_args()
if not arguments.model.is_file():
    print(f"skipped: there is no {arguments.model}; give the mesh with --model")
    sys.exit()
size = 160 if arguments.quick else 360

surface = pa.load(arguments.model)
surface = surface.scaled(surface.area**-0.5)
epsilon = 0.02
levels = 1 if arguments.quick else arguments.levels
diffusion = scipy.sparse.diags_array(surface.mass) + epsilon**2 * surface.stiffness
curvature = scipy.sparse.linalg.spsolve(diffusion.tocsc(), surface.angle_defects)
negative = curvature < 0
print(f"epsilon / h {epsilon / surface.mean_edge_length:.3g}")
print(f"part of the surface where K < 0: {surface.mass @ negative:.3f}")

trials = [("sharp", 0.0), ("paper", 0.1), ("sharp", 0.1), ("sharp", 1.0), ("sharp", 10.0)]
trials = trials[:1] + trials[-1:] if arguments.quick else trials
rows, shown = [], {}


def cut(omega, law, seed):
    with ThreadPoolExecutor(2) as pool:
        return pa.segment(
            surface, levels, epsilon=epsilon, distortion=omega, law=law, seed=seed, executor=pool
        )


for law, omega in trials:
    for seed in arguments.seeds:
        row = {"law": law if omega else "-", "omega": omega, "seed": seed}
        rows.append(row)
        try:
            tree = cut(omega, law, seed)
        except pa.DisconnectedError as error:
            row |= {"length": "-", "interface on K < 0": "-", "mean K there": "-"}
            print(f"{law}, omega = {omega}, seed {seed}: {error}")
            continue
        interface = np.zeros(surface.n_vertices)
        for level in range(levels):
            nodes = slice(2**level - 1, 2 ** (level + 1) - 1)
            interface += (tree.weights_at(level) * (1 - tree.fields[nodes] ** 2) ** 2).sum(axis=0)
        interface *= surface.mass
        row["length"] = sum(d.length for d in tree.diagnostics)
        row["interface on K < 0"] = float(interface @ negative / interface.sum())
        row["mean K there"] = float(interface @ curvature / interface.sum())
        shown.setdefault(omega, tree)
table(rows)

limit = float(np.quantile(np.abs(curvature), 0.97))
colours = plot.scalar_colors(curvature, low=-limit, high=limit, colormap="PuOr_r")
panels = [[(*plot.render(surface, colours, views=1, size=size), "Gauss curvature")]]
for omega in sorted(shown)[:2]:
    tree = shown[omega]
    colours = tree.weights.T @ plot.segment_colors(surface, tree.labels)
    for k, view in enumerate(plot.render(surface, colours, size=size)):
        panels[0].append((view, f"omega = {omega:g}" + ", other side" * k))

save(arguments.folder, "figure9", panels)
