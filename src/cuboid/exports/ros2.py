"""ROS 2: the map of objects as the fields of two messages.

``marker_array`` has those of ``visualization_msgs/MarkerArray`` (for RViz: a see-through cube, its edges and its label
an object), ``detections`` those of ``vision_msgs/Detection3DArray``. Fields with the message's own default are left
out, so that ``rosidl_runtime_py.set_message_fields(message, fields)`` takes them as they are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cuboid.exports.finished import FinishedRun
from cuboid.exports.registry import EXPORTS, Export
from cuboid.frame import Float64Array
from cuboid.geometry.box import CORNER_SIGNS, EDGES
from cuboid.geometry.se3 import quat_wxyz_from_rotation
from cuboid.outputs.objects import write_json
from cuboid.outputs.text import DIRECTION, LENGTH, rounded
from cuboid.results import TrackedObject, tag_of
from cuboid.views.palette import color_of

FRAME_ID = "world"

# Numbers of visualization_msgs/Marker.
CUBE, LINE_LIST, TEXT_VIEW_FACING = 1, 5, 9

CUBE_ALPHA = 0.25
LINE_M = 0.004
TEXT_M = 0.05


def write(run: FinishedRun, path: Path) -> list[str]:
    """Write the file."""
    objects = run.found.objects
    last_s = max((pose.timestamp_s for pose in run.poses.values()), default=0.0)
    markers = [marker for item in objects for marker in (_cube(item), _edges(item), _text(item, run.found.up))]
    document = {
        "marker_array": {"markers": markers},
        "detections": {
            "header": {"stamp": stamp(last_s), "frame_id": FRAME_ID},
            "detections": [_detection(item, last_s) for item in objects],
        },
    }
    write_json(path, document)
    return []


def stamp(time_s: float) -> dict[str, int]:
    """Return a builtin_interfaces/Time of seconds."""
    seconds, nanoseconds = divmod(round(time_s * 1e6) * 1000, 10**9)
    return {"sec": seconds, "nanosec": nanoseconds}


def _detection(item: TrackedObject, last_s: float) -> dict[str, Any]:
    pose = _pose(item.box.center, item.box.rotation)
    hypothesis = {"class_id": "object", "score": rounded(item.score, LENGTH)}
    return {
        "header": {"stamp": stamp(last_s), "frame_id": FRAME_ID},
        "results": [{"hypothesis": hypothesis, "pose": {"pose": pose}}],
        "bbox": {"center": pose, "size": _xyz(item.box.size)},
        "id": str(item.label),
    }


def _cube(item: TrackedObject) -> dict[str, Any]:
    pose = _pose(item.box.center, item.box.rotation)
    return _marker(item, "boxes", CUBE, pose, _xyz(item.box.size), CUBE_ALPHA)


def _edges(item: TrackedObject) -> dict[str, Any]:
    ends = (CORNER_SIGNS * (item.box.size / 2.0))[np.array(EDGES)].reshape(-1, 3)
    pose = _pose(item.box.center, item.box.rotation)
    marker = _marker(item, "edges", LINE_LIST, pose, {"x": LINE_M}, 1.0)
    return {**marker, "points": [_xyz(end) for end in ends]}


def _text(item: TrackedObject, up: Float64Array | None) -> dict[str, Any]:
    above = item.box.center + (item.box.size[2] / 2.0 + TEXT_M) * (item.box.up if up is None else up)
    marker = _marker(item, "labels", TEXT_VIEW_FACING, _pose(above, np.eye(3)), {"z": TEXT_M}, 1.0)
    return {**marker, "text": tag_of(item.label, item.name)}


def _marker(
    item: TrackedObject, namespace: str, kind: int, pose: dict[str, Any], scale: dict[str, float], alpha: float
) -> dict[str, Any]:
    """Return a marker of an object; without a time stamp, which stands for the latest transform."""
    red, green, blue = (rounded(part / 255.0, LENGTH) for part in color_of(item.label))
    return {
        "header": {"frame_id": FRAME_ID},
        "ns": namespace,
        "id": item.label,
        "type": kind,
        "pose": pose,
        "scale": scale,
        "color": {"r": red, "g": green, "b": blue, "a": alpha},
    }


def _pose(position: Float64Array, rotation: Float64Array) -> dict[str, Any]:
    w, x, y, z = (rounded(part, DIRECTION) for part in quat_wxyz_from_rotation(rotation))
    return {"position": _xyz(position), "orientation": {"x": x, "y": y, "z": z, "w": w}}


def _xyz(vector: Float64Array) -> dict[str, float]:
    return {axis: rounded(value, LENGTH) for axis, value in zip("xyz", vector, strict=True)}


EXPORTS.register("ros2")(Export(".json", write))
