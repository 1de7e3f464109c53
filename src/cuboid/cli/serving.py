"""Options of the commands that open a page in the browser."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cuboid.views.serving import PageServer


def add_page(parser: argparse.ArgumentParser) -> None:
    """Add the options for the port and the browser."""
    parser.add_argument("--port", type=port, default=0, metavar="N", help="port of this machine (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address only, open no browser")


def serve(args: argparse.Namespace, what: str, page: PageServer) -> int:
    """Serve a page until Ctrl-C, and print its address; return the exit status."""
    import webbrowser

    from cuboid.cli.tables import console

    with page as server:
        address = f"http://localhost:{server.server_port}/"
        console().print(f"{what} at {address} (Ctrl-C ends it)", markup=False)
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
