"""Results whose every figure is known, with the recording they are of: for tests of what shows results."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.results.files import ObjectsFile, ResultWriter, RunReport, Timing
from fakes import write_recording

FRAMES = 40
SKIPPED = {7: "color/000007.png: truncated", 23: "color/000023.png: truncated"}
HEIGHT, WIDTH = 120, 160
INTRINSICS = Intrinsics(WIDTH, WIDTH, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT)

# By label the frames that see it. 2 is seen before and after a skipped frame, which is one run; 4 turned out
# to be 1; 5 is retired.
SEEN = {
    1: [*range(2, 21), *range(30, 40)],
    2: [frame for frame in range(5, 40) if frame not in SKIPPED],
    3: [35, 36],
    4: [10, 11, 12],
    5: [15],
}
SPANS = {1: [(2, 20), (30, 39)], 2: [(5, 39)], 3: [(35, 36)], 4: [(10, 12)], 5: [(15, 15)]}
SIZES = {1: (0.2, 0.1, 0.3), 2: (0.15, 0.15, 0.1), 3: (0.1, 0.1, 0.2)}
PLACES = {1: (-0.3, 0.0), 2: (0.3, 0.1), 3: (0.0, -0.3)}
COLORS = {1: (200, 40, 40), 2: (40, 200, 40), 3: (40, 40, 200)}
# The frame that shows most of an object.
BEST = {1: 33, 2: 12, 3: 36}


def camera(i: int) -> Float64Array:
    """T_world_camera: from 2 m in front and 1.2 m above, moving to the right, looking at the middle."""
    place = np.array([-0.4 + 0.02 * i, -2.0, 1.2])
    z = -place / np.linalg.norm(place)
    x = np.cross(z, (0.0, 0.0, 1.0))
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3] = np.column_stack((x, np.cross(z, x), z, place))
    return T


def box(label: int) -> Box:
    """An object's box on the plane z = 0."""
    size = np.array(SIZES.get(label, (0.1, 0.1, 0.1)))
    return Box(np.array([*PLACES.get(label, (0.5, 0.5)), size[2] / 2]), size, np.eye(3))


def map_points(per_side: int = 60) -> MapPoints:
    """A grey square metre and a half of plane, and the objects' boxes full of points in their colors."""
    grid = np.stack(np.meshgrid(*[np.linspace(-0.75, 0.75, per_side)] * 2), axis=-1).reshape(-1, 2)
    parts = [(np.column_stack((grid, np.zeros(len(grid)))), (120, 120, 120), 0.0, 0)]
    inside = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 14)] * 3), axis=-1).reshape(-1, 3)
    for label, color in COLORS.items():
        parts.append((box(label).center + inside * SIZES[label], color, 0.9, label))
    return MapPoints(
        np.concatenate([xyz for xyz, *_ in parts]).astype(np.float32),
        np.concatenate([np.full((len(xyz), 3), color, np.uint8) for xyz, color, _, _ in parts]),
        np.concatenate([np.full(len(xyz), heat, np.float32) for xyz, _, heat, _ in parts]),
        np.concatenate([np.full(len(xyz), label, np.int32) for xyz, _, _, label in parts]),
    )


def made_objects() -> tuple[TrackedObject, ...]:
    return tuple(
        TrackedObject(
            label=label,
            box=box(label),
            score=0.5 + 0.1 * label,
            heat=0.9,
            first_frame=SEEN[label][0],
            last_frame=SEEN[label][-1],
            frames_seen=len(SEEN[label]),
            points=14**3,
            mean_color=np.array(COLORS[label], dtype=np.float64),
            plane=0,
            merged_labels=(4,) if label == 1 else (),
        )
        for label in SIZES
    )


def write_results(folder: Path, complete: bool = True) -> Path:
    """Write recording and results below a folder; return the folder of the results.

    Frame i of the recording has red i, green 100, blue 200; all of it is 4 m away, behind the objects.
    """
    recording = write_recording(folder / "recording", FRAMES, (HEIGHT, WIDTH))
    for i in range(FRAMES):
        bgr = np.full((HEIGHT, WIDTH, 3), (200, 100, i), np.uint8)
        cv2.imwrite(str(recording / "color" / f"{i:06d}.png"), bgr)
        cv2.imwrite(str(recording / "depth" / f"{i:06d}.png"), np.full((HEIGHT, WIDTH), 4000, np.uint16))
    with ResultWriter(folder / "results") as writer:
        for i in range(FRAMES):
            if i not in SKIPPED:
                writer.add(_frame(i))
        corners = [(-0.75, -0.75, 0), (0.75, -0.75, 0), (0.75, 0.75, 0), (-0.75, 0.75, 0)]
        up = np.array([0.0, 0.0, 1.0])
        plane = SupportPlane(up, 0.0, np.array(corners, dtype=np.float64))
        report = RunReport(
            version="1.2.3",
            complete=complete,
            recording=str(recording),
            format="plain",
            poses="given",
            threads=1,
            config={"every": 1, "limit": None, "tracker": {"voxel_m": 0.01}},
            frames_read=FRAMES,
            frames_used=FRAMES - len(SKIPPED),
            skipped=tuple(SKIPPED.items()),
            milliseconds={"frame": Timing(25.0, 40.0), "decode": Timing(5.0, 6.0), "<b>fuse": Timing(20.0, 34.0)},
            seconds=1.5,
            peak_memory_mb=321.0,
        )
        writer.finish(ObjectsFile(up, INTRINSICS, (plane,), made_objects()), map_points(), report)
    return folder / "results"


def _frame(i: int) -> FrameResult:
    sightings = []
    for label in (label for label, frames in SEEN.items() if i in frames):
        rect = np.array([40.0, 30.0, 80.0 if i == BEST.get(label) else 60.0, 60.0])
        sightings.append(Sighting(label, box(label), None, 1.0, rect))
    # the plain layout has no times: frame / 30 s
    return FrameResult(i, i / 30.0, camera(i), tuple(sightings), (), 3, np.zeros((4, 4), np.float32), {})
