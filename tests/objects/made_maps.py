"""Maps of points that are put where a test wants them."""

from __future__ import annotations

import numpy as np

from cuboid.ground.geometry.box import Box
from cuboid.method.heatmap.kernels.cubes import PLACES, ROW
from cuboid.method.heatmap.voxel_map import VoxelMap
from worlds import cubes_of

VOXEL_M = 0.01


def grid(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    """The middles (N, 3) of all voxels of 1 cm from so far to so far, metres."""
    axes = [np.arange(round(low / VOXEL_M), round(high / VOXEL_M)) * VOXEL_M + VOXEL_M / 2 for low, high in (x, y, z)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def shell(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    """The outermost of those, but for the ones at the bottom."""
    points = grid(x, y, z)
    low, high = points.min(0), points.max(0)
    outer = (np.abs(points - low) < 1e-6)[:, :2].any(1) | (np.abs(points - high) < 1e-6).any(1)
    return points[outer]


def map_of(*parts: tuple[np.ndarray, int], hits: int = 3, far_m: float = 1.3) -> VoxelMap:
    """A map of points (N, 3), each part with the number of its owner, 0 none, as seen from so far."""
    voxels = VoxelMap(VOXEL_M, 1e-3, 4.0)
    points = np.concatenate([part for part, _ in parts])
    owner = np.concatenate([np.full(len(part), number) for part, number in parts])
    places = points / VOXEL_M
    number, first = np.unique(np.floor(places).astype(np.int64), axis=0, return_index=True)
    rows = np.zeros(len(first), ROW)
    rows["place"] = (places[first] - number) * PLACES
    rows["heat"], rows["weight"], rows["hits"], rows["owner"] = 65535, hits / far_m**4, hits, owner[first]
    rows["confidence"] = np.where(owner[first] > 0, hits, 0)
    keys, rows["voxel"] = cubes_of(number)
    voxels.refill(keys, rows)
    return voxels


def box_of(points: np.ndarray) -> Box:
    """The box of points along the world's axes."""
    low, high = points.min(0) - VOXEL_M / 2, points.max(0) + VOXEL_M / 2
    return Box((low + high) / 2, high - low, np.eye(3))
