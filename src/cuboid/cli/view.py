"""`cuboid view`: finished results in the browser, image and map side by side."""

from __future__ import annotations

import argparse
from pathlib import Path

HELP = "look at finished results in the browser, image and map side by side"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""
    parser.add_argument("results", type=Path, metavar="DIR", help="what 'cuboid track' left behind")
    parser.add_argument("--recording", type=Path, metavar="PATH", help="the recording, where it is not where it was")
    parser.add_argument("--port", type=port, default=0, metavar="N", help="port of this machine (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="only say the address, open no browser")


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    import webbrowser

    from cuboid.cli.tables import console
    from cuboid.cli.threads import limit_threads
    from cuboid.readers.reopen import reopen_recording
    from cuboid.views.replay import Replay
    from cuboid.views.report.server import Viewer, make_server

    limit_threads(1)
    replay = Replay(args.results)
    where = args.recording or replay.recording
    recording = reopen_recording(
        where, replay.format, replay.intrinsics, replay.distortion, replay.depth_camera, replay.last_frame
    )
    viewer = Viewer(args.results, replay, recording)
    _ = viewer.page  # a mistake in the results is told here, not to the browser
    with make_server(viewer, args.port) as server:
        address = f"http://localhost:{server.server_port}/"
        console().print(f"{args.results} at {address} (Ctrl-C ends it)", markup=False)
        if not args.no_browser:
            webbrowser.open(address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            console().print("ended", markup=False)
    return 0


def port(text: str) -> int:
    """Read a port's number from the command line."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number <= 65535:
        raise argparse.ArgumentTypeError(f"expected a port, 0 to 65535, got '{text}'")
    return number
