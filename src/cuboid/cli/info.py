"""`cuboid info`: describe a recording before it is tracked."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from cuboid.cli.recording import add_reading, open_from
from cuboid.cli.results import add_results, give
from cuboid.cli.tables import console
from cuboid.ground.core.errors import counted
from cuboid.ground.core.skipped import kind_lines

if TYPE_CHECKING:
    from cuboid.inputs.recordings.inspecting import RecordingInfo

NAME_WIDTH = 14

EXAMPLE = "cuboid info RECORDING"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_reading(parser, thinned=False, tracked=False)
    parser.add_argument("--all", action="store_true", help="examine all frames instead of 24")
    parser.add_argument(
        "--check", action="store_true", help="also measure the offset between the clocks of poses and images (2 s)"
    )
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Examine, and print."""
    from cuboid.inputs.recordings.inspecting import inspect_recording

    recording = open_from(args)
    found = inspect_recording(recording, every_frame=args.all)
    document, clock = found.to_dict(), None
    if args.check:
        from cuboid.runs.pipeline.opening import checked_clock

        clock, entry = checked_clock(recording)
        document |= entry
    give(args, document, lambda: _print(found, clock))
    return 0


def _print(found: RecordingInfo, clock: str | None) -> None:
    out = console()
    for name, text in [*rows(found), *([] if clock is None else [("pose times", clock)])]:
        out.print(f"{name:<{NAME_WIDTH}}{text}", soft_wrap=True)
    for line in [*skipped_lines(found), *(f"warning: {warning}" for warning in found.warnings)]:
        out.print(line, soft_wrap=True)


def rows(found: RecordingInfo) -> list[tuple[str, str]]:
    """Return the lines of the table."""
    fx, fy, cx, cy = found.intrinsics
    lens = f"; distortion {', '.join(f'{v:g}' for v in found.distortion)} is removed" if found.distortion else ""
    return [
        ("recording", found.path),
        ("format", found.format),
        ("frames", f"{found.frames} of {found.size[0]} x {found.size[1]} pixels"),
        ("time", _time(found)),
        ("intrinsics", f"fx {fx:.2f} fy {fy:.2f} cx {cx:.2f} cy {cy:.2f} ({found.intrinsics_source}){lens}"),
        ("depth", _depth(found)),
        ("registration", _registration(found)),
        ("poses", _poses(found)),
        ("up", _up(found)),
    ]


def skipped_lines(found: RecordingInfo) -> list[str]:
    """Return the lines about frames that will be skipped."""
    examined = f"{found.looked_at} of {found.frames} frames examined"
    if not found.skipped:
        return [f"{examined}: all are usable"]
    return [f"{examined}; these will be skipped:", *kind_lines(found.skipped)]


def _time(found: RecordingInfo) -> str:
    origin = "times of the recording" if found.has_timestamps else "the recording has no times: 30 Hz assumed"
    if found.rate_hz is None or found.duration_s is None:
        return origin
    gaps = f", {found.gaps} gap{'s' * (found.gaps != 1)}" if found.gaps else ""
    return f"{found.duration_s:.2f} s at {found.rate_hz:.4g} Hz{gaps} ({origin})"


def _depth(found: RecordingInfo) -> str:
    text = f"{found.depth_units_per_metre:g} units per metre"
    if found.depth_range_m is not None and found.holes is not None:
        near, far = found.depth_range_m
        text += f", {near:.2f} to {far:.2f} m, {100 * found.holes:.0f} % without a reading"
    return text


def _registration(found: RecordingInfo) -> str:
    """Return one verdict on depth and color, with its certainty."""
    registered = ""
    if found.depth_camera is not None:
        camera, T = found.depth_camera["depth_camera"], found.depth_camera["T_color_depth"]
        apart_mm = 1000 * math.hypot(*(row[3] for row in T[:3]))
        size = f"{camera['width']} x {camera['height']}"
        registered = f"registered to color from {size}, fx {camera['fx']:.2f}, {apart_mm:.0f} mm away; "
    return registered + _agreement(found)


def _agreement(found: RecordingInfo) -> str:
    """Return how well the edges of depth and color agree, and what the commands do about it."""
    from cuboid.inputs.calibration.registering import WORTH_A_WARNING

    aligned = "depth" if found.depth_camera is not None else "depth taken as aligned to color"
    if found.depth_views == 0:
        return f"{aligned}: not checked, too few edges in depth"
    off_px, checked = found.depth_off_px, f"edges compared in {counted(found.depth_views, 'view')}"
    if off_px is None:
        return f"{aligned}: no clear displacement ({checked})"
    if off_px < WORTH_A_WARNING * found.size[0]:
        return f"{aligned}: displaced by {off_px:.0f} px, too little to be registered without --register on ({checked})"
    return (
        f"depth is displaced from color by {off_px:.0f} px ({checked}): 'cuboid track' registers it, if that is "
        "plausible, unless --register off is given; --register on shows the registration here"
    )


def _up(found: RecordingInfo) -> str:
    if found.up_world is None:
        return "measured by the device" if found.up_measured else "unknown: it will be estimated from the planes"
    return f"{', '.join(f'{value:g}' for value in found.up_world)} in the world of the poses"


def _poses(found: RecordingInfo) -> str:
    if not found.poses_looked_at:
        return "none: they will be estimated"
    found_in = (
        "all frames" if found.poses == found.poses_looked_at else f"{found.poses} of {found.poses_looked_at} frames"
    )
    length = "" if found.path_length_m is None else f", {found.path_length_m:.2f} m long"
    return f"{found_in}, camera to world (x right, y down, z forward){length}"
