"""`cuboid measure`: measure what stands on the surface in front of a camera."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.interrupt import interruptible
from cuboid.cli.parser import seconds
from cuboid.cli.recording import add_recording, tracking_from
from cuboid.cli.results import add_output, add_results, give, refuse_existing
from cuboid.cli.tables import console
from cuboid.cli.track import add_camera, add_rig, source_of
from cuboid.ground.core.errors import InputError, OutputError
from cuboid.ground.core.threads import cores

if TYPE_CHECKING:
    from cuboid.inputs.cameras import LiveCamera, LiveRig
    from cuboid.inputs.readers import Recording
    from cuboid.results.files.measures import Scale
    from cuboid.runs.pipeline.measuring import Measured

EXAMPLE = "cuboid measure RECORDING --picture parcels.png"

# Time after which the answer of a live camera is steady, seconds.
LIVE_S = 2.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    results = parser.add_argument_group("results")
    results.add_argument("--units", choices=("mm", "cm", "in"), default="mm", help="unit of lengths (default: mm)")
    results.add_argument(
        "--seconds",
        type=seconds,
        metavar="S",
        help=f"use this time (default: {LIVE_S:g} of a camera, all of a recording)",
    )
    results.add_argument("--picture", type=Path, metavar="FILE", help="write the last frame with the dimensions drawn")
    results.add_argument(
        "--fixed", action="store_true", help="the camera stands still: no pose is estimated, and a bare surface will do"
    )
    add_results(results)
    known = parser.add_argument_group("check with a known box")
    known.add_argument(
        "--known",
        type=known_sides,
        metavar="LxWxH",
        help="true sides of one object, in any order, such as 200x150x100mm: print the error of scale",
    )
    add_output(
        known, type=Path, metavar="FILE", help="write the corrected camera.json, for --intrinsics; needs --known"
    )
    add_camera(parser)
    add_recording(parser, default_threads=min(2, cores()), required=False, several=True)
    add_rig(parser)


def run(args: argparse.Namespace) -> int:
    """Measure, and print a line for each object."""
    from cuboid.results.files.measures import scale_of

    _check_output(args)
    options = replace(tracking_from(args), fixed=args.fixed)
    with interruptible() as interruption:
        from cuboid.cli.progress import progress
        from cuboid.runs.pipeline.measuring import measure
        from cuboid.runs.pipeline.options import never
        from cuboid.runs.tracking.types import RigLike

        with source_of(args, interruption) as source, progress() as shown:
            if args.output is not None and isinstance(source, RigLike):
                raise InputError("--output writes the camera.json of one camera; measure with each of the rig alone")
            live = args.camera is not None
            time_s = args.seconds or (LIVE_S if live else None)
            stop = never if live else interruption
            found = measure(source, options, seconds=time_s, progress=shown, stop=stop)
    if interruption.status:
        return interruption.status
    scale = None if args.known is None else scale_of(found.measures, args.known)
    if args.picture is not None:
        _write_picture(args, found)
    if scale is not None and args.output is not None:
        _write_camera(args, source, scale)
    give(args, _document(found, scale), lambda: _print(args, found, scale))
    return 0


def known_sides(text: str) -> tuple[float, float, float]:
    """Parse LxWxH with a unit (mm, cm, m or in); return metres."""
    units = {"mm": 0.001, "cm": 0.01, "in": 0.0254, "m": 1.0}
    unit = next((name for name in units if text.endswith(name)), None)
    try:
        if unit is None:
            raise ValueError
        length, width, height = (float(word) * units[unit] for word in text.removesuffix(unit).split("x"))
        if not 0.0 < min(length, width, height) <= max(length, width, height) < float("inf"):
            raise ValueError
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected three sides and a unit such as 200x150x100mm, got '{text}'"
        ) from None
    return length, width, height


def _check_output(args: argparse.Namespace) -> None:
    """Refuse files that cannot be written before the work starts."""
    if args.output is not None:
        if args.known is None:
            raise InputError("--output writes a corrected camera.json; it needs --known with the sides of one object")
        if args.output.suffix != ".json":
            raise OutputError(f"{args.output}: must be a .json file")
        refuse_existing(args.output, force=args.force)
    if args.picture is not None and args.picture.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise OutputError(f"{args.picture}: must be a .png or .jpg file")


def _write_picture(args: argparse.Namespace, found: Measured) -> None:
    import cv2

    from cuboid.results.files.pending import write_whole
    from cuboid.results.views.dimensions import draw_dimensions

    drawn = draw_dimensions(found.color, found.measures, found.T_world_camera, found.intrinsics, args.units)
    write_whole(args.picture, cv2.imencode(args.picture.suffix, drawn[..., ::-1])[1].tobytes())


def _write_camera(args: argparse.Namespace, source: Recording | LiveCamera | LiveRig, scale: Scale) -> None:
    """Write the calibration of the camera, with depth units that remove the error of scale if it is clear."""
    from cuboid.inputs.readers import Recording
    from cuboid.inputs.readers.calibration import write_camera
    from cuboid.results.files.pending import new_file

    units = source.depth_units_per_metre * (scale.measured if scale.clear else 1.0)
    kept = (source.distortion, source.depth_camera) if isinstance(source, Recording) else ()
    with new_file(args.output, force=args.force) as file:
        write_camera(file, source.intrinsics, units, *kept)


def _document(found: Measured, scale: Scale | None) -> dict[str, Any]:
    document: dict[str, Any] = {"frames": found.frames, "objects": [one.to_dict() for one in found.measures]}
    if scale is not None:
        measured, sigma = round(scale.measured, 6), round(scale.sigma, 6)
        document["scale"] = {"label": scale.label, "measured": measured, "sigma": sigma}
    return document


def _print(args: argparse.Namespace, found: Measured, scale: Scale | None) -> None:
    out = console()
    for one in found.measures:
        out.print(one.text(args.units), soft_wrap=True)
    if not found.measures:
        out.print("nothing stands on a surface in view")
        for warning in found.warnings:
            out.print(f"warning: {warning}", soft_wrap=True)
    if scale is not None:
        out.print(scale.text(), soft_wrap=True)
    camera = "the corrected camera" if scale is not None and scale.clear else "the camera, not changed,"
    for file, what in ((args.picture, "the picture with dimensions"), (args.output, camera)):
        if file is not None:
            out.print(f"{what} is {file}", soft_wrap=True)
