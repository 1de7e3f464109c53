"""Whatever a tracker is shown, in whatever order: its map stays sound, and a label is one object's for life."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from cuboid.ground.core.config import TrackerConfig
from cuboid.ground.geometry import se3
from cuboid.runs.tracking.posed_tracker import PosedTracker
from worlds import CAMERA, TABLE, Proposer, Watch, World

WAYS = ("round", "jump", "down", "upside down", "on its side")
SPOILT = ("far and near", "noise", "one value", "empty")


@pytest.fixture(autouse=True, scope="module")
def finely() -> Iterator[None]:
    """Let the coarse pictures of these worlds be near enough for fine points."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cuboid.runs.tracking.posed_tracker.resolves_m", lambda *_: 3.0)
        yield


class Worlds(RuleBasedStateMachine):
    """A camera in a small world in which anything may happen."""

    @initialize(
        seed=st.integers(0, 10_000),
        source=st.sampled_from(["true", "true", "strays", "depth"]),
        max_size_m=st.sampled_from([1.0, 1.0, 0.3]),
    )
    def begin(self, seed: int, source: str, max_size_m: float) -> None:
        rng = np.random.default_rng(seed)
        self.world, self.index, self.anchor = World(rng), 0, 1
        self.proposer = None if source == "depth" else Proposer(rng, 4 if source == "strays" else 0)
        self.tracker = PosedTracker(CAMERA, TrackerConfig(max_size_m=max_size_m), self.proposer or "depth")
        self.watch = Watch(self.tracker)
        for _ in range(3):
            self.world.add("alone")

    def show(self, way: str, spoilt: str = "", index: int | None = None) -> None:
        frame, hit = self.world.frame(self.world.pose(way), self.index if index is None else index, spoilt)
        if self.proposer is not None:
            self.proposer.hit, self.proposer.first = hit, len(self.world.room)
        result = self.tracker.update(frame, self.anchor)
        self.index += 1
        self.watch.result(frame, result)
        self.watch.check_map()

    @rule(frames=st.integers(4, 12))
    def go_round(self, frames: int) -> None:
        for _ in range(frames):
            self.show("round")

    @rule(way=st.sampled_from(WAYS))
    def show_view(self, way: str) -> None:
        for _ in range(2):
            self.show(way)

    @rule(spoilt=st.sampled_from(SPOILT), way=st.sampled_from(WAYS))
    def look_at_nothing_real(self, spoilt: str, way: str) -> None:
        self.show(way, spoilt)

    @rule(back=st.integers(0, 20))
    def look_as_an_earlier_frame(self, back: int) -> None:
        self.show("round", index=max(0, self.index - back))

    @rule(way=st.sampled_from(["alone", "beside", "on top"]))
    def add(self, way: str) -> None:
        self.world.add(way)
        self.show("round")

    @precondition(lambda self: self.world.things)
    @rule(which=st.integers(0, 99))
    def remove(self, which: int) -> None:
        self.world.things.pop(which % len(self.world.things))
        self.show("round")

    @precondition(lambda self: len(self.world.things) > 1)
    @rule(which=st.integers(0, 99))
    def swap(self, which: int) -> None:
        self.world.things.pop(which % len(self.world.things))
        self.world.add("alone")
        self.show("round")

    @precondition(lambda self: not any(box is TABLE for box in self.world.room))
    @rule()
    def set_a_table_down(self) -> None:
        self.world.room.append(TABLE)
        self.show("round")

    @rule(new=st.booleans())
    def hang_on_another_keyframe(self, new: bool) -> None:
        self.anchor = self.anchor + 1 if new else int(self.world.rng.integers(0, self.anchor + 1))

    @rule(size=st.sampled_from([0.02, 0.1, 2.0]), count=st.integers(1, 3))
    def apply_correction(self, size: float, count: int) -> None:
        rng = self.world.rng
        moved = {int(k): se3.exp(rng.normal(size=6) * size) for k in rng.integers(0, self.anchor + 2, count)}
        self.tracker.apply_correction(moved)
        self.watch.check_map()
        self.show("round")


TestWorlds = Worlds.TestCase
TestWorlds.settings = settings(
    max_examples=10,
    stateful_step_count=30,
    deadline=None,
    derandomize=True,
    phases=(Phase.generate,),  # a long way is quickly told; to make it short takes minutes
    database=None,
    suppress_health_check=list(HealthCheck),
)


def told(seed: int, frames: int) -> tuple[object, ...]:
    """All that a tracker tells of a world with this seed."""
    rng = np.random.default_rng(seed)
    world, proposer = World(rng), Proposer(rng, 2)
    tracker = PosedTracker(CAMERA, proposals=proposer)
    for way in ("alone", "alone", "beside", "on top"):
        world.add(way)
    seen = []
    for k in range(frames):
        frame, hit = world.frame(world.pose("round"), k)
        proposer.hit, proposer.first = hit, len(world.room)
        result = tracker.update(frame, k // 10)
        if k == frames // 2:
            tracker.apply_correction({0: se3.exp(np.full(6, 0.01))})
        seen.append([(s.label, s.iou, s.visible, s.box.corners().tobytes()) for s in result.sightings])
    points = tracker.map_points()
    objects = [(o.label, o.score, o.points, o.plane, o.box.corners().tobytes()) for o in tracker.objects]
    return seen, objects, points.xyz.tobytes(), points.label.tobytes(), tracker.points_known


@pytest.mark.parametrize("seed", [1, 2])
def test_the_same_world_is_told_the_same_twice(seed: int) -> None:
    once = told(seed, 40)
    assert once == told(seed, 40)
    assert once[1], "a world without objects proves nothing"
