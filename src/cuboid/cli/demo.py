"""`cuboid demo`: a recording made here, tracked, and compared with what is known of it."""

from __future__ import annotations

import argparse

HELP = "make a recording, track it, and compare with the truth"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what the command takes."""


def run(args: argparse.Namespace) -> int:
    """Make, track, compare."""
    raise SystemExit(1)
