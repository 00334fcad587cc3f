"""The slow obvious twin of the tracker's linear algebra: residuals one after the other in numpy, Jacobian by central differences, dense
solve.

Images are read by scipy's spline interpolation, projections by `project`, normals by cross products: nothing but the level's pixels is
shared.
"""

import numpy as np
from scipy.ndimage import map_coordinates

from tasks.geometry.cameras import project


def residuals_and_weights(x, scene, instant, number, view):
    """All residuals r [n] at x [V, 3] and their weights w [n], so that E ≈ ½ Σ w r² (Cauchy weights at x)."""
    s, shape, level, settings = scene.surface, instant.shape, instant.levels[number], scene.settings
    r, w, weight = [], [], view.weight
    corners = x[s.faces]
    points = np.einsum("ni,fia->fna", s.barycentric, corners).reshape(-1, 3)
    uv = project(scene.cameras, points)[0] / level.scale
    area = s.mean_face / len(s.barycentric) / scene.pixel**2
    η = min(1.0, area / (4 * np.pi * level.blur**2))
    for k in range(len(scene.cameras)):
        width, height = level.size[k]
        image = level.pixels[level.offset[k] : level.offset[k] + width * height].reshape(height, width, 4).astype(float)
        for q in np.flatnonzero(weight[:, k]):
            u, v = uv[k, q] - 0.5
            for c in range(4):
                σ = settings.sigma_colour if c < 3 else settings.sigma_mask
                value = map_coordinates(image[..., c], [[v], [u]], order=3, prefilter=False, mode="nearest")[0]
                d = value - scene.reference.colour[number][q, k, c]
                r.append(d)
                w.append(η * weight[q, k] / (σ**2 * (1 + (d / σ) ** 2)))
    σ = max(settings.sigma_outline, level.blur)
    rim = view.rim
    for k, f, b, beyond in zip(rim.camera, rim.face, rim.barycentric, rim.beyond, strict=True):
        u, v = project(scene.cameras.subset([k]), b @ corners[f] + scene.cameras.R[k].T @ beyond)[0][0] - 0.5
        width, height = instant.outlines.size[k]
        field = instant.outlines.distance[instant.outlines.offset[k] :][: width * height].reshape(height, width).astype(float)
        d = map_coordinates(field, [[v], [u]], order=1)[0]
        r.append(d)
        w.append(1 / (σ**2 * (1 + (d / σ) ** 2)))
    for e, (i, j) in enumerate(s.edges):
        r.append(np.linalg.norm(x[i] - x[j]) / shape.rest[e] - 1)
        w.append(s.edge_weight[e])
    for h, (a, b, c, d) in enumerate(s.hinges):
        r.extend(_normal(x[a], x[b], x[c]) - _normal(x[b], x[a], x[d]) - shape.bend[h])
        w.extend([scene.settings.sigma_normal**-2] * 3)
    for v in range(len(x)):
        r.extend(x[v] - shape.anchor[v])
        w.extend([shape.anchor_weight[v]] * 3)
    return np.array(r), np.array(w)


def step(x, scene, instant, number, view, *, damping, h=1e-6):
    """Hessian [3V, 3V], gradient [3V] and δ [V, 3] of one damped Gauss–Newton step."""
    r, w = residuals_and_weights(x, scene, instant, number, view)
    J = np.empty((len(r), x.size))
    for i in range(x.size):
        e = np.zeros(x.size)
        e[i] = h
        forward = residuals_and_weights(x + e.reshape(x.shape), scene, instant, number, view)[0]
        J[:, i] = (forward - residuals_and_weights(x - e.reshape(x.shape), scene, instant, number, view)[0]) / (2 * h)
    H, g = J.T @ (w[:, None] * J), J.T @ (w * r)
    return H, g, np.linalg.solve(H + damping * np.eye(len(H)), -g).reshape(x.shape)


def _normal(a, b, c):
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n)
