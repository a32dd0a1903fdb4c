"""Slow, obvious NumPy twins of the discrete equations.

Everything takes plain arrays: ``vertices`` (n, 3) float, ``faces`` (m, 3) int, ``u`` and ``weight``
(n,). The functionals return ``(value, gradient)``. Nothing here is shared with the package, so that
the two agree only if both follow the equations.
"""

from __future__ import annotations

import heapq
import math
from fractions import Fraction

import numpy as np
import scipy.linalg

# --------------------------------------------------------------------------------------------------
# scalar laws
# --------------------------------------------------------------------------------------------------


def psi(u):
    """Double well of the Modica-Mortola functional, 9/16 (u^2 - 1)^2."""
    u = np.asarray(u, dtype=float)
    return 9.0 / 16.0 * (u**2 - 1.0) ** 2


def psi_derivative(u):
    u = np.asarray(u, dtype=float)
    return 9.0 / 4.0 * u * (u**2 - 1.0)


def psi_second_derivative(u):
    u = np.asarray(u, dtype=float)
    return 27.0 / 4.0 * u**2 - 9.0 / 4.0


def chi(u, delta=0.0):
    """Smooth indicator of the positive phase: cubic on |u| <= 1 - delta, constant outside."""
    u = np.asarray(u, dtype=float)
    b = 1.0 - delta
    cubic = (u + b) ** 2 * (2.0 * b - u) / (4.0 * b**3)
    return np.where(u <= -b, 0.0, np.where(u >= b, 1.0, cubic))


def chi_derivative(u, delta=0.0):
    u = np.asarray(u, dtype=float)
    b = 1.0 - delta
    return np.where(np.abs(u) >= b, 0.0, 3.0 * (b + u) * (b - u) / (4.0 * b**3))


def chi_second_derivative(u, delta=0.0):
    u = np.asarray(u, dtype=float)
    b = 1.0 - delta
    return np.where(np.abs(u) >= b, 0.0, -6.0 * u / (4.0 * b**3))


def threshold(epsilon):
    """The value a = 1 - sqrt(epsilon) that separates the supports of F and H."""
    return 1.0 - math.sqrt(epsilon)


def path_cost(u, epsilon):
    """F: the price of a path where the phase is absent; zero for u >= a."""
    u = np.asarray(u, dtype=float)
    return np.minimum(u - threshold(epsilon), 0.0) ** 2


def path_cost_derivative(u, epsilon):
    u = np.asarray(u, dtype=float)
    return 2.0 * np.minimum(u - threshold(epsilon), 0.0)


def bump(u, epsilon, plateau=1.0):
    """H: the amount of phase; zero for u <= a, one for u >= plateau, smooth cubic between."""
    a = threshold(epsilon)
    t = np.clip((np.asarray(u, dtype=float) - a) / (plateau - a), 0.0, 1.0)
    return t**2 * (3.0 - 2.0 * t)


def bump_derivative(u, epsilon, plateau=1.0):
    a = threshold(epsilon)
    t = np.clip((np.asarray(u, dtype=float) - a) / (plateau - a), 0.0, 1.0)
    return 6.0 * t * (1.0 - t) / (plateau - a)


# --------------------------------------------------------------------------------------------------
# geometry and operators
# --------------------------------------------------------------------------------------------------


def face_areas(vertices, faces):
    areas = np.empty(len(faces))
    for f, (i, j, k) in enumerate(faces):
        areas[f] = 0.5 * np.linalg.norm(
            np.cross(vertices[j] - vertices[i], vertices[k] - vertices[i])
        )
    return areas


def face_diameters(vertices, faces):
    """Longest edge of every face."""
    diameters = np.empty(len(faces))
    for f, (i, j, k) in enumerate(faces):
        diameters[f] = max(
            np.linalg.norm(vertices[j] - vertices[i]),
            np.linalg.norm(vertices[k] - vertices[j]),
            np.linalg.norm(vertices[i] - vertices[k]),
        )
    return diameters


