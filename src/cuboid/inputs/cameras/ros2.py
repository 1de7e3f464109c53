"""Cameras that a ROS 2 node publishes: over DDS without ROS (extra ``ros2``), or over any other transport.

Options of ``--camera ros2``:
``color=`` and ``depth=`` the topics of images (``Image`` or ``CompressedImage``), if they are not found by
name; ``domain=`` ROS_DOMAIN_ID (default: from the environment, or 0); ``info=`` the topic of color's ``CameraInfo``, if
it is not beside the color topic.

Depth must be aligned to color: drivers publish aligned depth with an option (``align_depth.enable:=true``,
``depth_registration:=true``).
"""

from __future__ import annotations

import os
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from itertools import takewhile
from typing import Any, TypeVar

from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.middleware.transport import Inlet, Qos, Transport
from cuboid.inputs.cameras.driver import CAMERAS, Shot, StreamEndedError, library, refuse_unknown, whole_number
from cuboid.inputs.cameras.ros_poses import RosPoses
from cuboid.inputs.readers.bag_cameras import camera_of
from cuboid.inputs.readers.bag_images import COMPRESSED, RAW, color_of, depth_of, units_per_metre
from cuboid.inputs.readers.bag_transforms import stamp_s
from cuboid.inputs.readers.reader import Calibration
from cuboid.inputs.readers.ros_bag import CAMERA_INFO, COLOR_WORDS, DEPTH_WORDS, NEITHER, WITHIN_S

T = TypeVar("T")

NAME = "ros2"
OPTIONS = ("color", "depth", "info", "domain")
# Maximum time for nodes to find each other (usually one or two seconds), and for a camera's first images, seconds.
DISCOVERY_S, FIRST_S = 5.0, 10.0
# Maximum number of images of one kind that the transport keeps, and that wait for their partner: at 30 Hz those of a
# second, during which a busy machine may not run the receiving thread.
WAITING_IMAGES = 30
TICK_S = 0.01
# An image waits no longer than this for the transforms of its time, seconds.
POSE_WAIT_S = 0.25
# Number of images whose stamps are stored, so that answers have them to the nanosecond.
STAMPS_KEPT = 64


