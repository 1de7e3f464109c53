"""Options of the commands that track a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.names import detector_names, format_names, proposal_names, setting_names
from cuboid.cli.parser import depth_scale, pose_offset, positive, probability, takes_names
from cuboid.cli.workers import add_threads
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.ground.core.tolerances import DETECT_EVERY

if TYPE_CHECKING:
    from cuboid.ground.core.config import TrackerConfig
    from cuboid.inputs.readers import Recording
    from cuboid.runs.pipeline.options import TrackOptions


def add_recording(
    parser: argparse.ArgumentParser, default_threads: int, *, required: bool = True, several: bool = False
) -> None:
    """Add the recording (optional if not `required`), and the options for reading and tracking it.

    With `several` there may be one for each camera of a rig, and `args.recording` is a list.
    """
    add_reading(parser, required=required, several=several)
    add_threads(add_tracking(parser), default_threads)


def add_tracking(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Add the options for tracking; return the group."""
    tracking = parser.add_argument_group("tracking")
    tracking.add_argument(
        "--poses",
        choices=("given", "auto", "corrected", "estimated"),
        help="camera poses: given (used unchanged), auto (given, with a warning if they drift), corrected (given, and "
        "corrected where they drift), or estimated from the video (default: given if the recording has poses, else "
        "estimated)",
    )
    tracking.add_argument("--bridge", action="store_true", help="estimate the missing poses between given poses")
    tracking.add_argument(
        "--scale",
        type=int,
        choices=(1, 2, 4),
        default=1,
        help="reduce the images by this factor: faster, but coarser (default: 1)",
    )
    add_method(tracking)
    return tracking


def add_method(tracking: argparse._ActionsContainer) -> None:
    """Add the options for proposals, the detector, and the configuration."""
    source = tracking.add_argument("--proposals", metavar="NAME[:OPTIONS]", help="source of the 2D proposals")
    takes_names(source, proposal_names)
    detector = tracking.add_argument(
        "--detector",
        metavar="FILE.onnx[:OPTIONS]|NAME",
        help="2D detector that names the objects: an ONNX file (options: score=0.05, labels=FILE, threads=1, "
        "provider=NAME), or a model that 'cuboid models' downloaded",
    )
    takes_names(detector, detector_names)
    tracking.add_argument(
        "--detector-every",
        type=positive,
        metavar="N",
        help=f"run the detector on every N-th frame (default: {DETECT_EVERY}, on any computer, since a number that "
        "followed the clock would change the results); the run prints the cost",
    )
    tracking.add_argument(
        "--min-probability",
        type=probability,
        metavar="P",
        help="leave out objects whose probability of being one whole object is lower than this, 0.01 to 0.99",
    )
    field = tracking.add_argument(
        "--set",
        type=setting,
        action="append",
        default=[],
        dest="settings",
        metavar="NAME=VALUE",
        help="set a field of the tracker's configuration, such as voxel_m=0.02; may be repeated; fields",
    )
    takes_names(field, setting_names, ending="=")


def add_relations(parser: argparse._ActionsContainer) -> None:
    """Add `--relations`."""
    relations = "also find relations of objects (on, in, beside, under, against), once, at the end (0.1 to 2 s)"
    parser.add_argument("--relations", action="store_true", help=relations)


def add_furniture(parser: argparse._ActionsContainer) -> None:
    """Add `--no-furniture`."""
    no_furniture = "do not find the tables, shelves and other furniture that bear the planes (0.1 to 2 s at the end)"
    parser.add_argument("--no-furniture", action="store_false", dest="furniture", help=no_furniture)


def add_reading(
    parser: argparse.ArgumentParser,
    *,
    thinned: bool = True,
    required: bool = True,
    tracked: bool = True,
    several: bool = False,
) -> argparse._ArgumentGroup:
    """Add the recording and the options for reading it; return the group of the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    thinned : bool
        Add the options that select frames.
    required : bool
    tracked : bool
        By default register depth that is clearly displaced from color; if false, only with `--register`.
    several : bool
        Allow several recordings, for the cameras of a rig.
    """
    parser.add_argument(
        "recording",
        type=Path,
        metavar="RECORDING",
        nargs="*" if several else None if required else "?",
        default=[] if several else None,
        help="folder, file, archive or URL of the RGB-D recording",
    )
    return add_reading_options(parser, thinned=thinned, tracked=tracked)


