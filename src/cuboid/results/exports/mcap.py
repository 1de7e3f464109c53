"""MCAP: the run as one bag of ROS 2, which Foxglove and RViz open, and `ros2 bag play` plays.

    /tf                                              world -> camera_color_optical_frame
    /camera/color/image_raw/compressed               sensor_msgs/CompressedImage, JPEG
    /camera/aligned_depth_to_color/image_raw/compressedDepth    sensor_msgs/CompressedImage, PNG of 16 bits, millimetres
    /camera/color/camera_info, /camera/aligned_depth_to_color/camera_info
    /objects/markers                                 visualization_msgs/MarkerArray: a cube, its edges, its label
    /objects/detections                              vision_msgs/Detection3DArray: the label as id, the name as class
    /objects/events                                  cuboid_ros/ObjectEvent: an object appeared, moved, left, returned
    /objects/furniture                               visualization_msgs/MarkerArray: the same of furniture, once
    /map                                             sensor_msgs/PointCloud2: the global point map, once, at the start

Of a rig, the name of each camera stands in place of "camera". Each used frame has the objects that it sees. A marker
stays until its object is seen again; that of a label that was merged into another, or retired, is deleted after the
last frame that saw it.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame
from cuboid.ground.core.results import names_of
from cuboid.ground.formats.ros_messages import (
    COLOR,
    DEPTH,
    OPTICAL_FRAME,
    TRANSFORMS,
    WORLD_FRAME,
    RosBag,
    camera_topics,
    nanoseconds,
    optical_frame,
)
from cuboid.ground.geometry.box import Box
from cuboid.results.exports.shown_frames import missing_pictures, shown_frames
from cuboid.results.files import Results, TrackRow
from cuboid.results.files.rows import EventRow
from cuboid.results.views.ros_objects import (
    cloud_message,
    color_image,
    deleted_markers,
    depth_image,
    detection,
    detection_array,
    event_message,
    marker_array,
    object_markers,
)

MARKERS, DETECTIONS, EVENTS = "/objects/markers", "/objects/detections", "/objects/events"
FURNITURE, MAP = "/objects/furniture", "/map"


def write(run: Results, path: Path) -> list[str]:
    """Write the file; return a note if the recording with the pictures is missing."""
    missing = missing_pictures(run)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".cuboid-", suffix=".partial") as work:
        with RosBag(Path(work) / "bag", "--to mcap") as bag:
            _write_frames(bag, run, not missing)
        next((Path(work) / "bag").glob("*.mcap")).replace(path)
    return missing


def _write_frames(bag: RosBag, run: Results, shown: bool) -> None:
    events: dict[int, list[EventRow]] = defaultdict(list)
    for event in run.events:
        events[event.frame].append(event)
    names = names_of(run.found.objects)
    for number, (frame, pose, seen, gone) in enumerate(shown_frames(run)):
        time_ns = nanoseconds(pose.timestamp_s)
        if number == 0:
            points = run.map_points()
            if run.furniture:
                pieces = ((item.label, item.box) for item in run.furniture)
                bag.publish(FURNITURE, marker_array(bag, _markers(bag, run, pieces, {}, time_ns)), time_ns)
            bag.publish(MAP, cloud_message(bag, points.xyz, points.rgb, time_ns, WORLD_FRAME), time_ns)
        camera = run.report.camera_of(frame)
        optical = OPTICAL_FRAME if camera is None else optical_frame(camera.name)
        transform = bag.transform(pose.T_world_camera, time_ns, child=optical)
        bag.publish(TRANSFORMS, bag.transforms([transform]), time_ns)
        topics = (COLOR, DEPTH) if camera is None else camera_topics(camera.name)
        for topic in topics:
            lens = run.found.intrinsics if camera is None else camera.intrinsics
            bag.publish(f"{topic}/camera_info", bag.camera_info(lens, time_ns, optical), time_ns)
        if shown:
            _write_pictures(bag, run, frame, topics, optical, time_ns)
        markers = _markers(bag, run, ((row.label, row.box) for row in seen), names, time_ns)
        markers += [one for label in gone for one in deleted_markers(bag, label, time_ns, WORLD_FRAME)]
        bag.publish(MARKERS, marker_array(bag, markers), time_ns)
        bag.publish(DETECTIONS, _detections(bag, run, seen, names, time_ns), time_ns)
        for event in events[frame]:
            name = names.get(event.label, "")
            bag.publish(EVENTS, event_message(bag, event, name, time_ns, WORLD_FRAME), time_ns)


def _write_pictures(bag: RosBag, run: Results, index: int, topics: tuple[str, str], optical: str, time_ns: int) -> None:
    """Write a frame's picture and depth, where they can still be read."""
    try:
        frame: Frame = run.recording.read(index)
    except FrameError:
        return
    color, depth = topics
    for topic, image in (
        (f"{color}/image_raw/compressed", color_image(bag, frame.color, time_ns, optical)),
        (f"{depth}/image_raw/compressedDepth", depth_image(bag, frame.depth_m, time_ns, optical)),
    ):
        bag.publish(topic, image, time_ns)


def _markers(
    bag: RosBag, run: Results, boxes: Iterable[tuple[int, Box]], names: Mapping[int, str], time_ns: int
) -> list[Any]:
    """Return the markers of boxes with their labels."""
    return [
        one
        for label, box in boxes
        for one in object_markers(bag, label, names.get(label, ""), box, run.found.up, time_ns, WORLD_FRAME)
    ]


def _detections(bag: RosBag, run: Results, rows: list[TrackRow], names: Mapping[int, str], time_ns: int) -> Any:
    detections = []
    sigmas_m = {item.label: item.center_sigma_m for item in run.found.objects}
    for row in rows:
        score, sigma_m = run.probability_of(row), sigmas_m.get(row.label, ())
        name = names.get(row.label, "")
        detections.append(detection(bag, row.label, name, row.box, score, time_ns, WORLD_FRAME, sigma_m))
    return detection_array(bag, detections, time_ns, WORLD_FRAME)
