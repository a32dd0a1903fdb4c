"""
Width of the interface, and connectedness
=========================================

The interface width epsilon is a choice: the profile of a minimiser takes 2.8 epsilon from -0.9 to
0.9, whatever its place. Above, a sphere is cut into halves with a wide, a middling and a narrow
interface. The diffuse perimeter over the square root of two tends to the length of the equator.

Below, a descent with the connectedness functional on a starfish, from random values: the phases
are born in many pieces, which the functional joins by paths and then draws together, while the
perimeter shortens.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure2.png"
import numpy as np
from gallery import descend, parser, phase_pieces, save, table

import phaseatlas as pa
from phaseatlas import datasets, plot

arguments = parser(__file__, __doc__).parse_args()
size = 150 if arguments.quick else 300

# %%
# The sweep. Lengths are those of a sphere of radius 1, whose equator is 2 pi = 6.283 long.
sphere = datasets.icosphere(4 if arguments.quick else 6)
above, rows = [], []
for epsilon in [0.4, 0.2, 0.1] if arguments.quick else [0.2, 0.1, 0.05]:
    tree = pa.segment(sphere, epsilon=epsilon, connected=False)
    (u,) = tree.fields
    # Across the equator u runs along the meridians, at unit speed: the width can be read off.
    axis = sphere.mass @ (u[:, None] * sphere.vertices)
    angle = np.arcsin(sphere.vertices @ (axis / np.linalg.norm(axis)))
    width = np.interp([-0.9, 0.9], np.sort(u), angle[np.argsort(u)])
    rows.append(
        {
            "epsilon": epsilon,
            "epsilon/h": epsilon / sphere.mean_edge_length,
            "width/epsilon": float(np.ptp(width) / epsilon),
            "length": tree.diagnostics[0].length,
        }
    )
    # Seen from a point of the equator.
    towards = np.cross(axis, [0.3, 0.5, 1.0])
    (view,) = plot.render(
        sphere, plot.scalar_colors(u), views=1, size=size, direction=towards.tolist()
    )
    above.append((view, f"epsilon = {epsilon:g}"))
table(rows)

# %%
# The flow. The paper starts from random values and keeps epsilon fixed; so does this.
starfish = datasets.starfish(4)
unit = starfish.scaled(starfish.area**-0.5)
start = np.random.default_rng(1).uniform(-1, 1, unit.n_vertices)
steps = [10, 30, 60]
fields, last = descend(unit, 2 * unit.mean_edge_length, start, steps)
below, rows = [], []
for step, u in zip([*steps, last], fields, strict=True):
    found = phase_pieces(unit, u)
    rows.append({"step": step, "red pieces": found[0], "blue pieces": found[1]})
    (view,) = plot.render(starfish, plot.scalar_colors(u), views=1, size=size)
    below.append((view, f"step {step}"))
print()
table(rows)

save(arguments.folder, "figure2", [above, below])
