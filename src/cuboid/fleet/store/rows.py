"""Conversion of a run's results to rows of the tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import cv2
import numpy as np
import pyarrow as pa

from cuboid.fleet.store.indicators import indicators
from cuboid.fleet.store.schema import BOX_COLUMNS, DONE, OBJECTS, RECORDINGS, RUNS, SIGHTINGS, TABLES, values_of
from cuboid.ground.core.frame import Intrinsics
from cuboid.ground.core.results import Relation, TrackedObject
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import quats_wxyz_from_rotations
from cuboid.method.poses.sources import LOST
from cuboid.method.relations import find_relations, surface_kinds
from cuboid.method.text_search import Embeddings
from cuboid.results.files import Results
from cuboid.results.files.queries import saved_relations
from cuboid.results.views.pixels import encode_jpeg, shrunk
from cuboid.results.views.report.pictures import Picture
from cuboid.services.queries.in_results import later_in_results, seen_in_results
from cuboid.services.queries.likeness import color_fractions, color_word, shape_distribution
from cuboid.services.queries.looking import CALENDAR_S
from cuboid.services.queries.rows import CENTER, SIDES, sigma_names

# Maximum side of a picture in a table, pixels, and JPEG quality: enough for a list; a million pictures take 3 GB.
THUMBNAIL_PX, THUMBNAIL_QUALITY = 120, 75


@dataclass(frozen=True, slots=True)
class RunHead:
    """Values that are known before a run and shared by all of its rows.

    Attributes
    ----------
    run, recording, source, version, settings : str
        As in the columns of `runs`.
    newest : datetime
        Time of the newest file of the recording.
    size_bytes : int
        Total size of the recording's files.
    """

    run: str
    recording: str
    source: str
    version: str
    settings: str
    newest: datetime
    size_bytes: int

    def row(self, state: str, reason: str | None) -> dict[str, Any]:
        """Return the part of the row in `runs` that finished and failed runs share."""
        return {**asdict(self), "state": state, "reason": reason, "finished": datetime.now(UTC)}


@dataclass(frozen=True, slots=True)
class ReadAs:
    """The properties of a recording as it was read.

    Attributes
    ----------
    format : str
    frames : int
    intrinsics : Intrinsics
    has_poses : bool
    """

    format: str
    frames: int
    intrinsics: Intrinsics
    has_poses: bool


def recorded(head: RunHead, results: Results) -> datetime:
    """Return the start of a recording: its first timestamp if that is a calendar time, else its newest file."""
    first_s = next((row.timestamp_s for row in results.poses.values()), 0.0)
    return datetime.fromtimestamp(first_s, UTC) if first_s >= CALENDAR_S else head.newest


def day_of(moment: datetime) -> str:
    """Return the folder, within a table, of the day of a time."""
    return f"day={moment.astimezone(UTC).date().isoformat()}"


def failure(head: RunHead, state: str, reason: str) -> pa.Table:
    """Return the table of `runs` for a recording that failed or was set aside."""
    return TABLES[RUNS].table([head.row(state, reason)])


def tables_of(
    head: RunHead,
    results: Results,
    read_as: ReadAs,
    pictures: Mapping[int, Picture],
    folder: str | None,
    embeddings: Embeddings | None = None,
    last_pictures: Mapping[int, Picture] | None = None,
) -> dict[str, pa.Table]:
    """Return the rows of a finished run, by table.

    Parameters
    ----------
    head : RunHead
    results : Results
    read_as : ReadAs
    pictures : mapping of int to Picture
        Pictures by label.
    folder : str or None
        Folder of the result files in the store.
    embeddings : Embeddings, optional
        Vectors of the objects.
    last_pictures : mapping of int to Picture, optional
        Pictures of the last sightings by label.
    """
    whose = {"run": head.run, "recording": head.recording}
    begin = recorded(head, results)
    objects = _objects(results, pictures, last_pictures or {})
    rows = {
        RUNS: [{**head.row(DONE, None), "results": folder, **_run(results)}],
        RECORDINGS: [{**whose, **_recording(head, results, read_as, begin)}],
        OBJECTS: [{**whose, **row, **_embedding(row, embeddings)} for row in objects],
        SIGHTINGS: [{**whose, **row} for row in _sightings(results)],
    }
    return {name: TABLES[name].table(rows[name]) for name in TABLES}


def settings_text(settings: Mapping[str, Any]) -> str:
    """Return settings as text in canonical form: equal settings give equal texts."""
    return json.dumps(settings, sort_keys=True, ensure_ascii=False, allow_nan=False)


def _run(results: Results) -> dict[str, Any]:
    report, objects = results.report, results.found.objects
    return {
        "poses": report.poses,
        "frames_read": report.frames_read,
        "frames_used": report.frames_used,
        "frames_lost": sum(reason == LOST for _, reason in report.skipped),
        "skipped": [{"frame": frame, "reason": reason} for frame, reason in report.skipped],
        "warnings": list(report.warnings),
        "proposals": len(results.proposal_labels),
        "proposals_labelled": sum(label > 0 for label in results.proposal_labels),
        "sightings": len(results.tracks),
        "labels": len({row.label for row in results.tracks} | set(results.survivor)),
        "objects": len(objects),
        **indicators(objects),
        "stages": [
            {"stage": stage, "median_ms": timing.median_ms, "p95_ms": timing.p95_ms}
            for stage, timing in report.milliseconds.items()
        ],
        "seconds": report.seconds,
        "peak_memory_mb": report.peak_memory_mb,
    }


def _recording(head: RunHead, results: Results, read_as: ReadAs, begin: datetime) -> dict[str, Any]:
    K, up = read_as.intrinsics, results.found.up
    times_s = [row.timestamp_s for row in results.poses.values()] or [0.0]
    return {
        "source": head.source,
        "format": read_as.format,
        "recorded": begin,
        "seconds": times_s[-1] - times_s[0],
        "frames": read_as.frames,
        "bytes": head.size_bytes,
        **{f"{name}_px": value for name, value in asdict(K).items()},
        "has_poses": read_as.has_poses,
        **({} if up is None else dict(zip(("up_x", "up_y", "up_z"), map(float, up), strict=True))),
    }


def _boxes(boxes: Sequence[Box]) -> list[dict[str, float]]:
    """Return the columns of boxes, one dict per box."""
    if not boxes:
        return []
    quats = quats_wxyz_from_rotations([box.rotation for box in boxes])
    values = np.hstack(([box.center for box in boxes], [box.size for box in boxes], quats))
    return [dict(zip(BOX_COLUMNS, row, strict=True)) for row in values.tolist()]


def _objects(
    results: Results, pictures: Mapping[int, Picture], last_pictures: Mapping[int, Picture]
) -> list[dict[str, Any]]:
    found = results.found
    objects = found.objects
    bearers = {f"plane:{k}": piece.label for piece in found.furniture for k in piece.planes}
    kinds = {f"plane:{k}": kind for k, kind in enumerate(surface_kinds(found.planes, found.up)) if kind}
    relations = saved_relations(objects) or find_relations(objects, found.planes, found.up)
    rows = [
        {
            "gone": False,
            "relations": _relations(relations.get(item.label, ()), bearers, kinds),
            **_look(item, results),
            **_pictures(pictures.get(item.label), last_pictures.get(item.label)),
        }
        for item in objects
    ]
    gone = results.gone
    lasting = [last_pictures.get(item.label) for item in gone]
    rows += [{"gone": True, **_pictures(last, last)} for last in lasting]
    every = [*objects, *gone]
    boxes = _boxes([item.box for item in every])
    return [{**_object(results, item), **box, **row} for item, box, row in zip(every, boxes, rows, strict=True)]


def _object(results: Results, item: TrackedObject) -> dict[str, Any]:
    """Return the columns that present and gone objects have, without those of the box."""
    longest, middle, shortest = sorted(map(float, item.box.size), reverse=True)
    return {
        "longest_m": longest,
        "middle_m": middle,
        "shortest_m": shortest,
        "names": [{"name": name, "score": score} for name, score in item.names],
        "sides_seen": list(item.sides_seen) if item.size_sigma_m else None,
        **dict(zip(sigma_names(SIDES), item.size_sigma_m or (None,) * 3, strict=True)),
        **dict(zip(sigma_names(CENTER), item.center_sigma_m or (None,) * 3, strict=True)),
        **values_of(item),
        **_seen(results, item),
    }


def _seen(results: Results, item: TrackedObject) -> dict[str, Any]:
    """Return the columns of the first and the last sighting of an object."""
    first, last = (seen_in_results(results, frame, item) for frame in (item.first_frame, item.last_frame))
    times = {"first_seen": first.time, "last_seen": last.time}
    places = zip(("camera_x_m", "camera_y_m", "camera_z_m"), last.camera_m or (None,) * 3, strict=True)
    later = later_in_results(results, item)
    return {
        **{name: None if time is None else datetime.fromisoformat(time) for name, time in times.items()},
        **dict(places),
        "camera_distance_m": last.distance_m,
        "later": later.state,
        "later_frame": None if later.at is None else later.at.frame,
    }


def _relations(
    relations: Sequence[Relation], bearers: Mapping[str, int], kinds: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Return the relations of an object.

    What is on a surface is also on the furniture that bears it, and on the floor or a table if the surface is one:
    `bearers` has its label, `kinds` this word, by surface.
    """
    rows: list[dict[str, Any]] = []
    for one in relations:
        ends: list[int | str] = [one.to]
        if one.kind == "on" and one.to in bearers:
            ends.append(bearers[str(one.to)])
        if one.to in kinds:
            ends.append(kinds[str(one.to)])
        for to in ends:
            label, surface = (to, None) if isinstance(to, int) else (None, to)
            rows.append({"kind": one.kind, "label": label, "surface": surface, "score": one.score})
    return rows


