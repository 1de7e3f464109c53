"""Objects and the point map as ROS 2 messages, for bags (`export --to mcap`), ROS 2 and Foxglove."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import numpy as np

from cuboid.ground.arrays import Float32Array, Float64Array, UInt8Array
from cuboid.ground.core.palette import color_of
from cuboid.ground.core.results import ObjectEvent, tag_of
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.geometry.box import CORNER_SIGNS, EDGES, Box
from cuboid.results.views.pixels import encode_jpeg

# The class of an object without a name.
UNNAMED = "object"
# Constants of visualization_msgs/Marker.
CUBE, LINE_LIST, TEXT_VIEW_FACING = 1, 5, 9
ADD, DELETE = 0, 2
CUBE_ALPHA = 0.25
OUTLINE_M, TEXT_M = 0.004, 0.05
FLOAT32 = 7  # of sensor_msgs/PointField
# A picture of 640x480 takes about 50 kB at this quality, and text in it stays clean.
JPEG_QUALITY = 85
# Header of compressed_depth_image_transport before the PNG: its format, and two numbers that integer depth leaves 0.
DEPTH_HEADER = bytes(12)
DEPTH_FORMAT = "16UC1; compressedDepth png"


def detection(
    make: RosMessages,
    label: int,
    name: str,
    box: Box,
    score: float,
    time_ns: int,
    frame: str,
    center_sigma_m: Sequence[float] = (),
) -> Any:
    """Return an object as vision_msgs/Detection3D.

    Parameters
    ----------
    make : RosMessages
    label : int
        Becomes its `id`, which identifies the object in all messages.
    name : str
        Becomes the class; `UNNAMED` if it is empty.
    box : Box
        In the world.
    score : float
        Its probability, 0..1.
    time_ns : int
        Time of the image that shows it.
    frame : str
        Name of the world.
    center_sigma_m : sequence of float
        Standard deviations of the centre along the axes of the world, metres: its variances are in the covariance of
        the pose. Empty if unknown; then, as for the rotation, the variances are 0.
    """
    pose = make.pose(box_pose(box))
    hypothesis = make.make("vision_msgs/ObjectHypothesis", class_id=name or UNNAMED, score=score)
    covariance = np.zeros((6, 6))
    covariance[range(len(center_sigma_m)), range(len(center_sigma_m))] = np.square(center_sigma_m)
    placed = make.make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=covariance.ravel())
    return make.make(
        "vision_msgs/Detection3D",
        header=make.header(frame, time_ns),
        results=[make.make("vision_msgs/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=placed)],
        bbox=make.make("vision_msgs/BoundingBox3D", center=pose, size=make.xyz(box.size)),
        id=str(label),
    )


def detection_array(make: RosMessages, detections: Sequence[Any], time_ns: int, frame: str) -> Any:
    """Return the results of `detection` as vision_msgs/Detection3DArray."""
    header = make.header(frame, time_ns)
    return make.make("vision_msgs/Detection3DArray", header=header, detections=list(detections))


def event_message(make: RosMessages, event: ObjectEvent, name: str, time_ns: int, frame: str) -> Any:
    """Return an event as cuboid_ros/ObjectEvent: a place where the object was, or is, not in the scene is NaN.

    Parameters
    ----------
    make : RosMessages
    event : ObjectEvent
    name : str
        Of its object; may be empty.
    time_ns : int
        Of the image that reports it.
    frame : str
        Name of the world.
    """
    unknown = np.full(3, np.nan)
    before, after = (
        make.xyz(unknown if at_m is None else at_m, "geometry_msgs/Point") for at_m in (event.from_m, event.to_m)
    )
    return make.make(
        "cuboid_ros/ObjectEvent",
        header=make.header(frame, time_ns),
        event=event.event,
        label=event.label,
        name=name,
        from_position=before,
        to_position=after,
        score=float(event.score),
    )


def object_markers(
    make: RosMessages, label: int, name: str, box: Box, up: Float64Array | None, time_ns: int, frame: str
) -> list[Any]:
    """Return an object as visualization_msgs/Marker: its cube, its edges and its text; parameters as in `detection`."""
    T, line = box_pose(box), np.array([OUTLINE_M, 0.0, 0.0])
    ends = (CORNER_SIGNS * (box.size / 2.0))[np.array(EDGES)].reshape(-1, 3)
    above = np.eye(4)
    above[:3, 3] = box.center + (box.size[2] / 2.0 + TEXT_M) * (box.up if up is None else up)
    text, height = tag_of(label, name), np.array([0, 0, TEXT_M])
    header = make.header(frame, time_ns)
    return [
        _marker(make, label, "boxes", header, kind=CUBE, T=T, scale=box.size, alpha=CUBE_ALPHA),
        _marker(make, label, "edges", header, kind=LINE_LIST, T=T, scale=line, ends=ends),
        _marker(make, label, "labels", header, kind=TEXT_VIEW_FACING, T=above, scale=height, text=text),
    ]


def deleted_markers(make: RosMessages, label: int, time_ns: int, frame: str) -> list[Any]:
    """Return the messages that delete the markers of an object."""
    header, T, scale = make.header(frame, time_ns), np.eye(4), np.ones(3)
    names = ("boxes", "edges", "labels")
    return [_marker(make, label, name, header, kind=CUBE, T=T, scale=scale, action=DELETE) for name in names]


def marker_array(make: RosMessages, markers: Iterable[Any]) -> Any:
    """Return markers as visualization_msgs/MarkerArray."""
    return make.make("visualization_msgs/MarkerArray", markers=list(markers))


def _marker(
    make: RosMessages,
    label: int,
    namespace: str,
    header: Any,
    *,
    kind: int,
    T: Float64Array,
    scale: Float64Array,
    alpha: float = 1.0,
    text: str = "",
    ends: Float64Array | None = None,
    action: int = ADD,
) -> Any:
    red, green, blue = (part / 255.0 for part in color_of(label))
    return make.make(
        "visualization_msgs/Marker",
        header=header,
        ns=namespace,
        id=label,
        type=kind,
        action=action,
        pose=make.pose(T),
        scale=make.xyz(scale),
        color=make.make("std_msgs/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=make.make("builtin_interfaces/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[make.xyz(end, "geometry_msgs/Point") for end in (() if ends is None else ends)],
        colors=[],
        texture_resource="",
        texture=compressed_image(make, b"", "", "", 0),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=make.make("visualization_msgs/MeshFile", filename="", data=np.empty(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )


def box_pose(box: Box) -> Float64Array:
    """Return T_world_box (4, 4): centre and axes of the box."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = box.rotation, box.center
    return T


