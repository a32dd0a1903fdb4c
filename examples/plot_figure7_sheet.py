"""
A sheet with bumps, areas free
==============================

The distortion alone decides where the border runs on this sheet of waves, for there is no area
constraint (epsilon = 0.1, omega = 10 in the units of the sheet, which is 4 wide). Its Gauss
curvature, first, is positive on tops and hollows, where the border lets the flattening relax it.
A straight border, above, bends until it runs from one bump to the next, as the cuts of Sharp and
Crane (2018) do; it gets longer by it. From random values, below, the phases come out as patches
with their corners on the bumps.

Spots on single bumps are no noise: a hole of the size of epsilon on a peak of the curvature costs
little length and takes much of the distortion, like a cone point.
"""

# sphinx_gallery_thumbnail_path = "gallery/figure7.png"
import numpy as np
from gallery import descend, parser, phase_pieces, save, table

import phaseatlas as pa
from phaseatlas import datasets, plot

arguments = parser(__file__, __doc__).parse_args()
size = 110 if arguments.quick else 260
direction = (0.15, -0.9, 1.3)

cells = 80 if arguments.quick else 110
sheet = datasets.sheet(cells, cells, size=(4.0, 4.0), amplitude=0.6, periods=2)
unit_length = np.sqrt(sheet.area)
unit = sheet.scaled(1 / unit_length)
epsilon, omega = (0.13 if arguments.quick else 0.1) / unit_length, 10 * unit_length
# At the border of the sheet the angle defect is the geodesic curvature of the border.
curvature = np.where(sheet.on_border, 0.0, sheet.angle_defects / sheet.mass)
print(f"epsilon / h  {epsilon / unit.mean_edge_length:.3g}")

x, y, _ = sheet.vertices.T
starts = {
    "straight": np.tanh(1.06 * (x + 0.3 * y - 2.6) / 0.1),
    "random": np.random.default_rng(0).uniform(-1, 1, sheet.n_vertices),
}
steps = {"straight": [0, 10], "random": [10, 40]}
perimeter = pa.functionals.Perimeter(unit, epsilon)
distortion = pa.functionals.Distortion(unit, epsilon)

views, rows = {}, []
for name, start in starts.items():
    fields, last = descend(
        unit, epsilon, start, steps[name], connected=False, distortion=omega, area="none"
    )
    views[name] = []
    for step, u in zip([*steps[name], last], fields, strict=True):
        on_interface = sheet.mass * (1 - u**2) ** 2
        rows.append(
            {
                "start": name,
                "step": step,
                "length": perimeter.value_and_gradient(u)[0] / np.sqrt(2) * unit_length,
                "J": distortion.value_and_gradient(u)[0] * sheet.area,
                "mean |K| on the interface": float(
                    on_interface @ np.abs(curvature) / on_interface.sum()
                ),
                "pieces": sum(phase_pieces(sheet, u)),
            }
        )
        (view,) = plot.render(sheet, plot.scalar_colors(u), views=1, size=size, direction=direction)
        views[name].append((view, f"{name}, step {step}"))
table(rows)
print(f"mean |K| of the sheet  {sheet.mass @ np.abs(curvature) / sheet.area:.4g}")

limit = float(curvature.max())
(view,) = plot.render(
    sheet,
    plot.scalar_colors(curvature, low=-limit, high=limit, colormap="PuOr_r"),
    views=1,
    size=size,
    direction=direction,
)
(grid,) = plot.render(
    sheet,
    plot.scalar_colors(sheet.vertices[:, 2], low=-0.6, high=0.6, colormap="Greys"),
    views=1,
    size=size,
    direction=direction,
)
save(
    arguments.folder,
    "figure7",
    [
        [(view, "Gauss curvature"), *views["straight"]],
        [(grid, "height"), *views["random"]],
    ],
)
