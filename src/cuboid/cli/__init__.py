"""The command `cuboid`: each of its commands has a module, and only the chosen module is imported.

A command module has `EXAMPLE` (a valid call), `add_arguments(parser)` and `run(args) -> int`; modules that are slow to
import are imported inside `run`.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from io import TextIOWrapper
from types import ModuleType

from cuboid.cli.names import without_guessing
from cuboid.cli.parser import MISTAKE, Parser, did_you_mean
from cuboid.ground.core.errors import CuboidError, one_line, printable
from cuboid.ground.version import __version__

# The commands in groups, as the help lists them, with a line for each.
GROUPS = {
    "run": {
        "track": "track the objects of a recording and write the results",
        "detect": "find the objects in one picture: a color and a depth image",
        "measure": "measure what stands on the surface in front of a camera: sides, volume, and how sure they are",
        "slam": "estimate the camera poses of a recording from its images and write the trajectory",
        "ros2": "track the images of a running ROS 2, and publish the objects there",
        "demo": "make a recording, track it, and compare with the truth",
    },
    "look": {
        "info": "describe a recording: layout, camera, depth, poses, and frames that will be skipped",
        "view": "show finished results in the browser, image and map side by side",
        "report": "write the 3D page of finished results (report.html)",
        "render": "draw the results of a run into the images of its recording, as a video",
        "scene": "list, show and change the objects of a scene file",
        "export": "write the results of a run in the format of another program",
    },
    "judge": {
        "evaluate": "compare a result with the truth: boxes, and labels over time",
        "evaluate trajectory": "compare an estimated camera path with the true one",
        "annotate": "draw rectangles of objects into some frames of a recording, in the browser",
        "bench": "measure time per stage, frames/s and memory on a recording",
        "doctor": "check packages, compiled kernels, extras and threads",
        "compile": "compile all kernels that tracking uses, ahead of the first run",
    },
    "ask": {
        "name": "give names to objects of results, a scene or a store",
        "find": "find objects in a scene, results or a store by size, position, time, color, or their support",
        "serve": "serve a scene, results or a store: pages and a read-only API over HTTP",
        "mcp": "serve a scene or results to assistants, over the Model Context Protocol",
    },
    "many recordings": {
        "batch": "track many recordings into one store of objects",
        "sql": "query the tables of a store in SQL",
        "store compact": "merge the small files of a store into large ones, and remove the leftovers of killed tasks",
    },
    "make": {
        "synth": "make a recording with an exact truth",
        "convert": "convert a recording to another format: plain folder, TUM, or ROS 2 bag",
        "calibrate": "estimate focal length, optical centre and depth scale of a recording",
        "models": "list the known detectors, and download them from their publishers",
        "completion": "print the script for a shell that completes commands and options",
    },
}
COMMANDS = tuple(name for group in GROUPS.values() for name in group)

OK, INTERRUPTED = 0, 130

DESCRIPTION = "Objects that stay found: persistent labels and 3D boxes from an RGB-D video, on one CPU core."


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name (default: the arguments of the process).

    Returns
    -------
    int
        0: done; 2: mistake in the call or the input; 130 or 143: ended by Ctrl-C or SIGTERM. A bug of the
        program prints a traceback, and the interpreter exits with 1.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    _open_streams()
    try:
        return _flushed(words)
    except CuboidError as error:
        print(one_line(f"cuboid: error: {error}"), file=sys.stderr)
        for note in getattr(error, "__notes__", ()):
            print(f"  {printable(note)}", file=sys.stderr)
        return MISTAKE
    except KeyboardInterrupt:
        print("cuboid: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output is gone: print nothing more, flush nothing at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except OSError as error:
        if error.filename is not None:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"cuboid: error: standard output cannot be written: {error.strerror}", file=sys.stderr)
        return MISTAKE


def _open_streams() -> None:
    """Open missing standard streams, and let the output streams accept any character.

    If a standard stream is closed, the next opened file gets its number, and printed text would go into that file.
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


def _flushed(words: list[str]) -> int:
    """Run the command, and flush standard output here, where errors of writing are still handled."""
    try:
        status = _run(words)
    except SystemExit:  # --help, or an error message of the parser
        sys.stdout.flush()
        raise
    sys.stdout.flush()
    return status


def _run(words: list[str]) -> int:
    if " ".join(words[:2]) in COMMANDS:  # a command of two words
        words = [" ".join(words[:2]), *words[2:]]
    completing = "_ARGCOMPLETE" in os.environ  # if set, the words are in the environment
    parser = Parser(prog="cuboid", description=DESCRIPTION, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"cuboid {__version__}")
    chosen = next((word for word in words if not word.startswith("-")), None)
    if not completing and chosen not in COMMANDS:
        return _without_command(parser, words)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    modules: dict[str, ModuleType] = {}
    for name in COMMANDS if completing else (str(chosen),):
        module = modules[name] = import_module(f"cuboid.cli.{name.replace(' ', '_')}")
        command = commands.add_parser(
            name, description=description(name), epilog=f"example: {module.EXAMPLE}", allow_abbrev=False
        )
        command.example = module.EXAMPLE
        module.add_arguments(command)
    if completing:
        import argcomplete

        argcomplete.autocomplete(parser, always_complete_options="long")
    words = without_guessing(words)
    command.refuse_unknown_options(words[words.index(command.prog.removeprefix("cuboid ")) + 1 :])
    args = parser.parse_args(words)
    if "force" in args:
        from cuboid.cli.results import refuse_existing_files

        refuse_existing_files(args)
    # `doctor` tells which library is missing, and shells call `completion` at their start: neither loads a library
    if args.command not in ("doctor", "completion"):
        from cuboid.ground.core.threads import limit_threads

        limit_threads(getattr(args, "threads", 1))
    status: int = modules[args.command].run(args)
    return status


def description(name: str) -> str:
    """Return the purpose of a command, as a sentence."""
    line = next(group[name] for group in GROUPS.values() if name in group)
    return f"{line[0].upper()}{line[1:]}."


def _without_command(parser: Parser, words: list[str]) -> int:
    """Print the help if no command is given; report a command that does not exist."""
    unknown = [word for word in words if not word.startswith("-")]
    if unknown:
        hint = did_you_mean(" ".join(unknown[:2]), COMMANDS) or did_you_mean(unknown[0], COMMANDS)
        parser.error(f"argument COMMAND: invalid choice: {unknown[0]!r}{hint}")
    parser.usage = "cuboid [-h] [--version] COMMAND ..."
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = _listed()
    parser.refuse_unknown_options(words)
    parser.parse_args(words)
    parser.print_help()
    return OK


def _listed() -> str:
    """Return the commands in their groups, one per line."""
    width = max(map(len, COMMANDS))
    lines = []
    for group, commands in GROUPS.items():
        lines += [f"{group}:", *(f"  {name:{width}}  {line}" for name, line in commands.items()), ""]
    return "\n".join([*lines, "'cuboid COMMAND --help' lists the options of a command."])