class RosCamera:
    """The images of a camera on the network, paired, with the poses of their times.

    Parameters
    ----------
    transport : Transport
        Closed with the camera.
    messages : RosMessages
    color, depth, info : str, optional
        Topics; None: found by name, and beside color.
    poses : RosPoses, optional
        Source of the camera poses.
    feature : str
        The feature in the user's words, with which errors begin.
    patient : bool
        Wait without limit for the first images; otherwise an error names the missing ones.
    stopped : callable
        Called during the wait; True ends it.

    Attributes
    ----------
    frame_id : str
        The camera's frame, as its images name it.
    received : dict of str to int
        Number of images that arrived so far, for "color" and "depth".
    unpaired, paired : int
        Number of images whose partner was lost, and of pairs.
    unposed, damaged : int
        Number of pairs without a pose at their time, and of pairs that hold no images.

    Raises
    ------
    InputError
        No node publishes such images, or their intrinsics.
    StreamEndedError
        `stopped` ended the wait.
    """

    paced = False

    def __init__(
        self,
        transport: Transport,
        messages: RosMessages,
        *,
        color: str | None = None,
        depth: str | None = None,
        info: str | None = None,
        poses: RosPoses | None = None,
        feature: str = f"--camera {NAME}",
        patient: bool = False,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._transport, self._messages, self._poses = transport, messages, poses
        self._feature, self._patient, self._stopped = feature, patient, stopped
        self.has_poses = poses is not None
        self.received = {"color": 0, "depth": 0}
        self.paired = self.unpaired = self.unposed = self.damaged = 0
        named = {"color": color, "depth": depth}
        topics = self._found_topics(named)
        chosen = {kind: self._chosen(topics, kind, named[kind], beside=color or "") for kind in ("color", "depth")}
        self.name = f"ROS 2 {chosen['color']}"
        self._kinds = {kind: topics[topic] for kind, topic in chosen.items()}
        self._inlets: dict[str, Inlet] = {
            kind: transport.inlet(topic, topics[topic], Qos.SENSOR, WAITING_IMAGES) for kind, topic in chosen.items()
        }
        self._waiting: dict[str, deque[Any]] = {kind: deque(maxlen=WAITING_IMAGES) for kind in chosen}
        self._stamps_ns: OrderedDict[float, int] = OrderedDict()
        self._posing: tuple[Any, Any, float] | None = None
        self.calibration = self._calibration(chosen["color"], info)
        self.depth_units_per_metre = self._units(chosen["depth"])

    @property
    def world(self) -> str:
        """The frame that poses are in; empty where they come from elsewhere."""
        return "" if self._poses is None else self._poses.found_world

    def stamp_ns(self, timestamp_s: float) -> int:
        """Return the stamp of the image of one of the last frames, to the nanosecond, from the time of its `Shot`."""
        return self._stamps_ns[min(self._stamps_ns, key=lambda known_s: abs(known_s - timestamp_s))]

    def take(self, wait_s: float) -> Shot | None:
        """Return the next pair of color and depth that were taken together; None where there is none in time."""
        until_s = time.monotonic() + wait_s
        while True:
            shot = self._next()
            left_s = until_s - time.monotonic()
            if shot is not None or left_s <= 0:
                return shot
            # an image that waits for its pose must not wait for the next image
            self._transport.wait(left_s if self._posing is None else min(left_s, TICK_S))

    def close(self) -> None:
        """Leave the network."""
        self._transport.close()

    def _next(self) -> Shot | None:
        """Return the next pair that is there, with its pose where there are poses."""
        if self._poses is None:
            pair = self._pair()
            return None if pair is None else self._shot(*pair, None)
        self._poses.take()
        if self._posing is None:
            pair = self._pair()
            if pair is None:
                return None
            self._posing = (*pair, time.monotonic())
        color, depth, since_s = self._posing
        pose = self._poses.at(color.header.frame_id, stamp_s(color))
        if (pose is None or not self._poses.is_newer(stamp_s(color))) and time.monotonic() - since_s < POSE_WAIT_S:
            return None
        self._posing = None
        self.unposed += pose is None
        return self._shot(color, depth, pose)

    def _pair(self) -> tuple[Any, Any] | None:
        for kind, inlet in self._inlets.items():
            while (data := inlet.take()) is not None:
                self.received[kind] += 1
                self.unpaired += len(self._waiting[kind]) == WAITING_IMAGES
                self._waiting[kind].append(self._messages.decode(data, self._kinds[kind]))
        colors, depths = self._waiting["color"], self._waiting["depth"]
        while colors and depths:
            apart_s = stamp_s(colors[0]) - stamp_s(depths[0])
            if abs(apart_s) <= WITHIN_S:
                self.paired += 1
                return colors.popleft(), depths.popleft()
            (depths if apart_s > 0 else colors).popleft()  # its partner was lost
            self.unpaired += 1
        return None

    def _shot(self, color: Any, depth: Any, T_world_camera: Any) -> Shot | None:
        stamp = color.header.stamp
        self.frame_id = color.header.frame_id
        self._stamps_ns[stamp_s(color)] = stamp.sec * 10**9 + stamp.nanosec
        while len(self._stamps_ns) > STAMPS_KEPT:
            self._stamps_ns.popitem(last=False)
        try:
            return Shot(
                stamp_s(color), color_of(color, "a color image"), depth_of(depth, "a depth image"), T_world_camera
            )
        except FrameError:  # of a node that changed its mind about the encoding
            self.damaged += 1
            return None

    def _calibration(self, color: str, info: str | None) -> Calibration:
        """Wait for color's CameraInfo and return its pinhole."""
        topic = info or f"{color.removesuffix('/compressed').rsplit('/', 1)[0]}/camera_info"
        found = self._first(self._transport.inlet(topic, CAMERA_INFO, Qos.SENSOR, 1, wakes=False), CAMERA_INFO)
        if found is None:
            raise InputError(f"{self._feature}: no CameraInfo on {topic} within {FIRST_S:g} s; name it: info=TOPIC")
        K, distortion = camera_of(found, "rect" in color.rsplit("/", 2)[-1], color)
        self.frame_id = found.header.frame_id
        return Calibration(*K, (int(found.width), int(found.height)), f"CameraInfo on {topic}", distortion)

    def _units(self, depth: str) -> float:
        """Wait for the first depth image and return its units."""
        first = self._first(self._inlets["depth"], self._kinds["depth"])
        if first is None:
            raise InputError(f"{self._feature}: no image on {depth} within {FIRST_S:g} s")
        self.received["depth"] += 1
        self._waiting["depth"].append(first)
        size = self.calibration.size
        raw = depth_of(first, f"image of {depth}")
        if raw.shape[::-1] != size:
            raise InputError(
                f"{self._feature}: {depth} is {raw.shape[1]}x{raw.shape[0]}, color {'x'.join(map(str, size or ()))}: "
                "depth must be aligned to color; its node does it when told to (align_depth, depth_registration)"
            )
        return units_per_metre(first)

    def _first(self, inlet: Inlet, kind: str) -> Any:
        data = self._within(FIRST_S, inlet.take)
        return None if data is None else self._messages.decode(data, kind)

    def _found_topics(self, named: Mapping[str, str | None]) -> Mapping[str, str]:
        """Return the topics of images and their types, once color and depth are there or the time is over."""
        found: dict[str, str] = {}

        def both() -> Mapping[str, str] | None:
            found.update((topic, kind) for topic, kind in self._transport.topics().items() if kind in (RAW, COMPRESSED))
            there = all(named[kind] in found if named[kind] else _candidates(found, kind) for kind in named)
            return found if there else None

        return self._within(DISCOVERY_S, both) or found

    def _chosen(self, topics: Mapping[str, str], kind: str, named: str | None, beside: str) -> str:
        """Return the named topic, else the likeliest one; of several cameras that of the camera of another topic."""
        found = sorted(_candidates(topics, kind), key=lambda topic: -_shared(topic, beside))
        there = ", ".join(sorted(topics)) or "no images at all"
        if named is not None:
            if named not in topics:
                raise InputError(f"{self._feature}: nobody publishes images on '{named}' ({kind}); there are: {there}")
            return named
        if not found:
            raise InputError(
                f"{self._feature}: nobody publishes {kind} images within {DISCOVERY_S:g} s; there are: {there}"
            )
        return found[0]

    def _within(self, wait_s: float, find: Callable[[], T | None]) -> T | None:
        """Return what `find` finds within a time, or, where it is patient, at last; None where it finds nothing."""
        until_s = time.monotonic() + wait_s
        while (found := find()) is None and (self._patient or time.monotonic() < until_s):
            if self._stopped():
                raise StreamEndedError
            time.sleep(TICK_S)
        return found


def _candidates(topics: Mapping[str, str], kind: str) -> list[str]:
    """Return the topics that may be color or depth by their names, the preferred ones first."""
    usable = [topic for topic in sorted(topics) if not any(word in topic.lower() for word in NEITHER)]
    words = DEPTH_WORDS if kind == "depth" else COLOR_WORDS
    named = [topic for topic in usable if ("depth" in topic.lower()) == (kind == "depth")]

    def rank(topic: str) -> tuple[int, bool]:
        place = next((k for k, word in enumerate(words) if word in topic.lower()), len(words))
        return place, "compressed" in topic.lower()

    return sorted(named, key=rank)


def _shared(topic: str, beside: str) -> int:
    """Return the number of levels that two topics have in common: those of one camera have its namespace."""
    pairs = zip(topic.split("/"), beside.split("/"), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def domain_of(named: str | None) -> int:
    """Return ROS_DOMAIN_ID as it is named, or as the environment has it; raises InputError where it is no number."""
    return whole_number(NAME, "domain", named or os.environ.get("ROS_DOMAIN_ID", "0"))


def open_ros2(options: Mapping[str, str]) -> RosCamera:
    """Open `--camera ros2`.

    Raises
    ------
    InputError
        No node publishes such images, or their intrinsics.
    MissingExtraError
        cyclonedds or rosbags is not installed.
    """
    refuse_unknown(NAME, options, OPTIONS)
    for module in ("cyclonedds", "rosbags"):
        library(module, NAME, "ros2")
    from cuboid.ground.middleware.dds import DdsTransport

    messages = RosMessages(f"--camera {NAME}", "ros2")
    transport = DdsTransport(domain_of(options.get("domain")), messages)
    try:
        return RosCamera(
            transport, messages, color=options.get("color"), depth=options.get("depth"), info=options.get("info")
        )
    except BaseException:
        transport.close()
        raise


CAMERAS.register(NAME)(open_ros2)
