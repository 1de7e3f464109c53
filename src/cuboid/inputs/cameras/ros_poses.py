"""Camera poses of a running ROS 2: from ``tf``, or from a topic of poses or odometry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError, InputError
from cuboid.ground.geometry.se3 import inverse
from cuboid.ground.middleware.transport import Inlet, Qos, Transport
from cuboid.inputs.readers.bag_transforms import STAMPED_TYPES, Edge, camera_pose, edges_of, frame_name

if TYPE_CHECKING:
    from cuboid.ground.formats.ros_messages import RosMessages

TF, TF_STATIC, TF_TYPE = "/tf", "/tf_static", "tf2_msgs/msg/TFMessage"
# Messages that wait: a robot has some hundred transforms a second, and they are taken with each image.
TF_KEPT, POSES_KEPT = 200, 100
# Transforms are kept for this long, by their own clock, seconds: images are late by less.
KEPT_S = 10.0
# A clock that goes back by more than this has begun anew, as that of a bag that is played in a loop, seconds.
BACK_S = 1.0


class RosPoses:
    """The transforms of the last seconds, as they come.

    Parameters
    ----------
    transport : Transport
    messages : RosMessages
    topic : str, optional
        Of PoseStamped, PoseWithCovarianceStamped or Odometry; ``tf`` unless given.
    world : str, optional
        The frame that poses are in; the root of ``tf`` unless given.
    added_s : float
        Added to the times of the poses, seconds.

    Attributes
    ----------
    found_world : str
        The frame that the last pose was in; empty before the first.

    Raises
    ------
    InputError
        The topic has another type.
    """

    def __init__(
        self,
        transport: Transport,
        messages: RosMessages,
        topic: str | None = None,
        world: str | None = None,
        *,
        added_s: float = 0.0,
    ) -> None:
        self._messages, self._world, self._topic, self._added_s = messages, world, topic, added_s
        self._moving: dict[str, Edge] = {}
        self._fixed: dict[str, tuple[str, Float64Array]] = {}
        self._newest_s = float("-inf")
        self.found_world = ""
        self._child = ""
        self._inlets: list[tuple[Inlet, str, bool]] = [
            (transport.inlet(TF_STATIC, TF_TYPE, Qos.LATCHED, TF_KEPT), TF_TYPE, True)
        ]
        if topic is None:
            self._inlets.append((transport.inlet(TF, TF_TYPE, Qos.RELIABLE, TF_KEPT), TF_TYPE, False))
            return
        kind = transport.topics().get(topic)
        if kind not in STAMPED_TYPES:
            what = "nobody publishes it" if kind is None else f"it is {kind}"
            raise InputError(f"--pose {topic}: expected a topic of {', '.join(STAMPED_TYPES)}, but {what}")
        self._inlets.append((transport.inlet(topic, kind, Qos.SENSOR, POSES_KEPT), kind, False))

    def take(self) -> None:
        """Take what has come."""
        for inlet, kind, fixed in self._inlets:
            while (data := inlet.take()) is not None:
                self._add(self._messages.decode(data, kind), fixed=fixed)

    def at(self, frame: str, time_s: float) -> Float64Array | None:
        """Return T_world_camera (4, 4) at a time; None where it is not known, or not yet.

        Parameters
        ----------
        frame : str
            Of the camera's image.
        time_s : float
            By the clock of the messages.
        """
        start, frame = ("", frame_name(frame)) if self._topic else (frame_name(frame), "")
        try:
            found = camera_pose(
                [self._moving], self._fixed, start, time_s - self._added_s, self._world if self._topic is None else None
            )
        except FrameError:
            return None
        if self._topic is not None:
            in_world, T_world_camera = found.moved, found.T_world_frame @ self._beside(frame)
        else:
            in_world = found.world == self._world if self._world is not None else found.world != start
            T_world_camera = found.T_world_frame
        if not in_world:
            return None
        self.found_world = found.world
        return T_world_camera

    def is_newer(self, time_s: float) -> bool:
        """Tell whether transforms of a later time have come: then `at` needs no other."""
        return self._newest_s >= time_s - self._added_s

    def _beside(self, frame: str) -> Float64Array:
        """Return T_posed_camera: odometry may pose another frame, to which ``tf`` fixes the camera."""
        roots = [camera_pose([], self._fixed, name, 0.0) for name in (self._child, frame)]
        if not self._child or roots[0].world != roots[1].world:
            return camera_pose([], {}, frame, 0.0).T_world_frame
        return inverse(roots[0].T_world_frame) @ roots[1].T_world_frame

    def _add(self, message: Any, *, fixed: bool) -> None:
        self._child = frame_name(getattr(message, "child_frame_id", self._child))
        for parent, child, time_s, T in edges_of(message):
            if fixed:
                self._fixed[child] = (parent, T)
                continue
            if time_s < self._newest_s - BACK_S:
                self._moving.clear()
                self._newest_s = time_s
            self._newest_s = max(self._newest_s, time_s)
            if child in self._moving and self._moving[child][0] != parent:
                del self._moving[child]
            _, times_s, transforms = self._moving.setdefault(child, (parent, [], []))
            times_s.append(time_s)
            transforms.append(T)
            while times_s[0] < self._newest_s - KEPT_S:
                del times_s[0], transforms[0]
