"""Options of `cuboid track` for a scene that a recording goes into."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.recording import seconds
from cuboid.core.errors import InputError

if TYPE_CHECKING:
    from cuboid.scene.running import IntoScene


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the scene and how the recording goes into it."""
    scene = parser.add_argument_group("scene")
    scene.add_argument("--scene", type=Path, metavar="FILE", help="scene that the recording goes into (NAME.cuboid)")
    scene.add_argument("--same-world", action="store_true", help="the recording's poses are in the scene's world")
    scene.add_argument("--resume", action="store_true", help="go on with the run that was broken off in the scene")
    scene.add_argument(
        "--commit-every", type=seconds, metavar="SECONDS", help="how often what is new is saved (default: 1)"
    )


def scene_from(args: argparse.Namespace) -> IntoScene | None:
    """Return the scene that the arguments name, or None."""
    if args.scene is None:
        for name in ("same_world", "resume", "commit_every"):
            if getattr(args, name):
                raise InputError(f"--{name.replace('_', '-')} needs --scene")
        return None
    if args.resume and args.video:
        raise InputError("--video cannot go on with --resume; 'cuboid render' draws it from the results afterwards")
    if args.resume and args.camera is not None:
        raise InputError("--resume needs a recording: what a live camera saw is gone")
    if args.bridge:
        raise InputError("--bridge does not go with --scene")
    from cuboid.scene.running import IntoScene
    from cuboid.scene.session import COMMIT_EVERY_S

    every_s = COMMIT_EVERY_S if args.commit_every is None else args.commit_every
    return IntoScene(args.scene, same_world=args.same_world, resume=args.resume, commit_every_s=every_s)
