"""stub."""

from __future__ import annotations

import argparse

HELP = "serve a store"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Stub."""


def run(args: argparse.Namespace) -> int:
    """Stub."""
    return 0
