"""`cuboid view`: finished results in the browser, image and map side by side."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.serving import add_page, serve

EXAMPLE = "cuboid view DIR"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("results", type=Path, metavar="DIR", help="what 'cuboid track' left behind")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, where it is not where it was")
    add_page(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    from cuboid.core.threads import limit_threads
    from cuboid.views.replay import Replay
    from cuboid.views.report.server import Viewer, make_server

    limit_threads(1)
    replay = Replay(args.results, args.recording)
    recording = replay.recording
    viewer = Viewer(args.results, replay, recording)
    _ = viewer.page  # a mistake in the results is told here, not to the browser
    return serve(args, str(args.results), make_server(viewer, args.port))
