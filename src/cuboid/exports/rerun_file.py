"""rerun: the run as a recording for the rerun viewer, its entities named after the tree of frames.

    world                     up, and the color of each label
    world/map                 the global point map
    world/planes/0            outline of a supporting plane
    world/objects/3           box of the object with label 3, in each frame that sees it
    world/camera              pose of the camera; world/camera_path: all of its places
    world/camera/image        pinhole and picture; world/camera/image/objects: rectangles in it

The timelines are ``frame`` (number in the recording) and ``time`` (seconds since the first frame). A label that was
merged into another, or retired, is cleared after the last frame that saw it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cuboid.errors import FrameError, MissingExtraError
from cuboid.exports.finished import FinishedRun
from cuboid.exports.registry import EXPORTS, Export
from cuboid.frame import Float64Array
from cuboid.geometry.se3 import quat_wxyz_from_rotation
from cuboid.outputs import TrackRow
from cuboid.outputs.text import LENGTH, rounded
from cuboid.results import names_of, tag_of
from cuboid.views.palette import color_of
from cuboid.views.report.pictures import encode_jpeg

APPLICATION = "cuboid"

# A picture of 640x480 is about 50 kB at this quality, and lines of text in it stay clean.
JPEG_QUALITY = 85

# Sizes of what is drawn, metres: a voxel of the map is 1 cm wide.
POINT_M, LINE_M = 0.004, 0.003
# How far in front of the camera its picture hangs, metres.
IMAGE_PLANE_M = 0.25

PLANE_COLOR = (150, 158, 170)
PATH_COLOR = (230, 230, 235)


def write(run: FinishedRun, path: Path) -> list[str]:
    """Write the file; says so where the recording, which has the pictures, is not there."""
    try:
        import rerun as rr
    except ImportError:
        raise MissingExtraError("'--to rerun' needs the rerun SDK: pip install 'cuboid[rerun]'") from None
    shown = run.recording_path is not None or Path(run.report.recording).exists()
    if shown:
        _ = run.recording  # a wrong one is found before anything is written
    name = Path(run.report.recording).name
    stream = rr.RecordingStream(APPLICATION, recording_id=f"{APPLICATION}-{name}", send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.save(path)
    _log_scene(rr, stream, run)
    _log_frames(rr, stream, run, shown)
    stream.flush()
    stream.disconnect()
    return [] if shown else [f"{run.report.recording} is not there: no pictures (--recording says where it is)"]


def _log_scene(rr: Any, stream: Any, run: FinishedRun) -> None:
    """Log what does not change: the map, planes, the camera's path and its pinhole."""
    found, K = run.found, run.found.intrinsics
    labels = sorted({row.label for row in run.tracks} | {item.label for item in found.objects})
    names = names_of(found.objects)
    kinds = [(label, tag_of(label, names.get(label, "")), color_of(label)) for label in labels]
    up = _axis_of(found.up)
    if up is not None:
        stream.log("world", getattr(rr.ViewCoordinates, f"RIGHT_HAND_{up}"), static=True)
    stream.log("/", rr.AnnotationContext(kinds), static=True)
    stream.log("world/map", rr.Points3D(run.points.xyz, colors=run.points.rgb, radii=POINT_M), static=True)
    for number, plane in enumerate(found.planes):
        outline = np.concatenate((plane.extent, plane.extent[:1]))
        strip = rr.LineStrips3D([outline], colors=PLANE_COLOR, radii=LINE_M)
        stream.log(f"world/planes/{number}", strip, static=True)
    places = np.array([pose.T_world_camera[:3, 3] for pose in run.poses.values()]).reshape(-1, 3)
    stream.log("world/camera_path", rr.LineStrips3D([places], colors=PATH_COLOR, radii=LINE_M / 2), static=True)
    pinhole = rr.Pinhole(
        focal_length=(K.fx, K.fy),
        principal_point=(K.cx, K.cy),
        width=K.width,
        height=K.height,
        image_plane_distance=IMAGE_PLANE_M,
    )
    stream.log("world/camera/image", pinhole, static=True)


def _log_frames(rr: Any, stream: Any, run: FinishedRun, shown: bool) -> None:
    """Log pose, picture and objects of each used frame."""
    seen: dict[int, list[TrackRow]] = defaultdict(list)
    last_seen: dict[int, int] = {}
    for row in run.tracks:
        seen[row.frame].append(row)
        last_seen[row.label] = row.frame
    lasting, names = {item.label for item in run.found.objects}, names_of(run.found.objects)
    gone: list[int] = []
    first_s = next((pose.timestamp_s for pose in run.poses.values()), 0.0)
    for frame, pose in run.poses.items():
        stream.set_time("frame", sequence=frame)
        stream.set_time("time", duration=rounded(pose.timestamp_s - first_s, LENGTH))
        T = pose.T_world_camera
        turn = rr.Quaternion(xyzw=quat_wxyz_from_rotation(T[:3, :3])[[1, 2, 3, 0]])
        stream.log("world/camera", rr.Transform3D(translation=T[:3, 3], quaternion=turn))
        picture = _picture(run, frame) if shown else None
        if picture is not None:
            stream.log("world/camera/image", rr.EncodedImage(contents=picture, media_type="image/jpeg"))
        _log_objects(rr, stream, seen[frame], names)
        for label in gone:
            stream.log(f"world/objects/{label}", rr.Clear(recursive=False))
        gone = [row.label for row in seen[frame] if row.label not in lasting and last_seen[row.label] == frame]


def _log_objects(rr: Any, stream: Any, rows: list[TrackRow], names: Mapping[int, str]) -> None:
    for row in rows:
        box = rr.Boxes3D(
            centers=[row.box.center],
            sizes=[row.box.size],
            quaternions=[rr.Quaternion(xyzw=quat_wxyz_from_rotation(row.box.rotation)[[1, 2, 3, 0]])],
            class_ids=[row.label],
            labels=[tag_of(row.label, names.get(row.label, ""))],
            radii=[LINE_M],
        )
        stream.log(f"world/objects/{row.label}", box)
    labels = [row.label for row in rows]
    rects = np.array([row.rect_xyxy for row in rows]).reshape(-1, 4)
    flat = rr.Boxes2D(array=rects, array_format=rr.Box2DFormat.XYXY, class_ids=labels)
    stream.log("world/camera/image/objects", flat)


def _picture(run: FinishedRun, frame: int) -> bytes | None:
    """Return a frame's picture as JPEG; None where it can no longer be read."""
    try:
        return encode_jpeg(run.recording.read(frame).color, JPEG_QUALITY)
    except FrameError:
        return None


def _axis_of(up: Float64Array | None) -> str | None:
    """Return the axis that is next to up, as rerun names it: "Z_UP", "Y_DOWN"; None where up is not known."""
    if up is None:
        return None
    axis = int(np.argmax(np.abs(up)))
    return f"{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}"


EXPORTS.register("rerun")(Export(".rrd", write))
