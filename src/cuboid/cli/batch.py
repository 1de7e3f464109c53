"""`cuboid batch`: track many recordings on many cores or machines, into one store."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from cuboid.cli.progress import Bar, Lines, display
from cuboid.cli.recording import (
    add_furniture,
    add_reading_options,
    add_relations,
    add_tracking,
    config_from,
    reading_from,
)
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.text_model import add_embedding, embedding_model
from cuboid.cli.workers import add_workers, workers_from
from cuboid.ground.core.errors import InputError, counted, one_line, printable
from cuboid.ground.core.extras import need_cluster
from cuboid.ground.version import __version__

if TYPE_CHECKING:
    from cuboid.fleet.batch.batch import Plan
    from cuboid.fleet.batch.task import Ended


class BatchProgress:
    """Shows the recordings that have ended, and counts them.

    Parameters
    ----------
    planned : Plan
    display : Bar or Lines
    dashboard : str
        Address of Dask's page.
    """

    def __init__(self, planned: Plan, display: Bar | Lines, dashboard: str) -> None:
        self._planned, self._display = planned, display
        self._states: Counter[str] = Counter()
        self._frames = self._objects = 0
        self._begun_s = time.monotonic()
        before = f", {planned.failed} failed before" if planned.failed else ""
        recordings = f"{counted(len(planned.tasks), 'recording')} to track, {planned.done} done before{before}"
        self._say(f"{recordings}; dashboard {dashboard}")
        for source, reason in planned.broken.items():
            self._say(f"{source.name}: {reason}")
        display.show(0, len(planned.tasks))

    def ended(self, one: Ended) -> None:
        """Count a recording that has ended."""
        self._states[one.state] += 1
        self._frames += one.frames
        self._objects += one.objects
        if one.reason is not None:
            self._say(f"{one.head.recording}: {one.state}: {one.reason}")
        done, total = self._states.total(), len(self._planned.tasks)
        left_s = (time.monotonic() - self._begun_s) / done * (total - done)
        left = f", about {duration(left_s)} left" if isinstance(self._display, Lines) else ""
        self._display.show(done, total, f"{counted(self._objects, 'object')}{left}")

    def count(self, state: str) -> int:
        """Return the number of recordings that ended in this state."""
        return self._states[state]

    def figures(self) -> dict[str, Any]:
        """Return the figures of the finished recordings, ready for JSON."""
        from cuboid.fleet.store.schema import DONE, FAILED, SET_ASIDE

        states = {state.replace(" ", "_"): self._states[state] for state in (DONE, FAILED, SET_ASIDE)}
        seconds = round(time.monotonic() - self._begun_s, 3)
        return {**states, "frames": self._frames, "objects": self._objects, "seconds": seconds}

    def summary(self, store: str) -> str:
        """Return the last line."""
        states = ", ".join(f"{count} {state}" for state, count in sorted(self._states.items())) or "nothing to do"
        broken = f", {len(self._planned.broken)} not listed" if self._planned.broken else ""
        before = f"; {self._planned.done} done before" if self._planned.done else ""
        found = f"{counted(self._frames, 'frame')}, {counted(self._objects, 'object')}"
        seconds = time.monotonic() - self._begun_s
        return printable(f"{states}{broken}{before}; {found} in {seconds:.1f} s; store {store}")

    def _say(self, line: str) -> None:
        self._display.print(printable(f"cuboid: {line}"))


def duration(seconds: float) -> str:
    """Return a time in units that suit its length."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"


EXAMPLE = "cuboid batch RECORDINGS --output STORE"

# --dry-run names this many recordings, and prints the number of the others.
RECORDINGS_NAMED = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="a recording, a folder of recordings, a glob in quotes, a .txt file with a recording per line, or a URL",
    )
    results = parser.add_argument_group("results")
    add_output(results, required=True, metavar="STORE", help="folder or URL of the store")
    results.add_argument(
        "--tables-only", action="store_true", help="store the tables only, without a result folder per recording"
    )
    add_relations(results)
    add_furniture(results)
    results.add_argument("--retry", action="store_true", help="also retry recordings that failed or were set aside")
    results.add_argument(
        "--tag",
        metavar="NAME",
        help="name of this version, as in 1.0+NAME: all recordings are tracked again, and the versions can be compared",
    )
    add_embedding(results)
    results.add_argument("--dry-run", action="store_true", help="list the recordings to track, and track none")
    add_results(results)
    add_workers(parser)
    add_reading_options(parser)
    add_tracking(parser)


