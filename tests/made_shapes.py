"""Results of a made table with two boxes, one of them named, whose frames are kept as a plain recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.method.shapes.keeping import ViewKeeper
from cuboid.results.files import ObjectsFile, ResultWriter
from fakes import run_report
from made_scenes import CAMERA, frame_of, look_at, upright, write_plain

UNITS = 5000
FRAMES = 14
TABLE = Box(np.array([0.0, 0.0, -0.02]), np.array([1.4, 1.4, 0.04]), np.eye(3))
BOXES = {1: upright((-0.12, 0.0), (0.16, 0.12, 0.14), 0.4), 2: upright((0.14, 0.05), (0.10, 0.10, 0.20))}
UP = np.array([0.0, 0.0, 1.0])


def frames() -> list[Frame]:
    """What a camera sees on half a circle: the far side of the boxes is seen by few, their feet by none."""
    angles = np.linspace(-2.2, 1.2, FRAMES)
    poses = [look_at((0.8 * np.cos(a), 0.8 * np.sin(a), 0.55), (0.0, 0.0, 0.05)) for a in angles]
    return [frame_of([TABLE, *BOXES.values()], T, k) for k, T in enumerate(poses)]


def write_frames(folder: Path, taken: list[Frame]) -> None:
    """Write a plain recording without poses."""
    write_plain(folder, CAMERA, taken, UNITS, posed=False)


def map_points() -> MapPoints:
    """Points of the faces of both boxes, a centimetre apart."""
    parts, labels = [], []
    for label, box in BOXES.items():
        steps = [np.linspace(-0.5, 0.5, int(side / 0.01) + 1) * side for side in box.size]
        grid = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3)
        shell = grid[(np.abs(np.abs(grid) - box.size / 2) < 1e-6).any(1)]
        parts.append(box.center + shell @ box.rotation.T)
        labels += [label] * len(shell)
    xyz = np.concatenate(parts).astype(np.float32)
    count = len(xyz)
    return MapPoints(xyz, np.full((count, 3), 128, np.uint8), np.ones(count, np.float32), np.array(labels, np.int32))


def finished(results: Path, recording: Path, *, keep_views: bool = False) -> Path:
    """Write recording and results."""
    taken = frames()
    write_frames(recording, taken)
    keeper = ViewKeeper(CAMERA) if keep_views else None
    with ResultWriter(results) as writer:
        for frame in taken:
            assert frame.T_world_camera is not None
            seen = tuple(Sighting(k, box, None, 0.9, np.array([0.0, 0.0, 9.0, 9.0])) for k, box in BOXES.items())
            if keeper is not None:
                keeper.add(frame, frame.T_world_camera, seen)
            heat = np.zeros((1, 1), np.float32)
            writer.add(FrameResult(frame.index, frame.index / 30, frame.T_world_camera, seen, (), 2, heat, {}))
        color = np.array([200.0, 100.0, 50.0])
        objects = tuple(
            TrackedObject(k, box, 0.9, 0.8, 0, FRAMES - 1, FRAMES, 40, color, 0, name="tea / box" if k == 2 else None)
            for k, box in BOXES.items()
        )
        table = SupportPlane(UP, 0.0, np.array([[-0.6, -0.6, 0.0], [0.6, -0.6, 0], [0.6, 0.6, 0], [-0.6, 0.6, 0]]))
        writer.finish(
            ObjectsFile(UP, CAMERA, (table,), objects), map_points(), run_report(recording, FRAMES), views=keeper
        )
    return results
