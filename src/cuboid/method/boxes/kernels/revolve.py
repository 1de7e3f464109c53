"""Hot loop: the upright axis of a body of revolution, from points of its side."""

from __future__ import annotations

import numpy as np

from cuboid.ground.compiling.compiled import kernel
from cuboid.ground.core.tolerances import MIN_SIGMA_M, SIGMAS


@kernel
def fit_axis(plan, layer, weights, rounds, center, radius, residual):
    """Fit one axis, and a radius for each layer, to points of a surface: robust least squares of the distances.

    It starts with the algebraic circle (Kasa 1976) with a radius for each layer; Gauss-Newton steps with Cauchy weights
    follow. The radii are eliminated in both: they are weighted means over the layers.

    Parameters
    ----------
    plan : (N, 2) float64
        Points projected along the axis, metres.
    layer : (N,) int64
        Layer of each point, from 0.
    weights : (N,) float64
    rounds : int
        Number of steps.
    center : (2,) float64, output
    radius : (L,) float64, output
        0 for layers without weight.
    residual : (N,) float64, output
        Distance from the axis minus the radius of the layer.

    Returns
    -------
    bool
        False if the points do not determine an axis.
    """
    count, layers = plan.shape[0], radius.size
    total, mean = np.zeros(layers), np.zeros((layers, 3))
    for i in range(count):
        k, w = layer[i], weights[i]
        x, y = plan[i, 0], plan[i, 1]
        total[k] += w
        mean[k, 0] += w * x
        mean[k, 1] += w * y
        mean[k, 2] += w * (x * x + y * y)
    for k in range(layers):
        if total[k] > 0.0:
            for axis in range(3):
                mean[k, axis] /= total[k]
    aa = ab = bb = ac = bc = 0.0
    for i in range(count):
        k, w = layer[i], weights[i]
        x, y = plan[i, 0], plan[i, 1]
        a, b, c = x - mean[k, 0], y - mean[k, 1], x * x + y * y - mean[k, 2]
        aa, ab, bb, ac, bc = aa + w * a * a, ab + w * a * b, bb + w * b * b, ac + w * a * c, bc + w * b * c
    det = aa * bb - ab * ab
    if not det > 1e-9 * (aa + bb) * (aa + bb):
        return False
    cx, cy = 0.5 * (ac * bb - bc * ab) / det, 0.5 * (bc * aa - ac * ab) / det
    out, robust = np.empty(count), weights.copy()
    for step in range(rounds + 1):
        total[:] = 0.0
        mean[:] = 0.0
        for i in range(count):
            k, w = layer[i], robust[i]
            a, b = plan[i, 0] - cx, plan[i, 1] - cy
            r = np.sqrt(a * a + b * b)
            out[i] = r
            total[k] += w
            mean[k, 0] += w * a / max(r, 1e-6)
            mean[k, 1] += w * b / max(r, 1e-6)
            mean[k, 2] += w * r
        for k in range(layers):
            if total[k] > 0.0:
                for axis in range(3):
                    mean[k, axis] /= total[k]
        spread = whole = 0.0
        for i in range(count):
            residual[i] = out[i] - mean[layer[i], 2]
            spread += robust[i] * abs(residual[i])
            whole += robust[i]
        if step == rounds or not whole > 0.0:
            break
        usual = SIGMAS * max(2.0 * MIN_SIGMA_M, 1.25 * spread / whole)
        aa = ab = bb = ac = bc = 0.0
        for i in range(count):
            w = robust[i]
            k, r = layer[i], max(out[i], 1e-6)
            a, b = (plan[i, 0] - cx) / r - mean[k, 0], (plan[i, 1] - cy) / r - mean[k, 1]
            aa, ab, bb = aa + w * a * a, ab + w * a * b, bb + w * b * b
            ac, bc = ac + w * a * residual[i], bc + w * b * residual[i]
            robust[i] = weights[i] / (1.0 + (residual[i] / usual) ** 2)
        det = aa * bb - ab * ab
        if not det > 1e-9 * (aa + bb) * (aa + bb):
            return False
        cx, cy = cx + (ac * bb - bc * ab) / det, cy + (bc * aa - ac * ab) / det
    center[0], center[1] = cx, cy
    for k in range(radius.size):
        radius[k] = mean[k, 2]
    return True


@kernel
def widest_layer(distance, layer, weights, layers, min_weight, rim):
    """Return the radius of the widest layer with at least `min_weight`.

    The radius of a layer is the mean distance of its rim: points inside a filled layer, such as a top, do not count.

    Parameters
    ----------
    distance : (N,) float64
        Distance from the axis, metres.
    layer : (N,) int64
    weights : (N,) float64
    layers : int
    min_weight : float
        Smallest weight of a layer that counts.
    rim : float
        Points belong to the rim from this fraction of the mean distance of the outer half.
    """
    sums = np.zeros((layers, 2))
    for i in range(distance.size):
        sums[layer[i], 0] += weights[i]
        sums[layer[i], 1] += weights[i] * distance[i]
    weight, bound = sums[:, 0].copy(), np.zeros(layers)
    for turn in range(3):
        for k in range(layers):
            mean = sums[k, 1] / sums[k, 0] if sums[k, 0] > 0.0 else 0.0
            bound[k] = mean if turn == 0 else rim * mean if turn == 1 else mean
        if turn == 2:
            break
        sums[:] = 0.0
        for i in range(distance.size):
            if distance[i] >= bound[layer[i]]:
                sums[layer[i], 0] += weights[i]
                sums[layer[i], 1] += weights[i] * distance[i]
    widest = 0.0
    for k in range(layers):
        if weight[k] >= min_weight:
            widest = max(widest, bound[k])
    return widest
