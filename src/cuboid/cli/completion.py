"""`cuboid completion`: what lets a shell complete commands, options and names."""

from __future__ import annotations

import argparse

EXAMPLE = 'eval "$(cuboid completion bash)"'
SHELLS = ("bash", "zsh", "fish", "powershell")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"one of {', '.join(SHELLS)}")


def run(args: argparse.Namespace) -> int:
    """Print it."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["cuboid"], shell=args.shell))
    return 0
