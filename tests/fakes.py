"""A recording and a tracker that are quick and known, for tests of what stands around them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, Proposal3D, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.results.files import RunReport, Timing
from cuboid.results.files.object_table import ObjectTable

INTRINSICS = Intrinsics(500.0, 500.0, 31.5, 23.5, 64, 48)


class FakeRecording:
    """Frames of noise at one place; some of them broken, some without a pose."""

    format = "fake"

    def __init__(
        self,
        frames: int,
        broken: Mapping[int, str] | None = None,
        lost: tuple[int, ...] = (),
        poses: bool = True,
    ) -> None:
        self.path = Path("fake-recording")
        self.intrinsics = INTRINSICS
        self.distortion: tuple[float, ...] = ()
        self.depth_units_per_metre = 1000.0
        self.depth_camera = None
        self.warnings: tuple[str, ...] = ()
        self.has_poses = poses
        self._frames = frames
        self._broken = broken or {}
        self._retire_removed = lost
        self.reads: list[int] = []

    def __len__(self) -> int:
        return self._frames

    def pose(self, index: int) -> np.ndarray | None:
        if index in self._retire_removed:
            raise FrameError("the frame has no camera pose")
        return self._T_world_camera(index)

    def _T_world_camera(self, index: int) -> np.ndarray:
        T_world_camera = np.eye(4)
        T_world_camera[0, 3] = index * 0.01
        return T_world_camera

    def without_poses(self) -> FakeRecording:
        return FakeRecording(self._frames, self._broken, tuple(range(self._frames)), poses=False)

    def read(self, index: int) -> Frame:
        self.reads.append(index)
        if index in self._broken:
            raise FrameError(self._broken[index])
        return Frame(
            index,
            index / 30.0,
            np.full((48, 64, 3), index % 256, np.uint8),
            np.full((48, 64), 1.5, np.float32),
            None if index in self._retire_removed else self._T_world_camera(index),
        )


def box(x: float = 0.0) -> Box:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    return Box(np.array([x, 0.2, 1.0]), np.array([0.1, 0.2, 0.3]), turn)


class FakeTracker:
    """One object from the second frame on."""

    def __init__(
        self, intrinsics: Intrinsics, config: object = None, proposals: object = None, *, memory_mb: float = 0.0
    ) -> None:
        self.intrinsics = intrinsics
        self.config = config if isinstance(config, TrackerConfig) else TrackerConfig()
        self.frames: list[int] = []
        self.sizes: list[tuple[int, ...]] = []
        self.refuse: dict[int, str] = {}
        self.carried: list[dict[int, np.ndarray]] = []
        self.up = np.array([0.0, 0.0, 1.0])
        self.planes = [SupportPlane(self.up, -0.85, np.array([[0, 0, 0.85], [1, 0, 0.85], [0, 1, 0.85]]))]

    def apply_correction(self, moved: Mapping[int, np.ndarray]) -> None:
        self.carried.append(dict(moved))

    def update(self, frame: Frame, anchor: int = 0) -> FrameResult:
        if frame.index in self.refuse:
            raise FrameError(self.refuse[frame.index])
        assert frame.T_world_camera is not None
        self.frames.append(frame.index)
        self.sizes.append(frame.color.shape)
        rect = np.array([1.0, 2.0, 11.5, 12.25])
        seen = Sighting(1, box(), None if len(self.frames) == 2 else 0.75, 0.5, rect, probability=0.7)
        return FrameResult(
            frame.index,
            frame.timestamp_s,
            frame.T_world_camera,
            (seen,) if len(self.frames) > 1 else (),
            (Proposal3D(min(len(self.frames) - 1, 1), box(0.01), 0.5, rect),),
            1,
            np.zeros(frame.depth_m.shape, np.float32),
            {"proposals": 1.0, "matching": 2.0},
            camera=frame.camera_name,
        )

    @property
    def objects(self) -> list[TrackedObject]:
        if len(self.frames) < 2:
            return []
        seen = len(self.frames) - 1
        color = np.array([10.0, 20.0, 30.0])
        return [TrackedObject(1, box(), 0.9, 0.8, self.frames[1], self.frames[-1], seen, 1234, color, 0, (3, 4))]

    @property
    def points_known(self) -> int:
        return len(self.frames)

    @property
    def map_bytes(self) -> int:
        return 50 * len(self.frames)

    def map_points(self) -> MapPoints:
        n = len(self.frames)
        return MapPoints(
            np.arange(3 * n, dtype=np.float32).reshape(n, 3),
            np.arange(3 * n, dtype=np.uint8).reshape(n, 3),
            np.linspace(0, 1, n, dtype=np.float32),
            np.ones(n, np.int32),
        )

    def find_furniture(self, points: MapPoints) -> ObjectTable:
        return ObjectTable()


def write_recording(path: Path, frames: int, shape: tuple[int, int] = (48, 64), poses: bool = True) -> Path:
    """Write a recording in the plain layout: a wall at 1.5 m, the camera moving 1 cm a frame."""
    height, width = shape
    for folder in ("color", "depth"):
        (path / folder).mkdir(parents=True)
    color = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    for i in range(frames):
        cv2.imwrite(str(path / "color" / f"{i:06d}.png"), color)
        cv2.imwrite(str(path / "depth" / f"{i:06d}.png"), np.full(shape, 1500, np.uint16))
    camera = {"fx": width, "fy": width, "cx": width / 2, "cy": height / 2, "width": width, "height": height}
    (path / "camera.json").write_text(json.dumps({**camera, "depth_units_per_metre": 1000}))
    if poses:
        lines = [f"{i} {i * 0.01:.3f} 0 0 0 0 0 1" for i in range(frames)]
        (path / "poses.txt").write_text("\n".join(lines) + "\n")
    return path


def run_report(recording: Path, frames: int, skipped: tuple[tuple[int, str], ...] = ()) -> RunReport:
    """The report of a run over a made recording."""
    config, used, milliseconds = {"every": 1}, frames - len(skipped), {"frame": Timing(25.0, 30.0)}
    made = "0.1", True, str(recording), "plain", "given", 1, config
    return RunReport(*made, frames, used, skipped, milliseconds, 1.0, 1.0)
