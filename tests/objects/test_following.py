"""Things that are moved while the camera watches keep their labels; people and hands get none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from cuboid.ground.arrays import Float64Array
from cuboid.ground.core.results import FrameResult, ObjectEvent
from cuboid.ground.geometry.box import Box
from cuboid.ground.geometry.se3 import inverse, transform
from cuboid.method.detection.types import Detections
from cuboid.runs.tracking.posed_tracker import PosedTracker
from made_scenes import CAMERA, frame_of, look_at, upright

FLOOR = upright((0.0, 0.0), (6.0, 6.0, 0.02), z=-0.72)
TABLE = upright((0.0, 0.0), (1.2, 0.8, 0.7), z=-0.7)
STANDING = look_at((0.0, -1.1, 0.8), (0.0, 0.0, 0.0))
ASIDE = look_at((0.0, -1.1, 0.8), (2.0, -1.5, -0.7))
SIZES = ((0.12, 0.12, 0.15), (0.2, 0.12, 0.08), (0.09, 0.09, 0.2))
FREE_X, AWAY = (-0.42, -0.21, 0.0, 0.21, 0.42), (0.0, 0.0, -5.0)


class Stage:
    """A table with things before a camera that stands, or turns away; the tracker gets every n-th frame of 30 Hz."""

    def __init__(self, places: list[int], every: int = 3) -> None:
        self.every = every
        self.tracker, self.index, self.events = PosedTracker(CAMERA), 0, list[ObjectEvent]()
        self.camera = self.claimed = STANDING
        self.at: list[tuple[float, float, float]] = [(FREE_X[place], 0.0, 0.0) for place in places]

    def things(self) -> list[Box]:
        return [upright((x, y), size, z=z) for (x, y, z), size in zip(self.at, SIZES, strict=False)]

    def show(self, *others: Box, frames: int = 1) -> FrameResult:
        for _ in range(frames):
            if self.index % self.every == 0:
                boxes = [FLOOR, TABLE, *self.things(), *others]
                self.last = self.tracker.update(frame_of(boxes, self.camera, self.index, T_shown=self.claimed))
                self.events += self.last.events
            self.index += 1
        return self.last

    def look(self, T_world_camera: Float64Array, frames: int = 0) -> None:
        """Turn the camera, and show frames from there."""
        self.camera = self.claimed = T_world_camera
        for _ in range(frames):
            self.show()

    def carry(self, which: int, to: tuple[float, float, float]) -> None:
        """Lift a thing, carry it to a place and put it there, 3 cm a frame."""
        start = np.array(self.at[which])
        up = np.array([0.0, 0.0, 0.25])
        for a, b in ((start, start + up), (start + up, np.array(to) + up), (np.array(to) + up, np.array(to))):
            for part in np.linspace(0, 1, 2 + int(np.linalg.norm(b - a) / 0.03))[1:]:
                self.at[which] = tuple((a + part * (b - a)).tolist())
                self.show()
        self.at[which] = to

    def mugs(self, *_: object) -> Detections:
        """A detector that sees a mug where the first thing stands on the table."""
        if self.at[0] == AWAY:
            return Detections(np.zeros((0, 4), np.int32), np.zeros((0, 1), np.float32), ("mug",))
        pixels = CAMERA.pixels(transform(inverse(self.camera), self.things()[0].corners()))
        rect = np.rint(np.concatenate([pixels.min(0), pixels.max(0)])).astype(np.int32)
        return Detections(rect[None], np.full((1, 1), 0.9, np.float32), ("mug",))

    def label_of(self, which: int) -> int | None:
        """The label of what the map has where a thing is."""
        here = [o for o in self.tracker.objects if np.linalg.norm(o.box.center - self.things()[which].center) < 0.05]
        return here[0].label if here else None


@pytest.mark.parametrize("every", [1, 3, 6], ids=["30 Hz", "10 Hz", "5 Hz"])
def test_a_thing_that_is_carried_keeps_its_label_on_the_way_and_is_told_to_have_moved(every: int) -> None:
    stage = Stage([0, 2], every)
    stage.show(frames=75)
    label, other = stage.label_of(0), stage.label_of(1)
    assert None not in (label, other)
    stage.carry(0, (FREE_X[4], 0.05, 0.0))
    result = stage.show(frames=30)
    assert stage.label_of(0) == label
    assert stage.label_of(1) == other
    assert {seen.label for seen in result.sightings} == {label, other}
    (event,) = stage.events
    assert (event.event, event.label) == ("moved", label)
    assert event.from_m is not None
    assert event.to_m is not None
    np.testing.assert_allclose(event.from_m[:2], (FREE_X[0], 0.0), atol=0.03)
    np.testing.assert_allclose(event.to_m[:2], (FREE_X[4], 0.05), atol=0.03)


def test_things_stay_where_a_hand_moves_elsewhere_and_poses_err() -> None:
    stage = Stage([0, 2])
    stage.show(frames=75)
    labels = stage.label_of(0), stage.label_of(1)
    assert None not in labels
    # A hand comes from the right; poses say that the camera goes ahead, 10 mm a frame.
    for step, x in enumerate(np.linspace(0.75, 0.5, 20), 1):
        stage.claimed = STANDING.copy()
        stage.claimed[:3, 3] += 0.01 * step * STANDING[:3, 2]
        stage.show(upright((float(x), -0.1), (0.1, 0.1, 0.1), z=0.05))
    stage.show(frames=30)
    assert stage.events == []
    assert (stage.label_of(0), stage.label_of(1)) == labels


def test_a_thing_that_is_put_back_has_not_moved() -> None:
    stage = Stage([0, 2])
    stage.show(frames=75)
    label = stage.label_of(0)
    stage.carry(0, (FREE_X[0], 0.0, 0.0))
    stage.show(frames=30)
    assert stage.label_of(0) == label
    assert not stage.events


def test_a_thing_that_is_taken_away_is_gone_and_has_its_label_when_it_is_back() -> None:
    stage = Stage([0, 2], every=1)
    stage.tracker.use_detector(stage.mugs)
    stage.show(frames=75)
    label = stage.label_of(0)
    stage.at[0] = AWAY
    # Somebody's hand is there while it goes.
    for k in range(20):
        stage.show(upright((FREE_X[0] - 0.05 * k, -0.1), (0.08, 0.3, 0.08), z=0.2))
    assert label not in {o.label for o in stage.tracker.objects}
    stage.show(frames=160)
    assert [(one.event, one.label) for one in stage.events] == [("gone", label)]
    assert stage.tracker.gone_names == {label: "mug"}
    stage.at[0] = (FREE_X[4], 0.0, 0.0)
    stage.show(frames=120)
    assert stage.label_of(0) == label
    assert [(one.event, one.label) for one in stage.events] == [("gone", label), ("back", label)]
    assert stage.tracker.gone_names == {}


def test_a_thing_that_is_brought_appears_and_what_never_rests_gets_no_label() -> None:
    stage = Stage([0, 2])
    stage.show(frames=45)
    before = {o.label for o in stage.tracker.objects}
    for k in range(60):
        hand = upright((-0.8 + 0.03 * k, -0.15 + 0.05 * np.sin(k / 5)), (0.1, 0.1, 0.1), z=0.1)
        result = stage.show(hand)
        assert {seen.label for seen in result.sightings} <= before
        if 15 <= k <= 40:
            assert any(np.linalg.norm(box.center - hand.center) < 0.1 for box in result.agents)
    stage.at.append((FREE_X[3], 0.0, 0.0))
    stage.show(frames=130)
    (event,) = stage.events
    assert event.event == "appeared"
    assert event.label == stage.label_of(2)


@pytest.mark.parametrize("watched", [60, 240])
def test_a_thing_that_is_taken_while_the_camera_looks_away_is_gone_when_it_looks_again(watched: int) -> None:
    stage = Stage([0, 2, 4])
    stage.show(frames=watched)
    label = stage.label_of(1)
    others = {stage.label_of(0), stage.label_of(2)}
    assert None not in {label, *others}
    stage.look(ASIDE, frames=30)
    stage.at[1] = AWAY
    stage.look(STANDING, frames=50)
    assert {o.label for o in stage.tracker.objects} == others
    stage.show(frames=160)
    assert [(one.event, one.label) for one in stage.events] == [("gone", label)]


def test_a_thing_that_is_moved_while_the_camera_looks_away_keeps_its_label() -> None:
    stage = Stage([0, 2])
    stage.show(frames=60)
    label, other = stage.label_of(0), stage.label_of(1)
    stage.look(ASIDE, frames=30)
    stage.at[0] = (FREE_X[3], 0.1, 0.0)
    stage.look(STANDING, frames=90)
    assert (stage.label_of(0), stage.label_of(1)) == (label, other)
    assert [(one.event, one.label) for one in stage.events] == [("moved", label)]


def test_things_stay_while_poses_err_after_a_look_aside() -> None:
    stage = Stage([0, 2, 4])
    stage.show(frames=60)
    labels = [stage.label_of(k) for k in range(3)]
    stage.look(ASIDE, frames=30)
    stage.look(STANDING)
    stage.claimed = STANDING.copy()
    stage.claimed[:3, 3] += 0.06 * STANDING[:3, 0]
    for _ in range(90):
        stage.show()
    stage.look(STANDING, frames=30)
    assert [stage.label_of(k) for k in range(3)] == labels
    assert stage.events == []


def test_what_came_while_the_camera_looked_away_gets_a_label_within_a_second() -> None:
    stage = Stage([0, 2])
    stage.show(frames=15)
    before = {o.label for o in stage.tracker.objects}
    assert len(before) == 2
    stage.look(ASIDE, frames=75)
    stage.look(STANDING)
    hand = upright((FREE_X[4], 0.0), (0.09, 0.18, 0.08), z=0.0)
    stage.show(hand, frames=10)
    assert {o.label for o in stage.tracker.objects} == before, "a hand that leaves before"
    stage.show(frames=15)
    stage.at.append((FREE_X[4], 0.0, 0.0))
    stage.show(frames=30)
    assert stage.label_of(2) not in (None, *before)


class Stages(RuleBasedStateMachine):
    """Somebody carries, takes and brings things in any order."""

    @initialize()
    def begin(self) -> None:
        self.stage = Stage([0, 2, 4])
        self.where: dict[int, int | None] = {0: 0, 1: 2, 2: 4}
        self.stage.show(frames=75)
        self.labels = {which: self.stage.label_of(which) for which in self.where}

    @property
    def free(self) -> list[int]:
        return [k for k in range(len(FREE_X)) if k not in self.where.values()]

    @rule(which=st.integers(0, 2), k=st.integers(0, 9))
    def carry(self, which: int, k: int) -> None:
        if self.where[which] is not None and self.free:
            to = self.free[k % len(self.free)]
            self.stage.carry(which, (FREE_X[to], 0.0, 0.0))
            self.where[which] = to
            self.stage.show(frames=20)

    @precondition(lambda self: any(place is not None for place in self.where.values()))
    @rule(which=st.integers(0, 2))
    def take(self, which: int) -> None:
        if self.where[which] is not None:
            self.stage.carry(which, (-1.5, 0.3, 0.0))
            self.stage.at[which], self.where[which] = AWAY, None
            self.stage.show(frames=160)

    @rule(which=st.integers(0, 2), k=st.integers(0, 9))
    def bring(self, which: int, k: int) -> None:
        if self.where[which] is None:
            to = self.free[k % len(self.free)]
            self.stage.at[which], self.where[which] = (FREE_X[to], 0.0, 0.0), to
            self.stage.show(frames=140)

    @rule(frames=st.integers(1, 40))
    def wait(self, frames: int) -> None:
        self.stage.show(frames=frames)

    @invariant()
    def labels_are_for_life(self) -> None:
        if not hasattr(self, "stage"):
            return
        found = {o.label for o in self.stage.tracker.objects}
        assert len(found) == len(self.stage.tracker.objects)
        # Nothing has two labels, none of these is another one's, and what is gone comes back.
        for which, place in self.where.items():
            label = self.stage.label_of(which) if place is not None else None
            assert label in (self.labels[which], None)
        state: dict[int, str] = {}
        for one in self.stage.events:
            assert one.event != "appeared"
            assert (one.event == "back") == (state.get(one.label) == "gone")
            state[one.label] = one.event


TestStages = Stages.TestCase
TestStages.settings = settings(
    max_examples=3,
    stateful_step_count=4,
    deadline=None,
    derandomize=True,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
