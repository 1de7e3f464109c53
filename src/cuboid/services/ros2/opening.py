"""Opening of a node: transport, camera, session and services, from the options."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.limits import FRAMES_WAITING
from cuboid.ground.formats.rig_file import FIXED, RigDocument
from cuboid.ground.formats.ros_messages import RosMessages, ros_name
from cuboid.ground.middleware.foxglove import FoxgloveServer
from cuboid.ground.middleware.transport import Services, Transport
from cuboid.inputs.cameras.driver import StreamEndedError
from cuboid.inputs.cameras.live import LiveCamera
from cuboid.inputs.cameras.live_rig import CAPACITY, LiveRig
from cuboid.inputs.cameras.ros2 import TICK_S, RosCamera, domain_of
from cuboid.inputs.cameras.ros_poses import RosPoses
from cuboid.inputs.recordings.rig import read_rig
from cuboid.method.poses.sources import AUTO, ESTIMATED, GIVEN, SYNCHRONISED
from cuboid.results.views.ros_stream import NODE, WORLD, RosStream
from cuboid.services.ros2.node import NodeClock, RosNode
from cuboid.services.ros2.session import Session

FEATURE, EXTRA = "ros2", "ros2"
DDS, RCLPY = "dds", "rclpy"
TF = "tf"


@dataclass(frozen=True, slots=True)
class NodeOptions:
    """Options of a node.

    Attributes
    ----------
    color, depth : tuple of str
        Topics, of a rig for each camera; empty: the node finds them by their names, or beside the color topics.
    info : str or None
        Topic; None: the node finds it beside the color topic.
    rig : Path or None
        The ``rig.json`` of several cameras; without `color` it has the color topic of each as its `serial`.
    pose : str
        `TF`, `ESTIMATED`, or a topic of poses.
    pose_offset : float or "auto"
        What is added to the times of poses, milliseconds; "auto": what the images show (of a rig: nothing).
    world : str or None
        Frame of the world; None: the root of `tf`, or `WORLD` without `tf`.
    node : str
        Name of the node.
    transport : {"dds", "rclpy"} or None
        None: rclpy if it can be imported, else dds.
    domain : str or None
        ROS_DOMAIN_ID, for DDS without ROS.
    simulated_time : bool
        Whether the clock is the topic /clock.
    foxglove : (str, int) or None
        Host and port of a server for Foxglove.
    queue : int
        Maximum number of images that wait for the tracker; if more arrive, the oldest is dropped.
    """

    color: tuple[str, ...] = ()
    depth: tuple[str, ...] = ()
    info: str | None = None
    rig: Path | None = None
    pose: str = ESTIMATED
    pose_offset: float | str = AUTO
    world: str | None = None
    node: str = NODE
    transport: str | None = None
    domain: str | None = None
    simulated_time: bool = False
    foxglove: tuple[str, int] | None = None
    queue: int = FRAMES_WAITING


@dataclass(frozen=True, slots=True)
class OpenNode:
    """A node that is ready to run.

    Attributes
    ----------
    node : RosNode
    live : LiveCamera or LiveRig
        Frames of the cameras; `close` ends the node.
    transport, camera : str
        Names of the transport and of the images, for messages to the user.
    foxglove_port : int or None
    """

    node: RosNode
    live: LiveCamera | LiveRig
    transport: str
    camera: str
    foxglove_port: int | None


@contextmanager
def open_node(
    options: NodeOptions, make_session: Callable[[Intrinsics, str], Session], stopped: Callable[[], bool]
) -> Iterator[OpenNode]:
    """Wait for the images that the options name, and yield the node; the node leaves the network on exit.

    Parameters
    ----------
    options : NodeOptions
    make_session : callable
        Makes the session of the tracker from the intrinsics and the source of poses (`poses` of `Tracker`).
    stopped : callable
        Called during the wait; True ends it.

    Raises
    ------
    StreamEndedError
        `stopped` ended the wait.
    InputError
        The images do not fit each other, or an option names something that does not exist.
    MissingExtraError
        A package is not installed.
    """
    messages, document = RosMessages(FEATURE, EXTRA), _rig(options)
    with ExitStack() as stack:
        changed = threading.Condition()
        cameras: dict[str, RosCamera] = {}
        parts, transports = [], []
        for name, color, depth in _topics(options, document):
            transport = _transport(options, messages, f"_{ros_name(name)}" if cameras else "")
            cameras[name] = _camera(options, transport, messages, color, depth, stopped)
            transports.append(transport)
            capacity = options.queue if document is None else options.queue + CAPACITY
            part = LiveCamera(cameras[name], silence_s=float("inf"), capacity=capacity, changed=changed)
            parts.append(stack.enter_context(part))
        live = parts[0] if document is None else LiveRig(document, parts, changed)
        transport, camera = transports[0], next(iter(cameras.values()))
        tf = camera.has_poses
        given = SYNCHRONISED if document is None and options.pose_offset == AUTO else GIVEN
        session = make_session(live.intrinsics, given if live.has_poses else ESTIMATED)
        foxglove = None
        if options.foxglove is not None:
            foxglove = FoxgloveServer(messages, *options.foxglove)
            stack.callback(foxglove.close)
        others = [] if foxglove is None else [foxglove]
        stream = RosStream(
            messages,
            [transport, *others],
            live.intrinsics,
            node=options.node,
            world=options.world or WORLD,
            camera=camera.frame_id,
            camera_moves=not tf,
            pictures=others,
            cameras=[] if document is None else list(cameras),
        )
        clock = NodeClock.of(transport, messages, simulated=options.simulated_time)
        node = RosNode(cameras, live, session, stream, clock)
        services: list[Services] = [transport, *others]
        node.serve(messages, transport, services, options.node)
        for carrier in services:
            carrier.declare(node.parameters.values, node.parameters.set)
        names = ", ".join(one.name for one in cameras.values())
        yield OpenNode(node, live, transport.name, names, None if foxglove is None else foxglove.port)


def _rig(options: NodeOptions) -> RigDocument | None:
    """Return the rig of the node; None for a single camera.

    Raises
    ------
    InputError
        The file is malformed, or the node cannot know the poses of the cameras.
    """
    if options.rig is None:
        if max(len(options.color), len(options.depth)) > 1:
            raise InputError(f"{FEATURE}: several cameras need --rig rig.json; 'cuboid calibrate --rig' makes it")
        return None
    if options.info is not None:
        raise InputError(f"{FEATURE}: --info is for one camera; of a rig, camera_info is beside each color topic")
    file, document = read_rig(options.rig)
    if document.kind == FIXED and options.pose != ESTIMATED:
        raise InputError(f"{file}: a fixed rig has the poses of its cameras; leave out --pose {options.pose}")
    if document.kind != FIXED and (options.pose == ESTIMATED or document.cameras[0].pose is not None):
        raise InputError(
            f"{file}: the node takes a moving rig whose cameras have poses in one world: --pose {TF}, and no "
            "'T_rig_camera' in the file"
        )
    return document


def _topics(options: NodeOptions, rig: RigDocument | None) -> list[tuple[str, str | None, str | None]]:
    """Return name, color topic and depth topic of each camera; None: found by name."""
    if rig is None:
        return [("", next(iter(options.color), None), next(iter(options.depth), None))]
    names = [entry.name for entry in rig.cameras]
    colors: list[str | None] = [*options.color] or [entry.serial for entry in rig.cameras]
    depths: list[str | None] = [*options.depth] or [None for _ in names]
    if None in colors or not len(colors) == len(depths) == len(names):
        raise InputError(
            f"{options.rig}: has {len(names)} cameras ({', '.join(names)}); name a topic of each with --color, and "
            "with --depth if it is not beside, or its color topic as 'serial' in the file"
        )
    return list(zip(names, colors, depths, strict=True))


def _camera(
    options: NodeOptions,
    transport: Transport,
    messages: RosMessages,
    color: str | None,
    depth: str | None,
    stopped: Callable[[], bool],
) -> RosCamera:
    """Wait for the images of a camera, which closes its transport; without them, the transport is closed."""
    try:
        return RosCamera(
            transport,
            messages,
            color=color,
            depth=depth,
            info=options.info,
            poses=_poses(options, transport, messages, stopped),
            feature=FEATURE,
            patient=True,
            stopped=stopped,
        )
    except BaseException:
        transport.close()
        raise


def _transport(options: NodeOptions, messages: RosMessages, ending: str = "") -> Transport:
    """Return a transport: rclpy if ROS is installed, else DDS; `ending` is that of the name of a further node."""
    if (options.transport or (RCLPY if find_spec(RCLPY) else DDS)) == RCLPY:
        if options.domain is not None:
            raise InputError(f"{FEATURE}: --domain is for bare DDS; within ROS it is ROS_DOMAIN_ID")
        from cuboid.ground.middleware.rclpy_node import RclpyTransport

        return RclpyTransport(options.node + ending, messages)
    require("cyclonedds", FEATURE, EXTRA)
    from cuboid.ground.middleware.dds import DdsTransport

    return DdsTransport(domain_of(options.domain), messages)


def _poses(
    options: NodeOptions, transport: Transport, messages: RosMessages, stopped: Callable[[], bool]
) -> RosPoses | None:
    """Return the source of camera poses; None if they are estimated."""
    if options.pose == ESTIMATED:
        return None
    added_s = 0.0 if isinstance(options.pose_offset, str) else 1e-3 * options.pose_offset
    if options.pose == TF:
        return RosPoses(transport, messages, world=options.world, added_s=added_s)
    if not options.pose.startswith("/"):
        raise InputError(f"{FEATURE}: --pose is {TF}, {ESTIMATED} or a topic such as /odom, got '{options.pose}'")
    while options.pose not in transport.topics():
        if stopped():
            raise StreamEndedError
        time.sleep(TICK_S)
    return RosPoses(transport, messages, options.pose, added_s=added_s)