def face_neighbours(faces):
    """(m, 3): the face across edge (f[k], f[(k+1) % 3]); -1 at the border."""
    owner = {}
    for f, face in enumerate(faces):
        for k in range(3):
            owner[int(face[k]), int(face[(k + 1) % 3])] = f
    neighbours = np.full((len(faces), 3), -1)
    for f, face in enumerate(faces):
        for k in range(3):
            # A consistently oriented neighbour runs through the common edge backwards.
            neighbours[f, k] = owner.get((int(face[(k + 1) % 3]), int(face[k])), -1)
    return neighbours


def boundary_vertices(vertices, faces):
    """Boolean mask (n,) of the vertices on a border edge."""
    on_border = np.zeros(len(vertices), dtype=bool)
    for face, around in zip(faces, face_neighbours(faces), strict=True):
        for k in range(3):
            if around[k] < 0:
                on_border[[face[k], face[(k + 1) % 3]]] = True
    return on_border


def lumped_mass(vertices, faces):
    """A third of the area of the faces around every vertex."""
    mass = np.zeros(len(vertices))
    for face, area in zip(faces, face_areas(vertices, faces), strict=True):
        mass[face] += area / 3.0
    return mass


def angle_defects(vertices, faces):
    """Integrated curvature: 2 pi minus the angles inside, pi minus the angles on the border."""
    defects = np.where(boundary_vertices(vertices, faces), math.pi, 2.0 * math.pi)
    for face in faces:
        for k in range(3):
            p, q, r = vertices[face[k]], vertices[face[(k + 1) % 3]], vertices[face[(k + 2) % 3]]
            a, b = q - p, r - p
            defects[face[k]] -= math.atan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))
    return defects


def weighted_stiffness(vertices, faces, weight):
    """Dense matrix of int w grad theta_i . grad theta_j, w taken at the face centroid."""
    matrix = np.zeros((len(vertices), len(vertices)))
    for face in faces:
        w = np.mean(weight[face])
        # The hat gradient of corner i is the opposite edge, turned by 90 degrees, over 2 area; the
        # turn drops out of the products.
        opposite = vertices[np.roll(face, -2)] - vertices[np.roll(face, -1)]
        area = 0.5 * np.linalg.norm(np.cross(opposite[0], opposite[1]))
        matrix[np.ix_(face, face)] += w * (opposite @ opposite.T) / (4.0 * area)
    return matrix


def stiffness(vertices, faces):
    return weighted_stiffness(vertices, faces, np.ones(len(vertices)))


def diffuse_weights(vertices, faces, labels, epsilon):
    """u - div(epsilon^2 grad u) = 1 on the faces of each label, 0 elsewhere; epsilon by faces."""
    n = len(vertices)
    matrix = np.zeros((n, n))
    shares = np.zeros((labels.max() + 1, n))
    for face, label, width in zip(faces, labels, epsilon, strict=True):
        inside = stiffness(vertices[face], np.array([[0, 1, 2]]))
        matrix[np.ix_(face, face)] += width**2 * inside
        shares[label, face] += face_areas(vertices, face[None])[0] / 3.0
    # No entry but the diagonal is positive; rows sum to the mass.
    matrix = np.minimum(matrix - np.diag(np.diag(matrix)), 0.0)
    matrix += np.diag(lumped_mass(vertices, faces) - matrix.sum(axis=1))
    return np.linalg.solve(matrix, shares.T).T


# --------------------------------------------------------------------------------------------------
# functionals
# --------------------------------------------------------------------------------------------------


def perimeter(vertices, faces, u, epsilon):
    """Equation (5)."""
    s = stiffness(vertices, faces)
    m = lumped_mass(vertices, faces)
    value = 0.5 * epsilon * u @ (s @ u) + m @ psi(u) / epsilon
    gradient = epsilon * (s @ u) + m * psi_derivative(u) / epsilon
    return value, gradient


def weighted_perimeter(vertices, faces, u, epsilon, weight, eta=0.0, sigma=None):
    """Discrete form of (7); eta = 0 gives (9)."""
    s = weighted_stiffness(vertices, faces, weight + eta)
    m = lumped_mass(vertices, faces)
    value = 0.5 * epsilon * u @ (s @ u) + m @ ((weight + eta) * psi(u)) / epsilon
    gradient = epsilon * (s @ u) + m * (weight + eta) * psi_derivative(u) / epsilon
    if sigma is not None:
        value += m @ ((1.0 - weight) * u**2) / sigma
        gradient = gradient + 2.0 * m * (1.0 - weight) * u / sigma
    return value, gradient


