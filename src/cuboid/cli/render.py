"""`cuboid render`: draw finished results as a video."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from cuboid.cli.results import add_finished, add_output, add_results, give, refuse_existing
from cuboid.cli.tables import console
from cuboid.ground.core.errors import InputError, counted

if TYPE_CHECKING:
    from cuboid.results.views.encoding import VideoWriter
    from cuboid.results.views.replay import Replay

EXAMPLE = "cuboid render DIR --show heat"

DEFAULT_NAMES = {"boxes": "labelled", "heat": "heat", "depth": "depth", "proposals": "proposals", "planes": "planes"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_finished(parser)
    add_output(
        parser, type=Path, metavar="FILE", help="the video (default: a file in DIR with the name of its contents)"
    )
    parser.add_argument(
        "--show",
        choices=tuple(DEFAULT_NAMES),
        default="boxes",
        help="labelled boxes, heat of the map, depth, 3D proposals of a frame, or supporting planes (default: boxes)",
    )
    parser.add_argument("--gif", action="store_true", help="write a small GIF instead of an MP4")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Draw all frames and write the video."""
    from rich.progress import track

    from cuboid.inputs.recordings.rig import RigRecording
    from cuboid.results.views.mosaic import CamerasVideo
    from cuboid.results.views.redraw import drawer
    from cuboid.results.views.replay import Replay
    from cuboid.results.views.tags import SteadyNames

    path = _path(args)
    replay = Replay(args.results, args.recording)
    recording = replay.recording
    cameras = [part.camera for part in recording.parts] if isinstance(recording, RigRecording) else []
    names = [camera.name for camera in cameras] or [""]
    draw = {name: drawer(args.show, args.results, replay, steady=SteadyNames()) for name in names}
    drawn = 0
    seen = replay.frames(recording.timestamp_s)
    shown = Console(stderr=True)
    with _writer(path, replay) as writer:
        video = CamerasVideo(writer, cameras)
        for found in track(seen, "drawing", len(replay), console=shown, transient=True, disable=not shown.is_terminal):
            frame = recording.read(found.index)
            video.add(frame.camera_name, draw[frame.camera_name](frame, found))
            drawn += 1
        video.finish()
    if drawn == 0:
        raise InputError(f"{args.results}: no frame of {recording.path} is in its trajectory")
    line = f"{counted(drawn, 'frame')} drawn; video in {path}"
    give(args, {"output": str(path), "frames": drawn}, lambda: console().print(line))
    return 0


def _path(args: argparse.Namespace) -> Path:
    """Return the output file; raises if its suffix is wrong, or if it exists and --force is not given."""
    suffix = ".gif" if args.gif else ".mp4"
    path: Path = args.output or args.results / f"{DEFAULT_NAMES[args.show]}{suffix}"
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: the video's name must end with {suffix}{'' if args.gif else ', or give --gif'}")
    refuse_existing(path, force=args.force)
    return path


def _writer(path: Path, replay: Replay) -> AbstractContextManager[VideoWriter]:
    from cuboid.results.views.encoding import GifWriter, Mp4Writer
    from cuboid.results.views.video import video_rate

    return GifWriter(path, len(replay)) if path.suffix.lower() == ".gif" else Mp4Writer(path, video_rate(replay.every))
