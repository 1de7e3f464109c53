"""`cuboid synth`: make a recording with an exact truth from a seed."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.parser import positive, whole
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.tables import console
from cuboid.ground.core.errors import InputError, counted
from cuboid.ground.core.threads import cores

if TYPE_CHECKING:
    from cuboid.lab.synthetic.shapes import Model

EXAMPLE = "cuboid synth --kind clutter --seed 7 --output DIR"

KINDS = (
    *("table", "occluders", "leave", "tables", "clutter", "room"),
    *("overhead", "bin", "counter", "stacks", "shelf", "moving", "containers", "sideboard"),
    *("desk", "kitchen", "bookshelf", "toybox", "floor", "tray", "alone"),
)
CAMERAS = ("orbit", "handheld", "drone")
SENSORS = (
    *("structured-light", "time-of-flight", "clean"),
    *("kinect-v1", "realsense-d435", "azure-kinect", "iphone-lidar"),
)
STYLES = ("plain", "real")
POSE_NOISES = ("none", "drift", "jumps")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_output(parser, type=Path, required=True, metavar="DIR", help="folder of the recording")
    add_results(parser)
    scene = parser.add_argument_group("scene")
    scene.add_argument("--kind", choices=KINDS, default="table", help="kind of scene (default: table)")
    scene.add_argument(
        "--seed", type=whole, default=1, metavar="N", help="seed: the same seed gives the same bytes (default: 1)"
    )
    scene.add_argument(
        "--visits",
        type=positive,
        metavar="N",
        help="make N recordings of the place (visit-1, visit-2, ... in DIR); objects move, go and come between them",
    )
    scene.add_argument(
        "--style",
        choices=STYLES,
        default=STYLES[0],
        help="real: materials, light and camera as in homes, with the same geometry (default: plain)",
    )
    scene.add_argument("--meshes", type=Path, metavar="DIR", help="use these objects: .obj, .glb, .ply files")
    camera = parser.add_argument_group("camera")
    camera.add_argument("--frames", type=positive, metavar="N", help="number of frames (default: depends on the kind)")
    camera.add_argument("--motion", choices=CAMERAS, help="camera path (default: chosen by the seed)")
    camera.add_argument(
        "--size", type=_size, default=(640, 480), metavar="WxH", help="size of the images (default: 640x480)"
    )
    camera.add_argument(
        "--sensor", choices=SENSORS, default=SENSORS[0], help=f"noise model of the depth sensor (default: {SENSORS[0]})"
    )
    camera.add_argument(
        "--rig",
        type=_rig,
        metavar="[moving:]N",
        help="N cameras: fixed around the first surface, or moving together; --frames is then for each camera",
    )
    faulty = parser.add_argument_group("faults")
    faulty.add_argument(
        "--pose-noise", choices=POSE_NOISES, default="none", help="noise of the written poses (default: none)"
    )
    faulty.add_argument(
        "--faults",
        type=lambda text: tuple(text.split(",")),
        default=(),
        metavar="NAME,...",
        help="damage some frames: all, or names of faults such as truncated-depth",
    )
    parser.add_argument(
        "--workers",
        type=positive,
        default=min(4, cores()),
        metavar="N",
        help="number of processes for rendering (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Make the scene, render it, and print its contents."""
    from cuboid.cli.progress import counting
    from cuboid.lab.synthetic import make_rig, make_scene, render_recording
    from cuboid.lab.synthetic.user_meshes import load_meshes

    meshes = load_meshes(args.meshes) if args.meshes else ()
    if args.visits and args.rig:
        raise InputError("--visits and --rig cannot be combined")
    if args.visits:
        return _visits(args, meshes)
    if args.rig:
        moving, cameras = args.rig
        scene = make_rig(args.kind, args.seed, cameras, moving=moving, meshes=meshes, **_made_as(args))
    else:
        scene = make_scene(args.kind, args.seed, meshes=meshes, **_made_as(args))
    with counting("rendering") as progress:
        render_recording(scene, args.output, progress=progress, **_rendered_as(args))
    counts = {"frames": scene.frames, "objects": len(scene.objects), "surfaces": len(scene.surfaces)}
    things = counted(len(scene.objects), "object"), counted(len(scene.surfaces), "level surface")
    what = f"{counted(scene.frames, 'frame')}, {', '.join(things)}"
    line = f"{scene.name}: {what}; in {args.output}"
    document = {"output": str(args.output), "name": scene.name, **counts}
    give(args, document, lambda: console().print(line))
    return 0


def _visits(args: argparse.Namespace, meshes: Sequence[Model]) -> int:
    """Make several recordings of one place, and print the changes between them."""
    from cuboid.cli.progress import counting
    from cuboid.lab.synthetic import make_visits, render_visits

    scenes = make_visits(args.kind, args.seed, args.visits, meshes=meshes, **_made_as(args))
    with counting("rendering") as progress:
        truth = render_visits(scenes, args.output, progress=progress, **_rendered_as(args))

    def show() -> None:
        for visit in truth["visits"]:
            kinds = [change["change"] for change in visit["changes"]]
            what = ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("unchanged", "moved", "gone", "new"))
            console().print(f"{visit['recording']}: {what if kinds else 'the first visit'}; in {args.output}")

    give(args, {"output": str(args.output), "visits": truth["visits"]}, show)
    return 0


def _made_as(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the scene from the arguments, for `make_scene` and `make_visits`."""
    return {"frames": args.frames, "camera": args.motion, "style": args.style}


def _rendered_as(args: argparse.Namespace) -> dict[str, Any]:
    """Return the rendering options from the arguments, for `render_recording` and `render_visits`."""
    names = ("sensor", "pose_noise", "faults", "size", "workers", "force")
    return {name: getattr(args, name) for name in names}


def _rig(text: str) -> tuple[bool, int]:
    """Parse N or moving:N: whether the cameras move, and their number."""
    kind, _, count = text.rpartition(":")
    if kind not in ("", "fixed", "moving") or not count.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a number of cameras such as 3 or moving:2, got '{text}'")
    return kind == "moving", int(count)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT such as 640x480, got '{text}'")
    return int(width), int(height)
