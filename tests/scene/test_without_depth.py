"""Things that depth does not read, and a detector sees: places, labels, and what becomes of them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
import pytest
from made_scene import CAMERA, THINGS, Shown, record

from cuboid import FrameResult, Tracker
from cuboid.ground.core.errors import InputError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.method.detection.types import Detections
from cuboid.results.files import open_results
from cuboid.runs.scene import RecordingInfo, Scene, SceneObject
from cuboid.runs.scene.checking import problems
from made_scenes import upright

# Of the made scene: the number of the second thing in what its rays hit, and its middle.
DARK, PLACE = 3, THINGS[1].center
ALL = range(1000)
# Height of the table, and a thing at its far end.
TABLE_TOP_M, FAR = 0.48, upright((-0.4, -0.3), (0.16, 0.12, 0.14), 0.3, z=0.48)


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
    assert (abs(found[0].box.size - THINGS[1].size) < 0.24).all()
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
    stated = next(item.size_sigma_m for item in again if item.label == label)
    assert (np.array(stated) > 0.0).all()
    assert stated == pytest.approx(found[0].size_sigma_m, abs=1e-4)


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
    tracker, results = run(shown, dark(shown), detector=detector_of(shown, range(24)))
    labels = {one.label for one in results[13].sightings} - {one.label for one in results[59].sightings}
    assert len(labels) == 1
    assert all(item.kind == "volume" for item in tracker.objects)


def test_the_label_stays_when_depth_comes() -> None:
    shown = Shown(frames=60)
    tracker, results = run(shown, dark(shown, range(20)), detector=detector_of(shown), proposals=shown.proposals)
    before = {one.label for one in results[19].sightings}
    near = [item for item in tracker.objects if np.linalg.norm(item.box.center - PLACE) < 0.1]
    assert [item.kind for item in near] == ["volume"]
    assert near[0].label in before
    assert near[0].label in {one.label for one in results[59].sightings}


def test_a_correction_of_the_poses_moves_it() -> None:
    from cuboid.runs.tracking.posed_tracker import PosedTracker

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


def into_scene(
    path: Path,
    shown: Shown,
    frames: list[Frame],
    *,
    detected: Collection[int] = ALL,
    detect: Callable[[Frame, Intrinsics], Detections] | None = None,
) -> set[int]:
    """Let a recording go into a scene, with a detector; return the labels that its last frame shows."""
    detector = detect or detector_of(shown, detected)
    _, last = record(path, shown, frames=frames, proposals=others_of(shown), detector=detector, detector_every=1)
    return {one.label for one in last.sightings}


def without_depth_of(path: Path) -> list[SceneObject]:
    with Scene.open(path) as scene:
        return [item for item in scene.all_objects if item.kind != "volume"]


Kitchen = tuple[Path, SceneObject]


@pytest.fixture
def kitchen(tmp_path: Path) -> Kitchen:
    """A scene with a thing that depth does not read."""
    path, shown = tmp_path / "kitchen.cuboid", Shown(frames=30)
    into_scene(path, shown, dark(shown))
    (item,) = without_depth_of(path)
    return path, item


def test_in_a_scene_it_keeps_its_label_from_one_recording_to_the_next(tmp_path: Path) -> None:
    path, shown = tmp_path / "kitchen.cuboid", Shown(frames=30)
    first = into_scene(path, shown, dark(shown))
    (item,) = without_depth_of(path)
    assert item.label in first
    assert (item.kind, item.name, item.state, item.points) == ("box", "tv", "present", 0)
    assert np.linalg.norm(item.box.center - PLACE) < 0.08
    assert item.last_seen == (1, 29)
    again = Shown(frames=20, begin=0.5)
    second = into_scene(path, again, dark(again))
    assert item.label in second
    (later,) = without_depth_of(path)
    assert (later.label, later.state, later.last_seen) == (item.label, "present", (2, 19))
    with Scene.open(path) as scene:
        history = scene.history(item.label)
        assert {past.recording for past in history} == {1, 2}
        scene.write_results(tmp_path / "results", 2)
    assert [one.kind for one in open_results(tmp_path / "results").objects if one.label == item.label] == ["box"]
    assert problems(path) == []


def test_a_scene_without_a_detector_leaves_it_as_it_was(kitchen: Kitchen) -> None:
    (path, item), shown = kitchen, Shown(frames=30)
    objects, _ = record(path, shown, "again", frames=dark(shown), proposals=others_of(shown))
    assert item.label not in {one.label for one in objects}  # this recording has not seen it
    (later,) = without_depth_of(path)
    assert (later.label, later.state, later.last_seen) == (item.label, "present", (1, 29))


def test_in_a_scene_it_ends_when_it_is_not_there_any_more(tmp_path: Path) -> None:
    path, shown = tmp_path / "kitchen.cuboid", Shown(frames=30)
    into_scene(path, shown, dark(shown))
    again = Shown(frames=60)
    into_scene(path, again, dark(again), detected=())
    (item,) = without_depth_of(path)
    assert item.state == "gone"
    assert problems(path) == []


def test_in_a_scene_its_label_stays_when_depth_comes(kitchen: Kitchen) -> None:
    path, item = kitchen
    again = Shown(frames=40)
    record(path, again, "again", detector=detector_of(again), detector_every=1)
    assert without_depth_of(path) == []
    with Scene.open(path) as scene:
        near = [one for one in scene.objects if np.linalg.norm(one.box.center - PLACE) < 0.1]
        assert [(one.label, one.kind) for one in near] == [(item.label, "volume")]
        assert item.label not in {one.label for one in scene.changes() if one.change == "new"}
    assert problems(path) == []


def halves_of(shown: Shown) -> Callable[[Frame, Intrinsics], Detections]:
    """A detector that sees the left and the right half of the second thing as two."""
    whole = detector_of(shown)

    def detect(frame: Frame, intrinsics: Intrinsics) -> Detections:
        found = whole(frame, intrinsics)
        left, right = found.boxes_xyxy.copy(), found.boxes_xyxy.copy()
        left[:, 2] = right[:, 0] = found.boxes_xyxy[:, ::2].mean(axis=1).astype(np.int32)
        return Detections(np.vstack([left, right]), np.vstack([found.scores] * 2), found.names)

    return detect


def test_people_merge_two_labels_of_what_depth_does_not_read(tmp_path: Path) -> None:
    path, shown = tmp_path / "kitchen.cuboid", Shown(frames=30)
    into_scene(path, shown, dark(shown), detect=halves_of(shown))
    older, younger = (item.label for item in without_depth_of(path))
    with Scene.open(path) as scene:
        assert scene.merge(younger, older) == older
    (one,) = [item for item in without_depth_of(path) if item.label == older]
    assert (one.label, one.kind, one.name, one.state) == (older, "box", "tv", "present")
    assert np.linalg.norm(one.box.center - PLACE) < 0.08
    assert (abs(one.box.size - THINGS[1].size) < 0.24).all()
    with Scene.open(path) as scene:
        assert [(item.state, item.merged_into) for item in scene.all_objects if item.label == younger] == [
            ("merged", older)
        ]
    assert problems(path) == []
    again = Shown(frames=20, begin=0.5)
    assert older in into_scene(path, again, dark(again))  # whole from now on
    assert [(item.label, item.last_seen) for item in without_depth_of(path) if item.state == "present"] == [
        (older, (2, 19))
    ]


def test_people_merge_it_with_an_object_of_the_map(kitchen: Kitchen) -> None:
    path, item = kitchen
    with Scene.open(path) as scene:
        volume = next(one for one in scene.objects if one.kind == "volume")
        kept = scene.merge(item.label, volume.label)
        assert kept == min(item.label, volume.label)
        (one,) = [one for one in scene.objects if one.label == kept]
        assert (one.kind, one.name) == ("volume", "tv")
        np.testing.assert_allclose(one.box.center, volume.box.center)
        gone = max(item.label, volume.label)
        assert [one.merged_into for one in scene.all_objects if one.label == gone] == [kept]
    assert problems(path) == []


def test_what_is_far_apart_is_not_merged(tmp_path: Path) -> None:
    path, shown = tmp_path / "kitchen.cuboid", Shown((*THINGS[:2], FAR), frames=30)
    into_scene(path, shown, dark(shown))
    (item,) = without_depth_of(path)
    with Scene.open(path) as scene:
        apart_m = {one.label: float(np.linalg.norm(one.box.center - item.box.center)) for one in scene.objects}
        far = max(apart_m, key=lambda label: apart_m[label])
        with pytest.raises(InputError, match=f"are {apart_m[far]:.2f} m apart, farther than they are large"):
            scene.merge(item.label, far)
        assert {one.label for one in scene.objects} == {*apart_m}


def test_people_forget_and_name_it(kitchen: Kitchen) -> None:
    path, item = kitchen
    with Scene.open(path) as scene:
        scene.name(item.label, "my screen")
    (named,) = without_depth_of(path)
    assert (named.name, named.names[0][0]) == ("my screen", "tv")
    with Scene.open(path) as scene:
        scene.forget(item.label)
        assert item.label not in {one.label for one in scene.objects}
    again = Shown(frames=20)
    assert item.label not in into_scene(path, again, dark(again), detected=())


def test_a_run_that_was_broken_off_goes_on_with_it(tmp_path: Path) -> None:
    """After each commit the state has all of it: the same labels as in one go, box for box."""
    whole, broken, shown = tmp_path / "whole.cuboid", tmp_path / "broken.cuboid", Shown(frames=30)
    into_scene(whole, shown, dark(shown))
    source = RecordingInfo("/made", "made", "given", 30, CAMERA, {"every": 1})
    for part, resume in ((dark(shown)[:7], False), (dark(shown)[7:], True)):
        with Scene.open(broken) as scene:
            options = {"proposals": others_of(shown), "source": source, "resume": resume}
            tracker = scene.tracker(CAMERA, **options)  # type: ignore[arg-type]
            tracker.use_detector(detector_of(shown), 1)
            for frame in part:
                tracker.update(frame)
            tracker.close(complete=resume)
    (one,), (other,) = without_depth_of(whole), without_depth_of(broken)
    assert (one.label, one.score, one.frames_seen) == (other.label, other.score, other.frames_seen)
    np.testing.assert_array_equal(one.box.center, other.box.center)
    np.testing.assert_array_equal(one.box.size, other.box.size)


def test_the_true_size_is_within_two_stated_deviations() -> None:
    rng = np.random.default_rng(7)
    off = []
    for turn, (x, y), size in zip(
        rng.uniform(0.0, np.pi, 16),
        rng.uniform(-0.15, 0.15, (16, 2)),
        rng.uniform((0.1, 0.1, 0.01), (0.2, 0.2, 0.25), (16, 3)),
        strict=True,
    ):
        thing = upright((x, y + 0.15), tuple(size), turn, z=TABLE_TOP_M)
        shown = Shown((FAR, thing), frames=24)
        detect = wrong_sides(detector_of(shown), 1.0 + rng.normal(0.0, 0.1, 2))
        tracker, _ = run(shown, dark(shown), detector=detect)
        (item,) = [item for item in tracker.objects if item.kind != "volume"]
        # Which horizontal side is the width depends on where the camera is.
        sides = min((thing.size, thing.size[[1, 0, 2]]), key=lambda true: float(np.abs(item.box.size - true).max()))
        off.append(np.abs(item.box.size - sides) / item.size_sigma_m)
    within = np.array(off) <= 2.0
    assert within.mean() >= 0.93
    assert (within.mean(axis=0) >= 0.85).all()
    assert np.median(off) > 0.4  # no larger than the errors need


def wrong_sides(
    detect: Callable[[Frame, Intrinsics], Detections], factor: np.ndarray
) -> Callable[[Frame, Intrinsics], Detections]:
    """A detector whose rectangles are all too wide and too high, or too narrow and too low, by these factors."""

    def changed(frame: Frame, intrinsics: Intrinsics) -> Detections:
        found = detect(frame, intrinsics)
        low, high = found.boxes_xyxy[:, :2], found.boxes_xyxy[:, 2:]
        middle, half = (low + high) / 2.0, (high - low) / 2.0 * factor
        around = np.clip(np.hstack([middle - half, middle + half]), 0, [CAMERA.width, CAMERA.height] * 2)
        return dataclasses.replace(found, boxes_xyxy=np.rint(around).astype(np.int32))

    return changed
