"""`--camera`: a live camera in the place of a recording."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.names import camera_names
from cuboid.cli.parser import takes_names
from cuboid.cli.recording import open_from

if TYPE_CHECKING:
    from cuboid.cameras import LiveCamera
    from cuboid.cli.interrupt import Interruption
    from cuboid.readers import Recording

# The options that say how a recording is read, with their defaults.
OF_RECORDINGS = {
    "format": None,
    "intrinsics": None,
    "depth_scale": None,
    "pose_convention": None,
    "topics": None,
    "register": "auto",
}


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add `--camera`, `--record` and `--record-as`."""
    camera = parser.add_argument_group("live camera, instead of RECORDING; Ctrl-C ends it")
    live = camera.add_argument("--camera", metavar="NAME[:OPTION=VALUE,...]", help="one of")
    takes_names(live, camera_names)
    camera.add_argument("--record", type=Path, metavar="DIR", help="also keep its frames, as a recording")
    camera.add_argument(
        "--record-as", choices=("plain", "mcap"), default="plain", help="what they are kept as (default: plain)"
    )


@contextmanager
def source_of(args: argparse.Namespace, interruption: Interruption) -> Iterator[Recording | LiveCamera]:
    """Open the recording or the camera that the arguments name; a signal ends the camera.

    Raises
    ------
    InputError
        The arguments name neither, or both, or what the other one has.
    """
    from cuboid.core.errors import InputError

    if args.camera is None:
        if args.recording is None:
            raise InputError("name a RECORDING, or a live camera with --camera")
        if args.record is not None:
            raise InputError("--record keeps the frames of --camera; a recording is written anew by 'cuboid convert'")
        yield open_from(args)
        return
    if args.recording is not None:
        raise InputError(f"a run has one source: the recording {args.recording}, or --camera {args.camera}")
    for name, default in OF_RECORDINGS.items():
        if getattr(args, name) != default:
            raise InputError(f"--{name.replace('_', '-')} is for recordings; a camera knows that itself")
    from cuboid.cameras import open_camera

    with open_camera(args.camera, record=args.record, form=args.record_as) as camera:
        interruption.tell = camera.close
        yield camera
