"""`cuboid completion`: print the script with which a shell completes commands, options and names."""

from __future__ import annotations

import argparse

EXAMPLE = 'eval "$(cuboid completion bash)"'
SHELLS = ("bash", "zsh", "fish", "powershell")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"one of {', '.join(SHELLS)}")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from argcomplete.shell_integration import shellcode

    print(shellcode(["cuboid"], shell=args.shell))
    return 0
