"""
Distortion on a sphere
======================

Halves of a sphere that shall flatten with little distortion: the larger its weight omega, the
longer and the more wound the border, and the lower the distortion J. Without the connectedness
functional, in the first row, the phases may fall apart into islands; with it, in the second,
both are one piece. The third and fourth row are the same for the law of the paper's equation
(12), whose J counts a hemisphere for many times its distortion: the same omega winds the border
much more, and mixes the phases, which the pale colours show.

The paper gives epsilon = 0.023 on about 40,000 vertices, which is 2 h on a sphere of radius 0.609;
omega = 5, 10, 15 are in the units of that sphere. On unit area they are 2.16 times as large.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure6.png"
import numpy as np
from gallery import parser, save, table

import phaseatlas as pa
from phaseatlas import datasets, plot

arguments = parser(__file__, __doc__)
arguments.add_argument("--subdivisions", type=int, default=6, help="of the icosahedron")
arguments.add_argument("--law", choices=["sharp", "paper"], help="one law only; both by default")
arguments = arguments.parse_args()
laws = [arguments.law] if arguments.law else ["sharp", "paper"]
subdivisions = 4 if arguments.quick else arguments.subdivisions
size = 120 if arguments.quick else 190

radius = 0.0115 / datasets.icosphere(6).mean_edge_length
sphere = datasets.icosphere(subdivisions, radius=radius)
length = np.sqrt(sphere.area)
epsilon = 2 * sphere.mean_edge_length
print(f"radius {radius:.4g}, {sphere.n_vertices} vertices, epsilon {epsilon:.3g}")


def cut(omega, law, connected):
    return pa.segment(
        sphere, epsilon=epsilon, distortion=omega * length, law=law, connected=connected
    )


panels, rows = [], []
for law in laws:
    distortion = pa.functionals.Distortion(sphere, epsilon, law=law)
    for connected in (False, True):
        panels.append([])
        for omega in (5.0, 10.0, 15.0):
            row = {"law": law, "C": "with" if connected else "without", "omega": omega}
            rows.append(row)
            try:
                tree = cut(omega, law, connected)
            except pa.DisconnectedError as error:
                print(f"{law}, omega = {omega:g}: {error}")
                row |= dict.fromkeys(["length", "J", "red pieces", "blue pieces", "repairs"], "-")
                continue
            (u,) = tree.fields
            row["length"] = tree.diagnostics[0].length
            row["J"] = distortion.value_and_gradient(u)[0]
            row["red pieces"], row["blue pieces"] = tree.components.tolist()
            row["repairs"] = tree.diagnostics[0].repairs
            for k, view in enumerate(plot.render(sphere, plot.scalar_colors(u), size=size)):
                caption = f"{law}, {row['C']} C, omega = {omega:g}"
                panels[-1].append((view, caption if k == 0 else "other side"))
table(rows)

print()
for law in laws:
    for with_c in ("without", "with"):
        series = [row for row in rows if (row["law"], row["C"]) == (law, with_c)]
        if any(row["J"] == "-" for row in series):
            continue
        lengths, distortions = ([row[key] for row in series] for key in ("length", "J"))
        print(
            f"{law}, {with_c} C: length grows {bool(np.all(np.diff(lengths) > 0))}, "
            f"J falls {bool(np.all(np.diff(distortions) < 0))}"
        )

save(arguments.folder, "figure6", [row for row in panels if row])
