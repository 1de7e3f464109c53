"""A running tracker as topics of ROS 2: what is sent of each frame, and what is sent now and then.

/cuboid/detections    vision_msgs/Detection3DArray       the objects seen in the frame
/cuboid/markers       visualization_msgs/MarkerArray     the same as boxes and text; all objects once a second
/cuboid/map           sensor_msgs/PointCloud2            the point map, where `map_every_s` asks for it
/cuboid/cloud         sensor_msgs/PointCloud2            what was asked for
/tf                   tf2_msgs/TFMessage                 the camera, and objects where `object_frames` asks for them
/diagnostics          diagnostic_msgs/DiagnosticArray    how the run goes
/cuboid/color/compressed, /cuboid/depth/compressedDepth, /cuboid/camera_info    for who has no other source of them
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cuboid.core.frame import Float32Array, Frame, Intrinsics, UInt8Array
from cuboid.core.results import FrameResult, TrackedObject
from cuboid.formats.ros_messages import OPTICAL_FRAME, TRANSFORMS, RosMessages, nanoseconds
from cuboid.middleware.transport import Outlet, Outlets, Qos
from cuboid.views.live.watch import TrackerView
from cuboid.views.ros_objects import (
    box_pose,
    cloud_message,
    color_image,
    deleted_markers,
    depth_image,
    detection,
    detection_array,
    marker_array,
    object_markers,
)

NODE, WORLD = "cuboid", "map"
DIAGNOSTICS = "/diagnostics"
# Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, STALE = 0, 1, 3
# Who comes later sees all objects after this time, seconds: frames tell of those in view only.
ALL_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class StreamSettings:
    """What is sent beside the detections.

    Attributes
    ----------
    object_frames : bool
        One frame of `tf` an object, `object_3` for the label 3.
    min_score : float
        Objects below this score are not sent, 0..1.
    map_every_s : float
        The point map is sent so often, seconds; 0: on request only.
    """

    object_frames: bool = False
    min_score: float = 0.0
    map_every_s: float = 0.0


class Topic:
    """A topic on all that carries it; a message is made where somebody listens, once."""

    def __init__(self, messages: RosMessages, carriers: Iterable[Outlets], name: str, kind: str, qos: Qos) -> None:
        self._messages, self._latched = messages, qos is Qos.LATCHED
        self._outlets: list[Outlet] = [carrier.outlet(name, kind, qos) for carrier in carriers]

    def wanted(self) -> bool:
        """Tell whether somebody listens."""
        return any(outlet.wanted() for outlet in self._outlets)

    def send(self, message: Any, time_ns: int) -> None:
        """Send a message to all that listen, or that may listen later."""
        data = self._messages.encode(message)
        for outlet in self._outlets:
            if self._latched or outlet.wanted():
                outlet.send(data, time_ns)


class RosStream:
    """Sends what a tracker finds.

    Parameters
    ----------
    messages : RosMessages
    carriers : sequence of Outlets
    intrinsics : Intrinsics
    node : str
        Begins the names of its own topics.
    world, camera : str
        Frames of `tf`: the world, and the camera.
    camera_moves : bool
        Whether it sends where the camera is; others do where poses come from them.
    pictures : sequence of Outlets
        Those of `carriers` that also get color, depth and the camera.

    Attributes
    ----------
    settings : StreamSettings
    names : mapping of int to str
        Names that users gave, by label; before those of a detector.
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
    ) -> None:
        self.settings = StreamSettings()
        self.names: Mapping[int, str] = {}
        self.world, self.camera = world, camera
        self._messages, self._intrinsics, self._camera_moves = messages, intrinsics, camera_moves

        def topic(name: str, kind: str, qos: Qos, to: Sequence[Outlets] = carriers) -> Topic:
            return Topic(messages, to, name, kind, qos)

        self._detections = topic(f"/{node}/detections", "vision_msgs/msg/Detection3DArray", Qos.RELIABLE)
        self._markers = topic(f"/{node}/markers", "visualization_msgs/msg/MarkerArray", Qos.RELIABLE)
        self._map = topic(f"/{node}/map", "sensor_msgs/msg/PointCloud2", Qos.LATCHED)
        self._cloud = topic(f"/{node}/cloud", "sensor_msgs/msg/PointCloud2", Qos.LATCHED)
        self._transforms = topic(TRANSFORMS, "tf2_msgs/msg/TFMessage", Qos.RELIABLE)
        self._diagnostics = topic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", Qos.RELIABLE)
        image = "sensor_msgs/msg/CompressedImage"
        self._color = topic(f"/{node}/color/compressed", image, Qos.RELIABLE, pictures)
        self._depth = topic(f"/{node}/depth/compressedDepth", image, Qos.RELIABLE, pictures)
        self._camera_info = topic(f"/{node}/camera_info", "sensor_msgs/msg/CameraInfo", Qos.RELIABLE, pictures)
        self._name = node
        self._shown: set[int] = set()
        self._all_s = self._map_s = float("-inf")

    def frame(self, frame: Frame, result: FrameResult, tracker: TrackerView, time_ns: int) -> None:
        """Send what was found in a frame.

        Parameters
        ----------
        frame : Frame
        result : FrameResult
        tracker : TrackerView
        time_ns : int
            Stamp of its image.
        """
        objects = {item.label: item for item in tracker.objects if item.score >= self.settings.min_score}
        seen = [objects[one.label] for one in result.sightings if one.label in objects]
        self._send_transforms(result, objects, time_ns)
        if self._detections.wanted():
            self._detections.send(self.detections(seen, time_ns), time_ns)
        self._send_markers(objects, seen, tracker, time_ns)
        self._send_pictures(frame, time_ns)
        every_s, now_s = self.settings.map_every_s, time.monotonic()
        if every_s and now_s - self._map_s >= every_s and self._map.wanted():
            self._map_s = now_s
            points = tracker.map_points()
            self._map.send(self.cloud(points.xyz, points.rgb, time_ns), time_ns)

    def detections(self, objects: Iterable[TrackedObject], time_ns: int) -> Any:
        """Return objects as vision_msgs/Detection3DArray."""
        made = [
            detection(self._messages, item.label, self._name_of(item), item.box, item.score, time_ns, self.world)
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
        """Send points that were asked for."""
        self._cloud.send(cloud, time_ns)

    def clear(self, time_ns: int) -> None:
        """Take all markers away: the map begins anew."""
        gone = [
            one for label in sorted(self._shown) for one in deleted_markers(self._messages, label, time_ns, self.world)
        ]
        self._markers.send(marker_array(self._messages, gone), time_ns)
        self._shown.clear()
        self._all_s = self._map_s = float("-inf")

    def diagnose(self, level: int, message: str, values: Mapping[str, object], time_ns: int) -> None:
        """Send how the run goes.

        Parameters
        ----------
        level : {OK, WARN, STALE}
        message : str
            In a few words.
        values : mapping of str to object
            Figures, by name.
        time_ns : int
            Now, by the clock of the node.
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

    def _send_transforms(self, result: FrameResult, objects: Mapping[int, TrackedObject], time_ns: int) -> None:
        make, made = self._messages.transform, []
        if self._camera_moves:
            made.append(make(result.T_world_camera, time_ns, self.world, self.camera))
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
            one
            for item in shown
            for one in object_markers(
                self._messages, item.label, self._name_of(item), item.box, tracker.up, time_ns, self.world
            )
        ]
        for label in sorted(self._shown - set(objects)):
            markers += deleted_markers(self._messages, label, time_ns, self.world)
        self._shown = (self._shown & set(objects)) | {item.label for item in shown}
        self._markers.send(marker_array(self._messages, markers), time_ns)

    def _send_pictures(self, frame: Frame, time_ns: int) -> None:
        if self._camera_info.wanted():
            self._camera_info.send(self._messages.camera_info(self._intrinsics, time_ns, self.camera), time_ns)
        if self._color.wanted():
            self._color.send(color_image(self._messages, frame.color, time_ns, self.camera), time_ns)
        if self._depth.wanted():
            self._depth.send(depth_image(self._messages, frame.depth_m, time_ns, self.camera), time_ns)


def stamp_of(frame: Frame) -> int:
    """Return the time of a frame of a recording, nanoseconds."""
    return nanoseconds(frame.timestamp_s)