def costed_perimeter(vertices, faces, u, epsilon, cost, weight=None, eta=0.0, sigma=1.0):
    """(5) or, with a weight, (7), all integrands times the factor `cost` on the length of seams."""
    w = np.ones(len(vertices)) if weight is None else weight
    factor = cost * (w + (0.0 if weight is None else eta))
    s = weighted_stiffness(vertices, faces, factor)
    m = lumped_mass(vertices, faces)
    outside = m * cost * (1.0 - w) / sigma
    value = 0.5 * epsilon * u @ (s @ u) + m @ (factor * psi(u)) / epsilon + outside @ u**2
    gradient = epsilon * (s @ u) + m * factor * psi_derivative(u) / epsilon + 2.0 * outside * u
    return value, gradient


def costed_perimeter_hessian(vertices, faces, u, epsilon, cost, weight=None, eta=0.0, sigma=1.0):
    """Second derivatives of `costed_perimeter`, (n, n)."""
    w = np.ones(len(vertices)) if weight is None else weight
    factor = cost * (w + (0.0 if weight is None else eta))
    m = lumped_mass(vertices, faces)
    well = m * factor * psi_second_derivative(u) / epsilon
    outside = 2.0 * m * cost * (1.0 - w) / sigma
    return epsilon * weighted_stiffness(vertices, faces, factor) + np.diag(well + outside)


def perimeter_hessian(vertices, faces, u, epsilon):
    """Second derivatives of (5), (n, n)."""
    m = lumped_mass(vertices, faces)
    return epsilon * stiffness(vertices, faces) + np.diag(m * psi_second_derivative(u) / epsilon)


def weighted_perimeter_hessian(vertices, faces, u, epsilon, weight, eta, sigma):
    """Second derivatives of the discrete form of (7), (n, n)."""
    m = lumped_mass(vertices, faces)
    well = m * (weight + eta) * psi_second_derivative(u) / epsilon
    outside = 2.0 * m * (1.0 - weight) / sigma
    return epsilon * weighted_stiffness(vertices, faces, weight + eta) + np.diag(well + outside)


def area_hessian(vertices, faces, u, delta, weight=None):
    """Second derivatives of (2) and (10), (n, n)."""
    w = np.ones(len(vertices)) if weight is None else weight
    return np.diag(lumped_mass(vertices, faces) * w * chi_second_derivative(u, delta))


def area(vertices, faces, u, delta, weight=None):
    """Equation (2), or with a weight the constraint of (10)."""
    m = lumped_mass(vertices, faces)
    w = np.ones(len(vertices)) if weight is None else weight
    return m @ (w * chi(u, delta)), m * w * chi_derivative(u, delta)


def face_means(faces, values):
    return np.array([np.mean(values[face]) for face in faces])


def components(faces, u, epsilon):
    """Label (m,) of the connected set of faces with mean value >= a; -1 for the other faces."""
    return label_faces(faces, face_means(faces, u) >= threshold(epsilon))


def label_faces(faces, inside):
    """Label (m,) of each connected set of the faces ``inside``; -1 for the other faces."""
    neighbours = face_neighbours(faces)
    labels = np.full(len(faces), -1)
    count = 0
    for seed in range(len(faces)):
        if not inside[seed] or labels[seed] >= 0:
            continue
        labels[seed] = count
        stack = [seed]
        while stack:
            for g in neighbours[stack.pop()]:
                if g >= 0 and inside[g] and labels[g] < 0:
                    labels[g] = count
                    stack.append(g)
        count += 1
    return labels


def dual_edge_factors(vertices, faces, weight=None, floor=1e-2):
    """For every face the list of (neighbour, mean diameter / max(mean weight, floor))."""
    diameters = face_diameters(vertices, faces)
    w = np.ones(len(faces)) if weight is None else face_means(faces, weight)
    edges = []
    for f, around in enumerate(face_neighbours(faces)):
        edges.append(
            [
                (
                    int(g),
                    0.5 * (diameters[f] + diameters[g]) / max(0.5 * (w[f] + w[g]), floor),
                )
                for g in around
                if g >= 0
            ]
        )
    return edges


