"""`cuboid calibrate`: estimate the intrinsics of a recording, or the poses of the cameras of a rig, from the frames."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli.recording import add_reading, open_from, refuse_with_rig
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.tables import console, new_table
from cuboid.ground.core.errors import InputError, OutputError

if TYPE_CHECKING:
    from cuboid.inputs.calibration import CalibrationResult
    from cuboid.inputs.calibration.board import Board
    from cuboid.inputs.calibration.board_fit import BoardFit
    from cuboid.inputs.calibration.rig_fit import RigFit
    from cuboid.inputs.calibration.still_view import StillView
    from cuboid.inputs.readers import Recording

EXAMPLE = "cuboid calibrate RECORDING --output camera.json"

# If a camera is unknown, the search begins with a focal length of this fraction of the image width: color cameras of
# common depth cameras have 0.71 to 0.96, and the search covers 0.61 to 1.12.
UNKNOWN_FOCAL_FRACTION = 0.83
# The board that fits on A4 and on letter paper.
BOARD = "7x5x38mm"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    results = parser.add_argument_group("results")
    output = "the camera.json to write, for --intrinsics; with --rig the rig.json"
    add_output(results, type=Path, metavar="FILE", help=output)
    add_results(results)
    parser.add_argument(
        "--rig",
        nargs="+",
        type=Path,
        metavar="RECORDING",
        help="find the poses of fixed cameras from one recording of each, in place of the intrinsics of one; a picture "
        "of their points, a color for each camera, lies beside FILE",
    )
    board = parser.add_argument_group("with a ChArUco board")
    board.add_argument(
        "--board",
        nargs="?",
        type=board_size,
        const=BOARD,
        metavar="COLUMNSxROWSxSIDEmm",
        help="with --rig, find the poses from a board that the cameras see, held still at some places: number and "
        f"side of its squares (default: {BOARD})",
    )
    board.add_argument(
        "--print-board", type=Path, metavar="FILE.pdf", help="write the board at its true size, for a printer"
    )
    reading = add_reading(parser, tracked=False, required=False)
    reading.add_argument(
        "--poses",
        choices=("given", "auto", "corrected", "estimated"),
        help="poses of the recording (given, auto), or estimated ones (default: given if the recording has them)",
    )


def board_size(text: str) -> Board:
    """Parse COLUMNSxROWSxSIDEmm."""
    from cuboid.inputs.calibration.board import board_of

    try:
        return board_of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def run(args: argparse.Namespace) -> int:
    """Calibrate, write, and print the result with its errors."""
    if args.print_board is not None:
        return _print_board(args)
    if args.board is not None and args.rig is None:
        raise InputError("--board finds the poses of the cameras of a rig; name their recordings with --rig")
    if args.output is None:
        raise OutputError("name the file to write with --output")
    if args.output.suffix != ".json":
        raise OutputError(f"{args.output}: must be a .json file")
    if not args.output.parent.is_dir():
        raise OutputError(f"{args.output}: the folder {args.output.parent} does not exist")
    if args.output.exists() and not args.force:
        raise OutputError(f"{args.output}: exists; --force replaces it")
    if args.rig is not None:
        return _calibrate_rig(args)
    if args.recording is None:
        raise InputError("name a RECORDING, or the recordings of a rig's cameras with --rig")
    from cuboid.cli.progress import counting
    from cuboid.inputs.readers.calibration import write_camera
    from cuboid.inputs.readers.undistortion import rescaled
    from cuboid.results.files.pending import new_file
    from cuboid.runs.pipeline.calibrating import calibrate_recording

    recording = _open(args)
    with counting("estimating poses") as shown:
        found = calibrate_recording(
            recording, poses=_poses(args.poses), every=args.every, limit=args.limit, progress=shown
        )
    units = recording.depth_units_per_metre / found.depth_scale
    # The compared frames are undistorted. The coefficients are rescaled so that they undistort the images in the same
    # way with the new focal length.
    distortion = rescaled(recording.distortion, found.intrinsics.fx / recording.calibration.fx)
    with new_file(args.output, force=args.force) as file:
        write_camera(file, found.intrinsics, units, distortion, recording.depth_camera)
    give(args, _document(found, units, args.output), lambda: _print(found, recording, args.output))
    return 0


def _print_board(args: argparse.Namespace) -> int:
    """Write the PDF of a board."""
    from cuboid.inputs.calibration.board import Board, board_pdf
    from cuboid.results.files.pending import new_file

    if args.recording is not None or args.rig is not None or args.output is not None:
        raise InputError("--print-board only writes a board; calibrate with --rig RECORDING ... --board")
    if args.print_board.suffix.lower() != ".pdf":
        raise OutputError(f"{args.print_board}: must be a .pdf file")
    board = args.board or Board()
    with new_file(args.print_board, force=args.force) as file:
        file.write_bytes(board_pdf(board))

    def show() -> None:
        line = f"{args.print_board}: print it at 100 %, check the length of its line, and glue it onto something flat"
        console().print(line, soft_wrap=True)
        console().print(f"then: cuboid calibrate --rig A B --board {board} --output rig.json")

    give(args, {"output": str(args.print_board), "board": str(board)}, show)
    return 0


def _calibrate_rig(args: argparse.Namespace) -> int:
    """Find the poses of a rig's cameras, write them with a picture, and print their errors."""
    import json
    import sys

    import cv2
    import numpy as np

    from cuboid.inputs.recordings.opening import open_recording
    from cuboid.results.files.pending import new_file
    from cuboid.runs.pipeline.rig_calibrating import (
        calibrate_rig,
        calibrate_with_board,
        names_of,
        overlay,
        rig_document,
    )

    _check_rig_options(args)
    picture = args.output.with_suffix(".png")
    if picture.exists() and not args.force:
        raise OutputError(f"{picture}: exists; --force replaces it")
    recordings = [open_recording(path, register=args.register) for path in args.rig]
    names = names_of(recordings)
    fit: RigFit | BoardFit
    views: Sequence[StillView | None]
    without: list[str] = []
    if args.board is None:
        fit, views = calibrate_rig(recordings, names)
        counted, counts, said = "points_confirmed", fit.confirmed.tolist(), ""
    else:
        fit = calibrate_with_board(recordings, names, args.board)
        views, without = _views_there(recordings, names)
        counted, counts = "board_positions", fit.positions.tolist()
        said = f"corners are {fit.residual_px:.2f} px from their places; "
    document = rig_document(fit.T_rig_camera, recordings, names, args.output)
    with new_file(args.output, force=args.force) as file:
        file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    if without:
        print(f"cuboid: warning: not in the picture: {'; '.join(without)}", file=sys.stderr, flush=True)
    drawn = [(view, T) for view, T in zip(views, fit.T_rig_camera, strict=True) if view is not None]
    if drawn:
        pixels = overlay([view for view, _ in drawn], np.array([T for _, T in drawn]))
        with new_file(picture, force=args.force) as file:
            file.write_bytes(cv2.imencode(".png", pixels[..., ::-1])[1].tobytes())
    else:
        picture.unlink(missing_ok=True)  # of an earlier call
    written = [str(args.output), *([str(picture)] if drawn else [])]
    rows = [
        {"name": name, "error_mm": 1000 * float(error_m), "error_degrees": float(np.degrees(error_rad)), counted: count}
        for name, error_m, error_rad, count in zip(names, fit.error_m, fit.error_rad, counts, strict=True)
    ]

    def show() -> None:
        _print_rig(rows, counted, f"{said}the first camera is the rig; written: {', '.join(written)}")

    found = {"output": str(args.output), "picture": str(picture) if drawn else None, "cameras": rows, "rig": document}
    give(args, found, show)
    return 0


