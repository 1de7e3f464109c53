"""Results with as many objects as are wanted, side by side on a table, with the recording they are of."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.inputs.readers.calibration import write_camera
from cuboid.results.files import ObjectsFile, ResultWriter, RunReport, Timing
from cuboid.results.views.projection import visible_rect
from fakes import write_recording

FRAMES = 12
CAMERA = Intrinsics(300.0, 300.0, 160.0, 120.0, 320, 240)
# Metres from the middle of an object to that of the next.
APART_M = 0.14
NAMES = ("cup", "milk carton", "box of screws", "the lamp that stands on the left", "")
UP = np.array([0.0, 0.0, 1.0])


def box(label: int, count: int) -> Box:
    """An object's box on the plane z = 0: they stand in rows."""
    row = int(np.ceil(np.sqrt(count)))
    i, j = divmod(label - 1, row)
    size = np.array([0.07 + 0.01 * (label % 3), 0.06, 0.05 + 0.03 * (label % 4)])
    place = APART_M * (np.array([j, i]) - (row - 1) / 2)
    return Box(np.array([*place, size[2] / 2]), size, np.eye(3))


def camera(i: int, count: int) -> Float64Array:
    """T_world_camera: from in front and above, moving to the right, looking at the middle."""
    reach = APART_M * np.sqrt(count)
    place = np.array([0.1 * reach * (i / FRAMES - 0.5), -0.7 - 0.8 * reach, 0.5 + 0.7 * reach])
    z = -place / np.linalg.norm(place)
    x = np.cross(z, UP)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3] = np.column_stack((x, np.cross(z, x), z, place))
    return T


def crowd(count: int) -> tuple[TrackedObject, ...]:
    """Objects 1 to `count`; four of five have a name."""
    return tuple(
        TrackedObject(
            label=label,
            box=box(label, count),
            score=0.9,
            heat=0.8,
            first_frame=0,
            last_frame=FRAMES - 1,
            frames_seen=FRAMES,
            points=64,
            mean_color=np.array(color_of(label), dtype=np.float64),
            plane=0,
            name=NAMES[label % len(NAMES)] or None,
        )
        for label in range(1, count + 1)
    )


def write_crowd(folder: Path, count: int, warnings: tuple[str, ...] = ()) -> Path:
    """Write recording and results below a folder; return the folder of the results."""
    objects = crowd(count)
    recording = write_recording(folder / "recording", FRAMES, (CAMERA.height, CAMERA.width))
    write_camera(recording / "camera.json", CAMERA, 1000)
    for i in range(FRAMES):
        picture = np.full((CAMERA.height, CAMERA.width, 3), 150, np.uint8)
        for item in sorted(objects, key=lambda item: -item.box.center[1]):
            _paint(picture, item, camera(i, count))
        cv2.imwrite(str(recording / "color" / f"{i:06d}.png"), picture[..., ::-1])
    with ResultWriter(folder / "results") as writer:
        for i in range(FRAMES):
            writer.add(_frame(i, objects))
        half = APART_M * (np.ceil(np.sqrt(count)) / 2 + 0.5)
        corners = np.array([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], np.float64)
        report = RunReport(
            version="1.2.3",
            complete=True,
            recording=str(recording),
            format="plain",
            poses="given",
            threads=1,
            config={"every": 1, "limit": None, "distortion": [0.1, -0.2, 0.0, 0.001, 0.05]},
            frames_read=FRAMES,
            frames_used=FRAMES,
            skipped=(),
            milliseconds={"frame": Timing(25.0, 40.0), "decode": Timing(5.0, 6.0)},
            seconds=1.5,
            peak_memory_mb=321.0,
            warnings=warnings,
        )
        found = ObjectsFile(UP, CAMERA, (SupportPlane(UP, 0.0, corners),), objects)
        writer.finish(found, _points(objects, half), report)
    return folder / "results"


def _frame(i: int, objects: tuple[TrackedObject, ...]) -> FrameResult:
    T = camera(i, len(objects))
    sightings = []
    for item in objects:
        rect = visible_rect(item.box, T, CAMERA)
        if rect is not None:
            sightings.append(Sighting(item.label, item.box, None, 1.0, rect))
    heat = np.zeros((4, 4), np.float32)
    return FrameResult(i, i / 30.0, T, tuple(sightings), (), len(objects), heat, {"frame": 25.0})


def _paint(picture: np.ndarray, item: TrackedObject, T: Float64Array) -> None:
    seen = (item.box.corners() - T[:3, 3]) @ T[:3, :3]
    at = CAMERA.pixels(seen)
    cv2.fillConvexPoly(picture, cv2.convexHull(np.round(at).astype(np.int32)), [int(c) for c in color_of(item.label)])


def _points(objects: tuple[TrackedObject, ...], half: float) -> MapPoints:
    side = np.linspace(-half, half, 80)
    ground = np.stack((*np.meshgrid(side, side), np.zeros((80, 80))), axis=-1).reshape(-1, 3)
    inside = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 8)] * 3), axis=-1).reshape(-1, 3)
    xyz = [ground, *(item.box.center + inside * item.box.size for item in objects)]
    rgb = [np.full((len(ground), 3), 130), *(np.tile(item.mean_color, (len(inside), 1)) for item in objects)]
    label = [np.zeros(len(ground)), *(np.full(len(inside), item.label) for item in objects)]
    return MapPoints(
        np.concatenate(xyz).astype(np.float32),
        np.concatenate(rgb).astype(np.uint8),
        np.where(np.concatenate(label) > 0, 0.8, 0.0).astype(np.float32),
        np.concatenate(label).astype(np.int32),
    )
