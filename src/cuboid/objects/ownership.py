"""Whose voxel is it: clusters of the map are given to objects, contested ones shared out, twins merged, parts split."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from cuboid.boxes.fit import plane_axes
from cuboid.frame import Float64Array
from cuboid.heatmap.voxel_map import Rows, VoxelMap
from cuboid.objects.entry import MapObject
from cuboid.surfaces.clusters import MapCluster
from cuboid.surfaces.plane import Plane

# An object has a say in a cluster when it owns this many of its voxels, and this share of the cluster or of its own.
SAY_VOXELS, SAY_SHARE = 5, 0.05
# A surface that bends towards another one with less than this radius bends around it, metres.
BEND_RADIUS_M = 0.4
# Two objects touch as one when this share of the smaller one's voxels lies at the other.
CONTACT_SHARE = 0.12


@dataclass(frozen=True, slots=True)
class Piece:
    """Voxels of one cluster that belong to one object; `owner` is 0 for an object yet to be."""

    owner: int
    rows: Rows
    plane: Plane | None


def owners_of(rows: Rows, voxels: VoxelMap, objects: dict[int, MapObject]) -> list[int]:
    """Return the objects that have a say in a cluster, the one with the most voxels first."""
    owner = voxels.owner[rows]
    numbers, counts = np.unique(owner[owner > 0], return_counts=True)
    has_say = [
        (-int(count), int(number))
        for number, count in zip(numbers, counts, strict=True)
        if count >= SAY_VOXELS and count >= SAY_SHARE * min(len(rows), len(objects[int(number)].points))
    ]
    return [number for _, number in sorted(has_say)]


def share_out(cluster: MapCluster, owners: list[int], voxels: VoxelMap) -> tuple[list[Rows], npt.NDArray[np.float64]]:
    """Divide a contested cluster: every voxel goes to the owner that reaches it in the fewest steps.

    Returns
    -------
    list of (N,) int64
        Each owner's rows.
    (K, K) float64
        How closely two owners touch: the voxels of one at the other, as a share of the smaller one's.
    """
    held = voxels.owner[cluster.rows]
    holder = np.full(len(cluster.rows), -1, np.int64)
    for k, number in enumerate(owners):
        holder[held == number] = k
    a, b = edges = cluster.links().T
    while (holder < 0).any():
        # One step from all owned voxels at once; of two owners that arrive together the first one takes it.
        a, b = edges[:, (holder[edges[0]] < 0) != (holder[edges[1]] < 0)]
        old = holder.copy()
        for k in range(len(owners) - 1, -1, -1):
            holder[a[(old[a] < 0) & (old[b] == k)]] = k
            holder[b[(old[b] < 0) & (old[a] == k)]] = k
    a, b = edges[:, holder[edges[0]] != holder[edges[1]]]
    touches = np.zeros((len(holder), len(owners)), bool)
    touches[a, holder[b]] = True
    touches[b, holder[a]] = True
    touching = np.array([touches[holder == k].sum(0) for k in range(len(owners))])
    sizes = np.maximum(1, np.bincount(holder, minlength=len(owners)))
    share = np.minimum(touching, touching.T) / np.minimum(sizes[:, None], sizes[None])
    return [cluster.rows[holder == k] for k in range(len(owners))], share


def gap_m(a: npt.NDArray[np.float32], b: npt.NDArray[np.float32], limit_m: float) -> float:
    """Return the least distance between two point sets (N, 3), metres; infinity beyond the limit."""
    a = a[((a > b.min(0) - limit_m) & (a < b.max(0) + limit_m)).all(1)]
    if len(a) == 0:
        return float("inf")
    b = b[((b > a.min(0) - limit_m) & (b < a.max(0) + limit_m)).all(1)]
    if len(b) == 0:
        return float("inf")
    distance, _ = cKDTree(b).query(a, distance_upper_bound=limit_m)
    return float(np.min(distance))


def bends_around(part: npt.NDArray[np.float32], main: npt.NDArray[np.float32], up: Float64Array) -> tuple[bool, float]:
    """Tell whether a part bends around another one, as the far wall of a bowl does around the near one.

    Seen from above, with x from the main part to this one and y across, the part follows x = a + b y + c y^2. A
    body of its own bulges towards the viewer and so towards what stands before it (c > 0) or is flat; an inner
    wall, a brim, a handle bends back (c < 0). It must not reach farther to the sides than the main part does.

    Returns
    -------
    bool
        Whether it bends around the main part.
    float
        How far its profile lies above the line from its near to its far end, metres: below 0 it is hollow, as the
        inside of a bowl is; the front and the top of a body lie above that line.
    """
    first, second = plane_axes(up)
    plan = np.column_stack([part @ first, part @ second])
    other = np.column_stack([main @ first, main @ second])
    step = plan.mean(0) - other.mean(0)
    norm = float(np.linalg.norm(step))
    if norm < 1e-3 or len(part) < 6:
        return True, 0.0
    ahead = step / norm
    across = np.array([-ahead[1], ahead[0]])
    x, y, side = plan @ ahead, plan @ across, other @ across
    margin = 0.1 * (side.max() - side.min())
    if y.min() < side.min() - margin or y.max() > side.max() + margin:
        return False, 0.0
    y = y - y.mean()
    bend = np.linalg.lstsq(np.column_stack([np.ones(len(y)), y, y * y]), x, rcond=None)[0][2]
    return bool(bend < -0.5 / BEND_RADIUS_M), _sag_m(x - bend * y * y, part @ up)


def _sag_m(x: Float64Array, height: Float64Array) -> float:
    near, far = x <= np.quantile(x, 0.1), x >= np.quantile(x, 0.9)
    x0, x1, z0, z1 = (float(np.median(v)) for v in (x[near], x[far], height[near], height[far]))
    line = z0 + (z1 - z0) * (x - x0) / max(x1 - x0, 1e-6)
    return float((height - line).mean())
