"""The topics of ROS 2 for a running tracker: messages of each frame, and messages at intervals.

/cuboid/detections    vision_msgs/Detection3DArray       the objects seen in the frame
/cuboid/markers       visualization_msgs/MarkerArray     the same as boxes and text; all objects once a second
/cuboid/events        cuboid_ros/ObjectEvent             an object appeared, moved, left or returned
/cuboid/map           sensor_msgs/PointCloud2            the point map, if `map_every_s` is set
/cuboid/cloud         sensor_msgs/PointCloud2            requested points
/tf                   tf2_msgs/TFMessage                 the camera, and the objects if `object_frames` is set
/diagnostics          diagnostic_msgs/DiagnosticArray    state of the run
/cuboid/color/compressed, /cuboid/depth/compressedDepth, /cuboid/camera_info    for clients without another source;
                      of a rig, the name of each camera follows /cuboid
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float32Array, UInt8Array
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult, TrackedObject
from cuboid.ground.formats.ros_messages import (
    OPTICAL_FRAME,
    TRANSFORMS,
    RosMessages,
    nanoseconds,
    optical_frame,
    ros_name,
)
from cuboid.ground.middleware.transport import Outlet, Outlets, Qos
from cuboid.results.views.live.watch import TrackerView
from cuboid.results.views.ros_objects import (
    box_pose,
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

NODE, WORLD = "cuboid", "map"
DIAGNOSTICS = "/diagnostics"
# Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, STALE = 0, 1, 3
# Interval between messages with all objects, seconds, for clients that connect late; other messages have only the
# objects in view.
ALL_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """Messages that are sent in addition to the detections.

    Attributes
    ----------
    object_frames : bool
        Send a frame of `tf` for each object, `object_3` for the label 3.
    min_probability : float
        Objects with a lower probability are not sent, 0..1; `TrackerConfig.min_probability` comes first.
    map_every_s : float
        Interval between two point maps, seconds; 0: on request only.
    """

    object_frames: bool = False
    min_probability: float = 0.0
    map_every_s: float = 0.0


class Topic:
    """A topic on all its carriers; a message is encoded once, and sent to carriers with subscribers."""

    def __init__(self, messages: RosMessages, carriers: Iterable[Outlets], name: str, kind: str, qos: Qos) -> None:
        self._messages, self._latched = messages, qos is Qos.LATCHED
        self._outlets: list[Outlet] = [carrier.outlet(name, kind, qos) for carrier in carriers]

    def wanted(self) -> bool:
        """Return whether there is a subscriber."""
        return any(outlet.wanted() for outlet in self._outlets)

    def send(self, message: Any, time_ns: int) -> None:
        """Send a message to all subscribers; on a latched topic also to later subscribers."""
        data = self._messages.encode(message)
        for outlet in self._outlets:
            if self._latched or outlet.wanted():
                outlet.send(data, time_ns)


class RosStream:
    """Sends the results of a tracker.

    Parameters
    ----------
    messages : RosMessages
    carriers : sequence of Outlets
    intrinsics : Intrinsics
    node : str
        Prefix of the names of its own topics.
    world, camera : str
        Frames of `tf`: the world, and the camera.
    camera_moves : bool
        Whether to send the pose of the camera; False if another node provides it.
    pictures : sequence of Outlets
        The `carriers` that also get color, depth and the camera.
    cameras : sequence of str
        Names of the cameras of a rig: the frames of each have topics and a frame of `tf` of their own.

    Attributes
    ----------
    settings : StreamSettings
    names : mapping of int to str
        Names that users gave, by label; they take precedence over the names of a detector.
    """

    def __init__(
        self,
        messages: RosMessages,
        carriers: Sequence[Outlets],
        intrinsics: Intrinsics,
        *,
        node: str = NODE,
        world: str = WORLD,
        camera: str = OPTICAL_FRAME,
        camera_moves: bool = True,
        pictures: Sequence[Outlets] = (),
        cameras: Sequence[str] = (),
    ) -> None:
        self.settings = StreamSettings()
        self.names: Mapping[int, str] = {}
        self.world, self.camera = world, camera
        self._messages, self._intrinsics, self._camera_moves = messages, intrinsics, camera_moves

        def topic(name: str, kind: str, qos: Qos, to: Sequence[Outlets] = carriers) -> Topic:
            return Topic(messages, to, name, kind, qos)

        self._detections = topic(f"/{node}/detections", "vision_msgs/msg/Detection3DArray", Qos.RELIABLE)
        self._markers = topic(f"/{node}/markers", "visualization_msgs/msg/MarkerArray", Qos.RELIABLE)
        self._events = topic(f"/{node}/events", "cuboid_ros/msg/ObjectEvent", Qos.RELIABLE)
        self._map = topic(f"/{node}/map", "sensor_msgs/msg/PointCloud2", Qos.LATCHED)
        self._cloud = topic(f"/{node}/cloud", "sensor_msgs/msg/PointCloud2", Qos.LATCHED)
        self._transforms = topic(TRANSFORMS, "tf2_msgs/msg/TFMessage", Qos.RELIABLE)
        self._diagnostics = topic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", Qos.RELIABLE)
        self._picture_topic = partial(topic, qos=Qos.RELIABLE, to=pictures)
        # Topics of color, depth and lens, by the name of the camera in a rig; offered from the start without a rig.
        self._pictures: dict[str, tuple[Topic, Topic, Topic]] = {}
        self._name = node
        if not cameras:
            self._picture_topics("")
        for name in cameras:
            self._picture_topics(name)
        self._shown: set[int] = set()
        self._all_s = self._map_s = float("-inf")

    def frame(self, frame: Frame, result: FrameResult, tracker: TrackerView, time_ns: int) -> None:
        """Send the results of a frame.

        Parameters
        ----------
        frame : Frame
        result : FrameResult
        tracker : TrackerView
        time_ns : int
            Stamp of its image.
        """
        objects = {item.label: item for item in tracker.objects if item.probability >= self.settings.min_probability}
        seen = [objects[sighting.label] for sighting in result.sightings if sighting.label in objects]
        optical = optical_frame(frame.camera_name) if frame.camera_name else self.camera
        self._send_transforms(result, objects, optical, time_ns)
        if self._detections.wanted():
            self._detections.send(self.detections(seen, time_ns), time_ns)
        self._send_markers(objects, seen, tracker, time_ns)
        self._send_events(result, objects, time_ns)
        self._send_pictures(frame, optical, time_ns)
        every_s, now_s = self.settings.map_every_s, time.monotonic()
        if every_s and now_s - self._map_s >= every_s and self._map.wanted():
            self._map_s = now_s
            points = tracker.map_points()
            self._map.send(self.cloud(points.xyz, points.rgb, time_ns), time_ns)

    def detections(self, objects: Iterable[TrackedObject], time_ns: int) -> Any:
        """Return objects as vision_msgs/Detection3DArray."""
        made = [
            detection(
                self._messages,
                item.label,
                self._name_of(item),
                item.box,
                item.probability,
                time_ns,
                self.world,
                item.center_sigma_m,
            )
            for item in objects
        ]
        return detection_array(self._messages, made, time_ns, self.world)

    def cloud(self, xyz: Float32Array, rgb: UInt8Array, time_ns: int) -> Any:
        """Return points (N, 3) with colors as sensor_msgs/PointCloud2."""
        return cloud_message(self._messages, xyz, rgb, time_ns, self.world)

    def empty_cloud(self, time_ns: int) -> Any:
        """Return a sensor_msgs/PointCloud2 without points."""
        return self.cloud(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8), time_ns)

    def send_cloud(self, cloud: Any, time_ns: int) -> None:
        """Send requested points."""
        self._cloud.send(cloud, time_ns)

    def clear(self, time_ns: int) -> None:
        """Delete all markers, since the map starts again."""
        gone = [
            marker
            for label in sorted(self._shown)
            for marker in deleted_markers(self._messages, label, time_ns, self.world)
        ]
        self._markers.send(marker_array(self._messages, gone), time_ns)
        self._shown.clear()
        self._all_s = self._map_s = float("-inf")

    def diagnose(self, level: int, message: str, values: Mapping[str, object], time_ns: int) -> None:
        """Send the state of the run.

        Parameters
        ----------
        level : {OK, WARN, STALE}
        message : str
            A few words.
        values : mapping of str to object
            Figures, by name.
        time_ns : int
            Present time by the clock of the node.
        """
        make = self._messages.make
        pairs = [make("diagnostic_msgs/KeyValue", key=key, value=str(value)) for key, value in values.items()]
        status = make(
            "diagnostic_msgs/DiagnosticStatus",
            level=level,
            name=f"{self._name}: tracking",
            message=message,
            hardware_id=self.camera,
            values=pairs,
        )
        header = self._messages.header("", time_ns)
        self._diagnostics.send(make("diagnostic_msgs/DiagnosticArray", header=header, status=[status]), time_ns)

    def _name_of(self, item: TrackedObject) -> str:
        return self.names.get(item.label) or item.name or ""

    def _send_transforms(
        self, result: FrameResult, objects: Mapping[int, TrackedObject], optical: str, time_ns: int
    ) -> None:
        make, made = self._messages.transform, []
        if self._camera_moves:
            made.append(make(result.T_world_camera, time_ns, self.world, optical))
        if self.settings.object_frames:
            made += [
                make(box_pose(item.box), time_ns, self.world, f"object_{label}") for label, item in objects.items()
            ]
        if made:
            self._transforms.send(self._messages.transforms(made), time_ns)

    def _send_markers(
        self,
        objects: Mapping[int, TrackedObject],
        seen: Sequence[TrackedObject],
        tracker: TrackerView,
        time_ns: int,
    ) -> None:
        if not self._markers.wanted():
            return
        now_s, shown = time.monotonic(), seen
        if now_s - self._all_s >= ALL_EVERY_S:
            self._all_s, shown = now_s, list(objects.values())
        markers = [
            marker
            for item in shown
            for marker in object_markers(
                self._messages, item.label, self._name_of(item), item.box, tracker.up, time_ns, self.world
            )
        ]
        for label in sorted(self._shown - set(objects)):
            markers += deleted_markers(self._messages, label, time_ns, self.world)
        self._shown = (self._shown & set(objects)) | {item.label for item in shown}
        self._markers.send(marker_array(self._messages, markers), time_ns)

    def _send_events(self, result: FrameResult, objects: Mapping[int, TrackedObject], time_ns: int) -> None:
        for event in result.events if self._events.wanted() else ():
            item = objects.get(event.label)
            name = self.names.get(event.label, "") if item is None else self._name_of(item)
            self._events.send(event_message(self._messages, event, name, time_ns, self.world), time_ns)

    def _picture_topics(self, camera: str) -> tuple[Topic, Topic, Topic]:
        """Return the topics of color, depth and lens of a camera."""
        if camera not in self._pictures:
            prefix = f"/{self._name}/{ros_name(camera)}" if camera else f"/{self._name}"
            image = "sensor_msgs/msg/CompressedImage"
            self._pictures[camera] = (
                self._picture_topic(f"{prefix}/color/compressed", image),
                self._picture_topic(f"{prefix}/depth/compressedDepth", image),
                self._picture_topic(f"{prefix}/camera_info", "sensor_msgs/msg/CameraInfo"),
            )
        return self._pictures[camera]

    def _send_pictures(self, frame: Frame, optical: str, time_ns: int) -> None:
        color, depth, lens = self._picture_topics(frame.camera_name)
        if lens.wanted():
            intrinsics = frame.intrinsics_or(self._intrinsics)
            lens.send(self._messages.camera_info(intrinsics, time_ns, optical), time_ns)
        if color.wanted():
            color.send(color_image(self._messages, frame.color, time_ns, optical), time_ns)
        if depth.wanted():
            depth.send(depth_image(self._messages, frame.depth_m, time_ns, optical), time_ns)


def stamp_of(frame: Frame) -> int:
    """Return the time of a frame of a recording, nanoseconds."""
    return nanoseconds(frame.timestamp_s)
