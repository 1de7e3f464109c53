"""MCAP: the run as one bag of ROS 2, which Foxglove and RViz open, and `ros2 bag play` plays.

    /tf                                              world -> camera_color_optical_frame
    /camera/color/image_raw/compressed               sensor_msgs/CompressedImage, JPEG
    /camera/aligned_depth_to_color/image_raw/compressedDepth    sensor_msgs/CompressedImage, PNG of 16 bits, millimetres
    /camera/color/camera_info, /camera/aligned_depth_to_color/camera_info
    /objects/markers                                 visualization_msgs/MarkerArray: a cube, its edges, its label
    /objects/detections                              vision_msgs/Detection3DArray, the label as id
    /map                                             sensor_msgs/PointCloud2: the global point map, once, at the start

Each used frame has the objects that it sees. A marker stays until its object is seen again; that of a label that was
merged into another, or retired, is deleted after the last frame that saw it.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cuboid.core.errors import FrameError
from cuboid.core.frame import Float64Array, Frame
from cuboid.core.palette import color_of
from cuboid.core.results import MapPoints, names_of, tag_of
from cuboid.exports.registry import EXPORTS, Export
from cuboid.formats.ros_messages import COLOR, DEPTH, OPTICAL_FRAME, TRANSFORMS, WORLD_FRAME, RosBag, nanoseconds
from cuboid.formats.stored import is_there
from cuboid.geometry.box import CORNER_SIGNS, EDGES, Box
from cuboid.outputs import Results, TrackRow
from cuboid.views.report.pictures import encode_jpeg

MARKERS, DETECTIONS, MAP = "/objects/markers", "/objects/detections", "/map"
# Numbers of visualization_msgs/Marker.
CUBE, LINE_LIST, TEXT_VIEW_FACING = 1, 5, 9
ADD, DELETE = 0, 2
CUBE_ALPHA = 0.25
LINE_M, TEXT_M = 0.004, 0.05
JPEG_QUALITY = 85
# compressed_depth_image_transport writes this before the PNG: its format, and two numbers that whole depth lacks.
DEPTH_HEADER = bytes(12)
FLOAT32 = 7  # of sensor_msgs/PointField


def write(run: Results, path: Path) -> list[str]:
    """Write the file; return a note if the recording with the pictures is missing."""
    shown = run.recording_path is not None or is_there(run.report.recording)
    if shown:
        _ = run.recording  # a wrong one is found before anything is written
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".cuboid-", suffix=".partial") as work:
        with RosBag(Path(work) / "bag", "--to mcap") as bag:
            _write_frames(bag, run, shown)
        next((Path(work) / "bag").glob("*.mcap")).replace(path)
    return [] if shown else [f"{run.report.recording} is not there: no pictures (--recording says where it is)"]


def _write_frames(bag: RosBag, run: Results, shown: bool) -> None:
    seen: dict[int, list[TrackRow]] = defaultdict(list)
    last_seen: dict[int, int] = {}
    for row in run.tracks:
        seen[row.frame].append(row)
        last_seen[row.label] = row.frame
    lasting, names = {item.label for item in run.found.objects}, names_of(run.found.objects)
    gone: list[int] = []
    for number, (frame, pose) in enumerate(run.poses.items()):
        time_ns = nanoseconds(pose.timestamp_s)
        if number == 0:
            bag.publish(MAP, _cloud(bag, run.map_points(), time_ns), time_ns)
        bag.publish(TRANSFORMS, bag.transform(pose.T_world_camera, time_ns), time_ns)
        for topic in (COLOR, DEPTH):
            bag.publish(f"{topic}/camera_info", bag.camera_info(run.found.intrinsics, time_ns), time_ns)
        if shown:
            _write_pictures(bag, run, frame, time_ns)
        markers = [
            one
            for row in seen[frame]
            for one in _markers(bag, row.label, names.get(row.label, ""), row.box, run.found.up, time_ns)
        ]
        markers += [one for label in gone for one in _deleted(bag, label, time_ns)]
        bag.publish(MARKERS, bag.make("visualization_msgs/MarkerArray", markers=markers), time_ns)
        bag.publish(DETECTIONS, _detections(bag, run, seen[frame], time_ns), time_ns)
        gone = [row.label for row in seen[frame] if row.label not in lasting and last_seen[row.label] == frame]


def _write_pictures(bag: RosBag, run: Results, index: int, time_ns: int) -> None:
    """Write a frame's picture and depth, where they can still be read."""
    try:
        frame: Frame = run.recording.read(index)
    except FrameError:
        return
    millimetres = np.clip(np.rint(frame.depth_m * np.float32(1000.0)), 0, 65535).astype(np.uint16)
    png = cv2.imencode(".png", millimetres, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    for topic, kind, data in (
        (f"{COLOR}/image_raw/compressed", "jpeg", encode_jpeg(frame.color, JPEG_QUALITY)),
        (f"{DEPTH}/image_raw/compressedDepth", "16UC1; compressedDepth png", DEPTH_HEADER + png),
    ):
        image = bag.make(
            "sensor_msgs/CompressedImage",
            header=bag.header(OPTICAL_FRAME, time_ns),
            format=kind,
            data=np.frombuffer(data, np.uint8),
        )
        bag.publish(topic, image, time_ns)


def _detections(bag: RosBag, run: Results, rows: list[TrackRow], time_ns: int) -> Any:
    detections = []
    for row in rows:
        pose = bag.pose(_T_world_box(row.box))
        ended = run.survivor.get(row.label)
        score = 0.0 if ended is None else float(ended.score)
        hypothesis = bag.make("vision_msgs/ObjectHypothesis", class_id="object", score=score)
        sure = bag.make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
        detections.append(
            bag.make(
                "vision_msgs/Detection3D",
                header=bag.header(WORLD_FRAME, time_ns),
                results=[bag.make("vision_msgs/ObjectHypothesisWithPose", hypothesis=hypothesis, pose=sure)],
                bbox=bag.make("vision_msgs/BoundingBox3D", center=pose, size=bag.xyz(row.box.size)),
                id=str(row.label),
            )
        )
    return bag.make("vision_msgs/Detection3DArray", header=bag.header(WORLD_FRAME, time_ns), detections=detections)


def _markers(bag: RosBag, label: int, name: str, box: Box, up: Float64Array | None, time_ns: int) -> list[Any]:
    """Return the cube, the edges and the text of an object."""
    T, line = _T_world_box(box), np.array([LINE_M, 0.0, 0.0])
    ends = (CORNER_SIGNS * (box.size / 2.0))[np.array(EDGES)].reshape(-1, 3)
    above = np.eye(4)
    above[:3, 3] = box.center + (box.size[2] / 2.0 + TEXT_M) * (box.up if up is None else up)
    return [
        _marker(bag, label, "boxes", time_ns, kind=CUBE, T=T, scale=box.size, alpha=CUBE_ALPHA),
        _marker(bag, label, "edges", time_ns, kind=LINE_LIST, T=T, scale=line, ends=ends),
        _marker(
            bag,
            label,
            "labels",
            time_ns,
            kind=TEXT_VIEW_FACING,
            T=above,
            scale=np.array([0, 0, TEXT_M]),
            text=tag_of(label, name),
        ),
    ]


def _deleted(bag: RosBag, label: int, time_ns: int) -> list[Any]:
    """Return the messages that delete the markers of an object."""
    names = ("boxes", "edges", "labels")
    return [
        _marker(bag, label, name, time_ns, kind=CUBE, T=np.eye(4), scale=np.ones(3), action=DELETE) for name in names
    ]


def _marker(
    bag: RosBag,
    label: int,
    namespace: str,
    time_ns: int,
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
    return bag.make(
        "visualization_msgs/Marker",
        header=bag.header(WORLD_FRAME, time_ns),
        ns=namespace,
        id=label,
        type=kind,
        action=action,
        pose=bag.pose(T),
        scale=bag.xyz(scale),
        color=bag.make("std_msgs/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=bag.make("builtin_interfaces/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[bag.xyz(end, "geometry_msgs/Point") for end in (() if ends is None else ends)],
        colors=[],
        texture_resource="",
        texture=bag.make(
            "sensor_msgs/CompressedImage", header=bag.header("", 0), format="", data=np.empty(0, np.uint8)
        ),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=bag.make("visualization_msgs/MeshFile", filename="", data=np.empty(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )


def _T_world_box(box: Box) -> Float64Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = box.rotation, box.center
    return T


def _cloud(bag: RosBag, points: MapPoints, time_ns: int) -> Any:
    """Return the point map: x y z, and the color as RViz packs it."""
    red, green, blue = points.rgb.astype(np.uint32).T
    rows = np.empty((len(points.xyz), 4), np.float32)
    rows[:, :3] = points.xyz
    rows[:, 3] = (red << 16 | green << 8 | blue).view(np.float32)
    fields = [
        bag.make("sensor_msgs/PointField", name=name, offset=4 * k, datatype=FLOAT32, count=1)
        for k, name in enumerate(("x", "y", "z", "rgb"))
    ]
    return bag.make(
        "sensor_msgs/PointCloud2",
        header=bag.header(WORLD_FRAME, time_ns),
        height=1,
        width=len(rows),
        fields=fields,
        is_bigendian=False,
        point_step=16,
        row_step=16 * len(rows),
        data=rows.view(np.uint8).reshape(-1),
        is_dense=True,
    )


EXPORTS.register("mcap")(
    Export(
        ".mcap", "Foxglove, RViz, `ros2 bag play`: one bag with images, `tf`, markers, detections", write, extra="ros"
    )
)
