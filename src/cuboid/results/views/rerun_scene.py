"""A run, in progress or finished, for the rerun viewer, as entities in the tree of frames.

    world                     up, and the color of each label
    world/map                 the global point map
    world/planes/0            outline of a supporting plane
    world/objects/3           box of the object with label 3, in each frame that sees it
    world/camera              pose of the camera; world/camera_path: all of its positions
    world/camera/image        pinhole and picture; world/camera/image/objects: rectangles in it
    world/camera/depth        depth, of a run in progress

Of a rig, each camera has its name behind ``world/camera`` and ``world/camera_path``.

The timelines are ``frame`` (number in the recording) and ``time`` (seconds since the first frame).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.extras import require
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import MapPoints, SupportPlane, tag_of
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import quat_wxyz_from_rotation

APPLICATION = "cuboid"
# Sizes of drawn points and lines, metres: a voxel of the map is 1 cm wide.
POINT_M, LINE_M = 0.004, 0.003
# Distance of the picture in front of the camera, metres.
IMAGE_PLANE_M = 0.25
# Decimal places of seconds.
MICROSECOND = 6

PLANE_COLOR = (150, 158, 170)
PATH_COLOR = (230, 230, 235)


class SeenObject(Protocol):
    """An object in a frame: a sighting, or a row of tracks.csv."""

    @property
    def label(self) -> int:
        """Its label."""

    @property
    def box(self) -> Box:
        """In the world."""

    @property
    def rect_xyxy(self) -> Float64Array:
        """In the image, pixels."""


class RerunScene:
    """Logs a run to one recording of rerun.

    Parameters
    ----------
    name : str
        Of the recording.
    feature : str
        Requested feature, for the error message if rerun is missing.

    Attributes
    ----------
    stream : rr.RecordingStream
        The caller chooses its destination: `save`, `spawn` or `connect_grpc`.
    names : mapping of int to str
        Names of the objects, by label.

    Raises
    ------
    MissingExtraError
        The rerun SDK is not installed.
    """

    def __init__(self, name: str, feature: str) -> None:
        self._rr = rr = require("rerun", feature, "rerun")
        self.stream: Any = rr.RecordingStream(APPLICATION, recording_id=f"{APPLICATION}-{name}", send_properties=False)
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self._labels: set[int] = set()
        self.names: Mapping[int, str] = {}
        self._up: str | None = None
        self._first_s: float | None = None

    def pinhole(self, K: Intrinsics, camera: str = "") -> None:
        """Log the camera; of a rig, with its name."""
        for entity in ("image", "depth"):
            pinhole = self._rr.Pinhole(
                focal_length=(K.fx, K.fy),
                principal_point=(K.cx, K.cy),
                width=K.width,
                height=K.height,
                image_plane_distance=IMAGE_PLANE_M,
            )
            self.stream.log(f"{_entity(camera)}/{entity}", pinhole, static=True)

    def up(self, up: Float64Array | None) -> None:
        """Log the up axis, if it is known and not logged yet."""
        axis = _axis_of(up)
        if axis is not None and axis != self._up:
            self._up = axis
            self.stream.log("world", getattr(self._rr.ViewCoordinates, f"RIGHT_HAND_{axis}"), static=True)

    def labels(self, labels: Iterable[int]) -> None:
        """Log the colors of labels, if one of the labels is new."""
        all_labels = self._labels | set(labels)
        if all_labels != self._labels:
            self._labels = all_labels
            context = [(k, tag_of(k, self.names.get(k, "")), color_of(k)) for k in sorted(all_labels)]
            self.stream.log("/", self._rr.AnnotationContext(context), static=True)

    def map(self, points: MapPoints, *, static: bool) -> None:
        """Log the global point map."""
        self.stream.log("world/map", self._rr.Points3D(points.xyz, colors=points.rgb, radii=POINT_M), static=static)

    def planes(self, planes: Sequence[SupportPlane], *, static: bool) -> None:
        """Log the outlines of supporting planes."""
        for number, plane in enumerate(planes):
            outline = np.concatenate((plane.extent, plane.extent[:1]))
            strip = self._rr.LineStrips3D([outline], colors=PLANE_COLOR, radii=LINE_M)
            self.stream.log(f"world/planes/{number}", strip, static=static)

    def path(self, places: Float64Array, *, static: bool, camera: str = "") -> None:
        """Log the positions of the camera so far, (N, 3)."""
        strip = self._rr.LineStrips3D([places], colors=PATH_COLOR, radii=LINE_M / 2)
        self.stream.log(_entity(camera, "world/camera_path"), strip, static=static)

    def moment(self, frame: int, timestamp_s: float) -> None:
        """Set the time of the following entries."""
        self._first_s = timestamp_s if self._first_s is None else self._first_s
        self.stream.set_time("frame", sequence=frame)
        self.stream.set_time("time", duration=round(timestamp_s - self._first_s, MICROSECOND))

    def camera(self, T_world_camera: Float64Array, picture: bytes | None, camera: str = "") -> None:
        """Log the pose of the camera, and its picture as JPEG."""
        rr, T = self._rr, T_world_camera
        turn = rr.Quaternion(xyzw=quat_wxyz_from_rotation(T[:3, :3])[[1, 2, 3, 0]])
        self.stream.log(_entity(camera), rr.Transform3D(translation=T[:3, 3], quaternion=turn))
        if picture is not None:
            self.stream.log(f"{_entity(camera)}/image", rr.EncodedImage(contents=picture, media_type="image/jpeg"))

    def depth(self, png: bytes, units_per_metre: float, camera: str = "") -> None:
        """Log depth as a PNG of 16 bits."""
        image = self._rr.EncodedDepthImage(blob=png, media_type="image/png", meter=units_per_metre)
        self.stream.log(f"{_entity(camera)}/depth", image)

    def objects(self, seen: Sequence[SeenObject], camera: str = "") -> None:
        """Log the boxes of a frame, in the world and in its image."""
        rr = self._rr
        self.labels(item.label for item in seen)
        for item in seen:
            box = rr.Boxes3D(
                centers=[item.box.center],
                sizes=[item.box.size],
                quaternions=[rr.Quaternion(xyzw=quat_wxyz_from_rotation(item.box.rotation)[[1, 2, 3, 0]])],
                class_ids=[item.label],
                labels=[tag_of(item.label, self.names.get(item.label, ""))],
                radii=[LINE_M],
            )
            self.stream.log(f"world/objects/{item.label}", box)
        rects = np.array([item.rect_xyxy for item in seen]).reshape(-1, 4)
        labels = [item.label for item in seen]
        flat = rr.Boxes2D(array=rects, array_format=rr.Box2DFormat.XYXY, class_ids=labels)
        self.stream.log(f"{_entity(camera)}/image/objects", flat)

    def gone(self, labels: Iterable[int]) -> None:
        """Clear the boxes of labels that were merged or retired."""
        for label in labels:
            self.stream.log(f"world/objects/{label}", self._rr.Clear(recursive=False))

    def close(self) -> None:
        """Wait until all entries are sent."""
        self.stream.flush()
        self.stream.disconnect()


def _entity(camera: str, entity: str = "world/camera") -> str:
    """Return the entity of a camera; that of a camera of a rig has its name, with escapes for other signs."""
    escaped = "".join(letter if letter.isalnum() or letter in "-_." else f"\\{letter}" for letter in camera)
    return f"{entity}/{escaped}" if camera else entity


def _axis_of(up: Float64Array | None) -> str | None:
    """Return the axis closest to up, as rerun names it: "Z_UP", "Y_DOWN"; None if up is unknown."""
    if up is None:
        return None
    axis = int(np.argmax(np.abs(up)))
    return f"{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}"
