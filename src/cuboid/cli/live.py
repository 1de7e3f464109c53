"""`--live`: a look at a run from the browser while it goes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cuboid.frame import Intrinsics
    from cuboid.views.live import LiveView


def add_live(parser: argparse._ActionsContainer) -> None:
    """Add `--live` and `--live-host`."""
    parser.add_argument("--live", action="store_true", help="show the run in the browser while it goes")
    parser.add_argument(
        "--live-host",
        metavar="ADDRESS",
        help="address of this machine that shows it to others too, 0.0.0.0 for all (default: to nobody else)",
    )


@contextmanager
def live_view(args: argparse.Namespace, name: str, intrinsics: Intrinsics) -> Iterator[LiveView | None]:
    """Serve the run where `--live` asks for it, and say where; gives what looks at the run."""
    if not args.live:
        if args.live_host is not None:
            from cuboid.errors import InputError

            raise InputError("--live-host says where --live is seen; give --live too")
        yield None
        return
    from cuboid.views.live import LiveServer, LiveView
    from cuboid.views.serving import HOST

    host = args.live_host or HOST
    with LiveServer(LiveView(), name, intrinsics, host) as server:
        shown = "localhost" if args.live_host is None else host
        print(f"cuboid: live at http://{shown}:{server.port}/", file=sys.stderr, flush=True)
        yield server.view
