"""The contents of the page of a run, from its result folder."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from cuboid.ground.core.frame import Frame
from cuboid.ground.core.palette import color_of, hex_of, ink_on
from cuboid.ground.core.results import SceneChange, TrackedObject
from cuboid.results.files import ObjectsFile, PoseRow, Results, RunReport, TrackRow
from cuboid.results.files.naming import name_document
from cuboid.results.files.objects import object_to_json, surface_to_json
from cuboid.results.files.rows import EventRow
from cuboid.results.files.text import rounded_list
from cuboid.results.views.report.pictures import (
    Picture,
    Strips,
    best_sightings,
    cut_pictures,
    jpeg_address,
    through_time,
)
from cuboid.results.views.report.points import PackedPoints, pack_points

if TYPE_CHECKING:
    from cuboid.method.relations import Branch

# Decimal places of positions in metres, and of directions.
PLACE_DIGITS = 4
TURN_DIGITS = 6
# Tags of furniture are gray, since colors belong to objects.
FURNITURE_COLOR, FURNITURE_INK = "#6b7484", "#ffffff"


@dataclass(frozen=True, slots=True)
class Summary:
    """The contents of the page.

    Attributes
    ----------
    report : RunReport
    found : ObjectsFile
    frames : tuple of int
        The used frames of the recording, in order.
    poses : tuple of PoseRow
        Poses of these frames.
    tracks : tuple of TrackRow
    points : PackedPoints
    pictures : dict of int to Picture
        By label; an object may have no picture.
    strips : dict of int to list of (int, bytes)
        Small pictures of an object through time, by label: frame and JPEG, by frame.
    changes : tuple of SceneChange
        Empty unless the recording was added to a scene with other recordings.
    events : tuple of EventRow
        By frame.
    """

    report: RunReport
    found: ObjectsFile
    frames: tuple[int, ...]
    poses: tuple[PoseRow, ...]
    tracks: tuple[TrackRow, ...]
    points: PackedPoints
    pictures: dict[int, Picture]
    changes: tuple[SceneChange, ...] = ()
    events: tuple[EventRow, ...] = ()
    strips: Mapping[int, Sequence[tuple[int, bytes]]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of the page, ready for JSON."""
        recording = Path(self.report.recording)
        kept = {item.label for item in self.found.objects}
        seen = spans(self.tracks, self.frames, max(1, len(self.report.rig_cameras)))
        matrices = np.array([pose.T_world_camera[:3] for pose in self.poses], dtype="<f4")
        return {
            "title": recording.name,
            "place": recording.parent.name,
            "run": self.report.to_dict(),
            "skipped": [[kind.frame, kind.count, kind.reason] for kind in self.report.skipped_kinds()],
            "up": None if self.found.up is None else rounded_list(self.found.up, TURN_DIGITS),
            "camera": asdict(self.found.intrinsics),
            "planes": [surface_to_json(plane) for plane in self.found.planes],
            "objects": [self._object(item, seen.get(item.label, [])) for item in self.found.objects],
            "gone": [
                {
                    **label_colors(label),
                    "label": label,
                    "name": self.found.gone_names.get(label, ""),
                    "spans": runs,
                    "into": self._survivor(label),
                }
                for label, runs in sorted(seen.items())
                if label not in kept
            ],
            **self._furniture(),
            "frames": packed(np.array(self.frames, dtype="<i4")),
            **self._cameras(),
            "poses": packed(matrices),
            "points": self.points.to_dict(),
            "inferno": packed(inferno()),
            "changes": [_change(change) for change in self.changes],
            "events": [event_document(event) for event in self.events],
            **self._tree(),
        }

    def _cameras(self) -> dict[str, Any]:
        """Return the cameras of a rig, and which of them took each frame; empty without a rig."""
        if not len(self.report.rig_frames[0]):
            return {}
        names = [camera.name for camera in self.report.rig_cameras]
        numbers = self.report.rig_frames[0][list(self.frames)]
        return {"rig": {"names": names, "cameras": packed(numbers.astype("<i4"))}}

    def _furniture(self) -> dict[str, Any]:
        """Return the furniture; empty if the run did not search for it."""
        if not self.found.furniture:
            return {}
        pieces = [
            {"name": "furniture", **object_to_json(item), "color": FURNITURE_COLOR, "ink": FURNITURE_INK}
            for item in self.found.furniture
        ]
        return {"furniture": pieces}

    def _tree(self) -> dict[str, Any]:
        """Return the tree of the place; empty if the results have no relations."""
        relations = {item.label: item.relations for item in self.found.objects}
        if not any(relations.values()):
            return {}
        from cuboid.method.relations import place_tree

        tree = place_tree(self.found.objects, relations, self.found.planes, self.found.up)
        return {"tree": [_branch(branch) for branch in tree]}

    def named(self, named: TrackedObject) -> Summary:
        """Return a summary with a renamed object."""
        objects = tuple(named if item.label == named.label else item for item in self.found.objects)
        changes = tuple(
            replace(change, name=named.name) if change.label == named.label else change for change in self.changes
        )
        return replace(self, found=replace(self.found, objects=objects), changes=changes)

    def _object(self, item: TrackedObject, seen: list[tuple[int, int]]) -> dict[str, Any]:
        picture = self.pictures.get(item.label)
        return {
            **object_document(item),
            "spans": seen,
            "picture": None if picture is None else _picture(picture),
            "strip": [
                {"frame": frame, "address": jpeg_address(jpeg)} for frame, jpeg in self.strips.get(item.label, ())
            ],
        }

    def _survivor(self, label: int) -> int | None:
        """Return the object into which a label was merged; None if the label is retired."""
        return next((item.label for item in self.found.objects if label in item.merged_labels), None)


