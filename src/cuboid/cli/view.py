"""`cuboid view`: show finished results or a scene in the browser, and name objects."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from cuboid.cli.results import add_finished
from cuboid.cli.serving import add_page, serve
from cuboid.cli.text_model import add_text_model, serving_model

EXAMPLE = "cuboid view DIR"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_finished(parser, "results of 'cuboid track', or a scene file")
    add_text_model(parser)
    add_page(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    import tempfile

    from cuboid.results.files import Results
    from cuboid.results.views.replay import Replay
    from cuboid.results.views.report.server import Viewer, make_server

    model = serving_model(args)
    with tempfile.TemporaryDirectory(prefix="cuboid-view-") as work:
        if args.results.is_file():
            from cuboid.runs.scene.viewing import scene_viewer

            viewer = scene_viewer(args.results, Path(work) / "results", args.recording, model)
        else:
            replay = Replay(args.results, args.recording)
            find = None if model is None else partial(Results(args.results, args.recording).find, model=model)
            viewer = Viewer(args.results, replay, replay.recording, find=find)
        return serve(args, str(args.results), make_server(viewer, args.port))
