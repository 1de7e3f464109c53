"""A made room that is tracked once, as results, as a scene and as a store, for the questions that people ask."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from cuboid import Tracker, open_recording
from cuboid.fleet.store.files import Part, key_of
from cuboid.fleet.store.folder import StoreFolder
from cuboid.fleet.store.rows import ReadAs, RunHead, day_of, recorded, tables_of
from cuboid.fleet.store.schema import DONE, RUNS, TABLES
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.proposals.types import Proposals
from cuboid.results.files import Results
from cuboid.results.views.report import pictures_of
from cuboid.results.views.report.pictures import last_sightings
from cuboid.runs.scene import RecordingInfo, Scene
from made_scenes import cast, look_at, upright, write_plain
from worlds import FLOOR, TABLE

CAMERA = Intrinsics(136.0, 136.0, 79.5, 59.5, 160, 120)
# 2026-03-01 12:00 UTC.
BEGIN_S = 1772366400.0
# What stands there, with the colors that the camera sees (RGB). The box stands beside the bin. The last frames
# show the bin and the box, but not the can and the parcel, which stands on the floor.
THINGS = {
    "bin": (upright((-0.2, 0.0), (0.16, 0.14, 0.14), 0.3, z=0.48), (29, 31, 54)),
    "box": (upright((-0.16, 0.2), (0.2, 0.16, 0.1), 0.3, z=0.48), (140, 140, 140)),
    "red cup": (upright((0.1, -0.1), (0.08, 0.08, 0.1), 0.3, z=0.48), (190, 30, 30)),
    "can": (upright((0.3, 0.1), (0.1, 0.1, 0.16), 0.0, z=0.48), (40, 150, 60)),
    "parcel": (upright((1.15, 0.3), (0.3, 0.25, 0.2), 0.2, z=0.0), (230, 230, 230)),
}
SURROUNDINGS = (FLOOR, TABLE)
GROUND = ((110, 90, 70), (170, 150, 120))
FRAMES, TURNED = 18, 12


@dataclass(frozen=True)
class Room:
    """The frames of a camera that looks at the floor and the table, and at the end at the bin alone."""

    frames: list[Frame]
    hits: list[np.ndarray]

    def proposals(self, frame: Frame, _: object) -> Proposals:
        """A mask for each thing in the picture."""
        hit = self.hits[frame.index]
        masks = [hit == k for k in np.unique(hit[hit >= len(SURROUNDINGS)])]
        spans = [(np.flatnonzero(m.any(0)), np.flatnonzero(m.any(1))) for m in masks]
        boxes = [(c[0], r[0], c[-1] + 1, r[-1] + 1) for c, r in spans]
        cut = tuple(m[y0:y1, x0:x1].astype(np.uint8) for m, (x0, y0, x1, y1) in zip(masks, boxes, strict=True))
        return Proposals(np.array(boxes, np.int32).reshape(-1, 4), np.full(len(boxes), 0.9, np.float32), cut)


def room(begin_s: float, without: str = "") -> Room:
    """Cast the frames of a room; one thing may be away."""
    things = [one for name, one in THINGS.items() if name != without]
    palette = np.array([*GROUND, *(color for _, color in things), (0, 0, 0)], np.uint8)
    boxes = [*SURROUNDINGS, *(box for box, _ in things)]
    frames, hits = [], []
    for k in range(FRAMES):
        turn = 0.6 + 0.05 * k
        eye = [0.3 + 1.5 * np.cos(turn), 0.1 + 1.5 * np.sin(turn), 1.5]
        T = look_at(eye, [0.4, 0.15, 0.3] if k < TURNED else [-0.5, 0.0, 0.5])
        depth, hit = cast(boxes, T, CAMERA)
        frames.append(Frame(k, begin_s + k / 30, palette[hit], depth.astype(np.float32), T))
        hits.append(hit)
    return Room(frames, hits)


def track(folder: Path, name: str, begin_s: float) -> Path:
    """Write a recording and its results into a folder, name the objects, and return the folder of the results."""
    made = room(begin_s)
    recording = open_recording(write_plain(folder / name, CAMERA, made.frames, posed=False))
    tracker = Tracker(CAMERA, proposals=made.proposals)
    for frame in made.frames:
        tracker.update(frame)
    results = folder / f"{name}-results"
    tracker.save(results, recording=recording)
    return results


def label_of(objects: list, name: str) -> int:
    """The label of the object that is where a thing stands."""
    away = {item.label: float(np.linalg.norm(item.box.center - THINGS[name][0].center)) for item in objects}
    label = min(away, key=lambda one: away[one])
    assert away[label] < 0.05, f"{name} was not found"
    return label


def into_scene(path: Path, begin_s: float, without: str = "") -> None:
    """Let the room go into a scene as a further recording."""
    made = room(begin_s, without)
    source = RecordingInfo("/made/room", "made", "given", len(made.frames), CAMERA, {"every": 1})
    with Scene.open(path) as scene:
        tracker = scene.tracker(CAMERA, proposals=made.proposals, source=source)
        for frame in made.frames:
            tracker.update(frame)


def put_results(store: str, results: Path, recording: str, number: int) -> None:
    """Put the results of a recording into a store, as a batch does."""
    found, place = Results(results), StoreFolder(store)
    newest = datetime(2026, 11, 27, 17, 30, tzinfo=UTC)
    head = RunHead(f"{number:020x}", recording, f"/data/{recording}", "1", "{}", newest, 1)
    read: Callable[[int], Frame] = found.recording.read
    pictures, last = pictures_of(found, read), pictures_of(found, read, last_sightings)
    read_as = ReadAs("plain", FRAMES, CAMERA, has_poses=True)
    tables = tables_of(head, found, read_as, pictures, None, None, last)
    names = Part(key_of(head.run, DONE), day_of(recorded(head, found))).names()
    for table in sorted(names, key=lambda one: one == RUNS):
        place.put_table(names[table], tables[table], TABLES[table].group_rows)
