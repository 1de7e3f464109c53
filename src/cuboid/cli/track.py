"""`cuboid track`: track the objects of a recording or of a live camera."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cuboid.cli import tables
from cuboid.cli.interrupt import Interruption, interruptible
from cuboid.cli.live import add_live, add_serve, watching
from cuboid.cli.names import camera_names
from cuboid.cli.parser import megabytes, seconds, takes_names
from cuboid.cli.recording import add_furniture, add_recording, add_relations, open_from, refuse_with_rig, tracking_from
from cuboid.cli.results import add_output, add_results, give
from cuboid.cli.text_model import add_embedding, embedding_model
from cuboid.ground.core.errors import InputError, counted
from cuboid.ground.core.limits import MEMORY_MB
from cuboid.ground.core.threads import cores
from cuboid.ground.formats.folder import REPORT, VIDEO

if TYPE_CHECKING:
    from cuboid.inputs.cameras import LiveCamera, LiveRig
    from cuboid.inputs.readers import Recording
    from cuboid.method.text_search import TextModel
    from cuboid.runs.scene.running import IntoScene
    from cuboid.runs.tracking.types import RunOutcome

# The options for reading a recording, with their defaults.
OF_RECORDINGS = {
    "format": None,
    "intrinsics": None,
    "depth_scale": None,
    "pose_convention": None,
    "pose_offset": "auto",
    "topics": None,
    "register": "auto",
}


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add `--camera`, `--record` and `--record-as`."""
    camera = parser.add_argument_group("live camera, instead of RECORDING; Ctrl-C ends it")
    live = camera.add_argument(
        "--camera",
        metavar="NAME[:OPTION=VALUE,...]",
        help="the camera, or with --rig several, such as realsense:SERIAL,realsense:SERIAL; NAME is one of",
    )
    takes_names(live, camera_names)
    camera.add_argument("--record", type=Path, metavar="DIR", help="also store the frames, as a recording")
    camera.add_argument(
        "--record-as", choices=("plain", "mcap"), default="plain", help="format of the stored frames (default: plain)"
    )


def add_rig(parser: argparse.ArgumentParser) -> None:
    """Add `--rig`."""
    parser.add_argument_group("several cameras").add_argument(
        "--rig",
        type=Path,
        metavar="FILE",
        help="rig.json of the cameras; RECORDING ..., or the live cameras, are theirs, in its order",
    )


@contextmanager
def source_of(args: argparse.Namespace, interruption: Interruption) -> Iterator[Recording | LiveCamera | LiveRig]:
    """Open the recording or the camera that the arguments name; a signal ends the camera.

    Raises
    ------
    InputError
        The arguments name neither source, or both, or an option of the other source.
    """
    if args.camera is None:
        if not args.recording and args.rig is None:
            raise InputError("name a RECORDING, or a live camera with --camera")
        if args.record is not None:
            raise InputError("--record stores the frames of --camera; use 'cuboid convert' to copy a recording")
        yield recording_of(args)
        return
    if args.recording:
        raise InputError(f"a run has one source: either the recording {args.recording[0]} or --camera {args.camera}")
    for name, default in OF_RECORDINGS.items():
        if getattr(args, name) != default:
            raise InputError(f"--{name.replace('_', '-')} is for recordings only; a camera provides this value")
    from cuboid.cli.progress import load_kernels

    with cameras_from(args) as camera:
        interruption.on_signal = camera.close
        load_kernels()
        yield camera


def cameras_from(args: argparse.Namespace) -> LiveCamera | LiveRig:
    """Open the live camera, or those of a rig."""
    from cuboid.inputs.cameras import open_camera, open_cameras
    from cuboid.inputs.cameras.live_rig import named_cameras

    if args.rig is not None:
        return open_cameras(args.camera, args.rig, record=args.record, form=args.record_as)
    count = len(named_cameras(args.camera))
    if count > 1:
        raise InputError(f"{count} live cameras need --rig rig.json; 'cuboid calibrate --rig' makes it")
    return open_camera(args.camera, record=args.record, form=args.record_as)