def _look(item: TrackedObject, results: Results) -> dict[str, Any]:
    """Return the columns for similarity search: colors and shape of an object."""
    cloud = results.cloud(item.label)
    colors = color_fractions(cloud.rgb)
    red, green, blue = (round(float(value)) for value in item.mean_color)
    return {
        "red": red,
        "green": green,
        "blue": blue,
        "color": color_word(colors),
        "colors": colors.tolist(),
        "shape": shape_distribution(cloud.xyz, item.box.size).tolist(),
    }


def _pictures(best: Picture | None, last: Picture | None) -> dict[str, Any]:
    """Return the columns of the best picture and, if it is of another frame, that of the last sighting."""
    found = {} if best is None else {"picture_frame": best.frame, "picture": _small(best)}
    if last is None or (best is not None and best.frame == last.frame):
        return found
    return {**found, "last_picture": _small(last)}


def _small(picture: Picture) -> bytes:
    """Return a picture in the size of the tables, JPEG."""
    color = np.asarray(cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)
    return encode_jpeg(shrunk(color, THUMBNAIL_PX)[..., ::-1], THUMBNAIL_QUALITY)


def _embedding(row: Mapping[str, Any], embeddings: Embeddings | None) -> dict[str, Any]:
    vector = None if embeddings is None else embeddings.vectors.get(row["label"])
    if embeddings is None or vector is None:
        return {}
    return {"embedding": vector.tolist(), "embedding_model": embeddings.model}


def _sightings(results: Results) -> list[dict[str, Any]]:
    return [
        {
            "frame": row.frame,
            "timestamp_s": row.timestamp_s,
            **box,
            **values_of(row),
        }
        for row, box in zip(results.tracks, _boxes([row.box for row in results.tracks]), strict=True)
    ]
