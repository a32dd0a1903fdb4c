"""
For researchers: minimise a functional of your own
==================================================

The functionals of the paper are building blocks: each is a value and a gradient of a phase field
on the vertices. This page adds one of its own to them, checks its gradient, and minimises the sum
twice: with the minimiser of the package and with SciPy. The new term pulls the positive phase
upwards, as oil rises in water: on a cube, it ends as a cap on top.
"""

# sphinx_gallery_thumbnail_number = 1
import matplotlib.pyplot as plt
import numpy as np
import scipy.optimize
from threadpoolctl import threadpool_limits

import phaseatlas as pa
from phaseatlas import optimise, plot
from phaseatlas.functionals import Area, Perimeter, indicator

# %%
# A surface of unit area
# ----------------------
# Weights of a sum have units, so the surface is scaled to unit area first. An interface is
# resolved where epsilon is about twice the length of an edge.
cube = pa.datasets.rounded_cube(24)
surface = cube.scaled(cube.area**-0.5)
epsilon = 2 * surface.mean_edge_length
print(surface.n_vertices, "vertices, epsilon", round(epsilon, 4))


# %%
# A functional of your own
# ------------------------
# Anything with ``value_and_gradient`` will do. This is minus the height of the positive phase,
#
# .. math:: B[u] = -\int_M y \, \chi(u) \approx -\sum_i m_i y_i \, \chi(u_i) .
#
# The lumped masses ``surface.mass`` make an integral a sum over the vertices.
class Buoyancy:
    """Minus the integral of the height over the positive phase."""

    def __init__(self, surface, delta=0.0):
        self.moment = -surface.mass * surface.vertices[:, 1]
        self.delta = delta

    def value_and_gradient(self, u):
        r = 1 - self.delta
        inside = np.clip(u, -r, r)
        slope = 3 * (r**2 - inside**2) / (4 * r**3)
        return float(self.moment @ indicator(u, self.delta)), self.moment * slope


buoyancy = Buoyancy(surface)

# %%
# A wrong gradient is the usual reason why a line search fails. Compare it with a difference in a
# random direction before anything else.
rng = np.random.default_rng(0)
u = 0.9 * np.tanh(rng.normal(size=surface.n_vertices))
direction = rng.normal(size=len(u))
step = 1e-6
ahead, behind = (buoyancy.value_and_gradient(u + s * direction)[0] for s in (step, -step))
difference = (ahead - behind) / (2 * step)
slope = buoyancy.value_and_gradient(u)[1] @ direction
print(f"gradient {slope:.8f}, difference {difference:.8f}")
assert abs(slope - difference) < 1e-6 * abs(slope)

# %%
# The minimiser of the package
# ----------------------------
# `minimise` takes factors and functionals, and one constraint with its target: here, a third of
# the area. ``scale`` makes the unknowns alike. BLAS libraries share long sums among their threads,
# and the order of a sum changes its last digits; with one thread a run can be repeated to the bit.
# `segment` does so by itself.
perimeter, area = Perimeter(surface, epsilon), Area(surface, epsilon)
target = area.total / 3
start = rng.uniform(-1, 1, surface.n_vertices)
terms = [(1.0, perimeter), (20.0, buoyancy)]
with threadpool_limits(1, user_api="blas"):
    found = optimise.minimise(terms, area, target, start, scale=np.sqrt(perimeter.preconditioner()))
print(found.status.value, "after", found.iterations, "steps, energy", round(found.energy, 5))
print("length", round(perimeter.length(found.u), 4), "area missed by", f"{found.violation:.1e}")

# %%
# The same with SciPy
# -------------------
# Any other minimiser gets the same sum. SciPy's L-BFGS-B knows no such constraint, so the area is
# a quadratic penalty here. That leaves a small miss, which the method above would not.
scale, penalty = np.sqrt(perimeter.preconditioner()), 1e3


def energy(x):
    u = x / scale
    value, gradient = optimise.weighted_sum(terms, u)
    content, slope = area.value_and_gradient(u)
    miss = content - target
    return value + 0.5 * penalty * miss**2, (gradient + penalty * miss * slope) / scale


with threadpool_limits(1, user_api="blas"):
    result = scipy.optimize.minimize(
        energy, start * scale, jac=True, method="L-BFGS-B", options={"maxiter": 2000}
    )
by_scipy = result.x / scale
missed = area.value_and_gradient(by_scipy)[0] / target - 1
print(result.nit, "steps, length", round(perimeter.length(by_scipy), 4))
print("area missed by", f"{missed:.1e}")

# %%
# Look at the fields
# ------------------
# The start is noise. Both ends have the red phase on top.
figure, axes = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
fields = {"start": start, "optimise.minimise": found.u, "scipy.optimize": by_scipy}
for axis, (title, field) in zip(axes, fields.items(), strict=True):
    colours = plot.scalar_colors(field)
    (view,) = plot.render(surface, colours, views=1, size=360)
    axis.imshow(np.clip(view, 0, 1))
    axis.set_axis_off()
    axis.set_title(title)

# %%
# From a field to an atlas
# ------------------------
# Labels from anywhere make a `Segmentation`, and an atlas takes any.
labels = (surface.face_mean(found.u) < 0).astype(np.int64)
atlas = pa.build_atlas(pa.Segmentation(surface, labels))
for name, value in atlas.metrics().items():
    print(f"{name:10} {value:.4g}")