def recording_of(args: argparse.Namespace) -> Recording:
    """Open the recording, or those of a rig's cameras."""
    recordings = args.recording
    if args.rig is None:
        if len(recordings) > 1:
            raise InputError(f"{len(recordings)} recordings need --rig rig.json; 'cuboid calibrate --rig' makes it")
        one = argparse.Namespace(**{**vars(args), "recording": recordings[0]})
        return open_from(one, rigs=True)
    refuse_with_rig(args, "format", "intrinsics", "depth_scale", "pose_convention", "topics")
    from cuboid.inputs.recordings.opening import open_rig

    return open_rig(args.rig, recordings, register=args.register)


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Add the scene and the options for adding the recording to it."""
    scene = parser.add_argument_group("scene")
    scene.add_argument("--scene", type=Path, metavar="FILE", help="add the recording to this scene (NAME.cuboid)")
    scene.add_argument("--same-world", action="store_true", help="the recording's poses are in the scene's world")
    scene.add_argument("--resume", action="store_true", help="continue the interrupted run in the scene")
    scene.add_argument(
        "--commit-every", type=seconds, metavar="SECONDS", help="interval between two saves of the scene (default: 1)"
    )


def scene_from(args: argparse.Namespace) -> IntoScene | None:
    """Return the scene that the arguments name, or None."""
    if args.scene is None:
        for name in ("same_world", "resume", "commit_every"):
            if getattr(args, name):
                raise InputError(f"--{name.replace('_', '-')} needs --scene")
        return None
    if args.resume and args.video:
        raise InputError("--video and --resume cannot be combined; 'cuboid render' draws the video from the results")
    if args.resume and args.camera is not None:
        raise InputError("--resume needs a recording: the frames of a live camera are not available any more")
    if args.bridge:
        raise InputError("--bridge and --scene cannot be combined")
    from cuboid.runs.scene.running import IntoScene
    from cuboid.runs.scene.session import COMMIT_EVERY_S

    every_s = COMMIT_EVERY_S if args.commit_every is None else args.commit_every
    return IntoScene(args.scene, same_world=args.same_world, resume=args.resume, commit_every_s=every_s)


EXAMPLE = "cuboid track RECORDING --output DIR"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    results = parser.add_argument_group("results")
    add_output(results, type=Path, required=True, metavar="DIR", help="folder of the results")
    add_results(results)
    results.add_argument("--video", action="store_true", help="also write labelled.mp4")
    shapes = "also store views of the objects, for meshes after the recording is deleted"
    results.add_argument("--shapes", action="store_true", help=shapes)
    add_relations(results)
    add_furniture(results)
    add_embedding(results)
    add_live(results)
    add_serve(results)
    add_scene(parser)
    memory = (
        "memory of the process; beyond it, parts of the map that are out of view move to the scene or to a temporary "
    )
    memory += f"file (default: {MEMORY_MB:g})"
    results.add_argument("--memory", type=megabytes, default=MEMORY_MB, metavar="MB", help=memory)
    add_camera(parser)
    add_rig(parser)
    add_recording(parser, default_threads=min(2, cores()), required=False, several=True)


def run(args: argparse.Namespace) -> int:
    """Track, and print the objects."""
    into, text_model = scene_from(args), embedding_model(args)
    if text_model is not None and args.camera is not None and not args.shapes:
        raise InputError("--text-model of a live camera needs --shapes, which keeps the views that it embeds")
    with interruptible() as interruption:
        from cuboid.cli.progress import progress
        from cuboid.inputs.readers import Recording
        from cuboid.runs.pipeline.options import ResultOptions, RunHooks, never
        from cuboid.runs.pipeline.run import track_recording
        from cuboid.runs.tracking.types import RigLike

        with source_of(args, interruption) as source, progress() as shown:
            name = source.path.name if isinstance(source, Recording) else args.camera
            cameras = [camera.name for camera in source.rig.cameras] if isinstance(source, RigLike) else []
            with watching(args, name, source.intrinsics, cameras) as views:
                outcome = track_recording(
                    source,
                    args.output,
                    tracking_from(args, args.memory),
                    results=ResultOptions(
                        force=args.force,
                        video=args.video,
                        shapes=args.shapes,
                        relations=args.relations,
                        furniture=args.furniture,
                    ),
                    into=into,
                    hooks=RunHooks(
                        progress=shown,
                        # the run of a camera ends when the camera closes, and the results are then complete
                        stop=interruption if args.camera is None else never,
                        watch=views if views.views else None,
                    ),
                )
                views.end(outcome.report)
        if text_model is not None:
            embed(args.output, text_model, into)
    give(args, outcome_document(outcome, args.output), lambda: print_outcome(outcome, args.output))
    return interruption.status_of(outcome.report)


def embed(output: Path, model: TextModel, into: IntoScene | None) -> None:
    """Embed the objects of a run, and store the vectors beside its results and in its scene."""
    from cuboid.results.files import Results
    from cuboid.runs.scene import Scene

    found = Results(output).embed(model)
    if into is not None:
        with Scene.open(into.path) as scene:
            scene.keep_vectors(found)


def outcome_document(outcome: RunOutcome, output: Path) -> dict[str, Any]:
    """Return the results of a run, ready for JSON: the contents of `objects.json`, `events.csv` and `run.json`."""
    from cuboid.results.files import Results
    from cuboid.results.files.objects import object_to_json

    objects = sorted((*outcome.objects, *outcome.furniture), key=lambda item: item.label)
    return {
        "output": str(output),
        "objects": [object_to_json(item) for item in objects],
        "events": [event.to_dict() for event in Results(output).events],
        "run": outcome.report.to_dict(),
    }


def print_outcome(outcome: RunOutcome, output: Path) -> None:
    """Print the table of objects and the summary of the run."""
    from cuboid.ground.compiling.compiletime import compiling_s
    from cuboid.results.files import Results

    out, report = tables.console(), outcome.report
    if outcome.objects:
        out.print(tables.objects_table(outcome.objects))
    else:
        out.print("no object found")
    for line in tables.furniture_lines(outcome.objects, outcome.furniture) + tables.event_lines(Results(output).events):
        out.print(line)
    for warning in report.warnings:
        out.print(f"warning: {warning}", soft_wrap=not out.is_terminal)
    for line in [
        *tables.skipped_lines(report),
        *tables.limit_lines(report),
        *tables.detector_lines(outcome.milliseconds),
    ]:
        out.print(line)
    if report.frames_dropped:
        out.print(f"{counted(report.frames_dropped, 'frame')} of the camera dropped: the tracker was too slow for them")
    frame_ms = f", {report.milliseconds['frame'].median_ms:.1f} ms per frame" if report.frames_used else ""
    out.print(
        f"{report.frames_used} of {report.frames_read} frames in {report.seconds:.1f} s{frame_ms}; results in {output}"
    )
    if compiling_s() >= 1.0:
        out.print(f"compiling kernels took {compiling_s():.0f} s in addition; the next run loads them")
    video = f", and {output / VIDEO}" if (output / VIDEO).is_file() else ""
    out.print(f"open {output / REPORT} in a browser{video}", soft_wrap=True)
