"""Three local 3D features that systems match clusters by: FPFH (33 numbers), SHOT (352), RoPS (135).

They are our own, written after the papers, since no package that installs with pip has all three:

- FPFH: Rusu, Blodow, Beetz, "Fast Point Feature Histograms for 3D registration", ICRA 2009; weights of neighbours are
  the inverse of their squared distance, as in the libraries that have it.
- SHOT: Tombari, Salti, Di Stefano, "Unique signatures of histograms for local surface description", ECCV 2010: a local
  frame, 8 x 2 x 2 volumes, 11 bins of the normals' cosine, each point shared among neighbouring bins in all four.
- RoPS: Guo, Sohel, Bennamoun, Lu, Wan, "Rotational projection statistics for 3D local surface description and object
  recognition", IJCV 2013: a local frame from the triangles, three turns about each axis, three projections of each in
  5 x 5 cells, four central moments and the entropy of each.

A cluster is an organised set of points (each has a pixel), thinned to at most about `POINTS`; features are taken at
`KEYPOINTS` of them. SHOT and RoPS need few points of support at each keypoint; FPFH needs histograms of all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import cKDTree

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

POINTS, KEYPOINTS = 600, 32
# Support of a feature and of a normal, metres: objects are 3 to 30 cm, points of one are 3 to 10 mm apart.
SUPPORT_M, NORMAL_M = 0.05, 0.02


@dataclass(frozen=True, slots=True)
class Surface:
    """A thinned cluster.

    Attributes
    ----------
    points, normals : (N, 3) float64
        Metres, towards the camera.
    triangles : (T, 3) int64
        Of neighbouring pixels.
    keypoints : (K,) int64
    pairs : (N + 1,) int64, (P,) int64, (P,) float64
        For each point the first of its neighbours in support, the neighbours, their distances.
    """

    points: Array
    normals: Array
    triangles: Ints
    keypoints: Ints
    pairs: tuple[Ints, Ints, Array]


def make_surface(points: Array, pixels: Ints, width: int, eye: Array) -> Surface:
    """Thin a cluster, along its pixel grid, and find normals, triangles and neighbours.

    Parameters
    ----------
    points : (N, 3) float64
    pixels : (N,) int64
        Numbers of their pixels in an image `width` pixels wide.
    eye : (3,) float64
        Where the camera is.
    """
    v, u = np.divmod(pixels, width)
    step = int(np.ceil(np.sqrt(len(points) / POINTS)))
    keep = (v % step == 0) & (u % step == 0)
    points, v, u = points[keep], v[keep] // step, u[keep] // step
    pairs = _neighbours(points, SUPPORT_M)
    normals = normals_of(points, *pairs, NORMAL_M)
    normals *= np.where(((eye - points) * normals).sum(1) < 0, -1.0, 1.0)[:, None]
    chosen = np.unique(np.linspace(0, len(points) - 1, min(KEYPOINTS, len(points))).round().astype(np.int64))
    return Surface(points, normals, _triangles(points, v, u), chosen, pairs)


def _neighbours(points: Array, radius_m: float) -> tuple[Ints, Ints, Array]:
    near = cKDTree(points).query_pairs(radius_m, output_type="ndarray")
    both = np.concatenate([near, near[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    first = np.searchsorted(both[:, 0], np.arange(len(points) + 1))
    distance = np.linalg.norm(points[both[:, 0]] - points[both[:, 1]], axis=1)
    return first, np.ascontiguousarray(both[:, 1]), distance


def _triangles(points: Array, v: Ints, u: Ints) -> Ints:
    """Return the triangles of pixels that are all there and near each other."""
    number = np.full((v.max(initial=0) + 2, u.max(initial=0) + 2), -1, np.int64)
    number[v, u] = np.arange(len(points))
    here, right, down, across = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    found = np.concatenate(
        [np.stack(corners, -1).reshape(-1, 3) for corners in ((here, right, down), (right, across, down))]
    )
    found = found[(found >= 0).all(1)]
    sides = points[found] - points[np.roll(found, 1, axis=1)]
    near: Ints = found[(np.linalg.norm(sides, axis=2) < SUPPORT_M / 2).all(1)]
    return near


@njit(cache=True, nogil=True)
def normals_of(points, first, neighbours, distances, radius):
    """Return the direction (N, 3) in which each point's neighbours spread least."""
    normals = np.empty_like(points)
    for i in range(len(points)):
        n = 1.0
        mean = points[i].copy()
        square = np.outer(points[i], points[i])
        for k in range(first[i], first[i + 1]):
            if distances[k] <= radius:
                other = points[neighbours[k]]
                mean += other
                square += np.outer(other, other)
                n += 1.0
        mean /= n
        normals[i] = np.linalg.eigh(square / n - np.outer(mean, mean))[1][:, 0]
    return normals


