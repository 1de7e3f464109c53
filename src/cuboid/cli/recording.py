"""What the commands that track a recording have in common."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.threads import add_threads, positive

if TYPE_CHECKING:
    from cuboid.config import TrackerConfig
    from cuboid.readers import Recording


def add_recording(parser: argparse.ArgumentParser, default_threads: int, *, required: bool = True) -> None:
    """Add the recording, where wanted as one of several things to track, and how it is read and tracked."""
    add_reading(parser, required=required)
    add_threads(add_tracking(parser), default_threads)


def add_tracking(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add how recordings are tracked; return the group."""
    tracking = parser.add_argument_group("tracking")
    tracking.add_argument(
        "--poses",
        choices=("given", "auto", "corrected", "estimated"),
        help="camera poses: given as they are, auto (given, with a warning where they drift), corrected where they "
        "drift, or estimated from the video (default: given where the recording has them, else estimated)",
    )
    tracking.add_argument(
        "--bridge", action="store_true", help="estimate the poses of frames between given poses that have none"
    )
    tracking.add_argument(
        "--scale",
        type=int,
        choices=(1, 2, 4),
        default=1,
        help="pixels of the recording a side that become one: faster, coarser (default: 1)",
    )
    tracking.add_argument("--proposals", metavar="NAME[:OPTIONS]", help="source of the 2D proposals")
    tracking.add_argument(
        "--set",
        type=setting,
        action="append",
        default=[],
        dest="settings",
        metavar="NAME=VALUE",
        help="a field of the tracker's configuration, such as voxel_m=0.02; may be repeated",
    )
    return tracking


def add_reading(
    parser: argparse.ArgumentParser, *, thinned: bool = True, required: bool = True
) -> argparse._ArgumentGroup:
    """Add the recording and how it is read, where wanted with thinning; return the group of the latter."""
    parser.add_argument(
        "recording",
        type=Path,
        metavar="RECORDING",
        nargs=None if required else "?",
        help="folder, file, archive or URL of the RGB-D recording",
    )
    return add_reading_options(parser, thinned=thinned)


def add_reading_options(parser: argparse.ArgumentParser, *, thinned: bool = True) -> argparse._ArgumentGroup:
    """Add how a recording is read, where wanted with thinning; return the group."""
    reading = parser.add_argument_group("reading")
    reading.add_argument("--format", metavar="NAME", help="its layout, where it is not recognised")
    reading.add_argument(
        "--intrinsics",
        type=intrinsics,
        metavar="FX,FY,CX,CY|FILE",
        help="pinhole in pixels, or a camera.json, instead of its own",
    )
    reading.add_argument(
        "--depth-scale", type=depth_scale, metavar="UNITS", help="depth units a metre, instead of its own"
    )
    reading.add_argument(
        "--topics", metavar="color=TOPIC,depth=TOPIC", help="topics of a ROS bag, where they are not found by name"
    )
    if thinned:
        reading.add_argument("--every", type=positive, default=1, metavar="N", help="use each N-th frame")
        reading.add_argument("--limit", type=positive, metavar="N", help="read at most N frames")
    reading.add_argument(
        "--register", action="store_true", help="find the registration of depth to color, and apply it"
    )
    return reading


def open_from(args: argparse.Namespace) -> Recording:
    """Open the recording that the arguments name, and register it where they ask for it."""
    return open_as(args.recording, **reading_from(args))


def reading_from(args: argparse.Namespace) -> dict[str, Any]:
    """Return how the arguments say that recordings are read, for `open_as`."""
    return {
        "format": args.format if args.topics is None else f"ros-bag:{args.topics}",
        "intrinsics": args.intrinsics,
        "depth_scale": args.depth_scale,
        "register": args.register,
    }


def open_as(path: Path, *, register: bool, **options: Any) -> Recording:
    """Open a recording with the options of `cuboid.open_recording`, and register it where that is asked for."""
    from cuboid.readers import open_recording

    recording = open_recording(path, **options)
    return _registered(recording) if register else recording


def _registered(recording: Recording) -> Recording:
    """Return the recording with depth on color, and say what was found."""
    from cuboid.calibration.registering import register_recording

    found, registered = register_recording(recording)
    camera = registered.depth_camera
    if found is None or not found.clear or camera is None:
        views = 0 if found is None else found.views
        print(
            f"cuboid: --register: depth does not clearly lie beside color ({views} views); left as it is",
            file=sys.stderr,
        )
        return recording
    tx, ty, _ = 100 * camera.T_color_depth[:3, 3]
    print(
        f"cuboid: --register: depth lay {found.off_px:.1f} px beside color ({found.views} views); depth camera "
        f"fx {camera.fx:.1f} fy {camera.fy:.1f} cx {camera.cx:.1f} cy {camera.cy:.1f}, "
        f"{tx:.1f}, {ty:.1f} cm in the color camera's x, y",
        file=sys.stderr,
    )
    return registered


def tracking_from(args: argparse.Namespace) -> dict[str, Any]:
    """Return how the arguments say that a recording is tracked, for `cuboid.track_recording`."""
    return {
        "config": config_from(args),
        "proposals": args.proposals,
        "poses": args.poses,
        "bridge": args.bridge,
        "every": args.every,
        "limit": args.limit,
        "scale": args.scale,
        "threads": args.threads,
    }


def config_from(args: argparse.Namespace) -> TrackerConfig:
    """Return the configuration that the arguments give."""
    from cuboid.config import TrackerConfig

    return TrackerConfig.from_dict(dict(args.settings))


def intrinsics(text: str) -> tuple[float, float, float, float] | Path:
    """Read FX,FY,CX,CY, or the name of a file that holds them, from the command line."""
    if text.endswith((".json", ".txt")):
        return Path(text)
    try:
        fx, fy, cx, cy = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected FX,FY,CX,CY in pixels or a .json file, got '{text}'") from None
    if not (0 < fx < float("inf") and 0 < fy < float("inf") and abs(cx + cy) < float("inf")):
        raise argparse.ArgumentTypeError(f"expected finite numbers with FX, FY > 0, got '{text}'")
    return fx, fy, cx, cy


def depth_scale(text: str) -> float:
    """Read a number of depth units a metre from the command line."""
    return _above_zero(text, "depth units a metre")


def seconds(text: str) -> float:
    """Read a time above 0 from the command line."""
    return _above_zero(text, "seconds")


def megabytes(text: str) -> float:
    """Read an amount of memory above 0, in units of 2**20 bytes, from the command line."""
    return _above_zero(text, "megabytes")


def _above_zero(text: str, what: str) -> float:
    """Read a finite number above 0 from the command line."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected {what}, above 0, got '{text}'")
    return value


def setting(text: str) -> tuple[str, str]:
    """Read NAME=VALUE from the command line."""
    name, equals, value = text.partition("=")
    if not name or not equals or not value:
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE, got '{text}'")
    return name.strip(), value.strip()
