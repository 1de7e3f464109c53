"""`--live` and `--rerun`: show a run in the browser or in the rerun viewer as it proceeds."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cuboid.cli.names import OPTIONAL
from cuboid.cli.serving import HOST, listen, port

if TYPE_CHECKING:
    from cuboid.core.frame import Frame, Intrinsics
    from cuboid.core.results import FrameResult
    from cuboid.outputs import RunReport
    from cuboid.service.process import ServedRun
    from cuboid.tracking.types import MapLike, Watch
    from cuboid.views.live import LiveView


def add_live(parser: argparse._ActionsContainer) -> None:
    """Add `--live`, `--live-host` and `--rerun`."""
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


def add_serve(parser: argparse._ActionsContainer) -> None:
    """Add `--serve` and `--serve-host`."""
    parser.add_argument(
        "--serve",
        nargs="?",
        const=OPTIONAL["--serve"][0],
        type=port,
        metavar="PORT",
        help="answer other programs over HTTP while the run goes, as 'cuboid serve' does (default port: %(const)s)",
    )
    parser.add_argument(
        "--serve-host",
        metavar="ADDRESS",
        help="address of this machine that answers others too, who need the token that is printed",
    )


@contextmanager
def served_run(args: argparse.Namespace, name: str) -> Iterator[ServedRun | None]:
    """Answer about the run where `--serve` asks for it, and say where; gives what looks at the run."""
    if args.serve is None:
        if args.serve_host is not None:
            from cuboid.core.errors import InputError

            raise InputError("--serve-host says where --serve answers; give --serve too")
        yield None
        return
    from cuboid.core.extras import need_serve

    need_serve("cuboid track --serve")
    from cuboid.service.process import ServedRun

    address = listen(args.serve_host or HOST, args.serve, None)
    with ServedRun(name, address.listening, address.token, address.hosts) as served:
        print(f"cuboid: serving at {address.url}", file=sys.stderr, flush=True)
        yield served


@contextmanager
def watching(args: argparse.Namespace, name: str, intrinsics: Intrinsics) -> Iterator[Watching]:
    """Open the views that the arguments ask for."""
    with ExitStack() as stack:
        live = stack.enter_context(live_view(args, name, intrinsics))
        looks: list[Watch] = [] if live is None else [live]
        served = stack.enter_context(served_run(args, name))
        looks += [] if served is None else [served]
        if args.rerun is not None:
            from cuboid.views.rerun_view import RerunView

            looks.append(stack.enter_context(RerunView(args.rerun, name, intrinsics)))
        yield Watching(live, looks)


@dataclass(frozen=True, slots=True)
class Watching:
    """All views of a run."""

    live: LiveView | None
    looks: Sequence[Watch]

    def __call__(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        """Show a used frame to all of them."""
        for look in self.looks:
            look(frame, result, tracker)

    def end(self, report: RunReport) -> None:
        """Report the end of the run."""
        if self.live is not None:
            self.live.end(report.complete, report.warnings)


@contextmanager
def live_view(args: argparse.Namespace, name: str, intrinsics: Intrinsics) -> Iterator[LiveView | None]:
    """Serve the run if `--live` is given, and print the address; gives the view, or None."""
    if not args.live:
        if args.live_host is not None:
            from cuboid.core.errors import InputError

            raise InputError("--live-host is an option of --live; give --live too")
        yield None
        return
    from cuboid.views.live import LiveServer, LiveView
    from cuboid.views.serving import HOST

    host = args.live_host or HOST
    with LiveServer(LiveView(), name, intrinsics, host) as server:
        shown = "localhost" if args.live_host is None else host
        print(f"cuboid: live at http://{shown}:{server.port}/", file=sys.stderr, flush=True)
        yield server.view
