"""Cameras that a ROS 2 node publishes, without ROS: DDS by cyclonedds, messages by rosbags (extra ``ros2``).

Options: ``color=`` and ``depth=`` the topics of images (``Image`` or ``CompressedImage``), if they are not found by
name; ``domain=`` ROS_DOMAIN_ID (default: from the environment, or 0); ``info=`` the topic of color's ``CameraInfo``, if
it is not beside the color topic.

Depth must be aligned to color: drivers publish aligned depth with an option (``align_depth.enable:=true``,
``depth_registration:=true``).
"""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from cuboid.cameras.driver import CAMERAS, Shot, library, refuse_unknown, whole_number
from cuboid.core.errors import FrameError, InputError
from cuboid.readers.bag_cameras import camera_of
from cuboid.readers.bag_images import color_of, depth_of, units_per_metre
from cuboid.readers.bag_transforms import stamp_s
from cuboid.readers.reader import Calibration
from cuboid.readers.ros_bag import COLOR_WORDS, DEPTH_WORDS, NEITHER, WITHIN_S

NAME = "ros2"
OPTIONS = ("color", "depth", "info", "domain")
# Maximum time for nodes to find each other (usually one or two seconds), and for a camera's first images, seconds.
DISCOVERY_S, FIRST_S = 5.0, 10.0
# Maximum number of images of one kind that wait for their partner, and that DDS keeps.
WAITING = 8
TICK_S = 0.01


class Ros2:
    """The images of a camera on the network.

    Parameters
    ----------
    options : mapping of str to str

    Raises
    ------
    InputError
        No node publishes such images, or their intrinsics.
    MissingExtraError
        cyclonedds or rosbags is not installed.
    """

    has_poses = False
    paced = False

    def __init__(self, options: Mapping[str, str]) -> None:
        refuse_unknown(NAME, options, OPTIONS)
        for module in ("cyclonedds", "rosbags"):
            library(module, NAME, "ros2")
        from cuboid.cameras.ros2_messages import Network

        domain = options.get("domain", os.environ.get("ROS_DOMAIN_ID", "0"))
        self._network = Network(whole_number(NAME, "domain", domain))
        topics = self._network.images(DISCOVERY_S, lambda found: _both(found, options))
        color, depth = (_chosen(topics, kind, options.get(kind)) for kind in ("color", "depth"))
        self.name = f"ROS 2 {color}"
        self._colors = self._network.reader(color, topics[color], WAITING)
        self._depths = self._network.reader(depth, topics[depth], WAITING)
        self._waiting: dict[str, deque[Any]] = {kind: deque(maxlen=WAITING) for kind in ("color", "depth")}
        self.calibration = self._calibration(color, options.get("info"))
        self.depth_units_per_metre = self._units(depth)

    def _calibration(self, color: str, info: str | None) -> Calibration:
        """Wait for color's CameraInfo and return its pinhole."""
        topic = info or f"{color.removesuffix('/compressed').rsplit('/', 1)[0]}/camera_info"
        found = _within(FIRST_S, self._network.infos(topic).take)
        if found is None:
            raise InputError(f"--camera {NAME}: no CameraInfo on {topic} within {FIRST_S:g} s; name it: info=TOPIC")
        K, distortion = camera_of(found, "rect" in color.rsplit("/", 2)[-1], color)
        return Calibration(*K, (int(found.width), int(found.height)), f"CameraInfo on {topic}", distortion)

    def _units(self, depth: str) -> float:
        """Wait for the first depth image and return its units."""
        first = _within(FIRST_S, self._depths.take)
        if first is None:
            raise InputError(f"--camera {NAME}: no image on {depth} within {FIRST_S:g} s")
        self._waiting["depth"].append(first)
        size = self.calibration.size
        raw = depth_of(first, f"image of {depth}")
        if raw.shape[::-1] != size:
            raise InputError(
                f"--camera {NAME}: {depth} is {raw.shape[1]}x{raw.shape[0]}, color {'x'.join(map(str, size or ()))}: "
                "depth must be aligned to color; its node does it when told to (align_depth, depth_registration)"
            )
        return units_per_metre(first)

    def take(self, wait_s: float) -> Shot | None:
        """Return the next pair of color and depth taken at the same time; None if there is none in time."""
        found: Shot | None = _within(wait_s, self._pair)
        return found

    def _pair(self) -> Shot | None:
        for kind, reader in (("color", self._colors), ("depth", self._depths)):
            while (message := reader.take()) is not None:
                self._waiting[kind].append(message)
        colors, depths = self._waiting["color"], self._waiting["depth"]
        while colors and depths:
            apart_s = stamp_s(colors[0]) - stamp_s(depths[0])
            if abs(apart_s) <= WITHIN_S:
                return _shot(colors.popleft(), depths.popleft())
            (depths if apart_s > 0 else colors).popleft()  # its partner was lost
        return None

    def close(self) -> None:
        """Leave the network."""
        self._network.close()


def _shot(color: Any, depth: Any) -> Shot | None:
    try:
        return Shot(stamp_s(color), color_of(color, "a color image"), depth_of(depth, "a depth image"))
    except FrameError:  # the node changed the encoding
        return None


def _within(wait_s: float, find: Callable[[], Any]) -> Any:
    """Return the result of `find` within a time; None if it finds nothing."""
    until_s = time.monotonic() + wait_s
    while (found := find()) is None and time.monotonic() < until_s:
        time.sleep(TICK_S)
    return found


def _both(topics: Mapping[str, str], options: Mapping[str, str]) -> bool:
    """Tell whether topics for both color and depth exist."""
    return all(
        options.get(kind) in topics if kind in options else _candidates(topics, kind) for kind in ("color", "depth")
    )


def _candidates(topics: Mapping[str, str], kind: str) -> list[str]:
    """Return the topics that may be color or depth by their names, the preferred ones first."""
    usable = [topic for topic in sorted(topics) if not any(word in topic.lower() for word in NEITHER)]
    words = DEPTH_WORDS if kind == "depth" else COLOR_WORDS
    named = [topic for topic in usable if ("depth" in topic.lower()) == (kind == "depth")]

    def rank(topic: str) -> tuple[int, bool]:
        place = next((k for k, word in enumerate(words) if word in topic.lower()), len(words))
        return place, "compressed" in topic.lower()

    return sorted(named, key=rank)


def _chosen(topics: Mapping[str, str], kind: str, named: str | None) -> str:
    found = _candidates(topics, kind)
    there = ", ".join(sorted(topics)) or "no images at all"
    if named is not None:
        if named not in topics:
            raise InputError(f"--camera {NAME}: nobody publishes images on '{named}' ({kind}); there are: {there}")
        return named
    if not found:
        raise InputError(
            f"--camera {NAME}: nobody publishes {kind} images within {DISCOVERY_S:g} s; there are: {there}"
        )
    return found[0]


CAMERAS.register(NAME)(Ros2)
