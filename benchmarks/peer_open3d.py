"""A tracker made of what Open3D offers, with no part of this project: run it in an environment of its own.

python benchmarks/peer_open3d.py RECORDING OUTPUT.csv [--every N] [--limit N]

RECORDING is a plain recording (`docs/recordings.md`; what `cuboid synth` writes). Each frame: back-projection up to
3.5 m; a voxel grid of 1 cm; to the world by the given pose; up to five planes by RANSAC, each with a twentieth of the
points or more, whose points are taken out. Up is the normal of the first plane that faces up in a picture; the planes
that are level by it are supports. What lies above a support, up to 60 cm, is clustered by DBSCAN (3 cm, 10 points); a
cluster that rests on the support, does not reach those 60 cm (a wall does) and has the size of an object gets the
upright box of least footprint. Boxes are matched greedily with the boxes of all objects seen before, by IoU (0.25 or
more), else by the fraction of the smaller box (half or more). An object is told of from its fifth sighting on; its box
is that of all points it has got so far.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from pathlib import Path

import cv2
import numpy as np
import open3d as o3d

VOXEL_M, MAX_DEPTH_M = 0.01, 3.5
PLANE_M, PLANES, PLANE_FRACTION = 0.012, 5, 0.05
ABOVE_M = (0.012, 0.6)
DBSCAN_M, DBSCAN_POINTS = 0.03, 10
SMALLEST_M, LARGEST_M = 0.03, 1.0
REST_M = 0.05
# Level to 11 degrees; the first plane tells up when it is within 60 degrees of the picture's.
LEVEL_COS, UPRIGHT_COS = 0.98, 0.5
SAME_IOU, PART, CONFIRM = 0.25, 0.5, 5

# Normal, offset and points of a plane.
Support = tuple[np.ndarray, float, np.ndarray]


class Recording:
    """A plain recording: color is not used."""

    def __init__(self, folder: Path) -> None:
        camera = json.loads((folder / "camera.json").read_text())
        self.units = camera["depth_units_per_metre"]
        self.pinhole = o3d.camera.PinholeCameraIntrinsic(
            camera["width"], camera["height"], camera["fx"], camera["fy"], camera["cx"], camera["cy"]
        )
        self.depths = sorted((folder / "depth").iterdir())
        lines = [line.split() for line in (folder / "poses.txt").read_text().splitlines() if line[:1] != "#"]
        self.poses = {int(line[0]): pose([float(x) for x in line[1:]]) for line in lines}

    def cloud(self, frame: int) -> np.ndarray:
        """Return the points (N, 3) of a frame in the world, a voxel each."""
        depth = cv2.imread(str(self.depths[frame]), cv2.IMREAD_UNCHANGED)
        points = o3d.geometry.PointCloud.create_from_depth_image(
            o3d.geometry.Image(depth), self.pinhole, depth_scale=self.units, depth_trunc=MAX_DEPTH_M
        )
        points = points.transform(self.poses[frame]).voxel_down_sample(VOXEL_M)
        return np.asarray(points.points)


def pose(values: list[float]) -> np.ndarray:
    """Return the motion (4, 4) of tx ty tz qx qy qz qw."""
    T = np.eye(4)
    x, y, z, w = values[3:]
    T[:3, :3] = o3d.geometry.get_rotation_matrix_from_quaternion([w, x, y, z])
    T[:3, 3] = values[:3]
    return T


class Thing:
    """An object: its points, its box, how often it was seen."""

    def __init__(self, label: int) -> None:
        self.label, self.seen = label, 0
        self.points = np.zeros((0, 3))
        self.box: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def add(self, points: np.ndarray, up: np.ndarray, base: float) -> None:
        """Take in a cluster."""
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.concatenate([self.points, points])))
        self.points = np.asarray(cloud.voxel_down_sample(VOXEL_M).points)
        self.box = upright_box(self.points, up, base)
        self.seen += 1


def supports(
    points: np.ndarray, T_world_camera: np.ndarray, up: np.ndarray | None
) -> tuple[list[Support], np.ndarray, np.ndarray | None]:
    """Return the level planes of a frame, the points of no plane, and up where it is known."""
    rest, planes = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)), []
    for _ in range(PLANES):
        if len(rest.points) < PLANE_FRACTION * len(points):
            break
        model, inliers = rest.segment_plane(PLANE_M, 3, 300)
        if len(inliers) < PLANE_FRACTION * len(points):
            break
        normal, offset = np.array(model[:3]), float(model[3])
        if normal @ T_world_camera[:3, 3] + offset < 0:
            normal, offset = -normal, -offset
        planes.append((normal, offset, np.asarray(rest.points)[inliers]))
        rest = rest.select_by_index(inliers, invert=True)
    if up is None:
        up = next((n for n, _, _ in planes if n @ -T_world_camera[:3, 1] >= UPRIGHT_COS), None)
    level = [] if up is None else [plane for plane in planes if plane[0] @ up >= LEVEL_COS]
    return level, np.asarray(rest.points), up


def clusters(points: np.ndarray, planes: list[Support]) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Return what stands on the planes: points, the plane's normal, its height along it."""
    result, left = [], points
    for normal, offset, surface in sorted(planes, key=lambda plane: plane[1]):  # the highest plane first
        height = left @ normal + offset
        low, high = surface.min(0) - 0.05, surface.max(0) + 0.05
        flat = left - np.outer(height, normal)
        on = (height > ABOVE_M[0]) & (height < ABOVE_M[1]) & ((flat > low) & (flat < high)).all(1)
        some, left = left[on], left[~on]
        if len(some) < DBSCAN_POINTS:
            continue
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(some))
        labels = np.asarray(cloud.cluster_dbscan(DBSCAN_M, DBSCAN_POINTS))
        parts = [some[labels == k] for k in range(labels.max() + 1)]
        for part in parts:
            low, high = (part @ normal).min() + offset, (part @ normal).max() + offset
            if low <= REST_M and high <= ABOVE_M[1] - VOXEL_M:
                result.append((part, normal, -offset))
    return result


