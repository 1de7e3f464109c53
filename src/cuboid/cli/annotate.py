"""`cuboid annotate`: draw rectangles into some frames of a recording, as the truth for its results."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.parser import positive
from cuboid.cli.recording import add_reading, open_from
from cuboid.cli.results import add_output
from cuboid.cli.serving import add_page, serve
from cuboid.ground.core.errors import OutputError

if TYPE_CHECKING:
    from cuboid.inputs.readers import Recording

EXAMPLE = "cuboid annotate RECORDING"

# Number of suggested keyframes: ten minutes of work, and enough to distinguish a good result from a bad one.
SUGGESTED = 12
NAME = "keyframes.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_reading(parser, thinned=False, tracked=False)
    add_output(
        parser,
        type=Path,
        metavar="FILE",
        help=f"file of the keyframes; an existing file is continued (default: {NAME} in the recording)",
    )
    parser.add_argument(
        "--every",
        type=positive,
        metavar="N",
        help=f"suggest every N-th frame (default: about {SUGGESTED} frames in all)",
    )
    add_page(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    from cuboid.lab.annotation import Annotator, KeyframesFile, make_server

    recording = open_from(args)
    file = KeyframesFile(_path(args.output, recording), recording)
    annotator = Annotator(recording, file, args.every or max(1, len(recording) // SUGGESTED))
    return serve(args, f"{recording.path}, keyframes in {file.path},", make_server(annotator, args.port))


def _path(output: Path | None, recording: Recording) -> Path:
    """Return the file of the keyframes; raises OutputError if it cannot be written."""
    import os

    path = output or (recording.path / NAME if recording.path.is_dir() else recording.path.with_suffix(f".{NAME}"))
    if path.suffix != ".json":
        raise OutputError(f"{path}: the name of a file of keyframes must end with .json")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"{path}: its folder is missing or not writable; choose another file with --output")
    return path
