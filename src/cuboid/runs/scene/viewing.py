"""A scene for the 3D page: the map, the changes of the last recording, and names that the scene stores."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np

from cuboid.ground.core.errors import InputError
from cuboid.ground.core.paths import PathLike, as_path
from cuboid.ground.core.results import TrackedObject
from cuboid.inputs.readers import Recording
from cuboid.method.text_search import TextMatch, TextModel
from cuboid.results.files import Results
from cuboid.results.views.replay import Replay
from cuboid.results.views.report import Summary, summarise
from cuboid.results.views.report.pictures import Picture
from cuboid.results.views.report.server import Viewer
from cuboid.runs.scene.scene import Scene


def scene_viewer(
    path: PathLike, work: Path, recording_path: Path | None = None, model: TextModel | None = None
) -> Viewer:
    """Return the viewer of a scene after its last recording.

    Parameters
    ----------
    path : path
        The scene.
    work : Path
        A folder that does not exist yet; the results in it must stay while the page is shown.
    recording_path : Path, optional
        Present path of the last recording. If the recording is missing, the page has no pictures of frames.
    model : TextModel, optional
        Model for text search: the page ranks objects by their fit to a text.

    Raises
    ------
    InputError
        The scene is missing or damaged, holds no recording, or the recording that is given is not the last one.
    """
    file = as_path(path)
    summary = scene_summary(file, work, recording_path)

    def rename(label: int, name: str) -> TrackedObject:
        with Scene.open(file) as scene:  # closed soon, so that a recording can be added meanwhile
            scene.name(label, name)
        return Results(work).name(label, name)

    def find(text: str) -> list[TextMatch]:
        with Scene.open(file) as scene:
            return scene.find(text, model)

    recording = _recording(work, recording_path)
    return Viewer(work, Replay(work, recording_path), recording, rename, summary, None if model is None else find)


def scene_summary(path: PathLike, work: Path, recording_path: Path | None = None) -> Summary:
    """Return the contents of the page of a scene after its last recording; parameters and errors of `scene_viewer`."""
    file = as_path(path)
    with Scene.open(file) as scene:
        if not scene.recordings:
            raise InputError(f"{file}: the scene holds no recording yet")
        number = len(scene.recordings)
        scene.write_results(work, number)
        changes = scene.shown_changes(number)
        kept = {item.label: scene.picture(item.label) for item in scene.objects}
    recording = _recording(work, recording_path)
    summary = summarise(Results(work), None if recording is None else recording.without_poses().read, changes)
    pictures = {label: _picture(jpeg) for label, jpeg in kept.items() if jpeg is not None} | summary.pictures
    return dataclasses.replace(summary, pictures=pictures)


def _recording(folder: Path, path: Path | None) -> Recording | None:
    """Return the recording of results; None if it is missing and no path is given."""
    try:
        return Results(folder, path).recording
    except InputError:
        if path is not None:
            raise
        return None


def _picture(jpeg: bytes) -> Picture:
    """Return a stored picture; its frame and the object's place in it are unknown."""
    height, width = np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)).shape[:2]
    return Picture(None, jpeg, (width, height), np.zeros((0, 4)))
