"""`cuboid ros2`: track the images of a running ROS 2, and publish the objects there."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.live import add_foxglove, say_foxglove
from cuboid.cli.parser import pose_offset, positive
from cuboid.cli.recording import add_method, config_from
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.workers import add_threads
from cuboid.ground.core.limits import FRAMES_WAITING
from cuboid.ground.core.tolerances import DETECT_EVERY

if TYPE_CHECKING:
    from cuboid.ground.core.frame import Intrinsics
    from cuboid.services.ros2.opening import OpenNode
    from cuboid.services.ros2.session import Session

EXAMPLE = "cuboid ros2 --color /camera/color/image_raw --depth /camera/aligned_depth_to_color/image_raw --pose tf"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    topics = parser.add_argument_group("topics in; Ctrl-C ends the node")
    found = "found by name"
    topics.add_argument(
        "--color",
        action="append",
        default=[],
        metavar="TOPIC",
        help=f"color images, with --rig of each camera, repeated (default: {found})",
    )
    topics.add_argument(
        "--depth", action="append", default=[], metavar="TOPIC", help=f"depth, aligned to color (default: {found})"
    )
    topics.add_argument("--info", metavar="TOPIC", help="CameraInfo of color (default: camera_info beside color)")
    topics.add_argument(
        "--pose",
        metavar="tf|TOPIC|estimated",
        default="estimated",
        help="camera poses: from tf, from a topic of PoseStamped, PoseWithCovarianceStamped or Odometry, or estimated "
        "from the images (default: %(default)s)",
    )
    topics.add_argument(
        "--pose-offset",
        type=pose_offset,
        default="auto",
        metavar="auto|off|MILLISECONDS",
        help="added to the times of poses: what the images of the first 10 s show (auto), nothing (off), or "
        "milliseconds (default: %(default)s)",
    )
    topics.add_argument(
        "--rig", type=Path, metavar="FILE", help="rig.json of several cameras, in the order of the color topics"
    )
    topics.add_argument("--world", metavar="FRAME", help="frame of the world (default: the root of tf; else map)")
    node = parser.add_argument_group("node")
    node.add_argument("--node", default="cuboid", metavar="NAME", help="its name (default: %(default)s)")
    node.add_argument(
        "--transport", choices=("dds", "rclpy"), help="dds needs no ROS (default: rclpy if a ROS is sourced, else dds)"
    )
    node.add_argument("--domain", metavar="N", help="ROS_DOMAIN_ID of dds (default: that of the environment, or 0)")
    node.add_argument("--sim-time", action="store_true", help="take the time from /clock")
    node.add_argument(
        "--param",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a parameter: object_frames=true (a frame of tf for each object), min_probability=0.5, map_every_s=2 "
        "(interval of the point map); may be repeated",
    )
    add_foxglove(node)
    node.add_argument(
        "--queue",
        type=positive,
        default=FRAMES_WAITING,
        metavar="N",
        help="images that wait for the tracker; if more arrive, the oldest is dropped (default: %(default)s)",
    )
    node.add_argument("--limit", type=positive, metavar="N", help="end after N frames")
    results = parser.add_argument_group("results")
    add_output(results, type=Path, metavar="DIR", help="folder of the results, written at the end and on request")
    add_results(results)
    tracking = parser.add_argument_group("tracking")
    add_method(tracking)
    add_threads(tracking, 1)


def run(args: argparse.Namespace) -> int:
    """Run the node until a signal."""
    from cuboid.cli.interrupt import interruptible
    from cuboid.cli.progress import load_kernels
    from cuboid.inputs.cameras.driver import StreamEndedError
    from cuboid.services.ros2.opening import NodeOptions, open_node
    from cuboid.services.ros2.parameters import Parameters

    options = NodeOptions(
        color=tuple(args.color),
        depth=tuple(args.depth),
        info=args.info,
        rig=args.rig,
        pose=args.pose,
        pose_offset=0.0 if args.pose_offset == "off" else args.pose_offset,
        world=args.world,
        node=args.node,
        transport=args.transport,
        domain=args.domain,
        simulated_time=args.sim_time,
        foxglove=args.foxglove,
        queue=args.queue,
    )
    Parameters(lambda settings: None).set_texts(args.param)  # mistakes are reported before the wait for images

    def make_session(intrinsics: Intrinsics, poses: str) -> Session:
        return session_from(args, intrinsics, poses)

    load_kernels()
    with interruptible() as interruption:
        say("waiting for images")
        try:
            with open_node(options, make_session, interruption) as opened:
                interruption.on_signal = opened.live.close
                say_opened(args, opened)
                opened.node.parameters.set_texts(args.param)
                opened.node.run(args.limit)
                end(args, opened)
        except StreamEndedError:
            say("ended before the first image")
    return 0


def session_from(args: argparse.Namespace, intrinsics: Intrinsics, poses: str) -> Session:
    """Return the session that the arguments describe."""
    from cuboid.runs.tracking.tracker import Tracker
    from cuboid.services.ros2.session import Session

    config: Any = config_from(args)

    def make_tracker() -> Tracker:
        every = args.detector_every or DETECT_EVERY
        return Tracker(intrinsics, config, args.proposals, poses=poses, detector=args.detector, detector_every=every)

    return Session(make_tracker, args.output, force=args.force)


def say_opened(args: argparse.Namespace, opened: OpenNode) -> None:
    """Print the connections of the node."""
    say(f"node {args.node} on {opened.transport}: images of {opened.camera}, poses {args.pose}")
    if opened.foxglove_port is not None:
        say_foxglove(args.foxglove[0], opened.foxglove_port)


def end(args: argparse.Namespace, opened: OpenNode) -> None:
    """Print the warnings and figures, and write the results if an output folder is given."""
    for warning in opened.node.warnings:
        say(f"warning: {warning}")
    figures = opened.node.figures()
    give(args, figures, lambda: say(", ".join(f"{name} {value}" for name, value in figures.items())))
    saved = opened.node.finish()
    if saved is not None:
        say(f"results in {saved}")


def say(line: str) -> None:
    """Print a line for the user to standard error."""
    print(f"cuboid: {line}", file=sys.stderr, flush=True)
