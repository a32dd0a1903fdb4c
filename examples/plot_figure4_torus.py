"""
A torus, with and without connectedness
=======================================

From random values at a narrow interface, without the wide ones first, the perimeter alone ends on
this torus in a local minimum of four rings, two a phase: each ring is as short as it can be, so
nothing moves any more. The connectedness functional sees that the phases are in pieces and leads
the same start to two half rings.

Below, the descent that splits one of the two halves further, on the second level of the
hierarchy: the field lives where its parent's indicator does and fades to 0 elsewhere.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure4.png"
import numpy as np
from gallery import descend, parser, phase_pieces, save, table

import phaseatlas as pa
from phaseatlas import datasets, plot

arguments = parser(__file__, __doc__).parse_args()
size = 110 if arguments.quick else 280
direction = (0.0, -0.8, 1.0)

torus = datasets.torus(1.0, 0.15, 128, 20)
epsilon = 2 * torus.mean_edge_length
above, rows = [], []
for connected in (False, True):
    # With epsilon_start at epsilon there is no continuation, and with a single start no choice.
    tree = pa.segment(
        torus,
        epsilon=epsilon,
        epsilon_start=epsilon,
        connected=connected,
        initial="random",
        seed=5,
    )
    found = tree.components
    rows.append(
        {
            "C": "with" if connected else "without",
            "red pieces": found[0],
            "blue pieces": found[1],
            "length": tree.diagnostics[0].length,
        }
    )
    (view,) = plot.render(
        torus, plot.scalar_colors(tree.fields[0]), views=1, size=size, direction=direction
    )
    above.append((view, f"{rows[-1]['C']} C: {found[0]} + {found[1]} pieces"))
table(rows)

# %%
# Level 2 on the red half. The weight is the parent's indicator chi(u), in the perimeter, the area
# and the connectedness alike.
unit = torus.scaled(torus.area**-0.5)
weight = tree.weights[0]
start = np.random.default_rng(3).uniform(-1, 1, unit.n_vertices)
steps = [5, 20, 40]
fields, last = descend(unit, 2 * unit.mean_edge_length, start, steps, weight=weight)
below, rows = [], []
parent = pa.functionals.indicator(tree.fields[0], tree.delta)[:, None]
for step, u in zip([*steps, last], fields, strict=True):
    found = phase_pieces(unit, u, tree.labels == 0)
    rows.append({"step": step, "red pieces": found[0], "blue pieces": found[1]})
    # The other half in white.
    colours = parent * plot.scalar_colors(u) + (1 - parent)
    (view,) = plot.render(torus, colours, views=1, size=size // 2, direction=direction)
    below.append((view, f"level 2, step {step}"))
print()
table(rows)

save(arguments.folder, "figure4", [above, below])