def shortest_paths(edges, cost, sources):
    """Distance and predecessor of every face from a set of faces.

    Dual edges cost mean(cost) * factor; those inside a component cost nothing, as F vanishes there.
    """
    distance = [math.inf] * len(edges)
    predecessor = [-1] * len(edges)
    heap = []
    for f in sources:
        distance[f] = 0.0
        heap.append((0.0, int(f)))
    heapq.heapify(heap)
    while heap:
        d, f = heapq.heappop(heap)
        if d > distance[f]:
            continue
        for g, factor in edges[f]:
            candidate = d + 0.5 * (cost[f] + cost[g]) * factor
            if candidate < distance[g]:
                distance[g] = candidate
                predecessor[g] = f
                heapq.heappush(heap, (candidate, g))
    return distance, predecessor


def saturated(mass, area):
    """What counts for a mass W, W / (W + area) or itself, and its derivative."""
    return (mass, 1.0) if area is None else (mass / (mass + area), area / (mass + area) ** 2)


def connectedness(
    vertices,
    faces,
    u,
    epsilon,
    weight=None,
    floor=1e-2,
    outside=0.25,
    form="pairs",
    saturation=None,
    plateau=1.0,
    inside=None,
):
    """Equation (3) for the positive phase: sum over ordered pairs i != j of W_i W_j d_ij.

    Faces whose mean weight is below ``outside`` belong to no component and cost F(0) more. The form
    "tree" sums over the edges of the shortest spanning tree instead, with the masses of the two
    parts that each joins.
    """
    w = np.ones(len(faces)) if weight is None else face_means(faces, weight)
    inside = w >= outside if inside is None else np.asarray(inside)
    values = face_means(faces, u)
    labels = label_faces(faces, inside & (values >= threshold(epsilon)))
    count = labels.max() + 1
    gradient = np.zeros(len(vertices))
    if count < 2:
        return 0.0, gradient

    areas = face_areas(vertices, faces)
    phase = inside * areas * w * bump(values, epsilon, plateau)
    phase_slope = inside * areas * w * bump_derivative(values, epsilon, plateau)
    totals = np.array([phase[labels == i].sum() for i in range(count)])

    cost = (path_cost(values, epsilon) + ~inside * path_cost(0.0, epsilon)).tolist()
    cost_slope = path_cost_derivative(values, epsilon)
    edges = dual_edge_factors(vertices, faces, weight, floor)

    lengths = np.zeros((count, count))
    paths = {}
    for i in range(count - 1):
        distance, predecessor = shortest_paths(edges, cost, np.flatnonzero(labels == i))
        for j in range(i + 1, count):
            f = min(np.flatnonzero(labels == j), key=lambda f: distance[f])
            lengths[i, j] = distance[f]
            paths[i, j] = []
            while predecessor[f] >= 0:
                paths[i, j].append((f, predecessor[f]))
                f = predecessor[f]

    # Which components the two ends of each path stand for.
    ends = {(i, j): ([i], [j]) for i, j in paths}
    if form == "tree":
        ends = tree_ends(lengths)

    value = 0.0
    per_total = np.zeros(count)  # dC / dW_i
    per_face = np.zeros(len(faces))  # dC / du_f
    for (i, j), (here, there) in ends.items():
        near, near_slope = saturated(totals[here].sum(), saturation)
        far, far_slope = saturated(totals[there].sum(), saturation)
        # The pair (i, j) stands for (j, i) as well.
        value += 2.0 * near * far * lengths[i, j]
        per_total[here] += 2.0 * near_slope * far * lengths[i, j]
        per_total[there] += 2.0 * near * far_slope * lengths[i, j]
        for f, g in paths[i, j]:
            factor = dict(edges[f])[g]
            per_face[f] += near * far * factor * cost_slope[f]
            per_face[g] += near * far * factor * cost_slope[g]
    for f in range(len(faces)):
        if labels[f] >= 0:
            per_face[f] += per_total[labels[f]] * phase_slope[f]
        gradient[faces[f]] += per_face[f] / 3.0
    return value, gradient