def add_reading_options(
    parser: argparse.ArgumentParser, *, thinned: bool = True, tracked: bool = True
) -> argparse._ArgumentGroup:
    """Add the options for reading a recording; return the group. Parameters are those of `add_reading`."""
    reading = parser.add_argument_group("reading")
    layout = reading.add_argument("--format", metavar="NAME", help="layout of the recording, if it is not recognised")
    takes_names(layout, format_names)
    reading.add_argument(
        "--intrinsics",
        type=intrinsics,
        metavar="FX,FY,CX,CY|FILE",
        help="pinhole in pixels, or a camera.json, in place of the recording's intrinsics",
    )
    reading.add_argument(
        "--depth-scale", type=depth_scale, metavar="UNITS", help="depth units per metre, in place of the recording's"
    )
    reading.add_argument(
        "--pose-convention",
        metavar="NAME[,NAME]",
        help="convention of the poses, if it differs from that of the layout: inverse (world to camera), opengl (y up, "
        "z backward), mm or cm, wxyz or xyzw (order of quaternions)",
    )
    reading.add_argument(
        "--pose-offset",
        type=pose_offset,
        default="auto" if tracked else "off",
        metavar="auto|off|MILLISECONDS",
        help="added to the times of given poses: the offset between their clock and that of the images, if the images "
        "prove one (auto), nothing (off), or milliseconds (default: %(default)s)",
    )
    reading.add_argument(
        "--topics", metavar="color=TOPIC,depth=TOPIC", help="topics of a ROS bag, if they are not found by their names"
    )
    if thinned:
        reading.add_argument("--every", type=positive, default=1, metavar="N", help="use every N-th frame")
        reading.add_argument("--limit", type=positive, metavar="N", help="read at most N frames")
    reading.add_argument(
        "--register",
        nargs="?",
        choices=("auto", "on", "off"),
        const="on",
        default="auto" if tracked else "off",
        help="register depth to color: auto (if depth is clearly displaced), on, or off (default: %(default)s)",
    )
    return reading


def refuse_with_rig(args: argparse.Namespace, *options: str) -> None:
    """Raise InputError if one of these options, which are for one camera, was given."""
    for name in options:
        if getattr(args, name) is not None:
            raise InputError(f"--{name.replace('_', '-')} is for one camera; leave it out with --rig")


def open_from(args: argparse.Namespace, *, rigs: bool = False) -> Recording:
    """Open the recording that the arguments name; a rig of several cameras only with `rigs`."""
    from cuboid.inputs.recordings.rig import RigRecording
    from cuboid.runs.pipeline.opening import open_recording

    recording = open_recording(args.recording, **reading_from(args))
    if isinstance(recording, RigRecording) and not rigs:
        first = recording.parts[0].recording.path
        raise InputError(f"{args.recording}: is a rig; name the recording of one camera, such as {first}")
    return recording


def reading_from(args: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `cuboid.open_recording` from the command line."""
    return {
        "format": args.format if args.topics is None else f"ros-bag:{args.topics}",
        "intrinsics": args.intrinsics,
        "depth_scale": args.depth_scale,
        "register": args.register,
        "pose_convention": args.pose_convention,
        "pose_offset": "off" if getattr(args, "poses", None) == "estimated" else args.pose_offset,
    }


def tracking_from(args: argparse.Namespace, memory_mb: float = MEMORY_MB) -> TrackOptions:
    """Return how the command line asks to track a recording."""
    from cuboid.runs.pipeline.options import TrackOptions

    return TrackOptions(
        every=args.every,
        limit=args.limit,
        scale=args.scale,
        poses=args.poses,
        bridge=args.bridge,
        config=config_from(args),
        proposals=args.proposals,
        detector=args.detector,
        detector_every=args.detector_every,
        threads=args.threads,
        memory_mb=memory_mb,
    )


def config_from(args: argparse.Namespace) -> TrackerConfig:
    """Return the configuration from the arguments."""
    from cuboid.ground.core.config import TrackerConfig

    settings = dict(args.settings)
    if args.min_probability is not None:
        if "min_probability" in settings:
            raise InputError("--min-probability and --set min_probability are one setting; give one of them")
        settings["min_probability"] = args.min_probability
    return TrackerConfig.from_dict(settings)


def intrinsics(text: str) -> tuple[float, float, float, float] | Path:
    """Parse FX,FY,CX,CY, or the name of a file that contains them."""
    if text.endswith((".json", ".txt")):
        return Path(text)
    try:
        fx, fy, cx, cy = (float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected FX,FY,CX,CY in pixels or a .json file, got '{text}'") from None
    if not (0 < fx < float("inf") and 0 < fy < float("inf") and abs(cx + cy) < float("inf")):
        raise argparse.ArgumentTypeError(f"expected finite numbers with FX, FY > 0, got '{text}'")
    return fx, fy, cx, cy


def setting(text: str) -> tuple[str, str]:
    """Parse NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not name or not equals or not value:
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE, got '{text}'")
    return name.strip(), value.strip()