def upright_box(points: np.ndarray, up: np.ndarray, base: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return centre, size and rotation of the box of least footprint from `base` to the highest point."""
    first = np.linalg.svd(up[None])[2][1]
    second = np.cross(up, first)
    flat = np.column_stack([points @ first, points @ second]).astype(np.float32)
    (x, y), (length, width), degrees = cv2.minAreaRect(flat)
    top = float((points @ up).max())
    a = np.radians(degrees)
    along = np.cos(a) * first + np.sin(a) * second
    center = x * first + y * second + (top + base) / 2 * up
    return center, np.array([length, width, top - base]), np.column_stack([along, np.cross(up, along), up])


def overlap(a: tuple, b: tuple) -> tuple[float, float]:
    """Return IoU and the fraction of the smaller box, of two upright boxes."""
    up = a[2][:, 2]
    low = max(a[0] @ up - a[1][2] / 2, b[0] @ up - b[1][2] / 2)
    high = min(a[0] @ up + a[1][2] / 2, b[0] @ up + b[1][2] / 2)
    if high <= low or np.linalg.norm(a[0] - b[0]) > (np.linalg.norm(a[1]) + np.linalg.norm(b[1])) / 2:
        return 0.0, 0.0
    axes = a[2][:, :2]
    rectangles = []
    for center, size, rotation in (a, b):
        x, y = axes.T @ center
        along = axes.T @ rotation[:, 0]
        angle = float(np.degrees(np.arctan2(along[1], along[0])))
        rectangles.append(((float(x), float(y)), (float(size[0]), float(size[1])), angle))
    _, corners = cv2.rotatedRectangleIntersection(*rectangles)
    if corners is None or len(corners) < 3:
        return 0.0, 0.0
    common = cv2.contourArea(cv2.convexHull(corners)) * (high - low)
    volumes = np.prod(a[1]), np.prod(b[1])
    return float(common / (sum(volumes) - common)), float(common / min(volumes))


def match(boxes: list[tuple], things: list[Thing]) -> dict[int, Thing]:
    """Pair boxes with objects greedily: by IoU, then as parts."""
    likeness = np.zeros((len(boxes), len(things)))
    for i, box in enumerate(boxes):
        for j, thing in enumerate(things):
            iou, part = overlap(box, thing.box)
            likeness[i, j] = 1 + iou if iou >= SAME_IOU else part if part >= PART else 0.0
    pairs = {}
    while likeness.size and likeness.max() > 0:
        i, j = np.unravel_index(int(likeness.argmax()), likeness.shape)
        pairs[int(i)] = things[int(j)]
        likeness[i], likeness[:, j] = 0, 0
    return pairs


class Pipeline:
    """The objects so far; takes the points of one frame after the other."""

    def __init__(self) -> None:
        self.things: list[Thing] = []
        self._up: np.ndarray | None = None

    def find(self, points: np.ndarray, T_world_camera: np.ndarray) -> list[tuple]:
        """Return what is found in one frame: points, box, the plane's normal, its height along it."""
        planes, rest, self._up = supports(points, T_world_camera, self._up)
        found = [(p, upright_box(p, normal, base), normal, base) for p, normal, base in clusters(rest, planes)]
        return [item for item in found if np.sort(item[1][1])[1] >= SMALLEST_M and item[1][1].max() <= LARGEST_M]

    def add(self, found: list[tuple]) -> list[Thing]:
        """Take in what was found in a frame; return the confirmed objects among it."""
        pairs = match([item[1] for item in found], self.things)
        for k, (part, _, normal, base) in enumerate(found):
            if k not in pairs:
                pairs[k] = Thing(len(self.things) + 1)
                self.things.append(pairs[k])
            pairs[k].add(part, normal, base)
        return [pairs[k] for k in range(len(found)) if pairs[k].seen >= CONFIRM]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--limit", type=int, default=None)
    args = parser.parse_args()
    o3d.utility.random.seed(1)
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    recording, pipeline = Recording(args.recording), Pipeline()
    rows, times = [], []
    for frame in range(0, len(recording.depths), args.every)[: args.limit]:
        start = time.process_time()
        found = pipeline.find(recording.cloud(frame), recording.poses[frame])
        # A box as it is now: it changes with the next frame.
        rows += [(frame, thing.label, *thing.box) for thing in pipeline.add(found)]
        times.append((time.process_time() - start) * 1e3)
    with args.output.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "label", "cx", "cy", "cz", "length", "width", "height", "qw", "qx", "qy", "qz"])
        for frame, label, center, size, rotation in rows:
            writer.writerow([frame, label, *center, *size, *quaternion(rotation)])
    print(json.dumps({"ms_frame": float(np.median(times)), "ms_frame_p95": float(np.percentile(times, 95))}))


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return qw qx qy qz of a rotation (3, 3)."""
    vector = cv2.Rodrigues(rotation)[0].ravel()
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0 else np.zeros(3)
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])


if __name__ == "__main__":
    main()