def cloud_message(make: RosMessages, xyz: Float32Array, rgb: UInt8Array, time_ns: int, frame: str) -> Any:
    """Return points (N, 3) with colors as sensor_msgs/PointCloud2: x, y, z, and the color packed as RViz expects."""
    red, green, blue = rgb.astype(np.uint32).T
    rows = np.empty((len(xyz), 4), np.float32)
    rows[:, :3] = xyz
    rows[:, 3] = (red << 16 | green << 8 | blue).view(np.float32)
    fields = [
        make.make("sensor_msgs/PointField", name=name, offset=4 * k, datatype=FLOAT32, count=1)
        for k, name in enumerate(("x", "y", "z", "rgb"))
    ]
    return make.make(
        "sensor_msgs/PointCloud2",
        header=make.header(frame, time_ns),
        height=1,
        width=len(rows),
        fields=fields,
        is_bigendian=False,
        point_step=16,
        row_step=16 * len(rows),
        data=rows.view(np.uint8).reshape(-1),
        is_dense=True,
    )


def color_image(make: RosMessages, color: UInt8Array, time_ns: int, frame: str) -> Any:
    """Return a color image (H, W, 3) as sensor_msgs/CompressedImage, JPEG."""
    return compressed_image(make, encode_jpeg(color, JPEG_QUALITY), "jpeg", frame, time_ns)


def depth_image(make: RosMessages, depth_m: Float32Array, time_ns: int, frame: str) -> Any:
    """Return depth (H, W) as sensor_msgs/CompressedImage: a PNG of 16 bits, millimetres."""
    millimetres = np.clip(np.rint(depth_m * np.float32(1000.0)), 0, 65535).astype(np.uint16)
    png = cv2.imencode(".png", millimetres, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    return compressed_image(make, DEPTH_HEADER + png, DEPTH_FORMAT, frame, time_ns)


def compressed_image(make: RosMessages, data: bytes, form: str, frame: str, time_ns: int) -> Any:
    """Return a sensor_msgs/CompressedImage."""
    header = make.header(frame, time_ns)
    return make.make("sensor_msgs/CompressedImage", header=header, format=form, data=np.frombuffer(data, np.uint8))
