"""rerun: the run as a recording for the rerun viewer, its entities as in `cuboid.results.views.rerun_scene`.

A label that was merged into another, or retired, is cleared after the last frame that saw it.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.results import names_of
from cuboid.ground.formats.stored import is_there
from cuboid.results.exports.registry import EXPORTS, Export
from cuboid.results.files import Results, TrackRow
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.rerun_scene import RerunScene
from cuboid.results.views.rerun_view import JPEG_QUALITY


def write(run: Results, path: Path) -> list[str]:
    """Write the file; return a note if the recording with the pictures is missing."""
    scene = RerunScene(Path(run.report.recording).name, "--to rerun")
    shown = run.recording_path is not None or is_there(run.report.recording)
    if shown:
        _ = run.recording  # a wrong one is found before anything is written
    scene.stream.save(path)
    _log_surroundings(scene, run)
    _log_frames(scene, run, shown)
    scene.close()
    return [] if shown else [f"{run.report.recording} is not there: no pictures (--recording says where it is)"]


def _log_surroundings(scene: RerunScene, run: Results) -> None:
    """Log what does not change: the map, planes, the camera's path and its pinhole."""
    found = run.found
    scene.names = names_of(found.objects)
    scene.up(found.up)
    scene.labels({row.label for row in run.tracks} | {item.label for item in found.objects})
    scene.map(run.map_points(), static=True)
    scene.planes(found.planes, static=True)
    places = np.array([pose.T_world_camera[:3, 3] for pose in run.poses.values()]).reshape(-1, 3)
    scene.path(places, static=True)
    scene.pinhole(found.intrinsics)


def _log_frames(scene: RerunScene, run: Results, shown: bool) -> None:
    """Log pose, picture and objects of each used frame."""
    seen: dict[int, list[TrackRow]] = defaultdict(list)
    last_seen: dict[int, int] = {}
    for row in run.tracks:
        seen[row.frame].append(row)
        last_seen[row.label] = row.frame
    lasting = {item.label for item in run.found.objects}
    gone: list[int] = []
    for frame, pose in run.poses.items():
        scene.moment(frame, pose.timestamp_s)
        scene.camera(pose.T_world_camera, _picture(run, frame) if shown else None)
        scene.objects(seen[frame])
        scene.gone(gone)
        gone = [row.label for row in seen[frame] if row.label not in lasting and last_seen[row.label] == frame]


def _picture(run: Results, frame: int) -> bytes | None:
    """Return a frame's picture as JPEG; None where it can no longer be read."""
    try:
        return encode_jpeg(run.recording.read(frame).color, JPEG_QUALITY)
    except FrameError:
        return None


EXPORTS.register("rerun")(Export(".rrd", "the rerun viewer", write, extra="rerun"))
