"""COCO: the objects' rectangles in the images, with their labels as track ids.

The layout is that of COCO's object detection files, with the additions for videos that TAO and its kin made:
``videos``, ``tracks``, and for an annotation its ``track_id``. ``image_id`` and ``frame_index`` are the number of the
frame in the recording, from 0; annotations count from 1. The first category is "object"; where a detector named
objects, each of their classes is one more, by alphabet.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cuboid.ground.core.results import TrackedObject
from cuboid.ground.formats.stored import is_there
from cuboid.results.files import Results, TrackRow
from cuboid.results.files.objects import write_json
from cuboid.results.files.text import LENGTH, PIXEL, rounded, rounded_list

CATEGORY = 1
VIDEO_ID = 1


def write(run: Results, path: Path) -> list[str]:
    """Write the file; return a note if the recording with the image names is missing."""
    K = run.found.intrinsics
    names = _image_names(run)
    images = [
        {
            "id": frame,
            "file_name": names.get(frame, f"{frame:06d}"),
            "width": K.width,
            "height": K.height,
            "video_id": VIDEO_ID,
            "frame_index": frame,
            "timestamp": rounded(pose.timestamp_s, LENGTH),
        }
        for frame, pose in run.poses.items()
    ]
    seen = [row for row in run.tracks if (row.rect_xyxy[2:] > row.rect_xyxy[:2]).all()]
    categories = _categories(run)
    document = {
        "info": {"description": f"Objects found by cuboid {run.report.version} in {run.report.recording}"},
        "videos": [{"id": VIDEO_ID, "name": Path(run.report.recording).name, "width": K.width, "height": K.height}],
        "categories": [
            {"id": CATEGORY, "name": "object", "supercategory": "object"},
            *({"id": number, "name": name, "supercategory": "object"} for name, number in categories.items()),
        ],
        "tracks": [_track(run, label, categories) for label in sorted({row.label for row in seen})],
        "images": images,
        "annotations": [_annotation(run, number, row, categories) for number, row in enumerate(seen, 1)],
    }
    write_json(path, document)
    if names or not images:
        return []
    return [f"{run.report.recording} is not there: images are named by their numbers (--recording says where it is)"]


def _image_names(run: Results) -> dict[int, str]:
    """Return the file of each frame's image, seen from the recording; none where the recording is gone."""
    # Frames that a program gave to the tracker have no recording.
    if run.recording_path is None and not (run.report.recording and is_there(run.report.recording)):
        return {}
    named = ((frame, run.recording.color_name(frame)) for frame in run.poses)
    return {frame: name for frame, name in named if name is not None}


def _categories(run: Results) -> dict[str, int]:
    """Return the category of each class that a detector gave to an object."""
    names = {item.name for item in run.found.objects if item.name and item.name_score is not None}
    return {name: number for number, name in enumerate(sorted(names), CATEGORY + 1)}


def _category(item: TrackedObject | None, categories: Mapping[str, int]) -> int:
    if item is None or item.name_score is None:
        return CATEGORY
    return categories.get(item.name or "", CATEGORY)


def _track(run: Results, label: int, categories: Mapping[str, int]) -> dict[str, Any]:
    ended = run.survivor.get(label)
    merged_into = ended.label if ended is not None and ended.label != label else None
    name = {"name": ended.name} if ended is not None and ended.name else {}
    return {
        "id": label,
        "category_id": _category(ended, categories),
        "video_id": VIDEO_ID,
        "merged_into": merged_into,
        **name,
    }


def _annotation(run: Results, number: int, row: TrackRow, categories: Mapping[str, int]) -> dict[str, Any]:
    x0, y0, x1, y1 = row.rect_xyxy
    ended = run.survivor.get(row.label)
    return {
        "id": number,
        "image_id": row.frame,
        "category_id": _category(ended, categories),
        "track_id": row.label,
        "bbox": rounded_list((x0, y0, x1 - x0, y1 - y0), PIXEL),
        "area": rounded((x1 - x0) * (y1 - y0), PIXEL),
        "iscrowd": 0,
        "visibility": rounded(row.visible, LENGTH),
        "score": rounded(run.probability_of(row), LENGTH),
    }
