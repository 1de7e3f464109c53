"""rerun: the run as a recording for the rerun viewer, its entities as in `cuboid.results.views.rerun_scene`.

A label that was merged into another, or retired, is cleared after the last frame that saw it.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.results import names_of
from cuboid.results.exports.shown_frames import missing_pictures, shown_frames
from cuboid.results.files import Results
from cuboid.results.views.pixels import encode_jpeg
from cuboid.results.views.rerun_scene import RerunScene
from cuboid.results.views.rerun_view import JPEG_QUALITY


def write(run: Results, path: Path) -> list[str]:
    """Write the file; return a note if the recording with the pictures is missing."""
    scene = RerunScene(Path(run.report.recording).name, "--to rerun")
    missing = missing_pictures(run)
    scene.stream.save(path)
    _log_surroundings(scene, run)
    _log_frames(scene, run, not missing)
    scene.close()
    return missing


def _log_surroundings(scene: RerunScene, run: Results) -> None:
    """Log what does not change: the map, planes, the camera's path and its pinhole."""
    found = run.found
    scene.names = names_of(found.objects)
    scene.up(found.up)
    scene.labels({row.label for row in run.tracks} | {item.label for item in found.objects})
    scene.map(run.map_points(), static=True)
    scene.planes(found.planes, static=True)
    places: dict[str, list[Float64Array]] = defaultdict(list)
    for frame, pose in run.poses.items():
        places[_camera(run, frame)].append(pose.T_world_camera[:3, 3])
    lenses = {camera.name: camera.intrinsics for camera in run.report.rig_cameras}
    for name, path in places.items():
        scene.path(np.array(path), static=True, camera=name)
        scene.pinhole(lenses.get(name, found.intrinsics), name)


def _log_frames(scene: RerunScene, run: Results, shown: bool) -> None:
    """Log pose, picture and objects of each used frame."""
    for frame, pose, seen, gone in shown_frames(run):
        scene.moment(frame, pose.timestamp_s)
        camera = _camera(run, frame)
        scene.camera(pose.T_world_camera, _picture(run, frame) if shown else None, camera)
        scene.objects(seen, camera)
        scene.gone(gone)


def _camera(run: Results, frame: int) -> str:
    """Return the name of a frame's camera; empty without a rig."""
    camera = run.report.camera_of(frame)
    return "" if camera is None else camera.name


def _picture(run: Results, frame: int) -> bytes | None:
    """Return a frame's picture as JPEG; None where it can no longer be read."""
    try:
        return encode_jpeg(run.recording.read(frame).color, JPEG_QUALITY)
    except FrameError:
        return None
