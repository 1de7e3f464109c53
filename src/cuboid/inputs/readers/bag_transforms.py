"""Camera poses over time, from the transforms in a ROS bag."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.geometry import se3
from cuboid.inputs.readers.bag import Bag

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
STAMPED_TYPES = (
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
# Transforms are read in blocks of one second; this many blocks are cached, because frames are read in order.
BLOCK_NS, KEPT_BLOCKS = 1_000_000_000, 6
# Time around the first image that is searched first: one step at 30 Hz in both directions.
AT_FIRST_NS = 40_000_000
# Maximum length of a chain of transforms; a longer one contains a cycle.
LONGEST_CHAIN = 64
# Maximum gap between two transforms for interpolation; elsewhere the nearest one within NEAREST_WITHIN_S is used.
LARGEST_TRANSFORM_GAP_S, NEAREST_WITHIN_S = 1.0, 0.05
# The quaternion of a transform must have length 1 to within this.
QUATERNION_LENGTH_TOLERANCE = 0.01

# Times in seconds (N,) and transforms parent <- child (N, 4, 4) by child.
Edge = tuple[str, list[float], list[Float64Array]]


class Transforms:
    """The tree of transforms of a bag.

    Parameters
    ----------
    bag : Bag
    pose_topic : str, optional
        A topic with the camera's poses or odometry, used instead of the tree.
    """

    def __init__(self, bag: Bag, pose_topic: str | None = None) -> None:
        self._bag = bag
        self._moving = [
            topic for topic, kind in bag.types.items() if kind in TF_TYPES and not topic.endswith("_static")
        ]
        self._pose_topic = pose_topic
        self._blocks: OrderedDict[int, dict[str, Edge]] = OrderedDict()
        self._fixed: dict[str, tuple[str, Float64Array]] = {}
        for topic, kind in bag.types.items():
            if kind in TF_TYPES and topic.endswith("_static"):
                times = bag.times(topic)
                for message in bag.between(topic, int(times[0]), int(times[-1]) + 1) if len(times) else ():
                    for parent, child, _, T in edges_of(message):
                        self._fixed[child] = (parent, T)

    def moves(self, frame: str, time_ns: int) -> bool:
        """Tell whether there are moving transforms of a frame around a time, and thus poses."""
        if self._pose_topic is not None:
            return True
        # With frequent transforms, the first few are enough, and opening a large bag need not read whole seconds.
        if self._moved(frame, self._edges_between(time_ns - AT_FIRST_NS, time_ns + AT_FIRST_NS)):
            return True
        return self._moved(frame, self._block(time_ns // BLOCK_NS) | self._block(time_ns // BLOCK_NS + 1))

    def _moved(self, frame: str, edges: dict[str, Edge]) -> bool:
        """Tell whether one of the transforms from a frame to the root is among these."""
        child, moving = frame, False
        for _ in range(LONGEST_CHAIN):
            moving |= child in edges
            parent = edges[child][0] if child in edges else self._fixed.get(child, (None,))[0]
            if parent is None:
                return moving
            child = parent
        return False

    def pose(self, frame: str, time_ns: int, time_s: float) -> Float64Array:
        """Return T_world_camera (4, 4) of a frame; the world is the root of the tree.

        Parameters
        ----------
        frame : str
            Coordinate frame of the camera.
        time_ns : int
            Log time of the image: transforms of the surrounding seconds are read.
        time_s : float
            Time of capture, by the clock of the messages.

        Raises
        ------
        FrameError
            No transforms are near enough in time.
        """
        blocks = [self._block(time_ns // BLOCK_NS + k) for k in (-1, 0, 1)]
        found = camera_pose(blocks, self._fixed, "" if self._pose_topic else frame, time_s)
        if not found.moved:
            raise FrameError(f"no camera pose: the bag has no transforms of '{frame}' about {time_s:.3f} s")
        return found.T_world_frame

    def between(self, frame: str, other: str) -> Float64Array | None:
        """Return the fixed transform T_frame_other (4, 4) of two frames; None without a fixed common root."""
        (root, T_root_frame), (other_root, T_root_other) = self._fixed_root(frame), self._fixed_root(other)
        return se3.inverse(T_root_frame) @ T_root_other if root == other_root else None

    def _fixed_root(self, frame: str) -> tuple[str, Float64Array]:
        T = np.eye(4)
        for _ in range(LONGEST_CHAIN):
            if frame not in self._fixed:
                break
            parent, T_parent_frame = self._fixed[frame]
            T, frame = T_parent_frame @ T, parent
        return frame, T

    def _block(self, number: int) -> dict[str, Edge]:
        """Return the moving transforms that were logged in one second, by child."""
        if number in self._blocks:
            return self._blocks[number]
        block = self._blocks[number] = self._edges_between(number * BLOCK_NS, (number + 1) * BLOCK_NS)
        if len(self._blocks) > KEPT_BLOCKS:
            self._blocks.popitem(last=False)
        return block

    def _edges_between(self, start_ns: int, stop_ns: int) -> dict[str, Edge]:
        """Return the moving transforms that were logged in a time span, by child."""
        found: dict[str, Edge] = {}
        for topic in [self._pose_topic] if self._pose_topic else self._moving:
            for message in self._bag.between(topic, start_ns, stop_ns):
                for parent, child, time_s, T in edges_of(message):
                    _, times_s, transforms = found.setdefault(child, (parent, [], []))
                    times_s.append(time_s)
                    transforms.append(T)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class FoundPose:
    """Where a frame is in the tree of transforms.

    Attributes
    ----------
    T_world_frame : (4, 4) float64
    world : str
        The frame at the end of the chain.
    moved : bool
        Whether a transform that may change is part of it.
    """

    T_world_frame: Float64Array
    world: str
    moved: bool


def camera_pose(
    moving: Sequence[Mapping[str, Edge]],
    fixed: Mapping[str, tuple[str, Float64Array]],
    frame: str,
    time_s: float,
    world: str | None = None,
) -> FoundPose:
    """Return where a frame is at a time.

    Parameters
    ----------
    moving : sequence of mapping of str to Edge
        Transforms that change, by child.
    fixed : mapping of str to (str, (4, 4) float64)
        Parent, and T_parent_child, by child.
    frame : str
    time_s : float
    world : str, optional
        Frame at which the chain ends; its root unless given.

    Raises
    ------
    FrameError
        No transforms are near enough in time.
    """
    child, T_child_frame, moved = frame, np.eye(4), False
    for _ in range(LONGEST_CHAIN):
        if child == world:
            break
        found = [block[child] for block in moving if child in block]
        if found:
            T_parent_child, parent, moved = _at(found, time_s, child), found[0][0], True
        elif child in fixed:
            parent, T_parent_child = fixed[child]
        else:
            break
        T_child_frame, child = T_parent_child @ T_child_frame, parent
    return FoundPose(T_child_frame, child, moved)


def frame_name(name: str) -> str:
    """Return the name of a frame in the style of ROS 2."""
    return name.lstrip("/")


def stamp_s(message: Any) -> float:
    """Return the time in a message's header, seconds."""
    return float(message.header.stamp.sec) + 1e-9 * float(message.header.stamp.nanosec)


