"""Options of the commands that spread their work over workers."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from cuboid.cli.threads import positive

if TYPE_CHECKING:
    from cuboid.batch.cluster import Workers


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add who does the work."""
    work = parser.add_argument_group("workers")
    work.add_argument("--workers", type=positive, metavar="N", help="workers on this machine (default: one a core)")
    work.add_argument("--scheduler", metavar="ADDRESS", help="use the workers of this Dask scheduler, tcp://HOST:PORT")
    work.add_argument(
        "--memory-limit", default="4GiB", metavar="SIZE", help="memory of a worker on this machine (default: 4GiB)"
    )
    work.add_argument(
        "--attempts",
        type=positive,
        default=3,
        metavar="N",
        help="set aside a recording that has killed its worker so often (default: 3)",
    )


def workers_from(args: argparse.Namespace) -> Workers:
    """Return who does the work, as the arguments say."""
    from dask.utils import parse_bytes

    from cuboid.batch.cluster import Workers
    from cuboid.core.errors import InputError

    try:
        parse_bytes(args.memory_limit)
    except ValueError:
        raise InputError(f"--memory-limit: expected a size such as 4GiB, got '{args.memory_limit}'") from None
    return Workers(args.scheduler, args.workers, args.memory_limit, args.attempts)