def run(args: argparse.Namespace) -> int:
    """Track the recordings that are not done yet."""
    need_cluster("cuboid batch")

    from cuboid.fleet.batch.batch import Order, carry_out, plan
    from cuboid.fleet.batch.claim import claimed
    from cuboid.fleet.batch.sources import expand
    from cuboid.fleet.store.folder import StoreFolder
    from cuboid.fleet.store.page import write_summary
    from cuboid.fleet.store.schema import DONE

    version = f"{__version__}+{args.tag}" if args.tag else __version__
    embedding_model(args)  # mistakes are reported before workers start
    order = Order(args.output, settings_from(args), args.tables_only, args.retry, version)
    sources = expand(args.sources)
    place = StoreFolder(order.store)  # a mistake in its name is reported before workers start

    def waiting() -> None:
        print(
            one_line(f"cuboid: {order.store}: another batch is working on this store; waiting until it ends"),
            file=sys.stderr,
        )

    with workers_from(args).connected() as client, nullcontext() if args.dry_run else claimed(place, waiting):
        planned = plan(client, sources, order)
        if args.dry_run:
            give(args, _plan_document(planned), lambda: _print_plan(planned))
            return 0
        with display("recordings", Console(stderr=True), "recordings") as opened:
            shown = BatchProgress(planned, opened, str(client.dashboard_link))
            try:
                carry_out(client, planned, order, shown.ended)
            except KeyboardInterrupt:
                print(
                    "cuboid: interrupted; finished recordings are kept, and the same call continues with the others",
                    file=sys.stderr,
                )
                return 130
    if planned.tasks:
        write_summary(order.store)
    document = {"store": order.store, **shown.figures(), **_before(planned)}
    give(args, document, lambda: print(shown.summary(order.store)))
    return 0 if shown.count(DONE) == len(planned.tasks) and not planned.broken else 3


def settings_from(args: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of an `Order`."""
    if isinstance(args.intrinsics, Path):
        raise InputError("--intrinsics: a batch takes FX,FY,CX,CY only; put a camera.json into each recording instead")
    return {
        "reading": reading_from(args),
        "tracker": config_from(args).to_dict(),
        "proposals": args.proposals,
        "poses": args.poses,
        "bridge": args.bridge,
        "every": args.every,
        "limit": args.limit,
        "scale": args.scale,
        # only if they differ from the defaults: the settings are part of the identity of a run in the store
        **({"detector": args.detector} if args.detector else {}),
        **({"detector_every": args.detector_every} if args.detector_every else {}),
        **({"relations": True} if args.relations else {}),
        **({} if args.furniture else {"furniture": False}),
        **({"text_model": args.text_model} if args.text_model else {}),
    }


def _plan_document(planned: Plan) -> dict[str, Any]:
    """Return the recordings that would be tracked, ready for JSON."""
    to_do = [{"recording": task.source.name, "source": task.source.url} for task in planned.tasks]
    return {"to_do": to_do, **_before(planned)}


def _before(planned: Plan) -> dict[str, Any]:
    """Return the recordings that will not be tracked, with the reason, ready for JSON."""
    broken = [{"recording": one.name, "source": one.url, "reason": why} for one, why in planned.broken.items()]
    return {"done_before": planned.done, "failed_before": planned.failed, "not_listed": broken}


def _print_plan(planned: Plan) -> None:
    for task in planned.tasks[:RECORDINGS_NAMED]:
        print(f"would track {task.source.name}  ({task.source.url})")
    if len(planned.tasks) > RECORDINGS_NAMED:
        print(f"and {len(planned.tasks) - RECORDINGS_NAMED} more")
    for source, reason in planned.broken.items():
        print(f"cannot be listed: {source.name}: {reason}")
    print(
        f"{len(planned.tasks)} to do, {planned.done} done, {planned.failed} failed before (--retry tracks them again)"
    )
