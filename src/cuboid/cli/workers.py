"""Options for the number of threads and workers of a command."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cuboid.cli.parser import positive
from cuboid.ground.core.errors import InputError

if TYPE_CHECKING:
    from cuboid.fleet.batch.cluster import Workers


def add_threads(parser: argparse._ActionsContainer, default: int) -> None:
    """Add `--threads`."""
    parser.add_argument(
        "--threads",
        type=positive,
        default=default,
        metavar="N",
        help="number of threads: with 2, a second thread decodes and prepares the next frames; with 3, decoding has "
        "its own; the libraries use more (default: %(default)s)",
    )


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the options for workers."""
    work = parser.add_argument_group("workers")
    work.add_argument("--workers", type=positive, metavar="N", help="workers on this machine (default: one per core)")
    work.add_argument("--scheduler", metavar="ADDRESS", help="use the workers of this Dask scheduler, tcp://HOST:PORT")
    work.add_argument(
        "--memory-limit", default="4GiB", metavar="SIZE", help="memory of a worker on this machine (default: 4GiB)"
    )
    work.add_argument(
        "--attempts",
        type=positive,
        default=3,
        metavar="N",
        help="set a recording aside after it has killed this many workers (default: 3)",
    )


def workers_from(args: argparse.Namespace) -> Workers:
    """Return the workers that the arguments name."""
    from dask.utils import parse_bytes

    from cuboid.fleet.batch.cluster import Workers

    try:
        parse_bytes(args.memory_limit)
    except ValueError:
        raise InputError(f"--memory-limit: expected a size such as 4GiB, got '{args.memory_limit}'") from None
    return Workers(args.scheduler, args.workers, args.memory_limit, args.attempts)
