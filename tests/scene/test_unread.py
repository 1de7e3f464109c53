"""Things that depth does not read, and a detector sees: places, labels, and what becomes of them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
from made_scene import CAMERA, THINGS, Shown

from cuboid import FrameResult, Tracker
from cuboid.core.frame import Frame, Intrinsics
from cuboid.detection.types import Detections
from cuboid.outputs import open_results

# Of the made scene: the number of the second thing in what its rays hit, and its middle.
DARK, PLACE = 3, THINGS[1].center
ALL = range(1000)


def dark(shown: Shown, frames: Collection[int] = ALL) -> list[Frame]:
    """The frames of a scene in which depth reads nothing of the second thing, in all of these frames."""
    blank = []
    for frame in shown.frames:
        depth_m = np.where((shown._hits[frame.index] == DARK) & (frame.index in frames), 0, frame.depth_m)
        blank.append(dataclasses.replace(frame, depth_m=depth_m.astype(np.float32)))
    return blank


def detector_of(
    shown: Shown, frames: Collection[int] = ALL, score: float = 0.8
) -> Callable[[Frame, Intrinsics], Detections]:
    """It sees the second thing in these frames, as a screen."""

    def detect(frame: Frame, intrinsics: Intrinsics) -> Detections:
        mask = shown._hits[frame.index] == DARK
        if frame.index not in frames or not mask.any():
            return Detections(np.zeros((0, 4), np.int32), np.zeros((0, 1), np.float32), ("tv",))
        x, y = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
        box = np.array([[x[0], y[0], x[-1] + 1, y[-1] + 1]], np.int32)
        return Detections(box, np.array([[score]], np.float32), ("tv",))

    return detect


def others_of(shown: Shown) -> Callable[[Frame, Intrinsics], object]:
    """Proposals of the first thing alone."""

    def propose(frame: Frame, intrinsics: object) -> object:
        found = shown.proposals(frame, None)
        hit = shown._hits[frame.index]
        kept = [k for k, number in enumerate(np.unique(hit[hit >= 2])) if number != DARK]
        masks = found.masks
        assert masks is not None
        return dataclasses.replace(
            found,
            boxes_xyxy=found.boxes_xyxy[kept],
            scores=found.scores[kept],
            masks=tuple(masks[k] for k in kept),
        )

    return propose


def run(shown: Shown, frames: list[Frame], **options: object) -> tuple[Tracker, list[FrameResult]]:
    options.setdefault("proposals", others_of(shown))
    tracker = Tracker(CAMERA, detector_every=1, **options)  # type: ignore[arg-type]
    return tracker, [result for frame in frames if isinstance(result := tracker.update(frame), FrameResult)]


def test_what_depth_does_not_read_gets_a_label_and_a_place(tmp_path: Path) -> None:
    shown = Shown(frames=30)
    tracker, results = run(shown, dark(shown), detector=detector_of(shown))
    found = [item for item in tracker.objects if item.kind != "volume"]
    assert [item.name for item in found] == ["tv"]
    assert np.linalg.norm(found[0].box.center - PLACE) < 0.08
    assert (abs(found[0].box.size - THINGS[1].size) < 0.12).all()
    assert abs(found[0].box.rotation[:, 2] @ (0.0, 0.0, 1.0)) > 0.99
    label = found[0].label
    seen = {result.index for result in results if label in {one.label for one in result.sightings}}
    assert min(seen) >= 2
    assert seen >= set(range(8, 30))
    rect = next(one.rect_xyxy for one in results[-1].sightings if one.label == label)
    expected = detector_of(shown)(shown.frames[-1], CAMERA).boxes_xyxy[0]
    assert np.abs(rect - expected).max() <= 2
    tracker.save(tmp_path / "out")
    document = json.loads((tmp_path / "out" / "objects.json").read_text())["objects"]
    assert [item.get("kind") for item in document if item["label"] == label] == ["box"]
    again = open_results(tmp_path / "out").found.objects
    assert [item.kind for item in again if item.label == label] == ["box"]


def test_without_a_detector_it_gets_none() -> None:
    shown = Shown(frames=30)
    tracker, _ = run(shown, dark(shown))
    assert all(item.kind == "volume" for item in tracker.objects)
    assert all(np.linalg.norm(item.box.center - PLACE) > 0.15 for item in tracker.objects)


def test_where_depth_reads_depth_decides() -> None:
    shown = Shown(frames=30)
    plain, _ = run(shown, shown.frames)
    tracker, _ = run(shown, shown.frames, detector=detector_of(shown))
    assert [item.label for item in tracker.objects] == [item.label for item in plain.objects]
    assert all(item.kind == "volume" for item in tracker.objects)


def test_two_hits_are_not_enough_nor_are_many_unsure_ones_among_misses() -> None:
    shown = Shown(frames=30)
    for frames, score in (((4, 5), 0.9), (range(0, 30, 6), 0.06)):
        tracker, _ = run(shown, dark(shown), detector=detector_of(shown, frames, score))
        assert all(item.kind == "volume" for item in tracker.objects)


def test_what_is_looked_at_and_not_there_ends() -> None:
    shown = Shown(frames=60)
    tracker, results = run(shown, dark(shown), detector=detector_of(shown, range(12)))
    labels = {one.label for one in results[13].sightings} - {one.label for one in results[59].sightings}
    assert len(labels) == 1
    assert all(item.kind == "volume" for item in tracker.objects)


def test_the_label_stays_when_depth_comes() -> None:
    shown = Shown(frames=60)
    tracker, results = run(
        shown, dark(shown, range(20)), detector=detector_of(shown), proposals=shown.proposals
    )  # fmt: skip
    before = {one.label for one in results[19].sightings}
    near = [item for item in tracker.objects if np.linalg.norm(item.box.center - PLACE) < 0.1]
    assert [item.kind for item in near] == ["volume"]
    assert near[0].label in before
    assert near[0].label in {one.label for one in results[59].sightings}


def test_a_correction_of_the_poses_moves_it() -> None:
    from cuboid.tracking.posed_tracker import PosedTracker

    shown = Shown(frames=20)
    tracker = PosedTracker(CAMERA, proposals=others_of(shown))  # type: ignore[arg-type]
    tracker.use_detector(detector_of(shown), 1)
    for frame in dark(shown):
        tracker.update(frame, anchor=1)
    T = np.eye(4)
    T[:3, 3] = (0.3, 0.0, 0.0)
    (before,) = (item.box.center for item in tracker.objects if item.kind != "volume")
    tracker.apply_correction({1: T})
    (after,) = (item.box.center for item in tracker.objects if item.kind != "volume")
    np.testing.assert_allclose(after - before, (0.3, 0.0, 0.0), atol=1e-6)
