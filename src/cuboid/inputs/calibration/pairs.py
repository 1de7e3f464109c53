"""Selection of pairs of frames that overlap and were taken from places far enough apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Pinhole
from cuboid.ground.geometry import se3
from cuboid.inputs.calibration.views import View

# A wrong pinhole shows in pairs with motion in the image, but pose errors grow with the camera's motion. Each view gets
# one partner near each of these motions, radians of the median pixel (5, 11 and 20 degrees).
MOTIONS_RAD = (0.09, 0.19, 0.35)
# Motions of a short run (2 and 3 degrees more): a second of a hand-held camera has hardly larger ones, and too long a
# focal length makes them smaller.
SHORT_MOTIONS_RAD = (0.03, 0.05, *MOTIONS_RAD)
# Maximum factor between a pair's motion and one of these.
MAX_MOTION_FACTOR = 1.6
# Minimum fraction of a view's points that lie in its partner's image.
MIN_PARTNER_OVERLAP = 0.45
# Number of points of a view that measure its overlap with another view.
OVERLAP_PROBES = 80


def choose_pairs(
    views: Sequence[View], pinhole: Pinhole, motions_rad: Sequence[float] = MOTIONS_RAD
) -> list[tuple[int, int]]:
    """Return pairs (from, to) of indices of views, in their order, that moved by about one of some motions."""
    pairs = set()
    for i, view in enumerate(views):
        points = _probes(view, pinhole)
        if not len(points):
            continue
        seen = [_overlap_motion(points, view, other, pinhole) for other in views]
        for target in motions_rad:
            off = [
                abs(np.log(motion / target)) if overlap >= MIN_PARTNER_OVERLAP and motion > 0 else np.inf
                for overlap, motion in seen
            ]
            j = int(np.argmin(off))
            if off[j] < np.log(MAX_MOTION_FACTOR) and j != i:
                pairs.add((i, j))
    return sorted(pairs)


def relative(views: Sequence[View], pairs: Sequence[tuple[int, int]]) -> list[Float64Array]:
    """Return T_to_from (4, 4) of each pair."""
    return [se3.inverse(views[j].T_world_camera) @ views[i].T_world_camera for i, j in pairs]


def _probes(view: View, pinhole: Pinhole) -> Float64Array:
    """Return some of a view's points (N, 3) in its camera, metres."""
    chosen = view.xyz[:: max(1, len(view.xyz) // OVERLAP_PROBES)]
    return pinhole.points(*chosen.T)


def _overlap_motion(points: Float64Array, view: View, other: View, pinhole: Pinhole) -> tuple[float, float]:
    """Return the fraction of points inside the other image, and their median motion in it, radians."""
    moved = se3.transform(se3.inverse(other.T_world_camera) @ view.T_world_camera, points)
    depth_m = np.where(moved[:, 2] > 0, moved[:, 2], np.inf)
    ray, old = moved[:, :2] / depth_m[:, None], points[:, :2] / points[:, 2:]
    height, width = other.depth_m.shape
    x, y = ray[:, 0] * pinhole.fx + pinhole.cx, ray[:, 1] * pinhole.fy + pinhole.cy
    inside = np.isfinite(depth_m) & (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    if not inside.any():
        return 0.0, 0.0
    return float(inside.mean()), float(np.median(np.linalg.norm(ray - old, axis=1)[inside]))
