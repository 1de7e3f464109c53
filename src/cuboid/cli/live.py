"""`--live`, `--rerun` and `--foxglove`: a look at a run from the browser, or from a viewer, while it goes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cuboid.cli.names import OPTIONAL
from cuboid.cli.serving import port

if TYPE_CHECKING:
    from cuboid.core.frame import Frame, Intrinsics
    from cuboid.core.results import FrameResult
    from cuboid.outputs import RunReport
    from cuboid.tracking.types import MapLike, Watch
    from cuboid.views.live import LiveView


def add_live(parser: argparse._ActionsContainer) -> None:
    """Add `--live`, `--live-host`, `--rerun` and `--foxglove`."""
    parser.add_argument("--live", action="store_true", help="show the run in the browser while it goes")
    parser.add_argument(
        "--live-host",
        metavar="ADDRESS",
        help="address of this machine that shows it to others too, 0.0.0.0 for all (default: to nobody else)",
    )
    parser.add_argument(
        "--rerun",
        nargs="?",
        const=OPTIONAL["--rerun"][0],
        metavar="FILE.rrd|ADDRESS",
        help="show the run in the rerun viewer while it goes; or write a file for it, or reach it at its address",
    )
    add_foxglove(parser)


def add_foxglove(parser: argparse._ActionsContainer) -> None:
    """Add `--foxglove`."""
    parser.add_argument(
        "--foxglove",
        nargs="?",
        type=address,
        const=OPTIONAL["--foxglove"][0],
        metavar="HOST:PORT",
        help="show the run in Foxglove while it goes: serve it at this address of this machine, 0.0.0.0:8765 for all "
        f"(default: {OPTIONAL['--foxglove'][0]}, for nobody else)",
    )


def address(text: str) -> tuple[str, int]:
    """Read HOST:PORT from the command line."""
    host, _, number = text.rpartition(":")
    if not host:
        raise argparse.ArgumentTypeError(f"expected HOST:PORT, got '{text}'")
    return host, port(number)


def say_foxglove(host: str, number: int) -> None:
    """Say where Foxglove finds the run."""
    shown = "localhost" if host == "127.0.0.1" else host
    print(f"cuboid: Foxglove connects to ws://{shown}:{number}", file=sys.stderr, flush=True)


@contextmanager
def watching(args: argparse.Namespace, name: str, intrinsics: Intrinsics) -> Iterator[Watching]:
    """Open what the arguments ask for; gives what looks at the run."""
    with ExitStack() as stack:
        live = stack.enter_context(live_view(args, name, intrinsics))
        looks: list[Watch] = [] if live is None else [live]
        if args.rerun is not None:
            from cuboid.views.rerun_view import RerunView

            looks.append(stack.enter_context(RerunView(args.rerun, name, intrinsics)))
        if args.foxglove is not None:
            from cuboid.views.foxglove_view import FoxgloveView

            view = stack.enter_context(FoxgloveView(intrinsics, *args.foxglove))
            say_foxglove(args.foxglove[0], view.port)
            looks.append(view)
        yield Watching(live, looks)


@dataclass(frozen=True, slots=True)
class Watching:
    """All that look at a run."""

    live: LiveView | None
    looks: Sequence[Watch]

    def __call__(self, frame: Frame, result: FrameResult, tracker: MapLike) -> None:
        """Show a used frame to all of them."""
        for look in self.looks:
            look(frame, result, tracker)

    def end(self, report: RunReport) -> None:
        """Tell that the run is over."""
        if self.live is not None:
            self.live.end(report.complete, report.warnings)


@contextmanager
def live_view(args: argparse.Namespace, name: str, intrinsics: Intrinsics) -> Iterator[LiveView | None]:
    """Serve the run where `--live` asks for it, and say where; gives what looks at the run."""
    if not args.live:
        if args.live_host is not None:
            from cuboid.core.errors import InputError

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
