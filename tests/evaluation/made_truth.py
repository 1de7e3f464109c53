"""Truth files and results of boxes on a level floor, small enough to compute by hand."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.overlap import pack
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation
from cuboid.lab.evaluation.matching import FrameOverlap
from cuboid.results.files import ObjectsFile, RunReport, write_objects, write_run

LEVEL = np.eye(3)


def cube(x: float, y: float = 0.0, side: float = 0.1) -> Box:
    """Return a cube that stands on the floor z = 0."""
    return Box(np.array([x, y, side / 2]), np.full(3, side), LEVEL)


def rows(boxes: Iterable[Box]) -> np.ndarray:
    return pack(list(boxes))


def truth_document(
    boxes: Sequence[Box],
    frames: int = 10,
    shown: dict[int, list[list[float]]] | None = None,
    **more: Any,
) -> dict[str, Any]:
    """Return a truth whose objects 1, 2, ... are fully visible in all frames, but as `shown` and `more` say."""
    everything = {str(k + 1): [[1.0, frames]] for k in range(len(boxes))}
    everything |= {str(k): runs for k, runs in (shown or {}).items()}
    return {
        "format": "cuboid-truth",
        "version": 1,
        "name": "by hand",
        "frames": frames,
        "objects": [
            {"id": k + 1, "name": f"cube {k + 1}", "judged": True, **as_json(box)} for k, box in enumerate(boxes)
        ],
        "visibility": {"frames": frames, "objects": everything},
        **more,
    }


def as_json(box: Box) -> dict[str, Any]:
    return {"center": box.center.tolist(), "size": box.size.tolist(), "rotation": box.rotation.tolist()}


def write_truth(folder: Path, document: dict[str, Any]) -> Path:
    path = folder / "truth.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def write_csv(folder: Path, sightings: Iterable[tuple[int, int, Box]], name: str = "tracks.csv") -> Path:
    """Write (frame, label, box) as another tracker would."""
    lines = ["frame,label,cx,cy,cz,length,width,height,qw,qx,qy,qz"]
    for frame, label, box in sightings:
        lines.append(",".join(map(str, (frame, label, *box.center, *box.size, *quat_wxyz_from_rotation(box.rotation)))))
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def follow(box: Box, label: int, frames: range) -> list[tuple[int, int, Box]]:
    """Return sightings of a box in each of the frames."""
    return [(frame, label, box) for frame in frames]


def write_folder(
    folder: Path,
    box: Box,
    seen: range,
    *,
    read: int,
    every: int = 1,
    skipped: tuple[int, ...] = (),
    poses: str = "given",
) -> None:
    """Write the results of a run that saw one object, labelled 3."""
    item = TrackedObject(3, box, 0.9, 0.9, 0, 9, 9, 100, np.zeros(3), None)
    K = Intrinsics(500.0, 500.0, 320.0, 240.0, 640, 480)
    write_objects(folder / "objects.json", ObjectsFile(None, K, (), (item,)))
    faults = tuple((frame, "no depth") for frame in skipped)
    used = read - len(skipped)
    run = RunReport("1", True, "r", "f", poses, 1, {"every": every}, read, used, faults, {}, 1.0, 1.0)
    write_run(folder / "run.json", run)
    write_csv(folder, follow(box, 3, seen))


def frame(k: int, truth: list[int], found: list[int], iou: list[list[float]]) -> FrameOverlap:
    return FrameOverlap(
        k, np.array(truth, int), np.array(found, int), np.array(iou, float).reshape(len(truth), len(found))
    )
