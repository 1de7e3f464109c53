from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import rotation_from_quat_wxyz
from cuboid.results.files import ObjectsFile, ResultWriter
from fakes import run_report

FRAMES = 5
SKIPPED = 2
CAMERA = Intrinsics(64.0, 64.0, 32.0, 24.0, 64, 48)
UP = np.array([0.0, 0.0, 1.0])

# Stand on the table z = 0.7, turned about the vertical.
BOXES = {
    1: Box(np.array([0.05, 0.02, 0.75]), np.array([0.20, 0.12, 0.10]), rotation_from_quat_wxyz((0.9, 0, 0, 0.3))),
    2: Box(np.array([0.30, -0.10, 0.80]), np.array([0.08, 0.07, 0.20]), np.eye(3)),
    3: Box(np.array([-0.20, 0.00, 0.73]), np.array([0.05, 0.05, 0.06]), np.eye(3)),
}
# Label 3 is seen twice and turns out to be part of object 1.
SEEN = {0: (1,), 1: (1, 2, 3), 3: (1, 3), 4: (2,)}


def look(down_deg: float, x: float) -> Float64Array:
    """T_world_camera of a camera at y = -1.2 that looks along y and down onto the table."""
    a = np.radians(down_deg)
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, -np.sin(a), np.cos(a)], [0, -np.cos(a), -np.sin(a)]])
    T[:3, 3] = (x, -1.2, 0.75 + 1.2 * np.tan(a))
    return T


def finished(folder: Path, recording: Path, down_deg: float) -> Path:
    """Write results in which one frame of five was skipped."""
    with ResultWriter(folder) as writer:
        for index, labels in SEEN.items():
            rect = np.array([10.0, 11.5, 20.25, 31.0])
            seen = tuple(Sighting(label, BOXES[label], None, 1.0 - 0.3 * k, rect + k) for k, label in enumerate(labels))
            pose = look(down_deg, 0.02 * index)
            result = FrameResult(index, index / 30.0, pose, seen, (), 0, np.zeros((1, 1), np.float32), {})
            writer.add(result)
        color = np.array([200.0, 100.0, 50.0])
        objects = (
            TrackedObject(1, BOXES[1], 0.9, 0.8, 0, 3, 3, 40, color, 0, (3,)),
            TrackedObject(2, BOXES[2], 0.7, 0.6, 1, 4, 2, 0, color, None),
        )
        table = SupportPlane(UP, -0.7, np.array([[-1, -1, 0.7], [-1, 1, 0.7], [1, 1, 0.7], [1, -1, 0.7]]))
        rng = np.random.default_rng(5)
        label = np.repeat([0, 1], [60, 40]).astype(np.int32)
        points = MapPoints(
            rng.normal(size=(100, 3)).astype(np.float32),
            rng.integers(0, 256, (100, 3)).astype(np.uint8),
            rng.random(100).astype(np.float32),
            label,
        )
        writer.finish(
            ObjectsFile(UP, CAMERA, (table,), objects), points, run_report(recording, FRAMES, ((SKIPPED, "bad"),))
        )
    return folder
