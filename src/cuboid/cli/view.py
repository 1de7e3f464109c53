"""`cuboid view`: show finished results or a scene in the browser, and give names to objects."""

from __future__ import annotations

import argparse
from pathlib import Path

from cuboid.cli.serving import add_page, serve

EXAMPLE = "cuboid view DIR"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("results", type=Path, metavar="DIR", help="results of 'cuboid track', or a scene file")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, if it has moved since the run")
    add_page(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    import tempfile

    from cuboid.core.threads import limit_threads
    from cuboid.views.replay import Replay
    from cuboid.views.report.server import Viewer, make_server

    limit_threads(1)
    with tempfile.TemporaryDirectory(prefix="cuboid-view-") as work:
        if args.results.is_file():
            from cuboid.scene.viewing import scene_viewer

            viewer = scene_viewer(args.results, Path(work) / "results", args.recording)
        else:
            replay = Replay(args.results, args.recording)
            viewer = Viewer(args.results, replay, replay.recording)
        return serve(args, str(args.results), make_server(viewer, args.port))
