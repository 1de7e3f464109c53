"""A result folder from a scene: the same files as `cuboid track` writes, for one of the scene's recordings."""

from __future__ import annotations

import sqlite3
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import UnsetType

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.results import FrameResult, Sighting, TrackedObject
from cuboid.ground.version import __version__
from cuboid.results.files import ObjectsFile, ResultWriter, RunReport
from cuboid.results.files.report import rig_frames
from cuboid.runs.scene.answers import SceneObject, ScenePast
from cuboid.runs.scene.furniture import known_furniture, of_recording, read_names
from cuboid.runs.scene.reader import SceneReader
from cuboid.runs.scene.validation import DamagedError, Settings, SettingsOfRig, columns_of, document, read_rows
from cuboid.runs.scene.visit import load_tracker

NOT_IN_SCENE = "the scene has no pose of this frame"


def write_results(
    scene: SceneReader, connection: sqlite3.Connection, number: int, folder: Path, *, force: bool
) -> None:
    """Write the results of a recording: its sightings, with the objects' boxes at its end.

    Parameters
    ----------
    scene : SceneReader
    connection : sqlite3.Connection
        Connection to the scene.
    number : int
        Number of the recording.
    folder : Path
    force : bool
        Whether existing results are replaced.

    Raises
    ------
    InputError
        There is no such recording.
    OutputError
        The results cannot be written.
    """
    names = ("path", "format", "poses", "complete", "next_frame", "settings", "first_frame")
    columns = columns_of("recordings", names)
    rows = read_rows(connection, columns, "recordings WHERE id = ?", (number,))
    if not rows:
        raise InputError(f"{scene.path}: there is no recording {number}; there are 1 to {len(scene.recordings)}")
    path, form, poses, complete, frames, settings, first_frame = rows[0]
    config = document(settings, dict[str, Any], "recordings.settings")
    every = document(settings, Settings, "recordings.settings").every
    posed_frames = scene.poses(number)
    frame_cameras = _frame_cameras(settings, max(posed_frames, default=-1))
    _, numbers = rig_frames(config)
    taken: Sequence[int] = range(0, frames, every)
    if len(numbers):  # of a rig, each camera has its own n-th frames
        taken = np.flatnonzero(numbers[:frames] % every == 0).tolist()
    missing = [k for k in taken if k not in posed_frames]
    sightings, objects = _seen(scene, number)
    tracker, planes = load_tracker(connection, scene.path), scene.planes
    with ResultWriter(folder, force=force, rig=bool(frame_cameras)) as writer:
        for frame, (time_s, T_world_camera) in posed_frames.items():
            seen, heat = tuple(sightings.get(frame, ())), np.zeros((0, 0), np.float32)
            camera = frame_cameras[frame] if frame_cameras else ""
            writer.add(FrameResult(frame, time_s, T_world_camera, seen, (), len(objects), heat, {}, camera=camera))
        report = RunReport(
            version=__version__,
            complete=bool(complete),
            recording=path,
            format=form,
            poses=poses,
            threads=1,
            config={**config, "tracker": tracker.config.to_dict()},
            frames_read=len(taken),
            frames_used=len(posed_frames),
            skipped=tuple((frame, NOT_IN_SCENE) for frame in missing),
            milliseconds={},
            seconds=0.0,
            peak_memory_mb=0.0,
        )
        points = tracker.map_points()
        intrinsics = scene.intrinsics(number)
        furniture = tuple(of_recording(known_furniture(tracker, points, read_names(connection)), first_frame))
        found = ObjectsFile(tracker.up, intrinsics, planes, points.counted(objects), furniture=furniture)
        writer.finish(found, points, report)


def _frame_cameras(settings: str, last_frame: int) -> list[str]:
    """Return the name of the camera of each frame of a rig; empty for one camera.

    It is also empty for a live rig whose run was killed: the sequence is stored at the end of a run.

    Raises
    ------
    DamagedError
        The rig has not a camera for each frame up to the last one with a pose.
    """
    rig = document(settings, SettingsOfRig, "recordings.settings").rig
    if isinstance(rig, UnsetType) or not rig.sequence:
        return []
    if max(rig.sequence) >= len(rig.cameras):
        raise DamagedError(
            f"recordings.settings is damaged: a frame is of camera {max(rig.sequence)}, the last camera of the rig is "
            f"{len(rig.cameras) - 1}"
        )
    if len(rig.sequence) <= last_frame:
        raise DamagedError(
            f"recordings.settings is damaged: the rig has cameras for {len(rig.sequence)} frames, expected at least "
            f"{last_frame + 1}"
        )
    return [rig.cameras[k] for k in rig.sequence]


def _seen(scene: SceneReader, number: int) -> tuple[dict[int, list[Sighting]], list[TrackedObject]]:
    """Return the sightings of a recording by frame, and the objects that were seen in it."""
    frames: dict[int, list[Sighting]] = defaultdict(list)
    objects: list[TrackedObject] = []
    gone = {change.label for change in scene.changes(number) if change.recording == number and change.change == "gone"}
    for item in scene.all_objects:
        sightings = [past for past in scene.history(item.label) if past.recording == number]
        if item.merged_into is not None or item.state == "forgotten" or not sightings:
            continue
        for past in sightings:
            frames[past.frame].append(Sighting(past.label, past.box, past.iou, past.visible, past.rect_xyxy))
        if item.label not in gone and item.state != "unlikely":
            objects.append(_object(item, sightings, last=number == len(scene.recordings)))
    for rows in frames.values():
        rows.sort(key=lambda change: change.label)
    return frames, objects


def _object(item: SceneObject, sightings: list[ScenePast], *, last: bool) -> TrackedObject:
    """Return an object with its box at the end of a recording.

    Only of the `last` recording the scene knows how sure that box is.
    """
    values = {item_field.name: getattr(item, item_field.name) for item_field in fields(TrackedObject)}
    if not last:
        values |= {"size_sigma_m": (), "center_sigma_m": (), "sides_seen": ()}
    seen = {past.frame for past in sightings}
    return TrackedObject(
        **{
            **values,
            "box": sightings[-1].box,
            "first_frame": min(seen),
            "last_frame": max(seen),
            "frames_seen": len(seen),
        }
    )