def tree_ends(lengths):
    """Edges of the shortest spanning tree (Kruskal 1956) with the nodes on either side of each."""
    count = len(lengths)
    pairs = [(i, j) for i in range(count) for j in range(i + 1, count)]
    tree = []
    part = list(range(count))
    for i, j in sorted(pairs, key=lambda pair: lengths[pair]):
        if part[i] != part[j]:
            part = [part[i] if p == part[j] else p for p in part]
            tree.append((i, j))
    ends = {}
    for edge in tree:
        part = list(range(count))
        for i, j in tree:
            if (i, j) != edge:
                part = [part[i] if p == part[j] else p for p in part]
        ends[edge] = tuple([k for k in range(count) if part[k] == part[end]] for end in edge)
    return ends


def yamabe_coefficients(c, epsilon, law, eta):
    """Diffusion, source and penalty of (12) as functions of the indicator c of a phase.

    Returns ``(a, b, p)`` and their derivatives in c, all (n,).
    """
    one = np.ones(len(c))
    if law == "paper":
        return (c + eta, c, (1.0 - c) / epsilon), (one, one, -one / epsilon)
    # "sharp": the penalty sets in where the other phase prevails and stiffens like 1 / epsilon^2,
    # so that s = 0 on the interface in the limit; the mixed phase c = 1/2 goes unpunished.
    t = np.maximum(0.0, 1.0 - 4.0 * c)
    q, dq = t**2, -8.0 * t
    values = (one, 1.0 - q, (30.0 * q + eta) / epsilon**2)
    return values, (0.0 * one, -dq, 30.0 * dq / epsilon**2)


def yamabe(vertices, faces, c, epsilon, law, eta):
    """Solution s of A s = b, zero on the border, and a function that solves A x = y for any y."""
    a, b, p = yamabe_coefficients(c, epsilon, law, eta)[0]
    matrix = weighted_stiffness(vertices, faces, a) + np.diag(lumped_mass(vertices, faces) * p)
    inner = np.flatnonzero(~boundary_vertices(vertices, faces))
    factor = scipy.linalg.cho_factor(matrix[np.ix_(inner, inner)])

    def solve(y):
        x = np.zeros(len(vertices))
        x[inner] = scipy.linalg.cho_solve(factor, y[inner])
        return x

    return solve(angle_defects(vertices, faces) * b), solve


def distortion(vertices, faces, u, epsilon, law, delta, eta, weight=None):
    """Discrete objective of (13), for both phases; the gradient has the sign + of the adjoint."""
    m = lumped_mass(vertices, faces)
    defects = angle_defects(vertices, faces)
    w = np.ones(len(vertices)) if weight is None else weight
    value = 0.0
    gradient = np.zeros(len(vertices))
    for sign in (1.0, -1.0):
        c = w * chi(sign * u, delta)
        c_slope = sign * w * chi_derivative(sign * u, delta)
        s, solve = yamabe(vertices, faces, c, epsilon, law, eta)
        value += m @ s**2
        adjoint = solve(m * s)
        # dJ = 2 (db - dA s) . adjoint, where dA has a penalty part at the vertices and a diffusion
        # part on the faces, a third of it for each corner.
        a_slope, b_slope, p_slope = yamabe_coefficients(c, epsilon, law, eta)[1]
        slope = (defects * b_slope - m * p_slope * s) * adjoint
        for face in faces:
            local = stiffness(vertices[face], np.array([[0, 1, 2]]))
            slope[face] -= a_slope[face] / 3.0 * (adjoint[face] @ local @ s[face])
        gradient += 2.0 * c_slope * slope
    return value, gradient


def log_scales(vertices, faces, u, epsilon, law, delta, eta, weight=None):
    """Log scale factors of both phases: e^{2 log_scale} g is flat, so they are minus s of (11)."""
    w = np.ones(len(vertices)) if weight is None else weight
    return tuple(
        -yamabe(vertices, faces, w * chi(sign * u, delta), epsilon, law, eta)[0]
        for sign in (1.0, -1.0)
    )


