"""A tracker saved at any moment and loaded goes on as if nothing had happened, byte for byte."""

from __future__ import annotations

import dataclasses
import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.core.errors import FrameError
from cuboid.ground.core.frame import Frame, Intrinsics
from cuboid.ground.core.results import FrameResult
from cuboid.ground.core.state import snapshot
from cuboid.ground.geometry import se3
from cuboid.lab.synthetic import make_scene
from cuboid.lab.synthetic.view import SceneView
from cuboid.method.heatmap import levels
from cuboid.method.poses.sources import ESTIMATED
from cuboid.method.proposals.types import Proposals
from cuboid.results.files.objects import ObjectsFile, write_objects
from cuboid.runs.scene.codec import Encoder, Part, take
from cuboid.runs.scene.database import Writing, open_to_read
from cuboid.runs.scene.localisation import ScenePoses
from cuboid.runs.scene.saving import SceneBlockStore, StateFile, load_state
from cuboid.runs.tracking.posed_tracker import PosedTracker
from worlds import CAMERA, Proposer, World

FRAMES = 36
# Places of frames, of which these tests but one need none.
PLACES = ScenePoses(CAMERA, TrackerConfig())
# To another place, out of view from here.
TURN = se3.compose((1, 0, 0, 0), (20.0, 0, 0))


