"""A place whose every relation is known, as results: a crate with a can in it, a book with a cup on it, a parcel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import FrameResult, MapPoints, Sighting, SupportPlane, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.results.files import ObjectsFile, ResultWriter
from fakes import run_report, write_recording

UP = np.array([0.0, 0.0, 1.0])
CAMERA = Intrinsics(64.0, 64.0, 32.0, 24.0, 64, 48)
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
# 2026-03-01 12:00 UTC.
BEGIN_S = 1772366400.0
FRAMES = 6


def thing(
    label: int, x: float, y: float, foot: float, size: tuple[float, float, float], **more: object
) -> TrackedObject:
    box = Box(np.array([x, y, foot + size[2] / 2]), np.array(size), np.eye(3))
    color = np.array([200.0, 30.0, 30.0] if label == 5 else [128.0, 128.0, 128.0])
    values: dict[str, object] = {"plane": 1, "last_frame": FRAMES - 1, **more}
    made = TrackedObject(label, box, 0.9, 0.8, 0, 0, FRAMES, 10, color, None)
    return replace(made, **values)  # type: ignore[arg-type]


OBJECTS = (
    thing(1, -0.5, 0, 0.5, (0.3, 0.25, 0.12), name="crate"),
    thing(2, -0.45, 0, 0.508, (0.07, 0.07, 0.2), name="can", name_score=0.8, names=(("bottle", 0.15),)),
    thing(3, 0.3, 0, 0.5, (0.2, 0.15, 0.03), merged_labels=(7,)),
    thing(4, 2.0, 0, 0.0, (0.3, 0.3, 0.2), plane=0, last_frame=2, score=0.6),
    thing(5, 0.3, 0, 0.53, (0.08, 0.08, 0.1), name="mug", name_score=0.6, names=(("bowl", 0.3),)),
)


def plane(height: float, half: float) -> SupportPlane:
    return SupportPlane(UP, -height, np.column_stack([half * SQUARE, np.full(4, height)]))


PLANES = (plane(0.0, 3.0), plane(0.5, 1.0))


def write_place(folder: Path, *, begin_s: float = BEGIN_S) -> Path:
    """Write the recording and the results of the place into a folder; return that of the results."""
    recording = write_recording(folder / "recording", FRAMES, (48, 64))
    with ResultWriter(folder / "results") as writer:
        for index in range(FRAMES):
            rect = np.array([10.0, 11.5, 20.25, 31.0])
            seen = tuple(Sighting(o.label, o.box, None, 0.9, rect) for o in OBJECTS if o.last_frame >= index)
            heat = np.zeros((1, 1), np.float32)
            writer.add(FrameResult(index, begin_s + index, np.eye(4), seen, (), 0, heat, {}))
        points = MapPoints(
            np.zeros((20, 3), np.float32),
            np.full((20, 3), 128, np.uint8),
            np.zeros(20, np.float32),
            np.repeat([0, 1], 10).astype(np.int32),
        )
        writer.finish(ObjectsFile(UP, CAMERA, PLANES, OBJECTS), points, run_report(recording, FRAMES))
    return folder / "results"