def summarise(results: Results, read: Callable[[int], Frame] | None, changes: Sequence[SceneChange] = ()) -> Summary:
    """Gather the contents of the page of a run.

    Parameters
    ----------
    results : Results
    read : callable or None
        Returns a frame of the recording, for pictures; None if the recording is not available.
    changes : sequence of SceneChange
        Changes of its scene by the recording.

    Returns
    -------
    Summary

    Raises
    ------
    InputError
        A file of the results is missing, malformed, or inconsistent with the others.
    """
    pictures, strips = ({}, {}) if read is None else _pictures_and_strips(results, read)
    return Summary(
        report=results.report,
        found=results.found,
        frames=tuple(results.poses),
        poses=tuple(results.poses.values()),
        tracks=tuple(results.tracks),
        points=pack_points(results.map_points()),
        pictures=pictures,
        changes=tuple(changes),
        events=tuple(results.events),
        strips=strips,
    )


def pictures_of(
    results: Results,
    read: Callable[[int], Frame],
    choose: Callable[[Iterable[TrackRow]], dict[int, TrackRow]] = best_sightings,
    gone: Iterable[TrackedObject] = (),
) -> dict[int, Picture]:
    """Return a picture of each object, by label: the best one, or of another choice of sightings.

    Parameters
    ----------
    results, read
        As in `summarise`, with its errors.
    choose : callable
        Returns a row for each label.
    gone : iterable of TrackedObject
        Objects that are no longer in the map, for pictures of them as well.
    """
    boxes = {item.label: item.box for item in (*results.found.objects, *gone)}
    best = {label: row for label, row in choose(results.tracks).items() if label in boxes}
    return cut_pictures(best, read, boxes, results.poses, results.found.intrinsics)[0]


def _pictures_and_strips(results: Results, read: Callable[[int], Frame]) -> tuple[dict[int, Picture], Strips]:
    boxes = {item.label: item.box for item in results.found.objects}
    best = {label: row for label, row in best_sightings(results.tracks).items() if label in boxes}
    chosen = through_time(results.tracks, boxes, best)
    return cut_pictures(best, read, boxes, results.poses, results.found.intrinsics, chosen)


def spans(rows: Iterable[TrackRow], frames: Sequence[int], cameras: int = 1) -> dict[int, list[tuple[int, int]]]:
    """Return the spans of frames in which each label is seen.

    Parameters
    ----------
    rows : iterable of TrackRow
        In frame order.
    frames : sequence of int
        The used frames, ascending.
    cameras : int
        Number of cameras that take turns: a span lasts while each of them, or one, sees the label in its turns.

    Returns
    -------
    dict of int to list of (int, int)
        Spans by label: first and last frame; the label is seen in both and in all used frames between them.
    """
    place = {frame: i for i, frame in enumerate(frames)}
    found: dict[int, list[tuple[int, int]]] = {}
    for row in rows:
        runs = found.setdefault(row.label, [])
        if runs and place[row.frame] - place[runs[-1][1]] <= cameras:
            runs[-1] = (runs[-1][0], row.frame)
        else:
            runs.append((row.frame, row.frame))
    return found


def _branch(branch: Branch) -> dict[str, Any]:
    """Return a part of the tree of the place in the form that the page reads."""
    return {
        "of": branch.of,
        "kind": branch.kind,
        "height": None if branch.height_m is None else round(branch.height_m, 2),
        "children": [_branch(child) for child in branch.children],
    }


def object_document(item: TrackedObject) -> dict[str, Any]:
    """Return an object in the form that the pages read: its fields in `objects.json`, and the colors of its label."""
    return {**object_to_json(item), **name_document(item), **label_colors(item.label)}


def _picture(picture: Picture) -> dict[str, Any]:
    return {
        "frame": picture.frame,
        "address": picture.address,
        "size": list(picture.size),
        "edges": [rounded_list(edge, 1) for edge in picture.edges],
    }


def _change(change: SceneChange) -> dict[str, Any]:
    places = {"from": change.from_m, "to": change.to_m}
    pictures = {"before": change.before, "after": change.after}
    return {
        **label_colors(change.label),
        "label": change.label,
        "name": change.name or "",
        "change": change.change,
        **{key: None if place is None else rounded_list(place, PLACE_DIGITS) for key, place in places.items()},
        "size": rounded_list(change.box.size, PLACE_DIGITS),
        "rotation": [rounded_list(row, TURN_DIGITS) for row in change.box.rotation],
        "metres": None if change.metres is None else round(change.metres, PLACE_DIGITS),
        "sure": round(change.sure, 2),
        **{key: None if jpeg is None else jpeg_address(jpeg) for key, jpeg in pictures.items()},
    }


def event_document(event: EventRow) -> dict[str, Any]:
    """Return an event in the form that the page reads."""
    metres = None if event.metres is None else round(event.metres, PLACE_DIGITS)
    return {
        **label_colors(event.label),
        "label": event.label,
        "frame": event.frame,
        "event": event.event,
        "metres": metres,
    }


def label_colors(label: int) -> dict[str, str]:
    """Return the color of a label, and the color of text on it."""
    return {"color": hex_of(label), "ink": "#{:02x}{:02x}{:02x}".format(*ink_on(color_of(label)))}


def inferno() -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return the colors of heat 0..255, (256, 3), the same as in videos."""
    levels = np.arange(256, dtype=np.uint8)[:, None]
    return np.asarray(cv2.applyColorMap(levels, cv2.COLORMAP_INFERNO), np.uint8)[:, 0, ::-1]


def packed(values: np.ndarray[Any, np.dtype[Any]]) -> str:
    """Return the bytes of an array, base64."""
    return base64.b64encode(values.tobytes()).decode("ascii")
