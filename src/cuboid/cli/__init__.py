"""The command `cuboid`: a module for each of its commands, and only the chosen one is imported.

A command module has `HELP` (one line), `EXAMPLE` (a call that works), `add_arguments(parser)` and `run(args) -> int`;
whatever is slow to import is imported inside `run`.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from io import TextIOWrapper
from types import ModuleType
from typing import NoReturn

from cuboid import __version__
from cuboid.cli.optional_words import without_guessing
from cuboid.errors import CuboidError, one_line

COMMANDS = (
    "track",
    "batch",
    "find",
    "sql",
    "serve",
    "store compact",
    "info",
    "convert",
    "evaluate",
    "evaluate trajectory",
    "annotate",
    "render",
    "report",
    "view",
    "export",
    "scene",
    "slam",
    "calibrate",
    "demo",
    "synth",
    "bench",
    "doctor",
    "compile",
    "completion",
)

OK, MISTAKE, INTERRUPTED = 0, 2, 130

DESCRIPTION = "Objects that stay found: persistent labels and 3D boxes from an RGB-D video, on one CPU core."


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line.

    Attributes
    ----------
    example : str
        A call that works, which is shown where something is missing.
    """

    example = "cuboid demo"

    def error(self, message: str) -> NoReturn:
        shown = f"; for example: {self.example}" if "required: " in message else ""
        line = one_line(f"cuboid: error: {message}{shown} (see '{self.prog} --help')")
        self.exit(MISTAKE, f"{line}\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; those of the process unless given.

    Returns
    -------
    int
        0 done, 2 a mistake in the call or the input, 130 or 143 ended by Ctrl-C or SIGTERM; a fault of the
        program is a traceback, and the interpreter then exits with 1.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    _open_streams()
    try:
        status = _run(words)
        sys.stdout.flush()
        return status
    except CuboidError as error:
        print(one_line(f"cuboid: error: {error}"), file=sys.stderr)
        return MISTAKE
    except KeyboardInterrupt:
        print("cuboid: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # who read our output has gone: nothing is left to say, nor to be flushed at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except OSError as error:
        if error.filename is not None:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"cuboid: error: standard output cannot be written: {error.strerror}", file=sys.stderr)
        return MISTAKE


def _open_streams() -> None:
    """Let there be all three standard streams, each of which takes any character.

    Where one is closed, the next file that is opened would get its number, and what is printed would go into it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, os.fdopen(number, mode, closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _run(words: list[str]) -> int:
    if " ".join(words[:2]) in COMMANDS:  # a command of two words
        words = [" ".join(words[:2]), *words[2:]]
    chosen = next((word for word in words if not word.startswith("-")), None)
    completing = "_ARGCOMPLETE" in os.environ  # the words are in the environment then
    known = chosen in COMMANDS and not completing
    parser = _Parser(prog="cuboid", description=DESCRIPTION, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"cuboid {__version__}")
    commands = parser.add_subparsers(title="commands", dest="command", metavar="COMMAND", required=True)
    modules: dict[str, ModuleType] = {}
    for name in (chosen,) if known and chosen else COMMANDS:
        module = modules[name] = import_module(f"cuboid.cli.{name.replace(' ', '_')}")
        command = commands.add_parser(
            name,
            help=module.HELP,
            description=module.HELP[0].upper() + module.HELP[1:] + ".",
            epilog=f"example: {module.EXAMPLE}",
            allow_abbrev=False,
        )
        command.example = module.EXAMPLE
        module.add_arguments(command)
    if completing:
        import argcomplete

        argcomplete.autocomplete(parser, always_complete_options="long")
    args = parser.parse_args(without_guessing(words))
    if "threads" in args:
        from cuboid.cli.threads import limit_threads

        limit_threads(args.threads)
    status: int = modules[args.command].run(args)
    return status