def fpfh(surface: Surface) -> Array:
    """Return the FPFH (K, 33) of a surface's keypoints."""
    return _fpfh(surface.points, surface.normals, *surface.pairs, surface.keypoints)


@njit(cache=True, nogil=True)
def _fpfh(points, normals, first, neighbours, distances, keypoints):
    simple = np.zeros((len(points), 33))
    for i in range(len(points)):
        count = first[i + 1] - first[i]
        for k in range(first[i], first[i + 1]):
            j, d = neighbours[k], distances[k]
            line = (points[j] - points[i]) / d
            u, other = normals[i], normals[j]
            if abs(u @ line) < abs(other @ line):  # the frame is the point's whose normal is nearer to the line
                u, other, line = other, u, -line
            v = np.cross(line, u)
            length = np.sqrt(v @ v)
            if length == 0.0:
                continue
            v /= length
            values = (
                (np.arctan2(np.cross(u, v) @ other, u @ other) + np.pi) / (2 * np.pi),
                (v @ other + 1.0) / 2.0,
                (u @ line + 1.0) / 2.0,
            )
            for part in range(3):
                simple[i, 11 * part + min(10, max(0, int(11 * values[part])))] += 100.0 / count
    result = np.zeros((len(keypoints), 33))
    for row in range(len(keypoints)):
        i = keypoints[row]
        for k in range(first[i], first[i + 1]):
            result[row] += simple[neighbours[k]] / distances[k] ** 2
        for part in range(3):
            whole = result[row, 11 * part : 11 * part + 11].sum()
            if whole > 0:
                result[row, 11 * part : 11 * part + 11] *= 100.0 / whole
        result[row] += simple[i]
    return result


def shot(surface: Surface) -> Array:
    """Return the SHOT (K, 352) of a surface's keypoints."""
    return _shot(surface.points, surface.normals, *surface.pairs, surface.keypoints, SUPPORT_M)


@njit(cache=True, nogil=True)
def _shot(points, normals, first, neighbours, distances, keypoints, radius):
    result = np.zeros((len(keypoints), 352))
    bins = np.array([8, 2, 2, 11])
    low, fraction = np.empty(4, np.int64), np.empty(4)
    for row in range(len(keypoints)):
        i = keypoints[row]
        near = neighbours[first[i] : first[i + 1]]
        if len(near) < 5:
            continue
        away = points[near] - points[i]
        weights = radius - distances[first[i] : first[i + 1]]
        axes = np.linalg.eigh((away * weights[:, None]).T @ away)[1]
        x, z = axes[:, 2].copy(), axes[:, 0].copy()
        if (away @ x >= 0).sum() * 2 < len(near):  # each axis points to where most of the points are
            x = -x
        if (away @ z >= 0).sum() * 2 < len(near):
            z = -z
        y = np.cross(z, x)
        for k in range(len(near)):
            a, b, c = away[k] @ x, away[k] @ y, away[k] @ z
            d = distances[first[i] + k]
            place = (
                np.arctan2(b, a) / (2 * np.pi) + 0.5,
                (c / d + 1.0) / 2.0,
                d / radius,
                (normals[near[k]] @ z + 1.0) / 2.0,
            )
            for q in range(4):
                at = place[q] * bins[q] - 0.5
                low[q] = int(np.floor(at))
                fraction[q] = at - low[q]
            for corner in range(16):
                weight, cell = 1.0, 0
                for q in range(4):
                    up = (corner >> q) & 1
                    bin_ = low[q] + up
                    weight *= fraction[q] if up else 1.0 - fraction[q]
                    bin_ = bin_ % 8 if q == 0 else min(bins[q] - 1, max(0, bin_))
                    cell = cell * bins[q] + bin_
                result[row, cell] += weight
        result[row] /= np.sqrt((result[row] ** 2).sum())
    return result


