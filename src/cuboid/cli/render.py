"""`cuboid render`: finished results as a video, drawn anew from what is in their folder."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.results import add_output, add_results, give, refuse_existing

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from cuboid.views.encoding import VideoWriter
    from cuboid.views.replay import Replay

EXAMPLE = "cuboid render DIR --show heat"

DEFAULT_NAMES = {"boxes": "labelled", "heat": "heat", "depth": "depth", "proposals": "proposals", "planes": "planes"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("results", type=Path, metavar="DIR", help="what 'cuboid track' left behind")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, where it is not where it was")
    add_output(parser, type=Path, metavar="FILE", help="the video (default: in DIR, named after what it shows)")
    parser.add_argument(
        "--show",
        choices=tuple(DEFAULT_NAMES),
        default="boxes",
        help="labels, heat of the map, depth, each frame's own 3D proposals, or supporting planes (default: boxes)",
    )
    parser.add_argument("--gif", action="store_true", help="a small GIF instead of an MP4")
    add_results(parser)


def run(args: argparse.Namespace) -> int:
    """Draw all frames and write the video."""
    from rich.console import Console
    from rich.progress import track

    from cuboid.cli.tables import console
    from cuboid.core.errors import InputError
    from cuboid.core.threads import limit_threads
    from cuboid.views.redraw import drawer
    from cuboid.views.replay import Replay
    from cuboid.views.tags import SteadyNames

    limit_threads(1)
    path = _path(args)
    replay = Replay(args.results, args.recording)
    recording = replay.recording
    draw, drawn = drawer(args.show, args.results, replay, steady=SteadyNames()), 0
    seen = replay.frames(recording.timestamp_s)
    shown = Console(stderr=True)
    with _writer(path, replay) as video:
        for found in track(seen, "drawing", len(replay), console=shown, transient=True, disable=not shown.is_terminal):
            video.add(draw(recording.read(found.index), found))
            drawn += 1
    if drawn == 0:
        raise InputError(f"{args.results}: no frame of {recording.path} is in its trajectory")
    line = f"{drawn} frames drawn; video in {path}"
    give(args, {"output": str(path), "frames": drawn}, lambda: console().print(line, markup=False))
    return 0


def _path(args: argparse.Namespace) -> Path:
    """Return the file to write; an error where its name says another format, or it exists and --force is not given."""
    from cuboid.core.errors import InputError

    suffix = ".gif" if args.gif else ".mp4"
    path: Path = args.output or args.results / f"{DEFAULT_NAMES[args.show]}{suffix}"
    if path.suffix.lower() != suffix:
        raise InputError(f"{path}: the video's name must end with {suffix}{'' if args.gif else ', or give --gif'}")
    refuse_existing(path, force=args.force)
    return path


def _writer(path: Path, replay: Replay) -> AbstractContextManager[VideoWriter]:
    from cuboid.views.encoding import GifWriter, Mp4Writer
    from cuboid.views.video import video_rate

    return GifWriter(path, len(replay)) if path.suffix.lower() == ".gif" else Mp4Writer(path, video_rate(replay.every))
