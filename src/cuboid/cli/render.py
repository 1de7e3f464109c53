"""`cuboid render`: finished results as a video, drawn anew from what is in their folder."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from cuboid.frame import Frame, UInt8Array
    from cuboid.readers import Recording
    from cuboid.views.encoding import VideoWriter
    from cuboid.views.replay import Replay, ReplayedFrame

    Draw = Callable[[Frame, ReplayedFrame], UInt8Array]

HELP = "draw the results of a run into its recording, as a video"

DEFAULT_NAMES = {"boxes": "labelled", "heat": "heat", "depth": "depth", "proposals": "proposals"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("results", type=Path, metavar="DIR", help="what 'cuboid track' left behind")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, where it is not where it was")
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="the video (default: in DIR, named after what it shows)"
    )
    what = parser.add_mutually_exclusive_group()
    for name, text in (
        ("heat", "show the heat of the global map over the picture"),
        ("depth", "show the depth instead of the picture"),
        ("proposals", "show each frame's own 3D proposals instead of the objects"),
    ):
        what.add_argument(f"--{name}", action="store_const", const=name, dest="what", default="boxes", help=text)
    parser.add_argument("--gif", action="store_true", help="a small GIF instead of an MP4")


def run(args: argparse.Namespace) -> int:
    """Draw all frames and write the video."""
    from rich.console import Console
    from rich.progress import track

    from cuboid.cli.tables import console
    from cuboid.cli.threads import limit_threads
    from cuboid.errors import InputError
    from cuboid.views.replay import Replay

    limit_threads(1)
    path = _path(args)
    replay = Replay(args.results)
    recording = _recording(args.recording or replay.recording, replay)
    draw, drawn = _drawing(args.what, args.results, replay), 0
    seen = replay.frames(recording.timestamp_s)
    shown = Console(stderr=True)
    with _writer(path, replay) as video:
        for found in track(seen, "drawing", len(replay), console=shown, transient=True, disable=not shown.is_terminal):
            video.add(draw(recording.read(found.index), found))
            drawn += 1
    if drawn == 0:
        raise InputError(f"{args.results}: no frame of {recording.path} is in its trajectory")
    console().print(f"{drawn} frames drawn; video in {path}", markup=False)
    return 0


def _path(args: argparse.Namespace) -> Path:
    """Return the file to write; InputError where its name says another format."""
    from cuboid.errors import InputError

    suffix = ".gif" if args.gif else ".mp4"
    path: Path = args.output or args.results / f"{DEFAULT_NAMES[args.what]}{suffix}"
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: the video's name must end with {suffix}{'' if args.gif else ', or give --gif'}")
    return path


def _recording(path: Path, replay: Replay) -> Recording:
    """Open the recording of the results; InputError where it is another."""
    from cuboid.errors import InputError
    from cuboid.readers import open_recording

    K = replay.intrinsics
    recording = open_recording(path, format=replay.format, intrinsics=(K.fx, K.fy, K.cx, K.cy))
    size = recording.intrinsics.width, recording.intrinsics.height
    if size != (K.width, K.height) or len(recording) <= replay.last_frame:
        raise InputError(
            f"{recording.path}: is not the recording of the results: expected frame {replay.last_frame} "
            f"and {K.width} x {K.height} pixels, got {len(recording)} frames of {size[0]} x {size[1]}"
        )
    return recording


def _writer(path: Path, replay: Replay) -> AbstractContextManager[VideoWriter]:
    from cuboid.views.encoding import GifWriter, Mp4Writer
    from cuboid.views.video import video_rate

    return GifWriter(path, len(replay)) if path.suffix.lower() == ".gif" else Mp4Writer(path, video_rate(replay.every))


def _drawing(what: str, results: Path, replay: Replay) -> Draw:
    """Return what makes a picture of a frame."""
    from cuboid.outputs import read_map
    from cuboid.outputs.folder import MAP
    from cuboid.views.drawing import Status, draw_frame, draw_proposals
    from cuboid.views.overlays import depth_picture, heat_over, map_heat

    K = replay.intrinsics
    points = read_map(results / MAP) if what == "heat" else None

    def ground(frame: Frame, found: ReplayedFrame) -> UInt8Array:
        if points is not None:
            return heat_over(frame.color, map_heat(points, frame.depth_m, found.T_world_camera, K))
        return depth_picture(frame.depth_m, K) if what == "depth" else frame.color

    def draw(frame: Frame, found: ReplayedFrame) -> UInt8Array:
        status = Status(found.index, replay.frames_per_second, len(found.sightings), found.known)
        if what == "proposals":
            return draw_proposals(frame.color, found.T_world_camera, K, found.proposals, status)
        picture = ground(frame, found)
        return draw_frame(
            picture, found.T_world_camera, K, found.sightings, found.hidden, status, tinted=what != "heat"
        )

    return draw