# --------------------------------------------------------------------------------------------------
# baking
# --------------------------------------------------------------------------------------------------


def bilinear(image, uv):
    """Values (k, c) of an image over [0, 1]^2, first row at v = 1, that repeats over the plane."""
    height, width = image.shape[:2]
    scale = 255.0 if image.dtype == np.uint8 else 1.0
    values = []
    for u, v in uv:
        x, y = u * width - 0.5, (1.0 - v) * height - 0.5
        left, top = math.floor(x), math.floor(y)
        value = np.zeros(image.shape[2])
        for row, row_weight in ((top, top + 1 - y), (top + 1, y - top)):
            for column, column_weight in ((left, left + 1 - x), (left + 1, x - left)):
                texel = image[row % height, column % width] / scale
                value += row_weight * column_weight * texel
        values.append(value)
    return np.array(values)


def barycentric(corners, point):
    """Of a point in the plane."""
    return np.linalg.solve(np.vstack([corners.T, np.ones(3)]), [*point, 1.0])


def bake(corners, charts, texture, resolution, padding, background):
    """Blend of a texture over charts, baked into the layout ``corners`` (m, 3, 2).

    A chart is ``{face: (uv, weights)}`` with the places (3, 2) and weights (3,) of the corners of
    each face, ``texture`` a function from places (k, 2) to values (k, 3) in [0, 1]. No centre of a
    texel may lie on an edge of the layout.
    """
    colours = {}
    for row in range(resolution):
        for column in range(resolution):
            centre = np.array([column + 0.5, resolution - row - 0.5]) / resolution
            for face, triangle in enumerate(corners):
                inside = barycentric(triangle, centre)
                if inside.min() > 0:
                    colours[row, column] = blend_at(charts, texture, face, inside)
                    break
    image = np.empty((resolution, resolution, 3), dtype=np.uint8)
    for row in range(resolution):
        for column in range(resolution):
            squared, near_column, near_row = min(
                ((r - row) ** 2 + (c - column) ** 2, c, r) for r, c in colours
            )
            within = padding is None or squared <= padding**2
            image[row, column] = colours[near_row, near_column] if within else background
    return image


def blend_at(charts, texture, face, inside):
    """Colour in bytes of a point of a face, given by its barycentric coordinates."""
    total, colour = 0.0, np.zeros(3)
    for chart in charts:
        if face in chart:
            uv, weights = chart[face]
            weight = inside @ weights
            if weight > 0:
                colour += weight * texture((inside @ uv)[None])[0]
                total += weight
    return np.rint(np.clip(colour / total, 0, 1) * 255)


# --------------------------------------------------------------------------------------------------
# charts by energy
# --------------------------------------------------------------------------------------------------


def dirichlet_log_scale(vertices, faces):
    """s of a chart: S s = K inside, 0 on the boundary, (n,)."""
    inner = np.flatnonzero(~boundary_vertices(vertices, faces))
    matrix = stiffness(vertices, faces)
    s = np.zeros(len(vertices))
    s[inner] = np.linalg.solve(matrix[np.ix_(inner, inner)], angle_defects(vertices, faces)[inner])
    return s


def chart_distortion(vertices, faces):
    """Integral of s^2 over a chart that is a disk."""
    return lumped_mass(vertices, faces) @ dirichlet_log_scale(vertices, faces) ** 2


def partition_energy(vertices, faces, labels, distortion):
    """Energy of charts that are disks, overlap nowhere and are not tiny.

    The seam over sqrt A, `distortion` times the sum of the integrals of s^2 over A, charts / 10.
    """
    area = face_areas(vertices, faces).sum()
    neighbours = face_neighbours(faces)
    seam = 0.0
    for f, face in enumerate(faces):
        for k in range(3):
            g = neighbours[f, k]
            if f < g and labels[f] != labels[g]:
                seam += np.linalg.norm(vertices[face[k]] - vertices[face[(k + 1) % 3]])
    total = 0.0
    for label in np.unique(labels):
        used, corners = np.unique(faces[labels == label], return_inverse=True)
        total += chart_distortion(vertices[used], corners.reshape(-1, 3))
    return seam / np.sqrt(area) + distortion * total / area + 0.1 * len(np.unique(labels))