def matrix(translation: Any, rotation: Any) -> Float64Array | None:
    """Return a transform (4, 4) from ROS's vector and quaternion; None if it is invalid."""
    quat_wxyz = (rotation.w, rotation.x, rotation.y, rotation.z)
    values = np.array([*quat_wxyz, translation.x, translation.y, translation.z], np.float64)
    length = float(np.linalg.norm(values[:4])) if np.isfinite(values).all() else 0.0
    if abs(length - 1) > QUATERNION_LENGTH_TOLERANCE:
        return None
    return se3.compose(values[:4] / length, values[4:])


def edges_of(message: Any) -> Iterable[tuple[str, str, float, Float64Array]]:
    """Yield parent, child, time and T_parent_child of a message; the child of a single pose is ""."""
    if message.__msgtype__ in TF_TYPES:
        for one in message.transforms:
            T = matrix(one.transform.translation, one.transform.rotation)
            if T is not None:
                yield frame_name(one.header.frame_id), frame_name(one.child_frame_id), stamp_s(one), T
        return
    pose = message.pose if message.__msgtype__ == STAMPED_TYPES[0] else message.pose.pose
    T = matrix(pose.position, pose.orientation)
    if T is not None:
        yield frame_name(message.header.frame_id) or "world", "", stamp_s(message), T


def _at(edges: list[Edge], time_s: float, child: str) -> Float64Array:
    """Return the transform at a time."""
    times_s = np.array([t for edge in edges for t in edge[1]])
    transforms = [T for edge in edges for T in edge[2]]
    order = np.argsort(times_s, kind="stable")
    after = int(np.searchsorted(times_s[order], time_s))
    if 0 < after < len(order):
        before_s, after_s = times_s[order[after - 1]], times_s[order[after]]
        if after_s - before_s <= LARGEST_TRANSFORM_GAP_S:
            fraction = (time_s - before_s) / (after_s - before_s)
            return se3.interpolate(transforms[order[after - 1]], transforms[order[after]], float(fraction))
    nearest = int(np.argmin(np.abs(times_s - time_s)))
    if abs(times_s[nearest] - time_s) > NEAREST_WITHIN_S:
        raise FrameError(
            f"no camera pose at {time_s:.3f} s: the nearest transform of '{child or 'the camera'}' is "
            f"{abs(times_s[nearest] - time_s):.3f} s away (at most {NEAREST_WITHIN_S:g} s, or between two at most "
            f"{LARGEST_TRANSFORM_GAP_S:g} s apart)"
        )
    return transforms[nearest]