@pytest.fixture(autouse=True)
def finely(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the coarse pictures of these worlds be near enough for fine points."""
    monkeypatch.setattr("cuboid.runs.tracking.posed_tracker.resolves_m", lambda *_: 3.0)


class Show:
    """Frames of a random world, with what is proposed in each: the same again and again."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        world, proposer = World(rng), Proposer(rng, strays=2)
        for way in ("alone", "alone", "beside", "atop"):
            world.add(way)
        proposer.first = len(world.room)
        self.frames, self.proposals = [], {}
        for index in range(FRAMES):
            if index == FRAMES // 2:
                world.things.pop()
            way = str(rng.choice(["on", "on", "on", "jump", "down"]))
            frame, proposer.hit = world.frame(world.pose(way), index)
            self.frames.append(frame)
            self.proposals[index] = proposer(frame, CAMERA)

    def proposed(self, frame: Frame, _: Intrinsics) -> Proposals:
        return self.proposals[frame.index]

    def tracker(self) -> PosedTracker:
        return PosedTracker(CAMERA, proposals=self.proposed)


def told(result: FrameResult) -> list[object]:
    """Return all that a result says, exactly, but times."""
    said: list[object] = [result.index, result.objects_known, result.heat.tobytes(), result.T_world_camera.tobytes()]
    for one in (*result.sightings, *result.proposals):
        box = one.box
        said += [one.label, box.center.tobytes(), box.size.tobytes(), box.rotation.tobytes(), one.rect_xyxy.tobytes()]
    said += [(one.iou, one.visible) for one in result.sightings]
    return said


def ends(tracker: PosedTracker, folder: Path) -> list[bytes]:
    """Return all that a tracker knows at the end."""
    path = folder / "objects.json"
    write_objects(path, ObjectsFile(tracker.up, CAMERA, tuple(tracker.planes), tuple(tracker.objects)))
    points = tracker.map_points()
    return [path.read_bytes(), *(column.tobytes() for column in (points.xyz, points.rgb, points.heat, points.label))]


def load(connection: sqlite3.Connection, show: Show, block_store: SceneBlockStore | None = None) -> PosedTracker:
    """Return the tracker of a scene."""
    return load_state(connection, CAMERA, show.proposed, block_store=block_store)[0]


def commit(connection: sqlite3.Connection, state: StateFile) -> None:
    connection.execute("BEGIN")
    state.write(connection, state.snapshot())
    connection.execute("COMMIT")


@pytest.mark.parametrize("seed", range(4))
def test_goes_on_from_any_cut(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(levels, "MAX_UNVIEWED_MOMENTS", 3)
    show, rng = Show(seed), np.random.default_rng(100 + seed)
    whole = show.tracker()
    expected = [told(whole.update(frame)) for frame in show.frames]
    tracker, begun = show.tracker(), 0
    file = Writing(tmp_path / "a.cuboid", create=True)
    state = StateFile(file.connection, tracker, PLACES)
    for cut in (*sorted(rng.choice(np.arange(1, FRAMES), 4, replace=False).tolist()), FRAMES):
        for frame in show.frames[begun:cut]:
            assert told(tracker.update(frame)) == expected[frame.index], frame.index
            if rng.random() < 0.3:  # commits in between write only what changed
                commit(file.connection, state)
        commit(file.connection, state)
        tracker, begun = load(file.connection, show), cut
        state = StateFile(file.connection, tracker, PLACES)
    assert ends(tracker, tmp_path) == ends(whole, tmp_path)
    assert len(tracker.voxels.stored.living(fine=True)) > 100
    file.close()


@pytest.mark.parametrize("scene", [False, True])
def test_parts_of_the_map_leave_memory_and_come_back(
    scene: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No result depends on how much memory there is."""
    monkeypatch.setattr(levels, "MAX_UNVIEWED_MOMENTS", 5)
    show = Show(1)
    whole, poor = (
        PosedTracker(CAMERA, proposals=lambda frame, _: show.proposals[frame.index], memory_mb=most_mb)
        for most_mb in (float("inf"), 1.0)
    )
    file = Writing(tmp_path / "a.cuboid", create=True)
    reader = open_to_read(tmp_path / "a.cuboid")
    block_store = SceneBlockStore(reader, tmp_path / "a.cuboid")
    state = StateFile(file.connection, poor, PLACES, block_store)
    least = most = 0.0
    turned = [dataclasses.replace(f, T_world_camera=TURN @ f.T_world_camera) for f in show.frames]
    frames = [*show.frames, *turned, *show.frames]
    for index, frame in enumerate(frames):
        if index == len(show.frames):  # another visit, to a place that it sees first
            whole.begin_visit()
            poor.begin_visit()
        assert told(poor.update(frame)) == told(whole.update(frame)), index
        if scene and index % 3 == 0:
            commit(file.connection, state)
            state.mark_committed()
        assert poor.points_known == whole.points_known
        height_fraction = poor.map_bytes / whole.map_bytes
        least, most = (
            (min(least, height_fraction), max(most, height_fraction)) if index else (height_fraction, height_fraction)
        )
    assert least < 0.7, "what is out of view leaves"
    assert most > 0.9
    assert ends(poor, tmp_path) == ends(whole, tmp_path)
    one, two = (tracker.voxels.stored.hits[tracker.voxels.stored.living()] for tracker in (whole, poor))
    np.testing.assert_array_equal(one, two, "what a visit saw first is not of before the visit")
    reader.close()
    file.close()


def plain(parts: dict[str, Part]) -> dict[str, object]:
    return {
        key: (part.fields, {path: (form, array.tobytes()) for path, (form, array) in part.arrays.items()})
        for key, part in parts.items()
    }


def test_what_has_changed_is_never_taken_for_what_has_not() -> None:
    """What is encoded again and again is what is encoded once; planes that no frame showed are not encoded again."""
    show, encoder, spared = Show(2), Encoder(), 0
    tracker, before = show.tracker(), {}
    frames = [*show.frames, *(dataclasses.replace(f, T_world_camera=TURN @ f.T_world_camera) for f in show.frames[:12])]
    for index, frame in enumerate(frames):
        tracker.update(frame, anchor=index // 12)
        if index in (22, 40):
            tracker.apply_correction({k: se3.exp(np.array([0.01, 0.06 * k, 0.01, 0, 0, 0.01])) for k in (1, 2)})
        parts = encoder.parts(take(tracker.state()))
        for plane in tracker.support.planes:
            again = dataclasses.replace(plane, plan=dataclasses.replace(plane.plan))
            key = f"planes/planes/{plane.identity}"
            anew = plain(Encoder().parts(take(snapshot(again), key)))
            assert anew == plain({name: parts[name] for name in anew}), index
        spared += sum(part is before.get(key) for key, part in parts.items() if key.endswith("/plan"))
        before = parts
    assert spared > 0


def test_what_points_owe_lasts_and_no_look_from_outside_settles_it(tmp_path: Path) -> None:
    """Two places far apart; corrections of both while one is seen, commits, cuts, little memory: the same results."""
    show = Show(2)
    away = [dataclasses.replace(f, T_world_camera=TURN @ f.T_world_camera) for f in show.frames]
    frames = [*show.frames[:12], *away[:12], *show.frames[12:18], *away[12:18]]
    rng, pending = np.random.default_rng(2), []
    moved = {index: {k: se3.exp(rng.normal(0, 0.006, 6)) for k in range(1, 7)} for index in (13, 17, 20, 26, 31)}

    def run(memory_mb: float, meddle: Callable[[PosedTracker, int], PosedTracker]) -> tuple[list[object], list[bytes]]:
        tracker, said = show.tracker(), []
        tracker.voxels.stored.memory_mb = memory_mb
        for index, frame in enumerate(frames):
            if index in moved:
                tracker.apply_correction(moved[index])
            said.append(told(tracker.update(frame, anchor=1 + index // 6)))
            tracker = meddle(tracker, index)
        return said, ends(tracker, tmp_path)

    def profile(tracker: PosedTracker, index: int) -> PosedTracker:
        pending.append(len(tracker.voxels.anchors.pending_cubes[0]))
        ends(tracker, tmp_path)
        return tracker

    def cut(tracker: PosedTracker, index: int) -> PosedTracker:
        if index not in (13, 18, 21, 25, 31):
            return tracker
        commit(file.connection, state(tracker))
        tracker = load(file.connection, show, SceneBlockStore(reader, path))
        tracker.voxels.stored.memory_mb = 1.0
        return tracker

    path = tmp_path / "owing.cuboid"
    file, states = Writing(path, create=True), {}
    reader = open_to_read(path)

    def state(tracker: PosedTracker) -> StateFile:
        return states.setdefault(id(tracker), StateFile(file.connection, tracker, PLACES))

    whole = run(float("inf"), lambda tracker, index: tracker)
    assert run(float("inf"), profile) == whole
    assert min(pending[13:]) > 0
    assert run(1.0, cut) == whole
    reader.close()
    file.close()


def test_estimated_poses_go_on_from_any_cut(tmp_path: Path) -> None:
    scene = make_scene("table", 4, frames=70)
    view = SceneView(scene, scene.intrinsics(160, 120))
    shown = [view.render(k, "clean") for k in range(0, 70, 2)]
    frames = [Frame(k, k / 15, one.color, one.depth_m) for k, one in enumerate(shown)]
    camera = scene.intrinsics(160, 120)

    files: list[Writing] = []

    def run(cuts: tuple[int, ...]) -> tuple[list[bytes], list[bytes]]:
        tracker, poses, told = PosedTracker(camera), ScenePoses(camera, TrackerConfig()), []
        poses.begin(ESTIMATED, first=True)
        for frame in frames:
            try:
                posed = poses.locate(frame, tracker.up)
                tracker.apply_correction(posed.moved)
                said = tracker.update(dataclasses.replace(frame, T_world_camera=posed.T_world_camera), posed.anchor)
                told.append(said.T_world_camera.tobytes())
            except FrameError as error:
                told.append(str(error).encode())
            if frame.index in cuts:
                file = Writing(tmp_path / f"{frame.index}.cuboid", create=True)
                commit(file.connection, StateFile(file.connection, tracker, poses))
                tracker, poses = load_state(file.connection, camera)
                files.append(file)
        return told, [T.tobytes() for T in poses.trajectory(0).values()]

    whole = run(())
    assert sum(len(one) == 128 for one in whole[0]) > 30, "poses are found"
    assert run((3, 11, 17, 29)) == whole
    for file in files:
        file.close()
