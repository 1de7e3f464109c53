"""`cuboid detect`: find the objects in one picture."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from cuboid.cli.parser import depth_scale
from cuboid.cli.recording import add_furniture, add_method, add_relations, config_from, intrinsics
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.tables import console
from cuboid.ground.formats.folder import PICTURE

if TYPE_CHECKING:
    from cuboid.ground.core.frame import Frame, Intrinsics
    from cuboid.ground.core.results import FrameResult
    from cuboid.runs.tracking.types import RunOutcome

EXAMPLE = "cuboid detect COLOR.png DEPTH.png --intrinsics 525,525,319.5,239.5 --depth-scale 1000"

# What more views would give; printed beside the objects.
ADVICE = "one picture: hidden sides are assumed, and objects are less sure; 'cuboid track' of a video shows more"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("color", type=Path, metavar="COLOR", help="color image, or a folder with one picture")
    parser.add_argument("depth", type=Path, metavar="DEPTH", nargs="?", help="depth image, aligned to color")
    reading = parser.add_argument_group("reading")
    reading.add_argument(
        "--intrinsics",
        type=intrinsics,
        metavar="FX,FY,CX,CY|FILE",
        help="pinhole in pixels, or a camera.json (default: the camera.json beside the images)",
    )
    reading.add_argument("--depth-scale", type=depth_scale, metavar="UNITS", help="depth units per metre")
    results = parser.add_argument_group("results")
    add_output(results, type=Path, metavar="DIR", help="folder of the results (default: NAME-objects, here)")
    add_results(results)
    add_relations(results)
    add_furniture(results)
    add_method(parser.add_argument_group("detection"))


def run(args: argparse.Namespace) -> int:
    """Find the objects, write the results, and print the objects."""
    from cuboid.cli.track import outcome_document
    from cuboid.inputs.recordings.picture import open_picture
    from cuboid.runs.pipeline.options import ResultOptions, RunHooks, TrackOptions
    from cuboid.runs.pipeline.run import track_recording

    recording = open_picture(args.color, args.depth, intrinsics=args.intrinsics, depth_scale=args.depth_scale)
    output = args.output or Path(f"{args.color.stem}-objects")
    options = TrackOptions(
        fixed=not recording.has_poses,
        config=config_from(args),
        proposals=args.proposals,
        detector=args.detector,
        detector_every=args.detector_every,
    )
    results = ResultOptions(force=args.force, relations=args.relations, furniture=args.furniture)
    found: list[tuple[Frame, FrameResult]] = []
    hooks = RunHooks(watch=lambda frame, result, _: found.append((frame, result)))
    outcome = track_recording(recording, output, options, results=results, hooks=hooks)
    for frame, result in found:
        _draw(output / PICTURE, frame, result, recording.intrinsics)
    give(args, outcome_document(outcome, output), lambda: _print(outcome, output))
    return 0


def _draw(file: Path, frame: Frame, result: FrameResult, intrinsics: Intrinsics) -> None:
    """Write the picture with its labelled boxes."""
    import cv2

    from cuboid.results.files.pending import write_whole
    from cuboid.results.views.drawing import draw_frame

    drawn = draw_frame(frame.color, result.T_world_camera, intrinsics, result.sightings, (), None)
    write_whole(file, cv2.imencode(file.suffix, drawn[..., ::-1])[1].tobytes())


def _print(outcome: RunOutcome, output: Path) -> None:
    from cuboid.cli.track import print_outcome

    print_outcome(outcome, output)
    out = console()
    out.print(f"the labelled picture is {output / PICTURE}", soft_wrap=True)
    out.print(ADVICE, soft_wrap=not out.is_terminal)