def ward_cells(vertices, faces, count):
    """Ward clustering of (normal, centroid), both on the surface of unit area, to `count` cells.

    Always merges the two neighbouring clusters that raise the area-weighted variance least.
    """
    vertices = vertices / np.sqrt(face_areas(vertices, faces).sum())
    areas = face_areas(vertices, faces)
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.hstack([normals, corners.mean(axis=1)])
    neighbours = face_neighbours(faces)
    labels = np.arange(len(faces))
    while len(np.unique(labels)) > count:
        best = (math.inf, 0, 0)
        for f, around in enumerate(neighbours):
            for g in around:
                if g < 0 or labels[f] == labels[g]:
                    continue
                a, b = labels == labels[f], labels == labels[g]
                gap = np.average(points[a], axis=0, weights=areas[a]) - np.average(
                    points[b], axis=0, weights=areas[b]
                )
                size = areas[a].sum(), areas[b].sum()
                cost = gap @ gap * size[0] * size[1] / sum(size)
                best = min(best, (cost, labels[f], labels[g]))
        labels[labels == best[2]] = best[1]
    return labels


# --------------------------------------------------------------------------------------------------
# repair
# --------------------------------------------------------------------------------------------------


def fan_count(faces, vertex):
    """Number of groups of faces, all at a vertex, that hang together across edges there."""
    groups = []
    for face in faces:
        # The other two vertices are the ends of the two edges at this one.
        merged = {int(v) for v in face} - {vertex}
        apart = []
        for group in groups:
            if group & merged:
                merged |= group
            else:
                apart.append(group)
        groups = [*apart, merged]
    return len(groups)


def manifold_defects(n_vertices, faces):
    """What keeps faces from being an oriented manifold in which every vertex has a face."""
    defects = []
    directed = {}
    around = [[] for _ in range(n_vertices)]
    for f, face in enumerate(faces):
        if len(set(map(int, face))) < 3:
            defects.append(f"face {f} names a vertex twice")
        for k in range(3):
            around[face[k]].append(face)
            edge = int(face[k]), int(face[(k + 1) % 3])
            if edge in directed:
                defects.append(f"faces {directed[edge]} and {f} run along {edge} alike")
            directed[edge] = f
    for vertex in range(n_vertices):
        if (count := fan_count(around[vertex], vertex)) != 1:
            defects.append(f"vertex {vertex} has {count} fans")
    return defects


def face_components(faces):
    """Component of each face over common edges, in the order of the first faces."""
    edges = [
        [frozenset((int(face[k]), int(face[(k + 1) % 3]))) for k in range(3)] for face in faces
    ]
    at_edge = {}
    for f, sides in enumerate(edges):
        for edge in sides:
            at_edge.setdefault(edge, []).append(f)
    component = np.full(len(faces), -1)
    count = 0
    for seed in range(len(faces)):
        if component[seed] >= 0:
            continue
        stack = [seed]
        while stack:
            f = stack.pop()
            component[f] = count
            stack += [g for edge in edges[f] for g in at_edge[edge] if component[g] < 0]
        count += 1
    return component


def boundary_loop_count(faces):
    """Number of closed chains of the edges of one face; each vertex is in one at most."""
    directed = {(int(f[k]), int(f[(k + 1) % 3])) for f in faces for k in range(3)}
    after = {a: b for a, b in directed if (b, a) not in directed}
    count = 0
    while after:
        start, v = after.popitem()
        while v != start:
            v = after.pop(v)
        count += 1
    return count


# --------------------------------------------------------------------------------------------------
# maps to the plane
# --------------------------------------------------------------------------------------------------


