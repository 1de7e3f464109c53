"""`--live`, `--rerun` and `--foxglove`: show a run in the browser or in another viewer as it proceeds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cuboid.cli.names import OPTIONAL
from cuboid.cli.parser import port
from cuboid.cli.serving import HOST, listen
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.extras import need_serve

if TYPE_CHECKING:
    from cuboid.ground.core.frame import Frame, Intrinsics
    from cuboid.ground.core.results import FrameResult
    from cuboid.results.files import RunReport
    from cuboid.results.views.live import LiveView
    from cuboid.runs.tracking.types import MapLike, Watch
    from cuboid.services.service.process import ServedRun


def add_live(parser: argparse._ActionsContainer) -> None:
    """Add `--live`, `--live-host`, `--rerun` and `--foxglove`."""
    parser.add_argument("--live", action="store_true", help="show the run in the browser as it proceeds")
    parser.add_argument(
        "--live-host",
        metavar="ADDRESS",
        help="address at which other machines see the live page, 0.0.0.0 for all (default: this machine only)",
    )
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=OPTIONAL["--rerun"][0],
        metavar="FILE.rrd|ADDRESS",
        help="show the run in the rerun viewer as it proceeds; or write a file for it, or connect to its address",
    )
    add_foxglove(parser)


def add_serve(parser: argparse._ActionsContainer) -> None:
    """Add `--serve` and `--serve-host`."""
    parser.add_argument(
        "--serve",
        nargs="?",
        const=OPTIONAL["--serve"][0],
        type=port,
        metavar="PORT",
        help="answer other programs over HTTP as the run proceeds, as 'cuboid serve' does (default port: %(const)s)",
    )
    parser.add_argument(
        "--serve-host",
        metavar="ADDRESS",
        help="address at which other machines, with the printed token, get answers, 0.0.0.0 for all "
        "(default: this machine only)",
    )


def add_foxglove(parser: argparse._ActionsContainer) -> None:
    """Add `--foxglove`."""
    parser.add_argument(
        "--foxglove",
        nargs="?",
        type=address,
        const=OPTIONAL["--foxglove"][0],
        metavar="HOST:PORT",
        help="show the run in Foxglove as it proceeds, at this address of this machine; 0.0.0.0:8765 for all machines "
        f"(default: {OPTIONAL['--foxglove'][0]}, this machine only)",
    )


def address(text: str) -> tuple[str, int]:
    """Parse HOST:PORT."""
    host, _, number = text.rpartition(":")
    if not host:
        raise argparse.ArgumentTypeError(f"expected HOST:PORT, got '{text}'")
    return host, port(number)


def say_foxglove(host: str, number: int) -> None:
    """Print the address for Foxglove."""
    shown = "localhost" if host == "127.0.0.1" else host
    print(f"cuboid: Foxglove connects to ws://{shown}:{number}", file=sys.stderr, flush=True)


@contextmanager
def served_run(args: argparse.Namespace, name: str) -> Iterator[ServedRun | None]:
    """Serve the run over HTTP if `--serve` is given, and print the address; yields the server, or None."""
    if args.serve is None:
        if args.serve_host is not None:
            raise InputError("--serve-host is an option of --serve; give --serve too")
        yield None
        return

    need_serve("cuboid track --serve")
    from cuboid.services.service.process import ServedRun

    address = listen(args.serve_host or HOST, args.serve, None)
    with ServedRun(name, address.listening, address.token, address.hosts) as served:
        print(f"cuboid: serving at {address.url}", file=sys.stderr, flush=True)
        yield served


@contextmanager
def watching(
    args: argparse.Namespace, name: str, intrinsics: Intrinsics, cameras: Sequence[str] = ()
) -> Iterator[Watching]:
    """Open the views that the arguments request; `cameras` are the names of those of a rig."""
    with ExitStack() as stack:
        live = stack.enter_context(live_view(args, name, intrinsics))
        views: list[Watch] = [] if live is None else [live]
        served = stack.enter_context(served_run(args, name))
        views += [] if served is None else [served]
        if args.rerun is not None:
            from cuboid.results.views.rerun_view import RerunView

            views.append(stack.enter_context(RerunView(args.rerun, name, intrinsics)))
        if args.foxglove is not None:
            from cuboid.results.views.foxglove_view import FoxgloveView

            view = stack.enter_context(FoxgloveView(intrinsics, args.foxglove[0], args.foxglove[1], cameras))
            say_foxglove(args.foxglove[0], view.port)
            views.append(view)
        yield Watching(live, views)


@dataclass(frozen=True, slots=True)
class Watching:
    """All views of a run."""

    live: LiveView | None
    views: Sequence[Watch]

    def __call__(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        """Show a used frame in all views."""
        for show in self.views:
            show(frame, result, tracker)

    def end(self, report: RunReport) -> None:
        """Report the end of the run."""
        if self.live is not None:
            self.live.end(report.complete, report.warnings)


@contextmanager
def live_view(args: argparse.Namespace, name: str, intrinsics: Intrinsics) -> Iterator[LiveView | None]:
    """Serve the live page if `--live` is given, and print the address; yields the view, or None."""
    if not args.live:
        if args.live_host is not None:
            raise InputError("--live-host is an option of --live; give --live too")
        yield None
        return
    from cuboid.results.views.live import LiveServer, LiveView
    from cuboid.results.views.serving import HOST

    host = args.live_host or HOST
    with LiveServer(LiveView(), name, intrinsics, host) as server:
        shown = "localhost" if args.live_host is None else host
        print(f"cuboid: live at http://{shown}:{server.port}/", file=sys.stderr, flush=True)
        yield server.view