def rops(surface: Surface) -> Array:
    """Return the RoPS (K, 135) of a surface's keypoints."""
    first, neighbours, _ = surface.pairs
    return _rops(surface.points, first, neighbours, surface.triangles, surface.keypoints, SUPPORT_M)


@njit(cache=True, nogil=True)
def _rops(points, first, neighbours, triangles, keypoints, radius):
    result = np.zeros((len(keypoints), 135))
    corners = np.empty((3, 3))
    for row in range(len(keypoints)):
        origin = points[keypoints[row]]
        scatter, mean, whole = np.zeros((3, 3)), np.zeros(3), 0.0
        for t in range(len(triangles)):
            for q in range(3):
                corners[q] = points[triangles[t, q]] - origin
            middle = (corners[0] + corners[1] + corners[2]) / 3.0
            distance = np.sqrt(middle @ middle)
            if distance >= radius:
                continue
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            weight = 0.5 * np.sqrt(normal @ normal) * (radius - distance) ** 2
            scatter += weight * (9.0 * np.outer(middle, middle) + corners.T @ corners) / 12.0
            mean += weight * middle / 2.0
            whole += weight
        near = neighbours[first[keypoints[row]] : first[keypoints[row] + 1]]
        if whole == 0.0 or len(near) < 5:
            continue
        axes = np.linalg.eigh(scatter / whole)[1]
        x, z = axes[:, 2].copy(), axes[:, 0].copy()
        x = -x if mean @ x < 0 else x
        z = -z if mean @ z < 0 else z
        y = np.cross(z, x)
        away = points[near] - origin
        frame = np.empty((len(near), 3))
        frame[:, 0], frame[:, 1], frame[:, 2] = away @ x, away @ y, away @ z
        _projections(frame, result[row])
        result[row] /= np.abs(result[row]).sum()
    return result


@njit(cache=True, nogil=True)
def _projections(frame, out):
    """Write the statistics of the projections of points (N, 3) in three turns about each axis."""
    at = 0
    cells = np.empty((5, 5))
    for axis in range(3):
        p, q = (axis + 1) % 3, (axis + 2) % 3
        for k in range(1, 4):
            angle = k * np.pi / 6.0
            turned = frame.copy()
            turned[:, p] = np.cos(angle) * frame[:, p] - np.sin(angle) * frame[:, q]
            turned[:, q] = np.sin(angle) * frame[:, p] + np.cos(angle) * frame[:, q]
            for a, b in ((0, 1), (0, 2), (1, 2)):
                low_a, low_b = turned[:, a].min(), turned[:, b].min()
                step_a = max(1e-9, (turned[:, a].max() - low_a) / 5.0)
                step_b = max(1e-9, (turned[:, b].max() - low_b) / 5.0)
                cells[:] = 0.0
                for n in range(len(turned)):
                    i = min(4, int((turned[n, a] - low_a) / step_a))
                    j = min(4, int((turned[n, b] - low_b) / step_b))
                    cells[i, j] += 1.0 / len(turned)
                _statistics(cells, out[at : at + 5])
                at += 5


@njit(cache=True, nogil=True)
def _statistics(cells, out):
    """Write the central moments 11, 21, 12, 22 and the entropy of a distribution over cells."""
    mean_i, mean_j, entropy = 0.0, 0.0, 0.0
    for i in range(5):
        for j in range(5):
            mean_i += i * cells[i, j]
            mean_j += j * cells[i, j]
            if cells[i, j] > 0:
                entropy -= cells[i, j] * np.log(cells[i, j])
    out[:] = 0.0
    for i in range(5):
        for j in range(5):
            a, b = i - mean_i, j - mean_j
            out[0] += a * b * cells[i, j]
            out[1] += a * a * b * cells[i, j]
            out[2] += a * b * b * cells[i, j]
            out[3] += a * a * b * b * cells[i, j]
    out[4] = entropy


FEATURES: Mapping[str, tuple[int, Callable[[Surface], Array]]] = MappingProxyType(
    {"FPFH": (33, fpfh), "SHOT": (352, shot), "RoPS": (135, rops)}
)