def symmetric_dirichlet(vertices, faces, uv):
    """Mean of |J|^2 + |J^-1|^2 + 1.25 (|J|^2 / det J - 2) over the area, and its gradient in uv."""

    def energy(uv):
        total = area = 0.0
        for face in faces:
            p, q = vertices[face], uv[face]
            a, b = p[1] - p[0], p[2] - p[0]
            x = a / np.linalg.norm(a)
            y = np.cross(np.cross(a, b), x)
            y /= np.linalg.norm(y)
            solid = np.array([[a @ x, b @ x], [a @ y, b @ y]])
            flat = np.array([q[1] - q[0], q[2] - q[0]]).T
            jacobian = flat @ np.linalg.inv(solid)
            inverse = np.linalg.inv(jacobian)
            determinant = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
            square = (jacobian**2).sum()
            share = np.linalg.det(solid) / 2
            total += share * (square + (inverse**2).sum() + 1.25 * (square / determinant - 2))
            area += share
        return total / area

    gradient = np.zeros(uv.shape)
    for index in np.ndindex(uv.shape):
        moved = uv.astype(complex)
        moved[index] += 1e-30j
        gradient[index] = energy(moved).imag / 1e-30
    return energy(uv), gradient


def is_bijection(triangles, uv):
    """Whether all faces turn left and no two sides of the boundary have a point in common.

    By fractions, each pair of sides; sides with a common vertex may meet there.
    """
    points = [(Fraction(float(x)), Fraction(float(y))) for x, y in uv]

    def turn(a, b, c):
        (ax, ay), (bx, by), (cx, cy) = points[a], points[b], points[c]
        return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)

    def on(a, b, p):
        inside = all(
            min(points[a][k], points[b][k]) <= points[p][k] <= max(points[a][k], points[b][k])
            for k in range(2)
        )
        return turn(a, b, p) == 0 and inside

    def meet(a, b, c, d):
        if any(on(*three) for three in ((a, b, c), (a, b, d), (c, d, a), (c, d, b))):
            return True
        return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0

    if any(turn(*face) <= 0 for face in triangles):
        return False
    sides = {(f[k], f[(k + 1) % 3]) for f in triangles for k in range(3)}
    rim = sorted(side for side in sides if side[::-1] not in sides)
    for i, (a, b) in enumerate(rim):
        for c, d in rim[:i]:
            common = {a, b} & {c, d}
            if not common:
                if meet(a, b, c, d):
                    return False
            else:
                (p,) = {a, b} - common
                (q,) = {c, d} - common
                if on(a, b, q) or on(c, d, p):
                    return False
    return True


def layout_of(faces, uv, tolerance):
    """Chart of each face and cut vertex of each corner of a layout, by trying all pairs."""
    corners = [(f, k) for f in range(len(faces)) for k in range(3)]
    chart, vertex = list(range(len(faces))), {corner: i for i, corner in enumerate(corners)}

    def join(labels, keys, a, b):
        low, high = sorted((labels[a], labels[b]))
        for key in keys:
            if labels[key] == high:
                labels[key] = low

    for f, k in corners:
        for g, i in corners:
            after, behind = (f, (k + 1) % 3), (g, (i + 1) % 3)
            if faces[f][k] != faces[behind[0]][behind[1]] or faces[g][i] != faces[f][after[1]]:
                continue
            gaps = [uv[f][k] - uv[behind[0]][behind[1]], uv[after[0]][after[1]] - uv[g][i]]
            if np.abs(gaps).max() <= tolerance:
                join(chart, range(len(faces)), f, g)
                join(vertex, corners, (f, k), behind)
                join(vertex, corners, after, (g, i))
    number = {label: i for i, label in enumerate(dict.fromkeys(vertex.values()))}
    order = {label: i for i, label in enumerate(dict.fromkeys(chart))}
    cut = np.array([[number[vertex[f, k]] for k in range(3)] for f in range(len(faces))])
    return np.array([order[label] for label in chart]), cut


def edge_components(triangles):
    """Component over common edges of each triangle, in the order of their first ones."""
    sides = [{frozenset(pair) for pair in ((a, b), (b, c), (c, a))} for a, b, c in triangles]
    found = [-1] * len(sides)
    count = 0
    for first in range(len(sides)):
        if found[first] >= 0:
            continue
        waiting, found[first] = [first], count
        while waiting:
            f = waiting.pop()
            for g in range(len(sides)):
                if found[g] < 0 and sides[f] & sides[g]:
                    found[g] = count
                    waiting.append(g)
        count += 1
    return found
