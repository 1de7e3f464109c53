"""Opening of a node: transport, camera, session and services, from the options."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import require
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.limits import FRAMES_WAITING
from cuboid.ground.formats.ros_messages import RosMessages
from cuboid.ground.middleware.foxglove import FoxgloveServer
from cuboid.ground.middleware.transport import Services, Transport
from cuboid.inputs.cameras.driver import StreamEndedError
from cuboid.inputs.cameras.live import LiveCamera
from cuboid.inputs.cameras.ros2 import TICK_S, RosCamera, domain_of
from cuboid.inputs.cameras.ros_poses import RosPoses
from cuboid.method.poses.sources import ESTIMATED, GIVEN
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
    color, depth, info : str or None
        Topics; None: the node finds them by their names.
    pose : str
        `TF`, `ESTIMATED`, or a topic of poses.
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

    color: str | None = None
    depth: str | None = None
    info: str | None = None
    pose: str = ESTIMATED
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
    live : LiveCamera
        Frames of the camera; `close` ends the node.
    transport, camera : str
        Names of the transport and of the images, for messages to the user.
    foxglove_port : int or None
    """

    node: RosNode
    live: LiveCamera
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
    messages = RosMessages(FEATURE, EXTRA)
    with ExitStack() as stack:
        transport = _transport(options, messages)
        stack.callback(transport.close)
        poses = _poses(options, transport, messages, stopped)
        camera = RosCamera(
            transport,
            messages,
            color=options.color,
            depth=options.depth,
            info=options.info,
            poses=poses,
            feature=FEATURE,
            patient=True,
            stopped=stopped,
        )
        stack.pop_all()  # from here on, the camera closes its transport
        live = stack.enter_context(LiveCamera(camera, silence_s=float("inf"), capacity=options.queue))
        session = make_session(live.intrinsics, ESTIMATED if poses is None else GIVEN)
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
            camera_moves=poses is None,
            pictures=others,
        )
        clock = NodeClock.of(transport, messages, simulated=options.simulated_time)
        node = RosNode(camera, live, session, stream, clock)
        services: list[Services] = [transport, *others]
        node.serve(messages, transport, services, options.node)
        for carrier in services:
            carrier.declare(node.parameters.values, node.parameters.set)
        yield OpenNode(node, live, transport.name, camera.name, None if foxglove is None else foxglove.port)


def _transport(options: NodeOptions, messages: RosMessages) -> Transport:
    """Return the transport: rclpy if ROS is installed, else DDS."""
    if (options.transport or (RCLPY if find_spec(RCLPY) else DDS)) == RCLPY:
        if options.domain is not None:
            raise InputError(f"{FEATURE}: --domain is for bare DDS; within ROS it is ROS_DOMAIN_ID")
        from cuboid.ground.middleware.rclpy_node import RclpyTransport

        return RclpyTransport(options.node, messages)
    require("cyclonedds", FEATURE, EXTRA)
    from cuboid.ground.middleware.dds import DdsTransport

    return DdsTransport(domain_of(options.domain), messages)


def _poses(
    options: NodeOptions, transport: Transport, messages: RosMessages, stopped: Callable[[], bool]
) -> RosPoses | None:
    """Return the source of camera poses; None if they are estimated."""
    if options.pose == ESTIMATED:
        return None
    if options.pose == TF:
        return RosPoses(transport, messages, world=options.world)
    if not options.pose.startswith("/"):
        raise InputError(f"{FEATURE}: --pose is {TF}, {ESTIMATED} or a topic such as /odom, got '{options.pose}'")
    while options.pose not in transport.topics():
        if stopped():
            raise StreamEndedError
        time.sleep(TICK_S)
    return RosPoses(transport, messages, options.pose)