def _views_there(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[list[StillView | None], list[str]]:
    """Return the still view of each camera, None without enough depth; and the reasons, one line each."""
    from cuboid.runs.pipeline.rig_calibrating import still_view_of

    views: list[StillView | None] = []
    reasons = []
    for recording, name in zip(recordings, names, strict=True):
        try:
            views.append(still_view_of(recording, name))
        except InputError as error:
            views.append(None)
            reasons.append(str(error))
    return views, reasons


def _check_rig_options(args: argparse.Namespace) -> None:
    """Raise InputError for an option of one camera."""
    if args.recording is not None:
        raise InputError(f"with --rig, name all recordings after it; got {args.recording} too")
    refuse_with_rig(args, "format", "intrinsics", "depth_scale", "pose_convention", "topics", "limit", "poses")
    if args.every != 1:
        raise InputError("--every is for one camera; leave it out with --rig")


def _print_rig(rows: Sequence[dict[str, Any]], counted: str, line: str) -> None:
    """Print the errors of the cameras of a rig."""
    table = new_table("camera", "position +-, mm", "direction +-, degrees", counted.replace("_", " "))
    for row in rows:
        table.add_row(str(row["name"]), f"{row['error_mm']:.1f}", f"{row['error_degrees']:.2f}", str(row[counted]))
    console().print(table)
    console().print(line)


def _document(found: CalibrationResult, units: float, output: Path) -> dict[str, Any]:
    """Return the result, ready for JSON; null for values that were not fitted."""
    figures = asdict(found)
    before, after, center = figures.pop("start"), figures.pop("intrinsics"), figures.pop("center_error_px")
    return {
        "output": str(output),
        "before": before,
        "after": after,
        "depth_units_per_metre": units,
        "center_error_px": [value if isfinite(value) else None for value in center],
        **{name: value if isfinite(value) else None for name, value in figures.items()},
    }


def _poses(poses: str | None) -> str | None:
    """Return the source of poses for `calibrate_recording`; raises InputError for corrected poses."""
    if poses == "corrected":
        raise InputError("--poses corrected needs correct intrinsics; calibrate with --poses given or estimated")
    return "given" if poses == "auto" else poses


def _open(args: argparse.Namespace) -> Recording:
    """Open the recording; if its intrinsics are unknown, with a guess."""
    from cuboid.inputs.readers.missing_camera import UnknownIntrinsicsError

    try:
        return open_from(args)
    except UnknownIntrinsicsError:
        args.intrinsics = (500.0, 500.0, 0.0, 0.0)  # any values: only the size of the images is read
        size = open_from(args).intrinsics
        focal = UNKNOWN_FOCAL_FRACTION * size.width
        args.intrinsics = (focal, focal, (size.width - 1) / 2, (size.height - 1) / 2)
        return open_from(args)


def _print(found: CalibrationResult, recording: Recording, output: Path) -> None:
    import math

    out, begin, end = console(), found.start, found.intrinsics
    table = new_table("", "before", "after", "+-")
    for name in ("fx", "fy"):
        before, after = getattr(begin, name), getattr(end, name)
        table.add_row(f"{name}, px", f"{before:.1f}", f"{after:.1f}", f"{found.focal_error * after:.1f}")
    for name, error in zip(("cx", "cy"), found.center_error_px, strict=True):
        table.add_row(f"{name}, px", f"{getattr(begin, name):.1f}", f"{getattr(end, name):.1f}", _error(error, 1))
    units = recording.depth_units_per_metre
    scale = found.depth_scale
    table.add_row(
        "depth units per metre",
        f"{units:g}",
        f"{units / scale:.6g}",
        _error(found.depth_scale_error * units / scale, 0),
    )
    out.print(table)
    poses = (
        f"; the poses of a pair have an error of {1000 * found.pose_error_m:.1f} mm and "
        f"{math.degrees(found.pose_error_rad):.2f} degrees"
    )
    out.print(
        f"{found.pairs} pairs of {found.frames} frames: median difference of depths {1000 * found.gap_after_m:.1f} mm, "
        f"before {1000 * found.gap_before_m:.1f} mm{'' if math.isnan(found.pose_error_m) else poses}"
    )
    out.print(_depth_line(found))
    out.print(f"written: {output}")


def _error(value: float, digits: int) -> str:
    return "not fitted" if value != value else f"{value:.{digits}f}"


def _depth_line(found: CalibrationResult) -> str:
    if found.depth_scale_error != found.depth_scale_error:
        return "optical centre and depth scale are unchanged: estimated poses do not determine them"
    seen = f"one metre of depth measures {found.measured_depth_scale:.4f} ± {found.depth_scale_error:.4f} m"
    if found.depth_scale == 1.0:
        return f"{seen}: no clear error, the depth scale is unchanged"
    return f"{seen}: the depth scale is changed (the scale of the poses is taken as right)"
